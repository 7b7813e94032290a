//! From a description and settings to a session: the one way in for the command line, Python and the farm.

use std::sync::Arc;

use etendue_scene::desc::classic::CameraKind;
use etendue_scene::desc::{FilmDesc, FilterDesc};
use etendue_scene::{Fault, RenderSettings, SceneDesc};

use super::{Antialias, Aov, Confidence, Session};
use crate::classic::{self, WorkingSpace};
use crate::film::{FilmError, FilmMeta, FilmSpec, Filter, Rect};
use crate::integrator::{self, Integrator};
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::{self, Scene, View};

/// Samples per pixel where neither the user nor the file says.
pub const DEFAULT_SPP: u32 = 64;
/// Most samples per pixel of adaptive sampling where the user does not say.
pub const ADAPTIVE_SPP: u32 = 1024;
/// Threshold of antialiasing for scenes of the classic model.
pub const CLASSIC_ANTIALIAS: f32 = 0.3;
/// Rows and columns of samples that antialiasing adds.
pub const ANTIALIAS_DEPTH: u32 = 3;
/// Most rows and columns.
const MAX_ANTIALIAS_DEPTH: u32 = 64;
/// The size of a picture where neither the user nor the file says.
pub const DEFAULT_SIZE: [u32; 2] = [1280, 720];
/// What chooses lights for next-event estimation.
const LIGHT_SAMPLERS: [&str; 3] = ["bvh", "power", "uniform"];
/// The largest picture, in pixels.
const MAX_PIXELS: u64 = 1 << 28;

/// Why a job could not be made.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// A setting does not fit.
    #[error("{0}")]
    Setting(String),
    /// The scene could not be compiled: all faults that were found, with spans into the description's files.
    #[error("the scene cannot be rendered: {}", .0.iter().map(|f| f.message.as_str()).collect::<Vec<_>>().join("; "))]
    Scene(Vec<Fault>),
    /// The film could not be made.
    #[error(transparent)]
    Film(#[from] FilmError),
}

/// What a picture of a scene looks like under given settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pixels to render.
    pub crop: Rect,
    /// Samples per pixel; with antialiasing, focal blur and adaptive sampling the most of them.
    pub spp: u32,
    /// Fewer samples where the picture is flat.
    pub antialias: Option<Antialias>,
    /// Fewer samples where a blurred picture is known well enough.
    pub confidence: Option<Confidence>,
    /// The relative error at which pixels take no more samples.
    pub error_goal: Option<f64>,
    /// Reconstruction filter.
    pub filter: Filter,
    /// Sequence.
    pub sampler: SamplerKind,
    /// Name of the integrator.
    pub integrator: String,
}

