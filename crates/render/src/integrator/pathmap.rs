//! Path tracing that borrows a caustic map where paths cannot reach.
//!
//! [`Path`], but light that leaves the lights by mirrors and refractors first (caustics, and what these light) is taken from photons, at
//! the first diffuse surface that the camera sees, also in mirrors and through glass ([`CausticMap`]). The map is made anew for each sample
//! of all pixels, with a radius that shrinks, as in `sppm`. The same paths are left out of the path tracer. All other light, direct and
//! between diffuse surfaces, is the path tracer's own: unbiased, and without the blotches of photons.
//!
//! When not to use it: where caustics do not matter `path` is faster and without bias. Caustics in media and on surfaces without a diffuse
//! part, and light in directions that a glossy lobe samples densely, are left to the paths; so is light that photons do not
//! carry (infinite planes and media that emit).

use super::caustic_map::CausticMap;
use super::photon_settings::PhotonSettings;
use super::{Estimate, Integrator, Path, Stage};
use crate::camera::CameraRay;
use crate::sampler::SampleStream;
use crate::scene::Scene;

/// The path tracer with a caustic map.
pub struct PathMap {
    path: Path,
    map: CausticMap,
}

impl PathMap {
    /// The path tracer that does the rest, and the settings of the map.
    pub fn new(path: Path, settings: PhotonSettings) -> Self {
        Self { path, map: CausticMap::new(settings) }
    }
}

impl Integrator for PathMap {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        self.map.prepare(scene, stage)
    }

    fn pass_limit(&self) -> u32 {
        if self.map.is_empty() { self.path.pass_limit() } else { 1 }
    }

    fn begin_pass(&mut self, scene: &Scene, first: u32, _end: u32, stage: &Stage) -> Result<(), String> {
        self.map.begin_pass(scene, first, stage);
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        self.map.notes()
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        if self.map.is_empty() {
            self.path.estimate(scene, camera_ray, stream, out);
        } else {
            self.path.estimate_with(&self.map, scene, camera_ray, stream, out);
        }
    }
}
