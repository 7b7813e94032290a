//! Keywords of `Scene.render` for [`RenderSettings`]: names, types, defaults and sentences come from its declaration.

use etendue_scene::RenderSettings;
use etendue_scene::param::ParamError;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors;

/// What each setting is: name, type in words, unit, default in words, sentence.
#[pyfunction]
pub fn parameters() -> Vec<(&'static str, &'static str, &'static str, &'static str, &'static str)> {
    RenderSettings::SPECS.iter().map(|s| (s.name, s.kind, s.unit, s.default, s.doc.trim())).collect()
}

/// Names that the setting `integrator` takes.
#[pyfunction]
pub fn integrators() -> Vec<&'static str> {
    etendue_render::integrator::NAMES.to_vec()
}

/// Settings from keywords; None leaves one at its default.
///
/// # Errors
/// TypeError for an unknown keyword, `SettingError` for a value that does not fit.
pub fn from_keywords(keywords: &Bound<'_, PyDict>) -> PyResult<RenderSettings> {
    let mut settings = RenderSettings::default();
    for (key, value) in keywords {
        let name: String = key.extract()?;
        if value.is_none() && RenderSettings::SPECS.iter().any(|s| s.name == name) {
            continue;
        }
        let text = match value.extract::<bool>() {
            Ok(switch) => switch.to_string(),
            Err(_) => value.str()?.to_string(),
        };
        settings.set(&name, &text).map_err(|e| match e {
            ParamError::Unknown(_) => {
                let hint = etendue_scene::formats::mitsuba::tree::suggestion(&name, RenderSettings::SPECS.iter().map(|s| s.name));
                PyTypeError::new_err(format!("render() got an unexpected keyword argument '{name}'{hint}"))
            }
            ParamError::Invalid { .. } => errors::error(keywords.py(), "SettingError", e.to_string()),
        })?;
    }
    Ok(settings)
}
