//! Whether guided paths are better, by a trial.

use rayon::prelude::*;

use crate::integrator::splitting::Probe;
use crate::integrator::{Estimate, Path, Stage};
use crate::math::Vec2;
use crate::math::hash::mix64;
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::Scene;

/// Rows and columns of the trial's pixels: so many less than the picture's, within limits.
const COARSER: usize = 6;
const GRID: [usize; 2] = [8, 48];
/// Rows and columns of pixels that share what is to be expected there.
const BLOCK: usize = 4;
/// The random numbers are not those of the picture.
const SEED: u64 = 0x7a1e_9d11_5eed_0001;

/// What a trial says of a path tracer.
pub(super) struct Trial {
    size: [usize; 2],
    /// Mean and variance of a sample of each pixel.
    mean: Vec<f64>,
    variance: Vec<f64>,
    /// Variance of what comes by way of other surfaces to the first that can be guided: guides take no other noise.
    indirect: Vec<f64>,
    /// By how much it would be larger if the paths were not guided, as far as their direct light tells: what others find too rarely to be seen in
    /// a trial shows in those that go there often.
    saved: Vec<f64>,
    /// Edges of a path, in the mean.
    pub edges: f64,
}

impl Trial {
    /// Traces so many paths, two at least, through each pixel of a grid.
    pub fn new(path: &Path, samples: u32, scene: &Scene, stage: &Stage) -> Self {
        let size = stage.size.map(|n| (n as usize / COARSER).clamp(GRID[0], GRID[1]));
        let sampler = Sampler { kind: SamplerKind::Independent, seed: mix64(stage.seed ^ SEED ^ u64::from(samples)), spp: 1 };
        let pixels: Vec<[f64; 6]> = (0..size[0] * size[1])
            .into_par_iter()
            .map(|i| {
                let pixel = [i % size[0], i / size[0]];
                let (mut sum, mut estimate) = ([0.0; 6], Estimate::default());
                let mut lessons = Vec::new();
                for index in 0..samples {
                    if (stage.is_cancelled)() {
                        break;
                    }
                    let mut stream = sampler.stream(pixel[0] as u32, pixel[1] as u32, index);
                    let u = stream.next_2d();
                    let at = |a: usize, u: f32| (pixel[a] as f32 + u) / size[a] as f32 * stage.size[a] as f32;
                    let camera_ray = scene.camera_ray(Vec2::new(at(0, u.x), at(1, u.y)), stream.next_2d());
                    estimate.reset(0);
                    let mut probe = Probe::new(1);
                    probe.lessons = Some(lessons);
                    path.probe(scene, &camera_ray, &mut stream, &mut estimate, &mut probe);
                    let light = f64::from(estimate.radiance.luminance());
                    let light = if light.is_finite() { light } else { 0.0 };
                    lessons = probe.lessons.unwrap_or_default();
                    let indirect = lessons.first().map_or(0.0, |l| f64::from(l.indirect(estimate.radiance.luminance())));
                    let indirect = if indirect.is_finite() { indirect } else { 0.0 };
                    let rarer: f64 = lessons.drain(..).map(|l| f64::from(l.rarer())).filter(|v| v.is_finite()).sum();
                    let of_path = [light, light * light, f64::from(probe.edges), rarer, indirect, indirect * indirect];
                    for (sum, v) in sum.iter_mut().zip(of_path) {
                        *sum += v;
                    }
                }
                sum.map(|v| v / f64::from(samples))
            })
            .collect();
        let unbiased = f64::from(samples) / f64::from(samples - 1);
        Self {
            size,
            mean: pixels.iter().map(|p| p[0]).collect(),
            variance: pixels.iter().map(|p| (p[1] - p[0] * p[0]).max(0.0) * unbiased).collect(),
            indirect: pixels.iter().map(|p| (p[5] - p[4] * p[4]).max(0.0) * unbiased).collect(),
            saved: pixels.iter().map(|p| p[3]).collect(),
            edges: pixels.iter().map(|p| p[2]).sum::<f64>() / pixels.len() as f64,
        }
    }

    /// The variance of a sample, relative to what these trials see around each pixel, how large it would be without a guide, and that of
    /// indirect light alone.
    pub fn noise(&self, trials: &[&Self]) -> [f64; 3] {
        let columns = self.size[0].div_ceil(BLOCK);
        let block = |i: usize| i / self.size[0] / BLOCK * columns + i % self.size[0] / BLOCK;
        let mut sums = vec![[0.0; 2]; columns * self.size[1].div_ceil(BLOCK)];
        for trial in trials {
            for (i, mean) in trial.mean.iter().enumerate() {
                let sum = &mut sums[block(i)];
                *sum = [sum[0] + mean, sum[1] + 1.0];
            }
        }
        let [light, n] = sums.iter().fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let floor = 0.01 * (light / n).powi(2);
        let mean = |values: &[f64]| {
            let relative = |(i, value): (usize, &f64)| {
                let [light, n] = sums[block(i)];
                value / ((light / n).powi(2) + floor).max(1e-300)
            };
            values.iter().enumerate().map(relative).sum::<f64>() / values.len() as f64
        };
        let noise = mean(&self.variance);
        [noise, noise + mean(&self.saved).max(0.0), mean(&self.indirect)]
    }
}
