//! Methods of baking by name.

use etendue_scene::RenderSettings;

use super::{BakeError, SurfaceLight};
use crate::integrator::{Integrator, LookUp, Path, PhotonSettings, Stage};
use crate::photon::PhotonLight;
use crate::radiosity;
use crate::scene::Scene;

/// Names of the methods.
pub const NAMES: [&str; 3] = ["path", "radiosity", "particles"];

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
        if !gather {
            return Ok(Self::Solved(light));
        }
        let [max_depth, rr_depth] = rest(settings);
        Ok(Self::Path { indirect: Some(Box::new(LookUp { light, max_depth, rr_depth })) })
    }

    /// Samples of a point where the user does not say: methods that trace paths need more than those that look light up.
    pub fn default_spp(&self) -> u32 {
        match self {
            Self::Path { .. } => 256,
            Self::Solved(_) => 16,
        }
    }

    /// Path tracing.
    pub fn path(settings: &RenderSettings) -> Self {
        let [max_depth, rr_depth] = rest(settings);
        Self::Path { indirect: (max_depth > 0).then(|| -> Box<dyn Integrator> { Box::new(Path::new(max_depth, rr_depth)) }) }
    }
}

/// Most scatterings of paths, and after how many roulette ends them, without the point itself, which is the first scattering of each.
fn rest(settings: &RenderSettings) -> [u32; 2] {
    let max_depth = settings.max_depth.unwrap_or(u32::MAX);
    [if max_depth == u32::MAX { max_depth } else { max_depth.saturating_sub(1) }, settings.rr_depth.unwrap_or(4).min(1000)]
}
