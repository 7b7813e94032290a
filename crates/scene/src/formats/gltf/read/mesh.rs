//! Primitives of meshes become [`MeshData`].

use glam::{Vec2, Vec3, Vec4};

use super::Reader;
use super::accessor::Component::{self, F32, I8, I16, U8, U16, U32};
use super::deform::Deform;
use crate::desc::{AddNode, MeshAttribute, MeshData, MeshDesc, MeshId, Node};

use crate::formats::gltf::json::Value;
use crate::span::Span;

/// What tells one loaded form of a mesh from another.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct MeshKey {
    pub mesh: usize,
    /// Number of the node where the node's skin or weights change the mesh.
    pub deformed_by: Option<usize>,
    /// Mirrored in x.
    pub mirrored: bool,
}

/// A loaded primitive.
#[derive(Clone, Debug)]
pub(super) struct Primitive {
    pub mesh: MeshId,
    pub material: Option<usize>,
    pub triangles: usize,
    pub has_color: bool,
    pub has_alpha: bool,
    pub span: Span,
}

/// How far sets of texture coordinates are looked for.
const UV_SETS: usize = 8;

impl<'a> Reader<'a> {
    /// The primitives of a mesh; those that cannot be read are left out.
    pub(super) fn load_mesh(&mut self, key: &MeshKey, mesh: &'a Value<'a>, deform: &Deform) -> Vec<Primitive> {
        if let Some(known) = self.meshes.get(key) {
            return known.clone();
        }
        let name = self.name(mesh);
        self.required(mesh, "primitives");
        let mut primitives = Vec::new();
        for primitive in self.array(mesh, "primitives") {
            let Some(mut data) = self.primitive(primitive, deform) else { continue };
            if data.triangles.is_empty() {
                continue;
            }
            if key.mirrored {
                mirror_x(&mut data);
            }
            let material = self.primitive_material(primitive);
            let has = |name| data.attributes.iter().any(|a| a.name == name);
            let (has_color, has_alpha, triangles) = (has("color"), has("alpha"), data.triangles.len());
            let span = self.span(primitive);
            let id = self.desc.add(Node::named(name.clone(), span, MeshDesc { file: None, flip_v: false, data: Some(data) }));
            primitives.push(Primitive { mesh: id, material, triangles, has_color, has_alpha, span });
        }
        self.meshes.insert(key.clone(), primitives.clone());
        primitives
    }

    /// The material of a primitive, after the choice of a variant.
    fn primitive_material(&mut self, primitive: &'a Value<'a>) -> Option<usize> {
        if let (Some(variant), Some(extension)) = (self.variant, self.extension(primitive, "KHR_materials_variants")) {
            for mapping in self.array(extension, "mappings") {
                if self.array(mapping, "variants").iter().any(|v| v.as_f64() == Some(variant as f64)) {
                    return self.reference(mapping, "material", "materials").map(|(i, _)| i);
                }
            }
        }
        self.reference(primitive, "material", "materials").map(|(i, _)| i)
    }

    fn primitive(&mut self, primitive: &'a Value<'a>, deform: &Deform) -> Option<MeshData> {
        let mode = if primitive.get("mode").is_some() { self.integer(primitive, "mode")? } else { 4 };
        if mode < 4 {
            self.loss(primitive, if mode == 0 { "points" } else { "lines" }, "ignored");
            return None;
        }
        if mode > 6 {
            self.error(primitive, format!("unknown mode {mode}"));
            return None;
        }
        self.required(primitive, "attributes")?;
        let attributes = self.object(primitive, "attributes")?;
        self.required(attributes, "POSITION")?;
        if let Some(draco) = self.extension(primitive, "KHR_draco_mesh_compression")
            && !self.has_plain_data(attributes)
        {
            self.error(draco, "Draco compression is not supported (KHR_draco_mesh_compression); decompress the file first");
            return None;
        }
        let mut data = self.vertices(attributes)?;
        self.deform(primitive, attributes, &mut data, deform)?;
        data.triangles = self.triangles(primitive, mode, data.positions.len())?;
        repair_normals(&mut data);
        Some(data)
    }

