//! Boxes in double precision, open to infinity along unbounded directions.

use glam::{DAffine3, DVec3};

use super::Line;

/// A box in double precision; infinite along unbounded directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: DVec3,
    /// Upper corner.
    pub max: DVec3,
}

impl Bounds {
    /// Holds nothing.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
    /// Holds everything.
    pub const INFINITE: Self = Self { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };

    /// The box of two points in any order.
    pub fn of(a: DVec3, b: DVec3) -> Self {
        Self { min: a.min(b), max: a.max(b) }
    }

    /// The box of points.
    pub fn of_points(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, Self::with)
    }

    /// A cube around a point.
    pub fn around(center: DVec3, radius: f64) -> Self {
        Self { min: center - DVec3::splat(radius), max: center + DVec3::splat(radius) }
    }

    /// The box that holds a further point.
    pub fn with(self, p: DVec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The box of both.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// What both hold; empty where they are apart.
    pub fn intersection(self, other: Self) -> Self {
        Self { min: self.min.max(other.min), max: self.max.min(other.max) }
    }

    /// Whether all six sides are finite.
    pub fn is_finite(&self) -> bool {
        self.min.is_finite() && self.max.is_finite()
    }

    /// Whether it holds nothing (not a number counts as nothing).
    pub fn is_empty(&self) -> bool {
        !(self.min.x <= self.max.x && self.min.y <= self.max.y && self.min.z <= self.max.z)
    }

    /// Whether a point is inside or on the border.
    #[inline]
    pub fn contains(&self, p: DVec3) -> bool {
        p.x >= self.min.x && p.x <= self.max.x && p.y >= self.min.y && p.y <= self.max.y && p.z >= self.min.z && p.z <= self.max.z
    }

    /// A little larger, so that rounding in surface points does not lead out of it.
    pub fn padded(self) -> Self {
        let pad = 1e-9 * self.min.map(finite).abs().max(self.max.map(finite).abs()) + 1e-12;
        Self { min: self.min - pad, max: self.max + pad }
    }

    /// The box of its image under a transform: exact for each axis on its own (Arvo 1990, "Transforming axis-aligned bounding boxes",
    /// Graphics Gems). Entries of a turn by 90° that are zero but for rounding do not make infinite sides spread.
    pub fn transformed(&self, m: &DAffine3) -> Self {
        if self.is_empty() {
            return Self::EMPTY;
        }
        let rows = m.matrix3.transpose();
        let mut out = Self { min: m.translation, max: m.translation };
        for (i, row) in [rows.x_axis, rows.y_axis, rows.z_axis].into_iter().enumerate() {
            let largest = row.abs().max_element();
            for j in 0..3 {
                if row[j].abs() <= 1e-14 * largest && !(self.min[j].is_finite() && self.max[j].is_finite()) {
                    continue;
                }
                let (a, b) = (product(row[j], self.min[j]), product(row[j], self.max[j]));
                out.min[i] += a.min(b);
                out.max[i] += a.max(b);
            }
        }
        // Sums of opposite infinities.
        for i in 0..3 {
            if out.min[i].is_nan() {
                out.min[i] = f64::NEG_INFINITY;
            }
            if out.max[i].is_nan() {
                out.max[i] = f64::INFINITY;
            }
        }
        out
    }

    /// The part of a line within the box and between `t_min` and `t_max`, given 1 / direction; `None` where there is none.
    #[inline]
    pub fn clip(&self, line: &Line, inverse: DVec3, t_min: f64, t_max: f64) -> Option<(f64, f64)> {
        let a = (self.min - line.o) * inverse;
        let b = (self.max - line.o) * inverse;
        let (mut near, mut far) = (t_min, t_max);
        for i in 0..3 {
            // A line within a side plane gives NaN, which neither comparison takes.
            let (lo, hi) = if inverse[i] < 0.0 { (b[i], a[i]) } else { (a[i], b[i]) };
            if lo > near {
                near = lo;
            }
            if hi < far {
                far = hi;
            }
        }
        (near <= far).then_some((near, far))
    }
}

/// Zero times infinity is zero here.
fn product(a: f64, b: f64) -> f64 {
    if a == 0.0 { 0.0 } else { a * b }
}

/// Infinite sides have no size.
fn finite(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    #[test]
    fn transform_of_infinite_boxes() {
        let slab = Bounds { min: DVec3::new(f64::NEG_INFINITY, -1.0, -2.0), max: DVec3::new(f64::INFINITY, 1.0, 2.0) };
        let turn = DAffine3::from_mat3(DMat3::from_cols(DVec3::new(6e-17, 1.0, 0.0), DVec3::new(-1.0, 6e-17, 0.0), DVec3::Z));
        let b = slab.transformed(&turn);
        assert!((b.min.x + 1.0).abs() < 1e-12 && (b.max.x - 1.0).abs() < 1e-12, "{b:?}");
        assert_eq!((b.min.y, b.max.y), (f64::NEG_INFINITY, f64::INFINITY));
        assert_eq!((b.min.z, b.max.z), (-2.0, 2.0));
    }

    #[test]
    fn lines_in_side_planes() {
        let b = Bounds::of(DVec3::ZERO, DVec3::ONE);
        let line = Line { o: DVec3::new(0.0, 0.5, -1.0), d: DVec3::Z };
        assert_eq!(b.clip(&line, line.d.recip(), 0.0, 10.0), Some((1.0, 2.0)));
        let off = Line { o: DVec3::new(-0.1, 0.5, -1.0), d: DVec3::Z };
        assert_eq!(b.clip(&off, off.d.recip(), 0.0, 10.0), None);
    }
}
