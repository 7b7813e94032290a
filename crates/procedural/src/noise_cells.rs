//! Patterns of random cells and of random wave centers: `cells`, `crackle`, `ripples`, `waves`.
//!
//! Found from POV-Ray's documentation and output alone (`README.md` beside this file).

use std::f64::consts::TAU;
use std::sync::LazyLock;

use glam::DVec3;

use crate::fns;
use crate::noise::{noise, unit, vector_noise};
use crate::noise_tables::{HASH, HASH_SIZE, TWISTER, step};

/// Points this close below a border of two cells belong to the upper one.
const BORDER: f64 = 1e-10;

/// Cubes within one of a point's own and those two off along one axis, near ones first.
const NEIGHBORS: [[i8; 3]; 81] = {
    let mut list = [[0; 3]; 81];
    let (mut length, mut square) = (0, 0);
    while square <= 6 {
        let mut n = 0;
        while n < 125 {
            let o = [n % 5 - 2, n / 5 % 5 - 2, n / 25 - 2];
            // Two steps along two axes would make a square of 8 at least.
            if o[0] * o[0] + o[1] * o[1] + o[2] * o[2] == square {
                list[length] = [o[0] as i8, o[1] as i8, o[2] as i8];
                length += 1;
            }
            n += 1;
        }
        square += 1;
    }
    list
};

/// The first of [`NEIGHBORS`] that is two off.
const TWO_OFF: usize = 27;

/// Number of a unit cell, 0 to 4095; unlike the lattice of the noise, cells are numbered from 0 on.
fn cell_hash(cell: [i64; 3]) -> usize {
    cell.into_iter().fold(None, |h, i| Some(usize::from(HASH[(h.unwrap_or(0) ^ (i & 4095) as usize) % HASH_SIZE]))).unwrap_or(0)
}

fn uniform(index: usize) -> f64 {
    f64::from(TWISTER[index % TWISTER.len()]) / 4_294_967_296.0
}

/// The pattern `cells`: a random number in [0, 1) per unit cube.
pub fn cells(p: DVec3) -> f64 {
    uniform(cell_hash((p + BORDER).floor().to_array().map(|c| c as i64)))
}

/// The pattern `crackle`, in [0, 1].
///
/// # Arguments
///
/// * `form`: weights of the distances to the nearest, second and third nearest feature point; (−1, 1, 0) by default.
/// * `metric`: m of the distance (Σ |d|^m)^(1/m); 2 by default. One that is not above 0 counts as 2.
/// * `offset`: distance along a fourth dimension; 0 by default.
/// * `solid`: the noise at the nearest feature point instead, by `generator`.
pub fn crackle(p: DVec3, form: DVec3, metric: f64, offset: f64, solid: bool, generator: u8) -> f64 {
    let metric = if metric > 0.0 && metric.is_finite() { metric } else { 2.0 };
    let needed = if solid || (form.y == 0.0 && form.z == 0.0) {
        0
    } else if form.z == 0.0 {
        1
    } else {
        2
    };
    let (best, nearest) = if metric == 2.0 {
        feature_points(p, needed, |d| d * d)
    } else if metric == 1.0 {
        feature_points(p, needed, f64::abs)
    } else {
        feature_points(p, needed, |d| fns::pow(d.abs(), metric))
    };
    if solid {
        return noise(nearest, generator);
    }
    let fourth = if offset == 0.0 { 0.0 } else { fns::pow(offset, metric) };
    let distance = |weight: f64, s: f64| {
        if weight == 0.0 {
            return 0.0;
        }
        let s = s + fourth;
        weight
            * if metric == 2.0 {
                s.sqrt()
            } else if metric == 1.0 {
                s
            } else {
                fns::pow(s, 1.0 / metric)
            }
    };
    unit(distance(form.x, best[0]) + distance(form.y, best[1]) + distance(form.z, best[2]))
}

