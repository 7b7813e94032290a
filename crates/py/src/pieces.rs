//! Parts of any work of a farm, by what their bytes are: films, parts of bakes, photon maps.

use etendue_render::film::Film;
use etendue_render::film::file::DEFAULT_MEMORY_LIMIT;
use etendue_render::lightmap::Part;
use etendue_render::photon::PhotonMap;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict};

use crate::{background, errors, films};

fn map(bytes: &[u8], room: u64) -> Result<PhotonMap, String> {
    PhotonMap::read_from(&mut &*bytes, bytes.len() as u64, room).map_err(|e| e.to_string())
}

fn part(bytes: &[u8]) -> Result<Part, String> {
    Part::from_bytes(bytes).ok_or_else(|| "is no part of a bake, or a damaged one".to_owned())
}

/// The exact sum of parts of one kind. A photon map takes at most `memory_mib` in use and is thinned where it has more.
#[pyfunction]
pub fn part_merge(py: Python<'_>, parts: Vec<PyBackedBytes>, memory_mib: u32) -> PyResult<Bound<'_, PyBytes>> {
    let work = move || -> Result<Vec<u8>, String> {
        let first = parts.first().ok_or("there are no parts to merge")?;
        let mut bytes = Vec::new();
        if Part::is_part(first) {
            let parts = parts.iter().map(|p| part(p)).collect::<Result<_, _>>()?;
            bytes = Part::merge(parts).map_err(|e| e.to_string())?.to_bytes().map_err(|e| e.to_string())?;
        } else if PhotonMap::is_file(first) {
            // As a map is thinned that is traced at once.
            let room = PhotonMap::room(u64::from(memory_mib) << 20);
            let mut total = map(first, room)?;
            for part in &parts[1..] {
                total.merge_within(map(part, room)?, room).map_err(|e| e.to_string())?;
            }
            total.write_to(&mut bytes).map_err(|e| e.to_string())?;
        } else {
            films::merged(&parts)?.write_to(&mut bytes).map_err(|e| e.to_string())?;
        }
        Ok(bytes)
    };
    let bytes = background::run(py, None, work, |_| Ok(()))?.map_err(|e| errors::error(py, "ImageError", e))?;
    Ok(PyBytes::new(py, &bytes))
}

/// What a part holds: rectangles of pixels (or of points in a row) with ranges of samples (or photons) as
/// (x0, y0, x1, y1, begin, end); and the seconds that it took, where it tells.
#[pyfunction]
pub fn part_info(py: Python<'_>, part: PyBackedBytes) -> PyResult<Bound<'_, PyDict>> {
    type Held = Vec<(u64, u64, u64, u64, u64, u64)>;
    let bytes = part;
    let work = move || -> Result<(Held, f64), String> {
        if Part::is_part(&bytes) {
            let (begin, end, spp) = self::part(&bytes)?.held();
            return Ok((vec![(begin, 0, end, 1, 0, u64::from(spp))], 0.0));
        }
        if PhotonMap::is_file(&bytes) {
            return Ok((map(&bytes, u64::MAX)?.segments().iter().map(|s| (0, 0, 1, 1, s.begin, s.end)).collect(), 0.0));
        }
        let film = Film::from_bytes(&bytes, DEFAULT_MEMORY_LIMIT).map_err(|e| e.to_string())?;
        let held = film.held().entries().iter().map(|h| {
            let [x0, y0, x1, y1, begin, end] = [h.rect.x0, h.rect.y0, h.rect.x1, h.rect.y1, h.begin, h.end].map(u64::from);
            (x0, y0, x1, y1, begin, end)
        });
        Ok((held.collect(), film.meta.render_ms as f64 / 1000.0))
    };
    let (held, secs) = background::run(py, None, work, |_| Ok(()))?.map_err(|e| errors::error(py, "ImageError", e))?;
    let out = PyDict::new(py);
    out.set_item("held", held)?;
    out.set_item("render_secs", secs)?;
    Ok(out)
}
