//! What went wrong and what was lost while reading a scene.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::span::Span;

/// How bad a fault is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Severity {
    /// The scene can still be rendered as meant, or nearly.
    Warning,
    /// The scene cannot be rendered as meant.
    Error,
}

/// One fault of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// How bad it is.
    pub severity: Severity,
    /// Where.
    pub span: Span,
    /// What, in one sentence without a full stop.
    pub message: String,
}

/// Something that a file holds and the renderer does not honor (yet).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Loss {
    /// Where the file says it.
    pub span: Span,
    /// What it is, in the format's own words, such as `KHR_materials_dispersion` or `bsdf "hair"`.
    pub feature: String,
    /// What happens instead, such as `ignored` or `rendered as rough plastic`.
    pub effect: String,
}

/// Everything that reading found: warnings and losses of a scene that could be read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Faults in the order in which they were found.
    pub faults: Vec<Fault>,
    /// Losses in the order in which they were found.
    pub losses: Vec<Loss>,
}

/// The most faults and losses that are kept of one scene; a hostile file must not fill the memory with them.
pub const REPORT_LIMIT: usize = 1000;

impl Report {
    /// Adds an error.
    pub fn error(&mut self, span: Span, message: impl Into<String>) {
        self.fault(Severity::Error, span, message.into());
    }

    /// Adds a warning.
    pub fn warning(&mut self, span: Span, message: impl Into<String>) {
        self.fault(Severity::Warning, span, message.into());
    }

    fn fault(&mut self, severity: Severity, span: Span, message: String) {
        if self.faults.len() < REPORT_LIMIT {
            self.faults.push(Fault { severity, span, message });
        } else if severity == Severity::Error && !self.has_errors() {
            // Never let a flood of warnings hide that there was an error.
            self.faults[REPORT_LIMIT - 1] = Fault { severity, span, message };
        }
    }

    /// Adds a loss.
    pub fn loss(&mut self, span: Span, feature: impl Into<String>, effect: impl Into<String>) {
        if self.losses.len() < REPORT_LIMIT {
            self.losses.push(Loss { span, feature: feature.into(), effect: effect.into() });
        }
    }

    /// True where an error has been told and no further fault will be kept: a reader may stop.
    pub fn is_full(&self) -> bool {
        self.faults.len() >= REPORT_LIMIT && self.has_errors()
    }

    /// True where any fault is an error.
    pub fn has_errors(&self) -> bool {
        self.faults.iter().any(|f| f.severity == Severity::Error)
    }
}

/// Why a scene could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file has faults; all of them that were found.
    #[error("{}", display_faults(files, faults))]
    Invalid {
        /// The files that the faults' spans point at.
        files: Vec<PathBuf>,
        /// The faults, at least one of them an error.
        faults: Vec<Fault>,
    },
    /// A file could not be opened or read.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The format is not one that is read.
    #[error("{path}: {reason}", path = path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What is not supported.
        reason: String,
    },
}

fn display_faults(files: &[PathBuf], faults: &[Fault]) -> String {
    let lines: Vec<String> = faults
        .iter()
        .map(|f| {
            let word = if f.severity == Severity::Error { "error" } else { "warning" };
            format!("{}: {word}: {}", f.span.display(files), f.message)
        })
        .collect();
    lines.join("\n")
}
