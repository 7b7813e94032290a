//! Local upper bounds of a grid medium's extinction, and the walk along a ray through their cells (Amanatides and Woo 1987, "A Fast
//! Voxel Traversal Algorithm for Ray Tracing").

use crate::math::Vec3;

/// The most cells along an axis.
const MOST_CELLS: i32 = 64;
/// Values of a volume that share a cell, along an axis, where the limit allows.
const VALUES_PER_CELL: i32 = 4;
/// What look-ups may exceed a bound by rounding.
const MARGIN: f32 = 1.0 + 1e-5;

/// Bounds on a coarse grid over the unit cube.
#[derive(Clone, Debug)]
pub struct MajorantGrid {
    size: [i32; 3],
    bounds: Vec<f32>,
    /// The largest bound.
    pub max: f32,
}

impl MajorantGrid {
    /// Bounds for look-ups, linear or nearest, in a grid of `values` values along each axis; `value` gives a cell's, beyond the box as well.
    pub fn new(values: [i32; 3], value: impl Fn([i32; 3]) -> f32) -> Self {
        let size = values.map(|n| ((n + VALUES_PER_CELL - 1) / VALUES_PER_CELL).clamp(1, MOST_CELLS));
        // The values that look-ups in a cell touch: half a value beyond its ends, and a little more for rounding.
        let range = |k: usize, c: i32| {
            let per_cell = values[k] as f32 / size[k] as f32;
            let lo = (c as f32 * per_cell - 0.51).floor() as i32;
            let hi = ((c + 1) as f32 * per_cell - 0.49).floor() as i32 + 1;
            lo..=hi
        };
        let mut bounds = Vec::with_capacity(size.iter().map(|n| *n as usize).product());
        for cz in 0..size[2] {
            for cy in 0..size[1] {
                for cx in 0..size[0] {
                    let mut bound = 0.0f32;
                    for z in range(2, cz) {
                        for y in range(1, cy) {
                            for x in range(0, cx) {
                                bound = bound.max(value([x, y, z]));
                            }
                        }
                    }
                    bounds.push(bound * MARGIN);
                }
            }
        }
        let max = bounds.iter().copied().fold(0.0, f32::max);
        Self { size, bounds, max }
    }

    /// One bound for all of the unit cube.
    pub fn constant(bound: f32) -> Self {
        Self { size: [1; 3], bounds: vec![bound * MARGIN], max: bound * MARGIN }
    }

    /// Calls `visit(t_enter, t_exit, bound)` for the cells with a bound above zero along o + t d, t in [0, t_max], in order, until it
    /// returns false. `o` and `d` are in the unit cube's space.
    pub fn walk(&self, o: Vec3, d: Vec3, t_max: f32, mut visit: impl FnMut(f32, f32, f32) -> bool) {
        let Some((mut t, t_end)) = clip(o, d, t_max) else { return };
        let size = self.size.map(|n| n as f32);
        let mut cell = [0; 3];
        let mut step = [0; 3];
        let mut next = [f32::INFINITY; 3];
        let mut delta = [f32::INFINITY; 3];
        for k in 0..3 {
            let x = (o[k] + d[k] * t) * size[k];
            cell[k] = (x.floor() as i32).clamp(0, self.size[k] - 1);
            if d[k] != 0.0 {
                step[k] = if d[k] > 0.0 { 1 } else { -1 };
                let border = (cell[k] + i32::from(d[k] > 0.0)) as f32 / size[k];
                next[k] = (border - o[k]) / d[k];
                delta[k] = (1.0 / (size[k] * d[k])).abs();
            }
        }
        // A ray crosses at most so many cells; the count guards against numbers that are none.
        for _ in 0..self.size.iter().sum::<i32>() + 3 {
            let k = if next[0] < next[1] {
                if next[0] < next[2] { 0 } else { 2 }
            } else if next[1] < next[2] {
                1
            } else {
                2
            };
            let leave = next[k].min(t_end);
            let bound = self.bounds[((cell[2] * self.size[1] + cell[1]) * self.size[0] + cell[0]) as usize];
            if leave > t {
                if bound > 0.0 && !visit(t, leave, bound) {
                    return;
                }
                t = leave;
            }
            cell[k] += step[k];
            if !(next[k] < t_end) || !(0..self.size[k]).contains(&cell[k]) {
                return;
            }
            next[k] += delta[k];
        }
    }
}

/// The part of a ray that is within the unit cube.
fn clip(o: Vec3, d: Vec3, t_max: f32) -> Option<(f32, f32)> {
    let (mut near, mut far) = (0.0f32, t_max);
    for k in 0..3 {
        if d[k] == 0.0 {
            if !(0.0..=1.0).contains(&o[k]) {
                return None;
            }
        } else {
            let (a, b) = (-o[k] / d[k], (1.0 - o[k]) / d[k]);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
    }
    // Fails for what is not a number as well.
    (near < far && far.is_finite()).then_some((near, far))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash;

    fn number(i: u32, k: u32) -> f32 {
        hash::unit_float(hash::mix32(i * 31 + k))
    }

    #[test]
    fn walks_cover_a_ray_without_gaps_and_meet_the_cells_they_name() {
        let grid = MajorantGrid::new([20, 7, 33], |c| 1.0 + (c[0].rem_euclid(20) + 7 * c[1].rem_euclid(7) + c[2].rem_euclid(33)) as f32);
        for i in 0..2000 {
            let o = Vec3::new(number(i, 0), number(i, 1), number(i, 2)) * 3.0 - 1.0;
            let mut d = Vec3::new(number(i, 3), number(i, 4), number(i, 5)) * 2.0 - 1.0;
            if i % 7 == 0 {
                d[(i / 7) as usize % 3] = 0.0;
            }
            let expected = clip(o, d, 2.0);
            let mut covered: Option<(f32, f32)> = None;
            grid.walk(o, d, 2.0, |a, b, bound| {
                assert!(a < b && bound >= 1.0);
                let (first, last) = covered.unwrap_or((a, a));
                assert_eq!(last, a, "a gap");
                covered = Some((first, b));
                true
            });
            match (expected, covered) {
                (Some((a, b)), Some((c, d))) => assert!((a - c).abs() < 1e-4 && (b - d).abs() < 1e-4, "{i}: {a}..{b}, {c}..{d}"),
                (None, None) => {}
                (Some((a, b)), None) => assert!(b - a < 1e-5, "{i}: nothing between {a} and {b}"),
                (None, Some(_)) => panic!("{i}: cells beyond the cube"),
            }
        }
    }

    #[test]
    fn hostile_rays_end() {
        let grid = MajorantGrid::new([64; 3], |_| 1.0);
        let odd = [f32::NAN, f32::INFINITY, 1e38, 1e-38, 0.0, -1e20, 0.5];
        for a in odd {
            for b in odd {
                grid.walk(Vec3::new(a, 0.5, b), Vec3::new(b, a, 1.0), a, |_, _, _| true);
            }
        }
    }
}
