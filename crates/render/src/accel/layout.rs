//! Memory layout of a hierarchy: nodes, leaf blocks and the arena that holds both.
#![allow(unsafe_code)]

use super::simd::{LANES, WIDTH};

/// A reference to what a child is: the offset in the arena in [`UNIT`]s, shifted left by three, with a tag below:
/// 0 to [`MAX_BLOCKS`] for so many triangle blocks, [`TAG_ITEMS`] for a list of item numbers, [`TAG_NODE`] for a node.
/// Thus 0 is the leaf that holds nothing.
pub(super) type ChildRef = u32;
/// Tag of a list: its length, then numbers of shapes or instances.
pub(super) const TAG_ITEMS: u32 = 6;
/// Tag of an inner node.
pub(super) const TAG_NODE: u32 = 7;
/// Most triangle blocks in a leaf.
pub(super) const MAX_BLOCKS: usize = 5;
/// Bytes of the unit of offsets.
pub(super) const UNIT: usize = 32;

/// Eight boxes as planes, and what they hold. The planes a ray enters and leaves by are found by a byte offset that
/// depends on the sign of the ray's direction.
#[repr(C, align(64))]
pub(super) struct Node {
    /// Lower and upper planes of x, then y, then z. Empty slots have lower +∞ and upper -∞.
    pub planes: [[f32; WIDTH]; 6],
    pub children: [ChildRef; WIDTH],
    pub unused: [u32; WIDTH],
}

/// Units of a node.
pub(super) const NODE_UNITS: usize = size_of::<Node>() / UNIT;
/// Offset of the children in a node, in bytes.
pub(super) const CHILDREN_AT: usize = 6 * WIDTH * 4;

impl Node {
    pub(super) const EMPTY: Self = Self {
        planes: [
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
            [f32::INFINITY; 8],
            [f32::NEG_INFINITY; 8],
        ],
        children: [0; WIDTH],
        unused: [0; WIDTH],
    };
}

/// [`LANES`] triangles by coordinate. Unused lanes hold a triangle of three equal points, which nothing hits.
#[repr(C, align(32))]
#[derive(Clone, Copy)]
pub(super) struct Block {
    /// Coordinate `axis` of vertex `k` at `vertices[3 k + axis]`.
    pub vertices: [[f32; LANES]; 9],
    pub prims: [u32; LANES],
}

/// Units of a block.
pub(super) const BLOCK_UNITS: usize = size_of::<Block>() / UNIT;

/// Memory aligned for nodes, in huge pages where the system grants them: rays jump about in it.
pub(super) struct Arena {
    lines: Vec<[Line; 1]>,
}

/// A cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(super) struct Line([u32; 16]);

impl Arena {
    /// Zeroed memory of at least so many units.
    pub(super) fn new(units: usize) -> Self {
        let count = (units * UNIT).div_ceil(size_of::<Line>());
        let mut lines: Vec<[Line; 1]> = Vec::with_capacity(count);
        advise_huge_pages(lines.as_mut_ptr().cast(), count * size_of::<Line>());
        lines.resize(count, [Line([0; 16])]);
        Self { lines }
    }

    pub(super) fn bytes(&self) -> usize {
        self.lines.len() * size_of::<Line>()
    }

    #[inline(always)]
    pub(super) fn base(&self) -> *const u8 {
        self.lines.as_ptr().cast()
    }

    pub(super) fn units_mut(&mut self) -> &mut [Unit] {
        // SAFETY: `Line` is two `Unit`s of plain numbers, with a stricter alignment.
        unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.lines.len() * 2) }
    }

    pub(super) fn units(&self) -> &[Unit] {
        // SAFETY: as above.
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.lines.len() * 2) }
    }
}

/// The unit of offsets in an arena.
#[repr(C, align(32))]
#[derive(Clone, Copy)]
pub(super) struct Unit(pub [u32; UNIT / 4]);

/// Writes a node at the start of `units`.
pub(super) fn write_node(units: &mut [Unit], node: &Node) {
    let words: [u32; NODE_UNITS * 8] = {
        let mut w = [0; NODE_UNITS * 8];
        for (i, plane) in node.planes.iter().enumerate() {
            for (j, x) in plane.iter().enumerate() {
                w[i * WIDTH + j] = x.to_bits();
            }
        }
        w[6 * WIDTH..7 * WIDTH].copy_from_slice(&node.children);
        w
    };
    copy_words(units, &words);
}

/// Writes a block at the start of `units`.
pub(super) fn write_block(units: &mut [Unit], block: &Block) {
    let mut words = [0; BLOCK_UNITS * 8];
    for (i, lane) in block.vertices.iter().flatten().enumerate() {
        words[i] = lane.to_bits();
    }
    words[9 * LANES..10 * LANES].copy_from_slice(&block.prims);
    copy_words(units, &words);
}

/// Copies words to the start of `units`.
pub(super) fn copy_words(units: &mut [Unit], words: &[u32]) {
    for (unit, chunk) in units.iter_mut().zip(words.chunks(UNIT / 4)) {
        unit.0[..chunk.len()].copy_from_slice(chunk);
    }
}

#[cfg(target_os = "linux")]
fn advise_huge_pages(start: *mut u8, bytes: usize) {
    const HUGE: usize = 2 << 20;
    let first = (start as usize).next_multiple_of(HUGE);
    let end = (start as usize + bytes) / HUGE * HUGE;
    if first < end {
        // SAFETY: the range lies within an allocation of ours, and the advice changes no contents. A refusal is harmless.
        unsafe { libc::madvise(first as *mut libc::c_void, end - first, libc::MADV_HUGEPAGE) };
    }
}

#[cfg(not(target_os = "linux"))]
fn advise_huge_pages(_start: *mut u8, _bytes: usize) {}
