//! No surface at all: the border of a medium, or a shape that only emits.

use super::{BsdfSample, Lobe, TransportMode};
use crate::math::{Vec2, Vec3};
use crate::spectrum::Spectrum;

/// Light passes straight on and unchanged.
#[derive(Clone, Debug)]
pub struct Null;

impl Null {
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
        Some(BsdfSample { wi: -wo, value: Spectrum::ONE, pdf: 1.0, lobe: self.lobes(), eta: 1.0 })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::NULL.union(Lobe::DELTA).union(Lobe::TRANSMISSION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, _wo: Vec3) -> Spectrum {
        Spectrum::ONE
    }
}
