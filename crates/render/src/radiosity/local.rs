//! The local pass: once the balance is found, each element looks around by rays of its own.
//!
//! The solvers find how much light goes between surfaces, and are coarse about where it arrives: a link is one number for all of its
//! receiver, and a few rays decide what passes through a window. Here each element takes the light of shining surfaces by next-event
//! estimation and all other light from the solution where its rays end, as in the second pass of Reichert 1992 ("A Two-Pass Radiosity Method
//! Driven by Lights and Viewer Position") and of Lischinski, Tampieri and Greenberg 1993 (doi:10.1145/166117.166143), but for elements
//! instead of pixels: the result still belongs to all views. It is Jacobi's iteration with rays in place of form factors, so what is wrong in
//! the solution loses a factor of the mean reflectance in each round; between rounds elements are subdivided where light varies.

use rayon::prelude::*;

use super::Progress;
use super::direct::DirectLights;
use super::exchange::Solved;
use super::form_factor::{passes, point_of};
use super::material::{may_pass, passing_share};
use super::mesh::MAX_LEVEL;
use super::reconstruct::Smooth;
use super::shapes::barycentric;
use crate::accel::Ray;
use crate::integrator::light_sampling::{pdf_surface, sample_one};
use crate::light::{Light, LightContext};
use crate::math::warp::{cosine_hemisphere, cosine_hemisphere_pdf, power_heuristic};
use crate::math::{Frame, INV_PI, Vec3};
use crate::sampler::{SampleStream, Sampler, SamplerKind};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Rays of all elements together in the last round where the user gives no number for each.
const ALL_RAYS: usize = 24_000_000;
/// Fewest and most rays of an element.
const RAYS: (u32, u32) = (16, 1024);
/// What the rays of the last round are divided by in each round before it. The first ones subdivide; those after them only let the light
/// go on bouncing, for which few rays are enough: the noise of one element is one of very many in what others see.
const FIRST_ROUNDS: [u32; 8] = [6, 6, 6, 6, 24, 24, 24, 24];
/// Rounds that subdivide.
const SUBDIVIDING: usize = 4;
/// The rays of an element over those of one of the mean area in all rounds but the last, at least and at most.
const BY_AREA: (f32, f32) = (0.25, 16.0);
/// The deviation of one look over the irradiance that rays of the last round go by, at least and at most.
const NOISE: (f32, f32) = (0.2, 20.0);
/// Rays of an element in the last round over the mean, at most. Few large elements may be all that is seen of a dark place.
const MOST_BY_NOISE: u32 = 1024;
/// How far the values at an element's corners are apart by noise alone, over the noise of the element: the range of three values that are
/// means of about six elements each, times two.
const SEEN_NOISE: f32 = 1.5;
/// Panes and holes on the way of a ray.
const MAX_CROSSINGS: u32 = 64;
/// Shadow rays end this much (relative) before a light.
const SHADOW_END: f32 = 1.0 - 1e-4;
/// What is darker than this share of the light in a typical place is judged by it: when elements are subdivided, and when rays are shared out.
const DARK: f32 = 0.05;
const DARK_TO_RAYS: f32 = 0.02;

/// Settings of the pass.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Rays of each element; `None` shares a fixed number among all.
    pub rays: Option<u32>,
    /// Elements that subdivision may lead to.
    pub elements: usize,
    /// Random numbers.
    pub seed: u64,
}

/// Replaces the irradiance of a solution's elements by what they see, and subdivides them where it varies. Returns a sentence.
pub fn refine(scene: &Scene, lights: &DirectLights, solved: &mut Solved, options: &Options, progress: &Progress) -> Option<String> {
    if options.rays == Some(0) || solved.mesh.nodes.is_empty() {
        return None;
    }
    let rays_of = |count: usize| options.rays.unwrap_or_else(|| ((ALL_RAYS / count.max(1)) as u32).clamp(RAYS.0, RAYS.1));
    for (round, share) in FIRST_ROUNDS.into_iter().enumerate() {
        let leaves = solved.mesh.leaves();
        let rays = (rays_of(leaves.len()) / share).max(1);
        let counts = by_area(solved, &leaves, rays);
        gather(scene, solved, &leaves, &counts, options.seed.wrapping_add(round as u64), progress, round);
        if round >= SUBDIVIDING {
            continue;
        }
        let first = solved.mesh.nodes.len() as u32;
        subdivide(scene, solved, options.elements, rays);
        let new: Vec<u32> = solved.mesh.leaves().into_iter().filter(|&i| i >= first).collect();
        for (&i, d) in new.iter().zip(lights.irradiance(scene, &solved.mesh, &new)) {
            solved.direct[i as usize] = d;
        }
    }
    let leaves = solved.mesh.leaves();
    let rays = rays_of(leaves.len());
    let counts = by_noise(solved, &leaves, rays);
    gather(scene, solved, &leaves, &counts, options.seed.wrapping_add(FIRST_ROUNDS.len() as u64), progress, FIRST_ROUNDS.len());
    Some(format!("local pass: {} elements look around with {rays} rays in the mean", leaves.len()))
}

