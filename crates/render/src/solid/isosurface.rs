//! `isosurface`: where a function of space has a value.
//!
//! The section *Isosurface* of POV-Ray's reference (3.4.5.1.6): an interval of a ray, in which the function cannot come to the
//! threshold and back by its greatest slope (`max_gradient`), holds no surface; other intervals are halved until they are
//! shorter than `accuracy`. This is the search with Lipschitz bounds of Kalra and Barr, "Guaranteed Ray Intersections with
//! Implicit Surfaces", SIGGRAPH 1989, doi:10.1145/74333.74364. Where such a short interval has a change of sign, its place is refined by
//! bisection and secants, so that hits do not depend on how the ray was divided. Slopes that are too small make holes, as there.
//!
//! `evaluate` estimates the slope in POV-Ray from what earlier rays have met, which depends on their order. Here every ray
//! starts anew: with P0 · P1², which is the slope that the reference derives P0 and P1 from, and enlarges it by what it meets.

use std::sync::Arc;

use etendue_procedural::{Context, Function};
use etendue_scene::desc::classic;
use glam::{DVec2, DVec3};

use super::container::Container;
use super::{Bounds, Crossing, Line, Primitive};

/// Evaluations that one ray may take; beyond it has no further crossings. Only absurd accuracies and slopes need so many.
const MOST_EVALUATIONS: u32 = 200_000;
/// Deepest division of an interval.
const MOST_DIVISIONS: usize = 48;
/// Part numbers of the container's surface start here.
const CAP: u32 = 1;

/// Surface of a function within a container; inside, the function is below the threshold.
#[derive(Clone, Debug)]
pub struct Isosurface {
    function: Arc<Function>,
    container: Container,
    threshold: f64,
    accuracy: f64,
    max_gradient: f64,
    /// Factor by which slopes that are met are overestimated, where they count.
    estimate: Option<f64>,
    open: bool,
    noise_generator: u8,
}

/// An interval of a line with the function's values at its ends.
#[derive(Clone, Copy)]
struct Interval {
    a: f64,
    fa: f64,
    b: f64,
    fb: f64,
}

impl Isosurface {
    /// `None` where the container is degenerate.
    pub fn new(iso: &classic::Isosurface) -> Option<Self> {
        let container = Container::new(&iso.container)?;
        let size = (container.bounds().max - container.bounds().min).length();
        // No finer than doubles tell apart, no coarser than the container.
        let accuracy = iso.accuracy.clamp(1e-10 * size, size.max(1e-300));
        let (max_gradient, estimate) = match iso.evaluate {
            Some([least, over, _]) => (least * over * over, Some(over.max(1.0))),
            None => (iso.max_gradient, None),
        };
        Some(Self {
            function: iso.function.clone(),
            container,
            threshold: iso.threshold,
            accuracy: if accuracy.is_nan() { 0.001 } else { accuracy },
            max_gradient: if max_gradient.is_nan() { 1.1 } else { max_gradient },
            estimate,
            open: iso.open,
            noise_generator: iso.noise_generator,
        })
    }

    /// Above 0 outside, below 0 inside.
    #[inline]
    fn value(&self, p: DVec3) -> f64 {
        let context = Context { noise_generator: self.noise_generator, ..Context::at(p) };
        let value = self.function.eval3(p, &context) - self.threshold;
        // Without a value there is no inside, but the surface may be near.
        if value.is_nan() { f64::MIN_POSITIVE } else { value }
    }

