//! Rays in lists: each node is read once for all rays that enter it.
//!
//! A group of rays whose directions have the same signs goes down the hierarchy together (Barringer and Akenine-Möller
//! 2014, "Dynamic Ray Stream Traversal", ACM TOG 33(4)): a node's planes stay in registers while the rays of its list
//! are tested one by one, and each child gets the list of those that enter it. Tests of different rays do not wait for
//! each other, and no branch depends on their results. In leaves, a vector holds the tests of several rays.
#![allow(unsafe_code)]

use super::super::floats::{Floats, RECORD};
use super::super::layout::{Arena, Block, CHILDREN_AT, ChildRef, TAG_ITEMS, TAG_NODE, UNIT};
use super::super::ray::{OPPOSITE, Prepared};
use super::super::simd::{Isa, LANES, WIDTH};
use super::super::traverse::{self, Best, Items, PREFETCH_ABOVE, STACK, TestRay, scaled_limit, take_hits, test_block};
use std::mem::MaybeUninit;

/// Words that lists may be written beyond their end.
pub(super) const OVERHANG: usize = 16;
/// Lists of no more rays go on one by one.
const FEW: u32 = 1;

/// A ray's numbers for triangle tests: see [`TestRay`].
#[repr(C, align(32))]
#[derive(Clone, Copy)]
pub(super) struct TestRecord(pub [f32; RECORD]);

/// Rays whose directions have the same signs, and what they have found. Pointers are to arrays by the index of a ray.
pub(super) struct Group {
    pub rays: *const Prepared,
    /// Where any hit will do, `t` is where the search ends.
    pub best: *mut Best,
    /// Start of the interval, and scaled distance of the nearest hit so far: -∞ for rays that need no more.
    pub ends: *mut [f32; 2],
    pub tests: *mut TestRecord,
    /// Numbers whose lower two bits are the longest axis. Lists are in the order of these.
    pub keys: *const u8,
    /// Offsets in nodes of the planes that they enter by.
    pub near_at: [usize; 3],
}

/// Memory of lists.
pub(super) struct Memory {
    /// [`OVERHANG`] more than `capacity`.
    pub ids: *mut u32,
    pub capacity: usize,
    /// A byte for each ray of a list, [`OVERHANG`] more.
    pub masks: *mut u8,
}

/// What list leaves stand for, for lists of rays.
pub(super) trait StreamItems: Items {
    /// Traces rays through an item.
    ///
    /// # Safety
    /// All `ids` are of rays of the group.
    unsafe fn trace_list<const ANY: bool>(&self, item: u32, ids: &[u32], group: &Group);
}

/// A list of rays that enter a child.
#[derive(Clone, Copy)]
struct Entry {
    child: ChildRef,
    /// Where its rays start in the memory of lists, and how many they are.
    first: u32,
    count: u32,
    /// The node it is a child of, in units, and its slot; [`NO_PARENT`] for the root.
    parent: u32,
    slot: u32,
}

const NO_PARENT: u32 = u32::MAX;

/// Of all functions: the caller vouches for the numbers of rays, the memory and the instruction set.
impl Group {
    /// A ray as it was prepared.
    #[inline(always)]
    pub unsafe fn ray(&self, id: u32) -> &Prepared {
        // SAFETY: as above; so below.
        unsafe { &*self.rays.add(id as usize) }
    }

    /// What a ray has found. No two results for the same ray may be held at once.
    #[inline(always)]
    #[allow(clippy::mut_from_ref)]
    pub unsafe fn best(&self, id: u32) -> &mut Best {
        unsafe { &mut *self.best.add(id as usize) }
    }

    /// Ends a ray's search for any hit.
    #[inline(always)]
    pub unsafe fn done(&self, id: u32) {
        unsafe { (*self.ends.add(id as usize))[1] = f32::NEG_INFINITY };
    }

    /// Tells that a ray's nearest hit so far is at `t`.
    #[inline(always)]
    pub unsafe fn found(&self, id: u32, t: f32) {
        unsafe {
            (*self.ends.add(id as usize))[1] = scaled_limit(t);
            (*self.tests.add(id as usize)).0[RECORD - 1] = t;
        }
    }

