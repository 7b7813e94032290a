//! Plane curves of `lathe` and `prism`: chains of polynomial segments.
//!
//! POV-Ray documentation, sections 3.4.5.1.8 and 3.4.5.1.11. What it leaves open was measured: the quadratic spline is the parabola through
//! the point before and both ends, the cubic one has the slopes of Catmull–Rom.

use glam::DVec2;

use super::roots;

/// Points nearer than this in both coordinates close a curve, as measured.
const SAME: f64 = 1e-10;

/// How a curve goes through its points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SplineKind {
    /// Straight lines.
    Linear,
    /// Parabolas; the first point only bends.
    Quadratic,
    /// Cubics; the first and the last point only bend.
    Cubic,
    /// Four control points for each cubic.
    Bezier,
}

/// A polynomial piece over 0 ≤ u ≤ 1.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// Coefficients, lowest first.
    pub c: [DVec2; 4],
    /// Where it begins, exactly.
    pub start: DVec2,
    /// Where it ends, exactly: the next one begins with the same bits.
    pub end: DVec2,
    /// Degree: 1, 2 or 3.
    pub degree: usize,
    /// Box of the piece.
    pub min: DVec2,
    /// Box of the piece.
    pub max: DVec2,
}

impl Segment {
    fn new(c: [DVec2; 4], end: DVec2) -> Self {
        let degree = if c[3] != DVec2::ZERO {
            3
        } else if c[2] != DVec2::ZERO {
            2
        } else {
            1
        };
        let start = c[0];
        let mut s = Self { c, start, end, degree, min: start.min(end), max: start.max(end) };
        #[allow(clippy::needless_range_loop)] // The axis of all four coefficients.
        for axis in 0..2 {
            for u in roots::quadratic_in(&[c[1][axis], 2.0 * c[2][axis], 3.0 * c[3][axis]], 0.0, 1.0) {
                let p = s.at(u);
                s.min = s.min.min(p);
                s.max = s.max.max(p);
            }
        }
        s
    }

    fn linear(a: DVec2, b: DVec2) -> Self {
        Self::new([a, b - a, DVec2::ZERO, DVec2::ZERO], b)
    }

    fn quadratic(before: DVec2, a: DVec2, b: DVec2) -> Self {
        Self::new([a, 0.5 * (b - before), 0.5 * (before - 2.0 * a + b), DVec2::ZERO], b)
    }

    fn cubic(before: DVec2, a: DVec2, b: DVec2, after: DVec2) -> Self {
        Self::new([a, 0.5 * (b - before), before - 2.5 * a + 2.0 * b - 0.5 * after, 0.5 * (after - before) + 1.5 * (a - b)], b)
    }

    fn bezier(p: &[DVec2; 4]) -> Self {
        let [a, b, c, d] = *p;
        Self::new([a, 3.0 * (b - a), 3.0 * (a - 2.0 * b + c), d - a + 3.0 * (b - c)], d)
    }

    /// The point at u.
    #[inline]
    pub fn at(&self, u: f64) -> DVec2 {
        self.c[0] + u * (self.c[1] + u * (self.c[2] + u * self.c[3]))
    }

    /// The derivative at u.
    #[inline]
    pub fn slope(&self, u: f64) -> DVec2 {
        self.c[1] + u * (2.0 * self.c[2] + u * (3.0 * self.c[3]))
    }

    /// The tangent at u, also where the derivative vanishes at an end.
    pub fn tangent(&self, u: f64) -> DVec2 {
        let d = self.slope(u);
        if d.length_squared() > 1e-24 * (self.max - self.min).length_squared() {
            return d;
        }
        let (a, b) = (self.slope((u - 1e-4).max(0.0)), self.slope((u + 1e-4).min(1.0)));
        if a.length_squared() > b.length_squared() { a } else { b }
    }

