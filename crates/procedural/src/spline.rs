//! Splines of numbers and vectors.
//!
//! After the section *Splines* of POV-Ray 3.7's reference (3.3.1.11), and its output where that says nothing: which points each
//! piece takes, the tangents of cubic splines, what holds outside.

use serde::{Deserialize, Serialize};

/// How a spline runs between its points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SplineKind {
    /// Straight lines.
    #[default]
    Linear,
    /// Each piece is part of the parabola through the point before it and its two ends; the first through the first three points.
    Quadratic,
    /// Cubic pieces whose tangents are the mean of the slopes on both sides; the first and the last point serve their tangents only.
    Cubic,
    /// Cubic pieces with continuous second derivatives, zero at both ends.
    Natural,
}

/// A curve through points of up to five numbers each. Outside of its range it keeps the value of the nearest end.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Points", into = "Points")]
pub struct Spline {
    kind: SplineKind,
    components: usize,
    /// (parameter, point), parameters strictly ascending.
    points: Vec<(f64, [f64; 5])>,
    /// Second derivatives at the points, of natural splines.
    second: Vec<[f64; 5]>,
}

/// What a spline is made of.
#[derive(Clone, Serialize, Deserialize)]
struct Points {
    kind: SplineKind,
    components: usize,
    points: Vec<(f64, [f64; 5])>,
}

impl From<Points> for Spline {
    fn from(p: Points) -> Self {
        Self::new(p.kind, p.points, p.components)
    }
}

impl From<Spline> for Points {
    fn from(s: Spline) -> Self {
        Self { kind: s.kind, components: s.components, points: s.points }
    }
}

/// One number for each component.
fn each(f: impl Fn(usize) -> f64) -> [f64; 5] {
    std::array::from_fn(f)
}

impl Spline {
    /// A spline through (parameter, point) in any order; of several points with one parameter the first counts. Points have
    /// `components` numbers (1 to 5), the rest 0.
    pub fn new(kind: SplineKind, mut points: Vec<(f64, [f64; 5])>, components: usize) -> Self {
        points.retain(|p| !p.0.is_nan());
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup_by(|b, a| a.0 == b.0);
        let second = if kind == SplineKind::Natural { second_derivatives(&points) } else { Vec::new() };
        Self { kind, components: components.clamp(1, 5), points, second }
    }

    /// The same points with another way in between.
    pub fn with_kind(&self, kind: SplineKind) -> Self {
        Self::new(kind, self.points.clone(), self.components)
    }

    /// Its points: (parameter, value), parameters ascending.
    pub fn points(&self) -> &[(f64, [f64; 5])] {
        &self.points
    }

    /// How it runs between its points.
    pub fn kind(&self) -> SplineKind {
        self.kind
    }

    /// How many numbers its values have, 1 to 5.
    pub fn components(&self) -> usize {
        self.components.max(1)
    }

