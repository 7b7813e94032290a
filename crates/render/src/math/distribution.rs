//! Tabulated densities: piecewise constant over [0,1) and over the unit square.
//!
//! Only the cumulative distribution is kept (`f32`, accumulated in `f64`), and densities are differences of it, so
//! that `pdf` is exactly the density of `sample` even after rounding. The price: a cell that holds less than about
//! 6e-8 of its table (of its row, in 2D) may round to zero, and is then never sampled and has density zero.
//! Negative and non-finite weights count as zero. A table without any weight is sampled uniformly, and its
//! `integral` of zero tells.

use super::{ONE_MINUS_EPSILON, Vec2};

/// Fills `cdf` (one longer than `weights`) and returns the mean of the weights, which is the integral over [0,1).
fn build_cdf(weights: &[f32], cdf: &mut [f32]) -> f64 {
    let n = weights.len();
    let usable = |w: f32| if w.is_finite() && w > 0.0 { f64::from(w) } else { 0.0 };
    let total: f64 = weights.iter().map(|&w| usable(w)).sum();
    cdf[0] = 0.0;
    if total > 0.0 {
        let inv = 1.0 / total;
        let mut sum = 0.0;
        let mut last = 0;
        for (i, &w) in weights.iter().enumerate() {
            let w = usable(w);
            sum += w;
            if w > 0.0 {
                last = i;
            }
            cdf[i + 1] = ((sum * inv) as f32).min(1.0);
        }
        // Exactly one after the last cell with weight: no sample may fall into the empty ones behind it.
        cdf[last + 1..].fill(1.0);
    } else {
        for (i, c) in cdf.iter_mut().enumerate() {
            *c = (i as f64 / n as f64) as f32;
        }
    }
    total / n as f64
}

/// The cell that holds `u`: the last i with cdf\[i\] <= u. Cells of no width are never returned for u in [0,1).
#[inline]
fn find_cell(cdf: &[f32], u: f32) -> usize {
    let mut base = 0;
    let mut size = cdf.len() - 1;
    while size > 1 {
        let half = size / 2;
        // A branch that is taken half of the time would cost more than the rest.
        base = std::hint::select_unpredictable(cdf[base + half] <= u, base + half, base);
        size -= half;
    }
    base
}

/// (position in [0,1), density, cell) of the sample `u` of one table.
#[inline]
fn sample_cdf(cdf: &[f32], u: f32) -> (f32, f32, usize) {
    let n = (cdf.len() - 1) as f32;
    let u = u.clamp(0.0, ONE_MINUS_EPSILON);
    let i = find_cell(cdf, u);
    let width = cdf[i + 1] - cdf[i];
    let t = if width > 0.0 { (u - cdf[i]) / width } else { 0.0 };
    (((i as f32 + t) / n).min(ONE_MINUS_EPSILON), width * n, i)
}

/// The cell of a position in [0,1].
#[inline]
fn cell_of(x: f32, n: usize) -> usize {
    // Negative numbers and NaN become 0 in the conversion.
    ((x * n as f32) as usize).min(n - 1)
}

/// The `u` that [`sample_cdf`] maps to `x`.
#[inline]
fn invert_cdf(cdf: &[f32], x: f32) -> f32 {
    let n = cdf.len() - 1;
    let i = cell_of(x, n);
    let t = (x * n as f32 - i as f32).clamp(0.0, 1.0);
    ((1.0 - t) * cdf[i] + t * cdf[i + 1]).min(ONE_MINUS_EPSILON)
}

/// A piecewise-constant density over [0,1).
#[derive(Clone, Debug)]
pub struct PiecewiseConstant1D {
    cdf: Vec<f32>,
    integral: f64,
}

impl PiecewiseConstant1D {
    /// From one weight for each of the equal cells; no weights at all make one uniform cell with integral 0.
    pub fn new(weights: &[f32]) -> Self {
        let weights = if weights.is_empty() { &[0.0][..] } else { weights };
        let mut cdf = vec![0.0; weights.len() + 1];
        let integral = build_cdf(weights, &mut cdf);
        Self { cdf, integral }
    }

    /// The number of cells.
    pub fn len(&self) -> usize {
        self.cdf.len() - 1
    }

    /// Never: there is at least one cell.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The integral of the weights over [0,1), which is their mean; 0 where every weight was 0.
    pub fn integral(&self) -> f64 {
        self.integral
    }

    /// A position in [0,1) for `u` in [0,1), its density over [0,1), and its cell. O(log n).
    #[inline]
    pub fn sample(&self, u: f32) -> (f32, f32, usize) {
        sample_cdf(&self.cdf, u)
    }

    /// A cell for `u` in [0,1), its probability, and `u` stretched back to [0,1) for use as another sample.
    #[inline]
    pub fn sample_discrete(&self, u: f32) -> (usize, f32, f32) {
        let u = u.clamp(0.0, ONE_MINUS_EPSILON);
        let i = find_cell(&self.cdf, u);
        let width = self.probability(i);
        let rest = if width > 0.0 { ((u - self.cdf[i]) / width).min(ONE_MINUS_EPSILON) } else { 0.0 };
        (i, width, rest)
    }

