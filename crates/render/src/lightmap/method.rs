//! Methods of baking by name.

use etendue_scene::RenderSettings;

use super::{BakeError, SurfaceLight};
use crate::accel::Ray;
use crate::camera::CameraRay;
use crate::integrator::{Estimate, Integrator, Path, PhotonSettings, Stage};
use crate::math::{Frame, INV_PI};
use crate::photon::PhotonLight;
use crate::radiosity;
use crate::sampler::SampleStream;
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Names of the methods.
pub const NAMES: [&str; 3] = ["path", "radiosity", "particles"];
/// Surfaces without substance that a look-up crosses.
const MAX_CROSSINGS: u32 = 64;

/// How irradiance is found.
pub enum Method {
    /// Sampling of lights and directions from the point; along a direction an integrator finds what surfaces scatter. `None` for direct
    /// light alone.
    Path {
        /// Finds the light that surfaces scatter.
        indirect: Option<Box<dyn Integrator>>,
    },
    /// A solution that is looked up.
    Solved(Box<dyn SurfaceLight>),
}

impl Method {
    /// Solves the scene by the method of a name, as far as that is done before the first point. With `gather`, solutions are not looked
    /// up at the point but where rays from it arrive (final gathering): what is coarse in them does not show. `notes` gets sentences.
    ///
    /// # Errors
    /// [`BakeError::Setting`] for a name that is unknown, and for settings that a method does not take.
    pub fn new(
        name: &str,
        gather: bool,
        scene: &Scene,
        settings: &RenderSettings,
        stage: &Stage,
        notes: &mut Vec<String>,
    ) -> Result<Self, BakeError> {
        let light: Box<dyn SurfaceLight> = match name {
            "path" => return Ok(Self::path(settings)),
            "radiosity" => {
                let own = radiosity::Settings::new(settings).map_err(BakeError::Setting)?;
                let progress = radiosity::Progress::new(stage);
                let mut solution = radiosity::solve(scene, &own, radiosity::Display::Smooth, &progress).map_err(BakeError::Setting)?;
                notes.append(&mut solution.notes);
                Box::new(solution)
            }
            "particles" => {
                let rr_depth = settings.rr_depth.unwrap_or(4).min(1000);
                let own = PhotonSettings::new(settings, settings.max_depth, rr_depth).map_err(BakeError::Setting)?;
                let map = own.map(scene, stage, notes).map_err(BakeError::Setting)?;
                let light = PhotonLight::new(map, own.count(), own.reach(scene).near);
                if gather { Box::new(light.coarse(scene)) } else { Box::new(light) }
            }
            _ => return Err(BakeError::Setting(format!("no method `{name}`; there are {}", NAMES.join(", ")))),
        };
        Ok(if gather { Self::Path { indirect: Some(Box::new(LookUp { light })) } } else { Self::Solved(light) })
    }

    /// Samples of a point where the user does not say: methods that trace paths need more than those that look light up.
    pub fn default_spp(&self) -> u32 {
        match self {
            Self::Path { .. } => 256,
            Self::Solved(_) => 16,
        }
    }

    /// Path tracing. The point itself is the first scattering of a path, so the integrator has one less.
    pub fn path(settings: &RenderSettings) -> Self {
        let max_depth = settings.max_depth.unwrap_or(u32::MAX);
        let rr_depth = settings.rr_depth.unwrap_or(4).min(1000);
        let indirect = (max_depth > 1).then(|| -> Box<dyn Integrator> {
            let rest = if max_depth == u32::MAX { max_depth } else { max_depth - 1 };
            Box::new(Path::new(rest, rr_depth))
        });
        Self::Path { indirect }
    }
}

/// The light that surfaces scatter as if they were diffuse, from a solution.
struct LookUp {
    light: Box<dyn SurfaceLight>,
}

impl Integrator for LookUp {
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, _stream: &mut SampleStream, out: &mut Estimate) {
        let mut ray = camera_ray.ray;
        let mut through = Spectrum::ONE;
        for _ in 0..MAX_CROSSINGS {
            let Some(mut s) = scene.intersect(&ray) else { return };
            let wo = -ray.d;
            let material = &scene.materials[s.material as usize];
            let scatter = material.shade(scene, &s, wo);
            // Solutions are asked for the side that is seen.
            if s.ng.dot(wo) < 0.0 {
                s.ng = -s.ng;
                s.frame = Frame::from_normal(-s.frame.n);
            }
            let straight = if material.has_null { scatter.null_transmittance(wo) } else { Spectrum::ZERO };
            let albedo = scatter.albedo(wo);
            out.add(through * albedo * self.light.irradiance(scene, &s) * INV_PI, 0);
            through *= straight;
            if through.is_black() {
                return;
            }
            ray = Ray::new(s.offset_origin(ray.d), ray.d);
        }
    }
}