    /// Visits the changes of sign between two places of the line in order, until `visit` returns false.
    fn search(&self, line: &Line, start: f64, end: f64, visit: &mut dyn FnMut(f64) -> bool) {
        let speed = line.d.length();
        let shortest = self.accuracy / speed;
        let mut slope = self.max_gradient * speed;
        let mut evaluations = 2;
        let first = Interval { a: start, fa: self.value(line.at(start)), b: end, fb: self.value(line.at(end)) };
        // Intervals to the right of the one in hand, nearest last.
        let mut waiting = [first; MOST_DIVISIONS];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let mut i = waiting[count];
            loop {
                let length = i.b - i.a;
                let crosses = (i.fa < 0.0) != (i.fb < 0.0);
                if !crosses && i.fa.abs() + i.fb.abs() > slope * length {
                    break;
                }
                if length <= shortest || count + 1 >= MOST_DIVISIONS {
                    if crosses && !visit(self.refine(line, i)) {
                        return;
                    }
                    break;
                }
                if evaluations >= MOST_EVALUATIONS {
                    return;
                }
                evaluations += 1;
                let middle = 0.5 * (i.a + i.b);
                let value = self.value(line.at(middle));
                if let Some(over) = self.estimate {
                    let met = (value - i.fa).abs().max((i.fb - value).abs()) / (0.5 * length);
                    if met > slope && met.is_finite() {
                        slope = met * over;
                    }
                }
                waiting[count] = Interval { a: middle, fa: value, ..i };
                count += 1;
                i = Interval { b: middle, fb: value, ..i };
            }
        }
    }

    /// The change of sign within an interval: secants kept within bounds (the Illinois variant of false position), bisection where these are slow.
    fn refine(&self, line: &Line, mut i: Interval) -> f64 {
        let tolerance = 1e-9 * self.accuracy / line.d.length();
        let mut side = 0;
        for step in 0..60 {
            let length = i.b - i.a;
            if !(length > tolerance + 4.0 * f64::EPSILON * i.a.abs().max(i.b.abs())) {
                break;
            }
            let secant = (i.a * i.fb - i.b * i.fa) / (i.fb - i.fa);
            let t = if step < 20 && secant > i.a && secant < i.b { secant } else { 0.5 * (i.a + i.b) };
            let f = self.value(line.at(t));
            if (f < 0.0) == (i.fa < 0.0) {
                (i.a, i.fa) = (t, f);
                i.fb *= if side == 1 { 0.5 } else { 1.0 };
                side = 1;
            } else {
                (i.b, i.fb) = (t, f);
                i.fa *= if side == -1 { 0.5 } else { 1.0 };
                side = -1;
            }
            if f == 0.0 {
                return t;
            }
        }
        0.5 * (i.a + i.b)
    }

    /// Visits crossings in order until `visit` returns false.
    fn visit(&self, line: &Line, t_min: f64, t_max: f64, visit: &mut dyn FnMut(Crossing) -> bool) {
        let speed = line.d.length();
        if !(speed > 0.0 && speed.is_finite() && line.o.is_finite()) {
            return;
        }
        let Some([enter, leave]) = self.container.span(line) else { return };
        if !(leave.t > t_min && enter.t < t_max) {
            return;
        }
        let cap = |c: Crossing| Crossing { part: CAP + c.part, ..c };
        if !self.open && enter.t > t_min && self.value(line.at(enter.t)) < 0.0 && !visit(cap(enter)) {
            return;
        }
        let mut go_on = true;
        let (start, end) = (enter.t.max(t_min), leave.t.min(t_max));
        if start < end {
            self.search(line, start, end, &mut |t| {
                if t > t_min && t < t_max {
                    go_on = visit(Crossing::new(t, 0));
                }
                go_on
            });
        }
        if go_on && !self.open && leave.t < t_max && leave.t > t_min && self.value(line.at(leave.t)) < 0.0 {
            visit(cap(leave));
        }
    }
}

impl Primitive for Isosurface {
    fn bounds(&self) -> Bounds {
        self.container.bounds()
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        self.visit(line, t_min, t_max, &mut |c| {
            out.push(c);
            true
        });
    }

    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        let mut nearest = None;
        self.visit(line, t_min, t_max, &mut |c| {
            nearest = Some(c);
            false
        });
        nearest
    }

    fn inside(&self, p: DVec3) -> bool {
        self.container.contains(p) && self.value(p) < 0.0
    }

    fn normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        if crossing.part >= CAP {
            return self.container.normal(p, &Crossing { part: crossing.part - CAP, ..*crossing });
        }
        let h = self.accuracy;
        let difference = |e: DVec3| self.value(p + e * h) - self.value(p - e * h);
        DVec3::new(difference(DVec3::X), difference(DVec3::Y), difference(DVec3::Z)).try_normalize().unwrap_or(DVec3::Y)
    }

    fn uv(&self, _p: DVec3, _crossing: &Crossing) -> DVec2 {
        DVec2::ZERO
    }
}

#[cfg(test)]
mod tests {
    use etendue_procedural::function::{Binary, Builder, Unary};

    use super::super::testing::Random;
    use super::super::torus::Torus;
    use super::*;

    /// The distance function of a torus (radii 0.6 and 0.25) around the y axis, or of a sphere of radius 0.8.
    fn function(is_torus: bool) -> Arc<Function> {
        let mut b = Builder::new(["x", "y", "z"].map(String::from).to_vec());
        let [x, y, z] = ["x", "y", "z"].map(|n| b.parameter(n).unwrap());
        let [xx, yy, zz] = [x, y, z].map(|v| b.unary(Unary::Sqr, v));
        let round = b.binary(Binary::Add, xx, zz);
        let (sum, radius) = if is_torus {
            let (r, major) = (b.unary(Unary::Sqrt, round), b.number(0.6));
            let off = b.binary(Binary::Subtract, r, major);
            let square = b.unary(Unary::Sqr, off);
            (b.binary(Binary::Add, square, yy), b.number(0.25))
        } else {
            (b.binary(Binary::Add, round, yy), b.number(0.8))
        };
        let d = b.unary(Unary::Sqrt, sum);
        let f = b.binary(Binary::Subtract, d, radius);
        Arc::new(b.finish(f).unwrap())
    }

