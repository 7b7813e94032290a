//! Displaced meshes: split until no edge is too long, their vertices moved along their normals, with smooth normals of what comes out.
//!
//! As in pbrt-v4 (`TriQuadMesh::Displace`), but for two things. Vertices at one place with one normal move together, by the mean of their heights,
//! and share the new normal: pictures that differ across a seam of the texture coordinates tear no crack. And patterns in space are looked up where
//! the vertex is in the world (or its group), not in the mesh's own space.

mod refine;

use std::collections::{HashMap, HashSet};

use etendue_scene::desc::{
    AddNode, CameraDesc, GeometryDesc, ImageSource, MeshData, MeshDesc, Node, Param, Scalar, SceneDesc, ShapeDesc, ShapeId, TextureDesc,
    TextureId,
};
use etendue_scene::{Fault, RenderSettings, Severity, Span};
use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::compile::{compile_with, vertex_normals};
use super::{Scene, Surface};
use crate::math::Frame;
use refine::refine;

/// Most triangles of all displaced meshes of a scene.
pub const DISPLACED_LIMIT: usize = 10_000_000;

/// The displaced meshes of a scene.
#[derive(Debug, Default)]
pub struct Displaced {
    /// The mesh of each displaced shape, in its object space.
    pub meshes: HashMap<ShapeId, MeshData>,
    /// Sentences about values that are no numbers.
    pub warnings: Vec<String>,
}

/// Displaces the meshes of all shapes that ask for it. Meshes must be loaded.
///
/// # Errors
/// Faults of pictures that cannot be read, of textures that need more than a place and its coordinates, and of meshes that would have more than
/// [`DISPLACED_LIMIT`] triangles.
pub fn displace(desc: &SceneDesc) -> Result<Displaced, Vec<Fault>> {
    let mut out = Displaced::default();
    let shapes: Vec<ShapeId> = (0..desc.shapes.len() as u32).map(ShapeId).filter(|id| desc[*id].value.displacement.is_some()).collect();
    if shapes.is_empty() {
        return Ok(out);
    }
    let scene = textures_of(desc, &shapes)?;
    let (mut faults, mut left) = (Vec::new(), DISPLACED_LIMIT);
    for id in shapes {
        let node = &desc[id];
        let Some(mesh) = mesh_of(desc, &node.value).filter(|m| !m.triangles.is_empty()) else { continue };
        let fault = |message| Fault { severity: Severity::Error, span: node.span, message };
        if mesh.uvs.is_empty() {
            faults.push(fault("a displaced mesh needs texture coordinates".to_owned()));
            continue;
        }
        let Some((moved, bad)) = displaced(&scene, &node.value, mesh, left) else {
            let message = format!(
                "edges as short as this would make more than {DISPLACED_LIMIT} triangles of this scene's displaced meshes: take a longer `edgelength`"
            );
            faults.push(fault(message));
            continue;
        };
        if bad > 0 {
            let place = node.span.display(&desc.files);
            out.warnings.push(format!("{place}: {bad} heights of the displacement are no finite numbers: those vertices stay"));
        }
        left -= moved.triangles.len();
        out.meshes.insert(id, moved);
    }
    if faults.is_empty() { Ok(out) } else { Err(faults) }
}

/// Puts displaced meshes in the place of those that are to be displaced, for programs and formats that cannot do it themselves.
///
/// # Errors
/// As of [`displace`].
pub fn bake_displacement(desc: &mut SceneDesc) -> Result<(), Vec<Fault>> {
    let displaced = displace(desc)?;
    for warning in displaced.warnings {
        desc.report.warning(Span::default(), warning);
    }
    let mut meshes: Vec<(ShapeId, MeshData)> = displaced.meshes.into_iter().collect();
    meshes.sort_by_key(|(id, _)| *id);
    for (id, data) in meshes {
        let node = &desc[id];
        let mesh = MeshDesc { file: None, flip_v: false, data: Some(data) };
        let mesh = desc.add(Node::named(node.name.clone(), node.span, mesh));
        let shape = &mut desc.shapes[id.0 as usize].value;
        shape.geometry = GeometryDesc::Mesh { mesh, face_normals: false, smooth: false };
        shape.displacement = None;
    }
    Ok(())
}

fn mesh_of<'a>(desc: &'a SceneDesc, shape: &ShapeDesc) -> Option<&'a MeshData> {
    let GeometryDesc::Mesh { mesh, .. } = shape.geometry else { return None };
    desc[mesh].value.data.as_ref()
}

