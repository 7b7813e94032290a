//! Form factors by the hemicube (Cohen and Greenberg 1985, "The Hemi-Cube: A Radiosity Solution for Complex Environments",
//! doi:10.1145/325334.325171).
//!
//! All items are drawn onto the five sides of half a cube about a point, with a z-buffer; each pixel has a known factor, and an item's
//! factor is the sum over the pixels that it wins. The error is that of the pixels: items of few pixels have large ones, and the whole
//! of a patch is represented by its middle.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::mesh::Mesh;
use crate::math::Frame;

/// Something to draw.
#[derive(Clone, Copy, Debug)]
pub struct Item {
    /// Corners, counter-clockwise seen from the side that counts.
    pub corners: [Vec3; 3],
    /// Whose factor the pixels count for; [`NO_ITEM`] only hides others.
    pub item: u32,
    /// Whether its back hides what is behind; not so where another item is the back.
    pub back_hides: bool,
}

/// No item.
pub const NO_ITEM: u32 = u32::MAX;

/// A picture of items with a z-buffer.
pub trait ItemBuffer {
    /// Draws triangles into an empty buffer of `width` × `height` pixels, through a projection from world to clip space
    /// (x, y in [−w, w] are the picture from left to right and from bottom to top, z in [0, w] is from near to far). Returns the item
    /// of each pixel, row by row from the top; [`NO_ITEM`] where nothing is, or the back of something.
    fn draw(&self, width: u32, height: u32, clip_from_world: glam::Mat4, items: &[Item]) -> Vec<u32>;
}

/// A rasterizer without frills: homogeneous clipping at the near plane, edge functions at pixel middles, depth linear in the
/// picture. A triangle's back hides what is behind it and counts for nobody.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlainBuffer;

impl ItemBuffer for PlainBuffer {
    fn draw(&self, width: u32, height: u32, clip_from_world: glam::Mat4, items: &[Item]) -> Vec<u32> {
        let count = (width * height) as usize;
        let (mut owner, mut depth) = (vec![NO_ITEM; count], vec![f32::INFINITY; count]);
        for item in items {
            let clip = item.corners.map(|c| clip_from_world * c.extend(1.0));
            let outside = |f: fn(&Vec4) -> bool| clip.iter().all(f);
            if outside(|c| c.x > c.w)
                || outside(|c| c.x < -c.w)
                || outside(|c| c.y > c.w)
                || outside(|c| c.y < -c.w)
                || outside(|c| c.z < 0.0)
            {
                continue;
            }
            // The part in front of the near plane has three or four corners.
            let mut kept = arrayvec::ArrayVec::<Vec4, 4>::new();
            for i in 0..3 {
                let (a, b) = (clip[i], clip[(i + 1) % 3]);
                if a.z >= 0.0 {
                    let _ = kept.try_push(a);
                }
                if (a.z > 0.0 && b.z < 0.0) || (a.z < 0.0 && b.z > 0.0) {
                    let _ = kept.try_push(a + (b - a) * (a.z / (a.z - b.z)));
                }
            }
            let screen: arrayvec::ArrayVec<Vec3, 4> = kept
                .iter()
                .filter(|c| c.w > 0.0)
                .map(|c| Vec3::new((0.5 + 0.5 * c.x / c.w) * width as f32, (0.5 - 0.5 * c.y / c.w) * height as f32, c.z / c.w))
                .collect();
            for i in 1..screen.len().saturating_sub(1) {
                fill(&mut owner, &mut depth, [width, height], [screen[0], screen[i], screen[i + 1]], item);
            }
        }
        owner
    }
}

/// Draws a triangle of the picture; x to the right and y down in pixels, z the depth.
fn fill(owner: &mut [u32], depth: &mut [f32], [width, height]: [u32; 2], c: [Vec3; 3], item: &Item) {
    let edge = |a: Vec3, b: Vec3, x: f32, y: f32| f64::from(b.x - a.x) * f64::from(y - a.y) - f64::from(b.y - a.y) * f64::from(x - a.x);
    let area = edge(c[0], c[1], c[2].x, c[2].y);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    // Rows run down, so that what is counter-clockwise in the world has a negative area here.
    if area > 0.0 && !item.back_hides {
        return;
    }
    let item = if area < 0.0 { item.item } else { NO_ITEM };
    let range = |lo: f32, hi: f32, n: u32| {
        let lo = (lo - 0.5).ceil().max(0.0);
        let hi = (hi - 0.5).floor().min(n as f32 - 1.0);
        if lo <= hi { lo as u32..hi as u32 + 1 } else { 0..0 }
    };
    let [x0, y0, x1, y1] = c.iter().fold([f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY], |[a, b, d, e], p| {
        [a.min(p.x), b.min(p.y), d.max(p.x), e.max(p.y)]
    });
    let is_top_left = |a: Vec3, b: Vec3| {
        let (a, b) = if area < 0.0 { (b, a) } else { (a, b) };
        (a.y == b.y && b.x > a.x) || b.y < a.y
    };
    let rule = [is_top_left(c[1], c[2]), is_top_left(c[2], c[0]), is_top_left(c[0], c[1])];
    for y in range(y0, y1, height) {
        for x in range(x0, x1, width) {
            let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
            let w = [edge(c[1], c[2], px, py) / area, edge(c[2], c[0], px, py) / area, edge(c[0], c[1], px, py) / area];
            // A pixel on an edge belongs to one of the two triangles.
            if (0..3).any(|i| w[i] < 0.0 || (w[i] == 0.0 && !rule[i])) {
                continue;
            }
            let z = (w[0] * f64::from(c[0].z) + w[1] * f64::from(c[1].z) + w[2] * f64::from(c[2].z)) as f32;
            let at = (y * width + x) as usize;
            if z < depth[at] {
                depth[at] = z;
                owner[at] = item;
            }
        }
    }
}

