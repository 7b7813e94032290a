//! Elementary functions with the same bits on every machine.
//!
//! The platform's math library may round the last bit differently from one system to the next, so the
//! renderer uses the `libm` crate (a port of musl's) for everything that IEEE 754 does not fix. Square
//! roots are exact everywhere and stay `f32::sqrt`.

/// Sine of an angle in radians.
#[inline]
pub fn sin(x: f32) -> f32 {
    libm::sinf(x)
}

/// Cosine of an angle in radians.
#[inline]
pub fn cos(x: f32) -> f32 {
    libm::cosf(x)
}

/// Sine and cosine of an angle in radians.
#[inline]
pub fn sin_cos(x: f32) -> (f32, f32) {
    libm::sincosf(x)
}

/// Sine and cosine of an angle in [−π/4, π/4], within two units in the last place: polynomials without branches, several times faster
/// than [`sin_cos`].
#[inline]
pub fn sin_cos_eighth(x: f32) -> (f32, f32) {
    let x2 = x * x;
    // Minimax on the interval.
    let sin = x + x * x2 * (-0.166_666_55 + x2 * (8.332_161e-3 - 1.951_529_6e-4 * x2));
    let cos = 1.0 - 0.5 * x2 + x2 * x2 * (0.041_666_646 + x2 * (-1.388_731_6e-3 + 2.443_315_7e-5 * x2));
    (sin, cos)
}

/// Tangent of an angle in radians.
#[inline]
pub fn tan(x: f32) -> f32 {
    libm::tanf(x)
}

/// Arc sine in radians; arguments beyond ±1 are clamped.
#[inline]
pub fn asin(x: f32) -> f32 {
    libm::asinf(x.clamp(-1.0, 1.0))
}

/// Arc cosine in radians; arguments beyond ±1 are clamped.
#[inline]
pub fn acos(x: f32) -> f32 {
    libm::acosf(x.clamp(-1.0, 1.0))
}

/// Arc tangent in radians.
#[inline]
pub fn atan(x: f32) -> f32 {
    libm::atanf(x)
}

/// Angle of the point (x, y) in radians, in (-π, π].
#[inline]
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// e to the power of x.
#[inline]
pub fn exp(x: f32) -> f32 {
    libm::expf(x)
}

/// e to the power of x, less one: exact for small x.
#[inline]
pub fn exp_m1(x: f32) -> f32 {
    libm::expm1f(x)
}

/// Natural logarithm of 1 + x: exact for small x.
#[inline]
pub fn ln_1p(x: f32) -> f32 {
    libm::log1pf(x)
}

/// Two to the power of x.
#[inline]
pub fn exp2(x: f32) -> f32 {
    libm::exp2f(x)
}

/// Natural logarithm.
#[inline]
pub fn ln(x: f32) -> f32 {
    libm::logf(x)
}

/// Logarithm to base two.
#[inline]
pub fn log2(x: f32) -> f32 {
    libm::log2f(x)
}

/// x to the power of y.
#[inline]
pub fn pow(x: f32, y: f32) -> f32 {
    libm::powf(x, y)
}

/// Hyperbolic cosine.
#[inline]
pub fn cosh(x: f32) -> f32 {
    libm::coshf(x)
}

/// The square of x.
#[inline]
pub fn sqr(x: f32) -> f32 {
    x * x
}

/// Square root that takes slightly negative arguments (from rounding) as zero.
#[inline]
pub fn safe_sqrt(x: f32) -> f32 {
    x.max(0.0).sqrt()
}

/// Linear interpolation from a (t = 0) to b (t = 1).
#[inline]
pub fn lerp(t: f32, a: f32, b: f32) -> f32 {
    (1.0 - t) * a + t * b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_of_an_eighth_agree_with_the_whole_circle() {
        for i in -10_000..=10_000 {
            let x = std::f32::consts::FRAC_PI_4 * (i as f32 / 10_000.0);
            let (sin, cos) = sin_cos_eighth(x);
            let (x, exact) = (f64::from(x), libm::sincos(f64::from(x)));
            assert!((f64::from(sin) - exact.0).abs() <= 1.2e-7 * exact.0.abs() && (f64::from(cos) - exact.1).abs() <= 1.2e-7, "{x}");
        }
    }
}
