//! `sor`: the graph of a function turned about the y axis. The square of the radius is a cubic of the height in each piece.
//!
//! POV-Ray documentation, section 3.4.5.1.15: the pieces go through their points, and the derivative of the squared radius at each point is
//! the one that chords between its neighbors have.

use glam::{DVec2, DVec3};

use super::facets::{Facet, revolve};
use super::lathe::turn;
use super::{Bounds, Crossing, Line, Primitive, roots};

/// A surface of revolution.
#[derive(Clone, Debug)]
pub struct Sor {
    pieces: Vec<Piece>,
    open: bool,
    bounds: Bounds,
}

#[derive(Clone, Copy, Debug)]
struct Piece {
    bottom: f64,
    top: f64,
    /// Of the squared radius in powers of the height above the bottom.
    c: [f64; 4],
    /// Largest squared radius.
    largest: f64,
    /// Number among the pieces in the file's order, for surface coordinates.
    number: usize,
}

const BOTTOM: u32 = u32::MAX - 1;
const TOP: u32 = u32::MAX;

impl Sor {
    /// Points are (radius, height); heights of the inner ones go strictly one way. `None` for fewer than four points, other heights,
    /// and where one is not finite.
    pub fn new(points: &[DVec2], open: bool) -> Option<Self> {
        if points.len() < 4 || !points.iter().all(|p| p.is_finite() && p.abs().max_element() < 1e60) {
            return None;
        }
        let mut pieces = Vec::with_capacity(points.len() - 3);
        let descending = points[2].y < points[1].y;
        for (number, p) in points.windows(4).enumerate() {
            let squares = [p[0], p[1], p[2], p[3]].map(|p| p.x * p.x);
            // d(r²)/dh = 2 r dr/dh, dr/dh from the chord.
            let slope = |at: usize| 2.0 * p[at].x * (p[at + 1].x - p[at - 1].x) / (p[at + 1].y - p[at - 1].y);
            let (s1, s2) = (slope(1), slope(2));
            let h = p[2].y - p[1].y;
            if h == 0.0 || (h < 0.0) != descending || !s1.is_finite() || !s2.is_finite() {
                return None;
            }
            // Hermite form in height above P1, moved to begin at the lower end.
            let d = squares[2] - squares[1];
            let (a2, a3) = ((3.0 * d / h - 2.0 * s1 - s2) / h, (s1 + s2 - 2.0 * d / h) / (h * h));
            let c = if h > 0.0 { [squares[1], s1, a2, a3] } else { [squares[2], s2, a2 + 3.0 * a3 * h, a3] };
            let height = h.abs();
            let mut largest = squares[1].max(squares[2]);
            for u in roots::quadratic_in(&[c[1], 2.0 * c[2], 3.0 * c[3]], 0.0, height) {
                largest = largest.max(roots::eval(&c, u));
            }
            if !largest.is_finite() || c.iter().any(|c| !c.is_finite()) {
                return None;
            }
            pieces.push(Piece { bottom: p[1].y.min(p[2].y), top: p[1].y.max(p[2].y), c, largest, number });
        }
        if descending {
            pieces.reverse();
        }
        let r = pieces.iter().map(|p| p.largest).fold(0.0, f64::max).sqrt();
        let bounds = Bounds { min: DVec3::new(-r, pieces.first()?.bottom, -r), max: DVec3::new(r, pieces.last()?.top, r) };
        Some(Self { pieces, open, bounds })
    }

    /// Squared radii of the caps at the bottom and the top.
    fn caps(&self) -> [f64; 2] {
        let first = self.pieces.first().map_or(0.0, |p| p.c[0]);
        let last = self.pieces.last().map_or(0.0, |p| roots::eval(&p.c, p.top - p.bottom));
        [first, last]
    }
}

