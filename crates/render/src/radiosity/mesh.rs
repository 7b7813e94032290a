//! The hierarchy that light is exchanged over: clusters of faces, faces, and the elements into which they are subdivided.
//!
//! All are nodes of one array in which parents come before their children. A face is subdivided by the midpoints of its edges into
//! four ([`quarter`]); the children of a node lie side by side. Midpoints of a common edge are the same bits from either side, so that
//! elements of neighboring faces meet in the same vertices.

use std::cmp::Ordering;

use glam::Vec3;
use rayon::prelude::*;

use super::face::{Face, Faces, mean_optics};
use super::form_factor::{PairRandom, area_of, point_of, quarter};
use crate::accel::Ray;
use crate::math::{Aabb, Frame, warp};
use crate::scene::Scene;
use crate::scene::geometry::NONE;
use crate::scene::surface::offset;
use crate::spectrum::Spectrum;

/// Deepest subdivision of a face.
pub const MAX_LEVEL: u8 = 14;

/// A cluster, a face or an element.
#[derive(Clone, Debug)]
pub struct Node {
    /// First child; [`NONE`] for leaves.
    pub first_child: u32,
    /// Parent; [`NONE`] for the root.
    pub parent: u32,
    /// The face that it is (a part of); [`NONE`] for clusters.
    pub face: u32,
    /// Subdivisions from the face.
    pub level: u8,
    /// Surface area, of a cluster that of all its faces.
    pub area: f32,
    /// Middle: of the corners, or of the cluster's box.
    pub center: Vec3,
    /// Radius of a sphere about the middle that holds it.
    pub radius: f32,
    /// Corners, counter-clockwise; of a cluster the box in the first two.
    pub corners: [Vec3; 3],
    /// Mean diffuse reflectance.
    pub reflectance: Spectrum,
    /// Mean emitted radiosity, W·m⁻².
    pub emission: Spectrum,
}

impl Node {
    /// Whether it is a group of faces.
    #[inline]
    pub fn is_cluster(&self) -> bool {
        self.face == NONE
    }

    /// Whether it has no children.
    #[inline]
    pub fn is_leaf(&self) -> bool {
        self.first_child == NONE
    }

    /// The children's indices: two of a cluster, four of a face or element, none of a leaf.
    #[inline]
    pub fn children(&self) -> std::ops::Range<u32> {
        match self.first_child {
            NONE => 0..0,
            c if self.is_cluster() => c..c + 2,
            c => c..c + 4,
        }
    }
}

/// The hierarchy.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Faces of the scene.
    pub faces: Faces,
    /// All nodes; the first is the root.
    pub nodes: Vec<Node>,
    /// The node of each face.
    pub face_nodes: Vec<u32>,
    /// Sum of the faces' areas.
    pub area: f32,
}

impl Mesh {
    /// A hierarchy of clusters down to faces without subdivisions. O(n log n).
    pub fn new(scene: &Scene, faces: Faces) -> Self {
        let leaves: Vec<Node> = faces.faces.par_iter().map(|f| element(scene, &faces, f, f.corners, None)).collect();
        let mut mesh = Self { face_nodes: vec![NONE; leaves.len()], ..Self::default() };
        if leaves.is_empty() {
            mesh.faces = faces;
            return mesh;
        }
        let mut order: Vec<u32> = (0..leaves.len() as u32).collect();
        mesh.nodes.reserve(2 * leaves.len());
        mesh.nodes.push(empty());
        // (node, range of `order`)
        let mut stack = vec![(0u32, 0usize, leaves.len())];
        while let Some((at, begin, end)) = stack.pop() {
            let parent = mesh.nodes[at as usize].parent;
            if end - begin == 1 {
                let face = order[begin];
                mesh.nodes[at as usize] = Node { parent, face, ..leaves[face as usize].clone() };
                mesh.face_nodes[face as usize] = at;
                continue;
            }
            let part = &mut order[begin..end];
            let bounds = part.iter().fold(Aabb::EMPTY, |b, &f| leaves[f as usize].corners.iter().fold(b, |b, &c| b.grow(c)));
            let centers = part.iter().fold(Aabb::EMPTY, |b, &f| b.grow(leaves[f as usize].center));
            let extent = centers.extent();
            let axis = (0..3).fold(0, |best, i| if extent[i] > extent[best] { i } else { best });
            let key = |f: u32| leaves[f as usize].center[axis];
            let by_center = |a: &u32, b: &u32| -> Ordering { key(*a).total_cmp(&key(*b)).then(a.cmp(b)) };
            // At the middle of the box where that leaves something on both sides, else at the median.
            let middle = centers.center()[axis];
            part.sort_unstable_by(by_center);
            let mut split = part.partition_point(|&f| key(f) < middle);
            let fewest = (end - begin) / 8;
            if split <= fewest || split >= end - begin - fewest {
                split = (end - begin) / 2;
            }
            let first = mesh.nodes.len() as u32;
            let (center, radius) = bounds.bounding_sphere();
            mesh.nodes[at as usize] =
                Node { first_child: first, parent, center, radius, corners: [bounds.min, bounds.max, bounds.max], ..empty() };
            for _ in 0..2 {
                mesh.nodes.push(Node { parent: at, ..empty() });
            }
            stack.push((first + 1, begin + split, end));
            stack.push((first, begin, begin + split));
        }
        mesh.faces = faces;
        mesh.pull_optics();
        mesh.area = mesh.nodes[0].area;
        mesh
    }

