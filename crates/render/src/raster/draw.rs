//! From triangles to an item buffer.

use rayon::prelude::*;

use super::tile::{self, TILE, Tile};
use super::triangles::{CHUNK, Mesh, Part, Triangles};
use super::view::{Projection, View};
use crate::math::Aabb;

/// The item of pixels where nothing is.
pub const NO_ITEM: u32 = u32::MAX;

/// Chunks that are set up before their triangles are filled: bounds memory.
const BATCH: usize = 512;
/// Triangle–tile pairs after which tiles are filled: bounds memory when all triangles are large.
const MAX_PAIRS: usize = 1 << 22;
/// Pixels and triangles up to which threads cost more than they bring.
const SMALL: (u32, u32) = (1 << 14, 1 << 13);

/// The nearest triangle of each pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ItemBuffer {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Number of the triangle, [`NO_ITEM`] where there is none; row by row from the top.
    pub items: Vec<u32>,
    /// Its depth: larger is nearer; see [`View::distance`].
    pub depth: Vec<f32>,
}

/// What is drawn and what is not.
#[derive(Clone, Copy, Default)]
pub struct DrawOptions<'a> {
    /// Leaves out whole objects, given the scene's placement and the object in its geometry.
    pub hides: Option<&'a (dyn Fn(u32, u32) -> bool + Sync)>,
    /// Decides, pixel by pixel, whether a triangle through which light may pass is there: number, column, row. Without it, it is.
    pub keeps: Option<&'a (dyn Fn(u32, u32, u32) -> bool + Sync)>,
}

impl ItemBuffer {
    /// Triangle and depth of a pixel; `None` where nothing is or the pixel is not in the picture.
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> Option<(u32, f32)> {
        if x >= self.width || y >= self.height {
            return None;
        }
        let i = y as usize * self.width as usize + x as usize;
        let item = self.items[i];
        (item != NO_ITEM).then(|| (item, self.depth[i]))
    }
}

/// A triangle ready to be filled. Edges are signed distances in pixels from it, positive inside.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setup {
    /// Number.
    pub id: u32,
    /// Whether it is asked pixel by pixel whether it is there.
    pub masked: bool,
    /// Whether a corner is at a pixel's center, where the signs of rounded edges may contradict each other: edges are inside then.
    pub closed: bool,
    /// First and last column, first and last row of pixel centers that it may cover.
    pub pixels: [u32; 4],
    /// a·x + b·y + c for each edge.
    pub edges: [[f64; 3]; 3],
    /// Depth as a·x + b·y + c.
    pub depth: [f64; 3],
    /// The range of its depths: rounding on steep triangles must not leave it.
    pub range: [f32; 2],
    /// What is beyond is not drawn.
    pub limits: [f32; 2],
}

/// Draws what a view shows.
pub fn draw(triangles: &Triangles, view: &View, options: &DrawOptions) -> ItemBuffer {
    let [width, height] = view.size;
    let (columns, rows) = (width.div_ceil(TILE as u32), height.div_ceil(TILE as u32));
    let mut tiles = vec![Tile::EMPTY; columns as usize * rows as usize];
    let visible = visible_chunks(triangles, view);
    let is_small = width * height <= SMALL.0 && visible.len() as u32 * CHUNK as u32 <= SMALL.1;
    let mut bins: Vec<Vec<u32>> = vec![Vec::new(); tiles.len()];
    for batch in visible.chunks(BATCH) {
        let set_up = |&(part, chunk): &(u32, u32)| set_up_chunk(triangles, view, options, part, chunk);
        let setups: Vec<Setup> =
            if is_small { batch.iter().flat_map(set_up).collect() } else { batch.par_iter().flat_map_iter(set_up).collect() };
        let mut pairs = 0;
        for (i, s) in setups.iter().enumerate() {
            let [x0, x1, y0, y1] = s.pixels.map(|v| v / TILE as u32);
            for ty in y0..=y1 {
                for tx in x0..=x1 {
                    bins[(ty * columns + tx) as usize].push(i as u32);
                }
            }
            pairs += (x1 - x0 + 1) as usize * (y1 - y0 + 1) as usize;
            if pairs > MAX_PAIRS || i + 1 == setups.len() {
                fill(&mut tiles, &mut bins, &setups, columns, options, is_small);
                pairs = 0;
            }
        }
    }
    untile(&tiles, width, height, columns)
}

