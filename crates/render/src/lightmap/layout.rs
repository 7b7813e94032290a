//! Texels: which point of which surface each texel of the atlases stands for.

use rayon::prelude::*;

use super::charts::{self, Chart};
use super::flatten::Flat;
use super::pack::{self, Packing, Place};
use super::{BakeError, BakeOptions};
use crate::math::Vec2;

/// Most texels that are baked at once.
const TEXEL_LIMIT: usize = 1 << 26;
/// Points on the rim of a chart move this far inwards, in texels: at the rim itself begins the next wall.
const INSET: f32 = 0.05;

/// A side of a shape that gets light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Side {
    /// Index in the flat scene's shapes.
    pub shape: u32,
    /// The side that the normals point away from.
    pub back: bool,
}

/// A chart and where it lies.
#[derive(Clone, Debug)]
pub struct PlacedChart {
    /// Index in [`Layout::sides`].
    pub side: u32,
    /// The piece of surface.
    pub chart: Chart,
    /// Its place.
    pub place: Place,
}

impl PlacedChart {
    /// The corners of a triangle of the chart in texels of its atlas: x to the right, y down, (0, 0) the outer corner of the first texel.
    pub fn corners(&self, triangle: u32) -> [Vec2; 3] {
        let p = &self.place;
        let o = Vec2::new(p.origin[0] as f32, p.origin[1] as f32);
        self.chart.corners[triangle as usize].map(|c| o + c * p.scale)
    }
}

/// A texel that lies on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Atlas.
    pub atlas: u32,
    /// Column and row.
    pub at: [u32; 2],
    /// Index in [`Layout::charts`].
    pub chart: u32,
    /// Triangle of the chart that is nearest to the texel's center.
    pub triangle: u32,
    /// The point of it: weights of its second and third corner.
    pub bary: Vec2,
    /// Triangles of the chart that the texel touches: start and number in [`Layout::touching`].
    pub touching: [u32; 2],
}

/// All charts and texels.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Sides of shapes.
    pub sides: Vec<Side>,
    /// Charts.
    pub charts: Vec<PlacedChart>,
    /// Atlases.
    pub packing: Packing,
    /// Texels, chart by chart.
    pub texels: Vec<Texel>,
    /// Triangles of charts, see [`Texel::touching`].
    pub touching: Vec<u32>,
    /// Shapes whose own second set of texture coordinates is kept.
    pub kept: usize,
}

impl Layout {
    /// Unwraps and packs everything that is to be baked, and finds the texels.
    ///
    /// # Errors
    /// [`BakeError::Setting`] where the settings ask for too many texels.
    pub fn new(flat: &Flat, options: &BakeOptions) -> Result<Self, BakeError> {
        let shapes: Vec<(usize, bool, Vec<Chart>)> = (0..flat.shapes.len())
            .into_par_iter()
            .filter(|i| flat.shapes[*i].bake != [false; 2])
            .map(|i| {
                let mesh = flat.mesh(i);
                let own = if options.unwrap { None } else { second_uvs(mesh).and_then(|uvs| charts::existing(mesh, &uvs)) };
                let is_own = own.is_some();
                (i, is_own, own.map_or_else(|| charts::unwrap(mesh, &flat.shapes[i].topology), |c| vec![c]))
            })
            .collect();
        let kept = shapes.iter().filter(|s| s.1).count();
        let (mut sides, mut list) = (Vec::new(), Vec::new());
        for (shape, _, charts) in shapes {
            for back in [false, true].into_iter().filter(|back| flat.shapes[shape].bake[usize::from(*back)]) {
                list.extend(charts.iter().map(|c| (sides.len() as u32, c.clone())));
                sides.push(Side { shape: shape as u32, back });
            }
        }
        let sizes: Vec<Vec2> = list.iter().map(|(_, c)| c.size).collect();
        let packing = pack::pack(&sizes, options.texels_per_meter, options.resolution, options.padding).map_err(BakeError::Setting)?;
        let covered: usize = packing.places.iter().map(|p| p.texels[0] as usize * p.texels[1] as usize).sum();
        if covered > TEXEL_LIMIT {
            return Err(BakeError::Setting(format!("{covered} texels are too many to bake at once; {TEXEL_LIMIT} are the most")));
        }
        let charts: Vec<PlacedChart> =
            list.into_iter().zip(&packing.places).map(|((side, chart), place)| PlacedChart { side, chart, place: *place }).collect();
        let parts: Vec<_> = charts.par_iter().enumerate().map(|(i, c)| rasterize(i as u32, c)).collect();
        let (mut texels, mut touching) = (Vec::new(), Vec::new());
        for (part, lists) in parts {
            let first = touching.len() as u32;
            texels.extend(part.into_iter().map(|t: Texel| Texel { touching: [t.touching[0] + first, t.touching[1]], ..t }));
            touching.extend(lists);
        }
        Ok(Self { sides, charts, packing, texels, touching, kept })
    }

