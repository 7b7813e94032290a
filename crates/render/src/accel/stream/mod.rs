//! Streams: many rays at once, with the same hits as one by one and less time for each.
//!
//! Rays are put into groups by the signs of their direction, and each group goes down the hierarchy together
//! ([`lists`]). See README.md of the folder above for what that gains.
#![allow(unsafe_code)]

mod instances;
mod level;
mod lists;
#[cfg(test)]
mod tests;

use super::blas::{Blas, Shapes};
use super::simd::IsaKind;
use super::traverse::Best;
use super::{Accel, Hit, Ray};
use instances::StreamInstances;
use level::Level;
use lists::{Group, StreamItems};

/// Most rays that are looked at together: what is kept for each takes about 400 bytes, which should stay in caches.
const MOST: usize = 4096;
/// Fewer rays than these are traced one by one.
const FEWEST: usize = 8;

/// Memory that tracing streams needs, some 3 MB; keep it from call to call.
#[derive(Default)]
pub struct StreamMemory {
    upper: Level,
    /// Rays in the space of an instance.
    lower: Level,
    placed: Vec<Ray>,
}

impl StreamMemory {
    /// Takes no memory before its first use.
    pub fn new() -> Self {
        Self::default()
    }
}

impl Accel {
    /// The nearest hits of many rays: `hits[i]` becomes what [`Accel::intersect`] returns for `rays[i]`, to the bit. Rays
    /// are looked at 4096 at a time, and are the faster the more of these start close to each other and run alike. Where
    /// one slice is longer than the other, its rest is left alone.
    pub fn intersect_stream(&self, rays: &[Ray], hits: &mut [Option<Hit>], memory: &mut StreamMemory) {
        for (rays, hits) in rays.chunks(MOST).zip(hits.chunks_mut(MOST)) {
            let rays = &rays[..rays.len().min(hits.len())];
            if rays.len() < FEWEST {
                rays.iter().zip(hits).for_each(|(ray, hit)| *hit = self.intersect(ray));
                continue;
            }
            self.trace_stream::<false>(rays, memory);
            for (best, hit) in memory.upper.best.iter().zip(hits) {
                let Best { t, u, v, prim, instance, .. } = *best;
                *hit = (instance != u32::MAX).then_some(Hit { t, u, v, prim, instance });
            }
        }
    }

    /// Whether rays hit anything: `occluded[i]` becomes what [`Accel::occluded`] returns for `rays[i]`; else as
    /// [`Accel::intersect_stream`].
    pub fn occluded_stream(&self, rays: &[Ray], occluded: &mut [bool], memory: &mut StreamMemory) {
        for (rays, occluded) in rays.chunks(MOST).zip(occluded.chunks_mut(MOST)) {
            let rays = &rays[..rays.len().min(occluded.len())];
            if rays.len() < FEWEST {
                rays.iter().zip(occluded).for_each(|(ray, o)| *o = self.occluded(ray));
                continue;
            }
            self.trace_stream::<true>(rays, memory);
            memory.upper.occluded().zip(occluded).for_each(|(found, o)| *o = found);
        }
    }

    /// Traces rays; the results are in `memory.upper`.
    fn trace_stream<const ANY: bool>(&self, rays: &[Ray], memory: &mut StreamMemory) {
        let StreamMemory { upper, lower, placed } = memory;
        upper.start(rays.iter().map(|ray| Best::new(ray.t_max)));
        if let Some(blas) = self.single() {
            return blas.trace_stream::<ANY>(self.isa(), rays, upper);
        }
        let items = StreamInstances::new(self, lower, placed);
        items.unbounded::<ANY>(rays, upper);
        let (arena, root) = self.tree();
        level::trace::<ANY>(self.isa(), arena, root, rays, upper, &items);
    }
}

impl Blas {
    /// Traces rays in this space, with what they have found so far and the results in `level`.
    fn trace_stream<const ANY: bool>(&self, isa: IsaKind, rays: &[Ray], level: &mut Level) {
        if !self.unbounded.is_empty() {
            for (i, ray) in rays.iter().enumerate() {
                if !ANY {
                    self.closest_unbounded(ray, &mut level.best[i]);
                } else if self.any_unbounded(ray, level.best[i].t) {
                    level.done(i);
                }
            }
        }
        level::trace::<ANY>(isa, &self.arena, self.root, rays, level, &self.shapes);
    }
}

impl StreamItems for Shapes {
    unsafe fn trace_list<const ANY: bool>(&self, item: u32, ids: &[u32], group: &Group) {
        // SAFETY: the caller vouches for the rays.
        unsafe { group.one_by_one::<ANY>(item, ids, self) }
    }
}
