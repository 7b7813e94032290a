//! Walks through the scene from the camera and from the lights.

use std::borrow::Cow;

use super::mis::Joint;
use super::{Bidirectional, Numbers};
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::integrator::emission::Emission;
use crate::integrator::light_sampling::context;
use crate::light::{Light, LightContext};
use crate::material::Scatter;
use crate::math::{Vec3, fns};
use crate::scene::geometry::NONE;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// A walk that only ever crosses surfaces straight on ends after so many of them.
const MAX_CROSSINGS: u32 = 1024;
/// The walk's start as a vertex's `previous`.
pub const START: u32 = u32::MAX;

/// A surface point of a walk.
#[derive(Clone, Debug)]
pub struct Vertex {
    /// The point.
    pub surface: Surface,
    /// Scattering as seen from `wo`.
    pub scatter: Scatter,
    /// To where the walk has come from, unit.
    pub wo: Vec3,
    /// What the walk carries when it arrives.
    pub beta: Spectrum,
    /// Medium on the side of `wo`.
    pub medium: u32,
    /// The vertex before it that scattered, or [`START`].
    pub previous: u32,
    /// Number of edges from the start.
    pub depth: u32,
    /// Density by area of this walk.
    pub own: f32,
    /// Density by area of the other walk, given that this one went on as it did.
    pub other: f32,
    /// From densities per solid angle of directions to the previous vertex to its densities by area.
    pub to_previous: f32,
    /// Whether this walk went on by a delta lobe.
    pub delta: bool,
    /// Of the first vertices of a light's walk: density of the light's point if a light is sampled for the vertex.
    pub nee: f32,
}

/// Where a walk from a light has started.
#[derive(Clone, Copy, Debug)]
pub struct LightStart {
    /// The light's group.
    pub group: u32,
    /// Its joint: `light` is the density of emission, `camera` that of being met.
    pub joint: Joint,
    /// No path meets it by chance.
    pub delta: bool,
}

/// Where a walk from the camera has left the scene.
#[derive(Clone, Copy, Debug)]
pub struct Escape {
    /// Direction, unit.
    pub d: Vec3,
    /// What it carries.
    pub beta: Spectrum,
    /// Density of the direction per solid angle at the last vertex that scattered.
    pub pdf: f32,
    /// That vertex, or [`START`].
    pub previous: u32,
}

/// A walk.
#[derive(Clone, Debug, Default)]
pub struct Walk {
    /// Its surface points.
    pub vertices: Vec<Vertex>,
    /// Density with which the other walk makes the start, once the walk has gone on from its first vertex.
    pub start_other: f32,
}

/// The first edge of a walk.
#[derive(Clone, Copy)]
enum FirstEdge {
    /// Density per area across the ray is that of the camera over the number of pixels.
    Camera { pixels: f32 },
    /// Light from a place of finite distance: density of the direction, and the cosine at the light (1 for points).
    Light { pdf: f32, cos: f32 },
    /// Parallel light: density across the ray.
    Parallel { pdf: f32 },
}

impl Vertex {
    /// Scattering as seen from the direction `w`: that of `wo` where the material and its normals do not make a difference.
    #[inline]
    pub fn scatter_from(&self, scene: &Scene, w: Vec3) -> Cow<'_, Scatter> {
        let s = &self.surface;
        let material = &scene.materials[s.material as usize];
        let (n, ng) = (s.frame.n, s.ng);
        let side = |w: Vec3| (n.dot(w) > 0.0, ng.dot(w) > 0.0);
        let (a, b) = (side(self.wo), side(w));
        if !material.wants_tangents && a == b && a.0 == a.1 {
            Cow::Borrowed(&self.scatter)
        } else {
            Cow::Owned(material.shade(scene, s, w))
        }
    }

    /// For a vertex of a walk from a light: what light that came along `wo` sends along `w`, |cos| of `w` to the surface included;
    /// and the density with which a walk that comes from `w` goes on along `wo`. Evaluated from the camera's side.
    #[inline]
    pub fn eval_light(&self, scene: &Scene, w: Vec3) -> (Spectrum, f32) {
        let (value, pdf) = self.scatter_from(scene, w).eval_pdf(w, self.wo, TransportMode::Radiance);
        let cos = self.surface.ng.dot(self.wo).abs();
        let factor = self.surface.ng.dot(w).abs() / cos;
        (if factor.is_finite() { value * factor } else { Spectrum::ZERO }, pdf)
    }

    /// The density with which a walk that comes from `w` goes on along `wo`.
    #[inline]
    pub fn pdf_back(&self, scene: &Scene, w: Vec3, mode: TransportMode) -> f32 {
        self.scatter_from(scene, w).eval_pdf(w, self.wo, mode).1
    }
}

