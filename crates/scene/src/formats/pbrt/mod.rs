//! The reader of pbrt-v4 scenes, and the writer.
//!
//! ```text
//! text ─lexer→ tokens ─directive→ graphics state + parameters ─items→ SceneDesc
//! ```
//!
//! Differences that are translated here: a camera of pbrt looks along +z, ours along −z; its transforms are of a left-handed world,
//! which needs no change, as nothing of ours depends on handedness; light spectra count by their shape only (pbrt divides them by their
//! luminance); roughness is remapped to α = √roughness unless the file says otherwise.

mod angles;
mod camera;
mod cloud;
mod curve;
mod directive;
mod lexer;
mod light;
mod material;
mod medium;
mod params;
mod presets;
mod shape;
mod spectrum;
mod state;
mod subdivision;
mod texture;
mod write;

pub use write::write;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use super::{ReadOptions, ResolveError, Resolver};
use crate::desc::{AddNode, BsdfId, GroupId, ImageDesc, ImageId, ImageSource, MediumId, Node, Scalar, SceneDesc, ShapeId, TextureId};
use crate::report::ReadError;
use crate::span::Span;
use state::State;

/// Reads a scene file. Mesh and image files are found, not opened.
///
/// # Errors
/// [`ReadError`] with every fault that was found.
pub fn read(path: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let bytes = std::fs::read(path).map_err(|source| ReadError::Io { path: path.to_owned(), source })?;
    read_bytes(path, &bytes, options)
}

/// Reads a scene from the text of a file; `path` names it in messages, and its folder is where the names of other files start.
///
/// # Errors
/// [`ReadError::Invalid`] with every fault that was found.
pub fn read_bytes(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let mut reader = Reader::new(SceneDesc::new("pbrt", path), Resolver::new(&folder, &options.search_paths), folder);
    let file = reader.desc.add_file(path);
    reader.text(&String::from_utf8_lossy(bytes), file);
    reader.end();
    let desc = reader.desc;
    if desc.report.has_errors() { Err(ReadError::Invalid { files: desc.files, faults: desc.report.faults }) } else { Ok(desc) }
}

/// What has been read so far.
struct Reader {
    desc: SceneDesc,
    resolver: Resolver,
    /// The scene file's folder: where names of files start, in included files as well.
    folder: PathBuf,
    state: State,
    /// States saved by `AttributeBegin` and the like, with the directive that opened them.
    stack: Vec<(&'static str, Span, State)>,
    in_world: bool,
    /// Of the film, in meters: what realistic cameras see.
    film_diagonal: f32,
    materials: HashMap<String, BsdfId>,
    default_material: Option<BsdfId>,
    float_textures: HashMap<String, Scalar>,
    spectrum_textures: HashMap<String, TextureId>,
    /// Textures whose values may lie beyond [0, 1] by a pattern, and what has been made to limit them.
    unbounded: HashSet<TextureId>,
    clamped: HashMap<TextureId, TextureId>,
    media: HashMap<String, MediumId>,
    coordinate_systems: HashMap<String, glam::DMat4>,
    objects: HashMap<String, GroupId>,
    /// The object that is being defined, with its shapes.
    object: Option<(GroupId, Vec<ShapeId>)>,
    images: HashMap<PathBuf, ImageId>,
    meshes: HashMap<PathBuf, crate::desc::MeshId>,
    /// Triangles of subdivided meshes so far.
    subdivided: usize,
    includes: u32,
    depth: u32,
}

impl Reader {
    fn new(desc: SceneDesc, resolver: Resolver, folder: PathBuf) -> Self {
        Self {
            desc,
            resolver,
            folder,
            state: State::default(),
            stack: Vec::new(),
            in_world: false,
            film_diagonal: 0.035,
            materials: HashMap::new(),
            default_material: None,
            float_textures: HashMap::new(),
            spectrum_textures: HashMap::new(),
            unbounded: HashSet::new(),
            clamped: HashMap::new(),
            media: HashMap::new(),
            coordinate_systems: HashMap::new(),
            objects: HashMap::new(),
            object: None,
            images: HashMap::new(),
            meshes: HashMap::new(),
            subdivided: 0,
            includes: 0,
            depth: 0,
        }
    }

    fn error(&mut self, span: Span, message: impl Into<String>) {
        self.desc.report.error(span, message);
    }

    fn loss(&mut self, span: Span, feature: impl Into<String>, effect: impl Into<String>) {
        self.desc.report.loss(span, feature, effect);
    }

    /// The path of a file that the scene names; `None` with a fault where there is none.
    fn resolve(&mut self, name: &str, span: Span) -> Option<PathBuf> {
        match self.resolver.resolve(&self.folder, name) {
            Ok(path) => Some(path),
            Err(e) => {
                self.error(span, resolve_message(&e));
                None
            }
        }
    }

    /// A picture; the same file is one node.
    fn image(&mut self, name: &str, span: Span) -> Option<ImageId> {
        let path = self.resolve(name, span)?;
        if let Some(id) = self.images.get(&path) {
            return Some(*id);
        }
        let id = self.desc.add(Node::named(name, span, ImageDesc { source: ImageSource::File(path.clone()) }));
        self.images.insert(path, id);
        Some(id)
    }

    /// Checks what must be closed or present at the end of the scene.
    fn end(&mut self) {
        while let Some((opened, span, _)) = self.stack.pop() {
            self.error(span, format!("`{opened}` is never ended"));
        }
        if self.desc.film.width.is_none() {
            self.desc.film.width = Some(1280);
            self.desc.film.height = Some(720);
        }
        if self.desc.film.filter.is_none() {
            self.desc.film.filter = Some(crate::desc::FilterDesc::Gaussian { stddev: 0.5 });
        }
        self.desc.film.spp.get_or_insert(16);
        if self.desc.integrator.name.is_empty() {
            self.desc.integrator.name = "path".to_owned();
            self.desc.integrator.max_depth = Some(5);
        }
        if self.desc.cameras.is_empty() {
            self.default_camera();
        }
    }
}

fn resolve_message(e: &ResolveError) -> String {
    e.to_string()
}
