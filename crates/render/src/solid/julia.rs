//! `julia_fractal`: a slice of the points of four dimensions whose orbits stay near the origin for a number of iterations.
//!
//! POV-Ray documentation, section 3.4.5.1.7. Lines are walked in steps that an estimate of the distance gives (Hart, Sandin, Kauffman, "Ray
//! tracing deterministic 3-D fractals", SIGGRAPH 1989, equation 8), and crossings bisected.

use etendue_procedural::fns;
use etendue_scene::desc::classic::JuliaFunction;
use glam::{DVec2, DVec3, DVec4};

use super::hypercomplex::{self, Complex};
use super::{Bounds, Crossing, Line, Primitive};

/// Orbits of hypercomplex numbers that leave this sphere are outside. Those of quaternions may not leave that of radius 1 + |parameter|, from
/// where none comes back; both measured, and that the last of `max_iteration` points counts.
const ESCAPE: f64 = 4.0;
/// More iterations change nothing that double precision shows, and would take without end.
const MOST_ITERATIONS: u32 = 1000;
/// Shortest step over the radius.
const FINEST: f64 = 2e-4;

/// A Julia set.
#[derive(Clone, Debug)]
pub struct Julia {
    parameter: DVec4,
    hypercomplex: bool,
    function: JuliaFunction,
    iterations: u32,
    /// Radius of the sphere that orbits must not leave.
    escape: f64,
    /// Shortest step.
    step: f64,
    /// w = base + slope · p on the slice.
    base: f64,
    slope: DVec3,
    /// Of a sphere that holds all.
    radius: f64,
    /// ln `escape` over the function's power to the number of iterations left.
    potentials: Vec<f64>,
}

/// How an orbit ended.
struct Orbit {
    /// Whether it stayed.
    inside: bool,
    /// Iteration at the end.
    count: u32,
    /// Distance from the origin then.
    length: f64,
    /// How much it stretched differences on its way, about.
    stretch: f64,
}

/// A quaternion's square or cube, and what becomes of differences.
fn quaternion(cube: bool, h: DVec4, tangents: &mut [DVec4]) -> DVec4 {
    let (s, v) = (h.x, DVec3::new(h.y, h.z, h.w));
    let square = v.length_squared();
    for t in tangents {
        let (ds, dv) = (t.x, DVec3::new(t.y, t.z, t.w));
        let dot = v.dot(dv);
        let (a, b) = if cube {
            (3.0 * ((s * s - square) * ds - 2.0 * s * dot), (3.0 * s * s - square) * dv + v * (6.0 * s * ds - 2.0 * dot))
        } else {
            (2.0 * (s * ds - dot), 2.0 * (s * dv + ds * v))
        };
        *t = DVec4::new(a, b.x, b.y, b.z);
    }
    let (a, b) = if cube { (s * (s * s - 3.0 * square), v * (3.0 * s * s - square)) } else { (s * s - square, v * (2.0 * s)) };
    DVec4::new(a, b.x, b.y, b.z)
}

/// Both complex numbers of a hypercomplex one.
fn pair(h: DVec4) -> [Complex; 2] {
    [Complex::new(h.x - h.w, h.y + h.z), Complex::new(h.x + h.w, h.y - h.z)]
}

fn pair_length(h: &[Complex; 2]) -> f64 {
    0.5 * (h[0].square_length() + h[1].square_length())
}

