//! A hierarchy over finite lights, and choosing one by its importance at a point (see [`super::bounds`] for the paper).

use super::LightBounds;
use super::bounds::Group;
use crate::math::{Aabb, ONE_MINUS_EPSILON, Vec3};

/// One node: an inner one's first child follows it, the second is at `link`; a leaf's `link` is its light.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: LightBounds,
    link: u32,
    leaf: bool,
}

/// A binary tree with one light in each leaf.
#[derive(Clone, Debug, Default)]
pub(super) struct LightBvh {
    nodes: Vec<Node>,
    /// For each light the way from the root, first turn in bit 0, below a bit that ends it; 0 for lights that are not in the tree.
    trails: Vec<u64>,
}

/// Clusters are split at one of these many places along each axis.
const BINS: usize = 12;
/// From this depth on clusters are halved by count, so that trails fit their 64 bits.
const MAX_SAOH_DEPTH: u32 = 36;

/// Groups larger than this are built on another thread.
const PARALLEL: usize = 4096;

impl LightBvh {
    /// Over (light, bounds) pairs out of `light_count` lights. O(n log n); the same tree on every machine and for any number of threads.
    pub fn new(mut lights: Vec<(u32, LightBounds)>, light_count: usize) -> Self {
        let mut bvh = Self { nodes: Vec::new(), trails: vec![0; light_count] };
        if !lights.is_empty() {
            bvh.nodes = vec![Node { bounds: LightBounds::EMPTY, link: 0, leaf: false }; 2 * lights.len() - 1];
            build(&mut lights, &mut bvh.nodes, 0, 0);
            bvh.mark_trails();
        }
        bvh
    }

    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    fn mark_trails(&mut self) {
        let mut stack = vec![(0, 0u64, 0u32)];
        while let Some((index, trail, depth)) = stack.pop() {
            let node = &self.nodes[index];
            if node.leaf {
                self.trails[node.link as usize] = trail | 1 << depth;
            } else {
                stack.push((node.link as usize, trail | 1 << depth, depth + 1));
                stack.push((index + 1, trail, depth + 1));
            }
        }
    }

    /// The probability of an inner node's first child; `None` where no light arrives from either.
    #[inline]
    fn first_probability(&self, index: usize, p: Vec3, n: Vec3) -> Option<f32> {
        let a = self.nodes[index + 1].bounds.importance(p, n);
        let b = self.nodes[self.nodes[index].link as usize].bounds.importance(p, n);
        (a > 0.0 || b > 0.0).then(|| a / (a + b))
    }

    /// A light and its probability for `u` in [0, 1). `None` where no light arrives, which may show only at the bottom: a
    /// group's bounds hold more than its members, so that the probabilities sum to a little less than one.
    pub fn sample(&self, p: Vec3, n: Vec3, mut u: f32) -> Option<(u32, f32)> {
        let (mut index, mut pmf) = (0, 1.0);
        let root = self.nodes.first()?;
        if root.leaf && root.bounds.importance(p, n) <= 0.0 {
            return None;
        }
        loop {
            let node = &self.nodes[index];
            if node.leaf {
                // A probability may underflow.
                return (pmf > 0.0).then_some((node.link, pmf));
            }
            let first = self.first_probability(index, p, n)?;
            if u < first {
                (index, pmf, u) = (index + 1, pmf * first, u / first);
            } else {
                let second = 1.0 - first;
                (index, pmf, u) = (node.link as usize, pmf * second, (u - first) / second);
            }
            u = u.clamp(0.0, ONE_MINUS_EPSILON);
        }
    }

    /// The probability with which [`LightBvh::sample`] returns the light.
    pub fn pmf(&self, p: Vec3, n: Vec3, light: u32) -> f32 {
        let Some(mut trail) = self.trails.get(light as usize).copied().filter(|&t| t != 0) else {
            return 0.0;
        };
        let (mut index, mut pmf) = (0, 1.0);
        if trail == 1 && self.nodes[0].bounds.importance(p, n) <= 0.0 {
            return 0.0;
        }
        while trail != 1 {
            let Some(first) = self.first_probability(index, p, n) else {
                return 0.0;
            };
            (index, pmf) = if trail & 1 == 0 { (index + 1, pmf * first) } else { (self.nodes[index].link as usize, pmf * (1.0 - first)) };
            trail >>= 1;
        }
        pmf
    }
}

