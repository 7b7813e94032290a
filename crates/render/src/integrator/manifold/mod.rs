//! Manifold next-event estimation (Hanika, Droske, Fascione 2015, doi:10.1111/cgf.12681): light that comes to a point through smooth glass
//! and from mirrors, looked for like light that comes straight.
//!
//! A point of a light is sampled, and a *chain* of refractions and mirror reflections that leads there is found from a random start by
//! Newton's method ([`walk`]). How likely a start leads to the chain that was found is not known; the number of further starts until one
//! leads there again has the reciprocal as mean (Zeltner, Georgiev, Jakob 2020, "Specular Manifold Sampling",
//! doi:10.1145/3386569.3392408, section 4.3). So the light of chains is estimated without bias.
//!
//! Left out, and so missing, are of lights that chance cannot meet: chains that fewer than about one start in [`MAX_TRIALS`] finds, and those
//! that are so near to a fold that single precision cannot tell them from their twins (`walk`).
//!
//! What chains bring must not count again where a path meets the light by chance, and what they do not look for is left to such
//! paths. Of surfaces' light each has a share where both find it ([`Chains::share`]): where a chain focuses light so much that paths often
//! meet the lamp, next to folds, and where few starts find it, it is theirs, and the search's noise is bounded by that of paths. Which share
//! it is depends on the chain alone ([`Chains::after`], [`Chains::share`]), but for the starts: a path that has met a light by a chain
//! looks for it as the search does, and so leaves its light as often as the search brings it ([`Caustics::found`]):
//!
//! - a chain has at most [`MAX_VERTICES`] vertices: refractions by smooth dielectrics and reflections by smooth conductors, in any order,
//!   and at most one reflection by a dielectric; surfaces that let light straight through may be on its way;
//! - its light is a point, a spot, parallel light or the sun, or a surface seen under a small angle from where the chain starts
//!   ([`LARGEST`]): large lights are found by chance with less noise; and there chains start where something is diffuse only.

mod casters;
mod walk;

use super::Estimate;
use super::caustics::{Caustics, Place, Start};
use super::light_sampling::beyond;
use crate::accel::{Hit, Ray};
use crate::bsdf::{BsdfSample, Lobe};
use crate::light::{AreaGeometry, Light, LightContext, LightSampler, LightSelection};
use crate::material::Scatter;
use crate::math::{Vec2, Vec3};
use crate::sampler::{HashRng, SampleStream};
use crate::scene::{Scene, Surface};
use crate::shape::{Shape, area_to_solid_angle, triangle};
use crate::spectrum::Spectrum;
use casters::Casters;
use walk::{Beam, Caster, MAX_VERTICES, Origin, Plan, Solution, Target, Tracer};

/// Starts after which a chain that was not found again is given up, for lights that chance cannot meet and for others, whose light is then
/// left to paths. The mean number of starts is no more than the number of chains and one, whatever their probabilities.
const MAX_TRIALS: u32 = 4096;
const MAX_TRIALS_SHARED: u32 = 128;
/// A surface that emits is large where its radius is more than this share of its distance.
const LARGEST: f32 = 0.12;
/// How often a start aims straight at the light; else at a random point of a caster.
const STRAIGHT: f32 = 0.5;
/// How often chains are looked for where no caster is between a point and the light.
const IN_PLAIN_VIEW: f32 = 0.5;
/// Probabilities that a chain is one that glass reflects at the first vertex, at the second, or at a later one.
const REFLECTS_AT: [f32; 2] = [0.1, 0.12];
const REFLECTS_LATER: f32 = 0.06;
/// For the share of the search in the light of a surface: the ratio of the densities of the search and of paths for a chain whose end
/// spreads over the square of the surface's radius for each unit of solid angle at its start; the same for chains that glass reflects
/// over that of others; and the least share for which chains are looked for.
const SEARCHED: f32 = 0.25;
const SEARCHED_REFLECTIONS: f32 = 0.1;
const LEAST_SHARE: f32 = 0.02;
/// Surfaces between the last vertex and a light that let light straight through.
const MAX_CROSSINGS: u32 = 64;
/// No vertex.
const NOWHERE: u32 = u32::MAX;
/// How often the point of a light is sampled as for direct light: from where the chain starts most chains see the same side.
const AS_DIRECT: f32 = 0.75;

/// The chains that lead to lights, and how to find them.
pub(super) struct Chains {
    casters: Casters,
    /// Where the middle of each light is, and how large; nothing for lights that no chains are looked for to.
    sizes: Vec<Option<Size>>,
    by_power: LightSampler,
}

