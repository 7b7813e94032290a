//! What the methods with photons have in common: the camera's part of the paths.
//!
//! A path from the camera ends on the first surface where the density of photons can tell what is reflected. Which light is left to
//! photons and which to the path itself is decided by direction: where the BSDF's own sampling is denser than [`MAX_PDF`] (mirrors,
//! glass, narrow glossy lobes) the path goes on, all other directions are the photons'. Both sides use the same rule, so that nothing
//! is counted twice and nothing is left out, whatever the material is made of.

use super::Estimate;
use super::light_sampling::{context_towards, pdf_infinite_alone, pdf_surface, sample_one_alone, visibility};
use super::path::first_hit;
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::light::LightContext;
use crate::material::Scatter;
use crate::math::warp::power_heuristic;
use crate::math::{Vec3, fns};
use crate::medium::{Medium, MediumStack};
use crate::sampler::{HashRng, SampleStream};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// The density per solid angle from which on a path follows a direction: that of the peak of a GGX lobe with α = 0.2. The densest
/// direction of a diffuse surface has 1/π.
pub(super) const MAX_PDF: f32 = 2.0;
/// A path that only ever crosses surfaces straight on ends after so many of them.
const MAX_CROSSINGS: u32 = 1024;

/// A surface that a path has come to.
pub(super) struct At<'a> {
    pub s: &'a Surface,
    pub scatter: &'a Scatter,
    pub wo: Vec3,
    /// What light towards `wo` is multiplied by.
    pub throughput: Spectrum,
    /// Scattering events before this one.
    pub depth: u32,
    /// On the side of `wo`.
    pub media: &'a MediumStack,
}

/// A segment of a path in a medium.
pub(super) struct Through<'a> {
    pub medium: &'a Medium,
    pub ray: &'a Ray,
    pub t_max: f32,
    pub throughput: Spectrum,
    /// Scattering events before the segment.
    pub depth: u32,
}

/// Where photons come in.
pub(super) trait Gather {
    /// Adds the light that a surface reflects from directions up to [`MAX_PDF`], without that of [`direct`] where the method has it.
    fn surface(&self, scene: &Scene, at: &At, stream: &mut SampleStream, rng: &mut HashRng, out: &mut Estimate);

    /// Adds the light that a medium scatters along a segment.
    fn medium(&self, scene: &Scene, through: &Through, rng: &mut HashRng, out: &mut Estimate);
}

/// How paths go.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    /// Longest path in scattering events.
    pub max_depth: u32,
    /// Scattering events after which Russian roulette may end a path.
    pub rr_depth: u32,
    /// Whether lights are sampled; else photons bring direct light as well.
    pub samples_lights: bool,
}

/// The last scattering, which the weights of light found next refer to.
struct Vertex {
    ctx: LightContext,
    /// Density of the direction; infinite where no light was sampled for it.
    pdf: f32,
}

