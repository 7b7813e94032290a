//! Traversal: the nearest hit and any hit of a ray, generic over the instruction set.
#![allow(unsafe_code)]

use super::floats::{Floats, RECORD};
use super::layout::{Arena, BLOCK_UNITS, Block, CHILDREN_AT, MAX_BLOCKS, TAG_ITEMS, TAG_NODE, UNIT, Unit};
use super::ray::{FAR_SCALE, Lanes4, OPPOSITE, Prepared};
use super::simd::{Isa, LANES};
use crate::math::{Aabb, Vec3};
use std::mem::MaybeUninit;

/// Most entries of the stack: the build keeps trees less than [`super::build::MAX_DEPTH`] deep, a node leaves seven
/// behind, and vector stores write up to seven beyond.
pub(super) const STACK: usize = super::build::MAX_DEPTH * 7 + 8;

/// Bytes of a hierarchy from which memory is asked for ahead: smaller ones stay in caches.
pub(super) const PREFETCH_ABOVE: usize = 16 << 20;

/// The nearest hit so far.
#[derive(Clone, Copy)]
pub(super) struct Best {
    pub t: f32,
    pub u: f32,
    pub v: f32,
    pub prim: u32,
    pub instance: u32,
    /// Instance that is being searched.
    pub current: u32,
}

impl Best {
    /// Nothing yet; hits at `t_max` itself do not count, hits as near as an earlier one do if their number is lower.
    #[inline(always)]
    pub(super) fn new(t_max: f32) -> Self {
        Self { t: t_max.next_down(), u: 0.0, v: 0.0, prim: u32::MAX, instance: u32::MAX, current: 0 }
    }

    /// Takes a hit if it is nearer, or as near with a lower (instance, primitive).
    #[inline(always)]
    pub(super) fn offer(&mut self, t: f32, u: f32, v: f32, prim: u32) {
        if t < self.t || (t == self.t && (self.current, prim) < (self.instance, self.prim)) {
            *self = Self { t, u, v, prim, instance: self.current, current: self.current };
        }
    }
}

/// What list leaves stand for: shapes in the lower level, instances in the upper.
pub(super) trait Items {
    /// Offers the hits of an item to `best`.
    fn closest(&self, item: u32, ray: &Prepared, best: &mut Best);
    /// Whether the item is hit before `t_last`, itself included.
    fn any(&self, item: u32, ray: &Prepared, t_last: f32) -> bool;
}

/// The box of a block's triangle.
pub(super) fn lane_box(block: &Block, lane: usize) -> Aabb {
    let v = |k: usize| Vec3::new(block.vertices[3 * k][lane], block.vertices[3 * k + 1][lane], block.vertices[3 * k + 2][lane]);
    let (a, b, c) = (v(0), v(1), v(2));
    Aabb { min: a.min(b).min(c), max: a.max(b).max(c) }
}

/// A block's hits by one row of rays.
pub(super) struct BlockHits<V> {
    /// A bit for each hit with `t_min` < t ≤ `t_last`, by row, then triangle.
    pub mask: u32,
    pub t: V,
    /// Areas whose quotients by `det` are the barycentric weights of vertices 1 and 2.
    pub v: V,
    pub w: V,
    pub det: V,
}

/// What triangle tests need of a ray, in [`Floats::gather`]'s order: origin by permuted axes, shear, `t_min`, `t_last`.
pub(super) type TestRay<V> = [V; RECORD];