/// What is known of a light.
#[derive(Clone, Copy)]
enum Size {
    /// Small from everywhere.
    Small,
    /// Part of a surface within a ball.
    Ball(Vec3, f32),
}

/// Where chains start, and of which kinds.
#[derive(Clone, Copy)]
struct Foot {
    origin: Origin,
    diffuse: bool,
    /// The most vertices.
    longest: u32,
}

impl Foot {
    fn new(place: Place, longest: u32) -> Self {
        let longest = longest.min(MAX_VERTICES);
        match place {
            Place::Surface(s, scatter) => Self { origin: Origin { p: s.p, ng: s.ng }, diffuse: scatter.has_diffuse(), longest },
            Place::Medium(p, _) => Self { origin: Origin { p, ng: Vec3::ZERO }, diffuse: true, longest },
        }
    }
}

/// The chain that a path has followed since its last rough surface or point of a medium.
#[derive(Clone, Copy)]
pub(super) struct Followed {
    foot: Foot,
    /// Its unit direction at the start, once it is known.
    first: Option<Vec3>,
    plan: Plan,
    /// The vertex at which glass has reflected.
    reflect: u32,
}

impl Chains {
    /// Those of a scene; `None` where nothing makes any.
    pub fn new(scene: &Scene) -> Option<Self> {
        let casters = Casters::new(scene)?;
        let sizes: Vec<_> = (0..scene.lights.len()).map(|i| size(scene, i, &casters)).collect();
        let by_power = LightSampler::new(&scene.lights, &scene.sphere(), LightSelection::Power);
        sizes.iter().any(Option::is_some).then_some(Self { casters, sizes, by_power })
    }

    /// The chain of a path after one more vertex where it was scattered by a delta lobe; `None` where it is one that is not looked for.
    #[inline]
    pub fn after(&self, chain: Option<Followed>, s: &Surface, lobe: Lobe) -> Option<Followed> {
        let c = chain.filter(|c| c.plan.vertices < MAX_VERTICES && s.solid.is_none())?;
        let reflects = lobe.contains(Lobe::REFLECTION);
        let glass_reflects = self.casters.of_material(s.material)? != Caster::Mirror && reflects;
        if glass_reflects && c.reflect != NOWHERE {
            return None;
        }
        let first = match c.first {
            Some(first) => first,
            None => (s.p - c.foot.origin.p).try_normalize()?,
        };
        let Plan { vertices, reflects: before } = c.plan;
        let plan = Plan { vertices: vertices + 1, reflects: before | u32::from(reflects) << vertices };
        Some(Followed { first: Some(first), plan, reflect: if glass_reflects { vertices } else { c.reflect }, ..c })
    }

    /// Whether chains that start at a point are looked for to a light.
    #[inline]
    fn covers(&self, scene: &Scene, light: u32, from: &Foot) -> bool {
        match self.sizes[light as usize] {
            None => false,
            Some(Size::Small) => from.diffuse || scene.lights[light as usize].is_delta(),
            Some(Size::Ball(center, radius)) => {
                from.diffuse && radius * radius < (LARGEST * LARGEST) * (center - from.origin.p).length_squared()
            }
        }
    }

    /// The share of the light of a chain that the search brings; paths that meet the light by chance bring the rest. A function of the
    /// chain alone, after the power heuristic (Veach 1997, section 9.2.2) for the density of the search over that of paths, but for what
    /// nobody knows of the former. `None`: all is left to paths.
    fn share(&self, light: u32, glass_reflects: bool, determinant: f32) -> Option<f32> {
        let Some(Size::Ball(_, radius)) = self.sizes[light as usize] else { return Some(1.0) };
        let ratio = SEARCHED * determinant.abs() / (radius * radius) * if glass_reflects { SEARCHED_REFLECTIONS } else { 1.0 };
        let share = if ratio > 1.0 { 1.0 / (1.0 + 1.0 / (ratio * ratio)) } else { ratio * ratio / (1.0 + ratio * ratio) };
        (share > LEAST_SHARE).then_some(share)
    }

    /// A chain that a path has followed to a light, and the point that it meets there.
    fn solution(&self, tracer: &Tracer, chain: &Followed, light: u32) -> Option<(Solution, Target)> {
        let (scene, plan, w) = (tracer.scene, chain.plan, chain.first?);
        let end = tracer.follow(w, plan)?;
        let target = self.target(scene, &end, light)?;
        let determinant = target.sound_determinant(&end)?;
        Some((Solution { w, plan, end, determinant }, target))
    }

