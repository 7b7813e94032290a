//! Path tracing (Kajiya 1986, doi:10.1145/15922.15902) with next-event estimation, multiple importance sampling (Veach 1997,
//! chapter 9) and Russian roulette.
//!
//! Unbiased for everything that paths from the camera can find. It is slow on light that reaches diffuse surfaces through
//! small mirrors and refractors (caustics of small lights) and cannot see point lights through glass.
//!
//! Surfaces that let light straight through (masks, thin panes) do not end the search for lights: shadow rays cross them, and
//! a path that crosses one keeps the density of its last real scattering for the weights.
//!
//! Media scatter, absorb and emit along the way (`volume`): a scattering in a medium is an edge of the path as one at a surface is.

use arrayvec::ArrayVec;

use super::caustics::{Caustics, Place, Start};
use super::light_sampling::{context, pdf_infinite, pdf_surface, sample_one, visibility};
use super::volume::{self, Scattered, power_of_three};
use super::{Estimate, FirstHit, Integrator, Vertex};
use crate::accel::Ray;
use crate::bsdf::{Bsdf, Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::light::LightContext;
use crate::material::Scatter;
use crate::math::warp::power_heuristic;
use crate::math::{Vec3, fns};
use crate::medium::MediumStack;
use crate::sampler::{HashRng, SampleStream};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// A path that only ever crosses surfaces straight on ends after so many of them.
const MAX_CROSSINGS: u32 = 1024;

/// Numbers that a vertex draws for its direct light, and those for its scattering and roulette: none is made that is not used.
const DIRECT_NUMBERS: u32 = 3;
const SCATTER_NUMBERS: u32 = 4;

/// The path tracer.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    /// Longest path in scattering events: 0 shows lights only, 1 direct light.
    pub max_depth: u32,
    /// Scattering events after which Russian roulette may end a path.
    pub rr_depth: u32,
    /// Samples direct light along segments in homogeneous media by the angle from the light as well: less noise about small lights.
    pub equiangular: bool,
}

/// The cone of directions that a path's sample stands for, after Akenine-Möller et al. 2019 (Ray Tracing Gems ch. 20).
struct Cone {
    width: f32,
    spread: f32,
}

impl Cone {
    /// Goes along the ray; returns the footprint's width on a surface seen at a cosine. The shorter way across the ellipse and the
    /// longer one are averaged as areas.
    #[inline]
    fn advance(&mut self, distance: f32, cos: f32) -> f32 {
        self.width += self.spread * distance;
        self.width / cos.abs().max(0.05).sqrt()
    }

    /// Widens with the solid angle that a sampled direction stands for, 1 / pdf; a quarter of it, as neighboring samples share it.
    #[inline]
    fn scatter(&mut self, pdf: f32) {
        if pdf.is_finite() {
            self.spread = (self.spread + 0.25 / pdf.sqrt()).min(0.5);
        }
    }
}

impl Integrator for Path {
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        self.estimate_with(&(), scene, camera_ray, stream, out);
    }
}

impl Path {
    /// An estimate that leaves caustics to another method.
    pub(super) fn estimate_with<C: Caustics>(
        &self,
        caustics: &C,
        scene: &Scene,
        camera_ray: &CameraRay,
        stream: &mut SampleStream,
        out: &mut Estimate,
    ) {
        if scene.has_media {
            self.trace::<true, C>(scene, camera_ray, caustics, stream, out);
        } else {
            self.trace::<false, C>(scene, camera_ray, caustics, stream, out);
        }
    }

