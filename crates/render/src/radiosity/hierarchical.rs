//! Hierarchical radiosity (Hanrahan, Salzman and Aupperle 1991, "A Rapid Hierarchical Radiosity Algorithm", doi:10.1145/122718.122740)
//! with clusters (Smits, Arvo and Greenberg 1994, doi:10.1145/192161.192277).
//!
//! Light goes along links between nodes of any level. A link is refined (pushed down to the children of its receiver or its source)
//! until what is uncertain about the irradiance that it carries is small, weighted by the root of the receiver's area: the
//! BF refinement of the paper with the variation of the factor over the receiver instead of the factor itself, as in Lischinski, Smits
//! and Greenberg 1994 ("Bounds and Error Estimates for Radiosity", doi:10.1145/192161.192176). A shadow edge makes the factor vary, so
//! elements become small there and nowhere else. Links start as one, from the whole scene to itself.
//!
//! Rounds of refinement alternate with solutions on the links that there are, from a coarse error to the one asked for. Each round
//! decides about all links at once from the state before it, so that the result does not depend on threads.

use rayon::prelude::*;

use super::direct::DirectLights;
use super::exchange::{Factors, OTHER, Solved};
use super::mesh::{MAX_LEVEL, Mesh, Node};
use super::{Limits, Progress};
use crate::scene::Scene;
use crate::scene::geometry::NONE;
use crate::spectrum::Spectrum;

/// Light may go from the source to the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// The node that gets light.
    pub receiver: u32,
    /// The node that sends it.
    pub source: u32,
    /// Form factor; negative where it is not known yet, as long as the source is dark.
    pub factor: f32,
    /// How uncertain it is: its variation over the receiver, and what the rays may have missed.
    pub spread: f32,
    /// The factor that does not know how unevenly the source shines.
    pub geometric: f32,
    /// Rays that are worth it, from each quarter of the receiver.
    pub rays: u32,
}

/// Settings of the method.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// The error that a link may have; see the module.
    pub error: f32,
    /// Most elements and links.
    pub limits: Limits,
    /// Random numbers.
    pub seed: u64,
}

/// Rounds of refinement and solution.
const ROUNDS: [f32; 5] = [8.0, 4.0, 2.0, 1.0, 1.0];
/// From this round on it is known well enough how light is spread over sources: their factors stay.
const LIGHT_KNOWN: usize = 4;
/// Rounds at the end in which factors are found by rays that had no say in the refinement.
const FRESH_ROUNDS: usize = 2;
/// Rays from each quarter of a receiver at most.
const MOST_RAYS: u32 = 16;
/// How uncertain a factor is where the receiver is as large as its distance from the source.
const NEAR_ERROR: f32 = 0.4;
/// How uncertain a cluster's factor is: times its diameter over the distance.
const CLUSTER_ERROR: f32 = 2.0;
/// What a cluster's factor may be where all rays to it were blocked, over the factor without anything in between.
const UNSEEN: f32 = 0.1;
/// Bounces of a solution at most.
const MAX_BOUNCES: u32 = 400;
/// A solution ends when a bounce changes less than this share of all light.
const CONVERGED: f64 = 2e-5;

#[derive(Clone, Copy, PartialEq)]
enum Decision {
    Keep,
    Drop,
    SplitReceiver,
    SplitSource,
    SplitBoth,
}

/// The state while the method runs.
struct State<'a> {
    scene: &'a Scene,
    lights: &'a DirectLights,
    solved: Solved,
    links: Vec<Link>,
    seed: u64,
    /// Mean irradiance, weighted by itself.
    reference: f32,
    /// The area that has it.
    lit_area: f32,
    /// The error in use; grows where limits are met.
    error: f32,
    is_limited: bool,
    bounces: u32,
}

