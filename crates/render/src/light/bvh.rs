//! A hierarchy over finite lights, and choosing one by its importance at a point (see [`super::bounds`] for the paper).

use super::LightBounds;
use crate::math::{ONE_MINUS_EPSILON, Vec3};

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

impl LightBvh {
    /// Over (light, bounds) pairs out of `light_count` lights. O(n log n); the same tree on every machine.
    pub fn new(mut lights: Vec<(u32, LightBounds)>, light_count: usize) -> Self {
        let mut bvh = Self { nodes: Vec::with_capacity(2 * lights.len()), trails: vec![0; light_count] };
        if !lights.is_empty() {
            bvh.build(&mut lights, 0, 0);
        }
        bvh
    }

    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    fn build(&mut self, lights: &mut [(u32, LightBounds)], trail: u64, depth: u32) {
        let index = self.nodes.len();
        if let [(light, bounds)] = lights {
            self.nodes.push(Node { bounds: *bounds, link: *light, leaf: true });
            self.trails[*light as usize] = trail | 1 << depth;
            return;
        }
        let split = if depth < MAX_SAOH_DEPTH { partition(lights) } else { None }.unwrap_or_else(|| halve(lights));
        self.nodes.push(Node { bounds: LightBounds::EMPTY, link: 0, leaf: false });
        let (first, second) = lights.split_at_mut(split);
        self.build(first, trail, depth + 1);
        let link = self.nodes.len();
        self.build(second, trail | 1 << depth, depth + 1);
        self.nodes[index].link = link as u32;
        self.nodes[index].bounds = self.nodes[index + 1].bounds.union(&self.nodes[link].bounds);
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

/// Splits by the surface area orientation heuristic; the number in the first part, or `None` where no plane splits them.
fn partition(lights: &mut [(u32, LightBounds)]) -> Option<usize> {
    let center = |b: &LightBounds| b.bounds.center();
    let (mut lo, mut hi, mut all) = (Vec3::INFINITY, Vec3::NEG_INFINITY, LightBounds::EMPTY);
    for (_, b) in lights.iter() {
        lo = lo.min(center(b));
        hi = hi.max(center(b));
        all.bounds = all.bounds.union(b.bounds);
    }
    let extent = all.bounds.extent();
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        if lo[axis] >= hi[axis] {
            continue;
        }
        let mut bins = [LightBounds::EMPTY; BINS];
        for (_, b) in lights.iter() {
            let bin = &mut bins[bin_of(center(b)[axis], lo[axis], hi[axis])];
            *bin = bin.union(b);
        }
        let stretch = extent.max_element() / extent[axis].max(f32::MIN_POSITIVE);
        let mut above = [0.0; BINS];
        let mut acc = LightBounds::EMPTY;
        for i in (1..BINS).rev() {
            acc = acc.union(&bins[i]);
            above[i] = acc.cost(stretch);
        }
        let mut acc = LightBounds::EMPTY;
        for i in 1..BINS {
            acc = acc.union(&bins[i - 1]);
            let cost = acc.cost(stretch) + above[i];
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
