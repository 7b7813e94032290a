//! Path tracing with manifold next-event estimation: caustics of small lights without blur.
//!
//! [`Path`], and at each point that scatters light a search for the chains of refractions and mirror reflections that lead to a light
//! (`manifold`). It finds what paths cannot: points, spots and parallel light through smooth glass and from mirrors, and it takes most
//! noise from caustics of small lamps. All else is done as `path` does it.
//!
//! When not to use it: where nothing smooth is between lights and surfaces it costs nothing and gives `path`'s picture; where only large
//! lights shine through glass it costs time for little. Chains that it does not look for (`manifold` lists them) and rough glass are
//! left to chance, as with `path`; of lights that chance cannot find they are missing.

use super::manifold::Chains;
use super::{Estimate, Integrator, Path, Stage};
use crate::camera::CameraRay;
use crate::sampler::SampleStream;
use crate::scene::Scene;

/// The path tracer that looks for caustics.
pub struct Mnee {
    path: Path,
    chains: Option<Chains>,
}

impl Mnee {
    /// The path tracer that does the rest.
    pub fn new(path: Path) -> Self {
        Self { path, chains: None }
    }
}

impl Integrator for Mnee {
    fn prepare(&mut self, scene: &Scene, _stage: &Stage) -> Result<(), String> {
        self.chains = Chains::new(scene);
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        vec![match self.chains {
            Some(_) => {
                "mnee: noisy at the focus of caustics; not found of point lights and parallel light: rough glass, chains of more than six \
                 vertices, those that glass reflects more than once, and those that few starts find"
                    .into()
            }
            None => "mnee: nothing smooth makes caustics of small lights here; the same as path".into(),
        }]
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        match &self.chains {
            None => self.path.estimate(scene, camera_ray, stream, out),
            Some(chains) => self.path.estimate_with(chains, scene, camera_ray, stream, out),
        }
    }
}