    /// The point of a light that the last edge of a chain meets.
    fn target(&self, scene: &Scene, end: &Beam, light: u32) -> Option<Target> {
        if !matches!(scene.lights[light as usize], Light::Area(_)) {
            return Some(Target::Direction(end.d));
        }
        let mut ray = Ray::new(end.o, end.d);
        for _ in 0..MAX_CROSSINGS {
            let s = scene.intersect(&ray)?;
            if s.light(scene) == Some(light) {
                return Some(Target::Point(s.p));
            }
            ray = beyond(&ray, &s);
        }
        None
    }

    fn tracer<'a>(&'a self, scene: &'a Scene, foot: &Foot) -> Tracer<'a> {
        Tracer { scene, casters: self.casters.by_material(), start: foot.origin }
    }

    fn pmf(&self, scene: &Scene, foot: &Foot, light: u32) -> f32 {
        let ctx = LightContext { p: foot.origin.p, n: Vec3::ZERO };
        0.5 * (self.by_power.pmf(&ctx, light) + scene.light_sampler.pmf(&ctx, light))
    }

    /// An unbiased estimate of the light that chains from a foot bring to a point and that it sends to the viewer, with its light group.
    /// `None`: nothing.
    fn estimate(&self, scene: &Scene, start: &Start, foot: &Foot, rng: &mut HashRng) -> Option<(Spectrum, u32)> {
        let ctx = LightContext { p: foot.origin.p, n: Vec3::ZERO };
        let sampler = if rng.next_1d() < 0.5 { &self.by_power } else { &scene.light_sampler };
        let (light, _) = sampler.sample(&ctx, rng.next_1d())?;
        if foot.longest == 0 || !self.covers(scene, light, foot) {
            return None;
        }
        let source = Source::sample(scene, light, &ctx, rng)?;
        let tracer = self.tracer(scene, foot);
        let (reflect, kind) = choose_reflection(rng.next_1d(), foot.longest);
        let mut search = Search::new(&tracer, &self.casters, source.target, foot.longest, reflect);
        // Where the light is in plain view, little comes by chains.
        let chance = if search.straight.is_some() { 1.0 } else { IN_PLAIN_VIEW };
        if rng.next_1d() >= chance {
            return None;
        }
        let first = search.chain(rng)?;
        let f = start.eval(first.w);
        if f.is_black() {
            return None;
        }
        let own = self.share(light, reflect != NOWHERE, first.determinant)?;
        let sent = source.sent(scene, light, &first)? * own;
        let through = tracer.value(&first, source.target, start.media(scene, first.w), rng)?;
        let value = f * through * sent / (first.determinant.abs() * kind * chance * self.pmf(scene, foot, light));
        if value.is_black() || !value.is_finite() {
            return None;
        }
        // The number of starts until the chain is found again.
        let trials = (1..=max_trials(scene, light)).find(|_| search.chain(rng).is_some_and(|again| again.is(&first)))?;
        Some((value * trials as f32, scene.light_groups[light as usize]))
    }
}

/// Starts after which a chain to a light is given up.
fn max_trials(scene: &Scene, light: u32) -> u32 {
    if scene.lights[light as usize].is_delta() { MAX_TRIALS } else { MAX_TRIALS_SHARED }
}

/// First dimension of the numbers that the search for chains takes: beyond those of any path.
const CHAIN_DIMENSIONS: u32 = 5 << 16;

/// How often chains are looked for beyond what the camera sees first: there they are averaged anyhow.
const DEEP_CHAINS: f32 = 0.5;

/// The random numbers for chains of a path, and the chain that it has followed, where it is one that is looked for.
#[derive(Clone)]
pub(super) struct Trail {
    rng: HashRng,
    /// Where the path is, if it is where chains can start.
    here: Option<Foot>,
    chain: Option<Followed>,
}

impl Trail {
    /// The path starts a chain where it is.
    fn begin(&mut self, first: Option<Vec3>) {
        self.chain = self.here.map(|foot| Followed { foot, first, plan: Plan::default(), reflect: NOWHERE });
    }
}

impl Caustics for Chains {
    type Trail = Trail;

    fn start(&self, stream: &SampleStream) -> Trail {
        Trail { rng: stream.at(CHAIN_DIMENSIONS).rng(), here: None, chain: None }
    }

