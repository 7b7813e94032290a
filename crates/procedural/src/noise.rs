//! Noise and turbulence of the three generators, and the patterns that are sums of noise.
//!
//! All formulas and tables were found from POV-Ray's documentation and output alone: `docs/decisions/0004-noise-tables.md` and
//! `README.md` beside this file tell how. Values agree with POV-Ray 3.7 to about 1e-15.
//!
//! Points that are not finite give some finite value or NaN, never a panic.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::fns;
use crate::noise_tables::{COEFFICIENTS, HASH, HASH_SIZE, PERLIN, PERLIN_SIZE};

/// Noise in [0, 1] at a point.
///
/// # Arguments
///
/// * `generator`: 1, which is cut at 0 and at 1 in many places; 2, the same function scaled into [0, 1]; 3, gradient noise of Perlin
///   (1985). Other numbers count as 2.
#[inline]
pub fn noise(p: DVec3, generator: u8) -> f64 {
    unit(match generator {
        1 => value_gradient_noise(p) + 0.5,
        3 => perlin(p),
        _ => (value_gradient_noise(p) + 1.05242) * 0.48985582,
    })
}

/// Vector-valued noise: three numbers, each about in [−1, 1] and mostly in [−0.5, 0.5]. It is the same for all generators
/// (measured); the argument keeps the two kinds of noise alike.
pub fn vector_noise(p: DVec3, _generator: u8) -> DVec3 {
    let cell = Cell::new(p);
    let mut factors = [[0.0; 4]; 8];
    for (corner, factors) in factors.iter_mut().enumerate() {
        let (_, weight, d) = cell.corner(corner);
        *factors = [weight * 0.5, weight * d.x, weight * d.y, weight * d.z];
    }
    let sum = terms(&cell.hash, &factors);
    let component = |k: usize| (sum[k] + sum[k + 2]) + (sum[k + 1] + sum[k + 3]);
    DVec3::new(component(0), component(4), component(8))
}

/// Four terms of each component of [`vector_noise`], over all corners.
///
/// On its own, so that compilers pair neighbors in memory: where they see the sums of the terms they pair components, and spend half of the
/// time on moving numbers about.
#[inline(never)]
fn terms(hash: &[u8; 8], factors: &[[f64; 4]; 8]) -> [f64; 12] {
    let mut sum = [0.0; 12];
    for (h, factors) in hash.iter().zip(factors) {
        let h = usize::from(*h);
        for (i, (sum, c)) in sum.iter_mut().zip(&COEFFICIENTS[h..h + 12]).enumerate() {
            *sum += c * factors[i % 4];
        }
    }
    sum
}

/// Parameters of turbulence.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Turbulence {
    /// Number of octaves, 1 to 10; others are moved into that range.
    pub octaves: u32,
    /// Frequency ratio of successive octaves; counts with the precision of `f32`.
    pub lambda: f64,
    /// Amplitude ratio of successive octaves; counts with the precision of `f32`.
    pub omega: f64,
}

impl Default for Turbulence {
    fn default() -> Self {
        Self { octaves: 6, lambda: 2.0, omega: 0.5 }
    }
}

impl Turbulence {
    /// Scale of the point and amplitude of each octave.
    fn octaves(&self) -> impl Iterator<Item = (f64, f64)> {
        let (lambda, omega) = (f64::from(self.lambda as f32), f64::from(self.omega as f32));
        (0..self.octaves.clamp(1, 10)).scan((1.0, 1.0), move |(scale, amplitude), _| {
            let octave = (*scale, *amplitude);
            *scale *= lambda;
            *amplitude *= omega;
            Some(octave)
        })
    }
}

