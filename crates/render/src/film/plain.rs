//! Plain films: the four channels of a picture, nothing else, and every sample counts 1.
//!
//! Most pixels of a picture whose edges alone are smoothed have one sample. Such a pixel keeps its values as they came, and no sum or
//! weight of it is touched, nor the memory that it would lie in, which the system then never has to provide. The picture is that of the
//! general film: a pixel with a second sample has sums as there.

use super::{Film, LIMIT, SUM_BITS, finite_or_zero, fixed, limit, real};

/// Values of at least this size have all their bits in a sum.
const WHOLE: f32 = 1.0 / (1u64 << 40) as f32;

impl Film {
    /// Whether the film is kept as the head of the module says.
    #[inline]
    pub(super) fn is_plain(&self) -> bool {
        !self.singles.is_empty()
    }

    /// Makes an empty film plain where its channels allow it.
    pub(super) fn become_plain(&mut self) {
        let spec = &self.layout.spec;
        let is_picture = self.layout.means.len() == 4 && spec.channels.len() == 4 && !spec.splats;
        if is_picture && self.squares.is_empty() && self.held.entries().is_empty() {
            self.weights = Vec::new();
            self.singles = vec![[0.0; 4]; self.counts.len()];
        }
    }

    /// Makes it a general film, for samples that do not count 1.
    pub(super) fn widen(&mut self) {
        if !self.is_plain() {
            return;
        }
        for (pixel, values) in std::mem::take(&mut self.singles).into_iter().enumerate() {
            if self.counts[pixel] == 1 {
                self.add_to_sum(pixel, values);
            }
        }
        self.weights = self.counts.iter().map(|&n| i128::from(n) << SUM_BITS).collect();
    }

    /// Forgets all sums; values of single samples count only where there is one.
    pub(super) fn empty_plain(&mut self) {
        for (sums, &count) in self.sums.chunks_exact_mut(4).zip(&self.counts) {
            if count > 1 {
                sums.fill(0);
            }
        }
        self.singles.fill([0.0; 4]);
    }

    /// Adds a sample that counts 1.
    #[inline]
    pub(super) fn add_plain(&mut self, pixel: usize, values: &[f32]) {
        let values = match *values {
            [r, g, b, a] if [r, g, b, a].iter().all(|v| v.abs() < LIMIT as f32) => [r, g, b, a],
            // The limit is a power of two, so nothing is lost.
            _ => std::array::from_fn(|i| {
                let value = finite_or_zero(values.get(i).copied().unwrap_or(0.0), &mut self.counters);
                limit(f64::from(value), LIMIT, &mut self.counters) as f32
            }),
        };
        match self.counts[pixel] {
            0 => self.singles[pixel] = values,
            1 => {
                self.raise(pixel);
                self.add_to_sum(pixel, values);
            }
            _ => self.add_to_sum(pixel, values),
        }
        self.counts[pixel] = self.counts[pixel].wrapping_add(1);
    }

    /// Moves the values of a pixel with one sample to its sums.
    #[inline]
    fn raise(&mut self, pixel: usize) {
        let values = std::mem::take(&mut self.singles[pixel]);
        self.add_to_sum(pixel, values);
    }

    #[inline]
    fn add_to_sum(&mut self, pixel: usize, values: [f32; 4]) {
        if let Some(sums) = self.sums.get_mut(4 * pixel..4 * pixel + 4) {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum = sum.wrapping_add(fixed(f64::from(value), SUM_BITS));
            }
        }
    }

    /// [`Film::merge`] of two plain films.
    pub(super) fn merge_plain(&mut self, other: &Self) {
        for y in other.rect.y0..other.rect.y1 {
            let (ours, theirs) = (self.pixel(other.rect.x0, y), other.pixel(other.rect.x0, y));
            for i in 0..other.rect.width() as usize {
                let (a, b) = (ours + i, theirs + i);
                let count = other.counts[b];
                match (self.counts[a], count) {
                    (_, 0) => continue,
                    (0, 1) => self.singles[a] = other.singles[b],
                    (before, _) => {
                        if before == 1 {
                            self.raise(a);
                        }
                        if count == 1 {
                            self.add_to_sum(a, other.singles[b]);
                        } else {
                            super::add_slices(&mut self.sums[4 * a..4 * a + 4], &other.sums[4 * b..4 * b + 4]);
                        }
                    }
                }
                self.counts[a] = self.counts[a].wrapping_add(count);
            }
        }
    }

    /// A sum as a number, as if the film were general.
    #[inline]
    pub(super) fn plain_sum(&self, pixel: usize, slot: usize) -> f64 {
        match self.counts[pixel] {
            1 => {
                let value = self.singles[pixel][slot];
                if value.abs() >= WHOLE { f64::from(value) } else { real(fixed(f64::from(value), SUM_BITS)) }
            }
            _ => real(self.sums[4 * pixel + slot]),
        }
    }
}