    /// Areas and mean optics of clusters from their children.
    fn pull_optics(&mut self) {
        for i in (0..self.nodes.len()).rev() {
            if !self.nodes[i].is_cluster() {
                continue;
            }
            let (mut area, mut rho, mut emission) = (0.0f64, Spectrum::ZERO, Spectrum::ZERO);
            for c in self.nodes[i].children() {
                let child = &self.nodes[c as usize];
                area += f64::from(child.area);
                rho += child.reflectance * child.area;
                emission += child.emission * child.area;
            }
            let node = &mut self.nodes[i];
            node.area = area as f32;
            let inv = if area > 0.0 { (1.0 / area) as f32 } else { 0.0 };
            node.reflectance = rho * inv;
            node.emission = emission * inv;
        }
    }

    /// The face of a node that is no cluster.
    #[inline]
    pub fn face(&self, node: &Node) -> &Face {
        &self.faces.faces[node.face as usize]
    }

    /// Subdivides leaves that are no clusters, in the order given; returns the first child of the first of them.
    pub fn subdivide(&mut self, scene: &Scene, leaves: &[u32]) -> u32 {
        let first = self.nodes.len() as u32;
        let children: Vec<[Node; 4]> = leaves
            .par_iter()
            .map(|&leaf| {
                let node = &self.nodes[leaf as usize];
                let face = self.face(node);
                std::array::from_fn(|i| {
                    let corners = quarter(&node.corners, i);
                    Node {
                        parent: leaf,
                        face: node.face,
                        level: node.level + 1,
                        ..element(scene, &self.faces, face, corners, Some(node.level + 1))
                    }
                })
            })
            .collect();
        for (leaf, children) in leaves.iter().zip(children) {
            self.nodes[*leaf as usize].first_child = self.nodes.len() as u32;
            self.nodes.extend(children);
        }
        first
    }

    /// All leaves, in the order of their indices.
    pub fn leaves(&self) -> Vec<u32> {
        (0..self.nodes.len() as u32).filter(|&i| self.nodes[i as usize].is_leaf() && !self.nodes[i as usize].is_cluster()).collect()
    }

    /// Number of leaves.
    pub fn leaf_count(&self) -> usize {
        self.nodes.iter().filter(|n| n.is_leaf() && !n.is_cluster()).count()
    }

    /// Subdivides the faces that count until no element of them is larger than `area`, or there are `limit` elements; returns whether
    /// the limit was met.
    pub fn subdivide_to(&mut self, scene: &Scene, area: f32, limit: usize, counts: &[bool]) -> bool {
        let mut count = self.leaf_count();
        loop {
            let large: Vec<u32> = self
                .leaves()
                .into_iter()
                .filter(|&i| {
                    let n = &self.nodes[i as usize];
                    n.area > area && n.level < MAX_LEVEL && counts[n.face as usize]
                })
                .collect();
            if large.is_empty() {
                return false;
            }
            if count + 3 * large.len() > limit {
                return true;
            }
            count += 3 * large.len();
            self.subdivide(scene, &large);
        }
    }

