//! Radiosity: shows the solution of [`crate::radiosity`], as it is or through a final gather.
//!
//! Without gathering a picture shows the mesh: radiance = emission + ρ H / π with the interpolated irradiance H, ρ from the texture at
//! the point. With gathering (`--radiosity-gather N`) each camera sample looks N times along directions of the material there, takes
//! the light of lights by next-event estimation and all other from the solution where those rays end (the local pass of Lischinski,
//! Tampieri and Greenberg 1993, "Combining Hierarchical Radiosity and Discontinuity Meshing", doi:10.1145/166117.166143): errors of
//! the mesh blur away, shadows of lights are exact, and gloss shows. Perfect mirrors and glass in sight are followed either way.
//!
//! Not for caustics, nor where mirrors or gloss carry light between surfaces: the solution knows them as diffuse.

use etendue_scene::RenderSettings;

use super::light_sampling::{context, pdf_infinite, pdf_surface, sample_one, visibility};
use super::path::first_hit;
use super::{Estimate, Integrator, Stage};
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::lightmap::SurfaceLight;
use crate::material::Scatter;
use crate::math::warp::power_heuristic;
use crate::math::{INV_PI, Vec3};
use crate::radiosity::material::diffuse_reflectance;
use crate::radiosity::{self, Display, Progress, Solution};
use crate::sampler::SampleStream;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Mirrors and panes in sight that are followed.
const MAX_SPECULAR: u32 = 16;
/// Most rays of a gather.
const MAX_GATHER: u32 = 4096;

/// The integrator.
pub struct Radiosity {
    settings: radiosity::Settings,
    display: Display,
    gather: u32,
    solution: Option<Solution>,
}

impl Radiosity {
    /// From the user's settings.
    ///
    /// # Errors
    /// A sentence where a setting is not possible.
    pub fn new(s: &RenderSettings) -> Result<Self, String> {
        let display = match s.radiosity_display.as_deref() {
            None | Some("smooth") => Display::Smooth,
            Some("elements") => Display::Elements,
            Some("mesh") => Display::Mesh,
            Some(name) => return Err(format!("no radiosity display `{name}`; there are smooth, elements, mesh")),
        };
        let gather = s.radiosity_gather.unwrap_or(0);
        if gather > MAX_GATHER {
            return Err(format!("radiosity: at most {MAX_GATHER} rays of a gather, not {gather}; take more samples per pixel"));
        }
        Ok(Self { settings: radiosity::Settings::new(s)?, display, gather, solution: None })
    }
}

impl Integrator for Radiosity {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        scene.needs_triangles("radiosity")?;
        let settings = radiosity::Settings { seed: stage.seed, ..self.settings };
        self.solution = Some(radiosity::solve(scene, &settings, self.display, &Progress::new(stage))?);
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        self.solution.as_ref().map_or(Vec::new(), |s| s.notes.clone())
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let Some(solution) = &self.solution else { return };
        let mut ray = camera_ray.ray;
        let mut throughput = Spectrum::splat(camera_ray.weight);
        let mut distance = 0.0;
        for depth in 0..=MAX_SPECULAR {
            let is_hidden = depth == 0 && scene.hide_lights;
            let Some(s) = scene.intersect(&ray) else {
                if !is_hidden {
                    for &light in &scene.infinite_lights {
                        let radiance = scene.lights[light as usize].escaped(ray.o, ray.d);
                        out.add(throughput * radiance, scene.light_groups[light as usize]);
                    }
                }
                return;
            };
            let wo = -ray.d;
            distance += s.t;
            if let Some(emission) = &s.object(scene).emission
                && !is_hidden
            {
                out.add(throughput * scene.emitted(&s, wo), emission.group);
            }
            let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
            if depth == 0 {
                first_hit(scene, &s, wo, &scatter, distance, out);
            }
            let (u_lobe, u) = (stream.next_1d(), stream.next_2d());
            if scatter.is_smooth_anywhere() {
                if self.gather > 0 {
                    self.gather(scene, solution, &s, wo, &scatter, throughput, stream, out);
                } else {
                    out.add(throughput * reflected(scene, solution, &s, wo, &scatter), 0);
                }
            }
            // What is left are directions without width: straight on, mirrored, refracted. Coats over something diffuse are in its albedo.
            let Some(sample) = scatter.sample(wo, u_lobe, u, TransportMode::Radiance) else { return };
            let is_coat = self.gather == 0 && !sample.lobe.contains(Lobe::TRANSMISSION) && scatter.is_smooth_anywhere();
            if !sample.lobe.contains(Lobe::DELTA) || is_coat {
                return;
            }
            throughput *= sample.value / sample.pdf;
            if throughput.is_black() {
                return;
            }
            ray = Ray::new(s.offset_origin(sample.wi), sample.wi);
        }
    }
}

