//! Orthonormal frames.

use glam::Vec3;

/// A right-handed orthonormal frame; `n` is the local z axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Local x axis in world space, unit.
    pub s: Vec3,
    /// Local y axis in world space, unit.
    pub t: Vec3,
    /// Local z axis in world space, unit.
    pub n: Vec3,
}

impl Frame {
    /// The frame about a unit normal with arbitrary tangents (Duff et al. 2017, "Building an Orthonormal
    /// Basis, Revisited", JCGT 6(1), listing 3).
    #[inline]
    pub fn from_normal(n: Vec3) -> Self {
        let sign = 1.0f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self { s: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), t: Vec3::new(b, sign + n.y * n.y * a, -n.y), n }
    }

    /// The frame about a unit normal whose `s` follows `tangent` (any length, made perpendicular). Falls back to
    /// [`Frame::from_normal`] where the tangent is zero, not finite or parallel to the normal.
    #[inline]
    pub fn from_normal_tangent(n: Vec3, tangent: Vec3) -> Self {
        let s = tangent - n * n.dot(tangent);
        let len2 = s.length_squared();
        if !(len2 > 1e-12 * tangent.length_squared() && len2.is_finite()) {
            return Self::from_normal(n);
        }
        let s = s / len2.sqrt();
        Self { s, t: n.cross(s), n }
    }

    /// A world-space direction in the frame's coordinates.
    #[inline]
    pub fn local_from_world(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }

    /// A direction of the frame's coordinates in world space.
    #[inline]
    pub fn world_from_local(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_and_right_handed() {
        for n in [Vec3::Z, -Vec3::Z, Vec3::X, Vec3::new(0.6, 0.0, -0.8), Vec3::new(0.36, 0.48, 0.8)] {
            for f in [Frame::from_normal(n), Frame::from_normal_tangent(n, Vec3::new(0.3, 2.0, 0.1)), Frame::from_normal_tangent(n, n)] {
                assert!((f.s.cross(f.t) - f.n).length() < 1e-5, "{f:?}");
                assert!(f.s.dot(f.t).abs() < 1e-6 && (f.s.length() - 1.0).abs() < 1e-5);
                let v = Vec3::new(0.1, -0.7, 0.4);
                assert!((f.world_from_local(f.local_from_world(v)) - v).length() < 1e-5);
            }
        }
    }
}
