//! Photon mapping in two passes (Jensen 1996, doi:10.1007/978-3-7091-7484-5_3): direct light by rays to the lights, caustics from a map
//! of their own, all other light by a final gather over a global map.
//!
//! A gather ray goes on through mirrors, glass and frosted glass to the next surface with a diffuse part and takes what the global map
//! says there; where that is purely diffuse, from irradiance computed beforehand at the photons (Christensen 1999, "Faster Photon Map
//! Global Illumination", doi:10.1080/10867651.1999.10487505). Light that reaches the gathering surface from a light by mirrors and
//! refractors alone is the caustic map's: gather rays that meet a light bring nothing. What media emit gather rays bring from wherever they
//! pass, also beyond mirrors; the caustic map has none of it. Gather rays that end closer than the estimates
//! reach gather once more, so that corners are neither dark nor blotchy.
//!
//! The map is the same for all views and samples: noise goes down with the samples, the blur of the map does not.

use arrayvec::ArrayVec;
use rayon::prelude::*;

use super::particles::add_volume;
use super::photon_beams::PhotonBeams;
use super::photon_settings::{PhotonSettings, Reach, volume_radius};
use super::photon_walk::{At, Gather, MAX_PDF, Through, Walk, direct};
use super::{Estimate, Integrator, Stage};
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::material::Scatter;
use crate::math::{Frame, INV_PI, ONE_MINUS_EPSILON, Vec3, warp};
use crate::medium::Medium;
use crate::photon::tree::Neighbors;
use crate::photon::{Photon, PhotonTree, Query, Route, estimate};
use crate::sampler::{HashRng, SampleStream};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Surfaces that a gather ray may meet.
const MAX_EVENTS: u32 = 64;
/// Photons that say where light comes from.
const GUIDES: usize = 32;
/// 1 − cos of the half-angle about a photon's direction in which gather rays go: 10 degrees.
const GUIDE_CONE: f32 = 0.015_192_25;
/// Bytes for a photon's irradiance.
const IRRADIANCE_BYTES: u64 = size_of::<[f32; 3]>() as u64;

/// What a gather ray has come to.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    /// The surface that the camera sees: the path itself goes on in narrow lobes.
    First,
    /// A surface too near for the map, which gathers light once more.
    Near,
    /// Anything else: the ray goes on by mirrors and refractors.
    Guide,
}

/// Photon mapping with final gather.
pub struct PhotonMapping {
    settings: PhotonSettings,
    caustic: PhotonTree,
    global: PhotonTree,
    volume: PhotonTree,
    beams: PhotonBeams,
    /// Irradiance at the photons of the global map, where it can stand for them.
    irradiance: Vec<[f32; 3]>,
    volume_radius: f32,
    /// From `prepare` on.
    reach: Option<Reach>,
    scale: f32,
    /// Whether any medium emits.
    glows: bool,
    notes: Vec<String>,
}

impl PhotonMapping {
    /// With settings; the map comes in `prepare`.
    pub fn new(settings: PhotonSettings) -> Self {
        let tree = PhotonTree::default;
        Self {
            settings,
            caustic: tree(),
            global: tree(),
            volume: tree(),
            beams: PhotonBeams::default(),
            irradiance: Vec::new(),
            volume_radius: 0.0,
            reach: None,
            scale: 0.0,
            glows: false,
            notes: Vec::new(),
        }
    }

    /// How far estimates reach at a point.
    #[inline]
    fn reach_at(&self, p: Vec3) -> f32 {
        self.reach.map_or(0.0, |r| r.at(p))
    }

    /// Computes the irradiance at all photons of the global map.
    fn precompute(&mut self, stage: &Stage) {
        let (global, count, scale) = (&self.global, self.settings.count(), self.scale);
        let mut irradiance = vec![[0.0; 3]; global.len()];
        let parts = irradiance.len().div_ceil(1 << 14).max(1);
        for (part, out) in irradiance.chunks_mut(1 << 14).enumerate() {
            if (stage.is_cancelled)() {
                return;
            }
            out.par_iter_mut().enumerate().for_each(|(i, out)| {
                let photon = global.photon((part << 14 | i) as u32);
                let reach = self.reach_at(photon.position());
                *out = estimate::irradiance(global, photon.position(), photon.normal(), count, reach, scale).rgb();
            });
            (stage.progress)("irradiance at the photons", (part + 1) as f64 / parts as f64);
        }
        self.irradiance = irradiance;
    }