    /// The value at a parameter: as many numbers as the points have, the rest 0. Without points all are 0.
    pub fn eval(&self, t: f64) -> [f64; 5] {
        let p = &self.points;
        let n = p.len();
        let (Some(first), Some(last)) = (p.first(), p.last()) else { return [0.0; 5] };
        if self.kind == SplineKind::Cubic {
            // Only the inner points are on the curve; of two points POV-Ray gives the middle.
            match n {
                1 => return first.1,
                2 => return each(|c| 0.5 * (first.1[c] + last.1[c])),
                _ if t >= p[n - 2].0 => return p[n - 2].1,
                _ if !matches!(t.partial_cmp(&p[1].0), Some(std::cmp::Ordering::Greater)) => return p[1].1,
                _ => {}
            }
        } else if t >= last.0 {
            return last.1;
        } else if !matches!(t.partial_cmp(&first.0), Some(std::cmp::Ordering::Greater)) {
            return first.1;
        }
        // The piece between points i and i + 1.
        let i = p.partition_point(|q| q.0 <= t).clamp(1, n - 1) - 1;
        let ((t0, a), (t1, b)) = (p[i], p[i + 1]);
        let h = t1 - t0;
        let u = (t - t0) / h;
        match self.kind {
            SplineKind::Quadratic if n > 2 => {
                let [(ta, pa), (tb, pb), (tc, pc)] = if i == 0 { [p[0], p[1], p[2]] } else { [p[i - 1], p[i], p[i + 1]] };
                let la = (t - tb) * (t - tc) / ((ta - tb) * (ta - tc));
                let lb = (t - ta) * (t - tc) / ((tb - ta) * (tb - tc));
                let lc = (t - ta) * (t - tb) / ((tc - ta) * (tc - tb));
                each(|c| la * pa[c] + lb * pb[c] + lc * pc[c])
            }
            SplineKind::Linear | SplineKind::Quadratic => each(|c| a[c] + (b[c] - a[c]) * u),
            SplineKind::Cubic => {
                // Hermite form; i is at least 1 and at most n − 3 here.
                let ((tb, before), (ta, after)) = (p[i - 1], p[i + 2]);
                let (w, v) = (1.0 - u, u * u);
                each(|c| {
                    let slope = (b[c] - a[c]) / h;
                    let m0 = 0.5 * ((a[c] - before[c]) / (t0 - tb) + slope);
                    let m1 = 0.5 * (slope + (after[c] - b[c]) / (ta - t1));
                    (1.0 + 2.0 * u) * w * w * a[c] + u * w * w * h * m0 + v * (3.0 - 2.0 * u) * b[c] - v * w * h * m1
                })
            }
            SplineKind::Natural => {
                let (w, sa, sb) = (1.0 - u, self.second[i], self.second[i + 1]);
                each(|c| w * a[c] + u * b[c] + ((w * w * w - w) * sa[c] + (u * u * u - u) * sb[c]) * h * h / 6.0)
            }
        }
    }
}

