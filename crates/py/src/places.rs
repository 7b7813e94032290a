//! Places in scenes as Python sees them.

use std::path::PathBuf;

use etendue_scene::Span;

/// A place: file (or a path of keys into a dictionary), line and column; the latter None where they are not known.
pub type Place = (String, Option<u32>, Option<u32>);

/// Turns spans into places.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// For a scene from a dictionary: what the lines of file 0 stand for, from line 1.
    pub keys: Vec<String>,
}

impl Places {
    /// The place of a span.
    pub fn place(&self, span: Span, files: &[PathBuf]) -> Place {
        if span.file.0 == 0 && !self.keys.is_empty() {
            let key = (span.line as usize).checked_sub(1).and_then(|i| self.keys.get(i));
            return (key.unwrap_or(&self.keys[0]).clone(), None, None);
        }
        let file = files.get(span.file.0 as usize).map_or_else(|| "<unknown>".to_owned(), |p| p.display().to_string());
        if span.line == 0 { (file, None, None) } else { (file, Some(span.line), Some(span.column)) }
    }
}

/// `file:line:column`, as far as known.
pub fn display(place: &Place) -> String {
    match place {
        (file, Some(line), Some(column)) => format!("{file}:{line}:{column}"),
        (file, ..) => file.clone(),
    }
}
