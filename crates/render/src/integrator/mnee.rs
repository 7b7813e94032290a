//! Path tracing with manifold next-event estimation: light that comes to a surface through glass and from mirrors is looked for like
//! light that comes straight.
//!
//! For each point of a rough surface a point of a light is sampled, and a chain of refractions and mirror reflections that leads there
//! is found by Newton's method from a random seed (`manifold`; Hanika, Droske, Fascione 2015, doi:10.1111/cgf.12681; Zeltner, Georgiev, Jakob
//! 2020, "Specular Manifold Sampling", doi:10.1145/3386569.3392408). With which probability a seed leads to the chain is not known; its
//! reciprocal is estimated without bias by the number of further seeds until one leads there again.
//!
//! Caustics of small lamps and of point lights behind smooth glass come out clean, also where they are seen in mirrors. Chains have up to
//! six vertices, each a refraction at a dielectric or a reflection at a metal; light that glass reflects is found as with `path`.

use super::emission::EmissionSampler;
use super::light_sampling::{context, pdf_infinite, pdf_surface, sample_one, visibility};
use super::manifold::{Casters, MAX_CHAIN};
use super::path::first_hit;
use super::{Estimate, Integrator, Stage};
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::light::LightContext;
use crate::math::warp::power_heuristic;
use crate::math::{Vec3, fns};
use crate::medium::MediumStack;
use crate::sampler::SampleStream;
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// A path that only ever crosses surfaces straight on ends after so many of them.
const MAX_CROSSINGS: u32 = 1024;
/// First dimension of the numbers that the search for chains takes.
const MANIFOLD_DIMENSIONS: u32 = 5 << 16;

/// The path tracer that looks for caustics.
pub struct Mnee {
    max_depth: u32,
    rr_depth: u32,
    emission: Option<EmissionSampler>,
    casters: Casters,
}

/// The last real scattering, and what has happened since the last rough surface.
struct Last {
    ctx: LightContext,
    /// Density of the direction; infinite for the camera and for delta lobes.
    pdf: f32,
    /// Delta events that the search for chains covers; `None`: others, or no rough surface before them.
    chain: Option<u32>,
}

impl Mnee {
    /// Paths of at most `max_depth` scattering events; Russian roulette may end a path after `rr_depth`.
    pub fn new(max_depth: u32, rr_depth: u32) -> Self {
        Self { max_depth, rr_depth, emission: None, casters: Casters::default() }
    }

    fn hit(&self, scene: &Scene, s: &crate::scene::Surface, wo: Vec3, throughput: Spectrum, last: &Last, depth: u32, out: &mut Estimate) {
        let Some(emission) = &s.object(scene).emission else { return };
        if depth == 0 && scene.hides(s) {
            return;
        }
        // Chains to lights find this path, and with full weight.
        let light = s.light(scene).filter(|&l| self.emission.as_ref().is_some_and(|e| e.pmf(l) > 0.0));
        let found_by_chain = light.is_some() && last.chain.is_some_and(|n| n > 0) && !Casters::is_caster(scene, s.material);
        let radiance = scene.emitted(s, wo);
        if found_by_chain || radiance.is_black() {
            return;
        }
        let weight = match s.light(scene) {
            Some(light) if last.pdf.is_finite() => power_heuristic(last.pdf, pdf_surface(scene, &last.ctx, light, s)),
            _ => 1.0,
        };
        out.add(throughput * radiance * weight, emission.group);
    }
}

impl Integrator for Mnee {
    fn prepare(&mut self, scene: &Scene, _stage: &Stage) -> Result<(), String> {
        if scene.has_media {
            return Err("`mnee` cannot render media yet; path, bdpt and vcm can".into());
        }
        self.emission = Some(EmissionSampler::new(scene));
        self.casters = Casters::new(scene);
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        if self.casters.is_empty() { vec!["mnee: no smooth glass or metal in the scene; the same as path".into()] } else { Vec::new() }
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let mut ray = camera_ray.ray;
        let mut throughput = Spectrum::splat(camera_ray.weight);
        let mut last = Last { ctx: LightContext { p: ray.o, n: Vec3::ZERO }, pdf: f32::INFINITY, chain: None };
        let (mut depth, mut crossings, mut eta_scale, mut distance) = (0, 0, 1.0f32, 0.0);
        let mut rng = stream.at(MANIFOLD_DIMENSIONS).rng();
        loop {
            let Some(s) = scene.intersect(&ray) else {
                for &light in scene.infinite_lights.iter().filter(|_| depth > 0 || !scene.hide_lights) {
                    let radiance = scene.lights[light as usize].escaped(ray.d);
                    let by_light = || pdf_infinite(scene, &last.ctx, light, ray.d);
                    let weight = if last.pdf.is_finite() { power_heuristic(last.pdf, by_light()) } else { 1.0 };
                    out.add(throughput * radiance * weight, scene.light_groups[light as usize]);
                }
                return;
            };
            let wo = -ray.d;
            self.hit(scene, &s, wo, throughput, &last, depth, out);
            let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
            if depth == 0 {
                distance += s.t;
                first_hit(scene, &s, wo, &scatter, distance, out);
            }
            let last_edge = depth >= self.max_depth;
            if last_edge && !scene.has_null {
                return;
            }
            let ctx = context(&s);
            let is_rough = scatter.is_smooth_anywhere();
            let direct = sample_one(scene, &ctx, stream);
            if let Some(direct) = direct.filter(|_| !last_edge && is_rough) {
                let (f, bsdf_pdf) = scatter.eval_pdf(wo, direct.sample.wi, TransportMode::Radiance);
                if !f.is_black() {
                    let weight = if direct.sample.delta { 1.0 } else { power_heuristic(direct.pdf, bsdf_pdf) };
                    let unshadowed = throughput * f * direct.radiance * (weight / direct.pdf);
                    out.add(unshadowed * visibility(scene, &s, wo, &MediumStack::VACUUM, &direct.sample, &mut rng), direct.group);
                }
            }
            if let Some(emission) = self.emission.as_ref().filter(|_| !last_edge && is_rough) {
                let longest = (self.max_depth - depth - 1).min(MAX_CHAIN);
                if let Some((value, group)) = self.casters.estimate(scene, emission, &s, wo, &scatter, longest, &mut rng) {
                    out.add(throughput * value, group);
                }
            }
            let (u_lobe, u, u_roulette) = (stream.next_1d(), stream.next_2d(), stream.next_1d());
            let Some(sample) = scatter.sample(wo, u_lobe, u, TransportMode::Radiance) else { return };
            throughput *= sample.value / sample.pdf;
            if throughput.is_black() {
                return;
            }
            ray = Ray::new(s.offset_origin(sample.wi), sample.wi);
            if sample.lobe.contains(Lobe::NULL) {
                crossings += 1;
                last.chain = None;
                if crossings > MAX_CROSSINGS {
                    return;
                }
                continue;
            }
            if last_edge {
                return;
            }
            depth += 1;
            eta_scale *= fns::sqr(sample.eta);
            let is_delta = sample.lobe.contains(Lobe::DELTA);
            let chain = if is_delta {
                let covered = Casters::covers(scene, s.material, sample.lobe);
                last.chain.filter(|&n| covered && n < MAX_CHAIN).map(|n| n + 1)
            } else {
                Some(0)
            };
            last = Last { ctx, pdf: if is_delta { f32::INFINITY } else { sample.pdf }, chain };
            if depth >= self.rr_depth {
                let survive = (throughput.max_component() * eta_scale).min(0.95);
                if !(u_roulette < survive) {
                    return;
                }
                throughput /= survive;
            }
        }
    }
}