/// Solves on a hierarchy, which is refined further.
///
/// # Errors
/// None today; cancelled work returns early with whatever there is.
pub fn solve(scene: &Scene, mesh: Mesh, lights: &DirectLights, options: &Options, progress: &Progress) -> Result<Solved, String> {
    let count = mesh.nodes.len();
    let solved = Solved {
        mesh,
        direct: vec![Spectrum::ZERO; count],
        irradiance: vec![Spectrum::ZERO; count],
        radiosity: vec![Spectrum::ZERO; count],
        ..Solved::default()
    };
    if count == 0 {
        return Ok(solved);
    }
    let mut state = State {
        scene,
        lights,
        solved,
        links: vec![Link { receiver: 0, source: 0, factor: -1.0, spread: 0.0, geometric: 0.0, rays: 1 }],
        seed: options.seed,
        reference: 0.0,
        lit_area: 0.0,
        error: options.error,
        is_limited: false,
        bounces: 0,
    };
    let leaves = state.solved.mesh.leaves();
    state.light_up(&leaves);
    state.push_pull(&vec![Spectrum::ZERO; count]);
    for (round, scale) in ROUNDS.iter().enumerate() {
        if progress.is_cancelled() {
            break;
        }
        progress.tell("radiosity", round as f64 / ROUNDS.len() as f64);
        state.measure();
        if round < LIGHT_KNOWN {
            state.forget_spread();
        }
        state.refine(*scale, &options.limits, progress);
        state.converge(progress);
    }
    for _ in 0..FRESH_ROUNDS {
        if !progress.is_cancelled() {
            state.find_anew();
            state.converge(progress);
        }
    }
    progress.tell("radiosity", 1.0);
    Ok(state.finish(options))
}

