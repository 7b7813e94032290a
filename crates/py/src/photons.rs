//! Parts of a photon map: what a farm's workers trace.

use std::sync::Arc;

use etendue_render::integrator::{DEFAULT_PHOTONS, photon_limits};
use etendue_render::photon::{MapInfo, PhotonMap};
use etendue_render::scene::Scene;
use etendue_render::session::{Cancel, job};
use etendue_scene::{RenderSettings, SceneDesc};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::parts::Parts;
use crate::places::Places;
use crate::{background, errors};

/// A compiled scene whose photons are traced, some at a time.
#[pyclass(frozen, extends = Parts, module = "etendue._etendue")]
pub struct PreparedPhotons {
    scene: Arc<Scene>,
    pool: Arc<rayon::ThreadPool>,
    info: MapInfo,
    budget: u64,
}

impl PreparedPhotons {
    /// Compiles.
    pub fn new(py: Python<'_>, desc: &Arc<SceneDesc>, places: &Places, settings: &RenderSettings, threads: usize) -> PyResult<Py<Self>> {
        let pool = background::pool(py, threads)?;
        let (worker, worker_desc) = (Arc::clone(&pool), Arc::clone(desc));
        let work = move || worker.install(|| job::compile_for_photons(&worker_desc));
        let scene = background::run(py, None, work, |_| Ok(()))?.map_err(|e| errors::job_error(py, &e, &desc.files, places))?;
        let parts = Parts {
            width: 1,
            height: 1,
            crop: (0, 0, 1, 1),
            spp: settings.photons.unwrap_or(DEFAULT_PHOTONS).max(1),
            is_adaptive: false,
            splats: false,
            has_costly_passes: false,
            warnings: photon_limits(&scene),
        };
        let info = MapInfo { scene_hash: desc.light_hash(), seed: settings.seed, max_depth: settings.max_depth };
        Py::new(py, (Self { scene: Arc::new(scene), pool, info, budget: u64::from(settings.photon_memory) << 20 }, parts))
    }
}

#[pymethods]
impl PreparedPhotons {
    /// Traces the photons `begin..end` and returns the map's bytes, or None where `should_stop`, which is called some 20 times a second,
    /// has returned True.
    #[pyo3(signature = (rect, begin, end, should_stop=None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        rect: [u32; 4],
        begin: u32,
        end: u32,
        should_stop: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        if begin >= end || rect != [0, 0, 1, 1] {
            return Err(errors::error(py, "SettingError", format!("a part of a photon map has photons: not {begin}..{end}")));
        }
        let (scene, pool, info, budget) = (Arc::clone(&self.scene), Arc::clone(&self.pool), self.info.clone(), self.budget);
        let cancel = Cancel::default();
        let worker = cancel.clone();
        let work = move || {
            let mut map = PhotonMap::new(info);
            let range = u64::from(begin)..u64::from(end);
            pool.install(|| map.trace(&scene, range, budget, &|| worker.is_cancelled(), &mut |_, _| {}));
            let mut bytes = Vec::new();
            if !worker.is_cancelled() {
                map.write_to(&mut bytes).map_err(|e| e.to_string())?;
            }
            Ok::<_, String>((!worker.is_cancelled()).then_some(bytes))
        };
        let bytes = background::run(py, Some(&cancel), work, background::stopper(should_stop.as_ref(), &cancel))?;
        Ok(bytes.map_err(|e| errors::error(py, "Error", e))?.map(|b| PyBytes::new(py, &b)))
    }
}