    #[inline(never)]
    fn add(&self, scene: &Scene, start: &Start, throughput: Spectrum, depths: [u32; 2], trail: &mut Trail, out: &mut Estimate) {
        let [depth, max_depth] = depths;
        let foot = Foot::new(start.place, max_depth - depth - 1);
        trail.here = Some(foot);
        let chance = if depth == 0 { 1.0 } else { DEEP_CHAINS };
        if trail.rng.next_1d() >= chance {
            return;
        }
        if let Some((light, group)) = self.estimate(scene, start, &foot, &mut trail.rng) {
            out.add(throughput * light / chance, group);
        }
    }

    #[inline]
    fn scattered(&self, trail: &mut Trail, s: &Surface, _: &Scatter, sample: &BsdfSample) {
        if sample.lobe.contains(Lobe::DELTA) {
            trail.chain = self.after(trail.chain, s, sample.lobe);
        } else {
            trail.begin(Some(sample.wi));
        }
    }

    #[inline]
    fn scattered_in_medium(&self, trail: &mut Trail, _: Vec3) {
        trail.begin(None);
    }

    #[inline]
    fn found(&self, scene: &Scene, trail: &Trail, light: u32) -> bool {
        let Some(chain) = trail.chain.filter(|c| c.plan.vertices > 0 && self.covers(scene, light, &c.foot)) else { return false };
        if !(self.pmf(scene, &chain.foot, light) > 0.0) {
            return false;
        }
        let tracer = self.tracer(scene, &chain.foot);
        let Some((solution, target)) = self.solution(&tracer, &chain, light) else { return false };
        let Some(own) = self.share(light, chain.reflect != NOWHERE, solution.determinant) else { return false };
        let mut rng = trail.rng;
        // All of the light or nothing, by chance: in the mean what the search does not bring.
        if rng.next_1d() >= own {
            return false;
        }
        // A chain that one start finds with a probability p has the share Σ n p² (1 − p)ⁿ⁻¹, n up to the most trials, of its light by the search,
        // which is the probability that so many starts and one find it twice.
        let mut search = Search::new(&tracer, &self.casters, target, chain.foot.longest, chain.reflect);
        let starts = 0..=max_trials(scene, light);
        starts.filter(|_| search.chain(&mut rng).is_some_and(|again| again.is(&solution))).nth(1).is_some()
    }

    #[inline]
    fn finds_direct(&self, _: &Trail, _: &Scatter, _: u32) -> bool {
        false
    }
}

/// The search for chains of a kind from a point to a point of a light.
struct Search<'a> {
    tracer: &'a Tracer<'a>,
    casters: &'a Casters,
    target: Target,
    longest: u32,
    /// The vertex at which glass reflects.
    reflect: u32,
    /// Straight to the light, where a caster is in the way, and the chain that this start leads to once it is known.
    straight: Option<Straight>,
}

struct Straight {
    w: Vec3,
    plan: Plan,
    chain: Option<Option<Solution>>,
}

impl<'a> Search<'a> {
    fn new(tracer: &'a Tracer, casters: &'a Casters, target: Target, longest: u32, reflect: u32) -> Self {
        let w = match target {
            Target::Point(to) => (to - tracer.start.p).try_normalize(),
            Target::Direction(d) => Some(d),
        };
        // Reflections are seldom on the straight way.
        let straight = w
            .filter(|_| reflect == NOWHERE)
            .and_then(|w| Some(Straight { w, plan: tracer.plan(w, target, reflect, longest, 1.0)?, chain: None }));
        Self { tracer, casters, target, longest, reflect, straight }
    }

    /// A chain from a random start.
    fn chain(&mut self, rng: &mut HashRng) -> Option<Solution> {
        let (u_aim, u_length) = (rng.next_1d(), rng.next_1d());
        if u_aim < STRAIGHT
            && let Some(straight) = &mut self.straight
        {
            let Straight { w, plan, chain } = straight;
            return *chain.get_or_insert_with(|| self.tracer.solve(*w, *plan, self.target));
        }
        let p = self.tracer.start.p;
        let w = (self.casters.point(self.tracer.scene, p, rng)? - p).try_normalize()?;
        let plan = self.tracer.plan(w, self.target, self.reflect, self.longest, u_length)?;
        self.tracer.solve(w, plan, self.target)
    }
}

