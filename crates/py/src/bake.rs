//! Parts of a bake: what a farm's workers make of texels and vertices.

use std::path::PathBuf;
use std::sync::Arc;

use etendue_render::denoise::Denoiser;
use etendue_render::image::Image;
use etendue_render::integrator::Stage;
use etendue_render::lightmap::deliver::Order;
use etendue_render::lightmap::output::Display;
use etendue_render::lightmap::{Bake, BakeError, BakeOptions, Method, Part, Sides, Target, Watcher};
use etendue_render::session::{Cancel, Observer};
use etendue_scene::{RenderSettings, SceneDesc};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict};

use crate::parts::Parts;
use crate::places::Places;
use crate::{background, errors, layers};

/// Paths of finished files, sentences for the user, the relative error, and the first atlas.
type Files<'py> = (Vec<PathBuf>, Vec<String>, f64, Option<Bound<'py, PyAny>>);

/// Nobody watches.
struct Alone;

impl Observer for Alone {}
impl Watcher for Alone {}

/// A scene that is ready to be baked, of which some points, texels or vertices, are sampled at a time.
#[pyclass(frozen, extends = Parts, module = "etendue._etendue")]
pub struct PreparedBake {
    bake: Arc<Bake>,
    method: Arc<Method>,
    pool: Arc<rayon::ThreadPool>,
    name: String,
}

fn bake_error(py: Python<'_>, e: &BakeError, desc: &SceneDesc, places: &Places) -> PyErr {
    match e {
        BakeError::Faults(faults) => errors::scene_error(py, faults, &desc.files, places),
        BakeError::Scene(m) => errors::error(py, "SceneError", m.clone()),
        e => errors::error(py, "SettingError", e.to_string()),
    }
}

fn options(py: Python<'_>, given: &Bound<'_, PyDict>) -> PyResult<(String, bool, BakeOptions)> {
    let mut options = BakeOptions::default();
    let (mut method, mut gather) = ("path".to_owned(), false);
    for (key, value) in given {
        let key: String = key.extract()?;
        match key.as_str() {
            "method" => method = value.extract()?,
            "final_gather" => gather = value.extract()?,
            "texels_per_meter" => options.texels_per_meter = value.extract()?,
            "resolution" => options.resolution = value.extract()?,
            "padding" => options.padding = value.extract()?,
            "unwrap" => options.unwrap = value.extract()?,
            "per_vertex" => options.target = if value.extract()? { Target::Vertices } else { Target::Texels },
            "sides" => {
                options.sides = match value.extract::<String>()?.as_str() {
                    "auto" => Sides::Auto,
                    "front" => Sides::Front,
                    "both" => Sides::Both,
                    other => return Err(errors::error(py, "SettingError", format!("no sides `{other}`; there are auto, front, both"))),
                }
            }
            _ => return Err(errors::error(py, "SettingError", format!("a bake has no option `{key}`"))),
        }
    }
    Ok((method, gather, options))
}

impl PreparedBake {
    /// Flattens, unwraps and compiles the scene, and solves it as far as the method does that before the first point.
    pub fn new(
        py: Python<'_>,
        desc: &Arc<SceneDesc>,
        places: &Places,
        settings: RenderSettings,
        threads: usize,
        given: &Bound<'_, PyDict>,
    ) -> PyResult<Py<Self>> {
        let (name, gather, options) = options(py, given)?;
        let pool = background::pool(py, threads)?;
        let (worker, worker_desc, worker_name) = (Arc::clone(&pool), Arc::clone(desc), name.clone());
        let cancel = Cancel::default();
        let stopper = cancel.clone();
        let work = move || {
            worker.install(|| {
                let whole = if gather { format!("{worker_name} gathered") } else { worker_name.clone() };
                let bake = Bake::new(&worker_desc, &settings, &options, &whole)?;
                let mut warnings = bake.flat.notes.clone();
                let is_cancelled = || stopper.is_cancelled();
                let stage = Stage::without_camera(settings.seed, &is_cancelled, &|_, _| {});
                let method = bake.method(&worker_name, gather, &stage, &mut warnings)?;
                let spp = settings.spp.unwrap_or(method.default_spp());
                Ok((bake, method, spp, warnings))
            })
        };
        let made = background::run(py, Some(&cancel), work, |_| Ok(()))?;
        let (bake, method, spp, warnings) = made.map_err(|e| bake_error(py, &e, desc, places))?;
        let points = u32::try_from(bake.point_count()).ok().filter(|n| *n > 0);
        let width = points.ok_or_else(|| errors::error(py, "SceneError", "the scene has no surface to bake, or too many points".into()))?;
        // A point has all of its samples in one part, and gets its own light alone.
        let parts =
            Parts { width, height: 1, crop: (0, 0, width, 1), spp, is_adaptive: true, splats: false, has_costly_passes: false, warnings };
        Py::new(py, (Self { bake: Arc::new(bake), method: Arc::new(method), pool, name }, parts))
    }
}

