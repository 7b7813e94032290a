//! Reconstruction filters and filter importance sampling.
//!
//! Camera samples are drawn in proportion to |f| about the centre of their pixel and count for that pixel alone
//! (Ernst, Stamminger, Greiner 2006, "Filter Importance Sampling", doi:10.1109/RT.2006.280223). Pixels stay
//! independent of each other, so that tiles need no borders and a film merges pixel by pixel.
//!
//! All filters are products f(x)·f(y) of a symmetric function of one coordinate, in pixels from the pixel's centre.
//! Parameters and defaults are those of Mitsuba 3's filters of the same names.

use serde::{Deserialize, Serialize};

use crate::math::{ONE_MINUS_EPSILON, PI, PiecewiseConstant1D, Vec2, fns};

/// Which filter weighs a pixel's samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Filter {
    /// Constant up to `radius` (0.5: the pixel's own square).
    Box {
        /// Half the width in pixels.
        radius: f32,
    },
    /// Falls linearly from the centre to zero at `radius`.
    Tent {
        /// Half the width in pixels.
        radius: f32,
    },
    /// Gaussian, cut and shifted to zero at four standard deviations.
    Gaussian {
        /// Standard deviation in pixels.
        stddev: f32,
    },
    /// The cubic of Mitchell and Netravali 1988, "Reconstruction Filters in Computer Graphics",
    /// doi:10.1145/54852.378514, eq. 8; radius 2, partly negative.
    Mitchell {
        /// Blur.
        b: f32,
        /// Ringing.
        c: f32,
    },
    /// The four-term window of Harris 1978, "On the Use of Windows for Harmonic Analysis",
    /// doi:10.1109/PROC.1978.10837, table I (minimum 4-term).
    BlackmanHarris {
        /// Half the width in pixels.
        radius: f32,
    },
    /// Sinc under a sinc window of `lobes` lobes (Duchon 1979); the sharpest, partly negative.
    Lanczos {
        /// Half the width in pixels.
        lobes: f32,
    },
}

impl Default for Filter {
    fn default() -> Self {
        Self::GAUSSIAN
    }
}

impl Filter {
    /// The pixel's own square.
    pub const BOX: Self = Self::Box { radius: 0.5 };
    /// Tent of radius 1.
    pub const TENT: Self = Self::Tent { radius: 1.0 };
    /// Gaussian of standard deviation 0.5.
    pub const GAUSSIAN: Self = Self::Gaussian { stddev: 0.5 };
    /// Mitchell–Netravali with B = C = 1/3.
    pub const MITCHELL: Self = Self::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 };
    /// Blackman–Harris of radius 1.5.
    pub const BLACKMAN_HARRIS: Self = Self::BlackmanHarris { radius: 1.5 };
    /// Lanczos of three lobes.
    pub const LANCZOS: Self = Self::Lanczos { lobes: 3.0 };

    /// Names for [`Filter::from_name`].
    pub const NAMES: [&str; 6] = ["box", "tent", "gaussian", "mitchell", "blackman-harris", "lanczos"];

    /// The filter of that name with its default parameters.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "box" => Self::BOX,
            "tent" => Self::TENT,
            "gaussian" => Self::GAUSSIAN,
            "mitchell" => Self::MITCHELL,
            "blackman-harris" => Self::BLACKMAN_HARRIS,
            "lanczos" => Self::LANCZOS,
            _ => return None,
        })
    }

    /// Half the width of the square, in pixels, outside of which the filter is zero.
    pub fn radius(&self) -> f32 {
        match *self {
            Self::Box { radius } | Self::Tent { radius } | Self::BlackmanHarris { radius } => radius,
            Self::Gaussian { stddev } => 4.0 * stddev,
            Self::Mitchell { .. } => 2.0,
            Self::Lanczos { lobes } => lobes,
        }
    }

    /// True where the parameters make a filter: finite, of a positive radius of at most 64 pixels, with a positive integral.
    pub fn is_valid(&self) -> bool {
        let radius = self.radius();
        let bounded = match *self {
            Self::Mitchell { b, c } => b.abs() <= 4.0 && c.abs() <= 4.0,
            _ => true,
        };
        bounded && radius > 1e-4 && radius <= 64.0 && FilterSampler::integral_1d(self) > 1e-3 * f64::from(radius)
    }

    /// The filter's value at an offset from the pixel's centre in pixels; not normalized.
    pub fn eval(&self, x: f32, y: f32) -> f32 {
        self.eval_1d(x) * self.eval_1d(y)
    }

    /// One of the two factors of [`Filter::eval`].
    pub fn eval_1d(&self, x: f32) -> f32 {
        let x = x.abs();
        let radius = self.radius();
        if x > radius {
            return 0.0;
        }
        match *self {
            Self::Box { .. } => 1.0,
            Self::Tent { .. } => 1.0 - x / radius,
            Self::Gaussian { stddev } => {
                let alpha = -0.5 / (stddev * stddev);
                (fns::exp(alpha * x * x) - fns::exp(alpha * radius * radius)).max(0.0)
            }
            Self::Mitchell { b, c } => {
                let (x2, x3) = (x * x, x * x * x);
                let sixfold = if x < 1.0 {
                    (12.0 - 9.0 * b - 6.0 * c) * x3 + (-18.0 + 12.0 * b + 6.0 * c) * x2 + (6.0 - 2.0 * b)
                } else {
                    (-b - 6.0 * c) * x3 + (6.0 * b + 30.0 * c) * x2 + (-12.0 * b - 48.0 * c) * x + (8.0 * b + 24.0 * c)
                };
                sixfold / 6.0
            }
            Self::BlackmanHarris { .. } => {
                let t = PI * x / radius;
                (0.358_75 + 0.488_29 * fns::cos(t) + 0.141_28 * fns::cos(2.0 * t) + 0.011_68 * fns::cos(3.0 * t)).max(0.0)
            }
            Self::Lanczos { lobes } => sinc(x) * sinc(x / lobes),
        }
    }
}

