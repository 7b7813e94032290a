//! Random numbers as a function of (seed, pixel, sample index, dimension).
//!
//! There is no state that threads could share or reorder: a pixel's n-th sample is the same whoever renders it. A
//! [`Sampler`] is a choice of sequence; [`Sampler::stream`] gives the numbers of one sample in the order in which a
//! path asks for them.

mod halton;
mod rng;
mod sobol;
mod stratified;

pub use rng::HashRng;

use crate::math::hash::{hash_words, mix32, unit_float};
use crate::math::{ONE_MINUS_EPSILON, Vec2};

/// Which sequence the numbers come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SamplerKind {
    /// Owen-scrambled Sobol' pairs, shuffled for each dimension: the default.
    #[default]
    Sobol,
    /// Independent pseudo-random numbers.
    Independent,
    /// Correlated multi-jittered strata; wants to know the number of samples.
    Stratified,
    /// Halton's sequence with scrambled digits in the first dimensions, independent numbers beyond.
    Halton,
}

impl SamplerKind {
    /// By the name that the user types; `None` where there is no such sampler.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "sobol" => Self::Sobol,
            "independent" => Self::Independent,
            "stratified" => Self::Stratified,
            "halton" => Self::Halton,
            _ => return None,
        })
    }
}

/// A sequence with its seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampler {
    /// Which sequence.
    pub kind: SamplerKind,
    /// Selects one of 2⁶⁴ randomizations.
    pub seed: u64,
    /// Samples per pixel that are planned; only the stratified sequence uses it.
    pub spp: u32,
}

impl Sampler {
    /// The numbers of one sample of one pixel.
    #[inline]
    pub fn stream(&self, x: u32, y: u32, index: u32) -> SampleStream {
        let pixel = hash_words([self.seed, u64::from(x) << 32 | u64::from(y)]);
        let pixel = [pixel as u32, (pixel >> 32) as u32];
        SampleStream { kind: self.kind, spp: self.spp, at: [x, y], pixel, index, reversed_index: index.reverse_bits(), dimension: 0 }
    }
}

/// The numbers of one sample, in [0, 1), one dimension after the other.
#[derive(Clone, Copy, Debug)]
pub struct SampleStream {
    kind: SamplerKind,
    spp: u32,
    at: [u32; 2],
    pixel: [u32; 2],
    index: u32,
    reversed_index: u32,
    dimension: u32,
}

impl SampleStream {
    /// Column and row of the pixel.
    #[inline]
    #[expect(clippy::misnamed_getters, reason = "the field `pixel` is what the pixel is scrambled by")]
    pub fn pixel(&self) -> [u32; 2] {
        self.at
    }

    /// Index of the sample.
    #[inline]
    pub fn index(&self) -> u32 {
        self.index
    }

    /// The numbers of another sample of the same pixel, from the start; what is the same for all of a pixel's samples is not made again.
    #[inline]
    pub fn of_sample(&self, index: u32) -> Self {
        Self { index, reversed_index: index.reverse_bits(), dimension: 0, ..*self }
    }

    /// The same sample's numbers from a dimension on: for parts of a sample that must not shift each other's numbers.
    #[inline]
    pub fn at(&self, dimension: u32) -> Self {
        Self { dimension, ..*self }
    }

    /// The numbers from here on of the `j`-th of `n` paths into which those of all samples of the pixel split here: all of them together are
    /// as well distributed as a sequence `n` times as long.
    #[inline]
    pub fn split(&self, n: u32, j: u32) -> Self {
        let index = self.index.wrapping_mul(n).wrapping_add(j);
        Self { index, reversed_index: index.reverse_bits(), ..*self }
    }

    /// The next `numbers` as a stream of their own, and goes on behind them: what of them is not asked for is never made, and those that
    /// follow stay the same.
    #[inline]
    pub fn part(&mut self, numbers: u32) -> Self {
        let part = *self;
        self.dimension += numbers;
        part
    }

    /// Passes over a number that would not be used; returns 0.
    #[inline]
    pub fn skip_1d(&mut self) -> f32 {
        self.dimension += 1;
        0.0
    }

    /// Two hash words for the current dimension; different for each pixel, dimension and seed, the same for each sample index.
    #[inline]
    fn dimension_hash(&self) -> [u32; 2] {
        let a = mix32(self.pixel[0] ^ self.dimension.wrapping_mul(0x9e37_79b9));
        [a, mix32(self.pixel[1] ^ a)]
    }

    /// Numbers without an end that belong to the current dimension, whatever the sequence. Takes no dimension: the numbers that follow
    /// are the same with and without it, and two generators made at one dimension give the same numbers.
    #[inline]
    pub fn rng(&self) -> HashRng {
        let [a, b] = self.dimension_hash();
        HashRng::new(hash_words([u64::from(a) << 32 | u64::from(b), u64::from(self.index) ^ 0x6d65_6469_756d_0000]))
    }

