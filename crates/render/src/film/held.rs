//! Which samples a film holds: rectangles of pixels × ranges of sample indices.

use serde::{Deserialize, Serialize};

/// Pixels from (x0, y0) up to, not including, (x1, y1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Rect {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// One past the last column.
    pub x1: u32,
    /// One past the last row.
    pub y1: u32,
}

impl Rect {
    /// From its corners.
    pub const fn new(x0: u32, y0: u32, x1: u32, y1: u32) -> Self {
        Self { x0, y0, x1, y1 }
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.x1.saturating_sub(self.x0)
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.y1.saturating_sub(self.y0)
    }

    /// Pixels.
    pub fn area(&self) -> u64 {
        u64::from(self.width()) * u64::from(self.height())
    }

    /// True where the pixel lies in it.
    #[inline]
    pub fn contains(&self, x: u32, y: u32) -> bool {
        x >= self.x0 && x < self.x1 && y >= self.y0 && y < self.y1
    }

    /// True where every pixel of `o` lies in it.
    pub fn contains_rect(&self, o: &Self) -> bool {
        o.area() == 0 || (o.x0 >= self.x0 && o.y0 >= self.y0 && o.x1 <= self.x1 && o.y1 <= self.y1)
    }

    /// The common pixels (of area 0 where there are none).
    pub fn intersection(&self, o: &Self) -> Self {
        let (x0, y0) = (self.x0.max(o.x0), self.y0.max(o.y0));
        Self { x0, y0, x1: self.x1.min(o.x1).max(x0), y1: self.y1.min(o.y1).max(y0) }
    }
}

impl std::fmt::Display for Rect {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "[{}, {}) x [{}, {})", self.x0, self.x1, self.y0, self.y1)
    }
}

/// The samples `begin..end` of every pixel of `rect`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct HeldSamples {
    /// Pixels in full-picture coordinates.
    pub rect: Rect,
    /// First sample index.
    pub begin: u32,
    /// One past the last sample index.
    pub end: u32,
}

impl HeldSamples {
    /// How many (pixel, sample) pairs are in both.
    fn overlap(&self, o: &Self) -> u64 {
        let samples = self.end.min(o.end).saturating_sub(self.begin.max(o.begin));
        self.rect.intersection(&o.rect).area() * u64::from(samples)
    }
}

/// A set of disjoint [`HeldSamples`], kept small: complete passes over the film become one entry, and such
/// passes that follow each other are joined.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Held {
    entries: Vec<HeldSamples>,
}

impl Held {
    /// The disjoint parts, in order.
    pub fn entries(&self) -> &[HeldSamples] {
        &self.entries
    }

    /// A part that is held already and shares samples with `new`.
    pub fn find_overlap(&self, new: &HeldSamples) -> Option<HeldSamples> {
        self.entries.iter().find(|e| e.overlap(new) > 0).copied()
    }

    /// True where all of `part` is held.
    pub fn holds(&self, part: &HeldSamples) -> bool {
        let wanted = part.rect.area() * u64::from(part.end.saturating_sub(part.begin));
        self.entries.iter().map(|e| e.overlap(part)).sum::<u64>() == wanted
    }

    /// Adds a part that overlaps none (see [`Held::find_overlap`]); `full` is the film's own rectangle.
    pub(super) fn insert(&mut self, new: HeldSamples, full: &Rect) {
        if new.rect.area() == 0 || new.begin >= new.end {
            return;
        }
        // Sorted by rectangle, then range: what can be joined is side by side.
        let at = self.entries.partition_point(|e| *e < new);
        self.entries.insert(at, new);
        if new.rect != *full {
            // Parts are disjoint, so equal areas mean that the film is covered.
            let same = |e: &HeldSamples| e.begin == new.begin && e.end == new.end;
            if self.entries.iter().filter(|e| same(e)).map(|e| e.rect.area()).sum::<u64>() != full.area() {
                return;
            }
            self.entries.retain(|e| !same(e));
            let whole = HeldSamples { rect: *full, ..new };
            let at = self.entries.partition_point(|e| *e < whole);
            self.entries.insert(at, whole);
        }
        // Only passes over the whole film are joined, so that the entries do not depend on the order in which tiles come in.
        self.entries.dedup_by(|next, kept| {
            let follows = kept.rect == *full && next.rect == *full && kept.end == next.begin;
            if follows {
                kept.end = next.end;
            }
            follows
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_of_a_pass_become_one_entry_and_passes_join() {
        let full = Rect::new(0, 0, 10, 10);
        let mut held = Held::default();
        for begin in [4, 0] {
            for rect in [Rect::new(0, 0, 5, 10), Rect::new(5, 0, 10, 4), Rect::new(5, 4, 10, 10)] {
                let new = HeldSamples { rect, begin, end: begin + 4 };
                assert_eq!(held.find_overlap(&new), None);
                assert!(!held.holds(&new));
                held.insert(new, &full);
                assert!(held.find_overlap(&new).is_some());
                assert!(held.holds(&new));
            }
        }
        assert_eq!(held.entries(), [HeldSamples { rect: full, begin: 0, end: 8 }]);
        assert!(held.find_overlap(&HeldSamples { rect: Rect::new(9, 9, 20, 20), begin: 7, end: 9 }).is_some());
        assert!(!held.holds(&HeldSamples { rect: full, begin: 7, end: 9 }));
        assert!(held.find_overlap(&HeldSamples { rect: full, begin: 8, end: 9 }).is_none());
    }
}
