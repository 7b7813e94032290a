//! `prism`: closed plane curves in x and z swept along y, straight or from a point. An even number of curves around a point leaves a hole.

use arrayvec::ArrayVec;
use glam::{DVec2, DVec3};

use super::curve::{self, Segment, SplineKind};
use super::facets::{Facet, fill, has_area, quad};
use super::{Bounds, Crossing, Line, Primitive};

/// Swept curves.
#[derive(Clone, Debug)]
pub struct Prism {
    /// Of x and z.
    segments: Vec<Segment>,
    bottom: f64,
    top: f64,
    /// The curve is as large as its height above the origin.
    conic: bool,
    open: bool,
    backward: bool,
    bounds: Bounds,
    /// Of the curves.
    min: DVec2,
    max: DVec2,
}

impl Prism {
    /// Sweeps curves from one height to another, in either order. `None` where a curve is not closed, points are too few, or a number is
    /// not finite.
    pub fn new(kind: SplineKind, conic: bool, open: bool, heights: [f64; 2], points: &[DVec2]) -> Option<Self> {
        let segments = curve::closed_chains(kind, points)?;
        let (bottom, top) = (heights[0].min(heights[1]), heights[0].max(heights[1]));
        if !heights.iter().all(|h| h.abs() < 1e40) {
            return None;
        }
        let min = segments.iter().fold(DVec2::INFINITY, |m, s| m.min(s.min));
        let max = segments.iter().fold(DVec2::NEG_INFINITY, |m, s| m.max(s.max));
        let mut lo = min;
        let mut hi = max;
        if conic {
            let corners = [min * bottom, max * bottom, min * top, max * top];
            lo = corners.iter().fold(DVec2::INFINITY, |m, p| m.min(*p));
            hi = corners.iter().fold(DVec2::NEG_INFINITY, |m, p| m.max(*p));
        }
        let bounds = Bounds { min: DVec3::new(lo.x, bottom, lo.y), max: DVec3::new(hi.x, top, hi.y) };
        Some(Self { segments, bottom, top, conic, open, backward: kind == SplineKind::Bezier, bounds, min, max })
    }

    /// The curve's plane: where a point of the prism is on it.
    fn flat(&self, p: DVec3) -> DVec2 {
        let q = DVec2::new(p.x, p.z);
        if self.conic { q / p.y } else { q }
    }

    fn cap_holds(&self, p: DVec3) -> bool {
        let q = self.flat(p);
        q.cmpge(self.min).all() && q.cmple(self.max).all() && curve::inside(&self.segments, q)
    }
}

