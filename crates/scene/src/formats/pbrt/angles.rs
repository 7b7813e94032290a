//! Elementary functions of `f32` by way of `f64`, with the same bits on every machine.

use etendue_procedural::fns;

/// Sine and cosine of an angle in radians.
pub(in crate::formats::pbrt) fn sin_cos(x: f32) -> (f32, f32) {
    let (sin, cos) = fns::sin_cos(f64::from(x));
    (sin as f32, cos as f32)
}

/// Tangent of an angle in radians.
pub(in crate::formats::pbrt) fn tan(x: f32) -> f32 {
    fns::tan(f64::from(x)) as f32
}

/// Arc tangent in radians.
pub(in crate::formats::pbrt) fn atan(x: f32) -> f32 {
    fns::atan(f64::from(x)) as f32
}

/// Arc cosine in radians.
pub(in crate::formats::pbrt) fn acos(x: f32) -> f32 {
    fns::acos(f64::from(x)) as f32
}