impl Julia {
    /// The set of the iteration f(h) + `parameter`. `None` where the slice's fourth component is 0, where a number is not finite,
    /// and for functions that quaternions do not have.
    pub fn new(
        parameter: DVec4,
        hypercomplex: bool,
        function: JuliaFunction,
        max_iteration: u32,
        precision: f64,
        slice: DVec4,
        distance: f64,
    ) -> Option<Self> {
        let normal = slice.try_normalize()?;
        if normal.w.abs() < 1e-12 || !parameter.is_finite() || !distance.is_finite() {
            return None;
        }
        if !hypercomplex && !matches!(function, JuliaFunction::Sqr | JuliaFunction::Cube) {
            return None;
        }
        let iterations = max_iteration.clamp(1, MOST_ITERATIONS) - 1;
        let escape = if hypercomplex { ESCAPE } else { 1.0 + parameter.length() };
        // |f(h) + p| ≥ |h|^n − |p|, so that what must not leave by the last iteration was not farther out before.
        let mut radius = escape;
        for _ in 0..iterations {
            radius = match function {
                JuliaFunction::Sqr => (radius + parameter.length()).sqrt(),
                JuliaFunction::Cube => fns::pow(radius + parameter.length(), 1.0 / 3.0),
                _ => escape,
            };
            radius = radius.min(escape);
        }
        let radius = radius * (1.0 + 1e-9);
        let precision = if precision >= 1.0 { precision } else { 1.0 };
        let step = (0.05 / precision).max(FINEST * radius);
        let base = distance / normal.w;
        let slope = -normal.truncate() / normal.w;
        if !base.is_finite() || !slope.is_finite() {
            return None;
        }
        let power: f64 = if function == JuliaFunction::Sqr { 2.0 } else { 3.0 };
        let potentials = (0..=60).scan(fns::log(escape), |p, _| Some(std::mem::replace(p, *p / power))).collect();
        Some(Self { parameter, hypercomplex, function, iterations, escape, step, base, slope, radius, potentials })
    }

    fn lift(&self, p: DVec3) -> DVec4 {
        p.extend(self.base + self.slope.dot(p))
    }

    fn orbit(&self, p: DVec3) -> Orbit {
        let h = self.lift(p);
        if self.hypercomplex { self.hyper_orbit(h) } else { self.quaternion_orbit(h) }
    }

    fn quaternion_orbit(&self, mut h: DVec4) -> Orbit {
        let cube = self.function == JuliaFunction::Cube;
        // For squares the square of it, so that there is one root at the end.
        let mut stretch = 1.0;
        let mut square = h.length_squared();
        for count in 0..=self.iterations {
            if !(square <= self.escape * self.escape) || count == self.iterations {
                let stretch = if cube { stretch } else { f64::sqrt(stretch) };
                return Orbit { inside: square <= self.escape * self.escape, count, length: square.sqrt(), stretch };
            }
            stretch *= if cube { 3.0 * square } else { 4.0 * square };
            h = quaternion(cube, h, &mut []) + self.parameter;
            square = h.length_squared();
        }
        Orbit { inside: false, count: 0, length: f64::INFINITY, stretch: 1.0 }
    }

    fn hyper_orbit(&self, h: DVec4) -> Orbit {
        let p = pair(self.parameter);
        let mut h = pair(h);
        let mut stretch = [Complex::ONE; 2];
        for count in 0..=self.iterations {
            let square = pair_length(&h);
            if !(square <= self.escape * self.escape) || count == self.iterations {
                let stretch = stretch[0].square_length().max(stretch[1].square_length()).sqrt();
                return Orbit { inside: square <= self.escape * self.escape, count, length: square.sqrt(), stretch };
            }
            for i in 0..2 {
                let (f, d) = hypercomplex::evaluate(self.function, h[i]);
                h[i] = f.plus(p[i]);
                stretch[i] = stretch[i].times(d);
            }
        }
        Orbit { inside: false, count: 0, length: f64::INFINITY, stretch: 1.0 }
    }

    /// How far the surface is at least, about.
    fn estimate(&self, orbit: &Orbit) -> f64 {
        let gap = (orbit.length - self.escape).abs() / orbit.stretch;
        let guess = match self.function {
            JuliaFunction::Sqr | JuliaFunction::Cube if !orbit.inside => {
                // Half of |h| ln|h| / |h'| is the distance of the set itself; that of the surface at a potential above 0 is less.
                let log = fns::log(orbit.length);
                let left = self.iterations.saturating_sub(orbit.count) as usize;
                let surface = self.potentials.get(left).copied().unwrap_or(0.0);
                0.5 * orbit.length * log / orbit.stretch * (1.0 - (surface / log).min(1.0))
            }
            JuliaFunction::Sqr | JuliaFunction::Cube => 0.5 * gap,
            _ => (0.5 * gap).min(20.0 * self.step),
        };
        if guess > self.step { guess } else { self.step }
    }

