//! Spheres and ellipsoids.

use glam::{DMat4, DVec3};

use super::affine::{Affine, circle_roots};
use super::{AreaSample, ShapeHit, SurfaceGeometry};
use crate::accel::Ray;
use crate::math::{Aabb, Frame, INV_4PI, INV_PI, INV_TAU, Mat4, PI, TAU, Vec2, Vec3, fns, warp};

/// The unit sphere under an affine map; a true sphere where that keeps angles. u runs about the object's +z, v from +z to −z.
#[derive(Clone, Debug)]
pub struct Sphere {
    pub(super) affine: Affine,
    /// The radius of a true sphere.
    radius: Option<f32>,
    normal_sign: f32,
    area: f32,
}

/// Squared distances from the center of the unit sphere up to this above 1 count as on it.
const ON_SURFACE: f32 = 1e-5;
/// What is nearer than this to a point on the unit sphere is not sampled from there: its direction would have no digits.
const NEAREST: f32 = 1e-4;

impl Sphere {
    /// A true sphere in the object's axes; `None` where the radius is not positive or something not finite.
    pub fn new(center: Vec3, radius: f32) -> Option<Self> {
        Self::from_transform(center, radius, Mat4::IDENTITY, false)
    }

    /// Places a sphere; `None` where the radius is not positive, or the transform singular or not finite.
    pub fn from_transform(center: Vec3, radius: f32, world_from_object: Mat4, flip_normals: bool) -> Option<Self> {
        if !(radius > 0.0 && radius.is_finite()) {
            return None;
        }
        let object_from_unit = DMat4::from_translation(center.as_dvec3()) * DMat4::from_scale(DVec3::splat(f64::from(radius)));
        let affine = Affine::new(world_from_object, object_from_unit)?;
        let [x, y, z] = [affine.linear.x_axis, affine.linear.y_axis, affine.linear.z_axis].map(|c| c.as_dvec3());
        let r2 = (x.length_squared() + y.length_squared() + z.length_squared()) / 3.0;
        // Products of three rotations and scalings in f32 leave an error of about 1e-6.
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-5 * r2;
        let keeps_angles =
            [x, y, z].iter().all(|c| close(c.length_squared(), r2)) && [x.dot(y), y.dot(z), z.dot(x)].iter().all(|&dot| close(dot, 0.0));
        let radius = keeps_angles.then_some(r2.sqrt() as f32);
        let normal_sign = if affine.mirrored != flip_normals { -1.0 } else { 1.0 };
        let area = match radius {
            Some(r) => 4.0 * PI * r * r,
            None => ellipsoid_area(&affine),
        };
        (area > 0.0 && area.is_finite()).then_some(Self { affine, radius, normal_sign, area })
    }

    /// Center.
    #[inline]
    pub fn center(&self) -> Vec3 {
        self.affine.origin
    }

    /// The radius of a true sphere, `None` for an ellipsoid.
    #[inline]
    pub fn radius(&self) -> Option<f32> {
        self.radius
    }

    /// See [`super::Shape::bounds`].
    pub fn bounds(&self) -> Aabb {
        let m = &self.affine.linear;
        let half = (m.x_axis * m.x_axis + m.y_axis * m.y_axis + m.z_axis * m.z_axis).map(f32::sqrt) * (1.0 + 2.0 * f32::EPSILON);
        Aabb { min: self.center() - half, max: self.center() + half }
    }

