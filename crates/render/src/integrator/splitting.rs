//! How many ways a path goes on from the first surface that scatters it, and of how many light samples it chooses one there.
//!
//! A camera ray and the direct light at what it meets often cost as much as all that follows, and have little noise; then several paths
//! that go on from there are worth more than several camera rays. How many is a question of errors and costs (Arvo and Kirk 1990,
//! doi:10.1145/97879.97886; Bolin and Meyer 1997, doi:10.1145/258734.258865). With variances V and costs C before and after the split,
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
//! Light samples of which one is chosen where the path splits (`resampling`) are a question of the same form: of the variance before the
//! split a part B falls as B / M with their number M, and each costs c. The pilot finds B as the difference of two estimates by the same
//! paths, of one light sample and of one of four. Where the picture as a whole shows no such difference, there is no choice.
//!
//! Then camera rays themselves are shared out among the pixels by what they cost and find with these numbers (`allotment`).
//!
//! Later vertices do not split. Tried, by statistics of what paths find from cells of the scene on (after Rath et al. 2022, "EARS",
//! doi:10.1145/3528223.3530168): 0.81 of the efficiency in a kitchen, 0.94 to 1.05 in five other scenes.

use std::ops::Range;

use rayon::prelude::*;

use super::allotment::{Rates, around};
use super::guiding::Lesson;
use super::resampling::MOST_CANDIDATES;
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
/// Light samples of which it chooses one, to compare what that is worth with one light sample.
const COMPARED: u32 = 4;
/// What one light sample without its shadow ray costs, in edges: 0.3 to 0.6 on the scenes of `bench/efficiency.py`.
const CANDIDATE_COST: f64 = 0.5;
/// Standard errors of the mean gain over the picture by which it has to be above zero.
const SIGNIFICANT: f64 = 2.0;
/// Most of the variance before the split that is ascribed to the choice of the light sample: some of it is always the shadows'.
const MOST_SHARE: f64 = 0.95;
/// The pilot's random numbers are not those of the picture.
const PILOT_SEED: u64 = 0x5eed_0f5b_1177_1e55;

/// Into how many a path splits, and what it tells the pilot of that.
#[derive(Clone, Debug)]
pub(super) struct Probe {
    /// Paths that go on from the first surface that does more than mirror or refract.
    pub splits: u32,
    /// Light samples of which one is chosen for direct light on that surface.
    pub candidates: u32,
    /// The same for another estimate of that light, to be compared with; 0 where nobody asks.
    pub compared: u32,
    /// What the other estimate has more than that of the path.
    other: Spectrum,
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
            candidates: 1,
            compared: 0,
            other: Spectrum::ZERO,
            before: Spectrum::ZERO,
            after: [Spectrum::ZERO; CHILDREN as usize],
            edges_before: 0,
            edges_after: 0,
            edges: 0,
            lessons: None,
        }
    }

    /// Direct light where the path is about to split, and another estimate of it.
    #[cold]
    pub fn resampled(&mut self, light: Spectrum, other: Spectrum) {
        self.other = other - light;
    }

    /// The path is about to split, or could, and its direct light is found.
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

/// Numbers of paths and of samples for blocks of pixels.
#[derive(Clone, Debug)]
pub(super) struct Splits {
    /// Rows and columns of pixels in a block.
    block: u32,
    columns: u32,
    rows: u32,
    /// Paths that go on, and light samples of which one is chosen.
    counts: Vec<[u8; 2]>,
    rates: Rates,
}

/// What the pilot knows of a block: a mean, variances of a sample and costs in edges; before and after the split.
#[derive(Clone, Copy, Debug, Default)]
struct Look {
    mean: f64,
    variance: [f64; 2],
    cost: [f64; 2],
    /// How much less variance there is before the split where one of [`COMPARED`] light samples is chosen.
    gain: f64,
    /// Share of the samples that have such a choice.
    choices: f64,
}

