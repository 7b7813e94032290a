//! `height_field`: two triangles between each four neighboring heights over the unit square of x and z.
//!
//! A surface without walls and bottom: everything below it counts as inside. The diagonals run from (x, z + 1) to (x + 1, z), and
//! heights are multiples of 1/65536: both measured. Rays walk down a pyramid of the smallest and largest heights.

use arrayvec::ArrayVec;
use glam::{DVec2, DVec3};

use super::facets::{Facet, trim};
use super::{Bounds, Crossing, Line, Primitive};

/// Most heights that are taken: more would need too much memory.
pub const MOST: usize = 1 << 28;

/// Normals are stored in steps of one over this.
const NORMAL_STEPS: f64 = 32767.0;

/// A landscape.
pub struct HeightField {
    /// Heights along x and z.
    columns: usize,
    rows: usize,
    /// By z, then x.
    heights: Vec<f32>,
    /// Of smooth ones.
    normals: Vec<[i16; 3]>,
    /// From the cells up to one node.
    levels: Vec<Level>,
    water: f64,
}

struct Level {
    columns: usize,
    rows: usize,
    /// Smallest and largest height.
    ranges: Vec<[f32; 2]>,
}

/// The height that POV-Ray stores for a value of a function: in 65536 levels, wrapped around beyond [0, 1], as measured.
pub fn from_function(value: f64) -> f64 {
    let level = (value * 65535.0).trunc();
    if level.is_finite() { level.rem_euclid(65536.0) / 65536.0 } else { 0.0 }
}

/// The height that POV-Ray stores for a gray pixel of eight bits: as measured, the weights of red, green and blue in single precision take
/// one level off some values.
pub fn from_gray(value: u8) -> f64 {
    let v = f32::from(value) / 255.0;
    let level = ((v * 0.297 + v * 0.589 + v * 0.114) * 255.0).trunc();
    f64::from(level) * 257.0 / 65536.0
}

impl HeightField {
    /// A landscape of `columns` heights along x by rows along z, which come from z = 1 down to 0, as in a picture. `None` for less than
    /// 2 × 2 heights, too many of them, other lengths, and where one is not finite.
    pub fn new(columns: usize, heights: &[f64], smooth: bool, water_level: f64) -> Option<Self> {
        let rows = heights.len().checked_div(columns)?;
        if columns < 2 || rows < 2 || rows * columns != heights.len() || heights.len() > MOST || water_level.is_nan() {
            return None;
        }
        if heights.iter().any(|h| !(h.abs() < 1e6)) {
            return None;
        }
        let heights: Vec<f32> = heights.chunks_exact(columns).rev().flatten().map(|h| *h as f32).collect();
        let mut field = Self { columns, rows, heights, normals: Vec::new(), levels: Vec::new(), water: water_level };
        field.build();
        if smooth {
            field.smooth();
        }
        Some(field)
    }

    fn height(&self, i: usize, j: usize) -> f64 {
        f64::from(self.heights[j * self.columns + i])
    }

    fn build(&mut self) {
        let (columns, rows) = (self.columns - 1, self.rows - 1);
        let mut ranges = Vec::with_capacity(columns * rows);
        for j in 0..rows {
            for i in 0..columns {
                let k = j * self.columns + i;
                let h = [self.heights[k], self.heights[k + 1], self.heights[k + self.columns], self.heights[k + self.columns + 1]];
                ranges.push([h[0].min(h[1]).min(h[2]).min(h[3]), h[0].max(h[1]).max(h[2]).max(h[3])]);
            }
        }
        self.levels.push(Level { columns, rows, ranges });
        while let Some(below) = self.levels.last().filter(|l| l.columns > 1 || l.rows > 1) {
            let (columns, rows) = (below.columns.div_ceil(2), below.rows.div_ceil(2));
            let mut ranges = vec![[f32::INFINITY, f32::NEG_INFINITY]; columns * rows];
            for j in 0..below.rows {
                for i in 0..below.columns {
                    let [lo, hi] = below.ranges[j * below.columns + i];
                    let range = &mut ranges[j / 2 * columns + i / 2];
                    *range = [range[0].min(lo), range[1].max(hi)];
                }
            }
            self.levels.push(Level { columns, rows, ranges });
        }
    }

