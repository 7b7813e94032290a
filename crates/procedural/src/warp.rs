//! Warps: how space is bent around patterns (documentation, "Warp"; what it leaves open is measured).

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::fns;
use crate::pattern::Turbulent;

/// A warp.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Warp {
    /// A slab of the pattern again and again.
    Repeat {
        /// Axis along which it repeats: 0, 1, 2.
        axis: u8,
        /// Width of the slab; negative ones run the other way. Not 0.
        width: f64,
        /// Moves each copy.
        offset: DVec3,
        /// Which axes every other copy is mirrored along.
        flip: [bool; 3],
    },
    /// Sucks the pattern to a center or pushes it away.
    BlackHole(Box<BlackHole>),
    /// Random steps.
    Turbulence(Turbulent),
    /// Longitude around an axis and height along it.
    Cylindrical(Wrap),
    /// Longitude and latitude.
    Spherical(Wrap),
    /// The two angles of a torus.
    Toroidal {
        /// How it is turned, and its depth.
        wrap: Wrap,
        /// Major radius.
        major_radius: f64,
    },
    /// All of space takes the color of a plane.
    Planar {
        /// Normal of the plane.
        normal: DVec3,
        /// Its distance from the origin.
        distance: f64,
    },
    /// The faces of a cube laid out in the unit square.
    Cubic,
}

/// `black_hole`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlackHole {
    /// Center; an offset in each block where the hole repeats.
    pub center: DVec3,
    /// Nothing farther away is moved.
    pub radius: f64,
    /// Factor of the force.
    pub strength: f64,
    /// Exponent of the force.
    pub falloff: f64,
    /// Pushes away.
    pub inverse: bool,
    /// Blocks in which the hole repeats; axes with 0 have one only.
    pub repeat: DVec3,
    /// Random shift of each block's center.
    pub turbulence: DVec3,
}

/// How mapping warps are turned, and what depth does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wrap {
    /// Which direction of the pattern becomes depth.
    pub orientation: DVec3,
    /// Exponent of depth by which the mapped coordinates grow.
    pub dist_exp: f64,
}

impl Default for Wrap {
    fn default() -> Self {
        Self { orientation: DVec3::Z, dist_exp: 0.0 }
    }
}

impl Warp {
    /// The point of the pattern that shows at `p`.
    pub fn apply(&self, p: DVec3, generator: u8) -> DVec3 {
        match self {
            Self::Repeat { axis, width, offset, flip } => repeat(p, usize::from(*axis).min(2), *width, *offset, flip),
            Self::BlackHole(hole) => hole.apply(p, generator),
            Self::Turbulence(t) => t.push(p, generator),
            Self::Cylindrical(wrap) => cylindrical(p, wrap),
            Self::Spherical(wrap) => spherical(p, wrap),
            Self::Toroidal { wrap, major_radius } => toroidal(p, wrap, *major_radius),
            Self::Planar { normal, distance } => turn(DVec3::new(p.x, p.y, *distance), *normal),
            Self::Cubic => cubic(p),
        }
    }
}

fn repeat(p: DVec3, axis: usize, width: f64, offset: DVec3, flip: &[bool; 3]) -> DVec3 {
    let copy = (p[axis] / width).floor();
    if !copy.is_finite() {
        return p;
    }
    let mut q = p;
    q[axis] -= copy * width;
    if (copy % 2.0) != 0.0 {
        for i in 0..3 {
            if flip[i] {
                q[i] = if i == axis { width - q[i] } else { -q[i] };
            }
        }
    }
    q + offset * copy
}

impl BlackHole {
    fn apply(&self, p: DVec3, generator: u8) -> DVec3 {
        let mut center = self.center;
        if self.repeat != DVec3::ZERO {
            let mut block = DVec3::ZERO;
            for i in 0..3 {
                if self.repeat[i] != 0.0 {
                    let n = (p[i] / self.repeat[i]).floor();
                    center[i] += n * self.repeat[i];
                    block[i] = n;
                }
            }
            if self.turbulence != DVec3::ZERO {
                let shift = crate::noise::vector_noise(block + DVec3::splat(0.5), generator);
                center += self.turbulence * shift;
            }
        }
        let from_center = p - center;
        let distance = from_center.length();
        if !(distance < self.radius) || distance == 0.0 {
            return p;
        }
        let closeness = (self.radius - distance) / self.radius;
        let force = fns::pow(closeness, self.falloff) * self.strength;
        // A point moves by no more than its distance from the center.
        let force = force.clamp(-1.0, 1.0);
        p + from_center * if self.inverse { -force } else { force }
    }
}

