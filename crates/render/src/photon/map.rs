//! Photon maps: what the photons of ranges of indices have left.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::Photon;
use super::file::Contents;
use super::trace::{Deposits, Keep, Tracer};
use crate::math::hash::hash_words;
use crate::scene::Scene;

/// Photons traced between looks at the memory budget and at who waits: at first, and at most.
const ROUNDS: [u64; 2] = [1 << 12, 1 << 16];
/// One of so many bytes of the budget is for what a round leaves before it is in the map.
const ROUND_SHARE: u64 = 8;
/// The coarsest thinning: one photon of a billion.
pub(super) const MAX_LEVEL: u32 = 30;
/// Memory that a photon takes in a map in use: its record and its place in the tree.
pub const BYTES_PER_PHOTON: u64 = size_of::<Photon>() as u64 + 1;

/// What maps must have in common to be merged.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapInfo {
    /// Names all of the scene that light depends on: everything but cameras, film and integrator.
    pub scene_hash: String,
    /// The seed of the photons.
    pub seed: u64,
    /// Longest path in scattering events.
    pub max_depth: Option<u32>,
}

/// The photons of a range of indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// First photon.
    pub begin: u64,
    /// Behind the last photon.
    pub end: u64,
    /// Records that they left on surfaces.
    pub surface: u64,
    /// Records that they left in media.
    pub volume: u64,
}

/// Why maps do not go together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MapError {
    /// Of other scenes, seeds or depths.
    #[error("the photon maps differ in {0}")]
    Different(&'static str),
    /// Photons would count twice.
    #[error("both photon maps hold photons {begin} to {end}")]
    Overlap {
        /// First common photon.
        begin: u64,
        /// Behind the last common photon.
        end: u64,
    },
}

/// What photons have left, in the order of their indices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotonMap {
    /// What it is of.
    pub info: MapInfo,
    segments: Vec<Segment>,
    level: u32,
    surface: Vec<Photon>,
    volume: Vec<Photon>,
}

impl PhotonMap {
    /// A map without photons.
    pub fn new(info: MapInfo) -> Self {
        Self { info, ..Self::default() }
    }

    /// With the segments of a file, whose records are still to come ([`Self::push`]).
    pub(super) fn empty(contents: &Contents) -> Self {
        let segments = contents.segments.iter().map(|s| Segment { surface: 0, volume: 0, ..*s }).collect();
        Self { segments, level: contents.level, ..Self::new(contents.info.clone()) }
    }

    /// Adds the next record of a segment, surfaces first.
    pub(super) fn push(&mut self, segment: usize, volume: bool, photon: Photon) {
        let (list, count) = match volume {
            false => (&mut self.surface, &mut self.segments[segment].surface),
            true => (&mut self.volume, &mut self.segments[segment].volume),
        };
        list.push(photon);
        *count += 1;
    }

    /// Records on surfaces.
    pub fn surface(&self) -> &[Photon] {
        &self.surface
    }

    /// Records in media.
    pub fn volume(&self) -> &[Photon] {
        &self.volume
    }

    /// The ranges that are there, in order, neighbors joined.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Thinning: one of 2^level records is kept, and stands for all.
    pub fn level(&self) -> u32 {
        self.level
    }

    /// Number of photons that were traced.
    pub fn traced(&self) -> u64 {
        self.segments.iter().map(|s| s.end - s.begin).sum()
    }

    /// What a record's power is multiplied by for its share of the scene's light; 0 for an empty map.
    pub fn scale(&self) -> f32 {
        match self.traced() {
            0 => 0.0,
            n => ((1u64 << self.level) as f64 / n as f64) as f32,
        }
    }

    /// Bytes that the map takes once it is in use.
    pub fn bytes(&self) -> u64 {
        (self.surface.len() + self.volume.len()) as u64 * BYTES_PER_PHOTON
    }

    /// The parts of a range that are not there.
    pub fn missing(&self, range: Range<u64>) -> Vec<Range<u64>> {
        let mut missing = Vec::new();
        let mut at = range.start;
        for s in self.segments.iter().filter(|s| s.end > range.start && s.begin < range.end) {
            if s.begin > at {
                missing.push(at..s.begin);
            }
            at = at.max(s.end);
        }
        if at < range.end {
            missing.push(at..range.end);
        }
        missing
    }

