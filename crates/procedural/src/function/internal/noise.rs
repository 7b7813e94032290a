//! Internal functions of summed noise.
//!
//! Ken Musgrave, "Procedural Fractal Terrains", in Ebert et al., *Texturing and Modeling: A Procedural Approach*, 2003, chapter 16:
//! heterogeneous terrain and ridged multifractal. What POV-Ray does with fractional octaves and its parameter T was measured.

use glam::DVec3;

use crate::fns;
use crate::noise::noise;

/// Octaves beyond this change nothing that can be seen, and huge numbers must not take forever.
const MOST_OCTAVES: f64 = 64.0;

/// The noise generator that a parameter means.
pub(super) fn generator(parameter: f64) -> u8 {
    match parameter.floor() {
        2.0 => 2,
        3.0 => 3,
        _ => 1,
    }
}

/// Noise in [−1, 1].
fn signed(p: DVec3, generator: u8) -> f64 {
    2.0 * noise(p, generator) - 1.0
}

/// Octaves within limits: how many are whole, and the fraction of a further one.
fn octaves(parameter: f64) -> f64 {
    if parameter.is_nan() { 0.0 } else { parameter.clamp(0.0, MOST_OCTAVES) }
}

/// `f_hetero_mf`: H, lacunarity, octaves, offset, T, generator.
pub(super) fn hetero_mf(at: [f64; 3], p: &[f64]) -> f64 {
    let (h, lacunarity, octaves, offset, g) = (p[0], p[1], octaves(p[2]), p[3], generator(p[5]));
    // T counts how often the value so far weighs the next octave; of fractions only the whole part counts.
    let weights = if p[4] >= 1.0 { p[4].min(16.0) as u32 } else { 0 };
    let mut q = DVec3::from(at);
    let mut value = signed(q, g) + offset;
    let octave = |q: DVec3, i: f64| (signed(q, g) + offset) * fns::pow(lacunarity, -h * i);
    let mut i = 1.0;
    while i < octaves {
        q *= lacunarity;
        let weight: f64 = (0..weights).map(|_| value).product();
        value += octave(q, i) * weight;
        i += 1.0;
    }
    let rest = octaves - octaves.floor();
    if rest > 0.0 {
        q *= lacunarity;
        // Once, whatever T is.
        value += rest * octave(q, i) * value;
    }
    value
}

/// `f_ridged_mf`: H, lacunarity, octaves, offset, gain, generator.
pub(super) fn ridged_mf(at: [f64; 3], p: &[f64]) -> f64 {
    let (h, lacunarity, octaves, offset, gain, g) = (p[0], p[1], octaves(p[2]), p[3], p[4], generator(p[5]));
    let ridge = |q: DVec3| {
        let s = offset - signed(q, g).abs();
        s * s
    };
    let mut q = DVec3::from(at);
    let mut signal = ridge(q);
    let mut value = signal;
    let mut i = 1.0;
    while i < octaves {
        q *= lacunarity;
        signal = ridge(q) * (signal * gain).clamp(0.0, 1.0);
        value += signal * fns::pow(lacunarity, -h * i);
        i += 1.0;
    }
    value
}

/// `f_ridge`: lambda, octaves, omega, offset, ridge, generator.
pub(super) fn ridge(at: [f64; 3], p: &[f64]) -> f64 {
    let (lambda, octaves, omega, offset, ridge, g) = (p[0], octaves(p[1]), p[2], p[3], p[4], generator(p[5]));
    // Noise folded at `ridge` and brought to [0, 1], then shifted by `offset` and brought to [−1, 1].
    let (fold, shift) = (ridge.max(1.0 - ridge), offset.max(1.0 - offset));
    let octave = |q: DVec3| ((noise(q, g) - ridge).abs() / fold - offset) / shift;
    let mut q = DVec3::from(at);
    let (mut sum, mut weights, mut amplitude) = (octave(q), 1.0, 1.0);
    let mut i = 2.0;
    while i <= octaves {
        q *= lambda;
        amplitude *= omega;
        sum += amplitude * octave(q);
        weights += amplitude;
        i += 1.0;
    }
    let rest = octaves - octaves.floor();
    if rest > 0.0 {
        q *= lambda;
        amplitude *= omega * rest;
        sum += amplitude * octave(q);
        weights += amplitude;
    }
    sum / weights
}
