//! A chain of mirror reflections and refractions as a function of the direction in which it starts, with its derivative, and
//! Newton's method to make it end at a light.
//!
//! The derivatives are those of ray differentials (Igehy 1999, "Tracing Ray Differentials", doi:10.1145/311535.311555), carried through
//! each vertex exactly. So all shapes are alike, a chain is at every step one that the path tracer could have followed, and the
//! derivative at the end says how the chain focuses light (the generalized geometry term of Hanika et al. 2015).

use std::cell::Cell;

use crate::accel::Ray;
use crate::bsdf::{Lobe, TransportMode, fresnel};
use crate::integrator::light_sampling::{beyond, towards, transmittance};
use crate::math::{Frame, ONE_MINUS_EPSILON, Vec2, Vec3};
use crate::medium::MediumStack;
use crate::sampler::HashRng;
use crate::scene::geometry::NONE;
use crate::scene::surface::offset;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Most vertices of a chain.
pub(super) const MAX_VERTICES: u32 = 6;
/// Chains that Newton's method follows before a start is given up (most starts that lead nowhere do so slowly, and those are most of
/// the cost), halvings of one step, and the largest step.
const MAX_FOLLOWED: u32 = 12;
const MAX_HALVINGS: u32 = 4;
const LARGEST_STEP: f32 = 0.5;
/// How far the end of a chain may be turned from the light: square of an angle.
const TOLERANCE: f32 = 1e-8;
/// How far the start of a chain may be from that which the next step would make of it: what is left of its error. Without this bound
/// chains next to a fold, where the end hardly turns with the start, would be found at as many places as there are starts, and
/// beyond the fold, where there are none.
const LARGEST_LAST_STEP: f32 = 2.5e-4;
/// Chains whose end turns less than this with their start are not looked for: single precision cannot tell them from their neighbors.
const FLATTEST: f32 = 2e-3;
/// How often a chain may have any length, not only that which fits best.
const ANY_LENGTH: f32 = 0.25;
/// Surfaces between two vertices that let light straight through.
const MAX_CROSSINGS: u32 = 64;
/// Directions nearer than this, on the same side of a fold and by the same facets, are the same chain.
const SAME: f32 = 1e-3;

/// What a material does to chains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Caster {
    /// Smooth glass of a refractive index inside over that outside.
    Glass(f32),
    /// A smooth mirror.
    Mirror,
}

/// Where chains start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Origin {
    pub p: Vec3,
    /// The geometric normal; zero in a medium.
    pub ng: Vec3,
}

impl Origin {
    /// The beam that starts along `w`.
    pub fn beam(&self, w: Vec3) -> Beam {
        Beam::new(offset(self.p, if self.ng.dot(w) < 0.0 { -self.ng } else { self.ng }), w)
    }
}

/// Where chains are to end.
#[derive(Clone, Copy, Debug)]
pub(super) enum Target {
    /// A point of a light.
    Point(Vec3),
    /// Unit direction to a light without a place.
    Direction(Vec3),
}

/// The number of vertices of a chain, and which of them reflect (bit by bit, from the start).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Plan {
    pub vertices: u32,
    pub reflects: u32,
}

impl Plan {
    fn reflects(self, vertex: u32) -> bool {
        self.reflects >> vertex & 1 == 1
    }
}

/// A ray and how its origin and direction change as the start turns about two axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    pub o: Vec3,
    pub d: Vec3,
    origin_changes: [Vec3; 2],
    direction_changes: [Vec3; 2],
    /// Mixes the numbers of the flat facets on the way.
    facets: u32,
}

impl Beam {
    /// One that starts at a point along a unit direction.
    pub fn new(o: Vec3, d: Vec3) -> Self {
        let frame = Frame::from_normal(d);
        Self { o, d, origin_changes: [Vec3::ZERO; 2], direction_changes: [frame.s, frame.t], facets: 0 }
    }
}

/// A chain that ends at the light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    /// Unit direction at the start.
    pub w: Vec3,
    pub plan: Plan,
    /// The last edge.
    pub end: Beam,
    /// Area across the last edge at its end (or solid angle of it, for targets without a place) per solid angle at the start; its sign is
    /// the orientation.
    pub determinant: f32,
}

impl Solution {
    /// Whether both are the same chain.
    pub fn is(&self, other: &Self) -> bool {
        self.plan == other.plan
            && self.end.facets == other.end.facets
            && (self.w - other.w).length_squared() < SAME * SAME
            && self.determinant.is_sign_positive() == other.determinant.is_sign_positive()
    }
}

impl Target {
    /// How far the direction of a beam is from that to the light, and how this changes.
    fn miss(self, beam: &Beam) -> (Vec3, [Vec3; 2]) {
        match self {
            Self::Point(p) => {
                let to = p - beam.o;
                let distance = to.length();
                let axis = to / distance;
                let changes = [0, 1].map(|i| {
                    let moved = beam.origin_changes[i];
                    beam.direction_changes[i] + (moved - axis * axis.dot(moved)) / distance
                });
                (beam.d - axis, changes)
            }
            Self::Direction(axis) => (beam.d - axis, beam.direction_changes),
        }
    }

