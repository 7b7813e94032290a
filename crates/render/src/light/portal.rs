//! An environment map that is seen through a window alone: light comes from a direction where the line to it passes the window, a
//! rectangle, out of the scene; everywhere else, and from beyond the window, it is black.
//!
//! Half of the samples go through the window evenly in solid angle, half go by the map's own density; those of them that miss the window are
//! lost. A portal does not stand for walls: it darkens directions that miss it, whatever is there. Light of the map that no portal shows is not
//! there at all (Bitterli, Novák, Jarosz 2015, "Portal-Masked Environment Map Sampling", doi:10.1111/cgf.12674, sample both at once, as pbrt-v4
//! does; here the product is left to the balance of the two densities).

use super::directional::infinite_sample;
use super::{EmissionSample, EnvironmentLight, LightContext, LightSample, SceneSphere};
use crate::accel::Ray;
use crate::math::{Mat4, Vec2, Vec3};
use crate::shape::Rectangle;
use crate::spectrum::Spectrum;

/// An environment map behind a window.
#[derive(Clone, Debug)]
pub struct PortalLight {
    map: EnvironmentLight,
    window: Rectangle,
    center: Vec3,
    /// Unit, out of the scene.
    n: Vec3,
    /// Mean radiance of the directions that pass the window, × |cos|, × π.
    flux: Spectrum,
}

impl PortalLight {
    /// A map seen through the rectangle of four corners in turn; light comes in against (corner 3 − corner 0) × (corner 1 − corner 0). `None`
    /// where the corners span no rectangle.
    pub fn new(map: EnvironmentLight, corners: [Vec3; 4]) -> Option<Self> {
        let (x, y) = (0.5 * (corners[3] - corners[0]), 0.5 * (corners[1] - corners[0]));
        let n = x.cross(y);
        let center = corners[0] + x + y;
        let m = Mat4::from_cols(x.extend(0.0), y.extend(0.0), n.normalize_or_zero().extend(0.0), center.extend(1.0));
        let window = Rectangle::from_transform(m, false)?;
        let n = n.as_dvec3().try_normalize()?.as_vec3();
        let flux = map.flux_through(n);
        Some(Self { map, window, center, n, flux })
    }

    /// The middle of the window.
    pub fn center(&self) -> Vec3 {
        self.center
    }

    /// The window's unit normal, out of the scene: light comes in against it.
    pub fn normal(&self) -> Vec3 {
        self.n
    }

    /// Where the line from a point along a unit direction passes the window.
    #[inline]
    fn pass(&self, o: Vec3, wi: Vec3) -> Option<Vec3> {
        let ray = Ray::new(o, wi);
        if !(wi.dot(self.n) > 0.0) {
            return None;
        }
        self.window.intersect(&ray).map(|hit| ray.at(hit.t))
    }

    /// Radiance that comes to a point from a unit direction.
    #[inline]
    pub fn radiance(&self, o: Vec3, wi: Vec3) -> Spectrum {
        if self.pass(o, wi).is_some() { self.map.radiance(wi) } else { Spectrum::ZERO }
    }

    /// The density of [`Self::sample`] for a unit direction; zero where the line misses the window.
    #[inline]
    pub fn pdf(&self, ctx: &LightContext, wi: Vec3) -> f32 {
        self.pass(ctx.p, wi).map_or(0.0, |p| self.mixed(ctx.p, p, self.map.pdf(wi)))
    }

    #[inline]
    fn mixed(&self, o: Vec3, p: Vec3, by_map: f32) -> f32 {
        0.5 * (by_map + self.window.pdf_solid_angle(o, p, self.n))
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let (wi, radiance, by_map) = if u.x < 0.5 {
            let s = self.map.sample(ctx, Vec2::new(2.0 * u.x, u.y))?;
            (s.wi, s.radiance, s.pdf)
        } else {
            let at = self.window.sample_solid_angle(ctx.p, Vec2::new(2.0 * u.x - 1.0, u.y))?;
            let wi = (at.p - ctx.p).try_normalize()?;
            (wi, self.map.radiance(wi), self.map.pdf(wi))
        };
        let pdf = self.mixed(ctx.p, self.pass(ctx.p, wi)?, by_map);
        (pdf > 0.0 && pdf.is_finite() && !radiance.is_black()).then(|| infinite_sample(ctx, wi, radiance, pdf))
    }

    /// See [`super::Light::power`]: what comes through the window, whatever the scene's size.
    pub fn power(&self, _scene: &SceneSphere) -> Spectrum {
        self.flux * self.window.area()
    }

    /// See [`super::Light::emit`]. The ray starts in the window: what is in its way before, the caller looks for.
    pub fn emit(&self, scene: &SceneSphere, u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        let sample = self.map.emit(scene, Vec2::splat(0.5), u_direction)?;
        let pdf_position = self.pdf_position(sample.d);
        let o = self.window.sample_area(u_position)?.p;
        (pdf_position > 0.0 && pdf_position.is_finite()).then_some(EmissionSample { o, pdf_position, ..sample })
    }

    /// The density of a ray's start, across the ray, from its unit direction; zero for rays that do not come in.
    #[inline]
    pub fn pdf_position(&self, d: Vec3) -> f32 {
        let cos = -d.dot(self.n);
        if cos > 0.0 { 1.0 / (self.window.area() * cos) } else { 0.0 }
    }

    /// The density per solid angle of the unit direction of a ray by [`Self::emit`].
    #[inline]
    pub fn pdf_emit(&self, d: Vec3) -> f32 {
        if d.dot(self.n) < 0.0 { self.map.pdf(-d) } else { 0.0 }
    }
}
