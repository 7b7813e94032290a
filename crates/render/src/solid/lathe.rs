//! `lathe`: a plane curve turned about the y axis.
//!
//! Inside by the parity of the curves below a point; normals to the right of the curve's direction, as measured.

use arrayvec::ArrayVec;
use etendue_procedural::fns;
use glam::{DVec2, DVec3};

use super::curve::{self, Segment, SplineKind};
use super::facets::{Facet, revolve};
use super::roots;
use super::{Bounds, Crossing, Line, Primitive};

/// Lines that climb less than this per length count as level.
const LEVEL: f64 = 1e-6;

/// A curve turned about the y axis.
#[derive(Clone, Debug)]
pub struct Lathe {
    /// Of radius and height.
    segments: Vec<Segment>,
    /// Smallest and largest height of all.
    heights: DVec2,
    radius: f64,
}

/// The turn about the y axis in [0, 1) from x towards z.
pub(super) fn turn(p: DVec3) -> f64 {
    let u = fns::atan2(p.z, p.x) / std::f64::consts::TAU;
    if u < 0.0 { u + 1.0 } else { u }
}

/// A line with unit direction around the point nearest to the y axis or, for steep ones, to the middle of a shape.
struct Local {
    o: DVec3,
    d: DVec3,
    /// x² + z² along the line: a + b t + c t².
    square: [f64; 3],
}

impl Local {
    fn square_at(&self, t: f64) -> f64 {
        let (x, z) = (self.o.x + t * self.d.x, self.o.z + t * self.d.z);
        x * x + z * z
    }

    /// Where the line is at this radius: the root nearest to `t`.
    fn at_radius(&self, r: f64, t: f64) -> Option<f64> {
        let [a, b, c] = self.square;
        let both = roots::quadratic(&[a - r * r, b, c]);
        both.into_iter().min_by(|x, y| (x - t).abs().total_cmp(&(y - t).abs()))
    }
}

impl Lathe {
    /// `None` for too few points or one that is not finite.
    pub fn new(kind: SplineKind, points: &[DVec2]) -> Option<Self> {
        let segments = curve::chain(kind, points)?;
        let heights =
            segments.iter().fold(DVec2::new(f64::INFINITY, f64::NEG_INFINITY), |h, s| DVec2::new(h.x.min(s.min.y), h.y.max(s.max.y)));
        let radius = segments.iter().map(|s| s.max.x.abs().max(s.min.x.abs())).fold(0.0, f64::max);
        Some(Self { segments, heights, radius })
    }

    /// The part of a line between two heights and within a radius.
    fn clip(line: &Local, lo: f64, hi: f64, bottom: f64, top: f64, radius: f64) -> Option<(f64, f64)> {
        let (mut lo, mut hi) = (lo, hi);
        let inverse = 1.0 / line.d.y;
        if inverse.is_finite() {
            let (a, b) = ((bottom - line.o.y) * inverse, (top - line.o.y) * inverse);
            lo = lo.max(a.min(b));
            hi = hi.min(a.max(b));
        } else if line.o.y < bottom || line.o.y > top {
            return None;
        }
        let [a, b, c] = line.square;
        if c > 1e-30 {
            let half = -0.5 * b;
            let d = half * half - c * (a - radius * radius);
            if !(d >= 0.0) {
                return None;
            }
            let root = d.sqrt();
            lo = lo.max((half - root) / c);
            hi = hi.min((half + root) / c);
        } else if a > radius * radius {
            return None;
        }
        (lo <= hi).then_some((lo, hi))
    }

    /// Crossings of a line that climbs, as parameters of a segment: x² + z² = r² where y = h, times the square of the climb. Of degree 2, 4
    /// or 6; the signs at the joints are taken from the joints themselves.
    fn steep(segment: &Segment, line: &Local) -> ArrayVec<f64, 6> {
        let (dy, o) = (line.d.y, line.o);
        let height = [segment.c[0].y - o.y, segment.c[1].y, segment.c[2].y, segment.c[3].y];
        // x = (ox dy + dx (h − oy)) / dy
        let across = |o: f64, d: f64| [o * dy + d * height[0], d * height[1], d * height[2], d * height[3]];
        let (x, z) = (across(o.x, line.d.x), across(o.z, line.d.z));
        let r = [segment.c[0].x * dy, segment.c[1].x * dy, segment.c[2].x * dy, segment.c[3].x * dy];
        let square = |f: &[f64; 4]| {
            let [a, b, c, d] = *f;
            [a * a, 2.0 * a * b, b * b + 2.0 * a * c, 2.0 * (a * d + b * c), c * c + 2.0 * b * d, 2.0 * c * d, d * d]
        };
        let (x, z, r) = (square(&x), square(&z), square(&r));
        let f: [f64; 7] = std::array::from_fn(|i| x[i] + z[i] - r[i]);
        let joint = |p: DVec2| {
            let h = p.y - o.y;
            let (x, z, r) = (o.x * dy + line.d.x * h, o.z * dy + line.d.z * h, p.x * dy);
            x * x + z * z - r * r < 0.0
        };
        let mut found: ArrayVec<f64, 6> = match segment.degree {
            1 => roots::quadratic_in(&[f[0], f[1], f[2]], 0.0, 1.0).into_iter().collect(),
            2 => roots::quartic_in(&[f[0], f[1], f[2], f[3], f[4]], 0.0, 1.0).into_iter().collect(),
            _ => roots::sextic_in(&f, 0.0, 1.0),
        };
        if (found.len() % 2 == 1) != (joint(segment.start) != joint(segment.end)) {
            curve::mend(&mut found);
        }
        found
    }

