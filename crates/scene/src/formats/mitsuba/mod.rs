//! The reader of Mitsuba scenes: XML of Mitsuba 3 and, upgraded on the way, of 0.x; and nested dictionaries as Python gives them.
//!
//! ```text
//! XML ─xml→ plugin tree ─build→ SceneDesc
//!           dictionary ┘
//! ```
//!
//! Differences that are translated here: a camera of Mitsuba looks along +z with +x to the left, ours along −z with +x to the right;
//! its pictures begin at v = 0, ours at v = 1; its `max_depth` counts the light's edge, ours does not.

mod build;
pub mod tree;
mod upgrade;
mod write;
pub mod xml;

pub use write::write;

use std::path::{Path, PathBuf};

use super::{ReadOptions, ResolveError, Resolver};
use crate::desc::SceneDesc;
use crate::report::{ReadError, Report};

/// Reads a scene file. Mesh and image files are found, not opened.
///
/// # Errors
/// [`ReadError`] with every fault that was found.
pub fn read(path: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let resolver = Resolver::new(path.parent().unwrap_or(Path::new("")), &options.search_paths);
    let mut reader = xml::XmlReader::new(&resolver, &options.defines);
    let tree = reader.read_file(path)?;
    finish(reader, tree.as_ref(), &resolver)
}

/// Reads a scene from the text of a file; `path` names it in messages, and its folder is where the names of other files start.
///
/// # Errors
/// [`ReadError::Invalid`] with every fault that was found.
pub fn read_bytes(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let resolver = Resolver::new(path.parent().unwrap_or(Path::new("")), &options.search_paths);
    let mut reader = xml::XmlReader::new(&resolver, &options.defines);
    let tree = reader.read_bytes(path, bytes);
    finish(reader, tree.as_ref(), &resolver)
}

fn finish(reader: xml::XmlReader, tree: Option<&tree::Tree>, resolver: &Resolver) -> Result<SceneDesc, ReadError> {
    let mut desc = SceneDesc { format: "mitsuba".to_owned(), files: reader.files, report: reader.report, ..SceneDesc::default() };
    if let Some(tree) = tree {
        let mut builder = build::Builder::new(desc, resolver, reader.paths);
        builder.scene(tree);
        desc = builder.desc;
    }
    checked(desc)
}

/// Makes a description of a plugin tree that did not come from a file, such as a dictionary of Python; names of files start in `folder`.
///
/// # Errors
/// [`ReadError::Invalid`] with every fault that was found.
pub fn from_tree(tree: &tree::Tree, folder: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let resolver = Resolver::new(folder, &options.search_paths);
    let mut desc = SceneDesc::new("mitsuba", folder.join("<dictionary>"));
    desc.report = Report::default();
    let mut builder = build::Builder::new(desc, &resolver, Vec::new());
    builder.scene(tree);
    checked(builder.desc)
}

fn checked(desc: SceneDesc) -> Result<SceneDesc, ReadError> {
    if desc.report.has_errors() { Err(ReadError::Invalid { files: desc.files, faults: desc.report.faults }) } else { Ok(desc) }
}

/// The first of the folders from which the name leads to a file that may be read.
fn find(resolver: &Resolver, folders: impl IntoIterator<Item = PathBuf>, name: &str) -> Result<PathBuf, ResolveError> {
    let mut first = None;
    for folder in folders {
        match resolver.resolve(&folder, name) {
            Ok(path) => return Ok(path),
            Err(e) => {
                first.get_or_insert(e);
            }
        }
    }
    Err(first.unwrap_or_else(|| ResolveError::NotFound(name.to_owned())))
}