/// Tests a block: the watertight test of Woop, Benthin, Wald 2013, "Watertight Ray/Triangle Intersection", JCGT 2(1),
/// appendix A, on several triangles at once. Edges are inclusive: an edge function that rounds to zero belongs to both
/// sides, and as rounding is monotonic its sign is never wrong, so no ray passes between two triangles. (The paper takes
/// double precision for zeros instead, to give them to one side.) All rays have the same permutation of axes. None where
/// no edge function lets a hit be.
#[inline(always)]
pub(super) unsafe fn test_block<V: Floats>(block: &Block, axes: &[usize; 3], ray: &TestRay<V>) -> Option<BlockHits<V>> {
    // SAFETY: the caller vouches for the instruction set; all loads lie within the block, aligned to its lanes.
    unsafe {
        let base = block.vertices.as_ptr().cast::<f32>();
        let [kx, ky, kz] = *axes;
        let [ox, oy, oz, sx, sy, sz, t_min, t_last] = *ray;
        let vertex = |k: usize| {
            let p = base.add(3 * k * LANES);
            let z = V::sub(V::load_row(p.add(kz)), oz);
            let x = V::sub(V::sub(V::load_row(p.add(kx)), ox), V::mul(sx, z));
            let y = V::sub(V::sub(V::load_row(p.add(ky)), oy), V::mul(sy, z));
            (x, y, z)
        };
        let (ax, ay, az) = vertex(0);
        let (bx, by, bz) = vertex(1);
        let (cx, cy, cz) = vertex(2);
        let u = V::sub(V::mul(cx, by), V::mul(cy, bx));
        let v = V::sub(V::mul(ax, cy), V::mul(ay, cx));
        let w = V::sub(V::mul(bx, ay), V::mul(by, ax));
        let zero = V::splat(0.0);
        let least = V::min(V::min(u, v), w);
        let most = V::max(V::max(u, v), w);
        let sided = V::le(zero, least) | V::le(most, zero);
        if sided == 0 {
            return None;
        }
        let det = V::add(V::add(u, v), w);
        let scaled = V::add(V::add(V::mul(u, az), V::mul(v, bz)), V::mul(w, cz));
        let t = V::div(V::mul(scaled, sz), det);
        // A quotient by zero is infinite or not a number, and fails here.
        let mask = sided & V::lt(t_min, t) & V::le(t, t_last);
        Some(BlockHits { mask, t, v, w, det })
    }
}

/// Most numbers of a vector of triangle tests.
const MOST_LANES: usize = 4 * LANES;

/// Calls `take` with the row, t, u, v and the primitive of each hit whose primitive's box its ray enters, until it returns
/// true; `ray` is the ray of a row.
#[inline(always)]
pub(super) unsafe fn take_hits<'a, I: Isa, V: Floats>(
    block: &Block,
    hits: &BlockHits<V>,
    mut mask: u32,
    ray: impl Fn(usize) -> &'a Prepared,
    mut take: impl FnMut(usize, f32, f32, f32, u32) -> bool,
) -> bool {
    let (mut ts, mut us, mut vs) = ([0.0f32; MOST_LANES], [0.0f32; MOST_LANES], [0.0f32; MOST_LANES]);
    // SAFETY: the caller vouches for the instruction set.
    unsafe {
        V::store(ts.as_mut_ptr(), hits.t);
        V::store(us.as_mut_ptr(), V::div(hits.v, hits.det));
        V::store(vs.as_mut_ptr(), V::div(hits.w, hits.det));
        while mask != 0 {
            let at = mask.trailing_zeros() as usize % MOST_LANES;
            mask &= mask - 1;
            let (row, lane) = (at / LANES, at % LANES);
            let vertex =
                |k: usize| I::row(block.vertices[3 * k][lane], block.vertices[3 * k + 1][lane], block.vertices[3 * k + 2][lane], 0.0);
            let (a, b, c) = (vertex(0), vertex(1), vertex(2));
            let (lo, hi) = (I::B::min(I::B::min(a, b), c), I::B::max(I::B::max(a, b), c));
            if let Some(near) = ray(row).enters_between::<I>(lo, hi)
                && take(row, ts[at].max(near), us[at], vs[at], block.prims[lane])
            {
                return true;
            }
        }
    }
    false
}

/// Tests a block with one ray: calls `take` with t, u, v and the primitive of each hit with `t_min` < t ≤ `t_last`,
/// until it returns true.
#[inline(always)]
unsafe fn test_ray<I: Isa>(block: &Block, ray: &Prepared, t_last: f32, mut take: impl FnMut(f32, f32, f32, u32) -> bool) -> bool {
    // SAFETY: the caller vouches for the instruction set.
    unsafe {
        let ([ox, oy, oz], [sx, sy, sz]) = (ray.origin, ray.shear);
        let test = [ox, oy, oz, sx, sy, sz, ray.t_min, t_last].map(|x| I::B::splat(x));
        match test_block(block, &ray.axes, &test) {
            Some(hits) if hits.mask != 0 => take_hits::<I, I::B>(block, &hits, hits.mask, |_| ray, |_, t, u, v, prim| take(t, u, v, prim)),
            _ => false,
        }
    }
}