    /// Adds a map of other photons. The result does not depend on the order of merging; of two thinned maps the coarser thinning
    /// holds. Nothing changes on error.
    ///
    /// # Errors
    /// [`MapError`]
    pub fn merge(&mut self, mut other: Self) -> Result<(), MapError> {
        let (a, b) = (&self.info, &other.info);
        for (same, what) in
            [(a.scene_hash == b.scene_hash, "their scenes"), (a.seed == b.seed, "their seeds"), (a.max_depth == b.max_depth, "max_depth")]
        {
            if !same {
                return Err(MapError::Different(what));
            }
        }
        for s in &other.segments {
            if let Some(o) = self.segments.iter().find(|o| o.begin < s.end && s.begin < o.end) {
                return Err(MapError::Overlap { begin: s.begin.max(o.begin), end: s.end.min(o.end) });
            }
        }
        let level = self.level.max(other.level);
        self.thin(level);
        other.thin(level);
        if self.segments.last().map(|s| s.end) <= other.segments.first().map(|s| s.begin) || other.segments.is_empty() {
            // The usual case, without a copy of what is there.
            self.surface.append(&mut other.surface);
            self.volume.append(&mut other.volume);
            self.segments.append(&mut other.segments);
        } else {
            let mut parts: Vec<(Segment, &[Photon], &[Photon])> = Vec::new();
            for map in [&*self, &other] {
                let (mut surface, mut volume) = (&map.surface[..], &map.volume[..]);
                for &segment in &map.segments {
                    let (s, v);
                    (s, surface) = surface.split_at((segment.surface as usize).min(surface.len()));
                    (v, volume) = volume.split_at((segment.volume as usize).min(volume.len()));
                    parts.push((segment, s, v));
                }
            }
            parts.sort_by_key(|p| p.0.begin);
            let surface = parts.iter().flat_map(|p| p.1).copied().collect();
            let volume = parts.iter().flat_map(|p| p.2).copied().collect();
            let segments = parts.iter().map(|p| p.0).collect();
            (self.surface, self.volume, self.segments) = (surface, volume, segments);
        }
        self.join_segments();
        Ok(())
    }

    fn join_segments(&mut self) {
        self.segments.dedup_by(|next, s| {
            let joins = s.end == next.begin;
            if joins {
                *s = Segment { begin: s.begin, end: next.end, surface: s.surface + next.surface, volume: s.volume + next.volume };
            }
            joins
        });
    }

    /// Keeps one of 2^level records. Which ones is a function of the records alone, so it does not matter when it is done.
    pub fn thin(&mut self, level: u32) {
        let level = level.min(MAX_LEVEL);
        if level <= self.level {
            return;
        }
        self.level = level;
        for list in [0, 1] {
            let photons = if list == 0 { &mut self.surface } else { &mut self.volume };
            let (mut read, mut kept) = (0, 0);
            for segment in &mut self.segments {
                let count = if list == 0 { &mut segment.surface } else { &mut segment.volume };
                let first = kept;
                for _ in 0..*count {
                    if survives_thinning(&photons[read], level) {
                        photons[kept] = photons[read];
                        kept += 1;
                    }
                    read += 1;
                }
                *count = (kept - first) as u64;
            }
            photons.truncate(kept);
            photons.shrink_to_fit();
        }
    }

    /// The same where both together may take so many bytes: thins them before one is added to the other.
    ///
    /// # Errors
    /// [`MapError`]; the maps may be thinned then.
    pub fn merge_within(&mut self, mut other: Self, bytes: u64) -> Result<(), MapError> {
        let mut level = self.level.max(other.level);
        self.thin(level);
        other.thin(level);
        while self.bytes() + other.bytes() > bytes && level < MAX_LEVEL {
            level += 1;
            self.thin(level);
            other.thin(level);
        }
        self.merge(other)
    }

    /// The bytes of a budget that are for a map while it is traced or merged; the rest is for the work.
    pub fn room(budget: u64) -> u64 {
        budget - budget / ROUND_SHARE
    }

    /// Thins until the map takes at most so many bytes in use. Returns whether anything was lost.
    pub fn limit(&mut self, bytes: u64) -> bool {
        let level = self.level;
        while self.bytes() > bytes && self.level < MAX_LEVEL {
            self.thin(self.level + 1);
        }
        self.level > level
    }

    /// Traces the photons of a range that are not there. Stops early when told to, with whole rounds done: what is there then is a map of
    /// fewer photons, and the next call goes on. `budget` limits the memory in bytes, that of the work included: records are thinned where
    /// there are more.
    pub fn trace(
        &mut self,
        scene: &Scene,
        range: Range<u64>,
        budget: u64,
        is_cancelled: &(dyn Fn() -> bool + Sync),
        progress: &mut dyn FnMut(&Self, f64),
    ) {
        let tracer = Tracer::new(scene, self.info.seed, self.info.max_depth.unwrap_or(u32::MAX), Keep::ALL);
        self.trace_with(&tracer, 0, range, budget, is_cancelled, progress);
    }

