//! Stochastic progressive photon mapping (Hachisuka and Jensen 2009, doi:10.1145/1618452.1618487) without memory (Knaus and Zwicker 2011,
//! "Progressive Photon Mapping: A Probabilistic Approach", doi:10.1145/1966394.1966404).
//!
//! Sample i of all pixels sees photons of its own, pass i, through radii that shrink with i: r²(i+1) / r²(i) = (i + α) / (i + 1). Passes
//! know nothing of each other, and the picture is their mean: so passes may be made anywhere and merged exactly. Bias and noise both
//! vanish as passes go on. Direct light comes from rays to the lights.
//!
//! Where Knaus and Zwicker leave the first radius open, ours is a function of the place: the distance of the n nearest photons of a
//! pilot map, caustics and other light apart. So caustics are sharp from the first pass, and dim corners are not black. Photons count
//! that the point can see along its surface ([`VisibleDisk`]), so that light does not leak past the edges of walls.

use std::cell::Cell;

use super::particles::add_volume;
use super::photon_beams::PhotonBeams;
use super::photon_settings::{PhotonSettings, Reach, check, limits, volume_radius};
use super::photon_walk::{At, Gather, MAX_PDF, Through, Walk};
use super::{Estimate, Integrator, Stage};
use crate::camera::CameraRay;
use crate::photon::trace::{Keep, Tracer};
use crate::photon::tree::Neighbors;
use crate::photon::{MapInfo, Photon, PhotonMap, PhotonTree, Query, Route, VisibleDisk};
use crate::sampler::{HashRng, SampleStream};
use crate::scene::Scene;

/// How slowly radii shrink: noise of the mean falls as 1/i^α, bias as 1/i^(1−α).
const ALPHA: f64 = 2.0 / 3.0;
/// The pass whose photons set the first radii; no session comes to it.
pub(super) const PILOT: u32 = u32::MAX;
/// Neighbors within the first radius where nobody says.
pub(super) const NEIGHBORS: u32 = 16;
/// Photons of a pass where nobody says: as many as pixels, in these bounds.
pub(super) const PHOTONS: [u32; 2] = [1 << 15, 1 << 20];

/// Photons of one pass.
#[derive(Default)]
struct Pass {
    caustic: PhotonTree,
    indirect: PhotonTree,
    volume: PhotonTree,
    beams: PhotonBeams,
    /// Factor of powers.
    scale: f32,
    level: u32,
}

/// Stochastic progressive photon mapping.
pub struct Sppm {
    settings: PhotonSettings,
    photons: u32,
    pilot: Pass,
    pass: Pass,
    /// Radius over the first one.
    shrink: f32,
    volume_radius: f32,
    beam_radius: f32,
    /// From `prepare` on.
    reach: Option<Reach>,
    least: f32,
    notes: Vec<String>,
}

impl Sppm {
    /// With settings; photons come with the passes.
    pub fn new(settings: PhotonSettings) -> Self {
        let (pilot, pass) = (Pass::default(), Pass::default());
        let [volume_radius, beam_radius, least] = [0.0; 3];
        Self { settings, photons: 0, pilot, pass, shrink: 1.0, volume_radius, beam_radius, reach: None, least, notes: Vec::new() }
    }

    fn trace(&self, scene: &Scene, pass: u32, stage: &Stage) -> Pass {
        let map = trace_pass(&self.settings, Keep { direct: false, ..Keep::ALL }, self.photons, scene, pass, stage);
        let (scale, level) = (map.scale(), map.level());
        let (surface, volume) = map.into_photons();
        let ([caustic, indirect], volume) = rayon::join(|| trees(surface), || PhotonTree::new(volume));
        Pass { caustic, indirect, volume, beams: PhotonBeams::default(), scale, level }
    }
}

/// So many photons of one pass, in a third of the memory that the settings allow: the pilot stays beside the pass, whose caustics are
/// copied out of it.
pub(super) fn trace_pass(settings: &PhotonSettings, keep: Keep, photons: u32, scene: &Scene, pass: u32, stage: &Stage) -> PhotonMap {
    let tracer = Tracer::new(scene, stage.seed, settings.depth(), keep);
    let mut map = PhotonMap::new(MapInfo::default());
    map.trace_with(&tracer, pass, 0..u64::from(photons), settings.memory / 3, stage.is_cancelled, &mut |_, f| {
        if pass == PILOT {
            (stage.progress)("tracing the pilot photons", f);
        }
    });
    map
}

/// Caustics and all other photons, each by place.
pub(super) fn trees(mut indirect: Vec<Photon>) -> [PhotonTree; 2] {
    // In place, as there may be no room for all of them twice; trees do not depend on the order.
    let mut others = 0;
    for i in 0..indirect.len() {
        if indirect[i].route() != Route::Caustic {
            indirect.swap(i, others);
            others += 1;
        }
    }
    let caustic = indirect.split_off(others);
    indirect.shrink_to_fit();
    let (caustic, indirect) = rayon::join(|| PhotonTree::new(caustic), || PhotonTree::new(indirect));
    [caustic, indirect]
}

/// The radius of a pass (from 0) over the first one.
pub(super) fn shrink(pass: u32) -> f64 {
    (1..=u64::from(pass)).map(|i| (i as f64 + ALPHA) / (i as f64 + 1.0)).product::<f64>().sqrt()
}

