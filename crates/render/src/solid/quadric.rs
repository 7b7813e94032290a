//! Second-order surfaces.

use glam::{DMat3, DVec2, DVec3};

use super::{Bounds, Crossing, Line, NO_UV, Primitive};

/// pᵀ M p + g · p + constant = 0; negative inside.
#[derive(Clone, Debug)]
pub(super) struct Quadric {
    m: DMat3,
    g: DVec3,
    constant: f64,
    bounds: Bounds,
    inside_bounds: Bounds,
}

impl Quadric {
    /// From the coefficients of x², y², z²; xy, xz, yz; x, y, z; 1. `None` where one is not finite or all but the last are 0.
    pub(super) fn new(squares: DVec3, mixed: DVec3, linear: DVec3, constant: f64) -> Option<Self> {
        let m = DMat3::from_cols(
            DVec3::new(squares.x, mixed.x / 2.0, mixed.y / 2.0),
            DVec3::new(mixed.x / 2.0, squares.y, mixed.z / 2.0),
            DVec3::new(mixed.y / 2.0, mixed.z / 2.0, squares.z),
        );
        if !(m.is_finite() && linear.is_finite() && constant.is_finite()) || (m == DMat3::ZERO && linear == DVec3::ZERO) {
            return None;
        }
        let mut quadric = Self { m, g: linear, constant, bounds: Bounds::INFINITE, inside_bounds: Bounds::INFINITE };
        if let Some(b) = extent(&m, linear, constant) {
            quadric.bounds = b;
            quadric.inside_bounds = b;
        } else if let Some(b) = extent(&(-m), -linear, -constant) {
            quadric.bounds = b;
        }
        Some(quadric)
    }

    #[inline]
    fn value(&self, p: DVec3) -> f64 {
        p.dot(self.m * p + self.g) + self.constant
    }
}

/// Box of the points where the form is not positive: an ellipsoid, or an elliptic cylinder along an axis.
fn extent(m: &DMat3, g: DVec3, constant: f64) -> Option<Bounds> {
    // Axes that do not occur at all stay infinite.
    let free = [0, 1, 2].map(|i| g[i] == 0.0 && m.col(i) == DVec3::ZERO);
    let mut full = *m;
    for (i, free) in free.into_iter().enumerate() {
        if free {
            full.col_mut(i)[i] = 1.0;
        }
    }
    let positive = full.x_axis.x > 0.0 && full.x_axis.x * full.y_axis.y - full.x_axis.y * full.y_axis.x > 0.0 && full.determinant() > 0.0;
    if !positive {
        return None;
    }
    let inverse = full.inverse();
    let center = inverse * g * -0.5;
    let level = -(constant + 0.5 * g.dot(center));
    if !(center.is_finite() && inverse.is_finite() && level.is_finite()) {
        return None;
    }
    if level < 0.0 {
        return Some(Bounds::EMPTY);
    }
    let mut b = Bounds::INFINITE;
    for i in 0..3 {
        if !free[i] {
            let reach = (level * inverse.col(i)[i]).max(0.0).sqrt() * (1.0 + 1e-9);
            b.min[i] = center[i] - reach;
            b.max[i] = center[i] + reach;
        }
    }
    Some(b)
}

impl Primitive for Quadric {
    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn inside_bounds(&self) -> Bounds {
        self.inside_bounds
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let md = self.m * line.d;
        let a = line.d.dot(md);
        let b = line.o.dot(md) * 2.0 + self.g.dot(line.d);
        let c = self.value(line.o);
        let mut take = |t: f64| {
            if t > t_min && t < t_max {
                out.push(Crossing::new(t, 0));
            }
        };
        let size = line.d.length_squared() * self.m.x_axis.abs().max(self.m.y_axis.abs()).max(self.m.z_axis.abs()).max_element();
        if a.abs() <= 1e-15 * size {
            if b != 0.0 {
                take(-c / b);
            }
            return;
        }
        let h = b * b - 4.0 * a * c;
        if h >= 0.0 {
            let q = -0.5 * (b + h.sqrt().copysign(b));
            take(q / a);
            if q != 0.0 {
                take(c / q);
            }
        }
    }

    fn inside(&self, p: DVec3) -> bool {
        self.value(p) <= 0.0
    }

    fn normal(&self, p: DVec3, _crossing: &Crossing) -> DVec3 {
        (self.m * p * 2.0 + self.g).normalize_or(DVec3::X)
    }

    fn uv(&self, _p: DVec3, _crossing: &Crossing) -> DVec2 {
        NO_UV
    }
}
