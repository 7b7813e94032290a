//! Internal functions that are polynomials: algebraic surfaces, and plane curves that are extruded or revolved.

use crate::fns;

/// Values of surfaces do not leave ±10.
const LIMIT: f64 = 10.0;

fn sq(x: f64) -> f64 {
    x * x
}

fn limited(value: f64, limit: f64) -> f64 {
    // A NaN stays one.
    if value > limit {
        limit
    } else if value < -limit {
        -limit
    } else {
        value
    }
}

/// The function by number; 0 for numbers that are none of these. `p` are the parameters beyond x, y, z, the first the field strength.
pub(super) fn eval(number: u8, at: [f64; 3], p: &[f64]) -> f64 {
    if let Some(value) = curve(number, at, p) {
        return value;
    }
    limited(p[0] * surface(number, at, [p[1], p[2], p[3], p[4], p[5]]), LIMIT)
}

/// Plane curves: the point brought into the plane, and the number of parameters before those of the surface of revolution.
fn curve(number: u8, [x, y, z]: [f64; 3], p: &[f64]) -> Option<f64> {
    let first = match number {
        0..=3 => 2,
        15 | 21 | 34 | 39 | 75 => 3,
        50 | 67 => 4,
        _ => return None,
    };
    let (switch, offset, angle) = (p[first], p[first + 1], p[first + 2]);
    let (x, y) = if switch > 0.0 {
        let r = (x * x + z * z).sqrt() - offset;
        let (s, c) = fns::sin_cos(angle.to_radians());
        (r * c - y * s, r * s + y * c)
    } else {
        (x, y)
    };
    let (a, b, c) = (p[1], p[2], p[3]);
    let (xx, yy) = (x * x, y * y);
    let value = match number {
        0 => yy + x.abs() * xx - xx,
        1 => 3.0 * xx * y - 2.0 * xx * xx - sq(yy - y),
        2 => x * yy + 2.0 * xx * y - yy - xx * yy - xx * xx,
        3 => yy * y - yy * yy - 3.0 * xx * y - 2.0 * xx * yy - xx * xx,
        15 => yy * yy - b * b * yy + a * a * xx - xx * xx,
        21 => (4.0 * a - b) * x * yy - yy - (1.0 + b) * xx,
        34 => b * b * xx * xx - a * b * b * b * xx - yy,
        39 => b * b * xx * (a * a - xx) - yy,
        50 => c * c * xx * x * (a + b * x) - yy,
        67 => c * c * xx * (x + a) + (x - b) * yy,
        _ => b - (xx + a * a) * y,
    };
    Some(limited(p[0] * value, if number < 4 { p[1].abs() } else { LIMIT }))
}