    /// Whether the accessor of the positions has data of its own.
    fn has_plain_data(&mut self, attributes: &'a Value<'a>) -> bool {
        let accessor = self.reference(attributes, "POSITION", "accessors");
        accessor.is_some_and(|(_, a)| a.get("bufferView").is_some() || a.get("sparse").is_some())
    }

    fn vertices(&mut self, attributes: &'a Value<'a>) -> Option<MeshData> {
        const QUANTIZED: &[Component] = &[F32, I8, U8, I16, U16];
        let mut data = MeshData::default();
        let at = attributes.get("POSITION")?;
        data.positions = self.elements::<f32>(at, &[3], QUANTIZED)?.arrays().map(Vec3::from_array).collect();
        if let Some(i) = data.positions.iter().position(|p| !p.is_finite()) {
            self.error(at, format!("the position of vertex {i} is not finite"));
            return None;
        }
        let count = data.positions.len();
        if let Some(at) = attributes.get("NORMAL") {
            let normals = self.elements::<f32>(at, &[3], &[F32, I8, I16])?;
            if self.same_count(at, normals.len(), count) {
                data.normals = normals.arrays().map(|n| unit(Vec3::from_array(n))).collect();
                if data.normals.contains(&Vec3::ZERO) {
                    self.warning(at, "normals of length 0 or not finite; replaced by those of a triangle");
                }
            }
        }
        // glTF 2.0, 3.7.2.1: tangents mean nothing without normals.
        if let (Some(at), false) = (attributes.get("TANGENT"), data.normals.is_empty()) {
            let tangents = self.elements::<f32>(at, &[4], &[F32, I8, I16])?;
            let tangent = |t: [f32; 4]| unit(Vec3::new(t[0], t[1], t[2])).extend(if t[3] < 0.0 { -1.0 } else { 1.0 });
            let tangents: Vec<Vec4> = tangents.arrays().map(tangent).collect();
            if self.same_count(at, tangents.len(), count) {
                if tangents.iter().any(|t| t.truncate() == Vec3::ZERO) {
                    self.warning(at, "tangents of length 0 or not finite; all are derived from the texture coordinates");
                } else {
                    data.tangents = tangents;
                }
            }
        }
        for set in 0..UV_SETS {
            let Some(at) = attributes.get(&format!("TEXCOORD_{set}")) else { break };
            let uvs = self.elements::<f32>(at, &[2], QUANTIZED)?;
            if !self.same_count(at, uvs.len(), count) {
                continue;
            }
            if uvs.data.iter().any(|v| !v.is_finite()) {
                self.warning(at, "texture coordinates that are not finite; taken as 0");
            }
            let uvs = uvs.arrays().map(|[u, v]| if u.is_finite() && v.is_finite() { Vec2::new(u, 1.0 - v) } else { Vec2::ZERO });
            if set == 0 {
                data.uvs = uvs.collect();
            } else {
                let values = uvs.flat_map(|uv| uv.to_array()).collect();
                data.attributes.push(MeshAttribute { name: format!("uv{set}"), per_face: false, width: 2, data: values });
            }
        }
        if let Some(at) = attributes.get("COLOR_0") {
            let colors = self.elements::<f32>(at, &[3, 4], &[F32, U8, U16])?;
            if self.same_count(at, colors.len(), count) {
                let finite = |v: &f32| if v.is_finite() { v.max(0.0) } else { 0.0 };
                let rgb = colors.data.chunks_exact(colors.width).flat_map(|c| c[..3].iter().map(finite)).collect();
                data.attributes.push(MeshAttribute { name: "color".to_owned(), per_face: false, width: 3, data: rgb });
                if colors.width == 4 && colors.data.chunks_exact(4).any(|c| c[3] != 1.0) {
                    let alpha = colors.data.chunks_exact(4).map(|c| finite(&c[3])).collect();
                    data.attributes.push(MeshAttribute { name: "alpha".to_owned(), per_face: false, width: 1, data: alpha });
                }
            }
        }
        if let Some(at) = attributes.get("COLOR_1") {
            self.loss(at, "COLOR_1", "ignored");
        }
        Some(data)
    }