/// Fills `nodes` (two for each light, less one), whose first will be at `index` of the tree.
fn build(lights: &mut [(u32, LightBounds)], nodes: &mut [Node], index: usize, depth: u32) {
    if let [(light, bounds)] = lights {
        nodes[0] = Node { bounds: *bounds, link: *light, leaf: true };
        return;
    }
    let split = if depth < MAX_SAOH_DEPTH { partition(lights) } else { None }.unwrap_or_else(|| halve(lights));
    let parallel = lights.len() > PARALLEL;
    let (first, second) = lights.split_at_mut(split);
    let Some((root, children)) = nodes.split_first_mut() else { return };
    let (a, b) = children.split_at_mut(2 * split - 1);
    let link = index + 2 * split;
    if parallel {
        rayon::join(|| build(first, a, index + 1, depth + 1), || build(second, b, link, depth + 1));
    } else {
        build(first, a, index + 1, depth + 1);
        build(second, b, link, depth + 1);
    }
    *root = Node { bounds: a[0].bounds.union(&b[0].bounds), link: link as u32, leaf: false };
}

/// Splits by the surface area orientation heuristic; the number in the first part, or `None` where no plane splits them.
fn partition(lights: &mut [(u32, LightBounds)]) -> Option<usize> {
    if lights.len() == 2 {
        return Some(1);
    }
    let center = |b: &LightBounds| b.bounds.center();
    let (mut lo, mut hi, mut all) = (Vec3::INFINITY, Vec3::NEG_INFINITY, Aabb::EMPTY);
    for (_, b) in lights.iter() {
        lo = lo.min(center(b));
        hi = hi.max(center(b));
        all = all.union(b.bounds);
    }
    let mut bins = [[Group::EMPTY; BINS]; 3];
    for (_, b) in lights.iter() {
        let c = center(b);
        for axis in 0..3 {
            bins[axis][bin_of(c[axis], lo[axis], hi[axis])].add(b);
        }
    }
    let extent = all.extent();
    let mut best: Option<(f32, usize, usize)> = None;
    for (axis, bins) in bins.iter().enumerate() {
        if lo[axis] >= hi[axis] {
            continue;
        }
        let stretch = extent.max_element() / extent[axis].max(f32::MIN_POSITIVE);
        let mut above = [Group::EMPTY; BINS];
        for i in (1..BINS).rev() {
            above[i - 1] = above[i];
            above[i - 1].join(&bins[i]);
        }
        let mut below = Group::EMPTY;
        for i in 1..BINS {
            // Behind an empty bin the parts are those of the place before.
            if bins[i - 1].is_empty() || above[i - 1].is_empty() {
                continue;
            }
            below.join(&bins[i - 1]);
            let cost = below.cost(stretch) + above[i - 1].cost(stretch);
            if best.is_none_or(|(c, _, _)| cost < c) {
                best = Some((cost, axis, i));
            }
        }
    }
    let (_, axis, bin) = best?;
    let mut first = 0;
    for i in 0..lights.len() {
        if bin_of(center(&lights[i].1)[axis], lo[axis], hi[axis]) < bin {
            lights.swap(first, i);
            first += 1;
        }
    }
    (first > 0 && first < lights.len()).then_some(first)
}

/// Zero where all lie in one plane.
#[inline]
fn bin_of(x: f32, lo: f32, hi: f32) -> usize {
    (((x - lo) / (hi - lo) * BINS as f32) as usize).min(BINS - 1)
}

/// Halves by count across the longest axis of the centers.
fn halve(lights: &mut [(u32, LightBounds)]) -> usize {
    let (lo, hi) =
        lights.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), (_, b)| (lo.min(b.bounds.center()), hi.max(b.bounds.center())));
    let axis = (hi - lo).max_position();
    let middle = lights.len() / 2;
    lights.select_nth_unstable_by(middle, |a, b| a.1.bounds.center()[axis].total_cmp(&b.1.bounds.center()[axis]).then(a.0.cmp(&b.0)));
    middle
}
