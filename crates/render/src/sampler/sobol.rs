//! Owen-scrambled Sobol' pairs.
//!
//! Each pair of dimensions uses the first two dimensions of Sobol's sequence, a (0, 2)-sequence in base 2, with its own
//! Owen scrambling and its own shuffle of the sample order, both by hashing (Burley 2020, "Practical Hash-based Owen
//! Scrambling", JCGT 9(4), sections 3 to 5). So every pair is perfectly stratified for each power of two of samples, and
//! pairs are independent of each other.

use crate::math::Vec2;
use crate::math::hash::unit_float;

/// A random permutation in which each bit depends on lower bits only (Laine and Karras 2011, doi:10.1111/j.1467-8659.2011.01987.x,
/// with the constants that Vegdahl 2021 found to scramble better).
#[inline]
fn laine_karras(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// The second dimension's generator matrix is Pascal's triangle modulo 2, and C(i, j) is odd where j's bits are a subset of i's (Lucas),
/// so the product is an exclusive or over supersets: five steps. The result is in reversed bit order.
#[inline]
fn pascal(mut x: u32) -> u32 {
    x ^= (x & 0xaaaa_aaaa) >> 1;
    x ^= (x & 0xcccc_cccc) >> 2;
    x ^= (x & 0xf0f0_f0f0) >> 4;
    x ^= (x & 0xff00_ff00) >> 8;
    x ^ (x >> 16)
}

#[inline]
fn shuffle(reversed_index: u32, seed: u32) -> u32 {
    laine_karras(reversed_index, seed).reverse_bits()
}

/// Reverses the bits of two words at once: half of the steps of doing so one after the other.
#[inline]
fn reverse_both(x: u32, y: u32) -> (u32, u32) {
    let v = u64::from(x) << 32 | u64::from(y);
    let v = (v >> 1) & 0x5555_5555_5555_5555 | (v & 0x5555_5555_5555_5555) << 1;
    let v = (v >> 2) & 0x3333_3333_3333_3333 | (v & 0x3333_3333_3333_3333) << 2;
    let v = (v >> 4) & 0x0f0f_0f0f_0f0f_0f0f | (v & 0x0f0f_0f0f_0f0f_0f0f) << 4;
    // Swapping all eight bytes also swaps the words.
    let v = v.swap_bytes();
    (v as u32, (v >> 32) as u32)
}

/// The number of the sample whose index has these bits in reverse.
#[inline]
pub(super) fn sample_1d(reversed_index: u32, a: u32, b: u32) -> f32 {
    unit_float(laine_karras(shuffle(reversed_index, a), b).reverse_bits())
}

/// The pair of the sample whose index has these bits in reverse.
#[inline]
pub(super) fn sample_2d(reversed_index: u32, a: u32, b: u32) -> Vec2 {
    let i = shuffle(reversed_index, a);
    let (x, y) = reverse_both(laine_karras(i, b), laine_karras(pascal(i), b.rotate_left(16) ^ 0x5bd1_e995));
    Vec2::new(unit_float(x), unit_float(y))
}