    /// What the global map says that a surface with a diffuse part reflects along `at.wo`, delta lobes left out; `at.depth` counts the
    /// events on the way.
    fn add_global(&self, at: &At, out: &mut Estimate) {
        if !self.irradiance.is_empty() && is_lambertian(at.scatter) {
            let n = if at.s.ng.dot(at.wo) < 0.0 { -at.s.ng } else { at.s.ng };
            let mut found = Neighbors::new();
            // The nearest photon's normal may be a little off; its own estimate has taken photons of such normals.
            self.global.nearest(at.s.p, 1, self.reach_at(at.s.p), |photon| photon.normal().dot(n) > 0.9, &mut found);
            if let Some(&(_, index)) = found.first() {
                let irradiance = Spectrum::from_rgb(self.irradiance[index as usize]);
                out.add(at.throughput * at.scatter.albedo(at.wo) * irradiance * INV_PI, 0);
            }
            return;
        }
        let query = Query { s: at.s, scatter: at.scatter, wo: at.wo, max_pdf: f32::INFINITY };
        let accept = |photon: &Photon| self.settings.accepts(photon, at.depth);
        query.radiance_nearest(&self.global, self.settings.count(), self.reach_at(at.s.p), self.scale, accept, |light, group| {
            out.add(at.throughput * light, group);
        });
    }

    fn add_caustics(&self, at: &At, max_pdf: f32, out: &mut Estimate) {
        let query = Query { s: at.s, scatter: at.scatter, wo: at.wo, max_pdf };
        let accept = |photon: &Photon| self.settings.accepts(photon, at.depth);
        query.radiance_nearest(&self.caustic, self.settings.count(), self.reach_at(at.s.p), self.scale, accept, |light, group| {
            out.add(at.throughput * light, group);
        });
    }

    /// Light from surfaces and media, by one ray.
    fn gather(&self, scene: &Scene, from: &At, stream: &mut SampleStream, rng: &mut HashRng, out: &mut Estimate) {
        let mut media = *from.media;
        let mut throughput = from.throughput;
        let mut depth = from.depth;
        // What the ray leaves; at first the gathering surface, later those that guide it on.
        let (mut s, mut scatter, mut wo): (Surface, Scatter, _) = (from.s.clone(), from.scatter.clone(), from.wo);
        let mut role = Role::First;
        let mut was_near = false;
        for event in 0..MAX_EVENTS {
            let step = if role == Role::First { self.guided(from, stream) } else { guide(role, &scatter, wo, stream) };
            let Some(step) = step else { return };
            throughput *= step.weight;
            if throughput.is_black() {
                return;
            }
            if scene.has_media && s.ng.dot(step.wi) * s.ng.dot(wo) < 0.0 {
                media.cross(scene, &s, step.wi);
            }
            depth += u32::from(event == 0 || !step.is_null);
            // The surface that comes next scatters as well; what media on the way emit does not.
            let is_last = depth >= self.settings.depth();
            if depth > self.settings.depth() || is_last && !self.glows {
                return;
            }
            let ray = Ray::new(s.offset_origin(step.wi), step.wi);
            let found = scene.intersect(&ray);
            if let Some(medium) = scene.medium(&media) {
                let t_max = found.as_ref().map_or(f32::INFINITY, |s| s.t);
                if medium.scatters() && !is_last {
                    self.medium(scene, &Through { medium, ray: &ray, t_max, throughput, depth }, rng, out);
                }
                let crossing = medium.cross(&ray, t_max, rng);
                out.add(throughput * crossing.emitted, 0);
                throughput *= crossing.transmittance;
            }
            let Some(hit) = found else { return };
            (s, wo) = (hit, -ray.d);
            scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
            role = Role::Guide;
            if scatter.has_diffuse() && !is_last {
                let at = At { s: &s, scatter: &scatter, wo, throughput, depth, media: &media };
                if !was_near && s.t < self.reach_at(s.p) && self.search_radius(&s) > s.t {
                    (role, was_near) = (Role::Near, true);
                    direct(scene, &at, f32::INFINITY, stream, rng, out);
                    self.add_caustics(&at, f32::INFINITY, out);
                } else {
                    self.add_global(&at, out);
                }
            }
        }
    }

    /// The direction of a gather ray: half of them by the BSDF, half towards where photons have come from (after Jensen 1995, "Importance
    /// Driven Path Tracing using the Photon Map", doi:10.1007/978-3-7091-9430-0_31), weighed by the density of both.
    fn guided(&self, at: &At, stream: &mut SampleStream) -> Option<Step> {
        let (u_choice, u) = (stream.next_1d(), stream.next_2d());
        let query = Query { s: at.s, scatter: at.scatter, wo: at.wo, max_pdf: MAX_PDF };
        let mut found = Neighbors::new();
        let useful = |photon: &Photon| photon.route() == Route::Indirect && query.lands(photon);
        self.global.nearest(at.s.p, GUIDES, self.reach_at(at.s.p), useful, &mut found);
        let guides: ArrayVec<(Vec3, f32), GUIDES> = found
            .iter()
            .take(GUIDES)
            .map(|(_, index)| self.global.photon(*index))
            .map(|photon| (photon.from(), photon.power().max_component()))
            .collect();
        let total: f32 = guides.iter().map(|g| g.1).sum();
        let share = if total > 0.0 && total.is_finite() { 0.5 } else { 0.0 };
        let wi = if u_choice < share {
            let mut rest = u_choice / share * total;
            let chosen = guides.iter().find(|g| {
                rest -= g.1;
                rest < 0.0
            });
            let (axis, _) = chosen.or(guides.last())?;
            Frame::from_normal(*axis).world_from_local(warp::uniform_cone(u, GUIDE_CONE))
        } else {
            let u_lobe = ((u_choice - share) / (1.0 - share)).clamp(0.0, ONE_MINUS_EPSILON);
            let sample = at.scatter.sample(at.wo, u_lobe, u, TransportMode::Radiance)?;
            if sample.lobe.contains(Lobe::DELTA) {
                return None;
            }
            sample.wi
        };
        let (f, pdf) = at.scatter.eval_pdf(at.wo, wi, TransportMode::Radiance);
        if f.is_black() || pdf > MAX_PDF {
            return None;
        }
        let near: f32 = guides.iter().filter(|g| g.0.dot(wi) > 1.0 - GUIDE_CONE).map(|g| g.1).sum();
        let guided = if share > 0.0 { near / total * warp::uniform_cone_pdf(GUIDE_CONE) } else { 0.0 };
        let pdf = share * guided + (1.0 - share) * pdf;
        (pdf > 0.0).then(|| Step { wi, weight: f / pdf, is_null: false })
    }

