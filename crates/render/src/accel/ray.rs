//! What traversal needs to know of a ray, computed once.

use super::Ray;
use super::simd::{LANES, WIDTH};
use crate::math::{Aabb, Vec3};

/// Half a unit in the last place of 1: the relative error of one operation.
const U: f32 = f32::EPSILON / 2.0;
/// Bounds of |coordinate| that geometry is taken with: beyond, areas and distances would overflow.
pub(super) const LIMIT: f32 = 1e18;

/// A ray prepared for box and triangle tests.
///
/// **Boxes**: t of a plane b is b/d - o/d. Its rounding is at most 3U |o/d| + 2U |t|, for separately rounded operations
/// 4U |o/d| + 3U |t|; triangle tests err by a few U |t| more. Boxes of primitives are widened by a little more than
/// that, boxes of nodes by more again, so that whatever rounding the machine uses, a ray that enters a primitive's box
/// (as [`Prepared::enters`] defines it) enters all boxes around it, and not later.
pub(super) struct Prepared {
    pub ray: Ray,
    /// 1/d for entering planes, and (1 + 32U)/d for leaving ones.
    pub inv_near: [f32; 3],
    pub inv_far: [f32; 3],
    /// -o/d lowered for entering planes, raised and scaled for leaving ones.
    pub off_near: [f32; 3],
    pub off_far: [f32; 3],
    /// Byte offsets of entering and leaving planes in a node.
    pub near_at: [usize; 3],
    pub far_at: [usize; 3],
    /// Axes permuted so that |d| is largest along the last, as offsets in a block's vertex in floats.
    pub axes: [usize; 3],
    /// Origin by permuted axes, and the shear that turns the ray to the unit vector along the last (Woop et al. 2013).
    pub origin: [f32; 3],
    pub shear: [f32; 3],
    /// Twice the largest allowance of a primitive's box: -o/d and what it may be off.
    prim_off: [(f32, f32); 3],
}

/// Distances up to the nearest hit are scaled by this before they are compared with entering distances.
pub(super) const FAR_SCALE: f32 = 1.0 + 32.0 * U;

impl Prepared {
    /// None for rays that hit nothing: no direction, not a number, an empty interval.
    #[inline(always)]
    pub(super) fn new(ray: &Ray) -> Option<Self> {
        let o = ray.o.to_array();
        let d = ray.d.to_array();
        let abs = [d[0].abs(), d[1].abs(), d[2].abs()];
        let kz = if abs[0] > abs[1] {
            if abs[0] > abs[2] { 0 } else { 2 }
        } else if abs[1] > abs[2] {
            1
        } else {
            2
        };
        let largest = abs[kz];
        let sum = (o[0] + o[1] + o[2]) + (d[0] + d[1] + d[2]);
        if !(largest > 1e-30 && sum.is_finite() && ray.t_min < ray.t_max) {
            return None;
        }
        let (kx, ky) = if kz == 2 {
            (0, 1)
        } else if kz == 0 {
            (1, 2)
        } else {
            (2, 0)
        };
        // Nearly axis-parallel: the quotient would overflow. A direction of 1e-20 of the largest component moves nowhere,
        // and the allowance of 1e10 in t makes the planes inclusive.
        let tiny = largest * 1e-20;
        let mut p = Self {
            ray: Ray { o: ray.o, d: ray.d, t_min: ray.t_min.max(0.0) + 0.0, t_max: ray.t_max },
            inv_near: [0.0; 3],
            inv_far: [0.0; 3],
            off_near: [0.0; 3],
            off_far: [0.0; 3],
            near_at: [0; 3],
            far_at: [0; 3],
            axes: [kx * LANES, ky * LANES, kz * LANES],
            origin: [o[kx], o[ky], o[kz]],
            shear: [d[kx] / d[kz], d[ky] / d[kz], 1.0 / d[kz]],
            prim_off: [(0.0, 0.0); 3],
        };
        for k in 0..3 {
            let parallel = abs[k] < tiny;
            let inv = 1.0 / if parallel { tiny.copysign(d[k]) } else { d[k] };
            let off = -(o[k] * inv);
            let extra = if parallel { 1e10 / largest } else { 0.0 };
            let slack = off.abs() * (16.0 * U) + 2.0 * extra;
            p.inv_near[k] = inv;
            p.inv_far[k] = inv * FAR_SCALE;
            p.off_near[k] = off - slack;
            p.off_far[k] = (off + slack) * FAR_SCALE;
            p.prim_off[k] = (off, off.abs() * (6.0 * U) + extra);
            let lower = 2 * k * WIDTH * 4;
            let upper = lower + WIDTH * 4;
            (p.near_at[k], p.far_at[k]) = if inv > 0.0 { (lower, upper) } else { (upper, lower) };
        }
        Some(p)
    }

    /// Where the ray enters a primitive's own box, if it does. All instruction sets compute this with the same bits, and
    /// a hit counts only if the ray enters the primitive's box, and not before it does: so which hit is the nearest is a
    /// property of the ray and the primitives alone, whatever the hierarchy is and in whatever order it is searched.
    #[inline(always)]
    pub(super) fn enters(&self, b: &Aabb) -> Option<f32> {
        let (lo, hi) = (b.min.to_array(), b.max.to_array());
        let mut near = self.ray.t_min;
        let mut far = f32::INFINITY;
        for k in 0..3 {
            let inv = self.inv_near[k];
            let (off, slack) = self.prim_off[k];
            let (a, b) = if inv > 0.0 { (lo[k], hi[k]) } else { (hi[k], lo[k]) };
            let t0 = a * inv + (off - slack);
            let t1 = b * inv + (off + slack);
            near = if t0 > near { t0 } else { near };
            far = if t1 < far { t1 } else { far };
        }
        (near <= far * (1.0 + 16.0 * U)).then_some(near)
    }
}

/// Whether all coordinates are numbers in the range that geometry is taken with.
pub(super) fn in_range(p: Vec3) -> bool {
    p.abs().max_element() <= LIMIT && !p.is_nan()
}
