//! Which triangles of a mesh are neighbors: by the positions of their corners, as meshes repeat vertices at seams.

use std::collections::HashMap;

use etendue_scene::desc::MeshData;

use crate::math::Vec3;

/// No neighbor.
pub const NONE: u32 = u32::MAX;
/// Neighbors whose normals at the common edge differ more than this are a crease: cosine of 10 degrees.
const CREASE_COS: f32 = 0.985;

/// Neighbors of a mesh's triangles.
#[derive(Clone, Debug)]
pub struct Topology {
    /// For each triangle and each of its edges (k to k + 1): triangle · 3 + edge of the neighbor that lies there as the only one and the
    /// other way round, or [`NONE`].
    pub neighbors: Vec<[u32; 3]>,
    /// Whether the surface is smooth across the edge; false where there is no neighbor.
    pub smooth: Vec<[bool; 3]>,
    /// Unit geometric normals.
    pub normals: Vec<Vec3>,
}

impl Topology {
    /// Finds the neighbors of a mesh whose triangles all have area. Edges of more than two triangles, and of two that are wound against
    /// each other, join nothing.
    pub fn new(mesh: &MeshData) -> Self {
        let mut ids = HashMap::new();
        let mut id_of = |p: Vec3| {
            let next = ids.len() as u32;
            *ids.entry(p.to_array().map(|v| (v + 0.0).to_bits())).or_insert(next)
        };
        let corners: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|i| id_of(mesh.positions[i as usize]))).collect();
        let mut edges = Vec::with_capacity(3 * corners.len());
        for (t, c) in corners.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (c[k], c[(k + 1) % 3]);
                edges.push((a.min(b), a.max(b), (3 * t + k) as u32, a < b));
            }
        }
        edges.sort_unstable();
        let normals: Vec<Vec3> = mesh.triangles.iter().map(|t| normal(mesh, t)).collect();
        let mut neighbors = vec![[NONE; 3]; corners.len()];
        let mut smooth = vec![[false; 3]; corners.len()];
        for run in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            let [x, y] = run else { continue };
            if x.3 == y.3 || x.2 / 3 == y.2 / 3 {
                continue;
            }
            let is_smooth = is_smooth(mesh, &normals, x.2, y.2);
            for (from, to) in [(x.2, y.2), (y.2, x.2)] {
                let (t, k) = ((from / 3) as usize, (from % 3) as usize);
                neighbors[t][k] = to;
                smooth[t][k] = is_smooth;
            }
        }
        Self { neighbors, smooth, normals }
    }

    /// Whether every edge joins two triangles.
    pub fn is_closed(&self) -> bool {
        self.neighbors.iter().flatten().all(|n| *n != NONE)
    }
}

fn normal(mesh: &MeshData, t: &[u32; 3]) -> Vec3 {
    let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
    (b - a).cross(c - a).normalize_or(glam::DVec3::Z).as_vec3()
}

/// Whether the shading normals on both sides of an edge agree.
fn is_smooth(mesh: &MeshData, face_normals: &[Vec3], x: u32, y: u32) -> bool {
    let ends = |e: u32| {
        let (t, k) = ((e / 3) as usize, (e % 3) as usize);
        let [i, j] = [mesh.triangles[t][k] as usize, mesh.triangles[t][(k + 1) % 3] as usize];
        if mesh.normals.is_empty() { [face_normals[t]; 2] } else { [mesh.normals[i], mesh.normals[j]] }
    };
    let (p, q) = (ends(x), ends(y));
    // The edge runs the other way in the neighbor.
    p[0].dot(q[1]) >= CREASE_COS && p[1].dot(q[0]) >= CREASE_COS
}

#[cfg(test)]
mod tests {
    use etendue_scene::desc::GeometryDesc;
    use etendue_scene::formats::tessellate::tessellate;

    use super::*;

    #[test]
    fn a_cube_is_closed_and_creased_and_a_square_is_open() {
        let cube = Topology::new(&tessellate(&GeometryDesc::Cube).unwrap());
        assert!(cube.is_closed());
        // Of the edges of twelve triangles the six diagonals are smooth, seen from both sides.
        assert_eq!(cube.smooth.iter().flatten().filter(|s| **s).count(), 12);
        let square = Topology::new(&tessellate(&GeometryDesc::Rectangle).unwrap());
        assert!(!square.is_closed());
    }

    #[test]
    fn three_triangles_at_an_edge_join_nothing() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Y];
        let mesh = MeshData { positions, triangles: vec![[0, 1, 2], [1, 0, 3], [1, 0, 4]], ..MeshData::default() };
        assert!(Topology::new(&mesh).neighbors.iter().flatten().all(|n| *n == NONE));
    }
}
