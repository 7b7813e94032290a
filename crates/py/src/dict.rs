//! Nested dictionaries in Mitsuba's terms → plugin tree, the same that an XML file becomes.
//!
//! A dictionary with a `type` is a plugin; its other keys are parameters. Arrays of shape (3,) are vectors, (4, 4) transforms, and
//! (height, width) or (height, width, channels) pictures.

use etendue_scene::formats::mitsuba::tree::{Kind, Plugin, Property, Tree, Value, suggestion};
use etendue_scene::{FileId, Span};
use glam::{DMat4, DVec3};
use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyInt, PyString};

use crate::errors;
use crate::places::Places;

/// Deepest nesting: a dictionary may contain itself.
const DEPTH_LIMIT: usize = 100;

const KINDS: [Kind; 13] = [
    Kind::Scene,
    Kind::Integrator,
    Kind::Sensor,
    Kind::Film,
    Kind::Sampler,
    Kind::Rfilter,
    Kind::Shape,
    Kind::Bsdf,
    Kind::Texture,
    Kind::Emitter,
    Kind::Medium,
    Kind::Phase,
    Kind::Volume,
];

/// The tree of a scene's dictionary, and what the lines of its spans stand for.
///
/// # Errors
/// `SceneError` with every fault of the dictionary.
pub fn tree(description: &Bound<'_, PyDict>) -> PyResult<(Tree, Places)> {
    let mut reader = Reader { places: Places::default(), faults: Vec::new() };
    let root = reader.plugin(description, "dict", "", 0)?;
    let places = reader.places;
    let root = match root {
        Some(root) if reader.faults.is_empty() && root.kind == Kind::Scene => root,
        Some(root) if reader.faults.is_empty() => {
            let message = format!("the outermost dictionary is a {}, not a scene", root.kind.tag());
            let fault = fault(root.span, message);
            return Err(errors::scene_error(description.py(), &[fault], &[], &places));
        }
        _ => return Err(errors::scene_error(description.py(), &reader.faults, &[], &places)),
    };
    Ok((Tree { root, aliases: Vec::new() }, places))
}

fn fault(span: Span, message: String) -> etendue_scene::Fault {
    etendue_scene::Fault { severity: etendue_scene::Severity::Error, span, message }
}

struct Reader {
    places: Places,
    faults: Vec<etendue_scene::Fault>,
}

impl Reader {
    /// A span that stands for a path of keys.
    fn span(&mut self, path: &str) -> Span {
        self.places.keys.push(path.to_owned());
        Span::new(FileId(0), self.places.keys.len() as u32, 0)
    }

    fn fault<T>(&mut self, span: Span, message: impl Into<String>) -> Option<T> {
        if self.faults.len() < etendue_scene::report::REPORT_LIMIT {
            self.faults.push(fault(span, message.into()));
        }
        None
    }

    /// A dictionary with a type; None where it has a fault.
    fn plugin(&mut self, dict: &Bound<'_, PyDict>, path: &str, id: &str, depth: usize) -> PyResult<Option<Plugin>> {
        let span = self.span(path);
        if depth > DEPTH_LIMIT {
            return Ok(self.fault(span, format!("dictionaries are nested deeper than {DEPTH_LIMIT}")));
        }
        let Some(type_name) = text(dict, "type")? else {
            return Ok(self.fault(span, "a dictionary needs a `type`"));
        };
        let Some(kind) = Kind::of_type(&type_name) else {
            let hint = suggestion(&type_name, KINDS.iter().flat_map(|k| k.types().iter().copied()));
            return Ok(self.fault(span, format!("unknown type `{type_name}`{hint}")));
        };
        let id = text(dict, "id")?.unwrap_or_else(|| id.to_owned());
        let mut params = Vec::with_capacity(dict.len());
        for (key, value) in dict {
            let Ok(key) = key.cast::<PyString>().map(|k| k.to_string_lossy().into_owned()) else {
                self.fault::<()>(span, "keys are texts");
                continue;
            };
            if key == "type" || key == "id" {
                continue;
            }
            let path = format!("{path}[{key:?}]");
            // Names of the scene's own entries are ids that references use.
            let id = if kind == Kind::Scene { key.as_str() } else { "" };
            let at = self.span(&path);
            if let Some(value) = self.value(&value, &path, id, at, depth)? {
                let name = if kind == Kind::Scene && matches!(value, Value::Plugin(_) | Value::Reference(_)) { String::new() } else { key };
                params.push(Property { name, value, span: at });
            }
        }
        let type_name = if kind == Kind::Scene { String::new() } else { type_name };
        Ok(Some(Plugin { kind, type_name, id, span, params }))
    }

    fn value(&mut self, value: &Bound<'_, PyAny>, path: &str, id: &str, at: Span, depth: usize) -> PyResult<Option<Value>> {
        if let Ok(switch) = value.extract::<bool>() {
            return Ok(Some(Value::Bool(switch)));
        }
        if value.is_instance_of::<PyInt>() {
            return Ok(match value.extract::<i64>() {
                Ok(v) => Some(Value::Int(v)),
                Err(_) => self.fault(at, "the number is too large"),
            });
        }
        if value.is_instance_of::<PyFloat>() {
            return Ok(self.number(value.extract()?, at).map(Value::Float));
        }
        if let Ok(text) = value.cast::<PyString>() {
            return Ok(Some(Value::Text(text.to_string_lossy().into_owned())));
        }
        if let Ok(dict) = value.cast::<PyDict>() {
            return match text(dict, "type")?.as_deref() {
                Some("rgb") => self.color(dict, at),
                Some("spectrum") if dict.contains("value")? => self.spectrum(dict, at),
                Some("ref") => Ok(match text(dict, "id")? {
                    Some(id) => Some(Value::Reference(id)),
                    None => self.fault(at, "a reference needs an `id`"),
                }),
                _ => Ok(self.plugin(dict, path, id, depth + 1)?.map(|p| Value::Plugin(Box::new(p)))),
            };
        }
        if value.hasattr("__fspath__")? {
            let text: std::path::PathBuf = value.extract()?;
            return Ok(Some(Value::Text(text.display().to_string())));
        }
        self.array(value, at)
    }

