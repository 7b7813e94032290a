//! Block patterns: which of several kinds of blocks a point is in (documentation, "Discontinuous Patterns", "Brick Pattern", "Cubic
//! Pattern"). What the documentation leaves open (phases, order of corners) is measured.

use glam::DVec3;

use super::PatternKind;
use crate::Context;
use crate::pattern::simple::floor;

impl PatternKind {
    /// Index of the block at a point in the pattern's space; 0 for patterns without blocks.
    pub fn block(&self, inner: &Context) -> usize {
        let p = inner.p;
        match self {
            Self::Brick { size, mortar } => brick(p, *size, *mortar),
            Self::Checker => usize::from(odd(floor(p.x) + floor(p.y) + floor(p.z))),
            Self::Cubic => cubic(p),
            Self::Hexagon => hexagon(p.x, p.z),
            Self::Object(object) => usize::from(inner.inside.is_some_and(|i| i.inside(*object, p))),
            Self::Square => match (odd(p.x.floor()), odd(p.z.floor())) {
                (false, false) => 0,
                (false, true) => 1,
                (true, true) => 2,
                (true, false) => 3,
            },
            Self::Triangular => triangular(p.x, p.z),
            _ => 0,
        }
    }
}

fn odd(n: f64) -> bool {
    n % 2.0 != 0.0
}

/// 0 in the mortar, which lies at the upper end of each brick; every other course is shifted by half a brick, in x the odd ones, in z
/// the even ones.
fn brick(p: DVec3, size: DVec3, mortar: f64) -> usize {
    let in_mortar = |v: f64, size: f64| v - (v / size).floor() * size >= size - mortar;
    if in_mortar(p.y, size.y) {
        return 0;
    }
    let odd_course = odd((p.y / size.y).floor());
    let (shift_x, shift_z) = if odd_course { (size.x * 0.5, 0.0) } else { (0.0, size.z * 0.5) };
    usize::from(!(in_mortar(p.z + shift_z, size.z) || in_mortar(p.x + shift_x, size.x)))
}

/// +x, +y, +z, −x, −y, −z.
fn cubic(p: DVec3) -> usize {
    let a = p.abs();
    let (axis, positive) = if a.x >= a.y && a.x >= a.z {
        (0, p.x >= 0.0)
    } else if a.y >= a.z {
        (1, p.y >= 0.0)
    } else {
        (2, p.z >= 0.0)
    };
    axis + if positive { 0 } else { 3 }
}

/// Remainder of a (possibly huge) whole number by 3.
fn modulo3(n: f64) -> usize {
    n.rem_euclid(3.0) as usize % 3
}

/// Hexagons of side 1, the first around the origin, corners on the x axis; the second kind follows along +z.
fn hexagon(x: f64, z: f64) -> usize {
    // Axial coordinates: steps of (3/2, √3/2) and (0, √3); then cube rounding to the nearest center.
    let sqrt3 = 3.0_f64.sqrt();
    let q = x / 1.5;
    let r = z / sqrt3 - q * 0.5;
    let s = -q - r;
    let (mut qi, mut ri, si) = (q.round(), r.round(), s.round());
    let (dq, dr, ds) = ((qi - q).abs(), (ri - r).abs(), (si - s).abs());
    if dq > dr && dq > ds {
        qi = -ri - si;
    } else if dr > ds {
        ri = -qi - si;
    }
    modulo3(ri - qi)
}

/// Triangles of side 1 in rows along x; six of them around a corner show all six kinds.
fn triangular(x: f64, z: f64) -> usize {
    let b = z / (3.0_f64.sqrt() * 0.5);
    let a = x - b * 0.5;
    let (i, j) = (a.floor(), b.floor());
    if (a - i) + (b - j) < 1.0 { 2 * modulo3(j - i) } else { (3 + 2 * modulo3(i - j)) % 6 }
}
