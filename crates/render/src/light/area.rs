//! Surfaces that emit.

use super::{EmissionSample, LightBounds, LightContext, LightSample, SceneSphere};
use crate::math::{Aabb, Frame, PI, Vec2, Vec3, warp};
use crate::shape::{AreaSample, Shape, triangle};
use crate::spectrum::Spectrum;

/// What an area light is made of.
#[derive(Clone, Debug)]
pub enum AreaGeometry {
    /// A triangle's vertices in the world. Its normal is on the side from which they are counter-clockwise.
    Triangle([Vec3; 3]),
    /// An analytic shape in the world.
    Shape(Box<Shape>),
}

/// A triangle or shape that emits diffusely. Infinite planes cannot be sampled: they light only what hits them by chance.
#[derive(Clone, Debug)]
pub struct AreaLight {
    /// What emits.
    pub geometry: AreaGeometry,
    /// Emitted radiance; its average where textured.
    pub radiance: Spectrum,
    /// Which emission of the scene this is: names texture and light group.
    pub emission_id: u32,
    /// Whether the radiance varies and is to be evaluated at the samples' uv.
    pub textured: bool,
    /// Whether both sides emit, or only that of the normal.
    pub two_sided: bool,
    /// Whether a triangle's normal is turned round (`flip_normals` of its mesh); shapes have that in themselves.
    pub flip_normals: bool,
}

impl AreaLight {
    #[inline]
    fn oriented(&self, s: AreaSample) -> AreaSample {
        if self.flip_normals { AreaSample { ng: -s.ng, ..s } } else { s }
    }

    /// Radiance that leaves into the unit direction `w` from where the normal is `ng`.
    #[inline]
    pub fn emitted(&self, ng: Vec3, w: Vec3) -> Spectrum {
        if self.two_sided || ng.dot(w) > 0.0 { self.radiance } else { Spectrum::ZERO }
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let s = self.oriented(match &self.geometry {
            AreaGeometry::Triangle(v) => triangle::sample_solid_angle(v, ctx.p, u)?,
            AreaGeometry::Shape(s) => s.sample_solid_angle(ctx.p, u)?,
        });
        let d = s.p - ctx.p;
        let dist = d.length();
        let wi = d / dist;
        let radiance = self.emitted(s.ng, -wi);
        (dist > 0.0 && s.pdf > 0.0 && !radiance.is_black()).then_some(LightSample {
            wi,
            dist,
            p: s.p,
            n: s.ng,
            uv: s.uv,
            radiance,
            pdf: s.pdf,
            delta: false,
        })
    }

    /// The density of `sample` for the point `p` with normal `ng` (either side's) on the light.
    #[inline]
    pub fn pdf(&self, ctx: &LightContext, p: Vec3, ng: Vec3) -> f32 {
        let pdf = match &self.geometry {
            AreaGeometry::Triangle(v) => triangle::pdf_solid_angle(v, ctx.p, p),
            AreaGeometry::Shape(s) => s.pdf_solid_angle(ctx.p, p, ng),
        };
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    /// Area of one side; infinite for planes.
    pub fn area(&self) -> f32 {
        match &self.geometry {
            AreaGeometry::Triangle(v) => triangle::area(v),
            AreaGeometry::Shape(s) => s.area(),
        }
    }

    /// The density by area of a point sampled on one side, as [`super::Light::emit`] has it.
    pub fn pdf_area(&self, p: Vec3) -> f32 {
        let pdf = match &self.geometry {
            AreaGeometry::Triangle(v) => 1.0 / triangle::area(v),
            AreaGeometry::Shape(s) => s.pdf_area(p),
        };
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    /// See [`super::Light::power`].
    pub fn power(&self, _scene: &SceneSphere) -> Spectrum {
        let sides = if self.two_sided { 2.0 } else { 1.0 };
        let area = self.area();
        if area.is_finite() { self.radiance * (sides * PI * area) } else { Spectrum::ZERO }
    }

    /// See [`super::Light::bounds`].
    pub fn bounds(&self) -> LightBounds {
        let (bounds, axis) = match &self.geometry {
            AreaGeometry::Triangle(v) => {
                let n = triangle::normal(v);
                (Aabb::from_points(*v), Some(if self.flip_normals { -n } else { n }))
            }
            AreaGeometry::Shape(s) => {
                let flat = matches!(**s, Shape::Disk(_) | Shape::Rectangle(_) | Shape::Plane(_) | Shape::Polygon(_));
                (s.bounds(), flat.then(|| s.surface(s.bounds().center()).ng))
            }
        };
        let area = self.area();
        let phi = if area.is_finite() { super::bounds::strength(self.radiance * area) } else { 0.0 };
        LightBounds::of_surface(bounds, phi, axis, self.two_sided)
    }

    /// See [`super::Light::emit`]: uniform by area, cosine-weighted; `u_position.x` chooses the side where both emit.
    pub fn emit(&self, _scene: &SceneSphere, u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        let (mut u, mut sign, mut share) = (u_position, 1.0, 1.0);
        if self.two_sided {
            sign = if u.x < 0.5 { 1.0 } else { -1.0 };
            u.x = if u.x < 0.5 { 2.0 * u.x } else { 2.0 * u.x - 1.0 };
            share = 0.5;
        }
        let s = self.oriented(match &self.geometry {
            AreaGeometry::Triangle(v) => triangle::sample_area(v, u)?,
            AreaGeometry::Shape(s) => s.sample_area(u)?,
        });
        let l = warp::cosine_hemisphere(u_direction);
        let n = s.ng * sign;
        let d = Frame::from_normal(n).world_from_local(l);
        (l.z > 0.0 && !self.radiance.is_black()).then(|| EmissionSample {
            o: s.p,
            d,
            n,
            uv: s.uv,
            radiance: self.radiance,
            pdf_position: s.pdf * share,
            pdf_direction: warp::cosine_hemisphere_pdf(l.z),
            cos: l.z,
        })
    }
}
