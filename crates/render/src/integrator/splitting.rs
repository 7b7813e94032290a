//! How many ways a path goes on from the first surface that scatters it.
//!
//! A camera ray and the direct light at what it meets often cost as much as all that follows, and have little noise; then several paths
//! that go on from there are worth more than several camera rays. How many is a question of errors and costs (Arvo and Kirk 1990,
//! doi:10.1145/97880.97886; Bolin and Meyer 1997, doi:10.1145/258734.258865). With variances V and costs C before and after the split,
//! and n camera rays for each pixel, the error Σ (V₀ + V₁ / k) / n at a cost of Σ n (C₀ + k C₁) is least for
//!
//! ```text
//! k² = (V₁ / C₁) · (Σ C₀ / Σ V₀)
//! ```
//!
//! in each pixel, where the sums go over the picture and errors are relative to what is seen. So dark corners that are lit by
//! what paths rarely find get more paths than walls in the lamp's light: the split is adaptive sampling without a bias, as a
//! pilot of its own decides, once, before the first sample. The pilot is a function of the scene, the settings and the seed.
//!
//! Later vertices do not split. Tried, by statistics of what paths find from cells of the scene on (after Rath et al. 2022, "EARS",
//! doi:10.1145/3528223.3530168): 0.81 of the efficiency in a kitchen, 0.94 to 1.05 in five other scenes.

use rayon::prelude::*;

use super::guiding::Lesson;
use super::{Estimate, Path, Stage, Vertex};
use crate::math::Vec2;
use crate::math::hash::mix64;
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Rows and columns of pixels that share a number, at least; one pixel of them is looked at.
const LEAST_BLOCK: u32 = 8;
/// Most blocks of a picture: what bounds the pilot's time and memory.
const MOST_BLOCKS: u64 = 16384;
/// Samples of such a pixel, in two halves whose difference shows how well a half is known.
const HALF: u32 = 8;
/// Paths into which each of them splits.
const CHILDREN: u32 = 2;
/// The pilot's random numbers are not those of the picture.
const PILOT_SEED: u64 = 0x5eed_0f5b_1177_1e55;

/// Into how many a path splits, and what it tells the pilot of that.
#[derive(Clone, Debug)]
pub(super) struct Probe {
    /// Paths that go on from the first surface that does more than mirror or refract.
    pub splits: u32,
    /// Light found before the split.
    before: Spectrum,
    /// Light found by the first two paths after it, each as if it were alone.
    pub after: [Spectrum; CHILDREN as usize],
    /// Edges of the path before the split.
    edges_before: u32,
    /// Edges of all paths after it.
    pub edges_after: u32,
    /// Edges of the path that the sample began as.
    pub edges: u32,
    /// What there is to learn of where light comes from; none where nobody asks.
    pub lessons: Option<Vec<Lesson>>,
}

impl Probe {
    /// For a path that tells nobody.
    #[inline]
    pub fn new(splits: u32) -> Self {
        Self {
            splits,
            before: Spectrum::ZERO,
            after: [Spectrum::ZERO; CHILDREN as usize],
            edges_before: 0,
            edges_after: 0,
            edges: 0,
            lessons: None,
        }
    }

    /// The path is about to split, or could.
    #[inline]
    pub fn at_split(&mut self, out: &Estimate, edges: u32) {
        self.before = out.radiance;
        self.edges_before = edges;
    }

    /// The path has come to light on its way from a vertex.
    #[inline]
    pub fn met(&mut self, from: &Vertex, out: &Estimate) {
        if let Some(lesson) = self.lessons.as_mut().and_then(|l| l.last_mut())
            && from.pdf.is_finite()
        {
            lesson.met(out);
        }
    }

    /// The sample is done.
    pub fn end(&mut self, out: &Estimate, edges: u32) {
        self.edges = edges;
        if self.edges_before == 0 {
            self.at_split(out, edges);
        }
    }
}

