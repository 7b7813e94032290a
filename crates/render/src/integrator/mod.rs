//! Integrators: estimates of the radiance that arrives along a camera ray.
//!
//! An integrator computes; it knows nothing of time, threads or files. One sample in, one [`Estimate`] out.
//!
//! Methods with stages of their own (radiosity, photon maps, shadow maps) do them in [`Integrator::prepare`], once, or in
//! [`Integrator::begin_pass`], for a range of sample indices. Both are functions of the scene, the settings and the seed (and the
//! range) alone: never of threads, time or what other passes found. So parts of a picture may be made anywhere and merged.

mod allotment;
mod ao;
mod auto;
mod bdpt;
pub mod bidirectional;
mod caustic_map;
mod caustics;
pub mod emission;
mod guiding;
mod illuminance;
pub mod irradiance;
mod light;
pub(crate) mod light_sampling;
mod look_up;
mod manifold;
mod mlt;
mod mnee;
mod normals;
mod particles;
mod path;
mod pathmap;
mod photon;
mod photon_beams;
mod photon_settings;
mod photon_walk;
mod radiosity;
mod raster;
mod resampling;
mod splitting;
mod sppm;
mod vcm;
mod volume;
pub mod volume_emission;
mod whitted;

pub use ao::AmbientOcclusion;
pub use auto::Auto;
pub use bdpt::Bdpt;
pub use guiding::Guiding;
pub use illuminance::Illuminance;
pub use light::LightTracer;
pub use look_up::LookUp;
pub use mlt::Mlt;
pub use mnee::Mnee;
pub use normals::Normals;
pub use particles::Particles;
pub use path::Path;
pub use pathmap::PathMap;
pub use photon::PhotonMapping;
pub use photon_settings::{DEFAULT_PHOTONS, PhotonSettings, check as check_photons, describe as describe_photons, limits as photon_limits};
pub use radiosity::Radiosity;
pub use raster::Raster;
pub use sppm::Sppm;
pub use vcm::Vcm;
pub use whitted::Whitted;

use std::ops::Range;

use etendue_scene::RenderSettings;
use etendue_scene::desc::IntegratorDesc;

use crate::camera::CameraRay;
use crate::light::LightContext;
use crate::math::{Vec2, Vec3};
use crate::sampler::SampleStream;
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// What the camera sees first, for AOVs.
#[derive(Clone, Copy, Debug)]
pub struct FirstHit {
    /// Position in world space.
    pub p: Vec3,
    /// Shading normal on the camera's side, unit.
    pub ns: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Distance from the ray's origin.
    pub depth: f32,
    /// Share of light that the surface scatters.
    pub albedo: Spectrum,
    /// Number of the object, from 1.
    pub object: u32,
    /// Number of the material, from 1.
    pub material: u32,
}

/// Light that a sample brings to another pixel than its own: a path from a light that meets the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Point of the picture, in pixels from the upper left corner.
    pub picture: Vec2,
    /// Contribution to the pixel's mean radiance if each pixel had one sample: all splats of a picture are summed and divided by the
    /// samples per pixel. So an integrator that sends one path for each camera sample divides by the number of the picture's pixels.
    pub radiance: Spectrum,
    /// Light group.
    pub group: u32,
}

/// The last real scattering of a path, which the weights of the light found next refer to.
#[derive(Clone)]
struct Vertex {
    ctx: LightContext,
    /// Density of the direction; infinite for the camera and for delta lobes.
    pdf: f32,
    /// Where on a segment of a homogeneous medium it was, if direct light is sampled along it.
    on_segment: Option<volume::OnSegment>,
}

/// One sample of a pixel.
#[derive(Clone, Debug, Default)]
pub struct Estimate {
    /// Radiance, all lights together.
    pub radiance: Spectrum,
    /// 0 where the ray left the scene, 1 where it met something.
    pub alpha: f32,
    /// Radiance by light group; as long as [`Scene::group_names`].
    pub groups: Vec<Spectrum>,
    /// What the camera sees first.
    pub first: Option<FirstHit>,
    /// Light for other pixels; only of integrators that announce it by [`Integrator::splats`].
    pub splats: Vec<Splat>,
    /// Asks for the texture coordinates of what the camera sees first; integrators to which they come free ignore it.
    pub wants_uv: bool,
    /// What the camera sees first is not asked for; integrators to which it comes free ignore that.
    pub forgoes_first: bool,
    /// Asks for the radiance in the numbers of a classic scene's working space; others know linear light only and ignore it.
    pub wants_own: bool,
    /// The radiance (but not that of groups) is in such numbers.
    pub is_own: bool,
}

