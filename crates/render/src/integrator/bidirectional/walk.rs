//! Walks through the scene from the camera and from the lights.

use std::borrow::Cow;

use super::mis::Joint;
use super::{Bidirectional, Numbers};
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::integrator::emission::Emission;
use crate::integrator::light_sampling::{context, visibility, visibility_in_medium};
use crate::light::{Light, LightContext, LightSample};
use crate::material::Scatter;
use crate::math::{Vec3, fns, warp::UNIFORM_SPHERE_PDF};
use crate::medium::MediumStack;
use crate::sampler::HashRng;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// A walk that only ever crosses surfaces straight on ends after so many of them.
const MAX_CROSSINGS: u32 = 1024;
/// The walk's start as a vertex's `previous`.
pub const START: u32 = u32::MAX;

/// What a vertex lies on.
#[derive(Clone, Debug)]
pub enum Place {
    /// On a surface, with its scattering as seen from where the walk has come from.
    Surface(Box<Surface>, Box<Scatter>),
    /// In a medium.
    Medium(u32),
}

/// A point of a walk where light is scattered.
#[derive(Clone, Debug)]
pub struct Vertex {
    /// The point.
    pub p: Vec3,
    /// What it lies on.
    pub place: Place,
    /// To where the walk has come from, unit.
    pub wo: Vec3,
    /// What the walk carries when it arrives.
    pub beta: Spectrum,
    /// Media on the side of `wo`.
    pub media: MediumStack,
    /// The vertex before it that scattered, or [`START`].
    pub previous: u32,
    /// Number of edges from the start.
    pub depth: u32,
    /// Density by area of this walk; in media by volume, without the extinction there.
    pub own: f32,
    /// That of the other walk, given that this one went on as it did.
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
    /// Where it was last scattered, or the camera.
    pub from: Vec3,
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
    /// Its points.
    pub vertices: Vec<Vertex>,
    /// Light that media send along the edges of a camera's walk, with the number of edges before.
    pub emitted: Vec<(u32, Spectrum)>,
    /// Density with which the other walk makes the start, once the walk has gone on from its first vertex.
    pub start_other: f32,
}

/// The first edge of a walk.
#[derive(Clone, Copy)]
enum FirstEdge {
    /// Density per area across the ray is that of the camera over the number of pixels.
    Camera { pixels: f32 },
    /// Light from a place of finite distance: density of the direction, and the cosine at the light (1 for points).
    Light { pdf: f32, cos: f32, is_delta: bool },
    /// Parallel light: density across the ray.
    Parallel { pdf: f32, is_delta: bool },
}

impl Vertex {
    /// The surface, where it is one.
    #[inline]
    pub fn surface(&self) -> Option<&Surface> {
        match &self.place {
            Place::Surface(s, _) => Some(s),
            Place::Medium(_) => None,
        }
    }

    /// Whether a medium scatters there.
    #[inline]
    pub fn in_medium(&self) -> bool {
        self.surface().is_none()
    }

    /// |cos| of a direction to the geometric normal; 1 in media.
    #[inline]
    pub fn cos(&self, w: Vec3) -> f32 {
        match &self.place {
            Place::Surface(s, _) => s.ng.dot(w).abs(),
            Place::Medium(_) => 1.0,
        }
    }

    /// For light sampling.
    #[inline]
    pub fn context(&self) -> LightContext {
        match &self.place {
            Place::Surface(s, _) => context(s),
            Place::Medium(_) => LightContext { p: self.p, n: Vec3::ZERO },
        }
    }

    /// Whether anything but delta lobes scatters.
    #[inline]
    pub fn is_smooth_anywhere(&self) -> bool {
        match &self.place {
            Place::Surface(_, scatter) => scatter.is_smooth_anywhere(),
            Place::Medium(_) => true,
        }
    }

    /// Where rays along `w` start.
    #[inline]
    pub fn origin(&self, w: Vec3) -> Vec3 {
        match &self.place {
            Place::Surface(s, _) => s.offset_origin(w),
            Place::Medium(_) => self.p,
        }
    }