impl Walk {
    /// Follows one path from the camera.
    pub fn follow(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, gather: &impl Gather, out: &mut Estimate) {
        let mut ray = camera_ray.ray;
        let mut throughput = Spectrum::splat(camera_ray.weight);
        let mut last = Vertex { ctx: LightContext { p: ray.o, n: Vec3::ZERO }, pdf: f32::INFINITY };
        let (mut depth, mut crossings, mut eta_scale, mut distance) = (0, 0, 1.0f32, 0.0);
        let mut media = scene.camera_medium;
        let mut rng = if scene.has_media { stream.rng() } else { HashRng::default() };
        loop {
            let found = scene.intersect(&ray);
            if let Some(medium) = scene.medium(&media) {
                let t_max = found.as_ref().map_or(f32::INFINITY, |s| s.t);
                if medium.scatters() && depth < self.max_depth {
                    gather.medium(scene, &Through { medium, ray: &ray, t_max, throughput, depth }, &mut rng, out);
                    if depth == 0 {
                        out.alpha = 1.0;
                    }
                }
                let crossing = medium.cross(&ray, t_max, &mut rng);
                out.add(throughput * crossing.emitted, 0);
                throughput *= crossing.transmittance;
                if throughput.is_black() {
                    return;
                }
            }
            let Some(s) = found else {
                add_infinite(scene, ray.d, throughput, &last, depth, out);
                return;
            };
            let wo = -ray.d;
            add_emission(scene, &s, wo, throughput, &last, depth, out);
            let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
            if depth == 0 {
                distance += s.t;
                first_hit(scene, &s, wo, &scatter, distance, out);
            }
            let last_edge = depth >= self.max_depth;
            if last_edge && !scene.has_null {
                return;
            }
            if !last_edge && scatter.is_smooth_anywhere() {
                let at = At { s: &s, scatter: &scatter, wo, throughput, depth, media: &media };
                if self.samples_lights {
                    direct(scene, &at, MAX_PDF, stream, &mut rng, out);
                }
                gather.surface(scene, &at, stream, &mut rng, out);
            }
            let (u_lobe, u, u_roulette) = (stream.next_1d(), stream.next_2d(), stream.next_1d());
            let Some(sample) = scatter.sample(wo, u_lobe, u, TransportMode::Radiance) else { return };
            let delta = sample.lobe.contains(Lobe::DELTA);
            if !delta && sample.pdf <= MAX_PDF {
                return;
            }
            throughput *= sample.value / sample.pdf;
            if throughput.is_black() {
                return;
            }
            if scene.has_media && sample.lobe.contains(Lobe::TRANSMISSION) {
                media.cross(scene, &s, sample.wi);
            }
            ray = Ray::new(s.offset_origin(sample.wi), sample.wi);
            if sample.lobe.contains(Lobe::NULL) {
                crossings += 1;
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
            last = Vertex { ctx: context_towards(&s, wo), pdf: if delta || !self.samples_lights { f32::INFINITY } else { sample.pdf } };
            if depth >= self.rr_depth {
                let survive = (throughput.max_component() * eta_scale).min(0.95);
                if u_roulette >= survive {
                    return;
                }
                throughput /= survive;
            }
        }
    }
}

/// Direct light by a ray to one light, from all directions; those that the BSDF's sampling finds with a higher density than `max_pdf` are
/// shared with the path that goes on there.
pub(super) fn direct(scene: &Scene, at: &At, max_pdf: f32, stream: &mut SampleStream, rng: &mut HashRng, out: &mut Estimate) {
    let Some(direct) = sample_one_alone(scene, &context_towards(at.s, at.wo), stream) else { return };
    let (f, pdf) = at.scatter.eval_pdf(at.wo, direct.sample.wi, TransportMode::Radiance);
    if f.is_black() {
        return;
    }
    let shared = !direct.sample.delta && pdf > max_pdf;
    let weight = if shared { power_heuristic(direct.pdf, pdf) } else { 1.0 };
    let visible = visibility(scene, at.s, at.wo, at.media, &direct.sample, rng);
    if !visible.is_black() {
        out.add(at.throughput * f * direct.radiance * visible * (weight / direct.pdf), direct.group);
    }
}

/// Light that the surface itself sends back along the ray.
fn add_emission(scene: &Scene, s: &Surface, wo: Vec3, throughput: Spectrum, last: &Vertex, depth: u32, out: &mut Estimate) {
    let Some(emission) = &s.object(scene).emission else { return };
    if depth == 0 && scene.hide_lights {
        return;
    }
    let radiance = scene.emitted(s, wo);
    if radiance.is_black() {
        return;
    }
    let weight = match s.light(scene) {
        Some(light) if last.pdf.is_finite() => power_heuristic(last.pdf, pdf_surface(scene, &last.ctx, light, s)),
        _ => 1.0,
    };
    out.add(throughput * radiance * weight, emission.group);
}

/// Light from beyond the scene.
fn add_infinite(scene: &Scene, d: Vec3, throughput: Spectrum, last: &Vertex, depth: u32, out: &mut Estimate) {
    if depth == 0 && scene.hide_lights {
        return;
    }
    for &light in &scene.infinite_lights {
        let radiance = scene.lights[light as usize].escaped(last.ctx.p, d);
        if !radiance.is_black() {
            let weight = if last.pdf.is_finite() { power_heuristic(last.pdf, pdf_infinite_alone(scene, &last.ctx, light, d)) } else { 1.0 };
            out.add(throughput * radiance * weight, scene.light_groups[light as usize]);
        }
    }
}
