//! How many samples pixels take, decided before the first of them.
//!
//! With variance V and cost C of a sample, numbers of samples in proportion to √(V / C) find most (Neyman 1934,
//! doi:10.2307/2342192). A sample of the picture then stands for more samples of noisy pixels and for less than one of others.
//! Unlike sampling that looks at what it has found so far (`session::adaptive`) this has no bias.

use std::ops::Range;

/// A rate of one sample for each of the picture.
const RATE_ONE: u16 = 16;
/// Limits of rates: edges of things that the pilot has not seen are smooth with half of the samples as well.
const LEAST_RATE: f64 = 0.5;
const MOST_RATE: f64 = 8.0;
/// Blocks in each direction that a rate comes from.
const REACH: usize = 2;
/// The least gain in efficiency for which pixels take different numbers of samples.
const LEAST_GAIN: f64 = 1.05;

/// Samples of a pixel for each of the picture, in [`RATE_ONE`]-ths, for blocks of pixels.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rates(Vec<u16>);

impl Rates {
    /// As many samples for each pixel.
    pub fn even(blocks: usize) -> Self {
        Self(vec![RATE_ONE; blocks])
    }

    /// The best for blocks whose samples have such errors and costs; none takes more than others unless that is worth it.
    pub fn allot(samples: &[[f64; 2]], size: [usize; 2]) -> Self {
        let finite = |variance: f64| if variance.is_finite() { variance.max(0.0) } else { 0.0 };
        let (mut variances, costs): (Vec<f64>, Vec<f64>) = samples.iter().map(|[error, cost]| (finite(*error), cost.max(1.0))).unzip();
        // A few blocks that have met a rare bright path say nothing of others.
        let mut sorted = variances.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let most = sorted[(sorted.len() - 1) * 49 / 50];
        variances.iter_mut().for_each(|v| *v = v.min(most));
        let ideals: Vec<f64> = variances.iter().zip(&costs).map(|(v, c)| (v / c).sqrt()).collect();
        // What a block gains by what others say of it is no matter of chance.
        let others = scaled(&around(&ideals, size, REACH, false));
        let product = |rate: &dyn Fn(usize) -> f64| {
            let sum = |f: &dyn Fn(usize) -> f64| (0..costs.len()).map(f).sum::<f64>();
            sum(&|i| variances[i] / rate(i)) * sum(&|i| costs[i] * rate(i))
        };
        let gain = product(&|_| 1.0) / product(&|i| others[i]);
        // The comparison is so turned that what is no number changes nothing.
        if !(gain > LEAST_GAIN) {
            return Self::even(samples.len());
        }
        Self(scaled(&around(&ideals, size, REACH, true)).iter().map(|r| (r * f64::from(RATE_ONE)).round() as u16).collect())
    }

    /// The samples of a pixel of a block that samples of the picture stand for; see [`super::Integrator::samples_of`].
    pub fn samples_of(&self, block: usize, begin: u32, end: u32) -> Range<u32> {
        let rate = u64::from(self.0[block]);
        let at = |index: u32| (u64::from(index) * rate).div_ceil(u64::from(RATE_ONE)).min(u64::from(u32::MAX - 1)) as u32;
        at(begin)..at(end)
    }

    /// Smallest and greatest number of samples for each of the picture.
    pub fn limits(&self) -> [f64; 2] {
        let all = || self.0.iter().map(|&rate| f64::from(rate) / f64::from(RATE_ONE));
        [all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max)]
    }
}

/// Values at the scale at which their mean is 1 with none beyond the limits of rates.
fn scaled(values: &[f64]) -> Vec<f64> {
    let at = |scale: f64| values.iter().map(move |v| (v * scale).clamp(LEAST_RATE, MOST_RATE));
    let mean = |scale: f64| at(scale).sum::<f64>() / values.len() as f64;
    // By halves of the logarithm, over all scales that there can be.
    let (mut low, mut high) = (1e-150_f64, 1e150_f64);
    for _ in 0..60 {
        let middle = low.sqrt() * high.sqrt();
        if mean(middle) < 1.0 { low = middle } else { high = middle }
    }
    at(high).collect()
}

/// Means over blocks up to so many columns and rows away, with or without the block itself.
pub(super) fn around(values: &[f64], [columns, rows]: [usize; 2], reach: usize, with_own: bool) -> Vec<f64> {
    (0..values.len())
        .map(|i| {
            let (x, y) = (i % columns, i / columns);
            let (mut sum, mut n) = (0.0, 0.0);
            for row in y.saturating_sub(reach)..(y + reach + 1).min(rows) {
                for column in x.saturating_sub(reach)..(x + reach + 1).min(columns) {
                    if with_own || (column, row) != (x, y) {
                        sum += values[row * columns + column];
                        n += 1.0;
                    }
                }
            }
            if n > 0.0 { sum / n } else { values[i] }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where noise is, samples go, as many in the mean and within the limits; none where there is nothing to win, or nothing but chance.
    #[test]
    fn samples_go_where_noise_is() {
        let rates = |variance: &dyn Fn(usize) -> f64| {
            let samples: Vec<[f64; 2]> = (0..400).map(|i| [variance(i), 5.0]).collect();
            Rates::allot(&samples, [20, 20]).0
        };
        let of_quarter = rates(&|i| if i % 20 < 5 { 4.0 } else { 0.04 });
        let mean = of_quarter.iter().map(|&r| f64::from(r)).sum::<f64>() / (400.0 * f64::from(RATE_ONE));
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
        assert!(of_quarter[42] > 2 * RATE_ONE && of_quarter[55] == RATE_ONE / 2, "{of_quarter:?}");
        let chance = |i: usize| f64::from(crate::math::hash::hash_words([i as u64]) as u32 % 1000).powi(2);
        for even in [rates(&|_| 3.0), rates(&|_| 0.0), rates(&chance), rates(&|i| if i == 77 { 1e9 } else { 1.0 })] {
            assert_eq!(even, [RATE_ONE; 400]);
        }
    }

    #[test]
    fn ranges_of_samples_join() {
        for rate in [8, 16, 23, 128] {
            let rates = Rates(vec![rate]);
            let mut at = 0;
            for (begin, end) in [(0, 1), (1, 2), (2, 7), (7, 1000), (1000, 4096)] {
                let range = rates.samples_of(0, begin, end);
                assert_eq!(range.start, at, "{rate}");
                at = range.end;
                assert!(at > 0, "each pixel has a sample");
            }
            assert_eq!(at, 4096 * u32::from(rate) / u32::from(RATE_ONE));
            assert!(rates.samples_of(0, u32::MAX - 5, u32::MAX).end < u32::MAX);
        }
    }
}
