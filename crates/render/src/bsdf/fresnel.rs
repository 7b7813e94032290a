//! Reflectance of smooth interfaces: the share of unpolarized light that is mirrored.

use crate::math::Vec3;
use crate::math::fns::{safe_sqrt, sqr};
use crate::spectrum::Spectrum;

/// Reflectance of the interface between two dielectrics by Fresnel's equations.
///
/// `cos_i` is the signed cosine of the incident direction with the normal, `eta` the refractive index inside (below the
/// surface) over that outside, positive and finite. Returns `(r, cos_t, eta_it, eta_ti)`:
///
/// - the reflectance, 1 where total internal reflection happens;
/// - the cosine of the refracted direction, with the sign opposite to `cos_i`, 0 at total internal reflection;
/// - the index on the transmitted side over that on the incident side, and the inverse of this ratio.
#[inline]
pub fn dielectric(cos_i: f32, eta: f32) -> (f32, f32, f32, f32) {
    let (eta_it, eta_ti) = if cos_i >= 0.0 { (eta, 1.0 / eta) } else { (1.0 / eta, eta) };
    if eta == 1.0 {
        return (0.0, -cos_i, 1.0, 1.0);
    }
    let ci = cos_i.abs().min(1.0);
    // Snell's law.
    let cos_t_sqr = 1.0 - (1.0 - ci * ci) * (eta_ti * eta_ti);
    if cos_t_sqr <= 0.0 {
        return (1.0, 0.0, eta_it, eta_ti);
    }
    let ct = cos_t_sqr.sqrt();
    // The amplitudes of both polarizations (Born and Wolf 1999, "Principles of Optics", equation 1.5.21).
    let a_s = (ci - eta_it * ct) / (ci + eta_it * ct);
    let a_p = (eta_it * ci - ct) / (eta_it * ci + ct);
    (0.5 * (a_s * a_s + a_p * a_p), (-ct).copysign(-cos_i), eta_it, eta_ti)
}

/// The direction of `w` refracted at the interface with unit normal `m`: `w` points away from the surface, and so does
/// the result. `cos_t` and `eta_ti` are those that [`dielectric`] returns for `w · m`.
#[inline]
pub fn refract(w: Vec3, m: Vec3, cos_t: f32, eta_ti: f32) -> Vec3 {
    m * (w.dot(m) * eta_ti + cos_t) - w * eta_ti
}

/// The direction of `w` mirrored about the unit normal `m`; both point away from the surface.
#[inline]
pub fn reflect(w: Vec3, m: Vec3) -> Vec3 {
    m * (2.0 * w.dot(m)) - w
}

/// The direction of `w` mirrored about +z.
#[inline]
pub fn reflect_z(w: Vec3) -> Vec3 {
    Vec3::new(-w.x, -w.y, w.z)
}

/// Reflectance of a conductor with the complex refractive index `eta + i k`, relative to the outside, lane by lane
/// (Born and Wolf 1999, section 14.2, with the real and imaginary part of the refracted cosine eliminated).
///
/// `cos_i` is the cosine of the incident direction with the normal; its absolute value counts.
#[inline]
pub fn conductor(cos_i: f32, eta: Spectrum, k: Spectrum) -> Spectrum {
    let c = cos_i.abs().min(1.0);
    let c2 = c * c;
    let s2 = 1.0 - c2;
    // The lanes that are not in use may hold zeros: no quotient may become 0 / 0.
    let ratio = |n: f32, d: f32| if d > 0.0 { n / d } else { 1.0 };
    eta.zip(k, |eta, k| {
        // Their fourth powers must stay finite; at this index everything is reflected but 1 in 2500.
        let (eta, k) = (eta.min(1e4), k.min(1e4));
        let t0 = eta * eta - k * k - s2;
        let ab = (t0 * t0 + 4.0 * sqr(eta * k)).sqrt();
        let a = safe_sqrt(0.5 * (ab + t0));
        let (t1, t2) = (ab + c2, 2.0 * a * c);
        let r_s = ratio(t1 - t2, t1 + t2);
        let (t3, t4) = (c2 * ab + s2 * s2, t2 * s2);
        let r_p = r_s * ratio(t3 - t4, t3 + t4);
        0.5 * (r_s + r_p)
    })
}

/// Schlick's approximation for the reflectance at normal incidence `f0` (Schlick 1994, "An Inexpensive BRDF Model for
/// Physically-based Rendering", equation 15, doi:10.1111/1467-8659.1330233).
#[inline]
pub fn schlick(cos_i: f32, f0: Spectrum) -> Spectrum {
    f0 + (Spectrum::ONE - f0) * schlick_weight(cos_i)
}

