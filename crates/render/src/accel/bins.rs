//! Binned surface area heuristic: where to split a range of references.

use super::simd::LANES;
use crate::math::{Aabb, Vec3};

/// A primitive, or with spatial splits the part of one in a region: its box and number.
#[repr(C, align(16))]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct PrimRef {
    pub min: [f32; 3],
    pub id: u32,
    pub max: [f32; 3],
    pub unused: u32,
}

impl PrimRef {
    pub(super) fn new(b: Aabb, id: u32) -> Self {
        Self { min: b.min.to_array(), id, max: b.max.to_array(), unused: 0 }
    }

    #[inline(always)]
    pub(super) fn bounds(&self) -> Box4 {
        let [min, max]: [[f32; 4]; 2] = bytemuck::cast(*self);
        Box4 { min, max }
    }

    /// Twice the middle.
    #[inline(always)]
    pub(super) fn center2(&self) -> [f32; 4] {
        let b = self.bounds();
        add4(b.min, b.max)
    }
}

/// A box in vectors of four, the last lane of which means nothing.
#[derive(Clone, Copy)]
pub(super) struct Box4 {
    pub min: [f32; 4],
    pub max: [f32; 4],
}

#[inline(always)]
fn add4(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|i| a[i] + b[i])
}

#[inline(always)]
fn min4(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
}

#[inline(always)]
fn max4(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
}

impl Box4 {
    pub(super) const EMPTY: Self = Self { min: [f32::INFINITY; 4], max: [f32::NEG_INFINITY; 4] };

    #[inline(always)]
    pub(super) fn union(self, o: Self) -> Self {
        Self { min: min4(self.min, o.min), max: max4(self.max, o.max) }
    }

    #[inline(always)]
    pub(super) fn grow(self, p: [f32; 4]) -> Self {
        Self { min: min4(self.min, p), max: max4(self.max, p) }
    }

    #[inline(always)]
    pub(super) fn intersection(self, o: Self) -> Self {
        Self { min: max4(self.min, o.min), max: min4(self.max, o.max) }
    }

    /// Half of the surface area, zero where empty.
    #[inline(always)]
    pub(super) fn half_area(&self) -> f32 {
        let e = |k: usize| {
            let e = self.max[k] - self.min[k];
            if e > 0.0 { e } else { 0.0 }
        };
        e(0) * e(1) + e(1) * e(2) + e(2) * e(0)
    }

    pub(super) fn aabb(&self) -> Aabb {
        Aabb { min: Vec3::new(self.min[0], self.min[1], self.min[2]), max: Vec3::new(self.max[0], self.max[1], self.max[2]) }
    }
}

/// Most bins of an axis.
pub(super) const MAX_BINS: usize = 32;

/// Maps twice the middle of a reference to its bin, the same way in every pass.
#[derive(Clone, Copy)]
pub(super) struct BinMap {
    origin: [f32; 4],
    scale: [f32; 4],
    last: i32,
}

impl BinMap {
    /// For so many bins over a box of doubled middles; axes without extent map to bin 0.
    pub(super) fn new(centers2: &Box4, bins: usize) -> Self {
        let scale = std::array::from_fn(|k| {
            let e = centers2.max[k] - centers2.min[k];
            if k < 3 && e > 1e-30 { bins as f32 * 0.9999 / e } else { 0.0 }
        });
        let mut origin = centers2.min;
        origin[3] = 0.0;
        Self { origin, scale, last: bins as i32 - 1 }
    }

    #[inline(always)]
    pub(super) fn bin(&self, center2: [f32; 4], axis: usize) -> usize {
        (((center2[axis] - self.origin[axis]) * self.scale[axis]) as i32).clamp(0, self.last) as usize
    }

    fn flat(&self, axis: usize) -> bool {
        self.scale[axis] == 0.0
    }
}

/// Boxes and counts by bin and axis.
pub(super) struct Bins {
    boxes: [[Box4; MAX_BINS]; 3],
    counts: [[u32; MAX_BINS]; 3],
}

/// A way to divide a range.
#[derive(Clone, Copy)]
pub(super) struct Split {
    pub axis: usize,
    /// First bin of the right side.
    pub bin: usize,
    /// Sum over the sides of half area times blocks.
    pub cost: f32,
    pub left: Box4,
    pub right: Box4,
}

/// Leaf blocks that so many primitives fill.
#[inline(always)]
pub(super) fn blocks(count: u32) -> f32 {
    count.div_ceil(LANES as u32) as f32
}

impl Bins {
    /// Sorts references into bins.
    pub(super) fn fill(refs: &[PrimRef], map: &BinMap) -> Self {
        let mut bins = Self { boxes: [[Box4::EMPTY; MAX_BINS]; 3], counts: [[0; MAX_BINS]; 3] };
        for r in refs {
            let c = r.center2();
            let b = r.bounds();
            for axis in 0..3 {
                let i = map.bin(c, axis);
                let slot = &mut bins.boxes[axis][i];
                *slot = slot.union(b);
                bins.counts[axis][i] += 1;
            }
        }
        bins
    }

    /// Adds the contents of other bins of the same map.
    pub(super) fn merge(mut self, o: &Self) -> Self {
        for axis in 0..3 {
            for i in 0..MAX_BINS {
                self.boxes[axis][i] = self.boxes[axis][i].union(o.boxes[axis][i]);
                self.counts[axis][i] += o.counts[axis][i];
            }
        }
        self
    }

    /// The cheapest split, if the middles differ at all. Ties go to the first axis and bin.
    pub(super) fn best(&self, map: &BinMap, count_cost: impl Fn(u32) -> f32) -> Option<Split> {
        let mut best: Option<Split> = None;
        let n = map.last as usize + 1;
        for axis in (0..3).filter(|&a| !map.flat(a)) {
            let mut right = [(Box4::EMPTY, 0u32); MAX_BINS + 1];
            for i in (1..n).rev() {
                right[i] = (right[i + 1].0.union(self.boxes[axis][i]), right[i + 1].1 + self.counts[axis][i]);
                if i + 1 == n {
                    right[i] = (self.boxes[axis][i], self.counts[axis][i]);
                }
            }
            let (mut left, mut left_count) = (Box4::EMPTY, 0);
            for (i, &(r, right_count)) in right.iter().enumerate().take(n).skip(1) {
                left = left.union(self.boxes[axis][i - 1]);
                left_count += self.counts[axis][i - 1];
                if left_count == 0 || right_count == 0 {
                    continue;
                }
                let cost = left.half_area() * count_cost(left_count) + r.half_area() * count_cost(right_count);
                if best.is_none_or(|b| cost < b.cost) {
                    best = Some(Split { axis, bin: i, cost, left, right: r });
                }
            }
        }
        best
    }
}
