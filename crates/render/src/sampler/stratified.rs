//! Correlated multi-jittered samples (Kensler 2013, Pixar technical memo 13-01).

use crate::math::Vec2;
use crate::math::hash::{mix32, unit_float};

/// A random permutation of 0..n: a Feistel-like mix by cycle walking, seeded.
fn permute(mut i: u32, n: u32, seed: u32) -> u32 {
    let mask = n.next_power_of_two() - 1;
    let bits = mask.count_ones().max(1);
    let shift = (bits / 2).max(1);
    let seeds = [0u32, 1, 2].map(|round| mix32(seed ^ round.wrapping_mul(0x9e37_79b9)));
    loop {
        // Each step is a bijection of the `bits`-bit numbers: odd multiplication, addition, xor with a right shift.
        for s in seeds {
            i = i.wrapping_add(s) & mask;
            i = i.wrapping_mul((s >> 7) | 1) & mask;
            i ^= i >> shift;
        }
        if i < n {
            return i;
        }
    }
}

/// The seed for the n-th batch of `spp` samples: samples beyond the plan are stratified among themselves.
fn batch(index: u32, spp: u32, seed: u32) -> (u32, u32) {
    (index % spp, mix32(seed ^ (index / spp).wrapping_mul(0x85eb_ca6b)))
}

pub(super) fn sample_1d(index: u32, spp: u32, seed: u32) -> f32 {
    let spp = spp.max(1);
    let (i, seed) = batch(index, spp, seed);
    let jitter = unit_float(mix32(i ^ mix32(seed ^ 0x0a39_9d38)));
    (permute(i, spp, seed) as f32 + jitter) / spp as f32
}

pub(super) fn sample_2d(index: u32, spp: u32, seed: u32) -> Vec2 {
    let spp = spp.max(1);
    let (i, seed) = batch(index, spp, seed);
    // m × n cells with m·n ≥ spp; a count that does not divide leaves some cells empty.
    let m = (spp as f32).sqrt() as u32;
    let n = spp.div_ceil(m);
    let s = permute(i, spp, seed ^ 0x51ed_270b);
    let (cx, cy) = (s % m, s / m);
    let sx = permute(cx, m, seed ^ 0x68bc_21eb);
    let sy = permute(cy, n, seed ^ 0x02e5_be93);
    let jx = unit_float(mix32(s ^ mix32(seed ^ 0x967a_889b)));
    let jy = unit_float(mix32(s ^ mix32(seed ^ 0x368c_c8b7)));
    let x = (cx as f32 + (permute(cy, n, seed ^ mix32(sx)) as f32 + jx) / n as f32) / m as f32;
    let y = (cy as f32 + (permute(cx, m, seed ^ mix32(sy ^ 0x1234)) as f32 + jy) / m as f32) / n as f32;
    Vec2::new(x, y)
}
