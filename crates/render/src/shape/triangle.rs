//! Sampling of triangles, by area and by solid angle.
//!
//! The solid angle is sampled as a spherical triangle (Arvo 1995, "Stratified Sampling of Spherical Triangles",
//! doi:10.1145/218380.218500), in `f64`. Triangles that are far away are sampled by area, and so are nearly complete solid angles,
//! as in pbrt-v4 (section 6.5.4): there the angles of the spherical triangle have few digits.

use glam::DVec3;

use super::{AreaSample, area_to_solid_angle, is_far};
use crate::math::{Vec2, Vec3, warp};

const MIN_SOLID_ANGLE: f64 = 1e-6;
const MAX_SOLID_ANGLE: f64 = 6.22;

/// Area of a triangle.
#[inline]
pub fn area(v: &[Vec3; 3]) -> f32 {
    0.5 * (v[1] - v[0]).cross(v[2] - v[0]).length()
}

/// Unit normal, on the side from which the vertices are counter-clockwise; zero for a triangle without area.
#[inline]
pub fn normal(v: &[Vec3; 3]) -> Vec3 {
    (v[1] - v[0]).cross(v[2] - v[0]).normalize_or_zero()
}

/// The point at barycentric coordinates of the second and third vertex.
#[inline]
pub fn point(v: &[Vec3; 3], b: Vec2) -> Vec3 {
    v[0] * (1.0 - b.x - b.y) + v[1] * b.x + v[2] * b.y
}

/// The solid angle seen from a point (Van Oosterom and Strackee 1983, "The Solid Angle of a Plane Triangle",
/// doi:10.1109/TBME.1983.325207, equation 8).
#[inline]
pub fn solid_angle(v: &[Vec3; 3], ref_p: Vec3) -> f32 {
    directions(v, ref_p).map_or(0.0, |d| solid_angle_of(&d) as f32)
}

/// A uniform point with its density by area; `None` for a triangle without area.
#[inline]
pub fn sample_area(v: &[Vec3; 3], u: Vec2) -> Option<AreaSample> {
    let pdf = 1.0 / area(v);
    let uv = warp::triangle(u);
    pdf.is_finite().then(|| AreaSample { p: point(v, uv), ng: normal(v), uv, pdf })
}

/// A point with its density per solid angle at `ref_p`; `None` where the triangle is seen edge-on or has no area.
pub fn sample_solid_angle(v: &[Vec3; 3], ref_p: Vec3, u: Vec2) -> Option<AreaSample> {
    let Some((d, solid_angle)) = spherical(v, ref_p) else {
        return sample_area(v, u)?.per_solid_angle(ref_p);
    };
    let w = sample_spherical(&d, solid_angle, u);
    let uv = barycentric(v, ref_p, w)?;
    Some(AreaSample { p: point(v, uv), ng: normal(v), uv, pdf: (1.0 / solid_angle) as f32 })
}

/// The density with which [`sample_solid_angle`] returns the point `p` of the triangle.
pub fn pdf_solid_angle(v: &[Vec3; 3], ref_p: Vec3, p: Vec3) -> f32 {
    match spherical(v, ref_p) {
        Some((_, solid_angle)) => (1.0 / solid_angle) as f32,
        None => area_to_solid_angle(ref_p, p, normal(v)) / area(v),
    }
}

/// Unit directions to the vertices; `None` where one is at the reference point.
#[inline]
fn directions(v: &[Vec3; 3], ref_p: Vec3) -> Option<[DVec3; 3]> {
    let d = v.map(|v| (v.as_dvec3() - ref_p.as_dvec3()).normalize());
    d.iter().all(|d| d.is_finite()).then_some(d)
}

#[inline]
fn solid_angle_of([a, b, c]: &[DVec3; 3]) -> f64 {
    // From differences, so that small triangles keep their digits.
    let volume = a.dot((*b - *a).cross(*c - *a)).abs();
    2.0 * libm::atan2(volume, 1.0 + a.dot(*b) + b.dot(*c) + c.dot(*a))
}

/// The directions and solid angle, if it can be sampled as a spherical triangle.
#[inline]
fn spherical(v: &[Vec3; 3], ref_p: Vec3) -> Option<([DVec3; 3], f64)> {
    let center = (v[0] + v[1] + v[2]) * (1.0 / 3.0);
    let radius2 = v.iter().fold(0.0f32, |r, &v| r.max((v - center).length_squared()));
    if is_far(center, radius2, ref_p) {
        return None;
    }
    let d = directions(v, ref_p)?;
    let solid_angle = solid_angle_of(&d);
    (solid_angle > MIN_SOLID_ANGLE && solid_angle < MAX_SOLID_ANGLE).then_some((d, solid_angle))
}

/// A uniform direction of the spherical triangle; Arvo's figure 2 with his names.
fn sample_spherical(&[a, b, c]: &[DVec3; 3], solid_angle: f64, u: Vec2) -> DVec3 {
    let (n_ab, n_ac) = (a.cross(b), a.cross(c));
    let (sin_alpha, cos_alpha) = {
        let (s, c) = (n_ab.cross(n_ac).length(), n_ab.dot(n_ac));
        let len = (s * s + c * c).sqrt();
        (s / len, c / len)
    };
    let alpha = libm::atan2(sin_alpha, cos_alpha);
    let area = f64::from(u.x) * solid_angle;
    let (s, t) = (libm::sin(area - alpha), libm::cos(area - alpha));
    let (uu, vv) = (t - cos_alpha, s + sin_alpha * a.dot(b));
    let q = (((vv * t - uu * s) * cos_alpha - vv) / ((vv * s + uu * t) * sin_alpha)).clamp(-1.0, 1.0);
    let perpendicular = |x: DVec3, y: DVec3| (x - y * x.dot(y)).normalize_or_zero();
    let q = if q.is_finite() { q } else { 1.0 };
    let c_hat = a * q + perpendicular(c, a) * (1.0 - q * q).max(0.0).sqrt();
    let z = 1.0 - f64::from(u.y) * (1.0 - c_hat.dot(b));
    b * z + perpendicular(c_hat, b) * (1.0 - z * z).max(0.0).sqrt()
}

/// Where a direction that meets the triangle meets it (Möller and Trumbore 1997), limited to the triangle.
fn barycentric(v: &[Vec3; 3], ref_p: Vec3, w: DVec3) -> Option<Vec2> {
    let v0 = v[0].as_dvec3();
    let (e1, e2, s) = (v[1].as_dvec3() - v0, v[2].as_dvec3() - v0, ref_p.as_dvec3() - v0);
    let p = w.cross(e2);
    let inv_det = 1.0 / p.dot(e1);
    let b1 = (p.dot(s) * inv_det).clamp(0.0, 1.0);
    let b2 = (w.dot(s.cross(e1)) * inv_det).clamp(0.0, 1.0);
    let over = (b1 + b2).max(1.0);
    let b = Vec2::new((b1 / over) as f32, (b2 / over) as f32);
    b.is_finite().then_some(b)
}
