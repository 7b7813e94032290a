//! Which objects lie in which directions from a place: for the many lines that all begin at the camera or end at a light.
//!
//! As the light buffer of Haines and Greenberg (1986, "The Light Buffer: A Shadow-Testing Accelerator", doi:10.1109/MCG.1986.276832): a
//! cube around the place, its faces cut into cells, and for each cell the objects whose boxes are seen in it, near ones first. As boxes
//! lie along the axes like the cube, the rectangle that one covers on a face is found exactly.

use glam::DVec3;

use super::Bounds;

/// Cells along an edge of the cube.
const CELLS: usize = 32;
/// No table is made that would have more entries.
const MOST_ENTRIES: usize = 1 << 16;
/// Cells with more objects are left to the hierarchy.
const MOST_IN_A_CELL: usize = 16;
/// Directions are uncertain by this much, in units of half a face.
const SLACK: f64 = 1e-6;

/// Cells that a box is seen in on a face: first and last column, first and last row.
type Rectangle = [usize; 4];

/// Objects by direction from a place; see the module.
#[derive(Clone, Debug)]
pub struct Outlook {
    origin: DVec3,
    /// First entry of each cell, and the end of the last.
    starts: Vec<u32>,
    /// Numbers of objects and a distance at which none of them is yet.
    entries: Vec<(u32, f32)>,
}

impl Outlook {
    /// Of boxes by number; those that are empty or not finite are left out. `None` where it would be too large to be of use.
    pub(super) fn new(origin: DVec3, boxes: impl Iterator<Item = (u32, Bounds)>) -> Option<Self> {
        if !origin.is_finite() {
            return None;
        }
        let mut seen: Vec<(u32, f32, [Option<Rectangle>; 6])> = Vec::new();
        let mut total = 0;
        for (i, bounds) in boxes.filter(|(_, b)| b.is_finite() && !b.is_empty()) {
            let near = (bounds.min - origin).max(origin - bounds.max).max(DVec3::ZERO).length();
            let cells: [_; 6] = std::array::from_fn(|face| cells(&bounds, origin, face));
            total += cells.iter().flatten().map(|[a, b, c, d]| (b + 1 - a) * (d + 1 - c)).sum::<usize>();
            if total > MOST_ENTRIES {
                return None;
            }
            seen.push((i, ((near * (1.0 - SLACK)) as f32).min(f32::MAX), cells));
        }
        seen.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut starts = vec![0u32; 6 * CELLS * CELLS + 1];
        let cells_of = |cells: &[Option<Rectangle>; 6]| {
            let rectangles = (0..6).zip(*cells).filter_map(|(face, r)| r.map(|r| (face, r)));
            rectangles.flat_map(|(face, [a, b, c, d])| (c..=d).flat_map(move |v| (a..=b).map(move |u| (face * CELLS + v) * CELLS + u)))
        };
        for (_, _, cells) in &seen {
            cells_of(cells).for_each(|cell| starts[cell + 1] += 1);
        }
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let mut next = starts.clone();
        let mut entries = vec![(0, 0.0); total];
        for (i, near, cells) in &seen {
            for cell in cells_of(cells) {
                entries[next[cell] as usize] = (*i, *near);
                next[cell] += 1;
            }
        }
        Some(Self { origin, starts, entries })
    }

    /// The place.
    #[inline]
    pub(super) fn origin(&self) -> DVec3 {
        self.origin
    }

