//! Open cylinders.

use glam::{DMat4, DVec4};

use super::affine::{Affine, circle_roots};
use super::{AreaSample, ShapeHit, SurfaceGeometry, area_to_solid_angle};
use crate::accel::Ray;
use crate::math::{Aabb, Frame, INV_TAU, Mat4, TAU, Vec2, Vec3, fns};

/// The cylinder of radius 1 about z from 0 to 1, without caps, under an affine map. u is the angle over 2π, v runs along the axis.
#[derive(Clone, Debug)]
pub struct Cylinder {
    pub(super) affine: Affine,
    normal_sign: f32,
    area: f32,
}

impl Cylinder {
    /// Places the cylinder from `p0` to `p1`; `None` where it has no surface or something is not finite.
    pub fn from_transform(p0: Vec3, p1: Vec3, radius: f32, world_from_object: Mat4, flip_normals: bool) -> Option<Self> {
        let axis = p1 - p0;
        let length = axis.as_dvec3().length();
        if !(radius > 0.0 && radius.is_finite() && length > 0.0 && length.is_finite()) {
            return None;
        }
        let frame = Frame::from_normal((axis.as_dvec3() / length).as_vec3());
        let r = f64::from(radius);
        let column = |v: Vec3, s: f64| (v.as_dvec3() * s).extend(0.0);
        let object_from_unit =
            DMat4::from_cols(column(frame.s, r), column(frame.t, r), column(axis, 1.0), DVec4::from((p0.as_dvec3(), 1.0)));
        let affine = Affine::new(world_from_object, object_from_unit)?;
        let normal_sign = if flip_normals { -1.0 } else { 1.0 };
        // The midpoint rule over a period converges faster than any power.
        let steps = 256;
        let mean = (0..steps).map(|i| affine.area_stretch(around((i as f32 + 0.5) / steps as f32))).sum::<f32>() / steps as f32;
        let area = TAU * mean;
        (area > 0.0 && area.is_finite()).then_some(Self { affine, normal_sign, area })
    }

    /// See [`super::Shape::bounds`].
    pub fn bounds(&self) -> Aabb {
        let m = &self.affine.linear;
        let half = (m.x_axis * m.x_axis + m.y_axis * m.y_axis).map(f32::sqrt) * (1.0 + 2.0 * f32::EPSILON);
        let (a, b) = (self.affine.origin, self.affine.world_from_unit(Vec3::Z));
        Aabb { min: a.min(b) - half, max: a.max(b) + half }
    }

    /// See [`super::Shape::intersect`].
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
        let (o, d) = (self.affine.unit_from_world(ray.o), self.affine.inverse * ray.d);
        let (f, e) = (Vec2::new(o.x, o.y), Vec2::new(d.x, d.y));
        let a = e.length_squared();
        let b = -f.dot(e);
        let l = f + e * (b / a);
        let len = f.length();
        let (t0, t1) = circle_roots(a, b, l.length_squared(), (len - 1.0) * (len + 1.0), 1.0)?;
        for t in [t0, t1] {
            let z = o.z + d.z * t;
            if t > ray.t_min && t < ray.t_max && (0.0..=1.0).contains(&z) {
                return Some(ShapeHit { t, u: turn(o + d * t), v: z });
            }
        }
        None
    }

    /// See [`super::Shape::surface`].
    #[inline]
    pub fn surface(&self, p: Vec3) -> SurfaceGeometry {
        let q = self.affine.unit_from_world(p);
        let e = Vec2::new(q.x, q.y).normalize_or(Vec2::X);
        let q = Vec3::new(e.x, e.y, q.z.clamp(0.0, 1.0));
        let dqdu = Vec3::new(-e.y, e.x, 0.0) * TAU;
        let (n, dndu, _) = self.affine.normals(Vec3::new(e.x, e.y, 0.0), dqdu, Vec3::ZERO);
        SurfaceGeometry {
            p: self.affine.world_from_unit(q),
            ng: n * self.normal_sign,
            uv: Vec2::new(turn(q), q.z),
            dpdu: self.affine.linear * dqdu,
            dpdv: self.affine.linear.z_axis,
            dndu: dndu * self.normal_sign,
            dndv: Vec3::ZERO,
        }
    }

    /// See [`super::Shape::area`].
    pub fn area(&self) -> f32 {
        self.area
    }

    /// See [`super::Shape::sample_area`].
    #[inline]
    pub fn sample_area(&self, u: Vec2) -> Option<AreaSample> {
        let n = around(u.x);
        let ng = (self.affine.normal * n).normalize_or_zero() * self.normal_sign;
        let p = self.affine.world_from_unit(n + Vec3::Z * u.y);
        Some(AreaSample { p, ng, uv: u, pdf: INV_TAU / self.affine.area_stretch(n) })
    }

    /// See [`super::Shape::sample_solid_angle`]: as [`Cylinder::sample_area`], so that half of the samples are on the far side.
    #[inline]
    pub fn sample_solid_angle(&self, ref_p: Vec3, u: Vec2) -> Option<AreaSample> {
        self.sample_area(u)?.per_solid_angle(ref_p)
    }

    /// See [`super::Shape::pdf_area`].
    #[inline]
    pub fn pdf_area(&self, p: Vec3) -> f32 {
        let q = self.affine.unit_from_world(p);
        let n = Vec3::new(q.x, q.y, 0.0).normalize_or_zero();
        INV_TAU / self.affine.area_stretch(n)
    }

    /// See [`super::Shape::pdf_solid_angle`].
    #[inline]
    pub fn pdf_solid_angle(&self, ref_p: Vec3, p: Vec3, ng: Vec3) -> f32 {
        area_to_solid_angle(ref_p, p, ng) * self.pdf_area(p)
    }
}

/// The unit circle at a share of a turn.
#[inline]
fn around(turn: f32) -> Vec3 {
    let (sin, cos) = fns::sin_cos(TAU * turn);
    Vec3::new(cos, sin, 0.0)
}

#[inline]
fn turn(q: Vec3) -> f32 {
    let turn = fns::atan2(q.y, q.x) * INV_TAU;
    if turn < 0.0 { turn + 1.0 } else { turn }
}
