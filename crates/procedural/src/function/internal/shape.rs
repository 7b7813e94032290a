//! Internal functions that are distances, sums of exponentials and the like.

use std::f64::consts::PI;

use crate::fns;

/// Length of a vector.
pub(super) fn length(x: f64, y: f64, z: f64) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// exp(−k q).
pub(super) fn fade(k: f64, q: f64) -> f64 {
    fns::exp(-k * q)
}

/// Squared radii of three ellipsoids, one along each axis.
pub(super) fn ellipsoids([x, y, z]: [f64; 3], eccentricity: f64) -> [f64; 3] {
    let (a, b, c) = (x * x, y * y, z * z);
    [a + eccentricity * (b + c), b + eccentricity * (c + a), c + eccentricity * (a + b)]
}

/// a + b y + c y² + d y³ + e y⁴.
pub(super) fn quartic([a, b, c, d, e]: [f64; 5], y: f64) -> f64 {
    a + y * (b + y * (c + y * (d + y * e)))
}

/// The size of (a, b) by which a cross section is square (0), round (1), diamond (2) or concave (3).
fn cross_section(a: f64, b: f64, kind: f64) -> f64 {
    let (a, b) = (a.abs(), b.abs());
    if kind == 0.0 {
        a.max(b)
    } else if kind == 1.0 {
        length(a, b, 0.0)
    } else {
        let p = 2.0 / kind;
        fns::pow(fns::pow(a, p) + fns::pow(b, p), 0.5 * kind)
    }
}

/// `x` less the multiple of `period` that brings it into [0, period).
fn wrapped(x: f64, period: f64) -> f64 {
    x - period * (x / period).floor()
}