/// Numbers of paths for blocks of pixels.
#[derive(Clone, Debug)]
pub(super) struct Splits {
    /// Rows and columns of pixels in a block.
    block: u32,
    columns: u32,
    rows: u32,
    counts: Vec<u8>,
}

/// What the pilot knows of a block: a mean, variances of a sample and costs in edges; before and after the split.
#[derive(Clone, Copy, Debug, Default)]
struct Look {
    mean: f64,
    variance: [f64; 2],
    cost: [f64; 2],
}

impl Splits {
    /// Decides by a pilot, for numbers up to `most`.
    pub fn plan(path: &Path, scene: &Scene, stage: &Stage, most: u32) -> Self {
        let mut block = LEAST_BLOCK;
        let blocks = |block: u32| stage.size.map(|n| n.div_ceil(block).max(1));
        while blocks(block).iter().map(|&n| u64::from(n)).product::<u64>() > MOST_BLOCKS {
            block += 1 + block / 8;
        }
        let [columns, rows] = blocks(block);
        let sampler = Sampler { kind: SamplerKind::Sobol, seed: mix64(stage.seed ^ PILOT_SEED) >> 1, spp: HALF };
        let looks: Vec<Look> = (0..columns as usize * rows as usize)
            .into_par_iter()
            .map(|i| {
                if (stage.is_cancelled)() {
                    return Look::default();
                }
                look(path, scene, stage, &sampler, block, [i as u32 % columns, i as u32 / columns])
            })
            .collect();
        let counts = decide(&looks, [columns as usize, rows as usize], f64::from(most.clamp(1, 255)));
        Self { block, columns, rows, counts }
    }

    /// What a path through a pixel does.
    #[inline]
    pub fn at(&self, [x, y]: [u32; 2]) -> Probe {
        let (column, row) = ((x / self.block).min(self.columns - 1), (y / self.block).min(self.rows - 1));
        Probe::new(u32::from(self.counts[(row * self.columns + column) as usize]))
    }

    /// Smallest, mean and greatest number.
    pub fn summary(&self) -> (u8, f64, u8) {
        let sum: f64 = self.counts.iter().map(|&n| f64::from(n)).sum();
        let all = || self.counts.iter().copied();
        (all().min().unwrap_or(1), sum / self.counts.len() as f64, all().max().unwrap_or(1))
    }
}

/// Traces the samples of a pixel of a block.
fn look(path: &Path, scene: &Scene, stage: &Stage, sampler: &Sampler, block: u32, at: [u32; 2]) -> Look {
    let mut estimate = Estimate::default();
    let mut look = Look::default();
    let mut halves = [0.0; 2];
    let n = f64::from(2 * HALF);
    for (seed, sum) in (sampler.seed..).zip(&mut halves) {
        let pixel = [0, 1].map(|a| (at[a] * block + block / 2).min(stage.size[a].saturating_sub(1)));
        let sampler = Sampler { seed, ..*sampler };
        for index in 0..HALF {
            let mut stream = sampler.stream(pixel[0], pixel[1], index);
            let at = Vec2::new(pixel[0] as f32, pixel[1] as f32) + stream.next_2d();
            let camera_ray = scene.camera_ray(at, stream.next_2d());
            estimate.reset(0);
            let mut probe = Probe::new(CHILDREN);
            path.probe(scene, &camera_ray, &mut stream, &mut estimate, &mut probe);
            let before = finite(probe.before);
            let after = probe.after.map(finite);
            look.mean += (before + 0.5 * (after[0] + after[1])) / n;
            look.variance[1] += 0.5 * (after[0] - after[1]).powi(2) / n;
            look.cost[0] += f64::from(probe.edges_before) / n;
            look.cost[1] += f64::from(probe.edges_after) / (n * f64::from(CHILDREN));
            *sum += before / f64::from(HALF);
        }
    }
    look.variance[0] = 0.5 * (halves[0] - halves[1]).powi(2) * f64::from(HALF);
    look
}

fn finite(light: Spectrum) -> f64 {
    let luminance = f64::from(light.luminance());
    if luminance.is_finite() { luminance } else { 0.0 }
}