/// sin(πx) / (πx)
fn sinc(x: f32) -> f32 {
    let t = PI * x;
    if t < 1e-4 { 1.0 } else { fns::sin(t) / t }
}

/// Where a camera sample of a pixel lies and how much it counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterSample {
    /// From the pixel's centre, in pixels.
    pub offset: Vec2,
    /// f / pdf for the filter normalized to integral 1: always ±c with a constant c of the filter (1 where it is
    /// nowhere negative); its expectation is 1.
    pub weight: f32,
}

/// Draws offsets in proportion to |f|.
#[derive(Clone, Debug)]
pub struct FilterSampler {
    filter: Filter,
    table: PiecewiseConstant1D,
    /// The sign of f in each cell; empty where the filter is nowhere negative.
    negative: Vec<bool>,
    weight: f32,
    /// ∫ f(x) dx of one factor.
    integral: f32,
}

/// Cells of the table over the filter's width: fine enough that its steps (1/170 of a pixel for the widest default
/// filter) are far below what a picture shows.
const CELLS: usize = 1024;

impl FilterSampler {
    /// Tabulates the filter.
    pub fn new(filter: Filter) -> Self {
        let values: Vec<f32> = (0..CELLS).map(|i| filter.eval_1d(cell_center(i, filter.radius()))).collect();
        let magnitudes: Vec<f32> = values.iter().map(|v| v.abs()).collect();
        let negative: Vec<bool> = values.iter().map(|&v| v < 0.0).collect();
        let any_negative = negative.contains(&true);
        let ratio = magnitudes.iter().map(|&v| f64::from(v)).sum::<f64>() / values.iter().map(|&v| f64::from(v)).sum::<f64>();
        Self {
            filter,
            table: PiecewiseConstant1D::new(&magnitudes),
            negative: if any_negative { negative } else { Vec::new() },
            weight: if any_negative { (ratio * ratio) as f32 } else { 1.0 },
            integral: Self::integral_1d(&filter) as f32,
        }
    }

    /// The filter that is sampled.
    pub fn filter(&self) -> &Filter {
        &self.filter
    }

    /// ∫ f(x) dx over the tabulated filter.
    fn integral_1d(filter: &Filter) -> f64 {
        let radius = filter.radius();
        (0..CELLS).map(|i| f64::from(filter.eval_1d(cell_center(i, radius)))).sum::<f64>() * 2.0 * f64::from(radius) / CELLS as f64
    }

    /// The camera sample for `u` in [0,1)²; neighboring `u` give neighboring offsets.
    #[inline]
    pub fn sample(&self, u: Vec2) -> FilterSample {
        if let Filter::Box { radius } = self.filter {
            return FilterSample { offset: (2.0 * u - Vec2::ONE) * radius, weight: 1.0 };
        }
        let (x, _, ix) = self.table.sample(u.x);
        let (y, _, iy) = self.table.sample(u.y);
        let offset = (2.0 * Vec2::new(x, y) - Vec2::ONE) * self.filter.radius();
        let flip = !self.negative.is_empty() && (self.negative[ix] != self.negative[iy]);
        FilterSample { offset, weight: if flip { -self.weight } else { self.weight } }
    }

