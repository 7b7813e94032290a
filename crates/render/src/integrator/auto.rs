//! The choice of a method, so that glass, mirrors and small lights need no knowledge of methods.
//!
//! Path tracing is unbiased and the best of what is here for most scenes. It fails where much light reaches diffuse surfaces by
//! mirrors and glass from small lights; there photons find what paths do not. A pilot tells the two cases apart:
//!
//! 1. A few photons say how much of the light is focused at all. Little: path tracing, and nothing more is tried.
//! 2. A grid of pixels is rendered by path tracing and by photon mapping. Each method's variance, in proportion to what a sample
//!    costs, is estimated from two independent halves; light that photons find and paths lack counts as a rare event of theirs.
//!
//! The choice is a function of the scene, the settings and the seed: costs are fixed ratios, not measured times.

use rayon::prelude::*;

use super::photon_settings::{PhotonSettings, check};
use super::{Estimate, Integrator, Path, Sppm, Stage};
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
/// What a pass of photon mapping costs in samples of path tracing, both for each pixel; measured on scenes with glass and mirrors.
const PASS_COST: f64 = 2.5;
/// Photon mapping has to be better by this factor, since it has a bias that only shrinks. Not by more: the pilot finds few of the bright
/// paths that make most of path tracing's noise.
const MARGIN: f64 = 1.5;
/// The pilot's random numbers are not those of the picture.
const PILOT_SEED: u64 = 0x9E37_79B9_7F4A_7C15;

/// Path tracing or photon mapping, whichever a pilot finds better.
pub struct Auto {
    path: Path,
    sppm: Sppm,
    depth: u32,
    memory: u64,
    uses_photons: bool,
    notes: Vec<String>,
}

impl Auto {
    /// The methods to choose from.
    pub fn new(path: Path, photons: PhotonSettings) -> Self {
        let (depth, memory) = (photons.depth(), photons.memory);
        Self { path, sppm: Sppm::new(photons), depth, memory, uses_photons: false, notes: Vec::new() }
    }

    fn chosen(&self) -> &dyn Integrator {
        if self.uses_photons { &self.sppm } else { &self.path }
    }

    /// The share of the light on surfaces that came there by mirrors and refractors alone.
    fn focused_share(&self, scene: &Scene, stage: &Stage) -> f64 {
        let tracer = Tracer::new(scene, stage.seed, self.depth, Keep::ALL);
        let mut map = PhotonMap::new(MapInfo::default());
        map.trace_with(&tracer, 0, 0..PHOTONS, self.memory / 2, stage.is_cancelled, &mut |_, _| ());
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

    /// Renders the grid by both methods and returns the ratio of their errors at equal cost, path tracing's above.
    fn ratio_of_errors(&mut self, scene: &Scene, stage: &Stage) -> Result<f64, String> {
        let mut paths = Pilot::default();
        for half in 0..2 {
            (stage.progress)("trying path tracing", 0.5 * f64::from(half));
            paths.add(scene, &self.path, stage, half, half * PATHS / 2..(half + 1) * PATHS / 2);
        }
        let small = Stage { size: [GRID as u32; 2], ..*stage };
        self.sppm.prepare(scene, &small)?;
        let mut photons = Pilot::default();
        for pass in 0..PASSES {
            (stage.progress)("trying photon mapping", f64::from(pass) / f64::from(PASSES));
            if (stage.is_cancelled)() {
                return Ok(0.0);
            }
            self.sppm.begin_pass(scene, pass, pass + 1, &small)?;
            photons.add(scene, &self.sppm, stage, pass * 2 / PASSES, pass..pass + 1);
        }
        let [paths, photons] = [paths.means(PATHS / 2), photons.means(PASSES / 2)];
        // Relative to what photons show around each pixel, as both methods agree where both work; dark places do not decide.
        let around = block_means(&photons.mean);
        let floor = 0.01 * (around.iter().sum::<f64>() / around.len() as f64).powi(2);
        let relative = |square: f64, pixel: usize| square / (around[block_of(pixel)].powi(2) + floor).max(1e-300);
        let variance = |means: &Means| {
            let sum: f64 = means.variance.iter().enumerate().map(|(i, v)| relative(*v, i)).sum();
            sum / (GRID * GRID) as f64
        };
        let (found, wanted) = (block_means(&paths.mean), &around);
        let [error_paths, error_photons] = [&paths, &photons].map(|m| block_means(&m.variance));
        let in_block = (BLOCK * BLOCK) as f64;
        let missing: f64 = (0..found.len())
            .map(|b| {
                let lack = (wanted[b] - found[b]).max(0.0);
                let noise = (error_paths[b] + error_photons[b]) / in_block;
                (lack * lack - 9.0 * noise).max(0.0) / (wanted[b].powi(2) + floor).max(1e-300)
            })
            .sum::<f64>()
            / found.len() as f64;
        let samples = f64::from(PATHS);
        // Light that none of n samples found comes in events rarer than 1 / n: a variance of n times its square for each sample.
        let path_error = variance(&paths) * samples + missing * samples * in_block;
        let photon_error = variance(&photons) * f64::from(PASSES) * PASS_COST;
        Ok(path_error / photon_error.max(1e-300))
    }
}

impl Integrator for Auto {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        self.uses_photons = false;
        self.path.forget_splits();
        let focused = self.focused_share(scene, stage);
        let percent = focused * 100.0;
        if focused < LEAST_FOCUSED || (stage.is_cancelled)() {
            self.notes = vec![format!("auto: path tracing; {percent:.2}% of the light is focused by mirrors or glass")];
            return self.path.prepare(scene, stage);
        }
        if check(scene).is_err() {
            self.notes =
                vec![format!("auto: path tracing; {percent:.2}% of the light is focused, but media emit where photons cannot start")];
            return self.path.prepare(scene, stage);
        }
        let ratio = self.ratio_of_errors(scene, stage)?;
        self.uses_photons = ratio > MARGIN;
        let compared = if ratio >= 1.0 {
            format!("photon mapping has {ratio:.1} times less noise in a pilot")
        } else {
            format!("path tracing has {:.1} times less noise in a pilot", 1.0 / ratio.max(1e-9))
        };
        let name = if self.uses_photons {
            "photon mapping (sppm), which is biased: it blurs caustics and indirect light a little, less with each pass"
        } else {
            "path tracing"
        };
        self.notes = vec![format!("auto: {name}; {percent:.2}% of the light is focused by mirrors or glass, and {compared}")];
        if self.uses_photons {
            self.sppm.prepare(scene, stage)?;
            self.notes.extend(self.sppm.notes());
            return Ok(());
        }
        self.path.prepare(scene, stage)
    }

    fn pass_limit(&self) -> u32 {
        self.chosen().pass_limit()
    }

    fn begin_pass(&mut self, scene: &Scene, first: u32, end: u32, stage: &Stage) -> Result<(), String> {
        if self.uses_photons { self.sppm.begin_pass(scene, first, end, stage) } else { Ok(()) }
    }

    fn notes(&self) -> Vec<String> {
        let of_path = if self.uses_photons { Vec::new() } else { self.path.notes() };
        self.notes.iter().cloned().chain(of_path).collect()
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        self.chosen().estimate(scene, camera_ray, stream, out);
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

impl Pilot {
    /// Adds samples of all pixels of the grid to a half.
    fn add(&mut self, scene: &Scene, method: &dyn Integrator, stage: &Stage, half: u32, samples: std::ops::Range<u32>) {
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
}