/// A hemicube of a resolution with its pixels' factors.
#[derive(Clone, Debug)]
pub struct Hemicube {
    size: u32,
    /// Factors of the top's pixels, row by row.
    top: Vec<f32>,
    /// Factors of a side's, of which only the upper half exists; row by row from the top.
    side: Vec<f32>,
}

impl Hemicube {
    /// With `size` × `size` pixels on top; even, at least 2.
    pub fn new(size: u32) -> Self {
        let size = (size.clamp(2, 4096) + 1) & !1;
        // A pixel's own factor is that of its rectangle, exact: differences of the closed form of a rectangle seen from a point below a
        // corner of it, rather than the paper's values at pixel middles.
        let n = size as usize;
        let edge = |i: usize| -1.0 + 2.0 * i as f64 / n as f64;
        let parallel = |x: f64, y: f64| {
            let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
            (x / rx * libm::atan(y / rx) + y / ry * libm::atan(x / ry)) / std::f64::consts::TAU
        };
        // The plane x = 1 over y from 0 and z from 0, seen by a horizontal surface at the origin.
        let perpendicular = |y: f64, z: f64| {
            let r = (1.0 + z * z).sqrt();
            (libm::atan(y) - libm::atan(y / r) / r) / std::f64::consts::TAU
        };
        let cell = |f: &dyn Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2]| {
            (f(x[1], y[1]) - f(x[0], y[1]) - f(x[1], y[0]) + f(x[0], y[0])).abs() as f32
        };
        let mut top = Vec::with_capacity(n * n);
        for j in 0..n {
            for i in 0..n {
                top.push(cell(&parallel, [edge(i), edge(i + 1)], [edge(j), edge(j + 1)]));
            }
        }
        let mut side = Vec::with_capacity(n * n / 2);
        for j in 0..n / 2 {
            for i in 0..n {
                side.push(cell(&perpendicular, [edge(i), edge(i + 1)], [-edge(j + 1), -edge(j)]));
            }
        }
        Self { size, top, side }
    }

    /// The sum of all pixels' factors: 1 up to rounding.
    pub fn total(&self) -> f64 {
        let sum = |v: &[f32]| v.iter().map(|&f| f64::from(f)).sum::<f64>();
        sum(&self.top) + 4.0 * sum(&self.side)
    }

    /// Adds the factors of items seen from `p` with the unit normal `n` to `out`, by [`Item::item`].
    pub fn factors(&self, p: Vec3, n: Vec3, items: &[Item], out: &mut [f32]) {
        self.factors_with(&PlainBuffer, p, n, items, out);
    }

    /// The same with another rasterizer.
    pub fn factors_with(&self, buffer: &(impl ItemBuffer + Sync), p: Vec3, n: Vec3, items: &[Item], out: &mut [f32]) {
        let frame = Frame::from_normal(n);
        let far = items.iter().flat_map(|i| i.corners).map(|c| (c - p).length()).fold(0.0f32, f32::max) * 1.01;
        if !(far > 0.0 && far.is_finite()) {
            return;
        }
        let near = far * 1e-5;
        // Each side: where it looks to, and what is up there.
        let views = [(frame.n, frame.t), (frame.s, frame.n), (-frame.s, frame.n), (frame.t, frame.n), (-frame.t, frame.n)];
        let size = self.size;
        let pictures: Vec<Vec<u32>> = views
            .par_iter()
            .map(|&(forward, up)| {
                let right = forward.cross(up);
                let world = glam::Mat4::from_cols(right.extend(0.0), up.extend(0.0), forward.extend(0.0), p.extend(1.0));
                // 90° wide: x and y are divided by the distance ahead.
                let (a, b) = (far / (far - near), -far * near / (far - near));
                let projection = glam::Mat4::from_cols(Vec4::X, Vec4::Y, Vec4::new(0.0, 0.0, a, 1.0), Vec4::new(0.0, 0.0, b, 0.0));
                buffer.draw(size, size, projection * world.inverse(), items)
            })
            .collect();
        for (k, picture) in pictures.iter().enumerate() {
            let factors = if k == 0 { &self.top } else { &self.side };
            for (&item, f) in picture.iter().zip(factors) {
                if let Some(sum) = out.get_mut(item as usize) {
                    *sum += f;
                }
            }
        }
    }
}

/// The leaves of a mesh as items; each counts for its place in `leaves`. Faces that have one side hide by their back.
pub fn items(mesh: &Mesh, leaves: &[u32]) -> Vec<Item> {
    let item = |(i, &leaf): (usize, &u32)| {
        let node = &mesh.nodes[leaf as usize];
        Item { corners: node.corners, item: i as u32, back_hides: !mesh.faces.has_both_sides(node.face) }
    };
    leaves.iter().enumerate().map(item).collect()
}