/// A scene of nothing but the textures that displace these shapes.
fn textures_of(desc: &SceneDesc, shapes: &[ShapeId]) -> Result<Scene, Vec<Fault>> {
    let mut todo: Vec<(TextureId, Span)> = Vec::new();
    for id in shapes {
        let node = &desc[*id];
        if let Some(Scalar::Texture(t)) = node.value.displacement.as_ref().map(|d| d.height) {
            todo.push((t, node.span));
        }
    }
    let (mut used, mut images, mut faults) = (HashSet::new(), HashSet::new(), Vec::new());
    while let Some((id, span)) = todo.pop() {
        if !used.insert(id) {
            continue;
        }
        let texture = &desc[id].value;
        todo.extend(texture.parts().into_iter().map(|part| (part, span)));
        let of_mesh = match texture {
            TextureDesc::Attribute { .. } => true,
            TextureDesc::Bitmap(bitmap) => {
                images.insert(bitmap.image);
                bitmap.uv_set > 0
            }
            _ => false,
        };
        if of_mesh {
            let message = "a mesh cannot be displaced by its attributes or by its second texture coordinates".to_owned();
            faults.push(Fault { severity: Severity::Error, span, message });
        }
    }
    if !faults.is_empty() {
        return Err(faults);
    }
    let mut only = SceneDesc { files: desc.files.clone(), ..SceneDesc::default() };
    for (i, node) in desc.textures.iter().enumerate() {
        let value = if used.contains(&TextureId(i as u32)) { node.value.clone() } else { TextureDesc::Constant { value: [0.0; 3] } };
        only.textures.push(Node { value, ..node.clone() });
    }
    for (i, node) in desc.images.iter().enumerate() {
        let mut image = node.clone();
        if !images.contains(&etendue_scene::desc::ImageId(i as u32)) {
            image.value.source = ImageSource::Pixels { width: 1, height: 1, channels: 1, data: vec![0.0] };
        }
        only.images.push(image);
    }
    only.add(Node::new(Span::default(), CameraDesc::default()));
    compile_with(&only, &RenderSettings::default(), [1, 1], None)
}

/// A displaced mesh, with the number of heights that are no numbers; `None` where it would have more than `most` triangles.
fn displaced(scene: &Scene, shape: &ShapeDesc, mesh: &MeshData, most: usize) -> Option<(MeshData, usize)> {
    let displacement = shape.displacement.as_ref()?;
    let m = shape.world_from_object;
    let coarse;
    let mesh = if mesh.normals.is_empty() {
        let normals = joined_normals(mesh, &places(mesh));
        coarse = MeshData { normals, ..mesh.clone() };
        &coarse
    } else {
        mesh
    };
    let mut out = refine(mesh, m, displacement.edge_length, most).ok()?;
    let normal_matrix = Mat3::from_mat4(m).inverse().transpose();
    let height = |i: usize| {
        let ng = (normal_matrix * out.normals[i]).normalize_or(Vec3::Z);
        let at = Surface::free(m.transform_point3(out.positions[i]), Frame::from_normal(ng));
        scene.scalar(&displacement.height, &Surface { uv: out.uvs[i], dpdu: Vec3::ZERO, dpdv: Vec3::ZERO, ..at })
    };
    let heights: Vec<f32> = match displacement.height {
        Param::Constant(h) => vec![h; out.positions.len()],
        Param::Texture(_) => (0..out.positions.len()).into_par_iter().map(height).collect(),
    };
    let first = places(&out);
    // Sums in the order of the vertices.
    let mut sums = vec![(0f64, 0u32); heights.len()];
    for (h, first) in heights.iter().zip(&first) {
        let sum = &mut sums[*first as usize];
        *sum = (sum.0 + f64::from(*h), sum.1 + 1);
    }
    let mut bad = 0;
    for (i, first) in first.iter().enumerate() {
        let (sum, count) = sums[*first as usize];
        let moved = out.positions[i] + out.normals[i].normalize_or_zero() * (sum / f64::from(count)) as f32;
        if moved.is_finite() {
            out.positions[i] = moved;
        } else {
            bad += 1;
        }
    }
    out.normals = joined_normals(&out, &first);
    Some((out, bad))
}

/// For each vertex, the first one at its place with its normal.
fn places(mesh: &MeshData) -> Vec<u32> {
    // Zeros of both signs are one place.
    let bits = |v: Vec3| (v + Vec3::ZERO).to_array().map(f32::to_bits);
    let key = |i: u32| (bits(mesh.positions[i as usize]), mesh.normals.get(i as usize).map(|n| bits(*n)));
    let mut order: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    order.par_sort_unstable_by_key(|&i| (key(i), i));
    let mut first = vec![0; order.len()];
    for run in order.chunk_by(|a, b| key(*a) == key(*b)) {
        for &i in run {
            first[i as usize] = run[0];
        }
    }
    first
}

/// Smooth normals where each vertex counts as the one given for it.
fn joined_normals(mesh: &MeshData, first: &[u32]) -> Vec<Vec3> {
    let triangles = mesh.triangles.iter().map(|t| t.map(|i| first[i as usize])).collect();
    let joined = MeshData { positions: mesh.positions.clone(), triangles, ..MeshData::default() };
    let normals = vertex_normals(&joined);
    first.iter().map(|i| normals[*i as usize]).collect()
}
