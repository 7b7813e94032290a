//! x^y = exp(y · ln x) with the same bits on every machine, three times as fast as `libm`'s and exact to about one unit of the last place.
//!
//! ln x = k · ln 2 − ln c + ln(1 + r) for x = 2^k · m and c ≈ 1/m from a table, r = m · c − 1, by a series in r; exp(e) = 2^n · 2^(j/128) · exp(s) likewise
//! (Tang 1989, 1990, "Table-driven implementation of the exponential / logarithm function", doi:10.1145/63522.214389, 10.1145/98267.98294).
//! The logarithm is kept as a sum of two numbers, as y may multiply its error by hundreds. What is odd (x not a positive normal number,
//! results near the limits) is left to `libm`.

use crate::power_tables::{EXP, LN2, LOG, STEP, STEPS};

/// Mantissas from 1 + this / 128 on are halved, so that they lie about 1; as in bench/power_tables.py.
const SPLIT: usize = 52;
/// Adding and subtracting it rounds to whole numbers: 1.5 · 2⁵².
const ROUND: f64 = 6_755_399_441_055_744.0;
/// Keeps 26 bits of a number.
const UPPER: u64 = !0 << 27;

#[inline]
fn upper(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & UPPER)
}

/// a + b and its rounding error (Knuth).
#[inline]
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_seen = sum - a;
    (sum, (a - (sum - b_seen)) + (b - b_seen))
}

/// `x` to the power of `y`, with the special cases of IEEE 754 `pow`.
#[inline]
pub fn pow(x: f64, y: f64) -> f64 {
    // Squares of distances, the most frequent of all.
    if y == 2.0 {
        return x * x;
    }
    let bits = x.to_bits();
    // Positive, normal and finite; the difference is less than half of all numbers.
    if bits.wrapping_sub(1 << 52) >= (0x7ff << 52) - (1 << 52) {
        return libm::pow(x, y);
    }
    let index = (bits >> 45 & 127) as usize;
    let halved = u64::from(index >= SPLIT);
    let k = ((bits >> 52) + halved) as i64 - 1023;
    let m = f64::from_bits(bits & ((1 << 52) - 1) | (1023 - halved) << 52);
    let [c, log_high, log_low] = LOG[index];
    // Both products are exact: 32 and 21 bits times 10.
    let m_high = f64::from_bits(m.to_bits() & (!0 << 21));
    let (r, r_low) = two_sum(m_high * c - 1.0, (m - m_high) * c);
    let k = k as f64;
    // Exact: both are multiples of 2⁻⁴² below 2¹⁰.
    let (sum, low1) = two_sum(k * LN2[0] + log_high, r);
    let r2 = r * r;
    let (high, low2) = two_sum(sum, -0.5 * r2);
    let series = r * r2 * (1.0 / 3.0 + r * (-0.25 + r * (0.2 + r * (-1.0 / 6.0 + r * (1.0 / 7.0 + r * (-0.125 + r * (1.0 / 9.0)))))));
    let low = k * LN2[1] + log_low + low1 + low2 + r_low * (1.0 - r) + series;
    // ln x = high + low; y times it, the upper halves exactly.
    let log = high + low;
    let low = (high - log) + low;
    let (y_upper, log_upper) = (upper(y), upper(log));
    let product = y_upper * log_upper;
    let rest = (y - y_upper) * log_upper + y * ((log - log_upper) + low);
    if !(product.abs() < 700.0) {
        return libm::pow(x, y);
    }
    let n = (product * STEPS + ROUND) - ROUND;
    let s = (product - n * STEP[0]) - n * STEP[1] + rest;
    let n = n as i64;
    let [base, tail] = EXP[(n & 127) as usize];
    let s2 = s * s;
    let series = tail + s + s2 * (0.5 + s * (1.0 / 6.0)) + s2 * s2 * (1.0 / 24.0 + s * (1.0 / 120.0));
    let scale = f64::from_bits(((n >> 7) + 1023) as u64 * (1 << 52));
    (base + base * series) * scale
}

