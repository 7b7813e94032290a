//! Chains of mirror reflections and refractions from a point to a point of a light.
//!
//! A chain is a function of the direction in which it leaves the point: refractions at dielectrics and reflections at metals follow
//! from it, until something else is met or nothing. Newton's method moves the direction until the last ray goes through the light's
//! point. The derivative is found by neighboring rays: so all shapes are alike, meshes with smooth normals included, and the same derivative
//! is how the chain focuses light (the generalized geometry term).

use super::emission::EmissionSampler;
use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode};
use crate::light::{Light, LightContext};
use crate::material::Scatter;
use crate::math::{Frame, ONE_MINUS_EPSILON, Vec2, Vec3};
use crate::sampler::HashRng;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;
use etendue_scene::desc::BsdfDesc;

/// Most vertices of a chain.
pub const MAX_CHAIN: u32 = 6;
/// Angle between neighboring rays: small enough for curvatures, large enough for single precision.
const STEP: f32 = 1e-3;
/// Newton's steps before a seed is given up, and halvings of one step.
const MAX_STEPS: u32 = 16;
const MAX_HALVINGS: u32 = 6;
/// How near to the light's point a chain must come, relative to the distance of its last vertex.
const TOLERANCE: f32 = 1e-4;
/// Directions nearer than this are the same chain.
const SAME: f32 = 2e-3;
/// Seeds after which the probability of a chain counts as small as it can be.
const MAX_TRIALS: u32 = 256;

/// Surfaces that make chains.
#[derive(Clone, Debug, Default)]
pub struct Casters {
    /// (placement, first primitive, number of primitives)
    objects: Vec<(u32, u32, u32)>,
}

/// A chain.
#[derive(Clone, Copy, Debug)]
struct Chain {
    /// Last vertex, moved off its surface, and the direction in which the chain goes on.
    o: Vec3,
    d: Vec3,
    /// Product of the factors of its delta lobes.
    value: Spectrum,
    vertices: u32,
}

/// A chain that ends at the light's point.
#[derive(Clone, Copy, Debug)]
struct Solution {
    w: Vec3,
    chain: Chain,
    /// Solid angle at the start per area across the last edge at its end.
    focus: f32,
}

impl Casters {
    /// Those of a scene.
    pub fn new(scene: &Scene) -> Self {
        let mut objects = Vec::new();
        for (p, placement) in scene.placements.iter().enumerate() {
            let g = &scene.geometries[placement.geometry as usize];
            for (o, object) in g.objects.iter().enumerate() {
                let first = object.first_primitive as usize;
                let count = g.object_of_primitive[first..].iter().take_while(|&&i| i as usize == o).count();
                if count > 0 && Self::is_caster(scene, object.material) {
                    objects.push((p as u32, first as u32, count as u32));
                }
            }
        }
        Self { objects }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.objects.is_empty()
    }

    /// Whether a material does nothing but mirror and refract.
    pub fn is_caster(scene: &Scene, material: u32) -> bool {
        Self::event(scene, material).is_some()
    }

    /// Whether a delta lobe of a material is one that chains have.
    pub fn covers(scene: &Scene, material: u32, lobe: Lobe) -> bool {
        Self::event(scene, material).is_some_and(|event| lobe.contains(event))
    }

    /// What a material does in a chain.
    fn event(scene: &Scene, material: u32) -> Option<Lobe> {
        match &scene.materials.get(material as usize)?.desc {
            BsdfDesc::Dielectric { roughness: None, .. } => Some(Lobe::TRANSMISSION),
            BsdfDesc::Conductor { roughness: None, .. } => Some(Lobe::REFLECTION),
            BsdfDesc::TwoSided { front, back } => {
                let (a, b) = (Self::event(scene, front.0)?, Self::event(scene, back.0)?);
                (a == b && a == Lobe::REFLECTION).then_some(a)
            }
            _ => None,
        }
    }