/// How far the three nearest feature points are, as the sum of `power` over the axes, and the nearest of them. Of the second and third only
/// as many are right as are `needed`.
#[inline(always)]
fn feature_points(p: DVec3, needed: usize, power: impl Fn(f64) -> f64) -> ([f64; 3], DVec3) {
    let floor = p.floor();
    let d = (p - floor).to_array();
    let base = floor.to_array().map(|c| c as i64);
    // Least distances along an axis to any point of the cubes two, one … off.
    let gaps = d.map(|d| [power(d + 1.0), power(d), 0.0, power(1.0 - d), power(2.0 - d)]);
    let mut first = [0; 5];
    for (step, h) in (-2i64..).zip(&mut first) {
        *h = usize::from(HASH[(base[0].wrapping_add(step) & 4095) as usize % HASH_SIZE]);
    }
    let mut best = [f64::INFINITY; 3];
    let mut nearest = p;
    // Near cubes come first, so that most of the others are left out.
    for (i, neighbor) in NEIGHBORS.iter().enumerate() {
        // All cubes from here on are off by two along an axis.
        if i == TWO_OFF && best[needed] <= power(1.0) {
            break;
        }
        let [x, y, z] = neighbor.map(|step| (step + 2) as usize % 5);
        if gaps[0][x] + gaps[1][y] + gaps[2][z] >= best[needed] {
            continue;
        }
        let step = neighbor.map(i64::from);
        let next = |h: usize, axis: usize| usize::from(HASH[(h ^ (base[axis].wrapping_add(step[axis]) & 4095) as usize) % HASH_SIZE]);
        let h = next(next(first[x], 1), 2);
        let point = [step[0] as f64 + uniform(h), step[1] as f64 + uniform(h + 1), step[2] as f64 + uniform(h + 2)];
        let s = power(d[0] - point[0]) + power(d[1] - point[1]) + power(d[2] - point[2]);
        if s < best[0] {
            nearest = floor + DVec3::from_array(point);
            best = [s, best[0], best[1]];
        } else if s < best[1] {
            best = [best[0], s, best[1]];
        } else if s < best[2] {
            best[2] = s;
        }
    }
    (best, nearest)
}

/// Most waves of a scene.
const MOST_WAVES: usize = 1000;

/// Centers of ripples and waves, on the unit sphere, and the frequencies of waves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waves {
    centers: &'static [(DVec3, f64)],
}

impl Waves {
    /// The centers of `number_of_waves` (10 by default) of a scene's global settings: 1 to 1000, others are moved into that range.
    pub fn new(number_of_waves: u32) -> Self {
        let count = (number_of_waves as usize).clamp(1, MOST_WAVES);
        Self { centers: ALL_WAVES.get(..count).unwrap_or_default() }
    }

    /// The pattern `ripples`, in [0, 1]. `frequency` and `phase` are those of the pattern, which afterwards count again, as for all patterns.
    pub fn ripples(&self, p: DVec3, frequency: f64, phase: f64) -> f64 {
        let sum: f64 = self.centers.iter().map(|(c, _)| fns::sin(TAU * (p.distance(*c) * frequency + phase))).sum();
        0.5 + 0.5 * sum / self.centers.len() as f64
    }

    /// The pattern `waves`, about in [0, 1]; the arguments as for [`Waves::ripples`].
    pub fn waves(&self, p: DVec3, frequency: f64, phase: f64) -> f64 {
        let sum: f64 = self.centers.iter().map(|(c, f)| fns::sin(TAU * (p.distance(*c) * frequency * f + phase)) / f).sum();
        0.5 + 0.2 * sum / self.centers.len() as f64
    }

    /// What `normal { ripples }` adds to a normal for each unit of depth: the mean of the directions from the centers, times the waves
    /// there.
    pub fn ripples_vector(&self, p: DVec3, frequency: f64, phase: f64) -> DVec3 {
        self.vector(p, |distance, _| fns::sin(TAU * (distance * frequency + phase)))
    }

    /// The same for `normal { waves }`.
    pub fn waves_vector(&self, p: DVec3, frequency: f64, phase: f64) -> DVec3 {
        self.vector(p, |distance, f| fns::sin(TAU * (distance * frequency * f + phase)) / f)
    }

    fn vector(&self, p: DVec3, wave: impl Fn(f64, f64) -> f64) -> DVec3 {
        let each = |(center, f): &(DVec3, f64)| {
            let way = p - *center;
            let distance = way.length();
            if distance > 0.0 { way * (wave(distance, *f) / distance) } else { DVec3::ZERO }
        };
        self.centers.iter().map(each).sum::<DVec3>() / self.centers.len() as f64
    }
}

/// All centers and frequencies: those of fewer waves are the first of them.
static ALL_WAVES: LazyLock<Vec<(DVec3, f64)>> = LazyLock::new(|| {
    let mut state = 0xde92_1401;
    let centers = (0..MOST_WAVES).map(|k| {
        state = step(state);
        let frequency = f64::from(state >> 16 & 0x7fff) / 32_767.0 + 0.01;
        (vector_noise(DVec3::new(k as f64, 0.0, 0.0), 2).normalize_or_zero(), frequency)
    });
    centers.collect()
});

#[cfg(test)]
mod tests {
    use super::*;

