//! What traversal needs to know of a ray, computed once.
#![allow(unsafe_code)]

use super::Ray;
use super::floats::Floats;
use super::simd::{Isa, LANES, Portable, WIDTH};
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
#[repr(C, align(64))]
pub(super) struct Prepared {
    /// 1/d for entering planes, and (1 + 32U)/d for leaving ones.
    pub inv_near: Lanes4,
    pub inv_far: Lanes4,
    /// -o/d lowered for entering planes, raised and scaled for leaving ones.
    pub off_near: Lanes4,
    pub off_far: Lanes4,
    /// Ends of the interval; the lower one is not negative.
    pub t_min: f32,
    pub t_max: f32,
    /// Byte offsets of entering planes in a node; the leaving ones are at the offset with the bit [`OPPOSITE`] flipped.
    pub near_at: [usize; 3],
    /// Axes permuted so that |d| is largest along the last, as offsets in a block's vertex in floats.
    pub axes: [usize; 3],
    /// Origin and direction.
    o: [f32; 4],
    d: [f32; 4],
    /// Origin by permuted axes, and the shear that turns the ray to the unit vector along the last (Woop et al. 2013).
    pub origin: [f32; 3],
    pub shear: [f32; 3],
    /// -o/d lowered and raised for the boxes of primitives.
    off_low: Lanes4,
    off_high: Lanes4,
}

/// Numbers for x, y and z, with a fourth lane that means nothing. Written and read whole or by lane: reading a pair of
/// floats that were written one by one would stall.
#[repr(C, align(16))]
pub(super) struct Lanes4(pub [f32; 4]);

/// Bytes between the lower and the upper planes of an axis in a node.
pub(super) const OPPOSITE: usize = WIDTH * 4;
const _: () = assert!(LANES == 4);

/// Distances up to the nearest hit are scaled by this before they are compared with entering distances.
pub(super) const FAR_SCALE: f32 = 1.0 + 32.0 * U;

