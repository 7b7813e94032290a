//! Scenes: reading them and what is known of them.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use etendue_cli::scene_args::SceneArgs;
use etendue_render::scene::View;
use etendue_scene::formats::{self, ReadOptions, mitsuba};
use etendue_scene::{ReadError, RenderSettings, SceneDesc, Severity, passes, validate};
use glam::DMat4;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::bake::PreparedBake;
use crate::compiled::{Compiled, Source};
use crate::parts::Prepared;
use crate::photons::PreparedPhotons;
use crate::places::{Place, Places};
use crate::render::RenderArgs;
use crate::{background, dict, errors, info, render};

/// File, line, column, feature, effect.
type LossRow = (String, Option<u32>, Option<u32>, String, String);
/// File, line, column, severity, message.
type FaultRow = (String, Option<u32>, Option<u32>, &'static str, String);

/// A scene that has been read. It never changes.
#[pyclass(frozen, module = "etendue._etendue")]
pub struct Scene {
    desc: Arc<SceneDesc>,
    places: Arc<Places>,
    view: Option<View>,
    compiled: Arc<Compiled>,
}

#[pymethods]
impl Scene {
    /// What is in the scene, as a dictionary.
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        info::of(py, &self.desc)
    }

    /// What the file holds and the renderer does not honor: (file, line, column, feature, effect).
    fn losses(&self) -> Vec<LossRow> {
        let losses = self.desc.report.losses.iter();
        losses
            .map(|l| {
                let (file, line, column): Place = self.places.place(l.span, &self.desc.files);
                (file, line, column, l.feature.clone(), l.effect.clone())
            })
            .collect()
    }

    /// Warnings of the reader: (file, line, column, severity, message).
    fn warnings(&self) -> Vec<FaultRow> {
        let warnings = self.desc.report.faults.iter().filter(|f| f.severity == Severity::Warning);
        warnings
            .map(|f| {
                let (file, line, column): Place = self.places.place(f.span, &self.desc.files);
                (file, line, column, errors::severity(f.severity), f.message.clone())
            })
            .collect()
    }

    /// Where the camera stands: four rows of `world_from_camera` (+x right, +y up, looking along −z), and the zoom.
    fn view(&self, py: Python<'_>, camera: Option<String>) -> PyResult<([[f64; 4]; 4], f64)> {
        let settings = RenderSettings { camera, ..RenderSettings::default() };
        let view = match self.view {
            Some(view) => view,
            None => View::of(&self.desc, &settings).map_err(|faults| errors::scene_error(py, &faults, &self.desc.files, &self.places))?,
        };
        Ok((view.world_from_camera.transpose().to_cols_array_2d(), view.zoom))
    }

    /// The same scene with its camera elsewhere.
    fn with_view(&self, py: Python<'_>, world_from_camera: [[f64; 4]; 4], zoom: f64) -> PyResult<Self> {
        let matrix = DMat4::from_cols_array_2d(&world_from_camera).transpose();
        let refused = || errors::error(py, "SettingError", "the camera's matrix is flat or not finite, or the zoom not above 0".to_owned());
        let view = View::new(matrix, zoom).ok_or_else(refused)?;
        Ok(Self { desc: Arc::clone(&self.desc), places: Arc::clone(&self.places), view: Some(view), compiled: Arc::clone(&self.compiled) })
    }

    /// Compiles the scene for a farm's worker; see `etendue.Scene.prepare`.
    fn prepare(
        &self,
        py: Python<'_>,
        settings: &Bound<'_, PyDict>,
        crop: Option<[u32; 4]>,
        threads: usize,
        aovs: Vec<String>,
        fixed_spp: bool,
    ) -> PyResult<Py<Prepared>> {
        if self.view.is_some() {
            return Err(errors::error(py, "SettingError", "a scene with a moved camera cannot be prepared for a farm".to_owned()));
        }
        Prepared::new(py, &self.desc, &self.places, crate::settings::from_keywords(settings)?, crop, threads, &aovs, fixed_spp)
    }

    /// Makes a bake ready for a farm's worker: `options` are those of `etendue bake`.
    fn prepare_bake(
        &self,
        py: Python<'_>,
        settings: &Bound<'_, PyDict>,
        threads: usize,
        options: &Bound<'_, PyDict>,
    ) -> PyResult<Py<PreparedBake>> {
        PreparedBake::new(py, &self.desc, &self.places, crate::settings::from_keywords(settings)?, threads, options)
    }

    /// Makes the tracing of photons ready for a farm's worker.
    fn prepare_photons(&self, py: Python<'_>, settings: &Bound<'_, PyDict>, threads: usize) -> PyResult<Py<PreparedPhotons>> {
        PreparedPhotons::new(py, &self.desc, &self.places, &crate::settings::from_keywords(settings)?, threads)
    }

    /// Renders; see `etendue.Scene.render`. Returns the layers of the picture by name.
    #[pyo3(signature = (settings, *, crop, time, noise, threads, aovs, progress, preview))]
    #[expect(clippy::too_many_arguments, reason = "keywords of one Python function")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        settings: &Bound<'py, PyDict>,
        crop: Option<[u32; 4]>,
        time: Option<f64>,
        noise: Option<f64>,
        threads: usize,
        aovs: Vec<String>,
        progress: Option<Bound<'py, PyAny>>,
        preview: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let settings = crate::settings::from_keywords(settings)?;
        let args = RenderArgs { settings, crop, time, noise, threads, aovs, progress, preview };
        let source = Source { desc: Arc::clone(&self.desc), view: self.view, compiled: Arc::clone(&self.compiled) };
        render::render(py, &source, &self.places, args)
    }
}