    /// The same with a tracer of one's own, for one of its passes.
    pub fn trace_with(
        &mut self,
        tracer: &Tracer,
        pass: u32,
        range: Range<u64>,
        budget: u64,
        is_cancelled: &(dyn Fn() -> bool + Sync),
        progress: &mut dyn FnMut(&Self, f64),
    ) {
        let parts = self.missing(range);
        let total: u64 = parts.iter().map(|r| r.end - r.start).sum();
        let reserve = budget - Self::room(budget);
        let (mut done, mut round) = (0, ROUNDS[0]);
        for part in parts {
            let mut begin = part.start;
            while begin < part.end {
                if is_cancelled() {
                    return;
                }
                let end = (begin + round).min(part.end);
                let found = Self::of_range(self.info.clone(), begin, end, self.level, tracer.trace(pass, begin..end, self.level));
                // Its records are in memory twice: by task, and in order. Never much more of them than in the round before.
                let fitting = (end - begin).saturating_mul(reserve) / (2 * found.bytes()).max(1);
                round = fitting.min(2 * round).clamp(ROUNDS[0] / 4, ROUNDS[1]);
                // The ranges were missing and the information is the same.
                let merged = self.merge_within(found, budget - reserve);
                debug_assert!(merged.is_ok());
                done += end - begin;
                begin = end;
                progress(self, done as f64 / total as f64);
            }
        }
    }

    fn of_range(info: MapInfo, begin: u64, end: u64, level: u32, deposits: Deposits) -> Self {
        let segment = Segment { begin, end, surface: deposits.surface.len() as u64, volume: deposits.volume.len() as u64 };
        Self { info, segments: vec![segment], level, surface: deposits.surface, volume: deposits.volume }
    }

    /// The records, surfaces first.
    pub fn into_photons(self) -> (Vec<Photon>, Vec<Photon>) {
        (self.surface, self.volume)
    }
}

/// Whether a record is one of the few that stand for all: by its own bits, which photons do not share.
pub(super) fn survives_thinning(photon: &Photon, level: u32) -> bool {
    let words: [u64; 4] = bytemuck::cast(*photon);
    hash_words(words) & ((1 << level) - 1) == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::photon::Route;
    use crate::spectrum::Spectrum;

    fn info() -> MapInfo {
        MapInfo { scene_hash: "s".into(), seed: 1, max_depth: None }
    }

    /// Photon i leaves i % 3 records.
    fn map(begin: u64, end: u64) -> PhotonMap {
        let record =
            |i: u64, k: u64| Photon::new(Vec3::new(i as f32, k as f32, 0.5), Vec3::Z, Vec3::Z, Spectrum::ONE, 0, k as u32, Route::Direct);
        let surface = (begin..end).flat_map(|i| (0..i % 3).map(move |k| record(i, k))).collect();
        let volume = (begin..end).filter(|i| i % 5 == 0).map(|i| record(i, 9)).collect();
        PhotonMap::of_range(info(), begin, end, 0, Deposits { surface, volume, ..Deposits::default() })
    }

    #[test]
    fn any_order_of_merging_gives_the_map_of_one_run() {
        let whole = map(0, 1000);
        let cuts = [(0, 100), (100, 101), (101, 640), (640, 1000)];
        for order in [[0, 1, 2, 3], [3, 2, 1, 0], [2, 0, 3, 1], [1, 3, 0, 2]] {
            let mut total = PhotonMap::new(info());
            for i in order {
                total.merge(map(cuts[i].0, cuts[i].1)).unwrap();
            }
            assert_eq!(total, whole);
        }
        assert_eq!(whole.segments().len(), 1);
    }

    #[test]
    fn thinning_may_come_before_or_after_merging() {
        let mut whole = map(0, 30_000);
        whole.thin(3);
        let mut a = map(0, 10_000);
        a.thin(3);
        a.merge(map(10_000, 30_000)).unwrap();
        assert_eq!(a, whole);
        let mut b = map(10_000, 30_000);
        b.thin(1);
        let mut c = map(0, 10_000);
        c.thin(3);
        b.merge(c).unwrap();
        assert_eq!(b, whole);
        // One of eight, within five standard deviations, and the power is the same.
        let n = map(0, 30_000).surface().len() as f64;
        let kept = whole.surface().len() as f64;
        assert!((kept - n / 8.0).abs() < 5.0 * (n * 7.0 / 64.0).sqrt(), "{kept} of {n}");
        assert_eq!(whole.scale(), 8.0 / 30_000.0);
    }

    #[test]
    fn budgets_hold() {
        for budget in [0, 1, 1000, 100_000, u64::MAX] {
            let mut m = map(0, 10_000);
            assert_eq!(m.limit(budget), budget < m.bytes().max(map(0, 10_000).bytes()));
            assert!(m.bytes() <= budget || m.surface().len() + m.volume().len() < 5, "{budget}: {}", m.bytes());
        }
    }

    #[test]
    fn what_does_not_belong_together_is_refused() {
        let mut m = map(0, 100);
        let before = m.clone();
        assert_eq!(m.merge(map(50, 150)), Err(MapError::Overlap { begin: 50, end: 100 }));
        let mut other = map(100, 200);
        other.info.seed = 2;
        assert_eq!(m.merge(other), Err(MapError::Different("their seeds")));
        assert_eq!(m, before);
        m.merge(map(200, 300)).unwrap();
        assert_eq!(m.missing(50..400), [100..200, 300..400]);
        assert_eq!(m.missing(0..100), []);
    }
}
