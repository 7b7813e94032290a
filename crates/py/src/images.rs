//! Picture files, tone mapping and comparison for arrays. The package's wrappers give arrays of three dimensions and `float32`.

use std::path::PathBuf;

use etendue_render::image::tonemap::{ToneMap, ToneOperator};
use etendue_render::image::{Image, WriteOptions, metrics};
use numpy::{PyArray1, PyArray3, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{background, errors, layers};

fn tone(py: Python<'_>, operator: &str, exposure: f32) -> PyResult<ToneMap> {
    let found = ToneOperator::from_name(operator).ok_or_else(|| {
        let known = ToneOperator::NAMES.join(", ");
        errors::error(py, "SettingError", format!("no tone mapping `{operator}`; there are {known}"))
    })?;
    Ok(ToneMap { operator: found, exposure })
}

/// The picture of one array.
fn picture(py: Python<'_>, array: PyReadonlyArray3<'_, f32>) -> PyResult<Image> {
    layers::from_python(&[("rgb".to_owned(), array)]).ok_or_else(|| errors::error(py, "ImageError", "the picture is too large".to_owned()))
}

/// Reads a picture file: its layers by name.
#[pyfunction]
pub fn read_layers(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let file = path.clone();
    let image = background::run(py, None, move || Image::load(&file), |_| Ok(()))?.map_err(|e| errors::image_error(py, &e, &path))?;
    layers::to_python(py, &image)
}

/// Writes layers to a picture file in the format of its extension.
#[pyfunction]
pub fn write_layers(
    py: Python<'_>,
    path: PathBuf,
    arrays: Vec<(String, PyReadonlyArray3<'_, f32>)>,
    operator: &str,
    exposure: f32,
) -> PyResult<()> {
    let tone = tone(py, operator, exposure)?;
    let image = layers::from_python(&arrays)
        .ok_or_else(|| errors::error(py, "ImageError", "all layers of a picture have the same height and width".to_owned()))?;
    let options = WriteOptions { tone, ..WriteOptions::default() };
    py.detach(|| image.save(&path, &options)).map_err(|e| errors::image_error(py, &e, &path))
}

/// Display values in [0, 1], encoded for sRGB.
#[pyfunction]
pub fn tonemap<'py>(
    py: Python<'py>,
    array: PyReadonlyArray3<'py, f32>,
    operator: &str,
    exposure: f32,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let tone = tone(py, operator, exposure)?;
    let image = picture(py, array)?;
    let rgb = image.rgb().unwrap_or_default();
    let data: Vec<f32> = py.detach(|| rgb.into_iter().flat_map(|p| tone.apply(p)).collect());
    PyArray1::from_vec(py, data).reshape([image.height as usize, image.width as usize, 3])
}

type Compared = (metrics::Comparison, metrics::ErrorMap, [usize; 3]);

fn compared(py: Python<'_>, image: PyReadonlyArray3<'_, f32>, reference: PyReadonlyArray3<'_, f32>, hdr: bool) -> PyResult<Compared> {
    let (image, reference) = (picture(py, image)?, picture(py, reference)?);
    let shape = [image.height as usize, image.width as usize, 1];
    let work = move || metrics::compare(&image, &reference, hdr);
    let result = background::run(py, None, work, |_| Ok(()))?;
    let (comparison, map) = result.map_err(|e| errors::error(py, "ImageError", e.to_string()))?;
    Ok((comparison, map, shape))
}

/// Every figure by name.
#[pyfunction]
pub fn compare<'py>(
    py: Python<'py>,
    image: PyReadonlyArray3<'py, f32>,
    reference: PyReadonlyArray3<'py, f32>,
    hdr: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let (comparison, ..) = compared(py, image, reference, hdr)?;
    let out = PyDict::new(py);
    for name in metrics::METRICS {
        out.set_item(name.replace('-', "_"), comparison.get(name))?;
    }
    Ok(out)
}

/// FLIP of each pixel, in [0, 1].
#[pyfunction]
pub fn flip_map<'py>(
    py: Python<'py>,
    image: PyReadonlyArray3<'py, f32>,
    reference: PyReadonlyArray3<'py, f32>,
    hdr: bool,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (_, map, shape) = compared(py, image, reference, hdr)?;
    PyArray1::from_vec(py, map).reshape(shape)
}
