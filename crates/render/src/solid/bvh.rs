//! Hierarchy of boxes over anything that has bounds: parts of unions, triangles of meshes.
//!
//! Four children a node, boxes in single precision rounded outwards, so that a node is tested by plain loops that compilers turn into
//! vector code; what the boxes hold is tested in double precision.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::{Bounds, Line};

const WIDTH: usize = 4;
/// Items of a leaf.
const LEAF: usize = 4;
/// Levels by area; below them ranges are halved.
const SAH_DEPTH: u32 = 48;
/// Levels there can be at most (halving takes 32), times the children that a level leaves behind.
const STACK: usize = (SAH_DEPTH as usize + 34) * (WIDTH - 1) + 2;
const BINS: usize = 16;
/// Relative error that box tests in single precision allow for.
const SLACK: f32 = 1.0 + 4.0e-6;
/// Origins beyond this are tested against everything.
const FAR: f64 = 1e15;

/// Four boxes and what they hold.
#[derive(Clone, Debug)]
struct Node {
    /// Lower and upper planes of x, then y, then z.
    planes: [[f32; WIDTH]; 6],
    /// Node, or the first item of a leaf.
    child: [u32; WIDTH],
    /// Items of a leaf; 0 for a node or an empty slot.
    count: [u8; WIDTH],
}

/// Hierarchy over items by number.
#[derive(Clone, Debug, Default)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    items: Vec<u32>,
    bounds: Option<Bounds>,
}

struct Entry {
    bounds: Bounds,
    item: u32,
}

impl Bvh {
    /// Builds over the boxes of items 0 to n − 1; empty and not finite ones are left out.
    pub(super) fn new(bounds: impl IntoIterator<Item = Bounds>) -> Self {
        let mut entries: Vec<Entry> = bounds
            .into_iter()
            .enumerate()
            .filter(|(_, b)| !b.is_empty() && b.is_finite())
            .map(|(i, bounds)| Entry { bounds, item: i as u32 })
            .collect();
        if entries.is_empty() {
            return Self::default();
        }
        let all = hull(&entries);
        let mut bvh =
            Self { nodes: Vec::with_capacity(entries.len() / 4 + 1), items: Vec::with_capacity(entries.len()), bounds: Some(all) };
        bvh.node(&mut entries, 0);
        bvh
    }

    /// The box of everything.
    pub(super) fn bounds(&self) -> Bounds {
        self.bounds.unwrap_or(Bounds::EMPTY)
    }

    /// Number of items.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.items.len()
    }

    /// Builds the node of a range and returns its number.
    fn node(&mut self, entries: &mut [Entry], depth: u32) -> u32 {
        let index = self.nodes.len();
        self.nodes.push(Node {
            planes: [
                [f32::INFINITY; 4],
                [f32::NEG_INFINITY; 4],
                [f32::INFINITY; 4],
                [f32::NEG_INFINITY; 4],
                [f32::INFINITY; 4],
                [f32::NEG_INFINITY; 4],
            ],
            child: [0; WIDTH],
            count: [0; WIDTH],
        });
        let mut parts: ArrayVec<&mut [Entry], WIDTH> = ArrayVec::new();
        let (a, b) = split(entries, depth);
        for half in [a, b] {
            if half.len() > LEAF {
                let (c, d) = split(half, depth + 1);
                parts.push(c);
                parts.push(d);
            } else if !half.is_empty() {
                parts.push(half);
            }
        }
        for (slot, part) in parts.into_iter().enumerate() {
            let box_ = hull(part);
            for axis in 0..3 {
                self.nodes[index].planes[2 * axis][slot] = below(box_.min[axis]);
                self.nodes[index].planes[2 * axis + 1][slot] = above(box_.max[axis]);
            }
            if part.len() <= LEAF {
                self.nodes[index].child[slot] = self.items.len() as u32;
                self.nodes[index].count[slot] = part.len() as u8;
                self.items.extend(part.iter().map(|e| e.item));
            } else {
                self.nodes[index].child[slot] = self.node(part, depth + 2);
            }
        }
        index as u32
    }

    /// Visits the items whose boxes the line may cross between `t_min` and `t_max`, near ones first by and large, until `visit` returns
    /// false. It may lower `t_max`.
    #[inline]
    pub(super) fn visit(&self, line: &Line, t_min: f64, mut t_max: f64, mut visit: impl FnMut(u32, &mut f64) -> bool) {
        if self.nodes.is_empty() {
            return;
        }
        // Not a number ends here too.
        if !(line.o.abs().max_element() < FAR && line.d.is_finite()) {
            for &item in &self.items {
                if !visit(item, &mut t_max) {
                    return;
                }
            }
            return;
        }
        let ray = Narrow::new(line, t_min);
        let mut stack: ArrayVec<(u32, f32), STACK> = ArrayVec::new();
        let mut current = 0u32;
        loop {
            let node = &self.nodes[current as usize];
            let (near, mask) = ray.test(&node.planes, (t_max as f32) * SLACK);
            // Children in the order of falling distance, so that the nearest is taken first.
            let mut order = [(0.0f32, 0u8); WIDTH];
            let mut entered = 0;
            for (slot, &t) in near.iter().enumerate() {
                if mask & (1 << slot) != 0 {
                    let mut at = entered;
                    while at > 0 && order[at - 1].0 < t {
                        order[at] = order[at - 1];
                        at -= 1;
                    }
                    order[at] = (t, slot as u8);
                    entered += 1;
                }
            }
            // Inner nodes wait behind the leaves of this node.
            let mut inner: ArrayVec<(u32, f32), WIDTH> = ArrayVec::new();
            for &(near, slot) in order[..entered].iter().rev() {
                let slot = slot as usize;
                if node.count[slot] == 0 {
                    inner.push((node.child[slot], near));
                    continue;
                }
                if near > (t_max as f32) * SLACK {
                    break;
                }
                let start = node.child[slot] as usize;
                for &item in &self.items[start..start + node.count[slot] as usize] {
                    if !visit(item, &mut t_max) {
                        return;
                    }
                }
            }
            for &entry in inner.iter().rev() {
                if stack.try_push(entry).is_err() {
                    debug_assert!(false, "stack of the hierarchy");
                }
            }
            loop {
                let Some((next, near)) = stack.pop() else { return };
                if near <= (t_max as f32) * SLACK {
                    current = next;
                    break;
                }
            }
        }
    }

    /// Visits the items whose boxes hold a point until `visit` returns false.
    pub(super) fn visit_point(&self, p: DVec3, mut visit: impl FnMut(u32) -> bool) {
        if !self.bounds.is_some_and(|b| b.contains(p)) {
            return;
        }
        let lo = [above(p.x), above(p.y), above(p.z)];
        let hi = [below(p.x), below(p.y), below(p.z)];
        let mut stack: ArrayVec<u32, STACK> = ArrayVec::new();
        stack.push(0);
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            for slot in 0..WIDTH {
                if !(0..3).all(|a| node.planes[2 * a][slot] <= lo[a] && node.planes[2 * a + 1][slot] >= hi[a]) {
                    continue;
                }
                let start = node.child[slot] as usize;
                if node.count[slot] == 0 {
                    if stack.try_push(node.child[slot]).is_err() {
                        debug_assert!(false, "stack of the hierarchy");
                    }
                    continue;
                }
                for &item in &self.items[start..start + node.count[slot] as usize] {
                    if !visit(item) {
                        return;
                    }
                }
            }
        }
    }
}

