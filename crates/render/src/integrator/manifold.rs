//! Chains of mirror reflections and refractions from a point to a point of a light.
//!
//! A chain is a function of the direction in which it leaves the point: what smooth dielectrics and metals do to it follows, once it is
//! settled which of them reflect and which refract. Newton's method moves the direction until the last ray goes through the light's
//! point (Hanika, Droske, Fascione 2015, "Manifold Next Event Estimation", doi:10.1111/cgf.12681). Its derivative is taken from neighboring
//! rays, so that all shapes are alike, meshes with smooth normals included, and a chain is at every step one that the path tracer could
//! have followed. The same derivative is how the chain focuses light (the generalized geometry term).
//!
//! Seeds are random: a random point of a random caster, glass reflecting by chance as it would for a path. How likely a seed leads to
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
const MAX_CHAIN: u32 = 8;
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
const MAX_TRIALS: u32 = 4096;
/// How often a seed's chain is taken at its full length; else it is cut somewhere, for lights inside of glass.
const FULL_LENGTH: f32 = 0.8;

/// The chains that lead to lights, and how to find them.
pub(super) struct Chains {
    /// (placement, first primitive, number of primitives) of the surfaces that make chains.
    casters: Vec<(u32, u32, u32)>,
    /// Whether a material is only on casters.
    is_caster: Vec<bool>,
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

/// What happens along a chain: as many vertices, and bit i says that vertex i reflects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Events {
    count: u32,
    reflections: u32,
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
    events: Events,
    chain: Chain,
    /// Area across the last edge at its end per solid angle at the start; its sign is the orientation.
    determinant: f32,
}

impl Solution {
    fn is(&self, other: &Self) -> bool {
        self.events == other.events
            && (self.w - other.w).length() < SAME
            && self.determinant.is_sign_positive() == other.determinant.is_sign_positive()
    }
}

impl Chains {
    /// Those of a scene.
    pub(super) fn new(scene: &Scene) -> Self {
        let mut is_caster: Vec<bool> = scene.materials.iter().map(|m| is_specular(scene, &m.desc)).collect();
        let mut casters = Vec::new();
        for (p, placement) in scene.placements.iter().enumerate() {
            let g = &scene.geometries[placement.geometry as usize];
            for (o, object) in g.objects.iter().enumerate() {
                let first = object.first_primitive as usize;
                let count = g.object_of_primitive.get(first..).unwrap_or_default().iter().take_while(|&&i| i as usize == o).count();
                let Some(is_caster) = is_caster.get_mut(object.material as usize).filter(|c| **c) else { continue };
                // No seed is on an unbounded surface: its material makes no chains.
                let bounded = |i: usize| i.checked_sub(g.triangles.len()).is_none_or(|i| g.shapes[i].sample_area(Vec2::splat(0.5)).is_some());
                *is_caster = (first..first + count).all(bounded);
                if count > 0 {
                    casters.push((p as u32, object.material, first as u32, count as u32));
                }
            }
        }
        let casters = casters.into_iter().filter(|c| is_caster[c.1 as usize]).map(|(p, _, first, count)| (p, first, count)).collect();
        Self { casters, is_caster, emission: EmissionSampler::new(scene) }
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.casters.is_empty()
    }

    /// Whether a surface does nothing but mirror and refract, and seeds find it.
    fn is_caster(&self, s: &Surface) -> bool {
        s.solid.is_none() && self.is_caster.get(s.material as usize).is_some_and(|c| *c)
    }

    /// The vertices of the chain that a path has followed since its last rough surface, after one more scattering by a lobe: `None` where
    /// this is a way that [`Self::estimate`] does not take.
    #[inline]
    pub(super) fn after(&self, chain: Option<u32>, s: &Surface, lobe: Lobe) -> Option<u32> {
        if !lobe.contains(Lobe::DELTA) {
            return Some(0);
        }
        chain.filter(|&n| n < MAX_CHAIN && !lobe.contains(Lobe::NULL) && self.is_caster(s)).map(|n| n + 1)
    }