/// Surfaces, before field strength and limit.
fn surface(number: u8, [x, y, z]: [f64; 3], [a, b, c, d, e]: [f64; 5]) -> f64 {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let rr = xx + yy + zz;
    match number {
        4 => yy * (a * a - xx - zz) - sq(xx + zz + 2.0 * a * y - a * a),
        5 => a * y * (xx + zz) - rr * rr,
        8 => boy(x, y, z, a),
        11 => xx * zz - y,
        12 => z + yy * y - xx * x,
        13 | 43 => xx + yy - 2.0 * zz + 2.0 * zz * z + 2.0 * yy * z + xx * zz - yy * zz - sq(xx + yy) - zz * zz,
        14 => yy * yy - 0.25 * yy + 0.36 * xx - sq(xx + zz),
        16 => dupin_cyclide(x, y, z, [a, b, c, d, e]),
        18 => {
            // Enneper's equation divided by z, which is kept away from 0.
            let w = if z.abs() > 0.2 { z } else { 0.2 };
            let saddle = (yy - xx) / (2.0 * w);
            let s = saddle + 2.0 * zz / 9.0;
            6.0 * sq(0.5 * saddle) - s * s * s
        }
        20 => yy + zz + (1.0 + b) * xx - (4.0 * a - b) * x * (yy + zz),
        22 => 0.5 * xx * xx * (x + 1.0) - yy - zz,
        23 => {
            let s = 2.0 * xx + yy + zz - 1.0;
            0.1 * xx * zz * z + yy * zz * z - s * s * s
        }
        30 => {
            let s = rr - 13.0;
            -4.0 * s * s * s - 27.0 * sq(3.0 * xx + yy - 4.0 * zz - 12.0)
        }
        31 => 4.0 * a * a * (xx - zz) - sq(xx + yy - zz + a * a - b * b),
        33 => b * b * xx * (xx - a * a) - yy - zz,
        35 => {
            let s = rr - 2.0 * y - 1.0;
            -(rr + 2.0 * y - 1.0) * (s * s - 8.0 * zz) - 16.0 * x * z * s
        }
        36 => rr + xx * yy + yy * zz + zz * xx - xx * xx - yy * yy - zz * zz - 1.0,
        37 => 1.0 - xx * xx - yy * yy - zz * zz - a * rr - b * (xx * yy + yy * zz + zz * xx) - c * x * y * z,
        38 => xx - xx * xx - yy - zz,
        41 => yy * (1.0 - yy - zz) - 4.0 * xx * rr,
        42 => 6.0 * y * z - yy * y - zz * z,
        44 => c * a * a * (xx + zz) + b * b - sq(rr + a * a),
        45 => y - xx - zz,
        46 => (a * a + b * b) * (xx - z) - sq(xx + yy - z) - (a * a - b * b) * (yy + a * a - b * b),
        48 => xx * xx + yy * yy + zz * zz - rr,
        49 => xx * x * (x - 1.0) + yy + zz,
        54 => y - xx * xx - zz * zz,
        55 => y + zz * zz - xx * xx,
        56 => a * a * b * b - (b * b + yy) * (xx + zz),
        65 => -(xx * yy + yy * zz + zz * xx + x * y * z),
        66 => c * c * xx * (x + a) + (x - b) * (yy + zz),
        71 => 4.0 * a * a * (xx + zz) - sq(rr + a * a - b * b),
        72 => 20.0 * rr - 17.0 - 4.0 * (xx * xx + sq(yy + zz)) - 17.0 * xx * (yy + zz),
        73 => y * zz - xx,
        74 => a - y * (a + xx + zz),
        _ => 0.0,
    }
}

/// Boy's surface as Apéry's polynomial of degree six (Apéry, *Models of the Real Projective Plane*, 1987, as MathWorld gives it),
/// times `scale`.
fn boy(x: f64, y: f64, z: f64, scale: f64) -> f64 {
    let q = std::f64::consts::SQRT_2;
    let (xx, yy, zz, w) = (x * x, y * y, z * z, 1.0 - z);
    let r = xx + yy;
    scale
        * (64.0 * w * w * w * zz * z - 48.0 * w * w * zz * (3.0 * r + 2.0 * zz)
            + 12.0 * w * z * (27.0 * r * r - 24.0 * zz * r + 36.0 * q * y * z * (yy - 3.0 * xx) + 4.0 * zz * zz)
            + (9.0 * r - 2.0 * zz) * (108.0 * q * x * z * (xx - 3.0 * yy) + 4.0 * zz * zz - 81.0 * r * r - 72.0 * zz * r))
}

/// A torus (radii `major`, `minor`), moved by (u, v) along x and y and inverted in a sphere, denominators cleared. One sign of `v`
/// differs from the exact inversion, as in POV-Ray.
fn dupin_cyclide(x: f64, y: f64, z: f64, [major, minor, u, v, radius]: [f64; 5]) -> f64 {
    let (p, k) = (x * x + y * y + z * z, radius * radius);
    let c = (major * major - minor * minor) * p;
    let square = k * k + (u * u + v * v) * p;
    let d = square - 2.0 * k * (u * x + v * y);
    let cross = square - 2.0 * k * (u * x - v * y);
    4.0 * major * major * (sq(k * x - u * p) + sq(k * z)) - (d * d + 2.0 * c * cross + c * c)
}
