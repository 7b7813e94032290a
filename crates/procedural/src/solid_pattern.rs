//! Patterns that are functions of a place: those of pbrt-v4's textures (Pharr, Jakob, Humphreys 2023, "Physically Based Rendering",
//! 4th edition, chapter 10; sums of noise in octaves: Perlin 1985, "An Image Synthesizer", doi:10.1145/325165.325247).
//!
//! All octaves count: what is finer than a pixel averages out over its samples, where pbrt leaves it out.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::fns;
use crate::gradient_noise::{LACUNARITY, noise};

/// Most octaves of a sum: beyond that, cells are smaller than what an `f32` tells apart.
pub const MOST_OCTAVES: u32 = 32;

/// What `|noise|` is taken to be in the mean where an octave is left out.
const MEAN_OF_ABSOLUTE: f32 = 0.2;
/// Radius of a dot, in cells.
const DOT_RADIUS: f32 = 0.35;

/// A pattern in its own space, whose cells have edges of length 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum SolidPattern {
    /// Octaves of noise, about 0.
    Fbm {
        /// How many, at most [`MOST_OCTAVES`].
        octaves: u32,
        /// Ratio of the weights of successive octaves.
        roughness: f32,
    },
    /// Octaves of absolute noise: creases where the noise is 0.
    Turbulence {
        /// How many, at most [`MOST_OCTAVES`].
        octaves: u32,
        /// Ratio of the weights of successive octaves.
        roughness: f32,
    },
    /// Waves of water: noise whose height is another, slower noise.
    Windy,
    /// A fixed ramp of colors over waves along y, moved by octaves of noise.
    Marble {
        /// How many, at most [`MOST_OCTAVES`].
        octaves: u32,
        /// Ratio of the weights of successive octaves.
        roughness: f32,
        /// Factor on the place.
        scale: f32,
        /// How far the noise moves the waves.
        variation: f32,
    },
    /// 0 in the cube at the origin, 1 in those that share a face with it, and so on.
    Cubes,
    /// 1 in dots of random places about whole numbers of x and y, which half of them have; 0 elsewhere.
    Dots,
    /// The place's x.
    Coordinate,
}

impl SolidPattern {
    /// The color at a place; numbers are in all channels. Whatever the place and the parameters, it is finite.
    pub fn color(&self, p: Vec3) -> [f32; 3] {
        let value = match *self {
            Self::Fbm { octaves, roughness } => fbm(p, octaves, roughness),
            Self::Turbulence { octaves, roughness } => turbulence(p, octaves, roughness),
            Self::Windy => fbm(0.1 * p, 3, 0.5).abs() * fbm(p, 6, 0.5),
            Self::Marble { octaves, roughness, scale, variation } => {
                let p = p * scale;
                let at = p.y + variation * fbm(p, octaves, roughness);
                return marble_ramp(0.5 + 0.5 * fns::sin(f64::from(at)) as f32);
            }
            Self::Cubes => {
                // Whole numbers of an f32 have an exact remainder, however large they are.
                let odd = p.floor().to_array().into_iter().filter(|v| v.rem_euclid(2.0) == 1.0).count();
                (odd % 2) as f32
            }
            Self::Dots => f32::from(u8::from(in_dot(p.truncate()))),
            Self::Coordinate => p.x,
        };
        [if value.is_finite() { value } else { 0.0 }; 3]
    }

    /// About the mean over all places, for formats that lack the pattern.
    pub fn mean(&self) -> [f32; 3] {
        match *self {
            Self::Fbm { .. } | Self::Windy => [0.0; 3],
            Self::Turbulence { octaves, roughness } => {
                let sum = (0..octaves.min(MOST_OCTAVES)).fold((0.0, 1.0), |(sum, weight), _| (sum + weight, weight * roughness)).0;
                [if sum.is_finite() { MEAN_OF_ABSOLUTE * sum } else { 0.0 }; 3]
            }
            // Sines spend most of their time at both ends.
            Self::Marble { .. } => {
                let steps = 64;
                let at = |i: i32| marble_ramp(0.5 + 0.5 * fns::sin((f64::from(i) + 0.5) / f64::from(steps) * std::f64::consts::TAU) as f32);
                (0..steps).map(at).fold([0.0; 3], |sum, c| std::array::from_fn(|k| sum[k] + c[k] / steps as f32))
            }
            Self::Cubes | Self::Coordinate => [0.5; 3],
            Self::Dots => [0.5 * std::f32::consts::PI * DOT_RADIUS * DOT_RADIUS; 3],
        }
    }

