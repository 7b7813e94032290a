//! Rays in lists: each node is read once for all rays that enter it.
//!
//! A group of rays whose directions have the same signs goes down the hierarchy together (Barringer and Akenine-Möller
//! 2014, "Dynamic Ray Stream Traversal", ACM TOG 33(4)): a node's planes stay in registers while the rays of its list
//! are tested one by one, and each child gets the list of those that enter it. Tests of different rays do not wait for
//! each other, and no branch depends on their results. Lists of few rays go on one by one.
#![allow(unsafe_code)]

use super::super::floats::{Floats, RECORD};
use super::super::layout::{Arena, Block, CHILDREN_AT, TAG_ITEMS, TAG_NODE, UNIT};
use super::super::ray::{OPPOSITE, Prepared};
use super::super::simd::{Isa, LANES, WIDTH};
use super::super::traverse::{self, Best, Items, PREFETCH_ABOVE, STACK, TestRay, scaled_limit, take_hits, test_block};
use super::TUNE;
use std::mem::MaybeUninit;
use std::sync::atomic::Ordering::Relaxed;

/// Words that lists may be written beyond their end.
pub(super) const OVERHANG: usize = 16;

/// A list of rays that enter a child.
#[derive(Clone, Copy)]
struct Entry {
    child: u32,
    /// Where its rays start in the memory of lists, and how many they are.
    first: u32,
    count: u32,
    /// The node it is a child of, in units, and its slot; [`NO_BOX`] for the root.
    parent: u32,
    slot: u32,
}

const NO_BOX: u32 = u32::MAX;

/// A ray's numbers for triangle tests.
#[repr(C, align(32))]
#[derive(Clone, Copy)]
pub(super) struct TestRecord(pub [f32; RECORD]);

/// The rays of a group and what they have found.
pub(super) struct Group {
    pub rays: *const Prepared,
    pub best: *mut Best,
    /// Start of the interval, and scaled distance of the nearest hit so far: -∞ for rays that need no more.
    pub ends: *mut [f32; 2],
    /// What triangle tests need: [`traverse::TestRay`].
    pub tests: *mut TestRecord,
    /// Numbers whose lower two bits are the longest axis. Lists are in the order of these.
    pub keys: *const u8,
    /// Offsets of the planes they enter by.
    pub near_at: [usize; 3],
}

/// Memory of lists.
pub(super) struct Memory {
    pub ids: *mut u32,
    pub capacity: usize,
    /// A byte for each ray of a list, [`OVERHANG`] more.
    pub masks: *mut u8,
}

impl Group {
    /// Whether a ray still enters a child's box before its nearest hit. Whatever the rounding, boxes are wide enough.
    #[inline(always)]
    unsafe fn enters(&self, planes: &[f32; 3], id: u32) -> bool {
        // SAFETY: the caller vouches for the number of the ray.
        unsafe {
            let ray = &*self.rays.add(id as usize);
            let t = |k: usize| planes[k] * ray.inv_near.0[k] + ray.off_near.0[k];
            let (x, y, z) = (t(0), t(1), t(2));
            let xy = if x > y { x } else { y };
            let near = if xy > z { xy } else { z };
            near <= (*self.ends.add(id as usize))[1]
        }
    }

    /// A ray needs no more hits than the one it has.
    #[inline(always)]
    unsafe fn done(&self, id: usize) {
        // SAFETY: as above.
        unsafe { (*self.ends.add(id))[1] = f32::NEG_INFINITY };
    }

    /// A ray's nearest hit is at `t`.
    #[inline(always)]
    unsafe fn found(&self, id: usize, t: f32) {
        // SAFETY: as above.
        unsafe {
            (*self.ends.add(id))[1] = scaled_limit(t);
            (*self.tests.add(id)).0[RECORD - 1] = t;
        }
    }

