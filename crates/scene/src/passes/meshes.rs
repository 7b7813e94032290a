//! Loads mesh files.

use rayon::prelude::*;

use crate::desc::{MeshData, SceneDesc};
use crate::formats::mesh;
use crate::report::{Fault, ReadError, Severity};
use crate::span::Span;

/// Loads the files of all meshes, in parallel. Meshes that share a file are loaded once already, as readers make one node of them.
///
/// # Errors
/// [`ReadError::Invalid`] with the faults of every mesh file, and the description's own.
pub fn load_meshes(desc: &mut SceneDesc) -> Result<(), ReadError> {
    let loaded: Vec<Option<Result<mesh::ParsedMesh, mesh::MeshFault>>> = desc
        .meshes
        .par_iter()
        .map(|node| {
            let (path, format, index) = node.value.file.as_ref().filter(|_| node.value.data.is_none())?;
            let mut result = mesh::load(path, *format, *index);
            if let Ok(parsed) = &mut result
                && node.value.flip_v
            {
                mesh::flip_v(&mut parsed.data);
            }
            Some(result)
        })
        .collect();
    let mut failed = false;
    for (i, result) in loaded.into_iter().enumerate() {
        let Some(result) = result else { continue };
        let node = &mut desc.meshes[i];
        let path = node.value.file.as_ref().map(|f| f.0.clone()).unwrap_or_default();
        let span = node.span;
        match result {
            Ok(parsed) => {
                node.value.data = Some(parsed.data);
                for warning in parsed.warnings {
                    desc.report.warning(span, format!("{}: {warning}", path.display()));
                }
            }
            Err(fault) => {
                failed = true;
                desc.meshes[i].value.data = Some(MeshData::default());
                let place = if fault.line == 0 { span } else { Span::new(desc.add_file(&path), fault.line, 1) };
                let message = if fault.line == 0 { format!("{}: {fault}", path.display()) } else { fault.to_string() };
                desc.report.error(place, message);
            }
        }
    }
    if failed {
        let faults: Vec<Fault> = std::mem::take(&mut desc.report.faults);
        debug_assert!(faults.iter().any(|f| f.severity == Severity::Error));
        return Err(ReadError::Invalid { files: desc.files.clone(), faults });
    }
    Ok(())
}
