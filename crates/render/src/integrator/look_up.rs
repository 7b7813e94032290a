//! Rays of a final gather: they end on the first surface, where a solution says what light arrives, and go through media as paths do.
//!
//! Whatever the solution knows of media, what it says of a surface is seen through them: they dim it, add what they emit, and where they
//! scatter the ray the lights are sampled and it goes on from there. So light that media bring to the point is found by paths, and its
//! noise is theirs. The scene must be compiled with hidden lights, as for all that starts at a [`super::irradiance::Receiver`].

use super::irradiance::emitted_along;
use super::volume::{self, Scattered};
use super::{Estimate, Integrator};
use crate::accel::Ray;
use crate::camera::CameraRay;
use crate::lightmap::SurfaceLight;
use crate::math::{Frame, INV_PI};
use crate::medium::MediumStack;
use crate::sampler::{HashRng, SampleStream};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Surfaces without substance that a look-up crosses.
const MAX_CROSSINGS: u32 = 64;

/// The light that surfaces scatter as if they were diffuse, from a solution, and the light that media scatter and emit on the way.
pub struct LookUp {
    /// The solution.
    pub light: Box<dyn SurfaceLight>,
    /// Longest path in scattering events; what the solution says of a surface counts as one.
    pub max_depth: u32,
    /// Scattering events after which Russian roulette may end a path.
    pub rr_depth: u32,
}

impl Integrator for LookUp {
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let mut ray = camera_ray.ray;
        let mut through = Spectrum::ONE;
        let mut media = if scene.has_media { scene.camera_medium } else { MediumStack::VACUUM };
        let mut rng = if scene.has_media { stream.rng() } else { HashRng::default() };
        let (mut depth, mut crossings) = (0, 0);
        while crossings < MAX_CROSSINGS {
            let found = scene.intersect(&ray);
            if let Some(medium) = scene.medium(&media) {
                let t_max = found.as_ref().map_or(f32::INFINITY, |s| s.t);
                if medium.scatters() && depth < self.max_depth {
                    let scattered = volume::advance(scene, medium, &media, &ray, t_max, &mut through, false, stream, &mut rng, out);
                    if let Some(Scattered { t, wi, weight, vertex }) = scattered {
                        through *= weight;
                        ray = Ray::new(ray.at(t), wi);
                        depth += 1;
                        out.add(through * emitted_along(scene, &vertex.ctx, ray, vertex.pdf, media, &mut rng), 0);
                        if depth >= self.rr_depth {
                            let survive = through.max_component().min(0.95);
                            if stream.next_1d() >= survive {
                                return;
                            }
                            through /= survive;
                        }
                        continue;
                    }
                } else {
                    let crossing = medium.cross(&ray, t_max, &mut rng);
                    out.add(through * crossing.emitted, 0);
                    through *= crossing.transmittance;
                }
                if through.is_black() {
                    return;
                }
            }
            let Some(mut s) = found else { return };
            let wo = -ray.d;
            let material = &scene.materials[s.material as usize];
            let scatter = material.shade(scene, &s, wo);
            let straight = if material.has_null { scatter.null_transmittance(wo) } else { Spectrum::ZERO };
            if scene.has_media {
                media.cross(scene, &s, ray.d);
            }
            let o = s.offset_origin(ray.d);
            // Solutions are asked for the side that is seen.
            if s.ng.dot(wo) < 0.0 {
                s.ng = -s.ng;
                s.frame = Frame::from_normal(-s.frame.n);
            }
            let albedo = scatter.albedo(wo);
            if depth < self.max_depth && !albedo.is_black() {
                out.add(through * albedo * self.light.irradiance(scene, &s) * INV_PI, 0);
            }
            through *= straight;
            if through.is_black() {
                return;
            }
            ray = Ray::new(o, ray.d);
            crossings += 1;
        }
    }
}
