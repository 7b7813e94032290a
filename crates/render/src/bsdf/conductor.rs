//! Smooth metal.

use super::{BsdfSample, Lobe, TransportMode, fresnel};
use crate::math::{Vec2, Vec3};
use crate::spectrum::Spectrum;

/// A perfectly smooth conductor: a mirror whose reflectance follows Fresnel's equations.
#[derive(Clone, Debug)]
pub struct Conductor {
    /// Real part of the refractive index, relative to the outside.
    pub eta: Spectrum,
    /// Imaginary part of the refractive index (extinction), relative to the outside.
    pub k: Spectrum,
    /// A factor on the reflected light; 1 for a real metal.
    pub specular_reflectance: Spectrum,
}

impl Conductor {
    /// A mirror that reflects the given share of light at every angle: with the index 0 + i nothing is absorbed.
    pub fn mirror(reflectance: Spectrum) -> Self {
        Self { eta: Spectrum::ZERO, k: Spectrum::ONE, specular_reflectance: reflectance }
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
    pub fn sample(&self, wo: Vec3, _u_lobe: f32, _u: Vec2, _mode: TransportMode) -> Option<BsdfSample> {
        (wo.z > 0.0).then(|| BsdfSample { wi: fresnel::reflect_z(wo), value: self.albedo(wo), pdf: 1.0, lobe: self.lobes(), eta: 1.0 })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::DELTA.union(Lobe::REFLECTION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        fresnel::conductor(wo.z, self.eta, self.k) * self.specular_reflectance
    }
}
