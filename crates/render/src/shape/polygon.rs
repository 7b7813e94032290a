//! Polygons with holes.

use glam::DVec2;

use super::planar::{Facing, Planar};
use super::{AreaSample, ShapeHit, SurfaceGeometry, area_to_solid_angle};
use crate::accel::Ray;
use crate::math::distribution::PiecewiseConstant1D;
use crate::math::{Aabb, Mat4, Vec2, Vec3};

/// Contours of the xy plane under a transform, filled by the even–odd rule. u and v are x and y.
#[derive(Clone, Debug)]
pub struct Polygon {
    planar: Planar,
    /// Start and end of each side.
    edges: Vec<[Vec2; 2]>,
    min: Vec2,
    max: Vec2,
    /// The inside, cut into pieces without overlap.
    trapezoids: Vec<Trapezoid>,
    by_area: PiecewiseConstant1D,
    area: f32,
}

/// Between two heights, from a left to a right side.
#[derive(Clone, Copy, Debug)]
struct Trapezoid {
    y: [f32; 2],
    left: [f32; 2],
    right: [f32; 2],
}

/// Crossings of sides are looked for (in quadratic time) up to this number of sides; larger polygons are taken to have none,
/// which matters for their area and sampling only.
const MAX_EDGES_WITH_CROSSINGS: usize = 4096;
/// More pieces than this and the polygon is refused.
const MAX_TRAPEZOIDS: usize = 1 << 20;

impl Polygon {
    /// Places the polygon; `None` where there is no area, something is not finite, or it has millions of pieces.
    pub fn from_transform(contours: &[Vec<Vec2>], world_from_object: Mat4, flip_normals: bool) -> Option<Self> {
        let planar = Planar::new(world_from_object, Facing::LocalZ, flip_normals)?;
        if !contours.iter().flatten().all(|p| p.is_finite()) {
            return None;
        }
        let edges: Vec<[Vec2; 2]> =
            contours.iter().flat_map(|c| c.iter().zip(c.iter().cycle().skip(1)).map(|(&a, &b)| [a, b])).filter(|[a, b]| a != b).collect();
        let (min, max) = edges.iter().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(lo, hi), e| (lo.min(e[0]), hi.max(e[0])));
        let trapezoids = decompose(&edges)?;
        let areas: Vec<f32> =
            trapezoids.iter().map(|t| 0.5 * (t.y[1] - t.y[0]) * (t.right[0] - t.left[0] + (t.right[1] - t.left[1]))).collect();
        let by_area = PiecewiseConstant1D::new(&areas);
        let area = (by_area.integral() * by_area.len() as f64) as f32 * planar.stretch;
        (area > 0.0 && area.is_finite()).then_some(Self { planar, edges, min, max, trapezoids, by_area, area })
    }

    /// See [`super::Shape::bounds`].
    pub fn bounds(&self) -> Aabb {
        let b = Aabb::from_points(self.edges.iter().map(|e| self.planar.point(e[0])));
        let pad = b.min.abs().max(b.max.abs()) * (2.0 * f32::EPSILON);
        Aabb { min: b.min - pad, max: b.max + pad }
    }

    /// Two triangles for each piece of the inside.
    pub(super) fn pieces(&self) -> super::Tessellation {
        let corner = |x: f32, y: f32| self.planar.point(Vec2::new(x, y));
        let positions = self.trapezoids.iter().flat_map(|t| {
            let [y0, y1] = t.y;
            [corner(t.left[0], y0), corner(t.right[0], y0), corner(t.right[1], y1), corner(t.left[1], y1)]
        });
        let triangles = (0..self.trapezoids.len() as u32).map(|i| 4 * i).flat_map(|i| [[i, i + 1, i + 2], [i, i + 2, i + 3]]);
        (positions.collect(), triangles.collect())
    }

    /// Whether a point of the plane is inside: an odd number of sides to its right.
    fn contains(&self, q: Vec2) -> bool {
        if !(q.cmpge(self.min).all() && q.cmple(self.max).all()) {
            return false;
        }
        let mut odd = false;
        for [a, b] in &self.edges {
            if (a.y > q.y) != (b.y > q.y) {
                let (lo, hi) = if a.y < b.y { (*a, *b) } else { (*b, *a) };
                odd ^= (q.x - lo.x) * (hi.y - lo.y) < (hi.x - lo.x) * (q.y - lo.y);
            }
        }
        odd
    }

    /// See [`super::Shape::intersect`]. Linear in the number of sides.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<ShapeHit> {
        let (t, q) = self.planar.intersect(ray)?;
        self.contains(q).then_some(ShapeHit { t, u: q.x, v: q.y })
    }

    /// See [`super::Shape::surface`].
    #[inline]
    pub fn surface(&self, p: Vec3) -> SurfaceGeometry {
        self.planar.surface(p)
    }

    /// See [`super::Shape::area`].
    pub fn area(&self) -> f32 {
        self.area
    }

    /// The polygon's inside as triangles without overlap, counter-clockwise about local +z.
    pub fn triangles(&self) -> Vec<[Vec3; 3]> {
        let at = |x: f32, y: f32| self.planar.point(Vec2::new(x, y));
        let pair = |t: &Trapezoid| {
            let [a, b] = [at(t.left[0], t.y[0]), at(t.right[0], t.y[0])];
            let [c, d] = [at(t.left[1], t.y[1]), at(t.right[1], t.y[1])];
            [[a, b, d], [a, d, c]]
        };
        self.trapezoids.iter().flat_map(pair).collect()
    }

    /// See [`super::Shape::sample_area`].
    pub fn sample_area(&self, u: Vec2) -> Option<AreaSample> {
        let (i, _, u_y) = self.by_area.sample_discrete(u.x);
        let t = self.trapezoids[i];
        let (w0, w1) = (t.right[0] - t.left[0], t.right[1] - t.left[1]);
        // The height whose share of the area below is u: (w0 s + (w1 − w0) s²/2) = u (w0 + w1)/2.
        let root = (w0 * w0 + u_y * (w1 * w1 - w0 * w0)).max(0.0).sqrt();
        let s = if w0 + root > 0.0 { (u_y * (w0 + w1) / (w0 + root)).clamp(0.0, 1.0) } else { 0.0 };
        let mix = |v: [f32; 2]| v[0] + (v[1] - v[0]) * s;
        let (left, right) = (mix(t.left), mix(t.right));
        let q = Vec2::new(left + (right - left) * u.y, mix(t.y));
        Some(AreaSample { p: self.planar.point(q), ng: self.planar.ng, uv: q, pdf: 1.0 / self.area })
    }

    /// See [`super::Shape::sample_solid_angle`]: uniform by area.
    pub fn sample_solid_angle(&self, ref_p: Vec3, u: Vec2) -> Option<AreaSample> {
        self.sample_area(u)?.per_solid_angle(ref_p)
    }

    /// See [`super::Shape::pdf_solid_angle`].
    pub fn pdf_solid_angle(&self, ref_p: Vec3, p: Vec3, ng: Vec3) -> f32 {
        area_to_solid_angle(ref_p, p, ng) / self.area
    }
}