impl Plan {
    /// Settings first, then the file, then defaults. One given edge of the picture keeps the file's aspect ratio.
    ///
    /// # Errors
    /// [`JobError::Setting`] for unknown names and impossible sizes.
    pub fn new(desc: &SceneDesc, settings: &RenderSettings, crop: Option<[u32; 4]>) -> Result<Self, JobError> {
        let film = &desc.film;
        let classic = desc.classic.as_ref().filter(|_| classic::is_asked_for(desc, settings));
        let (width, height) = size(film, settings)?;
        let full = Rect::new(0, 0, width, height);
        let same_size = (width, height) == (film.width.unwrap_or(width), film.height.unwrap_or(height));
        let crop = match crop.or(film.crop.filter(|_| same_size)) {
            Some([x0, y0, x1, y1]) => {
                let rect = Rect::new(x0, y0, x1, y1);
                if x0 >= x1 || y0 >= y1 || !full.contains_rect(&rect) {
                    return Err(JobError::Setting(format!("the crop {x0},{y0},{x1},{y1} is not inside the picture of {width}×{height}")));
                }
                rect
            }
            None => full,
        };
        let filter = match &settings.filter {
            Some(name) => Filter::from_name(name).ok_or_else(|| {
                JobError::Setting(format!("no filter `{name}`; there are box, tent, gaussian, mitchell, blackman-harris, lanczos"))
            })?,
            None if classic.is_some() => Filter::BOX,
            None => film.filter.map_or(Filter::GAUSSIAN, filter),
        };
        let error_goal = error_goal(settings)?;
        let camera = classic.map(|c| &c.camera).filter(|c| !matches!(c.kind, CameraKind::Mesh(_)));
        let is_free = settings.spp.is_none() && film.spp.is_none() && error_goal.is_none();
        let confidence = camera.filter(|_| is_free).and_then(|camera| Confidence::new(&camera.blur));
        let sampler = match (&settings.sampler, film.sampler.as_str()) {
            (Some(name), _) => SamplerKind::from_name(name)
                .ok_or_else(|| JobError::Setting(format!("no sampler `{name}`; there are sobol, independent, stratified, halton")))?,
            // The file's choice is about its own renderer; ours is at least as good.
            (None, _) if classic.is_some() && error_goal.is_none() && confidence.is_none() => SamplerKind::Stratified,
            (None, _) => SamplerKind::Sobol,
        };
        if let Some(name) = settings.light_sampler.as_deref().filter(|n| !LIGHT_SAMPLERS.contains(n)) {
            return Err(JobError::Setting(format!("no light sampler `{name}`; there are {}", LIGHT_SAMPLERS.join(", "))));
        }
        let antialias = antialias(desc, settings)?;
        let spp = match (antialias, classic) {
            (Some(antialias), _) => antialias.spp(),
            // What the file says is meant for pixels that all take as many.
            (None, _) if error_goal.is_some() => settings.spp.unwrap_or(ADAPTIVE_SPP),
            (None, Some(classic)) => settings.spp.or(film.spp).unwrap_or(classic.camera.samples().unwrap_or(1)),
            (None, None) => settings.spp.or(film.spp).unwrap_or(DEFAULT_SPP),
        };
        if spp == 0 {
            return Err(JobError::Setting("a picture needs at least one sample per pixel".into()));
        }
        let integrator = settings
            .integrator
            .clone()
            .unwrap_or_else(|| if desc.integrator.name.is_empty() { integrator::DEFAULT.to_owned() } else { desc.integrator.name.clone() });
        Ok(Self { width, height, crop, spp, antialias, confidence, error_goal, filter, sampler, integrator })
    }

    /// Whether pixels may take fewer samples than [`Plan::spp`]; then the samples of a pixel are all rendered together.
    pub fn is_uneven(&self) -> bool {
        self.antialias.is_some() || self.confidence.is_some() || self.error_goal.is_some()
    }

    /// Gives each pixel as many samples as others, but for those that an error is the goal of.
    pub fn be_even(&mut self) {
        self.antialias = None;
        self.confidence = None;
    }
}

/// The relative error at which pixels take no more samples.
fn error_goal(settings: &RenderSettings) -> Result<Option<f64>, JobError> {
    match settings.adaptive {
        None | Some(0.0) => Ok(None),
        Some(goal) if !(goal > 0.0 && goal < 10.0) => Err(JobError::Setting(format!(
            "adaptive sampling takes a relative error, such as 0.02: or 0 for as many samples in each pixel: not {goal}"
        ))),
        Some(_) if settings.antialias.is_some_and(|t| t > 0.0) => {
            Err(JobError::Setting("antialiasing and adaptive sampling exclude each other: give `antialias` or `adaptive`".into()))
        }
        Some(goal) => Ok(Some(f64::from(goal))),
    }
}

