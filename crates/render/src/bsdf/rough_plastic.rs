//! Rough plastic: a diffuse base below a frosted coat.

use super::microfacet::Microfacet;
use super::plastic::{base_reflectance, specular_probability};
use super::rough_conductor::{facet_reflection, sample_facet_reflection};
use super::rough_transmittance::RoughTransmittance;
use super::{BsdfSample, Lobe, TransportMode, fresnel};
use crate::math::fns::sqr;
use crate::math::{Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// A diffuse base below a dielectric coat with microfacets, with all interreflection between both.
#[derive(Clone, Debug)]
pub struct RoughPlastic {
    /// Distribution of the coat's normals; isotropic.
    pub microfacet: Microfacet,
    /// Reflectance of the base, in [0, 1].
    pub diffuse_reflectance: Spectrum,
    /// A factor on the light that the coat reflects; 1 for a real material.
    pub specular_reflectance: Spectrum,
    /// Refractive index of the coat over that outside.
    pub eta: f32,
    /// The coat's transmittance, for the same distribution and `eta`: made once for a material.
    pub transmittance: RoughTransmittance,
    /// Whether the base colors light each time that the coat sends it back: colors become more saturated.
    pub nonlinear: bool,
}

impl RoughPlastic {
    #[inline]
    fn specular_probability(&self, wo: Vec3) -> f32 {
        specular_probability(self.transmittance.eval(wo.z), self.specular_reflectance, self.diffuse_reflectance)
    }

    #[inline]
    fn base(&self, wo: Vec3, wi: Vec3) -> Spectrum {
        let base = base_reflectance(self.diffuse_reflectance, self.transmittance.internal_reflectance, self.nonlinear);
        let t = self.transmittance.eval(wo.z) * self.transmittance.eval(wi.z);
        base * (t * warp::cosine_hemisphere_pdf(wi.z) / sqr(self.eta))
    }

    #[inline]
    fn coat(&self, wo: Vec3, wi: Vec3, m: Vec3, pdf: f32) -> Spectrum {
        self.specular_reflectance * (fresnel::dielectric(wo.dot(m), self.eta).0 * pdf * self.microfacet.g1(wi, m))
    }

    /// See the contract in [`crate::bsdf`].
    pub fn eval(&self, wo: Vec3, wi: Vec3, _mode: TransportMode) -> Spectrum {
        match facet_reflection(&self.microfacet, wo, wi) {
            Some((m, pdf)) => self.coat(wo, wi, m, pdf) + self.base(wo, wi),
            None => Spectrum::ZERO,
        }
    }

    /// See the contract in [`crate::bsdf`].
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        facet_reflection(&self.microfacet, wo, wi).map_or(0.0, |(_, coat_pdf)| {
            let p = self.specular_probability(wo);
            p * coat_pdf + (1.0 - p) * warp::cosine_hemisphere_pdf(wi.z)
        })
    }

    /// See the contract in [`crate::bsdf`].
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, _mode: TransportMode) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let p = self.specular_probability(wo);
        let (wi, m, coat_pdf, lobe) = if u_lobe < p {
            let (wi, m, pdf) = sample_facet_reflection(&self.microfacet, wo, u)?;
            (wi, m, pdf, Lobe::GLOSSY)
        } else {
            let wi = warp::cosine_hemisphere(u);
            let (m, pdf) = facet_reflection(&self.microfacet, wo, wi)?;
            (wi, m, pdf, Lobe::DIFFUSE)
        };
        let pdf = p * coat_pdf + (1.0 - p) * warp::cosine_hemisphere_pdf(wi.z);
        let value = self.coat(wo, wi, m, coat_pdf) + self.base(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, value, pdf, lobe: lobe.union(Lobe::REFLECTION), eta: 1.0 })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::DIFFUSE.union(Lobe::GLOSSY).union(Lobe::REFLECTION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        let t = self.transmittance.eval(wo.z);
        let internal = self.transmittance.internal_reflectance;
        let base = base_reflectance(self.diffuse_reflectance, internal, self.nonlinear);
        self.specular_reflectance * (1.0 - t) + base * (t * (1.0 - internal))
    }
}
