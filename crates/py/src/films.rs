//! Film files in memory: merging, what they hold, and the pictures that they become.

use std::path::PathBuf;

use etendue_render::film::file::{DEFAULT_MEMORY_LIMIT, FilmFileError};
use etendue_render::film::{DevelopOptions, Film, FilmError, FilmMeta, Rect};
use etendue_render::image::tonemap::{ToneMap, ToneOperator};
use etendue_render::image::{ImageError, WriteOptions};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyDict;

use crate::{background, errors, layers};

/// The sum of films, over the smallest rectangle that has the pixels of all.
pub fn merged(files: &[PyBackedBytes]) -> Result<Film, String> {
    let mut total: Option<Film> = None;
    let read = |bytes: &PyBackedBytes| Film::from_bytes(bytes, DEFAULT_MEMORY_LIMIT).map_err(|e: FilmFileError| e.to_string());
    let mut rects = Vec::with_capacity(files.len());
    for bytes in files {
        rects.push(etendue_render::film::file::rect_of(bytes).map_err(|e| e.to_string())?);
    }
    let all = rects.iter().copied().reduce(|a, b| Rect::new(a.x0.min(b.x0), a.y0.min(b.y0), a.x1.max(b.x1), a.y1.max(b.y1)));
    let all = all.ok_or("there are no films to merge")?;
    for bytes in files {
        let film = read(bytes)?;
        match &mut total {
            None if film.rect() == all => total = Some(film),
            None => {
                let mut sum = Film::tile(film.spec(), all).map_err(|e| e.to_string())?;
                sum.meta = FilmMeta { render_ms: 0, ..film.meta.clone() };
                sum.merge(&film).map_err(|e| e.to_string())?;
                total = Some(sum);
            }
            Some(sum) => sum.merge(&film).map_err(|e| e.to_string())?,
        }
    }
    total.ok_or_else(|| "there are no films to merge".to_owned())
}

fn merge(py: Python<'_>, files: Vec<PyBackedBytes>) -> PyResult<Film> {
    background::run(py, None, move || merged(&files), |_| Ok(()))?.map_err(|e| errors::error(py, "ImageError", e))
}

/// What film files hold together.
#[pyfunction]
pub fn film_info(py: Python<'_>, films: Vec<PyBackedBytes>) -> PyResult<Bound<'_, PyDict>> {
    let film = merge(py, films)?;
    let (spec, meta, rect) = (film.spec(), &film.meta, film.rect());
    let out = PyDict::new(py);
    out.set_item("width", spec.width)?;
    out.set_item("height", spec.height)?;
    out.set_item("crop", (spec.crop.x0, spec.crop.y0, spec.crop.x1, spec.crop.y1))?;
    out.set_item("rect", (rect.x0, rect.y0, rect.x1, rect.y1))?;
    let held = film.held().entries().iter().map(|h| (h.rect.x0, h.rect.y0, h.rect.x1, h.rect.y1, h.begin, h.end));
    out.set_item("held", held.collect::<Vec<_>>())?;
    out.set_item("channels", spec.channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>())?;
    out.set_item("scene_hash", &meta.scene_hash)?;
    out.set_item("integrator", &meta.integrator)?;
    out.set_item("seed", meta.seed)?;
    out.set_item("renderer", &meta.renderer)?;
    out.set_item("render_secs", meta.render_ms as f64 / 1000.0)?;
    out.set_item("spp", film.declared_spp())?;
    let error = py.detach(|| film.relative_error());
    out.set_item("relative_error", error.is_finite().then_some(error))?;
    out.set_item("non_finite", film.counters().non_finite)?;
    Ok(out)
}

/// The picture of films: its layers by name, of the pixels that the films have, or of the `whole` crop. Pixels without samples are 0.
#[pyfunction]
#[pyo3(signature = (films, variance, samples, whole = false))]
pub fn film_layers(py: Python<'_>, films: Vec<PyBackedBytes>, variance: bool, samples: bool, whole: bool) -> PyResult<Bound<'_, PyDict>> {
    let mut film = merge(py, films)?;
    if whole && film.rect() != film.spec().crop {
        let add = || -> Result<Film, FilmError> {
            let mut sum = Film::new(film.spec().clone())?;
            sum.meta = film.meta.clone();
            sum.merge(&film)?;
            Ok(sum)
        };
        film = py.detach(add).map_err(|e| errors::error(py, "ImageError", e.to_string()))?;
    }
    let image = py.detach(|| film.develop_with(DevelopOptions { variance, sample_count: samples }));
    layers::to_python(py, &image)
}

/// Writes the picture of films to a file, as `etendue render` does.
#[pyfunction]
pub fn film_picture(
    py: Python<'_>,
    films: Vec<PyBackedBytes>,
    path: PathBuf,
    operator: &str,
    exposure: f32,
    variance: bool,
    samples: bool,
) -> PyResult<()> {
    let operator = ToneOperator::from_name(operator).ok_or_else(|| {
        let known = ToneOperator::NAMES.join(", ");
        errors::error(py, "SettingError", format!("no tone mapping `{operator}`; there are {known}"))
    })?;
    let film = merge(py, films)?;
    let file = path.clone();
    let work = move || -> Result<(), ImageError> {
        let image = film.develop_with(DevelopOptions { variance, sample_count: samples });
        image.save(&file, &WriteOptions { tone: ToneMap { operator, exposure }, ..WriteOptions::default() })
    };
    background::run(py, None, work, |_| Ok(()))?.map_err(|e| errors::image_error(py, &e, &path))
}