impl Integrator for Sppm {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        if self.settings.map.is_some() {
            return Err("`sppm` traces new photons for each pass: it cannot use a photon map".into());
        }
        check(scene)?;
        let pixels = stage.size[0].saturating_mul(stage.size[1]);
        self.photons = self.settings.photons.unwrap_or(pixels.clamp(PHOTONS[0], PHOTONS[1]));
        self.reach = Some(self.settings.reach(scene));
        self.least = 1e-6 * scene.sphere().radius;
        self.pilot = self.trace(scene, PILOT, stage);
        self.volume_radius = self.settings.radius.unwrap_or_else(|| volume_radius(scene, &self.pilot.volume, stage.seed));
        if PhotonBeams::are_wanted(scene, &self.settings) {
            let photons = u64::from(self.photons);
            self.beam_radius = PhotonBeams::trace(scene, &self.settings, stage.seed, PILOT, photons, self.settings.radius).radius();
        }
        let mut note = format!("{} photons in each pass; ", self.photons);
        note += &match self.settings.radius {
            Some(r) => format!("the first radius is {r}"),
            None => "first radii by the density of a pilot".to_owned(),
        };
        note += "; the blur that is left shrinks with each pass";
        self.notes = vec![note];
        if self.pilot.level > 0 {
            self.notes.push(format!("to fit into the memory one of {} records was kept", 1u64 << self.pilot.level));
        }
        self.notes.extend(limits(scene));
        Ok(())
    }

    fn pass_limit(&self) -> u32 {
        1
    }

    fn begin_pass(&mut self, scene: &Scene, first: u32, _end: u32, stage: &Stage) -> Result<(), String> {
        self.pass = Pass::default();
        self.pass = self.trace(scene, first, stage);
        self.shrink = shrink(first) as f32;
        if PhotonBeams::are_wanted(scene, &self.settings) {
            // Their blur is in one direction alone, so that its radius goes down as the square of the others'.
            let radius = (self.beam_radius * self.shrink * self.shrink).max(self.least);
            self.pass.beams = PhotonBeams::trace(scene, &self.settings, stage.seed, first, u64::from(self.photons), Some(radius));
        }
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let walk = Walk { max_depth: self.settings.depth(), rr_depth: self.settings.rr_depth, samples_lights: true };
        walk.follow(scene, camera_ray, stream, self, out);
    }
}

impl Gather for Sppm {
    fn surface(&self, scene: &Scene, at: &At, stream: &mut SampleStream, _rng: &mut HashRng, out: &mut Estimate) {
        let query = Query { s: at.s, scatter: at.scatter, wo: at.wo, max_pdf: MAX_PDF };
        let count = self.settings.neighbors.unwrap_or(NEIGHBORS) as usize;
        let reach = self.reach.map_or(0.0, |r| r.at(at.s.p));
        let mut found = Neighbors::new();
        let trees = [&self.pass.caustic, &self.pass.indirect];
        // The squared distance of the nearest photon on a surface of another orientation: where there is none within the radius, hardly
        // anything hides a part of the disk.
        let other = Cell::new(f32::INFINITY);
        let lands = |photon: &Photon| {
            let lands = query.lands(photon);
            if !lands {
                other.set(other.get().min((photon.position() - at.s.p).length_squared()));
            }
            lands
        };
        let mut radius = |pilot: &PhotonTree, tree: &PhotonTree| {
            let first = match self.settings.radius {
                _ if tree.is_empty() => return 0.0,
                Some(radius) => radius,
                None => pilot.nearest(at.s.p, count, reach, lands, &mut found).sqrt(),
            };
            (first * self.shrink).max(self.least)
        };
        let radii = [radius(&self.pilot.caustic, trees[0]), radius(&self.pilot.indirect, trees[1])];
        let u = stream.next_1d();
        let most = radii[0].max(radii[1]);
        let is_near_others = most > 0.0 && (self.settings.radius.is_some() || other.get() < most * most);
        let disk = is_near_others.then(|| VisibleDisk::around(scene, at.s, at.wo, most, u));
        for (tree, radius) in trees.into_iter().zip(radii) {
            if radius > 0.0 {
                let accept = |photon: &Photon| self.settings.accepts(photon, at.depth);
                query.radiance_within(tree, radius, disk.as_ref(), self.pass.scale, accept, |light, group| {
                    out.add(at.throughput * light, group)
                });
            }
        }
    }

    fn medium(&self, scene: &Scene, through: &Through, rng: &mut HashRng, out: &mut Estimate) {
        let radius = (self.volume_radius * self.shrink).max(self.least);
        add_volume(scene, (&self.pass.volume, &self.pass.beams), &self.settings, through, (radius, self.pass.scale), rng, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_shrink_as_published() {
        let mut square = 1.0;
        for pass in 0..1000u32 {
            assert!((shrink(pass).powi(2) / square - 1.0).abs() < 1e-9, "pass {pass}: {} instead of {}", shrink(pass).powi(2), square);
            let i = f64::from(pass + 1);
            square *= (i + ALPHA) / (i + 1.0);
        }
    }
}