    /// All objects that a line from the place can meet, and some more, by the distance at which they begin; `None` where those are
    /// too many or the direction is none.
    #[inline]
    pub(super) fn towards(&self, d: DVec3) -> Option<&[(u32, f32)]> {
        let a = d.abs();
        let (axis, along, u, v) = if a.x >= a.y && a.x >= a.z {
            (0, d.x, d.y, d.z)
        } else if a.y >= a.z {
            (1, d.y, d.z, d.x)
        } else {
            (2, d.z, d.x, d.y)
        };
        let scale = (0.5 * CELLS as f64) / along.abs();
        if !scale.is_finite() {
            return None;
        }
        // By way of i32: conversions to larger numbers take several instructions.
        let index = |x: f64| ((x * scale + 0.5 * CELLS as f64) as i32).clamp(0, CELLS as i32 - 1) as usize;
        let face = 2 * axis + usize::from(along < 0.0);
        let cell = (face * CELLS + index(v)) * CELLS + index(u);
        let found = &self.entries[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        (found.len() <= MOST_IN_A_CELL).then_some(found)
    }
}

/// The cells of a face that a box is seen in.
fn cells(bounds: &Bounds, origin: DVec3, face: usize) -> Option<Rectangle> {
    let axis = face / 2;
    let (lo, hi) = (bounds.min - origin, bounds.max - origin);
    // Along the face's axis, outwards.
    let [near, far] = if face.is_multiple_of(2) { [lo[axis], hi[axis]] } else { [-hi[axis], -lo[axis]] };
    // Rounding may put what is hardly in front of the place behind it, and what is next to it anywhere.
    let size = lo.abs().max(hi.abs()).max_element();
    let tiny = 1e-9 * (size + origin.abs().max_element()) + f64::MIN_POSITIVE;
    if far < -tiny {
        return None;
    }
    let (far, near) = (far.max(tiny), near - tiny);
    let mut out = [0; 4];
    for k in 0..2 {
        let side = (axis + 1 + k) % 3;
        let (a, b) = (lo[side] - tiny, hi[side] + tiny);
        // The smallest and the largest quotient over the box; behind the place there is no end to them.
        let least = if a >= 0.0 { a / far } else { a / near.max(0.0) };
        let most = if b <= 0.0 { b / far } else { b / near.max(0.0) };
        if least > 1.0 + SLACK || most < -1.0 - SLACK {
            return None;
        }
        let index = |q: f64| ((q.clamp(-1.0, 1.0) + 1.0) * 0.5 * CELLS as f64) as usize;
        out[2 * k] = index(least - SLACK).min(CELLS - 1);
        out[2 * k + 1] = index(most + SLACK).min(CELLS - 1);
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Line;
    use crate::solid::testing::Random;

    /// No object that a line from the place meets is missing: near boxes and far ones, around the place, beside it, and flat.
    #[test]
    fn everything_that_lines_meet_is_there() {
        let mut r = Random::new(11);
        for k in 0..40 {
            let origin = r.vector() * if k % 4 == 0 { 0.0 } else { 3.0 };
            let boxes: Vec<Bounds> = (0..25)
                .map(|i| {
                    let c = if i % 5 == 0 { origin } else { r.vector() * 6.0 };
                    let mut size = r.vector().abs() * if i % 3 == 0 { 4.0 } else { 0.3 };
                    if i % 4 == 0 {
                        size[i % 3] = 0.0;
                    }
                    Bounds::of(c, c + size)
                })
                .collect();
            let outlook = Outlook::new(origin, (0..).zip(boxes.iter().copied())).unwrap();
            for i in 0..400 {
                let mut d = r.vector();
                if i % 7 == 0 {
                    d[i % 3] = 0.0;
                }
                if i % 11 == 0 {
                    d = d.signum();
                }
                let Some(found) = outlook.towards(d) else { continue };
                assert!(found.windows(2).all(|w| w[0].1 <= w[1].1), "in the order of distance");
                let line = Line { o: origin, d: d.normalize() };
                for (i, b) in (0..).zip(&boxes) {
                    if let Some((t, _)) = b.clip(&line, line.d.recip(), 1e-9, 1e30) {
                        let entry = found.iter().find(|e| e.0 == i);
                        assert!(entry.is_some_and(|e| f64::from(e.1) <= t.max(1e-4)), "box {i} at {t}, {entry:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn odd_places_and_boxes() {
        let boxes = [Bounds::EMPTY, Bounds::INFINITE, Bounds::around(DVec3::ONE, 1e300), Bounds::around(DVec3::ONE, 0.0)];
        assert!(Outlook::new(DVec3::NAN, (0..).zip(boxes)).is_none());
        let outlook = Outlook::new(DVec3::ZERO, (0..).zip(boxes)).unwrap();
        assert!(outlook.towards(DVec3::NAN).is_none() && outlook.towards(DVec3::ZERO).is_none());
        assert_eq!(outlook.towards(DVec3::ONE).map(|e| e.iter().map(|e| e.0).collect::<Vec<_>>()), Some(vec![2, 3]));
        let many = (0..1000).map(|i| (i, Bounds::around(DVec3::ZERO, 1.0)));
        assert!(Outlook::new(DVec3::ZERO, many).is_none());
    }
}
