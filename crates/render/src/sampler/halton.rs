//! Halton's sequence with Owen-scrambled digits.

use crate::math::hash::{mix32, unit_float};

const PRIMES: [u32; 40] = [
    2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89, 97, 101, 103, 107, 109, 113, 127, 131, 137,
    139, 149, 151, 157, 163, 167, 173,
];

/// The scrambled radical inverse of the index in the dimension's prime base (Owen 1995; each digit is shifted by a hash of the
/// digits before it, a subset of all permutations that keeps every stratum).
#[inline]
pub(super) fn sample(index: u32, dimension: u32, seed: u32) -> f32 {
    let Some(&base) = PRIMES.get(dimension as usize) else {
        return unit_float(mix32(seed ^ mix32(index ^ dimension)));
    };
    let inv_base = 1.0 / base as f32;
    let (mut value, mut scale, mut rest, mut prefix) = (0.0f32, inv_base, index, seed);
    // Beyond this the digits do not change the float; leading zeros are scrambled as well.
    while scale > 1e-8 {
        let digit = rest % base;
        rest /= base;
        let shift = mix32(prefix) % base;
        value += ((digit + shift) % base) as f32 * scale;
        prefix = mix32(prefix ^ (digit + 1).wrapping_mul(0x9e37_79b9));
        scale *= inv_base;
    }
    value
}