    /// Point; values of POV-Ray 3.7.0.10: cells, crackle, crackle with a form, with metric 1, with metric 3 and offset 0.2, solid,
    /// ripples, waves.
    #[rustfmt::skip]
    const MEASURED: [(DVec3, [f64; 8]); 12] = [
        (DVec3::new(6.664, -3.837, 1.857), [0.585987038212, 0.156784596846, 0.380813924269, 0.272803602587, 0.108753250271, 0.491898221262, 0.411136234636, 0.577775079317]),
        (DVec3::new(4.996, 3.889, 7.477), [0.261871188413, 0.336756934893, 0.340424206766, 0.579311204921, 0.274323263329, 0.518170317024, 0.355833379849, 0.612959718403]),
        (DVec3::new(6.487, 7.528, -8.521), [0.0335723175667, 0.0487645808912, 0.307696063858, 0.0849472927563, 0.0471376564978, 0.427672742345, 0.617332157278, 0.560944773181]),
        (DVec3::new(-1.13, -0.271, -7.827), [0.275480210548, 0.0772110084769, 0.402084667868, 0.126380778164, 0.0848960659615, 0.47499328135, 0.58992724449, 0.402416449474]),
        (DVec3::new(-8.899, 5.951, 8.699), [0.699995463481, 0.0899680724011, 0.299600300889, 0.0961791775636, 0.130573991034, 0.369947495039, 0.445125066198, 0.560242584946]),
        (DVec3::new(5.123, -3.319, 3.696), [0.105920413742, 0.562878291077, 0.239871926705, 0.777455010479, 0.354500541381, 0.297109626376, 0.459763473474, 0.574533420676]),
        (DVec3::new(-3.615, 4.333, -3.965), [0.686397840967, 0.00662126427529, 0.496416805689, 0.138865082441, 0.0034482969603, 0.438389969048, 0.496197575288, 0.506954919131]),
        (DVec3::new(5.087, 8.779, 8.752), [0.783537448384, 0.129278755397, 0.30760489211, 0.0363831155319, 0.115970174463, 0.586719931386, 0.686291624381, 0.582132875006]),
        (DVec3::new(6.892, 7.431, 3.748), [0.327797074569, 0.40715865609, 0.306546731428, 0.571420690525, 0.36516306679, 0.414088861755, 0.401722221365, 0.345056305572]),
        (DVec3::new(0.981, 7.618, -7.385), [0.117334353272, 0.115143677074, 0.413147341499, 0.136606416607, 0.0960935730877, 0.53313772017, 0.316741763, 0.446793690586]),
        (DVec3::new(-1169.0, 953.5, -200.5), [0.376101934118, 0.233409957831, 0.380807688749, 0.463941737544, 0.167810373331, 0.471274983287, 0.493737359385, 0.44107054904]),
        (DVec3::new(2635.5, -2744.0, -3939.5), [0.722348514246, 0.0941658122281, 0.341729670286, 0.0455715765711, 0.126771842217, 0.582638761734, 0.480609054766, 0.332731538029]),
    ];

    #[test]
    fn patterns_are_as_measured() {
        let form = DVec3::new(-1.0, 1.0, 0.0);
        let waves = Waves::new(10);
        for (p, expected) in MEASURED {
            let found = [
                cells(p),
                crackle(p, form, 2.0, 0.0, false, 2),
                crackle(p, DVec3::new(0.3, -0.2, 0.4), 2.0, 0.0, false, 2),
                crackle(p, form, 1.0, 0.0, false, 2),
                crackle(p, form, 3.0, 0.2, false, 2),
                crackle(p, form, 2.0, 0.0, true, 2),
                waves.ripples(p, 1.0, 0.0),
                waves.waves(p, 1.0, 0.0),
            ];
            for (kind, (found, expected)) in found.into_iter().zip(expected).enumerate() {
                assert!((found - expected).abs() < 1e-9, "value {kind}: {found} instead of {expected} at {p}");
            }
        }
    }

    #[test]
    fn hostile_points_do_no_harm() {
        let waves = Waves::new(u32::MAX);
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -9.3e18, 0.0] {
            for p in [DVec3::splat(x), DVec3::new(0.5, x, 0.25)] {
                assert!((0.0..1.0).contains(&cells(p)));
                for solid in [false, true] {
                    assert!((0.0..=1.0).contains(&crackle(p, DVec3::new(x, 1.0, x), x, x, solid, 3)));
                }
                let _ = (waves.ripples(p, x, x), waves.waves(p, x, x));
            }
        }
    }
}