/// Box tests of a node: entering distances and a bit for each child that is entered before `limit`.
#[inline(always)]
unsafe fn test_node<I: Isa>(node: *const u8, r: &Lanes<I>, ray: &Prepared, limit: I::F) -> (I::F, u32) {
    // SAFETY: the caller vouches for the node and the instruction set; offsets lie within a node.
    unsafe {
        let plane = |at: usize| I::load(node.add(at).cast());
        let near = I::max(
            I::max(
                I::mul_add(plane(ray.near_at[0]), r.inv_near[0], r.off_near[0]),
                I::mul_add(plane(ray.near_at[1]), r.inv_near[1], r.off_near[1]),
            ),
            I::max(I::mul_add(plane(ray.near_at[2]), r.inv_near[2], r.off_near[2]), r.t_min),
        );
        let far = I::min(
            I::min(
                I::mul_add(plane(ray.near_at[0] ^ OPPOSITE), r.inv_far[0], r.off_far[0]),
                I::mul_add(plane(ray.near_at[1] ^ OPPOSITE), r.inv_far[1], r.off_far[1]),
            ),
            I::min(I::mul_add(plane(ray.near_at[2] ^ OPPOSITE), r.inv_far[2], r.off_far[2]), limit),
        );
        (near, I::le(near, far))
    }
}

/// A ray's numbers in all lanes.
struct Lanes<I: Isa> {
    inv_near: [I::F; 3],
    inv_far: [I::F; 3],
    off_near: [I::F; 3],
    off_far: [I::F; 3],
    t_min: I::F,
}

impl<I: Isa> Lanes<I> {
    #[inline(always)]
    unsafe fn new(ray: &Prepared) -> Self {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            let all = |a: &Lanes4| [I::splat(a.0[0]), I::splat(a.0[1]), I::splat(a.0[2])];
            Self {
                inv_near: all(&ray.inv_near),
                inv_far: all(&ray.inv_far),
                off_near: all(&ray.off_near),
                off_far: all(&ray.off_far),
                t_min: I::splat(ray.t_min),
            }
        }
    }
}

/// Up to where boxes count for a hit at `t`.
#[inline(always)]
pub(super) fn scaled_limit(t: f32) -> f32 {
    // From the largest number up to infinity is harmless.
    t * FAR_SCALE
}

/// The item numbers of a list leaf.
#[inline(always)]
pub(super) unsafe fn list<'a>(base: *const u8, child: u32) -> &'a [u32] {
    // SAFETY: the caller vouches that `child` is a list of the arena at `base`: a length and so many words.
    unsafe {
        let p = base.add((child >> 3) as usize * UNIT).cast::<Unit>().cast::<u32>();
        std::slice::from_raw_parts(p.add(1), *p as usize)
    }
}

/// Asks for the memory of the children in `mask`: most of them will be visited, and big scenes do not fit in caches.
#[inline(always)]
pub(super) unsafe fn prefetch_children<I: Isa>(base: *const u8, children: *const u32, mask: u32) {
    // SAFETY: the caller vouches for the children; prefetched addresses need not be valid.
    unsafe {
        let mut m = mask;
        while m != 0 {
            let child = base.wrapping_add((*children.add(m.trailing_zeros() as usize) >> 3) as usize * UNIT);
            m &= m - 1;
            for line in 0..4 {
                I::prefetch(child.wrapping_add(line * 64));
            }
        }
    }
}

/// Kept out of line, so that the registers of the loop around it are not planned for calls.
#[cold]
#[inline(never)]
fn closest_in_list(list: &[u32], ray: &Prepared, best: &mut Best, items: &impl Items) {
    list.iter().for_each(|&item| items.closest(item, ray, best));
}

#[cold]
#[inline(never)]
fn any_in_list(list: &[u32], ray: &Prepared, t_last: f32, items: &impl Items) -> bool {
    list.iter().any(|&item| items.any(item, ray, t_last))
}

/// Offers the hits in a leaf to `best`.
#[inline(always)]
pub(super) unsafe fn closest_in_leaf<I: Isa>(base: *const u8, leaf: u32, ray: &Prepared, best: &mut Best, items: &impl Items) {
    // SAFETY: the caller vouches for the leaf, which may be the empty one, and for the instruction set.
    unsafe {
        if leaf & 7 == TAG_ITEMS {
            closest_in_list(list(base, leaf), ray, best, items);
        } else {
            let blocks = base.add((leaf >> 3) as usize * UNIT).cast::<Block>();
            for i in 0..(leaf & 7) as usize {
                let t_last = best.t;
                test_ray::<I>(&*blocks.add(i), ray, t_last, |t, u, v, prim| {
                    best.offer(t, u, v, prim);
                    false
                });
            }
        }
    }
}

