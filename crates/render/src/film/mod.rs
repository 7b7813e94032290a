//! The film: a mergeable accumulator whose sums are exact.
//!
//! Every sum is fixed point in 128-bit integers (docs/decisions/0002-exact-film.md). Integer addition is associative
//! and commutative, so a film's bits do not depend on threads, tiles, order, machines, checkpoints or on how the
//! sample range was split. What a session must do for that: give each (pixel, sample index) pair to one film once.
//!
//! A film covers a rectangle of the picture. Workers fill small films ([`Film::new_tile`]), declare what they hold
//! ([`Film::mark_held`]) and [`Film::merge`] them into the whole one; whole films of different sample ranges
//! merge in the same way, in memory or from files ([`file`]).

mod develop;
pub mod file;
pub mod filter;
mod held;
mod plain;
mod spec;
mod splat;

use std::sync::Arc;

pub use develop::DevelopOptions;
pub use filter::{Filter, FilterSample, FilterSampler};
pub use held::{Held, HeldSamples, Rect};
pub use spec::{Channel, ChannelKind, FilmCounters, FilmError, FilmMeta, FilmSpec, MAX_CHANNELS, MAX_SIDE};
use splat::{SplatSums, Splats};

/// Fractional bits of sums, and what they make of 1.
const SUM_BITS: i32 = 64;
const SUM_ONE: f64 = 18_446_744_073_709_551_616.0;
/// Fractional bits of sums of squares, and what they make of 1.
const SQUARE_BITS: i32 = 40;
const SQUARE_ONE: f64 = 1_099_511_627_776.0;
/// Largest magnitude that is summed: leaves room for 2^23 samples a pixel of that size.
const LIMIT: f64 = 1_099_511_627_776.0;
/// Largest magnitude whose square is summed: leaves room for 2^23 samples as well.
const SQUARE_LIMIT: f64 = 4_294_967_296.0;
/// No sample yet.
const NO_INDEX: u32 = u32::MAX;
/// Sums of squares of a pixel: R, G, B, luminance.
const SQUARES: usize = 4;

/// Where each channel's values go.
#[derive(Debug, PartialEq)]
struct Layout {
    spec: FilmSpec,
    /// Indices into the channels, of each kind.
    means: Vec<usize>,
    firsts: Vec<usize>,
    /// Those that splats go to.
    splats: Vec<usize>,
}

/// The accumulator of a rectangle of pixels; see the module.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    layout: Arc<Layout>,
    rect: Rect,
    /// Where the samples come from.
    pub meta: FilmMeta,
    held: Held,
    counters: FilmCounters,
    /// Σ weight·value, pixel by pixel, the mean channels side by side.
    sums: Vec<i128>,
    /// Σ (weight·value)² of R, G, B and the luminance; empty where they are not kept.
    squares: Vec<i128>,
    /// Σ weight; empty in plain films.
    weights: Vec<i128>,
    /// Values of the pixels of plain films that have one sample; empty in others. See [`plain`].
    singles: Vec<[f32; 4]>,
    /// Number of samples.
    counts: Vec<u32>,
    /// Lowest sample index so far (only with first channels).
    first_indices: Vec<u32>,
    /// Its values, the first channels side by side.
    first_values: Vec<f32>,
    /// Light for other pixels, over the whole crop.
    splats: Splats,
}

impl Film {
    /// An empty film of the spec's crop.
    ///
    /// # Errors
    /// As [`FilmSpec::validate`].
    pub fn new(spec: FilmSpec) -> Result<Self, FilmError> {
        let rect = spec.crop;
        Self::tile(&spec, rect)
    }

    /// An empty film of a rectangle of the spec's crop.
    ///
    /// # Errors
    /// As [`FilmSpec::validate`], and [`FilmError::Outside`].
    pub fn tile(spec: &FilmSpec, rect: Rect) -> Result<Self, FilmError> {
        let mut film = Self::with_layout(Layout::new(spec)?, rect, FilmMeta::default(), true)?;
        film.sum_splats()?;
        Ok(film)
    }

    /// An empty film of a rectangle of this film, with its spec and meta data (but no render time): a worker's tile.
    ///
    /// # Errors
    /// [`FilmError::Outside`].
    pub fn new_tile(&self, rect: Rect) -> Result<Self, FilmError> {
        let meta = FilmMeta { render_ms: 0, ..self.meta.clone() };
        let mut tile = Self::with_layout(Arc::clone(&self.layout), rect, meta, self.has_squares())?;
        if self.is_plain() {
            tile.become_plain();
        }
        Ok(tile)
    }

