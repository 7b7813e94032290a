//! Tiles of pictures whose edges alone are smoothed; see [`super::antialias`].

use super::antialias::{CORNERS, Centers};
use super::{Session, own_rgb};
use crate::film::{Film, Rect};
use crate::integrator::Estimate;

impl Session {
    /// Samples `begin..end` of a tile's pixels: the first is the center, the corners follow where it differs from a neighbor, and the others
    /// where it differs from a corner or is beside something thin.
    pub(super) fn smooth_tile(&self, centers: &Centers, tile: &mut Film, rect: Rect, begin: u32, end: u32) {
        let space = self.film.spec().space;
        let mut estimate = self.new_estimate();
        let mut neighbor = Estimate { forgoes_first: true, wants_own: estimate.wants_own, ..Estimate::default() };
        let mut values = Vec::new();
        let further = begin.max(1)..end;
        // What corners show is asked for by those who come later, too.
        let traced = if end > 1 + CORNERS { 1..end } else { further.clone() };
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                if begin == 0 {
                    self.center(x, y, &mut estimate);
                    centers.keep(x, y, own_rgb(&estimate, space));
                    self.add(tile, x, y, 0, 1.0, space, &estimate, &mut values);
                }
                let mut trace = |x, y| {
                    self.center(x, y, &mut neighbor);
                    own_rgb(&neighbor, space)
                };
                if further.is_empty() || !centers.differs(x, y, &mut trace) {
                    continue;
                }
                let stream = self.sampler.stream(x, y, 0);
                let mut differs = false;
                for index in traced.clone() {
                    if index == 1 + CORNERS && !differs && !centers.is_by_something_thin(x, y, &mut trace) {
                        break;
                    }
                    let (weight, _) = self.sample(x, y, stream.of_sample(index - 1), &mut estimate);
                    differs = differs || centers.differs_from(x, y, own_rgb(&estimate, space));
                    if index >= further.start {
                        self.add(tile, x, y, index, weight, space, &estimate, &mut values);
                    }
                }
            }
        }
    }
}