impl Walk {
    /// Empties the walk for the next.
    pub fn clear(&mut self) {
        self.vertices.clear();
        self.start_other = 0.0;
    }

    /// Edges from the start to a vertex, or to the start.
    #[inline]
    pub fn depth_of(&self, vertex: u32) -> u32 {
        self.vertices.get(vertex as usize).map_or(0, |v| v.depth)
    }

    /// The vertex before another one; `None`: the start.
    #[inline]
    pub fn previous(&self, v: &Vertex) -> Option<&Vertex> {
        self.vertices.get(v.previous as usize)
    }
}

impl Bidirectional {
    /// Walks from the camera, `longest` edges at most.
    pub(in crate::integrator) fn walk_camera(
        &self,
        scene: &Scene,
        camera_ray: &CameraRay,
        longest: u32,
        numbers: &mut impl Numbers,
        walk: &mut Walk,
    ) -> Option<Escape> {
        walk.clear();
        let edge = FirstEdge::Camera { pixels: scene.camera.pixels() };
        self.walk(scene, camera_ray.ray, Spectrum::splat(camera_ray.weight), edge, longest, numbers, walk)
    }

    /// Walks from a light, `longest` edges at most; `None` where none was emitted.
    pub(in crate::integrator) fn walk_light(
        &self,
        scene: &Scene,
        longest: u32,
        numbers: &mut impl Numbers,
        walk: &mut Walk,
    ) -> Option<LightStart> {
        walk.clear();
        let sampler = self.emission.as_ref()?;
        let (u_light, u_position, u_direction) = (numbers.next_1d(), numbers.next_2d(), numbers.next_2d());
        let emission = sampler.sample(scene, u_light, u_position, u_direction)?;
        let light = &scene.lights[emission.light as usize];
        let has_surface = matches!(light, Light::Area(_));
        let edge = if light.is_infinite() {
            FirstEdge::Parallel { pdf: emission.pdf_position }
        } else {
            FirstEdge::Light { pdf: emission.pdf_direction, cos: if has_surface { emission.cos } else { 1.0 } }
        };
        let own = emission.pmf * if light.is_infinite() { emission.pdf_direction } else { emission.pdf_position };
        self.walk(scene, emission.ray, emission.power(), edge, longest, numbers, walk);
        // Several, where surfaces let the light through.
        for v in walk.vertices.iter_mut().filter(|v| v.previous == START) {
            v.nee = nee_density(scene, &emission, v);
        }
        Some(LightStart {
            group: emission.group,
            joint: Joint { light: own, camera: walk.start_other, connectible: true },
            delta: light.is_delta(),
        })
    }