    /// Normals of vertices as measured: sums of the unit normals towards the neighbors in the four quadrants, where x and z count pixels and
    /// y levels, in steps.
    fn smooth(&mut self) {
        self.normals.reserve_exact(self.heights.len());
        for j in 0..self.rows {
            for i in 0..self.columns {
                let here = self.height(i, j);
                // Slopes to the left, right, front and back; none beyond the border.
                let slope = |other: Option<(usize, usize)>, sign: f64| other.map(|(i, j)| 65536.0 * sign * (self.height(i, j) - here));
                let x = [slope(i.checked_sub(1).map(|i| (i, j)), -1.0), slope((i + 1 < self.columns).then_some((i + 1, j)), 1.0)];
                let z = [slope(j.checked_sub(1).map(|j| (i, j)), -1.0), slope((j + 1 < self.rows).then_some((i, j + 1)), 1.0)];
                let mut sum = DVec3::ZERO;
                for u in x.iter().flatten() {
                    for v in z.iter().flatten() {
                        sum += DVec3::new(-u, 1.0, -v).normalize();
                    }
                }
                self.normals.push((sum.normalize_or(DVec3::Y) * NORMAL_STEPS).to_array().map(|x| x as i16));
            }
        }
    }

    /// Cell and place in it.
    fn locate(&self, p: DVec3) -> (usize, usize, f64, f64) {
        let (x, z) = (p.x * (self.columns - 1) as f64, p.z * (self.rows - 1) as f64);
        let i = (x as usize).min(self.columns - 2);
        let j = (z as usize).min(self.rows - 2);
        (i, j, x - i as f64, z - j as f64)
    }

    /// Slopes per cell and height at a place of a cell.
    fn plane(&self, i: usize, j: usize, upper: bool) -> (f64, f64, f64) {
        let (b, c) = (self.height(i + 1, j), self.height(i, j + 1));
        if upper {
            let d = self.height(i + 1, j + 1);
            (d - c, d - b, b + c - d)
        } else {
            let a = self.height(i, j);
            (b - a, c - a, a)
        }
    }

