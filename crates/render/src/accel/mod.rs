//! Ray intersection: wide SIMD bounding volume hierarchies over triangles and exact analytic shapes, in two levels.
//!
//! A [`Blas`] holds geometry in its own space, an [`Accel`] places such in the world. Which hit is returned is a property
//! of ray and geometry alone: the same bits on every machine, with every instruction set and number of threads. See
//! README.md beside this file.

mod bins;
mod blas;
mod build;
mod emit;
mod floats;
mod layout;
mod ray;
mod simd;
mod spatial;
mod stream;
mod tlas;
mod traverse;

#[cfg(test)]
mod tests;

pub use blas::{Blas, BlasInput};
pub use simd::IsaKind;
pub use stream::StreamMemory;
pub use tlas::{Accel, Instance};

use glam::Vec3;

/// A ray. `t` is in units of the direction's length; hits are looked for in the open interval (`t_min`, `t_max`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin.
    pub o: Vec3,
    /// Direction, not necessarily unit.
    pub d: Vec3,
    /// Lower end of the interval, excluded; taken as zero where negative.
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

/// Where a ray meets a primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter.
    pub t: f32,
    /// Barycentric weight of vertex 1 of a triangle; the first surface parameter of a shape.
    pub u: f32,
    /// Barycentric weight of vertex 2 of a triangle; the second surface parameter of a shape.
    pub v: f32,
    /// Primitive of the instance's [`Blas`]: see [`BlasInput`].
    pub prim: u32,
    /// Index of the instance.
    pub instance: u32,
}
