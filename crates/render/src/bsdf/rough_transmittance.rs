//! How much light enters a rough dielectric interface, as a table over the angle.

use super::fresnel;
use super::microfacet::{Distribution, Microfacet};
use crate::math::fns::safe_sqrt;
use crate::math::{PI, Vec2, Vec3};

const RES: usize = 64;

/// Transmittance of a rough dielectric interface from outside, and its diffuse reflectance from inside.
///
/// The table holds 16-bit fractions at equidistant cosines: small enough to be copied into a
/// [`Bsdf`](crate::bsdf::Bsdf), which then needs neither a reference nor a counter shared between threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughTransmittance {
    table: [u16; RES],
    /// Share of ideally diffuse light from inside that is sent back.
    pub internal_reflectance: f32,
}

impl RoughTransmittance {
    /// Integrates the table for isotropic facets; `eta` is the index inside over that outside. Takes some 10 ms: once for a
    /// material, not at each hit.
    pub fn new(distribution: Distribution, alpha: f32, eta: f32) -> Self {
        let microfacet = Microfacet::isotropic(distribution, alpha);
        let nodes = (gauss_legendre(), gauss_legendre());
        let mut table = [0; RES];
        for (t, mu) in table.iter_mut().zip(cosines()) {
            *t = (directional(&microfacet, mu, eta, true, &nodes).clamp(0.0, 1.0) * f32::from(u16::MAX)).round() as u16;
        }
        // 2 ∫ R(µ) µ dµ, as the mean over the table's cosines: some 1 % below the integral. That error is kept so that
        // pictures agree with Mitsuba's `roughplastic`, which takes the same mean.
        let internal = cosines().map(|mu| mu * directional(&microfacet, mu, 1.0 / eta, false, &nodes)).sum::<f32>() * (2.0 / RES as f32);
        Self { table, internal_reflectance: internal.clamp(0.0, 0.999) }
    }

    /// The share of light that enters from outside at the given cosine.
    #[inline]
    pub fn eval(&self, cos: f32) -> f32 {
        let x = cos.clamp(0.0, 1.0) * (RES - 1) as f32;
        let i = (x as usize).min(RES - 2);
        let (a, b) = (f32::from(self.table[i]), f32::from(self.table[i + 1]));
        (a + (b - a) * (x - i as f32)) * (1.0 / 65_535.0)
    }
}

// The cosines of the table.
fn cosines() -> impl Iterator<Item = f32> {
    (0..RES).map(|i| (i as f32 / (RES - 1) as f32).max(1e-6))
}

// Over the sample space's first axis, and over half of the second one: the other half mirrors it about the plane of incidence.
type Nodes = ([(f32, f32); 32], [(f32, f32); 16]);

// The share of light from a direction with cosine `mu` that goes through (`transmit`) or comes back, by quadrature over
// the sample space of visible normals.
fn directional(microfacet: &Microfacet, mu: f32, eta: f32, transmit: bool, nodes: &Nodes) -> f32 {
    let wo = Vec3::new(safe_sqrt(1.0 - mu * mu), 0.0, mu);
    let mut sum = 0.0;
    for &(u, wu) in &nodes.0 {
        for &(v, wv) in &nodes.1 {
            let m = microfacet.sample_visible_normal(wo, Vec2::new(u, 0.5 * v));
            let (r, cos_t, _, eta_ti) = fresnel::dielectric(wo.dot(m).max(0.0), eta);
            let (wi, share) = if transmit { (fresnel::refract(wo, m, cos_t, eta_ti), 1.0 - r) } else { (fresnel::reflect(wo, m), r) };
            if share > 0.0 && (wi.z < 0.0) == transmit {
                sum += wu * wv * share * microfacet.g1_distant(wi);
            }
        }
    }
    sum
}

// Nodes and weights of Gauss-Legendre quadrature on [0, 1] (Newton's method on Legendre's recurrence; Press et al. 2007,
// "Numerical Recipes", section 4.6).
fn gauss_legendre<const N: usize>() -> [(f32, f32); N] {
    let n = N as f64;
    std::array::from_fn(|i| {
        let mut x = libm::cos(f64::from(PI) * (i as f64 + 0.75) / (n + 0.5));
        let mut derivative = 1.0;
        for _ in 0..8 {
            let (mut p0, mut p1) = (1.0, x);
            for k in 2..=N {
                let k = k as f64;
                (p0, p1) = (p1, ((2.0 * k - 1.0) * x * p1 - (k - 1.0) * p0) / k);
            }
            derivative = n * (x * p1 - p0) / (x * x - 1.0);
            x -= p1 / derivative;
        }
        ((0.5 - 0.5 * x) as f32, (1.0 / ((1.0 - x * x) * derivative * derivative)) as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadrature_is_exact_for_polynomials() {
        let nodes = gauss_legendre::<16>();
        for k in 0..8 {
            let sum: f32 = nodes.iter().map(|&(x, w)| w * x.powi(k)).sum();
            assert!((sum - 1.0 / (k + 1) as f32).abs() < 1e-6, "{k} {sum}");
        }
    }

    #[test]
    fn smooth_limit_is_fresnel() {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            let t = RoughTransmittance::new(distribution, 1e-3, 1.5);
            for cos in [0.1, 0.3, 0.5, 0.9, 1.0] {
                let exact = 1.0 - fresnel::dielectric(cos, 1.5).0;
                assert!((t.eval(cos) - exact).abs() < 3e-3, "{cos} {} {exact}", t.eval(cos));
            }
            assert!((t.internal_reflectance / fresnel::diffuse_reflectance(1.0 / 1.5) - 1.0).abs() < 0.03, "{}", t.internal_reflectance);
        }
    }
}