    /// Keeps no sums of squares any more, which takes half of the memory and of the time of a sample: all variances are infinite, and
    /// the film cannot be written to a file. For films of which nothing but the picture is wanted.
    pub fn drop_squares(&mut self) {
        self.squares = Vec::new();
        self.become_plain();
    }

    /// Whether sums of squares are kept: false after [`Film::drop_squares`].
    pub fn has_squares(&self) -> bool {
        !self.squares.is_empty()
    }

    /// Empties the film and moves it to another rectangle of the same size, to be used again; false where that does not fit.
    pub fn empty_for(&mut self, rect: Rect) -> bool {
        let same = (rect.width(), rect.height()) == (self.rect.width(), self.rect.height());
        if !same || !self.layout.spec.crop.contains_rect(&rect) {
            return false;
        }
        self.rect = rect;
        self.held = Held::default();
        self.counters = FilmCounters::default();
        if self.is_plain() {
            self.empty_plain();
        } else {
            self.sums.fill(0);
        }
        self.squares.fill(0);
        self.weights.fill(0);
        self.counts.fill(0);
        self.first_indices.fill(NO_INDEX);
        self.first_values.fill(0.0);
        if let Splats::List(list) = &mut self.splats {
            list.clear();
        }
        !matches!(self.splats, Splats::Sums(_))
    }

    fn with_layout(layout: Arc<Layout>, rect: Rect, meta: FilmMeta, has_squares: bool) -> Result<Self, FilmError> {
        if rect.area() == 0 || !layout.spec.crop.contains_rect(&rect) {
            return Err(FilmError::Outside { inner: rect, outer: layout.spec.crop });
        }
        let pixels = rect.area() as usize;
        let bytes_per_pixel = layout.bytes_per_pixel();
        if pixels.checked_mul(bytes_per_pixel).is_none_or(|bytes| bytes > isize::MAX as usize) {
            return Err(FilmError::Spec(format!("{rect} needs more memory than there is")));
        }
        let firsts = layout.firsts.len();
        Ok(Self {
            rect,
            meta,
            held: Held::default(),
            counters: FilmCounters::default(),
            sums: vec![0; pixels * layout.means.len()],
            squares: if has_squares { vec![0; pixels * SQUARES] } else { Vec::new() },
            weights: vec![0; pixels],
            singles: Vec::new(),
            counts: vec![0; pixels],
            first_indices: if firsts > 0 { vec![NO_INDEX; pixels] } else { Vec::new() },
            first_values: vec![0.0; pixels * firsts],
            splats: if layout.spec.splats { Splats::List(Vec::new()) } else { Splats::None },
            layout,
        })
    }

    /// Turns the list of splats, which must be empty, into sums.
    fn sum_splats(&mut self) -> Result<(), FilmError> {
        if self.layout.spec.splats {
            let pixels = self.layout.spec.crop.area() as usize;
            if pixels.checked_mul(self.layout.bytes_per_splat_pixel()).is_none_or(|bytes| bytes > isize::MAX as usize) {
                return Err(FilmError::Spec(format!("{} needs more memory than there is", self.layout.spec.crop)));
            }
            self.splats = Splats::Sums(SplatSums::new(pixels, self.layout.splats.len()));
        }
        Ok(())
    }

    /// Bytes that one pixel takes in memory, splats included.
    pub fn bytes_per_pixel(&self) -> usize {
        self.layout.bytes_per_pixel() + self.layout.bytes_per_splat_pixel()
    }

    /// What the film records.
    pub fn spec(&self) -> &FilmSpec {
        &self.layout.spec
    }

    /// The pixels that it covers, in full-picture coordinates.
    pub fn rect(&self) -> Rect {
        self.rect
    }

    /// Numeric oddities met so far.
    pub fn counters(&self) -> FilmCounters {
        self.counters
    }

    /// The samples that it was declared to hold.
    pub fn held(&self) -> &Held {
        &self.held
    }

    /// Ranges of sample indices [begin, end) that every pixel of this film holds.
    pub fn ranges(&self) -> Vec<[u32; 2]> {
        self.held.entries().iter().filter(|e| e.rect == self.rect).map(|e| [e.begin, e.end]).collect()
    }

    /// The number of samples of a pixel in full-picture coordinates; 0 outside.
    pub fn sample_count(&self, x: u32, y: u32) -> u32 {
        if self.rect.contains(x, y) { self.counts[self.pixel(x, y)] } else { 0 }
    }

