//! The affine map from a canonical curved shape (unit sphere, unit cylinder) to its place.

use glam::{DMat3, DMat4, Mat3};

use crate::math::{Mat4, Vec3};

/// An invertible affine map with what intersection and sampling need of it.
#[derive(Clone, Debug)]
pub(super) struct Affine {
    /// Image of the origin.
    pub origin: Vec3,
    /// Linear part.
    pub linear: Mat3,
    /// Its inverse.
    pub inverse: Mat3,
    /// Transpose of the inverse: maps normals (without normalizing).
    pub normal: Mat3,
    /// |det| of the linear part.
    pub det: f32,
    /// True where the map mirrors.
    pub mirrored: bool,
}

impl Affine {
    /// `world_from_object` after `object_from_unit`, whose last rows are taken as (0, 0, 0, 1); `None` where singular or not finite.
    pub fn new(world_from_object: Mat4, object_from_unit: DMat4) -> Option<Self> {
        let m = world_from_object.as_dmat4() * object_from_unit;
        let linear = DMat3::from_mat4(m);
        let det = linear.determinant();
        let inverse = linear.inverse();
        let a = Self {
            origin: m.w_axis.truncate().as_vec3(),
            linear: linear.as_mat3(),
            inverse: inverse.as_mat3(),
            normal: inverse.transpose().as_mat3(),
            det: det.abs() as f32,
            mirrored: det < 0.0,
        };
        (det != 0.0 && det.is_finite() && a.origin.is_finite() && a.linear.is_finite() && a.inverse.is_finite()).then_some(a)
    }

    /// A point in the canonical shape's space.
    #[inline]
    pub fn unit_from_world(&self, p: Vec3) -> Vec3 {
        self.inverse * (p - self.origin)
    }

    /// A point of the canonical shape in the world.
    #[inline]
    pub fn world_from_unit(&self, p: Vec3) -> Vec3 {
        self.origin + self.linear * p
    }

    /// By how much the map stretches area at a place with the unit normal `n` (in canonical space).
    #[inline]
    pub fn area_stretch(&self, n: Vec3) -> f32 {
        self.det * (self.normal * n).length()
    }

    /// The unit normal and its derivatives for a canonical normal `n` that changes by `dndu` and `dndv`.
    #[inline]
    pub fn normals(&self, n: Vec3, dndu: Vec3, dndv: Vec3) -> (Vec3, Vec3, Vec3) {
        let nw = self.normal * n;
        let inv_len = 1.0 / nw.length();
        let nw = nw * inv_len;
        let derivative = |d: Vec3| {
            let d = self.normal * d;
            (d - nw * nw.dot(d)) * inv_len
        };
        (nw, derivative(dndu), derivative(dndv))
    }
}

/// The two roots, in order, of |f + t d|² = r² for vectors of the plane or of space given by their products: `b` = −f·d, `a` = d·d,
/// `l2` = |f + d b/a|² (squared distance of the center from the line), `c` = f·f − r². No roots: `None`.
///
/// Haines, Günther, Akenine-Möller 2019, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems ch. 7.
#[inline]
pub(super) fn circle_roots(a: f32, b: f32, l2: f32, c: f32, r2: f32) -> Option<(f32, f32)> {
    let disc = r2 - l2;
    if disc.is_nan() || disc < 0.0 {
        return None;
    }
    let q = b + (a * disc).sqrt().copysign(b);
    let (x, y) = (c / q, q / a);
    Some(if x <= y { (x, y) } else { (y, x) })
}
