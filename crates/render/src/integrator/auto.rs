//! The choice of a method, so that glass, mirrors and small lights need no knowledge of methods.
//!
//! Path tracing is unbiased and the best of what is here for most scenes. It fails where much light reaches diffuse surfaces by
//! mirrors and glass from small lights; there photons find what paths do not. A pilot tells the cases apart:
//!
//! 1. A few photons say how much of the light is focused at all. Little: path tracing, which decides for itself whether its paths are
//!    guided, and nothing more is tried.
//! 2. A grid of pixels is rendered by path tracing (guided where the path tracer's own trial says that it pays, which it is only asked where
//!    photons are not far better), by photon mapping (`sppm`), by their mix (`pathmap`: photons for the light that mirrors and glass send
//!    first, paths for all other light) and, where paths alone are not the best of these, by vertex connection and merging (`vcm`). Each
//!    method's variance, in proportion to what a sample costs, is estimated from two independent halves; light that photons find and another
//!    method lacks counts as a rare event of it.
//!
//! The choice is a function of the scene, the settings and the seed: costs are fixed ratios, not measured times. Then the picture is that of
//! the chosen method, bit for bit. None of them lights other pixels than a sample's own, so that parts, crops and films are made as for path
//! tracing: `vcm` leaves connections to the camera out here, for which merging stands in ([`Vcm::without_splats`]), but not in media, where
//! it does not merge and is not tried.

use std::ops::Range;

use rayon::prelude::*;

use super::photon_settings::{PhotonSettings, check};
use super::sppm::PHOTONS as PHOTONS_OF_PASS;
use super::{Estimate, Integrator, Path, PathMap, Sppm, Stage, Vcm};
use crate::camera::CameraRay;
use crate::math::Vec2;
use crate::photon::trace::{Keep, Tracer};
use crate::photon::{MapInfo, PhotonMap, Route};
use crate::sampler::{SampleStream, Sampler, SamplerKind};
use crate::scene::Scene;

/// Photons of the first look.
const PHOTONS: u64 = 1 << 14;
/// The share of focused light below which path tracing is not questioned.
const LEAST_FOCUSED: f64 = 5e-4;
/// Rows and columns of the pilot's pixels; blocks of them are compared.
const GRID: usize = 48;
const BLOCK: usize = 6;
/// Samples of each pixel, in two halves.
const PATHS: u32 = 32;
const PASSES: u32 = 8;
/// Learning where light comes from takes seconds: not where another method is better than paths by more than this.
const MOST_GAIN_OF_GUIDES: f64 = 4.0;
/// The pilot's random numbers are not those of the picture.
const PILOT_SEED: u64 = 0x9E37_79B9_7F4A_7C15;

/// What can be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Method {
    Path,
    Sppm,
    PathMap,
    Vcm,
}

impl Method {
    fn name(self) -> &'static str {
        match self {
            Self::Path => "path tracing",
            Self::Sppm => "photon mapping (sppm)",
            Self::PathMap => "path tracing with a caustic map (pathmap)",
            Self::Vcm => "vertex connection and merging (vcm)",
        }
    }

    /// What is biased, where something is.
    fn bias(self) -> &'static str {
        match self {
            Self::Path => "",
            Self::Sppm => ", which is biased: it blurs caustics and indirect light a little, less with each pass",
            Self::PathMap => ", which is biased: it blurs caustics a little, less with each pass",
            Self::Vcm => ", which is biased: it blurs light a little, less with each pass",
        }
    }

    /// Samples of each pixel in the pilot.
    fn samples(self) -> u32 {
        if self == Self::Path { PATHS } else { PASSES }
    }

    /// What a sample costs in samples of path tracing, `photons` coming with it. CPU time measured on three scenes (`caustic.xml` of the
    /// benchmarks, `scenes/particles/room.xml`, a glass ball under a lamp) at one photon for each pixel: 2.2, 2.1, 2.1 for `sppm`; 1.9,
    /// 1.8, 2.1 for `pathmap`; 6.3, 6.0, 3.8 for `vcm`; at 4.7 photons 4.7, 4.1, 3.8 and 2.7, 2.7, 5.2 for the first two.
    fn cost(self, photons: f64) -> f64 {
        match self {
            Self::Path => 1.0,
            Self::Sppm => 1.5 + 0.6 * photons,
            Self::PathMap => 1.5 + 0.4 * photons,
            Self::Vcm => 5.5,
        }
    }

    /// Methods with a bias, which only shrinks, have to be better than path tracing by a factor. `sppm` not by much: the pilot finds few
    /// of the bright paths that make most of path tracing's noise. Those that trace paths as well make that noise themselves, and their
    /// fewer samples show less of it; where they are of use it is by much more.
    fn margin(self) -> f64 {
        match self {
            Self::Path => 1.0,
            Self::Sppm => 1.5,
            Self::PathMap | Self::Vcm => 3.0,
        }
    }
}