/// The vertex at which glass reflects, with its probability.
fn choose_reflection(u: f32, longest: u32) -> (u32, f32) {
    let [first, second] = REFLECTS_AT;
    let further = longest.saturating_sub(2);
    if u < first {
        return (0, first);
    }
    if u < first + second && longest > 1 {
        return (1, second);
    }
    let start = if longest > 1 { first + second } else { first };
    let share = REFLECTS_LATER / further.max(1) as f32;
    if further > 0 && u < start + REFLECTS_LATER {
        return ((2 + ((u - start) / share) as u32).min(longest - 1), share);
    }
    (NOWHERE, 1.0 - start - if further > 0 { REFLECTS_LATER } else { 0.0 })
}

/// The point or direction of a light that chains are to lead to.
struct Source {
    target: Target,
    /// A light's own surface.
    surface: Option<Surface>,
    /// Density by area of the surface point; per solid angle for the sun; 1 for deltas.
    pdf: f32,
    u: Vec2,
}

impl Source {
    fn sample(scene: &Scene, light: u32, ctx: &LightContext, rng: &mut HashRng) -> Option<Self> {
        let as_direct = rng.next_1d() < AS_DIRECT;
        let u = Vec2::new(rng.next_1d(), rng.next_1d());
        let of = &scene.lights[light as usize];
        let Light::Area(area) = of else {
            let sample = of.sample(ctx, u)?;
            let target = if sample.dist.is_finite() { Target::Point(sample.p) } else { Target::Direction(sample.wi) };
            return (sample.pdf > 0.0).then_some(Self { target, surface: None, pdf: if sample.delta { 1.0 } else { sample.pdf }, u });
        };
        let (p, uv) = if as_direct {
            let sample = area.sample(ctx, u)?;
            (sample.p, sample.uv)
        } else {
            let sample = match &area.geometry {
                AreaGeometry::Triangle(v) => triangle::sample_area(v, u)?,
                AreaGeometry::Shape(s) => s.sample_area(u)?,
            };
            (sample.p, sample.uv)
        };
        let source = scene.light_sources[area.emission_id as usize];
        let hit = Hit { t: 0.0, u: uv.x, v: uv.y, prim: source.primitive, instance: 0 };
        let surface = scene.surface(&Ray::new(p, Vec3::Z), &hit);
        let to = ctx.p - p;
        // Spheres are sampled on the side that is seen.
        let seen = match &area.geometry {
            AreaGeometry::Shape(s) if let Shape::Sphere(s) = &**s => (p - s.center()).dot(to) > 0.0,
            _ => true,
        };
        let lit = seen && (area.two_sided || surface.ng.dot(to) > 0.0);
        let direct = if lit { area.pdf(ctx, p, surface.ng) / area_to_solid_angle(ctx.p, p, surface.ng) } else { 0.0 };
        let pdf = AS_DIRECT * direct + (1.0 - AS_DIRECT) * area.pdf_area(p);
        (pdf > 0.0 && pdf.is_finite()).then_some(Self { target: Target::Point(p), surface: Some(surface), pdf, u })
    }

    /// Power per solid angle that goes along the last edge (irradiance for lights without a place), over the density of the point.
    fn sent(&self, scene: &Scene, light: u32, solution: &Solution) -> Option<Spectrum> {
        let end = &solution.end;
        let sent = match (&self.surface, self.target) {
            (Some(surface), _) => scene.emitted(surface, -end.d) * surface.ng.dot(end.d).abs(),
            (None, target) => {
                let sample = scene.lights[light as usize].sample(&LightContext { p: end.o, n: Vec3::ZERO }, self.u)?;
                let radiance = scene.light_radiance(light, &sample);
                match target {
                    Target::Point(p) => radiance * (p - end.o).length_squared(),
                    Target::Direction(_) => radiance,
                }
            }
        };
        (!sent.is_black()).then(|| sent / self.pdf)
    }
}

/// How large a light is; `None` where no chains are looked for to it.
fn size(scene: &Scene, light: usize, casters: &Casters) -> Option<Size> {
    match &scene.lights[light] {
        Light::Point(_) | Light::Spot(_) | Light::Picture(_) | Light::Directional(_) | Light::Sun(_) => Some(Size::Small),
        Light::Constant(_) | Light::Environment(_) | Light::Portal(_) => None,
        Light::Area(area) => {
            let source = scene.light_sources.get(area.emission_id as usize)?;
            let object = scene.geometries.first()?.objects.get(source.object as usize)?;
            if casters.of_material(object.material).is_some() {
                return None;
            }
            let (center, radius) = casters.ball_of_light(scene, source.object)?;
            (radius.is_finite() && center.is_finite()).then_some(Size::Ball(center, radius))
        }
    }
}