    /// The next number.
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        let [a, b] = self.dimension_hash();
        let v = match self.kind {
            SamplerKind::Sobol => sobol::sample_1d(self.reversed_index, a, b),
            SamplerKind::Independent => unit_float(mix32(a ^ mix32(b ^ self.index))),
            SamplerKind::Stratified => stratified::sample_1d(self.index, self.spp, a),
            SamplerKind::Halton => halton::sample(self.index, self.dimension, a),
        };
        self.dimension += 1;
        v.min(ONE_MINUS_EPSILON)
    }

    /// The next pair without regard to other samples, whatever the sequence: cheap, for numbers of which a sample takes many.
    #[inline]
    pub fn next_independent_2d(&mut self) -> Vec2 {
        let [a, b] = self.dimension_hash();
        self.dimension += 2;
        independent_2d(a, b, self.index).min(Vec2::splat(ONE_MINUS_EPSILON))
    }

    /// The next pair from a cell of a grid of n × n that is this sample's alone, whatever the sequence: for sets of samples of which all
    /// are taken, none, or the first four, which lie in the corners, so that their order need not be shuffled. The cell in the middle comes
    /// last. `n` is 1 to 65,535.
    #[inline]
    pub fn next_grid_2d(&mut self, n: u32) -> Vec2 {
        let inner = self.next_independent_2d();
        let n = n.clamp(1, 0xffff);
        // No division by a variable where the grid is the usual one, of three.
        let cell = if n == 3 { grid_cell(self.index % 9, 3) } else { grid_cell(self.index % (n * n), n) };
        ((cell + inner) / n as f32).min(Vec2::splat(ONE_MINUS_EPSILON))
    }

    /// Passes over a pair, so that the numbers that follow are the same as after [`SampleStream::next_2d`]; returns zeros.
    #[inline]
    pub fn skip_2d(&mut self) -> Vec2 {
        self.dimension += 2;
        Vec2::ZERO
    }

    /// The next pair, well distributed as a pair.
    #[inline]
    pub fn next_2d(&mut self) -> Vec2 {
        let [a, b] = self.dimension_hash();
        let v = match self.kind {
            SamplerKind::Sobol => sobol::sample_2d(self.reversed_index, a, b),
            SamplerKind::Independent => independent_2d(a, b, self.index),
            SamplerKind::Stratified => stratified::sample_2d(self.index, self.spp, a),
            SamplerKind::Halton => {
                Vec2::new(halton::sample(self.index, self.dimension, a), halton::sample(self.index, self.dimension + 1, b))
            }
        };
        self.dimension += 2;
        v.min(Vec2::splat(ONE_MINUS_EPSILON))
    }
}

/// Column and row of a cell of a grid of n × n; the corners come first, and the middle last.
#[inline(always)]
fn grid_cell(index: u32, n: u32) -> Vec2 {
    let (upper_right, lower_left, last) = (n - 1, n * n - n, n * n - 1);
    let cell = match index {
        0 => 0,
        1 => upper_right,
        2 => last,
        3 => lower_left,
        _ if index == last && n % 2 == 1 => last / 2,
        _ => {
            // The others in their order, past the upper right, the middle and the lower left.
            let cell = index - 3;
            let cell = cell + u32::from(cell >= upper_right);
            let cell = cell + u32::from(cell >= last / 2 && n % 2 == 1);
            cell + u32::from(cell >= lower_left)
        }
    };
    Vec2::new((cell % n) as f32, (cell / n) as f32)
}