    /// The gradient of the distance from the origin, one iteration after the last for squares and cubes; along w = constant. Both measured.
    fn gradient(&self, p: DVec3) -> DVec3 {
        let mut tangents = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| a.extend(0.0));
        let near = 1.001 * self.escape * self.escape;
        let more = matches!(self.function, JuliaFunction::Sqr | JuliaFunction::Cube);
        let count = self.iterations + u32::from(more);
        if self.hypercomplex {
            let parameter = pair(self.parameter);
            let mut h = pair(self.lift(p));
            let mut stretch = [Complex::ONE; 2];
            for _ in 0..count {
                if !(pair_length(&h) <= near) {
                    break;
                }
                for i in 0..2 {
                    let (f, d) = hypercomplex::evaluate(self.function, h[i]);
                    h[i] = f.plus(parameter[i]);
                    stretch[i] = stretch[i].times(d);
                }
            }
            let slope = |t: DVec4| {
                let d = pair(t);
                (0..2)
                    .map(|i| {
                        let d = stretch[i].times(d[i]);
                        h[i].re * d.re + h[i].im * d.im
                    })
                    .sum::<f64>()
            };
            return DVec3::from_array(tangents.map(slope));
        }
        let mut h = self.lift(p);
        for _ in 0..count {
            if !(h.length_squared() <= near) {
                break;
            }
            h = quaternion(self.function == JuliaFunction::Cube, h, &mut tangents) + self.parameter;
        }
        DVec3::from_array(tangents.map(|t| t.dot(h)))
    }

    /// The crossing between two points of a line, of which one is inside: halving, and false position where both orbits go through all
    /// iterations, as their ends depend on the point smoothly then (with Illinois' halving of an end that stays).
    fn border(&self, o: DVec3, d: DVec3, a: (f64, &Orbit), b: (f64, &Orbit)) -> f64 {
        let value = |orbit: &Orbit| (orbit.count == self.iterations).then_some(orbit.length - self.escape);
        let ((mut lo, mut f_lo), (mut hi, mut f_hi)) = ((a.0, value(a.1)), (b.0, value(b.1)));
        let fine = 1e-12 * self.radius;
        // Which end moved last, and how often the bracket shrank little.
        let (mut last, mut slow) = (None, 0);
        for _ in 0..80 {
            let width = hi - lo;
            let middle = 0.5 * (lo + hi);
            if !(width > fine) || middle == lo || middle == hi {
                break;
            }
            let guess = match (f_lo, f_hi) {
                // Kept off the ends by what is wanted, so that the other end follows.
                (Some(f), Some(g)) if slow < 3 => (lo + width * (f / (f - g))).clamp(lo + 0.4 * fine, hi - 0.4 * fine),
                _ => middle,
            };
            let at = if guess > lo && guess < hi { guess } else { middle };
            let found = self.orbit(o + d * at);
            let moves_lo = found.inside == a.1.inside;
            let again = last == Some(moves_lo);
            if moves_lo {
                (lo, f_lo) = (at, value(&found));
                f_hi = f_hi.map(|f| if again { 0.5 * f } else { f });
            } else {
                (hi, f_hi) = (at, value(&found));
                f_lo = f_lo.map(|f| if again { 0.5 * f } else { f });
            }
            last = Some(moves_lo);
            slow = if slow < 3 && hi - lo > 0.5 * width { slow + 1 } else { 0 };
        }
        0.5 * (lo + hi)
    }

    /// Visits crossings in order until `visit` returns true.
    fn walk(&self, line: &Line, t_min: f64, t_max: f64, visit: &mut dyn FnMut(f64) -> bool) {
        let speed = line.d.length();
        if !(speed > 0.0) || !speed.is_finite() || !line.o.is_finite() {
            return;
        }
        let d = line.d / speed;
        let middle = -line.o.dot(d);
        let o = line.o + d * middle;
        let rest = self.radius * self.radius - o.length_squared();
        if !(rest > 0.0) {
            return;
        }
        let reach = rest.sqrt();
        let (mut a, end) = ((t_min * speed - middle).max(-reach), (t_max * speed - middle).min(reach));
        if !(a < end) {
            return;
        }
        let mut orbit = self.orbit(o + d * a);
        while a < end {
            let b = (a + self.estimate(&orbit)).min(end);
            let next = self.orbit(o + d * b);
            if next.inside != orbit.inside {
                let t = (self.border(o, d, (a, &orbit), (b, &next)) + middle) / speed;
                if t > t_min && t < t_max && visit(t) {
                    return;
                }
            }
            if b <= a {
                return;
            }
            a = b;
            orbit = next;
        }
    }
}

