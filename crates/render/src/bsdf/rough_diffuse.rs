//! Diffuse reflection of a rough surface: Oren and Nayar's model.

use super::{BsdfSample, Lobe, TransportMode};
use crate::math::fns::{self, safe_sqrt, sqr};
use crate::math::{INV_PI, PI, Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// Diffuse reflection of V-shaped grooves with Gaussian slopes, with one interreflection (Oren and Nayar 1994,
/// "Generalization of Lambert's Reflectance Model", doi:10.1145/192161.192213, the full model with interreflection).
///
/// Flatter than Lambert's towards the edges of a sphere, and brighter where one looks along the light. For clay, plaster
/// and the moon; it has no highlight at grazing angles.
#[derive(Clone, Debug)]
pub struct RoughDiffuse {
    /// ρ, the reflectance of the grooves' sides, in [0, 1].
    pub reflectance: Spectrum,
    /// σ, the standard deviation of the slope angle in radians; 0 is Lambert's model.
    pub sigma: f32,
}

impl RoughDiffuse {
    /// The model for a roughness `alpha`, the root mean square slope times √2 (as for microfacets): σ = alpha / √2.
    pub fn from_alpha(reflectance: Spectrum, alpha: f32) -> Self {
        Self { reflectance, sigma: alpha * std::f32::consts::FRAC_1_SQRT_2 }
    }

    /// See the contract in [`crate::bsdf`].
    pub fn eval(&self, wo: Vec3, wi: Vec3, _mode: TransportMode) -> Spectrum {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return Spectrum::ZERO;
        }
        let s2 = sqr(self.sigma);
        if s2 == 0.0 {
            return self.reflectance * (INV_PI * wi.z);
        }
        // alpha is the greater of both polar angles, beta the smaller one.
        let (cos_alpha, cos_beta) = (wo.z.min(wi.z).min(1.0), wo.z.max(wi.z).min(1.0));
        let (sin_alpha, sin_beta) = (safe_sqrt(1.0 - sqr(cos_alpha)), safe_sqrt(1.0 - sqr(cos_beta)));
        let (alpha, beta) = (fns::acos(cos_alpha), fns::acos(cos_beta));
        let sin2 = ((1.0 - sqr(wo.z)) * (1.0 - sqr(wi.z))).max(0.0).sqrt();
        let cos_phi = if sin2 > 0.0 { ((wo.x * wi.x + wo.y * wi.y) / sin2).clamp(-1.0, 1.0) } else { 1.0 };

        let c1 = 1.0 - 0.5 * s2 / (s2 + 0.33);
        let t = 2.0 * beta * INV_PI;
        let c2 = 0.45 * s2 / (s2 + 0.09) * (sin_alpha - if cos_phi >= 0.0 { 0.0 } else { t * t * t });
        let c3 = 0.125 * s2 / (s2 + 0.09) * sqr(4.0 / (PI * PI) * alpha * beta);
        // tan((α + β) / 2), without a transcendental function.
        let tan_half = (sin_alpha + sin_beta) / (cos_alpha + cos_beta);
        let single = c1 + cos_phi * c2 * (sin_beta / cos_beta) + (1.0 - cos_phi.abs()) * c3 * tan_half;
        let double = 0.17 * s2 / (s2 + 0.13) * (1.0 - cos_phi * t * t);
        // The fit dips below zero by rounding errors where both directions are grazing.
        self.reflectance.map(|rho| (rho * (single + rho * double) * INV_PI * wi.z).max(0.0))
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