/// The antialiasing of a picture. A number of samples that is given takes its place, and so does the blur of a camera.
fn antialias(desc: &SceneDesc, settings: &RenderSettings) -> Result<Option<Antialias>, JobError> {
    let is_given = settings.antialias.is_some_and(|t| t > 0.0);
    if is_given && settings.spp.is_some_and(|n| n > 1) {
        return Err(JobError::Setting("samples per pixel and antialiasing exclude each other: give `spp` or `antialias`".into()));
    }
    let depth = settings.antialias_depth.unwrap_or(ANTIALIAS_DEPTH);
    if depth == 0 || depth > MAX_ANTIALIAS_DEPTH {
        return Err(JobError::Setting(format!("antialiasing adds 1 to {MAX_ANTIALIAS_DEPTH} rows of samples, not {depth}")));
    }
    let classic = desc.classic.as_ref().filter(|_| classic::is_asked_for(desc, settings));
    let is_counted = settings.spp.is_some() || settings.adaptive.is_some_and(|goal| goal > 0.0);
    let default = if classic.is_some() && !is_counted { CLASSIC_ANTIALIAS } else { 0.0 };
    // A blurred pixel needs its samples even where the picture is flat.
    let has_own = classic.is_some_and(|c| c.camera.samples().is_some());
    let threshold = match settings.antialias {
        _ if has_own => 0.0,
        // One sample goes through the center, as in POV-Ray.
        Some(t) if !(t > 0.0) && classic.is_some() && !is_counted => f32::INFINITY,
        given => given.unwrap_or(default),
    };
    Ok((threshold > 0.0).then_some(Antialias { threshold, depth }))
}

fn size(film: &FilmDesc, settings: &RenderSettings) -> Result<(u32, u32), JobError> {
    let own = (film.width.unwrap_or(DEFAULT_SIZE[0]), film.height.unwrap_or(DEFAULT_SIZE[1]));
    let scaled = |edge: u32, from: u32, to: u32| ((f64::from(edge) * f64::from(to) / f64::from(from.max(1))).round() as u32).max(1);
    let (width, height) = match (settings.width, settings.height) {
        (Some(w), Some(h)) => (w, h),
        (Some(w), None) => (w, scaled(w, own.0, own.1)),
        (None, Some(h)) => (scaled(h, own.1, own.0), h),
        (None, None) => own,
    };
    if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(JobError::Setting(format!("a picture of {width}×{height} is not possible: 1 to {MAX_PIXELS} pixels")));
    }
    Ok((width, height))
}

fn filter(desc: FilterDesc) -> Filter {
    match desc {
        FilterDesc::Box => Filter::BOX,
        FilterDesc::Tent => Filter::TENT,
        FilterDesc::Gaussian { stddev } => Filter::Gaussian { stddev },
        FilterDesc::Mitchell { b, c } => Filter::Mitchell { b, c },
        FilterDesc::CatmullRom => Filter::Mitchell { b: 0.0, c: 0.5 },
        FilterDesc::BlackmanHarris => Filter::BLACKMAN_HARRIS,
        FilterDesc::Lanczos { lobes } => Filter::Lanczos { lobes: lobes as f32 },
    }
}

/// Compiles a scene and makes a session for it.
///
/// # Errors
/// [`JobError`]
pub fn prepare(desc: &SceneDesc, settings: &RenderSettings, plan: &Plan, aovs: &[Aov]) -> Result<Session, JobError> {
    // A wrong name is told before any work is done.
    method(desc, settings, plan)?;
    let scene = scene::compile(desc, settings, [plan.width, plan.height]).map_err(JobError::Scene)?;
    prepare_compiled(desc, settings, plan, aovs, Arc::new(scene))
}

/// A text of all settings that a compiled scene depends on. One that was compiled from the same description with the same text serves
/// another plan after [`Scene::look`] for the plan's size.
pub fn compile_key(settings: &RenderSettings) -> String {
    // Camera and size are `Scene::look`'s; the others are about samples.
    let kept = RenderSettings { width: None, height: None, camera: None, spp: None, seed: 0, filter: None, ..settings.clone() };
    kept.given()
}