impl Primitive for Julia {
    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::splat(-self.radius), max: DVec3::splat(self.radius) }
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        self.walk(line, t_min, t_max, &mut |t| {
            out.push(Crossing { t, part: 0, uv: DVec2::ZERO });
            false
        });
    }

    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _: &mut Vec<Crossing>) -> Option<Crossing> {
        let mut nearest = None;
        self.walk(line, t_min, t_max, &mut |t| {
            nearest = Some(Crossing { t, part: 0, uv: DVec2::ZERO });
            true
        });
        nearest
    }

    fn inside(&self, p: DVec3) -> bool {
        p.length_squared() <= self.radius * self.radius && self.orbit(p).inside
    }

    fn normal(&self, p: DVec3, _: &Crossing) -> DVec3 {
        self.gradient(p).try_normalize().unwrap_or(DVec3::X)
    }

    fn uv(&self, p: DVec3, _: &Crossing) -> DVec2 {
        p.truncate()
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, hostile_lines};
    use super::*;

    const FLAT: DVec4 = DVec4::W;

    fn new(parameter: [f64; 4], hyper: bool, function: JuliaFunction, iterations: u32, slice: DVec4, distance: f64) -> Julia {
        Julia::new(DVec4::from_array(parameter), hyper, function, iterations, 500.0, slice, distance).unwrap()
    }

    fn shapes() -> [(Julia, &'static str, &'static str); 5] {
        use JuliaFunction::*;
        let slice = DVec4::new(0.1, 0.2, 0.0, 1.0);
        [
            (new([-0.083, 0.0, -0.83, -0.025], false, Sqr, 5, FLAT, 0.0), include_str!("measured/julia.txt"), "sqr"),
            (new([-0.2, 0.3, 0.4, 0.1], false, Cube, 4, slice, 0.1), include_str!("measured/julia_cube.txt"), "cube"),
            (new([-0.5, 0.3, 0.2, 0.1], true, Sqr, 5, FLAT, 0.0), include_str!("measured/julia_hyper.txt"), "hyper"),
            (new([0.3, 0.2, 0.1, 0.1], true, Sin, 4, FLAT, 0.0), include_str!("measured/julia_sin.txt"), "sin"),
            (new([-0.3, 0.2, 0.1, 0.1], true, Pwr(2.4, 0.1), 4, FLAT, 0.0), include_str!("measured/julia_pwr.txt"), "pwr"),
        ]
    }

    #[test]
    fn as_pov_ray() {
        for (shape, table, name) in shapes() {
            println!("{name}");
            // For functions other than powers POV-Ray stops near the surface, and what it takes for normals and the inside is not known.
            let rough = matches!(shape.function, JuliaFunction::Sin | JuliaFunction::Pwr(..));
            let (t, n) = if rough { (6e-3, 3.0) } else { (2e-4, 2e-3) };
            let lines: String = table.lines().filter(|l| !rough || l.starts_with('L')).map(|l| format!("{l}\n")).collect();
            compare(&shape, &lines, &Tolerance { t, n, lines: if rough { 5 } else { 0 }, ..Tolerance::default() });
        }
    }

    #[test]
    fn inside_alternates() {
        for (shape, ..) in shapes() {
            alternates(&shape, DVec3::ZERO, 1.2, 400, 4);
        }
    }

    #[test]
    fn hostile() {
        let new = |p: f64, hyper, function, iterations, precision, slice, distance| {
            Julia::new(DVec4::splat(p), hyper, function, iterations, precision, slice, distance)
        };
        use JuliaFunction::*;
        assert!(new(f64::NAN, false, Sqr, 10, 20.0, FLAT, 0.0).is_none());
        assert!(new(0.1, false, Sin, 10, 20.0, FLAT, 0.0).is_none());
        assert!(new(0.1, false, Sqr, 10, 20.0, DVec4::X, 0.0).is_none());
        assert!(new(0.1, false, Sqr, 10, 20.0, DVec4::ZERO, 0.0).is_none());
        assert!(new(0.1, false, Sqr, 10, 20.0, FLAT, f64::INFINITY).is_none());
        hostile_lines(&new(0.1, false, Sqr, u32::MAX, 1e300, FLAT, 0.0).unwrap());
        hostile_lines(&new(0.1, true, Pwr(1e300, -1e300), 10, f64::NAN, FLAT, 1e200).unwrap());
        hostile_lines(&new(1e200, true, Reciprocal, 0, -5.0, FLAT, 0.0).unwrap());
    }
}