    /// The pixel that a splat at a point of the picture goes to, in pixels, and what it counts there: one of those whose filters reach
    /// the point, chosen by how much they take of it, so that each gets the normalized filter's share on average. `None` where no
    /// filter reaches the point.
    pub fn land(&self, picture: Vec2, u: Vec2) -> Option<(i32, i32, f32)> {
        let (x, weight_x) = self.land_1d(picture.x, u.x)?;
        let (y, weight_y) = self.land_1d(picture.y, u.y)?;
        Some((x, y, weight_x * weight_y))
    }

    /// Along one axis.
    fn land_1d(&self, at: f32, u: f32) -> Option<(i32, f32)> {
        let radius = self.filter.radius();
        if !(at.abs() < 1e7) {
            return None;
        }
        // Pixel i has its center at i + 1/2.
        let (first, last) = ((at - radius - 0.5).ceil() as i32, (at + radius - 0.5).floor() as i32);
        let value = |i: i32| self.filter.eval_1d(at - (i as f32 + 0.5));
        let total: f32 = (first..=last).map(|i| value(i).abs()).sum();
        let mut rest = u * total;
        let mut chosen = None;
        for i in first..=last {
            let v = value(i);
            if v != 0.0 {
                chosen = Some((i, (total / self.integral).copysign(v)));
                rest -= v.abs();
                if rest < 0.0 {
                    break;
                }
            }
        }
        chosen
    }

    /// The density of [`FilterSampler::sample`] at an offset, per square pixel.
    pub fn pdf(&self, offset: Vec2) -> f32 {
        let radius = self.filter.radius();
        if offset.abs().max_element() > radius {
            return 0.0;
        }
        let p = (offset / radius + Vec2::ONE) * 0.5;
        let p = p.min(Vec2::splat(ONE_MINUS_EPSILON));
        self.table.pdf(p.x) * self.table.pdf(p.y) / (4.0 * radius * radius)
    }
}