    /// Visits crossings cell by cell, nearest cells first, until `visit` returns true.
    fn walk(&self, line: &Line, t_min: f64, t_max: f64, visit: &mut dyn FnMut(Crossing) -> bool) {
        let (o, d) = (line.o, line.d);
        if !o.is_finite() || !d.is_finite() || d == DVec3::ZERO {
            return;
        }
        let inverse = d.recip();
        let (across, along) = (1.0 / (self.columns - 1) as f64, 1.0 / (self.rows - 1) as f64);
        let Some((top, root)) = self.levels.len().checked_sub(1).and_then(|top| Some((top, *self.levels[top].ranges.first()?))) else {
            return;
        };
        let slab = |lo: f64, hi: f64, o: f64, d: f64, inverse: f64| {
            if d == 0.0 {
                return if o >= lo && o <= hi { (f64::NEG_INFINITY, f64::INFINITY) } else { (1.0, 0.0) };
            }
            let (a, b) = ((lo - o) * inverse, (hi - o) * inverse);
            (a.min(b), a.max(b))
        };
        let (ax, bx) = slab(0.0, (self.columns - 1) as f64 * across, o.x, d.x, inverse.x);
        let (az, bz) = slab(0.0, (self.rows - 1) as f64 * along, o.z, d.z, inverse.z);
        let (mut a, mut b) = (ax.max(az), bx.min(bz));
        if !(a.is_finite() && b.is_finite()) {
            // An upright line is cut to the range of heights.
            let hair = 1e-7 * (1.0 + f64::from(root[1].abs()) + f64::from(root[0].abs()));
            let (ay, by) = slab(f64::from(root[0]) - hair, f64::from(root[1]) + hair, o.y, d.y, inverse.y);
            (a, b) = (a.max(ay), b.min(by));
        }
        if !(a <= b) {
            return;
        }
        // Where the line is in a node; what it crosses first lies on top.
        let mut stack = ArrayVec::<(u32, u32, u32, f64, f64), 128>::new();
        stack.push((top as u32, 0, 0, a, b));
        while let Some((level, i, j, a, b)) = stack.pop() {
            let l = &self.levels[level as usize];
            let range = l.ranges[j as usize * l.columns + i as usize].map(f64::from);
            if range[1] < self.water || b < t_min || a > t_max {
                continue;
            }
            let (ya, yb) = (o.y + a * d.y, o.y + b * d.y);
            let hair = 1e-7 * (1.0 + range[1].abs() + range[0].abs());
            if ya.max(yb) < range[0] - hair || ya.min(yb) > range[1] + hair {
                continue;
            }
            if level == 0 {
                if self.cell(i as usize, j as usize, line, (a, b), (t_min, t_max), visit) {
                    return;
                }
                continue;
            }
            let level = level - 1;
            let below = &self.levels[level as usize];
            // The line changes sides at the middle planes; on which side it begins, and where it changes.
            let side = |middle: f64, o: f64, d: f64, inverse: f64| {
                if d == 0.0 {
                    return (u32::from(o > middle), f64::INFINITY);
                }
                let t = (middle - o) * inverse;
                let starts_up = (d > 0.0) == (t <= a);
                (u32::from(starts_up), if t > a { t } else { f64::INFINITY })
            };
            let (mut x, mut tx) = side(f64::from((2 * i + 1) << level) * across, o.x, d.x, inverse.x);
            let (mut z, mut tz) = side(f64::from((2 * j + 1) << level) * along, o.z, d.z, inverse.z);
            let mut parts = ArrayVec::<(u32, u32, u32, f64, f64), 4>::new();
            let mut from = a;
            loop {
                let to = tx.min(tz).min(b);
                let (ci, cj) = (2 * i + x, 2 * j + z);
                if (ci as usize) < below.columns && (cj as usize) < below.rows {
                    parts.push((level, ci, cj, from, to));
                }
                if !(to < b) || parts.is_full() {
                    break;
                }
                if tx <= to {
                    (x, tx) = (x ^ 1, f64::INFINITY);
                }
                if tz <= to {
                    (z, tz) = (z ^ 1, f64::INFINITY);
                }
                from = to;
            }
            while let Some(part) = parts.pop() {
                stack.push(part);
            }
        }
    }

    /// Crossings of one cell, which the line is in between the ends of an interval.
    fn cell(
        &self,
        i: usize,
        j: usize,
        line: &Line,
        (a, b): (f64, f64),
        (t_min, t_max): (f64, f64),
        visit: &mut dyn FnMut(Crossing) -> bool,
    ) -> bool {
        let (columns, rows) = ((self.columns - 1) as f64, (self.rows - 1) as f64);
        let (ox, dx) = (line.o.x * columns - i as f64, line.d.x * columns);
        let (oz, dz) = (line.o.z * rows - j as f64, line.d.z * rows);
        // The diagonal.
        let side = |t: f64| ox + oz + t * (dx + dz) - 1.0;
        let (sa, sb) = (side(a), side(b));
        let middle = if (sa < 0.0) != (sb < 0.0) { (a + (b - a) * (sa / (sa - sb))).clamp(a, b) } else { b };
        for (part, from, to) in [(sa >= 0.0, a, middle), (sb >= 0.0, middle, b)] {
            if !(from < to) {
                continue;
            }
            let (u, v, h) = self.plane(i, j, part);
            let above = |t: f64| line.o.y + t * line.d.y - h - (ox + t * dx) * u - (oz + t * dz) * v;
            let (fa, fb) = (above(from), above(to));
            if (fa < 0.0) == (fb < 0.0) {
                continue;
            }
            let t = (from + (to - from) * (fa / (fa - fb))).clamp(from, to);
            if t > t_min && t < t_max && line.o.y + t * line.d.y >= self.water {
                let cell = (j * (self.columns - 1) + i) as u32;
                if visit(Crossing { t, part: cell.wrapping_mul(2) + u32::from(part), uv: DVec2::ZERO }) {
                    return true;
                }
            }
        }
        false
    }