    /// Whether [`Self::estimate`] has found the light of a surface that a path meets by such a chain.
    #[inline]
    pub(super) fn found(&self, scene: &Scene, chain: Option<u32>, s: &Surface) -> bool {
        chain.is_some_and(|n| n > 0) && s.light(scene).is_some_and(|l| self.emission.pmf(l) > 0.0) && !self.is_caster(s)
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
            (Some((surface, _)), _) if self.is_caster(surface) => return None,
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
        let events = self.events(scene, start, w, longest, rng)?;
        let follow = |w: Vec3| self.follow(scene, start, w, events);
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
                return Some(Solution { w, events, chain, determinant });
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

    /// What happens to a path along `w` that takes the lobes of glass by chance, until it meets something else or nothing.
    fn events(&self, scene: &Scene, start: &Start, w: Vec3, longest: u32, rng: &mut HashRng) -> Option<Events> {
        let mut events = Events { count: 0, reflections: 0 };
        let mut ray = Ray::new(start.s.offset_origin(w), w);
        while events.count < longest {
            let Some(s) = scene.intersect(&ray).filter(|s| self.is_caster(s)) else { break };
            let sample = shade(scene, &s, -ray.d).sample(-ray.d, rng.next_1d(), Vec2::splat(0.5), TransportMode::Radiance)?;
            events.reflections |= u32::from(sample.lobe.contains(Lobe::REFLECTION)) << events.count;
            events.count += 1;
            ray = Ray::new(s.offset_origin(sample.wi), sample.wi);
        }
        if events.count > 1 && rng.next_1d() >= FULL_LENGTH {
            events.count = 1 + index(rng.next_1d(), events.count as usize - 1) as u32;
            events.reflections &= (1 << events.count) - 1;
        }
        (events.count > 0).then_some(events)
    }

    /// The chain along `w` with these events; `None` where it meets no casters or cannot have them.
    fn follow(&self, scene: &Scene, start: &Start, w: Vec3, events: Events) -> Option<Chain> {
        let mut chain = Chain { o: start.s.offset_origin(w), d: w, value: Spectrum::ONE };
        for i in 0..events.count {
            let s = scene.intersect(&Ray::new(chain.o, chain.d)).filter(|s| self.is_caster(s))?;
            let (value, wi) = bounce(scene, &s, -chain.d, events, i)?;
            chain = Chain { o: s.offset_origin(wi), d: wi, value: chain.value * value };
        }
        Some(chain)
    }

    /// The share of light that media along a chain and its last edge let through.
    fn transmittance(&self, scene: &Scene, start: &Start, solution: &Solution, last: &Ray, rng: &mut HashRng) -> Option<Spectrum> {
        let mut media = *start.media;
        let mut through = Spectrum::ONE;
        let mut ray = Ray::new(start.s.offset_origin(solution.w), solution.w);
        if ray.d.dot(start.s.ng) * start.wo.dot(start.s.ng) < 0.0 {
            media.cross(scene, start.s, ray.d);
        }
        for i in 0..solution.events.count {
            let s = scene.intersect(&ray)?;
            if let Some(medium) = scene.medium(&media) {
                through *= medium.transmittance(&ray, s.t, rng);
            }
            let (_, wi) = bounce(scene, &s, -ray.d, solution.events, i)?;
            if solution.events.reflections >> i & 1 == 0 {
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

/// Whether a material does nothing but mirror and refract.
fn is_specular(scene: &Scene, desc: &BsdfDesc) -> bool {
    match desc {
        BsdfDesc::Dielectric { roughness: None, .. } | BsdfDesc::Conductor { roughness: None, .. } => true,
        BsdfDesc::TwoSided { front, back } => [front, back].into_iter().all(|side| {
            let desc = scene.materials.get(side.0 as usize).map(|m| &m.desc);
            matches!(desc, Some(BsdfDesc::Conductor { roughness: None, .. }))
        }),
        _ => false,
    }
}

fn shade(scene: &Scene, s: &Surface, wo: Vec3) -> Scatter {
    scene.materials[s.material as usize].shade(scene, s, wo)
}

/// What vertex `i` of a chain does to the light, and where the chain goes on.
#[inline]
fn bounce(scene: &Scene, s: &Surface, wo: Vec3, events: Events, i: u32) -> Option<(Spectrum, Vec3)> {
    let reflects = events.reflections >> i & 1 == 1;
    // Reflection is at the lower end of the lobe numbers, transmission at the upper.
    let (u_lobe, lobe) = if reflects { (0.0, Lobe::REFLECTION) } else { (ONE_MINUS_EPSILON, Lobe::TRANSMISSION) };
    let sample = shade(scene, s, wo).sample(wo, u_lobe, Vec2::splat(0.5), TransportMode::Radiance)?;
    sample.lobe.contains(lobe.union(Lobe::DELTA)).then_some((sample.value, sample.wi))
}

fn pair(rng: &mut HashRng) -> Vec2 {
    Vec2::new(rng.next_1d(), rng.next_1d())
}

/// One of `n` for a random number in [0, 1).
fn index(u: f32, n: usize) -> usize {
    ((f64::from(u) * n as f64) as usize).min(n - 1)
}
