//! Flat disc, perhaps with a hole. Its inside is a half-space.

use glam::{DVec2, DVec3};

use super::{Bounds, Crossing, Line, NO_UV, Primitive};

/// Ring in a plane.
#[derive(Clone, Debug)]
pub(super) struct Disc {
    center: DVec3,
    n: DVec3,
    radius: f64,
    hole2: f64,
}

impl Disc {
    /// `None` without direction or size.
    pub(super) fn new(center: DVec3, normal: DVec3, radius: f64, hole: f64) -> Option<Self> {
        let n = normal.try_normalize()?;
        let radius = radius.abs();
        let finite = n.is_finite() && center.is_finite() && radius.is_finite() && !hole.is_nan();
        (finite && radius > 0.0).then_some(Self { center, n, radius, hole2: hole * hole })
    }
}

impl Primitive for Disc {
    fn bounds(&self) -> Bounds {
        let reach = (DVec3::ONE - self.n * self.n).max(DVec3::ZERO).map(f64::sqrt) * self.radius;
        Bounds { min: self.center - reach, max: self.center + reach }
    }

    fn inside_bounds(&self) -> Bounds {
        Bounds::INFINITE
    }

    #[inline]
    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        out.extend(self.nearest(line, t_min, t_max, &mut Vec::new()));
    }

    #[inline]
    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        let t = self.n.dot(self.center - line.o) / self.n.dot(line.d);
        if !(t > t_min && t < t_max) {
            return None;
        }
        let r2 = (line.at(t) - self.center).length_squared();
        (r2 <= self.radius * self.radius && r2 >= self.hole2).then(|| Crossing::new(t, 0))
    }

    fn inside(&self, p: DVec3) -> bool {
        self.n.dot(p - self.center) < 0.0
    }

    fn normal(&self, _p: DVec3, _crossing: &Crossing) -> DVec3 {
        self.n
    }

    fn uv(&self, _p: DVec3, _crossing: &Crossing) -> DVec2 {
        NO_UV
    }
}
