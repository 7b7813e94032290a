//! Loop subdivision (Loop 1987, "Smooth Subdivision Surfaces Based on Triangles"; weights as in pbrt-v3, section 3.8).

use std::collections::HashMap;

use glam::Vec3;

use super::angles::sin_cos;
use crate::desc::MeshData;

/// Most triangles that a subdivided mesh may have.
const TRIANGLE_LIMIT: usize = 2_000_000;

/// Why a control mesh cannot be subdivided.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum SubdivisionFault {
    /// An edge with more than two triangles.
    NotAManifold,
    /// More triangles than fit.
    TooMany,
}

/// The limit surface of a control mesh after so many levels, with limit normals.
pub(super) fn subdivide(positions: &[Vec3], triangles: &[[u32; 3]], levels: u32) -> Result<MeshData, SubdivisionFault> {
    let mut mesh = Control::new(positions.to_vec(), triangles.to_vec())?;
    for _ in 0..levels {
        if mesh.triangles.len() > TRIANGLE_LIMIT / 4 {
            return Err(SubdivisionFault::TooMany);
        }
        mesh = mesh.refined()?;
    }
    Ok(mesh.limit())
}

/// A control mesh with its neighborhoods.
struct Control {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    /// The ring of each vertex in order; on a boundary it starts and ends there.
    rings: Vec<Vec<u32>>,
    boundary: Vec<bool>,
}

impl Control {
    fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, SubdivisionFault> {
        // The spokes (next, previous) of each vertex by its triangles: walking them gives the ring.
        let mut spokes: Vec<Vec<(u32, u32)>> = vec![Vec::new(); positions.len()];
        let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
        for t in &triangles {
            for k in 0..3 {
                let (a, b, c) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
                spokes[a as usize].push((b, c));
                *edges.entry((a.min(b), a.max(b))).or_default() += 1;
            }
        }
        if edges.values().any(|n| *n > 2) {
            return Err(SubdivisionFault::NotAManifold);
        }
        let mut rings = Vec::with_capacity(positions.len());
        let mut boundary = Vec::with_capacity(positions.len());
        for list in &mut spokes {
            list.sort_unstable();
            let mut ends: Vec<u32> = list.iter().map(|(_, c)| *c).collect();
            ends.sort_unstable();
            let list = &*list;
            // A boundary spoke starts at a vertex that no other spoke ends at.
            let start = list.iter().find(|(b, _)| ends.binary_search(b).is_err());
            boundary.push(start.is_some());
            let mut ring = Vec::with_capacity(list.len() + 1);
            if let Some(first) = start.or(list.first()) {
                let mut at = *first;
                for _ in 0..list.len() {
                    ring.push(at.0);
                    match list.binary_search_by_key(&at.1, |(b, _)| *b).ok().map(|i| &list[i]) {
                        Some(next) if next != first => at = *next,
                        _ => break,
                    }
                }
                if start.is_some() {
                    ring.push(at.1);
                }
            }
            rings.push(ring);
        }
        Ok(Self { positions, triangles, rings, boundary })
    }

    fn sum(&self, ring: &[u32]) -> Vec3 {
        ring.iter().map(|i| self.positions[*i as usize]).sum()
    }

    /// The vertex after smoothing with weight `beta` of each neighbor, or along the boundary with `edge`.
    fn smoothed(&self, v: usize, beta: impl Fn(usize) -> f32, edge: f32) -> Vec3 {
        let (p, ring) = (self.positions[v], &self.rings[v]);
        match (self.boundary[v], ring.as_slice()) {
            (_, []) => p,
            (true, [first, .., last]) => p * (1.0 - 2.0 * edge) + (self.positions[*first as usize] + self.positions[*last as usize]) * edge,
            (_, ring) => {
                let b = beta(ring.len());
                p * (1.0 - ring.len() as f32 * b) + self.sum(ring) * b
            }
        }
    }

