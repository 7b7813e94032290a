//! Splits the edges of a mesh until none is too long.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use etendue_scene::desc::{MeshAttribute, MeshData};
use glam::{Mat4, Vec3};

/// The mesh would have more triangles than it may.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct TooMany;

/// Splits triangles at the middle of their longest edge until all edges are shorter than `edge_length` in the space that `m` leads to, as
/// pbrt-v4 does. Whether and where an edge is split depends on its two ends alone, so that neighbors split it alike: there are no cracks, along
/// seams of the texture coordinates neither. Normals, texture coordinates and attributes are interpolated; tangents are left out. Edges between
/// neighboring numbers, and those without finite length, stay.
///
/// # Errors
/// [`TooMany`] where the mesh would have more than `most` triangles.
pub(super) fn refine(mesh: &MeshData, m: Mat4, edge_length: f32, most: usize) -> Result<MeshData, TooMany> {
    let limit = f64::from(edge_length);
    let placed = |p: Vec3| m.transform_point3(p).as_dvec3();
    // Triangles that are small enough cannot be fewer than this: soon told, where making them would take long.
    let least: f64 = mesh.triangles.iter().map(|t| least_parts(t.map(|i| placed(mesh.positions[i as usize])), limit)).sum();
    if least > most as f64 {
        return Err(TooMany);
    }
    let mut out = MeshData { triangles: Vec::new(), tangents: Vec::new(), ..mesh.clone() };
    for a in out.attributes.iter_mut().filter(|a| a.per_face) {
        a.data.clear();
    }
    let mut middles: HashMap<(u32, u32), Option<u32>> = HashMap::new();
    let mut todo: Vec<[u32; 3]> = Vec::new();
    for (face, triangle) in mesh.triangles.iter().enumerate() {
        todo.push(*triangle);
        while let Some(v) = todo.pop() {
            if out.triangles.len() + todo.len() >= most {
                return Err(TooMany);
            }
            let p = v.map(|i| placed(out.positions[i as usize]));
            let mut edges: [(f64, usize); 3] = std::array::from_fn(|k| (p[k].distance(p[(k + 1) % 3]), k));
            edges.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            let split = edges.iter().filter(|e| e.0 >= limit && e.0.is_finite()).find_map(|&(_, k)| {
                let (a, b) = (v[k], v[(k + 1) % 3]);
                let middle = match middles.entry((a.min(b), a.max(b))) {
                    Entry::Occupied(known) => *known.get(),
                    Entry::Vacant(empty) => *empty.insert(add_middle(&mut out, a.min(b), a.max(b))),
                };
                middle.map(|middle| (middle, k))
            });
            match split {
                // The second half lies on top: the order of the first halves is that of the file.
                Some((middle, k)) => todo.extend([[middle, v[(k + 1) % 3], v[(k + 2) % 3]], [v[k], middle, v[(k + 2) % 3]]]),
                None => {
                    out.triangles.push(v);
                    for (a, source) in out.attributes.iter_mut().zip(&mesh.attributes).filter(|(a, _)| a.per_face) {
                        let (from, width) = (face * a.width as usize, a.width as usize);
                        a.data.extend_from_slice(&source.data[from..from + width]);
                    }
                }
            }
        }
    }
    Ok(out)
}

/// A lower bound of the triangles with edges up to `limit` that make up a triangle: by their area, and by its longest edge.
fn least_parts(p: [glam::DVec3; 3], limit: f64) -> f64 {
    let largest = 0.25 * 3f64.sqrt() * limit * limit;
    let area = 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).length();
    let edge = (0..3).map(|k| p[k].distance(p[(k + 1) % 3])).fold(0.0, f64::max);
    let parts = (area / largest).max(edge / limit);
    if parts.is_finite() { parts.max(1.0) } else { 1.0 }
}