/// The method that a pilot finds best.
pub struct Auto {
    /// Guided where that pays, but not split, which the pilot is too short for, before it is chosen.
    path: Path,
    settings: PhotonSettings,
    chosen: Box<dyn Integrator>,
    notes: Vec<String>,
}

impl Auto {
    /// The path tracer, and the settings of the other methods.
    pub fn new(path: Path, photons: PhotonSettings) -> Self {
        Self { chosen: Box::new(path.clone()), path, settings: photons, notes: Vec::new() }
    }

    fn create(&self, method: Method, settings: PhotonSettings) -> Box<dyn Integrator> {
        match method {
            Method::Path => Box::new(self.path.clone()),
            Method::Sppm => Box::new(Sppm::new(settings)),
            Method::PathMap => Box::new(PathMap::new(self.path.alone(), settings)),
            Method::Vcm => Box::new(Vcm::without_splats(settings.depth(), settings.rr_depth, settings.radius)),
        }
    }

    /// The share of the light on surfaces that came there by mirrors and refractors alone.
    fn focused_share(&self, scene: &Scene, stage: &Stage) -> f64 {
        let tracer = Tracer::new(scene, stage.seed, self.settings.depth(), Keep::ALL);
        let mut map = PhotonMap::new(MapInfo::default());
        map.trace_with(&tracer, 0, 0..PHOTONS, self.settings.memory / 2, stage.is_cancelled, &mut |_, _| ());
        let (surface, _) = map.into_photons();
        let (mut all, mut focused) = (0.0, 0.0);
        for photon in &surface {
            let power = f64::from(photon.power().luminance());
            all += power;
            if photon.route() == Route::Caustic {
                focused += power;
            }
        }
        if all > 0.0 { focused / all } else { 0.0 }
    }

    /// Renders the grid by a method, with so many photons in a pass.
    fn try_method(&self, method: Method, photons: u32, scene: &Scene, stage: &Stage) -> Result<Means, String> {
        let mut trial = self.create(method, PhotonSettings { photons: Some(photons), ..self.settings.clone() });
        let small = Stage { size: [2 * GRID as u32; 2], ..*stage };
        if method != Method::Path {
            trial.prepare(scene, &small)?;
        }
        let (mut pilot, samples) = (Pilot::default(), method.samples());
        let half = samples / 2;
        let mut first = 0;
        while first < samples && !(stage.is_cancelled)() {
            (stage.progress)(&format!("trying {}", method.name()), f64::from(first) / f64::from(samples));
            let end = (first + trial.pass_limit().clamp(1, half)).min((first / half + 1) * half);
            trial.begin_pass(scene, first, end, &small)?;
            pilot.add(scene, &*trial, stage, first / half, first..end);
            first = end;
        }
        Ok(pilot.means(half))
    }

    /// Tries the methods; returns each one's error at equal cost. Paths learn where that may change the choice.
    fn errors(&mut self, scene: &Scene, stage: &Stage) -> Result<Vec<(Method, f64)>, String> {
        let pixels = stage.size[0].saturating_mul(stage.size[1]).max(1);
        let photons = self.settings.photons.unwrap_or(pixels.clamp(PHOTONS_OF_PASS[0], PHOTONS_OF_PASS[1]));
        let attempt = |auto: &Self, method| auto.try_method(method, photons.min(PHOTONS_OF_PASS[0]), scene, stage);
        let by_photons = attempt(self, Method::Sppm)?;
        let error = |auto: &Self, method: Method, means: &Means| {
            let cost = method.cost(f64::from(photons) / f64::from(pixels));
            let cost = if method == Method::Path { auto.path.cost() } else { cost };
            (method, means.error(&by_photons, method.samples()) * cost)
        };
        let mut errors = vec![error(self, Method::Sppm, &by_photons)];
        for method in [Method::PathMap, Method::Path] {
            errors.push(error(self, method, &attempt(self, method)?));
        }
        let of_other = errors[..2].iter().map(|e| e.1).fold(f64::INFINITY, f64::min);
        if of_other * MOST_GAIN_OF_GUIDES >= errors[2].1 {
            self.path.guide(scene, stage);
            if self.path.is_guided() {
                errors[2] = error(self, Method::Path, &attempt(self, Method::Path)?);
            }
        }
        if best(&errors) != Method::Path && !scene.has_media && self.settings.memory >= Vcm::MEMORY {
            // Where it cannot be prepared the others still can.
            errors.extend(attempt(self, Method::Vcm).ok().map(|means| error(self, Method::Vcm, &means)));
        }
        Ok(errors)
    }
}

