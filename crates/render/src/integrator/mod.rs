//! Integrators: estimates of the radiance that arrives along a camera ray.
//!
//! An integrator computes; it knows nothing of time, threads, files or progress. One sample in, one [`Estimate`] out.

mod ao;
mod light_sampling;
mod normals;
mod path;
mod whitted;

pub use ao::AmbientOcclusion;
pub use normals::Normals;
pub use path::Path;
pub use whitted::Whitted;

use etendue_scene::RenderSettings;
use etendue_scene::desc::IntegratorDesc;

use crate::camera::CameraRay;
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
    /// Asks for the texture coordinates of what the camera sees first; integrators to which they come free ignore it.
    pub wants_uv: bool,
}

impl Estimate {
    /// Empties the estimate for the next sample.
    pub fn reset(&mut self, groups: usize) {
        self.radiance = Spectrum::ZERO;
        self.alpha = 0.0;
        self.first = None;
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

/// A way to compute light.
pub trait Integrator: Send + Sync {
    /// Estimates the radiance along a camera ray into `out`, which is empty before.
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate);
}

/// Names that [`create`] knows.
pub const NAMES: [&str; 5] = ["path", "direct", "whitted", "ao", "normals"];

/// The integrator that the settings name, else the file's, else `path`.
///
/// # Errors
/// A sentence where there is no integrator of that name.
pub fn create(settings: &RenderSettings, desc: &IntegratorDesc) -> Result<Box<dyn Integrator>, String> {
    let name = settings.integrator.as_deref().unwrap_or(if desc.name.is_empty() { "path" } else { &desc.name });
    // A depth that the file gives to its own integrator means nothing to another.
    let same = settings.integrator.is_none() || settings.integrator.as_deref() == Some(&desc.name) || desc.name.is_empty();
    let max_depth = settings.max_depth.or(if same { desc.max_depth } else { None });
    // Later roulette than this would let paths between perfect reflectors go on for ever.
    let rr_depth = settings.rr_depth.or(desc.rr_depth).unwrap_or(4).min(1000);
    Ok(match name {
        "path" => Box::new(Path { max_depth: max_depth.unwrap_or(u32::MAX), rr_depth }),
        "direct" => Box::new(Path { max_depth: max_depth.unwrap_or(1).min(1), rr_depth }),
        "whitted" => Box::new(Whitted { max_depth }),
        "ao" => Box::new(AmbientOcclusion { distance: settings.ao_distance.unwrap_or(f32::INFINITY) }),
        "normals" => Box::new(Normals),
        _ => return Err(format!("no integrator `{name}`; there are {}", NAMES.join(", "))),
    })
}
