//! Warps of uniform samples in [0,1)² to the domains of light transport, with their densities.
//!
//! Each `…_pdf` is the density of the warp with the same name, per solid angle unless said otherwise.

use super::{INV_4PI, INV_PI, INV_TAU, PI, TAU, Vec2, Vec3, fns};

/// A point of the unit disk, by area, with low distortion (Shirley and Chiu 1997, "A Low Distortion Map Between
/// Disk and Square", doi:10.1080/10867651.1997.10487479).
#[inline]
pub fn disk_concentric(u: Vec2) -> Vec2 {
    let o = 2.0 * u - Vec2::ONE;
    if o.x == 0.0 && o.y == 0.0 {
        return Vec2::ZERO;
    }
    let flat = o.x.abs() > o.y.abs();
    let (r, other) = if flat { (o.x, o.y) } else { (o.y, o.x) };
    // In the upper and lower quarters the angle is counted from the other axis.
    let (sin, cos) = fns::sin_cos_eighth(PI / 4.0 * (other / r));
    r * if flat { Vec2::new(cos, sin) } else { Vec2::new(sin, cos) }
}

/// A cosine-weighted direction about +z.
#[inline]
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = disk_concentric(u);
    Vec3::new(d.x, d.y, fns::safe_sqrt(1.0 - d.length_squared()))
}

/// The density of [`cosine_hemisphere`] for a direction at the given cosine.
#[inline]
pub fn cosine_hemisphere_pdf(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * INV_PI
}

/// A uniform direction of the hemisphere about +z.
#[inline]
pub fn uniform_hemisphere(u: Vec2) -> Vec3 {
    let r = fns::safe_sqrt(1.0 - u.x * u.x);
    let (sin, cos) = fns::sin_cos(TAU * u.y);
    Vec3::new(r * cos, r * sin, u.x)
}

/// The density of [`uniform_hemisphere`].
pub const UNIFORM_HEMISPHERE_PDF: f32 = INV_TAU;

/// A uniform direction of the sphere.
#[inline]
pub fn uniform_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let r = fns::safe_sqrt(1.0 - z * z);
    let (sin, cos) = fns::sin_cos(TAU * u.y);
    Vec3::new(r * cos, r * sin, z)
}

/// The density of [`uniform_sphere`].
pub const UNIFORM_SPHERE_PDF: f32 = INV_4PI;

/// A uniform direction of the cone about +z; `one_minus_cos` = 1 − cos of its half-angle, kept in this form so that
/// narrow cones do not lose their digits.
#[inline]
pub fn uniform_cone(u: Vec2, one_minus_cos: f32) -> Vec3 {
    let omc = u.x * one_minus_cos;
    let sin_theta = fns::safe_sqrt(omc * (2.0 - omc));
    let (sin, cos) = fns::sin_cos(TAU * u.y);
    Vec3::new(cos * sin_theta, sin * sin_theta, 1.0 - omc)
}

/// The density of [`uniform_cone`].
#[inline]
pub fn uniform_cone_pdf(one_minus_cos: f32) -> f32 {
    INV_TAU / one_minus_cos
}

/// Barycentric coordinates (of the second and third vertex) of a uniform point of a triangle.
#[inline]
pub fn triangle(u: Vec2) -> Vec2 {
    let r = fns::safe_sqrt(1.0 - u.x);
    Vec2::new(1.0 - r, u.y * r)
}

/// The weight of strategy `f` beside `g` by the power heuristic with exponent 2 (Veach 1997, section 9.2.4).
#[inline]
pub fn power_heuristic(pdf_f: f32, pdf_g: f32) -> f32 {
    if pdf_f.is_infinite() {
        return 1.0;
    }
    let (f, g) = (pdf_f * pdf_f, pdf_g * pdf_g);
    if (f + g).is_infinite() {
        // Lights seen from very far away have densities whose squares leave the range.
        let ratio = pdf_g / pdf_f;
        return 1.0 / (1.0 + ratio * ratio);
    }
    if f + g > 0.0 { f / (f + g) } else { 0.0 }
}