    /// The point of a texel's surface at an offset from the texel's center in texels; `None` where there is no surface.
    pub fn locate(&self, texel: &Texel, offset: Vec2) -> Option<(u32, Vec2)> {
        let chart = &self.charts[texel.chart as usize];
        let p = Vec2::new(texel.at[0] as f32 + 0.5, texel.at[1] as f32 + 0.5) + offset;
        let [first, count] = texel.touching.map(|v| v as usize);
        self.touching[first..first + count].iter().find_map(|&t| {
            let b = barycentric(&chart.corners(t), p)?;
            (b.min_element() >= 0.0 && b.x + b.y <= 1.0).then_some((t, b))
        })
    }
}

/// The second set of texture coordinates.
fn second_uvs(mesh: &etendue_scene::desc::MeshData) -> Option<Vec<Vec2>> {
    let a = mesh.attributes.iter().find(|a| a.name == "uv1" && a.width == 2 && !a.per_face)?;
    // Rows of the atlas run down.
    Some(a.data.chunks_exact(2).map(|c| Vec2::new(c[0], 1.0 - c[1])).collect())
}

/// Weights of the second and third corner; `None` for triangles without area.
pub fn barycentric(c: &[Vec2; 3], p: Vec2) -> Option<Vec2> {
    let (e1, e2, d) = ((c[1] - c[0]).as_dvec2(), (c[2] - c[0]).as_dvec2(), (p - c[0]).as_dvec2());
    let det = e1.perp_dot(e2);
    let b = glam::DVec2::new(d.perp_dot(e2), e1.perp_dot(d)) / det;
    b.is_finite().then(|| b.as_vec2())
}

/// The point of a triangle that is nearest to `p`.
fn nearest(c: &[Vec2; 3], p: Vec2) -> Vec2 {
    if let Some(b) = barycentric(c, p)
        && b.min_element() >= 0.0
        && b.x + b.y <= 1.0
    {
        return p;
    }
    let on_edge = |k: usize| {
        let (a, e) = (c[k], c[(k + 1) % 3] - c[k]);
        let t = ((p - a).dot(e) / e.length_squared()).clamp(0.0, 1.0);
        if t.is_finite() { a + e * t } else { a }
    };
    let mut best = on_edge(0);
    for q in [on_edge(1), on_edge(2)] {
        if q.distance_squared(p) < best.distance_squared(p) {
            best = q;
        }
    }
    best
}

/// The texels of a chart (conservatively: also those that it only touches) and lists of the triangles that they touch.
fn rasterize(index: u32, chart: &PlacedChart) -> (Vec<Texel>, Vec<u32>) {
    let (o, [w, h]) = (chart.place.origin, chart.place.texels);
    // (cell, triangle) of all contacts, and the best contact of each cell.
    let mut contacts: Vec<(u32, u32)> = Vec::new();
    let mut best = vec![(f32::INFINITY, 0u32, Vec2::ZERO); w as usize * h as usize];
    for t in 0..chart.chart.triangles.len() as u32 {
        let corners = chart.corners(t).map(|c| c - Vec2::new(o[0] as f32, o[1] as f32));
        let (min, max) = corners.iter().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        let range = |lo: f32, hi: f32, n: u32| (lo.max(0.0) as u32).min(n - 1)..=(hi.max(0.0) as u32).min(n - 1);
        for y in range(min.y, max.y, h) {
            for x in range(min.x, max.x, w) {
                let center = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let q = nearest(&corners, center);
                let distance = q.distance_squared(center);
                // Half of a texel's diagonal; a chart of one texel keeps it whatever its shape.
                if distance > 0.5 && w * h > 1 {
                    continue;
                }
                let cell = y * w + x;
                contacts.push((cell, t));
                if distance < best[cell as usize].0 {
                    best[cell as usize] = (distance, t, q);
                }
            }
        }
    }
    contacts.sort_unstable();
    let (mut texels, mut lists) = (Vec::new(), Vec::with_capacity(contacts.len()));
    for run in contacts.chunk_by(|a, b| a.0 == b.0) {
        let cell = run[0].0;
        let (distance, triangle, q) = best[cell as usize];
        let corners = chart.corners(triangle).map(|c| c - Vec2::new(o[0] as f32, o[1] as f32));
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let to_middle = middle - q;
        let inward = if distance > 0.0 { to_middle * (INSET / to_middle.length().max(2.0 * INSET)) } else { Vec2::ZERO };
        let b = barycentric(&corners, q + inward).unwrap_or(Vec2::splat(1.0 / 3.0)).clamp(Vec2::ZERO, Vec2::ONE);
        let bary = if b.x + b.y > 1.0 { b / (b.x + b.y) } else { b };
        texels.push(Texel {
            atlas: chart.place.atlas,
            at: [o[0] + cell % w, o[1] + cell / w],
            chart: index,
            triangle,
            bary,
            touching: [lists.len() as u32, run.len() as u32],
        });
        lists.extend(run.iter().map(|c| c.1));
    }
    (texels, lists)
}
