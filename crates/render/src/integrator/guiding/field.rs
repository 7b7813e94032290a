//! What is known of the light at each place: trees over space, one for each way in which surfaces face.

use rayon::prelude::*;

use super::quadtree::{Quadtrees, Weighted};
use crate::math::{Vec2, Vec3};

/// Samples of a leaf, at most; it has half as many at least, where there are so many.
const LEAF: usize = 2048;
/// Where a sample has no successor, a leaf no directions.
pub(super) const NONE: u32 = u32::MAX;

/// What a path has seen at one of its vertices.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub p: Vec3,
    /// Which way the surface faces, 0 to 5.
    pub side: u8,
    /// Direction in which the path went on, in the square.
    pub at: Vec2,
    /// Cosine at the surface over the density of the direction; 0 where the path did not go on, or by a delta lobe.
    pub factor: f32,
    /// Light found along that direction, with the direct light at the next vertex; all of it where there is none.
    pub light: f32,
    /// The vertex reached along it if the light sent back there is much the same for all directions; else [`NONE`].
    pub next: u32,
    /// The share of the light of that vertex that comes here.
    pub carry: f32,
    /// Light that the path found after this vertex: an estimate of the indirect light that is sent back along the path.
    pub sent: f32,
    /// The same with the light found at the vertex.
    pub all: f32,
}

/// What is known at a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    /// The root of the directions' tree; [`NONE`] where none are known.
    pub root: u32,
    /// What surfaces send back in the mean: indirect light, and all.
    pub sent: f32,
    pub all: f32,
}

/// The side of a normal: the axis that it is nearest to, and its sign.
#[inline]
pub(super) fn side(n: Vec3) -> u8 {
    let a = n.abs();
    let axis = if a.x >= a.y && a.x >= a.z { 0 } else { 1 + u8::from(a.z > a.y) };
    2 * axis + u8::from(n[usize::from(axis)] < 0.0)
}

/// A node of a tree over space: the first child is the next node.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// Where the cell is divided.
    at: f32,
    /// The axis, or 3 for a leaf, in the lower two bits; the second child or the number of the leaf in the others.
    link: u32,
}

/// The distribution of light at each place.
#[derive(Clone, Debug, Default)]
pub(super) struct Field {
    nodes: Vec<Node>,
    /// The roots of the sides' trees.
    roots: [u32; 6],
    leaves: Vec<Leaf>,
    pub directions: Quadtrees,
}

impl Field {
    /// Learns from samples: a function of them and their order alone.
    pub fn learn(samples: &[Sample]) -> Self {
        let trees: Vec<(Vec<Node>, Vec<Vec<u32>>)> = (0..6u8)
            .into_par_iter()
            .map(|side| {
                let mut of_side: Vec<u32> = (0..samples.len() as u32).filter(|&i| samples[i as usize].side == side).collect();
                let (mut nodes, mut leaves) = (Vec::new(), Vec::new());
                divide(samples, &mut of_side, &mut nodes, &mut leaves);
                (nodes, leaves)
            })
            .collect();
        let mut field = Self::default();
        let mut members = Vec::new();
        for (root, (nodes, leaves)) in field.roots.iter_mut().zip(trees) {
            let (first_node, first_leaf) = (field.nodes.len() as u32, members.len() as u32);
            *root = first_node;
            let raised = |n: Node| Node { link: n.link + (if n.link & 3 == 3 { first_leaf } else { first_node } << 2), ..n };
            field.nodes.extend(nodes.into_iter().map(raised));
            members.extend(leaves);
        }
        // What surfaces send back, by leaf: means of many paths, so that each sample's own luck beyond the next vertex does not count.
        let mut sent = vec![0.0f32; samples.len()];
        for of_leaf in &members {
            let mean = |value: &dyn Fn(&Sample) -> f32| {
                let sum: f64 = of_leaf.iter().map(|&i| f64::from(value(&samples[i as usize]))).sum();
                (sum / of_leaf.len().max(1) as f64).clamp(0.0, f64::from(f32::MAX)) as f32
            };
            let leaf = Leaf { root: NONE, sent: mean(&|s| s.sent), all: mean(&|s| s.all) };
            of_leaf.iter().for_each(|&i| sent[i as usize] = leaf.sent);
            field.leaves.push(leaf);
        }
        let trees: Vec<(Quadtrees, Option<u32>)> = members
            .par_iter()
            .map(|of_leaf| {
                let mut weighted: Vec<Weighted> = of_leaf
                    .iter()
                    .map(|&i| {
                        let s = &samples[i as usize];
                        let light = if s.next == NONE { s.light } else { s.light + s.carry * sent[s.next as usize] };
                        Weighted { at: s.at, weight: light * s.factor }
                    })
                    .filter(|w| w.weight > 0.0 && w.weight.is_finite())
                    .collect();
                let mut tree = Quadtrees::default();
                let root = tree.add(&mut weighted);
                (tree, root)
            })
            .collect();
        for (leaf, (tree, root)) in field.leaves.iter_mut().zip(trees) {
            let raised = field.directions.append(&tree);
            leaf.root = root.map_or(NONE, |root| root + raised);
        }
        field
    }

