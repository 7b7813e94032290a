//! The part of a search disk that its center can see.
//!
//! A disk that reaches past the foot of a wall finds photons that another room has, or none where the floor ends: light leaks along
//! edges, and corners are dark. Rays along the tangent plane tell how far the surface goes on before something else stands on it. What
//! lies behind does not count, and the kernel is normalized over what is left. As the radius goes to zero, all of the disk is seen from
//! every point that is not itself on an edge, so that the estimate converges to the same light.

use crate::accel::Ray;
use crate::math::{PI, Vec3, fns};
use crate::scene::{Scene, Surface};

use super::estimate::LEAST_NORMAL_COS;

/// Directions that are looked into.
const SECTORS: usize = 8;
/// The angle of a sector.
const EIGHTH: f32 = 0.25 * PI;
/// How high above the surface the rays start, as a part of the radius: what is flatter hides nothing.
const HEIGHT: f32 = 0.02;
/// The kernel's least integral that is divided by, as a part of the whole disk's.
const LEAST_SHARE: f32 = 0.05;

/// How far the surface around a point is seen from it, in sectors of the disk of a search.
pub struct VisibleDisk {
    x: Vec3,
    y: Vec3,
    /// In the middle of each sector, from `x` by way of `y`; at most the radius.
    reaches: [f32; SECTORS],
    radius: f32,
}

impl VisibleDisk {
    /// Looks around at a surface point on the side of the unit direction `wo`, as far as `radius`; `u` in [0, 1) turns the sectors.
    pub fn around(scene: &Scene, s: &Surface, wo: Vec3, radius: f32, u: f32) -> Self {
        let n = if s.ng.dot(wo) < 0.0 { -s.ng } else { s.ng };
        let across = n.any_orthonormal_vector();
        let (sin, cos) = fns::sin_cos(u * EIGHTH);
        let x = across * cos + n.cross(across) * sin;
        let y = n.cross(x);
        let o = s.offset_origin(n) + n * (HEIGHT * radius);
        let (sin, cos) = fns::sin_cos(0.5 * EIGHTH);
        let reaches =
            [[cos, sin], [sin, cos], [-sin, cos], [-cos, sin], [-cos, -sin], [-sin, -cos], [sin, -cos], [cos, -sin]].map(|[a, b]| {
                let ray = Ray { t_max: radius, ..Ray::new(o, x * a + y * b) };
                // Most rays meet nothing, which is found out faster than what.
                match scene.occluded(&ray).then(|| scene.intersect(&ray)).flatten() {
                    Some(hit) if hit.ng.dot(n).abs() < LEAST_NORMAL_COS => hit.t,
                    _ => radius,
                }
            });
        Self { x, y, reaches, radius }
    }

    /// Whether a place at this offset from the center, within the radius, is seen.
    #[inline]
    pub fn sees(&self, offset: Vec3) -> bool {
        let (x, y) = (offset.dot(self.x), offset.dot(self.y));
        let reach = self.reaches[sector(x, y)];
        reach >= self.radius || x * x + y * y < reach * reach
    }

    /// ∫ (1 − d²/r²) dA over what is seen of a disk of a radius up to that which was looked at, over the same of the whole disk; not
    /// less than a bound that keeps single photons in narrow corners from weighing without limit.
    pub fn share(&self, radius: f32) -> f32 {
        let sum: f32 = self.reaches.iter().map(|reach| fns::sqr((reach / radius).min(1.0))).map(|t2| t2 * (2.0 - t2)).sum();
        (sum / SECTORS as f32).max(LEAST_SHARE)
    }
}

/// The sector of a direction in the plane.
#[inline]
fn sector(x: f32, y: f32) -> usize {
    // Eighths of a turn: the half, the quarter in it, the eighth in that.
    let (x, y, half) = if y < 0.0 { (-x, -y, 4) } else { (x, y, 0) };
    let (x, y, quarter) = if x < 0.0 { (y, -x, 2) } else { (x, y, 0) };
    half + quarter + usize::from(y > x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_are_eighths_of_a_turn() {
        for i in 0..SECTORS {
            for part in [0.01, 0.5, 0.99] {
                let (sin, cos) = fns::sin_cos((i as f32 + part) * EIGHTH);
                assert_eq!(sector(cos, sin), i, "{part}");
            }
        }
    }
}
