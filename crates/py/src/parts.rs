//! Parts of pictures as film files: what a farm's workers make.

use std::sync::{Arc, Mutex, PoisonError};

use etendue_render::film::Rect;
use etendue_render::session::job::{self, JobError, Plan};
use etendue_render::session::{Aov, Cancel, Reason, Session, SessionError, Silent, Stop};
use etendue_scene::{RenderSettings, SceneDesc};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::places::Places;
use crate::{background, errors};

/// Why nothing is prepared.
enum Fault {
    Job(JobError),
    Session(SessionError),
}

/// What is cut into parts for a farm's workers: rectangles of pixels with ranges of samples. Points of a bake lie in one row of pixels; a
/// photon map is one pixel whose samples are photons.
#[pyclass(frozen, subclass, module = "etendue._etendue")]
pub struct Parts {
    /// Pixels in a row of the full picture.
    #[pyo3(get)]
    pub width: u32,
    /// Rows of the full picture.
    #[pyo3(get)]
    pub height: u32,
    /// The pixels of the picture: x0, y0, x1, y1.
    #[pyo3(get)]
    pub crop: (u32, u32, u32, u32),
    /// Samples per pixel that settings and file ask for.
    #[pyo3(get)]
    pub spp: u32,
    /// Whether a part has all samples of its pixels, as where pixels take no more than they need: with antialiasing and adaptive sampling.
    #[pyo3(get)]
    pub is_adaptive: bool,
    /// Whether samples give light to other pixels: then a part is the whole picture.
    #[pyo3(get)]
    pub splats: bool,
    /// Whether each range of samples begins with work of its own, such as new particles: then a part is better the whole picture.
    #[pyo3(get)]
    pub has_costly_passes: bool,
    /// What the method has chosen or found, and what the scene names and could not be loaded.
    #[pyo3(get)]
    pub warnings: Vec<String>,
}

/// A compiled scene with its settings, from which parts of the picture are rendered one after the other.
#[pyclass(frozen, extends = Parts, module = "etendue._etendue")]
pub struct Prepared {
    /// `None` while a part is being rendered, and after an error.
    session: Arc<Mutex<Option<Session>>>,
    pool: Arc<rayon::ThreadPool>,
    /// Name of the integrator.
    #[pyo3(get)]
    integrator: String,
    /// A hash of all that the picture depends on.
    #[pyo3(get)]
    scene_hash: String,
}

impl Prepared {
    /// Compiles. Without `fixed_spp`, and without a number in the settings, the samples are decided while rendering, as where
    /// `etendue render` stops by noise or time.
    #[expect(clippy::too_many_arguments, reason = "keywords of one Python function")]
    pub fn new(
        py: Python<'_>,
        desc: &Arc<SceneDesc>,
        places: &Places,
        settings: RenderSettings,
        crop: Option<[u32; 4]>,
        threads: usize,
        aovs: &[String],
        fixed_spp: bool,
    ) -> PyResult<Py<Self>> {
        let job_error = |e: JobError| errors::job_error(py, &e, &desc.files, places);
        let (aovs, _) = Aov::parse_list(aovs).map_err(|e| errors::error(py, "SettingError", e))?;
        let mut plan = Plan::new(desc, &settings, crop).map_err(job_error)?;
        if settings.spp.is_none() && !fixed_spp {
            plan.spp = if plan.error_goal.is_some() { plan.spp } else { job::DEFAULT_SPP };
            plan.be_even();
        }
        let pool = background::pool(py, threads)?;
        let (worker, worker_desc, worker_plan) = (Arc::clone(&pool), Arc::clone(desc), plan.clone());
        let cancel = Cancel::default();
        let worker_cancel = cancel.clone();
        let work = move || {
            worker.install(|| {
                let mut session = job::prepare(&worker_desc, &settings, &worker_plan, &aovs).map_err(Fault::Job)?;
                // What the method does once (a pilot, a solution) decides how the picture is best cut, and is no part's own cost.
                session.render(&Stop { spp: Some(0), ..Stop::default() }, &worker_cancel, &Silent).map_err(Fault::Session)?;
                Ok((session, worker_desc.content_hash()))
            })
        };
        let made = background::run(py, Some(&cancel), work, |_| Ok(()))?;
        let (mut session, scene_hash) = made.map_err(|e| match e {
            Fault::Job(e) => job_error(e),
            Fault::Session(e) => errors::error(py, "SettingError", e.to_string()),
        })?;
        session.set_scene_hash(scene_hash.clone());
        let Rect { x0, y0, x1, y1 } = plan.crop;
        let parts = Parts {
            width: plan.width,
            height: plan.height,
            crop: (x0, y0, x1, y1),
            spp: plan.spp,
            is_adaptive: plan.is_uneven(),
            splats: session.splats(),
            has_costly_passes: session.has_costly_passes(),
            warnings: [session.notes(), session.warnings().to_vec()].concat(),
        };
        Py::new(py, (Self { integrator: plan.integrator, session: Arc::new(Mutex::new(Some(session))), scene_hash, pool }, parts))
    }
}

