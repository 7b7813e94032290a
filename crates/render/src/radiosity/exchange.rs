//! What all solvers share: the factor between any two nodes, and the state that they leave.

use glam::Vec3;

use super::form_factor::{Estimate, Pair, PairRandom, Side, SourceLight, point_of, visibility};
use super::mesh::{Mesh, Node, descend_once};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Points that stand for a cluster.
const CLUSTER_SAMPLES: u32 = STRATA;
/// Parts of a cluster, of equal area, that its points come from in turn.
const STRATA: u32 = 16;

/// What changes a seed for rays that must not know of those that decided about them.
pub const OTHER: u64 = 0x9d39_247e_3377_6d41;

/// A solution on a mesh.
#[derive(Clone, Debug, Default)]
pub struct Solved {
    /// The elements; its leaves hold the solution.
    pub mesh: Mesh,
    /// Irradiance of the leaves from lights that are no surfaces, by node, W·m⁻².
    pub direct: Vec<Spectrum>,
    /// The part of it that comes from lights without a size, where few enough of them are there to be found anew at each point that is
    /// looked up; else empty.
    pub exact: Vec<Spectrum>,
    /// Irradiance of the leaves, direct light included, by node, W·m⁻².
    pub irradiance: Vec<Spectrum>,
    /// Radiosity of all nodes, W·m⁻².
    pub radiosity: Vec<Spectrum>,
    /// The share of leaves that does not lie inside of other bodies, where no one sees their light; by node. Empty before the
    /// [`super::local`] pass.
    pub outside: Vec<f32>,
    /// Standard deviation of one look of the [`super::local`] pass, W·m⁻², by node of leaves; empty before it.
    pub deviation: Vec<f32>,
    /// Sum of form factors of each leaf, by node; 1 in a closed room. Empty where the solver does not know it.
    pub row_sums: Vec<f32>,
    /// Mean of |Aᵢ Fᵢⱼ − Aⱼ Fⱼᵢ| over the mean of Aᵢ Fᵢⱼ; `None` where the solver has not both.
    pub reciprocity: Option<f32>,
    /// What the solver did, in sentences.
    pub notes: Vec<String>,
}

impl Solved {
    /// Subdivides leaves; the parts have the whole's light. Returns the first new node.
    pub fn subdivide(&mut self, scene: &Scene, leaves: &[u32]) -> u32 {
        let first = self.mesh.subdivide(scene, leaves);
        for i in first as usize..self.mesh.nodes.len() {
            let node = &self.mesh.nodes[i];
            let parent = node.parent as usize;
            self.irradiance.push(self.irradiance[parent]);
            self.direct.push(self.direct[parent]);
            self.radiosity.push(node.emission + node.reflectance * self.irradiance[parent]);
            if let Some(&e) = self.exact.get(parent) {
                self.exact.push(e);
            }
            if let Some(&sum) = self.row_sums.get(parent) {
                self.row_sums.push(sum);
            }
            for values in [&mut self.outside, &mut self.deviation] {
                if let Some(&v) = values.get(parent) {
                    values.push(v);
                }
            }
        }
        first
    }

    /// Fluxes of the leaves in W: emitted, brought by lights that are no surfaces, absorbed.
    pub fn fluxes(&self) -> [Spectrum; 3] {
        let mut sums = [[0.0f64; 4]; 3];
        for (i, n) in self.mesh.nodes.iter().enumerate() {
            if !n.is_leaf() || n.is_cluster() {
                continue;
            }
            let absorbed = (Spectrum::ONE - n.reflectance) * self.irradiance[i];
            for (sum, v) in sums.iter_mut().zip([n.emission, self.direct[i], absorbed]) {
                for (s, lane) in sum.iter_mut().zip(v.0) {
                    *s += f64::from(lane) * f64::from(n.area);
                }
            }
        }
        sums.map(|s| Spectrum(s.map(|v| v as f32)))
    }
}

/// The factor between nodes of a mesh.
pub struct Factors<'a> {
    /// The scene, for visibility.
    pub scene: &'a Scene,
    /// The nodes.
    pub mesh: &'a Mesh,
    /// Selects the random numbers.
    pub seed: u64,
}

/// A point that stands for a node, with the normal there and the face's node.
struct Sample {
    p: Vec3,
    normal: Vec3,
    face: u32,
}

