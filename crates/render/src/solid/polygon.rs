//! Flat polygons with holes.

use glam::{DVec2, DVec3};

use super::facets::{Facet, fill};
use super::{Bounds, Crossing, Line, NO_UV, Primitive};

/// Polygons in one plane; a point counts where it is inside of an odd number of them.
pub(super) struct Polygon {
    origin: DVec3,
    n: DVec3,
    /// Unit vectors within the plane.
    axes: [DVec3; 2],
    edges: Vec<[DVec2; 2]>,
    bounds: Bounds,
}

impl Polygon {
    /// From points in a row: each repetition of a polygon's first point closes it. `None` where there is no area.
    pub(super) fn new(points: &[DVec3]) -> Option<Self> {
        if !points.iter().all(|p| p.is_finite()) {
            return None;
        }
        let mut loops: Vec<Vec<DVec3>> = Vec::new();
        let mut current: Vec<DVec3> = Vec::new();
        for &p in points {
            let close = current.len() > 1 && current.first().is_some_and(|f| (*f - p).length() <= 1e-9 * (1.0 + p.length()));
            if close {
                loops.push(std::mem::take(&mut current));
            } else {
                current.push(p);
            }
        }
        if current.len() > 2 {
            loops.push(current);
        }
        let first = loops.first()?;
        let origin = first[0];
        // Newell's sum: the normal of any flat polygon.
        let sum = (0..first.len()).fold(DVec3::ZERO, |s, i| s + (first[i] - origin).cross(first[(i + 1) % first.len()] - origin));
        let n = sum.try_normalize()?;
        let (u, v) = n.any_orthonormal_pair();
        let flat = |p: DVec3| DVec2::new((p - origin).dot(u), (p - origin).dot(v));
        let edges = loops.iter().flat_map(|l| (0..l.len()).map(move |i| [flat(l[i]), flat(l[(i + 1) % l.len()])])).collect();
        Some(Self { origin, n, axes: [u, v], edges, bounds: Bounds::of_points(points.iter().copied()) })
    }

    fn covers(&self, q: DVec2) -> bool {
        self.edges.iter().fold(false, |odd, [a, b]| {
            let spans = (a.y <= q.y) != (b.y <= q.y);
            odd ^ (spans && a.x + (q.y - a.y) / (b.y - a.y) * (b.x - a.x) > q.x)
        })
    }
}

impl Primitive for Polygon {
    fn facets(&self, _: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let place = |q: DVec2| self.origin + self.axes[0] * q.x + self.axes[1] * q.y;
        Some(fill(&self.edges).into_iter().map(|t| Facet::new(t.map(place))).collect())
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let t = self.n.dot(self.origin - line.o) / self.n.dot(line.d);
        if !(t > t_min && t < t_max) {
            return;
        }
        let p = line.at(t) - self.origin;
        if self.covers(DVec2::new(p.dot(self.axes[0]), p.dot(self.axes[1]))) {
            out.push(Crossing::new(t, 0));
        }
    }

    fn inside(&self, _p: DVec3) -> bool {
        false
    }

    fn inside_bounds(&self) -> Bounds {
        Bounds::EMPTY
    }

    fn normal(&self, _p: DVec3, _crossing: &Crossing) -> DVec3 {
        self.n
    }

    fn uv(&self, _p: DVec3, _crossing: &Crossing) -> DVec2 {
        NO_UV
    }
}