    /// What is known at a place on a surface that faces a side.
    #[inline]
    pub fn at(&self, p: Vec3, side: u8) -> Leaf {
        let mut i = self.roots[usize::from(side)] as usize;
        loop {
            let Node { at, link } = self.nodes[i];
            let axis = (link & 3) as usize;
            if axis == 3 {
                return self.leaves[(link >> 2) as usize];
            }
            i = if p[axis] < at { i + 1 } else { (link >> 2) as usize };
        }
    }
}

/// Divides samples at the median of the longest edge of their box until few are left.
fn divide(samples: &[Sample], of_node: &mut [u32], nodes: &mut Vec<Node>, leaves: &mut Vec<Vec<u32>>) {
    let p = |i: u32| samples[i as usize].p;
    let (low, high) = of_node
        .iter()
        .fold((Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)), |(low, high), &i| (low.min(p(i)), high.max(p(i))));
    let extent = high - low;
    let index = nodes.len();
    if of_node.len() <= LEAF || extent.max_element() <= 0.0 {
        nodes.push(Node { at: 0.0, link: (leaves.len() as u32) << 2 | 3 });
        leaves.push(of_node.to_vec());
        return;
    }
    let axis = if extent.x >= extent.y && extent.x >= extent.z { 0 } else { 1 + usize::from(extent.z > extent.y) };
    let middle = of_node.len() / 2;
    // Equal coordinates in the order of the samples.
    of_node.select_nth_unstable_by(middle, |&a, &b| p(a)[axis].total_cmp(&p(b)[axis]).then(a.cmp(&b)));
    let at = p(of_node[middle])[axis];
    nodes.push(Node { at, link: 0 });
    let (first, second) = of_node.split_at_mut(middle);
    divide(samples, first, nodes, leaves);
    nodes[index].link = (nodes.len() as u32) << 2 | axis as u32;
    divide(samples, second, nodes, leaves);
}

#[cfg(test)]
mod tests {
    use super::super::quadtree::square_from_direction;
    use super::*;

    fn sample(p: Vec3, n: Vec3, toward: Vec3) -> Sample {
        let at = square_from_direction(toward);
        Sample { p, side: side(n), at, factor: 1.0, light: 1.0, next: NONE, carry: 0.0, sent: p.x, all: 2.0 * p.x }
    }

    /// Both sides of a wall, and both ends of it, know light of their own.
    #[test]
    fn places_and_sides_are_told_apart() {
        let mut samples = Vec::new();
        for i in 0..8000 {
            let (x, y) = ((i % 100) as f32 / 100.0, (i / 100) as f32 / 80.0);
            let left = if x < 0.5 { -1.0 } else { 1.0 };
            samples.push(sample(Vec3::new(x, y, 0.0), Vec3::Z, Vec3::new(left, 0.0, 1.0).normalize()));
            samples.push(sample(Vec3::new(x, y, 0.0), Vec3::NEG_Z, Vec3::NEG_Z));
        }
        let field = Field::learn(&samples);
        let density = |x: f32, n: Vec3, d: Vec3| field.directions.pdf(field.at(Vec3::new(x, 0.4, 0.0), side(n)).root, d.normalize());
        let [left, right] = [-1.0, 1.0].map(|x| Vec3::new(x, 0.0, 1.0));
        assert!(density(0.1, Vec3::Z, left) > 20.0 * density(0.1, Vec3::Z, right));
        assert!(density(0.9, Vec3::Z, right) > 20.0 * density(0.9, Vec3::Z, left));
        assert!(density(0.9, Vec3::NEG_Z, Vec3::NEG_Z) > 20.0 * density(0.9, Vec3::NEG_Z, right));
        let near = field.at(Vec3::new(0.05, 0.4, 0.0), side(Vec3::Z));
        assert!(near.sent < 0.35 && (near.all - 2.0 * near.sent).abs() < 1e-3, "{near:?}");
        assert_eq!(field.at(Vec3::ZERO, side(Vec3::X)).root, NONE, "nothing is known of what faces another way");
    }

    #[test]
    fn thousands_of_samples_at_one_point_end() {
        let samples = vec![sample(Vec3::ONE, Vec3::Z, Vec3::Z); 10_000];
        assert_ne!(Field::learn(&samples).at(Vec3::ONE, side(Vec3::Z)).root, NONE);
        assert_eq!(Field::learn(&[]).at(Vec3::ONE, 0).root, NONE);
    }
}
