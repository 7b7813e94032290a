//! Photon beams in the methods with photons: how many, how wide, and what they add to a segment of the camera's path.

use super::Estimate;
use super::photon_settings::PhotonSettings;
use super::photon_walk::Through;
use crate::accel::Ray;
use crate::math::hash::hash_words;
use crate::math::warp;
use crate::medium::Medium;
use crate::photon::trace::{Keep, Tracer};
use crate::photon::{Beam, BeamTree, beams};
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::Scene;

/// Of so many photons one leaves beams, which have more of a say than points.
const PHOTONS_PER_BEAM: u64 = 2;
/// The most photons that leave beams. In white media each leaves some tens of beams.
const MOST: u64 = 1 << 16;
/// Beams that a ray is meant to pass.
const NEIGHBORS: usize = 64;
/// Rays looked at to find the radius.
const PROBES: u32 = 64;

/// The beams of some photons.
#[derive(Default)]
pub(super) struct PhotonBeams {
    tree: BeamTree,
    scale: f32,
}

impl PhotonBeams {
    /// Whether beams stand for the light of a medium.
    pub fn serve(settings: &PhotonSettings, medium: &Medium) -> bool {
        settings.beams && matches!(medium, Medium::Homogeneous(_))
    }

    /// Whether any light of the scene comes from beams.
    pub fn are_wanted(scene: &Scene, settings: &PhotonSettings) -> bool {
        scene.media.iter().any(|m| m.scatters() && Self::serve(settings, m))
    }

    /// Traces the beams of a pass of `photons` photons, seen within a radius; `None`: by the density of beams.
    pub fn trace(scene: &Scene, settings: &PhotonSettings, seed: u64, pass: u32, photons: u64, radius: Option<f32>) -> Self {
        let count = (photons / PHOTONS_PER_BEAM).clamp(1, MOST);
        let found = Tracer::new(scene, seed, settings.depth(), Keep::BEAMS).trace(pass, 0..count, 0).beams;
        let radius = radius.unwrap_or_else(|| Self::radius_by_density(scene, &found, seed));
        Self { tree: BeamTree::new(found, radius), scale: (1.0 / count as f64) as f32 }
    }

    fn radius_by_density(scene: &Scene, beams: &[Beam], seed: u64) -> f32 {
        let reach = 0.1 * scene.sphere().radius;
        if beams.is_empty() {
            return reach;
        }
        let sampler = Sampler { kind: SamplerKind::Independent, seed: hash_words([seed, u64::from_le_bytes(*b"beams\0\0\0")]), spp: 0 };
        let probes = (0..PROBES).map(|i| {
            let mut stream = sampler.stream(0, 0, i);
            let (u, along, direction) = (stream.next_1d(), stream.next_1d(), stream.next_2d());
            let own = (u * beams.len() as f32) as usize % beams.len();
            let (beam, d) = (&beams[own], warp::uniform_sphere(direction));
            (own, Ray::new(beam.o + beam.d * (along * beam.length) - d * (0.5 * beam.length), d), beam.length)
        });
        beams::radius(beams, probes, NEIGHBORS, reach).max(1e-6 * scene.sphere().radius)
    }

    /// Adds the light that beams send along a segment of a homogeneous medium.
    pub fn add(&self, scene: &Scene, settings: &PhotonSettings, through: &Through, out: &mut Estimate) {
        let Medium::Homogeneous(medium) = through.medium else { return };
        self.tree.along(through.ray, through.t_max, |beam, t, s, kernel| {
            let same = scene.media.get(beam.medium as usize).is_some_and(|m| std::ptr::eq(m, through.medium));
            if same && settings.max_depth.is_none_or(|most| beam.depth + through.depth < most) {
                let light = beam.power * beams::scattered(medium, &medium.phase, through.ray, beam, t, s);
                out.add(through.throughput * light * (kernel * self.scale), beam.group);
            }
        });
    }

    /// How far away they are seen.
    pub fn radius(&self) -> f32 {
        self.tree.radius()
    }
}