/// The numbers that are best for what the pilot has seen.
fn decide(looks: &[Look], size: [usize; 2], most: f64) -> Vec<u8> {
    let mean = smooth(&looks.iter().map(|l| l.mean).collect::<Vec<_>>(), size);
    let of_all = mean.iter().sum::<f64>() / mean.len() as f64;
    let weight = |i: usize| 1.0 / (mean[i] * mean[i] + 0.01 * of_all * of_all).max(1e-300);
    // Blocks at the limits count as costs and errors of what does not split; a few rounds settle which these are.
    let ideal = |i: usize, scale: f64| match looks[i].cost[1] {
        0.0 => 1.0,
        cost => (looks[i].variance[1] * weight(i) / cost).sqrt() * scale,
    };
    let mut scale = 0.0;
    for _ in 0..8 {
        let (mut cost, mut error) = (0.0, 0.0);
        for (i, l) in looks.iter().enumerate() {
            let k = ideal(i, scale);
            cost += l.cost[0];
            error += l.variance[0] * weight(i);
            if k <= 1.0 || k >= most {
                let k = k.clamp(1.0, most);
                cost += l.cost[1] * k;
                error += l.variance[1] * weight(i) / k;
            }
        }
        scale = (cost / error.max(1e-300)).sqrt();
    }
    let ideals: Vec<f64> = (0..looks.len()).map(|i| ideal(i, scale).clamp(1.0, most)).collect();
    smooth(&ideals, size).iter().map(|k| (k + 0.5).max(1.0) as u8).collect()
}

/// Means over each block and its neighbors.
fn smooth(values: &[f64], [columns, rows]: [usize; 2]) -> Vec<f64> {
    (0..values.len())
        .map(|i| {
            let (x, y) = (i % columns, i / columns);
            let (mut sum, mut n) = (0.0, 0.0);
            for row in y.saturating_sub(1)..(y + 2).min(rows) {
                for column in x.saturating_sub(1)..(x + 2).min(columns) {
                    sum += values[row * columns + column];
                    n += 1.0;
                }
            }
            sum / n
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(variance: [f64; 2], cost: [f64; 2]) -> Look {
        Look { mean: 1.0, variance, cost }
    }

    /// The numbers against a search over all of them for the least product of error and cost.
    #[test]
    fn numbers_are_the_best_there_are() {
        for looks in [[look([0.5, 8.0], [2.0, 3.0]); 4], [look([0.5, 1.0], [2.0, 9.0]); 4], [look([1e-3, 9.0], [2.0, 3.0]); 4]] {
            let counts = decide(&looks, [2, 2], 16.0);
            let product = |k: u8| {
                let (k, l) = (f64::from(k), looks[0]);
                (l.variance[0] + l.variance[1] / k) * (l.cost[0] + l.cost[1] * k)
            };
            let best = (1..=16).min_by(|a, b| product(*a).total_cmp(&product(*b))).unwrap_or(0);
            assert_eq!(counts, vec![best; 4], "{:?}", looks[0]);
        }
    }

    /// Where noise is, paths go: a column of blocks with all of the noise between quiet ones.
    #[test]
    fn noisy_blocks_get_more() {
        let looks: Vec<Look> = (0..40).map(|i| look([0.01, if i % 10 < 3 { 4.0 } else { 0.0 }], [2.0, 3.0])).collect();
        let counts = decide(&looks, [10, 4], 16.0);
        assert!(counts[1] > 4 && counts[7] == 1, "{counts:?}");
    }

    #[test]
    fn what_is_no_number_splits_nothing() {
        for bad in [f64::NAN, f64::INFINITY, 1e300, 0.0] {
            for looks in [[Look { mean: bad, ..look([1.0; 2], [1.0; 2]) }], [look([bad; 2], [1.0; 2])], [look([bad; 2], [bad; 2])]] {
                let counts = decide(&looks, [1, 1], 16.0);
                assert!((1..=16).contains(&counts[0]), "{counts:?} of {bad}");
            }
        }
    }
}
