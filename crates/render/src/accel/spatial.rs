//! Spatial splits: dividing space instead of references, where the boxes of an object split overlap much (Stich,
//! Friedrich, Dietrich 2009, "Spatial Splits in Bounding Volume Hierarchies", HPG).

use super::bins::{Box4, PrimRef};
use super::emit::Source;

/// Bins of an axis.
const BINS: usize = 16;
/// References that one task sorts into bins.
const CHUNK: usize = 1 << 15;

/// A plane that divides a range.
#[derive(Clone, Copy)]
pub(super) struct SpatialSplit {
    axis: usize,
    plane: f32,
    /// Sum over the sides of half area times references.
    pub cost: f32,
}

/// Where bins begin along one axis.
#[derive(Clone, Copy)]
struct Grid {
    axis: usize,
    origin: f32,
    width: f32,
    inv_width: f32,
}

impl Grid {
    /// Along the longest edge of the box; the other axes gained little and cost twice as much again.
    fn new(b: &Box4) -> Option<Self> {
        let e: [f32; 3] = std::array::from_fn(|k| b.max[k] - b.min[k]);
        let axis = if e[0] >= e[1] && e[0] >= e[2] {
            0
        } else if e[1] >= e[2] {
            1
        } else {
            2
        };
        let width = e[axis] / BINS as f32;
        (width > 1e-30).then(|| Self { axis, origin: b.min[axis], width, inv_width: 1.0 / width })
    }
    #[inline(always)]
    fn bin(&self, x: f32) -> usize {
        (((x - self.origin) * self.inv_width) as i32).clamp(0, BINS as i32 - 1) as usize
    }
    /// Where bin `i` begins.
    fn plane(&self, i: usize) -> f32 {
        self.origin + i as f32 * self.width
    }
}

/// Boxes of the parts in each bin, and how many references begin and end there.
struct Bins {
    boxes: [Box4; BINS],
    begins: [u32; BINS],
    ends: [u32; BINS],
}

impl Bins {
    fn fill(refs: &[PrimRef], grid: &Grid, source: &Source) -> Self {
        let mut bins = Self { boxes: [Box4::EMPTY; BINS], begins: [0; BINS], ends: [0; BINS] };
        let axis = grid.axis;
        for r in refs {
            let (first, last) = (grid.bin(r.min[axis]), grid.bin(r.max[axis]));
            bins.begins[first] += 1;
            bins.ends[last] += 1;
            let mut rest = *r;
            if first < last {
                let triangle = vertices(r, source);
                for i in first..last {
                    let (left, right) = divide(&rest, axis, grid.plane(i + 1), &triangle);
                    bins.boxes[i] = bins.boxes[i].union(left.bounds());
                    rest = right;
                }
            }
            bins.boxes[last] = bins.boxes[last].union(rest.bounds());
        }
        bins
    }

    fn merge(mut self, o: &Self) -> Self {
        for i in 0..BINS {
            self.boxes[i] = self.boxes[i].union(o.boxes[i]);
            self.begins[i] += o.begins[i];
            self.ends[i] += o.ends[i];
        }
        self
    }
}

/// The cheapest plane that adds at most `spare` references and leaves both sides fewer than there are.
pub(super) fn best(refs: &[PrimRef], bounds: &Box4, spare: usize, source: &Source) -> Option<SpatialSplit> {
    use rayon::prelude::*;
    let grid = Grid::new(bounds)?;
    let bins = if refs.len() <= CHUNK {
        Bins::fill(refs, &grid, source)
    } else {
        let empty = || Bins::fill(&[], &grid, source);
        refs.par_chunks(CHUNK).map(|c| Bins::fill(c, &grid, source)).reduce(empty, |a, b| a.merge(&b))
    };
    let mut best: Option<SpatialSplit> = None;
    let count = refs.len() as u32;
    let mut right = [(0.0, 0u32); BINS];
    let (mut b, mut n) = (Box4::EMPTY, 0);
    for i in (1..BINS).rev() {
        b = b.union(bins.boxes[i]);
        n += bins.ends[i];
        right[i] = (b.half_area(), n);
    }
    let (mut b, mut n) = (Box4::EMPTY, 0);
    for (i, &(right_area, right_count)) in right.iter().enumerate().skip(1) {
        b = b.union(bins.boxes[i - 1]);
        n += bins.begins[i - 1];
        if n == 0 || right_count == 0 || n >= count || right_count >= count || n + right_count > count + spare as u32 {
            continue;
        }
        let cost = b.half_area() * n as f32 + right_area * right_count as f32;
        if best.is_none_or(|s| cost < s.cost) {
            best = Some(SpatialSplit { axis: grid.axis, plane: grid.plane(i), cost });
        }
    }
    best
}

