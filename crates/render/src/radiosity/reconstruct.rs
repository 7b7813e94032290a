//! From constant elements to light that varies smoothly over each surface, without leaks over corners.
//!
//! Each vertex gets the mean of the elements about it that are parts of one smooth surface, weighted by their angles there; between
//! vertices the irradiance is linear. Where an element meets smaller ones, their vertex on its edge counts too: the element is drawn as
//! four triangles between its corners and the middles of its edges, and an edge without such a vertex has the mean of its ends in
//! the middle, so that there are no cracks. Means at vertices blur, and at the rim of a surface they are those of places farther in. So what
//! an element lacks of its light after interpolation is added at its vertices, again as a mean of the elements about them (Van Cittert's
//! iteration, 1931). Elements are subdivided first until neighbors differ by one level at most (the
//! restricted quadtree of Von Herzen and Barr 1987, doi:10.1145/37401.37415).

use std::collections::HashSet;

use glam::Vec3;
use rayon::prelude::*;

use super::exchange::Solved;
use super::mesh::{MAX_LEVEL, descend_once};
use crate::math::fns;
use crate::scene::Scene;
use crate::scene::geometry::NONE;
use crate::spectrum::Spectrum;

/// Surfaces whose shading normals differ by more than this cosine have an edge between them.
const SMOOTH: f32 = 0.94;
/// More elements at one vertex than this are not compared with each other: hostile meshes have one vertex for everything.
const MAX_AROUND: usize = 96;
/// What a correction may lead beyond the values of the elements about a vertex, over their range.
const OVERSHOOT: f32 = 0.75;
/// Elements of which more than this share lies outside of bodies count as whole.
const WHOLE: f32 = 0.99;
/// Rounds of corrections of what is shown in the end.
pub const CORRECTIONS: u32 = 2;
/// Rounds of subdivision for neighbors that differ by one level.
const MAX_ROUNDS: usize = 16;

/// Position of a vertex, bit by bit.
type Key = [u32; 3];

fn key(p: Vec3) -> Key {
    // Both zeros are the same place.
    [p.x + 0.0, p.y + 0.0, p.z + 0.0].map(f32::to_bits)
}

/// Irradiance at the corners (0, 1, 2) and edge middles (01, 12, 20) of an element, R, G, B.
type Values = [[f32; 3]; 6];

/// Irradiance that is linear between vertices.
#[derive(Clone, Debug, Default)]
pub struct Smooth {
    /// For each node its entry in `values`; [`NONE`] for all that are no leaves.
    of_node: Vec<u32>,
    values: Vec<Values>,
}

/// A corner or edge middle of an element at a vertex.
struct Around {
    key: Key,
    /// Element's place among the leaves, and the slot in its [`Values`].
    leaf: u32,
    slot: u8,
    normal: Vec3,
    weight: f32,
}