#[pymethods]
impl Prepared {
    /// Renders the samples `begin..end` of the pixels of `rect` and returns the film file's bytes, or None where `should_stop`, which is
    /// called some 20 times a second, has returned True.
    #[pyo3(signature = (rect, begin, end, should_stop=None))]
    fn render<'py>(
        slf: PyRef<'py, Self>,
        py: Python<'py>,
        rect: [u32; 4],
        begin: u32,
        end: u32,
        should_stop: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let rect = Rect::new(rect[0], rect[1], rect[2], rect[3]);
        let (this, parts) = (&*slf, slf.as_super());
        let (x0, y0, x1, y1) = parts.crop;
        let whole = Rect::new(x0, y0, x1, y1);
        let setting = |message: String| errors::error(py, "SettingError", message);
        if begin >= end {
            return Err(setting(format!("a part has samples: not {begin}..{end}")));
        }
        if rect.area() == 0 || !whole.contains_rect(&rect) {
            return Err(setting(format!("the pixels {rect} are not within the picture's {whole}")));
        }
        if parts.splats && rect != whole {
            return Err(setting(format!("`{}` gives light to all pixels: its parts are the whole picture", this.integrator)));
        }
        if parts.is_adaptive && (begin, end) != (0, parts.spp) {
            return Err(setting(format!(
                "where pixels take different numbers of samples a part has all, 0..{}, not {begin}..{end}",
                parts.spp
            )));
        }
        let taken = this.session.lock().unwrap_or_else(PoisonError::into_inner).take();
        let mut session = taken.ok_or_else(|| errors::error(py, "Error", "another part is being rendered, or has failed".to_owned()))?;
        if let Err(e) = session.set_part(rect, begin) {
            *this.session.lock().unwrap_or_else(PoisonError::into_inner) = Some(session);
            return Err(setting(e.to_string()));
        }
        let (pool, slot, cancel) = (Arc::clone(&this.pool), Arc::clone(&this.session), Cancel::default());
        let stop = Stop { spp: Some(end - begin), ..Stop::default() };
        let worker_cancel = cancel.clone();
        let work = move || {
            let result = pool.install(|| session.render(&stop, &worker_cancel, &Silent)).map_err(|e| e.to_string())?;
            let mut bytes = Vec::new();
            if result != Reason::Cancelled {
                pool.install(|| session.film().write_to(&mut bytes)).map_err(|e| e.to_string())?;
            }
            *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(session);
            Ok::<_, String>((result != Reason::Cancelled).then_some(bytes))
        };
        let bytes = background::run(py, Some(&cancel), work, background::stopper(should_stop.as_ref(), &cancel))?
            .map_err(|e| errors::error(py, "Error", e))?;
        Ok(bytes.map(|b| PyBytes::new(py, &b)))
    }
}