/// One round: the irradiance of all elements from the radiosity of all; `counts` are the rays of each of the leaves.
fn gather(scene: &Scene, solved: &mut Solved, leaves: &[u32], counts: &[u32], seed: u64, progress: &Progress, round: usize) {
    let sampler = Sampler { kind: SamplerKind::Sobol, seed: seed ^ 0x10ca_19a5, spp: counts.iter().copied().max().unwrap_or(1) };
    let done = std::sync::atomic::AtomicUsize::new(0);
    // `None` for what a cancelled round has not reached.
    let found: Vec<Option<Found>> = leaves
        .par_iter()
        .zip(counts)
        .map(|(&leaf, &rays)| {
            let k = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            if k.is_multiple_of(1024) {
                progress.tell("local pass", (round as f64 + k as f64 / leaves.len() as f64) / (FIRST_ROUNDS.len() + 1) as f64);
            }
            (!progress.is_cancelled()).then(|| look_around(scene, solved, leaf, rays, &sampler))
        })
        .collect();
    let is_first = solved.outside.is_empty();
    solved.outside.resize(solved.mesh.nodes.len(), 1.0);
    solved.deviation.resize(solved.mesh.nodes.len(), 0.0);
    for (&leaf, found) in leaves.iter().zip(found) {
        let Some(found) = found else { continue };
        let i = leaf as usize;
        solved.outside[i] = found.outside;
        // What few rays find of their own spread is uncertain: rounds are averaged.
        solved.deviation[i] = if is_first { found.deviation } else { 0.5 * (solved.deviation[i] + found.deviation) };
        let node = &solved.mesh.nodes[i];
        solved.irradiance[i] = found.irradiance;
        solved.radiosity[i] = node.emission + node.reflectance * found.irradiance;
    }
    let Solved { mesh, radiosity, .. } = solved;
    mesh.pull(radiosity);
}

/// What an element has seen.
struct Found {
    irradiance: Spectrum,
    /// Standard deviation of one look.
    deviation: f32,
    /// The share of the element that does not lie inside of other bodies.
    outside: f32,
}

/// An element's irradiance from a number of looks.
fn look_around(scene: &Scene, solved: &Solved, leaf: u32, rays: u32, sampler: &Sampler) -> Found {
    let (mut sum, mut square, mut count) = (Spectrum::ZERO, 0.0f64, 0u32);
    for index in 0..rays {
        let Some(e) = look(scene, solved, leaf, &mut sampler.stream(leaf, 0, index)) else { continue };
        count += 1;
        if e.is_finite() {
            // Sums over a scene must not overflow.
            let e = e.map(|v| v.min(1e18));
            sum += e;
            square += f64::from(e.average()) * f64::from(e.average());
        }
    }
    if count == 0 {
        return Found { irradiance: Spectrum::ZERO, deviation: 0.0, outside: 0.0 };
    }
    let mean = sum / count as f32;
    let variance = (square / f64::from(count) - f64::from(mean.average()) * f64::from(mean.average())).max(0.0);
    // Lights that are no surfaces reach the part that is not inside of other bodies.
    let irradiance = solved.direct[leaf as usize] * (rays as f32 / count as f32) + mean;
    Found { irradiance, deviation: variance.sqrt() as f32, outside: count as f32 / rays as f32 }
}

/// Rays of each of the leaves by their area, `mean` for one of the mean area: so a large element, which is all that is seen in some
/// place, has no more noise than many small ones.
fn by_area(solved: &Solved, leaves: &[u32], mean: u32) -> Vec<u32> {
    let mean_area = solved.mesh.area / leaves.len().max(1) as f32;
    let share = |&i: &u32| (solved.mesh.nodes[i as usize].area / mean_area).clamp(BY_AREA.0, BY_AREA.1);
    leaves.iter().map(|i| ((mean as f32 * share(i)) as u32).max(1)).collect()
}