impl State<'_> {
    /// Direct light of new leaves.
    fn light_up(&mut self, leaves: &[u32]) {
        let direct = self.lights.irradiance(self.scene, &self.solved.mesh, leaves);
        for (&i, d) in leaves.iter().zip(direct) {
            self.solved.direct[i as usize] = d;
        }
    }

    /// Mean irradiance and lit area, which errors are measured by.
    fn measure(&mut self) {
        let (mut first, mut second, mut emitted) = (0.0f64, 0.0f64, 0.0f64);
        for (i, n) in self.solved.mesh.nodes.iter().enumerate() {
            if n.is_leaf() && !n.is_cluster() {
                let (h, a) = (f64::from(self.solved.irradiance[i].average()), f64::from(n.area));
                first += h * a;
                second += h * h * a;
                emitted += f64::from(n.emission.average()) * a;
            }
        }
        let area = f64::from(self.solved.mesh.area);
        if first > 0.0 && second > 0.0 && emitted < first {
            self.reference = (second / first) as f32;
            self.lit_area = (first * first / second) as f32;
        } else {
            // Before the first solution: as if the emitted light fell on everything alike.
            self.reference = ((emitted + first) / area.max(1e-30)) as f32;
            self.lit_area = area as f32;
        }
    }

    /// Lets factors be found anew that depend on how light is spread over their sources: those of clusters and of what has elements.
    fn forget_spread(&mut self) {
        let nodes = &self.solved.mesh.nodes;
        self.links.par_iter_mut().filter(|l| !nodes[l.source as usize].is_leaf()).for_each(|l| l.factor = -1.0);
    }

    /// Finds the factors of all links by rays that had no say in the refinement. Links whose first rays happened to find too much have
    /// been refined, and those that happened to find nothing have not: what is left of the first rays is too dark.
    fn find_anew(&mut self) {
        let factors = Factors { scene: self.scene, mesh: &self.solved.mesh, seed: self.seed ^ OTHER };
        let (nodes, radiosity) = (&self.solved.mesh.nodes, &self.solved.radiosity);
        self.links.par_iter_mut().for_each(|l| {
            if !(radiosity[l.source as usize].average() > 0.0) || l.rays == 0 {
                return;
            }
            let has_cluster = nodes[l.receiver as usize].is_cluster() || nodes[l.source as usize].is_cluster();
            let e = if has_cluster {
                factors.clusters(l.receiver, l.source, l.rays as f32, radiosity)
            } else if let Some(pair) = factors.pair(l.receiver, l.source) {
                factors.trace(&pair, l.receiver, l.source, l.rays, radiosity)
            } else {
                return;
            };
            (l.factor, l.geometric) = (e.factor, e.geometric);
        });
    }

    /// Refines links until all are good enough for `scale` times the error.
    fn refine(&mut self, scale: f32, limits: &Limits, progress: &Progress) {
        let mut active = std::mem::take(&mut self.links);
        let mut settled: Vec<Link> = Vec::new();
        let mut elements = self.solved.mesh.leaf_count();
        while !active.is_empty() && !progress.is_cancelled() {
            let decided: Vec<(Link, Decision)> = active.par_iter().map(|l| self.decide(l, scale)).collect();
            // What this round would add.
            let mut split: Vec<u32> = Vec::new();
            let mut links = settled.len();
            for (l, d) in &decided {
                let add = |node: u32, split: &mut Vec<u32>| {
                    let n = &self.solved.mesh.nodes[node as usize];
                    if n.is_leaf() {
                        split.push(node);
                    }
                    if n.is_cluster() { 2 } else { 4 }
                };
                links += match d {
                    Decision::Keep => 1,
                    Decision::Drop => 0,
                    Decision::SplitReceiver => add(l.receiver, &mut split),
                    Decision::SplitSource => add(l.source, &mut split),
                    Decision::SplitBoth => add(l.receiver, &mut split) * add(l.source, &mut split),
                };
            }
            split.sort_unstable();
            split.dedup();
            if links > limits.links || elements + 3 * split.len() > limits.elements {
                self.is_limited = true;
                self.error *= 1.5;
                active = decided.into_iter().filter(|(_, d)| *d != Decision::Drop).map(|(l, _)| l).collect();
                if self.error > 1e6 {
                    break;
                }
                continue;
            }
            elements += 3 * split.len();
            self.subdivide(&split);
            let nodes = &self.solved.mesh.nodes;
            let mut next = Vec::new();
            for (l, d) in decided {
                let new = |receiver, source| Link { receiver, source, factor: -1.0, spread: 0.0, geometric: 0.0, rays: 1 };
                match d {
                    Decision::Keep => settled.push(l),
                    Decision::Drop => {}
                    Decision::SplitReceiver => next.extend(nodes[l.receiver as usize].children().map(|c| new(c, l.source))),
                    Decision::SplitSource => next.extend(nodes[l.source as usize].children().map(|c| new(l.receiver, c))),
                    Decision::SplitBoth => {
                        let sources = nodes[l.source as usize].children();
                        next.extend(nodes[l.receiver as usize].children().flat_map(|c| sources.clone().map(move |s| new(c, s))));
                    }
                }
            }
            active = next;
        }
        settled.extend(active);
        settled.par_sort_unstable_by_key(|l| (l.receiver, l.source));
        self.links = settled;
    }

    /// Subdivides elements; the new ones have their parents' light.
    fn subdivide(&mut self, leaves: &[u32]) {
        if leaves.is_empty() {
            return;
        }
        let first = self.solved.mesh.subdivide(self.scene, leaves);
        for i in first as usize..self.solved.mesh.nodes.len() {
            let node = &self.solved.mesh.nodes[i];
            let parent = node.parent as usize;
            let h = self.solved.irradiance[parent];
            self.solved.irradiance.push(h);
            self.solved.radiosity.push(node.emission + node.reflectance * h);
            self.solved.direct.push(self.solved.direct[parent]);
        }
        let new: Vec<u32> = (first..self.solved.mesh.nodes.len() as u32).collect();
        self.light_up(&new);
    }

    /// What to do with a link, whose factor is found where it is not known.
    fn decide(&self, link: &Link, scale: f32) -> (Link, Decision) {
        let mut l = *link;
        let (r, s) = (&self.solved.mesh.nodes[l.receiver as usize], &self.solved.mesh.nodes[l.source as usize]);
        let b = self.solved.radiosity[l.source as usize].average();
        if !(b > 0.0) {
            // A dark source: not worth a ray, but it may light up later.
            return (l, Decision::Keep);
        }
        if !r.is_cluster() && !s.is_cluster() && r.face == s.face {
            return (l, Decision::Drop);
        }
        if !self.faces_each_other(r, s) {
            return (l, Decision::Drop);
        }
        let threshold = self.error * scale * self.reference;
        let weight = (r.area / self.lit_area.max(1e-30)).sqrt();
        let dist = (r.center - s.center).length();
        let has_cluster = r.is_cluster() || s.is_cluster();
        if has_cluster && dist < r.radius + s.radius {
            if b * weight > 0.01 * threshold {
                return (l, self.split_larger(&l, r, s));
            }
            // So little light that where it goes does not matter.
            (l.factor, l.rays) = (0.0, 0);
            return (l, Decision::Keep);
        }
        if l.factor < 0.0 {
            // No more than the share of the view that a sphere about the source fills.
            let most =
                (s.radius * s.radius / (dist * dist).max(1e-30)).min(s.area / (std::f32::consts::PI * dist * dist).max(1e-30)).min(1.0);
            let importance = b * most * weight / threshold.max(1e-30);
            let factors = Factors { scene: self.scene, mesh: &self.solved.mesh, seed: self.seed };
            if has_cluster {
                let e = factors.clusters(l.receiver, l.source, importance, &self.solved.radiosity);
                (l.factor, l.geometric, l.rays) = (e.factor, e.geometric, if importance > 1.0 { 2 } else { 1 });
                l.spread = e.factor.max(UNSEEN * e.open);
            } else {
                let Some(pair) = factors.pair(l.receiver, l.source) else { return (l, Decision::Drop) };
                let importance = b * pair.open() * weight / threshold.max(1e-30);
                l.rays = ((0.25 * importance) as u32).clamp(1, MOST_RAYS);
                let e = factors.trace(&pair, l.receiver, l.source, l.rays, &self.solved.radiosity);
                (l.factor, l.geometric) = (e.factor, e.geometric);
                // One more ray might have found what the others did not.
                let missed = e.open / (4 * l.rays + 2) as f32;
                l.spread = e.spread.max(missed);
                if e.is_mixed() {
                    l.rays = (4 * l.rays).min(MOST_RAYS);
                }
            }
        }
        let of_receiver = match (r.is_cluster(), s.is_cluster()) {
            (true, _) => l.spread * CLUSTER_ERROR * 2.0 * r.radius / dist,
            (_, true) => l.spread * 2.0 * r.radius / dist,
            // A source near a receiver that is larger than their distance may fall between the points at which its factor was found.
            _ => l.spread.max(l.factor * (NEAR_ERROR * (r.radius / dist.max(1e-30)).min(1.0).powi(2)).max(0.01)),
        };
        let of_source = if s.is_cluster() {
            l.spread * b * CLUSTER_ERROR * 2.0 * s.radius / dist
        } else {
            let uneven = s.children().map(|c| (self.solved.radiosity[c as usize].average() - b).abs()).fold(0.0, f32::max);
            // Not the factor in use, which is small where the dark part of a source is near: that is found by few points of it.
            l.factor.max(l.geometric) * uneven
        };
        let of_receiver = of_receiver * b;
        if of_receiver.max(of_source) * weight <= threshold {
            return (l, Decision::Keep);
        }
        let can_split = |n: &Node| n.is_cluster() || !n.is_leaf() || n.level < MAX_LEVEL;
        let d = if of_receiver >= of_source && can_split(r) {
            Decision::SplitReceiver
        } else if of_source * weight > threshold && can_split(s) {
            Decision::SplitSource
        } else {
            Decision::Keep
        };
        (l, d)
    }

    /// Whether any part of each may be on the side to which the other shines.
    fn faces_each_other(&self, r: &Node, s: &Node) -> bool {
        let before = |plane: &Node, other: &Node| {
            if plane.is_cluster() {
                return true;
            }
            let height = |p: glam::Vec3| (p - plane.corners[0]).dot(self.solved.mesh.face(plane).normal);
            if other.is_cluster() { height(other.center) > -other.radius } else { other.corners.iter().any(|&c| height(c) > 0.0) }
        };
        before(r, s) && before(s, r)
    }

    fn split_larger(&self, l: &Link, r: &Node, s: &Node) -> Decision {
        if l.receiver == l.source {
            return Decision::SplitBoth;
        }
        // A surface near a cluster is split only where it is the larger one by far: the cluster has parts already.
        let size = |n: &Node| if n.is_cluster() { n.radius } else { 0.5 * n.radius };
        if size(r) >= size(s) && (r.is_cluster() || r.level < MAX_LEVEL) { Decision::SplitReceiver } else { Decision::SplitSource }
    }

    /// Bounces light over the links until nothing changes.
    fn converge(&mut self, progress: &Progress) {
        let offsets = offsets(&self.links, self.solved.mesh.nodes.len());
        for _ in 0..MAX_BOUNCES {
            if progress.is_cancelled() {
                return;
            }
            let gathered = gather(&self.solved.mesh, &self.links, &offsets, &self.solved.radiosity);
            let change = self.push_pull(&gathered);
            self.bounces += 1;
            if change < CONVERGED {
                return;
            }
        }
    }

    /// Adds up what was gathered from the faces down to the leaves, and radiosity from there up. Returns the change of all light, relative
    /// to it.
    fn push_pull(&mut self, gathered: &[Spectrum]) -> f64 {
        let solved = &mut self.solved;
        let (mut change, mut total) = (0.0f64, 0.0f64);
        let mut pushed = gathered.to_vec();
        for (i, n) in solved.mesh.nodes.iter().enumerate() {
            if n.is_cluster() {
                continue;
            }
            if n.level > 0 {
                pushed[i] = pushed[i] + pushed[n.parent as usize];
            }
            if n.is_leaf() {
                let h = pushed[i] + solved.direct[i];
                let b = n.emission + n.reflectance * h;
                let a = f64::from(n.area);
                change += f64::from((b - solved.radiosity[i]).map(f32::abs).average()) * a;
                total += f64::from(b.average()) * a;
                solved.irradiance[i] = h;
                solved.radiosity[i] = b;
            }
        }
        let Solved { mesh, radiosity, .. } = solved;
        mesh.pull(radiosity);
        if total > 0.0 { change / total } else { 0.0 }
    }

    fn finish(mut self, options: &Options) -> Solved {
        let offsets = offsets(&self.links, self.solved.mesh.nodes.len());
        let ones = vec![Spectrum::ONE; self.solved.mesh.nodes.len()];
        // Rows and reciprocity are of geometry: the factors in use also know how unevenly sources shine.
        let geometric = |l: &Link| if l.factor > 0.0 { Link { factor: l.geometric, ..*l } } else { *l };
        let links: Vec<Link> = self.links.par_iter().map(geometric).collect();
        let mut sums: Vec<f32> = gather(&self.solved.mesh, &links, &offsets, &ones).into_iter().map(|s| s.0[0]).collect();
        for (i, n) in self.solved.mesh.nodes.iter().enumerate() {
            if !n.is_cluster() && n.level > 0 {
                sums[i] += sums[n.parent as usize];
            }
        }
        self.solved.row_sums = sums;
        self.solved.reciprocity = reciprocity(&self.solved.mesh, &links);
        drop(links);
        let clusters = self.solved.mesh.nodes.iter().filter(|n| n.is_cluster()).count();
        let elements = self.solved.mesh.leaf_count();
        self.solved.notes.push(format!(
            "hierarchical: {} faces, {elements} elements, {clusters} clusters, {} links, {} bounces",
            self.solved.mesh.face_nodes.len(),
            self.links.len(),
            self.bounces
        ));
        if self.is_limited {
            self.solved.notes.push(format!(
                "the limits of {} elements and {} links were met: the error per link is {:.2e} instead of {:.2e} \
                 (--radiosity-elements, --radiosity-links)",
                options.limits.elements, options.limits.links, self.error, options.error
            ));
        }
        self.solved
    }
}

