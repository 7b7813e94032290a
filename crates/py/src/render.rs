//! Rendering with progress, cancelling and Python's signals.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use etendue_render::film::{DevelopOptions, Film};
use etendue_render::image::Image;
use etendue_render::session::job::{self, JobError, Plan};
use etendue_render::session::{self, Aov, Cancel, Observer, Stop};
use etendue_scene::RenderSettings;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};

use crate::compiled::Source;
use crate::places::Places;
use crate::{background, errors, layers};

/// How far a rendering is.
#[pyclass(frozen, get_all, module = "etendue._etendue")]
pub struct Status {
    /// Done share from 0 to 1.
    fraction: f64,
    /// Samples per pixel that are complete everywhere.
    spp_done: u32,
    /// Samples per pixel that are planned; None where time or noise decides.
    spp_target: Option<u32>,
    /// Seconds since the start.
    elapsed_secs: f64,
    /// Estimated relative error; None until it is known.
    relative_error: Option<f64>,
}

#[pymethods]
impl Status {
    fn __repr__(&self) -> String {
        format!("Status(fraction={:.3}, spp_done={}, elapsed_secs={:.3})", self.fraction, self.spp_done, self.elapsed_secs)
    }
}

impl From<session::Status> for Status {
    fn from(s: session::Status) -> Self {
        let elapsed_secs = s.elapsed.as_secs_f64();
        let session::Status { fraction, spp_done, spp_target, relative_error, .. } = s;
        Self { fraction, spp_done, spp_target, elapsed_secs, relative_error }
    }
}

/// Keeps the newest status for the thread that tells Python of it, and the error from then on.
#[derive(Default)]
struct Latest {
    status: Mutex<Option<session::Status>>,
    error: Mutex<Option<f64>>,
    /// What of the film is wanted after passes; `None`: nothing.
    wanted: Option<DevelopOptions>,
    /// The picture of the newest pass, and how far the session was.
    preview: Mutex<Option<(Image, session::Status)>>,
}

impl Latest {
    fn take(&self) -> Option<session::Status> {
        let mut status = self.status.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        let mut error = self.error.lock().unwrap_or_else(PoisonError::into_inner);
        *error = status.relative_error.or(*error);
        status.relative_error = error.filter(|e| e.is_finite());
        Some(status)
    }

    fn take_preview(&self) -> Option<(Image, session::Status)> {
        self.preview.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl Observer for Latest {
    fn status(&self, status: &session::Status) {
        let mut latest = self.status.lock().unwrap_or_else(PoisonError::into_inner);
        let relative_error = status.relative_error.or(latest.and_then(|s| s.relative_error));
        *latest = Some(session::Status { relative_error, ..*status });
    }

    fn pass(&self, film: &Film, status: &session::Status) {
        let Some(options) = self.wanted else { return };
        let mut preview = self.preview.lock().unwrap_or_else(PoisonError::into_inner);
        // One picture waits at a time: Python takes them as fast as it can, and never faster than they are made.
        if preview.is_none() {
            *preview = Some((film.develop_with(options), *status));
        }
    }
}

/// What `Scene.render` takes.
pub struct RenderArgs<'py> {
    pub settings: RenderSettings,
    pub crop: Option<[u32; 4]>,
    pub time: Option<f64>,
    pub noise: Option<f64>,
    pub threads: usize,
    pub aovs: Vec<String>,
    pub progress: Option<Bound<'py, PyAny>>,
    pub preview: Option<Bound<'py, PyAny>>,
}

/// Renders and returns the picture's layers by name.
///
/// # Errors
/// `SettingError`, `SceneError`, and what the progress callback or a signal handler raises.
pub fn render<'py>(py: Python<'py>, source: &Source, places: &Places, args: RenderArgs<'py>) -> PyResult<Bound<'py, PyDict>> {
    let desc = &source.desc;
    let RenderArgs { settings, crop, time, noise, threads, aovs, progress, preview } = args;
    let job_error = |e: JobError| errors::job_error(py, &e, &desc.files, places);
    let (aovs, develop) = parse_aovs(py, &aovs)?;
    let mut plan = Plan::new(desc, &settings, crop).map_err(job_error)?;
    let stop = stop(py, &settings, &plan, time, noise)?;
    if stop.spp.is_none() {
        plan.be_even();
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(32 << 20).build();
    let pool = Arc::new(pool.map_err(|e| errors::error(py, "SettingError", format!("{threads} threads could not be started: {e}")))?);
    let (worker, worker_source) = (Arc::clone(&pool), source.clone());
    let key = job::compile_key(&settings);
    let prepare = move || worker.install(|| worker_source.prepare(&settings, &plan, &aovs));
    let (mut session, scene) = background::run(py, None, prepare, |_| Ok(()))?.map_err(job_error)?;

    let wanted = preview.is_some().then_some(develop);
    let (cancel, latest) = (Cancel::default(), Arc::new(Latest { wanted, ..Latest::default() }));
    let tell = |status: session::Status| -> PyResult<()> {
        let Some(progress) = &progress else { return Ok(()) };
        let answer = progress.call1((Status::from(status),))?;
        // Only `False` itself stops: a callback that returns nothing returns None.
        if answer.cast::<PyBool>().is_ok_and(|b| !b.is_true()) {
            cancel.cancel();
        }
        Ok(())
    };
    let (worker_cancel, worker_latest) = (cancel.clone(), Arc::clone(&latest));
    let work = move || {
        let result = pool.install(|| session.render(&stop, &worker_cancel, &*worker_latest));
        (session, result)
    };
    let show = |py: Python<'_>| -> PyResult<()> {
        if let (Some(preview), Some((image, status))) = (&preview, latest.take_preview()) {
            preview.call1((layers::to_python(py, &image)?, Status::from(status)))?;
        }
        Ok(())
    };
    let (session, result) = background::run(py, Some(&cancel), work, |py| {
        latest.take().map_or(Ok(()), tell)?;
        show(py)
    })?;
    result.map_err(|e| errors::error(py, "Error", e.to_string()))?;
    latest.take().map_or(Ok(()), tell)?;
    let image = py.detach(|| {
        let image = session.film().develop_with(develop);
        // The scene belongs to its store again.
        drop(session);
        source.compiled.keep(key, scene);
        image
    });
    layers::to_python(py, &image)
}

/// As the command line does: without a number of samples, time and noise alone decide.
fn stop(py: Python<'_>, settings: &RenderSettings, plan: &Plan, time: Option<f64>, noise: Option<f64>) -> PyResult<Stop> {
    let duration = |secs: f64| {
        Duration::try_from_secs_f64(secs).map_err(|e| errors::error(py, "SettingError", format!("`time` takes seconds, not {secs}: {e}")))
    };
    let time = time.map(duration).transpose()?;
    let by_other = settings.spp.is_none() && (time.is_some() || noise.is_some());
    Ok(Stop { spp: (!by_other).then_some(plan.spp), time, noise })
}

fn parse_aovs(py: Python<'_>, names: &[String]) -> PyResult<(Vec<Aov>, DevelopOptions)> {
    Aov::parse_list(names).map_err(|e| errors::error(py, "SettingError", e))
}