    /// Traces rays through an item one by one.
    pub unsafe fn one_by_one<const ANY: bool>(&self, item: u32, ids: &[u32], items: &impl Items) {
        unsafe {
            for &id in ids {
                let (ray, best) = (self.ray(id), self.best(id));
                if !ANY {
                    items.closest(item, ray, best);
                    self.found(id, best.t);
                } else if items.any(item, ray, best.t) {
                    self.done(id);
                }
            }
        }
    }

    /// Moves the rays that search on to the front of the list, and returns their number.
    unsafe fn retain(&self, ids: &mut [u32]) -> usize {
        let mut left = 0;
        for i in 0..ids.len() {
            let id = ids[i];
            ids[left] = id;
            left += usize::from(unsafe { (*self.ends.add(id as usize))[1] } != f32::NEG_INFINITY);
        }
        left
    }

    /// Whether a ray still enters a child's box before its nearest hit. Boxes are wide enough for any rounding.
    #[inline(always)]
    unsafe fn enters(&self, planes: &[f32; 3], id: u32) -> bool {
        unsafe {
            let ray = self.ray(id);
            let t = |k: usize| planes[k] * ray.inv_near.0[k] + ray.off_near.0[k];
            let (x, y, z) = (t(0), t(1), t(2));
            let xy = if x > y { x } else { y };
            let near = if xy > z { xy } else { z };
            near <= (*self.ends.add(id as usize))[1]
        }
    }