    /// The mean number of samples of a pixel.
    pub fn mean_sample_count(&self) -> f64 {
        self.counts.iter().map(|&n| f64::from(n)).sum::<f64>() / self.counts.len() as f64
    }

    /// The largest number of samples of a pixel that it was declared to hold. A pixel may have fewer, where it is smooth or its error small,
    /// and more, where a method has planned that; the mean is about this one then.
    pub fn declared_spp(&self) -> u32 {
        // What begins and ends at each pixel, summed over rows and columns: parts may have been cut in many ways.
        let columns = self.rect.width() as usize + 1;
        let mut steps = vec![0i64; columns * (self.rect.height() as usize + 1)];
        for e in self.held.entries() {
            let [x, y] = [e.rect.x0 - self.rect.x0, e.rect.y0 - self.rect.y0].map(|v| v as usize);
            let (width, height, count) = (e.rect.width() as usize, e.rect.height() as usize, i64::from(e.end - e.begin));
            for (x, y, step) in [(x, y, count), (x + width, y, -count), (x, y + height, -count), (x + width, y + height, count)] {
                steps[y * columns + x] += step;
            }
        }
        let mut above = vec![0i64; columns];
        let mut most = 0;
        for row in steps.chunks_exact(columns) {
            let mut sum = 0;
            for (total, step) in above.iter_mut().zip(row) {
                sum += step;
                *total += sum;
                most = most.max(*total);
            }
        }
        u32::try_from(most).unwrap_or(u32::MAX)
    }

    #[inline]
    fn pixel(&self, x: u32, y: u32) -> usize {
        (y - self.rect.y0) as usize * self.rect.width() as usize + (x - self.rect.x0) as usize
    }

    /// Adds sample `sample_index` of the pixel (x, y) in full-picture coordinates, with its filter weight and one
    /// value for each channel of the spec in order. Missing values count as 0; a pixel outside of the film is ignored.
    #[inline]
    pub fn add_sample(&mut self, x: u32, y: u32, sample_index: u32, weight: f32, values: &[f32]) {
        debug_assert_eq!(values.len(), self.layout.spec.channels.len());
        if !self.rect.contains(x, y) {
            return;
        }
        let pixel = self.pixel(x, y);
        if self.is_plain() {
            if weight == 1.0 {
                self.add_plain(pixel, values);
                return;
            }
            self.widen();
        }
        let counters = &mut self.counters;
        let weight = f64::from(finite_or_zero(weight, counters));
        let means = &self.layout.means;
        let sums = &mut self.sums[pixel * means.len()..][..means.len()];
        let mut rgb = [0.0; 3];
        for (slot, (sum, &channel)) in sums.iter_mut().zip(means).enumerate() {
            // A product of two f32 is exact in f64.
            let value = weight * f64::from(finite_or_zero(values.get(channel).copied().unwrap_or(0.0), counters));
            let value = limit(value, LIMIT, counters);
            *sum = sum.wrapping_add(fixed(value, SUM_BITS));
            if slot < 3 {
                rgb[slot] = value;
            }
        }
        let luminance = 0.212_671 * rgb[0] + 0.715_16 * rgb[1] + 0.072_169 * rgb[2];
        if let Some(squares) = self.squares.get_mut(pixel * SQUARES..(pixel + 1) * SQUARES) {
            for (square, value) in squares.iter_mut().zip([rgb[0], rgb[1], rgb[2], luminance]) {
                let value = limit(value, SQUARE_LIMIT, counters);
                *square = square.wrapping_add(fixed(value * value, SQUARE_BITS));
            }
        }
        self.weights[pixel] = self.weights[pixel].wrapping_add(fixed(limit(weight, LIMIT, counters), SUM_BITS));
        self.counts[pixel] = self.counts[pixel].wrapping_add(1);
        if !self.layout.firsts.is_empty() {
            let firsts = self.layout.firsts.iter().map(|&c| values.get(c).copied().unwrap_or(0.0));
            // Counted whether they stay or not: the counters must not depend on the order either.
            self.counters.non_finite += firsts.clone().filter(|v| !v.is_finite()).count() as u64;
            let firsts = firsts.map(|v| if v.is_finite() { v } else { 0.0 });
            let slots = &mut self.first_values[pixel * self.layout.firsts.len()..][..self.layout.firsts.len()];
            keep_first(&mut self.first_indices[pixel], slots, sample_index, firsts);
        }
    }

