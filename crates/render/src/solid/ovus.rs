//! `ovus`: an egg of two spheres and the part of a spindle torus that touches both, as the documentation shows it (section 3.4.5.1.9).
//!
//! The circle that joins them has twice the radius of the larger sphere, as measured.

use etendue_procedural::fns;
use glam::{DVec2, DVec3};

use super::lathe::turn;
use super::{Bounds, Crossing, Line, Primitive, prism, roots};

/// An egg along the y axis.
#[derive(Clone, Debug)]
pub struct Ovus {
    bottom: f64,
    top: f64,
    /// Center of the joining circle: distance from the axis on the far side, and height.
    center: DVec2,
    radius: f64,
    /// Heights where it touches the spheres; above each other where there is no bottom sphere left.
    touch: [f64; 2],
    bounds: Bounds,
}

impl Ovus {
    /// The bottom sphere is around the origin, the top one around the highest point of it. `None` where a radius is not positive and finite.
    pub fn new(bottom: f64, top: f64) -> Option<Self> {
        let valid = |x: f64| x > 1e-100 && x < 1e100;
        if !valid(bottom) || !valid(top) {
            return None;
        }
        if top >= 2.0 * bottom {
            // Only the top sphere.
            let bounds = Bounds { min: DVec3::new(-top, bottom - top, -top), max: DVec3::new(top, bottom + top, top) };
            return Some(Self { bottom, top, center: DVec2::ZERO, radius: 0.0, touch: [f64::NEG_INFINITY; 2], bounds });
        }
        // |c| = ρ − r₀ and |c − (0, r₀)| = ρ − r₁.
        let radius = 2.0 * bottom.max(top);
        let (far, near) = (radius - bottom, radius - top);
        let y = (far * far - near * near + bottom * bottom) / (2.0 * bottom);
        let x = (far * far - y * y).max(0.0).sqrt();
        let touch = [-y * bottom / far, bottom + (bottom - y) * top / near];
        let widest = if touch[0] <= y && y <= touch[1] { radius - x } else { 0.0 };
        let r = widest.max(bottom).max(top.min(widest.max(bottom)));
        // The top sphere's equator may be outside of the torus part.
        let r = if touch[1] < bottom { r.max(top) } else { r };
        let bounds = Bounds { min: DVec3::new(-r, -bottom, -r), max: DVec3::new(r, bottom + top, r) };
        Some(Self { bottom, top, center: DVec2::new(x, y), radius, touch, bounds })
    }

    fn part(&self, y: f64) -> u32 {
        if y >= self.touch[1] {
            2
        } else if y < self.touch[0] {
            0
        } else {
            1
        }
    }
}

