//! Infinite planes.

use super::planar::{Facing, Planar};
use super::{AreaSample, ShapeHit, SurfaceGeometry};
use crate::accel::Ray;
use crate::math::{Aabb, Mat4, Vec2, Vec3};

/// The infinite plane z = 0 of its own space. It has no finite area, so that it cannot be sampled as a light.
#[derive(Clone, Debug)]
pub struct Plane {
    pub(super) planar: Planar,
}

impl Plane {
    /// Places the plane; `None` where the transform leaves no plane.
    pub fn from_transform(world_from_object: Mat4, flip_normals: bool) -> Option<Self> {
        Planar::new(world_from_object, Facing::LocalZ, flip_normals).map(|planar| Self { planar })
    }

    /// See [`super::Shape::bounds`]; flat across an axis to which the plane is exactly perpendicular.
    pub fn bounds(&self) -> Aabb {
        let mut b = Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };
        for axis in 0..3 {
            if self.planar.ng[axis].abs() == 1.0 {
                b.min[axis] = self.planar.origin[axis];
                b.max[axis] = self.planar.origin[axis];
            }
        }
        b
    }

    /// See [`super::Shape::intersect`].
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
        self.planar.intersect(ray).map(|(t, q)| ShapeHit { t, u: q.x, v: q.y })
    }

    /// See [`super::Shape::surface`].
    #[inline]
    pub fn surface(&self, p: Vec3) -> SurfaceGeometry {
        self.planar.surface(p)
    }

    /// Infinite.
    pub fn area(&self) -> f32 {
        f32::INFINITY
    }

    /// `None`: there is no uniform density on an infinite plane.
    pub fn sample_area(&self, _u: Vec2) -> Option<AreaSample> {
        None
    }

    /// `None`, as for [`Plane::sample_area`].
    pub fn sample_solid_angle(&self, _ref_p: Vec3, _u: Vec2) -> Option<AreaSample> {
        None
    }

    /// Zero.
    pub fn pdf_solid_angle(&self, _ref_p: Vec3, _p: Vec3, _ng: Vec3) -> f32 {
        0.0
    }
}
