//! Splats: light that a sample brings to other pixels than its own.
//!
//! They are summed over the film's whole crop, apart from the samples, and divided by the mean number of samples per pixel when the
//! film is developed. Sums are fixed point as all others, so that their order does not matter. A worker's tile keeps its splats as a
//! list; merging adds them to the sums of the whole film.

use super::{
    Film, FilmCounters, FilmSpec, LIMIT, Rect, SQUARE_BITS, SQUARE_LIMIT, SQUARE_ONE, SQUARES, SUM_BITS, add_slices, finite_or_zero, fixed,
    limit, real,
};

/// A splat as a tile keeps it. Its numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Entry {
    /// Pixel of the crop, row by row.
    pixel: u32,
    /// Light group.
    group: u32,
    /// Filter weight.
    weight: f32,
    /// Contribution before the weight.
    rgb: [f32; 3],
}

/// Sums over all pixels of the crop.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SplatSums {
    /// Σ weight·value: R, G, B, then those of each light group.
    pub sums: Vec<i128>,
    /// Σ (weight·value)² of R, G, B and the luminance.
    pub squares: Vec<i128>,
}

/// The splats of a film.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Splats {
    /// The film has none.
    None,
    /// Of a tile.
    List(Vec<Entry>),
    /// Of a whole film.
    Sums(SplatSums),
}

impl Entry {
    /// Weighted values, cut to what can be summed.
    #[inline]
    fn values(&self, counters: &mut FilmCounters) -> [f64; 3] {
        self.rgb.map(|v| limit(f64::from(self.weight) * f64::from(v), LIMIT, counters))
    }
}

impl SplatSums {
    /// Nothing yet, for a number of pixels and of channels.
    pub fn new(pixels: usize, channels: usize) -> Self {
        Self { sums: vec![0; pixels * channels], squares: vec![0; pixels * SQUARES] }
    }

    fn add(&mut self, entry: &Entry, channels: usize) {
        // Counted when the entry was made.
        let mut counted = FilmCounters::default();
        let values = entry.values(&mut counted);
        let pixel = entry.pixel as usize;
        let sums = &mut self.sums[pixel * channels..][..channels];
        let group = 3 + 3 * entry.group as usize;
        for (c, &value) in values.iter().enumerate() {
            let value = fixed(value, SUM_BITS);
            sums[c] = sums[c].wrapping_add(value);
            if let Some(sum) = sums.get_mut(group + c) {
                *sum = sum.wrapping_add(value);
            }
        }
        let squares = &mut self.squares[pixel * SQUARES..][..SQUARES];
        for (square, value) in squares.iter_mut().zip(squared(values, &mut counted)) {
            *square = square.wrapping_add(fixed(value, SQUARE_BITS));
        }
    }
}

/// Squares of R, G, B and the luminance.
#[inline]
fn squared([r, g, b]: [f64; 3], counters: &mut FilmCounters) -> [f64; SQUARES] {
    let luminance = 0.212_671 * r + 0.715_16 * g + 0.072_169 * b;
    [r, g, b, luminance].map(|v| {
        let v = limit(v, SQUARE_LIMIT, counters);
        v * v
    })
}

impl FilmSpec {
    /// The channels that splats go to: R, G, B and those of light groups; empty where the film has no splats.
    pub(super) fn splat_channels(&self) -> Vec<usize> {
        let takes = |i: usize| i < 3 || self.channels[i].name.starts_with("light.");
        if self.splats { (0..self.channels.len()).filter(|&i| takes(i)).collect() } else { Vec::new() }
    }
}

impl Film {
    /// Adds a splat to the pixel (x, y) in full-picture coordinates, with its filter weight; outside of the crop and in films without
    /// splats it is ignored. See [`crate::integrator::Splat`] for the scale.
    pub fn add_splat(&mut self, x: u32, y: u32, weight: f32, rgb: [f32; 3], group: u32) {
        let crop = self.layout.spec.crop;
        if matches!(self.splats, Splats::None) || !crop.contains(x, y) {
            return;
        }
        let counters = &mut self.counters;
        let weight = finite_or_zero(weight, counters);
        let entry = Entry { pixel: index(&crop, x, y), group, weight, rgb: rgb.map(|v| finite_or_zero(v, counters)) };
        let values = entry.values(counters);
        squared(values, counters);
        match &mut self.splats {
            Splats::None => {}
            Splats::List(list) => list.push(entry),
            Splats::Sums(sums) => sums.add(&entry, self.layout.splats.len()),
        }
    }

