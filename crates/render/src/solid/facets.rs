//! Triangles that stand for exact surfaces, and the ways to make them: grids, bodies of revolution, flat areas with holes.

use glam::{DVec2, DVec3};

use super::Crossing;

/// A triangle of a tessellated shape, in the shape's own space.
#[derive(Clone, Copy, Debug)]
pub struct Facet {
    /// Corners, in any order.
    pub p: [DVec3; 3],
    /// What a line would report at the corners, where the shape knows; otherwise lines are sent there.
    pub at: Option<[Crossing; 3]>,
}

impl Facet {
    /// A triangle whose corners lines will ask for.
    pub fn new(p: [DVec3; 3]) -> Self {
        Self { p, at: None }
    }

    /// The normal by the order of the corners, as long as twice the area.
    pub fn cross(&self) -> DVec3 {
        let [a, b, c] = self.p;
        (b - a).cross(c - a)
    }

    /// The triangle of three points given by their barycentric coordinates.
    pub fn part(&self, corners: [DVec3; 3]) -> Self {
        let at = self.at.map(|at| corners.map(|w| Crossing { uv: at[0].uv * w.x + at[1].uv * w.y + at[2].uv * w.z, ..at[0] }));
        Self { p: corners.map(|w| self.p[0] * w.x + self.p[1] * w.y + self.p[2] * w.z), at }
    }
}

/// Both triangles of a quadrilateral.
pub fn quad([a, b, c, d]: [DVec3; 4]) -> [Facet; 2] {
    [Facet::new([a, b, c]), Facet::new([a, c, d])]
}

/// A surface over `nu` × `nv` cells of the unit square.
pub fn grid(nu: usize, nv: usize, at: impl Fn(f64, f64) -> DVec3) -> Vec<Facet> {
    let point = |i: usize, j: usize| at(i as f64 / nu as f64, j as f64 / nv as f64);
    let rows: Vec<Vec<DVec3>> = (0..=nv).map(|j| (0..=nu).map(|i| point(i, j)).collect()).collect();
    let cell = |i: usize, j: usize| quad([rows[j][i], rows[j][i + 1], rows[j + 1][i + 1], rows[j + 1][i]]);
    (0..nv).flat_map(|j| (0..nu).flat_map(move |i| cell(i, j))).filter(has_area).collect()
}

/// A curve of (radius, height) turned around the y axis in so many segments.
pub fn revolve(profile: &[DVec2], segments: usize) -> Vec<Facet> {
    let turns: Vec<DVec2> = (0..=segments).map(|i| circle(i % segments, segments)).collect();
    let at = |q: DVec2, i: usize| DVec3::new(q.x * turns[i].x, q.y, q.x * turns[i].y);
    let band = |q: &[DVec2], i: usize| quad([at(q[0], i), at(q[0], i + 1), at(q[1], i + 1), at(q[1], i)]);
    profile.windows(2).flat_map(|q| (0..segments).flat_map(move |i| band(q, i))).filter(has_area).collect()
}

/// The i-th of n points of the unit circle.
pub fn circle(i: usize, n: usize) -> DVec2 {
    let (sin, cos) = etendue_procedural::fns::sin_cos(std::f64::consts::TAU * i as f64 / n as f64);
    DVec2::new(cos, sin)
}

/// Whether it is a triangle at all.
pub fn has_area(f: &Facet) -> bool {
    f.cross().length_squared() > 0.0 && f.p.iter().all(|p| p.is_finite())
}

/// Most edges of a flat area; each level of corners is compared with all of them.
const MOST_EDGES: usize = 20_000;

