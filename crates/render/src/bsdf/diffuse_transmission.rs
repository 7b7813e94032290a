//! Lambertian reflection and transmission: leaves, paper, lamp shades.

use super::{BsdfSample, Lobe, TransportMode};
use crate::math::{INV_PI, Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// Light that is spread evenly over both sides, whatever it comes from: f = ρ / π on the side of `wo`, τ / π on the other.
///
/// For thin sheets only: it has no volume and no refraction.
#[derive(Clone, Debug)]
pub struct DiffuseTransmission {
    /// ρ, the share of light that is reflected.
    pub reflectance: Spectrum,
    /// τ, the share that is transmitted; ρ + τ ≤ 1.
    pub transmittance: Spectrum,
}

impl DiffuseTransmission {
    /// The probability of reflection when sampling.
    #[inline]
    fn reflection_probability(&self) -> f32 {
        let (r, t) = (self.reflectance.max_component(), self.transmittance.max_component());
        if r + t > 0.0 { r / (r + t) } else { 0.0 }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, _mode: TransportMode) -> Spectrum {
        let share = if wo.z * wi.z > 0.0 { self.reflectance } else { self.transmittance };
        share * (INV_PI * wi.z.abs())
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        let p = self.reflection_probability();
        let share = if wo.z * wi.z > 0.0 { p } else { 1.0 - p };
        if self.reflectance.is_black() && self.transmittance.is_black() { 0.0 } else { share * warp::cosine_hemisphere_pdf(wi.z.abs()) }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        let mut wi = warp::cosine_hemisphere(u);
        let reflect = u_lobe < self.reflection_probability();
        if reflect != (wo.z > 0.0) {
            wi.z = -wi.z;
        }
        let pdf = self.pdf(wo, wi);
        let side = if reflect { Lobe::REFLECTION } else { Lobe::TRANSMISSION };
        (pdf > 0.0).then(|| BsdfSample { wi, value: self.eval(wo, wi, mode), pdf, lobe: Lobe::DIFFUSE.union(side), eta: 1.0 })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        Lobe::DIFFUSE.union(Lobe::REFLECTION).union(Lobe::TRANSMISSION)
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, _wo: Vec3) -> Spectrum {
        self.reflectance + self.transmittance
    }
}