fn fill(tiles: &mut [Tile], bins: &mut [Vec<u32>], setups: &[Setup], columns: u32, options: &DrawOptions, is_small: bool) {
    let fill = |(i, (tile, bin)): (usize, (&mut Tile, &mut Vec<u32>))| {
        let origin = [i as u32 % columns * TILE as u32, i as u32 / columns * TILE as u32];
        for &s in bin.iter() {
            tile::fill(tile, origin, &setups[s as usize], options);
        }
        bin.clear();
    };
    if is_small {
        tiles.iter_mut().zip(bins).enumerate().for_each(fill);
    } else {
        tiles.par_iter_mut().zip(bins).enumerate().for_each(fill);
    }
}

fn untile(tiles: &[Tile], width: u32, height: u32, columns: u32) -> ItemBuffer {
    let pixels = width as usize * height as usize;
    let (mut items, mut depth) = (Vec::with_capacity(pixels), Vec::with_capacity(pixels));
    for y in 0..height as usize {
        for tx in 0..columns as usize {
            let tile = &tiles[y / TILE * columns as usize + tx];
            let n = TILE.min(width as usize - tx * TILE);
            let at = y % TILE * TILE;
            items.extend_from_slice(&tile.items[at..at + n]);
            depth.extend_from_slice(&tile.depth[at..at + n]);
        }
    }
    ItemBuffer { width, height, items, depth }
}

/// Part and number of each chunk that may be in the picture.
fn visible_chunks(triangles: &Triangles, view: &View) -> Vec<(u32, u32)> {
    let mut visible = Vec::new();
    for (p, part) in triangles.parts.iter().enumerate() {
        let projection = view.projection(part.world_from_object);
        let mesh = &triangles.meshes[part.mesh as usize];
        visible.extend((0..mesh.chunks.len()).filter(|&c| may_show(&projection, &mesh.chunks[c])).map(|c| (p as u32, c as u32)));
    }
    visible
}

/// False where all corners of a box are beyond one side of the picture.
fn may_show(projection: &Projection, bounds: &Aabb) -> bool {
    if !(bounds.min.is_finite() && bounds.max.is_finite()) {
        return true;
    }
    let [w, h] = projection.size.map(f64::from);
    let mut outside = [true; 6];
    for i in 0..8 {
        let corner = crate::math::Vec3::from_array(std::array::from_fn(|k| if i >> k & 1 == 0 { bounds.min[k] } else { bounds.max[k] }));
        let [x, y, pw, z] = projection.point(corner);
        let far = z < f64::from(projection.range[0]) * pw;
        let beyond = [x < 0.0, y < 0.0, x > w * pw, y > h * pw, pw < projection.w_min, far];
        for (all, one) in outside.iter_mut().zip(beyond) {
            *all &= one;
        }
    }
    !outside.contains(&true)
}

fn set_up_chunk(triangles: &Triangles, view: &View, options: &DrawOptions, part: u32, chunk: u32) -> Vec<Setup> {
    let part: &Part = &triangles.parts[part as usize];
    let mesh: &Mesh = &triangles.meshes[part.mesh as usize];
    let projection = view.projection(part.world_from_object);
    let begin = chunk as usize * CHUNK;
    let end = (begin + CHUNK).min(mesh.triangles.len());
    let is_hidden = |t: usize| options.hides.is_some_and(|hides| hides(part.instance, mesh.object(t)));
    (begin..end)
        .filter(|&t| !is_hidden(t))
        .filter_map(|t| {
            let v = mesh.corners(t)?.map(|p| projection.point(p));
            set_up(&projection, &v, part.first + t as u32, options.keeps.is_some() && mesh.is_masked(t))
        })
        .collect()
}

