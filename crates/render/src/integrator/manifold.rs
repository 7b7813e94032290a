//! Chains of mirror reflections and refractions from a point to a point of a light.
//!
//! A chain is a function of the direction in which it leaves the point: smooth dielectrics refract it and metals reflect it, until
//! something else is met or nothing. Newton's method moves the direction until the last ray goes through the light's
//! point (Hanika, Droske, Fascione 2015, "Manifold Next Event Estimation", doi:10.1111/cgf.12681). Its derivative is taken from neighboring
//! rays, so that all shapes are alike, meshes with smooth normals included, and a chain is at every step one that the path tracer could
//! have followed. The same derivative is how the chain focuses light (the generalized geometry term).
//!
//! Seeds are random points of random casters. How likely a seed leads to
//! the chain that was found is not known; the number of further seeds until one leads there again has its reciprocal as mean
//! (Zeltner, Georgiev, Jakob 2020, "Specular Manifold Sampling", doi:10.1145/3386569.3392408, section 4.3). So the light of all chains is
//! estimated without bias but for [`MAX_TRIALS`] and for facets seen under less than [`STEP`].

use super::emission::EmissionSampler;
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::light::{Light, LightContext};
use crate::material::Scatter;
use crate::math::{Frame, ONE_MINUS_EPSILON, Vec2, Vec3};
use crate::medium::MediumStack;
use crate::sampler::HashRng;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;
use etendue_scene::desc::BsdfDesc;

/// Most vertices of a chain.
const MAX_CHAIN: u32 = 6;
/// Angle between neighboring rays: small enough for curvatures, large enough for single precision.
const STEP: f32 = 1e-3;
/// Newton's steps before a seed is given up, and halvings of one step.
const MAX_STEPS: u32 = 16;
const MAX_HALVINGS: u32 = 6;
/// How near to the light's point a chain must come, relative to the distance of its last vertex, before a last step.
const TOLERANCE: f32 = 1e-4;
/// Directions nearer than this, on the same side of a fold, are the same chain.
const SAME: f32 = 2e-3;
/// Seeds after which a chain counts as found again; chains less likely than the reciprocal lose light. The mean number of seeds
/// is no more than the number of chains, whatever their probabilities.
const MAX_TRIALS: u32 = 2048;
/// How often a seed's chain is taken at its full length; else it is cut somewhere, for lights inside of glass.
const FULL_LENGTH: f32 = 0.8;

/// The chains that lead to lights, and how to find them.
pub(super) struct Chains {
    /// (placement, first primitive, number of primitives) of the surfaces that make chains.
    casters: Vec<(u32, u32, u32)>,
    /// What the materials of casters do to a chain; `None` for all others.
    events: Vec<Option<Lobe>>,
    emission: EmissionSampler,
}

/// The point at which chains start.
#[derive(Clone, Copy)]
pub(super) struct Start<'a> {
    pub s: &'a Surface,
    pub scatter: &'a Scatter,
    /// Unit direction to the viewer.
    pub wo: Vec3,
    /// The media on the side of `wo`.
    pub media: &'a MediumStack,
}

/// A chain.
#[derive(Clone, Copy, Debug)]
struct Chain {
    /// Last vertex, moved off its surface, and the direction in which the chain goes on.
    o: Vec3,
    d: Vec3,
    /// Product of the factors of its delta lobes.
    value: Spectrum,
}

/// A chain that ends at the light's point.
#[derive(Clone, Copy, Debug)]
struct Solution {
    w: Vec3,
    vertices: u32,
    chain: Chain,
    /// Area across the last edge at its end per solid angle at the start; its sign is the orientation.
    determinant: f32,
}

impl Solution {
    fn is(&self, other: &Self) -> bool {
        self.vertices == other.vertices
            && (self.w - other.w).length() < SAME
            && self.determinant.is_sign_positive() == other.determinant.is_sign_positive()
    }
}

