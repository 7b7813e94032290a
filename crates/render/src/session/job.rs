//! From a description and settings to a session: the one way in for the command line, Python and the farm.

use std::sync::Arc;

use etendue_scene::desc::{FilmDesc, FilterDesc};
use etendue_scene::{Fault, RenderSettings, SceneDesc};

use super::{Antialias, Aov, Session};
use crate::classic::WorkingSpace;
use crate::film::{FilmError, FilmMeta, FilmSpec, Filter, Rect};
use crate::integrator;
use crate::sampler::{Sampler, SamplerKind};
use crate::scene;

/// Samples per pixel where neither the user nor the file says.
pub const DEFAULT_SPP: u32 = 64;
/// The same for scenes of the classic model whose camera blurs: there every pixel needs several.
pub const CLASSIC_SPP: u32 = 9;
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
    /// Samples per pixel; with antialiasing the most of them.
    pub spp: u32,
    /// Fewer samples where the picture is flat.
    pub antialias: Option<Antialias>,
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
            None if desc.classic.is_some() => Filter::BOX,
            None => film.filter.map_or(Filter::GAUSSIAN, filter),
        };
        let sampler = match (&settings.sampler, film.sampler.as_str()) {
            (Some(name), _) => SamplerKind::from_name(name)
                .ok_or_else(|| JobError::Setting(format!("no sampler `{name}`; there are sobol, independent, stratified, halton")))?,
            // The file's choice is about its own renderer; ours is at least as good.
            (None, _) if desc.classic.is_some() => SamplerKind::Stratified,
            (None, _) => SamplerKind::Sobol,
        };
        if let Some(name) = settings.light_sampler.as_deref().filter(|n| !LIGHT_SAMPLERS.contains(n)) {
            return Err(JobError::Setting(format!("no light sampler `{name}`; there are {}", LIGHT_SAMPLERS.join(", "))));
        }
        let antialias = antialias(desc, settings)?;
        let spp = match (antialias, &desc.classic) {
            (Some(antialias), _) => antialias.spp(),
            (None, Some(classic)) => settings.spp.or(film.spp).unwrap_or(if classic.camera.blur.is_on() { CLASSIC_SPP } else { 1 }),
            (None, None) => settings.spp.or(film.spp).unwrap_or(DEFAULT_SPP),
        };
        if spp == 0 {
            return Err(JobError::Setting("a picture needs at least one sample per pixel".into()));
        }
        let integrator = settings
            .integrator
            .clone()
            .unwrap_or_else(|| if desc.integrator.name.is_empty() { "path".to_owned() } else { desc.integrator.name.clone() });
        Ok(Self { width, height, crop, spp, antialias, filter, sampler, integrator })
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
    let default = if desc.classic.is_some() && settings.spp.is_none() { CLASSIC_ANTIALIAS } else { 0.0 };
    // A blurred pixel needs its samples even where the picture is flat.
    let blurs = desc.classic.as_ref().is_some_and(|c| c.camera.blur.is_on());
    let threshold = match settings.antialias {
        _ if blurs => 0.0,
        // One sample goes through the center, as in POV-Ray.
        Some(t) if !(t > 0.0) && desc.classic.is_some() && settings.spp.is_none() => f32::INFINITY,
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
    if desc.classic.is_some() && plan.integrator != "whitted" {
        return Err(JobError::Setting(format!("`{}` cannot render POV-Ray scenes yet; `whitted` can", plan.integrator)));
    }
    let integrator = integrator::create(settings, &desc.integrator).map_err(JobError::Setting)?;
    let scene = Arc::new(scene::compile(desc, settings, [plan.width, plan.height]).map_err(JobError::Scene)?);
    let spp = plan.antialias.map_or(plan.spp, |a| a.depth * a.depth);
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
        settings_hash: settings_hash(desc, settings, plan),
        ..FilmMeta::default()
    };
    let mut session = Session::new(scene, integrator, sampler, spec, aovs.to_vec(), meta)?;
    if let Some(antialias) = plan.antialias {
        session.set_antialias(antialias);
    }
    Ok(session)
}

/// A short text of all settings that samples depend on; films merge only where it is equal.
fn settings_hash(desc: &SceneDesc, s: &RenderSettings, plan: &Plan) -> String {
    let depth = s.max_depth.or(desc.integrator.max_depth);
    let rr = s.rr_depth.or(desc.integrator.rr_depth);
    let stratified = if plan.sampler == SamplerKind::Stratified { plan.spp } else { 0 };
    let antialias = plan.antialias.map_or(String::new(), |a| format!(" antialias {}/{}", a.threshold, a.depth));
    format!(
        "{} {:?}/{stratified} depth {depth:?} rr {rr:?} lights {:?} ao {:?} camera {:?}{antialias}",
        plan.integrator, plan.sampler, s.light_sampler, s.ao_distance, s.camera
    )
}