    /// Tests a list against a node. Writes the children that each ray enters to `masks`, and returns those that any
    /// enters, with the least of the distances where rays enter each.
    #[inline(always)]
    unsafe fn test_node<I: Isa>(&self, node: *const u8, ids: &[u32], masks: *mut u8) -> (I::F, u32) {
        unsafe {
            let plane = |at: usize| I::load(node.add(at).cast());
            let [x, y, z] = self.near_at;
            let (nx, ny, nz) = (plane(x), plane(y), plane(z));
            let (fx, fy, fz) = (plane(x ^ OPPOSITE), plane(y ^ OPPOSITE), plane(z ^ OPPOSITE));
            let at = |p: I::F, inv: &f32, off: &f32| I::mul_add(p, I::splat(*inv), I::splat(*off));
            let mut nearest = I::splat(f32::INFINITY);
            let mut entered = 0;
            for (i, &id) in ids.iter().enumerate() {
                let (r, ends) = (self.ray(id), &*self.ends.add(id as usize));
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

    /// Tests a list against the blocks of a leaf, as many rays at once as vectors take.
    #[inline(always)]
    unsafe fn test_leaf<I: Isa, const ANY: bool>(&self, blocks: &[Block], mut ids: &[u32]) {
        unsafe {
            let key = |id: u32| *self.keys.add(id as usize);
            let record = |id: u32| (*self.tests.add(id as usize)).0.as_ptr();
            while let Some(&first) = ids.first() {
                let mut rows = I::W::ROWS.min(ids.len());
                while key(ids[rows - 1]) != key(first) {
                    rows -= 1;
                }
                let axes = &self.ray(first).axes;
                if rows == 1 {
                    let test = I::B::gather([record(first); 4]);
                    self.test_rows::<I, I::B, ANY>(blocks, axes, &test, (1 << LANES) - 1, |_| first);
                } else {
                    let row = |i: usize| ids[i.min(rows - 1)];
                    let test = I::W::gather([0, 1, 2, 3].map(|i| record(row(i))));
                    self.test_rows::<I, I::W, ANY>(blocks, axes, &test, (1 << (LANES * rows)) - 1, row);
                }
                ids = &ids[rows..];
            }
        }
    }

    /// Tests rays, one in each row of vectors, against blocks. Only the hits in `valid` count.
    #[inline(always)]
    unsafe fn test_rows<I: Isa, V: Floats, const ANY: bool>(
        &self,
        blocks: &[Block],
        axes: &[usize; 3],
        test: &TestRay<V>,
        valid: u32,
        id: impl Fn(usize) -> u32,
    ) {
        unsafe {
            for block in blocks {
                let Some(hits) = test_block(block, axes, test) else { continue };
                let mask = hits.mask & valid;
                if mask == 0 {
                    continue;
                }
                let ray = |row: usize| self.ray(id(row));
                take_hits::<I, V>(block, &hits, mask, ray, |row, t, u, v, prim| {
                    let id = id(row);
                    let best = self.best(id);
                    if !ANY {
                        best.offer(t, u, v, prim);
                        self.found(id, best.t);
                    } else if t <= best.t {
                        self.done(id);
                    }
                    false
                });
            }
        }
    }
}

/// Traces a list of rays, the first `count` in `memory`, below `root`. With `ANY`, a ray's search ends with the first hit at
/// its `best.t` or before; else `best` is offered all hits.
///
/// # Safety
/// As for [`traverse::closest`]; the list and all that it refers to are valid.
#[inline(always)]
pub(super) unsafe fn trace<I: Isa, const ANY: bool>(
    arena: &Arena,
    root: ChildRef,
    group: &Group,
    memory: &Memory,
    count: usize,
    items: &impl StreamItems,
) {
    let mut stack = [const { MaybeUninit::<Entry>::uninit() }; STACK];
    // SAFETY: as in `traverse::closest`; lists are written only where there is room.
    unsafe {
        let stack = stack.as_mut_ptr().cast::<Entry>();
        let (base, prefetch) = (arena.base(), arena.bytes() > PREFETCH_ABOVE);
        stack.write(Entry { child: root, first: 0, count: count as u32, parent: NO_PARENT, slot: 0 });
        let mut sp = 1;
        while sp > 0 {
            sp -= 1;
            let Entry { child, first, count, parent, slot } = *stack.add(sp);
            let ids = std::slice::from_raw_parts_mut(memory.ids.add(first as usize), count as usize);
            // Lists above this one are of children that are done with.
            let mut top = first as usize + ids.len();
            let room = top + WIDTH * ids.len() <= memory.capacity;
            if child & 7 == TAG_NODE && count > FEW && room {
                let at = child >> 3;
                let node = base.add(at as usize * UNIT);
                let (nearest, entered) = group.test_node::<I>(node, ids, memory.masks);
                std::ptr::write_bytes(memory.masks.add(ids.len()), 0, OVERHANG);
                if entered == 0 {
                    continue;
                }
                let children = node.add(CHILDREN_AT).cast::<u32>();
                if prefetch {
                    traverse::prefetch_children::<I>(base, children, entered);
                }
                let (mut keys, mut refs) = ([0i32; WIDTH], [0u32; WIDTH]);
                I::push_sorted(nearest, entered, children, keys.as_mut_ptr(), refs.as_mut_ptr());
                for (&key, &child) in keys.iter().zip(&refs).take(entered.count_ones() as usize) {
                    let slot = key as u32 & 7;
                    let n = I::pack(memory.masks, ids.as_ptr(), ids.len(), slot, memory.ids.add(top));
                    stack.add(sp).write(Entry { child, first: top as u32, count: n as u32, parent: at, slot });
                    top += n;
                    sp += 1;
                }
                continue;
            }
            // Some have found a nearer hit since they were put on the list.
            let mut left = ids.len();
            if parent != NO_PARENT {
                let planes = base.add(parent as usize * UNIT + 4 * slot as usize);
                let planes = group.near_at.map(|at| planes.add(at).cast::<f32>().read());
                left = 0;
                for i in 0..ids.len() {
                    let id = ids[i];
                    ids[left] = id;
                    left += usize::from(group.enters(&planes, id));
                }
            }
            let ids = &mut ids[..left];
            match child & 7 {
                TAG_NODE => {
                    for &id in ids.iter() {
                        let (ray, best) = (group.ray(id), group.best(id));
                        if !ANY {
                            traverse::closest::<I>(arena, child, ray, best, items);
                            group.found(id, best.t);
                        } else if traverse::any::<I>(arena, child, ray, best.t, items) {
                            group.done(id);
                        }
                    }
                }
                TAG_ITEMS => {
                    let mut left = ids.len();
                    for &item in traverse::list(base, child) {
                        items.trace_list::<ANY>(item, &ids[..left], group);
                        if ANY {
                            left = group.retain(&mut ids[..left]);
                        }
                    }
                }
                blocks => {
                    let first = base.add((child >> 3) as usize * UNIT).cast::<Block>();
                    group.test_leaf::<I, ANY>(std::slice::from_raw_parts(first, blocks as usize), ids);
                }
            }
        }
    }
}