impl Chains {
    /// Those of a scene.
    pub(super) fn new(scene: &Scene) -> Self {
        let mut events: Vec<Option<Lobe>> = scene.materials.iter().map(|m| event(scene, &m.desc)).collect();
        let mut casters = Vec::new();
        for (p, placement) in scene.placements.iter().enumerate() {
            let g = &scene.geometries[placement.geometry as usize];
            for (o, object) in g.objects.iter().enumerate() {
                let first = object.first_primitive as usize;
                let count = g.object_of_primitive.get(first..).unwrap_or_default().iter().take_while(|&&i| i as usize == o).count();
                let Some(event) = events.get_mut(object.material as usize).filter(|e| e.is_some()) else { continue };
                // No seed is on an unbounded surface: its material makes no chains.
                let bounded =
                    |i: usize| i.checked_sub(g.triangles.len()).is_none_or(|i| g.shapes[i].sample_area(Vec2::splat(0.5)).is_some());
                if !(first..first + count).all(bounded) {
                    *event = None;
                }
                if count > 0 {
                    casters.push((p as u32, object.material, first as u32, count as u32));
                }
            }
        }
        let casters =
            casters.into_iter().filter(|c| events[c.1 as usize].is_some()).map(|(p, _, first, count)| (p, first, count)).collect();
        Self { casters, events, emission: EmissionSampler::new(scene) }
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.casters.is_empty()
    }

    /// What a surface does to a chain; `None` where it is no caster, or none that seeds find.
    #[inline]
    fn event(&self, s: &Surface) -> Option<Lobe> {
        if s.solid.is_some() { None } else { *self.events.get(s.material as usize)? }
    }

    /// The vertices of the chain that a path has followed since its last rough surface, after one more scattering by a lobe: `None` where
    /// this is a way that [`Self::estimate`] does not take.
    #[inline]
    pub(super) fn after(&self, chain: Option<u32>, s: &Surface, lobe: Lobe) -> Option<u32> {
        if !lobe.contains(Lobe::DELTA) {
            return Some(0);
        }
        chain.filter(|&n| n < MAX_CHAIN && self.event(s).is_some_and(|event| lobe.contains(event))).map(|n| n + 1)
    }

    /// Whether [`Self::estimate`] has found the light of a surface that a path meets by such a chain.
    #[inline]
    pub(super) fn found(&self, scene: &Scene, chain: Option<u32>, s: &Surface) -> bool {
        chain.is_some_and(|n| n > 0) && s.light(scene).is_some_and(|l| self.emission.pmf(l) > 0.0) && self.event(s).is_none()
    }

    /// An unbiased estimate of the light that chains of up to `longest` vertices bring to a surface point and that it sends to the viewer,
    /// with its light group. `None`: nothing.
    pub(super) fn estimate(&self, scene: &Scene, start: &Start, longest: u32, rng: &mut HashRng) -> Option<(Spectrum, u32)> {
        let longest = longest.min(MAX_CHAIN);
        if self.casters.is_empty() || longest == 0 {
            return None;
        }
        let (light, pmf) = self.emission.choose(rng.next_1d())?;
        let u = pair(rng);
        let source = match &scene.lights[light as usize] {
            Light::Area(_) => Some(self.emission.point(scene, light, u)?),
            Light::Point(_) | Light::Spot(_) => None,
            _ => return None,
        };
        let to = match (&source, &scene.lights[light as usize]) {
            (Some((surface, _)), _) if self.event(surface).is_some() => return None,
            (Some((surface, _)), _) => surface.p,
            (None, light) => light.position()?,
        };
        let first = self.solve(scene, start, to, longest, rng)?;
        let (f, _) = start.scatter.eval_pdf(start.wo, first.w, TransportMode::Radiance);
        let end = to - first.chain.o;
        let distance = end.length();
        // Power per solid angle across the last edge: radiance times the lit area that faces it, or intensity.
        let sent = match &source {
            Some((surface, pdf)) => scene.emitted(surface, -first.chain.d) * (surface.ng.dot(first.chain.d).abs() / pdf),
            None => {
                let sample = scene.lights[light as usize].sample(&LightContext { p: first.chain.o, n: Vec3::ZERO }, u)?;
                scene.light_radiance(light, &sample) * (distance * distance)
            }
        };
        let mut value = f * first.chain.value * sent / (first.determinant.abs() * pmf);
        if value.is_black() || !value.is_finite() {
            return None;
        }
        let shadow = Ray { o: first.chain.o, d: end / distance, t_min: 0.0, t_max: distance * (1.0 - 1e-3) };
        if scene.occluded(&shadow) {
            return None;
        }
        if scene.has_media {
            value *= self.transmittance(scene, start, &first, &shadow, rng)?;
        }
        let mut trials = 1;
        while trials < MAX_TRIALS && !self.solve(scene, start, to, longest, rng).is_some_and(|again| again.is(&first)) {
            trials += 1;
        }
        Some((value * trials as f32, scene.light_groups[light as usize]))
    }