/// Rays of each of the leaves, `mean` in the mean, such that the relative noise of the mean over a place is least for the rays of all: in
/// proportion to area × deviation / irradiance (Neyman 1934, doi:10.2307/2342192, for strata that are weighted by area).
fn by_noise(solved: &Solved, leaves: &[u32], mean: u32) -> Vec<u32> {
    let reference = typical(solved, leaves);
    let want = |&i: &u32| {
        let (i, h) = (i as usize, solved.irradiance[i as usize].average());
        let size = (h + DARK_TO_RAYS * reference).max(1e-30);
        if solved.outside[i] > 0.0 { solved.mesh.nodes[i].area * (solved.deviation[i] / size).clamp(NOISE.0, NOISE.1) } else { 0.0 }
    };
    let sum: f64 = leaves.iter().map(|i| f64::from(want(i))).sum();
    let scale = if sum > 0.0 { f64::from(mean) * leaves.len() as f64 / sum } else { 0.0 };
    // Elements are seen one by one as well: none may be much noisier than others.
    let least = (mean / 2).max(1);
    leaves.iter().map(|i| ((f64::from(want(i)) * scale) as u32).clamp(least, mean.saturating_mul(MOST_BY_NOISE))).collect()
}

/// The irradiance of a typical place: the square of the mean root, as a bright place of small area must not make all others count as dark.
fn typical(solved: &Solved, leaves: &[u32]) -> f32 {
    let (mut sum, mut area) = (0.0f64, 0.0f64);
    for &i in leaves {
        let (h, a) = (f64::from(solved.irradiance[i as usize].average()), f64::from(solved.mesh.nodes[i as usize].area));
        if h > 0.0 {
            sum += h.sqrt() * a;
            area += a;
        }
    }
    if area > 0.0 { (sum / area * (sum / area)) as f32 } else { 0.0 }
}

/// One estimate of an element's irradiance: a point of it, a light and a direction, weighted against each other (Veach 1997, chapter 9).
/// `None` where the point lies inside of another body, as that of a floor under a wall: it must not make the part before the wall dark.
fn look(scene: &Scene, solved: &Solved, leaf: u32, stream: &mut SampleStream) -> Option<Spectrum> {
    let node = &solved.mesh.nodes[leaf as usize];
    let face = solved.mesh.face(node);
    let b = barycentric(&face.corners, point_of(&node.corners, stream.next_2d())).max(Vec3::ZERO);
    let mut s = solved.mesh.faces.surface(scene, face, b / (b.x + b.y + b.z).max(1e-20));
    if s.ng.dot(face.normal) < 0.0 {
        s.ng = -s.ng;
    }
    if s.frame.n.dot(s.ng) < 0.0 {
        s.frame = Frame::from_normal(-s.frame.n);
    }
    let n = s.frame.n;
    let above = |d: Vec3| n.dot(d) > 0.0 && s.ng.dot(d) > 0.0;
    let ctx = LightContext { p: s.p, n };
    let mut sum = Spectrum::ZERO;
    let is_surface = |light: u32| matches!(scene.lights[light as usize], Light::Area(_));
    if let Some(direct) = sample_one(scene, &ctx, stream).filter(|d| is_surface(d.light) && above(d.sample.wi)) {
        let wi = direct.sample.wi;
        let o = s.offset_origin(wi);
        let ray = Ray { o, d: direct.sample.p - o, t_min: 0.0, t_max: SHADOW_END };
        let cos = n.dot(wi);
        let weight = power_heuristic(direct.pdf, cosine_hemisphere_pdf(cos));
        sum += direct.radiance * (passes(scene, ray) * cos * weight / direct.pdf);
    }
    let d = s.frame.world_from_local(cosine_hemisphere(stream.next_2d()));
    let pdf = cosine_hemisphere_pdf(n.dot(d));
    if above(d) && pdf > 0.0 {
        let ray = Ray::new(s.offset_origin(d), d);
        let (radiance, meets_inside) = along(scene, solved, &ctx, ray, pdf);
        // Where bodies touch, light of the one seems to reach the inside of the other: what one ray has met does not tell.
        let reaches_inside = solved.outside.get(leaf as usize).is_some_and(|&share| share < 1.0);
        if (meets_inside || reaches_inside) && is_inside(scene, solved, &s) {
            return None;
        }
        sum += radiance * (n.dot(d) / pdf);
    }
    Some(sum)
}

/// Whether a ray first meets a side of a surface that neither reflects nor emits: the inside of a body.
fn meets_inside(scene: &Scene, solved: &Solved, ray: &Ray) -> bool {
    let Some(mut s) = scene.intersect(ray) else { return false };
    if s.ng.dot(ray.d) <= 0.0 || may_pass(scene, &scene.materials[s.material as usize]) {
        return false;
    }
    if s.ng.dot(s.frame.n) > 0.0 {
        s.frame.n = -s.frame.n;
    }
    solved.mesh.faces.locate(scene, &s).is_none()
}