    /// Tests a list against the blocks of a leaf, as many rays at once as vectors take.
    #[inline(always)]
    unsafe fn test_leaf<I: Isa, const ANY: bool>(&self, blocks: &[Block], mut ids: &[u32]) {
        // SAFETY: the caller vouches for everything.
        unsafe {
            let key = |id: u32| *self.keys.add(id as usize);
            while let Some(&first) = ids.first() {
                let mut rows = I::W::ROWS.min(ids.len());
                while key(ids[rows - 1]) != key(first) {
                    rows -= 1;
                }
                let row = |i: usize| ids[i.min(rows - 1)] as usize;
                let axes = &(*self.rays.add(first as usize)).axes;
                if rows == 1 {
                    let id = first as usize;
                    let record = &(*self.tests.add(id)).0;
                    let test = std::array::from_fn(|i| I::B::splat(record[i]));
                    self.test_rows::<I, I::B, ANY>(blocks, axes, &test, (1 << LANES) - 1, |_| id);
                } else {
                    let test = I::W::gather([0, 1, 2, 3].map(|i| (*self.tests.add(row(i))).0.as_ptr()));
                    self.test_rows::<I, I::W, ANY>(blocks, axes, &test, (1 << (LANES * rows)) - 1, row);
                }
                ids = &ids[rows..];
            }
        }
    }

    /// Tests rays, one for each row of vectors, against blocks. Hits beyond those of `valid` do not count.
    #[inline(always)]
    unsafe fn test_rows<I: Isa, V: Floats, const ANY: bool>(
        &self,
        blocks: &[Block],
        axes: &[usize; 3],
        test: &TestRay<V>,
        valid: u32,
        id: impl Fn(usize) -> usize,
    ) {
        // SAFETY: the caller vouches for everything.
        unsafe {
            for block in blocks {
                let Some(hits) = test_block(block, axes, test) else { continue };
                let mask = hits.mask & valid;
                if mask == 0 {
                    continue;
                }
                take_hits::<I, V>(block, &hits, mask, |row| &*self.rays.add(id(row)), |row, t, u, v, prim| {
                    let id = id(row);
                    let best = &mut *self.best.add(id);
                    if ANY {
                        if t <= best.t {
                            self.done(id);
                        }
                    } else {
                        best.offer(t, u, v, prim);
                        self.found(id, best.t);
                    }
                    false
                });
            }
        }
    }

    /// Tests a list against a node. Returns the nearest entering distance of each child, and the children entered.
    #[inline(always)]
    unsafe fn test_node<I: Isa>(&self, node: *const u8, ids: *const u32, count: usize, masks: *mut u8) -> (I::F, u32) {
        // SAFETY: the caller vouches for everything.
        unsafe {
            let plane = |at: usize| I::load(node.add(at).cast());
            let [x, y, z] = self.near_at;
            let (nx, ny, nz) = (plane(x), plane(y), plane(z));
            let (fx, fy, fz) = (plane(x ^ OPPOSITE), plane(y ^ OPPOSITE), plane(z ^ OPPOSITE));
            let mut nearest = I::splat(f32::INFINITY);
            let mut entered = 0;
            for i in 0..count {
                let id = *ids.add(i) as usize;
                let (r, ends) = (&*self.rays.add(id), &*self.ends.add(id));
                let at = |p: I::F, inv: &f32, off: &f32| I::mul_add(p, I::splat(*inv), I::splat(*off));
                let near = I::max(
                    I::max(at(nx, &r.inv_near.0[0], &r.off_near.0[0]), at(ny, &r.inv_near.0[1], &r.off_near.0[1])),
                    I::max(at(nz, &r.inv_near.0[2], &r.off_near.0[2]), I::splat(ends[0])),
                );
                let far = I::min(
                    I::min(at(fx, &r.inv_far.0[0], &r.off_far.0[0]), at(fy, &r.inv_far.0[1], &r.off_far.0[1])),
                    I::min(at(fz, &r.inv_far.0[2], &r.off_far.0[2]), I::splat(ends[1])),
                );
                let mask = I::le_min(near, far, &mut nearest);
                *masks.add(i) = mask as u8;
                entered |= mask;
            }
            (nearest, entered)
        }
    }
}

