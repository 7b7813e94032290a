//! From the binary tree to nodes and leaves in an arena: depth first, each subtree in one piece, leaves behind the
//! node that refers to them.

use std::sync::atomic::{AtomicU32, Ordering};

use arrayvec::ArrayVec;
use rayon::prelude::*;

use super::build::{BinaryNode, BinaryTree};
use super::layout::{
    Arena, BLOCK_UNITS, Block, ChildRef, MAX_BLOCKS, NODE_UNITS, Node, TAG_ITEMS, TAG_NODE, UNIT, Unit, copy_words, write_block, write_node,
};
use super::simd::{LANES, WIDTH};
use crate::math::Vec3;

/// Most primitives of a leaf.
const MAX_LEAF: usize = MAX_BLOCKS * LANES;
/// Subtrees with more references than this are written by a task of their own.
const TASK: u32 = 8192;

/// What leaves hold: primitives below `triangles.len()` are triangles, others items of a list.
pub(super) struct Source<'a> {
    pub positions: &'a [Vec3],
    pub triangles: &'a [[u32; 3]],
}

/// Writes a tree; returns the arena and the reference to the root. None where it would exceed what references can
/// address (16 GiB).
pub(super) fn emit(tree: &BinaryTree, source: &Source) -> Option<(Arena, ChildRef)> {
    if tree.nodes.is_empty() {
        return Some((Arena::new(0), 0));
    }
    let mut sizes = Vec::new();
    sizes.resize_with(tree.nodes.len(), || AtomicU32::new(0));
    let e = Emitter { tree, source, sizes };
    let root = Child { node: 0, leaf: tree.nodes[0].leaf == 1 };
    let units = if root.leaf { u64::from(e.leaf_units(&e.leaf(0))) } else { e.measure(0) };
    if units >= 1 << 29 {
        return None;
    }
    let mut arena = Arena::new(units as usize);
    let reference = if root.leaf { e.write_leaf(&e.leaf(0), arena.units_mut(), 0) } else { TAG_NODE };
    if !root.leaf {
        e.write(0, &mut arena.units_mut()[..units as usize], 0);
    }
    Some((arena, reference))
}

/// What a slot of a node stands for: a subtree of the binary tree, as a leaf or a node.
#[derive(Clone, Copy)]
struct Child {
    node: usize,
    leaf: bool,
}

type Children = ArrayVec<Child, WIDTH>;
/// Primitives of a leaf: triangles, then items.
struct Leaf {
    triangles: ArrayVec<u32, MAX_LEAF>,
    items: ArrayVec<u32, MAX_LEAF>,
}

struct Emitter<'a> {
    tree: &'a BinaryTree,
    source: &'a Source<'a>,
    /// Units of the subtree below each node of the binary tree that becomes a node.
    sizes: Vec<AtomicU32>,
}