    /// See [`super::Shape::intersect`]. The error of t is a few ulps of the distance from the origin to the center.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
        let f = ray.o - self.center();
        let (f, d, r) = match self.radius {
            Some(r) => (f, ray.d, r),
            None => (self.affine.inverse * f, self.affine.inverse * ray.d, 1.0),
        };
        let a = d.length_squared();
        let b = -f.dot(d);
        let l = f + d * (b / a);
        let len = f.length();
        let (t0, t1) = circle_roots(a, b, l.length_squared(), (len - r) * (len + r), r * r)?;
        let inside = |t: f32| t > ray.t_min && t < ray.t_max;
        let t = if inside(t0) {
            t0
        } else if inside(t1) {
            t1
        } else {
            return None;
        };
        let uv = uv_from_unit(self.affine.unit_from_world(ray.at(t)));
        Some(ShapeHit { t, u: uv.x, v: uv.y })
    }

    /// See [`super::Shape::surface`]. At the poles, where u has no derivative, `dpdu` is that of a point beside them.
    #[inline]
    pub fn surface(&self, p: Vec3) -> SurfaceGeometry {
        let q = self.affine.unit_from_world(p).normalize_or(Vec3::Z);
        let rho = Vec2::new(q.x, q.y).length();
        let e = if rho > 0.0 { Vec2::new(q.x, q.y) / rho } else { Vec2::X };
        let dqdu = Vec3::new(-e.y, e.x, 0.0) * (TAU * rho.max(1e-6));
        let dqdv = Vec3::new(q.z * e.x, q.z * e.y, -rho) * PI;
        let (n, dndu, dndv) = self.affine.normals(q, dqdu, dqdv);
        SurfaceGeometry {
            p: self.affine.world_from_unit(q),
            ng: n * self.normal_sign,
            uv: uv_from_unit(q),
            dpdu: self.affine.linear * dqdu,
            dpdv: self.affine.linear * dqdv,
            dndu: dndu * self.normal_sign,
            dndv: dndv * self.normal_sign,
        }
    }

    /// See [`super::Shape::area`].
    pub fn area(&self) -> f32 {
        self.area
    }

    /// See [`super::Shape::sample_area`].
    #[inline]
    pub fn sample_area(&self, u: Vec2) -> Option<AreaSample> {
        let q = warp::uniform_sphere(u);
        Some(self.sample_at(q, self.density_at(q)))
    }

    /// See [`super::Shape::pdf_area`].
    pub fn pdf_area(&self, p: Vec3) -> f32 {
        self.density_at(self.affine.unit_from_world(p).normalize_or(Vec3::Z))
    }

    /// The density by area at a point of the unit sphere.
    #[inline]
    fn density_at(&self, q: Vec3) -> f32 {
        match self.radius {
            Some(_) => 1.0 / self.area,
            None => INV_4PI / self.affine.area_stretch(q),
        }
    }

    /// The sample at a point of the unit sphere.
    #[inline]
    fn sample_at(&self, q: Vec3, pdf: f32) -> AreaSample {
        let ng = (self.affine.normal * q).normalize_or_zero() * self.normal_sign;
        AreaSample { p: self.affine.world_from_unit(q), ng, uv: uv_from_unit(q), pdf }
    }

    /// 1 − cos of the half-angle under which the unit sphere is seen from `f`: 2 (every direction) from the inside, and from the surface
    /// itself, whose points may lie outside by rounding.
    #[inline]
    fn cone(f: Vec3) -> f32 {
        let dist2 = f.length_squared();
        let sin2 = 1.0 / dist2;
        if dist2 > 1.0 + ON_SURFACE { sin2 / (1.0 + (1.0 - sin2).sqrt()) } else { 2.0 }
    }

    /// The density per solid angle in the world of directions that are uniform in the cone in the unit sphere's space;
    /// `wi` (unit) is the direction in the world. Directions map by ω → Aω/|Aω|, solid angles by |det A| / |Aω|³.
    #[inline]
    fn cone_pdf(&self, one_minus_cos: f32, wi: Vec3) -> f32 {
        let pdf = warp::uniform_cone_pdf(one_minus_cos);
        match self.radius {
            Some(_) => pdf,
            None => {
                let s = 1.0 / (self.affine.inverse * wi).length();
                pdf * (s * s * s) / self.affine.det
            }
        }
    }

    /// See [`super::Shape::sample_solid_angle`]: uniform in the visible cone, or over all directions from the inside. For
    /// ellipsoids uniform in the space in which they are spheres.
    #[inline]
    pub fn sample_solid_angle(&self, ref_p: Vec3, u: Vec2) -> Option<AreaSample> {
        let f = self.affine.unit_from_world(ref_p);
        let one_minus_cos = Self::cone(f);
        let q = if one_minus_cos < 2.0 {
            // The angle at the center from those at the reference point: its sine by the distance along the direction, which
            // keeps its digits close to the surface, its cosine as in pbrt-v4, section 6.2.4.
            let dist = f.length();
            let omc = u.x * one_minus_cos;
            let sin2 = omc * (2.0 - omc);
            let root = fns::safe_sqrt(1.0 - sin2 * dist * dist);
            let t = (dist - 1.0) * (dist + 1.0) / (dist * (1.0 - omc) + root);
            let (sin_alpha, cos_alpha) = (t * sin2.sqrt(), sin2 * dist + (1.0 - omc) * root);
            let (sin_phi, cos_phi) = fns::sin_cos(TAU * u.y);
            Frame::from_normal(f / dist)
                .world_from_local(Vec3::new(sin_alpha * cos_phi, sin_alpha * sin_phi, cos_alpha))
                .normalize_or_zero()
        } else {
            let d = warp::uniform_sphere(u);
            let b = -f.dot(d);
            let t = b + fns::safe_sqrt(b * b + (1.0 - f.length_squared()));
            if t < NEAREST {
                return None;
            }
            (f + d * t).normalize_or_zero()
        };
        let s = self.sample_at(q, 0.0);
        let pdf = self.cone_pdf(one_minus_cos, (s.p - ref_p).normalize_or_zero());
        (pdf > 0.0 && pdf.is_finite()).then_some(AreaSample { pdf, ..s })
    }

    /// See [`super::Shape::pdf_solid_angle`]; zero on the far side of a sphere seen from outside.
    #[inline]
    pub fn pdf_solid_angle(&self, ref_p: Vec3, p: Vec3, _ng: Vec3) -> f32 {
        let f = self.affine.unit_from_world(ref_p);
        let one_minus_cos = Self::cone(f);
        // With slack for points at the outline.
        let q = self.affine.unit_from_world(p);
        if one_minus_cos < 2.0 && q.dot(f) < 1.0 - 1e-3 * f.length() || one_minus_cos == 2.0 && (q - f).length_squared() < NEAREST * NEAREST
        {
            return 0.0;
        }
        let pdf = self.cone_pdf(one_minus_cos, (p - ref_p).normalize_or_zero());
        if pdf.is_finite() { pdf } else { 0.0 }
    }
}

#[inline]
fn uv_from_unit(q: Vec3) -> Vec2 {
    let turn = fns::atan2(q.y, q.x) * INV_TAU;
    // Not the arc cosine of z, which has no digits left near the poles.
    let v = fns::atan2(Vec2::new(q.x, q.y).length(), q.z) * INV_PI;
    Vec2::new(if turn < 0.0 { turn + 1.0 } else { turn }, v)
}

/// Midpoint rule over cos θ and φ: five digits for axes within a factor of ten.
fn ellipsoid_area(affine: &Affine) -> f32 {
    let (rows, columns) = (256, 64);
    let mut sum = 0.0;
    for i in 0..rows {
        for j in 0..columns {
            let u = Vec2::new((i as f32 + 0.5) / rows as f32, (j as f32 + 0.5) / columns as f32);
            sum += f64::from(affine.area_stretch(warp::uniform_sphere(u)));
        }
    }
    (sum / f64::from(rows * columns)) as f32 * 4.0 * PI
}
