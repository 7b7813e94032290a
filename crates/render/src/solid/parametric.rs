//! `parametric`: the surface of the points (x(u, v), y(u, v), z(u, v)).
//!
//! The range of (u, v) is sampled on a grid that is doubled until its cells are nearly flat. A hierarchy of boxes over the cells finds those
//! that a ray may meet; there the ray is met with the two triangles of the cell, and Newton's method moves the hit onto the surface
//! itself. (POV-Ray bounds coordinates over rectangles of (u, v) by `max_gradient` instead; this needs none.) Features finer than
//! a cell of the finest grid (256 × 256) are lost.

use std::sync::Arc;

use etendue_procedural::{Context, Function};
use etendue_scene::desc::classic;
use glam::{DMat3, DVec2, DVec3};

use super::container::Container;
use super::facets::{Facet, has_area, trim};
use super::{Bounds, Crossing, Line, Primitive};

/// Levels of the coarsest and the finest grid: cells along each side are powers of 2.
const LEVELS: [u32; 2] = [5, 8];

/// Surface of functions of u and v; it has no inside.
#[derive(Clone, Debug)]
pub struct Parametric {
    functions: [Arc<Function>; 3],
    from: DVec2,
    size: DVec2,
    container: Container,
    noise_generator: u8,
    /// Cells along each side: 2^level.
    level: u32,
    /// Points at the corners of cells, rows of v.
    points: Vec<DVec3>,
    /// Boxes of the quadtree, level by level from the root, rows of v.
    boxes: Vec<Bounds>,
    bounds: Bounds,
}

/// Index of the first box of a level: 1 + 4 + 16 + …
fn first_box(level: u32) -> usize {
    ((1 << (2 * level)) - 1) / 3
}

impl Parametric {
    /// `None` where the range, the container or all points are degenerate.
    pub fn new(surface: &classic::Parametric) -> Option<Self> {
        let container = Container::new(&surface.container)?;
        let [from, to] = surface.range;
        if !(from.is_finite() && to.is_finite() && (to - from).is_finite() && (to - from).min_element() > 0.0) {
            return None;
        }
        let mut made = Self {
            functions: surface.functions.clone(),
            from,
            size: to - from,
            container,
            noise_generator: surface.noise_generator,
            level: LEVELS[0],
            points: Vec::new(),
            boxes: Vec::new(),
            bounds: Bounds::EMPTY,
        };
        let flat = surface.accuracy.max(1e-4 * (made.container.bounds().max - made.container.bounds().min).length());
        let bend = loop {
            made.sample();
            let bend = made.bend();
            // Each doubling quarters the bend.
            if made.level == LEVELS[1] || !(bend > flat) {
                break bend;
            }
            made.level += 1;
        };
        made.fill_boxes(if bend.is_finite() { bend } else { 0.0 });
        made.bounds = made.boxes.first()?.intersection(made.container.bounds());
        (!made.bounds.is_empty()).then_some(made)
    }

    fn cells(&self) -> usize {
        1 << self.level
    }

    fn parameters(&self, i: f64, j: f64) -> DVec2 {
        self.from + self.size * DVec2::new(i, j) / self.cells() as f64
    }

    fn point(&self, uv: DVec2) -> DVec3 {
        let context = Context { noise_generator: self.noise_generator, ..Context::at(DVec3::ZERO) };
        DVec3::from([0, 1, 2].map(|i| self.functions[i].eval(&[uv.x, uv.y], &context)))
    }

    fn sample(&mut self) {
        let n = self.cells();
        let mut points = Vec::with_capacity((n + 1) * (n + 1));
        for j in 0..=n {
            for i in 0..=n {
                points.push(self.point(self.parameters(i as f64, j as f64)));
            }
        }
        self.points = points;
    }

    fn corner(&self, i: usize, j: usize) -> DVec3 {
        self.points[j * (self.cells() + 1) + i]
    }

    /// How far the surface leaves its cells at most, told from second differences: a quarter of the difference of neighboring chords bounds the
    /// arc over one of them, for smooth functions.
    fn bend(&self) -> f64 {
        let n = self.cells();
        let mut bend = 0.0_f64;
        for j in 0..=n {
            for i in 1..n {
                for (a, b, c) in [
                    (self.corner(i - 1, j), self.corner(i, j), self.corner(i + 1, j)),
                    (self.corner(j, i - 1), self.corner(j, i), self.corner(j, i + 1)),
                ] {
                    let d = (a + c - 2.0 * b).length();
                    if d.is_finite() {
                        bend = bend.max(0.25 * d);
                    }
                }
            }
        }
        bend
    }

