//! Pearson's chi-square test: do samples on the sphere have the density that they claim?

use crate::math::{PI, TAU, Vec2, Vec3, fns, hash};

/// Settings of a test.
#[derive(Clone, Copy, Debug)]
pub struct Chi2 {
    /// Cells over the cosine with +z; even, so that the horizon is between two rows.
    pub res_z: usize,
    /// Cells over the azimuth.
    pub res_phi: usize,
    /// Number of samples.
    pub samples: u64,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for Chi2 {
    fn default() -> Self {
        Self { res_z: 20, res_phi: 40, samples: 100_000, seed: 1 }
    }
}

/// What a test found.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Probability of a deviation at least as large, if the samples have the density.
    pub p_value: f64,
    /// Integral of the density over the sphere.
    pub mass: f64,
    /// Share of the samples that were directions.
    pub hit_share: f64,
    /// The (cosine, azimuth) at the middle of the cell that deviates most, with observed and expected count.
    pub worst: (f32, f32, f64, f64),
}

impl Outcome {
    /// Panics unless the samples have the density: the p-value is above `significance`, and the integral is the share of hits,
    /// within `mass_tolerance` and four standard deviations.
    #[allow(clippy::panic)]
    pub fn check(&self, settings: &Chi2, significance: f64, mass_tolerance: f64, what: &str) {
        let h = self.hit_share;
        let noise = 4.0 * libm::sqrt(h * (1.0 - h) / settings.samples as f64);
        if self.p_value < significance || (self.mass - h).abs() > mass_tolerance + noise || self.p_value.is_nan() {
            panic!("{what}: {self:?}, significance {significance:.1e}");
        }
    }
}

/// Three random numbers in [0, 1): a lobe choice and a point, number `i` of the sequence `seed`.
pub fn random(seed: u64, i: u64) -> (f32, Vec2) {
    let a = hash::hash_words([seed, i, 0]);
    let b = hash::hash_words([seed, i, 1]);
    (hash::unit_float(b as u32), Vec2::new(hash::unit_float(a as u32), hash::unit_float((a >> 32) as u32)))
}

/// The significance of one of `tests` tests, for all of them to reject wrongly with probability `level` (Šidák 1967).
pub fn sidak(level: f64, tests: usize) -> f64 {
    1.0 - libm::pow(1.0 - level, 1.0 / tests as f64)
}

impl Chi2 {
    /// Compares the samples that `sample` returns with `pdf`, both over directions of the sphere; `None` counts as a miss.
    pub fn run(&self, mut sample: impl FnMut(f32, Vec2) -> Option<Vec3>, pdf: impl Fn(Vec3) -> f32) -> Outcome {
        let mut observed = vec![0u64; self.res_z * self.res_phi];
        let mut hits = 0;
        for i in 0..self.samples {
            let (u_lobe, u) = random(self.seed, i);
            if let Some(w) = sample(u_lobe, u) {
                hits += 1;
                observed[self.cell(w)] += 1;
            }
        }
        let n = self.samples as f64;
        let expected = self.expected(&pdf);
        let mass = expected.iter().sum::<f64>();

        // Cells with few expected samples are pooled: the statistic's distribution holds for many.
        const ENOUGH: f64 = 5.0;
        let (mut statistic, mut cells) = (0.0, 0);
        let (mut pooled_observed, mut pooled_expected) = (0.0, 0.0);
        let (mut worst, mut worst_term) = ((0.0, 0.0, 0.0, 0.0), -1.0);
        for (i, (&o, &e)) in observed.iter().zip(&expected).enumerate() {
            let (o, e) = (o as f64, e * n);
            if e < ENOUGH {
                pooled_observed += o;
                pooled_expected += e;
                continue;
            }
            let term = (o - e) * (o - e) / e;
            statistic += term;
            cells += 1;
            if term > worst_term {
                worst_term = term;
                worst = (self.z(i / self.res_phi, 0.5) as f32, ((i % self.res_phi) as f32 + 0.5) * TAU / self.res_phi as f32, o, e);
            }
        }
        if pooled_expected >= ENOUGH {
            statistic += (pooled_observed - pooled_expected) * (pooled_observed - pooled_expected) / pooled_expected;
            cells += 1;
        } else if pooled_observed > 20.0 + 2.0 * pooled_expected {
            // Samples where there should be none: no statistic needed.
            statistic = f64::INFINITY;
        }
        let p_value = if cells == 0 || statistic.is_infinite() {
            f64::from(u8::from(cells == 0 && statistic.is_finite()))
        } else {
            upper_gamma(0.5 * f64::from(cells), 0.5 * statistic)
        };
        Outcome { p_value, mass, hit_share: f64::from(hits) / n, worst }
    }

    fn z(&self, row: usize, offset: f64) -> f64 {
        2.0 * (row as f64 + offset) / self.res_z as f64 - 1.0
    }

    fn cell(&self, w: Vec3) -> usize {
        let mut phi = fns::atan2(w.y, w.x);
        if phi < 0.0 {
            phi += 2.0 * PI;
        }
        let iz = ((f64::from(w.z) + 1.0) * 0.5 * self.res_z as f64) as usize;
        let ip = (phi / TAU * self.res_phi as f32) as usize;
        iz.min(self.res_z - 1) * self.res_phi + ip.min(self.res_phi - 1)
    }

