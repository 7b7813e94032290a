//! Numbers, vectors, frames, sampling warps and tabulated distributions.
//!
//! Points, directions and matrices are `glam` types in `f32`. Angles are radians. Elementary functions come
//! from [`fns`], never from `f32`'s methods, so that pictures have the same bits on every machine.

pub mod aabb;
pub mod distribution;
pub mod fns;
pub mod frame;
pub mod hash;
pub mod warp;

pub use aabb::Aabb;
pub use distribution::{PiecewiseConstant1D, PiecewiseConstant2D};
pub use frame::Frame;
pub use glam::{Affine3A, Mat3, Mat4, Vec2, Vec3, Vec4};

/// The largest `f32` below one: samples are in [0, this].
pub const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;
/// π
pub const PI: f32 = std::f32::consts::PI;
/// 2π
pub const TAU: f32 = std::f32::consts::TAU;
/// 1 / π
pub const INV_PI: f32 = std::f32::consts::FRAC_1_PI;
/// 1 / 2π
pub const INV_TAU: f32 = 0.5 * INV_PI;
/// 1 / 4π, the density of uniform directions
pub const INV_4PI: f32 = 0.25 * INV_PI;