    /// The probability of a cell.
    #[inline]
    pub fn probability(&self, cell: usize) -> f32 {
        self.cdf[cell + 1] - self.cdf[cell]
    }

    /// The density at a position in [0,1].
    #[inline]
    pub fn pdf(&self, x: f32) -> f32 {
        self.probability(cell_of(x, self.len())) * self.len() as f32
    }

    /// The `u` whose sample is `x`.
    #[inline]
    pub fn inverse(&self, x: f32) -> f32 {
        invert_cdf(&self.cdf, x)
    }
}

/// A piecewise-constant density over [0,1)², as of a picture: a row by the marginal density, then a column in it.
#[derive(Clone, Debug)]
pub struct PiecewiseConstant2D {
    width: usize,
    /// One table of width + 1 for each row, one after the other.
    conditional: Vec<f32>,
    marginal: PiecewiseConstant1D,
}

impl PiecewiseConstant2D {
    /// From `width` × `height` weights, row by row; x runs along a row and y across rows. What is missing at the end
    /// of `weights` counts as zero, and a side of 0 as 1.
    pub fn new(width: usize, height: usize, weights: &[f32]) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        let mut conditional = vec![0.0; (width + 1) * height];
        let mut row_integrals = vec![0.0; height];
        let mut padded = Vec::new();
        for (y, (cdf, row_integral)) in conditional.chunks_exact_mut(width + 1).zip(&mut row_integrals).enumerate() {
            let row = match weights.get(y * width..(y + 1) * width) {
                Some(row) => row,
                None => {
                    padded.clear();
                    padded.extend_from_slice(weights.get(y * width..).unwrap_or(&[]));
                    padded.resize(width, 0.0);
                    &padded[..]
                }
            };
            *row_integral = build_cdf(row, cdf);
        }
        // Rows may sum to more than f32 holds: scale to the largest before the marginal is built.
        let largest = row_integrals.iter().copied().fold(0.0, f64::max);
        let scale = if largest > 0.0 { largest } else { 1.0 };
        let rows: Vec<f32> = row_integrals.iter().map(|r| (r / scale) as f32).collect();
        let mut marginal = PiecewiseConstant1D::new(&rows);
        marginal.integral *= scale;
        Self { width, conditional, marginal }
    }

    /// Cells in a row and in a column.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.marginal.len()]
    }

    /// The integral of the weights over [0,1)², which is their mean; 0 where every weight was 0.
    pub fn integral(&self) -> f64 {
        self.marginal.integral
    }

    #[inline]
    fn row(&self, y: usize) -> &[f32] {
        &self.conditional[y * (self.width + 1)..(y + 1) * (self.width + 1)]
    }

    /// A position in [0,1)² for `u` in [0,1)², its density over the square, and its cell [x, y]. Two binary searches.
    #[inline]
    pub fn sample(&self, u: Vec2) -> (Vec2, f32, [usize; 2]) {
        let (y, pdf_y, iy) = self.marginal.sample(u.y);
        let (x, pdf_x, ix) = sample_cdf(self.row(iy), u.x);
        (Vec2::new(x, y), pdf_x * pdf_y, [ix, iy])
    }

    /// The probability of the cells of a row from the first to before the last.
    pub fn probability_in_row(&self, y: usize, [first, end]: [usize; 2]) -> f32 {
        let row = self.row(y);
        (row[end] - row[first]) * self.marginal.probability(y)
    }

    /// A position along a row in the cells from the first to before the last, by their density in the row, and the density of the place in
    /// all of the square.
    #[inline]
    pub fn sample_in_row(&self, y: usize, [first, end]: [usize; 2], u: f32) -> (f32, f32) {
        let row = &self.row(y)[first..=end];
        // By differences, which are exact: cells may hold a millionth of a row.
        let u = u.clamp(0.0, ONE_MINUS_EPSILON) * (row[row.len() - 1] - row[0]);
        let i = row.partition_point(|c| c - row[0] <= u).clamp(1, row.len() - 1) - 1;
        let share = row[i + 1] - row[i];
        let t = if share > 0.0 { ((u - (row[i] - row[0])) / share).clamp(0.0, 1.0) } else { 0.0 };
        let [width, height] = self.size();
        let x = ((first + i) as f32 + t) / width as f32;
        (x.min(ONE_MINUS_EPSILON), share * width as f32 * (self.marginal.probability(y) * height as f32))
    }

    /// The density at a position in [0,1]².
    #[inline]
    pub fn pdf(&self, p: Vec2) -> f32 {
        let [width, height] = self.size();
        let (ix, iy) = (cell_of(p.x, width), cell_of(p.y, height));
        let row = self.row(iy);
        (row[ix + 1] - row[ix]) * width as f32 * (self.marginal.probability(iy) * height as f32)
    }

    /// The `u` whose sample is `p`.
    #[inline]
    pub fn inverse(&self, p: Vec2) -> Vec2 {
        let iy = cell_of(p.y, self.marginal.len());
        Vec2::new(invert_cdf(self.row(iy), p.x), self.marginal.inverse(p.y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{mix32, unit_float};

    fn u(i: u32) -> f32 {
        unit_float(mix32(i))
    }

    #[test]
    fn known_table_in_one_dimension() {
        let d = PiecewiseConstant1D::new(&[0.0, 1.0, 0.0, 3.0, 0.0]);
        assert_eq!(d.integral(), 0.8);
        assert_eq!(d.sample(0.0), (0.2, 1.25, 1));
        assert_eq!(d.sample(0.25).2, 3);
        assert_eq!(d.sample(ONE_MINUS_EPSILON).2, 3);
        assert_eq!(d.sample(1.0).2, 3);
        assert_eq!(d.sample(f32::NAN.max(0.0)).2, 1);
        assert_eq!([d.pdf(0.1), d.pdf(0.3), d.pdf(0.5), d.pdf(0.7), d.pdf(1.0)], [0.0, 1.25, 0.0, 3.75, 0.0]);
        assert_eq!(d.sample_discrete(0.625), (3, 0.75, 0.5));
        for i in 0..1000 {
            let (x, _, _) = d.sample(u(i));
            assert!((d.inverse(x) - u(i)).abs() < 1e-5);
        }
    }

    #[test]
    fn no_weight_is_uniform_and_hostile_weights_are_zero() {
        for weights in [&[][..], &[0.0, 0.0], &[-1.0, f32::NAN], &[f32::INFINITY, f32::NEG_INFINITY]] {
            let d = PiecewiseConstant1D::new(weights);
            assert_eq!(d.integral(), 0.0);
            assert_eq!(d.pdf(0.4), 1.0);
            assert!((d.sample(0.3).0 - 0.3).abs() < 1e-6);
        }
        let d = PiecewiseConstant1D::new(&[f32::NAN, 2.0, -7.0]);
        assert!((0..100).all(|i| d.sample(u(i)).2 == 1));
        let d = PiecewiseConstant2D::new(2, 2, &[f32::MAX; 3]);
        assert!((d.pdf(Vec2::new(0.1, 0.1)) - 4.0 / 3.0).abs() < 1e-5);
        assert_eq!(d.pdf(Vec2::new(0.9, 0.9)), 0.0);
        assert_eq!(PiecewiseConstant2D::new(0, 0, &[]).pdf(Vec2::ZERO), 1.0);
    }

    /// Pearson's chi-square of the cells hit by samples; 6 standard deviations of the statistic.
    #[test]
    fn samples_follow_the_density_in_two_dimensions() {
        let (w, h) = (13, 7);
        let weights: Vec<f32> =
            (0..w * h).map(|i| if (i / w) as usize == 3 || i % 5 == 0 { 0.0 } else { u(900 + i) * u(7000 + i) * 100.0 }).collect();
        let d = PiecewiseConstant2D::new(w as usize, h as usize, &weights);
        let total: f64 = weights.iter().map(|&x| f64::from(x)).sum();
        assert!((d.integral() - total / f64::from(w * h)).abs() < 1e-6 * total);
        let n = 200_000;
        let mut hits = vec![0u32; weights.len()];
        for i in 0..n {
            let uv = Vec2::new(u(2 * i), u(2 * i + 1));
            let (p, pdf, [x, y]) = d.sample(uv);
            hits[y * w as usize + x] += 1;
            assert!((0.0..1.0).contains(&p.x) && (0.0..1.0).contains(&p.y));
            assert!(pdf > 0.0 && weights[y * w as usize + x] > 0.0);
            // A position at a cell's very border may round into the neighbor.
            let inside = (p.x * w as f32).fract().min((p.y * h as f32).fract()) > 1e-4;
            assert!(!inside || (d.pdf(p) - pdf).abs() <= 1e-4 * pdf);
            assert!(!inside || (d.inverse(p) - uv).length() < 1e-3);
        }
        let (mut chi2, mut dof) = (0.0, -1.0);
        for (&hit, &weight) in hits.iter().zip(&weights) {
            let expected = f64::from(n) * f64::from(weight) / total;
            if expected > 5.0 {
                chi2 += (f64::from(hit) - expected).powi(2) / expected;
                dof += 1.0;
            }
        }
        assert!(dof > 40.0 && chi2 < dof + 6.0 * (2.0f64 * dof).sqrt(), "chi2 {chi2} for {dof} degrees of freedom");
    }

    #[test]
    fn integral_of_the_pdf_is_one() {
        let weights: Vec<f32> = (0..64 * 32).map(u).collect();
        let d = PiecewiseConstant2D::new(64, 32, &weights);
        let sum: f64 =
            (0..64 * 32).map(|i| f64::from(d.pdf(Vec2::new(((i % 64) as f32 + 0.5) / 64.0, ((i / 64) as f32 + 0.5) / 32.0)))).sum();
        assert!((sum / (64.0 * 32.0) - 1.0).abs() < 1e-6);
    }
}
