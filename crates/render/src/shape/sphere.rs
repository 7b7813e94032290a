//! Spheres.

use super::ShapeHit;
use crate::accel::Ray;
use crate::math::{Aabb, INV_PI, INV_TAU, TAU, Vec3, fns};

/// A sphere of any center and radius.
#[derive(Clone, Debug)]
pub struct Sphere {
    /// Center.
    pub center: Vec3,
    /// Radius, positive.
    pub radius: f32,
}

impl Sphere {
    /// A box that holds the sphere.
    pub fn bounds(&self) -> Aabb {
        let r = Vec3::splat(self.radius);
        Aabb { min: self.center - r, max: self.center + r }
    }

    /// The nearest hit in the ray's open interval (Haines, Günther, Akenine-Möller 2019, "Precision Improvements for
    /// Ray/Sphere Intersection", Ray Tracing Gems ch. 7: the discriminant from the center's distance to the ray).
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
        let f = ray.o - self.center;
        let a = ray.d.length_squared();
        let b = -f.dot(ray.d);
        let l = f + ray.d * (b / a);
        let disc = self.radius * self.radius - l.length_squared();
        if !(disc >= 0.0) {
            return None;
        }
        let c = f.length_squared() - self.radius * self.radius;
        let q = b + (a * disc).sqrt().copysign(b);
        let (t0, t1) = if b >= 0.0 { (c / q, q / a) } else { (q / a, c / q) };
        let inside = |t: f32| t > ray.t_min && t < ray.t_max;
        let t = if inside(t0) {
            t0
        } else if inside(t1) {
            t1
        } else {
            return None;
        };
        let p = (ray.at(t) - self.center) / self.radius;
        let phi = fns::atan2(p.y, p.x);
        let u = if phi < 0.0 { phi + TAU } else { phi } * INV_TAU;
        Some(ShapeHit { t, u, v: fns::acos(p.z) * INV_PI })
    }
}