/// A line in single precision for box tests that err on the side of hits.
struct Narrow {
    /// Origin moved up, for planes entered in positive direction, and down, by its rounding error.
    above: [f32; 3],
    below: [f32; 3],
    inverse: [f32; 3],
    t_min: f32,
}

impl Narrow {
    #[inline]
    fn new(line: &Line, t_min: f64) -> Self {
        let o = [line.o.x, line.o.y, line.o.z];
        let d = [line.d.x, line.d.y, line.d.z];
        Self {
            // One step out or two: no branches.
            above: o.map(|x| x as f32).map(|y| y + (y.abs() * f32::EPSILON + f32::MIN_POSITIVE)),
            below: o.map(|x| x as f32).map(|y| y - (y.abs() * f32::EPSILON + f32::MIN_POSITIVE)),
            inverse: d.map(|d| {
                let inverse = (1.0 / d) as f32;
                if inverse.abs() < 1e30 { inverse } else { 1e30f32.copysign(inverse) }
            }),
            t_min: (t_min as f32) * if t_min > 0.0 { 1.0 / SLACK } else { SLACK },
        }
    }

    /// Entering distances and a bit for each box that is entered before `limit`.
    #[inline]
    fn test(&self, planes: &[[f32; WIDTH]; 6], limit: f32) -> ([f32; WIDTH], u32) {
        let mut near = [self.t_min; WIDTH];
        let mut far = [limit; WIDTH];
        for axis in 0..3 {
            let inverse = self.inverse[axis];
            let (enter, leave) = if inverse < 0.0 { (2 * axis + 1, 2 * axis) } else { (2 * axis, 2 * axis + 1) };
            // The entering plane is taken nearer, the leaving one farther than it may be.
            let (o_enter, o_leave) =
                if inverse < 0.0 { (self.below[axis], self.above[axis]) } else { (self.above[axis], self.below[axis]) };
            for i in 0..WIDTH {
                let a = (planes[enter][i] - o_enter) * inverse;
                let b = (planes[leave][i] - o_leave) * inverse * SLACK;
                near[i] = if a > near[i] { a } else { near[i] };
                far[i] = if b < far[i] { b } else { far[i] };
            }
        }
        let mut mask = 0;
        for i in 0..WIDTH {
            mask |= u32::from(near[i] <= far[i]) << i;
        }
        (near, mask)
    }
}

/// The largest single-precision number not above.
fn below(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) > x { y.next_down() } else { y }
}

/// The smallest single-precision number not below.
fn above(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) < x { y.next_up() } else { y }
}

fn hull(entries: &[Entry]) -> Bounds {
    entries.iter().fold(Bounds::EMPTY, |b, e| b.union(e.bounds))
}

