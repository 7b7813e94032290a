//! Places in files.

use serde::{Deserialize, Serialize};

/// Index of a file in [`crate::SceneDesc::files`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct FileId(pub u32);

/// A place in a file. Lines and columns count from 1; 0 means that the place within the file is not known (binary data).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Span {
    /// The file.
    pub file: FileId,
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
}

impl Span {
    /// A place with line and column.
    pub fn new(file: FileId, line: u32, column: u32) -> Self {
        Self { file, line, column }
    }

    /// The whole of a file.
    pub fn file(file: FileId) -> Self {
        Self { file, line: 0, column: 0 }
    }

    /// `path:line:column`, or `path` alone where the place is not known.
    pub fn display(&self, files: &[std::path::PathBuf]) -> String {
        let path = files.get(self.file.0 as usize).map_or_else(|| "<unknown>".into(), |p| p.display().to_string());
        if self.line == 0 { path } else { format!("{path}:{}:{}", self.line, self.column) }
    }
}