    /// Crossings of a level line: heights first, then radii.
    fn level(segment: &Segment, line: &Local, push: &mut dyn FnMut(f64, f64)) {
        let middle = -0.5 * line.square[1] / line.square[2];
        let mut found = ArrayVec::new();
        segment.meets(DVec2::Y, line.o.y + line.d.y * middle, &mut found);
        for u in found {
            let r = segment.at(u).x;
            for t in roots::quadratic(&[line.square[0] - r * r, line.square[1], line.square[2]]) {
                // The line climbs a little on its way there: one step of Newton's method on the height.
                let climb = segment.slope(u).y;
                let step = (line.o.y + line.d.y * t - segment.at(u).y) / climb;
                let exact = if step.abs() < 1e-3 { line.at_radius(segment.at(u + step).x, t) } else { None };
                push(exact.unwrap_or(t), u);
            }
        }
    }
}

impl Primitive for Lathe {
    fn facets(&self, segments: usize, _: &Bounds) -> Option<Vec<Facet>> {
        Some(self.segments.iter().flat_map(|s| revolve(&s.sampled(segments), segments)).collect())
    }

    fn bounds(&self) -> Bounds {
        let r = self.radius;
        Bounds { min: DVec3::new(-r, self.heights.x, -r), max: DVec3::new(r, self.heights.y, r) }
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let speed = line.d.length();
        if !(speed > 0.0) || !speed.is_finite() || !line.o.is_finite() {
            return;
        }
        let d = line.d / speed;
        let middle = DVec3::new(0.0, 0.5 * (self.heights.x + self.heights.y), 0.0);
        let shift = (middle - line.o).dot(d);
        let o = line.o + d * shift;
        let line = Local { o, d, square: [o.x * o.x + o.z * o.z, 2.0 * (o.x * d.x + o.z * d.z), d.x * d.x + d.z * d.z] };
        let (lo, hi) = (t_min * speed - shift, t_max * speed - shift);
        let Some((lo, hi)) = Self::clip(&line, lo, hi, self.heights.x, self.heights.y, self.radius) else { return };
        let nearest = -0.5 * line.square[1] / line.square[2];
        for (part, segment) in self.segments.iter().enumerate() {
            let outer = segment.max.x.abs().max(segment.min.x.abs());
            // Rays that run in the plane of a flat segment see nothing of it; others get a little room.
            let room = 1e-9 * (outer + segment.max.y.abs() + segment.min.y.abs());
            let Some((a, b)) = Self::clip(&line, lo, hi, segment.min.y - room, segment.max.y + room, outer + room) else { continue };
            let inner = if segment.min.x > 0.0 { segment.min.x - room } else { -segment.max.x - room };
            if inner > 0.0 && line.square_at(a).max(line.square_at(b)) < inner * inner {
                continue;
            }
            let mut push = |s: f64, u: f64| {
                let t = (s + shift) / speed;
                if t > t_min && t < t_max {
                    out.push(Crossing { t, part: part as u32, uv: DVec2::new(u, 0.0) });
                }
            };
            if line.d.y.abs() < LEVEL {
                Self::level(segment, &line, &mut push);
                continue;
            }
            for u in Self::steep(segment, &line) {
                let p = segment.at(u);
                let mut t = (p.y - line.o.y) / line.d.y;
                if line.d.y.abs() < 1e-3 {
                    t = line.at_radius(p.x, t).unwrap_or(if nearest.is_finite() { nearest } else { t });
                }
                push(t, u);
            }
        }
    }

    fn inside(&self, p: DVec3) -> bool {
        if !(p.y >= self.heights.x && p.y <= self.heights.y) {
            // Open curves have an inside above them, but bounds end it.
            return false;
        }
        let r = (p.x * p.x + p.z * p.z).sqrt();
        curve::inside(&self.segments, DVec2::new(r, p.y))
    }