    fn description(function: Arc<Function>) -> classic::Isosurface {
        classic::Isosurface {
            function,
            container: classic::Container::default(),
            threshold: 0.0,
            accuracy: 0.001,
            max_gradient: 1.1,
            evaluate: None,
            open: false,
            noise_generator: 2,
        }
    }

    fn lines(n: usize) -> impl Iterator<Item = Line> {
        let mut random = Random::new(11);
        (0..n).map(move |_| Line { o: random.vector() * 3.0, d: random.vector() })
    }

    #[test]
    fn torus_and_sphere_are_where_they_are() {
        let torus = Torus::new(0.6, 0.25).unwrap();
        let sphere = super::super::sphere::Sphere::new(DVec3::ZERO, 0.8).unwrap();
        let exact: [&dyn Primitive; 2] = [&sphere, &torus];
        let (mut hits, mut missed) = (0, 0);
        for (is_torus, exact) in [(false, exact[0]), (true, exact[1])] {
            for evaluate in [None, Some([0.5, 1.5, 0.7])] {
                let iso = Isosurface::new(&classic::Isosurface { evaluate, ..description(function(is_torus)) }).unwrap();
                for line in lines(2000) {
                    let (mut a, mut b) = (Vec::new(), Vec::new());
                    iso.crossings(&line, -100.0, 100.0, &mut a);
                    exact.crossings(&line, -100.0, 100.0, &mut b);
                    for c in [&mut a, &mut b] {
                        c.sort_by(|a, b| a.t.total_cmp(&b.t));
                    }
                    if a.len() != b.len() {
                        // Rays that graze within the accuracy.
                        missed += 1;
                        continue;
                    }
                    for (a, b) in a.iter().zip(&b) {
                        hits += 1;
                        assert!((a.t - b.t).abs() < 1e-8, "{a:?} {b:?}");
                        let p = line.at(a.t);
                        assert!(iso.normal(p, a).dot(exact.normal(p, b)) > 1.0 - 1e-5);
                    }
                    let first = iso.nearest(&line, -100.0, 100.0, &mut Vec::new());
                    assert_eq!(first.map(|c| c.t), a.first().map(|c| c.t));
                }
            }
        }
        assert!(hits > 500 && missed * 50 < hits, "{hits} {missed}");
    }

    #[test]
    fn containers_cut_with_caps_unless_open() {
        let container = classic::Container::Box([DVec3::splat(-0.5), DVec3::splat(0.5)]);
        let line = Line { o: DVec3::new(-2.0, 0.1, 0.0), d: DVec3::X };
        for open in [false, true] {
            let iso = Isosurface::new(&classic::Isosurface { container, open, ..description(function(false)) }).unwrap();
            let mut out = Vec::new();
            iso.crossings(&line, 0.0, 10.0, &mut out);
            assert_eq!(out.len(), if open { 0 } else { 2 });
            if !open {
                assert!((out[0].t - 1.5).abs() < 1e-12);
                assert_eq!(iso.normal(line.at(out[0].t), &out[0]), DVec3::NEG_X);
            }
            assert!(iso.inside(DVec3::splat(0.1)) && !iso.inside(DVec3::splat(0.6)));
        }
    }

    #[test]
    fn hostile_numbers_end() {
        let wild = [0.0, -1.0, 1e300, 1e-300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        let mut nan = Builder::new(vec!["x".into()]);
        let x = nan.parameter("x").unwrap();
        let root = nan.unary(Unary::Sqrt, x);
        let functions = [function(true), Arc::new(nan.finish(root).unwrap()), Arc::new(Function::constant(f64::NAN))];
        for v in wild {
            for f in &functions {
                let base = description(f.clone());
                for iso in [
                    classic::Isosurface { max_gradient: v, ..base.clone() },
                    classic::Isosurface { accuracy: v, ..base.clone() },
                    classic::Isosurface { threshold: v, ..base.clone() },
                    classic::Isosurface { evaluate: Some([v; 3]), ..base.clone() },
                    classic::Isosurface { container: classic::Container::Sphere { center: DVec3::ZERO, radius: v }, ..base },
                ] {
                    let Some(iso) = Isosurface::new(&iso) else { continue };
                    for line in lines(2).chain([Line { o: DVec3::splat(v), d: DVec3::ONE }, Line { o: DVec3::ZERO, d: DVec3::splat(v) }]) {
                        let mut out = Vec::new();
                        iso.crossings(&line, f64::NEG_INFINITY, f64::INFINITY, &mut out);
                        assert!(out.iter().all(|c| !c.t.is_nan()));
                        for c in out.iter().take(3) {
                            let _ = iso.normal(line.at(c.t), c);
                        }
                    }
                }
            }
        }
    }
}
