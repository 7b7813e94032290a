//! `bicubic_patch`: a Bézier patch, divided into quadrilaterals of two smooth triangles each, as POV-Ray does (documentation, section
//! 3.4.5.2.1). Both types make the same picture, so both divide beforehand.

use arrayvec::ArrayVec;
use glam::{DVec2, DVec3};

use super::facets::{Facet, has_area};
use super::{Bounds, Crossing, Line, Primitive};

/// Most levels of division in one direction.
const MOST_STEPS: u32 = 7;

/// A divided patch.
pub struct BicubicPatch {
    nodes: Vec<Node>,
    quads: Vec<Quad>,
    /// Surface coordinates of the corners (0, 0), (1, 0), (1, 1), (0, 1).
    uv: [DVec2; 4],
}

/// Depth first; `next` is the node after all that are below.
struct Node {
    bounds: Bounds,
    next: u32,
    quad: Option<u32>,
}

/// Corners at (u₀, v₀), (u₁, v₀), (u₁, v₁), (u₀, v₁).
struct Quad {
    p: [DVec3; 4],
    n: [DVec3; 4],
    uv: [DVec2; 4],
}

/// Corners of both triangles of a quadrilateral.
const TRIANGLES: [[usize; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

struct Division<'a> {
    points: &'a [DVec3; 16],
    flatness: f64,
    nodes: Vec<Node>,
    quads: Vec<Quad>,
}

/// Bernstein polynomials of degree 3 and their derivatives.
fn weights(t: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    (
        [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t],
        [-3.0 * s * s, 3.0 * s * (s - 2.0 * t), 3.0 * t * (2.0 * s - t), 3.0 * t * t],
    )
}

impl Division<'_> {
    /// Point and derivatives along u and v. Points of a row are along v, as measured.
    fn at(&self, uv: DVec2) -> (DVec3, DVec3, DVec3) {
        let ((bu, du), (bv, dv)) = (weights(uv.x), weights(uv.y));
        let (mut p, mut pu, mut pv) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        for j in 0..4 {
            for i in 0..4 {
                let c = self.points[4 * i + j];
                p += c * (bu[i] * bv[j]);
                pu += c * (du[i] * bv[j]);
                pv += c * (bu[i] * dv[j]);
            }
        }
        (p, pu, pv)
    }

    fn normal(&self, uv: DVec2) -> DVec3 {
        let (_, pu, pv) = self.at(uv);
        let n = pu.cross(pv);
        if n.length_squared() > 1e-20 * pu.length_squared() * pv.length_squared() {
            return n.normalize_or(DVec3::Y);
        }
        // Where points coincide: a little towards the middle.
        let (_, pu, pv) = self.at(uv.lerp(DVec2::splat(0.5), 1e-3));
        pu.cross(pv).normalize_or(DVec3::Y)
    }

    /// Whether a part is nearer than the flatness to the plane through three of its corners.
    fn flat(&self, lo: DVec2, hi: DVec2) -> bool {
        if !(self.flatness > 0.0) {
            return false;
        }
        let corner = |u: f64, v: f64| self.at(DVec2::new(u, v)).0;
        let (a, b, c) = (corner(lo.x, lo.y), corner(hi.x, lo.y), corner(hi.x, hi.y));
        let Some(n) = (b - a).cross(c - a).try_normalize() else { return false };
        (0..4).all(|j| {
            (0..4).all(|i| {
                let uv = lo + (hi - lo) * DVec2::new(f64::from(i), f64::from(j)) / 3.0;
                (self.at(uv).0 - a).dot(n).abs() < self.flatness
            })
        })
    }

    fn divide(&mut self, lo: DVec2, hi: DVec2, u_steps: u32, v_steps: u32) -> Bounds {
        let own = self.nodes.len();
        self.nodes.push(Node { bounds: Bounds::EMPTY, next: 0, quad: None });
        let middle = 0.5 * (lo + hi);
        let bounds = if (u_steps == 0 && v_steps == 0) || self.flat(lo, hi) {
            let uv = [lo, DVec2::new(hi.x, lo.y), hi, DVec2::new(lo.x, hi.y)];
            let quad = Quad { p: uv.map(|uv| self.at(uv).0), n: uv.map(|uv| self.normal(uv)), uv };
            self.nodes[own].quad = Some(self.quads.len() as u32);
            let bounds = Bounds::of_points(quad.p);
            self.quads.push(quad);
            bounds
        } else if u_steps >= v_steps {
            let left = self.divide(lo, DVec2::new(middle.x, hi.y), u_steps - 1, v_steps);
            left.union(self.divide(DVec2::new(middle.x, lo.y), hi, u_steps - 1, v_steps))
        } else {
            let front = self.divide(lo, DVec2::new(hi.x, middle.y), u_steps, v_steps - 1);
            front.union(self.divide(DVec2::new(lo.x, middle.y), hi, u_steps, v_steps - 1))
        };
        self.nodes[own].bounds = bounds;
        self.nodes[own].next = self.nodes.len() as u32;
        bounds
    }
}

impl BicubicPatch {
    /// Four rows of four control points; `uv` are the surface coordinates of the corners. Steps beyond 7 are taken for 7. `None` where a
    /// number is not finite.
    pub fn new(points: &[DVec3; 16], u_steps: u32, v_steps: u32, flatness: f64, uv: [DVec2; 4]) -> Option<Self> {
        if points.iter().any(|p| !p.is_finite() || p.abs().max_element() > 1e60) || uv.iter().any(|uv| !uv.is_finite()) {
            return None;
        }
        let mut division = Division { points, flatness, nodes: Vec::new(), quads: Vec::new() };
        division.divide(DVec2::ZERO, DVec2::ONE, u_steps.min(MOST_STEPS), v_steps.min(MOST_STEPS));
        Some(Self { nodes: division.nodes, quads: division.quads, uv })
    }