    fn normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        let Some(segment) = self.segments.get(crossing.part as usize) else { return DVec3::Y };
        let tangent = segment.tangent(crossing.uv.x);
        let r = segment.at(crossing.uv.x).x;
        let across = (p.x * p.x + p.z * p.z).sqrt().max(1e-300).copysign(r);
        DVec3::new(tangent.y * p.x / across, -tangent.x, tangent.y * p.z / across).try_normalize().unwrap_or(DVec3::Y)
    }

    fn uv(&self, p: DVec3, crossing: &Crossing) -> DVec2 {
        DVec2::new(turn(p), (f64::from(crossing.part) + crossing.uv.x) / self.segments.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, crossings, hostile_lines};
    use super::*;

    fn lathe(kind: SplineKind, points: &[(f64, f64)]) -> Lathe {
        Lathe::new(kind, &points.iter().map(|p| DVec2::new(p.0, p.1)).collect::<Vec<_>>()).unwrap()
    }

    fn shapes() -> [Lathe; 5] {
        [
            lathe(SplineKind::Linear, &[(2., 0.), (3., 0.), (3., 5.), (2.2, 4.), (2., 5.), (2., 0.)]),
            lathe(SplineKind::Linear, &[(1., 0.), (3., 1.), (2., 3.), (2.5, 5.)]),
            lathe(SplineKind::Quadratic, &[(2.5, -0.5), (2., 0.), (3., 0.2), (3.4, 4.), (2., 5.), (2., 0.)]),
            lathe(SplineKind::Cubic, &[(2., 5.), (2., 0.), (3., 0.2), (3.4, 4.), (2., 5.), (2., 0.), (3., 0.2)]),
            lathe(SplineKind::Bezier, &[(2., 1.), (3., 1.5), (3.5, 3.5), (2., 4.), (2., 4.), (1., 3.), (1.5, 2.), (2., 1.)]),
        ]
    }

    #[test]
    fn as_pov_ray() {
        let tables = [
            include_str!("measured/lathe_linear.txt"),
            include_str!("measured/lathe_open.txt"),
            include_str!("measured/lathe_quadratic.txt"),
            include_str!("measured/lathe_cubic.txt"),
            include_str!("measured/lathe_bezier.txt"),
        ];
        for (shape, table) in shapes().iter().zip(tables) {
            compare(shape, table, &Tolerance::default());
        }
    }

    #[test]
    fn inside_alternates() {
        for (i, shape) in shapes().iter().enumerate() {
            if i != 1 {
                alternates(shape, DVec3::new(0.0, 2.5, 0.0), 4.0, 1500, 0);
            }
        }
    }

    #[test]
    fn level_and_nearly_level_lines_agree() {
        for shape in &shapes() {
            for climb in [0.0, 1e-12, 1e-7, 0.99e-6, 1.01e-6, 1e-5, 0.9e-3, 1.1e-3] {
                let at = |c: f64| crossings(shape, &Line { o: DVec3::new(-5.0, 1.3, 0.7), d: DVec3::new(1.0, c, 0.0) }, 0.0, 20.0);
                let (a, b) = (at(climb), at(0.0));
                assert_eq!(a.len(), b.len(), "{climb}");
                for (x, y) in a.iter().zip(&b) {
                    assert!((x.t - y.t).abs() < 60.0 * climb + 1e-9, "{climb} {} {}", x.t, y.t);
                }
            }
        }
    }

    #[test]
    fn surface_coordinates_as_measured() {
        let shape = &shapes()[1];
        for (o, d, u, v) in [
            ((7., 0.5, 7.), (-1., 0., -1.), 0.125, 0.1667),
            ((0., 0.5, -10.), (0., 0., 1.), 0.75, 0.1667),
            ((10., 4., 0.), (-1., 0., 0.), 0.0, 0.8333),
        ] {
            let line = Line { o: DVec3::from(o), d: DVec3::from(d) };
            let c = crossings(shape, &line, 0.0, 1e3)[0];
            assert!((shape.uv(line.at(c.t), &c) - DVec2::new(u, v)).length() < 1e-4);
        }
    }

    #[test]
    fn hostile() {
        assert!(Lathe::new(SplineKind::Linear, &[DVec2::ONE]).is_none());
        assert!(Lathe::new(SplineKind::Cubic, &[DVec2::ONE; 3]).is_none());
        assert!(Lathe::new(SplineKind::Bezier, &[]).is_none());
        assert!(Lathe::new(SplineKind::Linear, &[DVec2::ONE, DVec2::NAN]).is_none());
        hostile_lines(&Lathe::new(SplineKind::Cubic, &[DVec2::ONE; 9]).unwrap());
        hostile_lines(&Lathe::new(SplineKind::Linear, &[DVec2::ZERO; 2]).unwrap());
        shapes().iter().for_each(|s| hostile_lines(s));
    }
}