/// Where the links of each receiver start.
fn offsets(links: &[Link], nodes: usize) -> Vec<u32> {
    let mut offsets = vec![0u32; nodes + 1];
    for l in links {
        offsets[l.receiver as usize + 1] += 1;
    }
    for i in 0..nodes {
        offsets[i + 1] += offsets[i];
    }
    offsets
}

/// The irradiance that comes to each node that is no cluster along its own links; to faces also what their clusters get.
fn gather(mesh: &Mesh, links: &[Link], offsets: &[u32], radiosity: &[Spectrum]) -> Vec<Spectrum> {
    let of = |i: usize| &links[offsets[i] as usize..offsets[i + 1] as usize];
    (0..mesh.nodes.len())
        .into_par_iter()
        .map(|i| {
            let node = &mesh.nodes[i];
            if node.is_cluster() {
                return Spectrum::ZERO;
            }
            let mut sum = Spectrum::ZERO;
            for l in of(i) {
                if l.factor > 0.0 {
                    sum += radiosity[l.source as usize] * l.factor;
                }
            }
            if node.level > 0 {
                return sum;
            }
            let normal = mesh.face(node).normal;
            let mut at = node.parent;
            while at != NONE {
                let center = mesh.nodes[at as usize].center;
                for l in of(at as usize) {
                    if l.factor > 0.0 {
                        let cos = normal.dot((mesh.nodes[l.source as usize].center - center).normalize_or_zero());
                        if cos > 0.0 {
                            sum += radiosity[l.source as usize] * (l.factor * cos);
                        }
                    }
                }
                at = mesh.nodes[at as usize].parent;
            }
            sum
        })
        .collect()
}

/// How far pairs of links are from Aᵢ Fᵢⱼ = Aⱼ Fⱼᵢ; see [`Solved::reciprocity`].
fn reciprocity(mesh: &Mesh, links: &[Link]) -> Option<f32> {
    let (mut difference, mut sum) = (0.0f64, 0.0f64);
    for l in links.iter().filter(|l| l.receiver < l.source && l.factor > 0.0) {
        if mesh.nodes[l.receiver as usize].is_cluster() || mesh.nodes[l.source as usize].is_cluster() {
            continue;
        }
        let Ok(back) = links.binary_search_by_key(&(l.source, l.receiver), |k| (k.receiver, k.source)) else { continue };
        let back = links[back];
        if back.factor < 0.0 {
            continue;
        }
        let (a, b) =
            (f64::from(mesh.nodes[l.receiver as usize].area * l.factor), f64::from(mesh.nodes[l.source as usize].area * back.factor));
        difference += (a - b).abs();
        sum += 0.5 * (a + b);
    }
    (sum > 0.0).then(|| (difference / sum) as f32)
}