/// Sum of octaves of [`noise`], mostly in [0, 2], the turbulence of [`agate`].
pub fn turbulence(p: DVec3, t: &Turbulence, generator: u8) -> f64 {
    let mut sum = 0.0;
    for (i, (scale, amplitude)) in t.octaves().enumerate() {
        let n = noise(p * scale, generator);
        // Only the first octave is cut to [0, 1] (measured).
        let n = match (generator, i) {
            (1, _) => n,
            (_, 0) => stretched(p, generator),
            _ => 2.0 * n - 0.5,
        };
        sum += amplitude * n;
    }
    sum
}

/// Sum of octaves of [`vector_noise`]. A pattern with `turbulence T` is evaluated at p + T · vector_turbulence(p).
pub fn vector_turbulence(p: DVec3, t: &Turbulence, generator: u8) -> DVec3 {
    t.octaves().map(|(scale, amplitude)| amplitude * vector_noise(p * scale, generator)).sum()
}

/// The pattern `granite`, in [0, 1].
pub fn granite(p: DVec3, generator: u8) -> f64 {
    let (mut sum, mut scale) = (0.0, 1.0);
    for _ in 0..6 {
        sum += (stretched(p * (4.0 * scale), generator) - 0.5).abs() / scale;
        scale *= 2.0;
    }
    sum
}

/// The pattern `wrinkles` of pigments, in [0, 1].
pub fn wrinkles(p: DVec3, generator: u8) -> f64 {
    let (mut sum, mut scale) = (0.0, 1.0);
    for _ in 0..10 {
        sum += stretched(p * scale, generator) * 0.5 / scale;
        scale *= 2.0;
    }
    sum
}

/// The pattern `dents` of pigments, in [0, 1].
pub fn dents(p: DVec3, generator: u8) -> f64 {
    let n = noise(p, generator);
    n * n * n
}

/// The pattern `agate`, in [0, 1], with its strength `agate_turb` (1 by default) and the turbulence of the pattern.
pub fn agate(p: DVec3, agate_turb: f64, t: &Turbulence, generator: u8) -> f64 {
    let wave = fns::sin(TAU * (1.3 * f64::from(agate_turb as f32) * turbulence(p, t, generator) + 1.1 * p.z));
    fns::pow(unit(0.5 * wave + 0.5), 0.77)
}

/// The pattern `leopard`, in [0, 1] (documentation, 3.4.7.1.15).
pub fn leopard(p: DVec3) -> f64 {
    let mean = (fns::sin(p.x) + fns::sin(p.y) + fns::sin(p.z)) / 3.0;
    mean * mean
}

/// Noise as the sums above take it: generators 2 and 3 are stretched about 0.5, so that they use as much of [0, 1] as generator 1.
fn stretched(p: DVec3, generator: u8) -> f64 {
    let n = noise(p, generator);
    if generator == 1 { n } else { unit(2.0 * n - 0.5) }
}

/// Moves into [0, 1]; NaN becomes 0.
#[inline]
#[allow(clippy::manual_clamp)] // clamp keeps NaN
pub(crate) fn unit(x: f64) -> f64 {
    x.max(0.0).min(1.0)
}

/// Integer and fraction: x = i + d, 0 ≤ d < 1. Numbers that have none give d = 0.
#[inline]
fn split(x: f64) -> (i64, f64) {
    // Faster than `floor`, which is a library call on processors without an instruction for it; exact where |x| < 2⁶³.
    let i = x as i64;
    let i = if (i as f64) > x { i.wrapping_sub(1) } else { i };
    let d = x - i as f64;
    (i, if (0.0..1.0).contains(&d) { d } else { 0.0 })
}

/// [`split`] where both numbers are waited for: adding a large number leaves the integer in the last bits, which takes less time than to
/// convert to an integer and back, but more instructions.
#[inline]
fn split_by_sum(x: f64) -> (i64, f64) {
    const ROUND: f64 = 1.5 * (1u64 << 52) as f64;
    if !(x.abs() < (1u64 << 51) as f64) {
        return split(x);
    }
    let rounded = x + ROUND;
    let whole = rounded - ROUND;
    let is_above = whole > x;
    let i = rounded.to_bits() as i64 - ROUND.to_bits() as i64 - i64::from(is_above);
    let d = x - if is_above { whole - 1.0 } else { whole };
    (i, if d < 1.0 { d } else { 0.0 })
}

