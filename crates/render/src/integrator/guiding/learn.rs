//! Paths that learn where light comes from.

use rayon::prelude::*;

use super::field::{Field, NONE, Sample, side};
use super::quadtree::square_from_direction;
use super::{Guide, can_guide};
use crate::integrator::splitting::Probe;
use crate::integrator::{Estimate, Path, Stage};
use crate::material::Scatter;
use crate::math::hash::mix64;
use crate::math::{Vec2, Vec3};
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Paths for each pixel, and at most.
const PATHS_OF_PIXEL: u64 = 4;
const LEAST_PATHS: u64 = 1 << 12;
const MOST_PATHS: u64 = 1 << 19;
/// Each round has twice the paths of all before it together, guided by what those have learned.
pub(super) const ROUNDS: u32 = 4;
/// Paths that are traced one after the other, and samples from which on no more of them are: 200 MB in all chunks.
const CHUNK: u64 = 1024;
const MOST_SAMPLES: usize = 8192;
/// Columns of the paths' random numbers.
const COLUMNS: u64 = 4096;
/// The random numbers are not those of the picture.
const SEED: u64 = 0x9d1d_1e55_0fba_7b50;

/// A vertex of a path under way.
#[derive(Clone, Copy, Debug)]
pub(in crate::integrator) struct Lesson {
    p: Vec3,
    side: u8,
    /// Whether the light sent back is much the same for all directions.
    even: bool,
    /// Light found, and what the path then carried: before the vertex, and as it went on from it.
    before: [f32; 2],
    after: [f32; 2],
    /// Light found with the vertex's direct light.
    direct: f32,
    /// The same with what the next edge meets of lights that shadow rays find as well.
    straight: f32,
    at: Vec2,
    factor: f32,
    /// How many more guided paths come here than others would.
    guided: f32,
}

impl Lesson {
    /// A path has come to a surface, and has found the light that it emits.
    #[inline]
    pub fn at(s: &Surface, scatter: &Scatter, wo: Vec3, throughput: Spectrum, guided: f32, out: &Estimate) -> Option<Self> {
        let n = facing(s, wo);
        let before = [out.radiance.luminance(), throughput.luminance()];
        can_guide(scatter).then(|| Self {
            p: s.p,
            side: side(n),
            even: scatter.has_diffuse() && !scatter.has_null(),
            before,
            after: before,
            direct: before[0],
            straight: before[0],
            at: Vec2::ZERO,
            factor: 0.0,
            guided,
        })
    }

    /// How much larger the mean square of the direct light found here is where paths are not guided, who find it more rarely.
    pub fn rarer(&self) -> f32 {
        let direct = self.direct - self.before[0];
        direct * direct * (self.guided - 1.0)
    }

    /// The direct light at the surface has been found.
    #[inline]
    pub fn lit(&mut self, out: &Estimate) {
        self.direct = out.radiance.luminance();
        self.straight = self.direct;
    }

    /// The path has met a light that a shadow ray may find.
    #[inline]
    pub fn met(&mut self, out: &Estimate) {
        self.straight = out.radiance.luminance();
    }

    /// How much of the light that a path has found in all has come here by other surfaces.
    pub fn indirect(&self, found: f32) -> f32 {
        found - self.straight
    }

    /// It goes on, by a direction of a density per solid angle that is infinite for delta lobes.
    #[inline]
    pub fn leave(&mut self, cos: f32, wi: Vec3, pdf: f32, throughput: Spectrum, out: &Estimate) {
        self.after = [out.radiance.luminance(), throughput.luminance()];
        self.at = square_from_direction(wi);
        self.factor = cos.abs() / pdf;
    }
}

/// The geometric normal on the side of a direction.
#[inline]
pub(super) fn facing(s: &Surface, wo: Vec3) -> Vec3 {
    if s.ng.dot(wo) < 0.0 { -s.ng } else { s.ng }
}