    fn flat(&self, part: u32) -> DVec3 {
        let cell = (part / 2) as usize;
        let (i, j) = (cell % (self.columns - 1), cell / (self.columns - 1));
        if j >= self.rows - 1 {
            return DVec3::Y;
        }
        let (u, v, _) = self.plane(i, j, part % 2 == 1);
        DVec3::new(-u * (self.columns - 1) as f64, 1.0, -v * (self.rows - 1) as f64).normalize()
    }
}

impl Primitive for HeightField {
    fn facets(&self, segments: usize, _: &Bounds) -> Option<Vec<Facet>> {
        // Every height where there are not too many of them, else the nearest of a coarser grid.
        let most = 8 * segments;
        let [nx, nz] = [self.columns - 1, self.rows - 1].map(|n| n.min(most));
        let index = |i: usize, n: usize, cells: usize| (i * cells + n / 2) / n;
        let place = |i: usize, j: usize| {
            let (i, j) = (index(i, nx, self.columns - 1), index(j, nz, self.rows - 1));
            DVec3::new(i as f64 / (self.columns - 1) as f64, self.height(i, j), j as f64 / (self.rows - 1) as f64)
        };
        let mut all = Vec::with_capacity(2 * nx * nz);
        for j in 0..nz {
            for i in 0..nx {
                let [a, b, c, d] = [place(i, j), place(i + 1, j), place(i, j + 1), place(i + 1, j + 1)];
                for facet in [Facet::new([a, b, c]), Facet::new([d, c, b])] {
                    trim(&facet, &|p| p.y >= self.water, &mut all);
                }
            }
        }
        Some(all)
    }

    fn bounds(&self) -> Bounds {
        let [lo, hi] = self.levels.last().and_then(|l| l.ranges.first()).map_or([0.0; 2], |r| r.map(f64::from));
        Bounds { min: DVec3::new(0.0, lo.max(self.water).min(hi), 0.0), max: DVec3::new(1.0, hi, 1.0) }
    }

