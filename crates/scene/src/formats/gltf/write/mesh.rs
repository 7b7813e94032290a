//! Shapes become meshes with primitives.

use glam::Vec3;
use serde_json::{Map, Value, json};

use super::Writer;
use crate::desc::{GeometryDesc, MeshData, MeshId, ShapeDesc, ShapeId};
use crate::formats::tessellate::tessellate;

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// What tells one form of a mesh's data from another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct DataKey {
    mesh: MeshId,
    flat: bool,
    smooth: bool,
    flipped: bool,
    colors: bool,
}

/// Attributes and the accessor of the indices.
pub(super) type Written = (Map<String, Value>, usize);

impl Writer<'_> {
    /// A mesh with a primitive for each shape; `None` where nothing is left of them.
    pub(super) fn mesh_of(&mut self, shapes: &[ShapeId]) -> Option<usize> {
        let mut primitives = Vec::new();
        let mut name = String::new();
        for id in shapes {
            let node = &self.desc[*id];
            let shape = &node.value;
            name.clone_from(match shape.geometry {
                GeometryDesc::Mesh { mesh, .. } => &self.desc[mesh].name,
                _ => &node.name,
            });
            let (material, colors) = self.material(shape, node.span);
            let Some((attributes, indices)) = self.data(*id, shape, colors) else { continue };
            primitives.push(json!({"attributes": attributes, "indices": indices, "material": material}));
        }
        if primitives.is_empty() {
            return None;
        }
        let mut mesh = json!({ "primitives": primitives });
        if !name.is_empty() {
            mesh["name"] = json!(name);
        }
        Some(self.push("meshes", mesh))
    }

    fn data(&mut self, id: ShapeId, shape: &ShapeDesc, colors: bool) -> Option<Written> {
        let span = self.desc[id].span;
        if shape.displacement.is_some() {
            self.loss(span, "displacement of a mesh", "the mesh without it");
        }
        let &GeometryDesc::Mesh { mesh, face_normals, smooth } = &shape.geometry else {
            if matches!(shape.geometry, GeometryDesc::Plane) {
                self.loss(span, "infinite plane", "written as a square of 2000 units");
            }
            let Some(mut data) = tessellate(&shape.geometry) else {
                self.loss(span, "polygon with holes", "left out");
                return None;
            };
            if matches!(shape.geometry, GeometryDesc::Sphere { .. } | GeometryDesc::Disk | GeometryDesc::Cylinder { .. }) {
                self.loss(span, "analytic shape", "written as triangles");
            }
            if shape.flip_normals {
                flip(&mut data);
            }
            return Some(self.write_data(&data, false));
        };
        let key = DataKey { mesh, flat: face_normals, smooth, flipped: shape.flip_normals, colors };
        if let Some(known) = self.attributes.get(&key) {
            return known.clone();
        }
        let node = &self.desc[mesh];
        let written = match &node.value.data {
            None => {
                self.loss(node.span, "mesh file", "left out: it is not loaded");
                None
            }
            Some(data) if data.triangles.is_empty() || data.positions.is_empty() => None,
            Some(data) => {
                let mut data = data.clone();
                if face_normals {
                    data.normals.clear();
                } else if smooth && data.normals.is_empty() {
                    data.normals = smooth_normals(&data);
                }
                if shape.flip_normals {
                    flip(&mut data);
                }
                for a in data.attributes.iter().filter(|a| a.per_face) {
                    self.loss(node.span, &format!("face attribute `{}`", a.name), "not written");
                }
                Some(self.write_data(&data, colors))
            }
        };
        self.attributes.insert(key, written.clone());
        written
    }

    fn accessor(&mut self, bytes: &[u8], target: u32, component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes, Some(target));
        self.push("accessors", json!({"bufferView": view, "componentType": component, "type": kind, "count": count}))
    }

    fn floats(&mut self, values: impl Iterator<Item = f32>, width: usize) -> usize {
        let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        self.accessor(&bytes, ARRAY_BUFFER, FLOAT, kind, bytes.len() / (4 * width))
    }

    /// Attributes and indices.
    fn write_data(&mut self, data: &MeshData, colors: bool) -> Written {
        let mut attributes = Map::new();
        let mut put = |name: String, accessor: usize| attributes.insert(name, json!(accessor));
        let position = self.floats(data.positions.iter().flat_map(|p| p.to_array()), 3);
        let (min, max) = data.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        if let Some(a) = self.lists.get_mut("accessors").and_then(|l| l.get_mut(position)) {
            a["min"] = json!(min.to_array());
            a["max"] = json!(max.to_array());
        }
        put("POSITION".to_owned(), position);
        if !data.normals.is_empty() {
            put("NORMAL".to_owned(), self.floats(data.normals.iter().flat_map(|n| n.to_array()), 3));
            if !data.tangents.is_empty() {
                put("TANGENT".to_owned(), self.floats(data.tangents.iter().flat_map(|t| t.to_array()), 4));
            }
        }
        let find = |name: &str, width: u32| data.attributes.iter().find(|a| a.name == name && a.width == width && !a.per_face);
        let sets = (1..8).take_while(|i| find(&format!("uv{i}"), 2).is_some()).count();
        if !data.uvs.is_empty() {
            put("TEXCOORD_0".to_owned(), self.floats(data.uvs.iter().flat_map(|uv| [uv.x, 1.0 - uv.y]), 2));
        } else if sets > 0 {
            // Sets must be counted without gaps.
            put("TEXCOORD_0".to_owned(), self.floats(data.positions.iter().flat_map(|_| [0.0, 0.0]), 2));
        }
        for i in 1..=sets {
            if let Some(a) = find(&format!("uv{i}"), 2) {
                put(format!("TEXCOORD_{i}"), self.floats(a.data.chunks_exact(2).flat_map(|uv| [uv[0], 1.0 - uv[1]]), 2));
            }
        }
        if let (true, Some(a)) = (colors, find("color", 3).or_else(|| find("color", 4))) {
            put("COLOR_0".to_owned(), self.floats(a.data.iter().copied(), a.width as usize));
        }
        let bytes: Vec<u8> = data.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()).collect();
        let indices = self.accessor(&bytes, ELEMENT_ARRAY_BUFFER, UNSIGNED_INT, "SCALAR", 3 * data.triangles.len());
        (attributes, indices)
    }
}

/// Turns inside and outside round.
fn flip(data: &mut MeshData) {
    for t in &mut data.triangles {
        t.swap(1, 2);
    }
    for n in &mut data.normals {
        *n = -*n;
    }
    // cross(n, t) turned round with n.
    for t in &mut data.tangents {
        t.w = -t.w;
    }
}

/// Normals of vertices, weighted by the areas of the triangles around them.
fn smooth_normals(data: &MeshData) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; data.positions.len()];
    for t in &data.triangles {
        let [a, b, c] = t.map(|i| data.positions[i as usize]);
        let n = (b - a).cross(c - a);
        for &i in t {
            normals[i as usize] += n;
        }
    }
    normals.iter().map(|n| n.normalize_or(Vec3::Z)).collect()
}
