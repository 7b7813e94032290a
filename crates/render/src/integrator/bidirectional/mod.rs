//! What `light`, `bdpt`, `vcm` and `mlt` share: walks from the camera and from the lights, and the ways to make whole paths of them.
//!
//! A walk ([`walk`]) leaves a row of vertices. [`connect`] joins two walks by every technique that there is and weighs them
//! ([`mis`]). The measure of a path is always that of the path tracer, evaluated from the camera's side, so that all methods have the same
//! mean: shading normals and materials that depend on the side of view give the light's walk the factors that make up for it.

pub(super) mod connect;
pub mod mis;
pub(super) mod stored;
pub(super) mod walk;

use super::emission::EmissionSampler;
use super::path::first_hit;
use super::{Estimate, Splat};
use crate::camera::CameraRay;
use crate::math::Vec2;
use crate::sampler::{HashRng, SampleStream};
use crate::scene::Scene;
use mis::{Joint, Techniques};
use stored::StoredWalks;
use walk::{Escape, Place, Walk};

/// Where random numbers come from.
pub(super) trait Numbers {
    /// The next one in [0, 1).
    fn next_1d(&mut self) -> f32;
    /// The next pair.
    fn next_2d(&mut self) -> Vec2;
    /// Numbers without an end, for media.
    fn rng(&mut self) -> HashRng;
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

    #[inline]
    fn rng(&mut self) -> HashRng {
        Self::rng(self)
    }
}

/// First dimensions of a sample's numbers that belong to the walk from the light, to connections to lights and to those to the camera.
pub(super) const LIGHT_DIMENSIONS: u32 = 1 << 16;
/// See [`LIGHT_DIMENSIONS`].
pub(super) const DIRECT_DIMENSIONS: u32 = 2 << 16;
/// See [`LIGHT_DIMENSIONS`].
pub(super) const CAMERA_DIMENSIONS: u32 = 3 << 16;
/// See [`LIGHT_DIMENSIONS`]; what connections in media need.
const CONNECTION_DIMENSIONS: u32 = 4 << 16;

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
    /// Where paths cannot be joined to the camera.
    pub fn prepare(&mut self, scene: &Scene) -> Result<(), String> {
        scene.camera.check_connections()?;
        self.emission = Some(EmissionSampler::new(scene));
        Ok(())
    }

    /// One sample by all connections, and by merging with kept walks where there are some.
    pub fn estimate(
        &self,
        scene: &Scene,
        camera_ray: &CameraRay,
        stored: Option<&StoredWalks>,
        stream: &mut SampleStream,
        out: &mut Estimate,
    ) {
        let mut joints = Vec::new();
        let mut light_walk = Walk::default();
        let start = self.walk_light(scene, self.max_depth, &mut stream.at(LIGHT_DIMENSIONS), &mut light_walk);
        if let Some(start) = start.as_ref().filter(|_| self.techniques.to_camera) {
            let mut numbers = stream.at(CAMERA_DIMENSIONS);
            for y in &light_walk.vertices {
                if let Some((picture, c)) = self.to_camera(scene, (&light_walk, start, y), &mut numbers, &mut joints) {
                    out.splats.push(Splat { picture, radiance: c.value, group: c.group });
                }
            }
        }
        let mut walk = Walk::default();
        // One edge more than scattering events: the last vertex may be a light.
        let escape = self.walk_camera(scene, camera_ray, self.max_depth.saturating_add(1), stream, &mut walk);
        let mut numbers = stream.at(DIRECT_DIMENSIONS);
        let mut rng = if scene.has_media { stream.at(CONNECTION_DIMENSIONS).rng() } else { HashRng::default() };
        for &(_, emitted) in &walk.emitted {
            out.add(emitted, 0);
        }
        self.direct_sight(scene, camera_ray, &walk, None, &mut joints, out);
        for z in &walk.vertices {
            if let Some(c) = self.hit(scene, &walk, z, &mut joints).filter(|_| z.depth > 1) {
                out.add(c.value, c.group);
            }
            if let Some(c) = self.direct(scene, &walk, z, &mut numbers, &mut joints) {
                out.add(c.value, c.group);
            }
            if !z.is_smooth_anywhere() {
                continue;
            }
            if let Some(start) = &start {
                for y in light_walk.vertices.iter().filter(|y| y.is_smooth_anywhere()) {
                    if let Some(c) = self.connect(scene, (&light_walk, start, y), (&walk, z), &mut rng, &mut joints) {
                        out.add(c.value, c.group);
                    }
                }
            }
            if let Some(stored) = stored {
                self.merge(scene, stored, (&walk, z), &mut joints, |c| out.add(c.value, c.group));
            }
        }
        if let Some(escape) = escape {
            self.escape(scene, &walk, &escape, &mut joints, |c| out.add(c.value, c.group));
        }
    }

    /// What the camera sees first, and the light that it sees itself.
    pub fn direct_sight(
        &self,
        scene: &Scene,
        camera_ray: &CameraRay,
        walk: &Walk,
        escape: Option<&Escape>,
        joints: &mut Vec<Joint>,
        out: &mut Estimate,
    ) {
        for z in walk.vertices.iter().filter(|z| z.depth == 1) {
            match &z.place {
                Place::Surface(s, scatter) => first_hit(scene, s, z.wo, scatter, (z.p - camera_ray.ray.o).length(), out),
                Place::Medium(_) => out.alpha = 1.0,
            }
            if let Some(c) = self.hit(scene, walk, z, joints) {
                out.add(c.value, c.group);
            }
        }
        if let Some(escape) = escape {
            self.escape(scene, walk, escape, joints, |c| out.add(c.value, c.group));
        }
    }
}