impl Prepared {
    /// None for rays that hit nothing: no direction (below 1e-12), not a number, from beyond 1e18, an empty interval.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    pub(super) unsafe fn new<I: Isa>(ray: &Ray) -> Option<Self> {
        let (o, d) = (ray.o, ray.d);
        let abs = [d.x.abs(), d.y.abs(), d.z.abs()];
        // Without branches: the largest component is as good as random.
        let first = if abs[0] > abs[1] { abs[0] } else { abs[1] };
        let largest = if first > abs[2] { first } else { abs[2] };
        let one = usize::from(abs[0] <= abs[1]);
        let two = usize::from(first <= abs[2]);
        let kz = (one + (2 - one) * two) & 3;
        // Comparisons are written so that they fail for NaN.
        let far = o.x.abs() <= LIMIT && o.y.abs() <= LIMIT && o.z.abs() <= LIMIT;
        let sum = d.x + d.y + d.z;
        if !(largest >= 1e-12 && far && sum.is_finite() && ray.t_min < ray.t_max) {
            return None;
        }
        const NEXT: [[usize; 2]; 4] = [[1, 2], [2, 0], [0, 1], [0, 1]];
        let [kx, ky] = NEXT[kz];
        // Nearly axis-parallel: the quotient would overflow. A direction of 1e-20 of the largest component moves nowhere,
        // and the allowance of 1e10 in t makes the planes inclusive. With these limits no box test meets NaN.
        let tiny = (largest * 1e-20).max(1e-19);
        let ten = 1e10 / largest;
        let clamp = |d: f32, abs: f32| if abs < tiny { tiny.copysign(d) } else { d };
        let allow = |abs: f32| if abs < tiny { ten } else { 0.0 };
        // SAFETY: the caller vouches for the instruction set, and the arrays are aligned.
        unsafe {
            let store = |x: I::B| {
                let mut a = Lanes4([0.0; 4]);
                I::B::store(a.0.as_mut_ptr(), x);
                a
            };
            let (o4, d4) = (I::row(o.x, o.y, o.z, 0.0), I::row(d.x, d.y, d.z, 1.0));
            let clamped = I::row(clamp(d.x, abs[0]), clamp(d.y, abs[1]), clamp(d.z, abs[2]), 1.0);
            let extra = I::row(allow(abs[0]), allow(abs[1]), allow(abs[2]), 0.0);
            let inv = I::B::div(I::B::splat(1.0), clamped);
            let minus = I::B::mul(o4, inv);
            let off = I::B::sub(I::B::splat(0.0), minus);
            let size = I::B::max(minus, off);
            let own = I::B::add(I::B::mul(size, I::B::splat(6.0 * U)), extra);
            let slack = I::B::add(I::B::mul(size, I::B::splat(16.0 * U)), I::B::add(extra, extra));
            let scale = I::B::splat(FAR_SCALE);
            let (o, d) = (store(o4).0, store(d4).0);
            let inv_z = 1.0 / d[kz];
            let upper = |d: f32| ((d.to_bits() >> 31) as usize) * OPPOSITE;
            Some(Self {
                t_min: ray.t_min.max(0.0) + 0.0,
                t_max: ray.t_max,
                inv_near: store(inv),
                inv_far: store(I::B::mul(inv, scale)),
                off_near: store(I::B::sub(off, slack)),
                off_far: store(I::B::mul(I::B::add(off, slack), scale)),
                near_at: [upper(ray.d.x), upper(ray.d.y) + 2 * OPPOSITE, upper(ray.d.z) + 4 * OPPOSITE],
                axes: [kx * LANES, ky * LANES, kz * LANES],
                o,
                d,
                origin: [o[kx], o[ky], o[kz]],
                shear: [d[kx] / d[kz], d[ky] / d[kz], inv_z],
                off_low: store(I::B::sub(off, own)),
                off_high: store(I::B::add(off, own)),
            })
        }
    }

    /// A number below 32 for the signs of the direction (the upper three bits) and its longest axis.
    #[inline(always)]
    pub(super) fn key(&self) -> u8 {
        let sign = |k: usize| u8::from(self.d[k].to_bits() >> 31 == 1) << (2 + k);
        (self.axes[2] / LANES) as u8 | sign(0) | sign(1) | sign(2)
    }

    /// The ray again.
    pub(super) fn ray(&self) -> Ray {
        let v = |a: &[f32; 4]| Vec3::new(a[0], a[1], a[2]);
        Ray { o: v(&self.o), d: v(&self.d), t_min: self.t_min, t_max: self.t_max }
    }

    /// Where the ray enters a primitive's own box, if it does. All instruction sets compute this with the same bits, and
    /// a hit counts only if the ray enters the primitive's box, and not before it does: so which hit is the nearest is a
    /// property of the ray and the primitives alone, whatever the hierarchy is and in whatever order it is searched.
    pub(super) fn enters(&self, b: &Aabb) -> Option<f32> {
        // SAFETY: every machine has these vectors.
        unsafe { self.enters_between::<Portable>([b.min.x, b.min.y, b.min.z, 0.0], [b.max.x, b.max.y, b.max.z, 0.0]) }
    }

    /// [`Prepared::enters`] for the box from `lo` to `hi`.
    ///
    /// # Safety
    /// The machine has the instruction set.
    #[inline(always)]
    pub(super) unsafe fn enters_between<I: Isa>(&self, lo: I::B, hi: I::B) -> Option<f32> {
        // SAFETY: as above, and the arrays are aligned.
        unsafe {
            let inv = I::B::load_row(self.inv_near.0.as_ptr());
            let (a, b) = (I::B::mul(lo, inv), I::B::mul(hi, inv));
            let (mut t0, mut t1) = (Lanes4([0.0; 4]), Lanes4([0.0; 4]));
            I::B::store(t0.0.as_mut_ptr(), I::B::add(I::B::min(a, b), I::B::load_row(self.off_low.0.as_ptr())));
            I::B::store(t1.0.as_mut_ptr(), I::B::add(I::B::max(a, b), I::B::load_row(self.off_high.0.as_ptr())));
            let later = |a: f32, b: f32| if a > b { a } else { b };
            let earlier = |a: f32, b: f32| if a < b { a } else { b };
            let ([x0, y0, z0, _], [x1, y1, z1, _]) = (t0.0, t1.0);
            let near = later(z0, later(y0, later(x0, self.t_min)));
            let far = earlier(z1, earlier(y1, x1));
            (near <= far * (1.0 + 16.0 * U)).then_some(near)
        }
    }
}

/// Whether all coordinates are numbers in the range that geometry is taken with.
pub(super) fn in_range(p: Vec3) -> bool {
    p.abs().max_element() <= LIMIT && !p.is_nan()
}
