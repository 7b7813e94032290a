//! The mesh reader.

use std::path::Path;

use super::ReadOptions;
use crate::desc::SceneDesc;
use crate::report::ReadError;

/// Reads a file of this format.
///
/// # Errors
/// [`ReadError`] with every fault that was found.
pub fn read(path: &Path, _options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    Err(ReadError::Unsupported { path: path.to_owned(), reason: "being built".to_owned() })
}