    /// Follows one path. `MEDIA`: whether there are any. Compiled apart, as for each kind of `caustics`, so that scenes without pay
    /// nothing for them.
    fn trace<const MEDIA: bool, C: Caustics>(
        &self,
        scene: &Scene,
        camera_ray: &CameraRay,
        caustics: &C,
        stream: &mut SampleStream,
        out: &mut Estimate,
    ) {
        let mut ray = camera_ray.ray;
        let mut throughput = Spectrum::splat(camera_ray.weight);
        let mut last = Vertex { ctx: LightContext { p: ray.o, n: Vec3::ZERO }, pdf: f32::INFINITY, on_segment: None };
        let (mut depth, mut crossings) = (0, 0);
        // Product of squared relative indices: radiance is denser inside glass, which is no reason for roulette to spare the path.
        let mut eta_scale = 1.0f32;
        let mut media = if MEDIA { scene.camera_medium } else { MediumStack::VACUUM };
        let mut rng = if MEDIA { stream.rng() } else { HashRng::default() };
        let mut trail = caustics.start(stream);
        let mut camera_distance = 0.0;
        let mut cone = Cone { width: 0.0, spread: camera_ray.spread_rad };
        let mut scatter = Scatter { parts: ArrayVec::new_const() };
        loop {
            let found = scene.intersect(&ray);
            if MEDIA && let Some(medium) = scene.medium(&media) {
                let t_max = found.as_ref().map_or(f32::INFINITY, |s| s.t);
                if !medium.scatters() || depth >= self.max_depth {
                    let crossing = medium.cross(&ray, t_max, &mut rng);
                    out.add(throughput * crossing.emitted, 0);
                    throughput *= crossing.transmittance;
                } else {
                    let equiangular = self.equiangular;
                    let scattered =
                        volume::advance(scene, medium, &media, &ray, t_max, &mut throughput, equiangular, stream, &mut rng, out);
                    if let Some(Scattered { t, wi, weight, vertex }) = scattered {
                        if depth == 0 {
                            out.alpha = 1.0;
                            if let Some(s) = &found {
                                behind_medium(scene, s, -ray.d, camera_distance + s.t, out);
                            }
                        }
                        if C::ON {
                            let start = Start { place: Place::Medium(ray.at(t), medium.phase()), wo: -ray.d, media: &media };
                            caustics.add(scene, &start, throughput, [depth, self.max_depth], &mut trail, out);
                            caustics.scattered_in_medium(&mut trail, ray.at(t));
                        }
                        throughput *= weight;
                        ray = Ray::new(ray.at(t), wi);
                        cone.advance(t, 1.0);
                        cone.scatter(vertex.pdf);
                        last = vertex;
                        depth += 1;
                        if !self.survives(depth, &mut throughput, eta_scale, &mut stream.part(1)) {
                            return;
                        }
                        continue;
                    }
                }
                if throughput.is_black() {
                    return;
                }
            }
            let Some(mut s) = found else {
                add_infinite(scene, ray.d, throughput, &last, depth, |light| caustics.found(scene, &trail, light), out);
                return;
            };
            let wo = -ray.d;
            if scene.mipmap {
                s.footprint = cone.advance(s.t, s.ng.dot(wo));
            }
            if !(C::ON && s.light(scene).is_some_and(|light| caustics.found(scene, &trail, light))) {
                add_emission(scene, &s, wo, throughput, &last, depth, out);
            }
            scene.materials[s.material as usize].shade_into(scene, &s, wo, &mut scatter);
            if depth == 0 {
                camera_distance += s.t;
                first_hit(scene, &s, wo, &scatter, camera_distance, out);
            }
            // The last scattering is done, but its ray may still go straight on to a light: shadow rays may as well.
            let last_edge = depth >= self.max_depth;
            if last_edge && !scene.has_null {
                return;
            }
            let ctx = context(&s);
            let mut numbers = stream.part(DIRECT_NUMBERS);
            if !last_edge
                && scatter.is_smooth_anywhere()
                && let Some(direct) = sample_one(scene, &ctx, &mut numbers)
                && !(C::ON && caustics.finds_direct(&trail, &scatter, direct.light))
            {
                let (f, bsdf_pdf) = scatter.eval_pdf(wo, direct.sample.wi, TransportMode::Radiance);
                if !f.is_black() {
                    let weight = if direct.sample.delta { 1.0 } else { power_heuristic(direct.pdf, bsdf_pdf) };
                    let unshadowed = throughput * f * direct.radiance * (weight / direct.pdf);
                    let visible = visibility(scene, &s, wo, &media, &direct.sample, &mut rng);
                    if !visible.is_black() {
                        out.add(unshadowed * visible, direct.group);
                    }
                }
            }
            if C::ON && !last_edge && scatter.is_smooth_anywhere() {
                let start = Start { place: Place::Surface(&s, &scatter), wo, media: &media };
                caustics.add(scene, &start, throughput, [depth, self.max_depth], &mut trail, out);
            }
            let mut numbers = stream.part(SCATTER_NUMBERS);
            let u_lobe = if scatter.needs_lobe() { numbers.next_1d() } else { numbers.skip_1d() };
            let u = numbers.next_2d();
            let Some(sample) = scatter.sample(wo, u_lobe, u, TransportMode::Radiance) else { return };
            throughput *= sample.value / sample.pdf;
            if throughput.is_black() {
                return;
            }
            let o = s.offset_origin(sample.wi);
            ray = Ray::new(o, sample.wi);
            if C::ON && !sample.lobe.contains(Lobe::NULL) {
                caustics.scattered(&mut trail, &s, &scatter, &sample);
            }
            if MEDIA && sample.lobe.contains(Lobe::TRANSMISSION) {
                media.cross(scene, &s, sample.wi);
            }
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
            let pdf = if sample.lobe.contains(Lobe::DELTA) { f32::INFINITY } else { sample.pdf };
            cone.scatter(pdf);
            last = Vertex { ctx, pdf, on_segment: None };
            if !self.survives(depth, &mut throughput, eta_scale, &mut numbers) {
                return;
            }
        }
    }