impl Factors<'_> {
    /// The pair of a receiver and a source, both no clusters; `None` where no light can go from one to the other.
    pub fn pair(&self, receiver: u32, source: u32) -> Option<Pair<'_>> {
        let side = |i: u32| {
            let node = &self.mesh.nodes[i as usize];
            Side { corners: &node.corners, normal: self.mesh.face(node).normal }
        };
        Pair::new(side(receiver), side(source))
    }

    /// The factor of a pair; `rays` as in [`Pair::trace`]. For a source with elements of its own, `light` of its leaves says how it is
    /// spread over them; the factor belongs to that light.
    pub fn trace(&self, pair: &Pair, receiver: u32, source: u32, rays: u32, light: &[Spectrum]) -> Estimate {
        let (r, s) = (&self.mesh.nodes[receiver as usize], &self.mesh.nodes[source as usize]);
        let (face_r, face_s) = (self.mesh.face(r), self.mesh.face(s));
        let passes = |p: Vec3, q: Vec3| {
            let (p, np) = self.mesh.faces.on_surface(self.scene, face_r, p);
            let (q, nq) = self.mesh.faces.on_surface(self.scene, face_s, q);
            visibility(self.scene, p, np, q, nq)
        };
        let at = |p| light[self.leaf_at(source, p) as usize].average();
        let light = (!s.is_leaf()).then(|| SourceLight { at: &at, mean: light[source as usize].average() });
        pair.trace(rays, PairRandom::new(self.seed, receiver, source), passes, light.as_ref())
    }

    /// The factor from a receiver to a source, both no clusters, by more rays where some first ones find something in between; those
    /// do not count themselves.
    pub fn elements(&self, receiver: u32, source: u32, light: &[Spectrum]) -> f32 {
        let Some(pair) = self.pair(receiver, source) else { return 0.0 };
        let rays = if self.trace(&pair, receiver, source, 1, light).is_mixed() { 4 } else { 1 };
        Factors { seed: self.seed ^ OTHER, ..*self }.trace(&pair, receiver, source, rays, light).factor
    }

    /// The leaf of an element that holds a point of it.
    fn leaf_at(&self, element: u32, p: Vec3) -> u32 {
        let (mut at, mut b) = (element, super::shapes::barycentric(&self.mesh.nodes[element as usize].corners, p));
        while !self.mesh.nodes[at as usize].is_leaf() {
            let (i, weights) = descend_once(b);
            (at, b) = (self.mesh.nodes[at as usize].first_child + i, weights);
        }
        at
    }

    /// The factor from a receiver to a source of which one at least is a cluster, by points of both. For a cluster as receiver it is
    /// the factor of a surface of it that faces the source: times the cosine of its own, it is that of each of its faces (Smits, Arvo
    /// and Greenberg 1994, "A Clustering Algorithm for Radiosity in Complex Environments", doi:10.1145/192161.192277).
    ///
    /// Each point of a source counts by the radiosity of its face over that of the whole: the receiver may see the bright sides of
    /// walls and not the dark ones. So the factor belongs to the radiosities at hand.
    pub fn clusters(&self, receiver: u32, source: u32, importance: f32, radiosity: &[Spectrum]) -> Estimate {
        let (r, s) = (&self.mesh.nodes[receiver as usize], &self.mesh.nodes[source as usize]);
        let random = PairRandom::new(self.seed, receiver, source);
        let turn = random.pair(u32::MAX);
        let (shift, stride) = ((turn.x * STRATA as f32) as u32, 2 * ((turn.y * 8.0) as u32) + 1);
        let n = if importance > 1.0 { 2 * CLUSTER_SAMPLES } else { CLUSTER_SAMPLES };
        let is_cluster = r.is_cluster();
        let mean = radiosity[source as usize].average();
        let (mut factor, mut geometric, mut open, mut passed, mut traced, mut count) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0u32, 0u32);
        for i in 0..n {
            let at = self.sample(r, receiver, random, 4 * i, i);
            // Which parts are paired is random: a fixed pairing would see the same half of everything.
            let from = self.sample(s, source, random, 4 * i + 2, i.wrapping_mul(stride).wrapping_add(shift));
            let d = from.p - at.p;
            let dist2 = d.length_squared();
            let cos_r = at.normal.dot(d);
            if is_cluster && cos_r <= 0.0 {
                // This face does not take part.
                continue;
            }
            let cos_s = -from.normal.dot(d);
            count += 1;
            if !(cos_r > 0.0 && cos_s > 0.0 && dist2 > 0.0) {
                continue;
            }
            let dist = dist2.sqrt();
            let kernel = s.area * (cos_s / dist) / (std::f32::consts::PI * dist2);
            let kernel = if is_cluster { kernel } else { kernel * (cos_r / dist) };
            let (face_r, face_s) =
                (self.mesh.face(&self.mesh.nodes[at.face as usize]), self.mesh.face(&self.mesh.nodes[from.face as usize]));
            let (p, np) = self.mesh.faces.on_surface(self.scene, face_r, at.p);
            let (q, nq) = self.mesh.faces.on_surface(self.scene, face_s, from.p);
            let share = visibility(self.scene, p, np, q, nq);
            open += kernel;
            passed += share;
            traced += 1;
            let kernel = kernel * share;
            geometric += kernel;
            factor += if mean > 0.0 && s.is_cluster() { kernel * (radiosity[from.face as usize].average() / mean) } else { kernel };
        }
        let inv = 1.0 / count.max(1) as f32;
        let passed = passed / traced.max(1) as f32;
        Estimate { factor: factor * inv, spread: 0.0, geometric: (geometric * inv).min(1.0), open: (open * inv).min(1.0), passed }
    }

    /// A point of a node: children by area, then uniform. Points with the index `i` fall into the parts of a
    /// cluster, or the quarters of a face, in turn.
    fn sample(&self, node: &Node, index: u32, random: PairRandom, at: u32, i: u32) -> Sample {
        let is_cluster = node.is_cluster();
        let (mut node, mut index) = (node, index);
        let mut u = random.pair(at).x;
        if node.is_cluster() {
            u = ((i % STRATA) as f32 + u) / STRATA as f32;
        }
        while node.is_cluster() {
            let first = &self.mesh.nodes[node.first_child as usize];
            let share = first.area / (first.area + self.mesh.nodes[node.first_child as usize + 1].area);
            if u < share {
                u /= share;
                index = node.first_child;
            } else {
                u = (u - share) / (1.0 - share);
                index = node.first_child + 1;
            }
            node = &self.mesh.nodes[index as usize];
        }
        let v = random.pair(at + 1);
        let corners = if is_cluster { node.corners } else { super::form_factor::quarter(&node.corners, (i % 4) as usize) };
        Sample { p: point_of(&corners, v), normal: self.mesh.face(node).normal, face: index }
    }
}

/// Sum over the areas of nodes of a value.
pub fn area_sum(mesh: &Mesh, nodes: impl Iterator<Item = u32>, value: impl Fn(u32) -> f32) -> f64 {
    nodes.map(|i| f64::from(value(i)) * f64::from(mesh.nodes[i as usize].area)).sum()
}