    /// A chain from a random seed to a point.
    fn solve(&self, scene: &Scene, start: &Start, to: Vec3, longest: u32, rng: &mut HashRng) -> Option<Solution> {
        let mut w = (self.seed(scene, rng)? - start.s.p).try_normalize()?;
        let vertices = self.vertices(scene, start, w, longest, rng)?;
        let follow = |w: Vec3| self.follow(scene, start, w, vertices);
        let mut chain = follow(w)?;
        for _ in 0..MAX_STEPS {
            let axis = (to - chain.o).try_normalize()?;
            let distance = (to - chain.o).length();
            let plane = Frame::from_normal(axis);
            // Where a chain meets the plane through the light's point that faces the chain's last vertex.
            let miss = |c: &Chain| {
                let cos = c.d.dot(axis);
                let at = c.o + c.d * ((to - c.o).dot(axis) / cos) - to;
                (cos > 1e-3).then(|| Vec2::new(at.dot(plane.s), at.dot(plane.t)))
            };
            let now = miss(&chain)?;
            let frame = Frame::from_normal(w);
            let turned = |x: f32, y: f32| (w + frame.s * x + frame.t * y).normalize();
            let at = |x: f32, y: f32| follow(turned(x, y)).and_then(|c| miss(&c));
            let dx = (at(STEP, 0.0)? - at(-STEP, 0.0)?) / (2.0 * STEP);
            let dy = (at(0.0, STEP)? - at(0.0, -STEP)?) / (2.0 * STEP);
            let determinant = dx.x * dy.y - dx.y * dy.x;
            if determinant == 0.0 || !determinant.is_finite() {
                return None;
            }
            let mut step = Vec2::new(-(now.x * dy.y - now.y * dy.x), -(now.y * dx.x - now.x * dx.y)) / determinant;
            let better = |step: Vec2| {
                let next = turned(step.x, step.y);
                let chain = follow(next)?;
                miss(&chain).is_some_and(|m| m.length_squared() < now.length_squared()).then_some((next, chain))
            };
            if now.length() < TOLERANCE * distance {
                // Once more, so that the same chain is always told by its direction.
                let (w, chain) = better(step).unwrap_or((w, chain));
                return Some(Solution { w, vertices, chain, determinant });
            }
            let mut next = None;
            for _ in 0..MAX_HALVINGS {
                next = better(step);
                if next.is_some() {
                    break;
                }
                step *= 0.5;
            }
            (w, chain) = next?;
        }
        None
    }

    /// A random point of a caster.
    fn seed(&self, scene: &Scene, rng: &mut HashRng) -> Option<Vec3> {
        let (p, first, primitives) = self.casters[index(rng.next_1d(), self.casters.len())];
        let primitive = first as usize + index(rng.next_1d(), primitives as usize);
        let u = pair(rng);
        let placement = &scene.placements[p as usize];
        let g = &scene.geometries[placement.geometry as usize];
        let local = match primitive.checked_sub(g.triangles.len()) {
            None => {
                let corners = g.triangles[primitive].map(|i| g.positions[i as usize]);
                crate::shape::triangle::sample_area(&corners, u)?.p
            }
            Some(shape) => g.shapes[shape].sample_area(u)?.p,
        };
        Some(placement.world_from_object.map_or(local, |m| m.transform_point3(local)))
    }

    /// How many vertices the chain along `w` is to have: usually all until it meets something else or nothing.
    fn vertices(&self, scene: &Scene, start: &Start, w: Vec3, longest: u32, rng: &mut HashRng) -> Option<u32> {
        let mut count = 0;
        let mut ray = Ray::new(start.s.offset_origin(w), w);
        while count < longest {
            let Some((s, event)) = self.met(scene, &ray) else { break };
            let (_, wi) = bounce(scene, &s, -ray.d, event)?;
            ray = Ray::new(s.offset_origin(wi), wi);
            count += 1;
        }
        if count > 1 && rng.next_1d() >= FULL_LENGTH {
            count = 1 + index(rng.next_1d(), count as usize - 1) as u32;
        }
        (count > 0).then_some(count)
    }