impl Primitive for Prism {
    fn facets(&self, segments: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let place = |q: DVec2, y: f64| {
            let q = if self.conic { q * y } else { q };
            DVec3::new(q.x, y, q.y)
        };
        let edges: Vec<[DVec2; 2]> =
            self.segments.iter().flat_map(|s| s.sampled(segments).windows(2).map(|w| [w[0], w[1]]).collect::<Vec<_>>()).collect();
        let wall = |[a, b]: &[DVec2; 2]| quad([place(*a, self.bottom), place(*b, self.bottom), place(*b, self.top), place(*a, self.top)]);
        let mut all: Vec<Facet> = edges.iter().flat_map(wall).collect();
        if !self.open {
            let area = fill(&edges);
            all.extend([self.bottom, self.top].iter().flat_map(|&y| area.iter().map(move |t| Facet::new(t.map(|q| place(q, y))))));
        }
        all.retain(has_area);
        Some(all)
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let (o, d) = (line.o, line.d);
        if !o.is_finite() || !d.is_finite() {
            return;
        }
        if clip(&self.bounds, line, t_min, t_max).is_none() {
            return;
        }
        if !self.open && d.y != 0.0 {
            for (part, y) in [(0, self.bottom), (1, self.top)] {
                let t = (y - o.y) / d.y;
                if t > t_min && t < t_max {
                    let p = line.at(t);
                    if self.cap_holds(DVec3::new(p.x, y, p.z)) {
                        out.push(Crossing { t, part, uv: DVec2::ZERO });
                    }
                }
            }
        }
        // The line as seen along the sweep: n · C = k. Lines through the apex or along the sweep are seen as points.
        let (n, k) = if self.conic {
            let n = o.cross(d);
            (DVec2::new(n.x, n.z), -n.y)
        } else {
            let n = DVec2::new(d.z, -d.x);
            (n, n.dot(DVec2::new(o.x, o.z)))
        };
        if n == DVec2::ZERO {
            return;
        }
        let mut found = ArrayVec::new();
        for (i, segment) in self.segments.iter().enumerate() {
            // Interval of n · C over the segment's box.
            let (a, b) = (n * segment.min, n * segment.max);
            let (low, high) = (a.min(b), a.max(b));
            if low.x + low.y > k || high.x + high.y < k {
                continue;
            }
            segment.meets(n, k, &mut found);
            for &u in &found {
                let c = segment.at(u);
                let t = if self.conic {
                    // o + t d is a multiple of (c, 1): from the coordinate where it shows best.
                    let (x, z) = (d.x - c.x * d.y, d.z - c.y * d.y);
                    if x.abs() > z.abs() { (c.x * o.y - o.x) / x } else { (c.y * o.y - o.z) / z }
                } else if d.x.abs() > d.z.abs() {
                    (c.x - o.x) / d.x
                } else {
                    (c.y - o.z) / d.z
                };
                let y = o.y + t * d.y;
                // Caps and walls must agree on where the prism ends, so the height decides.
                if t > t_min && t < t_max && y >= self.bottom && y < self.top {
                    out.push(Crossing { t, part: 2 + i as u32, uv: DVec2::new(u, 0.0) });
                }
            }
        }
    }

    fn inside(&self, p: DVec3) -> bool {
        p.y >= self.bottom && p.y < self.top && self.cap_holds(p)
    }

    fn normal(&self, _: DVec3, crossing: &Crossing) -> DVec3 {
        let segment = match crossing.part {
            0 | 1 => return DVec3::Y,
            i => self.segments.get(i as usize - 2),
        };
        let Some(segment) = segment else { return DVec3::Y };
        let tangent = segment.tangent(crossing.uv.x);
        // To the right of the curve's direction; to the left of Bézier curves, as measured.
        let side = if self.backward { -1.0 } else { 1.0 };
        let mut n = side * DVec3::new(tangent.y, 0.0, -tangent.x);
        if self.conic {
            // The wall holds the apex: the normal is across the line to it.
            let c = segment.at(crossing.uv.x);
            n.y = -(n.x * c.x + n.z * c.y);
        }
        n.try_normalize().unwrap_or(DVec3::Y)
    }

    fn uv(&self, p: DVec3, _: &Crossing) -> DVec2 {
        p.truncate()
    }
}

