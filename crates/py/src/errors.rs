//! Errors of the engine as the exceptions of `etendue._errors`.

use std::path::{Path, PathBuf};

use etendue_render::image::ImageError;
use etendue_render::session::job::JobError;
use etendue_scene::{Fault, ReadError, Severity};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use crate::places::{self, Places};

/// An exception of the package with a message and no more.
pub fn error(py: Python<'_>, class: &str, message: String) -> PyErr {
    make(py, class, |c| c.call1((message,)))
}

fn make<'py>(py: Python<'py>, class: &str, call: impl FnOnce(Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>>) -> PyErr {
    match py.import("etendue._errors").and_then(|m| m.getattr(class)).and_then(call) {
        Ok(value) => PyErr::from_value(value),
        Err(e) => e,
    }
}

/// `warning` or `error`.
pub fn severity(severity: Severity) -> &'static str {
    match severity {
        Severity::Warning => "warning",
        Severity::Error => "error",
    }
}

/// A `SceneError` with all faults and their places.
pub fn scene_error(py: Python<'_>, faults: &[Fault], files: &[PathBuf], places: &Places) -> PyErr {
    let rows: Vec<_> = faults
        .iter()
        .map(|f| {
            let (file, line, column) = places.place(f.span, files);
            (file, line, column, severity(f.severity), f.message.clone())
        })
        .collect();
    let lines: Vec<String> = faults
        .iter()
        .map(|f| format!("{}: {}: {}", places::display(&places.place(f.span, files)), severity(f.severity), f.message))
        .collect();
    make(py, "SceneError", |c| c.call1((lines.join("\n"), rows)))
}

/// For a scene that could not be read.
pub fn read_error(py: Python<'_>, e: &ReadError, places: &Places) -> PyErr {
    match e {
        ReadError::Invalid { files, faults } => scene_error(py, faults, files, places),
        ReadError::Io { path, source } => io_error(source, path),
        ReadError::Unsupported { .. } => error(py, "UnsupportedError", e.to_string()),
    }
}

/// For a job that could not be made.
pub fn job_error(py: Python<'_>, e: &JobError, files: &[PathBuf], places: &Places) -> PyErr {
    match e {
        JobError::Setting(message) => error(py, "SettingError", message.clone()),
        JobError::Scene(faults) => scene_error(py, faults, files, places),
        JobError::Film(e) => error(py, "SettingError", e.to_string()),
    }
}

/// For a picture file.
pub fn image_error(py: Python<'_>, e: &ImageError, path: &Path) -> PyErr {
    match e {
        ImageError::Io(e) => io_error(e, path),
        ImageError::Unsupported(_) => error(py, "UnsupportedError", format!("{}: {e}", path.display())),
        _ => error(py, "ImageError", format!("{}: {e}", path.display())),
    }
}

/// An `OSError` of the right kind, such as FileNotFoundError, with the file's name.
fn io_error(e: &std::io::Error, path: &Path) -> PyErr {
    match e.raw_os_error() {
        Some(code) => {
            // "No such file or directory (os error 2)": Python adds the number itself.
            let text = e.to_string();
            let text = text.split(" (os error").next().unwrap_or_default().to_owned();
            PyOSError::new_err((code, text, path.to_owned()))
        }
        None => PyOSError::new_err(format!("{}: {e}", path.display())),
    }
}