fn options(search_paths: Vec<PathBuf>, defines: BTreeMap<String, String>, variant: Option<String>, scene: Option<String>) -> ReadOptions {
    let mut options = ReadOptions { search_paths, defines, variant, scene, ..ReadOptions::default() };
    // Scripts of POV-Ray scenes ask what their objects look like.
    options.pov.probe = Some(Arc::new(etendue_render::solid::WorldProbe::new()));
    options
}

/// Reads in the background and wraps the result.
fn read(py: Python<'_>, places: Places, work: impl FnOnce() -> Result<SceneDesc, ReadError> + Send + 'static) -> PyResult<Scene> {
    let desc = background::run(py, None, work, |_| Ok(()))?.map_err(|e| errors::read_error(py, &e, &places))?;
    Ok(Scene { desc: Arc::new(desc), places: Arc::new(places), view: None, compiled: Arc::default() })
}

/// What [`formats::read`] does after the reader itself.
fn finish(mut desc: SceneDesc) -> Result<SceneDesc, ReadError> {
    passes::load_meshes(&mut desc)?;
    passes::complete(&mut desc);
    validate::validate(&mut desc)?;
    Ok(with_losses(desc))
}

/// Adds what the renderer does not honor to the report, as the command line does.
fn with_losses(mut desc: SceneDesc) -> SceneDesc {
    desc.report.losses.extend(etendue_render::scene::losses(&desc));
    desc
}

/// Number of the frame (0: no animation) and of the last frame, size of the picture as far as it is given.
type Moment = (i32, i32, [Option<u32>; 2]);

/// Reads a scene file of any format; with a moment, as the command line does. `clock` is that of a POV-Ray scene, or a second of a glTF
/// file's animation.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "keywords of one Python function")]
pub fn load(
    py: Python<'_>,
    path: PathBuf,
    search_paths: Vec<PathBuf>,
    defines: BTreeMap<String, String>,
    variant: Option<String>,
    scene: Option<String>,
    animation: Option<String>,
    clock: Option<f64>,
    moment: Option<Moment>,
) -> PyResult<Scene> {
    let Some((frame, frames, size)) = moment else {
        let mut options = ReadOptions { time: clock, animation, ..options(search_paths, defines, variant, scene) };
        options.pov.clock = clock.unwrap_or(0.0);
        return read(py, Places::default(), move || formats::read(&path, &options).map(with_losses));
    };
    let defines = defines.into_iter().collect();
    let script_output = None;
    let args = SceneArgs {
        scene: path,
        search_paths,
        defines,
        variant,
        gltf_scene: scene,
        gltf_animation: animation,
        clock,
        frame,
        frames,
        script_output,
        pov: None,
    };
    read(py, Places::default(), move || args.read(size))
}

/// Reads a Mitsuba scene from its XML text; names of files start in `folder`.
#[pyfunction]
pub fn load_string(
    py: Python<'_>,
    text: String,
    folder: PathBuf,
    search_paths: Vec<PathBuf>,
    defines: BTreeMap<String, String>,
) -> PyResult<Scene> {
    let options = options(search_paths, defines, None, None);
    read(py, Places::default(), move || finish(mitsuba::read_bytes(&folder.join("<string>"), text.as_bytes(), &options)?))
}

/// Reads a scene from a nested dictionary in Mitsuba's terms; names of files start in `folder`.
#[pyfunction]
pub fn load_dict(py: Python<'_>, description: &Bound<'_, PyDict>, folder: PathBuf, search_paths: Vec<PathBuf>) -> PyResult<Scene> {
    let options = options(search_paths, BTreeMap::new(), None, None);
    let (tree, places) = dict::tree(description)?;
    read(py, places, move || finish(mitsuba::from_tree(&tree, &folder, &options)?))
}
