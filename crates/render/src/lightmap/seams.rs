//! Seams: values on both sides of a cut through a smooth surface are made to agree.
//!
//! Along a cut two charts hold the same light twice, sampled at other texels, and bilinear interpolation shows the difference as a line.
//! The texels beside cuts are moved as little as needed, in the sense of least squares, for both interpolations to agree at points along
//! the cut (Iwanicki 2013, "Lighting technology of The Last of Us", doi:10.1145/2504459.2504484). Solved by conjugate gradients.

use std::collections::HashMap;

use super::fill::Map;
use super::flatten::Flat;
use super::layout::Layout;
use super::topology::NONE;
use crate::math::Vec2;

/// Weight of a texel's own value beside a point of a cut: small, so that cuts close.
const OWN: f64 = 0.05;
/// Corners of neighbors in one chart that are this near, in texels, are no cut.
const SAME: f32 = 1e-2;
/// Rounds of conjugate gradients.
const ROUNDS: usize = 60;

/// A bilinear look-up: four unknowns with their weights.
type Lookup = [(u32, f64); 4];

/// Lets both sides of all cuts agree, by the texels of charts and of their gutters.
pub fn stitch(flat: &Flat, layout: &Layout, maps: &mut [Map]) {
    let mut unknowns = Unknowns::default();
    let rows = rows(flat, layout, maps, &mut unknowns);
    for channel in 0..3 {
        let start: Vec<f64> = unknowns.texels.iter().map(|&(a, i)| f64::from(maps[a as usize].data[i as usize][channel])).collect();
        let solved = solve(&rows, &start);
        for (&(a, i), v) in unknowns.texels.iter().zip(solved) {
            maps[a as usize].data[i as usize][channel] = v.max(0.0) as f32;
        }
    }
}

/// Texels beside cuts, by number.
#[derive(Default)]
struct Unknowns {
    numbers: HashMap<(u32, u32), u32>,
    texels: Vec<(u32, u32)>,
}

impl Unknowns {
    fn number(&mut self, atlas: u32, index: u32) -> u32 {
        *self.numbers.entry((atlas, index)).or_insert_with(|| {
            self.texels.push((atlas, index));
            self.texels.len() as u32 - 1
        })
    }

    fn lookup(&mut self, maps: &[Map], atlas: u32, p: Vec2) -> Lookup {
        let map = &maps[atlas as usize];
        let q = p - 0.5;
        let (x, y) = (q.x.floor(), q.y.floor());
        let (fx, fy) = (f64::from(q.x - x), f64::from(q.y - y));
        let cell = |dx: f32, dy: f32| {
            let x = (x + dx).clamp(0.0, map.size[0] as f32 - 1.0) as u32;
            let y = (y + dy).clamp(0.0, map.size[1] as f32 - 1.0) as u32;
            map.index(x, y) as u32
        };
        [
            (self.number(atlas, cell(0.0, 0.0)), (1.0 - fx) * (1.0 - fy)),
            (self.number(atlas, cell(1.0, 0.0)), fx * (1.0 - fy)),
            (self.number(atlas, cell(0.0, 1.0)), (1.0 - fx) * fy),
            (self.number(atlas, cell(1.0, 1.0)), fx * fy),
        ]
    }
}

/// A row for each point along each cut: one look-up less the other is to be 0.
fn rows(flat: &Flat, layout: &Layout, maps: &[Map], unknowns: &mut Unknowns) -> Vec<[Lookup; 2]> {
    let mut rows = Vec::new();
    // Where each triangle of each side lies.
    let mut places: Vec<Vec<(u32, u32)>> =
        layout.sides.iter().map(|s| vec![(NONE, 0); flat.mesh(s.shape as usize).triangles.len()]).collect();
    for (c, chart) in layout.charts.iter().enumerate() {
        for (i, t) in chart.chart.triangles.iter().enumerate() {
            places[chart.side as usize][*t as usize] = (c as u32, i as u32);
        }
    }
    for (side, places) in layout.sides.iter().zip(&places) {
        let topology = &flat.shapes[side.shape as usize].topology;
        for (t, neighbors) in topology.neighbors.iter().enumerate() {
            for k in 0..3 {
                let other = neighbors[k];
                // Each cut once.
                if other == NONE || !topology.smooth[t][k] || other / 3 < t as u32 {
                    continue;
                }
                let ((c1, i1), (c2, i2)) = (places[t], places[(other / 3) as usize]);
                if c1 == NONE || c2 == NONE {
                    continue;
                }
                let (k2, first, second) = ((other % 3) as usize, &layout.charts[c1 as usize], &layout.charts[c2 as usize]);
                let (a, b) = (first.corners(i1), second.corners(i2));
                let (a0, a1, b0, b1) = (a[k], a[(k + 1) % 3], b[(k2 + 1) % 3], b[k2]);
                if c1 == c2 && a0.distance(b0) < SAME && a1.distance(b1) < SAME {
                    continue;
                }
                let length = a0.distance(a1).max(b0.distance(b1));
                let points = (2.0 * length).ceil().clamp(2.0, 65536.0) as u32;
                for i in 0..points {
                    let f = (i as f32 + 0.5) / points as f32;
                    rows.push([
                        unknowns.lookup(maps, first.place.atlas, a0.lerp(a1, f)),
                        unknowns.lookup(maps, second.place.atlas, b0.lerp(b1, f)),
                    ]);
                }
            }
        }
    }
    rows
}

/// Minimizes Σ (row · x)² + OWN Σ (x − start)².
fn solve(rows: &[[Lookup; 2]], start: &[f64]) -> Vec<f64> {
    let value = |row: &[Lookup; 2], x: &[f64]| {
        let side = |l: &Lookup| l.iter().map(|(i, w)| w * x[*i as usize]).sum::<f64>();
        side(&row[0]) - side(&row[1])
    };
    let apply = |x: &[f64]| {
        let mut out: Vec<f64> = x.iter().map(|v| OWN * v).collect();
        for row in rows {
            let v = value(row, x);
            row[0].iter().for_each(|(i, w)| out[*i as usize] += w * v);
            row[1].iter().for_each(|(i, w)| out[*i as usize] -= w * v);
        }
        out
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut x = start.to_vec();
    let product = apply(&x);
    let mut r: Vec<f64> = start.iter().zip(product).map(|(s, p)| OWN * s - p).collect();
    let mut p = r.clone();
    let mut rr = dot(&r, &r);
    let goal = rr * 1e-10;
    for _ in 0..ROUNDS {
        if !(rr > goal) {
            break;
        }
        let ap = apply(&p);
        let step = rr / dot(&p, &ap);
        for i in 0..x.len() {
            x[i] += step * p[i];
            r[i] -= step * ap[i];
        }
        let next = dot(&r, &r);
        let beta = next / rr;
        rr = next;
        p.iter_mut().zip(&r).for_each(|(p, r)| *p = r + beta * *p);
    }
    x
}
