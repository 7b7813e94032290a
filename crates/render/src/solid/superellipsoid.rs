//! `superellipsoid`: (|x|^(2/e) + |y|^(2/e))^(e/n) + |z|^(2/n) = 1.
//!
//! The left side to the power n/2 is a gauge of points: it grows in proportion along lines from the origin. With e and n up to 2 it is a norm,
//! so that it is convex on every line, and Newton's method from either end never steps over a crossing. Else pieces of a line are
//! divided, and bounded by the gauge at the nearest and farthest corner of the boxes around them.

use arrayvec::ArrayVec;
use etendue_procedural::fns::pow;
use glam::{DVec2, DVec3};

use super::{Bounds, Crossing, Line, Primitive, prism};

/// Smallest exponent: below it the shape is a box to ten digits.
const SMALLEST: f64 = 1e-4;
/// Pieces of a line that are looked at where the shape is not convex.
const MOST_PIECES: usize = 2000;

/// A superquadric ellipsoid between −1 and 1.
#[derive(Clone, Debug)]
pub struct Superellipsoid {
    /// 2/e and 2/n.
    a: f64,
    b: f64,
}

/// x^a for x ≥ 0.
#[inline]
fn power(x: f64, a: f64) -> f64 {
    if a == 2.0 {
        x * x
    } else if a == 1.0 {
        x
    } else if x == 0.0 {
        0.0
    } else if a == 4.0 {
        (x * x) * (x * x)
    } else {
        pow(x, a)
    }
}

impl Superellipsoid {
    /// `None` where an exponent is not positive and finite.
    pub fn new(e: f64, n: f64) -> Option<Self> {
        let valid = |x: f64| x > 0.0 && x.is_finite();
        (valid(e) && valid(n)).then(|| Self { a: 2.0 / e.max(SMALLEST), b: 2.0 / n.max(SMALLEST) })
    }

    /// The gauge and its gradient.
    fn gauge(&self, p: DVec3) -> (f64, DVec3) {
        let q = p.abs();
        let m = q.max_element();
        if !(m > 0.0) {
            return (0.0, DVec3::ZERO);
        }
        let q = q / m;
        let (x, y, z) = (power(q.x, self.a), power(q.y, self.a), power(q.z, self.b));
        let s = x + y;
        let w = if self.a == self.b { s } else { power(s, self.b / self.a) };
        let r = w + z;
        let gauge = power(r, 1.0 / self.b);
        // Exponents cancel: of the chain rule only ratios stay.
        let k = gauge / r;
        let kw = if s > 0.0 { k * w / s } else { 0.0 };
        let g = DVec3::new(kw * x / q.x, kw * y / q.y, k * z / q.z);
        // Where a coordinate vanishes, so does its share, but at needles of exponents above 2.
        let g = DVec3::select(g.is_nan_mask(), DVec3::ZERO, g);
        (m * gauge, g * p.signum())
    }

    /// Gauge less 1 and its derivative along a line.
    #[inline]
    fn along(&self, o: DVec3, d: DVec3, t: f64) -> (f64, f64) {
        let (f, g) = self.gauge(o + d * t);
        (f - 1.0, g.dot(d))
    }

    /// From an end outside towards the other one: the crossing, where there is one.
    fn newton(&self, o: DVec3, d: DVec3, from: f64, to: f64) -> Option<f64> {
        let forward = to > from;
        let mut t = from;
        for _ in 0..100 {
            let (f, df) = self.along(o, d, t);
            if f <= 0.0 {
                return Some(t);
            }
            let step = -f / df;
            // It rises: the minimum is behind, and nothing below 0.
            if !(if forward { step > 0.0 } else { step < 0.0 }) {
                return None;
            }
            let next = t + step;
            if if forward { next > to } else { next < to } {
                return None;
            }
            if step.abs() < 1e-14 || next == t {
                return Some(next);
            }
            t = next;
        }
        Some(t)
    }

    /// Whether the gauge of a point of the first octant is more than 1 and whether it is less, for points in the box.
    fn side(&self, q: DVec3) -> (bool, bool) {
        let s = power(q.x, self.a) + power(q.y, self.a);
        let r = if self.a == self.b { s } else { power(s, self.b / self.a) } + power(q.z, self.b);
        // What the gauge itself would decide otherwise by rounding is left undecided.
        (r > 1.0 + 1e-12, r < 1.0 - 1e-12)
    }