    /// Adds the splats of a film of the same spec.
    pub(super) fn merge_splats(&mut self, other: &Splats) {
        let channels = self.layout.splats.len();
        match (&mut self.splats, other) {
            (Splats::List(ours), Splats::List(theirs)) => ours.extend_from_slice(theirs),
            (Splats::Sums(sums), Splats::List(list)) => list.iter().for_each(|entry| sums.add(entry, channels)),
            (Splats::Sums(ours), Splats::Sums(theirs)) => {
                add_slices(&mut ours.sums, &theirs.sums);
                add_slices(&mut ours.squares, &theirs.squares);
            }
            (Splats::List(_), Splats::Sums(_)) => {
                // A tile that takes the sums of a whole film becomes one itself.
                let sums = self.splat_sums().into_owned();
                self.splats = Splats::Sums(sums);
                self.merge_splats(other);
            }
            (Splats::None, _) | (_, Splats::None) => {}
        }
    }

    /// The sums over the crop, of a tile's list as well; empty where the film has no splats.
    pub(super) fn splat_sums(&self) -> std::borrow::Cow<'_, SplatSums> {
        use std::borrow::Cow;
        match &self.splats {
            Splats::None => Cow::Owned(SplatSums::new(0, 0)),
            Splats::Sums(sums) => Cow::Borrowed(sums),
            Splats::List(list) => {
                let channels = self.layout.splats.len();
                let mut sums = SplatSums::new(self.layout.spec.crop.area() as usize, channels);
                list.iter().for_each(|entry| sums.add(entry, channels));
                Cow::Owned(sums)
            }
        }
    }

    /// One over the mean number of samples per pixel of the picture; 0 where there are none.
    fn splat_scale(&self) -> f64 {
        let samples = self.splat_samples();
        let pixels = f64::from(self.spec().width) * f64::from(self.spec().height);
        if samples > 0.0 { pixels / samples } else { 0.0 }
    }

    /// Number of samples, of all pixels together.
    fn splat_samples(&self) -> f64 {
        self.counts.iter().map(|&c| u64::from(c)).sum::<u64>() as f64
    }
}

/// What splats add to the pixels of a film's rectangle when it is developed.
pub(super) struct DevelopedSplats<'a> {
    film: &'a Film,
    sums: std::borrow::Cow<'a, SplatSums>,
    scale: f64,
    samples: f64,
}

impl<'a> DevelopedSplats<'a> {
    /// `None` where the film has no splats.
    pub fn new(film: &'a Film) -> Option<Self> {
        let has = !matches!(film.splats, Splats::None);
        has.then(|| Self { film, sums: film.splat_sums(), scale: film.splat_scale(), samples: film.splat_samples() })
    }

    /// The pixel of the crop that a pixel of the film's rectangle is.
    fn at(&self, pixel: usize) -> usize {
        let (rect, width) = (self.film.rect, self.film.rect.width() as usize);
        index(&self.film.spec().crop, rect.x0 + (pixel % width) as u32, rect.y0 + (pixel / width) as u32) as usize
    }

    /// The mean that splats add to a channel of the spec.
    pub fn mean(&self, pixel: usize, channel: usize) -> f64 {
        let channels = &self.film.layout.splats;
        let slot = channels.iter().position(|&c| c == channel);
        slot.map_or(0.0, |slot| self.sum(pixel, slot) * self.scale)
    }

    /// The mean luminance that splats add.
    pub fn luminance(&self, pixel: usize) -> f64 {
        (0.212_671 * self.sum(pixel, 0) + 0.715_16 * self.sum(pixel, 1) + 0.072_169 * self.sum(pixel, 2)) * self.scale
    }

    /// The variance that splats add; slot 0 to 2 = R, G, B, 3 = luminance. Each sample's splats are taken as independent, which they are
    /// nearly: few paths meet a pixel twice.
    pub fn variance(&self, pixel: usize, slot: usize) -> f64 {
        if self.samples < 2.0 {
            return f64::INFINITY;
        }
        let sum = if slot < 3 { self.sum(pixel, slot) * self.scale } else { self.luminance(pixel) };
        let squares = self.sums.squares[self.at(pixel) * SQUARES + slot] as f64 / SQUARE_ONE * self.scale * self.scale;
        ((squares - sum * sum / self.samples) * (self.samples / (self.samples - 1.0))).max(0.0)
    }

    fn sum(&self, pixel: usize, slot: usize) -> f64 {
        real(self.sums.sums[self.at(pixel) * self.film.layout.splats.len() + slot])
    }
}

#[inline]
fn index(crop: &Rect, x: u32, y: u32) -> u32 {
    // A film fits the memory, so its number of pixels fits as well.
    (y - crop.y0) * crop.width() + (x - crop.x0)
}
