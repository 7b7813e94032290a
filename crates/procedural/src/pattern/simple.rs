//! Patterns with closed formulas (documentation, "General Patterns"). Constants that the documentation does not say are fitted to
//! POV-Ray's values.

use glam::DVec3;

use super::wave::triangle;
use crate::fns;

/// `floor` that takes numbers just below a whole one for it, so that faces in the planes of the lattice show no noise. Measured.
pub(super) fn floor(v: f64) -> f64 {
    (v + 1e-10).floor()
}

/// `gradient`: along positive values it has period 1; the raw value of negative ones runs on.
pub(super) fn gradient(p: DVec3, direction: DVec3) -> f64 {
    let length = direction.length();
    if length == 0.0 {
        return 0.0;
    }
    fraction(p.dot(direction) / length)
}

/// Values of `gradient` and `function` above 1 lose their whole part; 1 and all below stay (measured).
pub(super) fn fraction(v: f64) -> f64 {
    if v > 1.0 { v % 1.0 } else { v }
}

/// Angle around the y axis in turns: 0 at +x, 1/4 at −z.
pub(super) fn radial(p: DVec3) -> f64 {
    if p.x == 0.0 && p.z == 0.0 {
        return 0.25;
    }
    0.25 + (fns::atan2(p.x, p.z) + std::f64::consts::PI) / std::f64::consts::TAU
}

/// `leopard`.
pub(super) fn leopard(p: DVec3) -> f64 {
    let v = (fns::sin(p.x) + fns::sin(p.y) + fns::sin(p.z)) / 3.0;
    v * v
}

/// `quilted` as a vector, as normals take it: from the cube's center, its length a cubic Bézier curve of the distance.
pub(crate) fn quilted_vector(p: DVec3, control0: f64, control1: f64) -> DVec3 {
    let v = p - p.floor() - DVec3::splat(0.5);
    let t = v.length();
    let s = 1.0 - t;
    // Over √(3/4), the largest distance.
    v * (t * (3.0 * s * (control0 * s + control1 * t) + t * t) / 0.866_025_403_784_438_6)
}

/// `quilted`: mean of the sizes of the vector's components.
pub(super) fn quilted(p: DVec3, control0: f64, control1: f64) -> f64 {
    quilted_vector(p, control0, control1).abs().element_sum() / 3.0
}

/// Angle around the z axis in turns, [0, 1), from −y.
fn spiral_turn(p: DVec3) -> f64 {
    if p.x == 0.0 && p.y == 0.0 {
        return 0.0;
    }
    let turn = fns::atan2(p.y, p.x) / std::f64::consts::TAU + 0.25;
    if turn < 0.0 { turn + 1.0 } else { turn }
}

/// `spiral1`, with the turbulence's share.
pub(super) fn spiral1(p: DVec3, arms: f64, turbulence: f64) -> f64 {
    p.z + (p.x * p.x + p.y * p.y).sqrt() + arms * spiral_turn(p) + turbulence
}

/// `spiral2`, with the turbulence's share: not two windings, as the documentation has it, but a winding and rings.
pub(super) fn spiral2(p: DVec3, arms: f64, turbulence: f64) -> f64 {
    let radius = (p.x * p.x + p.y * p.y).sqrt();
    triangle(spiral1(p, arms, turbulence)) + triangle(radius)
}

/// `wood` with its turbulence: x and y swing by a sine of the turbulent place.
pub(super) fn wood(p: DVec3, turbulent: Option<(DVec3, DVec3)>) -> f64 {
    let (mut x, mut y) = (p.x, p.y);
    if let Some((amount, step)) = turbulent {
        x += fns::sin(std::f64::consts::TAU * (p.x + step.x) * amount.x);
        y += fns::sin(std::f64::consts::TAU * (p.y + step.y) * amount.y);
    }
    (x * x + y * y).sqrt()
}