#[inline]
fn independent_2d(a: u32, b: u32, index: u32) -> Vec2 {
    let h = mix32(a ^ mix32(b ^ index));
    Vec2::new(unit_float(h), unit_float(mix32(h ^ 0x68e3_1da4)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [SamplerKind; 4] = [SamplerKind::Sobol, SamplerKind::Independent, SamplerKind::Stratified, SamplerKind::Halton];

    #[test]
    fn numbers_are_uniform_within_pixels_and_across_them() {
        for kind in KINDS {
            for seed in [0, 7] {
                let sampler = Sampler { kind, seed, spp: 256 };
                // Per pixel over samples, and over pixels at one sample, in a low and a high dimension.
                for skip in [0, 40] {
                    let mut sums = [0.0f64; 2];
                    for i in 0..4096u32 {
                        let (pixel, index) = if skip == 0 { (3, i) } else { (i, 5) };
                        let mut s = sampler.stream(pixel, 11, index);
                        for _ in 0..skip {
                            s.next_1d();
                        }
                        let u = s.next_2d();
                        assert!((0.0..1.0).contains(&u.x) && (0.0..1.0).contains(&u.y), "{kind:?} {u}");
                        sums[0] += f64::from(u.x);
                        sums[1] += f64::from(u.x * u.y);
                    }
                    // Six standard errors of independent numbers.
                    assert!((sums[0] / 4096.0 - 0.5).abs() < 6.0 * 0.29 / 64.0, "{kind:?} {sums:?}");
                    assert!((sums[1] / 4096.0 - 0.25).abs() < 6.0 * 0.22 / 64.0, "{kind:?} {sums:?}");
                }
            }
        }
    }

    #[test]
    fn sobol_pairs_are_a_zero_two_net_in_every_dimension() {
        let sampler = Sampler { kind: SamplerKind::Sobol, seed: 3, spp: 64 };
        for skip in 0..6 {
            // Elementary intervals of 64 points: each of 64 cells of every shape holds exactly one.
            for log_w in 0..=6u32 {
                let mut seen = [false; 64];
                for i in 0..64 {
                    let mut s = sampler.stream(9, 2, i);
                    for _ in 0..skip {
                        s.next_2d();
                    }
                    let u = s.next_2d();
                    let (w, h) = ((1u32 << log_w) as f32, (64u32 >> log_w) as f32);
                    let cell = (u.x * w) as usize + (u.y * h) as usize * w as usize;
                    assert!(!std::mem::replace(&mut seen[cell], true), "dimension pair {skip}, cells {w} x {h}");
                }
            }
        }
    }

    /// Samples that all split into as many have the strata of a sequence so many times as long, from the split on.
    #[test]
    fn split_samples_are_stratified_together() {
        let sampler = Sampler { kind: SamplerKind::Sobol, seed: 5, spp: 16 };
        let mut seen = [false; 64];
        for (index, j) in (0..16).flat_map(|i| (0..4).map(move |j| (i, j))) {
            let mut parent = sampler.stream(7, 7, index);
            parent.next_2d();
            let u = parent.split(4, j).next_2d();
            assert!(!std::mem::replace(&mut seen[(u.x * 8.0) as usize + (u.y * 8.0) as usize * 8], true), "sample {index}, branch {j}");
        }
    }

    #[test]
    fn stratified_samples_fall_into_their_strata() {
        for spp in [16, 17, 64] {
            let sampler = Sampler { kind: SamplerKind::Stratified, seed: 1, spp };
            let mut seen = vec![false; spp as usize];
            for i in 0..spp {
                let u = sampler.stream(0, 0, i).next_1d();
                assert!(!std::mem::replace(&mut seen[(u * spp as f32) as usize], true), "{spp}");
            }
        }
    }

    #[test]
    fn grids_have_a_sample_in_each_cell_and_begin_in_the_corners() {
        for n in [1u32, 2, 3, 4, 9] {
            let sampler = Sampler { kind: SamplerKind::Stratified, seed: 1, spp: n * n };
            let mut seen = vec![false; (n * n) as usize];
            for i in 0..n * n {
                let mut stream = sampler.stream(5, 3, i);
                let u = stream.next_grid_2d(n);
                let mut after = sampler.stream(5, 3, i);
                after.skip_2d();
                assert_eq!(stream.next_1d(), after.next_1d(), "what follows does not depend on it");
                let [x, y] = [u.x, u.y].map(|v| (v * n as f32) as u32);
                assert!(!std::mem::replace(&mut seen[(x + n * y) as usize], true), "{u} of {n}");
                assert!(i >= 4 || [x, y].iter().all(|v| *v == 0 || *v == n - 1), "{u} of {n}");
                assert!((x, y) != (n / 2, n / 2) || n % 2 == 0 || i == n * n - 1, "{u} of {n}");
            }
        }
        assert!(Sampler { kind: SamplerKind::Stratified, seed: 1, spp: 9 }.stream(0, 0, u32::MAX).next_grid_2d(u32::MAX).is_finite());
    }

    #[test]
    fn dimensions_are_uncorrelated() {
        for kind in KINDS {
            let sampler = Sampler { kind, seed: 5, spp: 1024 };
            let mut sum = [0.0f64; 3];
            for i in 0..1024 {
                let mut s = sampler.stream(4, 4, i);
                let (a, b) = (s.next_2d(), s.next_2d());
                let c = s.next_1d();
                sum[0] += f64::from((a.x - 0.5) * (b.x - 0.5));
                sum[1] += f64::from((a.y - 0.5) * (b.y - 0.5));
                sum[2] += f64::from((a.x - 0.5) * (c - 0.5));
            }
            assert!(sum.iter().all(|s| (s / 1024.0).abs() < 5.0 / 12.0 / 32.0), "{kind:?} {sum:?}");
        }
    }
}