/// Longitude in turns, [0, 1), from +x through +z.
fn longitude(x: f64, z: f64) -> f64 {
    let turn = fns::atan2(z, x) / std::f64::consts::TAU;
    if turn < 0.0 { turn + 1.0 } else { turn }
}

/// Depth to the power of `dist_exp`.
fn stretch(depth: f64, wrap: &Wrap) -> f64 {
    if wrap.dist_exp == 0.0 {
        1.0
    } else if wrap.dist_exp == 1.0 {
        depth
    } else {
        fns::pow(depth, wrap.dist_exp)
    }
}

fn cylindrical(p: DVec3, wrap: &Wrap) -> DVec3 {
    let depth = (p.x * p.x + p.z * p.z).sqrt();
    if depth == 0.0 {
        return p;
    }
    turn(DVec3::new(longitude(p.x, p.z) * stretch(depth, wrap), p.y, depth), wrap.orientation)
}

fn spherical(p: DVec3, wrap: &Wrap) -> DVec3 {
    let depth = p.length();
    if depth == 0.0 {
        return p;
    }
    let s = stretch(depth, wrap);
    let latitude = 0.5 + fns::asin((p.y / depth).clamp(-1.0, 1.0)) / std::f64::consts::PI;
    turn(DVec3::new(longitude(p.x, p.z) * s, latitude * s, depth), wrap.orientation)
}

fn toroidal(p: DVec3, wrap: &Wrap, major_radius: f64) -> DVec3 {
    let from_axis = (p.x * p.x + p.z * p.z).sqrt();
    if from_axis == 0.0 {
        return p;
    }
    let out = from_axis - major_radius;
    let depth = (out * out + p.y * p.y).sqrt();
    let s = stretch(depth, wrap);
    let around = 0.5 + fns::atan2(p.y, out) / std::f64::consts::TAU;
    turn(DVec3::new(longitude(p.x, p.z) * s, around * s, depth), wrap.orientation)
}

/// Mapped coordinates (two across, depth) laid along an orientation. Measured with orientations along and between the axes: not a
/// rotation, but this matrix.
fn turn(mapped: DVec3, orientation: DVec3) -> DVec3 {
    if orientation == DVec3::Z {
        return mapped;
    }
    let o = orientation.normalize_or_zero();
    DVec3::new(
        (o.z + o.y) * mapped.x + o.x * mapped.z,
        (o.z + o.x) * mapped.y - o.y * mapped.z,
        -o.x * mapped.x + o.y * mapped.y + o.z * mapped.z,
    )
}

/// The unfolded cube: +z in the middle of four faces around y, +y above it and −y below.
fn cubic(p: DVec3) -> DVec3 {
    let a = p.abs();
    let depth = a.max_element();
    if depth == 0.0 || !depth.is_finite() {
        return p;
    }
    let half = |v: f64| (v / depth + 1.0) * 0.5;
    let (column, row, u, v) = if a.x >= a.y && a.x >= a.z {
        if p.x > 0.0 { (2.0, 1.0, half(-p.z), half(p.y)) } else { (0.0, 1.0, half(p.z), half(p.y)) }
    } else if a.y >= a.z {
        if p.y > 0.0 { (1.0, 2.0, half(p.x), half(-p.z)) } else { (1.0, 0.0, half(p.x), half(p.z)) }
    } else if p.z > 0.0 {
        (1.0, 1.0, half(p.x), half(p.y))
    } else {
        (3.0, 1.0, half(-p.x), half(p.y))
    };
    DVec3::new((column + u) * 0.25, (row + v) / 3.0, depth)
}
