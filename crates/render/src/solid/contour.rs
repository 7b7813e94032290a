//! Triangles of any solid that tells inside from outside: dual contouring on a regular grid.
//!
//! Edges of the grid that change sides are cut exactly where the surface is; each cell they touch gets one point, as near as can be to
//! all tangent planes there, so that edges and corners stay sharp (Ju, Losasso, Schaefer and Warren 2002, "Dual Contouring of Hermite
//! Data", doi:10.1145/566654.566586). Parts thinner than a cell may be missed, and cells that two sheets cross hold one point for both.

use std::collections::HashMap;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::facets::{Facet, has_area, quad};
use super::{Bounds, Line, Primitive};

/// Pull towards the middle of the cuts, in parts of one plane's weight: decides along directions that the planes leave open.
const PULL: f64 = 0.02;
/// Grids with more points are made coarser.
const MOST_POINTS: usize = 1 << 24;

/// What is known of the surface in a cell.
#[derive(Default)]
struct Cell {
    points: Vec<DVec3>,
    normals: Vec<DVec3>,
}

impl Cell {
    /// The point nearest to all planes.
    fn point(&self, lo: DVec3, hi: DVec3) -> DVec3 {
        let n = self.points.len().max(1) as f64;
        let middle = self.points.iter().sum::<DVec3>() / n;
        let mut a = DMat3::from_diagonal(DVec3::splat(PULL * n));
        let mut b = DVec3::ZERO;
        for (p, m) in self.points.iter().zip(&self.normals) {
            a += DMat3::from_cols(*m * m.x, *m * m.y, *m * m.z);
            b += *m * m.dot(*p - middle);
        }
        let p = middle + a.inverse() * b;
        if p.is_finite() { p.clamp(lo, hi) } else { middle }
    }
}

/// The surface within a box, with `cells` of them along its longest side. Nothing for shapes without inside.
pub(super) fn contour(shape: &dyn Primitive, within: &Bounds, cells: usize) -> Vec<Facet> {
    let own = if shape.inside_bounds().is_empty() { Bounds::EMPTY } else { shape.bounds() };
    let bounds = own.intersection(*within);
    if bounds.is_empty() || !bounds.is_finite() {
        return Vec::new();
    }
    let size = bounds.max - bounds.min;
    let mut h = size.max_element() / cells.max(2) as f64;
    let (points, lo) = loop {
        if !(h > 0.0) || !h.is_finite() {
            return Vec::new();
        }
        // A cell of room on each side, and no grid plane where faces of round numbers lie.
        let points = size.to_array().map(|s| (s / h).ceil() as usize + 4);
        if points.iter().product::<usize>() <= MOST_POINTS {
            break (points, bounds.min - DVec3::new(1.371, 1.413, 1.387) * h);
        }
        h *= 1.3;
    };
    let [nx, ny, nz] = points;
    let place = |i: usize| lo + h * DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64);
    let inside: Vec<bool> = (0..nx * ny * nz).into_par_iter().with_min_len(1024).map(|i| shape.inside(place(i))).collect();
    let steps = [1, nx, nx * ny];
    let coordinate = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
    let cut = |i: usize, axis: usize| {
        if coordinate(i)[axis] + 1 >= points[axis] || inside[i] == inside[i + steps[axis]] {
            return None;
        }
        let line = Line { o: place(i), d: DVec3::AXES[axis] * h };
        let crossing = shape.nearest(&line, -1e-9, 1.0 + 1e-9, &mut Vec::new())?;
        let p = line.at(crossing.t);
        let n = shape.normal(p, &crossing).normalize_or_zero();
        (p.is_finite() && n.is_finite()).then_some((i, axis, p, n))
    };
    let cuts: Vec<(usize, usize, DVec3, DVec3)> =
        (0..inside.len()).into_par_iter().with_min_len(1024).flat_map_iter(|i| (0..3).filter_map(move |axis| cut(i, axis))).collect();
    // The four cells around an edge, in a ring.
    let around = |i: usize, axis: usize| {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let at = coordinate(i);
        (at[u] > 0 && at[v] > 0).then(|| [i - steps[u] - steps[v], i - steps[v], i, i - steps[u]])
    };
    let mut found: HashMap<usize, Cell> = HashMap::new();
    for &(i, axis, p, n) in &cuts {
        for cell in around(i, axis).into_iter().flatten() {
            let cell = found.entry(cell).or_default();
            cell.points.push(p);
            cell.normals.push(n);
        }
    }
    let points: HashMap<usize, DVec3> = found.iter().map(|(&i, cell)| (i, cell.point(place(i), place(i) + h))).collect();
    let mut out = Vec::with_capacity(2 * cuts.len());
    for &(i, axis, ..) in &cuts {
        let Some(ring) = around(i, axis) else { continue };
        let [a, b, c, d] = ring.map(|cell| points.get(&cell).copied().unwrap_or(DVec3::NAN));
        // The shorter diagonal.
        let corners = if (a - c).length_squared() <= (b - d).length_squared() { [a, b, c, d] } else { [b, c, d, a] };
        out.extend(quad(corners).into_iter().filter(has_area));
    }
    out
}
