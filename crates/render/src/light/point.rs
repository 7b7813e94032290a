//! Point lights.

use super::{EmissionSample, LightBounds, LightContext, LightSample, SceneSphere};
use crate::math::{Aabb, PI, Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// A point that shines alike in all directions. It casts hard shadows, and no ray ever meets it: mirrors do not show it.
#[derive(Clone, Debug)]
pub struct PointLight {
    /// Where.
    pub p: Vec3,
    /// Radiant intensity.
    pub intensity: Spectrum,
}

impl PointLight {
    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, _u: Vec2) -> Option<LightSample> {
        sample_point(self.p, ctx, |_| self.intensity)
    }

    /// See [`super::Light::power`].
    pub fn power(&self, _scene: &SceneSphere) -> Spectrum {
        self.intensity * (4.0 * PI)
    }

    /// See [`super::Light::bounds`].
    pub fn bounds(&self) -> LightBounds {
        let phi = super::bounds::strength(self.intensity);
        let bounds = Aabb { min: self.p, max: self.p };
        LightBounds { bounds, axis: Vec3::Z, phi, cos_o: -1.0, cos_e: 0.0, two_sided: false, mean: phi, lean: Vec3::ZERO }
    }

    /// See [`super::Light::emit`].
    pub fn emit(&self, _scene: &SceneSphere, _u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        let d = warp::uniform_sphere(u_direction);
        Some(EmissionSample {
            o: self.p,
            d,
            n: d,
            uv: Vec2::ZERO,
            radiance: self.intensity,
            pdf_position: 1.0,
            pdf_direction: warp::UNIFORM_SPHERE_PDF,
            cos: 1.0,
        })
    }
}

/// The only direction to a point; `intensity` is given the unit direction in which the light leaves.
#[inline]
pub(super) fn sample_point(p: Vec3, ctx: &LightContext, intensity: impl FnOnce(Vec3) -> Spectrum) -> Option<LightSample> {
    let d = p - ctx.p;
    let dist2 = d.length_squared();
    let dist = dist2.sqrt();
    let wi = d / dist;
    let radiance = intensity(-wi) * (1.0 / dist2);
    let usable = dist > 0.0 && radiance.is_finite() && !radiance.is_black();
    usable.then_some(LightSample { wi, dist, p, n: -wi, uv: Vec2::ZERO, radiance, pdf: 1.0, delta: true })
}