fn half_area(b: &Bounds) -> f64 {
    if b.is_empty() {
        return 0.0;
    }
    let s = b.max - b.min;
    s.x * s.y + s.y * s.z + s.z * s.x
}

/// Divides a range by the surface area heuristic in bins along the longest axis of the centers (Wald 2007, "On fast construction of SAH-based
/// bounding volume hierarchies"), or in the middle where that tells nothing.
fn split(entries: &mut [Entry], depth: u32) -> (&mut [Entry], &mut [Entry]) {
    let n = entries.len();
    if n <= 1 {
        return entries.split_at_mut(n);
    }
    let center = |e: &Entry| e.bounds.min * 0.5 + e.bounds.max * 0.5;
    let centers = Bounds::of_points(entries.iter().map(center));
    let size = centers.max - centers.min;
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let scale = BINS as f64 / size[axis];
    if depth >= SAH_DEPTH || !(scale.is_finite() && scale > 0.0) {
        return entries.split_at_mut(n / 2);
    }
    let bin = |e: &Entry| (((center(e)[axis] - centers.min[axis]) * scale) as usize).min(BINS - 1);
    let mut bins = [(Bounds::EMPTY, 0usize); BINS];
    for e in entries.iter() {
        let b = &mut bins[bin(e)];
        b.0 = b.0.union(e.bounds);
        b.1 += 1;
    }
    let mut right = [0.0; BINS];
    let mut acc = (Bounds::EMPTY, 0);
    for i in (1..BINS).rev() {
        acc = (acc.0.union(bins[i].0), acc.1 + bins[i].1);
        right[i] = half_area(&acc.0) * acc.1 as f64;
    }
    let mut best = (f64::INFINITY, 0);
    acc = (Bounds::EMPTY, 0);
    for i in 1..BINS {
        acc = (acc.0.union(bins[i - 1].0), acc.1 + bins[i - 1].1);
        let cost = half_area(&acc.0) * acc.1 as f64 + right[i];
        if acc.1 > 0 && acc.1 < n && cost < best.0 {
            best = (cost, i);
        }
    }
    if best.1 == 0 {
        return entries.split_at_mut(n / 2);
    }
    let mut middle = 0;
    for i in 0..n {
        if bin(&entries[i]) < best.1 {
            entries.swap(i, middle);
            middle += 1;
        }
    }
    entries.split_at_mut(middle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::testing::Random;

    #[test]
    fn visits_what_a_scan_finds() {
        let mut r = Random::new(7);
        for n in [0usize, 1, 3, 5, 40, 1000] {
            let boxes: Vec<Bounds> = (0..n)
                .map(|_| {
                    let c = r.vector() * 10.0;
                    Bounds::of(c, c + r.vector() * if r.unit() < 0.3 { 0.0 } else { 0.5 })
                })
                .collect();
            let bvh = Bvh::new(boxes.iter().copied());
            assert_eq!(bvh.len(), n);
            for k in 0..300 {
                let mut d = r.vector();
                if k % 5 == 0 {
                    d.x = 0.0;
                }
                let line = Line { o: r.vector() * if k % 3 == 0 { 1e4 } else { 12.0 }, d };
                let mut seen = vec![0; n];
                bvh.visit(&line, 0.0, 1e30, |i, _| {
                    seen[i as usize] += 1;
                    true
                });
                for (i, b) in boxes.iter().enumerate() {
                    let hit = b.clip(&line, line.d.recip(), 0.0, 1e30).is_some();
                    assert!(seen[i] == 1 || !hit && seen[i] == 0, "box {i} of {n}: {hit} {}", seen[i]);
                }
                let p = line.o;
                let mut inside = vec![false; n];
                bvh.visit_point(p, |i| {
                    inside[i as usize] = true;
                    true
                });
                assert!(boxes.iter().zip(&inside).all(|(b, i)| *i || !b.contains(p)));
            }
        }
    }

    #[test]
    fn degenerate_input() {
        let same = vec![Bounds::around(DVec3::ONE, 1.0); 100_000];
        let bvh = Bvh::new(same);
        let mut n = 0;
        bvh.visit(&Line { o: DVec3::ZERO, d: DVec3::ONE }, 0.0, f64::INFINITY, |_, _| {
            n += 1;
            true
        });
        assert_eq!(n, 100_000);
        // Boxes that nest to a point: every split leaves one aside.
        let nested = (0..2000).map(|i| Bounds::around(DVec3::splat(0.5f64.powi(i)), 0.5f64.powi(i)));
        let bvh = Bvh::new(nested);
        n = 0;
        bvh.visit(&Line { o: DVec3::splat(-1.0), d: DVec3::ONE }, 0.0, f64::INFINITY, |_, _| {
            n += 1;
            true
        });
        assert_eq!(n, 2000);
        let odd = [Bounds::EMPTY, Bounds::INFINITE, Bounds::around(DVec3::NAN, 1.0), Bounds::around(DVec3::splat(1e300), 1e299)];
        assert_eq!(Bvh::new(odd).len(), 1);
        Bvh::new(odd).visit(&Line { o: DVec3::NAN, d: DVec3::NAN }, 0.0, 1.0, |_, _| true);
    }
}
