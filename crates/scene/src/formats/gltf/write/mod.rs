//! The writer: [`SceneDesc`] → glTF, with a [`Loss`] for everything that glTF cannot say.

mod light;
mod material;
mod mesh;
mod png;
mod texture;

use std::collections::{BTreeSet, HashMap};
use std::io::{Error, ErrorKind};
use std::path::Path;

use glam::Mat4;
use serde_json::{Map, Value, json};

use crate::desc::{GeometryDesc, GroupId, ImageId, SceneDesc, ShapeDesc, ShapeId};
use crate::report::{Loss, Report};
use crate::span::Span;

/// Writes a scene as glTF 2.0: one file where the name ends in `.glb`, otherwise JSON with a `.bin` of the same name beside it.
/// Pictures are embedded. Analytic shapes become triangles, other materials the nearest metallic-roughness material; meshes must be
/// loaded. Returns what was lost.
///
/// # Errors
/// The system's error where a file cannot be written; `FileTooLarge` where the data exceed the 4 GiB of a GLB.
pub fn write(desc: &SceneDesc, path: &Path) -> std::io::Result<Vec<Loss>> {
    let mut writer = Writer::new(desc);
    writer.write_scene();
    let binary = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    let bin_path = path.with_extension("bin");
    let uri = bin_path.file_name().map(|n| n.to_string_lossy().into_owned()).filter(|_| !binary);
    let (json, bin, losses) = writer.finish(uri.as_deref());
    if binary {
        std::fs::write(path, glb(json, bin)?)?;
    } else {
        std::fs::write(path, json)?;
        if !bin.is_empty() {
            std::fs::write(bin_path, bin)?;
        }
    }
    Ok(losses)
}

/// The bytes of a GLB and what was lost; see [`write`].
///
/// # Errors
/// `FileTooLarge` where the data exceed the 4 GiB of a GLB.
pub fn write_glb(desc: &SceneDesc) -> std::io::Result<(Vec<u8>, Vec<Loss>)> {
    let mut writer = Writer::new(desc);
    writer.write_scene();
    let (json, bin, losses) = writer.finish(None);
    Ok((glb(json, bin)?, losses))
}