/// The part of a line in a box; a hair more on each side.
pub(super) fn clip(b: &Bounds, line: &Line, t_min: f64, t_max: f64) -> Option<(f64, f64)> {
    let (mut lo, mut hi) = (t_min, t_max);
    for axis in 0..3 {
        let (o, d) = (line.o[axis], line.d[axis]);
        let hair = 1e-9 * (b.max[axis] - b.min[axis]) + 1e-12 * (b.max[axis].abs() + b.min[axis].abs());
        let (min, max) = (b.min[axis] - hair, b.max[axis] + hair);
        if d == 0.0 {
            if !(o >= min && o <= max) {
                return None;
            }
            continue;
        }
        let (a, c) = ((min - o) / d, (max - o) / d);
        lo = lo.max(a.min(c));
        hi = hi.min(a.max(c));
    }
    (lo <= hi).then_some((lo, hi))
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, hostile_lines};
    use super::*;

    fn points(p: &[(f64, f64)]) -> Vec<DVec2> {
        p.iter().map(|p| DVec2::new(p.0, p.1)).collect()
    }

    #[rustfmt::skip]
    fn shapes() -> Vec<(Prism, &'static str)> {
        use SplineKind::*;
        let new = |kind, conic, open, heights, p: &[(f64, f64)]| Prism::new(kind, conic, open, heights, &points(p)).unwrap();
        vec![
            (new(Linear, false, false, [0., 1.], &[(0., 0.), (6., 0.), (6., 8.), (0., 8.), (0., 0.), (1., 1.), (5., 1.), (5., 7.), (1., 7.), (1., 1.)]),
             include_str!("measured/prism_linear.txt")),
            (new(Linear, false, false, [1., 0.], &[(0., 0.), (0., 8.), (6., 8.), (6., 0.), (0., 0.)]), include_str!("measured/prism_clockwise.txt")),
            (new(Quadratic, false, false, [-1., 2.], &[(1., -1.), (0., 0.), (6., 0.), (6., 8.), (0., 8.), (0., 0.), (2., 0.), (1., 1.), (5., 1.),
                (5., 7.), (1., 7.), (1., 1.)]), include_str!("measured/prism_quadratic.txt")),
            (new(Cubic, false, false, [-1., 2.], &[(1., -1.), (0., 0.), (6., 0.), (6., 8.), (0., 8.), (0., 0.), (-1., 1.), (2., 0.), (1., 1.),
                (5., 1.), (5., 7.), (1., 7.), (1., 1.), (0., 2.)]), include_str!("measured/prism_cubic.txt")),
            (new(Bezier, false, false, [0., 1.], &[(-2., 0.), (-2., 2.), (1., 2.), (2., 0.), (2., 0.), (2., -1.), (-1., -2.), (-2., 0.)]),
             include_str!("measured/prism_bezier.txt")),
            (new(Cubic, true, false, [0.2, 1.3], &[(1.5, -2.5), (1.5, 2.5), (-2.5, 0.), (1.5, -2.5), (1.5, 2.5), (-2.5, 0.)]),
             include_str!("measured/prism_conic.txt")),
            (new(Linear, true, false, [-0.5, 1.], &[(2., 2.), (-2., 2.), (-2., -2.), (2., -2.), (2., 2.)]),
             include_str!("measured/prism_conic_linear.txt")),
            (new(Linear, false, true, [0., 1.], &[(3., 0.), (-2., 2.), (-2., -2.), (3., 0.)]), include_str!("measured/prism_open.txt")),
        ]
    }

    #[test]
    fn as_pov_ray() {
        for (shape, table) in shapes() {
            compare(&shape, table, &Tolerance::default());
        }
    }

    #[test]
    fn inside_alternates() {
        for (shape, _) in shapes() {
            if !shape.open {
                let b = shape.bounds();
                alternates(&shape, 0.5 * (b.min + b.max), 0.6 * (b.max - b.min).max_element(), 2000, 0);
            }
        }
    }

    #[test]
    fn hostile() {
        assert!(Prism::new(SplineKind::Linear, false, false, [0., 1.], &points(&[(0., 0.), (1., 1.)])).is_none());
        assert!(Prism::new(SplineKind::Cubic, false, false, [0., 1.], &points(&[(0., 0.), (1., 1.), (2., 0.), (3., 1.)])).is_none());
        assert!(Prism::new(SplineKind::Bezier, false, false, [0., 1.], &points(&[(0., 0.); 3])).is_none());
        assert!(Prism::new(SplineKind::Linear, false, false, [0., f64::NAN], &points(&[(0., 0.), (1., 1.), (2., 0.)])).is_none());
        assert!(Prism::new(SplineKind::Linear, false, false, [0., 1.], &[]).is_none());
        hostile_lines(&Prism::new(SplineKind::Linear, true, false, [0., 0.], &points(&[(0., 0.); 9])).unwrap());
        shapes().iter().for_each(|s| hostile_lines(&s.0));
    }
}