/// `x` to the power of `y` to about 1e-11 (times `y`, where that is large), in half of the time: for light, of which pictures keep seven
/// digits at most.
#[inline]
pub fn pow_about(x: f64, y: f64) -> f64 {
    let bits = x.to_bits();
    if bits.wrapping_sub(1 << 52) >= (0x7ff << 52) - (1 << 52) {
        return pow(x, y);
    }
    let index = (bits >> 45 & 127) as usize;
    let halved = u64::from(index >= SPLIT);
    let k = ((bits >> 52) + halved) as i64 - 1023;
    let m = f64::from_bits(bits & ((1 << 52) - 1) | (1023 - halved) << 52);
    let [c, log_high, _] = LOG[index];
    let r = m * c - 1.0;
    let series = r - r * r * (0.5 - r * (1.0 / 3.0 - r * (0.25 - r * 0.2)));
    let product = y * (k as f64 * (LN2[0] + LN2[1]) + log_high + series);
    if !(product.abs() < 700.0) {
        return pow(x, y);
    }
    let n = (product * STEPS + ROUND) - ROUND;
    let s = product - n * (STEP[0] + STEP[1]);
    let n = n as i64;
    let base = EXP[(n & 127) as usize][0];
    let series = s * (1.0 + s * (0.5 + s * (1.0 / 6.0 + s * (1.0 / 24.0))));
    let scale = f64::from_bits(((n >> 7) + 1023) as u64 * (1 << 52));
    (base + base * series) * scale
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Units of the last place between two numbers.
    fn ulps(a: f64, b: f64) -> u64 {
        (a.to_bits() as i64).abs_diff(b.to_bits() as i64)
    }

    #[test]
    fn about_is_near() {
        for i in 0..20_000 {
            let x = libm::exp(f64::from(i) * 1e-3 - 18.0);
            for y in [0.4, 0.88, 1.0 / 2.4, 2.2, 2.4, 40.0, -3.0] {
                let (a, b) = (pow_about(x, y), pow(x, y));
                assert!((a - b).abs() <= 1e-11 * y.abs().max(1.0) * b, "{x}^{y}: {a} is not {b}");
            }
        }
        for x in [0.0, 1.0, -1.0, f64::INFINITY, f64::NAN, 1e-310, 1e300] {
            for y in [0.0, 2.5, -2.5, 1e300, f64::NAN] {
                let (a, b) = (pow_about(x, y), pow(x, y));
                assert!(a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan() || (a - b).abs() < 1e-9 * b, "{x}^{y}: {a} is not {b}");
            }
        }
    }

    #[test]
    fn agrees_with_libm() {
        let mut state = 1u64;
        let mut unit = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut worst = 0;
        for i in 0..400_000 {
            let (x, y) = match i % 4 {
                0 => (unit() * 2.0, unit() * 200.0 - 100.0),
                1 => (libm::exp((unit() - 0.5) * 1400.0), unit() * 4.0 - 2.0),
                2 => (1.0 + (unit() - 0.5) * 1e-3, (unit() - 0.5) * 1e5),
                _ => (unit(), [0.4, 2.2, 1.0 / 2.4, 45.0][i / 4 % 4]),
            };
            worst = worst.max(ulps(pow(x, y), libm::pow(x, y)));
        }
        assert!(worst <= 2, "{worst} units of the last place");
        for x in [0.5, 1.0, 2.0, 10.0, 1.0 + f64::EPSILON, 1.0 - f64::EPSILON, 1.4, 0.7, f64::MIN_POSITIVE, f64::MAX] {
            for y in [0.0, 1.0, -1.0, 2.0, 0.5, 3.0] {
                assert!(ulps(pow(x, y), libm::pow(x, y)) <= 1, "{x}^{y} = {} not {}", pow(x, y), libm::pow(x, y));
            }
        }
    }

    #[test]
    fn odd_numbers() {
        let odd = [0.0, -0.0, 1.0, -1.0, -2.0, 5e-324, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
        for x in odd {
            for y in odd.into_iter().chain([0.5, 3.0, 1e9, -700.0]) {
                assert_eq!(pow(x, y).to_bits(), libm::pow(x, y).to_bits(), "{x}^{y}");
            }
        }
        assert_eq!(pow(2.0, 1e300), f64::INFINITY);
        assert_eq!(pow(2.0, -1e300), 0.0);
    }
}