    /// What scatters light that comes along `w` (which points away) to where the walk has come from, |cos| of `w` to a surface's shading
    /// normal included, and the density with which the walk goes on along `w`. For walks from the camera.
    #[inline]
    pub fn eval(&self, scene: &Scene, w: Vec3) -> (Spectrum, f32) {
        match &self.place {
            Place::Surface(_, scatter) => scatter.eval_pdf(self.wo, w, TransportMode::Radiance),
            Place::Medium(_) => self.phase(scene, w),
        }
    }

    /// The density with which a walk from a light goes on along `w`.
    #[inline]
    pub fn pdf_light(&self, scene: &Scene, w: Vec3) -> f32 {
        match &self.place {
            Place::Surface(_, scatter) => scatter.eval_pdf(self.wo, w, TransportMode::Importance).1,
            Place::Medium(_) => self.phase(scene, w).1,
        }
    }

    #[inline]
    fn phase(&self, scene: &Scene, w: Vec3) -> (Spectrum, f32) {
        let Place::Medium(medium) = self.place else { return (Spectrum::ZERO, 0.0) };
        let value = scene.media.get(medium as usize).map_or(0.0, |m| m.phase().eval(self.wo, w));
        (Spectrum::splat(value), value)
    }

    /// Scattering as seen from the direction `w`: that of `wo` where the material and its normals do not make a difference.
    #[inline]
    fn scatter_from<'a>(&self, scene: &Scene, s: &Surface, scatter: &'a Scatter, w: Vec3) -> Cow<'a, Scatter> {
        let material = &scene.materials[s.material as usize];
        let (n, ng) = (s.frame.n, s.ng);
        let side = |w: Vec3| (n.dot(w) > 0.0, ng.dot(w) > 0.0);
        let (a, b) = (side(self.wo), side(w));
        if !material.wants_tangents && s.solid.is_none() && a == b && a.0 == a.1 {
            Cow::Borrowed(scatter)
        } else {
            Cow::Owned(material.shade(scene, s, w))
        }
    }

    /// For walks from a light: what light that came along `wo` sends along `w`, |cos| of `w` to a surface included; and the density with
    /// which a walk that comes from `w` goes on along `wo`. Evaluated from the camera's side.
    #[inline]
    pub fn eval_light(&self, scene: &Scene, w: Vec3) -> (Spectrum, f32) {
        let Place::Surface(s, scatter) = &self.place else { return self.phase(scene, w) };
        let (value, pdf) = self.scatter_from(scene, s, scatter, w).eval_pdf(w, self.wo, TransportMode::Radiance);
        let factor = s.ng.dot(w).abs() / s.ng.dot(self.wo).abs();
        (if factor.is_finite() { value * factor } else { Spectrum::ZERO }, pdf)
    }

    /// For walks from the camera: the density with which a walk from a light that comes from `w` goes on along `wo`.
    #[inline]
    pub fn pdf_back(&self, scene: &Scene, w: Vec3) -> f32 {
        let Place::Surface(s, scatter) = &self.place else { return self.phase(scene, w).1 };
        self.scatter_from(scene, s, scatter, w).eval_pdf(w, self.wo, TransportMode::Importance).1
    }

    /// The share of light that passes between the point and another one.
    #[inline]
    pub fn visibility(&self, scene: &Scene, sample: &LightSample, rng: &mut HashRng) -> Spectrum {
        match &self.place {
            Place::Surface(s, _) => visibility(scene, s, self.wo, &self.media, sample, rng),
            Place::Medium(_) => visibility_in_medium(scene, self.p, &self.media, sample, rng),
        }
    }
}

