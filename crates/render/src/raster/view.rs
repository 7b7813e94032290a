//! What a z-buffer shows: where the eye is, where it looks, how many pixels.

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

use crate::math::Vec3;

/// A place to look from. Axes of any length and angles are allowed; distances are in units of `forward`, along it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The eye; for orthographic views a point of the plane from which distances count.
    pub eye: DVec3,
    /// To the right of the picture.
    pub right: DVec3,
    /// To the top of the picture.
    pub up: DVec3,
    /// Into the picture.
    pub forward: DVec3,
}

impl Pose {
    /// Looks from `eye` along `forward` (any length) with some axes across it.
    pub fn along(eye: Vec3, forward: Vec3) -> Self {
        let forward = forward.as_dvec3().normalize_or(DVec3::NEG_Z);
        let (right, up) = forward.any_orthonormal_pair();
        // Right × up points back to the eye.
        Self { eye: eye.as_dvec3(), right, up: if right.cross(up).dot(forward) > 0.0 { -up } else { up }, forward }
    }

    /// One of the six faces of a cube about `eye`: 0 to 5 look along +x, −x, +y, −y, +z, −z.
    pub fn cube_face(eye: Vec3, face: usize) -> Self {
        let axis = |i: usize| DVec3::from_array(std::array::from_fn(|k| if k == i % 3 { 1.0 } else { 0.0 }));
        let i = face / 2;
        let forward = if face.is_multiple_of(2) { axis(i) } else { -axis(i) };
        let up = axis(i + 1);
        Self { eye: eye.as_dvec3(), right: forward.cross(up), up, forward }
    }
}

/// A picture's projection: from points of the world to pixels and depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Columns and rows of pixels.
    pub size: [u32; 2],
    pose: Pose,
    /// Left, right, bottom and top edge, at distance 1 for perspective views.
    window: [f64; 4],
    perspective: bool,
    /// The smallest and the largest depth that is drawn.
    range: [f32; 2],
    /// Homogeneous pixel coordinates x·w, y·w and w as functions of a world point (x, y, z, 1).
    rows: [DVec4; 3],
    /// Distance along the axis.
    distance: DVec4,
    near: f64,
}

impl View {
    /// A perspective view. `window` is left, right, bottom, top of the picture on the plane at distance 1 (so a cube's face is
    /// [−1, 1, −1, 1]); `near` and `far` are distances along the axis, near > 0; far may be infinite. A near distance that is not
    /// positive counts as the smallest possible.
    pub fn perspective(pose: Pose, window: [f64; 4], size: [u32; 2], near: f64, far: f64) -> Self {
        let near = if near > 0.0 { near.clamp(1e-30, 1e30) } else { 1e-30 };
        let range = [if far > near { (1.0 / far) as f32 } else { f32::INFINITY }, (1.0 / near) as f32];
        Self::new(pose, window, size, true, range, near)
    }

    /// An orthographic view. `window` is in scene units about the eye; `near` and `far` are distances from the eye's plane, of any
    /// sign.
    pub fn orthographic(pose: Pose, window: [f64; 4], size: [u32; 2], near: f64, far: f64) -> Self {
        Self::new(pose, window, size, false, [-far as f32, -near as f32], near)
    }

    fn new(pose: Pose, window: [f64; 4], size: [u32; 2], perspective: bool, range: [f32; 2], near: f64) -> Self {
        let size = size.map(|n| n.clamp(1, 1 << 15));
        let view_from_world = DMat3::from_cols(pose.right, pose.up, pose.forward).inverse();
        let row = |i: usize| view_from_world.row(i).extend(-view_from_world.row(i).dot(pose.eye));
        let distance = row(2);
        let w = if perspective { distance } else { DVec4::W };
        let [l, r, b, t] = window;
        let (sx, sy) = (f64::from(size[0]) / (r - l), f64::from(size[1]) / (t - b));
        let rows = [(row(0) - w * l) * sx, (w * t - row(1)) * sy, w];
        Self { size, pose, window, perspective, range, rows, distance, near }
    }