/// Second derivatives of the natural cubic spline at its points: the tridiagonal system of any numerical textbook (Press et al.,
/// *Numerical Recipes*, 2007, eq. 3.3.7), solved by elimination.
fn second_derivatives(p: &[(f64, [f64; 5])]) -> Vec<[f64; 5]> {
    let n = p.len();
    let mut second = vec![[0.0; 5]; n];
    let mut factor = vec![0.0; n];
    for i in 1..n.saturating_sub(1) {
        let (h0, h1) = (p[i].0 - p[i - 1].0, p[i + 1].0 - p[i].0);
        let diagonal = 2.0 * (h0 + h1) - h0 * factor[i - 1];
        factor[i] = h1 / diagonal;
        second[i] = each(|c| {
            let bend = (p[i + 1].1[c] - p[i].1[c]) / h1 - (p[i].1[c] - p[i - 1].1[c]) / h0;
            (6.0 * bend - h0 * second[i - 1][c]) / diagonal
        });
    }
    for i in (1..n.saturating_sub(1)).rev() {
        second[i] = each(|c| second[i][c] - factor[i] * second[i + 1][c]);
    }
    second
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spline(kind: SplineKind, n: usize) -> Spline {
        let p = [(0.0, [1.0, 2.0, 3.0]), (1.0, [4.0, 0.0, 1.0]), (2.5, [2.0, 5.0, -3.0]), (3.0, [7.0, 1.0, 1.0]), (5.0, [0.0, 0.0, 2.0])];
        // Out of order, and a second point at 1 that must not count.
        let mut points: Vec<_> = p[..n].iter().map(|(t, v)| (*t, [v[0], v[1], v[2], 0.0, 0.0])).collect();
        points.push((1.0, [9.0; 5]));
        points[..n].reverse();
        if n < 2 {
            points.pop();
        }
        Spline::new(kind, points, 3)
    }

    /// Values written by POV-Ray 3.7.0 for these points.
    #[test]
    #[allow(clippy::type_complexity)] // A table.
    fn agrees_with_pov_ray() {
        let cases: [(SplineKind, &[(f64, [f64; 3])]); 4] = [
            (
                SplineKind::Linear,
                &[(-1.0, [1.0, 2.0, 3.0]), (1.5, [10.0 / 3.0, 5.0 / 3.0, -1.0 / 3.0]), (4.0, [3.5, 0.5, 1.5]), (6.0, [0.0, 0.0, 2.0])],
            ),
            (
                SplineKind::Quadratic,
                &[
                    (0.5, [2.9333333333333336, 0.46666666666666634, 2.0666666666666664]),
                    (1.5, [4.2, 0.6, -0.2]),
                    (2.75, [4.145833333333332, 3.354166666666668, -1.3333333333333321]),
                    (4.9, [1.3759999999999906, -0.519999999999996, 2.519999999999996]),
                    (5.0, [0.0, 0.0, 2.0]),
                ],
            ),
            (
                SplineKind::Cubic,
                &[
                    (-1.0, [4.0, 0.0, 1.0]),
                    (0.5, [4.0, 0.0, 1.0]),
                    (1.5, [3.185185185185185, 1.7037037037037037, -0.8518518518518516]),
                    (2.75, [4.567708333333333, 3.1197916666666665, -1.0989583333333333]),
                    (4.0, [7.0, 1.0, 1.0]),
                ],
            ),
            (
                SplineKind::Natural,
                &[
                    (0.0, [1.0, 2.0, 3.0]),
                    (0.5, [3.274464285714286, 0.16017857142857173, 2.423392857142857]),
                    (2.0, [0.7141269841269846, 5.098253968253967, -3.67984126984127]),
                    (4.0, [8.149285714285714, -2.3364285714285717, 4.247857142857143]),
                    (6.0, [0.0, 0.0, 2.0]),
                ],
            ),
        ];
        for (kind, values) in cases {
            for (t, v) in values {
                let got = spline(kind, 5).eval(*t);
                assert!((0..3).all(|c| (got[c] - v[c]).abs() < 1e-12), "{kind:?} at {t}: {got:?} instead of {v:?}");
            }
        }
    }

    /// The same for few points: (kind, points, parameter, x).
    #[test]
    fn few_points_as_in_pov_ray() {
        use SplineKind::{Cubic, Linear, Natural, Quadratic};
        for (kind, n, t, x) in [
            (Linear, 1, 0.5, 1.0),
            (Cubic, 1, 0.5, 1.0),
            (Natural, 1, 2.0, 1.0),
            (Quadratic, 2, 0.25, 1.75),
            (Natural, 2, 0.25, 1.75),
            (Cubic, 2, 0.25, 2.5),
            (Cubic, 2, 9.0, 2.5),
            (Quadratic, 3, 0.25, 2.075),
            (Cubic, 3, 0.25, 4.0),
            (Natural, 3, 0.25, 1.953125),
            (Natural, 3, 1.5, 4.055555555555555),
        ] {
            assert!((spline(kind, n).eval(t)[0] - x).abs() < 1e-12, "{kind:?} of {n} points at {t}");
        }
    }

    #[test]
    fn hostile_parameters_do_no_harm() {
        for kind in [SplineKind::Linear, SplineKind::Quadratic, SplineKind::Cubic, SplineKind::Natural] {
            assert_eq!(Spline::new(kind, Vec::new(), 3).eval(1.0), [0.0; 5]);
            let points = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300, -1e300, 0.0, -0.0].map(|t| (t, [t; 5])).to_vec();
            let s = Spline::new(kind, points, 99);
            for t in [f64::NAN, f64::INFINITY, -f64::INFINITY, 0.0, 1e300, 5.0] {
                let _ = s.eval(t);
            }
            assert_eq!(s.components(), 5);
        }
    }
}
