//! Recursive ray tracing (Whitted 1980, "An Improved Illumination Model for Shaded Display", doi:10.1145/358876.358882).
//!
//! I = Ic + ks·Is + kt·It: the local color Ic under every light that a shadow ray reaches, plus what comes along the mirrored and
//! the refracted ray, each followed to a recursion level. No light between diffuse surfaces, no caustics, no blur of rough
//! mirrors: those show lights only. Area lights and environments get one random point each a sample, so their shadows are soft.

use super::light_sampling::{context, visibility};
use super::path::first_hit;
use super::{Estimate, Integrator, Stage};
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::material::Part;
use crate::math::{ONE_MINUS_EPSILON, Vec2, Vec3};
use crate::medium::{Medium, MediumStack};
use crate::sampler::SampleStream;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Rays that carry less than this are not followed: less than a step of an 8-bit picture.
const MIN_THROUGHPUT: f32 = 1.0 / 1024.0;

/// The recursive ray tracer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Whitted {
    /// Recursion level: how many mirrors and refractions a ray may meet; `None`: as many as a classic scene says, else 8.
    pub max_depth: Option<u32>,
    /// Whether the scene has media that scatter; found by [`Integrator::prepare`].
    pub has_scattering: bool,
}

/// A ray to be followed.
struct Pending {
    ray: Ray,
    throughput: Spectrum,
    depth: u32,
    media: MediumStack,
}

impl Integrator for Whitted {
    fn prepare(&mut self, scene: &Scene, _stage: &Stage) -> Result<(), String> {
        self.has_scattering = scene.has_media && scene.media.iter().any(Medium::scatters);
        Ok(())
    }

    fn uses_camera_rays(&self, scene: &Scene) -> bool {
        scene.classic.is_none()
    }

    fn notes(&self) -> Vec<String> {
        let note = "media absorb and glow, but the light that they scatter is missing: `whitted` cannot compute it, `path` can";
        if self.has_scattering { vec![note.to_owned()] } else { Vec::new() }
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        if let Some(classic) = &scene.classic {
            let (picture, lens) = (camera_ray.picture.as_dvec2(), camera_ray.u_lens.as_dvec2());
            classic.estimate(picture, lens, self.max_depth, stream, out);
            return;
        }
        let first = Pending { ray: camera_ray.ray, throughput: Spectrum::splat(camera_ray.weight), depth: 0, media: scene.camera_medium };
        let mut rng = stream.rng();
        // A stack of our own: the recursion level is the user's, the thread's stack is not.
        let mut pending = vec![first];
        while let Some(at) = pending.pop() {
            let found = scene.intersect(&at.ray);
            let mut throughput = at.throughput;
            if let Some(medium) = scene.medium(&at.media) {
                // What the medium scatters is lost: this method knows no light that comes from the side.
                let crossing = medium.cross(&at.ray, found.as_ref().map_or(f32::INFINITY, |s| s.t), &mut rng);
                out.add(throughput * crossing.emitted, 0);
                throughput *= crossing.transmittance;
            }
            let Some(s) = found else {
                if at.depth > 0 || !scene.hide_lights {
                    for &light in &scene.infinite_lights {
                        let radiance = scene.lights[light as usize].escaped(at.ray.o, at.ray.d);
                        out.add(throughput * radiance, scene.light_groups[light as usize]);
                    }
                }
                continue;
            };
            let wo = -at.ray.d;
            if let Some(emission) = &s.object(scene).emission
                && (at.depth > 0 || !scene.hide_lights)
            {
                out.add(throughput * scene.emitted(&s, wo), emission.group);
            }
            let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
            if at.depth == 0 {
                first_hit(scene, &s, wo, &scatter, s.t, out);
            }
            if scatter.is_smooth_anywhere() {
                let ctx = context(&s);
                for (index, light) in scene.lights.iter().enumerate() {
                    let Some(sample) = light.sample(&ctx, stream.next_2d()) else { continue };
                    let (f, _) = scatter.eval_pdf(wo, sample.wi, TransportMode::Radiance);
                    let local = throughput * f * scene.light_radiance(index as u32, &sample) / sample.pdf;
                    if !local.is_black() {
                        out.add(local * visibility(scene, &s, wo, &at.media, &sample, &mut rng), scene.light_groups[index]);
                    }
                }
            }
            if at.depth < self.max_depth.unwrap_or(8) {
                for part in &scatter.parts {
                    branch(scene, &s, wo, part, throughput, &at, &mut pending);
                }
            }
        }
    }
}

/// Adds the mirrored and the refracted ray of one model: the ends of the lobe number's range choose them.
fn branch(scene: &Scene, s: &Surface, wo: Vec3, part: &Part, throughput: Spectrum, at: &Pending, pending: &mut Vec<Pending>) {
    let local = part.frame.local_from_world(wo);
    let mut seen = None;
    for u_lobe in [0.0, ONE_MINUS_EPSILON] {
        let Some(sample) = part.bsdf.sample(local, u_lobe, Vec2::splat(0.5), TransportMode::Radiance) else { continue };
        if !sample.lobe.contains(Lobe::DELTA) || seen == Some(sample.lobe) {
            continue;
        }
        seen = Some(sample.lobe);
        let throughput = throughput * sample.value * part.weight;
        if throughput.max_component() < MIN_THROUGHPUT {
            continue;
        }
        let wi = part.frame.world_from_local(sample.wi);
        let mut media = at.media;
        if scene.has_media && sample.lobe.contains(Lobe::TRANSMISSION) {
            media.cross(scene, s, wi);
        }
        pending.push(Pending { ray: Ray::new(s.offset_origin(wi), wi), throughput, depth: at.depth + 1, media });
    }
}
