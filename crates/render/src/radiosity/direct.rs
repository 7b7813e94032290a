//! Light that comes straight from what is no surface: points, spots, the sun, the sky. Elements get it by shadow rays before the
//! exchange between surfaces starts.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::form_factor::{PairRandom, point_of, quarter};
use super::mesh::{MAX_LEVEL, Mesh, Node};
use crate::accel::Ray;
use crate::light::{Light, LightContext, LightSample};
use crate::math::Frame;
use crate::math::warp;
use crate::scene::surface::offset;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// More lights than this are chosen among at each point.
const MANY_LIGHTS: usize = 16;
/// Directions by each technique in which a point looks for a light that is all around.
const SKY_SAMPLES: u32 = 4;
/// Points of an element that look for light.
const POINTS: u32 = 16;
/// Random numbers of points that look for light, and of those that look for shadow edges: the points that decide that an element is
/// even must not be those that light it, or places that few points find would be too dark.
const LIGHT: u32 = 0xd1_4ec7;
const EDGES: u32 = 0xed_6e55;
/// More lights without a size than this are not looked for anew at each point that is looked up.
const MOST_EXACT: usize = 8;
/// Shadow rays end this much (relative) before a light.
const SHADOW_END: f32 = 1.0 - 1e-4;

/// Lights of a scene that are no surfaces.
#[derive(Clone, Debug)]
pub struct DirectLights {
    lights: Vec<u32>,
    /// Lights that give no noise: their direct light is looked at for shadow edges.
    has_delta: bool,
    /// Lights without a size, where they are few: see [`DirectLights::exact`].
    exact: Vec<u32>,
    seed: u64,
}

/// Irradiance at a point by a light that is all around, from [`SKY_SAMPLES`] directions by the light's radiance and as many by
/// the cosine, weighted by the balance heuristic. The directions of an element's points are one low-discrepancy sequence (Roberts 2018, the R₂ sequence) with
/// a random shift.
fn sky(scene: &Scene, light: &Light, ctx: &LightContext, random: PairRandom, base: u32, k: u32) -> Spectrum {
    let frame = Frame::from_normal(ctx.n);
    let shift = random.pair(0x4000_0000 | k);
    let mut sum = Spectrum::ZERO;
    for i in 0..2 * SKY_SAMPLES {
        let step = (base & 0xfff) * SKY_SAMPLES + i / 2;
        let u = (shift + Vec2::new(0.754_877_7, 0.569_840_3) * step as f32).fract();
        let wi = if i % 2 == 0 {
            let Some(sample) = light.sample(ctx, u) else { continue };
            sample.wi
        } else {
            frame.world_from_local(warp::cosine_hemisphere(u))
        };
        let cos = ctx.n.dot(wi);
        let pdf = light.pdf_escaped(ctx, wi) + cos * std::f32::consts::FRAC_1_PI;
        if cos <= 0.0 || !(pdf > 0.0) {
            continue;
        }
        let share = super::form_factor::passes(scene, Ray::new(offset(ctx.p, ctx.n), wi));
        if share > 0.0 {
            let e = light.escaped(ctx.p, wi) * (cos * share / (pdf * SKY_SAMPLES as f32));
            if e.is_finite() {
                sum += e.map(|v| v.min(1e18));
            }
        }
    }
    sum
}

/// The share of a light's sample that passes to a point.
fn passing(scene: &Scene, o: Vec3, sample: &LightSample) -> f32 {
    let ray = if sample.dist.is_finite() { Ray { o, d: sample.p - o, t_min: 0.0, t_max: SHADOW_END } } else { Ray::new(o, sample.wi) };
    super::form_factor::passes(scene, ray)
}