impl Estimate {
    /// Empties the estimate for the next sample.
    pub fn reset(&mut self, groups: usize) {
        self.radiance = Spectrum::ZERO;
        self.is_own = false;
        self.alpha = 0.0;
        self.first = None;
        self.splats.clear();
        self.groups.clear();
        self.groups.resize(groups, Spectrum::ZERO);
    }

    /// Adds radiance that a light of a group has sent.
    #[inline]
    pub fn add(&mut self, radiance: Spectrum, group: u32) {
        self.radiance += radiance;
        if let Some(sum) = self.groups.get_mut(group as usize) {
            *sum += radiance;
        }
    }
}

/// Where a sample is in its pixel and on the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraSample {
    /// From the pixel's center, in pixels.
    pub offset: Vec2,
    /// What the pixel's radiance counts.
    pub weight: f32,
    /// On the lens, in [0, 1)².
    pub u_lens: Vec2,
}

/// What an integrator's own stages may know: the picture, the seed, and whom to tell how far they are.
pub struct Stage<'a> {
    /// Columns and rows of the full picture.
    pub size: [u32; 2],
    /// The seed of the random numbers.
    pub seed: u64,
    /// The camera sample of an index, where an integrator has all pixels share it.
    pub camera_sample: &'a (dyn Fn(u32) -> CameraSample + Sync),
    /// Whether someone has asked to stop; stages return early then, with whatever result.
    pub is_cancelled: &'a (dyn Fn() -> bool + Sync),
    /// Takes what is being done (a few words) and the share that is done, in [0, 1]; from any thread.
    pub progress: &'a (dyn Fn(&str, f64) + Sync),
}

impl<'a> Stage<'a> {
    /// A stage of a method that is asked for light without a picture, as baking does; its camera sample is the pixel's center.
    pub fn without_camera(seed: u64, is_cancelled: &'a (dyn Fn() -> bool + Sync), progress: &'a (dyn Fn(&str, f64) + Sync)) -> Self {
        fn center(_: u32) -> CameraSample {
            CameraSample { offset: Vec2::ZERO, weight: 1.0, u_lens: Vec2::splat(0.5) }
        }
        Self { size: [64, 64], seed, camera_sample: &center, is_cancelled, progress }
    }
}

/// A way to compute light.
pub trait Integrator: Send + Sync {
    /// Does what has to be done once, before the first sample.
    ///
    /// # Errors
    /// A sentence where the scene or the settings do not allow this method.
    fn prepare(&mut self, _scene: &Scene, _stage: &Stage) -> Result<(), String> {
        Ok(())
    }

    /// The longest range of sample indices of a pass; 1 for methods that start each round with new particles.
    fn pass_limit(&self) -> u32 {
        16
    }

    /// Does what the samples `first..end` need, before any of them.
    ///
    /// # Errors
    /// A sentence.
    fn begin_pass(&mut self, _scene: &Scene, _first: u32, _end: u32, _stage: &Stage) -> Result<(), String> {
        Ok(())
    }

    /// Whether all pixels take the samples of an index at the same place in the pixel and on the lens ([`Stage::camera_sample`]), for
    /// methods that draw whole pictures.
    fn shares_camera_samples(&self) -> bool {
        false
    }

    /// Whether [`Self::estimate`] looks at the camera's ray: methods that make their own of the point of the picture do not need it.
    fn uses_camera_rays(&self, _scene: &Scene) -> bool {
        true
    }

    /// The samples of a pixel that the samples `begin..end` of the picture stand for, after [`Self::prepare`]: as many in the mean, more where
    /// there is more to find. Ranges that follow each other stand for ranges that follow each other, and the first one for at least one sample.
    fn samples_of(&self, _pixel: [u32; 2], begin: u32, end: u32) -> Range<u32> {
        begin..end
    }