/// Makes a session for a scene that has been compiled from the description with these settings and looks the way it is to be rendered.
///
/// # Errors
/// [`JobError`]
pub fn prepare_compiled(
    desc: &SceneDesc,
    settings: &RenderSettings,
    plan: &Plan,
    aovs: &[Aov],
    scene: Arc<Scene>,
) -> Result<Session, JobError> {
    let integrator = method(desc, settings, plan)?;
    let spp = plan.antialias.map_or(plan.spp, |a| a.further());
    let sampler = Sampler { kind: plan.sampler, seed: settings.seed, spp };
    let space = match &desc.classic {
        Some(classic) if plan.integrator == "whitted" => WorkingSpace::new(&classic.settings),
        _ => WorkingSpace::Linear,
    };
    let spec = FilmSpec { crop: plan.crop, filter: plan.filter, space, ..FilmSpec::new(plan.width, plan.height) };
    let meta = FilmMeta {
        seed: settings.seed,
        integrator: plan.integrator.clone(),
        renderer: format!("etendue {}", env!("CARGO_PKG_VERSION")),
        settings_hash: settings_hash(desc, settings, plan, scene.view.as_ref()),
        ..FilmMeta::default()
    };
    let mut session = Session::new(scene, integrator, sampler, spec, aovs.to_vec(), meta)?;
    if let Some(antialias) = plan.antialias {
        session.set_antialias(antialias);
    }
    if let Some(confidence) = plan.confidence {
        session.set_confidence(confidence);
    }
    if let Some(goal) = plan.error_goal {
        session.set_error_goal(goal);
    }
    Ok(session)
}

/// Compiles a scene for the photons of a map, as methods that use the map compile it.
///
/// # Errors
/// [`JobError`]
pub fn compile_for_photons(desc: &SceneDesc) -> Result<Scene, JobError> {
    // By the name of such a method, as POV-Ray's own model traces no such photons. The lights of a POV-Ray scene are as bright as they are
    // where its camera looks, so that the picture's size matters.
    let settings = RenderSettings { integrator: Some("particles".to_owned()), ..RenderSettings::default() };
    let plan = Plan::new(desc, &settings, None)?;
    let scene = scene::compile(desc, &settings, [plan.width, plan.height]).map_err(JobError::Scene)?;
    integrator::check_photons(&scene).map_err(JobError::Setting)?;
    Ok(scene)
}

/// The integrator of a plan, where it can render the scene.
///
/// # Errors
/// [`JobError::Setting`]
pub fn method(desc: &SceneDesc, settings: &RenderSettings, plan: &Plan) -> Result<Box<dyn Integrator>, JobError> {
    let integrator = integrator::create(settings, &desc.integrator).map_err(JobError::Setting)?;
    let leaves_out = if plan.antialias.is_some() { "antialias" } else { "adaptive" };
    if plan.is_uneven() && integrator.shares_camera_samples() {
        let message =
            format!("draws whole pictures, so that `{leaves_out}`, which leaves samples of single pixels out, does not go with it");
        return Err(JobError::Setting(format!("`{}` {message}: give `spp`", plan.integrator)));
    }
    if plan.is_uneven() && integrator.splats() {
        let message =
            format!("brings light to all pixels with every sample, so that `{leaves_out}`, which leaves samples out, does not go with it");
        return Err(JobError::Setting(format!("`{}` {message}: give `spp`", plan.integrator)));
    }
    Ok(integrator)
}

/// A text of all settings that samples depend on; films merge only where it is equal. Settings that are not named here as having no
/// influence count as having some.
fn settings_hash(desc: &SceneDesc, s: &RenderSettings, plan: &Plan, view: Option<&View>) -> String {
    let stratified = if plan.sampler == SamplerKind::Stratified { plan.spp } else { 0 };
    let method = RenderSettings {
        // In the film's spec, in its meta data, or in the plan.
        width: None,
        height: None,
        spp: None,
        seed: 0,
        filter: None,
        light_groups: false,
        antialias: None,
        antialias_depth: None,
        sampler: None,
        integrator: None,
        max_depth: s.max_depth.or(desc.integrator.max_depth),
        rr_depth: s.rr_depth.or(desc.integrator.rr_depth),
        ..s.clone()
    };
    let antialias = plan.antialias.map_or(String::new(), |a| format!(" antialias {}/{}", a.threshold, a.depth));
    let confidence = plan.confidence.map_or(String::new(), |c| format!(" blur {} {}", c.least, c.variance));
    let view = view.map_or(String::new(), |v| format!(" view {:?} {}", v.world_from_camera.to_cols_array(), v.zoom));
    format!("{} {:?}/{stratified}{antialias}{confidence}{view} {}", plan.integrator, plan.sampler, method.given())
}
