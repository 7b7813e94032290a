//! Elementary functions with the same bits on every machine.

pub use libm::{acos, acosh, asin, asinh, atan, atan2, atanh, cos, cosh, erf, exp, exp2, log, log2, log10, sin, sinh, tan, tanh};

pub use crate::power::{pow, pow_about};

/// Sine and cosine of an angle in radians.
pub fn sin_cos(x: f64) -> (f64, f64) {
    libm::sincos(x)
}