    /// An unbiased estimate of the light that chains of up to `longest` vertices bring to a surface point and that it sends along `wo`,
    /// with its light group. `None`: nothing.
    #[expect(clippy::too_many_arguments, reason = "a surface point is several of them")]
    pub fn estimate(
        &self,
        scene: &Scene,
        emission: &EmissionSampler,
        s: &Surface,
        wo: Vec3,
        scatter: &Scatter,
        longest: u32,
        rng: &mut HashRng,
    ) -> Option<(Spectrum, u32)> {
        if self.objects.is_empty() || longest == 0 {
            return None;
        }
        let pair = |rng: &mut HashRng| Vec2::new(rng.next_1d(), rng.next_1d());
        let u_light = rng.next_1d();
        let (u_position, u_direction) = (pair(rng), pair(rng));
        let start = emission.sample(scene, u_light, u_position, u_direction)?;
        let light = &scene.lights[start.light as usize];
        if light.is_infinite() {
            return None;
        }
        let to = start.p;
        let first = self.solve(scene, s, to, longest, rng)?;
        let (f, _) = scatter.eval_pdf(wo, first.w, TransportMode::Radiance);
        let end = to - first.chain.o;
        let distance = end.length();
        // Radiance for areas, with the cosine there; intensity for points.
        let sent = match (light, &start.surface) {
            (Light::Area(_), Some(surface)) => {
                scene.emitted(surface, -first.chain.d) * (surface.ng.dot(first.chain.d).abs() / start.pdf_position)
            }
            _ => {
                let sample = light.sample(&LightContext { p: first.chain.o, n: Vec3::ZERO }, u_position)?;
                scene.light_radiance(start.light, &sample) * (distance * distance)
            }
        };
        // A two-sided light was sampled on one of its sides.
        if start.surface.is_some() && start.n.dot(first.chain.d) >= 0.0 {
            return None;
        }
        let value = f * first.chain.value * sent * (first.focus / start.pmf);
        if value.is_black() || !value.is_finite() {
            return None;
        }
        let shadow = Ray { o: first.chain.o, d: end / distance, t_min: 0.0, t_max: distance * (1.0 - 1e-3) };
        if scene.occluded(&shadow) {
            return None;
        }
        // The number of trials until the same chain is found again has the mean 1 / p.
        let mut trials = 1;
        while trials < MAX_TRIALS {
            let again = self.solve(scene, s, to, longest, rng);
            if again.is_some_and(|a| a.chain.vertices == first.chain.vertices && (a.w - first.w).length() < SAME) {
                break;
            }
            trials += 1;
        }
        Some((value * trials as f32, start.group))
    }

    /// A chain from a random seed.
    fn solve(&self, scene: &Scene, s: &Surface, to: Vec3, longest: u32, rng: &mut HashRng) -> Option<Solution> {
        let seed = self.seed(scene, rng)?;
        let mut w = (seed - s.p).try_normalize()?;
        let mut chain = follow(scene, s, w, longest, None)?;
        let vertices = Some(chain.vertices);
        for _ in 0..MAX_STEPS {
            let axis = (to - chain.o).try_normalize()?;
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
            let at = |x: f32, y: f32| follow(scene, s, turned(x, y), longest, vertices).and_then(|c| miss(&c));
            let dx = (at(STEP, 0.0)? - at(-STEP, 0.0)?) / (2.0 * STEP);
            let dy = (at(0.0, STEP)? - at(0.0, -STEP)?) / (2.0 * STEP);
            let determinant = dx.x * dy.y - dx.y * dy.x;
            if determinant == 0.0 || !determinant.is_finite() {
                return None;
            }
            if now.length() < TOLERANCE * (to - chain.o).length() {
                return Some(Solution { w, chain, focus: 1.0 / determinant.abs() });
            }
            let mut step = Vec2::new(-(now.x * dy.y - now.y * dy.x), -(now.y * dx.x - now.x * dx.y)) / determinant;
            let mut better = None;
            for _ in 0..MAX_HALVINGS {
                let next = turned(step.x, step.y);
                better = follow(scene, s, next, longest, vertices)
                    .filter(|c| miss(c).is_some_and(|m| m.length_squared() < now.length_squared()))
                    .map(|c| (next, c));
                if better.is_some() {
                    break;
                }
                step *= 0.5;
            }
            (w, chain) = better?;
        }
        None
    }

    /// A random point of a caster.
    fn seed(&self, scene: &Scene, rng: &mut HashRng) -> Option<Vec3> {
        let count = self.objects.len();
        let (p, first, primitives) = self.objects[((rng.next_1d() * count as f32) as usize).min(count - 1)];
        let primitive = (first + ((rng.next_1d() * primitives as f32) as u32).min(primitives - 1)) as usize;
        let u = Vec2::new(rng.next_1d(), rng.next_1d());
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
}

/// The chain that leaves a surface point along `w`: until it meets something else or nothing, or has so many vertices as asked for.
fn follow(scene: &Scene, from: &Surface, w: Vec3, longest: u32, vertices: Option<u32>) -> Option<Chain> {
    let mut chain = Chain { o: from.offset_origin(w), d: w, value: Spectrum::ONE, vertices: 0 };
    while vertices.is_none_or(|n| chain.vertices < n) {
        let met = scene.intersect(&Ray::new(chain.o, chain.d));
        let met = met.and_then(|s| Casters::event(scene, s.material).map(|event| (s, event)));
        let Some((s, event)) = met else {
            // The end, unless more vertices were asked for.
            return (vertices.is_none() && chain.vertices > 0).then_some(chain);
        };
        if chain.vertices == longest {
            return None;
        }
        let wo = -chain.d;
        let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
        // Transmission is at the upper end of the lobe numbers.
        let sample = scatter.sample(wo, ONE_MINUS_EPSILON, Vec2::splat(0.5), TransportMode::Radiance)?;
        if !sample.lobe.contains(event) || !sample.lobe.contains(Lobe::DELTA) {
            return None;
        }
        chain.value *= sample.value;
        chain.d = sample.wi;
        chain.o = s.offset_origin(sample.wi);
        chain.vertices += 1;
    }
    (chain.vertices > 0).then_some(chain)
}