/// Triangles that cover what is inside of an odd number of closed polygons: strips between the levels of the corners, cut by the edges.
/// Edges must not cross each other between their ends; areas of more than 20 000 edges are left out.
pub fn fill(edges: &[[DVec2; 2]]) -> Vec<[DVec2; 3]> {
    if edges.len() > MOST_EDGES {
        return Vec::new();
    }
    let mut levels: Vec<f64> = edges.iter().flatten().map(|p| p.y).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let mut upward: Vec<[DVec2; 2]> =
        edges.iter().filter(|[a, b]| a.y != b.y).map(|&[a, b]| if a.y < b.y { [a, b] } else { [b, a] }).collect();
    upward.sort_by(|a, b| a[0].y.total_cmp(&b[0].y));
    let mut active: Vec<[DVec2; 2]> = Vec::new();
    let mut next = 0;
    let mut out = Vec::new();
    for level in levels.windows(2) {
        let (bottom, top) = (level[0], level[1]);
        active.retain(|e| e[1].y >= top);
        while next < upward.len() && upward[next][0].y <= bottom {
            if upward[next][1].y >= top {
                active.push(upward[next]);
            }
            next += 1;
        }
        // Shared corners keep their bits, so that strips above each other meet.
        let x = |[a, b]: &[DVec2; 2], y: f64| match y {
            y if y == a.y => a.x,
            y if y == b.y => b.x,
            y => a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x),
        };
        let mut spans: Vec<[f64; 2]> = active.iter().map(|e| [x(e, bottom), x(e, top)]).collect();
        spans.sort_by(|a, b| (a[0] + a[1]).total_cmp(&(b[0] + b[1])));
        for pair in spans.chunks_exact(2) {
            let [a, b] = [pair[0], pair[1]];
            let corners = [DVec2::new(a[0], bottom), DVec2::new(b[0], bottom), DVec2::new(b[1], top), DVec2::new(a[1], top)];
            if corners[0] != corners[1] {
                out.push([corners[0], corners[1], corners[2]]);
            }
            if corners[2] != corners[3] {
                out.push([corners[0], corners[2], corners[3]]);
            }
        }
    }
    out
}

/// Steps that find where a side is cut.
const BISECTIONS: u32 = 24;

/// The part of a triangle whose points are kept, cut straight between where its sides are cut.
pub fn trim(facet: &Facet, keep: &dyn Fn(DVec3) -> bool, out: &mut Vec<Facet>) {
    let kept = facet.p.map(keep);
    match kept.iter().filter(|k| **k).count() {
        0 => return,
        3 => return out.push(*facet),
        _ => {}
    }
    // The corner that is alone on its side first.
    let alone = (0..3).find(|&i| kept[i] != kept[(i + 1) % 3] && kept[i] != kept[(i + 2) % 3]).unwrap_or(0);
    let axes = [0, 1, 2].map(|k| DVec3::AXES[(alone + k) % 3]);
    let point = |w: DVec3| facet.p[0] * w.x + facet.p[1] * w.y + facet.p[2] * w.z;
    let cut = |other: DVec3| {
        let (mut a, mut b) = (0.0, 1.0);
        for _ in 0..BISECTIONS {
            let m = 0.5 * (a + b);
            if keep(point(axes[0].lerp(other, m))) == kept[alone] { a = m } else { b = m }
        }
        axes[0].lerp(other, 0.5 * (a + b))
    };
    let (b, c) = (cut(axes[1]), cut(axes[2]));
    if kept[alone] {
        out.push(facet.part([axes[0], b, c]));
    } else {
        out.extend([facet.part([b, axes[1], axes[2]]), facet.part([b, axes[2], c])]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_with_holes_are_filled() {
        let square = |c: f64, h: f64| {
            let p = [DVec2::new(c - h, c - h), DVec2::new(c + h, c - h), DVec2::new(c + h, c + h), DVec2::new(c - h, c + h)];
            (0..4).map(move |i| [p[i], p[(i + 1) % 4]])
        };
        let edges: Vec<_> = square(0.0, 2.0).chain(square(0.5, 0.5)).chain(square(-1.0, 0.25)).collect();
        let area: f64 = fill(&edges).iter().map(|[a, b, c]| 0.5 * (*b - *a).perp_dot(*c - *a).abs()).sum();
        assert!((area - (16.0 - 1.0 - 0.25)).abs() < 1e-12, "{area}");
    }
}