/// Adds the vertices of a path that has found so much light; `lessons` is empty afterwards.
fn conclude(lessons: &mut Vec<Lesson>, found: f32, samples: &mut Vec<Sample>) {
    let first = samples.len() as u32;
    for (i, l) in lessons.iter().enumerate() {
        let next = lessons.get(i + 1);
        let cached = next.filter(|n| n.even);
        let (light, carry) = match cached {
            Some(n) => (n.direct - l.after[0], n.before[1]),
            None => (found - l.after[0], 0.0),
        };
        let sample = Sample {
            p: l.p,
            side: l.side,
            at: l.at,
            factor: l.factor,
            light: light / l.after[1],
            next: cached.map_or(NONE, |_| first + i as u32 + 1),
            carry: carry / l.after[1],
            sent: (found - l.direct) / l.before[1],
            all: (found - l.before[0]) / l.before[1],
        };
        let known = [sample.factor, sample.light, sample.carry, sample.sent, sample.all, sample.p.x, sample.p.y, sample.p.z];
        if known.iter().all(|v| v.is_finite()) {
            samples.push(sample);
        } else {
            // Keeps the numbers of those that follow.
            samples.push(Sample { p: Vec3::ZERO, factor: 0.0, light: 0.0, carry: 0.0, sent: 0.0, all: 0.0, next: NONE, ..sample });
        }
    }
    lessons.clear();
}

/// Rounds of paths, each guided by what those before have learned.
pub(super) struct Learner {
    path: Path,
    samples: Vec<Sample>,
    round: u32,
    done: u64,
}

impl Learner {
    /// For a path tracer whose paths neither split nor are guided.
    pub fn new(path: &Path) -> Self {
        Self { path: path.clone(), samples: Vec::new(), round: 0, done: 0 }
    }

    /// Goes on until a share of the rounds is done; none where someone stops it.
    pub fn learn(&mut self, rounds: u32, scene: &Scene, stage: &Stage) -> Option<Guide> {
        let pixels = u64::from(stage.size[0]) * u64::from(stage.size[1]);
        let paths = pixels.saturating_mul(PATHS_OF_PIXEL).clamp(LEAST_PATHS, MOST_PATHS);
        let sampler = Sampler { kind: SamplerKind::Independent, seed: mix64(stage.seed ^ SEED), spp: 1 };
        while self.round < rounds {
            (stage.progress)("learning where light comes from", f64::from(self.round) / f64::from(ROUNDS));
            let end = (paths / 3u64.pow(ROUNDS - 1 - self.round)).max(self.done + 1);
            let firsts: Vec<u64> = (self.done..end).step_by(CHUNK as usize).collect();
            let of_chunk = |first: u64| trace(&self.path, scene, stage, &sampler, first..(first + CHUNK).min(end));
            let chunks: Vec<Vec<Sample>> = firsts.into_par_iter().map(of_chunk).collect();
            if (stage.is_cancelled)() {
                return None;
            }
            for chunk in chunks {
                let offset = self.samples.len() as u32;
                let moved = |s: Sample| Sample { next: if s.next == NONE { NONE } else { s.next + offset }, ..s };
                self.samples.extend(chunk.into_iter().map(moved));
            }
            self.path.guide = Some(Guide { field: Field::learn(&self.samples).into() });
            self.done = end;
            self.round += 1;
        }
        self.path.guide.clone()
    }
}

fn trace(path: &Path, scene: &Scene, stage: &Stage, sampler: &Sampler, range: std::ops::Range<u64>) -> Vec<Sample> {
    let (mut samples, mut estimate) = (Vec::new(), Estimate::default());
    let mut lessons = Vec::new();
    let size = Vec2::new(stage.size[0] as f32, stage.size[1] as f32);
    for i in range {
        if samples.len() >= MOST_SAMPLES || (stage.is_cancelled)() {
            break;
        }
        let mut stream = sampler.stream((i % COLUMNS) as u32, (i / COLUMNS) as u32, 0);
        let at = stream.next_2d() * size;
        let camera_ray = scene.camera_ray(at, stream.next_2d());
        estimate.reset(0);
        let mut probe = Probe::new(1);
        probe.lessons = Some(lessons);
        path.probe(scene, &camera_ray, &mut stream, &mut estimate, &mut probe);
        lessons = probe.lessons.unwrap_or_default();
        conclude(&mut lessons, estimate.radiance.luminance(), &mut samples);
    }
    samples
}