/// (1 − cos θ)⁵, the weight of the grazing reflectance in [`schlick`].
#[inline]
pub fn schlick_weight(cos_i: f32) -> f32 {
    let m = (1.0 - cos_i).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Share of ideally diffuse light that a dielectric interface reflects back to its side: the mean of [`dielectric`] over
/// the cosine-weighted hemisphere. `eta` is the index of the far side over that of the light's side.
///
/// The closed form for eta > 1 is by Walsh (1926; in Duntley 1942, "The Optical Properties of Diffusing Materials",
/// doi:10.1364/JOSA.32.000061); from below, the light that does not enter by total reflection is lost for the
/// squared ratio of the indices (Egan and Hilgeman 1979, "Optical Properties of Inhomogeneous Materials"). Costs two
/// logarithms in f64: call it when a material is made, not at each hit.
pub fn diffuse_reflectance(eta: f32) -> f32 {
    let eta = f64::from(eta);
    if eta >= 1.0 { external_diffuse(eta) as f32 } else { (1.0 - (1.0 - external_diffuse(1.0 / eta)) * eta * eta) as f32 }
}

fn external_diffuse(n: f64) -> f64 {
    // Each term has a pole at n = 1 that cancels against the others'; nearer than this the digits run out.
    const NEAR: f64 = 1.0 + 1e-4;
    if n < NEAR {
        return external_diffuse(NEAR) * ((n - 1.0) / (NEAR - 1.0)).max(0.0);
    }
    let n2 = n * n;
    let (p, q) = (n2 + 1.0, n2 * n2 - 1.0);
    0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) * (n + 1.0))
        + n2 * (n2 - 1.0) * (n2 - 1.0) / (p * p * p) * libm::log((n - 1.0) / (n + 1.0))
        - 2.0 * n * n2 * (n2 + 2.0 * n - 1.0) / (p * q)
        + 8.0 * n2 * n2 * (n2 * n2 + 1.0) / (p * q * q) * libm::log(n)
}

/// The refractive index of a dielectric against vacuum whose reflectance at normal incidence is `f0` in [0, 1).
#[inline]
pub fn eta_from_f0(f0: f32) -> f32 {
    let s = safe_sqrt(f0).min(0.999);
    (1.0 + s) / (1.0 - s)
}

/// Reflectance at normal incidence of the interface with relative index `eta`.
#[inline]
pub fn f0_from_eta(eta: f32) -> f32 {
    sqr((eta - 1.0) / (eta + 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dielectric_has_its_known_values() {
        let (r, cos_t, it, ti) = dielectric(1.0, 1.5);
        assert!((r - 0.04).abs() < 1e-6 && (cos_t + 1.0).abs() < 1e-6 && it == 1.5 && (ti - 1.0 / 1.5).abs() < 1e-7);
        // Brewster's angle: tan θ = eta, no light of one polarization: r = ((eta² − 1) / (eta² + 1))² / 2.
        let brewster = 1.0 / (1.0f32 + 1.5 * 1.5).sqrt();
        assert!((dielectric(brewster, 1.5).0 - 0.5 * sqr(1.25 / 3.25)).abs() < 1e-6);
        // Total internal reflection beyond sin θ = 1 / 1.5, not before it.
        assert_eq!(dielectric(-0.74, 1.5).0, 1.0);
        assert!(dielectric(-0.75, 1.5).0 < 1.0);
        assert_eq!(dielectric(0.3, 1.0), (0.0, -0.3, 1.0, 1.0));
        // The same interface from both sides.
        let (r, cos_t, ..) = dielectric(0.4, 1.7);
        let back = dielectric(cos_t, 1.7);
        assert!((back.0 - r).abs() < 1e-6 && (back.1 - 0.4).abs() < 1e-6);
    }

    #[test]
    fn conductor_without_absorption_is_a_dielectric() {
        for i in 0..=20 {
            let c = i as f32 / 20.0;
            let r = conductor(c, Spectrum::splat(1.5), Spectrum::ZERO);
            assert!((r.0[0] - dielectric(c, 1.5).0).abs() < 1e-5, "{c} {r:?}");
        }
        let zero = conductor(1.0, Spectrum::ZERO, Spectrum::ZERO);
        assert_eq!(zero, Spectrum::ONE);
        assert!(conductor(0.0, Spectrum::ONE, Spectrum::ZERO).is_finite());
        assert!(conductor(0.5, Spectrum::splat(1e30), Spectrum::splat(1e30)).is_finite());
    }

    #[test]
    fn diffuse_reflectance_is_the_integral_of_fresnel() {
        for eta in [1.0f32, 1.00003, 1.001, 1.1, 1.33, 1.5, 2.4, 5.0, 0.999, 0.9, 1.0 / 1.5, 0.4] {
            // ∫ r(c) 2c dc; substitution c = s² about the kink keeps the midpoint rule accurate.
            let n = 200_000;
            let crit = f64::from(1.0 - eta * eta).max(0.0).sqrt();
            let mut sum = crit * crit;
            for i in 0..n {
                let s = (f64::from(i) + 0.5) / f64::from(n);
                let c = crit + (1.0 - crit) * s * s;
                sum += f64::from(dielectric(c as f32, eta).0) * 2.0 * c * (1.0 - crit) * 2.0 * s / f64::from(n);
            }
            assert!((f64::from(diffuse_reflectance(eta)) - sum).abs() < 2e-5, "{eta}: {} {sum}", diffuse_reflectance(eta));
        }
    }
}