    /// Whether estimates hold light for other pixels.
    fn splats(&self) -> bool {
        false
    }

    /// Tells how far outside of the picture, in pixels, its filter reaches: so far splats are wanted. Before [`Self::prepare`].
    fn set_margin(&mut self, _pixels: f32) {}

    /// Sentences for the user about what was done: what was chosen and why, energy balance, known bias. After [`Self::prepare`].
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Estimates the radiance along a camera ray into `out`, which is empty before.
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate);
}

/// Names that [`create`] knows.
pub const NAMES: &[&str] = &[
    "auto",
    "path",
    "bdpt",
    "vcm",
    "mlt",
    "mnee",
    "pathmap",
    "light",
    "sppm",
    "photon",
    "particles",
    "radiosity",
    "raster",
    "direct",
    "whitted",
    "illuminance",
    "ao",
    "normals",
];

/// The integrator where neither the user nor the file names one.
pub const DEFAULT: &str = "auto";

/// Whether the method that the settings or the file name wants lights hidden from the camera, whatever the file says of that.
pub fn hides_lights(settings: &RenderSettings, desc: &IntegratorDesc) -> bool {
    settings.integrator.as_deref().unwrap_or(&desc.name) == "illuminance"
}

/// The integrator that the settings name, else the file's, else [`DEFAULT`].
///
/// # Errors
/// A sentence where there is no integrator of that name.
pub fn create(settings: &RenderSettings, desc: &IntegratorDesc) -> Result<Box<dyn Integrator>, String> {
    let name = settings.integrator.as_deref().unwrap_or(if desc.name.is_empty() { DEFAULT } else { &desc.name });
    // A depth that the file gives to its own integrator means nothing to another.
    let same = settings.integrator.is_none() || settings.integrator.as_deref() == Some(&desc.name) || desc.name.is_empty();
    let max_depth = settings.max_depth.or(if same { desc.max_depth } else { None });
    // Later roulette than this would let paths between perfect reflectors go on for ever.
    let rr_depth = settings.rr_depth.or(desc.rr_depth).unwrap_or(4).min(1000);
    let photons = || PhotonSettings::new(settings, max_depth, rr_depth);
    let mut path = Path::new(max_depth.unwrap_or(u32::MAX), rr_depth);
    path.max_splits = settings.max_splits.unwrap_or(16);
    path.allots = settings.adaptive.is_none();
    path.guiding = settings.guiding.as_deref().map_or(Ok(Guiding::Auto), Guiding::from_name)?;
    Ok(match name {
        "auto" => Box::new(Auto::new(path, photons()?)),
        "path" => Box::new(path),
        "light" => Box::new(LightTracer::new(max_depth.unwrap_or(u32::MAX), rr_depth)),
        "bdpt" => Box::new(Bdpt::new(max_depth.unwrap_or(u32::MAX), rr_depth)),
        "vcm" => Box::new(Vcm::new(max_depth.unwrap_or(u32::MAX), rr_depth, settings.photon_radius)),
        "mnee" => Box::new(Mnee::new(path)),
        "pathmap" => Box::new(PathMap::new(path, photons()?)),
        "mlt" => Box::new(Mlt::new(max_depth.unwrap_or(u32::MAX))),
        "direct" => Box::new(Path::new(max_depth.unwrap_or(1).min(1), rr_depth)),
        "particles" => Box::new(Particles::new(photons()?)),
        "photon" => Box::new(PhotonMapping::new(photons()?)),
        "sppm" => Box::new(Sppm::new(photons()?)),
        "whitted" => Box::new(Whitted { max_depth, has_scattering: false }),
        "raster" => Box::new(Raster::new(raster::options(settings)?)),
        "radiosity" => Box::new(Radiosity::new(settings)?),
        "illuminance" => {
            let path = RenderSettings { integrator: Some("path".into()), ..settings.clone() };
            Box::new(Illuminance::new(create(&path, desc)?))
        }
        "ao" => Box::new(AmbientOcclusion { distance: settings.ao_distance.unwrap_or(f32::INFINITY) }),
        "normals" => Box::new(Normals),
        _ => return Err(format!("no integrator `{name}`; there are {}", NAMES.join(", "))),
    })
}