    fn number(&mut self, v: f64, at: Span) -> Option<f64> {
        if v.is_finite() { Some(v) } else { self.fault(at, format!("{v} is not a finite number")) }
    }

    /// A number, vector, transform or picture.
    fn array(&mut self, value: &Bound<'_, PyAny>, at: Span) -> PyResult<Option<Value>> {
        // Transforms of other packages carry a matrix.
        let source = value.getattr("matrix").unwrap_or_else(|_| value.clone());
        let kind = value.get_type().name()?.to_string();
        let Some((shape, data)) = numbers(&source)? else {
            return Ok(self.fault(at, format!("a value of type {kind} means nothing here")));
        };
        let is_picture = matches!(shape[..], [h, w, 1..=4] if h * w > 0) || matches!(shape[..], [h, w] if h * w > 0 && (h, w) != (4, 4));
        // Pictures may hold infinities; the renderer counts them.
        if !is_picture && data.iter().any(|v| !v.is_finite()) {
            return Ok(self.fault(at, "not all numbers are finite"));
        }
        Ok(match (&shape[..], &data[..]) {
            ([], [v]) => Some(Value::Float(*v)),
            ([3], [x, y, z]) => Some(Value::Vector(DVec3::new(*x, *y, *z))),
            ([4, 4], m) => Some(Value::Transform(DMat4::from_cols_slice(m).transpose())),
            ([h, w, rest @ ..], _) if is_picture => {
                let (Ok(width), Ok(height)) = (u32::try_from(*w), u32::try_from(*h)) else {
                    return Ok(self.fault(at, "the picture is too large"));
                };
                let channels = rest.first().map_or(1, |&c| c as u32);
                Some(Value::Pixels { width, height, channels, data: data.iter().map(|&v| v as f32).collect() })
            }
            _ => self
                .fault(at, format!("an array of shape {shape:?} is no vector (3,), transform (4, 4) or picture (height, width, channels)")),
        })
    }

    fn color(&mut self, dict: &Bound<'_, PyDict>, at: Span) -> PyResult<Option<Value>> {
        let value = dict.get_item("value")?;
        let data = value.map(|v| numbers(&v)).transpose()?.flatten().map(|(_, d)| d).unwrap_or_default();
        Ok(match data[..] {
            [v] if v.is_finite() => Some(Value::Rgb(DVec3::splat(v))),
            [r, g, b] if r.is_finite() && g.is_finite() && b.is_finite() => Some(Value::Rgb(DVec3::new(r, g, b))),
            _ => self.fault(at, "a color needs a `value` of one or three finite numbers"),
        })
    }

    /// One number, or a list of (wavelength in nanometers, value).
    fn spectrum(&mut self, dict: &Bound<'_, PyDict>, at: Span) -> PyResult<Option<Value>> {
        let value = dict.get_item("value")?;
        let Some((shape, data)) = value.map(|v| numbers(&v)).transpose()?.flatten() else {
            return Ok(self.fault(at, "a spectrum needs a `value`: a number or a list of (wavelength, value)"));
        };
        if data.iter().any(|v| !v.is_finite()) {
            return Ok(self.fault(at, "not all numbers are finite"));
        }
        Ok(match (&shape[..], &data[..]) {
            ([], [v]) => Some(Value::Uniform(*v)),
            ([_, 2], pairs) => {
                let list: Vec<(f64, f64)> = pairs.chunks_exact(2).map(|p| (p[0], p[1])).collect();
                if list.is_empty() || !list.is_sorted_by(|a, b| a.0 < b.0) {
                    return Ok(self.fault(at, "wavelengths must rise"));
                }
                Some(Value::Spectrum(list))
            }
            _ => self.fault(at, "a spectrum needs a `value`: a number or a list of (wavelength, value)"),
        })
    }
}

/// A text entry; None where there is none.
fn text(dict: &Bound<'_, PyDict>, key: &str) -> PyResult<Option<String>> {
    let value = dict.get_item(key)?;
    Ok(value.and_then(|v| v.cast::<PyString>().ok().map(|t| t.to_string_lossy().into_owned())))
}

/// Shape and values of anything that NumPy takes for numbers; None for anything else.
fn numbers(value: &Bound<'_, PyAny>) -> PyResult<Option<(Vec<usize>, Vec<f64>)>> {
    let numpy = value.py().import("numpy")?;
    let Ok(array) = numpy.call_method1("array", (value, "float64")) else { return Ok(None) };
    let Ok(array) = array.cast::<PyArrayDyn<f64>>() else { return Ok(None) };
    let shape = array.shape().to_vec();
    let data = array.readonly().as_array().iter().copied().collect();
    Ok(Some((shape, data)))
}