/// Divides the first `count` references of `refs` at a plane, using the room behind them for those on both sides.
/// Returns how many there are on the left, at the front, and on the right, behind them.
pub(super) fn partition(refs: &mut [PrimRef], count: usize, split: &SpatialSplit, source: &Source) -> (usize, usize) {
    let SpatialSplit { axis, plane, .. } = *split;
    let (mut i, mut j, mut end) = (0, count, count);
    let spare_end = refs.len();
    while i < j {
        let r = refs[i];
        if r.max[axis] <= plane {
            i += 1;
        } else if r.min[axis] >= plane || end == spare_end {
            j -= 1;
            refs.swap(i, j);
        } else {
            let (left, right) = divide(&r, axis, plane, &vertices(&r, source));
            match (empty(&left), empty(&right)) {
                (false, false) => {
                    refs[i] = left;
                    refs[end] = right;
                    end += 1;
                    i += 1;
                }
                (false, true) => i += 1,
                _ => {
                    j -= 1;
                    refs.swap(i, j);
                }
            }
        }
    }
    (i, end - i)
}

fn empty(r: &PrimRef) -> bool {
    (0..3).any(|k| r.min[k] > r.max[k])
}

/// The corners of a reference's triangle; none for other primitives.
#[inline(always)]
fn vertices(r: &PrimRef, source: &Source) -> Option<[[f32; 4]; 3]> {
    let t = source.triangles.get(r.id as usize)?;
    Some(t.map(|i| {
        let p = source.positions[i as usize];
        [p.x, p.y, p.z, 0.0]
    }))
}

/// The boxes of a reference's parts on both sides of a plane.
#[inline(always)]
fn divide(r: &PrimRef, axis: usize, plane: f32, triangle: &Option<[[f32; 4]; 3]>) -> (PrimRef, PrimRef) {
    let (mut left, mut right) = (*r, *r);
    left.max[axis] = plane.min(r.max[axis]);
    right.min[axis] = plane.max(r.min[axis]);
    let Some(v) = triangle else { return (left, right) };
    let (mut l, mut h) = (Box4::EMPTY, Box4::EMPTY);
    for k in 0..3 {
        let (a, b) = (&v[k], &v[if k == 2 { 0 } else { k + 1 }]);
        let (below, above) = (a[axis] <= plane, a[axis] >= plane);
        if below {
            l = l.grow(*a);
        }
        if above {
            h = h.grow(*a);
        }
        if (!above && plane < b[axis]) || (!below && b[axis] < plane) {
            let s = (plane - a[axis]) / (b[axis] - a[axis]);
            // With room for the rounding of the crossing.
            let room: [f32; 4] = std::array::from_fn(|i| 4e-7 * (a[i].abs() + b[i].abs()));
            let p: [f32; 4] = std::array::from_fn(|i| a[i] + (b[i] - a[i]) * s);
            let (low, high) = (std::array::from_fn(|i| p[i] - room[i]), std::array::from_fn(|i| p[i] + room[i]));
            l = l.grow(low).grow(high);
            h = h.grow(low).grow(high);
        }
    }
    let clip = |part: &PrimRef, b: Box4| {
        let c = part.bounds().intersection(b);
        PrimRef { min: [c.min[0], c.min[1], c.min[2]], id: r.id, max: [c.max[0], c.max[1], c.max[2]], unused: 0 }
    };
    (clip(&left, l), clip(&right, h))
}