    /// Pieces between coordinate planes, divided until the gauge at the ends decides; in the order of the line, until `push` returns
    /// true.
    fn search(&self, o: DVec3, d: DVec3, lo: f64, hi: f64, push: &mut dyn FnMut(f64) -> bool) {
        let mut cuts = ArrayVec::<f64, 5>::new();
        cuts.push(lo);
        for axis in 0..3 {
            let t = -o[axis] / d[axis];
            if t > lo && t < hi {
                cuts.push(t);
            }
        }
        cuts.push(hi);
        cuts.sort_unstable_by(f64::total_cmp);
        let mut left = MOST_PIECES;
        for pair in cuts.windows(2) {
            // Ends with gauge and derivative, where they are known.
            let mut stack = ArrayVec::<(f64, f64, Option<(f64, f64)>, Option<(f64, f64)>), 64>::new();
            stack.push((pair[0], pair[1], None, None));
            while let Some((a, b, fa, fb)) = stack.pop() {
                let (pa, pb) = (o + d * a, o + d * b);
                let (near, far) = (pa.abs().min(pb.abs()), pa.abs().max(pb.abs()));
                if self.side(near).0 || self.side(far).1 {
                    continue;
                }
                let small = b - a < 1e-3 || left == 0;
                if !small && !stack.is_full() {
                    left -= 1;
                    let m = 0.5 * (a + b);
                    stack.push((m, b, None, fb));
                    stack.push((a, m, fa, None));
                    continue;
                }
                let (fa, fb) = (fa.unwrap_or_else(|| self.along(o, d, a)), fb.unwrap_or_else(|| self.along(o, d, b)));
                if (fa.0 < 0.0) != (fb.0 < 0.0) && small {
                    if push(self.bisect(o, d, (a, b), fa.0 < 0.0)) {
                        return;
                    }
                } else if small && (b - a < 1e-7 || left == 0 || (fa.1 > 0.0) == (fb.1 > 0.0)) {
                    // No sign of a crossing pair.
                } else if !stack.is_full() {
                    left = left.saturating_sub(1);
                    let m = 0.5 * (a + b);
                    let fm = Some(self.along(o, d, m));
                    stack.push((m, b, fm, Some(fb)));
                    stack.push((a, m, Some(fa), fm));
                }
            }
        }
    }

    fn bisect(&self, o: DVec3, d: DVec3, (mut a, mut b): (f64, f64), negative: bool) -> f64 {
        let mut t = 0.5 * (a + b);
        for _ in 0..60 {
            let (f, df) = self.along(o, d, t);
            if (f < 0.0) == negative {
                a = t;
            } else {
                b = t;
            }
            let mut next = t - f / df;
            if !(next > a && next < b) {
                next = 0.5 * (a + b);
            }
            if (next - t).abs() < 1e-14 {
                return next;
            }
            t = next;
        }
        t
    }
}

/// The part of a line within the box, in units of length from its middle.
#[derive(Clone, Copy)]
struct Part {
    o: DVec3,
    d: DVec3,
    half: f64,
    /// Line parameter of the middle, and length of its unit.
    middle: f64,
    speed: f64,
}

impl Part {
    fn t(&self, s: f64) -> f64 {
        self.middle + s / self.speed
    }

    fn crossing(&self, s: f64, t_min: f64, t_max: f64) -> Option<Crossing> {
        let t = self.t(s);
        (t > t_min && t < t_max).then(|| Crossing::new(t, 0))
    }
}

impl Superellipsoid {
    fn is_convex(&self) -> bool {
        self.a >= 1.0 && self.b >= 1.0
    }

    /// `None` where the line misses the box between `t_min` and `t_max`.
    fn part(&self, line: &Line, t_min: f64, t_max: f64) -> Option<Part> {
        let speed = line.d.length();
        if !(speed > 0.0) || !speed.is_finite() || !line.o.is_finite() {
            return None;
        }
        let (lo, hi) = prism::clip(&self.bounds(), line, f64::NEG_INFINITY, f64::INFINITY)?;
        let middle = 0.5 * (lo + hi);
        (lo <= t_max && hi >= t_min).then(|| Part { o: line.at(middle), d: line.d / speed, half: 0.5 * (hi - lo) * speed, middle, speed })
    }
}

