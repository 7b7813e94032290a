//! Rays in lists: each node is read once for all rays that enter it.
//!
//! A group of rays whose directions have the same signs goes down the hierarchy together (Barringer and Akenine-Möller
//! 2014, "Dynamic Ray Stream Traversal", ACM TOG 33(4)): a node's planes stay in registers while the rays of its list
//! are tested one by one, and each child gets the list of those that enter it. Tests of different rays do not wait for
//! each other, and no branch depends on their results. Lists of few rays go on one by one.
#![allow(unsafe_code)]

use super::super::layout::{Arena, CHILDREN_AT, TAG_NODE, UNIT};
use super::super::ray::{OPPOSITE, Prepared};
use super::super::simd::{Isa, WIDTH};
use super::super::traverse::{self, Best, Items, PREFETCH_ABOVE, STACK, scaled_limit};
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

/// The rays of a group and what they have found.
pub(super) struct Group {
    pub rays: *const Prepared,
    pub best: *mut Best,
    /// Scaled distance of the nearest hit so far; negative for rays that need no more.
    pub limits: *mut f32,
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
            near <= *self.limits.add(id as usize)
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
                let r = &*self.rays.add(id);
                let at = |p: I::F, inv: &f32, off: &f32| I::mul_add(p, I::splat(*inv), I::splat(*off));
                let near = I::max(
                    I::max(at(nx, &r.inv_near.0[0], &r.off_near.0[0]), at(ny, &r.inv_near.0[1], &r.off_near.0[1])),
                    I::max(at(nz, &r.inv_near.0[2], &r.off_near.0[2]), I::splat(r.t_min)),
                );
                let far = I::min(
                    I::min(at(fx, &r.inv_far.0[0], &r.off_far.0[0]), at(fy, &r.inv_far.0[1], &r.off_far.0[1])),
                    I::min(at(fz, &r.inv_far.0[2], &r.off_far.0[2]), I::splat(*self.limits.add(id))),
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
            for i in 0..count as usize {
                let id = *ids.add(i);
                if let Some(planes) = &planes
                    && !group.enters(planes, id)
                {
                    continue;
                }
                let id = id as usize;
                let ray = &*group.rays.add(id);
                let best = &mut *group.best.add(id);
                if ANY {
                    let found = if tag == TAG_NODE {
                        traverse::any::<I>(arena, child, ray, best.t, items)
                    } else {
                        traverse::any_in_leaf::<I>(base, child, ray, best.t, items)
                    };
                    if found {
                        *group.limits.add(id) = f32::NEG_INFINITY;
                    }
                } else {
                    if tag == TAG_NODE {
                        traverse::closest::<I>(arena, child, ray, best, items);
                    } else {
                        traverse::closest_in_leaf::<I>(base, child, ray, best, items);
                    }
                    *group.limits.add(id) = scaled_limit(best.t);
                }
            }
        }
    }
}
