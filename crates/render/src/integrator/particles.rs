//! Particle tracing, looked at: the density of photons on what the camera sees, directly (Jensen 1996, doi:10.1007/978-3-7091-7484-5_3).
//!
//! Mirrors, glass and narrow glossy lobes are followed from the camera; on everything else, and in media, all light comes from the
//! photon map, direct light included. The map does not depend on the view: it may be made once (`etendue photons trace`) and shown
//! from many cameras. The picture is soft where photons are few, and dark in a seam along edges: use `photon` or `sppm` for pictures
//! to keep.

use super::photon_beams::PhotonBeams;
use super::photon_settings::{PhotonSettings, Reach, volume_radius};
use super::photon_walk::{At, Gather, MAX_PDF, Through, Walk};
use super::{Estimate, Integrator, Stage};
use crate::camera::CameraRay;
use crate::photon::{PhotonTree, Query, estimate};
use crate::sampler::{HashRng, SampleStream};
use crate::scene::Scene;

/// The particle tracer's display.
pub struct Particles {
    settings: PhotonSettings,
    surface: PhotonTree,
    volume: PhotonTree,
    beams: PhotonBeams,
    volume_radius: f32,
    /// From `prepare` on.
    reach: Option<Reach>,
    scale: f32,
    notes: Vec<String>,
}

impl Particles {
    /// With settings; the map comes in `prepare`.
    pub fn new(settings: PhotonSettings) -> Self {
        let (surface, volume) = (PhotonTree::default(), PhotonTree::default());
        Self { settings, surface, volume, beams: PhotonBeams::default(), volume_radius: 0.0, reach: None, scale: 0.0, notes: Vec::new() }
    }
}

impl Integrator for Particles {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        self.notes.clear();
        let map = self.settings.map(scene, stage, &mut self.notes)?;
        self.scale = map.scale();
        self.reach = Some(self.settings.reach(scene));
        let (seed, traced) = (map.info.seed, map.traced());
        let (surface, volume) = map.into_photons();
        (self.surface, self.volume) = rayon::join(|| PhotonTree::new(surface), || PhotonTree::new(volume));
        self.volume_radius = volume_radius(scene, &self.volume, seed);
        if PhotonBeams::are_wanted(scene, &self.settings) {
            self.beams = PhotonBeams::trace(scene, &self.settings, seed, 0, traced, None);
        }
        self.notes.push(format!(
            "what is not a mirror or glass shows the density of its {} nearest photons: shadows and caustics are soft, edges are dark",
            self.settings.count()
        ));
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let walk = Walk { max_depth: self.settings.depth(), rr_depth: self.settings.rr_depth, samples_lights: false };
        walk.follow(scene, camera_ray, stream, self, out);
    }
}

impl Gather for Particles {
    fn surface(&self, _scene: &Scene, at: &At, _stream: &mut SampleStream, _rng: &mut HashRng, out: &mut Estimate) {
        let query = Query { s: at.s, scatter: at.scatter, wo: at.wo, max_pdf: MAX_PDF };
        let accept = |photon: &_| self.settings.accepts(photon, at.depth);
        let reach = self.reach.map_or(0.0, |r| r.at(at.s.p));
        query.radiance_nearest(&self.surface, self.settings.count(), reach, self.scale, accept, |light, group| {
            out.add(at.throughput * light, group);
        });
    }

    fn medium(&self, scene: &Scene, through: &Through, rng: &mut HashRng, out: &mut Estimate) {
        add_volume(scene, (&self.volume, &self.beams), &self.settings, through, (self.volume_radius, self.scale), rng, out);
    }
}

/// Adds the light that photons in a medium send along a segment: from beams where these serve, else from points, within a radius and
/// with a factor of their powers.
pub(super) fn add_volume(
    scene: &Scene,
    (tree, beams): (&PhotonTree, &PhotonBeams),
    settings: &PhotonSettings,
    through: &Through,
    (radius, scale): (f32, f32),
    rng: &mut HashRng,
    out: &mut Estimate,
) {
    if PhotonBeams::serve(settings, through.medium) {
        beams.add(scene, settings, through, out);
        return;
    }
    let Through { medium, ray, t_max, throughput, depth } = *through;
    estimate::radiance_along(tree, ray, t_max, radius, scale, medium.phase(), |photon, t, light| {
        if settings.accepts(photon, depth) {
            out.add(throughput * light * medium.transmittance(ray, t, rng), photon.group());
        }
    });
}