impl Emitter<'_> {
    fn node(&self, i: usize) -> &BinaryNode {
        &self.tree.nodes[i]
    }

    /// The children of the node that stands for the subtree at `i`.
    fn children(&self, i: usize) -> Children {
        let mut out = Children::new();
        self.expand(i, WIDTH, true, &mut out);
        out
    }

    fn expand(&self, i: usize, mut slots: usize, root: bool, out: &mut Children) {
        let n = self.node(i);
        while slots > 1 && n.slots[slots] == 0 {
            slots -= 1;
        }
        if slots == 1 || n.right == 0 {
            // A root that prefers one child is a leaf, and leaves are not expanded.
            debug_assert!(!root);
            out.push(Child { node: i, leaf: n.leaf == 1 });
            return;
        }
        let left = n.slots[slots] as usize;
        self.expand(i + 1, left, false, out);
        self.expand(i + n.right as usize, slots - left, false, out);
    }

    /// The primitives below a subtree, each once.
    fn leaf(&self, i: usize) -> Leaf {
        let mut ids = ArrayVec::<u32, MAX_LEAF>::new();
        self.gather(i, &mut ids);
        ids.sort_unstable();
        let mut leaf = Leaf { triangles: ArrayVec::new(), items: ArrayVec::new() };
        let triangles = self.source.triangles.len() as u32;
        for (k, &id) in ids.iter().enumerate() {
            if k > 0 && ids[k - 1] == id {
                continue;
            }
            if id < triangles { leaf.triangles.push(id) } else { leaf.items.push(id - triangles) }
        }
        leaf
    }

    fn gather(&self, i: usize, ids: &mut ArrayVec<u32, MAX_LEAF>) {
        let n = self.node(i);
        if n.right == 0 {
            let first = n.first as usize;
            ids.extend(self.tree.refs[first..first + n.count as usize].iter().map(|r| r.id));
        } else {
            self.gather(i + 1, ids);
            self.gather(i + n.right as usize, ids);
        }
    }

    /// Units that a leaf takes, even so that nodes stay aligned.
    fn leaf_units(&self, leaf: &Leaf) -> u32 {
        let blocks = leaf.triangles.len().div_ceil(LANES) * BLOCK_UNITS;
        let items = if leaf.items.is_empty() { 0 } else { (leaf.items.len() + 1).div_ceil(UNIT / 4) };
        let both = if blocks > 0 && items > 0 { NODE_UNITS + 1 } else { 0 };
        (blocks + items + both) as u32
    }

    /// Computes and stores the sizes of nodes.
    fn measure(&self, i: usize) -> u64 {
        let children = self.children(i);
        let own: u32 = NODE_UNITS as u32 + children.iter().filter(|c| c.leaf).map(|c| self.leaf_units(&self.leaf(c.node))).sum::<u32>();
        let measure = |c: &Child| if c.leaf { 0 } else { self.measure(c.node) };
        let below: u64 =
            if self.node(i).count > TASK { children.par_iter().map(measure).sum() } else { children.iter().map(measure).sum() };
        let size = u64::from(own.next_multiple_of(2)) + below;
        self.sizes[i].store(size as u32, Ordering::Relaxed);
        size
    }

    /// Writes the node for the subtree at `i` and all below it to `units`, which start at unit `at` of the arena.
    fn write(&self, i: usize, units: &mut [Unit], at: u32) {
        let children = self.children(i);
        let mut node = Node::EMPTY;
        let mut end = NODE_UNITS as u32;
        for (slot, c) in children.iter().enumerate() {
            let n = self.node(c.node);
            for axis in 0..3 {
                node.planes[2 * axis][slot] = n.min[axis];
                node.planes[2 * axis + 1][slot] = n.max[axis];
            }
            if c.leaf {
                let leaf = self.leaf(c.node);
                node.children[slot] = self.write_leaf(&leaf, &mut units[end as usize..], at + end);
                end += self.leaf_units(&leaf);
            }
        }
        end = end.next_multiple_of(2);
        let (own, mut rest) = units.split_at_mut(end as usize);
        let mut tasks = ArrayVec::<(usize, &mut [Unit], u32), WIDTH>::new();
        let mut offset = at + end;
        for (slot, c) in children.iter().enumerate().filter(|(_, c)| !c.leaf) {
            let size = self.sizes[c.node].load(Ordering::Relaxed);
            let (mine, others) = rest.split_at_mut(size as usize);
            rest = others;
            node.children[slot] = offset << 3 | TAG_NODE;
            tasks.push((c.node, mine, offset));
            offset += size;
        }
        write_node(own, &node);
        if self.node(i).count > TASK {
            tasks.into_iter().collect::<Vec<_>>().into_par_iter().for_each(|(n, units, at)| self.write(n, units, at));
        } else {
            tasks.into_iter().for_each(|(n, units, at)| self.write(n, units, at));
        }
    }

    /// Writes a leaf and returns the reference to it. One with triangles and items becomes a node with two leaves.
    fn write_leaf(&self, leaf: &Leaf, mut units: &mut [Unit], mut at: u32) -> ChildRef {
        let (blocks, items) = (!leaf.triangles.is_empty(), !leaf.items.is_empty());
        let both = (blocks && items).then(|| {
            // Nodes start at even units.
            let pad = at % 2;
            let node_at = at + pad;
            let (node_units, rest) = std::mem::take(&mut units)[pad as usize..].split_at_mut(NODE_UNITS);
            units = rest;
            at = node_at + NODE_UNITS as u32;
            (node_units, node_at)
        });
        let mut triangles_ref = 0;
        if blocks {
            let chunks = leaf.triangles.chunks(LANES);
            triangles_ref = at << 3 | chunks.len() as u32;
            for ids in chunks {
                write_block(units, &self.block(ids));
                units = &mut std::mem::take(&mut units)[BLOCK_UNITS..];
                at += BLOCK_UNITS as u32;
            }
        }
        let mut items_ref = 0;
        if items {
            items_ref = at << 3 | TAG_ITEMS;
            let mut words = ArrayVec::<u32, { MAX_LEAF + 1 }>::new();
            words.push(leaf.items.len() as u32);
            words.extend(leaf.items.iter().copied());
            copy_words(units, &words);
        }
        match both {
            None => triangles_ref | items_ref,
            Some((node_units, node_at)) => {
                let mut node = Node::EMPTY;
                for (slot, r) in [triangles_ref, items_ref].into_iter().enumerate() {
                    for axis in 0..3 {
                        (node.planes[2 * axis][slot], node.planes[2 * axis + 1][slot]) = (f32::MIN, f32::MAX);
                    }
                    node.children[slot] = r;
                }
                write_node(node_units, &node);
                node_at << 3 | TAG_NODE
            }
        }
    }

    fn block(&self, ids: &[u32]) -> Block {
        let mut block = Block { vertices: [[0.0; LANES]; 9], prims: [u32::MAX; LANES] };
        for (lane, &id) in ids.iter().enumerate() {
            block.prims[lane] = id;
            for (k, &index) in self.source.triangles[id as usize].iter().enumerate() {
                for (axis, x) in self.source.positions[index as usize].to_array().into_iter().enumerate() {
                    block.vertices[3 * k + axis][lane] = x;
                }
            }
        }
        block
    }
}
