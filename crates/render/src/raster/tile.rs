//! The inner loops: one triangle in one tile.
//!
//! Rows are set up in double precision, lanes of eight pixels are tested in single precision relative to the row's start: within a
//! tile that loses about 10⁻⁶ of a pixel, and stays exactly odd under exchange of an edge's ends. The loops over lanes have no
//! branches and fixed bounds, so that the compiler makes vector instructions of them.

use super::draw::{DrawOptions, NO_ITEM, Setup};

/// Edge of a tile in pixels.
pub(super) const TILE: usize = 32;
/// Pixels tested at once.
const LANES: usize = 8;

/// A square of the picture.
#[derive(Clone)]
pub(super) struct Tile {
    pub depth: [f32; TILE * TILE],
    pub items: [u32; TILE * TILE],
    /// No pixel of the tile has a smaller depth.
    farthest: f32,
}

impl Tile {
    pub const EMPTY: Self = Self { depth: [f32::NEG_INFINITY; TILE * TILE], items: [NO_ITEM; TILE * TILE], farthest: f32::NEG_INFINITY };
}

/// A linear function of the picture's pixel centers, from the corner of a tile on.
#[derive(Clone, Copy)]
struct Linear {
    dx: f32,
    dy: f64,
    start: f64,
}

impl Linear {
    fn new([a, b, c]: [f64; 3], origin: [u32; 2]) -> Self {
        let (x, y) = (f64::from(origin[0]) + 0.5, f64::from(origin[1]) + 0.5);
        Self { dx: a as f32, dy: b, start: a * x + b * y + c }
    }

    #[inline]
    fn row(&self, y: usize) -> f32 {
        (self.start + self.dy * y as f64) as f32
    }

    /// The smallest and the largest value in the tile.
    fn range(&self) -> [f64; 2] {
        let n = (TILE - 1) as f64;
        let (x, y) = (f64::from(self.dx) * n, self.dy * n);
        [self.start + x.min(0.0) + y.min(0.0), self.start + x.max(0.0) + y.max(0.0)]
    }
}

/// Draws a triangle in the tile whose upper left pixel is `origin`.
pub(super) fn fill(tile: &mut Tile, origin: [u32; 2], s: &Setup, options: &DrawOptions) {
    if s.range[1] <= tile.farthest {
        return;
    }
    let edges = s.edges.map(|e| Linear::new(e, origin));
    if edges.iter().any(|e| e.range()[1] < -1e-3) {
        return;
    }
    let covers = edges.iter().all(|e| e.range()[0] > 1e-3);
    let depth = Linear::new(s.depth, origin);
    // The smallest positive number excludes pixels exactly on an edge, of which the left and the top ones belong to the triangle.
    let least = s.edges.map(|[a, b, _]| match s.closed {
        true => -1e-5,
        false if a > 0.0 || (a == 0.0 && b > 0.0) => 0.0,
        false => f32::from_bits(1),
    });
    let [x0, x1, y0, y1] = s.pixels;
    let local = |v: u32, o: u32| (v.max(o) - o).min(TILE as u32 - 1) as usize;
    let (x0, x1, y0, y1) = (local(x0, origin[0]), local(x1, origin[0]), local(y0, origin[1]), local(y1, origin[1]));
    for y in y0..=y1 {
        let rows = edges.map(|e| e.row(y));
        let depth_row = depth.row(y);
        for first in (x0 / LANES * LANES..=x1).step_by(LANES) {
            let at = y * TILE + first;
            let Some(depths) = tile.depth[at..].first_chunk_mut::<LANES>() else { break };
            let Some(items) = tile.items[at..].first_chunk_mut::<LANES>() else { break };
            let mut z = [0.0f32; LANES];
            let mut wins = [false; LANES];
            for l in 0..LANES {
                let x = (first + l) as f32;
                // Not `clamp`, which checks its bounds.
                let d = (depth_row + depth.dx * x).max(s.range[0]).min(s.range[1]);
                let inside = (rows[0] + edges[0].dx * x >= least[0])
                    & (rows[1] + edges[1].dx * x >= least[1])
                    & (rows[2] + edges[2].dx * x >= least[2]);
                z[l] = d;
                wins[l] = inside & (d > depths[l]) & (d >= s.limits[0]) & (d <= s.limits[1]);
            }
            if s.masked {
                for (l, wins) in wins.iter_mut().enumerate() {
                    let [x, y] = [origin[0] + (first + l) as u32, origin[1] + y as u32];
                    *wins = *wins && options.keeps.is_none_or(|keeps| keeps(s.id, x, y));
                }
            }
            for l in 0..LANES {
                depths[l] = if wins[l] { z[l] } else { depths[l] };
                items[l] = if wins[l] { s.id } else { items[l] };
            }
        }
    }
    if covers && !s.masked {
        tile.farthest = tile.depth.iter().fold(f32::INFINITY, |least, d| if *d < least { *d } else { least });
    }
}
