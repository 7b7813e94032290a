//! Exact analytic shapes: intersection, bounds, surface geometry, and sampling by area and by solid angle.
//!
//! Conventions of every shape:
//! - a shape is in world space (or its instance's object space) and carries its own transform where it needs one;
//! - `intersect` returns the nearest hit with `t_min` < t < `t_max` and the shape's own parameters `u`, `v` in [0, 1];
//! - the geometric normal is that of the outside (sphere, cylinder) or local +z (disk, rectangle), flipped where the
//!   transform mirrors, as in Mitsuba 3.

pub mod sphere;

use crate::accel::Ray;
use crate::math::Aabb;
pub use sphere::Sphere;

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeHit {
    /// Ray parameter.
    pub t: f32,
    /// First surface parameter of the shape at the hit.
    pub u: f32,
    /// Second surface parameter.
    pub v: f32,
}

/// The closed set of analytic shapes.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A sphere, possibly under a transform.
    Sphere(Sphere),
}

impl Shape {
    /// A box that holds the shape; infinite for unbounded shapes.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Sphere(s) => s.bounds(),
        }
    }

    /// The nearest hit in the ray's open interval.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
        match self {
            Self::Sphere(s) => s.intersect(ray),
        }
    }
}