    /// The same view with the picture moved: what was at the pixel's center is then at `offset` (in pixels) from it. For samples
    /// beside the centers.
    #[must_use]
    pub fn sampled_at(&self, offset: DVec2) -> Self {
        let [x, y, w] = self.rows;
        let [l, r, b, t] = self.window;
        let (dx, dy) = (offset.x * (r - l) / f64::from(self.size[0]), offset.y * (t - b) / f64::from(self.size[1]));
        Self { rows: [x - w * offset.x, y - w * offset.y, w], window: [l + dx, r + dx, b - dy, t - dy], ..*self }
    }

    /// Where the eye is and looks.
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Whether lines of sight meet in the eye.
    pub fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// Distance along the view's axis of a depth in an item buffer.
    #[inline]
    pub fn distance(&self, depth: f32) -> f32 {
        if self.perspective { 1.0 / depth } else { -depth }
    }

    /// The line of sight through a point of the picture (in pixels from the upper left corner): origin and direction. The direction
    /// of a perspective view has length 1 along the axis, that of an orthographic view is unit.
    pub fn line_of_sight(&self, pixel: DVec2) -> (DVec3, DVec3) {
        let [l, r, b, t] = self.window;
        let x = l + (r - l) * pixel.x / f64::from(self.size[0]);
        let y = t - (t - b) * pixel.y / f64::from(self.size[1]);
        let across = self.pose.right * x + self.pose.up * y;
        if self.perspective { (self.pose.eye, self.pose.forward + across) } else { (self.pose.eye + across, self.pose.forward) }
    }

    /// Where a world point is in the picture (pixels) and its distance along the axis; `None` behind the near plane of a
    /// perspective view.
    #[inline]
    pub fn project(&self, p: Vec3) -> Option<(DVec2, f64)> {
        let q = p.as_dvec3().extend(1.0);
        let w = self.rows[2].dot(q);
        let distance = self.distance.dot(q);
        let visible = !self.perspective || w >= self.near;
        visible.then(|| (DVec2::new(self.rows[0].dot(q), self.rows[1].dot(q)) / w, distance))
    }

    /// Size of a pixel, in scene units, at a distance along the axis.
    #[inline]
    pub fn pixel_size(&self, distance: f64) -> f64 {
        let width = (self.window[1] - self.window[0]).max(self.window[3] - self.window[2]) / f64::from(self.size[0].min(self.size[1]));
        if self.perspective { width * distance } else { width }
    }

    /// The projection after a transform of objects.
    pub(super) fn projection(&self, world_from_object: Option<DMat4>) -> Projection {
        // Depth of orthographic views is minus the distance; 1/w is that of a constant 1.
        let z = if self.perspective { DVec4::W } else { -self.distance };
        let [x, y, w] = self.rows;
        let rows = [x, y, w, z];
        let rows = match world_from_object {
            None => rows,
            Some(m) => rows.map(|r| m.transpose() * r),
        };
        Projection { rows, range: self.range, w_min: if self.perspective { self.near } else { 0.5 }, size: self.size }
    }
}

/// From points of an object's space to homogeneous pixel coordinates.
pub(super) struct Projection {
    /// x·w, y·w, w and depth·w.
    pub rows: [DVec4; 4],
    /// Depths that are drawn.
    pub range: [f32; 2],
    /// Points with a smaller w are not seen.
    pub w_min: f64,
    /// Pixels.
    pub size: [u32; 2],
}

impl Projection {
    /// x·w, y·w, w and depth·w of a point.
    #[inline]
    pub fn point(&self, p: Vec3) -> [f64; 4] {
        let p = p.as_dvec3();
        self.rows.map(|r| r.x * p.x + r.y * p.y + r.z * p.z + r.w)
    }
}