    fn fill_boxes(&mut self, bend: f64) {
        let n = self.cells();
        self.boxes = vec![Bounds::EMPTY; first_box(self.level + 1)];
        for j in 0..n {
            for i in 0..n {
                let corners = [self.corner(i, j), self.corner(i + 1, j), self.corner(i, j + 1), self.corner(i + 1, j + 1)];
                if corners.iter().all(|p| p.is_finite()) {
                    let b = Bounds::of_points(corners);
                    let pad = bend + 1e-9 * (b.max - b.min).length();
                    self.boxes[first_box(self.level) + j * n + i] = Bounds { min: b.min - pad, max: b.max + pad };
                }
            }
        }
        for level in (0..self.level).rev() {
            let (n, below) = (1_usize << level, first_box(level + 1));
            for j in 0..n {
                for i in 0..n {
                    let child = |k: usize, l: usize| self.boxes[below + (2 * j + l) * 2 * n + 2 * i + k];
                    let both = child(0, 0).union(child(1, 0)).union(child(0, 1)).union(child(1, 1));
                    self.boxes[first_box(level) + j * n + i] = both;
                }
            }
        }
    }

    /// Derivatives by u and v, of a step that is small against a cell.
    fn derivatives(&self, uv: DVec2) -> [DVec3; 2] {
        let h = self.size * (0.01 / self.cells() as f64);
        let to = self.from + self.size;
        let by = |e: DVec2| {
            // One-sided at the borders, where functions may end.
            let (a, b) = ((uv - e * h).max(self.from), (uv + e * h).min(to));
            (self.point(b) - self.point(a)) / (b - a).dot(e)
        };
        [by(DVec2::X), by(DVec2::Y)]
    }

    /// The hit near a triangle's: Newton's method for S(u, v) = o + t d; the triangle's own where it leads away.
    fn refine(&self, line: &Line, uv: DVec2, t: f64, cell: f64) -> Option<(DVec2, f64)> {
        let scale = self.size / self.cells() as f64;
        let (mut q, mut s) = (uv, t);
        for _ in 0..8 {
            let off = self.point(q) - line.at(s);
            if !off.is_finite() {
                return None;
            }
            if off.length() <= 1e-10 * cell.max(1e-300) {
                break;
            }
            let [du, dv] = self.derivatives(q);
            let m = DMat3::from_cols(du, dv, -line.d);
            if !(m.determinant().abs() > 0.0) {
                return Some((uv, t));
            }
            let step = m.inverse() * off;
            q -= step.truncate();
            s -= step.z;
            // A cell and a half is as far as the bend of a cell can lead.
            if !(((q - uv) / scale).abs().max_element() <= 1.5) {
                return Some((uv, t));
            }
        }
        // Beyond the border there is nothing.
        let slack = 1e-6 * scale;
        let inside = q.cmpge(self.from - slack).all() && q.cmple(self.from + self.size + slack).all();
        inside.then(|| (q.clamp(self.from, self.from + self.size), s))
    }

    /// The hits of a cell's triangles.
    fn cell(&self, line: &Line, i: usize, j: usize, out: &mut dyn FnMut(DVec2, f64)) {
        let corners = [self.corner(i, j), self.corner(i + 1, j), self.corner(i, j + 1), self.corner(i + 1, j + 1)];
        let (i, j) = (i as f64, j as f64);
        let places = [[i, j], [i + 1.0, j], [i, j + 1.0], [i + 1.0, j + 1.0]].map(|[i, j]| self.parameters(i, j));
        for [a, b, c] in [[0, 1, 2], [3, 2, 1]] {
            let (e1, e2) = (corners[b] - corners[a], corners[c] - corners[a]);
            let m = DMat3::from_cols(e1, e2, -line.d);
            if !(m.determinant().abs() > 0.0) {
                continue;
            }
            let w = m.inverse() * (line.o - corners[a]);
            // A little beyond the edges, as the curved cell may be there; hits that are met twice are told apart later.
            let slack = 0.02;
            if w.x >= -slack && w.y >= -slack && w.x + w.y <= 1.0 + slack {
                let uv = places[a] + (places[b] - places[a]) * w.x + (places[c] - places[a]) * w.y;
                let uv = uv.clamp(self.from, self.from + self.size);
                if let Some((uv, t)) = self.refine(line, uv, w.z, e1.length() + e2.length()) {
                    out(uv, t);
                }
            }
        }
    }
}

