//! Torus around the y axis.

use etendue_procedural::fns;
use glam::{DVec2, DVec3};

use super::facets::{Facet, circle, revolve};
use super::roots::{quartic_first, quartic_in};
use super::{Bounds, Crossing, Line, Primitive};

/// Ring with a round tube.
#[derive(Clone, Debug)]
pub(super) struct Torus {
    major: f64,
    minor: f64,
}

impl Torus {
    /// `None` without a tube of positive radius.
    pub(super) fn new(major: f64, minor: f64) -> Option<Self> {
        let major = major.abs();
        (major.is_finite() && minor.is_finite() && minor > 0.0).then_some(Self { major, minor })
    }
}

/// The quartic on a line, where it may have roots.
struct Part {
    c: [f64; 5],
    lo: f64,
    hi: f64,
    /// Line parameter of the point nearest to the center, and length of its unit.
    closest: f64,
    speed: f64,
}

impl Part {
    fn t(&self, s: f64) -> f64 {
        (s + self.closest) / self.speed
    }
}

impl Torus {
    /// The quartic of (|p|² + R² − r²)² = 4 R² (x² + z²) in a line parameter that is zero at the point nearest to the center and has
    /// unit speed, which keeps coefficients of one size however far the line begins. `None` where there is no crossing.
    fn quartic(&self, line: &Line, t_min: f64, t_max: f64) -> Option<Part> {
        let speed = line.d.length();
        let d = line.d / speed;
        let closest = -line.o.dot(d);
        let o = line.o + d * closest;
        if !(speed > 0.0 && o.is_finite()) {
            return None;
        }
        let (major2, minor2) = (self.major * self.major, self.minor * self.minor);
        let reach2 = (self.major + self.minor) * (self.major + self.minor);
        let o2 = o.length_squared();
        if !(o2 < reach2) {
            return None;
        }
        // Within the enclosing ball and between the planes y = ±r.
        let half = (reach2 - o2).sqrt() * (1.0 + 1e-9);
        let (mut lo, mut hi) = ((t_min * speed - closest).max(-half), (t_max * speed - closest).min(half));
        if d.y.abs() > 1e-12 {
            let (a, b) = ((-self.minor - o.y) / d.y, (self.minor - o.y) / d.y);
            let room = 1e-9 * half;
            lo = lo.max(a.min(b) - room);
            hi = hi.min(a.max(b) + room);
        } else if o.y.abs() > self.minor {
            return None;
        }
        if !(lo < hi) {
            return None;
        }
        // |p|² = s² + o2, as o is perpendicular to d.
        let k = o2 + major2 - minor2;
        let c = [
            k * k - 4.0 * major2 * (o.x * o.x + o.z * o.z),
            -8.0 * major2 * (o.x * d.x + o.z * d.z),
            2.0 * k - 4.0 * major2 * (d.x * d.x + d.z * d.z),
            0.0,
            1.0,
        ];
        Some(Part { c, lo, hi, closest, speed })
    }
}

impl Primitive for Torus {
    fn facets(&self, segments: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let profile: Vec<DVec2> =
            (0..=segments).map(|i| circle(i % segments, segments) * self.minor + DVec2::new(self.major, 0.0)).collect();
        Some(revolve(&profile, segments))
    }

    fn bounds(&self) -> Bounds {
        let r = self.major + self.minor;
        Bounds { min: DVec3::new(-r, -self.minor, -r), max: DVec3::new(r, self.minor, r) }
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let Some(part) = self.quartic(line, t_min, t_max) else { return };
        for s in quartic_in(&part.c, part.lo, part.hi) {
            let t = part.t(s);
            if t > t_min && t < t_max {
                out.push(Crossing::new(t, 0));
            }
        }
    }

    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _: &mut Vec<Crossing>) -> Option<Crossing> {
        let part = self.quartic(line, t_min, t_max)?;
        let counts = |t: f64| t > t_min && t < t_max;
        let first = part.t(quartic_first(&part.c, part.lo, part.hi)?);
        // A root at the very end of the interval may lie outside of it by rounding.
        let t = if counts(first) {
            first
        } else {
            quartic_in(&part.c, part.lo, part.hi).into_iter().map(|s| part.t(s)).find(|t| counts(*t))?
        };
        Some(Crossing::new(t, 0))
    }

    fn inside(&self, p: DVec3) -> bool {
        let r = (p.x * p.x + p.z * p.z).sqrt() - self.major;
        // A tube wider than the ring crosses itself. All of it is inside, though its inner sheet is a surface too (as measured).
        r * r + p.y * p.y < self.minor * self.minor
    }

    fn normal(&self, p: DVec3, _crossing: &Crossing) -> DVec3 {
        let ring = DVec3::new(p.x, 0.0, p.z).normalize_or(DVec3::X) * self.major;
        (p - ring).normalize_or(DVec3::Y)
    }

    fn uv(&self, p: DVec3, _crossing: &Crossing) -> DVec2 {
        let turn = |y: f64, x: f64| fns::atan2(y, x) / std::f64::consts::TAU;
        let r = (p.x * p.x + p.z * p.z).sqrt() - self.major;
        // As measured: u falls as the ring turns from +x to +z, both are 0.5 on the outside at +x.
        DVec2::new((0.5 - turn(p.z, p.x)).rem_euclid(1.0), turn(p.y, r) + 0.5)
    }
}
