//! Pictures of named planes as NumPy arrays of shape (height, width, channels), and back.

use etendue_render::image::Image;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Layers whose names are longer in Python than in files; the rest is called the same.
const NAMES: [(&str, &str); 5] = [("normal", "N"), ("position", "P"), ("depth", "Z"), ("alpha", "A"), ("samples", "sampleCount")];

/// The name of the layer that a channel belongs to.
fn layer_of(channel: &str) -> String {
    if matches!(channel, "R" | "G" | "B") {
        return "rgb".to_owned();
    }
    if let Some(id) = channel.strip_prefix("id.") {
        return id.to_owned();
    }
    let stem = match channel.rsplit_once('.') {
        Some((stem, suffix)) if suffix.len() == 1 => stem,
        _ => channel,
    };
    NAMES.iter().find(|(_, file)| *file == stem).map_or(stem, |(python, _)| python).to_owned()
}

/// The channels of a layer in files.
fn channels_of(layer: &str, count: usize) -> Vec<String> {
    let stem = NAMES.iter().find(|(python, _)| *python == layer).map_or(layer, |(_, file)| file);
    let suffixes: &[&str] = match (stem, count) {
        ("rgb", 1) => return vec!["Y".to_owned()],
        ("rgb", 3 | 4) => return ["R", "G", "B", "A"].iter().take(count).map(|&c| c.to_owned()).collect(),
        ("object" | "material", 1) => return vec![format!("id.{stem}")],
        (_, 1) => return vec![stem.to_owned()],
        ("N" | "P", 3) => &["X", "Y", "Z"],
        ("uv", 2) => &["U", "V"],
        (_, 2) => &["X", "Y"],
        (_, 3) => &["R", "G", "B"],
        (_, 4) => &["R", "G", "B", "A"],
        _ => return (0..count).map(|i| format!("{stem}.{i}")).collect(),
    };
    suffixes.iter().map(|s| format!("{stem}.{s}")).collect()
}

/// The layers by name, each an array of shape (height, width, channels).
pub fn to_python<'py>(py: Python<'py>, image: &Image) -> PyResult<Bound<'py, PyDict>> {
    // Files may order channels by name: B, G, R.
    const ORDER: &str = "RGBAXYZUV";
    let rank = |name: &str| name.chars().last().and_then(|c| ORDER.find(c));
    let mut channels: Vec<_> = image.channels.iter().collect();
    channels.sort_by_key(|c| rank(&c.name));
    let mut layers: Vec<(String, Vec<&[f32]>)> = Vec::new();
    for channel in channels {
        let name = layer_of(&channel.name);
        match layers.iter_mut().find(|(n, _)| *n == name) {
            Some((_, planes)) => planes.push(&channel.data),
            None => layers.push((name, vec![&channel.data])),
        }
    }
    // The picture first.
    layers.sort_by_key(|(name, _)| name != "rgb");
    let shape = |channels: usize| [image.height as usize, image.width as usize, channels];
    let out = PyDict::new(py);
    for (name, planes) in layers {
        let data = py.detach(|| interleave(&planes));
        out.set_item(name, PyArray1::from_vec(py, data).reshape(shape(planes.len()))?)?;
    }
    Ok(out)
}

fn interleave(planes: &[&[f32]]) -> Vec<f32> {
    let count = planes.len();
    let mut data = vec![0.0; count * planes.first().map_or(0, |p| p.len())];
    for (c, plane) in planes.iter().enumerate() {
        for (pixel, &value) in data[c..].iter_mut().step_by(count).zip(*plane) {
            *pixel = value;
        }
    }
    data
}

/// A picture of layers, which must all have the first one's height and width. None where they do not.
pub fn from_python(layers: &[(String, PyReadonlyArray3<'_, f32>)]) -> Option<Image> {
    let [height, width, _] = layers.first()?.1.shape() else { return None };
    let mut image = Image::new(u32::try_from(*width).ok()?, u32::try_from(*height).ok()?);
    for (name, array) in layers {
        let view = array.as_array();
        let [h, w, channels] = array.shape() else { return None };
        if (h, w) != (height, width) {
            return None;
        }
        for (i, channel) in channels_of(name, *channels).into_iter().enumerate() {
            image.push(channel, view.slice(numpy::ndarray::s![.., .., i]).iter().copied().collect());
        }
    }
    Some(image)
}