impl Walk {
    /// Empties the walk for the next.
    pub fn clear(&mut self) {
        self.vertices.clear();
        self.emitted.clear();
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
        self.walk(scene, camera_ray.ray, Spectrum::splat(camera_ray.weight), edge, scene.camera_medium, longest, numbers, walk)
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
        let (mut u_light, u_position, u_direction) = (numbers.next_1d(), numbers.next_2d(), numbers.next_2d());
        let mut rng = if scene.has_media { numbers.rng() } else { HashRng::default() };
        if let Some(start) = sampler.sample_medium(scene, &mut u_light, (u_position, u_direction), &mut rng) {
            let start = start?;
            let edge = FirstEdge::Light { pdf: UNIFORM_SPHERE_PDF, cos: 1.0, is_delta: false };
            self.walk(scene, start.ray, start.power, edge, start.media, longest, numbers, walk);
            // Only methods without other ways to make the path come here: densities do not matter.
            let joint = Joint { light: 1.0, camera: walk.start_other, connectible: true, in_medium: true };
            return Some(LightStart { group: 0, joint, delta: false });
        }
        let emission = sampler.sample(scene, u_light, u_position, u_direction)?;
        let light = &scene.lights[emission.light as usize];
        let has_surface = matches!(light, Light::Area(_));
        let edge = if light.is_infinite() {
            FirstEdge::Parallel { pdf: emission.pdf_position, is_delta: light.is_delta() }
        } else {
            let cos = if has_surface { emission.cos } else { 1.0 };
            FirstEdge::Light { pdf: emission.pdf_direction, cos, is_delta: light.is_delta() }
        };
        let own = emission.pmf * if light.is_infinite() { emission.pdf_direction } else { emission.pdf_position };
        let media = sampler.media(emission.light);
        let mut power = emission.power();
        if let Some(medium) = scene.medium(&media).filter(|_| light.is_infinite() && !matches!(light, Light::Portal(_))) {
            // What fills the space without end lets nothing in from there.
            let behind = Ray::new(emission.p, -emission.ray.d);
            power *= medium.transmittance(&behind, f32::INFINITY, &mut numbers.rng());
            if power.is_black() {
                return None;
            }
        }
        self.walk(scene, emission.ray, power, edge, media, longest, numbers, walk);
        // Several, where surfaces let the light through.
        for v in walk.vertices.iter_mut().filter(|v| v.previous == START) {
            v.nee = nee_density(scene, &emission, v);
        }
        Some(LightStart {
            group: emission.group,
            joint: Joint { light: own, camera: walk.start_other, connectible: true, in_medium: false },
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
        mut media: MediumStack,
        longest: u32,
        numbers: &mut impl Numbers,
        walk: &mut Walk,
    ) -> Option<Escape> {
        let is_camera = matches!(first, FirstEdge::Camera { .. });
        let passes_solids =
            scene.solids.is_some() && matches!(first, FirstEdge::Light { is_delta: true, .. } | FirstEdge::Parallel { is_delta: true, .. });
        let first_beta = beta.max_component();
        let (mut previous, mut depth, mut crossings) = (START, 0, 0);
        // The last edge's start and the density of its direction.
        let (mut from, mut pdf) = (ray.o, f32::INFINITY);
        let mut eta_scale = 1.0f32;
        let mut rng = if scene.has_media { numbers.rng() } else { HashRng::default() };
        loop {
            let found = scene.intersect(&ray);
            let is_last = depth + 1 >= longest;
            let mut scattered = None;
            if let Some(medium) = scene.medium(&media) {
                let t_max = found.as_ref().map_or(f32::INFINITY, |s| s.t);
                // Light from media themselves is met by the camera's walk alone.
                if !medium.scatters() || depth >= self.max_depth {
                    let crossing = medium.cross(&ray, t_max, &mut rng);
                    walk.emitted.push((depth, beta * crossing.emitted));
                    beta *= crossing.transmittance;
                } else {
                    let flight = medium.sample_flight(&ray, t_max, beta, numbers.next_1d(), &mut rng);
                    walk.emitted.push((depth, beta * flight.emitted));
                    beta *= flight.weight;
                    scattered = flight.scattered_at.map(|t| (t, medium));
                }
                if beta.is_black() {
                    return None;
                }
            }
            if passes_solids
                && previous == START
                && scattered.is_none()
                && let Some(s) = found.as_ref().filter(|s| scene.casts_no_shadow(&ray, s))
            {
                // What casts no shadow is lit, and so is what lies behind it: half of the walks stand for either. The weights of all
                // techniques leave this out alike.
                beta *= 2.0;
                if numbers.next_1d() < 0.5 {
                    crossings += 1;
                    if crossings > MAX_CROSSINGS || !beta.is_finite() {
                        return None;
                    }
                    ray = Ray::new(s.offset_origin(ray.d), ray.d);
                    continue;
                }
            }
            let p = match (&scattered, &found) {
                (Some((t, _)), _) => ray.at(*t),
                (None, Some(s)) => s.p,
                (None, None) => return Some(Escape { d: ray.d, from, beta, pdf, previous }),
            };
            let wo = -ray.d;
            let place = match (&scattered, found) {
                (None, Some(surface)) => {
                    let scatter = scene.materials[surface.material as usize].shade(scene, &surface, wo);
                    Place::Surface(Box::new(surface), Box::new(scatter))
                }
                _ => Place::Medium(media.top()),
            };
            let mut vertex = Vertex {
                p,
                place,
                wo,
                beta,
                media,
                previous,
                depth: depth + 1,
                own: 0.0,
                other: 0.0,
                to_previous: 0.0,
                delta: false,
                nee: 0.0,
            };
            let cos = vertex.cos(wo);
            let distance_2 = (p - from).length_squared();
            let (own, to_previous) = match first {
                _ if previous != START => {
                    let at_start = walk.vertices.get(previous as usize).map_or(0.0, |v| v.cos(wo));
                    (pdf * cos / distance_2, at_start / distance_2)
                }
                FirstEdge::Camera { pixels } => (scene.camera.per_area(ray.d, (p - from).dot(ray.d)) / pixels * cos, 0.0),
                FirstEdge::Light { pdf, cos: at_light, .. } => (pdf * cos / distance_2, at_light / distance_2),
                FirstEdge::Parallel { pdf, .. } => (pdf * cos, 1.0),
            };
            (vertex.own, vertex.to_previous) = (own, to_previous);
            let (u_lobe, u, u_roulette) = (numbers.next_1d(), numbers.next_2d(), numbers.next_1d());
            let index = walk.vertices.len() as u32;
            walk.vertices.push(vertex);
            let v = &walk.vertices[index as usize];
            // What cannot be made by the other walk or weighed is not followed.
            if (is_last && !scene.has_null) || !(own > 0.0 && own.is_finite() && to_previous.is_finite()) {
                return None;
            }
            let (mut value, wi, density, lobe, eta) = match &v.place {
                Place::Medium(_) => {
                    if is_last {
                        return None;
                    }
                    let (_, medium) = scattered?;
                    let sample = medium.phase().sample(wo, u);
                    let value = Spectrum::splat(sample.weight * sample.pdf);
                    (value, sample.wi, sample.pdf, Lobe::DIFFUSE.union(Lobe::REFLECTION), 1.0)
                }
                Place::Surface(s, scatter) => {
                    let sample = if is_camera {
                        scatter.sample(wo, u_lobe, u, TransportMode::Radiance)?
                    } else {
                        scatter.sample_particle(s.ng, wo, u_lobe, u)?
                    };
                    (sample.value, sample.wi, sample.pdf, sample.lobe, sample.eta)
                }
            };
            let origin = v.origin(wi);
            let mut next_media = media;
            if let (true, true, Some(s)) = (scene.has_media, lobe.contains(Lobe::TRANSMISSION), v.surface()) {
                next_media.cross(scene, s, wi);
            }
            if lobe.contains(Lobe::NULL) {
                crossings += 1;
                beta *= value / density;
                if crossings > MAX_CROSSINGS || beta.is_black() {
                    return None;
                }
                (ray, media) = (Ray::new(origin, wi), next_media);
                continue;
            }
            if is_last {
                return None;
            }
            let delta = lobe.contains(Lobe::DELTA);
            let back = if delta {
                // The other walk chooses this lobe as often.
                density
            } else if is_camera {
                v.pdf_back(scene, wi)
            } else {
                let (seen, back) = v.eval_light(scene, wi);
                value = seen;
                back
            };
            from = v.p;
            match walk.vertices.get_mut(previous as usize) {
                Some(before) => before.other = back * to_previous,
                None => walk.start_other = back * to_previous,
            }
            walk.vertices[index as usize].delta = delta;
            beta *= value / density;
            if beta.is_black() {
                return None;
            }
            (previous, depth, pdf, media) = (index, depth + 1, density, next_media);
            ray = Ray::new(origin, wi);
            eta_scale *= fns::sqr(eta);
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
    let ctx = v.context();
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
        Light::Point(_) | Light::Spot(_) | Light::Picture(_) | Light::Directional(_) => 1.0,
        infinite => infinite.pdf_escaped(ctx, w),
    }
}