    /// Declares that every pixel of `rect` has received its samples `begin..end`.
    ///
    /// # Errors
    /// [`FilmError::Outside`]; [`FilmError::Overlap`] where some are declared already.
    pub fn mark_held(&mut self, rect: Rect, begin: u32, end: u32) -> Result<(), FilmError> {
        if !self.rect.contains_rect(&rect) {
            return Err(FilmError::Outside { inner: rect, outer: self.rect });
        }
        let new = HeldSamples { rect, begin, end };
        self.check_overlap(&new)?;
        self.held.insert(new, &self.rect);
        Ok(())
    }

    fn check_overlap(&self, new: &HeldSamples) -> Result<(), FilmError> {
        match self.held.find_overlap(new) {
            Some(old) => Err(FilmError::Overlap {
                rect: old.rect.intersection(&new.rect),
                begin: old.begin.max(new.begin),
                end: old.end.min(new.end),
            }),
            None => Ok(()),
        }
    }

    /// Adds all samples of `other`, a film of the same spec for the same pixels or for some of them. Exact: any order
    /// and any grouping of merges gives the same bits. Nothing is changed on error. Cost: one addition for each sum.
    ///
    /// # Errors
    /// [`FilmError::Mismatch`] where spec or origin differ, [`FilmError::Outside`], [`FilmError::Overlap`].
    pub fn merge(&mut self, other: &Self) -> Result<(), FilmError> {
        self.check_mergeable(other)?;
        for &part in other.held.entries() {
            self.held.insert(part, &self.rect);
        }
        self.counters.non_finite += other.counters.non_finite;
        self.counters.saturated += other.counters.saturated;
        self.meta.render_ms = self.meta.render_ms.saturating_add(other.meta.render_ms);
        for (key, value) in &other.meta.notes {
            self.meta.notes.entry(key.clone()).or_insert_with(|| value.clone());
        }
        if self.is_plain() && other.is_plain() {
            self.merge_plain(other);
            return Ok(());
        }
        self.widen();
        if other.is_plain() {
            let mut wide = other.clone();
            wide.widen();
            self.merge_sums(&wide);
        } else {
            self.merge_sums(other);
        }
        Ok(())
    }

    /// [`Film::merge`] of what is summed, where neither film is plain.
    fn merge_sums(&mut self, other: &Self) {
        self.merge_splats(&other.splats);
        let width = other.rect.width() as usize;
        let (means, firsts) = (self.layout.means.len(), self.layout.firsts.len());
        for y in other.rect.y0..other.rect.y1 {
            let (ours, theirs) = (self.pixel(other.rect.x0, y), other.pixel(other.rect.x0, y));
            for i in 0..width {
                // Pixels without samples have nothing to add.
                let (a, b) = (ours + i, theirs + i);
                if other.counts[b] == 0 {
                    continue;
                }
                add_slices(&mut self.sums[a * means..], &other.sums[b * means..][..means]);
                if !self.squares.is_empty() {
                    add_slices(&mut self.squares[a * SQUARES..], &other.squares[b * SQUARES..][..SQUARES]);
                }
                self.weights[a] = self.weights[a].wrapping_add(other.weights[b]);
                self.counts[a] = self.counts[a].wrapping_add(other.counts[b]);
            }
            if firsts > 0 {
                for i in 0..width {
                    let values = other.first_values[(theirs + i) * firsts..][..firsts].iter().copied();
                    let slots = &mut self.first_values[(ours + i) * firsts..][..firsts];
                    keep_first(&mut self.first_indices[ours + i], slots, other.first_indices[theirs + i], values);
                }
            }
        }
    }