impl Primitive for Sor {
    fn facets(&self, segments: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let steps = (segments / 4).max(2);
        let piece = |p: &Piece| -> Vec<DVec2> {
            let h = |i: usize| (p.top - p.bottom) * i as f64 / steps as f64;
            (0..=steps).map(|i| DVec2::new(roots::eval(&p.c, h(i)).max(0.0).sqrt(), p.bottom + h(i))).collect()
        };
        let mut all: Vec<Facet> = self.pieces.iter().flat_map(|p| revolve(&piece(p), segments)).collect();
        if !self.open {
            for (square, y) in self.caps().into_iter().zip([self.bounds.min.y, self.bounds.max.y]) {
                all.extend(revolve(&[DVec2::new(0.0, y), DVec2::new(square.max(0.0).sqrt(), y)], segments));
            }
        }
        Some(all)
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let speed = line.d.length();
        if !(speed > 0.0) || !speed.is_finite() || !line.o.is_finite() {
            return;
        }
        // Around the point nearest to the middle, in units of length.
        let d = line.d / speed;
        let shift = (0.5 * (self.bounds.min + self.bounds.max) - line.o).dot(d);
        let o = line.o + d * shift;
        let mut push = |s: f64, part: u32| {
            let t = (s + shift) / speed;
            if t > t_min && t < t_max {
                out.push(Crossing { t, part, uv: DVec2::ZERO });
            }
        };
        let square = [o.x * o.x + o.z * o.z, 2.0 * (o.x * d.x + o.z * d.z), d.x * d.x + d.z * d.z];
        let (bottom, top) = (self.bounds.min.y, self.bounds.max.y);
        if !self.open && d.y != 0.0 {
            for (y, r, part) in [(bottom, self.caps()[0], BOTTOM), (top, self.caps()[1], TOP)] {
                let s = (y - o.y) / d.y;
                if roots::eval(&square, s) < r {
                    push(s, part);
                }
            }
        }
        let radius = self.bounds.max.x;
        // The part within the largest radius.
        let mut reach = (f64::NEG_INFINITY, f64::INFINITY);
        if square[2] > 0.0 {
            let both = roots::quadratic(&[square[0] - radius * radius * (1.0 + 1e-9), square[1], square[2]]);
            let [a, b] = both[..] else { return };
            reach = (a, b);
        } else if square[0] > radius * radius {
            return;
        }
        for (i, piece) in self.pieces.iter().enumerate() {
            let (mut lo, mut hi) = reach;
            if d.y != 0.0 {
                let (a, b) = ((piece.bottom - o.y) / d.y, (piece.top - o.y) / d.y);
                lo = lo.max(a.min(b));
                hi = hi.min(a.max(b));
            } else if !(o.y >= piece.bottom && o.y < piece.top) {
                continue;
            }
            if !(lo < hi) || !lo.is_finite() || !hi.is_finite() {
                continue;
            }
            // Nearest to the axis in this part.
            let near = (-0.5 * square[1] / square[2]).clamp(lo, hi);
            if roots::eval(&square, near) > piece.largest * (1.0 + 1e-9) {
                continue;
            }
            // r² of the surface less that of the line, in powers of s.
            let h = o.y - piece.bottom;
            let [c0, c1, c2, c3] = piece.c;
            let f = [
                c0 + h * (c1 + h * (c2 + h * c3)) - square[0],
                d.y * (c1 + h * (2.0 * c2 + 3.0 * h * c3)) - square[1],
                d.y * d.y * (c2 + 3.0 * h * c3) - square[2],
                d.y * d.y * d.y * c3,
            ];
            for s in roots::cubic_in(&f, lo, hi) {
                push(s, i as u32);
            }
        }
    }

    fn inside(&self, p: DVec3) -> bool {
        if !(p.y >= self.bounds.min.y && p.y < self.bounds.max.y) {
            return false;
        }
        let i = self.pieces.partition_point(|q| q.top <= p.y);
        self.pieces.get(i).is_some_and(|q| p.x * p.x + p.z * p.z < roots::eval(&q.c, p.y - q.bottom))
    }

