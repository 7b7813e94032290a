//! glTF 2.0 (`.gltf`, `.glb`): [`read`] and [`write`](write()).
//!
//! What is honored, approximated and lost: `docs/guide/formats-gltf.md`. Conventions where glTF and the description differ:
//! - texture coordinates: glTF's v runs down the picture, ours up: `v → 1 − v` on vertices and in texture transforms. The
//!   bitangent cross(n, t) · w of glTF points up the picture, which is along our +v, so tangents stay as they are;
//! - mirrored nodes keep their outside: the mirror image is put into the mesh, the transform that is left mirrors nothing;
//! - opaque and masked materials scatter and emit on both sides, as in Cycles; glTF's `doubleSided` only culls;
//! - candela and lux become W/sr and W/m² by 683 lm/W, emissive strength (nit) stays a number of radiance, as in Blender's importer.
//!
//! Places: line and column are those of the JSON (in a GLB: of its JSON chunk), and every message starts with the JSON path.

mod container;
mod json;
mod meshopt;
mod meshopt_filter;
mod read;
mod write;

use std::path::Path;

use super::{ReadOptions, ResolveError, Resolver};
use crate::desc::SceneDesc;
use crate::report::ReadError;

pub use read::read_bytes;
pub use write::{write, write_glb};

/// Luminous efficacy that relates photometric to radiometric units, lm/W: that of 555 nm, as Blender and others take it for glTF.
const LUMENS_PER_WATT: f32 = 683.0;

/// Reads a file of this format.
///
/// # Errors
/// [`ReadError`] with every fault that was found.
pub fn read(path: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let bytes = Resolver::read(path).map_err(|e| match e {
        ResolveError::Io(_, source) => ReadError::Io { path: path.to_owned(), source },
        other => ReadError::Unsupported { path: path.to_owned(), reason: other.to_string() },
    })?;
    read_bytes(&bytes, path, options)
}