    fn expected(&self, pdf: &impl Fn(Vec3) -> f32) -> Vec<f64> {
        // Over the polar angle, not its cosine: narrow lobes about the poles are found, and are smooth.
        let f = |theta: f64, phi: f64| {
            let (r, z) = libm::sincos(theta);
            let (sin, cos) = libm::sincos(phi);
            r * f64::from(pdf(Vec3::new((r * cos) as f32, (r * sin) as f32, z as f32)))
        };
        let dp = f64::from(TAU) / self.res_phi as f64;
        // A tenth of a sample.
        let tolerance = 0.1 / self.samples as f64;
        (0..self.res_z * self.res_phi)
            .map(|i| {
                let p = (i % self.res_phi) as f64 * dp;
                let row = i / self.res_phi;
                let rect = [libm::acos(self.z(row, 1.0)), libm::acos(self.z(row, 0.0)), p, p + dp];
                integrate(&f, rect, quadrature(&f, rect), tolerance, 0)
            })
            .collect()
    }
}

/// The integral of a function over the sphere, to about `tolerance`.
pub fn sphere_integral(tolerance: f64, f: impl Fn(Vec3) -> f32) -> f64 {
    let grid = Chi2 { samples: (80.0 / tolerance) as u64, ..Chi2::default() };
    grid.expected(&f).iter().sum()
}

// Adaptive quadrature over [theta0, theta1] × [phi0, phi1]; `coarse` is the estimate by one rule.
fn integrate(f: &impl Fn(f64, f64) -> f64, rect: [f64; 4], coarse: f64, tolerance: f64, depth: u32) -> f64 {
    let [t0, t1, p0, p1] = rect;
    let (tm, pm) = (0.5 * (t0 + t1), 0.5 * (p0 + p1));
    let parts = [[t0, tm, p0, pm], [tm, t1, p0, pm], [t0, tm, pm, p1], [tm, t1, pm, p1]].map(|r| (r, quadrature(f, r)));
    let fine: f64 = parts.iter().map(|p| p.1).sum();
    // At least two levels, lest a narrow peak is missed.
    if depth >= 12 || (depth >= 1 && (fine - coarse).abs() < tolerance) {
        return fine;
    }
    parts.into_iter().map(|(r, c)| integrate(f, r, c, tolerance * 0.5, depth + 1)).sum()
}

// Gauss-Legendre with 3 × 3 nodes.
fn quadrature(f: &impl Fn(f64, f64) -> f64, [t0, t1, p0, p1]: [f64; 4]) -> f64 {
    const NODES: [(f64, f64); 3] = [(-0.774_596_669_241_483_4, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.774_596_669_241_483_4, 5.0 / 18.0)];
    let (ht, hp) = (0.5 * (t1 - t0), 0.5 * (p1 - p0));
    let mut sum = 0.0;
    for (x, wx) in NODES {
        for (y, wy) in NODES {
            sum += wx * wy * f(t0 + ht * (1.0 + x), p0 + hp * (1.0 + y));
        }
    }
    sum * 4.0 * ht * hp
}

/// The regularized upper incomplete gamma function Q(a, x): the probability that a chi-square variable with 2a degrees of
/// freedom exceeds 2x (Press et al. 2007, "Numerical Recipes", section 6.2).
pub fn upper_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let front = libm::exp(a * libm::log(x) - x - libm::lgamma(a));
    if x < a + 1.0 {
        let (mut term, mut sum, mut k) = (1.0 / a, 1.0 / a, a);
        for _ in 0..10_000 {
            k += 1.0;
            term *= x / k;
            sum += term;
            if term < sum * 1e-15 {
                break;
            }
        }
        return 1.0 - sum * front;
    }
    // Lentz's continued fraction.
    let mut b = x + 1.0 - a;
    let mut c = 1e300;
    let mut d = 1.0 / b;
    let mut h = d;
    for i in 1..10_000 {
        let i = f64::from(i);
        let an = -i * (i - a);
        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * h
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{INV_4PI, warp};

    #[test]
    fn gamma_has_its_known_values() {
        // Q(1, x) = exp(−x); the chi-square quantiles of tables.
        for x in [0.1, 1.0, 5.0] {
            assert!((upper_gamma(1.0, x) - libm::exp(-x)).abs() < 1e-12);
        }
        assert!((upper_gamma(5.0, 18.307 / 2.0) - 0.05).abs() < 1e-4);
        assert!((upper_gamma(50.0, 124.342 / 2.0) - 0.05).abs() < 1e-4);
    }

    #[test]
    fn right_density_passes_and_wrong_ones_fail() {
        let test = Chi2::default();
        let cosine = |_: f32, u: Vec2| Some(warp::cosine_hemisphere(u));
        let good = test.run(cosine, |w| warp::cosine_hemisphere_pdf(w.z));
        good.check(&test, 1e-3, 1e-4, "cosine");
        // A density off by up to 15 % in shape, samples where there is no density, a wrong integral.
        assert!(test.run(cosine, |w| warp::cosine_hemisphere_pdf(w.z) * (1.0 + 0.15 * w.x)).p_value < 1e-6);
        assert!(test.run(|_, u| Some(warp::uniform_sphere(u)), |w| if w.z > 0.0 { 2.0 * INV_4PI } else { 0.0 }).p_value < 1e-6);
        let short = test.run(cosine, |w| 0.99 * warp::cosine_hemisphere_pdf(w.z));
        assert!((short.mass - short.hit_share).abs() > 5e-3);
    }

    #[test]
    fn integrals_over_the_sphere() {
        assert!((sphere_integral(1e-4, |_| 1.0) - 4.0 * f64::from(PI)).abs() < 1e-4);
        assert!(
            (sphere_integral(1e-4, |w| if w.dot(Vec3::new(0.6, 0.0, 0.8)) > 0.9 { 1.0 } else { 0.0 }) - 0.2 * f64::from(PI)).abs() < 1e-2
        );
    }
}
