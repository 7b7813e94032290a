//! Axis-aligned bounding boxes.

use glam::Vec3;

/// An axis-aligned box; empty where a minimum exceeds its maximum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Aabb {
    /// The box that holds nothing; the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box that holds the points.
    pub fn from_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| b.grow(p))
    }

    /// The smallest box that holds this one and a point.
    #[inline]
    pub fn grow(self, p: Vec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The smallest box that holds both.
    #[inline]
    pub fn union(self, o: Self) -> Self {
        Self { min: self.min.min(o.min), max: self.max.max(o.max) }
    }

    /// The box of the points that both hold; may be empty.
    #[inline]
    pub fn intersection(self, o: Self) -> Self {
        Self { min: self.min.max(o.min), max: self.max.min(o.max) }
    }

    /// True where the box holds no point.
    #[inline]
    pub fn is_empty(self) -> bool {
        !(self.min.x <= self.max.x && self.min.y <= self.max.y && self.min.z <= self.max.z)
    }

    /// The middle of the box.
    #[inline]
    pub fn center(self) -> Vec3 {
        (self.min + self.max) * 0.5
    }

    /// The edge lengths; negative where empty.
    #[inline]
    pub fn extent(self) -> Vec3 {
        self.max - self.min
    }

    /// Half of the surface area, zero where empty.
    #[inline]
    pub fn half_area(self) -> f32 {
        let e = self.extent().max(Vec3::ZERO);
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    /// The box of this box's corners under a transform.
    pub fn transformed(self, m: glam::Mat4) -> Self {
        if self.is_empty() {
            return self;
        }
        Self::from_points((0..8).map(|i| {
            let pick = |bit: u32, a: f32, b: f32| if i >> bit & 1 == 0 { a } else { b };
            m.transform_point3(Vec3::new(pick(0, self.min.x, self.max.x), pick(1, self.min.y, self.max.y), pick(2, self.min.z, self.max.z)))
        }))
    }

    /// Center and radius of a sphere that holds the box.
    pub fn bounding_sphere(self) -> (Vec3, f32) {
        if self.is_empty() { (Vec3::ZERO, 0.0) } else { (self.center(), self.extent().length() * 0.5) }
    }
}