/// Finds hits of all rays of a list (the first `count` of `memory`) below `root`. With `ANY`, a ray's search ends with the
/// first hit at its `best.t` or before, which `limits` tells by a negative number; else `best` gets all hits.
///
/// # Safety
/// As for [`traverse::closest`]; all numbers of rays are valid.
#[inline(always)]
pub(super) unsafe fn trace<I: Isa, const ANY: bool>(
    arena: &Arena,
    root: u32,
    group: &Group,
    memory: &Memory,
    count: usize,
    items: &impl Items,
) {
    let few = TUNE[0].load(Relaxed) as u32;
    let mut stack = [const { MaybeUninit::<Entry>::uninit() }; STACK];
    // SAFETY: as in `traverse::closest`; lists are written only where `memory` has room.
    unsafe {
        let stack = stack.as_mut_ptr().cast::<Entry>();
        let (base, prefetch) = (arena.base(), arena.bytes() > PREFETCH_ABOVE);
        stack.write(Entry { child: root, first: 0, count: count as u32, parent: NO_BOX, slot: 0 });
        let mut sp = 1;
        while sp > 0 {
            sp -= 1;
            let Entry { child, first, count, parent, slot } = *stack.add(sp);
            let ids = memory.ids.add(first as usize);
            let tag = child & 7;
            let end = first as usize + count as usize;
            let room = end + WIDTH * (count as usize + OVERHANG) <= memory.capacity;
            if tag == TAG_NODE && count > few && room {
                let at = child >> 3;
                let node = base.add(at as usize * UNIT);
                let masks = memory.masks;
                let (nearest, entered) = group.test_node::<I>(node, ids, count as usize, masks);
                std::ptr::write_bytes(masks.add(count as usize), 0, OVERHANG);
                if entered == 0 {
                    continue;
                }
                let children = node.add(CHILDREN_AT).cast::<u32>();
                if prefetch {
                    traverse::prefetch_children::<I>(base, children, entered);
                }
                let (mut keys, mut refs) = ([0i32; 2 * WIDTH], [0u32; 2 * WIDTH]);
                I::push_sorted(nearest, entered, children, keys.as_mut_ptr(), refs.as_mut_ptr());
                let mut top = end;
                for i in 0..entered.count_ones() as usize {
                    let slot = keys[i] as u32 & 7;
                    let n = I::pack(masks, ids, count as usize, slot, memory.ids.add(top));
                    stack.add(sp).write(Entry { child: refs[i], first: top as u32, count: n as u32, parent: at, slot });
                    top += n;
                    sp += 1;
                }
                continue;
            }
            let planes = if parent == NO_BOX {
                None
            } else {
                let node = base.add(parent as usize * UNIT + 4 * slot as usize);
                Some(group.near_at.map(|at| node.add(at).cast::<f32>().read()))
            };
            let mut left = 0;
            for i in 0..count as usize {
                let id = *ids.add(i);
                *ids.add(left) = id;
                left += usize::from(planes.is_none_or(|p| group.enters(&p, id)));
            }
            if tag == TAG_NODE || tag == TAG_ITEMS {
                for i in 0..left {
                    let id = *ids.add(i) as usize;
                    let (ray, best) = (&*group.rays.add(id), &mut *group.best.add(id));
                    if ANY {
                        if traverse::any::<I>(arena, child, ray, best.t, items) {
                            group.done(id);
                        }
                    } else {
                        traverse::closest::<I>(arena, child, ray, best, items);
                        group.found(id, best.t);
                    }
                }
            } else {
                let blocks = base.add((child >> 3) as usize * UNIT).cast::<Block>();
                group.test_leaf::<I, ANY>(std::slice::from_raw_parts(blocks, tag as usize), std::slice::from_raw_parts(ids, left));
            }
        }
    }
}