/// Whether anything in a leaf is hit at `t_last` or before.
#[inline(always)]
pub(super) unsafe fn any_in_leaf<I: Isa>(base: *const u8, leaf: u32, ray: &Prepared, t_last: f32, items: &impl Items) -> bool {
    // SAFETY: as above.
    unsafe {
        if leaf & 7 == TAG_ITEMS {
            return any_in_list(list(base, leaf), ray, t_last, items);
        }
        let blocks = base.add((leaf >> 3) as usize * UNIT).cast::<Block>();
        for i in 0..(leaf & 7) as usize {
            if test_ray::<I>(&*blocks.add(i), ray, t_last, |t, _, _, _| t <= t_last) {
                return true;
            }
        }
        false
    }
}

/// Offers all hits below `root` to `best`.
///
/// # Safety
/// The machine has the instruction set, and `root` is a child reference of the arena.
#[inline(always)]
pub(super) unsafe fn closest<I: Isa>(arena: &Arena, root: u32, ray: &Prepared, best: &mut Best, items: &impl Items) {
    let mut keys = [const { MaybeUninit::<i32>::uninit() }; STACK];
    let mut refs = [const { MaybeUninit::<u32>::uninit() }; STACK];
    // SAFETY: the build vouches for references and depth (checked by `validate` in tests); entries below `sp` are written.
    unsafe {
        let (keys, refs) = (keys.as_mut_ptr().cast::<i32>(), refs.as_mut_ptr().cast::<u32>());
        let r = Lanes::<I>::new(ray);
        let (base, prefetch) = (arena.base(), arena.bytes() > PREFETCH_ABOVE);
        let mut sp = 0;
        let mut current = root;
        let mut limit = scaled_limit(best.t);
        let mut limits = I::splat(limit);
        loop {
            while current & 7 == TAG_NODE {
                let node = base.add((current >> 3) as usize * UNIT);
                let (near, mask) = test_node::<I>(node, &r, ray, limits);
                let children = node.add(CHILDREN_AT).cast::<u32>();
                if mask == 0 {
                    current = 0;
                } else if mask & (mask - 1) == 0 {
                    current = *children.add(mask.trailing_zeros() as usize);
                } else {
                    if prefetch {
                        prefetch_children::<I>(base, children, mask);
                    }
                    let nearest = I::push_sorted(near, mask, children, keys.add(sp), refs.add(sp));
                    sp += mask.count_ones() as usize - 1;
                    current = *children.add(nearest);
                }
            }
            if current != 0 {
                closest_in_leaf::<I>(base, current, ray, best, items);
                limit = scaled_limit(best.t);
                limits = I::splat(limit);
            }
            loop {
                if sp == 0 {
                    return;
                }
                sp -= 1;
                if f32::from_bits((*keys.add(sp) & !7) as u32) <= limit {
                    current = *refs.add(sp);
                    break;
                }
            }
        }
    }
}

/// Whether anything below `root` is hit at `t_last` or before.
///
/// # Safety
/// As for [`closest`].
#[inline(always)]
pub(super) unsafe fn any<I: Isa>(arena: &Arena, root: u32, ray: &Prepared, t_last: f32, items: &impl Items) -> bool {
    let mut refs = [const { MaybeUninit::<u32>::uninit() }; STACK];
    // SAFETY: as in `closest`.
    unsafe {
        let refs = refs.as_mut_ptr().cast::<u32>();
        let r = Lanes::<I>::new(ray);
        let (base, prefetch) = (arena.base(), arena.bytes() > PREFETCH_ABOVE);
        let limits = I::splat(scaled_limit(t_last));
        let mut sp = 0;
        let mut current = root;
        loop {
            while current & 7 == TAG_NODE {
                let node = base.add((current >> 3) as usize * UNIT);
                let (_, mask) = test_node::<I>(node, &r, ray, limits);
                let children = node.add(CHILDREN_AT).cast::<u32>();
                if mask == 0 {
                    current = 0;
                } else {
                    if prefetch && mask & (mask - 1) != 0 {
                        prefetch_children::<I>(base, children, mask);
                    }
                    I::push(mask, children, refs.add(sp));
                    sp += mask.count_ones() as usize - 1;
                    current = *refs.add(sp);
                }
            }
            if any_in_leaf::<I>(base, current, ray, t_last, items) {
                return true;
            }
            if sp == 0 {
                return false;
            }
            sp -= 1;
            current = *refs.add(sp);
        }
    }
}

const _: () = assert!(MAX_BLOCKS < TAG_ITEMS as usize && BLOCK_UNITS * UNIT == size_of::<Block>());