    /// How far the estimate of the global map reaches at a point.
    fn search_radius(&self, s: &Surface) -> f32 {
        let mut found = Neighbors::new();
        self.global.nearest(s.p, self.settings.count(), self.reach_at(s.p), |p| p.normal().dot(s.ng).abs() > 0.7, &mut found).sqrt()
    }
}

/// A direction in which a gather ray goes on.
struct Step {
    wi: Vec3,
    weight: Spectrum,
    is_null: bool,
}

/// How a gather ray leaves a surface that it has come to.
fn guide(role: Role, scatter: &Scatter, wo: Vec3, stream: &mut SampleStream) -> Option<Step> {
    let (u_lobe, u) = (stream.next_1d(), stream.next_2d());
    let sample = scatter.sample(wo, u_lobe, u, TransportMode::Radiance)?;
    let goes_on = role == Role::Near || sample.lobe.contains(Lobe::DELTA) || !scatter.has_diffuse();
    goes_on.then(|| Step { wi: sample.wi, weight: sample.value / sample.pdf, is_null: sample.lobe.contains(Lobe::NULL) })
}

/// Whether a point scatters as Lambert's law says and not through the surface, so that irradiance tells all.
fn is_lambertian(scatter: &Scatter) -> bool {
    scatter.parts.iter().all(|p| p.bsdf.lobes() == Lobe::DIFFUSE.union(Lobe::REFLECTION))
}

impl Integrator for PhotonMapping {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        self.notes.clear();
        let mut map = self.settings.map(scene, stage, &mut self.notes)?;
        self.reach = Some(self.settings.reach(scene));
        self.glows = scene.media.iter().any(Medium::emits);
        // Irradiance knows neither light groups nor the lengths of paths.
        let precompute = scene.group_names.len() == 1 && self.settings.max_depth.is_none();
        let record = crate::photon::map::BYTES_PER_PHOTON;
        // Caustic photons are in both trees.
        let needed = |map: &crate::photon::PhotonMap| {
            let caustics = map.surface().iter().filter(|p| p.route() == Route::Caustic).count() as u64;
            map.bytes() + caustics * record + if precompute { map.surface().len() as u64 * IRRADIANCE_BYTES } else { 0 }
        };
        if needed(&map) > self.settings.memory {
            let share = self.settings.memory as f64 / needed(&map) as f64;
            map.limit((map.bytes() as f64 * share) as u64);
            self.notes.push(format!("to fit into the memory the map is used with one of {} records", 1u64 << map.level()));
        }
        self.scale = map.scale();
        let (seed, traced) = (map.info.seed, map.traced());
        let (surface, volume) = map.into_photons();
        let caustic: Vec<Photon> = surface.iter().filter(|p| p.route() == Route::Caustic).copied().collect();
        let (global, (caustic, volume)) =
            rayon::join(|| PhotonTree::new(surface), || rayon::join(|| PhotonTree::new(caustic), || PhotonTree::new(volume)));
        (self.global, self.caustic, self.volume) = (global, caustic, volume);
        self.volume_radius = volume_radius(scene, &self.volume, seed);
        if PhotonBeams::are_wanted(scene, &self.settings) {
            self.beams = PhotonBeams::trace(scene, &self.settings, seed, 0, traced, None);
        }
        if precompute {
            self.precompute(stage);
        }
        self.notes.push(format!(
            "{} caustic photons; indirect light and caustics have the blur of {} photons, which more photons make smaller and more samples do not",
            self.caustic.len(),
            self.settings.count()
        ));
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

impl Gather for PhotonMapping {
    fn surface(&self, scene: &Scene, at: &At, stream: &mut SampleStream, rng: &mut HashRng, out: &mut Estimate) {
        self.add_caustics(at, MAX_PDF, out);
        self.gather(scene, at, stream, rng, out);
    }

    fn medium(&self, scene: &Scene, through: &Through, rng: &mut HashRng, out: &mut Estimate) {
        add_volume(scene, (&self.volume, &self.beams), &self.settings, through, (self.volume_radius, self.scale), rng, out);
    }
}
