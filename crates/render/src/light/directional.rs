//! Light from infinitely far away: one direction, or the sun's disk.

use super::{EmissionSample, LightContext, LightSample, SceneSphere};
use crate::math::{Frame, PI, Vec2, Vec3, fns, warp};
use crate::spectrum::Spectrum;

/// Parallel light. It casts hard shadows and is never seen itself.
#[derive(Clone, Debug)]
pub struct DirectionalLight {
    /// Where the light travels to, unit.
    direction: Vec3,
    irradiance: Spectrum,
}

impl DirectionalLight {
    /// `direction` is where the light travels to, any length; `irradiance` that of a surface that faces it. `None` where there is no direction.
    pub fn new(direction: Vec3, irradiance: [f32; 3]) -> Option<Self> {
        let direction = direction.normalize_or_zero();
        let irradiance = Spectrum::from_rgb(irradiance);
        (direction != Vec3::ZERO && irradiance.is_finite()).then_some(Self { direction, irradiance })
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, _u: Vec2) -> Option<LightSample> {
        let lit = !self.irradiance.is_black();
        lit.then(|| LightSample { delta: true, ..infinite_sample(ctx, -self.direction, self.irradiance, 1.0) })
    }

    /// See [`super::Light::power`].
    pub fn power(&self, scene: &SceneSphere) -> Spectrum {
        self.irradiance * (PI * scene.radius * scene.radius)
    }

    /// See [`super::Light::emit`].
    pub fn emit(&self, scene: &SceneSphere, u_position: Vec2, _u_direction: Vec2) -> Option<EmissionSample> {
        infinite_emission(scene, u_position, -self.direction, self.irradiance, 1.0)
    }
}

/// A disk of the sky with constant radiance.
#[derive(Clone, Debug)]
pub struct SunLight {
    /// To the disk's middle, in the world.
    frame: Frame,
    one_minus_cos: f32,
    radiance: Spectrum,
}

impl SunLight {
    /// `to_sun` points to its middle, any length; `irradiance` is that of a surface that faces it, of which the disk's
    /// half-angle, limited to (0, π/2], makes a radiance. `None` where there is no direction.
    pub fn new(to_sun: Vec3, irradiance: [f32; 3], half_angle_rad: f32) -> Option<Self> {
        let n = to_sun.normalize_or_zero();
        let irradiance = Spectrum::from_rgb(irradiance);
        if !(n != Vec3::ZERO && irradiance.is_finite() && half_angle_rad > 0.0) {
            return None;
        }
        let half_angle_rad = half_angle_rad.clamp(1e-5, PI / 2.0);
        let (sin, sin_half) = (fns::sin(half_angle_rad), fns::sin(0.5 * half_angle_rad));
        // E = ∫ L cos θ dω = L π sin² of the half-angle.
        let radiance = irradiance * (1.0 / (PI * sin * sin));
        Some(Self { frame: Frame::from_normal(n), one_minus_cos: 2.0 * sin_half * sin_half, radiance })
    }

    #[inline]
    fn contains(&self, wi: Vec3) -> bool {
        // 1 − cos from the chord: cosines near one have too few digits.
        0.5 * (wi - self.frame.n).length_squared() <= self.one_minus_cos
    }

    /// Radiance from a unit direction.
    #[inline]
    pub fn radiance(&self, wi: Vec3) -> Spectrum {
        if self.contains(wi) { self.radiance } else { Spectrum::ZERO }
    }

    /// The density of `sample`.
    #[inline]
    pub fn pdf(&self, wi: Vec3) -> f32 {
        if self.contains(wi) { warp::uniform_cone_pdf(self.one_minus_cos) } else { 0.0 }
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let wi = self.frame.world_from_local(warp::uniform_cone(u, self.one_minus_cos));
        let lit = !self.radiance.is_black();
        lit.then(|| infinite_sample(ctx, wi, self.radiance, warp::uniform_cone_pdf(self.one_minus_cos)))
    }

    /// See [`super::Light::power`].
    pub fn power(&self, scene: &SceneSphere) -> Spectrum {
        let solid_angle = 2.0 * PI * self.one_minus_cos;
        self.radiance * (solid_angle * PI * scene.radius * scene.radius)
    }

    /// See [`super::Light::emit`].
    pub fn emit(&self, scene: &SceneSphere, u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        let wi = self.frame.world_from_local(warp::uniform_cone(u_direction, self.one_minus_cos));
        infinite_emission(scene, u_position, wi, self.radiance, warp::uniform_cone_pdf(self.one_minus_cos))
    }
}

/// The sample of a light that has no place.
#[inline]
pub(super) fn infinite_sample(ctx: &LightContext, wi: Vec3, radiance: Spectrum, pdf: f32) -> LightSample {
    LightSample { wi, dist: f32::INFINITY, p: ctx.p, n: -wi, uv: Vec2::ZERO, radiance, pdf, delta: false }
}

/// A ray against `wi` that starts on a disk across it, as large as the scene and outside of it; of scenes without end around it as well.
#[inline]
pub(super) fn infinite_emission(scene: &SceneSphere, u: Vec2, wi: Vec3, radiance: Spectrum, pdf_direction: f32) -> Option<EmissionSample> {
    let q = scene.sample_across(u);
    let pdf_position = scene.pdf_across(q.length_squared());
    let usable = pdf_position.is_finite() && pdf_direction > 0.0 && !radiance.is_black();
    usable.then(|| EmissionSample {
        o: scene.center + Frame::from_normal(wi).world_from_local(Vec3::new(q.x, q.y, scene.radius)),
        d: -wi,
        n: -wi,
        uv: Vec2::ZERO,
        radiance,
        pdf_position,
        pdf_direction,
        cos: 1.0,
    })
}
