//! Plane: a half-space.

use glam::{DAffine3, DVec2, DVec3};

use super::facets::{Facet, quad};
use super::{Bounds, Crossing, Line, NO_UV, Primitive};

/// Everything with n · p ≤ distance.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    n: DVec3,
    distance: f64,
}

impl Plane {
    /// From a normal of any length and the distance along the unit normal; `None` without direction.
    pub(super) fn new(normal: DVec3, distance: f64) -> Option<Self> {
        let n = normal.try_normalize()?;
        (n.is_finite() && distance.is_finite()).then_some(Self { n, distance })
    }

    /// The image under an affine transform; `None` where that has no plane.
    pub(super) fn moved(&self, m: &DAffine3) -> Option<Self> {
        let n = (m.matrix3.inverse().transpose() * self.n).try_normalize()?;
        let p = m.transform_point3(self.n * self.distance);
        let distance = n.dot(p);
        (n.is_finite() && distance.is_finite()).then_some(Self { n, distance })
    }

    /// The axis along which it lies, where it does (but for rounding of turns by 90°).
    fn axis(&self) -> Option<usize> {
        (0..3).find(|&i| self.n[i].abs() > 1.0 - 1e-15 && (0..3).all(|j| j == i || self.n[j].abs() < 1e-15))
    }
}

impl Primitive for Plane {
    fn facets(&self, _: usize, within: &Bounds) -> Option<Vec<Facet>> {
        if !within.is_finite() || within.is_empty() {
            return Some(Vec::new());
        }
        let (middle, reach) = (0.5 * (within.min + within.max), (within.max - within.min).length());
        let p = middle - self.n * (self.n.dot(middle) - self.distance);
        let (u, v) = self.n.any_orthonormal_pair();
        let (u, v) = (u * reach, v * reach);
        Some(quad([p - u - v, p + u - v, p + u + v, p - u + v]).to_vec())
    }

    fn bounds(&self) -> Bounds {
        let mut b = Bounds::INFINITE;
        if let Some(i) = self.axis() {
            b.min[i] = self.distance * self.n[i].signum();
            b.max[i] = b.min[i];
        }
        b
    }

    fn inside_bounds(&self) -> Bounds {
        let mut b = Bounds::INFINITE;
        if let Some(i) = self.axis() {
            let at = self.distance * self.n[i].signum();
            if self.n[i] > 0.0 {
                b.max[i] = at;
            } else {
                b.min[i] = at;
            }
        }
        b
    }

    #[inline]
    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        out.extend(self.nearest(line, t_min, t_max, &mut Vec::new()));
    }

    #[inline]
    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        let (away, approach) = (self.distance - self.n.dot(line.o), self.n.dot(line.d));
        // Lines that lead away need no division.
        if t_min >= 0.0 && (away < 0.0) != (approach < 0.0) {
            return None;
        }
        let t = away / approach;
        (t > t_min && t < t_max).then(|| Crossing::new(t, 0))
    }

    fn inside(&self, p: DVec3) -> bool {
        self.n.dot(p) <= self.distance
    }

    fn normal(&self, _p: DVec3, _crossing: &Crossing) -> DVec3 {
        self.n
    }

    fn uv(&self, _p: DVec3, _crossing: &Crossing) -> DVec2 {
        NO_UV
    }
}
