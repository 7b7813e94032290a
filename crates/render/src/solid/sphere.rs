//! Sphere.

use etendue_procedural::fns;
use glam::{DAffine3, DVec2, DVec3};

use super::facets::{Facet, circle, revolve};
use super::{Bounds, Crossing, Line, Primitive};

/// Ball around a center.
#[derive(Clone, Debug)]
pub(super) struct Sphere {
    center: DVec3,
    radius: f64,
}

impl Sphere {
    /// `None` for a radius of 0; with a negative one normals point inside (as measured).
    pub(super) fn new(center: DVec3, radius: f64) -> Option<Self> {
        (center.is_finite() && radius != 0.0 && radius.is_finite()).then_some(Self { center, radius })
    }

    /// Scaled about the origin by a positive factor, then moved.
    pub(super) fn scaled(&self, factor: f64, offset: DVec3) -> Self {
        Self { center: self.center * factor + offset, radius: self.radius * factor }
    }

    /// The box of its image under a transform, which is an ellipsoid's.
    pub(super) fn extent(&self, m: &DAffine3) -> Bounds {
        let rows = m.matrix3.transpose();
        let reach = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length()) * self.radius.abs();
        let center = m.transform_point3(self.center);
        Bounds { min: center - reach, max: center + reach }
    }

    /// Whether a line has nothing in front of it for sure: it starts outside and leads away, or passes by farther than rounding errors
    /// reach. Most lines do, and this needs no division.
    #[inline]
    fn is_passed(&self, line: &Line, t_min: f64) -> bool {
        let f = line.o - self.center;
        let (a, b) = (line.d.length_squared(), -f.dot(line.d));
        let (f2, r2) = (f.length_squared(), self.radius * self.radius);
        if f2 <= r2 {
            return false;
        }
        t_min >= 0.0 && b < 0.0 || b * b - a * (f2 - r2) < -1e-12 * (b * b + a * (f2 + r2))
    }

    /// Both crossings of the endless line. The discriminant is formed from the distance of the line to the center, which keeps it exact
    /// far away (Haines et al. 2019, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, chapter 7, equation 7).
    #[inline]
    fn roots(&self, line: &Line) -> Option<(f64, f64)> {
        let f = line.o - self.center;
        let a = line.d.length_squared();
        let b = -f.dot(line.d);
        // Most lines are of unit length but for rounding, and need no division.
        let is_unit = (a - 1.0).abs() < 1e-15;
        let miss = f + line.d * if is_unit { b } else { b / a };
        let h = self.radius * self.radius - miss.length_squared();
        if !(h >= 0.0) {
            return None;
        }
        let c = f.length_squared() - self.radius * self.radius;
        let q = b + (h * a).sqrt().copysign(b);
        if q == 0.0 {
            return None;
        }
        let (t0, t1) = (c / q, if is_unit { q } else { q / a });
        Some(if t0 <= t1 { (t0, t1) } else { (t1, t0) })
    }
}

impl Primitive for Sphere {
    fn facets(&self, segments: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let half = segments.div_ceil(2);
        let profile: Vec<DVec2> = (0..=half)
            .map(|i| match i {
                // On the axis exactly.
                0 => DVec2::NEG_Y,
                i if i == half => DVec2::Y,
                i => circle(i, 2 * half).perp() * -1.0,
            })
            .map(|q| DVec2::new(q.x.abs(), q.y))
            .collect();
        let mut all = revolve(&profile, segments);
        all.iter_mut().for_each(|f| f.p = f.p.map(|p| self.center + p * self.radius));
        Some(all)
    }

    fn bounds(&self) -> Bounds {
        Bounds::around(self.center, self.radius.abs())
    }

    #[inline]
    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        if !self.is_passed(line, t_min)
            && let Some((a, b)) = self.roots(line)
        {
            for t in [a, b] {
                if t > t_min && t < t_max {
                    out.push(Crossing::new(t, 0));
                }
            }
        }
    }

    #[inline]
    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        if self.is_passed(line, t_min) {
            return None;
        }
        let (a, b) = self.roots(line)?;
        let t = if a > t_min { a } else { b };
        (t > t_min && t < t_max).then(|| Crossing::new(t, 0))
    }

    fn inside(&self, p: DVec3) -> bool {
        (p - self.center).length_squared() < self.radius * self.radius
    }

    fn normal(&self, p: DVec3, _crossing: &Crossing) -> DVec3 {
        ((p - self.center) * self.radius.signum()).normalize_or(DVec3::Y)
    }

    fn uv(&self, p: DVec3, _crossing: &Crossing) -> DVec2 {
        spherical((p - self.center).normalize_or(DVec3::Y))
    }
}

/// Longitude and latitude of a unit vector, each in [0, 1]: the seam is at +x, v runs from −y to +y.
pub(super) fn spherical(n: DVec3) -> DVec2 {
    let turn = fns::atan2(n.z, n.x) / std::f64::consts::TAU;
    let v = fns::asin(n.y.clamp(-1.0, 1.0)) / std::f64::consts::PI + 0.5;
    DVec2::new(if turn < 0.0 { turn + 1.0 } else { turn }, v)
}
