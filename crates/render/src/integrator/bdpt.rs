//! Bidirectional path tracing (Lafortune and Willems 1993; Veach and Guibas 1994; Veach 1997, chapter 10).
//!
//! Each sample walks from the camera and from a light and connects every vertex of one walk with every vertex of the other, with
//! the lights and with the camera. All techniques that make the same path are weighed against each other, so that each lights what it is
//! good at: caustics come from the lights' walks, reflections of them from the camera's.
//!
//! Unbiased. What no connection can make stays as noisy as with `path`, or is not found: caustics seen in a mirror or through
//! glass, of point lights not at all. `vcm` does those.

use super::bidirectional::Bidirectional;
use super::{Estimate, Integrator, Stage};
use crate::camera::CameraRay;
use crate::sampler::SampleStream;
use crate::scene::Scene;

/// The bidirectional path tracer.
pub struct Bdpt {
    shared: Bidirectional,
}

impl Bdpt {
    /// Paths of at most `max_depth` scattering events; Russian roulette may end a walk after `rr_depth` of its own.
    pub fn new(max_depth: u32, rr_depth: u32) -> Self {
        Self { shared: Bidirectional::new(max_depth, rr_depth) }
    }
}

impl Integrator for Bdpt {
    fn set_margin(&mut self, pixels: f32) {
        self.shared.margin = pixels;
    }

    fn prepare(&mut self, scene: &Scene, _stage: &Stage) -> Result<(), String> {
        self.shared.prepare(scene)?;
        Ok(())
    }

    fn splats(&self) -> bool {
        true
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        self.shared.estimate(scene, camera_ray, None, stream, out);
    }
}
