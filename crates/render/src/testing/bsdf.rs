//! What every scattering model must keep: checks that panic with the model's name.

use super::chi2::{self, Chi2, random, sphere_integral};
use crate::bsdf::{Bsdf, Lobe, TransportMode};
use crate::math::{ONE_MINUS_EPSILON, PI, Vec2, Vec3, fns};

/// A unit vector from polar angle and azimuth in degrees.
pub fn direction(theta_deg: f32, phi_deg: f32) -> Vec3 {
    let (st, ct) = fns::sin_cos(theta_deg * (PI / 180.0));
    let (sp, cp) = fns::sin_cos(phi_deg * (PI / 180.0));
    Vec3::new(st * cp, st * sp, ct)
}

/// Samples have the density that `pdf` says. `mass_tolerance` is how far its integral may be off the share of hits.
pub fn check_density(name: &str, bsdf: &Bsdf, wo: Vec3, significance: f64, mass_tolerance: f64, seed: u64) {
    let settings = Chi2 { seed, ..Chi2::default() };
    let sample = |u_lobe, u| {
        let s = bsdf.sample(wo, u_lobe, u, TransportMode::Radiance)?;
        (!s.lobe.contains(Lobe::DELTA)).then_some(s.wi)
    };
    settings.run(sample, |wi| bsdf.pdf(wo, wi)).check(&settings, significance, mass_tolerance, &format!("{name}, wo {wo}"));
}

/// No more light is scattered than comes in, and sampling estimates the same amount as quadrature over `eval`. Returns the
/// share of light that is scattered (first lane).
#[allow(clippy::panic)]
pub fn check_energy(name: &str, bsdf: &Bsdf, wo: Vec3, most: f64) -> f64 {
    let n = 20_000;
    let (mut sum, mut sum_sqr, mut delta) = (0.0, 0.0, 0.0);
    for i in 0..n {
        let (u_lobe, u) = random(11, i);
        if let Some(s) = bsdf.sample(wo, u_lobe, u, TransportMode::Importance) {
            let weight = f64::from(s.value.0[0] / s.pdf);
            if s.lobe.contains(Lobe::DELTA) {
                delta += weight;
            } else {
                sum += weight;
                sum_sqr += weight * weight;
            }
        }
    }
    let n = n as f64;
    let (mean, delta) = (sum / n, delta / n);
    let deviation = libm::sqrt((sum_sqr / n - mean * mean).max(0.0) / n);
    let integral = sphere_integral(1e-3, |wi| bsdf.eval(wo, wi, TransportMode::Importance).0[0]);
    if (integral - mean).abs() > 4.5 * deviation + 5e-3 || integral + delta > most {
        panic!("{name}, wo {wo}: quadrature {integral}, sampling {mean} ± {deviation}, deltas {delta}");
    }
    integral + delta
}

/// `sample` returns the same value and density as `eval` and `pdf`, a unit direction, and lobes that `lobes` announces.
#[allow(clippy::panic)]
pub fn check_consistency(name: &str, bsdf: &Bsdf, wo: Vec3, tolerance: f32) {
    for mode in [TransportMode::Radiance, TransportMode::Importance] {
        for i in 0..2000 {
            let (u_lobe, u) = random(5, i);
            let Some(s) = bsdf.sample(wo, u_lobe, u, mode) else { continue };
            let crosses = s.wi.z * wo.z < 0.0;
            let mut ok = (s.wi.length() - 1.0).abs() < 1e-4 && s.pdf > 0.0 && bsdf.lobes().contains(s.lobe);
            ok &= s.lobe.contains(if crosses { Lobe::TRANSMISSION } else { Lobe::REFLECTION }) && (crosses || s.eta == 1.0);
            let (value, pdf) = (bsdf.eval(wo, s.wi, mode), bsdf.pdf(wo, s.wi));
            if !s.lobe.contains(Lobe::DELTA) {
                ok &= (pdf - s.pdf).abs() <= tolerance * s.pdf;
                ok &= (0..3).all(|l| (value.0[l] - s.value.0[l]).abs() <= tolerance * s.value.0[l].max(1e-6));
            }
            if !ok {
                panic!("{name}, wo {wo}, {mode:?}: {s:?}, eval {value:?}, pdf {pdf}");
            }
        }
    }
}

/// Light and camera may change places: f(wo, wi) of radiance is f(wi, wo) of importance.
#[allow(clippy::panic)]
pub fn check_reciprocity(name: &str, bsdf: &Bsdf) {
    for i in 0..2000 {
        let (_, u) = random(3, 2 * i);
        let (_, v) = random(3, 2 * i + 1);
        let (a, b) = (crate::math::warp::uniform_sphere(u), crate::math::warp::uniform_sphere(v));
        let ab = bsdf.eval(a, b, TransportMode::Radiance) / b.z.abs();
        let ba = bsdf.eval(b, a, TransportMode::Importance) / a.z.abs();
        for l in 0..3 {
            if (ab.0[l] - ba.0[l]).abs() > 1e-3 * ab.0[l].max(ba.0[l]) + 1e-6 {
                panic!("{name}: f({a}, {b}) = {ab:?}, f({b}, {a}) = {ba:?}");
            }
        }
    }
}

/// Finite numbers and unit directions for grazing directions and the corners of the sample space.
#[allow(clippy::panic)]
pub fn check_extremes(name: &str, bsdf: &Bsdf) {
    let ends = [0.0, 1e-7, 0.5, ONE_MINUS_EPSILON];
    let cosines: [f32; 7] = [1.0, 0.5, 1e-3, 1e-6, 1e-20, 0.0, -1e-6];
    let dirs: Vec<Vec3> = cosines.iter().chain(&[-0.7, -1.0]).map(|&z| Vec3::new(fns::safe_sqrt(1.0 - z * z), 0.0, z)).collect();
    for &wo in &dirs {
        for &other in &dirs {
            for wi in [other, Vec3::new(-other.x, 0.0, other.z)] {
                let (value, pdf) = (bsdf.eval(wo, wi, TransportMode::Radiance), bsdf.pdf(wo, wi));
                if !value.is_finite() || !pdf.is_finite() || pdf < 0.0 || value.rgb().iter().any(|&v| v < 0.0) {
                    panic!("{name}: wo {wo}, wi {wi}: {value:?}, pdf {pdf}");
                }
            }
        }
        if !bsdf.albedo(wo).is_finite() {
            panic!("{name}: albedo of {wo}: {:?}", bsdf.albedo(wo));
        }
        for u_lobe in ends {
            for u in ends.iter().flat_map(|&x| ends.iter().map(move |&y| Vec2::new(x, y))) {
                if let Some(s) = bsdf.sample(wo, u_lobe, u, TransportMode::Radiance) {
                    let bounded = s.value.is_finite() && s.pdf.is_finite() && s.pdf > 0.0 && s.value.rgb().iter().all(|&v| v >= 0.0);
                    if !bounded || (s.wi.length() - 1.0).abs() > 1e-3 || !s.eta.is_finite() {
                        panic!("{name}: wo {wo}, u {u_lobe} {u}: {s:?}");
                    }
                }
            }
        }
    }
}

/// The significance of one of `tests` chi-square tests of a test function.
pub fn significance(tests: usize) -> f64 {
    chi2::sidak(0.01, tests)
}
