//! Building: a binary tree by the binned surface area heuristic, and its cost-optimal collapse to eight children.
//!
//! The tree depends on the input alone, not on the number of threads: ranges are divided at places that only depend on
//! their contents, and each subtree writes to memory whose place follows from counts.

use super::bins::{BinMap, Bins, Box4, MAX_BINS, PrimRef, Split, blocks};
use super::emit::Source;
use super::layout::MAX_BLOCKS;
use super::simd::{LANES, WIDTH};
use super::spatial;

/// Levels by area; ranges that are still not leaves are then halved by number, at most 32 times.
const SAH_DEPTH: u32 = 44;
/// No tree is deeper.
pub(super) const MAX_DEPTH: usize = SAH_DEPTH as usize + 34;
/// Cost of testing a node's eight boxes, where testing a block of triangles costs 1.
const NODE_COST: f32 = 2.0;
/// Ranges that are worth a task of their own.
const TASK: usize = 4096;
/// References that one task sorts into bins.
const CHUNK: usize = 1 << 16;

/// A node of the binary tree. The left child follows at once; `right` is the distance to the right one, or zero in
/// leaves, where `first` and `count` are a range of references.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct BinaryNode {
    pub min: [f32; 3],
    pub right: u32,
    pub max: [f32; 3],
    /// References below; in leaves they start at `first`.
    pub count: u32,
    pub first: u32,
    /// Whether the cheapest single child that stands for this subtree is a leaf.
    pub leaf: u8,
    /// How many of j slots the left subtree gets; zero: take the choice for j - 1 slots.
    pub slots: [u8; WIDTH + 3],
}

/// The binary tree with its references.
pub(super) struct BinaryTree {
    pub nodes: Vec<BinaryNode>,
    pub refs: Vec<PrimRef>,
    pub bounds: Box4,
}

/// Costs of a subtree that takes 1 to 8 slots of a node, at index 0 to 7; infinite where it cannot fill them.
type Costs = [f32; WIDTH];

/// Spatial splits are tried where the boxes of the best object split overlap by this part of the range's half area.
const OVERLAP: f32 = 0.1;
/// Attempts in a row that may fail before a subtree does without.
const PATIENCE: u32 = 2;
/// Room for references that spatial splits add, as part of those there are.
const SPARE: f32 = 0.25;

/// Builds the tree over references; with none there are no nodes.
pub(super) fn build(mut refs: Vec<PrimRef>, source: &Source) -> BinaryTree {
    let count = refs.len();
    if !source.triangles.is_empty() {
        refs.resize(count + (count as f32 * SPARE) as usize, bytemuck::Zeroable::zeroed());
    }
    let (bounds, centers) = range_bounds(&refs[..count]);
    let mut nodes: Vec<BinaryNode> = bytemuck::zeroed_vec((2 * refs.len()).saturating_sub(1));
    if count > 0 {
        let range = Range { refs: &mut refs, count, base: 0, nodes: &mut nodes };
        subtree(range, bounds, centers, Path { depth: 0, misses: 0 }, source);
    }
    BinaryTree { nodes, refs, bounds }
}

/// Bounds and bounds of the doubled middles.
fn range_bounds(refs: &[PrimRef]) -> (Box4, Box4) {
    use rayon::prelude::*;
    let scan = |refs: &[PrimRef]| refs.iter().fold((Box4::EMPTY, Box4::EMPTY), |(b, c), r| (b.union(r.bounds()), c.grow(r.center2())));
    let join = |a: (Box4, Box4), b: (Box4, Box4)| (a.0.union(b.0), a.1.union(b.1));
    if refs.len() <= CHUNK { scan(refs) } else { refs.par_chunks(CHUNK).map(scan).reduce(|| (Box4::EMPTY, Box4::EMPTY), join) }
}

/// A range of references with the memory of its subtree.
struct Range<'a> {
    /// Used ones first, then room for references that spatial splits add.
    refs: &'a mut [PrimRef],
    count: usize,
    /// Place of `refs` in the whole array.
    base: usize,
    /// 2 `refs.len()` - 1 of them.
    nodes: &'a mut [BinaryNode],
}

/// How a range came about.
#[derive(Clone, Copy)]
struct Path {
    depth: u32,
    /// Attempts at a spatial split since the last that paid.
    misses: u32,
}