    fn inside_bounds(&self) -> Bounds {
        let b = self.bounds();
        Bounds { min: DVec3::new(0.0, f64::NEG_INFINITY, 0.0), max: DVec3::new(1.0, b.max.y.max(self.water), 1.0) }
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        self.walk(line, t_min, t_max, &mut |c| {
            out.push(c);
            false
        });
    }

    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _: &mut Vec<Crossing>) -> Option<Crossing> {
        let mut nearest = None;
        self.walk(line, t_min, t_max, &mut |c| {
            nearest = Some(c);
            true
        });
        nearest
    }

    fn inside(&self, p: DVec3) -> bool {
        if !(p.x >= 0.0 && p.x <= 1.0 && p.z >= 0.0 && p.z <= 1.0) {
            return false;
        }
        let (i, j, x, z) = self.locate(p);
        let (u, v, h) = self.plane(i, j, x + z > 1.0);
        p.y < (h + x * u + z * v).max(self.water)
    }

    fn normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        if self.normals.is_empty() || !p.is_finite() {
            return self.flat(crossing.part);
        }
        let (i, j, x, z) = self.locate(p);
        let at = |i: usize, j: usize| {
            let [x, y, z] = self.normals[j * self.columns + i];
            let n = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
            (n * DVec3::new((self.columns - 1) as f64, 65536.0, (self.rows - 1) as f64)).normalize_or(DVec3::Y)
        };
        let (lower, upper) = (at(i, j).lerp(at(i + 1, j), x), at(i, j + 1).lerp(at(i + 1, j + 1), x));
        lower.lerp(upper, z).normalize_or(DVec3::Y)
    }

    fn geometric_normal(&self, _: DVec3, crossing: &Crossing) -> DVec3 {
        self.flat(crossing.part)
    }

    fn uv(&self, p: DVec3, _: &Crossing) -> DVec2 {
        p.truncate()
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, crossings, hostile_lines, random};
    use super::*;
    use etendue_procedural::fns::sin;

    fn of(columns: usize, rows: usize, f: impl Fn(f64, f64) -> f64, smooth: bool, water: f64) -> HeightField {
        let mut heights = Vec::new();
        for j in 0..rows {
            for i in 0..columns {
                heights.push(from_function(f(i as f64 / (columns - 1) as f64, j as f64 / (rows - 1) as f64)));
            }
        }
        HeightField::new(columns, &heights, smooth, water).unwrap()
    }

    #[test]
    fn as_pov_ray() {
        let rough = of(5, 4, |x, y| 0.1 + 0.8 * sin(7.0 * x + 5.0 * y * y).abs(), false, 0.0);
        compare(&rough, include_str!("measured/height_field.txt"), &Tolerance::default());
        let f = |x: f64, y: f64| 0.1 + 0.8 * sin(3.0 * x + 2.0 * y * y).abs();
        compare(&of(9, 7, f, true, 0.0), include_str!("measured/height_field_smooth.txt"), &Tolerance::default());
        compare(&of(9, 7, f, true, 0.4), include_str!("measured/height_field_water.txt"), &Tolerance::default());
    }

    #[test]
    fn levels_as_measured() {
        for (value, level) in [(0.25, 16383.0), (1.0, 65535.0), (1.5, 32766.0), (-0.5, 32769.0)] {
            assert_eq!(from_function(value) * 65536.0, level);
        }
        for (value, level) in [(12, 11), (25, 24), (64, 64), (128, 128), (200, 199), (255, 255)] {
            assert_eq!(from_gray(value) * 65536.0, f64::from(level) * 257.0);
        }
    }

    #[test]
    fn pyramid_agrees_with_all_cells() {
        let field = of(37, 22, |x, y| 0.5 + 0.4 * sin(20.0 * x) * sin(17.0 * y + x), false, 0.0);
        alternates(&field, DVec3::new(0.5, 0.5, 0.5), 0.45, 3000, 0);
        let mut s = 3;
        for round in 0..500 {
            let mut o = DVec3::new(random(&mut s), random(&mut s) * 2.0, random(&mut s));
            let mut d = DVec3::new(random(&mut s) - 0.5, random(&mut s) - 0.5, random(&mut s) - 0.5);
            // Along grid lines and axes too.
            match round % 5 {
                0 => d.x = 0.0,
                1 => d = DVec3::NEG_Y,
                2 => (o.x, d.x) = (0.5, 0.0),
                _ => {}
            }
            let line = Line { o, d };
            let found = crossings(&field, &line, 0.0, 1e3);
            let nearest = field.nearest(&line, 0.0, 1e3, &mut Vec::new()).map_or(0.0, |c| c.t);
            assert!((nearest - found.first().map_or(0.0, |c| c.t)).abs() < 1e-12);
            if round % 5 == 1 && o.y > 1.0 {
                assert_eq!(found.len(), 1);
            }
        }
    }

    #[test]
    fn hostile() {
        assert!(HeightField::new(1, &[0.0; 9], false, 0.0).is_none());
        assert!(HeightField::new(0, &[], false, 0.0).is_none());
        assert!(HeightField::new(4, &[0.0; 9], false, 0.0).is_none());
        assert!(HeightField::new(3, &[f64::NAN; 9], false, 0.0).is_none());
        assert!(HeightField::new(3, &[0.0; 9], false, f64::NAN).is_none());
        hostile_lines(&of(9, 7, |x, y| x * y, true, 0.4));
        hostile_lines(&of(2, 2, |x, _| x, false, 2.0));
        hostile_lines(&of(300, 2, |x, _| x, false, -1e9));
    }
}
