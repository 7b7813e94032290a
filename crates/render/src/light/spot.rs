//! Spot lights.

use etendue_scene::desc::SpotFalloff;

use super::point::sample_point;
use super::{EmissionSample, LightBounds, LightContext, LightSample, SceneSphere};
use crate::math::{Aabb, Frame, Mat4, PI, TAU, Vec2, Vec3, fns, warp};
use crate::spectrum::Spectrum;

/// A point that shines into a cone. Like a point light it casts hard shadows and is never seen itself.
#[derive(Clone, Debug)]
pub struct SpotLight {
    p: Vec3,
    /// Local −z is the cone's axis; columns are unit.
    frame: Frame,
    intensity: Spectrum,
    inner_rad: f32,
    outer_rad: f32,
    cos_inner: f32,
    cos_outer: f32,
    tan_outer: f32,
    falloff: SpotFalloff,
    /// Whether a picture is projected, to be evaluated at the samples' uv and multiplied with the radiance.
    pub textured: bool,
}

impl SpotLight {
    /// From the description's numbers; `None` where the transform is singular or something not finite. Angles are limited
    /// to 0 ≤ inner ≤ outer ≤ π.
    pub fn new(world_from_light: Mat4, intensity: [f32; 3], inner_rad: f32, outer_rad: f32, falloff: SpotFalloff) -> Option<Self> {
        let p = world_from_light.w_axis.truncate();
        let n = world_from_light.z_axis.truncate().normalize_or_zero();
        let intensity = Spectrum::from_rgb(intensity);
        let finite = p.is_finite() && n != Vec3::ZERO && intensity.is_finite() && inner_rad.is_finite() && outer_rad.is_finite();
        let outer_rad = outer_rad.clamp(0.0, PI);
        let inner_rad = inner_rad.clamp(0.0, outer_rad);
        finite.then(|| Self {
            p,
            frame: Frame::from_normal_tangent(n, world_from_light.x_axis.truncate()),
            intensity,
            inner_rad,
            outer_rad,
            cos_inner: fns::cos(inner_rad),
            cos_outer: fns::cos(outer_rad),
            tan_outer: fns::tan(outer_rad),
            falloff,
            textured: false,
        })
    }

    /// The share of the intensity in a direction at the given cosine to the axis.
    pub fn falloff(&self, cos: f32) -> f32 {
        if cos >= self.cos_inner {
            return 1.0;
        }
        if cos <= self.cos_outer {
            return 0.0;
        }
        let ramp = (cos - self.cos_outer) / (self.cos_inner - self.cos_outer);
        match self.falloff {
            SpotFalloff::Linear => ((self.outer_rad - fns::acos(cos)) / (self.outer_rad - self.inner_rad)).clamp(0.0, 1.0),
            SpotFalloff::CosineSquared => ramp * ramp,
            SpotFalloff::Smoothstep => ramp * ramp * (3.0 - 2.0 * ramp),
        }
    }

    /// The falloff's integral over directions, by the midpoint rule.
    fn solid_angle(&self) -> f32 {
        let steps = 256;
        let width = self.cos_inner - self.cos_outer;
        let mean = (0..steps).map(|i| self.falloff(self.cos_outer + width * (i as f32 + 0.5) / steps as f32)).sum::<f32>() / steps as f32;
        TAU * ((1.0 - self.cos_inner) + width * mean)
    }

    /// Picture coordinates of a unit direction in which light leaves: the picture fills the square about the outer cone.
    #[inline]
    fn uv(&self, d: Vec3) -> Vec2 {
        let l = self.frame.local_from_world(d);
        let scale = 0.5 / (-l.z * self.tan_outer);
        Vec2::new(0.5 + l.x * scale, 0.5 + l.y * scale)
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, _u: Vec2) -> Option<LightSample> {
        let s = sample_point(self.p, ctx, |d| self.intensity * self.falloff(-d.dot(self.frame.n)))?;
        Some(LightSample { uv: if self.textured { self.uv(-s.wi) } else { Vec2::ZERO }, ..s })
    }

    /// See [`super::Light::power`].
    pub fn power(&self, _scene: &SceneSphere) -> Spectrum {
        self.intensity * self.solid_angle()
    }

    /// See [`super::Light::bounds`].
    pub fn bounds(&self) -> LightBounds {
        let phi = super::bounds::strength(self.intensity);
        let cos = 0.5 * (self.cos_inner + self.cos_outer);
        LightBounds {
            bounds: Aabb { min: self.p, max: self.p },
            axis: -self.frame.n,
            phi,
            cos_o: self.cos_inner,
            cos_e: fns::cos(self.outer_rad - self.inner_rad),
            two_sided: false,
            // The first two bands of a cone's indicator function.
            mean: phi * 0.5 * (1.0 - cos),
            lean: -self.frame.n * (phi * 0.75 * (1.0 - cos * cos)),
        }
    }

    /// The density of `emit` for a unit direction.
    pub fn pdf_emit(&self, d: Vec3) -> f32 {
        if -d.dot(self.frame.n) >= self.cos_outer { warp::uniform_cone_pdf(1.0 - self.cos_outer) } else { 0.0 }
    }

    /// See [`super::Light::emit`]: uniform in the outer cone.
    pub fn emit(&self, _scene: &SceneSphere, _u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        let one_minus_cos = 1.0 - self.cos_outer;
        let l = warp::uniform_cone(u_direction, one_minus_cos);
        let d = self.frame.world_from_local(Vec3::new(l.x, l.y, -l.z));
        let radiance = self.intensity * self.falloff(l.z);
        (one_minus_cos > 0.0 && !radiance.is_black()).then(|| EmissionSample {
            o: self.p,
            d,
            n: d,
            uv: if self.textured { self.uv(d) } else { Vec2::ZERO },
            radiance,
            pdf_position: 1.0,
            pdf_direction: warp::uniform_cone_pdf(one_minus_cos),
            cos: 1.0,
        })
    }
}
