//! Path tracing with manifold next-event estimation: light that comes to a surface through glass and from mirrors is looked for like
//! light that comes straight.
//!
//! For each point of a rough surface a point of a light is sampled, and a chain of refractions by glass and reflections by metal that
//! leads there is found from a random seed (`manifold`). Caustics of small lamps, and of point lights behind smooth glass, come out
//! without blur, also where they are seen in mirrors. All else is done as `path` does it: large lamps cost more here, for the search is of
//! no use there.
//!
//! Not looked for, but found as by `path`: light of the sky and of the sun, light that glass reflects, chains of more than six vertices
//! or from a point of a medium, and rough glass.

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
        self.chains = Some(Chains::new(scene)).filter(|c| !c.is_empty());
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        match self.chains {
            Some(_) => Vec::new(),
            None => vec!["mnee: no smooth glass or metal makes caustics here; the same as path".into()],
        }
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        match (&self.chains, scene.has_media) {
            (None, _) => self.path.estimate(scene, camera_ray, stream, out),
            (chains, true) => self.path.trace::<true, true>(scene, camera_ray, chains.as_ref(), stream, out),
            (chains, false) => self.path.trace::<false, true>(scene, camera_ray, chains.as_ref(), stream, out),
        }
    }
}