/// Whether that is so in most of some directions from a point above a surface: where bodies touch, a ray may as well meet the other one.
fn is_inside(scene: &Scene, solved: &Solved, s: &Surface) -> bool {
    const DIRECTIONS: [[f32; 3]; 5] = [[0.0, 0.0, 1.0], [0.8, 0.1, 0.59], [-0.7, 0.4, 0.59], [0.1, -0.8, 0.59], [-0.3, 0.74, 0.6]];
    let frame = Frame::from_normal(s.ng);
    let is_inner = |&&d: &&[f32; 3]| {
        let d = frame.world_from_local(Vec3::from_array(d)).normalize_or_zero();
        meets_inside(scene, solved, &Ray::new(s.offset_origin(d), d))
    };
    DIRECTIONS.iter().filter(is_inner).count() > DIRECTIONS.len() / 2
}

/// Radiance along a ray: of shining surfaces, weighted against their own sampling, and what elements reflect; and whether it meets the inside of a
/// body first.
fn along(scene: &Scene, solved: &Solved, ctx: &LightContext, mut ray: Ray, pdf: f32) -> (Spectrum, bool) {
    let (mut through, mut sum) = (1.0f32, Spectrum::ZERO);
    for crossing in 0..MAX_CROSSINGS {
        // The sky is in the elements' direct light.
        let Some(mut s) = scene.intersect(&ray) else { break };
        let wo = -ray.d;
        if s.object(scene).emission.is_some() {
            let weight = s.light(scene).map_or(1.0, |light| power_heuristic(pdf, pdf_surface(scene, ctx, light, &s)));
            sum += scene.emitted(&s, wo) * (through * weight);
        }
        let share = share_through(scene, &s, wo);
        if s.ng.dot(wo) * s.ng.dot(s.frame.n) < 0.0 {
            s.frame.n = -s.frame.n;
        }
        if let Some((face, b)) = solved.mesh.faces.locate(scene, &s) {
            let (leaf, _) = solved.mesh.descend(face, b);
            let node = &solved.mesh.nodes[leaf as usize];
            sum += node.reflectance * solved.irradiance[leaf as usize] * (INV_PI * through);
        } else if crossing == 0 && share == 0.0 && s.ng.dot(wo) < 0.0 {
            return (sum, true);
        }
        through *= share;
        if !(through > 1e-3) {
            break;
        }
        ray = Ray::new(s.offset_origin(ray.d), ray.d);
    }
    (sum, false)
}

/// The share of light that a surface lets straight through.
fn share_through(scene: &Scene, s: &Surface, wo: Vec3) -> f32 {
    let material = &scene.materials[s.material as usize];
    if may_pass(scene, material) { passing_share(&material.shade(scene, s, wo), wo) } else { 0.0 }
}

/// Subdivides the elements over which irradiance varies most beyond the noise of `rays` rays, weighted by the root of their area, as long
/// as there may be more. An element of which a part lies inside of another body varies as much as any can: its light ends within it.
fn subdivide(scene: &Scene, solved: &mut Solved, limit: usize, rays: u32) {
    let room = limit.saturating_sub(solved.mesh.leaf_count()) / 3;
    if room == 0 {
        return;
    }
    let smooth = Smooth::new(scene, solved, 0);
    let leaves = solved.mesh.leaves();
    let reference = typical(solved, &leaves);
    let noise = SEEN_NOISE / (rays as f32).sqrt();
    let mut scores: Vec<(f32, u32)> = leaves
        .par_iter()
        .filter(|&&i| solved.mesh.nodes[i as usize].level < MAX_LEVEL)
        .map(|&i| {
            let (lo, hi) = smooth.range(i);
            let varies = (hi - lo - noise * solved.deviation[i as usize]) / (0.5 * (hi + lo) + DARK * reference).max(1e-30);
            let outside = solved.outside[i as usize];
            let varies = if outside > 0.0 && outside < 1.0 { 2.0 } else { varies };
            (varies * solved.mesh.nodes[i as usize].area.sqrt(), i)
        })
        .filter(|(score, _)| *score > 0.0)
        .collect();
    scores.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    // Balancing subdivides about as many again.
    scores.truncate((limit.saturating_sub(leaves.len()) / 6).min(leaves.len()));
    let mut chosen: Vec<u32> = scores.into_iter().map(|(_, i)| i).collect();
    chosen.sort_unstable();
    solved.subdivide(scene, &chosen);
}
