//! Directional albedos of the microfacet lobes, by quadrature, once per process.
//!
//! Every number comes from the same rule: visible normals at the points of a lattice, averaged. The grids are uniform in the perceived
//! roughness √alpha, in √cos θ (the functions bend at grazing angles) and, for refractive indices, in √((n − 1)/(n + 1)),
//! and are interpolated linearly. The tables for reflection take some 10 ms, those for glass are made only when glass is met.

use std::sync::LazyLock;

use crate::bsdf::fresnel;
use crate::bsdf::microfacet::{Distribution, Microfacet};
use crate::math::fns::{lerp, safe_sqrt, sqr};
use crate::math::{Vec2, Vec3};

const N_ROUGH: usize = 24;
const N_MU: usize = 28;
const N_ETA: usize = 16;
/// Points of the quadrature.
const N_U: u32 = 128;
/// The largest √((n − 1)/(n + 1)): n = 199.
const MAX_Z: f32 = 0.995;
/// √[`super::MIN_ALPHA`]: where the grid of the roughness begins.
const MIN_ROUGHNESS: f32 = 0.01;

/// A row of the tables for one roughness and cosine.
#[derive(Clone, Copy, Default)]
struct Row {
    /// Albedo of GGX with perfectly reflecting facets.
    e: f32,
    /// Share of `e` that Schlick's weight takes.
    schlick: f32,
    /// Share of `e` that (F − F0) / (1 − F0) takes, F being Fresnel's reflectance, for each refractive index.
    dielectric: [f32; N_ETA],
}

/// The tables for reflection.
pub(super) struct Tables {
    rows: Vec<Row>,
    e_avg: [f32; N_ROUGH],
    /// Mean over the hemisphere of (F − F0) / (1 − F0).
    dielectric_avg: [f32; N_ETA],
}

/// What the tables know about a lobe at a cosine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Albedo {
    /// Albedo of the lobe with perfectly reflecting facets.
    pub e: f32,
    /// Mean of the same over the cosine-weighted hemisphere.
    pub e_avg: f32,
    /// Share of `e` with Schlick's weight.
    pub schlick: f32,
    /// Share of `e` with the weight of the dielectric's Fresnel curve.
    pub dielectric: f32,
    /// Mean of the dielectric's weight over the cosine-weighted hemisphere.
    pub dielectric_avg: f32,
}

static TABLES: LazyLock<Tables> = LazyLock::new(Tables::new);
static GLASS: LazyLock<[Glass; 2]> = LazyLock::new(|| [Glass::new(false), Glass::new(true)]);

/// The tables for reflection, made on first use.
pub(super) fn tables() -> &'static Tables {
    &TABLES
}

fn mu_of(i: usize) -> f32 {
    sqr(i as f32 / (N_MU - 1) as f32).max(1e-4)
}

fn roughness_of(i: usize) -> f32 {
    lerp(i as f32 / (N_ROUGH - 1) as f32, MIN_ROUGHNESS, 1.0)
}

fn eta_of(z: f32) -> f32 {
    let s = sqr(z.clamp(0.01, MAX_Z));
    (1.0 + s) / (1.0 - s)
}

fn z_of(eta: f32) -> f32 {
    safe_sqrt((eta - 1.0) / (eta + 1.0)).min(MAX_Z)
}

/// Calls `f(cos, weight, m)` for the visible normals.
fn quadrature(mu: f32, roughness: f32, mut f: impl FnMut(&Microfacet, Vec3, Vec3)) {
    let mf = Microfacet::isotropic(Distribution::Ggx, sqr(roughness).max(super::MIN_ALPHA));
    let wo = Vec3::new(safe_sqrt(1.0 - mu * mu), 0.0, mu);
    for i in 0..N_U {
        // A golden-ratio lattice. Its second coordinate is an angle about the view: half of it, by symmetry.
        let u = Vec2::new((i as f32 + 0.5) / N_U as f32, 0.5 * ((i as f32 + 0.5) * 0.618_034).fract());
        f(&mf, wo, mf.sample_visible_normal(wo, u));
    }
}