impl Smooth {
    /// Balances the mesh of a solution and finds the values at its vertices, with so many rounds of corrections.
    pub fn new(scene: &Scene, solved: &mut Solved, corrections: u32) -> Self {
        balance(scene, solved);
        let leaves = solved.mesh.leaves();
        let corners: HashSet<Key> = leaves.iter().flat_map(|&i| solved.mesh.nodes[i as usize].corners.map(key)).collect();
        let mesh = &solved.mesh;
        let mut around: Vec<Around> = leaves
            .par_iter()
            .enumerate()
            .flat_map_iter(|(k, &i)| {
                let node = &mesh.nodes[i as usize];
                let face = mesh.face(node);
                let c = node.corners;
                let middles = [(c[0] + c[1]) * 0.5, (c[1] + c[2]) * 0.5, (c[2] + c[0]) * 0.5];
                let normal_at = |p: Vec3| {
                    let b = super::shapes::barycentric(&face.corners, p).max(Vec3::ZERO);
                    mesh.faces.shading_normal(scene, face, b / (b.x + b.y + b.z).max(1e-20))
                };
                let mut out = arrayvec::ArrayVec::<Around, 6>::new();
                for slot in 0..3usize {
                    let (p, q, r) = (c[slot], c[(slot + 1) % 3], c[(slot + 2) % 3]);
                    let weight = fns::acos((q - p).normalize_or_zero().dot((r - p).normalize_or_zero())).max(1e-3);
                    let _ = out.try_push(Around { key: key(p), leaf: k as u32, slot: slot as u8, normal: normal_at(p), weight });
                    if corners.contains(&key(middles[slot])) {
                        let (p, slot) = (middles[slot], slot as u8 + 3);
                        let _ =
                            out.try_push(Around { key: key(p), leaf: k as u32, slot, normal: normal_at(p), weight: std::f32::consts::PI });
                    }
                }
                out.into_iter()
            })
            .collect();
        around.par_sort_unstable_by_key(|a| (a.key, a.leaf, a.slot));
        let groups = Groups::new(&around);
        // The floor under a wall must not darken what is before the wall.
        let outside: Vec<f32> = leaves.iter().map(|&i| solved.outside.get(i as usize).copied().unwrap_or(1.0)).collect();
        let own: Vec<[f32; 3]> = leaves.iter().map(|&i| solved.irradiance[i as usize].rgb()).collect();
        let mut found = groups.means(&own, &outside, &own);
        let mut values = of_leaves(&around, &found, leaves.len());
        for _ in 0..corrections {
            // Parts of elements that lie inside of bodies are interpolated as well, but are not in their means.
            let lack = |k: usize| {
                let (own, shown) = (own[k], mean_of(&values[k]));
                if outside[k] > WHOLE { std::array::from_fn(|c| own[c] - shown[c]) } else { [0.0; 3] }
            };
            let lacking: Vec<[f32; 3]> = (0..leaves.len()).into_par_iter().map(lack).collect();
            let more = groups.means(&lacking, &outside, &vec![[0.0; 3]; leaves.len()]);
            found.par_iter_mut().zip(&more).enumerate().for_each(|(i, (v, more))| {
                let (lo, hi) = groups.range(i, &own, &outside);
                for c in 0..3 {
                    let slack = OVERSHOOT * (hi[c] - lo[c]);
                    v[c] = (v[c] + more[c]).min(hi[c] + slack).max((lo[c] - slack).max(0.0));
                }
            });
            values = of_leaves(&around, &found, leaves.len());
        }
        let mut of_node = vec![NONE; solved.mesh.nodes.len()];
        leaves.iter().enumerate().for_each(|(k, &i)| of_node[i as usize] = k as u32);
        Self { of_node, values }
    }

    /// Least and largest irradiance (mean of the colors) at the vertices of a leaf.
    pub fn range(&self, leaf: u32) -> (f32, f32) {
        let Some(v) = self.of_node.get(leaf as usize).and_then(|&k| self.values.get(k as usize)) else { return (0.0, 0.0) };
        let mean = |c: &[f32; 3]| (c[0] + c[1] + c[2]) / 3.0;
        v[..3].iter().map(mean).fold((f32::INFINITY, 0.0), |(lo, hi), m| (lo.min(m), hi.max(m)))
    }

    /// Irradiance of a leaf at barycentric weights.
    #[inline]
    pub fn at(&self, leaf: u32, b: Vec3) -> Spectrum {
        let Some(v) = self.of_node.get(leaf as usize).and_then(|&k| self.values.get(k as usize)) else { return Spectrum::ZERO };
        // Corners of the quarters in the order of [`super::form_factor::quarter`].
        const SLOTS: [[usize; 3]; 4] = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [4, 5, 3]];
        let (i, w) = descend_once(b);
        let [x, y, z] = SLOTS[i as usize].map(|s| v[s]);
        Spectrum::from_rgb(std::array::from_fn(|c| (w.x * x[c] + w.y * y[c] + w.z * z[c]).max(0.0)))
    }
}

/// Corners and edge middles, sorted by place, with those of one smooth surface at the same place.
struct Groups<'a> {
    around: &'a [Around],
    /// For each the first at the same place, and how many there are.
    spans: Vec<(u32, u32)>,
}

impl<'a> Groups<'a> {
    fn new(around: &'a [Around]) -> Self {
        let mut spans = vec![(0, 0); around.len()];
        let mut first = 0;
        while first < around.len() {
            let count = around[first..].iter().take_while(|b| b.key == around[first].key).count();
            spans[first..first + count].fill((first as u32, count as u32));
            first += count;
        }
        Self { around, spans }
    }

