//! Ray intersection: wide SIMD bounding volume hierarchies over triangles and exact analytic shapes, in two levels.

use glam::Vec3;

/// A ray. `t` is in units of the direction's length; hits are looked for in the open interval (`t_min`, `t_max`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin.
    pub o: Vec3,
    /// Direction, not necessarily unit.
    pub d: Vec3,
    /// Lower end of the interval, excluded.
    pub t_min: f32,
    /// Upper end of the interval, excluded; may be infinite.
    pub t_max: f32,
}

impl Ray {
    /// A ray without end.
    #[inline]
    pub fn new(o: Vec3, d: Vec3) -> Self {
        Self { o, d, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// The point at `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.o + self.d * t
    }
}