/// Weight of the corner above, with slope 0 at both: 3 d² − 2 d³ (Perlin 1985).
#[inline]
fn smooth(d: f64) -> f64 {
    d * d * (3.0 - 2.0 * d)
}

#[inline]
fn lerp(t: f64, a: f64, b: f64) -> f64 {
    a + t * (b - a)
}

/// Where a point lies in the lattice of generators 1 and 2.
struct Cell {
    /// Numbers of the eight corners in [`COEFFICIENTS`], 0 to 255; bit 0 of the index is x, bit 1 y, bit 2 z.
    hash: [u8; 8],
    /// The point from the corner below.
    d: DVec3,
    /// Weight of the corner above, per axis.
    s: DVec3,
}

impl Cell {
    #[inline]
    fn new(p: DVec3) -> Self {
        // The lattice repeats after 4096 and is numbered from −10,000 on.
        let wrap = |i: i64| (i.wrapping_add(10_000) & 4095) as usize;
        let ((x, dx), (y, dy), (z, dz)) = (split(p.x), split(p.y), split(p.z));
        let x = [wrap(x), wrap(x.wrapping_add(1))];
        let y = [wrap(y), wrap(y.wrapping_add(1))];
        let z = [wrap(z), wrap(z.wrapping_add(1))];
        let entry = |i: usize| usize::from(HASH[i % HASH_SIZE]);
        let hx = x.map(entry);
        let hy = [entry(hx[0] ^ y[0]), entry(hx[1] ^ y[0]), entry(hx[0] ^ y[1]), entry(hx[1] ^ y[1])];
        let mut hash = [0; 8];
        for (corner, h) in hash.iter_mut().enumerate() {
            *h = entry(hy[corner & 3] ^ z[corner >> 2]) as u8;
        }
        Self { hash, d: DVec3::new(dx, dy, dz), s: DVec3::new(smooth(dx), smooth(dy), smooth(dz)) }
    }

    /// Number of a corner in [`COEFFICIENTS`], its weight and the point seen from it.
    #[inline]
    fn corner(&self, corner: usize) -> (usize, f64, DVec3) {
        let [x, y, z] = [corner & 1, corner >> 1 & 1, corner >> 2];
        let offset = DVec3::new(x as f64, y as f64, z as f64);
        let weight = |s: f64, above: usize| if above > 0 { s } else { 1.0 - s };
        let w = weight(self.s.x, x) * weight(self.s.y, y) * weight(self.s.z, z);
        (usize::from(self.hash[corner]), w, self.d - offset)
    }
}

/// Noise with a value and a gradient at each lattice point, about in [−1, 1].
#[inline]
fn value_gradient_noise(p: DVec3) -> f64 {
    let cell = Cell::new(p);
    let d = cell.d;
    let value = |corner: usize, x: f64, y: f64, z: f64| {
        let h = usize::from(cell.hash[corner]);
        COEFFICIENTS[h] * 0.5 + COEFFICIENTS[h + 1] * x + COEFFICIENTS[h + 2] * y + COEFFICIENTS[h + 3] * z
    };
    let edge = |corner: usize, y: f64, z: f64| lerp(cell.s.x, value(corner, d.x, y, z), value(corner + 1, d.x - 1.0, y, z));
    let face = |corner: usize, z: f64| lerp(cell.s.y, edge(corner, d.y, z), edge(corner + 2, d.y - 1.0, z));
    lerp(cell.s.z, face(0, d.z), face(4, d.z - 1.0))
}

