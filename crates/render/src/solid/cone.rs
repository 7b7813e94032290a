//! Cone, frustum and cylinder, closed or open.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use super::facets::{Facet, revolve};
use super::{Bounds, Crossing, Line, NO_UV, Primitive};

/// Frustum between two circles. Parts: 0 the side, 1 the base, 2 the cap.
#[derive(Clone, Debug)]
pub(super) struct Cone {
    base: DVec3,
    /// Rows: two unit vectors across and the unit axis.
    frame: DMat3,
    length: f64,
    base_radius: f64,
    cap_radius: f64,
    /// Growth of the radius per unit of length.
    slope: f64,
    open: bool,
}

impl Cone {
    /// `None` without length or radius. Between radii of different signs it is a double cone (as measured).
    pub(super) fn new(base: DVec3, base_radius: f64, cap: DVec3, cap_radius: f64, open: bool) -> Option<Self> {
        let axis = cap - base;
        let length = axis.length();
        let sizes = length > 0.0 && length.is_finite() && (base_radius != 0.0 || cap_radius != 0.0);
        if !(sizes && base.is_finite() && base_radius.is_finite() && cap_radius.is_finite()) {
            return None;
        }
        let w = axis / length;
        let u = w.any_orthonormal_vector();
        let frame = DMat3::from_cols(u, w.cross(u), w).transpose();
        Some(Self { base, frame, length, base_radius, cap_radius, slope: (cap_radius - base_radius) / length, open })
    }

    /// The image under a similarity (turn, mirror, equal scale, shift); `None` for other transforms.
    pub(super) fn moved(&self, m: &DAffine3) -> Option<Self> {
        let gram = m.matrix3.transpose() * m.matrix3;
        let s2 = gram.x_axis.x;
        let off = gram - DMat3::from_diagonal(DVec3::splat(s2));
        let error = off.x_axis.abs().max(off.y_axis.abs()).max(off.z_axis.abs()).max_element();
        if !(error <= 1e-12 * s2) {
            return None;
        }
        let s = s2.sqrt();
        let base = m.transform_point3(self.base);
        let cap = m.transform_point3(self.base + self.frame.row(2) * self.length);
        Self::new(base, self.base_radius * s, cap, self.cap_radius * s, self.open)
    }

    /// All crossings of the endless line: at most two on a frustum's side and one on each end.
    #[inline]
    fn each(&self, line: &Line, mut take: impl FnMut(Crossing)) {
        let o = self.frame * (line.o - self.base);
        let d = self.frame * line.d;
        let r = self.base_radius + self.slope * o.z;
        let dr = self.slope * d.z;
        let a = d.x * d.x + d.y * d.y - dr * dr;
        let b = r * dr - (o.x * d.x + o.y * d.y);
        let c = o.x * o.x + o.y * o.y - r * r;
        let mut side = |t: f64| {
            let z = o.z + t * d.z;
            if z >= 0.0 && z <= self.length {
                take(Crossing::new(t, 0));
            }
        };
        let across = d.x * d.x + d.y * d.y;
        if a.abs() > 1e-14 * (across + dr * dr) {
            // b² − ac from the distance between line and axis, which stays exact far away: it is a c' with c' the value at the extremum.
            let extremum = b / a;
            let (x, y, re) = (o.x + extremum * d.x, o.y + extremum * d.y, r + extremum * dr);
            let h = -a * (x * x + y * y - re * re);
            if h >= 0.0 {
                let q = b + h.sqrt().copysign(b);
                side(q / a);
                if q != 0.0 {
                    side(c / q);
                } else {
                    side(0.0);
                }
            } else if a > 0.0 {
                // All of the line is outside of the endless cone, and so of both ends.
                return;
            }
        } else if b != 0.0 {
            // Parallel to a line of the side.
            side(0.5 * c / b);
        }
        if !self.open && d.z != 0.0 {
            for (part, z, radius) in [(1, 0.0, self.base_radius), (2, self.length, self.cap_radius)] {
                let t = (z - o.z) / d.z;
                let (x, y) = (o.x + t * d.x, o.y + t * d.y);
                if x * x + y * y <= radius * radius {
                    take(Crossing::new(t, part));
                }
            }
        }
    }
}

impl Primitive for Cone {
    fn facets(&self, segments: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let (a, b) = (DVec2::new(self.base_radius, 0.0), DVec2::new(self.cap_radius, self.length));
        let profile = [DVec2::ZERO, a, b, DVec2::new(0.0, self.length)];
        let mut all = revolve(if self.open { &profile[1..3] } else { &profile }, segments);
        let out = self.frame.transpose();
        all.iter_mut().for_each(|f| f.p = f.p.map(|p| self.base + out * DVec3::new(p.x, p.z, p.y)));
        Some(all)
    }

    fn bounds(&self) -> Bounds {
        let w = self.frame.row(2);
        let reach = (DVec3::ONE - w * w).max(DVec3::ZERO).map(f64::sqrt);
        let disc = |c: DVec3, r: f64| Bounds { min: c - reach * r.abs(), max: c + reach * r.abs() };
        disc(self.base, self.base_radius).union(disc(self.base + w * self.length, self.cap_radius))
    }

    #[inline]
    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        self.each(line, |c| {
            if c.t > t_min && c.t < t_max {
                out.push(c);
            }
        });
    }

    #[inline]
    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        let mut best: Option<Crossing> = None;
        let mut limit = t_max;
        self.each(line, |c| {
            if c.t > t_min && c.t < limit {
                limit = c.t;
                best = Some(c);
            }
        });
        best
    }

    fn inside(&self, p: DVec3) -> bool {
        let p = self.frame * (p - self.base);
        let r = self.base_radius + self.slope * p.z;
        p.z > 0.0 && p.z < self.length && p.x * p.x + p.y * p.y < r * r
    }

    fn normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        match crossing.part {
            1 => -self.frame.row(2),
            2 => self.frame.row(2),
            _ => {
                let p = self.frame * (p - self.base);
                let r = self.base_radius + self.slope * p.z;
                let n = DVec3::new(p.x, p.y, -self.slope * r).normalize_or(DVec3::NEG_Z);
                self.frame.transpose() * n
            }
        }
    }

    fn uv(&self, _p: DVec3, _crossing: &Crossing) -> DVec2 {
        NO_UV
    }
}