    /// [`Solution::determinant`] of a beam that ends here; `None` where it is next to a fold, or where there is none.
    pub fn sound_determinant(self, beam: &Beam) -> Option<f32> {
        let [a, b] = self.miss(beam).1;
        let (aa, ab, bb) = (a.length_squared(), a.dot(b), b.length_squared());
        // The smaller singular value is at least this.
        let flatness = (aa * bb - ab * ab) / (aa + bb);
        let determinant = self.determinant(beam);
        (flatness > FLATTEST * FLATTEST && determinant != 0.0 && determinant.is_finite()).then_some(determinant)
    }

    fn determinant(self, beam: &Beam) -> f32 {
        let [a, b] = match self {
            Self::Point(p) => {
                let distance = (p - beam.o).length();
                [0, 1].map(|i| beam.origin_changes[i] + beam.direction_changes[i] * distance)
            }
            Self::Direction(_) => beam.direction_changes,
        };
        beam.d.dot(a.cross(b))
    }
}

/// Follows chains through a scene.
pub(super) struct Tracer<'a> {
    pub scene: &'a Scene,
    /// What each material does to chains.
    pub casters: &'a [Option<Caster>],
    pub start: Origin,
}

impl Tracer<'_> {
    /// The end of the chain along `w`; `None` where there is no such chain.
    pub fn follow(&self, w: Vec3, plan: Plan) -> Option<Beam> {
        follow(self.scene, self.casters, self.start.beam(w), plan)
    }

    /// A plan for chains that start along `w`: mirrors reflect, and glass refracts but at the vertex `reflect`, if the chain has it. Of the
    /// possible lengths it takes that whose end points best to the target, or for small numbers `u` any.
    pub fn plan(&self, w: Vec3, target: Target, reflect: u32, longest: u32, u: f32) -> Option<Plan> {
        let mut beam = self.start.beam(w);
        let mut reflects = 0;
        let (mut best, mut least) = (None, f32::INFINITY);
        // Without the reflection that was asked for the chain would be one of another kind.
        let shortest = if reflect < longest { reflect + 1 } else { 1 };
        for vertex in 0..longest {
            let Some((s, caster)) = met(self.scene, self.casters, Ray::new(beam.o, beam.d)) else { break };
            let mirrored = match caster {
                Caster::Mirror if vertex == reflect => return None,
                Caster::Mirror => true,
                Caster::Glass(_) => vertex == reflect,
            };
            let Some(b) = bounce(self.scene, &beam, &s, caster, mirrored) else { break };
            beam = b;
            reflects |= u32::from(mirrored) << vertex;
            let plan = Plan { vertices: vertex + 1, reflects };
            if plan.vertices < shortest {
                continue;
            }
            let miss = target.miss(&beam).0.length_squared();
            if miss < least {
                (best, least) = (Some(plan), miss);
            }
            if u < ANY_LENGTH && (u / ANY_LENGTH * longest as f32) as u32 == vertex {
                return Some(plan);
            }
        }
        best
    }

    /// Newton's method from the direction `w`, with the steps of Gauss for the three components of the miss.
    pub fn solve(&self, mut w: Vec3, plan: Plan, target: Target) -> Option<Solution> {
        let mut beam = self.follow(w, plan)?;
        let (mut miss, mut changes) = target.miss(&beam);
        let left = Cell::new(MAX_FOLLOWED);
        loop {
            let now = miss.length_squared();
            let [a, b] = changes;
            let (aa, ab, bb) = (a.length_squared(), a.dot(b), b.length_squared());
            let (ra, rb) = (-a.dot(miss), -b.dot(miss));
            let det = aa * bb - ab * ab;
            let mut step = Vec2::new(bb * ra - ab * rb, aa * rb - ab * ra) / det;
            if !step.is_finite() {
                return None;
            }
            let length = step.length();
            if length > LARGEST_STEP {
                step *= LARGEST_STEP / length;
            }
            let frame = Frame::from_normal(w);
            let better = |step: Vec2| {
                let next = (w + frame.s * step.x + frame.t * step.y).normalize();
                left.set(left.get().checked_sub(1)?);
                let beam = self.follow(next, plan)?;
                let (miss, changes) = target.miss(&beam);
                (miss.length_squared() < now).then_some((next, beam, miss, changes))
            };
            if now < TOLERANCE && length < LARGEST_LAST_STEP {
                // The last step, where it brings the end nearer: the same chain is always told by its direction.
                let (w, beam) = better(step).map_or((w, beam), |(w, beam, ..)| (w, beam));
                return target.sound_determinant(&beam).map(|determinant| Solution { w, plan, end: beam, determinant });
            }
            let mut next = None;
            for _ in 0..MAX_HALVINGS {
                next = better(step);
                if next.is_some() {
                    break;
                }
                step *= 0.5;
            }
            (w, beam, miss, changes) = next?;
        }
    }

    /// The share of light that the vertices of a chain and all that is on its way let through; it starts in `media`.
    pub fn value(&self, solution: &Solution, target: Target, mut media: MediumStack, rng: &mut HashRng) -> Option<Spectrum> {
        let scene = self.scene;
        let last = match target {
            Target::Point(p) => towards(solution.end.o, p),
            Target::Direction(d) => Ray::new(solution.end.o, d),
        };
        // The way to the light is what usually fails.
        if !scene.has_null && scene.occluded(&last) {
            return None;
        }
        let mut value = Spectrum::ONE;
        let mut beam = self.start.beam(solution.w);
        for vertex in 0..solution.plan.vertices {
            let (s, caster) = met(self.scene, self.casters, Ray::new(beam.o, beam.d))?;
            if scene.has_null || scene.has_media {
                value *= transmittance(scene, towards(beam.o, s.p), &media, false, rng);
            }
            let reflects = solution.plan.reflects(vertex);
            let scatter = scene.materials[s.material as usize].shade(scene, &s, -beam.d);
            let (u, lobe) = if reflects { (0.0, Lobe::REFLECTION) } else { (ONE_MINUS_EPSILON, Lobe::TRANSMISSION) };
            let sample = scatter.sample(-beam.d, u, Vec2::splat(0.5), TransportMode::Radiance)?;
            if !sample.lobe.contains(lobe.union(Lobe::DELTA)) {
                return None;
            }
            value *= sample.value;
            beam = bounce(scene, &beam, &s, caster, reflects)?;
            if !reflects && scene.has_media {
                media.cross(scene, &s, beam.d);
            }
        }
        if scene.has_null || scene.has_media {
            value *= transmittance(scene, last, &media, false, rng);
        }
        (!value.is_black()).then_some(value)
    }
}