    /// Parameters where n · C(u) = k, ascending, of the parity that the exact ends ask for: a line through a chain of segments misses none
    /// and meets none twice at the joints.
    pub fn meets(&self, n: DVec2, k: f64, out: &mut arrayvec::ArrayVec<f64, 3>) {
        out.clear();
        let (a, b) = (n.dot(self.start) - k, n.dot(self.end) - k);
        let c = [a, n.dot(self.c[1]), n.dot(self.c[2]), n.dot(self.c[3])];
        if self.degree == 1 {
            if (a < 0.0) != (b < 0.0) {
                out.push((a / (a - b)).clamp(0.0, 1.0));
            }
            return;
        }
        *out = roots::cubic_in(&c, 0.0, 1.0);
        if (out.len() % 2 == 1) != ((a < 0.0) != (b < 0.0)) {
            mend(out);
        }
    }
}

/// Adds or takes away a root at the end of the interval [0, 1], where rounding got the sign wrong.
pub fn mend<const N: usize>(roots: &mut arrayvec::ArrayVec<f64, N>) {
    if roots.is_full() || roots.last().is_some_and(|u| *u > 1.0 - 1e-9) {
        roots.pop();
    } else {
        roots.push(1.0);
    }
}

/// Whether a point is inside of chains of segments by parity, along the second coordinate.
pub fn inside(segments: &[Segment], p: DVec2) -> bool {
    let mut odd = false;
    let mut roots = arrayvec::ArrayVec::new();
    for s in segments {
        if p.x < s.min.x || p.x > s.max.x || p.y < s.min.y {
            continue;
        }
        s.meets(DVec2::X, p.x, &mut roots);
        for u in &roots {
            odd ^= s.at(*u).y < p.y;
        }
    }
    odd
}

fn finite(points: &[DVec2]) -> bool {
    // Sixth powers of the coordinates must not overflow.
    points.iter().all(|p| p.is_finite() && p.abs().max_element() < 1e40)
}

/// The curve of a lathe. `None` for too few points, and where one is not finite.
pub fn chain(kind: SplineKind, points: &[DVec2]) -> Option<Vec<Segment>> {
    if !finite(points) {
        return None;
    }
    let segments: Vec<Segment> = match kind {
        SplineKind::Linear => points.windows(2).map(|p| Segment::linear(p[0], p[1])).collect(),
        SplineKind::Quadratic => points.windows(3).map(|p| Segment::quadratic(p[0], p[1], p[2])).collect(),
        SplineKind::Cubic => points.windows(4).map(|p| Segment::cubic(p[0], p[1], p[2], p[3])).collect(),
        SplineKind::Bezier => points.as_chunks::<4>().0.iter().map(Segment::bezier).collect(),
    };
    if segments.is_empty() { None } else { Some(segments) }
}

/// The curves of a prism, each closed. `None` where one is not (a linear one is closed by itself), where points are left over or too few,
/// and where one is not finite.
pub fn closed_chains(kind: SplineKind, points: &[DVec2]) -> Option<Vec<Segment>> {
    if !finite(points) {
        return None;
    }
    let same = |a: DVec2, b: DVec2| (a - b).abs().max_element() < SAME;
    let mut segments = Vec::new();
    let mut rest = points;
    // Control points before and after the curve.
    let (before, after) = match kind {
        SplineKind::Linear | SplineKind::Bezier => (0, 0),
        SplineKind::Quadratic => (1, 0),
        SplineKind::Cubic => (1, 1),
    };
    while !rest.is_empty() {
        let first = *rest.get(before)?;
        let step = if kind == SplineKind::Bezier { 4 } else { 1 };
        let closing = if kind == SplineKind::Bezier {
            (3..rest.len()).step_by(step).find(|i| same(rest[*i], first))
        } else {
            (before + 2..rest.len()).find(|i| same(rest[*i], first))
        };
        let mut own: Vec<DVec2>;
        let used;
        match closing {
            Some(last) => {
                used = last + 1 + after;
                own = rest.get(..used)?.to_vec();
                own[last] = first;
            }
            None if kind == SplineKind::Linear && rest.len() >= 3 => {
                used = rest.len();
                own = rest.to_vec();
                own.push(first);
            }
            None => return None,
        }
        if kind == SplineKind::Bezier {
            // Joints that differ by rounding only: the same bits, for parity.
            for i in (4..own.len()).step_by(4) {
                if same(own[i], own[i - 1]) {
                    own[i] = own[i - 1];
                }
            }
        }
        segments.extend(chain(kind, &own)?);
        rest = &rest[used..];
    }
    if segments.is_empty() { None } else { Some(segments) }
}
