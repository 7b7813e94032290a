//! Smooth plastic: a diffuse base below a clear coat.

use super::{BsdfSample, Lobe, TransportMode, fresnel};
use crate::math::fns::sqr;
use crate::math::{Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// A diffuse base below a smooth dielectric coat, with all interreflection between both.
#[derive(Clone, Debug)]
pub struct Plastic {
    /// Reflectance of the base, in [0, 1].
    pub diffuse_reflectance: Spectrum,
    /// A factor on the mirrored light; 1 for a real material.
    pub specular_reflectance: Spectrum,
    /// Refractive index of the coat over that outside.
    pub eta: f32,
    /// [`fresnel::diffuse_reflectance`] of 1 / eta: the share of the base's light that the coat sends back.
    pub internal_reflectance: f32,
    /// Whether the base colors light each time that the coat sends it back: colors become more saturated.
    pub nonlinear: bool,
}

impl Plastic {
    /// Plastic with the internal reflectance of a smooth coat. Costs two logarithms: where only the colors change from
    /// hit to hit, keep one and change its colors.
    pub fn new(diffuse_reflectance: Spectrum, specular_reflectance: Spectrum, eta: f32, nonlinear: bool) -> Self {
        let internal_reflectance = fresnel::diffuse_reflectance(1.0 / eta);
        Self { diffuse_reflectance, specular_reflectance, eta, internal_reflectance, nonlinear }
    }

    // The probability to sample the mirror, given the share of light that enters the coat.
    #[inline]
    fn specular_probability(&self, transmittance: f32) -> f32 {
        specular_probability(transmittance, self.specular_reflectance, self.diffuse_reflectance)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, _mode: TransportMode) -> Spectrum {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Spectrum::ZERO;
        }
        let t = (1.0 - fresnel::dielectric(wo.z, self.eta).0) * (1.0 - fresnel::dielectric(wi.z, self.eta).0);
        let base = base_reflectance(self.diffuse_reflectance, self.internal_reflectance, self.nonlinear);
        base * (t * warp::cosine_hemisphere_pdf(wi.z) / sqr(self.eta))
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return 0.0;
        }
        let p_specular = self.specular_probability(1.0 - fresnel::dielectric(wo.z, self.eta).0);
        (1.0 - p_specular) * warp::cosine_hemisphere_pdf(wi.z)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let r = fresnel::dielectric(wo.z, self.eta).0;
        let p_specular = self.specular_probability(1.0 - r);
        if u_lobe < p_specular {
            let lobe = Lobe::DELTA.union(Lobe::REFLECTION);
            return Some(BsdfSample { wi: fresnel::reflect_z(wo), value: self.specular_reflectance * r, pdf: p_specular, lobe, eta: 1.0 });
        }
        let wi = warp::cosine_hemisphere(u);
        let pdf = (1.0 - p_specular) * warp::cosine_hemisphere_pdf(wi.z);
        let lobe = Lobe::DIFFUSE.union(Lobe::REFLECTION);
        (pdf > 0.0).then(|| BsdfSample { wi, value: self.eval(wo, wi, mode), pdf, lobe, eta: 1.0 })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::DIFFUSE.union(Lobe::DELTA).union(Lobe::REFLECTION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        let r = fresnel::dielectric(wo.z, self.eta).0;
        // What leaves the base and the coat: ∫ t(wi) cos / (π eta²) dwi = 1 − internal reflectance.
        let base = base_reflectance(self.diffuse_reflectance, self.internal_reflectance, self.nonlinear);
        self.specular_reflectance * r + base * ((1.0 - r) * (1.0 - self.internal_reflectance))
    }
}

/// Reflectance of a diffuse base with the interreflection between it and a coat that sends the share `internal` back: the
/// geometric series of the bounces. Unless `nonlinear`, the bounces beyond the first lose no light to the base.
#[inline]
pub(super) fn base_reflectance(diffuse: Spectrum, internal: f32, nonlinear: bool) -> Spectrum {
    if nonlinear { diffuse.map(|d| d / (1.0 - d * internal)) } else { diffuse * (1.0 / (1.0 - internal)) }
}

/// With which probability to sample the coat's reflection, where the share `transmittance` of light enters it.
#[inline]
pub(super) fn specular_probability(transmittance: f32, specular: Spectrum, diffuse: Spectrum) -> f32 {
    let (s, d) = ((1.0 - transmittance) * specular.average(), transmittance * diffuse.average());
    if s + d > 0.0 { s / (s + d) } else { 0.0 }
}
