//! Rough metal.

use super::microfacet::Microfacet;
use super::{BsdfSample, Lobe, TransportMode, fresnel};
use crate::math::{Vec2, Vec3};
use crate::spectrum::Spectrum;

/// Metal with microfacets (Torrance and Sparrow 1967 with the terms of Walter et al. 2007, equation 20). Light that hits
/// more than one facet is lost: rough metal is darker than smooth.
#[derive(Clone, Debug)]
pub struct RoughConductor {
    /// Distribution of the facets' normals.
    pub microfacet: Microfacet,
    /// Real part of the refractive index, relative to the outside.
    pub eta: Spectrum,
    /// Imaginary part of the refractive index (extinction), relative to the outside.
    pub k: Spectrum,
    /// A factor on the reflected light; 1 for a real metal.
    pub specular_reflectance: Spectrum,
}

impl RoughConductor {
    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, _mode: TransportMode) -> Spectrum {
        match facet_reflection(&self.microfacet, wo, wi) {
            Some((m, pdf)) => self.value(wo, wi, m, pdf),
            None => Spectrum::ZERO,
        }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        facet_reflection(&self.microfacet, wo, wi).map_or(0.0, |(_, pdf)| pdf)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn sample(&self, wo: Vec3, _u_lobe: f32, u: Vec2, _mode: TransportMode) -> Option<BsdfSample> {
        let (wi, m, pdf) = sample_facet_reflection(&self.microfacet, wo, u)?;
        Some(BsdfSample { wi, value: self.value(wo, wi, m, pdf), pdf, lobe: self.lobes(), eta: 1.0 })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::GLOSSY.union(Lobe::REFLECTION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        fresnel::conductor(wo.z, self.eta, self.k) * self.specular_reflectance
    }

    // The density is D G1(wo) / (4 wo.z): all of the value but Fresnel's term and G1(wi).
    #[inline]
    fn value(&self, wo: Vec3, wi: Vec3, m: Vec3, pdf: f32) -> Spectrum {
        fresnel::conductor(wo.dot(m), self.eta, self.k) * self.specular_reflectance * (pdf * self.microfacet.g1(wi, m))
    }
}

/// The normal of the facets that reflect `wo` to `wi`, and the density of `wi` when visible normals are sampled. The
/// density times F G1(wi) is the value of the reflection, cosine included. `None` where no facet reflects so.
#[inline]
pub(super) fn facet_reflection(microfacet: &Microfacet, wo: Vec3, wi: Vec3) -> Option<(Vec3, f32)> {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return None;
    }
    let m = wo + wi;
    let len2 = m.length_squared();
    if len2 == 0.0 {
        return None;
    }
    let m = m / len2.sqrt();
    (wo.dot(m) > 0.0).then(|| (m, facet_reflection_pdf(microfacet, wo, m)))
}

/// A direction reflected by a visible facet: `wi`, the facet's normal, the density of `wi`.
#[inline]
pub(super) fn sample_facet_reflection(microfacet: &Microfacet, wo: Vec3, u: Vec2) -> Option<(Vec3, Vec3, f32)> {
    if wo.z <= 0.0 {
        return None;
    }
    let m = microfacet.sample_visible_normal(wo, u);
    let wi = fresnel::reflect(wo, m);
    if wi.z <= 0.0 || wo.dot(m) <= 0.0 {
        return None;
    }
    let pdf = facet_reflection_pdf(microfacet, wo, m);
    (pdf > 0.0).then_some((wi, m, pdf))
}

// The density of m times dm / dwi = 1 / (4 wo · m) (Walter et al. 2007, equation 14).
#[inline]
fn facet_reflection_pdf(microfacet: &Microfacet, wo: Vec3, m: Vec3) -> f32 {
    microfacet.d(m) * microfacet.g1_distant(wo) / (4.0 * wo.z)
}