/// The caster that a ray meets first; surfaces that let light straight through are not in its way. `None`: something else or nothing.
#[inline]
fn met(scene: &Scene, casters: &[Option<Caster>], mut ray: Ray) -> Option<(Surface, Caster)> {
    for _ in 0..MAX_CROSSINGS {
        let s = scene.intersect(&ray)?;
        if s.solid.is_some() {
            return None;
        }
        if let Some(caster) = casters[s.material as usize] {
            return Some((s, caster));
        }
        if !scene.materials[s.material as usize].has_null {
            return None;
        }
        ray = beyond(&ray, &s);
    }
    None
}

/// The end of the chain that begins with a beam; `None` where there is no such chain.
fn follow(scene: &Scene, casters: &[Option<Caster>], mut beam: Beam, plan: Plan) -> Option<Beam> {
    for vertex in 0..plan.vertices {
        let (s, caster) = met(scene, casters, Ray::new(beam.o, beam.d))?;
        beam = bounce(scene, &beam, &s, caster, plan.reflects(vertex))?;
    }
    Some(beam)
}

/// What becomes of a beam at a caster; `None` where it cannot do that.
#[inline]
fn bounce(scene: &Scene, beam: &Beam, s: &Surface, caster: Caster, reflects: bool) -> Option<Beam> {
    let mut n = s.frame.n;
    let side = beam.d.dot(s.ng);
    if side * beam.d.dot(n) <= 0.0 {
        // Interpolated normals may turn away near silhouettes; the material bends them back.
        let scatter = scene.materials[s.material as usize].shade(scene, s, -beam.d);
        n = scatter.parts.first()?.frame.n;
    }
    let distance = (s.p - beam.o).dot(beam.d);
    let moves = [0, 1].map(|i| {
        let across = beam.origin_changes[i] + beam.direction_changes[i] * distance;
        across - beam.d * (across.dot(s.ng) / side)
    });
    let turns = s.normal_changes(scene, moves);
    let cos = -beam.d.dot(n);
    let cos_changes = [0, 1].map(|i| -(beam.direction_changes[i].dot(n) + beam.d.dot(turns[i])));
    let (d, direction_changes) = if reflects {
        // Mirrors of the file's own back side are dark there, which the lobe's value says.
        let changes = [0, 1].map(|i| beam.direction_changes[i] + (n * cos_changes[i] + turns[i] * cos) * 2.0);
        (beam.d + n * (2.0 * cos), changes)
    } else {
        let Caster::Glass(eta) = caster else { return None };
        let (r, cos_t, _, eta_ti) = fresnel::dielectric(cos, eta);
        if r >= 1.0 || cos_t == 0.0 {
            return None;
        }
        let along = eta_ti * cos + cos_t;
        // Snell's law, 1 − cos_t² = η² (1 − cos²), differentiated.
        let slope = eta_ti + eta_ti * eta_ti * cos / cos_t;
        let changes = [0, 1].map(|i| beam.direction_changes[i] * eta_ti + turns[i] * along + n * (slope * cos_changes[i]));
        (beam.d * eta_ti + n * along, changes)
    };
    let flat = scene.geometries[s.geometry as usize].objects[s.object as usize].normals == NONE;
    let facet = if flat { s.primitive.wrapping_add(1).wrapping_mul(0x9E37_79B1) ^ s.instance } else { 0 };
    Some(Beam {
        o: s.offset_origin(d),
        d: d.normalize(),
        origin_changes: moves,
        direction_changes,
        facets: beam.facets.rotate_left(5) ^ facet,
    })
}