#[pymethods]
impl PreparedBake {
    /// Takes the samples `0..end` of the points of `rect`, and returns the part's bytes, or None where `should_stop`, which is called some 20
    /// times a second, has returned True.
    #[pyo3(signature = (rect, begin, end, should_stop=None))]
    fn render<'py>(
        slf: PyRef<'py, Self>,
        py: Python<'py>,
        rect: [u32; 4],
        begin: u32,
        end: u32,
        should_stop: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let width = slf.as_super().width;
        if begin != 0 || end == 0 || rect[0] >= rect[2] || rect[2] > width || (rect[1], rect[3]) != (0, 1) {
            let text = format!("a part of this bake has samples from 0 on of some of {width} points");
            return Err(errors::error(py, "SettingError", text));
        }
        let (bake, method, pool) = (Arc::clone(&slf.bake), Arc::clone(&slf.method), Arc::clone(&slf.pool));
        let cancel = Cancel::default();
        let worker = cancel.clone();
        let work = move || {
            let points = rect[0] as usize..rect[2] as usize;
            pool.install(|| bake.solve_part(&method, points, end, &worker, &Alone)).map(|p| p.to_bytes()).transpose()
        };
        let bytes = background::run(py, Some(&cancel), work, background::stopper(should_stop.as_ref(), &cancel))?;
        Ok(bytes?.map(|b| PyBytes::new(py, &b)))
    }

    /// Makes the files of all points' part: `path`, a GLB, and what was ordered beside it. Returns their paths, sentences for the user,
    /// the relative error, and the first atlas as an array of shape (height, width, 3), W·m⁻², or None without atlases.
    #[pyo3(signature = (part, path, *, display, probes, maps, directional, denoise))]
    #[expect(clippy::too_many_arguments, reason = "keywords of one Python function")]
    fn finish<'py>(
        &self,
        py: Python<'py>,
        part: PyBackedBytes,
        path: PathBuf,
        display: &str,
        probes: Option<[u32; 3]>,
        maps: bool,
        directional: bool,
        denoise: bool,
    ) -> PyResult<Files<'py>> {
        let setting = |m: String| errors::error(py, "SettingError", m);
        let display = match display {
            "emissive" => Display::Emissive,
            "unlit" => Display::Unlit,
            "lightmap" => Display::Lightmap,
            other => return Err(setting(format!("no display `{other}`; there are emissive, unlit, lightmap"))),
        };
        let order = Order { display, probes, maps, directional };
        let denoiser = if denoise { Some(Denoiser::load().map_err(|e| setting(e.to_string()))?) } else { None };
        let (bake, method, pool, name) = (Arc::clone(&self.bake), Arc::clone(&self.method), Arc::clone(&self.pool), self.name.clone());
        let work = move || {
            pool.install(|| {
                let damaged = || BakeError::Checkpoint("is no part of a bake, or a damaged one".into());
                let solution = bake.whole(Part::from_bytes(&part).ok_or_else(damaged)?)?;
                let delivery = bake.deliver(&name, &method, &solution, solution.spp, &order, denoiser.as_ref())?;
                let paths = delivery.write(&path)?;
                let atlas = delivery.baked.irradiance.first().map(|m| Image::from_rgb(m.size[0], m.size[1], &m.data));
                Ok::<_, BakeError>((paths, delivery.notes, solution.relative_error(), atlas))
            })
        };
        let (paths, notes, error, atlas) = background::run(py, None, work, |_| Ok(()))?.map_err(|e| setting(e.to_string()))?;
        let atlas = match atlas {
            Some(image) => layers::to_python(py, &image)?.get_item("rgb")?,
            None => None,
        };
        Ok((paths, notes, error, atlas))
    }
}