/// Radiance that a surface reflects diffusely, by the solution.
fn reflected(scene: &Scene, solution: &Solution, s: &Surface, wo: Vec3, scatter: &Scatter) -> Spectrum {
    let (rho, _) = diffuse_reflectance(scatter, wo);
    if rho.is_black() {
        return Spectrum::ZERO;
    }
    rho * irradiance_towards(scene, solution, s, wo) * INV_PI
}

/// Irradiance on the side of a surface that is seen from `wo`.
fn irradiance_towards(scene: &Scene, solution: &Solution, s: &Surface, wo: Vec3) -> Spectrum {
    if s.ng.dot(wo) * s.ng.dot(s.frame.n) >= 0.0 {
        return solution.irradiance(scene, s);
    }
    let mut back = s.clone();
    back.frame.n = -back.frame.n;
    solution.irradiance(scene, &back)
}

impl Radiosity {
    /// One look around: lights by next-event estimation and by the rays that meet them, weighted (Veach 1997, chapter 9), all other
    /// light by the solution.
    #[expect(clippy::too_many_arguments, reason = "private; the state of one camera sample")]
    fn gather(
        &self,
        scene: &Scene,
        solution: &Solution,
        s: &Surface,
        wo: Vec3,
        scatter: &Scatter,
        throughput: Spectrum,
        stream: &mut SampleStream,
        out: &mut Estimate,
    ) {
        let throughput = throughput / self.gather as f32;
        let ctx = context(s);
        let mut rng = stream.rng();
        for _ in 0..self.gather {
            if let Some(direct) = sample_one(scene, &ctx, stream) {
                let (f, bsdf_pdf) = scatter.eval_pdf(wo, direct.sample.wi, TransportMode::Radiance);
                if !f.is_black() {
                    let weight = if direct.sample.delta { 1.0 } else { power_heuristic(direct.pdf, bsdf_pdf) };
                    let visible = visibility(scene, s, wo, &scene.camera_medium, &direct.sample, &mut rng);
                    if !visible.is_black() {
                        out.add(throughput * f * direct.radiance * visible * (weight / direct.pdf), direct.group);
                    }
                }
            }
            let (u_lobe, u) = (stream.next_1d(), stream.next_2d());
            let Some(sample) = scatter.sample(wo, u_lobe, u, TransportMode::Radiance) else { continue };
            if sample.lobe.contains(Lobe::DELTA) {
                // Followed by the caller.
                continue;
            }
            let mut value = throughput * sample.value / sample.pdf;
            let mut ray = Ray::new(s.offset_origin(sample.wi), sample.wi);
            // Panes and holes on the way.
            for crossing in 0..MAX_SPECULAR {
                let Some(hit) = scene.intersect(&ray) else {
                    for &light in &scene.infinite_lights {
                        let weight = power_heuristic(sample.pdf, pdf_infinite(scene, &ctx, light, ray.d));
                        let radiance = scene.lights[light as usize].escaped(ctx.p, ray.d);
                        out.add(value * radiance * weight, scene.light_groups[light as usize]);
                    }
                    break;
                };
                if let Some(emission) = &hit.object(scene).emission {
                    let weight = match hit.light(scene) {
                        Some(light) => power_heuristic(sample.pdf, pdf_surface(scene, &ctx, light, &hit)),
                        None => 1.0,
                    };
                    out.add(value * scene.emitted(&hit, -ray.d) * weight, emission.group);
                }
                let there = scene.materials[hit.material as usize].shade(scene, &hit, -ray.d);
                out.add(value * reflected(scene, solution, &hit, -ray.d, &there), 0);
                let share = radiosity::material::passing_share(&there, -ray.d);
                if !(share > 0.0) || crossing + 1 == MAX_SPECULAR {
                    break;
                }
                value *= share;
                ray = Ray::new(hit.offset_origin(ray.d), ray.d);
            }
        }
    }
}
