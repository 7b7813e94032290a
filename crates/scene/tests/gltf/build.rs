//! Builds small glTF files.

use std::path::Path;

use etendue_scene::desc::{BsdfDesc, GeometryDesc, MeshData, PbrDesc, ShapeDesc};
use etendue_scene::formats::{ReadOptions, gltf};
use etendue_scene::{ReadError, SceneDesc};
use serde_json::{Value, json};

/// A glTF file in the making.
#[derive(Clone)]
pub struct Build {
    pub json: Value,
    pub bin: Vec<u8>,
}

pub const F32: u32 = 5126;
pub const U32: u32 = 5125;
pub const U16: u32 = 5123;
pub const I16: u32 = 5122;
pub const U8: u32 = 5121;
pub const I8: u32 = 5120;

/// A PNG of one pixel is as good as any: the reader does not decode pictures.
pub const PNG: &[u8] = b"\x89PNG\r\n\x1a\n pixels";

pub fn f32s(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

pub fn u16s(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

impl Build {
    /// A file without anything.
    pub fn new() -> Self {
        Self { json: json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}), bin: Vec::new() }
    }

    /// A triangle in the xy plane, (0,0), (1,0), (0,1), on node 0.
    pub fn triangle() -> Self {
        let mut b = Self::new();
        let position = b.accessor(&f32s(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]), F32, "VEC3", 3);
        b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}}]}));
        b.node(json!({"mesh": 0}));
        b
    }

    /// Appends to a list of the root; returns the number.
    pub fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json.as_object_mut().unwrap().entry(list).or_insert_with(|| json!([])).as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    /// Adds a node to the scene.
    pub fn node(&mut self, node: Value) -> usize {
        let i = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(i));
        i
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.bin.len().is_multiple_of(4) {
            self.bin.push(0);
        }
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    pub fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.push("accessors", json!({"bufferView": view, "componentType": component, "type": kind, "count": count}))
    }

    pub fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    /// Gives the triangle a material with texture 0.
    pub fn with_material(mut self, material: Value) -> Self {
        let view = self.view(PNG);
        let image = self.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
        self.push("textures", json!({"source": image}));
        let m = self.push("materials", material);
        self.primitive()["material"] = json!(m);
        self
    }

    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        glb(&serde_json::to_vec(&json).unwrap(), &self.bin)
    }

    pub fn read_with(&self, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
        gltf::read_bytes(&self.glb(), Path::new("test.glb"), options)
    }

    /// The description of a file that must be read without error.
    pub fn read(&self) -> SceneDesc {
        self.read_with(&ReadOptions::default()).unwrap()
    }

    /// The message about a file that must not be read.
    pub fn error(&self) -> String {
        self.read_with(&ReadOptions::default()).unwrap_err().to_string()
    }

    /// The material of the first shape of the description.
    pub fn pbr(&self) -> PbrDesc {
        let desc = self.read();
        let pbr = desc.bsdfs.iter().find_map(|b| if let BsdfDesc::Pbr(p) = &b.value { Some((**p).clone()) } else { None });
        pbr.unwrap()
    }
}

pub fn glb(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    while !json.len().is_multiple_of(4) {
        json.push(b' ');
    }
    let mut bin = bin.to_vec();
    while !bin.len().is_multiple_of(4) {
        bin.push(0);
    }
    let length = 12 + 8 + json.len() + 8 + bin.len();
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((length as u32).to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(bin);
    out
}

pub fn mesh_of<'a>(desc: &'a SceneDesc, shape: &ShapeDesc) -> &'a MeshData {
    let GeometryDesc::Mesh { mesh, .. } = shape.geometry else { panic!("no mesh") };
    desc[mesh].value.data.as_ref().unwrap()
}

/// The mesh of the first shape.
pub fn mesh(desc: &SceneDesc) -> &MeshData {
    mesh_of(desc, &desc.shapes[0].value)
}
