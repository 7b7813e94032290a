//! Disks.

use super::planar::{Facing, Planar};
use super::{AreaSample, ShapeHit, SurfaceGeometry, area_to_solid_angle};
use crate::accel::Ray;
use crate::math::{Aabb, INV_TAU, Mat4, PI, TAU, Vec2, Vec3, fns, warp};

/// The unit disk of the xy plane under a transform: also ellipses. u is the radius, v the angle over 2π.
#[derive(Clone, Debug)]
pub struct Disk {
    pub(super) planar: Planar,
}

impl Disk {
    /// Places the disk; `None` where the transform leaves no surface.
    pub fn from_transform(world_from_object: Mat4, flip_normals: bool) -> Option<Self> {
        Planar::new(world_from_object, Facing::LocalZ, flip_normals).map(|planar| Self { planar })
    }

    /// See [`super::Shape::bounds`].
    pub fn bounds(&self) -> Aabb {
        let (x, y) = (self.planar.x_axis, self.planar.y_axis);
        let half = (x * x + y * y).map(f32::sqrt) * (1.0 + 2.0 * f32::EPSILON);
        Aabb { min: self.planar.origin - half, max: self.planar.origin + half }
    }

    /// See [`super::Shape::intersect`].
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
        let (t, q) = self.planar.intersect(ray)?;
        let uv = (q.length_squared() <= 1.0).then(|| uv_from_point(q))?;
        Some(ShapeHit { t, u: uv.x, v: uv.y })
    }

    /// See [`super::Shape::surface`]. At the center, where v has no derivative, `dpdv` is that of a point beside it.
    #[inline]
    pub fn surface(&self, p: Vec3) -> SurfaceGeometry {
        let s = self.planar.surface(p);
        let r = s.uv.length();
        let e = if r > 0.0 { s.uv / r } else { Vec2::X };
        let at = |q: Vec2| self.planar.x_axis * q.x + self.planar.y_axis * q.y;
        SurfaceGeometry { uv: uv_from_point(s.uv), dpdu: at(e), dpdv: at(e.perp()) * (TAU * r.max(1e-6)), ..s }
    }

    /// See [`super::Shape::area`].
    pub fn area(&self) -> f32 {
        PI * self.planar.stretch
    }

    /// See [`super::Shape::sample_area`].
    #[inline]
    pub fn sample_area(&self, u: Vec2) -> Option<AreaSample> {
        let q = warp::disk_concentric(u);
        Some(AreaSample { p: self.planar.point(q), ng: self.planar.ng, uv: uv_from_point(q), pdf: 1.0 / self.area() })
    }

    /// See [`super::Shape::sample_solid_angle`]: uniform by area.
    #[inline]
    pub fn sample_solid_angle(&self, ref_p: Vec3, u: Vec2) -> Option<AreaSample> {
        self.sample_area(u)?.per_solid_angle(ref_p)
    }

    /// See [`super::Shape::pdf_solid_angle`].
    #[inline]
    pub fn pdf_solid_angle(&self, ref_p: Vec3, p: Vec3, ng: Vec3) -> f32 {
        area_to_solid_angle(ref_p, p, ng) / self.area()
    }
}

#[inline]
fn uv_from_point(q: Vec2) -> Vec2 {
    let turn = fns::atan2(q.y, q.x) * INV_TAU;
    Vec2::new(q.length(), if turn < 0.0 { turn + 1.0 } else { turn })
}
