//! Methods of baking by name.

use etendue_scene::RenderSettings;

use super::{BakeError, SurfaceLight};
use crate::integrator::{Integrator, Path, Stage};
use crate::scene::Scene;

/// Names of the methods.
pub const NAMES: [&str; 3] = ["path", "radiosity", "particles"];

/// How irradiance is found.
pub enum Method {
    /// Path tracing from the point; `None` for direct light alone.
    Path {
        /// Finds the light that surfaces scatter.
        indirect: Option<Box<dyn Integrator>>,
    },
    /// A solution that is looked up.
    Solved(Box<dyn SurfaceLight>),
}

impl Method {
    /// Solves the scene by the method of a name, as far as that is done before the first point.
    ///
    /// # Errors
    /// [`BakeError::Setting`] for a name that is unknown, or of a method that cannot bake yet.
    pub fn new(name: &str, _scene: &Scene, settings: &RenderSettings, _stage: &Stage) -> Result<Self, BakeError> {
        match name {
            "path" => Ok(Self::path(settings)),
            "radiosity" | "particles" => {
                Err(BakeError::Setting(format!("the method `{name}` cannot bake yet; `path` can, and finds the same light")))
            }
            _ => Err(BakeError::Setting(format!("no method `{name}`; there are {}", NAMES.join(", ")))),
        }
    }

    /// Path tracing. The point itself is the first scattering of a path, so the integrator has one less.
    pub fn path(settings: &RenderSettings) -> Self {
        let max_depth = settings.max_depth.unwrap_or(u32::MAX);
        let rr_depth = settings.rr_depth.unwrap_or(4).min(1000);
        let indirect = (max_depth > 1).then(|| -> Box<dyn Integrator> {
            let rest = if max_depth == u32::MAX { max_depth } else { max_depth - 1 };
            Box::new(Path { max_depth: rest, rr_depth, equiangular: true })
        });
        Self::Path { indirect }
    }
}