    /// Whether values may be below 0 or above 1.
    pub fn is_unbounded(&self) -> bool {
        matches!(self, Self::Fbm { .. } | Self::Turbulence { .. } | Self::Windy | Self::Coordinate)
    }
}

/// Scales of the place and weights of octaves.
fn octaves(count: u32, roughness: f32) -> impl Iterator<Item = (f32, f32)> {
    (0..count.min(MOST_OCTAVES)).scan((1.0, 1.0), move |(scale, weight), _| {
        let octave = (*scale, *weight);
        *scale *= LACUNARITY;
        *weight *= roughness;
        Some(octave)
    })
}

fn fbm(p: Vec3, count: u32, roughness: f32) -> f32 {
    octaves(count, roughness).map(|(scale, weight)| weight * noise(scale * p)).sum()
}

fn turbulence(p: Vec3, count: u32, roughness: f32) -> f32 {
    let (mut sum, mut next) = (0.0, 1.0);
    for (scale, weight) in octaves(count, roughness) {
        sum += weight * noise(scale * p).abs();
        next = weight * roughness;
    }
    // The first octave that is left out has its mean, as in pbrt.
    sum + MEAN_OF_ABSOLUTE * next
}

/// Whether a point is inside a dot.
fn in_dot(st: Vec2) -> bool {
    let cell = (st + 0.5).floor();
    // Planes of the noise away from its zeros, for whether, and for where.
    let number = |offset: Vec2| noise((cell + offset).extend(0.5));
    if !(number(Vec2::splat(0.5)) > 0.0) {
        return false;
    }
    let shift = (0.5 - DOT_RADIUS) * Vec2::new(number(Vec2::new(1.5, 2.8)), number(Vec2::new(4.5, 9.8)));
    (st - cell - shift).length_squared() < DOT_RADIUS * DOT_RADIUS
}

