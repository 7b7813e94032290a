//! Vertex connection and merging (Georgiev, Křivánek, Davidovič, Slusallek 2012, doi:10.1145/2366145.2366211; also Hachisuka, Pantaleoni,
//! Jensen 2012, "A Path Space Extension for Robust Light Transport Simulation").
//!
//! Bidirectional path tracing, and each sample of all pixels has its own map of light paths beside: camera paths are merged with those
//! that end within a radius of theirs. Merging finds what no connection can make, such as caustics seen in a mirror or through
//! glass. All techniques share their weights.
//!
//! Merging is biased as all density estimation is: light is blurred over the radius. The radius of the i-th sample is r₀ (i + 1)^((α − 1)/2)
//! with α = 3/4 (Knaus and Zwicker 2011, "Progressive Photon Mapping: A Probabilistic Approach", doi:10.1145/1966394.1966404), so
//! that bias and noise both vanish. It depends on the sample's index alone: parts of the samples may be rendered anywhere and merged.

use super::bidirectional::Bidirectional;
use super::bidirectional::stored::StoredWalks;
use super::{Estimate, Integrator, Stage};
use crate::camera::CameraRay;
use crate::math::{PI, fns};
use crate::sampler::SampleStream;
use crate::scene::Scene;

/// How fast the radius shrinks.
const ALPHA: f32 = 0.75;
/// Initial radius as a share of the scene's.
const RADIUS_OF_SCENE: f32 = 0.003;
/// Most walks from the lights that are kept at a time: some 400 MB at five vertices each.
const MOST_PATHS: u32 = 1 << 20;

/// Vertex connection and merging.
pub struct Vcm {
    shared: Bidirectional,
    initial_radius: Option<f32>,
    stored: StoredWalks,
    radius: f32,
}

impl Vcm {
    /// Bytes that the kept walks take at most, about.
    pub(super) const MEMORY: u64 = 400 << 20;

    /// Paths of at most `max_depth` scattering events; Russian roulette may end a walk after `rr_depth` of its own. The radius of merging
    /// starts at `initial_radius` in scene units, or at one that fits the scene.
    pub fn new(max_depth: u32, rr_depth: u32, initial_radius: Option<f32>) -> Self {
        Self { shared: Bidirectional::new(max_depth, rr_depth), initial_radius, stored: StoredWalks::default(), radius: 0.0 }
    }

    /// As [`Self::new`], but paths from the lights are not connected to the camera: no sample lights other pixels than its own. Merging
    /// finds the same light, but for what lights of no size send through glass into media.
    pub fn without_splats(max_depth: u32, rr_depth: u32, initial_radius: Option<f32>) -> Self {
        let mut vcm = Self::new(max_depth, rr_depth, initial_radius);
        vcm.shared.techniques.to_camera = false;
        vcm
    }
}

impl Integrator for Vcm {
    fn set_margin(&mut self, pixels: f32) {
        self.shared.margin = pixels;
    }

    fn prepare(&mut self, scene: &Scene, _stage: &Stage) -> Result<(), String> {
        self.radius = self.initial_radius.unwrap_or(RADIUS_OF_SCENE * scene.sphere().radius);
        if !(self.radius > 0.0 && self.radius.is_finite()) {
            return Err(format!("vcm cannot merge within a radius of {}", self.radius));
        }
        self.shared.prepare(scene)?;
        Ok(())
    }

    fn pass_limit(&self) -> u32 {
        1
    }

    fn begin_pass(&mut self, scene: &Scene, first: u32, _end: u32, stage: &Stage) -> Result<(), String> {
        let pixels = u64::from(stage.size[0]) * u64::from(stage.size[1]);
        let paths = pixels.min(u64::from(MOST_PATHS)) as u32;
        let radius = self.radius * fns::pow(first as f32 + 1.0, 0.5 * (ALPHA - 1.0));
        self.shared.techniques.merging = f64::from(PI * radius * radius) * f64::from(paths);
        self.stored = StoredWalks::default();
        self.stored = StoredWalks::new(&self.shared, scene, stage, first, paths, radius);
        Ok(())
    }

    fn splats(&self) -> bool {
        self.shared.techniques.to_camera
    }

    fn notes(&self) -> Vec<String> {
        vec![format!(
            "vcm: merging blurs light over a radius of {:.2e} at first, which shrinks with the samples: bias that vanishes",
            self.radius
        )]
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        self.shared.estimate(scene, camera_ray, Some(&self.stored), stream, out);
    }
}