    pub(super) fn same_count(&mut self, at: &Value<'_>, count: usize, positions: usize) -> bool {
        if count != positions {
            self.error(at, format!("{count} values for {positions} vertices"));
        }
        count == positions
    }

    fn triangles(&mut self, primitive: &'a Value<'a>, mode: u64, vertices: usize) -> Option<Vec<[u32; 3]>> {
        let indices = match primitive.get("indices") {
            Some(at) => {
                let indices = self.elements::<u32>(at, &[1], &[U8, U16, U32])?.data;
                if let Some(&i) = indices.iter().find(|&&i| i as usize >= vertices) {
                    self.error(at, format!("index {i} is out of range: there are {vertices} vertices"));
                    return None;
                }
                indices
            }
            None if u32::try_from(vertices).is_ok() => (0..vertices as u32).collect(),
            None => return None,
        };
        let n = indices.len();
        if mode == 4 && n % 3 != 0 {
            self.warning(primitive, format!("{n} indices are no whole number of triangles; the rest is left out"));
        }
        let mut triangles: Vec<[u32; 3]> = match mode {
            4 => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            // Every other triangle of a strip is turned, so that all face the same way (glTF 2.0, 3.7.2.1).
            5 => indices.windows(3).enumerate().map(|(i, t)| [t[0], t[1 + i % 2], t[2 - i % 2]]).collect(),
            _ => indices.windows(2).skip(1).map(|t| [t[0], t[1], indices[0]]).collect(),
        };
        triangles.retain(|[a, b, c]| a != b && b != c && a != c);
        Some(triangles)
    }
}

/// A vector of length 1: as it is where it is one but for rounding, so that writing and reading again changes nothing.
fn unit(v: Vec3) -> Vec3 {
    if (v.length_squared() - 1.0).abs() < 1e-6 { v } else { v.normalize_or_zero() }
}

/// Puts the mirror image in x in place of a mesh, with the outside still outside.
fn mirror_x(data: &mut MeshData) {
    for p in data.positions.iter_mut().chain(&mut data.normals) {
        p.x = -p.x;
    }
    for t in &mut data.tangents {
        t.x = -t.x;
        // A mirror turns cross(n, t) round.
        t.w = -t.w;
    }
    for t in &mut data.triangles {
        t.swap(1, 2);
    }
}

/// Gives vertices without a usable normal that of one of their triangles.
fn repair_normals(data: &mut MeshData) {
    if !data.normals.contains(&Vec3::ZERO) {
        return;
    }
    for t in &data.triangles {
        let [a, b, c] = t.map(|i| data.positions[i as usize]);
        let n = (b - a).cross(c - a).normalize_or_zero();
        for &i in t {
            let normal = &mut data.normals[i as usize];
            if *normal == Vec3::ZERO {
                *normal = n;
            }
        }
    }
    for n in data.normals.iter_mut().filter(|n| **n == Vec3::ZERO) {
        *n = Vec3::Z;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirrored_mesh_keeps_its_outside() {
        let mut data = MeshData {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            normals: vec![Vec3::Z; 3],
            tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 3],
            ..MeshData::default()
        };
        mirror_x(&mut data);
        let [a, b, c] = data.triangles[0].map(|i| data.positions[i as usize]);
        assert!((b - a).cross(c - a).z > 0.0);
        let (n, t) = (data.normals[0], data.tangents[0]);
        // The mirror image of the bitangent +y.
        assert_eq!(n.cross(t.truncate()) * t.w, Vec3::Y);
    }
}