/// Index and fraction on a grid of `n` points over [0, 1].
#[inline]
fn cell(x: f32, n: usize) -> (usize, f32) {
    let x = x.clamp(0.0, 1.0) * (n - 1) as f32;
    let i = (x as usize).min(n - 2);
    (i, x - i as f32)
}

impl Tables {
    fn new() -> Self {
        let etas: [f32; N_ETA] = std::array::from_fn(|k| eta_of(k as f32 / (N_ETA - 1) as f32 * MAX_Z));
        let f0 = etas.map(fresnel::f0_from_eta);
        let mut rows = Vec::with_capacity(N_ROUGH * N_MU);
        let mut e_avg = [0.0; N_ROUGH];
        for (r, avg) in e_avg.iter_mut().enumerate() {
            for m in 0..N_MU {
                let mut row = Row::default();
                quadrature(mu_of(m), roughness_of(r), |mf, wo, h| {
                    let wi = fresnel::reflect(wo, h);
                    if wi.z <= 0.0 {
                        return;
                    }
                    let w = super::masking_ratio(mf, wo, wi);
                    let c = wo.dot(h);
                    row.e += w;
                    row.schlick += w * fresnel::schlick_weight(c);
                    for k in 0..N_ETA {
                        row.dielectric[k] += w * (fresnel::dielectric(c, etas[k]).0 - f0[k]).max(0.0) / (1.0 - f0[k]);
                    }
                });
                row.schlick /= row.e;
                row.dielectric = row.dielectric.map(|d| d / row.e);
                row.e /= N_U as f32;
                rows.push(row);
            }
            // ∫ e 2μ dμ with μ = t²: 4 t³ dt, by trapezoids of the measure.
            let row = &rows[r * N_MU..];
            for m in 0..N_MU - 1 {
                *avg += 0.5 * (row[m].e + row[m + 1].e) * (sqr(mu_of(m + 1)) - sqr(mu_of(m)));
            }
        }
        let dielectric_avg = std::array::from_fn(|k| (fresnel::diffuse_reflectance(etas[k]) - f0[k]).max(0.0) / (1.0 - f0[k]));
        Self { rows, e_avg, dielectric_avg }
    }

    /// Albedos of GGX with the perceived roughness √alpha and the refractive index `eta` ≥ 1 seen under the cosine `mu`.
    #[inline]
    pub(super) fn lookup(&self, mu: f32, roughness: f32, eta: f32) -> Albedo {
        let ((r, fr), (m, fm), (k, fk)) =
            (cell((roughness - MIN_ROUGHNESS) / (1.0 - MIN_ROUGHNESS), N_ROUGH), cell(safe_sqrt(mu), N_MU), cell(z_of(eta) / MAX_Z, N_ETA));
        let mut a = Albedo {
            e: 0.0,
            e_avg: lerp(fr, self.e_avg[r], self.e_avg[r + 1]),
            schlick: 0.0,
            dielectric: 0.0,
            dielectric_avg: lerp(fk, self.dielectric_avg[k], self.dielectric_avg[k + 1]),
        };
        for (row, w) in [(0, (1.0 - fr) * (1.0 - fm)), (1, (1.0 - fr) * fm), (N_MU, fr * (1.0 - fm)), (N_MU + 1, fr * fm)] {
            let row = &self.rows[r * N_MU + m + row];
            a.e += w * row.e;
            a.schlick += w * row.schlick;
            a.dielectric += w * lerp(fk, row.dielectric[k], row.dielectric[k + 1]);
        }
        a
    }
}

/// Reflected and refracted light of a rough interface together, for the indices of the grid or their inverse.
struct Glass {
    /// Directional albedo, the index varying fastest, then the cosine.
    e: Vec<f32>,
    /// Mean over the cosine-weighted hemisphere.
    e_avg: Vec<[f32; N_ETA]>,
    /// Mean reflectance of the smooth interface.
    f_avg: [f32; N_ETA],
}