    /// The chain along `w` with so many vertices; `None` where it has not so many.
    fn follow(&self, scene: &Scene, start: &Start, w: Vec3, vertices: u32) -> Option<Chain> {
        let mut chain = Chain { o: start.s.offset_origin(w), d: w, value: Spectrum::ONE };
        for _ in 0..vertices {
            let (s, event) = self.met(scene, &Ray::new(chain.o, chain.d))?;
            let (value, wi) = bounce(scene, &s, -chain.d, event)?;
            chain = Chain { o: s.offset_origin(wi), d: wi, value: chain.value * value };
        }
        Some(chain)
    }

    /// The caster that a ray meets first, if it is one.
    #[inline]
    fn met(&self, scene: &Scene, ray: &Ray) -> Option<(Surface, Lobe)> {
        let s = scene.intersect(ray)?;
        self.event(&s).map(|event| (s, event))
    }

    /// The share of light that media along a chain and its last edge let through.
    fn transmittance(&self, scene: &Scene, start: &Start, solution: &Solution, last: &Ray, rng: &mut HashRng) -> Option<Spectrum> {
        let mut media = *start.media;
        let mut through = Spectrum::ONE;
        let mut ray = Ray::new(start.s.offset_origin(solution.w), solution.w);
        if ray.d.dot(start.s.ng) * start.wo.dot(start.s.ng) < 0.0 {
            media.cross(scene, start.s, ray.d);
        }
        for _ in 0..solution.vertices {
            let (s, event) = self.met(scene, &ray)?;
            if let Some(medium) = scene.medium(&media) {
                through *= medium.transmittance(&ray, s.t, rng);
            }
            let (_, wi) = bounce(scene, &s, -ray.d, event)?;
            if event == Lobe::TRANSMISSION {
                media.cross(scene, &s, wi);
            }
            ray = Ray::new(s.offset_origin(wi), wi);
        }
        if let Some(medium) = scene.medium(&media) {
            through *= medium.transmittance(last, last.t_max, rng);
        }
        Some(through)
    }
}

/// What a material does to a chain. Glass reflects as well, but little: to look for each of the many ways in which it can would cost more
/// than to leave them to the path tracer.
fn event(scene: &Scene, desc: &BsdfDesc) -> Option<Lobe> {
    match desc {
        BsdfDesc::Dielectric { roughness: None, .. } => Some(Lobe::TRANSMISSION),
        BsdfDesc::Conductor { roughness: None, .. } => Some(Lobe::REFLECTION),
        BsdfDesc::TwoSided { front, back } => {
            let is_metal = |side: u32| {
                let desc = scene.materials.get(side as usize).map(|m| &m.desc);
                matches!(desc, Some(BsdfDesc::Conductor { roughness: None, .. }))
            };
            (is_metal(front.0) && is_metal(back.0)).then_some(Lobe::REFLECTION)
        }
        _ => None,
    }
}

/// What a vertex of a chain does to the light, and where the chain goes on.
#[inline]
fn bounce(scene: &Scene, s: &Surface, wo: Vec3, event: Lobe) -> Option<(Spectrum, Vec3)> {
    let scatter = scene.materials[s.material as usize].shade(scene, s, wo);
    // Transmission is at the upper end of the lobe numbers; metal has reflection alone.
    let sample = scatter.sample(wo, ONE_MINUS_EPSILON, Vec2::splat(0.5), TransportMode::Radiance)?;
    sample.lobe.contains(event.union(Lobe::DELTA)).then_some((sample.value, sample.wi))
}

fn pair(rng: &mut HashRng) -> Vec2 {
    Vec2::new(rng.next_1d(), rng.next_1d())
}

/// One of `n` for a random number in [0, 1).
fn index(u: f32, n: usize) -> usize {
    ((f64::from(u) * n as f64) as usize).min(n - 1)
}