impl Splits {
    /// Decides by a pilot, for numbers of paths up to `most`.
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
        let size = [columns as usize, rows as usize];
        let terms = Terms::new(&looks, size);
        let counts = decide(&terms, size, f64::from(most.clamp(1, 255)));
        let rates = if path.allots { Rates::allot(&terms.of_samples(&counts), size) } else { Rates::even(counts.len()) };
        Self { block, columns, rows, counts, rates }
    }

    /// What a path through a pixel does.
    #[inline]
    pub fn at(&self, [x, y]: [u32; 2]) -> Probe {
        let [splits, candidates] = self.counts[self.block_of([x, y])].map(u32::from);
        Probe { candidates, ..Probe::new(splits) }
    }

    fn block_of(&self, [x, y]: [u32; 2]) -> usize {
        let (column, row) = ((x / self.block).min(self.columns - 1), (y / self.block).min(self.rows - 1));
        (row * self.columns + column) as usize
    }

    /// The samples of a pixel that samples of the picture stand for; see [`super::Integrator::samples_of`].
    pub fn samples_of(&self, pixel: [u32; 2], begin: u32, end: u32) -> Range<u32> {
        self.rates.samples_of(self.block_of(pixel), begin, end)
    }

    /// Smallest and greatest number of samples for each of the picture.
    pub fn rates(&self) -> [f64; 2] {
        self.rates.limits()
    }

    /// Smallest, mean and greatest number of paths.
    pub fn splits(&self) -> (u8, f64, u8) {
        self.summary(0)
    }

    /// The same of light samples of which one is chosen.
    pub fn candidates(&self) -> (u8, f64, u8) {
        self.summary(1)
    }

    fn summary(&self, which: usize) -> (u8, f64, u8) {
        let all = || self.counts.iter().map(|counts| counts[which]);
        let sum: f64 = all().map(f64::from).sum();
        (all().min().unwrap_or(1), sum / self.counts.len() as f64, all().max().unwrap_or(1))
    }
}

/// Traces the samples of a pixel of a block.
fn look(path: &Path, scene: &Scene, stage: &Stage, sampler: &Sampler, block: u32, at: [u32; 2]) -> Look {
    let mut estimate = Estimate::default();
    let mut look = Look::default();
    let (mut halves, mut others) = ([0.0; 2], [0.0; 2]);
    let n = f64::from(2 * HALF);
    for ((seed, sum), other) in (sampler.seed..).zip(&mut halves).zip(&mut others) {
        let pixel = [0, 1].map(|a| (at[a] * block + block / 2).min(stage.size[a].saturating_sub(1)));
        let sampler = Sampler { seed, ..*sampler };
        for index in 0..HALF {
            let mut stream = sampler.stream(pixel[0], pixel[1], index);
            let at = Vec2::new(pixel[0] as f32, pixel[1] as f32) + stream.next_2d();
            let camera_ray = scene.camera_ray(at, stream.next_2d());
            estimate.reset(0);
            let mut probe = Probe { compared: COMPARED, ..Probe::new(CHILDREN) };
            path.probe(scene, &camera_ray, &mut stream, &mut estimate, &mut probe);
            let before = finite(probe.before);
            let after = probe.after.map(finite);
            look.mean += (before + 0.5 * (after[0] + after[1])) / n;
            look.variance[1] += 0.5 * (after[0] - after[1]).powi(2) / n;
            look.cost[0] += f64::from(probe.edges_before) / n;
            look.cost[1] += f64::from(probe.edges_after) / (n * f64::from(CHILDREN));
            look.choices += f64::from(u8::from(probe.edges_after > 0)) / n;
            *sum += before / f64::from(HALF);
            *other += (before + finite(probe.other)) / f64::from(HALF);
        }
    }
    let variance = |halves: [f64; 2]| 0.5 * (halves[0] - halves[1]).powi(2) * f64::from(HALF);
    look.variance[0] = variance(halves);
    look.gain = look.variance[0] - variance(others);
    look
}

fn finite(light: Spectrum) -> f64 {
    let luminance = f64::from(light.luminance());
    if luminance.is_finite() { luminance } else { 0.0 }
}

/// Weights that make variances relative to what is seen.
fn weights(looks: &[Look], size: [usize; 2]) -> Vec<f64> {
    let mean = around(&looks.iter().map(|l| l.mean).collect::<Vec<_>>(), size, 1, true);
    let of_all = mean.iter().sum::<f64>() / mean.len() as f64;
    mean.iter().map(|mean| 1.0 / (mean * mean + 0.01 * of_all * of_all).max(1e-300)).collect()
}