    /// For each face whether anything is before it, as far as some rays tell: the outer sides of a room's walls need no elements. All
    /// count where light comes from outside.
    pub fn faces_that_see(&self, scene: &Scene) -> Vec<bool> {
        const RAYS: u32 = 24;
        if !scene.infinite_lights.is_empty() {
            return vec![true; self.faces.faces.len()];
        }
        let sees = |(i, face): (usize, &Face)| {
            let random = PairRandom::new(0x5ee5, i as u32, 0);
            (0..RAYS).any(|k| {
                let (p, n) = self.faces.on_surface(scene, face, point_of(&quarter(&face.corners, (k % 4) as usize), random.pair(2 * k)));
                let d = Frame::from_normal(n).world_from_local(warp::cosine_hemisphere(random.pair(2 * k + 1)));
                scene.accel.occluded(&Ray::new(offset(p, n), d))
            })
        };
        self.faces.faces.par_iter().enumerate().map(sees).collect()
    }

    /// The leaf of a face at barycentric weights, with the weights of its own corners.
    pub fn descend(&self, face: u32, mut b: Vec3) -> (u32, Vec3) {
        let mut at = self.face_nodes[face as usize];
        loop {
            let node = &self.nodes[at as usize];
            if node.is_leaf() {
                return (at, b);
            }
            let i;
            (i, b) = descend_once(b);
            at = node.first_child + i;
        }
    }

    /// Means of a value of the leaves over all nodes, by area. Children come after their parents, so one sweep does.
    pub fn pull(&self, values: &mut [Spectrum]) {
        for i in (0..self.nodes.len()).rev() {
            let node = &self.nodes[i];
            if node.is_leaf() {
                continue;
            }
            let (mut sum, mut area) = (Spectrum::ZERO, 0.0);
            for c in node.children() {
                let a = self.nodes[c as usize].area;
                sum += values[c as usize] * a;
                area += a;
            }
            values[i] = if area > 0.0 { sum / area } else { Spectrum::ZERO };
        }
    }
}

/// Which quarter of a triangle holds a point, and its weights there.
#[inline]
pub fn descend_once(b: Vec3) -> (u32, Vec3) {
    if b.x > 0.5 {
        (0, Vec3::new(2.0 * b.x - 1.0, 2.0 * b.y, 2.0 * b.z))
    } else if b.y > 0.5 {
        (1, Vec3::new(2.0 * b.x, 2.0 * b.y - 1.0, 2.0 * b.z))
    } else if b.z > 0.5 {
        (2, Vec3::new(2.0 * b.x, 2.0 * b.y, 2.0 * b.z - 1.0))
    } else {
        (3, Vec3::new(1.0 - 2.0 * b.x, 1.0 - 2.0 * b.y, 1.0 - 2.0 * b.z))
    }
}

fn empty() -> Node {
    Node {
        first_child: NONE,
        parent: NONE,
        face: NONE,
        level: 0,
        area: 0.0,
        center: Vec3::ZERO,
        radius: 0.0,
        corners: [Vec3::ZERO; 3],
        reflectance: Spectrum::ZERO,
        emission: Spectrum::ZERO,
    }
}

/// A node for a part of a face. Textures are averaged over more points where the part is large.
fn element(scene: &Scene, faces: &Faces, face: &Face, corners: [Vec3; 3], level: Option<u8>) -> Node {
    let center = (corners[0] + corners[1] + corners[2]) / 3.0;
    let radius = corners.iter().map(|c| (*c - center).length()).fold(0.0, f32::max);
    let area = area_of(&corners);
    let weights = if level.is_none() {
        [Vec3::X, Vec3::Y, Vec3::Z]
    } else {
        corners.map(|c| {
            let b = super::shapes::barycentric(&face.corners, c).max(Vec3::ZERO);
            b / (b.x + b.y + b.z).max(1e-20)
        })
    };
    let n = if level.unwrap_or(0) < 3 { 3 } else { 2 };
    let (reflectance, emission) = mean_optics(scene, faces, face, &weights, n);
    Node { area, center, radius, corners, reflectance, emission, ..empty() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_and_weights_say_the_same() {
        let c = [Vec3::new(0.1, 0.2, 0.3), Vec3::new(2.0, -0.5, 1.0), Vec3::new(0.4, 3.0, -1.0)];
        for k in 0..200u32 {
            let u = crate::math::Vec2::new((k as f32 * 0.618_034).fract(), (k as f32 * 0.754_878).fract());
            let b = warp::triangle(u);
            let b = Vec3::new(1.0 - b.x - b.y, b.x, b.y);
            let p = c[0] * b.x + c[1] * b.y + c[2] * b.z;
            let (i, w) = descend_once(b);
            let q = quarter(&c, i as usize);
            assert!(w.min_element() > -1e-5, "{w}");
            assert!((q[0] * w.x + q[1] * w.y + q[2] * w.z - p).length() < 1e-5);
        }
    }
}
