//! Readers and writers of scene formats, one folder each. [`read`] picks the reader by the file's name and content.

mod cie;
mod exr;
pub mod gltf;
mod grids;
pub mod mesh;
pub mod mitsuba;
mod nanovdb;
mod openvdb;
pub mod pbrt;
mod picture_size;
pub mod pov;
mod resolver;
mod sidecar;
mod spectrum;
mod summary;
pub mod tessellate;
mod volume;

pub use resolver::{ResolveError, Resolver};
pub use summary::{Summary, summary};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::desc::SceneDesc;
use crate::report::ReadError;

/// What a reader may be told.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// Folders beside the scene's own in which it may read files.
    pub search_paths: Vec<PathBuf>,
    /// Values for `$key` in Mitsuba files.
    pub defines: BTreeMap<String, String>,
    /// The material variant of a glTF file (KHR_materials_variants).
    pub variant: Option<String>,
    /// The scene of a glTF file, by name or number.
    pub scene: Option<String>,
    /// Second of a glTF file's animation at which the scene is read; `None`: its nodes are where they are without animation.
    pub time: Option<f64>,
    /// The animation, by name or number; `None`: the first.
    pub animation: Option<String>,
    /// What scenes of POV-Ray may ask and do.
    pub pov: pov::PovOptions,
}

/// Reads a scene of any format: `.xml` (Mitsuba), `.pov` (POV-Ray), `.pbrt`, `.gltf`, `.glb`, `.obj`, `.ply`, `.stl`; gives it an automatic camera and light where
/// the file has none; loads its meshes and checks it.
///
/// # Errors
/// [`ReadError`] with every fault that was found.
pub fn read(path: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let desc = match extension.as_str() {
        "xml" => mitsuba::read(path, options)?,
        "pbrt" => pbrt::read(path, options)?,
        "pov" | "inc" => pov::read(path, options)?,
        "gltf" | "glb" => gltf::read(path, options)?,
        "obj" | "ply" | "stl" | "serialized" => mesh::read(path, options)?,
        _ => {
            let reason = "not a scene format that etendue reads (xml, pov, pbrt, gltf, glb, obj, ply, stl)".to_owned();
            return Err(ReadError::Unsupported { path: path.to_owned(), reason });
        }
    };
    finish(desc)
}

/// What every description goes through after its reader: loads its meshes, adds a camera and a light where it has none, and checks it. For
/// descriptions that did not come through [`read`], such as those of [`mitsuba::from_tree`].
///
/// # Errors
/// [`ReadError::Invalid`] with every fault that was found.
pub fn finish(mut desc: SceneDesc) -> Result<SceneDesc, ReadError> {
    crate::passes::load_meshes(&mut desc)?;
    crate::passes::complete(&mut desc);
    crate::validate::validate(&mut desc)?;
    Ok(desc)
}