/// Gradient noise (Perlin 1985), scaled to lie in [0, 1] but for rare points.
#[inline]
fn perlin(p: DVec3) -> f64 {
    let tables = &**PERLIN;
    // The lattice is moved by this much; the fraction is what is left of 0.02315721 at the precision of the sum.
    let p = p + DVec3::splat(10_000_000.023_157_213);
    let ((x, dx), (y, dy), (z, dz)) = (split_by_sum(p.x), split_by_sum(p.y), split_by_sum(p.z));
    let entry = |i: usize| usize::from(tables.hash[i % PERLIN_SIZE]);
    let index = |i: i64| (i & 2047) as usize;
    let hx = [entry(index(x)), entry(index(x.wrapping_add(1)))];
    let (y, z) = (index(y), index(z));
    let dot = |hxy: usize, z: usize, dx: f64, dy: f64, dz: f64| {
        let g = &tables.gradient[(hxy + z) % PERLIN_SIZE];
        g[0] * dx + g[1] * dy + g[2] * dz
    };
    let (sx, sy, sz) = (smooth(dx), smooth(dy), smooth(dz));
    let column = |i: usize, j: usize, dx: f64, dy: f64| {
        let h = entry(hx[i] + y + j);
        lerp(sz, dot(h, z, dx, dy, dz), dot(h, z + 1, dx, dy, dz - 1.0))
    };
    let face = |j: usize, dy: f64| lerp(sx, column(0, j, dx, dy), column(1, j, dx - 1.0, dy));
    0.4925 + 0.795 * lerp(sy, face(0, dy), face(1, dy - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    // Values of POV-Ray 3.7.0.10, written with `#write`.
    /// Point; noise of generators 1, 2, 3.
    #[rustfmt::skip]
const NOISE: [(DVec3, [f64; 3]); 18] = [
    (DVec3::new(2.658, 0.068, 2.857), [0.1067549974984, 0.3229007089231, 0.5266085207218]),
    (DVec3::new(-2.515, 0.644, -0.741), [0.5115765950122, 0.5212049245269, 0.4971603200011]),
    (DVec3::new(1.811, -1.953, 2.23), [0.6085692709841, 0.5687173513491, 0.3629164335769]),
    (DVec3::new(0.264, 2.413, -0.137), [0.6633153995129, 0.5955350610314, 0.3761592508279]),
    (DVec3::new(-0.417, 1.734, 2.905), [0.1760245001121, 0.3568327779269, 0.3572399342623]),
    (DVec3::new(-0.782, 2.814, 2.574), [0.3745834071536, 0.454098014154, 0.3805654415584]),
    (DVec3::new(-1.934, 0.653, 1.229), [0.5148429995811, 0.5228049918155, 0.6261018593483]),
    (DVec3::new(2.657, 0.994, -2.2), [0.6656327251045, 0.5966702164593, 0.600575082607]),
    (DVec3::new(-42.65, -127.6, 4.52), [0.8174018237103, 0.6710151927075, 0.5498282453131]),
    (DVec3::new(9171.65, -3001.25, -5524.58), [0.5246042266744, 0.5275865857174, 0.5536832835236]),
    (DVec3::new(441.74, 2823.42, 8782.14), [0.6115079922853, 0.5701569010819, 0.5485090399326]),
    (DVec3::new(1640.32, -4643.33, 8595.49), [0.3751403161989, 0.4543708192911, 0.5027797316414]),
    (DVec3::new(-16549.4, 351601.7, -47922.2), [0.7435255628401, 0.6348264763604, 0.604090218475]),
    (DVec3::new(-566039.9, 385104.1, 541261.0), [0.3835195654006, 0.4584754432798, 0.4763796964536]),
    (DVec3::new(0.0, 0.0, 0.0), [0.0565805, 0.2983224393079, 0.511354305373]),
    (DVec3::new(-1.0, -2.0, -3.0), [0.773007, 0.6492681299351, 0.5033775305058]),
    (DVec3::new(-0.5, 1e-12, -1e-12), [0.2291524999996, 0.3828578378767, 0.4885838731159]),
    (DVec3::new(-10000.5, -10000.0, -9999.25), [0.0, 0.2601412646133, 0.3396854813332]),
];
    /// Point; vector noise; vector turbulence of 4 octaves, lambda 1.7, omega 0.6.
#[rustfmt::skip]
const VECTOR: [(DVec3, [f64; 3], [f64; 3]); 12] = [
    (DVec3::new(2.658, 0.068, 2.857), [-0.3932450025016, 0.1790022198158, 0.1897913901982], [-0.2941197127644, 0.2102506682279, 0.3861588959057]),
    (DVec3::new(-2.515, 0.644, -0.741), [0.01157659501221, 0.06743639534749, -0.4457300888601], [-0.3217443285137, -0.1607229486791, -0.1473950862582]),
    (DVec3::new(1.811, -1.953, 2.23), [0.1085692709841, 0.1343641740885, -0.2142379602235], [0.3217698123451, 0.1406963194969, -0.1106583320599]),
    (DVec3::new(0.264, 2.413, -0.137), [0.1633153995129, -0.2019926248835, 0.1299687206378], [0.2775857021018, -0.2921145649489, -0.0521338830594]),
    (DVec3::new(-0.417, 1.734, 2.905), [-0.3239754998879, -0.09037916872724, 0.2879873266573], [-0.5730600126611, 0.1493732779363, 0.1383045366804]),
    (DVec3::new(-0.782, 2.814, 2.574), [-0.1254165928464, -0.1248260593536, 0.2275993407849], [-0.25455865797, -0.1101844636606, 0.07341767550845]),
    (DVec3::new(-1.934, 0.653, 1.229), [0.01484299958112, 0.01990302759829, -0.1683038824727], [0.1082424044404, -0.2838221175992, -0.2759891400052]),
    (DVec3::new(2.657, 0.994, -2.2), [0.1656327251045, 0.5596133603125, 0.3202345653818], [-0.2179527961185, 0.5211447058545, 0.1806567481422]),
    (DVec3::new(-42.65, -127.6, 4.52), [0.3174018237103, 0.1411934553765, -0.4125558900457], [0.7278701092431, 0.1040712306432, -0.4680331963064]),
    (DVec3::new(9171.65, -3001.25, -5524.58), [0.02460422667439, -0.144522284087, -0.08253451901913], [0.230435099434, 0.03391476607308, -0.2125760724518]),
    (DVec3::new(441.74, 2823.42, 8782.14), [0.1115079922853, 0.1011643122204, -0.5152796874864], [-0.009893209636763, 0.2668482862108, -0.3564969956112]),
    (DVec3::new(1640.32, -4643.33, 8595.49), [-0.1248596838011, -0.02850363542899, 0.1831751827642], [0.07377103739897, 0.1084917881061, 0.1593239766668]),
];
    /// Point; granite, wrinkles, agate of generators 1, 2, 3.
#[rustfmt::skip]
    #[allow(clippy::type_complexity)] // A table.
const SUMS: [(DVec3, [f64; 3], [f64; 3], [f64; 3]); 6] = [
    (DVec3::new(2.658, 0.068, 2.857), [0.3711953890023, 0.3821111420451, 0.2839241021663], [0.4299255427672, 0.4623751163604, 0.542545109756], [0.9993483589341, 0.9589402798006, 0.4910690978616]),
    (DVec3::new(-2.515, 0.644, -0.741), [0.5840339712027, 0.5459711499753, 0.4187929906791], [0.5321481398948, 0.5625237846373, 0.4788250037228], [0.4449535689111, 0.2237817197309, 0.8273128288209]),
    (DVec3::new(1.811, -1.953, 2.23), [0.1589332166674, 0.2011613657581, 0.599226241271], [0.6405950518639, 0.6686899938339, 0.3863986107337], [0.8394654613441, 0.9556898341011, 0.7289920855535]),
    (DVec3::new(0.264, 2.413, -0.137), [0.2682291542443, 0.3123020474945, 0.1646572871587], [0.6017484037464, 0.6307119732798, 0.3183087062578], [0.8387641309461, 0.6605622485515, 0.139205027945]),
    (DVec3::new(-0.417, 1.734, 2.905), [0.4390127229802, 0.4446690580159, 0.3513665245786], [0.3978579375759, 0.4309581102875, 0.3713911015089], [0.9860676572363, 0.9866122722055, 0.9204923773459]),
    (DVec3::new(-0.782, 2.814, 2.574), [0.3698446375305, 0.3477779131761, 0.4921508031666], [0.461066041475, 0.4928838254198, 0.5005338339801], [0.6271638957021, 0.8288395520297, 0.8562811732516]),
];

    fn close(found: f64, expected: f64, p: DVec3) {
        assert!((found - expected).abs() < 1e-12, "{found} instead of {expected} at {p}");
    }

    #[test]
    fn noise_is_as_measured() {
        for (p, expected) in NOISE {
            for (generator, expected) in (1..).zip(expected) {
                close(noise(p, generator), expected, p);
            }
        }
    }

    #[test]
    fn vector_noise_is_as_measured() {
        let t = Turbulence { octaves: 4, lambda: 1.7, omega: 0.6 };
        for (p, one, four) in VECTOR {
            for axis in 0..3 {
                close(vector_noise(p, 2)[axis], one[axis], p);
                close(vector_turbulence(p, &t, 2)[axis], four[axis], p);
            }
        }
    }

    #[test]
    fn sums_of_noise_are_as_measured() {
        for (p, granites, wrinkled, agates) in SUMS {
            for generator in 1..=3 {
                let i = usize::from(generator) - 1;
                close(granite(p, generator), granites[i], p);
                close(wrinkles(p, generator), wrinkled[i], p);
                close(agate(p, 1.0, &Turbulence::default(), generator), agates[i], p);
            }
        }
    }

    #[test]
    fn first_component_of_vector_noise_is_noise() {
        let p = DVec3::new(0.3, -7.2, 1.9);
        close(vector_noise(p, 1).x + 0.5, noise(p, 1), p);
    }

    #[test]
    fn noise_repeats_with_its_lattice() {
        let p = DVec3::new(0.25, 5.5, -3.125);
        for axis in DVec3::AXES {
            assert_eq!(noise(p, 2), noise(p + 4096.0 * axis, 2));
            assert!((noise(p, 3) - noise(p + 2048.0 * axis, 3)).abs() < 1e-12);
        }
    }

    #[test]
    fn integers_and_fractions() {
        for x in [0.0, -0.0, 0.3, -0.3, 1.0, -1.0, 2.5, -2.5, 1e15 + 0.5, -1e15 - 0.5, 2.2e15, 2.3e15, -2.3e15, 1e300, -1e-20, 4.5e15] {
            assert_eq!(split(x), split_by_sum(x), "{x}");
            let (i, d) = split(x);
            assert_eq!(i, x.floor() as i64, "{x}");
            assert!(d == x - x.floor() || d == 0.0 && x - x.floor() == 1.0, "{x}: {d}");
        }
    }

    #[test]
    fn hostile_points_do_no_harm() {
        let t = Turbulence { octaves: u32::MAX, lambda: 1e300, omega: f64::NAN };
        for x in [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            1e300,
            -1e300,
            9.3e18,
            -9.3e18,
            4.6e15,
            f64::MIN_POSITIVE,
            -0.0,
            1.0 - f64::EPSILON / 2.0,
        ] {
            for p in [DVec3::splat(x), DVec3::new(0.5, x, 0.25)] {
                for generator in [0, 1, 2, 3, 255] {
                    assert!((0.0..=1.0).contains(&noise(p, generator)));
                    assert!((0.0..=2.0).contains(&granite(p, generator)));
                    let _ = (wrinkles(p, generator), dents(p, generator), agate(p, x, &t, generator), turbulence(p, &t, generator));
                }
                let _ = (vector_noise(p, 2), vector_turbulence(p, &t, 2), leopard(p));
            }
        }
    }
}
