//! Lambertian reflection: the same radiance in every direction.

use super::{BsdfSample, Lobe, TransportMode};
use crate::math::{INV_PI, Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// Lambert's ideally diffuse reflection, f = ρ / π.
#[derive(Clone, Debug)]
pub struct Diffuse {
    /// ρ, the share of light that is reflected, in [0, 1].
    pub reflectance: Spectrum,
}

impl Diffuse {
    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, _mode: TransportMode) -> Spectrum {
        if wo.z <= 0.0 || wi.z <= 0.0 { Spectrum::ZERO } else { self.reflectance * (INV_PI * wi.z) }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z <= 0.0 || wi.z <= 0.0 { 0.0 } else { warp::cosine_hemisphere_pdf(wi.z) }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn sample(&self, wo: Vec3, _u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = warp::cosine_hemisphere(u);
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, value: self.eval(wo, wi, mode), pdf, lobe: self.lobes(), eta: 1.0 })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::DIFFUSE.union(Lobe::REFLECTION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, _wo: Vec3) -> Spectrum {
        self.reflectance
    }
}
