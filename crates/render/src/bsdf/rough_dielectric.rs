//! Frosted glass.

use super::dielectric::{reflection_probability, transmission_scale};
use super::microfacet::Microfacet;
use super::{BsdfSample, Lobe, TransportMode, fresnel};
use crate::math::fns::sqr;
use crate::math::{Vec2, Vec3};
use crate::spectrum::Spectrum;

/// An interface between two dielectrics with microfacets that mirror and refract (Walter et al. 2007, "Microfacet Models
/// for Refraction through Rough Surfaces"). Light that hits more than one facet is lost.
///
/// Where the indices on both sides agree to [`RoughDielectric::MATCHED`] the facets do nothing, and light passes straight
/// on: the refracted lobe degenerates to a Dirac delta there.
#[derive(Clone, Debug)]
pub struct RoughDielectric {
    /// Distribution of the facets' normals.
    pub microfacet: Microfacet,
    /// Refractive index inside over that outside.
    pub eta: f32,
    /// A factor on the reflected light; 1 for a real material.
    pub specular_reflectance: Spectrum,
    /// A factor on the transmitted light; 1 for a real material.
    pub specular_transmittance: Spectrum,
}

/// The facets that scatter one direction to another, with the terms that value and density share.
struct Facet {
    reflect: bool,
    /// Fresnel reflectance.
    r: f32,
    /// Index on the side of `wo` over that on the side of `wi`; only for transmission.
    eta_ti: f32,
    /// D G1(wo) |wo·m| / |wo.z| · |dm / dwi|: the density of `wi` when all visible facets scatter so.
    pdf: f32,
    /// G1(wi).
    g1_wi: f32,
}

impl RoughDielectric {
    /// How near the relative index must be to 1 to count as 1.
    pub const MATCHED: f32 = 1e-3;

    #[inline]
    fn is_matched(&self) -> bool {
        (self.eta - 1.0).abs() < Self::MATCHED
    }

    #[inline]
    fn facet(&self, wo: Vec3, wi: Vec3) -> Option<Facet> {
        if wo.z == 0.0 || wi.z == 0.0 || self.is_matched() {
            return None;
        }
        let reflect = wo.z * wi.z > 0.0;
        let eta_it = if wo.z > 0.0 { self.eta } else { 1.0 / self.eta };
        // Half vector (Walter et al. 2007, equations 13 and 16), turned to the upper side.
        let h = if reflect { wo + wi } else { wo + wi * eta_it };
        let len2 = h.length_squared();
        if len2 == 0.0 {
            return None;
        }
        let m = h / len2.sqrt().copysign(h.z);
        self.facet_of(wo, wi, m, reflect, fresnel::dielectric(wo.dot(m), self.eta).0)
    }

    #[inline]
    fn facet_of(&self, wo: Vec3, wi: Vec3, m: Vec3, reflect: bool, r: f32) -> Option<Facet> {
        let (o, i) = (wo.dot(m), wi.dot(m));
        if o * wo.z <= 0.0 || i * wi.z <= 0.0 {
            return None;
        }
        let (eta_it, eta_ti) = if wo.z > 0.0 { (self.eta, 1.0 / self.eta) } else { (1.0 / self.eta, self.eta) };
        // Walter et al. 2007, equations 14 and 17.
        let jacobian = if reflect { 0.25 / i.abs() } else { sqr(eta_it / (o + eta_it * i)) * i.abs() };
        let pdf = self.microfacet.d(m) * self.microfacet.g1_distant(wo) * (o / wo.z) * jacobian;
        pdf.is_finite().then(|| Facet { reflect, r, eta_ti, pdf, g1_wi: self.microfacet.g1_distant(wi) })
    }

    #[inline]
    fn facet_value(&self, f: &Facet, mode: TransportMode) -> Spectrum {
        if f.reflect {
            self.specular_reflectance * (f.r * f.pdf * f.g1_wi)
        } else {
            self.specular_transmittance * ((1.0 - f.r) * f.pdf * f.g1_wi * transmission_scale(f.eta_ti, mode))
        }
    }

    #[inline]
    fn facet_pdf(&self, f: &Facet) -> f32 {
        let p = reflection_probability(f.r, self.specular_reflectance, self.specular_transmittance);
        f.pdf * p.map_or(0.0, |p| if f.reflect { p } else { 1.0 - p })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Spectrum {
        self.facet(wo, wi).map_or(Spectrum::ZERO, |f| self.facet_value(&f, mode))
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.facet(wo, wi).map_or(0.0, |f| self.facet_pdf(&f))
    }

    /// See the contract in [`crate::bsdf`].
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        if self.is_matched() {
            let lobe = Lobe::NULL.union(Lobe::DELTA).union(Lobe::TRANSMISSION);
            return Some(BsdfSample { wi: -wo, value: self.specular_transmittance, pdf: 1.0, lobe, eta: 1.0 });
        }
        if wo.z == 0.0 {
            return None;
        }
        // From below, the same facets are seen as from the opposite direction above.
        let m = self.microfacet.sample_visible_normal(if wo.z > 0.0 { wo } else { -wo }, u);
        let (r, cos_t, eta_it, eta_ti) = fresnel::dielectric(wo.dot(m), self.eta);
        let p_reflect = reflection_probability(r, self.specular_reflectance, self.specular_transmittance)?;
        let reflect = u_lobe < p_reflect;
        let (wi, eta, kind) = if reflect {
            (fresnel::reflect(wo, m), 1.0, Lobe::REFLECTION)
        } else {
            (fresnel::refract(wo, m, cos_t, eta_ti).normalize(), eta_it, Lobe::TRANSMISSION)
        };
        // Lost: the facet sends the light to the wrong side of the surface.
        if wi.z == 0.0 || (wi.z * wo.z > 0.0) != reflect {
            return None;
        }
        let f = self.facet_of(wo, wi, m, reflect, r)?;
        let pdf = self.facet_pdf(&f);
        (pdf > 0.0).then(|| BsdfSample { wi, value: self.facet_value(&f, mode), pdf, lobe: Lobe::GLOSSY.union(kind), eta })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        if self.is_matched() {
            Lobe::NULL.union(Lobe::DELTA).union(Lobe::TRANSMISSION)
        } else {
            Lobe::GLOSSY.union(Lobe::REFLECTION).union(Lobe::TRANSMISSION)
        }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        self.specular_transmittance.lerp(self.specular_reflectance, fresnel::dielectric(wo.z, self.eta).0)
    }
}