impl Glass {
    fn new(inside: bool) -> Self {
        let etas: [f32; N_ETA] = std::array::from_fn(|k| {
            let eta = eta_of(k as f32 / (N_ETA - 1) as f32 * MAX_Z);
            if inside { 1.0 / eta } else { eta }
        });
        let mut e = vec![0.0; N_ROUGH * N_MU * N_ETA];
        for (i, row) in e.chunks_exact_mut(N_ETA).enumerate() {
            let (r, m) = (i / N_MU, i % N_MU);
            quadrature(mu_of(m), roughness_of(r), |mf, wo, h| {
                let c = wo.dot(h);
                let wr = fresnel::reflect(wo, h);
                let w_reflect = if wr.z > 0.0 { super::masking_ratio(mf, wo, wr) } else { 0.0 };
                for (sum, &eta) in row.iter_mut().zip(&etas) {
                    let (f, cos_t, _, eta_ti) = fresnel::dielectric(c, eta);
                    *sum += f * w_reflect;
                    if f < 1.0 {
                        let wt = fresnel::refract(wo, h, cos_t, eta_ti);
                        if wt.z < 0.0 {
                            *sum += (1.0 - f) * super::masking_ratio(mf, wo, wt);
                        }
                    }
                }
            });
            row.iter_mut().for_each(|s| *s /= N_U as f32);
        }
        let mut e_avg = vec![[0.0; N_ETA]; N_ROUGH];
        for (r, avg) in e_avg.iter_mut().enumerate() {
            for m in 0..N_MU - 1 {
                let (i, w) = ((r * N_MU + m) * N_ETA, 0.5 * (sqr(mu_of(m + 1)) - sqr(mu_of(m))));
                for (k, avg) in avg.iter_mut().enumerate() {
                    *avg += w * (e[i + k] + e[i + N_ETA + k]);
                }
            }
        }
        Self { e, e_avg, f_avg: etas.map(fresnel::diffuse_reflectance) }
    }
}

/// Albedo of a rough refracting interface with the relative index `eta` (far side over the side of the view), its mean
/// over the hemisphere, and the mean reflectance.
pub(super) fn glass_albedo(mu: f32, roughness: f32, eta: f32) -> [f32; 3] {
    let inside = eta < 1.0;
    let table = &GLASS[usize::from(inside)];
    let z = z_of(if inside { 1.0 / eta } else { eta });
    let ((r, fr), (m, fm), (k, fk)) =
        (cell((roughness - MIN_ROUGHNESS) / (1.0 - MIN_ROUGHNESS), N_ROUGH), cell(safe_sqrt(mu), N_MU), cell(z / MAX_Z, N_ETA));
    let at = |r: usize, m: usize| {
        let i = (r * N_MU + m) * N_ETA + k;
        lerp(fk, table.e[i], table.e[i + 1])
    };
    let avg = |r: usize| lerp(fk, table.e_avg[r][k], table.e_avg[r][k + 1]);
    [
        lerp(fr, lerp(fm, at(r, m), at(r, m + 1)), lerp(fm, at(r + 1, m), at(r + 1, m + 1))),
        lerp(fr, avg(r), avg(r + 1)),
        lerp(fk, table.f_avg[k], table.f_avg[k + 1]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_hold_shares() {
        let t = Tables::new();
        assert!(t.e_avg[0] > 0.99 && t.e_avg.iter().all(|e| (0.3..1.0).contains(e)), "{:?}", t.e_avg);
        // From inside at grazing angles nearly all light that is scattered once stays inside.
        for (inside, least) in [(false, 0.2), (true, 0.0)] {
            for e in Glass::new(inside).e {
                assert!(e > least && e < 1.001, "{inside} {e}");
            }
        }
    }
}