/// Adds the vertex in the middle of an edge; `None` where no number lies between its ends.
fn add_middle(mesh: &mut MeshData, a: u32, b: u32) -> Option<u32> {
    let (i, j) = (a as usize, b as usize);
    let (p, q) = (mesh.positions[i], mesh.positions[j]);
    // Each half before the sum, which could be too large.
    let middle = p * 0.5 + q * 0.5;
    if middle == p || middle == q || !middle.is_finite() {
        return None;
    }
    let new = u32::try_from(mesh.positions.len()).ok()?;
    mesh.positions.push(middle);
    if !mesh.normals.is_empty() {
        let (n, o) = (mesh.normals[i], mesh.normals[j]);
        mesh.normals.push((n + o).normalize_or(n));
    }
    if !mesh.uvs.is_empty() {
        let uv = (mesh.uvs[i] + mesh.uvs[j]) * 0.5;
        mesh.uvs.push(uv);
    }
    for MeshAttribute { width, data, .. } in mesh.attributes.iter_mut().filter(|a| !a.per_face) {
        let width = *width as usize;
        for k in 0..width {
            data.push((data[i * width + k] + data[j * width + k]) * 0.5);
        }
    }
    Some(new)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use glam::Vec2;

    use super::*;

    /// The unit square in the xy plane, its two triangles with a seam between them: the vertices of the diagonal are there twice.
    fn square() -> MeshData {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        MeshData {
            positions: corners.to_vec(),
            uvs: corners.iter().map(|p| p.truncate()).collect(),
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            attributes: vec![
                MeshAttribute { name: "face".into(), per_face: true, width: 1, data: vec![5.0, 7.0] },
                MeshAttribute { name: "height".into(), per_face: false, width: 1, data: vec![0.0, 1.0, 3.0, 0.0, 3.0, 2.0] },
            ],
            ..MeshData::default()
        }
    }

    #[test]
    fn edges_become_short_and_neighbors_split_them_alike() {
        let m = Mat4::from_scale(Vec3::new(3.0, 1.0, 1.0));
        let out = refine(&square(), m, 0.3, 10_000).unwrap();
        let place = |i: u32| m.transform_point3(out.positions[i as usize]);
        let mut area = 0.0;
        // Each edge within the square is met once from each side, by position.
        let mut open: HashSet<[[u32; 3]; 2]> = HashSet::new();
        for t in &out.triangles {
            let p = t.map(place);
            area += 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).z;
            for k in 0..3 {
                assert!(p[k].distance(p[(k + 1) % 3]) < 0.3);
                let [a, b] = [t[k], t[(k + 1) % 3]].map(|i| out.positions[i as usize].to_array().map(f32::to_bits));
                assert!(open.remove(&[b, a]) || open.insert([a, b]));
            }
        }
        assert!((area - 3.0).abs() < 1e-4, "{area}");
        let inner = |p: [u32; 3]| (0..2).all(|k| (0.001..0.999).contains(&f32::from_bits(p[k])));
        assert!(open.iter().all(|[a, b]| !inner(*a) && !inner(*b)), "cracks");
        // What is interpolated is linear in the place, and faces keep their values.
        for (i, p) in out.positions.iter().enumerate() {
            assert!((out.uvs[i] - Vec2::new(p.x, p.y)).length() < 1e-6);
            assert!((out.attributes[1].data[i] - (p.x + 2.0 * p.y)).abs() < 1e-5);
        }
        for (t, value) in out.triangles.iter().zip(&out.attributes[0].data) {
            let middle: Vec3 = t.iter().map(|i| out.positions[*i as usize] / 3.0).sum();
            assert_eq!(*value, if middle.x > middle.y { 5.0 } else { 7.0 });
        }
        assert_eq!(out, refine(&square(), m, 0.3, 10_000).unwrap());
    }

    #[test]
    fn what_is_short_enough_stays() {
        let out = refine(&square(), Mat4::IDENTITY, 2.0, 10).unwrap();
        assert_eq!(out, square());
    }

    #[test]
    fn hostile_edges_end_soon() {
        assert_eq!(refine(&square(), Mat4::IDENTITY, 1e-30, 1_000_000), Err(TooMany));
        assert_eq!(refine(&square(), Mat4::IDENTITY, 0.01, 1000), Err(TooMany));
        // A needle whose ends are neighboring numbers, and corners without finite distance.
        let close = f32::from_bits(1f32.to_bits() + 1);
        for far in [Vec3::new(close, 0.0, 0.0), Vec3::splat(f32::MAX), Vec3::splat(f32::NAN)] {
            let mesh = MeshData {
                positions: vec![Vec3::X, far, Vec3::new(1.0, 1e-38, 0.0)],
                uvs: vec![Vec2::ZERO; 3],
                triangles: vec![[0, 1, 2]],
                ..MeshData::default()
            };
            let found = refine(&mesh, Mat4::IDENTITY, 1e-30, 100_000);
            assert!(found == Err(TooMany) || found.unwrap().triangles.len() < 10_000);
        }
    }
}
