//! Light tracing (Arvo 1986; Dutré, Lafortune, Willems 1993): paths start at the lights, and each point that they meet is connected to
//! the camera.
//!
//! Caustics on rough surfaces come out at once. What the camera sees in mirrors and through glass stays black, as the last
//! scattering before the camera must not be a delta lobe; lights and media that emit are themselves seen by rays from the camera. `bdpt`
//! and `vcm` weigh this method with others.

use super::bidirectional::mis::Techniques;
use super::bidirectional::walk::Walk;
use super::bidirectional::{Bidirectional, CAMERA_DIMENSIONS, LIGHT_DIMENSIONS};
use super::emission::EmissionSampler;
use super::{Estimate, Integrator, Splat, Stage};
use crate::camera::CameraRay;
use crate::sampler::SampleStream;
use crate::scene::Scene;

/// The light tracer.
pub struct LightTracer {
    shared: Bidirectional,
    /// The same for the rays from the camera, which look at the first surface only.
    direct_sight: Bidirectional,
}

impl LightTracer {
    /// Paths of at most `max_depth` scattering events; Russian roulette may end a path after `rr_depth`.
    pub fn new(max_depth: u32, rr_depth: u32) -> Self {
        Self { shared: Bidirectional::new(max_depth, rr_depth), direct_sight: Bidirectional::new(0, rr_depth) }
    }
}

impl Integrator for LightTracer {
    fn set_margin(&mut self, pixels: f32) {
        self.shared.margin = pixels;
    }

    fn prepare(&mut self, scene: &Scene, _stage: &Stage) -> Result<(), String> {
        scene.camera.check_connections()?;
        // Every path is made in one way only, so that it has no weight.
        self.shared.techniques = Techniques::ONLY_TO_CAMERA;
        self.shared.emission = Some(EmissionSampler::with_media(scene).map_err(|e| format!("`light`: {e}"))?);
        Ok(())
    }

    fn splats(&self) -> bool {
        true
    }

    fn notes(&self) -> Vec<String> {
        vec!["light: what is seen in mirrors and through glass stays black; bdpt and vcm show it".into()]
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let mut walk = Walk::default();
        let mut joints = Vec::new();
        if let Some(start) = self.shared.walk_light(scene, self.shared.max_depth, &mut stream.at(LIGHT_DIMENSIONS), &mut walk) {
            let mut numbers = stream.at(CAMERA_DIMENSIONS);
            for y in &walk.vertices {
                if let Some((picture, c)) = self.shared.to_camera(scene, (&walk, &start, y), &mut numbers, &mut joints) {
                    out.splats.push(Splat { picture, radiance: c.value, group: c.group });
                }
            }
        }
        let escape = self.direct_sight.walk_camera(scene, camera_ray, 1, stream, &mut walk);
        // What media on the straight way send to the camera; all that is scattered comes by the walk from the light.
        for &(_, emitted) in &walk.emitted {
            out.add(emitted, 0);
        }
        self.direct_sight.direct_sight(scene, camera_ray, &walk, escape.as_ref(), &mut joints, out);
    }
}
