//! Instances in streams: the rays that reach one go through its hierarchy as a stream of their own.
#![allow(unsafe_code)]

use super::super::ray::Prepared;
use super::super::tlas::Instances;
use super::super::traverse::{Best, Items};
use super::super::{Accel, Ray};
use super::FEWEST;
use super::level::Level;
use super::lists::{Group, StreamItems};
use std::cell::RefCell;

/// The instances of an upper level, with memory for rays in their space.
pub(super) struct StreamInstances<'a> {
    instances: Instances<'a>,
    memory: RefCell<(&'a mut Level, &'a mut Vec<Ray>)>,
}

impl<'a> StreamInstances<'a> {
    pub fn new(accel: &'a Accel, lower: &'a mut Level, placed: &'a mut Vec<Ray>) -> Self {
        Self { instances: Instances { accel }, memory: RefCell::new((lower, placed)) }
    }

    /// Traces all rays through the instances without bounds, one by one: few scenes have any.
    pub fn unbounded<const ANY: bool>(&self, rays: &[Ray], level: &mut Level) {
        for &item in self.instances.accel.unbounded() {
            for (i, ray) in rays.iter().enumerate() {
                if !ANY {
                    self.instances.trace(item, ray, &mut level.best[i]);
                } else if self.instances.occluded(item, ray, level.best[i].t) {
                    level.done(i);
                }
            }
        }
    }
}

impl Items for StreamInstances<'_> {
    fn closest(&self, item: u32, ray: &Prepared, best: &mut Best) {
        self.instances.closest(item, ray, best);
    }

    fn any(&self, item: u32, ray: &Prepared, t_last: f32) -> bool {
        self.instances.any(item, ray, t_last)
    }
}

impl StreamItems for StreamInstances<'_> {
    unsafe fn trace_list<const ANY: bool>(&self, item: u32, ids: &[u32], group: &Group) {
        // SAFETY: the caller vouches for the rays.
        unsafe {
            if ids.len() < FEWEST {
                group.one_by_one::<ANY>(item, ids, self);
                return;
            }
            let (lower, placed) = &mut *self.memory.borrow_mut();
            placed.clear();
            let enter = |&id: &u32| self.instances.enter(item, &group.ray(id).ray());
            placed.extend(ids.iter().map(|id| enter(id).1));
            lower.start(ids.iter().map(|&id| Best { current: item, ..*group.best(id) }));
            let Some((blas, _)) = ids.first().map(enter) else { return };
            blas.trace_stream::<ANY>(self.instances.accel.isa(), placed, lower);
            if ANY {
                ids.iter().zip(lower.occluded()).filter(|o| o.1).for_each(|(&id, _)| group.done(id));
            } else {
                for (&id, best) in ids.iter().zip(&lower.best) {
                    *group.best(id) = *best;
                    group.found(id, best.t);
                }
            }
        }
    }
}
