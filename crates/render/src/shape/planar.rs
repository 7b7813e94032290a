//! The plane of a flat shape, with coordinates in it.

use glam::DVec3;

use super::SurfaceGeometry;
use crate::accel::Ray;
use crate::math::{Mat4, Vec2, Vec3};

/// The image of the xy plane: points are `origin + x·x_axis + y·y_axis`.
#[derive(Clone, Debug)]
pub(super) struct Planar {
    /// Image of the origin.
    pub origin: Vec3,
    /// Image of +x, any length.
    pub x_axis: Vec3,
    /// Image of +y, any length and not necessarily perpendicular.
    pub y_axis: Vec3,
    /// Unit normal.
    pub ng: Vec3,
    /// |x_axis × y_axis|.
    pub stretch: f32,
    dual_x: Vec3,
    dual_y: Vec3,
}

/// Which way the normal of a flat shape points when its transform mirrors.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Facing {
    /// `x_axis` × `y_axis`.
    Cross,
    /// The side to which +z is mapped.
    LocalZ,
}

impl Planar {
    /// `None` where the plane's image is no plane or not finite. The image of z may vanish (files scale flat things by 0).
    pub fn new(m: Mat4, facing: Facing, flip_normals: bool) -> Option<Self> {
        let [x, y, z, o] = [m.x_axis, m.y_axis, m.z_axis, m.w_axis].map(|c| c.truncate().as_dvec3());
        let cross = x.cross(y);
        let stretch = cross.length();
        let n = cross / stretch;
        let mirrored = facing == Facing::LocalZ && cross.dot(z) < 0.0;
        let dual = |v: DVec3| (v / stretch).as_vec3();
        let p = Self {
            origin: o.as_vec3(),
            x_axis: x.as_vec3(),
            y_axis: y.as_vec3(),
            ng: (if mirrored != flip_normals { -n } else { n }).as_vec3(),
            stretch: stretch as f32,
            dual_x: dual(y.cross(n)),
            dual_y: dual(n.cross(x)),
        };
        let finite = [p.origin, p.x_axis, p.y_axis, p.ng, p.dual_x, p.dual_y].iter().all(|v| v.is_finite());
        (finite && p.stretch > 0.0 && p.stretch.is_finite()).then_some(p)
    }

    /// The point at plane coordinates.
    #[inline]
    pub fn point(&self, q: Vec2) -> Vec3 {
        self.origin + self.x_axis * q.x + self.y_axis * q.y
    }

    /// Plane coordinates of the foot of `p`.
    #[inline]
    pub fn coordinates(&self, p: Vec3) -> Vec2 {
        let d = p - self.origin;
        Vec2::new(d.dot(self.dual_x), d.dot(self.dual_y))
    }

    /// Ray parameter and plane coordinates of the hit, if it is in the ray's open interval.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<(f32, Vec2)> {
        let f = ray.o - self.origin;
        let t = -f.dot(self.ng) / ray.d.dot(self.ng);
        if !(t > ray.t_min && t < ray.t_max) {
            return None;
        }
        let q = f + ray.d * t;
        Some((t, Vec2::new(q.dot(self.dual_x), q.dot(self.dual_y))))
    }

    /// The geometry at the foot of `p`, with uv = plane coordinates.
    #[inline]
    pub fn surface(&self, p: Vec3) -> SurfaceGeometry {
        let on_plane = p - self.ng * (p - self.origin).dot(self.ng);
        SurfaceGeometry {
            p: on_plane,
            ng: self.ng,
            uv: self.coordinates(on_plane),
            dpdu: self.x_axis,
            dpdv: self.y_axis,
            dndu: Vec3::ZERO,
            dndv: Vec3::ZERO,
        }
    }
}