    fn normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        match crossing.part {
            BOTTOM => return DVec3::NEG_Y,
            TOP => return DVec3::Y,
            _ => {}
        }
        let Some(piece) = self.pieces.get(crossing.part as usize) else { return DVec3::Y };
        let [_, c1, c2, c3] = piece.c;
        let h = p.y - piece.bottom;
        DVec3::new(2.0 * p.x, -(c1 + h * (2.0 * c2 + 3.0 * h * c3)), 2.0 * p.z).try_normalize().unwrap_or(DVec3::Y)
    }

    /// Around the axis, and along the points; on the ends the distance to the rim goes on below 0 and above 1, as measured.
    fn uv(&self, p: DVec3, crossing: &Crossing) -> DVec2 {
        let r = (p.x * p.x + p.z * p.z).sqrt();
        let rim = |square: f64| if square > 0.0 { 1.0 - r / square.sqrt() } else { 1.0 };
        let v = match crossing.part {
            BOTTOM => -rim(self.caps()[0]),
            TOP => 1.0 + rim(self.caps()[1]),
            i => self
                .pieces
                .get(i as usize)
                .map_or(0.0, |q| (q.number as f64 + (p.y - q.bottom) / (q.top - q.bottom)) / self.pieces.len() as f64),
        };
        DVec2::new(turn(p), v)
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, crossings, hostile_lines};
    use super::*;

    fn vase(open: bool) -> Sor {
        let points = [
            (0.0, 0.0),
            (0.118143, 0.0),
            (0.620253, 0.540084),
            (0.210970, 0.827004),
            (0.194093, 0.962025),
            (0.286920, 1.0),
            (0.468354, 1.033755),
        ];
        Sor::new(&points.map(|p| DVec2::new(p.0, p.1)), open).unwrap()
    }

    #[test]
    fn as_pov_ray() {
        compare(&vase(false), include_str!("measured/sor.txt"), &Tolerance::default());
        compare(&vase(true), include_str!("measured/sor_open.txt"), &Tolerance::default());
    }

    #[test]
    fn inside_alternates() {
        alternates(&vase(false), DVec3::new(0.0, 0.5, 0.0), 0.8, 3000, 0);
        let points = [(0.3, 4.0), (1.0, 3.0), (0.5, 1.0), (1.5, 0.0), (1.0, -1.0)].map(|p| DVec2::new(p.0, p.1));
        alternates(&Sor::new(&points, false).unwrap(), DVec3::new(0.0, 1.5, 0.0), 2.0, 3000, 0);
    }

    #[test]
    fn surface_coordinates_as_measured() {
        let points = [(1.0, -1.0), (1.0, 0.0), (2.0, 1.0), (1.0, 2.0), (1.0, 3.0)].map(|p| DVec2::new(p.0, p.1));
        let shape = Sor::new(&points, false).unwrap();
        for (o, d, u, v) in [
            ((10.0, 1.5, 0.0), (-1.0, 0.0, 0.0), 0.0, 0.75),
            ((-10.0, 0.5, 0.0), (1.0, 0.0, 0.0), 0.5, 0.25),
            ((0.1, 10.0, 0.2), (0.0, -1.0, 0.0), 0.1762, 1.7763),
            ((0.3, -10.0, -0.2), (0.0, 1.0, 0.0), 0.9065, -0.6395),
        ] {
            let line = Line { o: DVec3::from(o), d: DVec3::from(d) };
            let c = crossings(&shape, &line, 0.0, 1e3)[0];
            assert!((shape.uv(line.at(c.t), &c) - DVec2::new(u, v)).length() < 2e-4);
        }
    }

    #[test]
    fn hostile() {
        assert!(Sor::new(&[DVec2::ONE; 3], false).is_none());
        assert!(Sor::new(&[DVec2::ONE; 4], false).is_none());
        assert!(Sor::new(&[DVec2::ZERO, DVec2::ONE, DVec2::NAN, DVec2::ONE], false).is_none());
        hostile_lines(&vase(false));
    }
}