    /// Those of the same smooth surface and place as the `i`-th; none where hostile meshes have too many.
    fn smooth(&self, i: usize) -> impl Iterator<Item = &'a Around> {
        let (first, count) = self.spans[i];
        let count = if count as usize > MAX_AROUND { 0 } else { count };
        let (around, normal) = (self.around, self.around[i].normal);
        around[first as usize..(first + count) as usize].iter().filter(move |b| normal.dot(b.normal) >= SMOOTH)
    }

    /// For each place the mean of a value of the leaves about it, by angle and by the share of the leaf that counts; where none counts that
    /// of `otherwise` of the own leaf.
    fn means(&self, of_leaf: &[[f32; 3]], counts: &[f32], otherwise: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mean = |i: usize| {
            let (mut sum, mut weight) = ([0.0f32; 3], 0.0);
            for b in self.smooth(i) {
                let (w, v) = (b.weight * counts[b.leaf as usize], of_leaf[b.leaf as usize]);
                (0..3).for_each(|c| sum[c] += v[c] * w);
                weight += w;
            }
            if weight > 0.0 { sum.map(|v| v / weight) } else { otherwise[self.around[i].leaf as usize] }
        };
        (0..self.around.len()).into_par_iter().map(mean).collect()
    }

    /// The least and largest value of the leaves that count about the `i`-th place, its own included.
    fn range(&self, i: usize, of_leaf: &[[f32; 3]], counts: &[f32]) -> ([f32; 3], [f32; 3]) {
        let own = of_leaf[self.around[i].leaf as usize];
        let start = if counts[self.around[i].leaf as usize] > 0.0 { (own, own) } else { ([f32::INFINITY; 3], [0.0; 3]) };
        let (lo, hi) = self.smooth(i).filter(|b| counts[b.leaf as usize] > 0.0).fold(start, |(lo, hi), b| {
            let v = of_leaf[b.leaf as usize];
            (std::array::from_fn(|c| lo[c].min(v[c])), std::array::from_fn(|c| hi[c].max(v[c])))
        });
        if lo[0].is_finite() { (lo, hi) } else { (own, own) }
    }
}

/// The values of all leaves from those at places; edges without a vertex in the middle have the mean of their ends there.
fn of_leaves(around: &[Around], found: &[[f32; 3]], count: usize) -> Vec<Values> {
    let mut values = vec![[[f32::NAN; 3]; 6]; count];
    for (a, v) in around.iter().zip(found) {
        values[a.leaf as usize][a.slot as usize] = *v;
    }
    values.par_iter_mut().for_each(|v| {
        for e in 0..3 {
            if v[3 + e][0].is_nan() {
                let (a, b) = (v[e], v[(e + 1) % 3]);
                v[3 + e] = std::array::from_fn(|c| 0.5 * (a[c] + b[c]));
            }
        }
    });
    values
}

/// The mean over an element of what is interpolated: a corner belongs to one of its four triangles, a middle to three.
fn mean_of(v: &Values) -> [f32; 3] {
    std::array::from_fn(|c| (v[0][c] + v[1][c] + v[2][c] + 3.0 * (v[3][c] + v[4][c] + v[5][c])) / 12.0)
}

/// Subdivides elements beside much smaller ones; the parts have the whole's light.
fn balance(scene: &Scene, solved: &mut Solved) {
    let mut candidates = solved.mesh.leaves();
    let mut corners: HashSet<Key> = candidates.iter().flat_map(|&i| solved.mesh.nodes[i as usize].corners.map(key)).collect();
    for _ in 0..MAX_ROUNDS {
        let is_coarse = |&i: &u32| {
            let node = &solved.mesh.nodes[i as usize];
            let c = node.corners;
            node.is_leaf()
                && node.level < MAX_LEVEL
                && (0..3).any(|e| {
                    let (a, b) = (c[e], c[(e + 1) % 3]);
                    let m = (a + b) * 0.5;
                    corners.contains(&key((a + m) * 0.5)) || corners.contains(&key((m + b) * 0.5))
                })
        };
        let coarse: Vec<u32> = candidates.par_iter().copied().filter(is_coarse).collect();
        if coarse.is_empty() {
            return;
        }
        let first = solved.subdivide(scene, &coarse);
        corners.extend(solved.mesh.nodes[first as usize..].iter().flat_map(|n| n.corners.map(key)));
        // A new vertex may make any leaf too coarse.
        candidates = solved.mesh.leaves();
    }
}