    /// Corners' values at a crossing.
    fn blend<T>(&self, crossing: &Crossing, of: impl Fn(&Quad) -> [T; 4]) -> Option<T>
    where
        T: Copy + std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>,
    {
        let values = of(self.quads.get(crossing.part as usize / 2)?);
        let [a, b, c] = TRIANGLES[crossing.part as usize % 2].map(|i| values[i]);
        Some(a * (1.0 - crossing.uv.x - crossing.uv.y) + b * crossing.uv.x + c * crossing.uv.y)
    }
}

impl Primitive for BicubicPatch {
    fn facets(&self, _: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let facet = |quad: u32, half: u32| {
            let at = [DVec2::ZERO, DVec2::X, DVec2::Y].map(|uv| Crossing { uv, ..Crossing::new(0.0, 2 * quad + half) });
            Facet { p: TRIANGLES[half as usize].map(|i| self.quads[quad as usize].p[i]), at: Some(at) }
        };
        Some((0..self.quads.len() as u32).flat_map(|q| [facet(q, 0), facet(q, 1)]).filter(has_area).collect())
    }

    fn bounds(&self) -> Bounds {
        self.nodes.first().map_or(Bounds::EMPTY, |n| n.bounds)
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        if !line.o.is_finite() || !line.d.is_finite() {
            return;
        }
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if super::prism::clip(&node.bounds, line, t_min, t_max).is_none() {
                at = node.next as usize;
                continue;
            }
            at += 1;
            let Some(quad) = node.quad else { continue };
            let mut found = ArrayVec::<Crossing, 2>::new();
            for (i, corners) in TRIANGLES.iter().enumerate() {
                // Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", JGT 2, 1997.
                let [a, b, c] = corners.map(|k| self.quads[quad as usize].p[k]);
                let (e1, e2) = (b - a, c - a);
                let p = line.d.cross(e2);
                let inverse = 1.0 / e1.dot(p);
                let s = line.o - a;
                let q = s.cross(e1);
                let (u, v, t) = (s.dot(p) * inverse, line.d.dot(q) * inverse, e2.dot(q) * inverse);
                // The shared edge counts once.
                let within = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && (i == 0 || v > 0.0);
                if within && t > t_min && t < t_max {
                    found.push(Crossing { t, part: 2 * quad + i as u32, uv: DVec2::new(u, v) });
                }
            }
            out.extend(found);
        }
    }

    fn inside(&self, _: DVec3) -> bool {
        false
    }

    fn normal(&self, _: DVec3, crossing: &Crossing) -> DVec3 {
        self.blend(crossing, |q| q.n).and_then(DVec3::try_normalize).unwrap_or(DVec3::Y)
    }

    fn geometric_normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        let Some(quad) = self.quads.get(crossing.part as usize / 2) else { return DVec3::Y };
        let [a, b, c] = TRIANGLES[crossing.part as usize % 2].map(|i| quad.p[i]);
        let (n, smooth) = ((b - a).cross(c - a).normalize_or(DVec3::Y), self.normal(p, crossing));
        if n.dot(smooth) < 0.0 { -n } else { n }
    }

    fn uv(&self, _: DVec3, crossing: &Crossing) -> DVec2 {
        let uv = self.blend(crossing, |q| q.uv).unwrap_or_default();
        // Surface coordinates take rows for v, steps take them for u: both measured.
        self.uv[0].lerp(self.uv[1], uv.y).lerp(self.uv[3].lerp(self.uv[2], uv.y), uv.x)
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, compare, hostile_lines};
    use super::*;

    #[rustfmt::skip]
    const POINTS: [DVec3; 16] = [
        DVec3::new(0., 0., 2.), DVec3::new(1., 0., 0.), DVec3::new(2., 0., 0.), DVec3::new(3., 0., -2.),
        DVec3::new(0., 1., 0.), DVec3::new(1., 1., 0.), DVec3::new(2., 1., 1.), DVec3::new(3., 1., 0.),
        DVec3::new(0., 2., 0.), DVec3::new(1., 2., 0.), DVec3::new(2., 2., 0.), DVec3::new(3., 2., 0.),
        DVec3::new(0., 3., 2.), DVec3::new(1., 3., 0.), DVec3::new(2., 3., 0.), DVec3::new(3., 3., -2.),
    ];
    const UV: [DVec2; 4] = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];

    #[test]
    fn as_pov_ray() {
        let patch = BicubicPatch::new(&POINTS, 2, 3, 0.0, UV).unwrap();
        compare(&patch, include_str!("measured/bicubic_patch.txt"), &Tolerance::default());
    }

    #[test]
    fn flatness_stops_division() {
        let patch = BicubicPatch::new(&POINTS, 4, 4, 0.1, UV).unwrap();
        // When exactly POV-Ray stops is not documented: within the flatness.
        compare(&patch, include_str!("measured/bicubic_flat.txt"), &Tolerance { t: 0.1, n: 0.05, ..Tolerance::default() });
    }

    #[test]
    fn hostile() {
        let mut points = POINTS;
        points[3].x = f64::NAN;
        assert!(BicubicPatch::new(&points, 2, 3, 0.0, UV).is_none());
        hostile_lines(&BicubicPatch::new(&POINTS, u32::MAX, 1_000_000_000, f64::NAN, UV).unwrap());
        hostile_lines(&BicubicPatch::new(&[DVec3::ONE; 16], 3, 3, 1e-300, UV).unwrap());
    }
}
