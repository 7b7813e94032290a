//! The rays of a stream at one level of the hierarchy: prepared, and in groups.
#![allow(unsafe_code)]

use super::super::Ray;
use super::super::layout::{Arena, ChildRef};
use super::super::ray::Prepared;
#[cfg(target_arch = "x86_64")]
use super::super::simd::{Avx2, Avx512};
use super::super::simd::{Isa, IsaKind, Portable};
use super::super::traverse::{Best, scaled_limit};
use super::MOST;
use super::lists::{self, Group, Memory, OVERHANG, StreamItems, TestRecord};

/// Words of memory for lists: what exceeds it goes on one by one.
const LIST_WORDS: usize = 32 * MOST;
/// Groups: one for each combination of signs.
const GROUPS: usize = 8;
/// Rays are put in the order of these numbers: group, then longest axis; the last one is of rays that hit nothing.
const KEYS: usize = 4 * GROUPS + 1;

/// What is kept of the rays of a stream. Arrays have an element for each ray, at its index in the stream.
#[derive(Default)]
pub(super) struct Level {
    /// The nearest hits so far; where any hit will do, `t` alone matters.
    pub best: Vec<Best>,
    /// See [`Group`].
    ends: Vec<[f32; 2]>,
    /// Those of rays that hit nothing are not written.
    rays: Vec<Prepared>,
    tests: Vec<TestRecord>,
    keys: Vec<u8>,
    /// Indices of rays by key.
    order: Vec<u32>,
    ids: Vec<u32>,
    masks: Vec<u8>,
}

impl Level {
    /// Takes up new rays, by the hits that they have found so far; at most [`MOST`].
    pub fn start(&mut self, best: impl Iterator<Item = Best>) {
        self.best.clear();
        self.best.extend(best.take(MOST));
        self.ends.clear();
        self.ends.resize(self.best.len(), [0.0; 2]);
    }

    /// Ends the search for any hit of a ray.
    pub fn done(&mut self, ray: usize) {
        self.ends[ray][1] = f32::NEG_INFINITY;
    }

    /// For each ray whether its search for any hit had success.
    pub fn occluded(&self) -> impl Iterator<Item = bool> {
        self.ends.iter().map(|e| e[1] == f32::NEG_INFINITY)
    }

    /// Prepares rays and returns the number of those of each key that may hit something.
    #[inline(always)]
    unsafe fn prepare<I: Isa>(&mut self, rays: &[Ray]) -> [usize; KEYS] {
        let count = self.best.len();
        self.rays.clear();
        self.rays.reserve(count);
        self.tests.clear();
        self.tests.reserve(count);
        self.keys.clear();
        let mut counts = [0; KEYS];
        for (i, (ray, (best, ends))) in rays.iter().zip(self.best.iter().zip(&mut self.ends)).enumerate() {
            // Rays that end before they start hit nothing, nor do those that have.
            let usable = best.t > 0.0 && ends[1] != f32::NEG_INFINITY;
            // SAFETY: the caller vouches for the instruction set, and there is room for all rays.
            let key = match unsafe { Prepared::new::<I>(ray) } {
                Some(p) if usable => unsafe {
                    let ([ox, oy, oz], [sx, sy, sz]) = (p.origin, p.shear);
                    self.tests.as_mut_ptr().add(i).write(TestRecord([ox, oy, oz, sx, sy, sz, p.t_min, best.t]));
                    *ends = [p.t_min, scaled_limit(best.t)];
                    let key = p.key();
                    self.rays.as_mut_ptr().add(i).write(p);
                    key
                },
                _ => KEYS as u8 - 1,
            };
            self.keys.push(key);
            counts[key as usize] += 1;
        }
        counts
    }

    /// Puts the indices of rays in the order of their keys.
    fn sort(&mut self, counts: &[usize; KEYS]) {
        let mut places = [0; KEYS];
        for k in 1..KEYS {
            places[k] = places[k - 1] + counts[k - 1];
        }
        self.order.resize(self.keys.len(), 0);
        for (i, &key) in self.keys.iter().enumerate() {
            let place = &mut places[key as usize];
            self.order[*place] = i as u32;
            *place += 1;
        }
    }

    #[inline(always)]
    unsafe fn trace<I: Isa, const ANY: bool>(&mut self, arena: &Arena, root: ChildRef, rays: &[Ray], items: &impl StreamItems) {
        // SAFETY: the caller vouches for the instruction set, the arena and its root. All indices are of rays that were
        // prepared and written.
        unsafe {
            let counts = self.prepare::<I>(rays);
            self.sort(&counts);
            self.ids.resize(LIST_WORDS + OVERHANG, 0);
            self.masks.resize(MOST + OVERHANG, 0);
            let mut first = 0;
            for counts in counts[..KEYS - 1].chunks(4) {
                let count: usize = counts.iter().sum();
                if count == 0 {
                    continue;
                }
                self.ids[..count].copy_from_slice(&self.order[first..first + count]);
                first += count;
                let group = Group {
                    rays: self.rays.as_ptr(),
                    best: self.best.as_mut_ptr(),
                    ends: self.ends.as_mut_ptr(),
                    tests: self.tests.as_mut_ptr(),
                    keys: self.keys.as_ptr(),
                    near_at: (*self.rays.as_ptr().add(self.ids[0] as usize)).near_at,
                };
                let memory = Memory { ids: self.ids.as_mut_ptr(), capacity: LIST_WORDS, masks: self.masks.as_mut_ptr() };
                lists::trace::<I, ANY>(arena, root, &group, &memory, count, items);
            }
        }
    }
}

/// Traces rays below `root` of the arena, with what they have found so far and the results in `level`.
pub(super) fn trace<const ANY: bool>(
    isa: IsaKind,
    arena: &Arena,
    root: ChildRef,
    rays: &[Ray],
    level: &mut Level,
    items: &impl StreamItems,
) {
    // SAFETY: `isa` comes from detection, and root and arena are of one build.
    unsafe {
        match isa {
            IsaKind::Portable => level.trace::<Portable, ANY>(arena, root, rays, items),
            #[cfg(target_arch = "x86_64")]
            IsaKind::Avx2 => trace_avx2::<ANY>(arena, root, rays, level, items),
            #[cfg(target_arch = "x86_64")]
            IsaKind::Avx512 => trace_avx512::<ANY>(arena, root, rays, level, items),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,popcnt")]
fn trace_avx2<const ANY: bool>(arena: &Arena, root: ChildRef, rays: &[Ray], level: &mut Level, items: &impl StreamItems) {
    // SAFETY: this function is only called where the machine has the instruction set, with the root of the arena.
    unsafe { level.trace::<Avx2, ANY>(arena, root, rays, items) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,popcnt,avx512f,avx512vl")]
fn trace_avx512<const ANY: bool>(arena: &Arena, root: ChildRef, rays: &[Ray], level: &mut Level, items: &impl StreamItems) {
    // SAFETY: as above.
    unsafe { level.trace::<Avx512, ANY>(arena, root, rays, items) }
}