    /// Goes on until nothing is met, nothing scattered, `longest` edges are made or roulette ends it.
    #[expect(clippy::too_many_arguments, reason = "private; called by the two above")]
    fn walk(
        &self,
        scene: &Scene,
        mut ray: Ray,
        mut beta: Spectrum,
        first: FirstEdge,
        longest: u32,
        numbers: &mut impl Numbers,
        walk: &mut Walk,
    ) -> Option<Escape> {
        let is_camera = matches!(first, FirstEdge::Camera { .. });
        let first_beta = beta.max_component();
        let (mut previous, mut depth, mut crossings) = (START, 0, 0);
        // The last edge's start, with its normal, and the density of its direction.
        let (mut from, mut from_ng, mut pdf) = (ray.o, Vec3::ZERO, f32::INFINITY);
        let mut eta_scale = 1.0f32;
        let mut medium = NONE;
        loop {
            let Some(surface) = scene.intersect(&ray) else {
                return Some(Escape { d: ray.d, beta, pdf, previous });
            };
            if medium != NONE {
                beta *= scene.media[medium as usize].transmittance(surface.t);
            }
            let wo = -ray.d;
            let cos = surface.ng.dot(wo).abs();
            let distance_2 = (surface.p - from).length_squared();
            let (own, to_previous) = if previous == START {
                match first {
                    FirstEdge::Camera { pixels } => (scene.camera.per_area(ray.d, (surface.p - from).dot(ray.d)) / pixels * cos, 0.0),
                    FirstEdge::Light { pdf, cos: at_light } => (pdf * cos / distance_2, at_light / distance_2),
                    FirstEdge::Parallel { pdf } => (pdf * cos, 1.0),
                }
            } else {
                (pdf * cos / distance_2, from_ng.dot(wo).abs() / distance_2)
            };
            let scatter = scene.materials[surface.material as usize].shade(scene, &surface, wo);
            let (u_lobe, u, u_roulette) = (numbers.next_1d(), numbers.next_2d(), numbers.next_1d());
            let index = walk.vertices.len() as u32;
            let vertex =
                Vertex { surface, scatter, wo, beta, medium, previous, depth: depth + 1, own, other: 0.0, to_previous, delta: false, nee: 0.0 };
            walk.vertices.push(vertex);
            let v = &walk.vertices[index as usize];
            let is_last = depth + 1 >= longest;
            // What cannot be made by the other walk or weighed is not followed.
            if (is_last && !scene.has_null) || !(own > 0.0 && own.is_finite() && to_previous.is_finite()) {
                return None;
            }
            let mut sample = if is_camera {
                v.scatter.sample(wo, u_lobe, u, TransportMode::Radiance)?
            } else {
                v.scatter.sample_particle(v.surface.ng, wo, u_lobe, u)?
            };
            let origin = v.surface.offset_origin(sample.wi);
            let next_medium =
                if sample.lobe.contains(Lobe::TRANSMISSION) { v.surface.medium_beyond(scene, sample.wi, medium) } else { medium };
            if sample.lobe.contains(Lobe::NULL) {
                crossings += 1;
                beta *= sample.value / sample.pdf;
                if crossings > MAX_CROSSINGS || beta.is_black() {
                    return None;
                }
                (ray, medium) = (Ray::new(origin, sample.wi), next_medium);
                continue;
            }
            if is_last {
                return None;
            }
            let delta = sample.lobe.contains(Lobe::DELTA);
            let back = if delta {
                // The other walk chooses this lobe as often.
                sample.pdf
            } else if is_camera {
                v.pdf_back(scene, sample.wi, TransportMode::Importance)
            } else {
                let (value, pdf) = v.eval_light(scene, sample.wi);
                sample.value = value;
                pdf
            };
            (from, from_ng) = (v.surface.p, v.surface.ng);
            match walk.vertices.get_mut(previous as usize) {
                Some(before) => before.other = back * to_previous,
                None => walk.start_other = back * to_previous,
            }
            walk.vertices[index as usize].delta = delta;
            beta *= sample.value / sample.pdf;
            if beta.is_black() {
                return None;
            }
            (previous, depth, pdf, medium) = (index, depth + 1, sample.pdf, next_medium);
            ray = Ray::new(origin, sample.wi);
            eta_scale *= fns::sqr(sample.eta);
            if depth >= self.rr_depth {
                let kept = if is_camera { beta.max_component() * eta_scale } else { beta.max_component() / first_beta };
                let survive = kept.min(0.95);
                if !(u_roulette < survive) {
                    return None;
                }
                beta /= survive;
            }
        }
    }
}

/// The density with which light sampling at the first vertex of a walk makes the light's point (by area; for infinite lights per
/// solid angle).
fn nee_density(scene: &Scene, emission: &Emission, v: &Vertex) -> f32 {
    let ctx = context(&v.surface);
    let light = &scene.lights[emission.light as usize];
    let pmf = scene.light_sampler.pmf(&ctx, emission.light);
    if pmf <= 0.0 {
        return 0.0;
    }
    pmf * light_density(light, &ctx, emission.p, emission.n, v.wo) * v.to_previous_for(light)
}

impl Vertex {
    /// The factor from densities per solid angle of the direction to a light to those of its joint.
    #[inline]
    fn to_previous_for(&self, light: &Light) -> f32 {
        if matches!(light, Light::Area(_)) { self.to_previous } else { 1.0 }
    }
}

/// The density per solid angle with which a light, once chosen, is sampled in the direction `w` from `ctx`; 1 for delta lights.
#[inline]
pub fn light_density(light: &Light, ctx: &LightContext, p: Vec3, n: Vec3, w: Vec3) -> f32 {
    match light {
        Light::Area(area) => area.pdf(ctx, p, n),
        Light::Point(_) | Light::Spot(_) | Light::Directional(_) => 1.0,
        infinite => infinite.pdf_escaped(ctx, w),
    }
}
