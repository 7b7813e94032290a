//! The same radiance from everywhere.

use super::directional::{infinite_emission, infinite_sample};
use super::{EmissionSample, LightContext, LightSample, SceneSphere};
use crate::math::{Frame, INV_TAU, PI, Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// A uniform surround, as in the furnace test.
#[derive(Clone, Debug)]
pub struct ConstantLight {
    /// Radiance.
    pub radiance: Spectrum,
}

impl ConstantLight {
    /// The density of `sample`: |cos| over both sides of a surface, uniform where there is none.
    #[inline]
    pub fn pdf(&self, ctx: &LightContext, wi: Vec3) -> f32 {
        if ctx.n == Vec3::ZERO { warp::UNIFORM_SPHERE_PDF } else { wi.dot(ctx.n).abs() * INV_TAU }
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let wi = if ctx.n == Vec3::ZERO {
            warp::uniform_sphere(u)
        } else {
            // The first half of u.x is one side, the second the other.
            let below = u.x >= 0.5;
            let l = warp::cosine_hemisphere(Vec2::new(if below { 2.0 * u.x - 1.0 } else { 2.0 * u.x }, u.y));
            Frame::from_normal(ctx.n).world_from_local(Vec3::new(l.x, l.y, if below { -l.z } else { l.z }))
        };
        let pdf = self.pdf(ctx, wi);
        (pdf > 0.0 && !self.radiance.is_black()).then(|| infinite_sample(ctx, wi, self.radiance, pdf))
    }

    /// See [`super::Light::power`].
    pub fn power(&self, scene: &SceneSphere) -> Spectrum {
        self.radiance * (4.0 * PI * PI * scene.radius * scene.radius)
    }

    /// See [`super::Light::emit`].
    pub fn emit(&self, scene: &SceneSphere, u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        infinite_emission(scene, u_position, warp::uniform_sphere(u_direction), self.radiance, warp::UNIFORM_SPHERE_PDF)
    }
}