impl Primitive for Superellipsoid {
    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE }
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let Some(part) = self.part(line, t_min, t_max) else { return };
        let mut push = |s: f64| out.extend(part.crossing(s, t_min, t_max));
        let Part { o, d, half, .. } = part;
        if self.is_convex() {
            if let Some(enter) = self.newton(o, d, -half, half) {
                push(enter);
                push(self.newton(o, d, half, enter).unwrap_or(enter));
            }
        } else {
            self.search(o, d, -half, half, &mut |s| {
                push(s);
                false
            });
        }
    }

    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _: &mut Vec<Crossing>) -> Option<Crossing> {
        if self.is_convex() {
            let part = self.part(line, t_min, t_max)?;
            let enter = self.newton(part.o, part.d, -part.half, part.half)?;
            // The far crossing takes as long to find as the near one, and mostly is not asked for.
            let near = part.crossing(enter, t_min, t_max);
            return near.or_else(|| {
                let is_before = part.t(enter) <= t_min;
                let exit = is_before.then(|| self.newton(part.o, part.d, part.half, enter).unwrap_or(enter))?;
                part.crossing(exit, t_min, t_max)
            });
        }
        let part = self.part(line, t_min, t_max)?;
        let mut nearest = None;
        self.search(part.o, part.d, -part.half, part.half, &mut |s| {
            nearest = part.crossing(s, t_min, t_max);
            nearest.is_some() || part.t(s) >= t_max
        });
        nearest
    }

    fn inside(&self, p: DVec3) -> bool {
        p.abs().max_element() <= 1.0 && self.gauge(p).0 < 1.0
    }

    fn normal(&self, p: DVec3, _: &Crossing) -> DVec3 {
        self.gauge(p).1.try_normalize().or_else(|| p.try_normalize()).unwrap_or(DVec3::Y)
    }

    fn uv(&self, p: DVec3, _: &Crossing) -> DVec2 {
        p.truncate()
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, crossings, hostile_lines};
    use super::*;

    fn new(e: f64, n: f64) -> Superellipsoid {
        Superellipsoid::new(e, n).unwrap()
    }

    #[test]
    fn as_pov_ray() {
        compare(&new(0.25, 0.25), include_str!("measured/superellipsoid_box.txt"), &Tolerance::default());
        compare(&new(1.4, 0.4), include_str!("measured/superellipsoid.txt"), &Tolerance::default());
        compare(&new(3.0, 1.7), include_str!("measured/superellipsoid_star.txt"), &Tolerance::default());
        compare(&new(1.0, 0.1), include_str!("measured/superellipsoid_cylinder.txt"), &Tolerance::default());
    }

    #[test]
    fn inside_alternates() {
        for (e, n) in [(1.0, 1.0), (0.2, 0.3), (1.9, 0.1), (0.02, 0.02), (3.0, 1.7), (0.5, 4.0), (2.0, 2.0)] {
            alternates(&new(e, n), DVec3::ZERO, 1.4, 1500, if e > 2.0 || n > 2.0 { 4 } else { 0 });
        }
    }

    #[test]
    fn sphere_and_octahedron() {
        let line = Line { o: DVec3::new(0.1, 0.2, -3.0), d: DVec3::new(0.0, 0.0, 2.0) };
        let found = crossings(&new(1.0, 1.0), &line, 0.0, 10.0);
        assert!((found[0].t - (3.0 - 0.95f64.sqrt()) / 2.0).abs() < 1e-14);
        let found = crossings(&new(2.0, 2.0), &line, 0.0, 10.0);
        assert!((found[0].t - (3.0 - 0.7) / 2.0).abs() < 1e-14);
    }

    #[test]
    fn hostile() {
        for (e, n) in [(0.0, 1.0), (1.0, -1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            assert!(Superellipsoid::new(e, n).is_none());
        }
        for (e, n) in [(1e-300, 1e-300), (1e300, 1e300), (1e-300, 1e300), (1e3, 1.0), (1.0, 1e5)] {
            hostile_lines(&new(e, n));
        }
    }
}