fn least(errors: impl Iterator<Item = (Method, f64)>) -> Method {
    errors.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(Method::Path, |e| e.0)
}

fn error_of(errors: &[(Method, f64)], method: Method) -> f64 {
    errors.iter().find(|e| e.0 == method).map_or(f64::INFINITY, |e| e.1.max(1e-300))
}

/// The method of the least error of those that are enough better than path tracing.
fn best(errors: &[(Method, f64)]) -> Method {
    let of_path = error_of(errors, Method::Path);
    least(errors.iter().copied().filter(|(method, error)| *method == Method::Path || error * method.margin() < of_path))
}

/// What the pilot says, for the user.
fn compared(errors: &[(Method, f64)], chosen: Method) -> String {
    let next = least(errors.iter().copied().filter(|e| e.0 != chosen));
    let of = |method| error_of(errors, method);
    let ratio = of(next) / of(chosen);
    let mut text = if ratio >= 1.0 {
        format!("it has {ratio:.1} times less noise at equal cost in a pilot than {}, the next best", next.name())
    } else {
        format!("{} has {:.1} times less noise at equal cost in a pilot, too little to rely on", next.name(), 1.0 / ratio)
    };
    if chosen != Method::Path && next != Method::Path {
        text += &format!("; {:.1} times less than path tracing", of(Method::Path) / of(chosen));
    }
    text
}

impl Integrator for Auto {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        let mut chosen = Method::Path;
        let focused = self.focused_share(scene, stage);
        let percent = focused * 100.0;
        let why = if focused < LEAST_FOCUSED || (stage.is_cancelled)() {
            self.path.guide(scene, stage);
            format!("{percent:.2}% of the light is focused by mirrors or glass")
        } else if check(scene).is_err() {
            self.path.guide(scene, stage);
            format!("{percent:.2}% of the light is focused, but media emit where photons cannot start")
        } else {
            let errors = self.errors(scene, stage)?;
            chosen = best(&errors);
            format!("{percent:.2}% of the light is focused by mirrors or glass, and {}", compared(&errors, chosen))
        };
        let guided = if chosen == Method::Path && self.path.is_guided() { "guided " } else { "" };
        self.notes = vec![format!("auto: {guided}{}{}; {why}", chosen.name(), chosen.bias())];
        if chosen == Method::Path {
            let mut path = self.path.clone();
            path.split(scene, stage);
            self.chosen = Box::new(path);
            return Ok(());
        }
        self.chosen = self.create(chosen, self.settings.clone());
        self.chosen.prepare(scene, stage)
    }

    fn pass_limit(&self) -> u32 {
        self.chosen.pass_limit()
    }

    fn samples_of(&self, pixel: [u32; 2], begin: u32, end: u32) -> Range<u32> {
        self.chosen.samples_of(pixel, begin, end)
    }

    fn begin_pass(&mut self, scene: &Scene, first: u32, end: u32, stage: &Stage) -> Result<(), String> {
        self.chosen.begin_pass(scene, first, end, stage)
    }

    fn notes(&self) -> Vec<String> {
        self.notes.iter().cloned().chain(self.chosen.notes()).collect()
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        self.chosen.estimate(scene, camera_ray, stream, out);
    }
}

/// Sums of luminance on the grid, by halves.
struct Pilot {
    sums: [Vec<f64>; 2],
}

impl Default for Pilot {
    fn default() -> Self {
        Self { sums: std::array::from_fn(|_| vec![0.0; GRID * GRID]) }
    }
}

/// What the halves say of each pixel.
struct Means {
    mean: Vec<f64>,
    /// Variance of the mean.
    variance: Vec<f64>,
}