    /// Russian roulette: whether the path goes on, with a throughput that makes up for those that do not. Paths that still carry half of
    /// what they began with are spared: on the scenes of `bench/efficiency.py` the noise of ending them costs more than following them.
    #[inline]
    fn survives(&self, depth: u32, throughput: &mut Spectrum, eta_scale: f32, numbers: &mut SampleStream) -> bool {
        if depth >= self.rr_depth {
            let survive = (2.0 * throughput.max_component() * eta_scale).min(0.99);
            if numbers.next_1d() >= survive {
                return false;
            }
            *throughput /= survive;
        }
        true
    }
}

/// Records the surface behind a medium that has scattered what the camera sees, where the ray meets one at once.
#[cold]
fn behind_medium(scene: &Scene, s: &Surface, wo: Vec3, depth: f32, out: &mut Estimate) {
    if out.first.is_none() {
        first_hit(scene, s, wo, &scene.materials[s.material as usize].shade(scene, s, wo), depth, out);
    }
}

/// Light that the surface itself sends back along the ray.
#[inline(always)]
fn add_emission(scene: &Scene, s: &Surface, wo: Vec3, throughput: Spectrum, last: &Vertex, depth: u32, out: &mut Estimate) {
    let Some(emission) = &s.object(scene).emission else { return };
    if depth == 0 && scene.hides(s) {
        return;
    }
    let radiance = scene.emitted(s, wo);
    if radiance.is_black() {
        return;
    }
    let weight = match s.light(scene) {
        Some(light) if last.pdf.is_finite() => {
            let by_light = pdf_surface(scene, &last.ctx, light, s);
            match &last.on_segment {
                None => power_heuristic(last.pdf, by_light),
                Some(on) => {
                    let pdf_light = scene.lights[light as usize].pdf_hit(&last.ctx, s.p, s.ng);
                    power_of_three(last.pdf, by_light, on.relative_pdf(scene, light, pdf_light))
                }
            }
        }
        _ => 1.0,
    };
    out.add(throughput * radiance * weight, emission.group);
}

/// Light from beyond the scene, but for lights that are `found` in another way.
#[inline]
fn add_infinite(scene: &Scene, d: Vec3, throughput: Spectrum, last: &Vertex, depth: u32, found: impl Fn(u32) -> bool, out: &mut Estimate) {
    if depth == 0 && scene.hide_lights {
        return;
    }
    for &light in &scene.infinite_lights {
        let radiance = scene.lights[light as usize].escaped(d);
        if !radiance.is_black() && !found(light) {
            let weight = if last.pdf.is_finite() { power_heuristic(last.pdf, pdf_infinite(scene, &last.ctx, light, d)) } else { 1.0 };
            out.add(throughput * radiance * weight, scene.light_groups[light as usize]);
        }
    }
}

/// Records what the camera sees, once: behind surfaces that are not there at all, but not behind panes.
pub(super) fn first_hit(scene: &Scene, s: &Surface, wo: Vec3, scatter: &Scatter, depth: f32, out: &mut Estimate) {
    let nothing = || !scatter.parts.is_empty() && scatter.parts.iter().all(|p| matches!(p.bsdf, Bsdf::Null(_)));
    if out.first.is_some() || nothing() {
        return;
    }
    out.alpha = 1.0;
    let ns = s.frame.n;
    out.first = Some(FirstHit {
        p: s.p,
        ns: if ns.dot(wo) < 0.0 { -ns } else { ns },
        uv: s.uv,
        depth,
        albedo: scatter.albedo(wo),
        object: s.object(scene).id,
        material: s.material + 1,
    });
}