/// Builds the subtree of a range and returns its costs.
fn subtree(range: Range, bounds: Box4, centers: Box4, path: Path, source: &Source) -> Costs {
    let Range { refs, count, base, nodes } = range;
    let node = BinaryNode {
        min: [bounds.min[0], bounds.min[1], bounds.min[2]],
        max: [bounds.max[0], bounds.max[1], bounds.max[2]],
        right: 0,
        count: count as u32,
        first: base as u32,
        leaf: 1,
        slots: [0; WIDTH + 3],
    };
    let area = bounds.half_area();
    if count == 1 {
        nodes[0] = node;
        let mut costs = [f32::INFINITY; WIDTH];
        costs[0] = area;
        return costs;
    }
    let split = if path.depth < SAH_DEPTH { object_split(&refs[..count], &centers) } else { None };
    let spare = refs.len() - count;
    let mut below = Path { depth: path.depth + 1, misses: path.misses };
    let mut spatial = None;
    if let Some((s, _)) = &split
        && spare > 0
        && path.misses < PATIENCE
        && s.left.intersection(s.right).half_area() > OVERLAP * area
    {
        below.misses += 1;
        spatial = spatial::best(&refs[..count], &bounds, spare, source).filter(|p| p.cost < s.cost);
    }
    let mut sides = None;
    if let Some(plane) = spatial {
        let (l, r) = spatial::partition(refs, count, &plane, source);
        if l > 0 && r > 0 {
            below.misses = 0;
            sides = Some((l, r, range_bounds(&refs[..l]), range_bounds(&refs[l..l + r])));
        }
    }
    let (left_count, right_count, left, right) = sides.unwrap_or_else(|| {
        let (l, left, right) = match split {
            Some((split, map)) => partition(&mut refs[..count], &split, &map),
            None => halve(&refs[..count]),
        };
        (l, count - l, left, right)
    });
    // Both sides get a share of the spare room, and the right side's references move up by the left side's share.
    let used = left_count + right_count;
    let spare = refs.len() - used;
    let left_spare = (spare as u64 * left_count as u64 / used as u64) as usize;
    let moved = left_spare.min(right_count);
    let to = left_count + left_spare.max(right_count);
    refs.copy_within(left_count..left_count + moved, to);
    let cut = left_count + left_spare;
    let (left_refs, right_refs) = refs.split_at_mut(cut);
    let (head, rest) = nodes.split_at_mut(1);
    let (left_nodes, right_nodes) = rest.split_at_mut(2 * cut - 1);
    let mut go_left = || {
        let r = Range { refs: left_refs, count: left_count, base, nodes: left_nodes };
        subtree(r, left.0, left.1, below, source)
    };
    let mut go_right = || {
        let r = Range { refs: right_refs, count: right_count, base: base + cut, nodes: right_nodes };
        subtree(r, right.0, right.1, below, source)
    };
    let (l, r) = if count > TASK { rayon::join(&mut go_left, &mut go_right) } else { (go_left(), go_right()) };
    let total = left_nodes[0].count + right_nodes[0].count;
    head[0] = BinaryNode { right: 2 * cut as u32, count: total, ..node };
    collapse(&mut head[0], area, &l, &r)
}

/// Chooses for each number of slots how the subtree fills them at least cost (Ylitie, Karras, Laine 2017, "Efficient
/// Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", section 3.1, equations 3 to 5).
fn collapse(node: &mut BinaryNode, area: f32, left: &Costs, right: &Costs) -> Costs {
    let mut costs = [f32::INFINITY; WIDTH];
    for j in 2..=WIDTH {
        let mut best = (costs[j - 2], 0);
        for k in 1..j {
            let cost = left[k - 1] + right[j - k - 1];
            if cost < best.0 {
                best = (cost, k as u8);
            }
        }
        costs[j - 1] = best.0;
        node.slots[j] = best.1;
    }
    let as_node = costs[WIDTH - 1] + area * NODE_COST;
    let as_leaf = if node.count as usize <= MAX_BLOCKS * LANES { area * blocks(node.count) } else { f32::INFINITY };
    node.leaf = u8::from(as_leaf <= as_node);
    costs[0] = as_leaf.min(as_node);
    for j in 1..WIDTH {
        if costs[0] <= costs[j] {
            costs[j] = costs[0];
            // Every number of slots up to this one is best served by a single child.
            node.slots[j + 1] = 0;
        } else {
            break;
        }
    }
    costs
}

/// The best split between references.
fn object_split(refs: &[PrimRef], centers: &Box4) -> Option<(Split, BinMap)> {
    use rayon::prelude::*;
    let bins = (8 + refs.len() / 4).min(MAX_BINS);
    let map = BinMap::new(centers, bins);
    let filled = if refs.len() <= CHUNK {
        Bins::fill(refs, &map)
    } else {
        let empty = || Bins::fill(&[], &map);
        refs.par_chunks(CHUNK).map(|c| Bins::fill(c, &map)).reduce(empty, |a, b| a.merge(&b))
    };
    let cost = |n: u32| n as f32;
    filled.best(&map, cost).map(|s| (s, map))
}

/// Bounds of a side and of its doubled middles.
type Side = (Box4, Box4);

/// Moves the left side's references to the front.
fn partition(refs: &mut [PrimRef], split: &Split, map: &BinMap) -> (usize, Side, Side) {
    let (mut left, mut right) = (Box4::EMPTY, Box4::EMPTY);
    let (mut i, mut j) = (0, refs.len());
    while i < j {
        let c = refs[i].center2();
        if map.bin(c, split.axis) < split.bin {
            left = left.grow(c);
            i += 1;
        } else {
            right = right.grow(c);
            j -= 1;
            refs.swap(i, j);
        }
    }
    (i, (split.left, left), (split.right, right))
}

/// Cuts a range in the middle, where area tells nothing.
fn halve(refs: &[PrimRef]) -> (usize, Side, Side) {
    let (left, right) = refs.split_at(refs.len() / 2);
    (left.len(), range_bounds(left), range_bounds(right))
}
