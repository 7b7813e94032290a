//! Follows photons from the lights.
//!
//! Energies are kept by Russian roulette: a photon dies with the share of its power that a surface or medium takes, so that those that
//! go on carry about what they left the light with (Arvo and Kirk 1990, doi:10.1145/97879.97886). Shading normals are corrected for
//! particles (Veach 1997, section 5.3).

use std::ops::Range;

use rayon::prelude::*;

use super::map::survives_thinning;
use super::{Beam, Photon, Route};
use crate::accel::Ray;
use crate::bsdf::Lobe;
use crate::integrator::emission::EmissionSampler;
use crate::math::hash::hash_words;
use crate::medium::Medium;
use crate::sampler::{HashRng, Sampler, SamplerKind};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Photons traced by one task: the unit in which the order of the result is put together.
const TASK: u64 = 2048;
/// A photon that only ever crosses surfaces straight on ends after so many of them.
const MAX_CROSSINGS: u32 = 1024;
/// After so many scattering events roulette kills at least one photon in twenty, so that closed white rooms end.
const LONG_PATH: u32 = 32;

/// Which photons are recorded.
#[derive(Clone, Copy, Debug)]
pub struct Keep {
    /// Those that come straight from a light. Methods that sample the lights for themselves do not want them.
    pub direct: bool,
    /// Those that come by mirrors and refractors alone.
    pub caustic: bool,
    /// All others, and those that land in media.
    pub indirect: bool,
    /// Ways through homogeneous media.
    pub beams: bool,
    /// Only on surfaces, and only photons whose first scattering was by a mirror or refractor (or a glossy surface without a diffuse part).
    pub focused_only: bool,
}

impl Keep {
    /// All photons.
    pub const ALL: Self = Self { direct: true, caustic: true, indirect: true, beams: false, focused_only: false };
    /// Caustics, and what becomes of them.
    pub const FOCUSED: Self = Self { direct: false, caustic: true, indirect: true, beams: false, focused_only: true };
    /// Ways through homogeneous media alone.
    pub const BEAMS: Self = Self { direct: false, caustic: false, indirect: false, beams: true, focused_only: false };

    fn takes(self, route: Route) -> bool {
        match route {
            Route::Direct => self.direct,
            Route::Caustic => self.caustic,
            Route::Indirect => self.indirect,
        }
    }
}

/// What photons left behind, in the order of their indices.
#[derive(Clone, Debug, Default)]
pub struct Deposits {
    /// On surfaces.
    pub surface: Vec<Photon>,
    /// Where media scatter them; powers are those after the loss by absorption there.
    pub volume: Vec<Photon>,
    /// The ways through homogeneous media.
    pub beams: Vec<Beam>,
}

/// Follows photons through a scene.
pub struct Tracer<'a> {
    scene: &'a Scene,
    emission: EmissionSampler,
    sampler: Sampler,
    max_depth: u32,
    keep: Keep,
}

impl<'a> Tracer<'a> {
    /// Photons of a seed. `max_depth` is the longest path in scattering events, the last of which is where the light is seen. Photons leave
    /// media that emit as well, but where they are wanted for their mirrors and refractors alone, and media without end
    /// ([`EmissionSampler::with_media`] says which).
    pub fn new(scene: &'a Scene, seed: u64, max_depth: u32, keep: Keep) -> Self {
        let sampler = Sampler { kind: SamplerKind::Sobol, seed: hash_words([seed, u64::from_le_bytes(*b"photons\0")]), spp: 0 };
        let lights = || EmissionSampler::new(scene);
        let emission = if keep.focused_only { lights() } else { EmissionSampler::with_media(scene).unwrap_or_else(|_| lights()) };
        Self { scene, emission, sampler, max_depth, keep }
    }

    /// The deposits of the photons of a range of indices, in `pass`: each pass has photons of its own. Of them one of 2^`level` is kept, as
    /// maps of this thinning do. Does not depend on threads.
    pub fn trace(&self, pass: u32, range: Range<u64>, level: u32) -> Deposits {
        let tasks = range.end.saturating_sub(range.start).div_ceil(TASK);
        let parts: Vec<Deposits> = (0..tasks)
            .into_par_iter()
            .map(|task| {
                let begin = range.start + task * TASK;
                let mut out = Deposits::default();
                for i in begin..(begin + TASK).min(range.end) {
                    let first = [out.surface.len(), out.volume.len()];
                    self.photon(pass, i, &mut out);
                    if level > 0 {
                        thin(&mut out.surface, first[0], level);
                        thin(&mut out.volume, first[1], level);
                    }
                }
                out
            })
            .collect();
        let total = |of: fn(&Deposits) -> &Vec<Photon>| parts.iter().map(|p| of(p).len()).sum();
        let [surface, volume] = [total(|d| &d.surface), total(|d| &d.volume)].map(Vec::with_capacity);
        let mut all = Deposits { surface, volume, beams: Vec::new() };
        for part in parts {
            all.surface.extend_from_slice(&part.surface);
            all.volume.extend_from_slice(&part.volume);
            all.beams.extend_from_slice(&part.beams);
        }
        all
    }