fn cell_center(i: usize, radius: f32) -> f32 {
    (2.0 * (i as f32 + 0.5) / CELLS as f32 - 1.0) * radius
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{mix32, unit_float};

    fn all() -> Vec<Filter> {
        Filter::NAMES.iter().map(|n| Filter::from_name(n).unwrap()).collect()
    }

    #[test]
    fn values_at_known_points() {
        assert_eq!(Filter::BOX.eval(0.4, -0.4), 1.0);
        assert_eq!(Filter::BOX.eval(0.6, 0.0), 0.0);
        assert!((Filter::TENT.eval(0.5, 0.25) - 0.375).abs() < 1e-6);
        // 8/9 and 1/18: Mitchell and Netravali's cubic at the sample and its neighbor for B = C = 1/3.
        assert!((Filter::MITCHELL.eval_1d(0.0) - 8.0 / 9.0).abs() < 1e-6);
        assert!((Filter::MITCHELL.eval_1d(1.0) - 1.0 / 18.0).abs() < 1e-6);
        assert!((Filter::GAUSSIAN.eval_1d(0.5) - (fns::exp(-0.5) - fns::exp(-8.0))).abs() < 1e-6);
        assert!((Filter::BLACKMAN_HARRIS.eval_1d(0.0) - 1.0).abs() < 1e-6);
        assert!(Filter::BLACKMAN_HARRIS.eval_1d(1.5) < 1e-4);
        assert!((Filter::LANCZOS.eval_1d(0.0) - 1.0).abs() < 1e-6 && Filter::LANCZOS.eval_1d(1.0).abs() < 1e-6);
        assert!((Filter::LANCZOS.eval_1d(1.5) - -0.135_095).abs() < 1e-5);
        assert!(all().iter().all(Filter::is_valid));
        assert!(!Filter::Gaussian { stddev: f32::NAN }.is_valid());
        assert!(!Filter::Box { radius: 0.0 }.is_valid());
        assert!(!Filter::Mitchell { b: f32::INFINITY, c: 0.0 }.is_valid());
    }

    /// Weighted samples must have the filter's own moments, and a histogram of them its shape.
    #[test]
    fn samples_follow_the_filter() {
        const N: u32 = 400_000;
        const BINS: usize = 32;
        for filter in all() {
            let sampler = FilterSampler::new(filter);
            let radius = filter.radius();
            let (mut sum_w, mut sum_x, mut sum_x2) = (0.0f64, 0.0f64, 0.0f64);
            let (mut hits, mut weights) = ([0u32; BINS], [0.0f64; BINS]);
            for i in 0..N {
                let u = Vec2::new((i as f32 + 0.5) / N as f32, unit_float(mix32(i)));
                let s = sampler.sample(u);
                assert!(s.offset.abs().max_element() <= radius);
                assert_eq!(s.weight.abs(), sampler.sample(Vec2::splat(0.5)).weight);
                let w = f64::from(s.weight);
                sum_w += w;
                sum_x += w * f64::from(s.offset.x);
                sum_x2 += w * f64::from(s.offset.x).powi(2);
                let bin = (((s.offset.x / radius + 1.0) * 0.5 * BINS as f32) as usize).min(BINS - 1);
                hits[bin] += 1;
                weights[bin] += w;
            }
            // The same moments by quadrature of `eval`.
            const Q: usize = 20_000;
            let xs = || (0..Q).map(|i| (2.0 * (i as f32 + 0.5) / Q as f32 - 1.0) * radius);
            let integral: f64 = xs().map(|x| f64::from(filter.eval_1d(x))).sum();
            let second: f64 = xs().map(|x| f64::from(filter.eval_1d(x) * x * x)).sum::<f64>() / integral;
            let n = f64::from(N);
            let w_max = f64::from(sampler.weight);
            let tolerance = 6.0 * w_max / n.sqrt() * f64::from(radius).max(1.0).powi(2);
            assert!((sum_w / n - 1.0).abs() < tolerance.min(0.02), "{filter:?}: mean weight {}", sum_w / n);
            assert!((sum_x / n).abs() < tolerance, "{filter:?}: first moment {}", sum_x / n);
            assert!((sum_x2 / n - second).abs() < tolerance, "{filter:?}: second moment {} instead of {second}", sum_x2 / n);
            let total_magnitude: f64 = xs().map(|x| f64::from(filter.eval_1d(x).abs())).sum();
            for bin in 0..BINS {
                let range = bin * Q / BINS..(bin + 1) * Q / BINS;
                let magnitude: f64 = xs().skip(range.start).take(range.len()).map(|x| f64::from(filter.eval_1d(x).abs())).sum();
                let value: f64 = xs().skip(range.start).take(range.len()).map(|x| f64::from(filter.eval_1d(x))).sum();
                assert!((f64::from(hits[bin]) / n - magnitude / total_magnitude).abs() < 1e-3, "{filter:?}: bin {bin}");
                assert!((weights[bin] / n - value / integral).abs() < 6.0 * w_max / n.sqrt() + 2e-3, "{filter:?}: bin {bin}");
            }
        }
    }

    /// What splats bring to a pixel is the normalized filter, as for camera samples.
    #[test]
    fn splats_land_by_the_filter() {
        const N: u32 = 100_000;
        for filter in all() {
            let sampler = FilterSampler::new(filter);
            let integral = FilterSampler::integral_1d(&filter);
            let at = Vec2::new(7.3, 4.85);
            let mut sums = std::collections::BTreeMap::new();
            for i in 0..N {
                let u = Vec2::new((i as f32 + 0.5) / N as f32, unit_float(mix32(i)));
                let (x, y, weight) = sampler.land(at, u).unwrap();
                *sums.entry((x, y)).or_insert(0.0) += f64::from(weight) / f64::from(N);
            }
            for x in 0..16 {
                for y in 0..12 {
                    let known = f64::from(filter.eval(at.x - x as f32 - 0.5, at.y - y as f32 - 0.5)) / (integral * integral);
                    let sum = sums.get(&(x, y)).copied().unwrap_or(0.0);
                    assert!((sum - known).abs() < 0.02, "{filter:?} {x} {y}: {sum} instead of {known}");
                }
            }
            assert!(sampler.land(Vec2::new(f32::NAN, 1.0), Vec2::ZERO).is_none());
        }
    }

    #[test]
    fn weight_is_the_normalized_filter_over_the_density() {
        for filter in all() {
            let sampler = FilterSampler::new(filter);
            let integral = FilterSampler::integral_1d(&filter);
            for i in 0..1000u32 {
                let s = sampler.sample(Vec2::new(unit_float(mix32(2 * i)), unit_float(mix32(2 * i + 1))));
                let f = f64::from(filter.eval(s.offset.x, s.offset.y)) / (integral * integral);
                let ratio = f64::from(s.weight) * f64::from(sampler.pdf(s.offset));
                // The table has steps, the filter has not: exact only to the height of a step.
                assert!((ratio - f).abs() < 0.02 / f64::from(filter.radius()), "{filter:?} at {}: {ratio} instead of {f}", s.offset);
            }
        }
    }
}
