//! The reader: JSON tree → [`SceneDesc`]. [`Reader`] carries what the parts share.

mod accessor;
mod animation;
mod buffer;
mod deform;
mod extensions;
mod field;
mod light;
mod material;
mod mesh;
mod node;
mod texture;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use super::container;
use super::json::{self, Places, Value};
use crate::desc::{ImageId, SceneDesc, TextureId};
use crate::formats::{ReadOptions, Resolver};
use crate::report::{Fault, ReadError, Severity};
use crate::span::{FileId, Span};

/// Reads a glTF or GLB file that is already in memory; `path` tells which folder its other files are in.
///
/// # Errors
/// [`ReadError`] with every fault that was found.
pub fn read_bytes(bytes: &[u8], path: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let fail = |span, message: String| {
        Err(ReadError::Invalid { files: vec![path.to_owned()], faults: vec![Fault { severity: Severity::Error, span, message }] })
    };
    let container = match container::split(bytes) {
        Ok(c) => c,
        Err(message) => return fail(Span::file(FileId(0)), message),
    };
    let text = match std::str::from_utf8(container.json) {
        Ok(text) => text,
        Err(e) => {
            let good = std::str::from_utf8(&container.json[..e.valid_up_to()]).unwrap_or_default();
            return fail(Places::new(good).span(good.len()), "the JSON is not UTF-8".to_owned());
        }
    };
    let places = Places::new(text);
    let root = match json::parse(text) {
        Ok(root) => root,
        Err(e) => return fail(places.span(e.at), e.message.to_owned()),
    };
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let mut reader = Reader {
        root: &root,
        places: &places,
        options,
        resolver: Resolver::new(&folder, &options.search_paths),
        folder,
        binary: container.binary,
        desc: SceneDesc::new("gltf", path),
        // Hostile files must not make much of little; honest ones hold most of their data as it is.
        budget: (1 << 28) + 64 * bytes.len() as u64,
        over_budget: false,
        told: HashSet::new(),
        buffers: HashMap::new(),
        files: HashMap::new(),
        views: HashMap::new(),
        images: HashMap::new(),
        textures: HashMap::new(),
        materials: HashMap::new(),
        variant: None,
        meshes: HashMap::new(),
    };
    for w in container.warnings {
        reader.desc.report.warning(Span::file(FileId(0)), w);
    }
    if let Err(reason) = reader.check_head() {
        return Err(ReadError::Unsupported { path: path.to_owned(), reason });
    }
    reader.read_scene();
    let desc = reader.desc;
    if desc.report.has_errors() {
        return Err(ReadError::Invalid { files: desc.files, faults: desc.report.faults });
    }
    Ok(desc)
}

/// Everything that reading a file shares.
struct Reader<'a> {
    root: &'a Value<'a>,
    places: &'a Places<'a>,
    options: &'a ReadOptions,
    resolver: Resolver,
    /// Where relative addresses start.
    folder: PathBuf,
    /// The binary chunk of a GLB.
    binary: Option<&'a [u8]>,
    desc: SceneDesc,
    /// Bytes that decoding may still take.
    budget: u64,
    over_budget: bool,
    /// The errors so far.
    told: HashSet<String>,
    buffers: HashMap<usize, Option<buffer::Bytes<'a>>>,
    /// External files that were read, by path.
    files: HashMap<PathBuf, buffer::Bytes<'a>>,
    /// Decoded views of EXT_meshopt_compression.
    views: HashMap<usize, Option<buffer::Bytes<'a>>>,
    images: HashMap<usize, Option<ImageId>>,
    textures: HashMap<texture::BitmapKey, Option<TextureId>>,
    materials: HashMap<material::MaterialKey, material::Material>,
    /// Number of the material variant that was asked for.
    variant: Option<usize>,
    meshes: HashMap<mesh::MeshKey, Vec<mesh::Primitive>>,
}

impl Reader<'_> {
    /// Takes memory from the budget; an error once it is used up.
    fn spend(&mut self, at: &Value<'_>, bytes: u64) -> bool {
        if let Some(rest) = self.budget.checked_sub(bytes) {
            self.budget = rest;
            return true;
        }
        if !self.over_budget {
            self.over_budget = true;
            self.error(at, format!("decoding takes {bytes} bytes more than a file of this size may ask for"));
        }
        false
    }
}