/// The colors of marble: each four neighbors are the control points of a cubic Bézier curve.
fn marble_ramp(t: f32) -> [f32; 3] {
    const LIGHT: [f32; 3] = [0.58, 0.58, 0.6];
    const COLORS: [[f32; 3]; 9] = [LIGHT, LIGHT, LIGHT, [0.5; 3], [0.6, 0.59, 0.58], LIGHT, LIGHT, [0.2, 0.2, 0.33], LIGHT];
    const BRIGHTNESS: f32 = 1.5;
    let segments = COLORS.len() - 3;
    let t = if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 } * segments as f32;
    let first = (t as usize).min(segments - 1);
    let t = t - first as f32;
    let s = 1.0 - t;
    let weights = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
    std::array::from_fn(|k| BRIGHTNESS * weights.iter().zip(&COLORS[first..]).map(|(w, c)| w * c[k]).sum::<f32>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places() -> impl Iterator<Item = Vec3> {
        (0..20_000u32).map(|i| Vec3::new((i % 20) as f32 * 0.37, (i / 20 % 40) as f32 * 0.61, (i / 800) as f32 * 0.53) - 7.0)
    }

    fn mean(pattern: SolidPattern) -> f64 {
        places().map(|p| f64::from(pattern.color(p)[0])).sum::<f64>() / 20_000.0
    }

    /// Two octaves are the noise and the weighted noise of the scaled place; turbulence takes both without their signs.
    #[test]
    fn octaves_add_up() {
        for p in places().step_by(97) {
            let (a, b) = (noise(p), noise(LACUNARITY * p));
            let fbm = SolidPattern::Fbm { octaves: 2, roughness: 0.3 }.color(p)[0];
            let turbulence = SolidPattern::Turbulence { octaves: 2, roughness: 0.3 }.color(p)[0];
            assert!((fbm - (a + 0.3 * b)).abs() < 1e-6);
            assert!((turbulence - (a.abs() + 0.3 * b.abs() + 0.2 * 0.09)).abs() < 1e-6);
        }
    }

    #[test]
    fn means_are_what_is_told() {
        let patterns = [
            SolidPattern::Fbm { octaves: 4, roughness: 0.5 },
            SolidPattern::Turbulence { octaves: 8, roughness: 0.5 },
            SolidPattern::Windy,
            SolidPattern::Marble { octaves: 4, roughness: 0.5, scale: 3.0, variation: 0.5 },
            SolidPattern::Cubes,
            SolidPattern::Dots,
        ];
        for pattern in patterns {
            let (found, told) = (mean(pattern), f64::from(pattern.mean()[0]));
            assert!((found - told).abs() < 0.06, "{pattern:?}: {found} {told}");
        }
    }

    #[test]
    fn cubes_alternate_along_each_axis() {
        let at = |x: f32, y: f32, z: f32| SolidPattern::Cubes.color(Vec3::new(x, y, z))[0];
        assert_eq!(
            [at(0.5, 0.5, 0.5), at(1.5, 0.5, 0.5), at(0.5, -0.5, 0.5), at(0.5, 0.5, 1.5), at(-0.5, -0.5, 0.5)],
            [0.0, 1.0, 1.0, 1.0, 0.0]
        );
    }

    /// Dots are round, as large as told, and no dot leaves its cell.
    #[test]
    fn dots_have_their_area_or_none() {
        let n = 200;
        let mut dotted = 0;
        for cell in 0..64 {
            let center = Vec2::new((cell % 8) as f32 - 3.0, (cell / 8) as f32 - 5.0);
            let inside = |i: i32| in_dot(center + Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32 - 0.5);
            let area = (0..n * n).filter(|i| inside(*i)).count() as f32 / (n * n) as f32;
            let full = std::f32::consts::PI * DOT_RADIUS * DOT_RADIUS;
            assert!(area == 0.0 || (area - full).abs() < 0.01, "{area}");
            dotted += u32::from(area > 0.0);
        }
        assert!((16..48).contains(&dotted), "{dotted}");
    }

    /// At its lowest and highest, and where curves meet: each begins with the first of its four colors.
    #[test]
    fn marble_has_its_colors() {
        let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(&b).all(|(a, b)| (a - 1.5 * b).abs() < 1e-5);
        assert!(close(marble_ramp(0.0), [0.58, 0.58, 0.6]) && close(marble_ramp(1.0), [0.58, 0.58, 0.6]));
        assert!(close(marble_ramp(0.5), [0.5; 3]), "{:?}", marble_ramp(0.5));
        assert!(marble_ramp(0.95)[0] < 0.75, "dark veins");
    }

    #[test]
    fn hostile_places_and_parameters_give_finite_colors_at_once() {
        let hostile = [f32::NAN, f32::INFINITY, f32::MAX, -1e30, 1e-40];
        for v in hostile {
            for p in [Vec3::splat(v), Vec3::new(v, 0.3, -v)] {
                for pattern in [
                    SolidPattern::Fbm { octaves: u32::MAX, roughness: v },
                    SolidPattern::Turbulence { octaves: u32::MAX, roughness: v },
                    SolidPattern::Windy,
                    SolidPattern::Marble { octaves: u32::MAX, roughness: v, scale: v, variation: v },
                    SolidPattern::Cubes,
                    SolidPattern::Dots,
                    SolidPattern::Coordinate,
                ] {
                    assert!(pattern.color(p).iter().all(|c| c.is_finite()), "{pattern:?} at {p}");
                    assert!(pattern.mean().iter().all(|c| c.is_finite()), "{pattern:?}");
                }
            }
        }
    }
}