/// What the pilot found of all blocks in terms of what is chosen: weighed errors and costs of a sample.
struct Terms {
    /// Of what is the same whatever is chosen; one light sample is in the cost.
    fixed: Vec<[f64; 2]>,
    /// Of what goes by the number of paths and by that of light samples.
    shares: Vec<[[f64; 2]; 2]>,
}

impl Terms {
    fn new(looks: &[Look], size: [usize; 2]) -> Self {
        let weights = weights(looks, size);
        let weighted = |of: fn(&Look) -> f64| looks.iter().zip(&weights).map(|(l, w)| of(l) * w).collect::<Vec<_>>();
        let before = weighted(|l| l.variance[0]);
        let resampled = resampled_variances(&weighted(|l| l.gain), &before, size);
        let after = weighted(|l| l.variance[1]);
        let of_choice = |l: &Look| CANDIDATE_COST * l.choices;
        let shares = looks.iter().enumerate().map(|(i, l)| [[after[i], l.cost[1]], [resampled[i], of_choice(l)]]).collect();
        let fixed = looks.iter().enumerate().map(|(i, l)| [before[i] - resampled[i], l.cost[0] - of_choice(l)]).collect();
        Self { fixed, shares }
    }

    /// Error and cost of a sample of a block by so many paths and light samples.
    fn of(&self, i: usize, counts: [f64; 2]) -> [f64; 2] {
        let sum = |[error, cost]: [f64; 2], (share, k): ([f64; 2], f64)| [error + share[0] / k, cost + share[1] * k];
        self.shares[i].into_iter().zip(counts).fold(self.fixed[i], sum)
    }

    /// Error and cost of a sample of each block.
    fn of_samples(&self, counts: &[[u8; 2]]) -> Vec<[f64; 2]> {
        counts.iter().enumerate().map(|(i, counts)| self.of(i, counts.map(f64::from))).collect()
    }
}

/// The numbers of paths and of light samples that are best for what the pilot has seen.
fn decide(terms: &Terms, size: [usize; 2], most: f64) -> Vec<[u8; 2]> {
    let most = [most, f64::from(MOST_CANDIDATES)];
    // Blocks at the limits count as costs and errors of what is the same whatever the number; a few rounds settle which these are.
    let ideal = |[error, cost]: [f64; 2], scale: f64| if cost == 0.0 { 1.0 } else { (error / cost).sqrt() * scale };
    let mut scale = 0.0;
    for _ in 0..8 {
        let (mut cost, mut error) = (0.0, 0.0);
        for (fixed, shares) in terms.fixed.iter().zip(&terms.shares) {
            error += fixed[0];
            cost += fixed[1];
            for (&share, most) in shares.iter().zip(most) {
                let k = ideal(share, scale);
                if k <= 1.0 || k >= most {
                    let k = k.clamp(1.0, most);
                    cost += share[1] * k;
                    error += share[0] / k;
                }
            }
        }
        scale = (cost / error.max(1e-300)).sqrt();
    }
    let numbers = [0, 1].map(|which| {
        let ideals: Vec<f64> = terms.shares.iter().map(|share| ideal(share[which], scale).clamp(1.0, most[which])).collect();
        around(&ideals, size, 1, true)
    });
    let rounded = |k: f64| (k + 0.5).max(1.0) as u8;
    (0..terms.fixed.len()).map(|i| [rounded(numbers[0][i]), rounded(numbers[1][i])]).collect()
}

