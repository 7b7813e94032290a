//! What `light`, `bdpt`, `vcm` and `mlt` share: walks from the camera and from the lights, and the ways to make whole paths of them.
//!
//! A walk ([`walk`]) leaves a row of vertices. [`connect`] joins two walks by every technique that there is and weighs them
//! ([`mis`]). The measure of a path is always that of the path tracer, evaluated from the camera's side, so that all methods have the same
//! mean: shading normals and materials that depend on the side of view give the light's walk the factors that make up for it.

pub(super) mod connect;
pub mod mis;
pub(super) mod walk;

use super::Stage;
use super::emission::EmissionSampler;
use crate::math::Vec2;
use crate::sampler::SampleStream;
use crate::scene::Scene;
use mis::Techniques;

/// Where random numbers come from.
pub(super) trait Numbers {
    /// The next one in [0, 1).
    fn next_1d(&mut self) -> f32;
    /// The next pair.
    fn next_2d(&mut self) -> Vec2;
}

impl Numbers for SampleStream {
    #[inline]
    fn next_1d(&mut self) -> f32 {
        Self::next_1d(self)
    }

    #[inline]
    fn next_2d(&mut self) -> Vec2 {
        Self::next_2d(self)
    }
}

/// First dimensions of a sample's numbers that belong to the walk from the light, to connections to lights and to those to the camera.
pub(super) const LIGHT_DIMENSIONS: u32 = 1 << 16;
/// See [`LIGHT_DIMENSIONS`].
pub(super) const DIRECT_DIMENSIONS: u32 = 2 << 16;
/// See [`LIGHT_DIMENSIONS`].
pub(super) const CAMERA_DIMENSIONS: u32 = 3 << 16;

/// What bidirectional methods need beside the scene.
#[derive(Clone, Debug)]
pub(super) struct Bidirectional {
    /// Longest path in scattering events.
    pub max_depth: u32,
    /// Scattering events of a walk after which Russian roulette may end it.
    pub rr_depth: u32,
    /// How far outside of the picture the reconstruction filter reaches, in pixels.
    pub margin: f32,
    /// Which ways to make a path are weighed against each other.
    pub techniques: Techniques,
    /// Chooses lights and rays that leave them.
    pub emission: Option<EmissionSampler>,
}

impl Bidirectional {
    /// With all connections and without merging.
    pub fn new(max_depth: u32, rr_depth: u32) -> Self {
        Self { max_depth, rr_depth, margin: 0.0, techniques: Techniques::CONNECTIONS, emission: None }
    }

    /// Prepares the choice of lights.
    ///
    /// # Errors
    /// A sentence where the scene has what these methods cannot do.
    pub fn prepare(&mut self, scene: &Scene, _stage: &Stage, name: &str) -> Result<(), String> {
        if scene.classic.is_some() {
            return Err(format!("`{name}` cannot render POV-Ray scenes yet; `whitted` can"));
        }
        self.emission = Some(EmissionSampler::new(scene));
        Ok(())
    }
}