impl Means {
    /// The error of one sample: what is lacking in the light that photons show included.
    fn error(&self, photons: &Self, samples: u32) -> f64 {
        // Relative to what photons show around each pixel, as all methods agree where all work; dark places do not decide.
        let wanted = block_means(&photons.mean);
        let floor = 0.01 * (wanted.iter().sum::<f64>() / wanted.len() as f64).powi(2);
        let relative = |square: f64, block: usize| square / (wanted[block].powi(2) + floor).max(1e-300);
        let variance = self.variance.iter().enumerate().map(|(i, v)| relative(*v, block_of(i))).sum::<f64>() / (GRID * GRID) as f64;
        let found = block_means(&self.mean);
        let [own, of_photons] = [self, photons].map(|m| block_means(&m.variance));
        let in_block = (BLOCK * BLOCK) as f64;
        let missing = (0..found.len()).map(|b| {
            let lack = (wanted[b] - found[b]).max(0.0);
            let noise = (own[b] + of_photons[b]) / in_block;
            relative((lack * lack - 9.0 * noise).max(0.0), b)
        });
        let missing = missing.sum::<f64>() / found.len() as f64;
        // Light that none of n samples found comes in events rarer than 1 / n: a variance of n times its square for each sample.
        (variance + missing * in_block) * f64::from(samples)
    }
}

impl Pilot {
    /// Adds samples of all pixels of the grid to a half.
    fn add(&mut self, scene: &Scene, method: &dyn Integrator, stage: &Stage, half: u32, samples: Range<u32>) {
        let sampler = Sampler { kind: SamplerKind::Independent, seed: stage.seed ^ PILOT_SEED, spp: 1 };
        let [width, height] = stage.size.map(|n| n as f32);
        let found: Vec<f64> = (0..GRID * GRID)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % GRID, i / GRID);
                let mut estimate = Estimate::default();
                let of_sample = |index| {
                    let mut stream = sampler.stream(x as u32, y as u32, index);
                    let u = stream.next_2d();
                    let cell = (Vec2::new(x as f32, y as f32) + u) / GRID as f32;
                    let camera_ray = scene.camera_ray(cell * Vec2::new(width, height), stream.next_2d());
                    estimate.reset(scene.group_names.len());
                    method.estimate(scene, &camera_ray, &mut stream, &mut estimate);
                    let luminance = f64::from(estimate.radiance.luminance());
                    if luminance.is_finite() { luminance } else { 0.0 }
                };
                samples.clone().map(of_sample).sum()
            })
            .collect();
        for (sum, v) in self.sums[half as usize].iter_mut().zip(found) {
            *sum += v;
        }
    }

    fn means(&self, samples_of_half: u32) -> Means {
        let n = f64::from(samples_of_half);
        let halves = || self.sums[0].iter().zip(&self.sums[1]).map(|(a, b)| (a / n, b / n));
        Means { mean: halves().map(|(a, b)| 0.5 * (a + b)).collect(), variance: halves().map(|(a, b)| 0.25 * (a - b).powi(2)).collect() }
    }
}

fn block_of(pixel: usize) -> usize {
    let (x, y) = (pixel % GRID, pixel / GRID);
    y / BLOCK * (GRID / BLOCK) + x / BLOCK
}

fn block_means(pixels: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; (GRID / BLOCK) * (GRID / BLOCK)];
    for (i, v) in pixels.iter().enumerate() {
        sums[block_of(i)] += v / (BLOCK * BLOCK) as f64;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_cover_the_grid_once() {
        let pixels: Vec<f64> = (0..GRID * GRID).map(|i| block_of(i) as f64).collect();
        let means = block_means(&pixels);
        assert!(means.iter().enumerate().all(|(b, m)| (m - b as f64).abs() < 1e-9));
    }
    #[test]
    fn biased_methods_need_their_margin() {
        use Method::{Path, PathMap, Sppm, Vcm};
        assert_eq!(best(&[(Sppm, 1.0), (Path, 1.4), (PathMap, 0.9)]), Path);
        assert_eq!(best(&[(Sppm, 1.0), (Path, 1.6), (PathMap, 0.9)]), Sppm);
        assert_eq!(best(&[(Sppm, 1.0), (Path, 2.8), (PathMap, 0.9)]), PathMap);
        assert_eq!(best(&[(Sppm, 1.0), (Path, 2.8), (PathMap, 0.9), (Vcm, 0.8)]), Vcm);
        assert_eq!(best(&[(Sppm, f64::NAN), (Path, 1.0), (PathMap, f64::INFINITY)]), Path);
        assert!(compared(&[(Sppm, 1.0), (Path, 1.4)], Path).contains("1.4 times less noise at equal cost in a pilot, too little"));
        assert!(compared(&[(Sppm, 1.0), (Path, 6.0), (PathMap, 2.0)], Sppm).contains("2.0 times"));
    }
}