    /// The checks of [`Film::merge`] alone.
    ///
    /// # Errors
    /// As there.
    pub fn check_mergeable(&self, other: &Self) -> Result<(), FilmError> {
        let differ = |what, ours: &dyn std::fmt::Debug, theirs: &dyn std::fmt::Debug| {
            Err(FilmError::Mismatch { what, ours: format!("{ours:?}"), theirs: format!("{theirs:?}") })
        };
        let (a, b) = (self.spec(), other.spec());
        if [a.width, a.height] != [b.width, b.height] {
            return differ("size", &[a.width, a.height], &[b.width, b.height]);
        }
        if a.crop != b.crop {
            return differ("crop", &a.crop, &b.crop);
        }
        if a.filter != b.filter {
            return differ("filter", &a.filter, &b.filter);
        }
        if a.channels != b.channels {
            let names = |s: &FilmSpec| s.channels.iter().map(|c| c.name.clone()).collect::<Vec<_>>().join(" ");
            return differ("channels", &names(a), &names(b));
        }
        if a.splats != b.splats {
            return differ("splats", &a.splats, &b.splats);
        }
        let (m, n) = (&self.meta, &other.meta);
        if m.scene_hash != n.scene_hash {
            return differ("scene", &m.scene_hash, &n.scene_hash);
        }
        if m.integrator != n.integrator {
            return differ("integrator", &m.integrator, &n.integrator);
        }
        if m.settings_hash != n.settings_hash {
            return differ("settings", &m.settings_hash, &n.settings_hash);
        }
        if m.seed != n.seed {
            return differ("seed", &m.seed, &n.seed);
        }
        if m.renderer != n.renderer {
            return differ("renderer version", &m.renderer, &n.renderer);
        }
        if self.has_squares() && !other.has_squares() {
            return differ("error estimate", &true, &false);
        }
        if !self.rect.contains_rect(&other.rect) {
            return Err(FilmError::Outside { inner: other.rect, outer: self.rect });
        }
        other.held.entries().iter().try_for_each(|part| self.check_overlap(part))
    }
}

impl Layout {
    fn new(spec: &FilmSpec) -> Result<Arc<Self>, FilmError> {
        spec.validate()?;
        let of_kind = |kind| (0..spec.channels.len()).filter(|&i| spec.channels[i].kind == kind).collect();
        let (means, firsts) = (of_kind(ChannelKind::Mean), of_kind(ChannelKind::First));
        Ok(Arc::new(Self { spec: spec.clone(), means, firsts, splats: spec.splat_channels() }))
    }

    /// Bytes of the splats of one pixel of the crop.
    fn bytes_per_splat_pixel(&self) -> usize {
        if self.spec.splats { 16 * (self.splats.len() + SQUARES) } else { 0 }
    }

    fn bytes_per_pixel(&self) -> usize {
        let firsts = if self.firsts.is_empty() { 0 } else { 4 + 4 * self.firsts.len() };
        16 * (self.means.len() + SQUARES + 1) + 4 + firsts
    }
}

#[inline]
fn finite_or_zero(v: f32, counters: &mut FilmCounters) -> f32 {
    if v.is_finite() {
        v
    } else {
        counters.non_finite += 1;
        0.0
    }
}

#[inline]
fn limit(v: f64, limit: f64, counters: &mut FilmCounters) -> f64 {
    if v.abs() >= limit {
        counters.saturated += 1;
        limit.copysign(v)
    } else {
        v
    }
}

/// v · 2^bits, truncated toward zero: `(v * 2^bits) as i128` without the call that it compiles to. |v| · 2^bits must be
/// below 2^116 and v finite.
#[inline]
fn fixed(v: f64, bits: i32) -> i128 {
    let pattern = v.to_bits();
    let exponent = ((pattern >> 52) & 0x7ff) as i32;
    let mantissa = (pattern & ((1 << 52) - 1)) | (1 << 52);
    let shift = exponent - 1075 + bits;
    let magnitude = if shift >= 0 {
        debug_assert!(shift < 64);
        i128::from(mantissa) << (shift & 63)
    } else {
        // Zero and subnormal numbers end here, with a shift that leaves nothing.
        i128::from(mantissa >> (-shift).min(63))
    };
    let sign = i128::from(pattern as i64 >> 63);
    (magnitude ^ sign) - sign
}

/// The number of a sum with [`SUM_BITS`]: `sum as f64 / SUM_ONE` to its last bit or next to it, without the call that it compiles to.
#[inline]
fn real(sum: i128) -> f64 {
    let magnitude = sum.unsigned_abs();
    let value = ((magnitude >> 64) as u64) as f64 + (magnitude as u64) as f64 / SUM_ONE;
    if sum < 0 { -value } else { value }
}

#[inline]
fn add_slices(a: &mut [i128], b: &[i128]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a = a.wrapping_add(*b);
    }
}

/// Replaces index and values if the new index is lower. A sample index that comes twice is an error of the caller;
/// the smaller values win then, so that even this does not depend on the order.
#[inline]
fn keep_first(index: &mut u32, slots: &mut [f32], new_index: u32, values: impl Iterator<Item = f32>) {
    if new_index > *index || new_index == NO_INDEX {
        return;
    }
    let lower = new_index < *index;
    *index = new_index;
    for (slot, value) in slots.iter_mut().zip(values) {
        if lower || value.total_cmp(slot).is_lt() {
            *slot = value;
        }
    }
}

#[cfg(test)]
mod tests;