impl DirectLights {
    /// The lights of a scene that are no surfaces.
    pub fn new(scene: &Scene, seed: u64) -> Self {
        let lights: Vec<u32> = (0..scene.lights.len() as u32).filter(|&i| !matches!(scene.lights[i as usize], Light::Area(_))).collect();
        let is_sharp = |l: &u32| matches!(scene.lights[*l as usize], Light::Sun(_)) || scene.lights[*l as usize].is_delta();
        let has_delta = lights.iter().any(is_sharp);
        let mut exact: Vec<u32> = lights.iter().copied().filter(|&l| scene.lights[l as usize].is_delta()).collect();
        if exact.len() > MOST_EXACT {
            exact.clear();
        }
        Self { lights, has_delta, exact, seed }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// Irradiance at a point from one sample of each light that `wants` it.
    fn at(&self, scene: &Scene, p: Vec3, n: Vec3, random: PairRandom, base: u32, wants: impl Fn(&Light) -> bool) -> Spectrum {
        let ctx = LightContext { p, n };
        let mut sum = Spectrum::ZERO;
        let count = self.lights.len();
        let (step, weight) = if count > MANY_LIGHTS { (count.div_ceil(MANY_LIGHTS), count.div_ceil(MANY_LIGHTS) as f32) } else { (1, 1.0) };
        // Every `step`-th light from a random one on, each with the chance 1 / `step`.
        let first = if step > 1 { (random.pair(base ^ 0x8000_0000).x * step as f32) as usize } else { 0 };
        for k in (first..count).step_by(step) {
            let light = &scene.lights[self.lights[k] as usize];
            if !wants(light) {
                continue;
            }
            if light.is_infinite() && !light.is_delta() && !matches!(light, Light::Sun(_)) {
                sum += sky(scene, light, &ctx, random, base, k as u32) * weight;
                continue;
            }
            let Some(sample) = light.sample(&ctx, random.pair(base.wrapping_mul(0x1_0001).wrapping_add(k as u32))) else { continue };
            let cos = n.dot(sample.wi);
            if cos <= 0.0 {
                continue;
            }
            let share = passing(scene, offset(p, n), &sample);
            if share > 0.0 {
                let e = sample.radiance * (cos * share * weight / sample.pdf);
                if e.is_finite() {
                    // Sums over a scene must not overflow.
                    sum += e.map(|v| v.min(1e18));
                }
            }
        }
        sum
    }

    /// Mean irradiance of the four quarters of an element, from `n` points in each; `series` selects the random numbers.
    fn quarters(&self, scene: &Scene, mesh: &Mesh, index: u32, n: u32, series: u32, wants: impl Fn(&Light) -> bool) -> [Spectrum; 4] {
        let node = &mesh.nodes[index as usize];
        let face = mesh.face(node);
        let random = PairRandom::new(self.seed, index, series);
        std::array::from_fn(|i| {
            let corners = quarter(&node.corners, i);
            let mut sum = Spectrum::ZERO;
            for k in 0..n {
                let at = k * 4 + i as u32;
                let p = if n == 1 { (corners[0] + corners[1] + corners[2]) / 3.0 } else { point_of(&corners, random.pair(at)) };
                let (p, normal) = mesh.faces.on_surface(scene, face, p);
                sum += self.at(scene, p, normal, random, 0x1000 + at, &wants);
            }
            sum / n as f32
        })
    }

    /// Mean direct irradiance of the given nodes, W·m⁻².
    pub fn irradiance(&self, scene: &Scene, mesh: &Mesh, nodes: &[u32]) -> Vec<Spectrum> {
        self.irradiance_by(scene, mesh, nodes, self.is_empty(), |_| true)
    }

    /// The part of [`DirectLights::irradiance`] that [`DirectLights::exact`] finds at single points: the same samples of these lights.
    pub fn irradiance_of_exact(&self, scene: &Scene, mesh: &Mesh, nodes: &[u32]) -> Vec<Spectrum> {
        self.irradiance_by(scene, mesh, nodes, self.exact.is_empty(), Light::is_delta)
    }

    /// Irradiance at a surface point, on the side of its shading normal, from the lights without a size. Their shadows have edges that no
    /// mesh follows, and one ray finds them. Zero where there are too many.
    pub fn exact(&self, scene: &Scene, s: &Surface) -> Spectrum {
        let n = s.frame.n;
        let ng = if s.ng.dot(n) < 0.0 { -s.ng } else { s.ng };
        let ctx = LightContext { p: s.p, n };
        let mut sum = Spectrum::ZERO;
        for &l in &self.exact {
            let Some(sample) = scene.lights[l as usize].sample(&ctx, Vec2::splat(0.5)) else { continue };
            let cos = n.dot(sample.wi);
            if cos > 0.0 && ng.dot(sample.wi) > 0.0 {
                let e = sample.radiance * (cos * passing(scene, offset(s.p, ng), &sample) / sample.pdf);
                if e.is_finite() {
                    sum += e.map(|v| v.min(1e18));
                }
            }
        }
        sum
    }

    fn irradiance_by(
        &self,
        scene: &Scene,
        mesh: &Mesh,
        nodes: &[u32],
        is_none: bool,
        wants: impl Fn(&Light) -> bool + Sync,
    ) -> Vec<Spectrum> {
        if is_none {
            return vec![Spectrum::ZERO; nodes.len()];
        }
        nodes
            .par_iter()
            .map(|&i| {
                let q = self.quarters(scene, mesh, i, POINTS / 4, LIGHT, &wants);
                (q[0] + q[1] + q[2] + q[3]) * 0.25
            })
            .collect()
    }

    /// Subdivides elements across which the light of points, spots and the sun changes: at the edges of their shadows, and near them.
    /// `error` is the change of irradiance that is allowed in an element of the mean size, relative to the mean irradiance; twice as
    /// large elements are allowed half. Returns whether `limit` elements were met.
    pub fn subdivide(&self, scene: &Scene, mesh: &mut Mesh, error: f32, limit: usize) -> bool {
        if !self.has_delta {
            return false;
        }
        let sharp = |l: &Light| matches!(l, Light::Sun(_)) || l.is_delta();
        let mut candidates = mesh.leaves();
        let mut reference = None;
        let mut count = candidates.len();
        while !candidates.is_empty() {
            let found: Vec<[Spectrum; 4]> = candidates.par_iter().map(|&i| self.quarters(scene, mesh, i, 2, EDGES, sharp)).collect();
            let reference = *reference.get_or_insert_with(|| {
                let sum: f64 = found
                    .iter()
                    .zip(&candidates)
                    .map(|(q, &i)| f64::from((q[0] + q[1] + q[2] + q[3]).average() * 0.25) * f64::from(mesh.nodes[i as usize].area))
                    .sum();
                (sum / f64::from(mesh.area.max(1e-30))) as f32
            });
            let is_uneven = |node: &Node, q: &[Spectrum; 4]| {
                let (lo, hi) = q.iter().fold((f32::INFINITY, 0.0f32), |(lo, hi), v| (lo.min(v.average()), hi.max(v.average())));
                node.level < MAX_LEVEL && (hi - lo) * (node.area / mesh.area).sqrt() > error * reference
            };
            let uneven: Vec<u32> =
                candidates.iter().zip(&found).filter(|(i, q)| is_uneven(&mesh.nodes[**i as usize], q)).map(|(i, _)| *i).collect();
            if count + 3 * uneven.len() > limit {
                return true;
            }
            count += 3 * uneven.len();
            let first = mesh.subdivide(scene, &uneven);
            candidates = (first..mesh.nodes.len() as u32).collect();
        }
        false
    }
}