/// Cuts the inside at the height of every corner and crossing: between two such heights sides do not cross, so that from
/// left to right they bound inside and outside in turn.
fn decompose(edges: &[[Vec2; 2]]) -> Option<Vec<Trapezoid>> {
    let sides: Vec<[DVec2; 2]> = edges
        .iter()
        .map(|&[a, b]| if a.y < b.y { [a.as_dvec2(), b.as_dvec2()] } else { [b.as_dvec2(), a.as_dvec2()] })
        .filter(|[a, b]| a.y < b.y)
        .collect();
    let mut heights: Vec<f64> = sides.iter().flat_map(|s| [s[0].y, s[1].y]).collect();
    if sides.len() <= MAX_EDGES_WITH_CROSSINGS {
        for (i, a) in sides.iter().enumerate() {
            for b in &sides[..i] {
                heights.extend(crossing(a, b));
            }
            if heights.len() > MAX_TRAPEZOIDS {
                return None;
            }
        }
    }
    heights.sort_unstable_by(f64::total_cmp);
    heights.dedup();

    let mut by_start: Vec<&[DVec2; 2]> = sides.iter().collect();
    by_start.sort_by(|a, b| a[0].y.total_cmp(&b[0].y));
    let (mut next, mut active, mut out) = (0, Vec::new(), Vec::new());
    for slab in heights.windows(2) {
        let [y0, y1] = [slab[0], slab[1]];
        active.retain(|s: &&[DVec2; 2]| s[1].y > y0);
        while next < by_start.len() && by_start[next][0].y <= y0 {
            active.push(by_start[next]);
            next += 1;
        }
        let x_at = |s: &[DVec2; 2], y: f64| s[0].x + (s[1].x - s[0].x) * ((y - s[0].y) / (s[1].y - s[0].y));
        let middle = 0.5 * (y0 + y1);
        active.sort_by(|a, b| x_at(a, middle).total_cmp(&x_at(b, middle)));
        for pair in active.chunks_exact(2) {
            let x = |s: &[DVec2; 2]| [x_at(s, y0) as f32, x_at(s, y1) as f32];
            out.push(Trapezoid { y: [y0 as f32, y1 as f32], left: x(pair[0]), right: x(pair[1]) });
        }
        if out.len() > MAX_TRAPEZOIDS {
            return None;
        }
    }
    Some(out)
}

/// The height at which two sides cross away from their ends.
fn crossing(a: &[DVec2; 2], b: &[DVec2; 2]) -> Option<f64> {
    if a[1].y <= b[0].y || b[1].y <= a[0].y {
        return None;
    }
    let (d, e, f) = (a[1] - a[0], b[1] - b[0], b[0] - a[0]);
    let det = d.perp_dot(e);
    let (s, t) = (f.perp_dot(e) / det, f.perp_dot(d) / det);
    let inside = |x: f64| x > 0.0 && x < 1.0;
    (inside(s) && inside(t)).then(|| a[0].y + d.y * s)
}
