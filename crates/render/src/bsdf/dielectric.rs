//! Smooth glass, water and the like.

use super::{BsdfSample, Lobe, TransportMode, fresnel};
use crate::math::fns::sqr;
use crate::math::{Vec2, Vec3};
use crate::spectrum::Spectrum;

/// A perfectly smooth interface between two dielectrics: mirrors and refracts.
#[derive(Clone, Debug)]
pub struct Dielectric {
    /// Refractive index inside over that outside.
    pub eta: f32,
    /// A factor on the reflected light; 1 for a real material.
    pub specular_reflectance: Spectrum,
    /// A factor on the transmitted light; 1 for a real material.
    pub specular_transmittance: Spectrum,
}

impl Dielectric {
    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn eval(&self, _wo: Vec3, _wi: Vec3, _mode: TransportMode) -> Spectrum {
        Spectrum::ZERO
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn pdf(&self, _wo: Vec3, _wi: Vec3) -> f32 {
        0.0
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, _u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let (r, cos_t, eta_it, eta_ti) = fresnel::dielectric(wo.z, self.eta);
        let p_reflect = reflection_probability(r, self.specular_reflectance, self.specular_transmittance)?;
        if u_lobe < p_reflect {
            let lobe = Lobe::DELTA.union(Lobe::REFLECTION);
            Some(BsdfSample { wi: fresnel::reflect_z(wo), value: self.specular_reflectance * r, pdf: p_reflect, lobe, eta: 1.0 })
        } else {
            let lobe = Lobe::DELTA.union(Lobe::TRANSMISSION);
            let wi = Vec3::new(-eta_ti * wo.x, -eta_ti * wo.y, cos_t);
            let value = self.specular_transmittance * ((1.0 - r) * transmission_scale(eta_ti, mode));
            Some(BsdfSample { wi, value, pdf: 1.0 - p_reflect, lobe, eta: eta_it })
        }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::DELTA.union(Lobe::REFLECTION).union(Lobe::TRANSMISSION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        self.specular_transmittance.lerp(self.specular_reflectance, fresnel::dielectric(wo.z, self.eta).0)
    }
}

/// What is transmitted is scaled by this: radiance by the squared ratio of the indices, importance not (Veach 1997,
/// section 5.2).
#[inline]
pub(super) fn transmission_scale(eta_ti: f32, mode: TransportMode) -> f32 {
    match mode {
        TransportMode::Radiance => sqr(eta_ti),
        TransportMode::Importance => 1.0,
    }
}

/// With which probability to sample reflection where the reflectance is `r`: in proportion to the light of both lobes;
/// `None` where both are black.
#[inline]
pub(super) fn reflection_probability(r: f32, reflectance: Spectrum, transmittance: Spectrum) -> Option<f32> {
    let (p_r, p_t) = (r * reflectance.average(), (1.0 - r) * transmittance.average());
    (p_r + p_t > 0.0).then(|| p_r / (p_r + p_t))
}
