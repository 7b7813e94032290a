//! What a film records, where its samples come from, and what can be wrong with either.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::filter::Filter;
use super::held::Rect;
use crate::classic::WorkingSpace;

/// How a channel's samples become a pixel's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelKind {
    /// The filter-weighted mean of the samples.
    Mean,
    /// The value of the sample with the lowest index: for ids, whose mean would mean nothing.
    First,
}

/// A plane of the film.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channel {
    /// The field's name, as in EXR files: `R`, `albedo.G`, `Z`, `id.object` …
    pub name: String,
    /// How samples are combined.
    pub kind: ChannelKind,
}

impl Channel {
    /// A channel of means.
    pub fn mean(name: impl Into<String>) -> Self {
        Self { name: name.into(), kind: ChannelKind::Mean }
    }

    /// A channel of first values.
    pub fn first(name: impl Into<String>) -> Self {
        Self { name: name.into(), kind: ChannelKind::First }
    }
}

/// What a film records: two films merge only if their specs are equal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilmSpec {
    /// Columns of the full picture.
    pub width: u32,
    /// Rows of the full picture.
    pub height: u32,
    /// The part of the picture that is rendered and stored.
    pub crop: Rect,
    /// The reconstruction filter (camera samples must be drawn by its [`FilterSampler`](super::FilterSampler)).
    pub filter: Filter,
    /// The planes: always `R`, `G`, `B` (means) first; then `A`, light groups and AOVs.
    pub channels: Vec<Channel>,
    /// The space in which samples of `R`, `G` and `B` are stored and averaged; pictures are developed to linear light.
    #[serde(default)]
    pub space: WorkingSpace,
    /// Whether samples also bring light to other pixels ([`Film::add_splat`](super::Film::add_splat)).
    #[serde(default, skip_serializing_if = "is_false")]
    pub splats: bool,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde asks for")]
fn is_false(v: &bool) -> bool {
    !v
}

/// Most columns or rows of a picture.
pub const MAX_SIDE: u32 = 1 << 20;
/// Most planes of a film.
pub const MAX_CHANNELS: usize = 1024;

impl FilmSpec {
    /// A whole picture of R, G, B and A under the default filter.
    pub fn new(width: u32, height: u32) -> Self {
        let channels = ["R", "G", "B", "A"].map(Channel::mean).to_vec();
        let crop = Rect::new(0, 0, width, height);
        Self { width, height, crop, filter: Filter::default(), channels, space: WorkingSpace::Linear, splats: false }
    }

    /// Checks sizes, crop, filter and channels.
    ///
    /// # Errors
    /// [`FilmError::Spec`] with the first fault.
    pub fn validate(&self) -> Result<(), FilmError> {
        let fault = |what: String| Err(FilmError::Spec(what));
        if self.width == 0 || self.height == 0 || self.width > MAX_SIDE || self.height > MAX_SIDE {
            return fault(format!("size {}x{} is not within 1 to {MAX_SIDE} on each side", self.width, self.height));
        }
        if self.crop.area() == 0 || !Rect::new(0, 0, self.width, self.height).contains_rect(&self.crop) {
            return fault(format!("crop {} is empty or not within the picture", self.crop));
        }
        if !self.filter.is_valid() {
            return fault(format!("filter {:?} has unusable parameters", self.filter));
        }
        let first: Vec<_> = self.channels.iter().take(3).map(|c| (c.name.as_str(), c.kind)).collect();
        if first != ["R", "G", "B"].map(|n| (n, ChannelKind::Mean)) {
            return fault("the first channels are not R, G and B".into());
        }
        if self.channels.len() > MAX_CHANNELS {
            return fault(format!("{} channels are more than {MAX_CHANNELS}", self.channels.len()));
        }
        let mut names: Vec<_> = self.channels.iter().map(|c| c.name.as_str()).collect();
        names.sort_unstable();
        if names.windows(2).any(|w| w[0] == w[1]) || names.iter().any(|n| n.is_empty() || n.len() > 255) {
            return fault("channel names are not unique, or empty, or longer than 255 bytes".into());
        }
        if self.splats && self.space != WorkingSpace::Linear {
            return fault("splats are sums of linear light".into());
        }
        if self.splats && self.crop.area() > u64::from(u32::MAX) {
            return fault("more pixels than splats can tell apart".into());
        }
        Ok(())
    }
}

/// Where a film's samples come from. All but `render_ms` and `notes` must agree for a merge.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FilmMeta {
    /// A hash of the compiled scene.
    pub scene_hash: String,
    /// A hash of all settings that change sample values (not of sample counts, threads or tiles).
    pub settings_hash: String,
    /// The seed of the random numbers.
    pub seed: u64,
    /// The integrator's name.
    pub integrator: String,
    /// The program and version that rendered.
    pub renderer: String,
    /// Time spent rendering, in milliseconds; summed by merges.
    pub render_ms: u64,
    /// Anything else, for people; merges keep the notes of both, the first film's where they collide.
    pub notes: BTreeMap<String, String>,
}

/// Numeric oddities met so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FilmCounters {
    /// Values (or weights) that were NaN or infinite and counted as 0.
    pub non_finite: u64,
    /// Values beyond ±2^40 (whose squares: ±2^32) that were cut to that.
    pub saturated: u64,
}

/// Why films cannot be made or merged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilmError {
    /// The spec contradicts itself.
    #[error("film: {0}")]
    Spec(String),
    /// The films do not belong together.
    #[error("films differ in {what}: {ours} and {theirs}")]
    Mismatch {
        /// The property.
        what: &'static str,
        /// Its value in the film merged into.
        ours: String,
        /// Its value in the other film.
        theirs: String,
    },
    /// Both films hold some of the same samples; their sum would count them twice.
    #[error("both films hold samples {begin}..{end} of pixels {rect}")]
    Overlap {
        /// Common pixels.
        rect: Rect,
        /// First common sample index.
        begin: u32,
        /// One past the last.
        end: u32,
    },
    /// A rectangle does not lie within the film.
    #[error("pixels {inner} are not within the film's {outer}")]
    Outside {
        /// The rectangle.
        inner: Rect,
        /// The film's.
        outer: Rect,
    },
}
