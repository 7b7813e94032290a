//! A thin pane of glass.

use super::dielectric::reflection_probability;
use super::{BsdfSample, Lobe, TransportMode, fresnel};
use crate::math::{Vec2, Vec3};
use crate::spectrum::Spectrum;

/// A pane so thin that light leaves it where it entered: mirrors, or lets pass straight on.
#[derive(Clone, Debug)]
pub struct ThinDielectric {
    /// Refractive index of the pane over that outside.
    pub eta: f32,
    /// A factor on the reflected light; 1 for a real material.
    pub specular_reflectance: Spectrum,
    /// A factor on the transmitted light; 1 for a real material.
    pub specular_transmittance: Spectrum,
}

impl ThinDielectric {
    // Reflection at both sides in turn, r + t r t + t r³ t + … = 2 r / (1 + r) with t = 1 − r.
    #[inline]
    fn reflectance(&self, cos: f32) -> f32 {
        let r = fresnel::dielectric(cos.abs(), self.eta).0;
        2.0 * r / (1.0 + r)
    }

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
    pub fn sample(&self, wo: Vec3, u_lobe: f32, _u: Vec2, _mode: TransportMode) -> Option<BsdfSample> {
        let r = self.reflectance(wo.z);
        let p_reflect = reflection_probability(r, self.specular_reflectance, self.specular_transmittance)?;
        Some(if u_lobe < p_reflect {
            let lobe = Lobe::DELTA.union(Lobe::REFLECTION);
            BsdfSample { wi: fresnel::reflect_z(wo), value: self.specular_reflectance * r, pdf: p_reflect, lobe, eta: 1.0 }
        } else {
            let lobe = Lobe::NULL.union(Lobe::DELTA).union(Lobe::TRANSMISSION);
            BsdfSample { wi: -wo, value: self.specular_transmittance * (1.0 - r), pdf: 1.0 - p_reflect, lobe, eta: 1.0 }
        })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::NULL.union(Lobe::DELTA).union(Lobe::REFLECTION).union(Lobe::TRANSMISSION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        self.specular_transmittance.lerp(self.specular_reflectance, self.reflectance(wo.z))
    }
}