impl Primitive for Ovus {
    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let speed = line.d.length();
        if !(speed > 0.0) || !speed.is_finite() || !line.o.is_finite() {
            return;
        }
        let Some((lo, hi)) = prism::clip(&self.bounds, line, f64::NEG_INFINITY, f64::INFINITY) else { return };
        let middle = 0.5 * (lo + hi);
        if !middle.is_finite() || hi < t_min || lo > t_max {
            return;
        }
        let (o, d, half) = (line.at(middle), line.d / speed, 0.5 * (hi - lo) * speed);
        let mut push = |s: f64, part: u32| {
            let t = middle + s / speed;
            if t > t_min && t < t_max {
                out.push(Crossing { t, part, uv: DVec2::ZERO });
            }
        };
        for (part, center, radius) in [(0, 0.0, self.bottom), (2, self.bottom, self.top)] {
            let p = DVec3::new(o.x, o.y - center, o.z);
            for s in roots::quadratic(&[p.length_squared() - radius * radius, 2.0 * p.dot(d), 1.0]) {
                if self.part(o.y + s * d.y) == part {
                    push(s, part);
                }
            }
        }
        if self.touch[1] > self.touch[0] {
            // (|q|² + R² − ρ²)² = 4 R² (x² + z²) around the center's height.
            let q = DVec3::new(o.x, o.y - self.center.y, o.z);
            let (big, small) = (self.center.x * self.center.x, self.radius * self.radius);
            let (k0, k1) = (q.length_squared() + big - small, 2.0 * q.dot(d));
            let c = [
                k0 * k0 - 4.0 * big * (q.x * q.x + q.z * q.z),
                2.0 * k0 * k1 - 8.0 * big * (q.x * d.x + q.z * d.z),
                2.0 * k0 + k1 * k1 - 4.0 * big * (d.x * d.x + d.z * d.z),
                2.0 * k1,
                1.0,
            ];
            for s in roots::quartic_in(&c, -half, half) {
                let p = o + d * s;
                // The lemon within the torus: |q|² + R² < ρ² there.
                let q = DVec3::new(p.x, p.y - self.center.y, p.z);
                if self.part(p.y) == 1 && q.length_squared() + big <= small {
                    push(s, 1);
                }
            }
        }
    }

    fn inside(&self, p: DVec3) -> bool {
        let across = p.x * p.x + p.z * p.z;
        match self.part(p.y) {
            0 => across + p.y * p.y < self.bottom * self.bottom,
            2 => across + (p.y - self.bottom) * (p.y - self.bottom) < self.top * self.top,
            _ => {
                let (x, y) = (across.sqrt() + self.center.x, p.y - self.center.y);
                x * x + y * y < self.radius * self.radius
            }
        }
    }

    fn normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        let n = match crossing.part {
            0 => p,
            2 => DVec3::new(p.x, p.y - self.bottom, p.z),
            _ => {
                let r = (p.x * p.x + p.z * p.z).sqrt();
                let k = (r + self.center.x) / r.max(1e-300);
                DVec3::new(p.x * k, p.y - self.center.y, p.z * k)
            }
        };
        n.try_normalize().unwrap_or(DVec3::Y)
    }

    /// Spherical, around a center that moves up with the top radius: as measured.
    fn uv(&self, p: DVec3, _: &Crossing) -> DVec2 {
        let y = p.y - (0.5 * self.top).min(self.bottom);
        let r = (p.x * p.x + p.z * p.z).sqrt();
        DVec2::new(turn(p), 0.5 + fns::atan2(y, r) / std::f64::consts::PI)
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, crossings, hostile_lines};
    use super::*;

    fn new(bottom: f64, top: f64) -> Ovus {
        Ovus::new(bottom, top).unwrap()
    }

    #[test]
    fn as_pov_ray() {
        compare(&new(1.0, 0.6), include_str!("measured/ovus.txt"), &Tolerance::default());
        compare(&new(1.0, 1.6), include_str!("measured/ovus_big.txt"), &Tolerance::default());
    }

    #[test]
    fn inside_alternates() {
        for (bottom, top) in [(1.0, 0.6), (1.0, 1.6), (1.0, 0.01), (2.0, 2.0), (1.0, 1.99), (1.0, 2.5)] {
            let shape = new(bottom, top);
            let b = shape.bounds();
            alternates(&shape, 0.5 * (b.min + b.max), 0.6 * (b.max - b.min).max_element(), 2000, 0);
            // Tight: the surface reaches all sides.
            let at = |o: DVec3, d: DVec3| crossings(&shape, &Line { o, d }, 0.0, 1e3).len();
            let r = b.max.x * 0.999;
            let found = (0..2000).any(|i| at(DVec3::new(r, b.min.y + (b.max.y - b.min.y) * f64::from(i) / 2000.0, -10.0), DVec3::Z) == 2);
            assert!(found, "{bottom} {top}");
        }
    }

    #[test]
    fn surface_coordinates_as_measured() {
        for (bottom, top, y, v) in
            [(1.0, 0.6, 0.5, 0.5666), (1.0, 0.2, -0.5, 0.3071), (1.0, 1.6, 1.0, 0.5396), (2.0, 1.0, 0.0, 0.4219), (1.0, 2.5, 2.0, 0.631)]
        {
            let shape = new(bottom, top);
            let line = Line { o: DVec3::new(0.0, y, 10.0), d: DVec3::NEG_Z };
            let c = crossings(&shape, &line, 0.0, 1e3)[0];
            assert!((shape.uv(line.at(c.t), &c) - DVec2::new(0.25, v)).length() < 2e-4);
        }
    }

    #[test]
    fn hostile() {
        for (bottom, top) in [(0.0, 1.0), (1.0, 0.0), (-1.0, 1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            assert!(Ovus::new(bottom, top).is_none());
        }
        hostile_lines(&new(1.0, 1e-90));
        hostile_lines(&new(1.0, 1.0));
    }
}