    /// Follows one photon.
    pub fn photon(&self, pass: u32, index: u64, out: &mut Deposits) {
        let scene = self.scene;
        let mut stream = self.sampler.stream((index >> 32) as u32, pass, index as u32);
        let mut rng = if scene.has_media { stream.rng() } else { HashRng::default() };
        let (mut u_light, u_position, u_direction) = (stream.next_1d(), stream.next_2d(), stream.next_2d());
        let (mut power, group, mut ray, mut media, mut route, is_delta);
        match self.emission.sample_medium(scene, &mut u_light, (u_position, u_direction), &mut rng) {
            // Light of media counts as indirect: no method samples it as it samples lights.
            Some(Some(v)) => (power, group, ray, media, route, is_delta) = (v.power, 0, v.ray, v.media, Route::Indirect, false),
            Some(None) => return,
            None => {
                let Some(e) = self.emission.sample(scene, u_light, u_position, u_direction) else { return };
                (power, group, ray, route) = (e.power(), e.group, e.ray, Route::Direct);
                (media, is_delta) = (self.emission.media(e.light), scene.lights[e.light as usize].is_delta());
            }
        }
        let (mut depth, mut crossings) = (0, 0);
        let passes_solids = scene.solids.is_some() && is_delta;
        while depth < self.max_depth {
            let found = scene.intersect(&ray);
            let mut before = power;
            if let Some(medium) = scene.medium(&media) {
                let t_max = found.as_ref().map_or(f32::INFINITY, |s| s.t);
                if medium.scatters() {
                    if self.keep.beams
                        && let Medium::Homogeneous(homogeneous) = medium
                    {
                        let beam = Beam::new(&ray, t_max, homogeneous, power, (media.top(), group, depth, route));
                        out.beams.extend(beam.is_usable().then_some(beam));
                    }
                    let flight = medium.sample_flight(&ray, t_max, power, stream.next_1d(), &mut rng);
                    power *= flight.weight;
                    if let Some(t) = flight.scattered_at {
                        let (p, wo) = (ray.at(t), -ray.d);
                        if !self.keep.focused_only && (self.keep.indirect || (route == Route::Direct && self.keep.direct)) {
                            push(&mut out.volume, Photon::new(p, wo, wo, power, group, depth, route));
                        }
                        if self.keep.focused_only && route == Route::Direct {
                            return;
                        }
                        let sample = medium.phase().sample(wo, stream.next_2d());
                        power *= sample.weight;
                        (route, depth) = (Route::Indirect, depth + 1);
                        ray = Ray::new(p, sample.wi);
                        if !survives(before, &mut power, depth, stream.next_1d()) {
                            return;
                        }
                        continue;
                    }
                } else {
                    power *= medium.transmittance(&ray, t_max, &mut rng);
                }
            }
            let Some(s) = found else { return };
            if passes_solids && route == Route::Direct && scene.casts_no_shadow(&ray, &s) {
                // What casts no shadow is lit, and so is what lies behind it: half of the photons stand for either.
                power *= 2.0;
                before *= 2.0;
                if stream.next_1d() < 0.5 {
                    crossings += 1;
                    if crossings > MAX_CROSSINGS || !power.is_finite() {
                        return;
                    }
                    ray = Ray::new(s.offset_origin(ray.d), ray.d);
                    continue;
                }
            }
            let wo = -ray.d;
            let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
            if scatter.is_smooth_anywhere() && self.keep.takes(route) {
                push(&mut out.surface, Photon::new(s.p, wo, s.ng, power, group, depth, route));
            }
            let (u_lobe, u, u_roulette) = (stream.next_1d(), stream.next_2d(), stream.next_1d());
            let Some(sample) = scatter.sample_particle(s.ng, wo, u_lobe, u) else { return };
            power *= sample.value / sample.pdf;
            if scene.has_media && sample.lobe.contains(Lobe::TRANSMISSION) {
                media.cross(scene, &s, sample.wi);
            }
            ray = Ray::new(s.offset_origin(sample.wi), sample.wi);
            if sample.lobe.contains(Lobe::NULL) {
                crossings += 1;
                if crossings > MAX_CROSSINGS || power.is_black() {
                    return;
                }
                continue;
            }
            depth += 1;
            let specular = sample.lobe.contains(Lobe::DELTA) || !scatter.has_diffuse();
            route = match route {
                Route::Direct | Route::Caustic if specular => Route::Caustic,
                Route::Direct if self.keep.focused_only => return,
                _ => Route::Indirect,
            };
            if !survives(before, &mut power, depth, u_roulette) {
                return;
            }
        }
    }
}

/// Thins what is behind the `first` records.
fn thin(photons: &mut Vec<Photon>, first: usize, level: u32) {
    let mut kept = first;
    for i in first..photons.len() {
        if survives_thinning(&photons[i], level) {
            photons[kept] = photons[i];
            kept += 1;
        }
    }
    photons.truncate(kept);
}

/// Adds a photon unless it carries nothing, or numbers that are none.
#[inline]
fn push(photons: &mut Vec<Photon>, photon: Photon) {
    if photon.is_finite() && photon.power != [0.0; 3] {
        photons.push(photon);
    }
}

/// Roulette by the share of power that is left.
#[inline]
fn survives(before: Spectrum, power: &mut Spectrum, depth: u32, u: f32) -> bool {
    let most = if depth >= LONG_PATH { 0.95 } else { 1.0 };
    let share = (power.max_component() / before.max_component()).min(most);
    if !(u < share) || !power.is_finite() {
        return false;
    }
    *power /= share;
    true
}