/// The part of each block's variance that falls with the number of light samples, from how much lower that was by [`COMPARED`] of
/// them; zero everywhere where the picture as a whole does not show that there is any.
fn resampled_variances(gains: &[f64], variances: &[f64], size: [usize; 2]) -> Vec<f64> {
    let n = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n * (n - 1.0));
    if gains.len() < 2 || !(mean > SIGNIFICANT * variance.sqrt()) {
        return vec![0.0; gains.len()];
    }
    let all = f64::from(COMPARED) / f64::from(COMPARED - 1);
    let means = |of: &[f64]| around(of, size, 1, true);
    means(gains).iter().zip(means(variances)).map(|(g, v)| (all * g).min(MOST_SHARE * v).max(0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(variance: [f64; 2], cost: [f64; 2]) -> Look {
        Look { mean: 1.0, variance, cost, gain: 0.0, choices: 1.0 }
    }

    /// Light samples are as many as is best of all, with and without splits, and one where there is nothing but chance in what they gain.
    #[test]
    fn light_samples_are_as_many_as_pay() {
        for (falls, after) in [(3.2, 0.1), (3.2, 8.0), (1.0, 0.5), (0.1, 0.5)] {
            let l = Look { gain: 0.75 * falls, ..look([4.0, after], [2.0, 3.0]) };
            let counts = decide(&Terms::new(&[l; 9], [3, 3]), [3, 3], 16.0);
            let product = |[k, m]: [u8; 2]| {
                let (k, m) = (f64::from(k), f64::from(m));
                let error = l.variance[0] - falls + falls / m + l.variance[1] / k;
                error * (l.cost[0] + CANDIDATE_COST * (m - 1.0) + l.cost[1] * k)
            };
            let all = (1..=16).flat_map(|k| (1..=MOST_CANDIDATES as u8).map(move |m| [k, m]));
            let best = all.min_by(|a, b| product(*a).total_cmp(&product(*b))).map_or(0.0, product);
            assert!(product(counts[4]) < 1.03 * best, "{counts:?} for {falls}, {after}");
        }
        let chance: Vec<Look> = (0..64).map(|i| Look { gain: [2.0, -1.9][i % 2], ..look([4.0, 1.0], [2.0, 3.0]) }).collect();
        assert!(decide(&Terms::new(&chance, [8, 8]), [8, 8], 16.0).iter().all(|counts| counts[1] == 1));
        let mut part = chance;
        for l in part.iter_mut().take(16) {
            l.gain = 3.0;
        }
        let counts = decide(&Terms::new(&part, [8, 8]), [8, 8], 16.0);
        assert!(counts[0][1] > 2 && counts[0][1] > counts[60][1], "{counts:?}");
    }

    /// The numbers against a search over all of them for the least product of error and cost.
    #[test]
    fn numbers_are_the_best_there_are() {
        for looks in [[look([0.5, 8.0], [2.0, 3.0]); 4], [look([0.5, 1.0], [2.0, 9.0]); 4], [look([1e-3, 9.0], [2.0, 3.0]); 4]] {
            let counts = decide(&Terms::new(&looks, [2, 2]), [2, 2], 16.0);
            let product = |k: u8| {
                let (k, l) = (f64::from(k), looks[0]);
                (l.variance[0] + l.variance[1] / k) * (l.cost[0] + l.cost[1] * k)
            };
            let best = (1..=16).min_by(|a, b| product(*a).total_cmp(&product(*b))).unwrap_or(0);
            assert_eq!(counts, vec![[best, 1]; 4], "{:?}", looks[0]);
        }
    }

    /// Where noise is, paths go: a column of blocks with all of the noise between quiet ones.
    #[test]
    fn noisy_blocks_get_more() {
        let looks: Vec<Look> = (0..40).map(|i| look([0.01, if i % 10 < 3 { 4.0 } else { 0.0 }], [2.0, 3.0])).collect();
        let counts = decide(&Terms::new(&looks, [10, 4]), [10, 4], 16.0);
        assert!(counts[1][0] > 4 && counts[7][0] == 1, "{counts:?}");
    }

    #[test]
    fn what_is_no_number_splits_nothing() {
        for bad in [f64::NAN, f64::INFINITY, 1e300, 0.0] {
            for looks in [
                [Look { mean: bad, ..look([1.0; 2], [1.0; 2]) }],
                [look([bad; 2], [1.0; 2])],
                [look([bad; 2], [bad; 2])],
                [Look { gain: bad, ..look([1.0; 2], [1.0; 2]) }],
            ] {
                let counts = decide(&Terms::new(&looks, [1, 1]), [1, 1], 16.0);
                assert!((1..=16).contains(&counts[0][0]), "{counts:?} of {bad}");
                assert!((1..=MOST_CANDIDATES as u8).contains(&counts[0][1]), "{counts:?} of {bad}");
                let terms = Terms::new(&looks, [1, 1]);
                assert_eq!(Rates::allot(&terms.of_samples(&counts), [1, 1]), Rates::even(1), "{bad}");
            }
        }
    }
}