    fn refined(&self) -> Result<Self, SubdivisionFault> {
        let mut positions: Vec<Vec3> = (0..self.positions.len()).map(|v| self.smoothed(v, beta, 1.0 / 8.0)).collect();
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        // The vertex across an edge, by the triangles on both sides.
        let mut across: HashMap<(u32, u32), (u32, Option<u32>)> = HashMap::new();
        for t in &self.triangles {
            for k in 0..3 {
                let (a, b, c) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
                across.entry((a.min(b), a.max(b))).and_modify(|e| e.1 = Some(c)).or_insert((c, None));
            }
        }
        let mut triangles = Vec::with_capacity(self.triangles.len() * 4);
        for t in &self.triangles {
            let m: [u32; 3] = std::array::from_fn(|k| {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let ends = self.positions[a as usize] + self.positions[b as usize];
                    let p = match across.get(&(a.min(b), a.max(b))) {
                        Some((c, Some(d))) => ends * (3.0 / 8.0) + (self.positions[*c as usize] + self.positions[*d as usize]) / 8.0,
                        _ => ends * 0.5,
                    };
                    positions.push(p);
                    positions.len() as u32 - 1
                })
            });
            triangles.extend([[t[0], m[0], m[2]], [m[0], t[1], m[1]], [m[2], m[1], t[2]], m]);
        }
        Self::new(positions, triangles)
    }

    /// Positions and normals of the limit surface.
    fn limit(self) -> MeshData {
        let positions: Vec<Vec3> = (0..self.positions.len()).map(|v| self.smoothed(v, loop_gamma, 1.0 / 5.0)).collect();
        let normals = (0..positions.len()).map(|v| self.normal(v, &positions)).collect();
        MeshData { positions, triangles: self.triangles, normals, ..MeshData::default() }
    }

    fn normal(&self, v: usize, positions: &[Vec3]) -> Vec3 {
        let ring: Vec<Vec3> = self.rings[v].iter().map(|i| positions[*i as usize]).collect();
        let n = ring.len();
        let p = positions[v];
        let (mut s, mut t) = (Vec3::ZERO, Vec3::ZERO);
        if !self.boundary[v] {
            for (j, q) in ring.iter().enumerate() {
                let angle = std::f32::consts::TAU * j as f32 / n as f32;
                let (sin, cos) = sin_cos(angle);
                s += *q * cos;
                t += *q * sin;
            }
        } else if n >= 2 {
            s = ring[n - 1] - ring[0];
            t = match n {
                2 => ring[0] + ring[1] - 2.0 * p,
                3 => ring[1] - p,
                4 => -ring[0] + 2.0 * ring[1] + 2.0 * ring[2] - ring[3] - 2.0 * p,
                _ => {
                    let theta = std::f32::consts::PI / (n - 1) as f32;
                    let mut t = (ring[0] + ring[n - 1]) * sin_cos(theta).0;
                    for (k, q) in ring.iter().enumerate().take(n - 1).skip(1) {
                        t += *q * ((2.0 * sin_cos(theta).1 - 2.0) * sin_cos(k as f32 * theta).0);
                    }
                    -t
                }
            };
            return t.cross(s).normalize_or_zero();
        }
        s.cross(t).normalize_or_zero()
    }
}

/// Weight of each of `n` neighbors of an inner vertex (Warren's choice).
fn beta(n: usize) -> f32 {
    if n == 3 { 3.0 / 16.0 } else { 3.0 / (8.0 * n as f32) }
}

/// The weight that takes an inner vertex to the limit surface.
fn loop_gamma(n: usize) -> f32 {
    1.0 / (n as f32 + 3.0 / (8.0 * beta(n)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn octahedron() -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let p = vec![Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
        let t = vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        (p, t)
    }

    #[test]
    fn an_octahedron_becomes_round_with_normals_to_the_outside() {
        let (p, t) = octahedron();
        let mesh = subdivide(&p, &t, 4).unwrap();
        assert_eq!(mesh.triangles.len(), 8 * 256);
        assert_eq!(mesh.positions.len(), 8 * 256 / 2 + 2, "Euler's formula");
        let radii: Vec<f32> = mesh.positions.iter().map(|p| p.length()).collect();
        let (lo, hi) = (radii.iter().copied().fold(f32::MAX, f32::min), radii.iter().copied().fold(0.0, f32::max));
        // The limit of a corner by its four neighbors, which sum to zero: 1 − 4 · 1/8.
        assert!((hi - 0.5).abs() < 1e-6 && lo > 0.4, "{lo} to {hi}");
        for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
            assert!(p.normalize().dot(*n) > 0.95, "{p} {n}");
        }
    }

    #[test]
    fn a_flat_grid_stays_flat_and_its_corners_shrink_along_the_edges() {
        let p = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let mesh = subdivide(&p, &[[0, 1, 2], [0, 2, 3]], 3).unwrap();
        assert!(mesh.positions.iter().all(|p| p.z == 0.0 && p.cmpge(Vec3::ZERO).all()));
        assert!(mesh.normals.iter().all(|n| (n.z - 1.0).abs() < 1e-5), "{:?}", mesh.normals);
    }

    #[test]
    fn an_edge_of_three_triangles_is_a_fault() {
        let p = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_Y];
        assert_eq!(subdivide(&p, &[[0, 1, 2], [0, 1, 3], [0, 1, 4]], 1).unwrap_err(), SubdivisionFault::NotAManifold);
    }
}
