//! Bidirectional path tracing (Lafortune and Willems 1993; Veach and Guibas 1994; Veach 1997, chapter 10).
//!
//! Each sample walks from the camera and from a light and connects every vertex of one walk with every vertex of the other, with
//! the lights and with the camera. All techniques that make the same path are weighed against each other, so that each lights what it is
//! good at: caustics come from the lights' walks, reflections of them from the camera's.
//!
//! Unbiased. What no connection can make stays as noisy as with `path`, or is not found: caustics seen in a mirror or through
//! glass, of point lights not at all. `vcm` does those.

use super::bidirectional::walk::Walk;
use super::bidirectional::{Bidirectional, CAMERA_DIMENSIONS, DIRECT_DIMENSIONS, LIGHT_DIMENSIONS};
use super::path::first_hit;
use super::{Estimate, Integrator, Splat, Stage};
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

    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        self.shared.prepare(scene, stage, "bdpt")
    }

    fn splats(&self) -> bool {
        true
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let shared = &self.shared;
        let mut light_walk = Walk::default();
        let mut joints = Vec::new();
        let start = shared.walk_light(scene, &mut stream.at(LIGHT_DIMENSIONS), &mut light_walk);
        if let Some(start) = &start {
            let mut numbers = stream.at(CAMERA_DIMENSIONS);
            for y in &light_walk.vertices {
                if let Some((picture, c)) = shared.to_camera(scene, (&light_walk, start, y), &mut numbers, &mut joints) {
                    out.splats.push(Splat { picture, radiance: c.value, group: c.group });
                }
            }
        }
        let mut walk = Walk::default();
        let escape = shared.walk_camera(scene, camera_ray, stream, &mut walk);
        let mut numbers = stream.at(DIRECT_DIMENSIONS);
        for z in &walk.vertices {
            if z.depth == 1 {
                let distance = (z.surface.p - camera_ray.ray.o).length();
                first_hit(scene, &z.surface, z.wo, &z.scatter, distance, out);
            }
            if let Some(c) = shared.hit(scene, &walk, z, &mut joints) {
                out.add(c.value, c.group);
            }
            if let Some(c) = shared.direct(scene, &walk, z, &mut numbers, &mut joints) {
                out.add(c.value, c.group);
            }
            let Some(start) = start.as_ref().filter(|_| z.scatter.is_smooth_anywhere()) else { continue };
            for y in light_walk.vertices.iter().filter(|y| y.scatter.is_smooth_anywhere()) {
                if let Some(c) = shared.connect(scene, (&light_walk, start, y), (&walk, z), &mut joints) {
                    out.add(c.value, c.group);
                }
            }
        }
        if let Some(escape) = escape {
            shared.escape(scene, &walk, &escape, &mut joints, |c| out.add(c.value, c.group));
        }
    }
}
