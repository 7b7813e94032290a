//! Distances along a ray by the angle that they are seen under from a light (Kulla and Fajardo 2012, "Importance Sampling Techniques for
//! Path Tracing in Participating Media", doi:10.1111/j.1467-8659.2012.03148.x): the density cancels the falloff with the squared distance.

use crate::math::{Vec3, fns};

/// A segment of a ray with a unit direction, seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct Equiangular {
    /// Where on the ray the point is nearest.
    nearest: f32,
    /// How far it is there.
    distance: f32,
    /// Angles of the segment's ends.
    from: f32,
    to: f32,
}

impl Equiangular {
    /// The segment [0, t_max] of a ray, which may be infinite, seen from `p`. `None` where it has no angle: points on the ray's line.
    #[inline]
    pub fn new(o: Vec3, d: Vec3, t_max: f32, p: Vec3) -> Option<Self> {
        let nearest = d.dot(p - o);
        let distance = (p - o - d * nearest).length();
        if !(distance > 1e-6 * (1.0 + nearest.abs())) || !distance.is_finite() {
            return None;
        }
        let from = fns::atan2(-nearest, distance);
        let to = if t_max.is_finite() { fns::atan2(t_max - nearest, distance) } else { 0.5 * crate::math::PI };
        (to - from > 1e-4).then_some(Self { nearest, distance, from, to })
    }

    /// The angle that the segment spans, in radians.
    #[inline]
    pub fn angle(&self) -> f32 {
        self.to - self.from
    }

    /// How far the point is from the ray's line.
    #[inline]
    pub fn distance(&self) -> f32 {
        self.distance
    }

    /// A distance along the ray, for u in [0, 1).
    #[inline]
    pub fn sample(&self, u: f32) -> f32 {
        self.nearest + self.distance * fns::tan(fns::lerp(u, self.from, self.to))
    }

    /// The density of a distance within the segment.
    #[inline]
    pub fn pdf(&self, t: f32) -> f32 {
        self.distance / (self.angle() * (fns::sqr(self.distance) + fns::sqr(t - self.nearest)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_have_their_density() {
        let cases = [(Vec3::new(1.0, 0.5, 0.0), 3.0), (Vec3::new(-2.0, 0.3, 0.1), 4.0), (Vec3::new(9.0, 2.0, 1.0), 5.0)];
        for (p, t_max) in cases {
            let e = Equiangular::new(Vec3::ZERO, Vec3::X, t_max, p).unwrap();
            // The distribution function by the midpoint rule against the samples' own.
            let (mut sum, n) = (0.0f64, 4000);
            for i in 0..n {
                let t = (i as f32 + 0.5) / n as f32 * t_max;
                sum += f64::from(e.pdf(t) * t_max / n as f32);
                if i % 400 == 399 {
                    let u = sum.min(0.999_999) as f32;
                    assert!((e.sample(u) - (i + 1) as f32 / n as f32 * t_max).abs() < 2e-3 * t_max, "{p} {i}");
                }
            }
            assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        }
    }

    #[test]
    fn points_on_the_ray_and_hostile_ones_have_none() {
        for p in [Vec3::new(2.0, 0.0, 0.0), Vec3::new(f32::NAN, 1.0, 0.0), Vec3::splat(f32::INFINITY)] {
            assert!(Equiangular::new(Vec3::ZERO, Vec3::X, 3.0, p).is_none());
        }
        let open = Equiangular::new(Vec3::ZERO, Vec3::X, f32::INFINITY, Vec3::new(1.0, 1.0, 0.0)).unwrap();
        assert!(open.sample(0.999).is_finite() && open.pdf(1e30) >= 0.0);
    }
}