impl Primitive for Parametric {
    fn facets(&self, _: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let n = self.cells();
        let mut all = Vec::new();
        for j in 0..n {
            for i in 0..n {
                let places = [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]];
                for [a, b, c] in [[0, 1, 2], [3, 2, 1]] {
                    let corners = [places[a], places[b], places[c]];
                    let at = corners.map(|[i, j]| Crossing { uv: self.parameters(i as f64, j as f64), ..Crossing::new(0.0, 0) });
                    let facet = Facet { p: corners.map(|[i, j]| self.corner(i, j)), at: Some(at) };
                    if has_area(&facet) {
                        trim(&facet, &|p| self.container.contains(p), &mut all);
                    }
                }
            }
        }
        Some(all)
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        if !(line.d.length_squared() > 0.0 && line.d.is_finite() && line.o.is_finite()) {
            return;
        }
        let Some([enter, leave]) = self.container.span(line) else { return };
        let (near, far) = (enter.t.max(t_min), leave.t.min(t_max));
        if !(near < far) {
            return;
        }
        let start = out.len();
        let same = self.size / self.cells() as f64 * 1e-5;
        let inverse = line.d.recip();
        // Four children of each of eight levels are the most that wait.
        let mut waiting = [(0_u32, 0_u32, 0_u32); 4 * LEVELS[1] as usize];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (level, i, j) = waiting[count];
            let n = 1_usize << level;
            let b = &self.boxes[first_box(level) + j as usize * n + i as usize];
            if b.is_empty() || b.clip(line, inverse, near, far).is_none() {
                continue;
            }
            if level < self.level {
                for (k, l) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    waiting[count] = (level + 1, 2 * i + k, 2 * j + l);
                    count += 1;
                }
                continue;
            }
            self.cell(line, i as usize, j as usize, &mut |uv, t| {
                let known = out[start..].iter().any(|c| ((c.uv - uv) / same).abs().max_element() <= 1.0);
                if t > near && t < far && !known {
                    out.push(Crossing { t, part: 0, uv });
                }
            });
        }
    }

    fn inside(&self, _p: DVec3) -> bool {
        false
    }

    fn normal(&self, _p: DVec3, crossing: &Crossing) -> DVec3 {
        let [du, dv] = self.derivatives(crossing.uv);
        du.cross(dv).try_normalize().unwrap_or(DVec3::Y)
    }

    fn uv(&self, _p: DVec3, crossing: &Crossing) -> DVec2 {
        crossing.uv
    }
}

#[cfg(test)]
mod tests {
    use etendue_procedural::function::{Binary, Builder, Unary};

    use super::super::sphere::Sphere;
    use super::super::testing::Random;
    use super::*;

    /// sin u · (cos v | sin v), or cos u, times a radius.
    fn coordinate(axis: usize) -> Arc<Function> {
        let mut b = Builder::new(vec!["u".into(), "v".into()]);
        let (u, v, radius) = (b.parameter("u").unwrap(), b.parameter("v").unwrap(), b.number(0.9));
        let value = if axis == 2 {
            b.unary(Unary::Cos, u)
        } else {
            let (s, w) = (b.unary(Unary::Sin, u), b.unary(if axis == 0 { Unary::Cos } else { Unary::Sin }, v));
            b.binary(Binary::Multiply, s, w)
        };
        let value = b.binary(Binary::Multiply, value, radius);
        Arc::new(b.finish(value).unwrap())
    }

    fn ball() -> classic::Parametric {
        classic::Parametric {
            functions: [0, 1, 2].map(coordinate),
            range: [DVec2::ZERO, DVec2::new(std::f64::consts::PI, 2.0 * std::f64::consts::PI)],
            container: classic::Container::default(),
            accuracy: 0.001,
            noise_generator: 2,
        }
    }

    #[test]
    fn sphere_is_where_it_is() {
        let surface = Parametric::new(&ball()).unwrap();
        let exact = Sphere::new(DVec3::ZERO, 0.9).unwrap();
        let mut random = Random::new(3);
        let (mut hits, mut missed) = (0, 0);
        for _ in 0..3000 {
            let line = Line { o: random.vector() * 2.0, d: random.vector() };
            let (mut a, mut b) = (Vec::new(), Vec::new());
            surface.crossings(&line, -50.0, 50.0, &mut a);
            exact.crossings(&line, -50.0, 50.0, &mut b);
            for c in [&mut a, &mut b] {
                c.sort_by(|a, b| a.t.total_cmp(&b.t));
            }
            if a.len() != b.len() {
                missed += 1;
                continue;
            }
            for (a, b) in a.iter().zip(&b) {
                hits += 1;
                assert!((a.t - b.t).abs() < 1e-6, "{a:?} {b:?}");
                let p = line.at(a.t);
                assert!(surface.normal(p, a).dot(exact.normal(p, b)).abs() > 1.0 - 1e-4);
            }
        }
        assert!(hits > 1000 && missed * 100 < hits, "{hits} {missed}");
    }

    #[test]
    fn hostile_numbers_end() {
        for v in [0.0, -1.0, 1e300, 1e-300, f64::NAN, f64::INFINITY] {
            for surface in [
                classic::Parametric { range: [DVec2::ZERO, DVec2::splat(v)], ..ball() },
                classic::Parametric { accuracy: v, ..ball() },
                classic::Parametric { functions: [0, 1, 2].map(|_| Arc::new(Function::constant(v))), ..ball() },
                classic::Parametric { container: classic::Container::Sphere { center: DVec3::splat(v), radius: 1.0 }, ..ball() },
            ] {
                let Some(surface) = Parametric::new(&surface) else { continue };
                for line in [Line { o: DVec3::splat(v), d: DVec3::ONE }, Line { o: DVec3::NEG_ONE, d: DVec3::new(1.0, 1.1, 1.2) }] {
                    let mut out = Vec::new();
                    surface.crossings(&line, f64::NEG_INFINITY, f64::INFINITY, &mut out);
                    assert!(out.iter().all(|c| !c.t.is_nan()));
                }
            }
        }
    }
}