/// Two soft spheres at x = ± half the distance: `f_blob`.
pub(super) fn blob([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    let component = |x: f64, strength: f64, inverse_radius: f64| {
        let d = (x * x + y * y + z * z) * inverse_radius * inverse_radius;
        if d < 1.0 { strength * (1.0 - d) * (1.0 - d) } else { 0.0 }
    };
    -component(x + 0.5 * p[0], p[1], p[2]) - component(x - 0.5 * p[0], p[3], p[4])
}

/// Two Gaussians: `f_blob2`.
pub(super) fn blob2([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    let squared = |x: f64| x * x + y * y + z * z;
    p[3] - p[2] * (fade(p[1], squared(x)) + fade(p[1], squared(x - p[0])))
}

/// `f_helix1`: number, period, minor and major radius, stretch along y, cross section, its rotation in degrees.
pub(super) fn helix1([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    let r = length(x, 0.0, z);
    let period = 2.0 * PI / p[0];
    let turn = wrapped(fns::atan2(z, x) + p[1] * y, period) - 0.5 * period;
    let (a, b) = (r - p[3], turn / (p[1] * p[4]));
    let (s, c) = fns::sin_cos(p[6].to_radians());
    cross_section(a * c - b * s, a * s + b * c, p[5]).min(r + p[3]) - p[2]
}

/// `f_helix2`: nothing, period, minor and major radius, nothing, cross section, nothing.
pub(super) fn helix2([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    let (s, c) = fns::sin_cos(p[1] * y);
    let (a, b) = (x - p[3] * c, z - p[3] * s);
    cross_section(a * c + b * s, b * c - a * s, p[5]) - p[2]
}

/// Offset from the nearest center of a hexagonal lattice (apothem √3/2), by the hexagon's own metric, which is the third number.
fn hexagon(x: f64, y: f64) -> (f64, f64, f64) {
    let h = 0.5 * 3.0_f64.sqrt();
    let nearest = |ox: f64, oy: f64| {
        let (a, b) = (x - ox, y - oy);
        let (a, b) = (a - 2.0 * h * (a / (2.0 * h) + 0.5).floor(), b - 3.0 * (b / 3.0 + 0.5).floor());
        (a, b, a.abs().max((0.5 * a + h * b).abs()).max((0.5 * a - h * b).abs()))
    };
    let (first, second) = (nearest(0.0, 0.0), nearest(h, 1.5));
    if second.2 < first.2 { second } else { first }
}

/// `f_hex_x`.
pub(super) fn hex_x(x: f64, y: f64) -> f64 {
    hexagon(x, y).2
}

/// `f_hex_y`.
pub(super) fn hex_y(x: f64, y: f64) -> f64 {
    let (a, b, _) = hexagon(x, y);
    let h = 0.5 * 3.0_f64.sqrt();
    b.abs().min((h * a - 0.5 * b).abs()).min((h * a + 0.5 * b).abs())
}

/// Woven threads, `f_mesh1`: distances along x and z, thickness, amplitude, thickness along y.
pub(super) fn mesh1([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    let (dx, dz, thickness, amplitude, upright) = (p[0], p[1], p[2], p[3], p[4]);
    // The nearest threads on both sides; neighbors wave against one another.
    let threads = |along: f64, across: f64, step: f64, wave: f64, sign: f64| {
        let first = (across / step).floor();
        let one = |k: f64| {
            let side = if k - 2.0 * (0.5 * k).floor() == 0.0 { sign } else { -sign };
            let height = side * amplitude * fns::cos(PI * along / wave);
            length(thickness * (across - k * step), upright * (y - height), 0.0)
        };
        one(first).min(one(first + 1.0))
    };
    threads(z, x, dx, dz, -1.0).min(threads(x, z, dz, dx, 1.0))
}

/// Tubes around the y axis, `f_polytubes`: their number, and the polynomial of y that is their distance from the axis.
pub(super) fn polytubes([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    let radius = quartic([p[1], p[2], p[3], p[4], p[5]], y);
    let angle = fns::atan2(x, z) + if radius < 0.0 { PI } else { 0.0 };
    let period = 2.0 * PI / p[0];
    let (s, c) = fns::sin_cos(wrapped(angle + 0.5 * period, period) - 0.5 * period);
    let r = length(x, 0.0, z);
    length(r * c - radius.abs(), r * s, 0.0)
}

/// `f_quantum`: the exponent is short of 4/3, as measured.
pub(super) fn quantum([x, y, z]: [f64; 3]) -> f64 {
    let lobe = 2.0 * y * y - x * x - z * z;
    1.2 - 1.6 * lobe * lobe * fade(1.333_333_32, length(x, y, z))
}

/// `f_rounded_box`: radius, half sizes.
pub(super) fn rounded_box([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    let beyond = |x: f64, half: f64| (x.abs() - (half - p[0])).max(0.0);
    // The small number is POV-Ray's.
    length(beyond(x, p[1]), beyond(y, p[2]), beyond(z, p[3])) - (p[0] + 1e-6)
}

/// `f_spikes`: spikiness, hollowness, size, roundness, fatness.
pub(super) fn spikes(at: [f64; 3], p: &[f64]) -> f64 {
    let [x, y, z] = at;
    let spikes: f64 = ellipsoids(at, p[0]).into_iter().map(|q| fade(p[1], q)).sum();
    p[2] * (spikes - p[4] * fade(p[3], x * x + y * y + z * z))
}

/// `f_spikes_2d`: height, frequencies along x and z, decay.
pub(super) fn spikes_2d([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    y - p[0] * fns::cos(p[1] * x) * fns::cos(p[2] * z) * fade(p[3], x * x + z * z)
}

/// `f_spiral`: distance between windings, thickness, outer radius, nothing, nothing, cross section.
pub(super) fn spiral([x, y, z]: [f64; 3], p: &[f64]) -> f64 {
    let winding = (PI - fns::atan2(z, x)) / (2.0 * PI) * p[0];
    let off = wrapped(length(x, 0.0, z) - winding + 0.5 * p[0], p[0]) - 0.5 * p[0];
    let r = length(x, y, z);
    (cross_section(off, y, p[5]).min(r) - p[1]).max(r - p[2])
}

/// `f_superellipsoid`: east-west and north-south exponent.
pub(super) fn superellipsoid([x, y, z]: [f64; 3], e: f64, n: f64) -> f64 {
    let around = fns::pow(fns::pow(x.abs(), 2.0 / e) + fns::pow(y.abs(), 2.0 / e), e / n);
    1.0 - fns::pow(around + fns::pow(z.abs(), 2.0 / n), 0.5 * n)
}
