//! Streams: many rays at once.
#![allow(unsafe_code)]

mod lists;

use super::blas::Blas;
use super::ray::Prepared;
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{Isa, IsaKind, Portable};
use super::traverse::{Best, scaled_limit};
use super::{Accel, Hit, Ray};
use lists::{Group, Memory, OVERHANG, TestRecord};
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

pub static TUNE: [AtomicUsize; 4] = [AtomicUsize::new(3), AtomicUsize::new(2), AtomicUsize::new(0), AtomicUsize::new(0)];

/// Most rays that are looked at together.
const MOST: usize = 4096;
/// Words of memory for lists.
const LIST_WORDS: usize = 32 * MOST;

/// Memory that tracing a stream needs; keep it from call to call.
#[derive(Default)]
pub struct StreamMemory {
    rays: Vec<Prepared>,
    best: Vec<Best>,
    ends: Vec<[f32; 2]>,
    tests: Vec<TestRecord>,
    keys: Vec<u8>,
    order: Vec<u32>,
    ids: Vec<u32>,
    masks: Vec<u8>,
}

impl StreamMemory {
    /// Without memory yet.
    pub fn new() -> Self {
        Self::default()
    }
}

/// Number of keys; the last one is of rays that hit nothing.
const KEYS: usize = 33;

impl Accel {
    /// The nearest hits of many rays: `hits[i]` becomes what [`Accel::intersect`] returns for `rays[i]`, to the bit.
    pub fn intersect_stream(&self, rays: &[Ray], hits: &mut [Option<Hit>], memory: &mut StreamMemory) {
        let Some(blas) = self.single() else {
            rays.iter().zip(hits).for_each(|(r, h)| *h = self.intersect(r));
            return;
        };
        for (rays, hits) in rays.chunks(MOST).zip(hits.chunks_mut(MOST)) {
            blas.trace_stream::<false>(self.isa(), rays, memory);
            for (b, h) in memory.best.iter().zip(hits) {
                *h = (b.instance != u32::MAX).then_some(Hit { t: b.t, u: b.u, v: b.v, prim: b.prim, instance: b.instance });
            }
        }
    }

    /// Whether rays hit anything: `occluded[i]` becomes what [`Accel::occluded`] returns for `rays[i]`.
    pub fn occluded_stream(&self, rays: &[Ray], occluded: &mut [bool], memory: &mut StreamMemory) {
        let Some(blas) = self.single() else {
            rays.iter().zip(occluded).for_each(|(r, h)| *h = self.occluded(r));
            return;
        };
        for (rays, occluded) in rays.chunks(MOST).zip(occluded.chunks_mut(MOST)) {
            blas.trace_stream::<true>(self.isa(), rays, memory);
            for (l, o) in memory.ends.iter().zip(occluded) {
                *o = l[1] == f32::NEG_INFINITY;
            }
        }
    }
}

impl Blas {
    fn trace_stream<const ANY: bool>(&self, isa: IsaKind, rays: &[Ray], memory: &mut StreamMemory) {
        // SAFETY: `isa` comes from detection.
        unsafe {
            match isa {
                IsaKind::Portable => self.trace_stream_in::<Portable, ANY>(rays, memory),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx2 => self.trace_stream_avx2::<ANY>(rays, memory),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx512 => self.trace_stream_avx512::<ANY>(rays, memory),
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt")]
    fn trace_stream_avx2<const ANY: bool>(&self, rays: &[Ray], memory: &mut StreamMemory) {
        // SAFETY: this function is only called where the machine has the instruction set.
        unsafe { self.trace_stream_in::<Avx2, ANY>(rays, memory) }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt,avx512f,avx512vl")]
    fn trace_stream_avx512<const ANY: bool>(&self, rays: &[Ray], memory: &mut StreamMemory) {
        // SAFETY: as above.
        unsafe { self.trace_stream_in::<Avx512, ANY>(rays, memory) }
    }

    #[inline(always)]
    unsafe fn trace_stream_in<I: Isa, const ANY: bool>(&self, rays: &[Ray], memory: &mut StreamMemory) {
        let m = memory;
        m.rays.clear();
        m.rays.reserve(rays.len());
        m.best.clear();
        m.ends.clear();
        m.tests.clear();
        m.tests.reserve(rays.len());
        m.keys.clear();
        m.ids.resize(LIST_WORDS + OVERHANG, 0);
        m.masks.resize(MOST + OVERHANG, 0);
        m.order.resize(MOST, 0);
        let mut ends = [0u32; KEYS];
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            for (i, ray) in rays.iter().enumerate() {
                let best = Best::new(ray.t_max);
                let mut key = KEYS as u8 - 1;
                if let Some(p) = Prepared::new::<I>(ray) {
                    key = p.key();
                    let ([ox, oy, oz], [sx, sy, sz]) = (p.origin, p.shear);
                    m.tests.as_mut_ptr().add(i).write(TestRecord([ox, oy, oz, sx, sy, sz, p.t_min, best.t]));
                    m.rays.as_mut_ptr().add(i).write(p);
                }
                m.keys.push(key);
                m.ends.push([ray.t_min.max(0.0) + 0.0, scaled_limit(best.t)]);
                m.best.push(best);
                ends[key as usize] += 1;
            }
            let mut sum = 0;
            for e in &mut ends {
                sum += *e;
                *e = sum - *e;
            }
            for (i, &key) in m.keys.iter().enumerate() {
                let at = &mut ends[key as usize];
                m.order[*at as usize] = i as u32;
                *at += 1;
            }
            let mut first = 0;
            let step = if TUNE[1].load(Relaxed) == 0 { 1 } else { 4 };
            for last in (step - 1..KEYS - 1).step_by(step) {
                let end = ends[last] as usize;
                let count = end - first;
                if count == 0 {
                    continue;
                }
                m.ids[..count].copy_from_slice(&m.order[first..end]);
                first = end;
                let group = Group {
                    rays: m.rays.as_ptr(),
                    best: m.best.as_mut_ptr(),
                    ends: m.ends.as_mut_ptr(),
                    tests: m.tests.as_mut_ptr(),
                    keys: m.keys.as_ptr(),
                    near_at: (*m.rays.as_ptr().add(m.ids[0] as usize)).near_at,
                };
                let lists = Memory { ids: m.ids.as_mut_ptr(), capacity: LIST_WORDS, masks: m.masks.as_mut_ptr() };
                lists::trace::<I, ANY>(&self.arena, self.root, &group, &lists, count, &self.shapes);
            }
        }
    }
}