/// The point between `a` and `b` where w is `w`.
fn cut(a: &[f64; 4], b: &[f64; 4], w: f64) -> [f64; 4] {
    let t = (w - a[2]) / (b[2] - a[2]);
    std::array::from_fn(|k| if k == 2 { w } else { a[k] + (b[k] - a[k]) * t })
}

/// The box of a triangle's visible part in pixels and the range of its depths; `None` where nothing of it is visible.
fn extent(projection: &Projection, v: &[[f64; 4]; 3]) -> Option<([f64; 4], [f64; 2])> {
    let mut sides = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    let mut grow = |p: &[f64; 4]| {
        let [x, y, z] = [p[0] / p[2], p[1] / p[2], p[3] / p[2]];
        sides = [sides[0].min(x), sides[1].max(x), sides[2].min(y), sides[3].max(y)];
        range = [range[0].min(z), range[1].max(z)];
    };
    let w = projection.w_min;
    for i in 0..3 {
        let (a, b) = (&v[i], &v[(i + 1) % 3]);
        if a[2] >= w {
            grow(a);
        }
        if (a[2] >= w) != (b[2] >= w) {
            grow(&cut(a, b, w));
        }
    }
    (sides[0] <= sides[1] && sides[2] <= sides[3]).then_some((sides, range))
}

/// Prepares a triangle in homogeneous pixel coordinates; `None` where it covers no pixel center.
pub(super) fn set_up(projection: &Projection, v: &[[f64; 4]; 3], id: u32, masked: bool) -> Option<Setup> {
    if !v.iter().flatten().all(|c| c.is_finite()) {
        return None;
    }
    let (sides, range) = extent(projection, v)?;
    // A little more than the box, for its rounding; the edges decide.
    const PAD: f64 = 1e-3;
    let first = |lo: f64| (lo - 0.5 - PAD).ceil().max(0.0);
    let last = |hi: f64, n: u32| (hi - 0.5 + PAD).floor().min(f64::from(n) - 1.0);
    let (x0, x1) = (first(sides[0]), last(sides[1], projection.size[0]));
    let (y0, y1) = (first(sides[2]), last(sides[3], projection.size[1]));
    if !(x0 <= x1 && y0 <= y1) {
        return None;
    }
    // The plane through the eye and an edge: exactly odd when the ends are exchanged.
    let cross = |a: &[f64; 4], b: &[f64; 4]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let raw = [cross(&v[1], &v[2]), cross(&v[2], &v[0]), cross(&v[0], &v[1])];
    let det = v[0][0] * raw[0][0] + v[0][1] * raw[0][1] + v[0][2] * raw[0][2];
    if !(det != 0.0 && det.is_finite()) {
        return None;
    }
    let depth: [f64; 3] = std::array::from_fn(|k| (v[0][3] * raw[0][k] + v[1][3] * raw[1][k] + v[2][3] * raw[2][k]) / det);
    let mut edges = raw;
    for e in &mut edges {
        let length = if e[0] == 0.0 && e[1] == 0.0 { e[2].abs() } else { e[0].abs() + e[1].abs() };
        let scale = length.copysign(det);
        *e = e.map(|c| c / scale);
    }
    if !edges.iter().flatten().chain(&depth).all(|c| c.is_finite()) {
        return None;
    }
    // Depths of what reaches through the near plane are limited by that alone.
    let crosses = v.iter().any(|p| p[2] < projection.w_min);
    let range = [range[0] as f32, if crosses { f32::INFINITY } else { range[1] as f32 }];
    // Nearer than rounding in the tiles can tell.
    let near_center = |c: f64| (c - c.floor() - 0.5).abs() < 1e-5;
    let closed = v.iter().any(|p| near_center(p[0] / p[2]) && near_center(p[1] / p[2]));
    let pixels = [x0 as u32, x1 as u32, y0 as u32, y1 as u32];
    Some(Setup { id, masked, closed, pixels, edges, depth, range, limits: projection.range })
}