fn glb(mut json: Vec<u8>, mut bin: Vec<u8>) -> std::io::Result<Vec<u8>> {
    json.resize(json.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let too_large = |_| Error::new(ErrorKind::FileTooLarge, "a GLB holds at most 4 GiB; write a .gltf instead");
    let size = |n: usize| u32::try_from(n).map_err(too_large);
    let total = size(20 + json.len() + if bin.is_empty() { 0 } else { 8 + bin.len() })?;
    let mut out = Vec::with_capacity(total as usize);
    out.extend(b"glTF\x02\0\0\0");
    out.extend(total.to_le_bytes());
    out.extend(size(json.len())?.to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    if !bin.is_empty() {
        out.extend(size(bin.len())?.to_le_bytes());
        out.extend(b"BIN\0");
        out.extend(bin);
    }
    Ok(out)
}

/// What is written so far.
struct Writer<'a> {
    desc: &'a SceneDesc,
    /// The lists of the root object.
    lists: HashMap<&'static str, Vec<Value>>,
    bin: Vec<u8>,
    used: BTreeSet<&'static str>,
    required: BTreeSet<&'static str>,
    lights: Vec<Value>,
    report: Report,
    /// Losses that are told once.
    told: BTreeSet<String>,
    attributes: HashMap<mesh::DataKey, Option<mesh::Written>>,
    materials: HashMap<String, usize>,
    images: HashMap<ImageId, Option<texture::Image>>,
    textures: HashMap<String, usize>,
}

impl<'a> Writer<'a> {
    fn new(desc: &'a SceneDesc) -> Self {
        Self {
            desc,
            lists: HashMap::new(),
            bin: Vec::new(),
            used: BTreeSet::new(),
            required: BTreeSet::new(),
            lights: Vec::new(),
            report: Report::default(),
            told: BTreeSet::new(),
            attributes: HashMap::new(),
            materials: HashMap::new(),
            images: HashMap::new(),
            textures: HashMap::new(),
        }
    }

    /// Appends to a list of the root object; returns the number.
    fn push(&mut self, list: &'static str, value: Value) -> usize {
        let list = self.lists.entry(list).or_default();
        list.push(value);
        list.len() - 1
    }

    fn loss(&mut self, span: Span, feature: &str, effect: &str) {
        if self.told.insert(format!("{span:?}{feature}{effect}")) {
            self.report.loss(span, feature, effect);
        }
    }

    /// Appends bytes at a multiple of four and makes a view of them.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bin.extend(bytes);
        self.push("bufferViews", view)
    }

    fn write_scene(&mut self) {
        let mut roots = Vec::new();
        let mut in_group = vec![false; self.desc.shapes.len()];
        for group in &self.desc.groups {
            for s in &group.value.shapes {
                in_group[s.0 as usize] = true;
            }
        }
        for (i, shape) in self.desc.shapes.iter().enumerate().filter(|(i, _)| !in_group[*i]) {
            if let Some(mesh) = self.mesh_of(&[ShapeId(i as u32)]) {
                roots.push(self.node(&shape.name, shape.value.world_from_object, "mesh", json!(mesh)));
            }
        }
        let mut groups = HashMap::new();
        for instance in &self.desc.instances {
            let group = instance.value.group;
            let content = groups.entry(group).or_insert_with(|| self.group(group));
            for (transform, mesh) in content.iter() {
                let world = instance.value.world_from_object * *transform;
                roots.push(self.node(&instance.name, world, "mesh", json!(mesh)));
            }
        }
        self.write_lights(&mut roots);
        self.write_cameras(&mut roots);
        // Lists must not be empty.
        self.push("scenes", if roots.is_empty() { json!({}) } else { json!({ "nodes": roots }) });
        if !self.desc.integrator.name.is_empty() || self.desc.film.spp.is_some() {
            self.loss(Span::default(), "integrator, sampler and film", "not written: glTF says nothing of how to render");
        }
    }

    /// The meshes of a group and their places in its space: one mesh of several primitives where all have the same place.
    fn group(&mut self, group: GroupId) -> Vec<(Mat4, usize)> {
        let shapes = &self.desc[group].value.shapes;
        let shape = |s: &ShapeId| &self.desc[*s].value;
        let is_mesh = |s: &ShapeDesc| matches!(s.geometry, GeometryDesc::Mesh { .. });
        let Some(first) = shapes.first() else { return Vec::new() };
        let place = shape(first).world_from_object;
        if shapes.iter().all(|s| shape(s).world_from_object == place && is_mesh(shape(s))) {
            return self.mesh_of(shapes).map(|m| (place, m)).into_iter().collect();
        }
        shapes.iter().filter_map(|s| Some((self.desc[*s].value.world_from_object, self.mesh_of(&[*s])?))).collect()
    }

    /// Adds a node that holds something.
    fn node(&mut self, name: &str, transform: Mat4, key: &str, value: Value) -> usize {
        let mut node = json!({ key: value });
        if !name.is_empty() {
            node["name"] = json!(name);
        }
        if transform != Mat4::IDENTITY {
            node["matrix"] = json!(transform.to_cols_array());
        }
        self.push("nodes", node)
    }

    /// JSON text, binary data, losses.
    fn finish(mut self, uri: Option<&str>) -> (Vec<u8>, Vec<u8>, Vec<Loss>) {
        let mut root = Map::new();
        root.insert("asset".to_owned(), json!({"version": "2.0", "generator": "etendue"}));
        root.insert("scene".to_owned(), json!(0));
        if !self.bin.is_empty() {
            let mut buffer = json!({"byteLength": self.bin.len()});
            if let Some(uri) = uri {
                buffer["uri"] = json!(uri);
            }
            self.push("buffers", buffer);
        }
        if !self.lights.is_empty() {
            self.used.insert("KHR_lights_punctual");
            root.insert("extensions".to_owned(), json!({"KHR_lights_punctual": {"lights": self.lights}}));
        }
        if !self.used.is_empty() {
            root.insert("extensionsUsed".to_owned(), json!(self.used));
        }
        if !self.required.is_empty() {
            root.insert("extensionsRequired".to_owned(), json!(self.required));
        }
        let mut lists: Vec<_> = self.lists.into_iter().collect();
        lists.sort_by_key(|(name, _)| *name);
        for (name, list) in lists {
            root.insert(name.to_owned(), Value::Array(list));
        }
        (Value::Object(root).to_string().into_bytes(), self.bin, self.report.losses)
    }
}
