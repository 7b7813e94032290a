//! Form factors: the share of the light that leaves one surface and arrives at another.
//!
//! [`point_to_polygon`] is exact where nothing is in between (Lambert 1760, as in Baum, Rushmeier and Winget 1989, "Improving
//! Radiosity Solutions Through the Use of Analytically Determined Form-Factors", doi:10.1145/74333.74367). Times the share of rays
//! that pass, and averaged over points of the receiver, it is the factor of a pair of elements: [`between_triangles`].
//!
//! The convention of all of this module: F from a receiver to a source is the share of the receiver's view that the source fills, so
//! the receiver's irradiance is F times the source's radiosity (W·m⁻²), and the factors of a receiver in a closed room sum to 1.

use glam::DVec3;

use crate::accel::Ray;
use crate::math::hash::{hash_words, mix64};
use crate::math::{Vec2, Vec3};
use crate::scene::Scene;
use crate::scene::surface::offset;

/// Shadow rays end this much (relative) before the other surface.
const SHADOW_END: f32 = 1.0 - 1e-4;
/// Surfaces that let light straight through, between two points.
const MAX_CROSSINGS: u32 = 64;
/// A polygon that is so small against its distance counts as a point: the error is of the order of the square of this.
const POINT_LIKE: f32 = 0.02;

/// The cosine-weighted share of the hemisphere about the unit normal `n` at `p` that a triangle fills: Σ θᵢ n·Γᵢ / 2π over the
/// edges of the part above the horizon, where θᵢ is the angle of an edge seen from `p` and Γᵢ the unit normal of the plane through it and
/// `p`. The triangle counts from the side from which its corners are counter-clockwise; zero from the other. In [0, 1].
pub fn point_to_polygon(p: Vec3, n: Vec3, corners: &[Vec3; 3]) -> f32 {
    let (center, normal) = ((corners[0] + corners[1] + corners[2]) / 3.0, (corners[1] - corners[0]).cross(corners[2] - corners[0]));
    let d = center - p;
    let dist2 = d.length_squared();
    let far = |v: &Vec3| (*v - center).length_squared() < POINT_LIKE * POINT_LIKE * dist2;
    if corners.iter().all(far) {
        let (cos_r, cos_s) = (n.dot(d), -normal.dot(d));
        // `normal` is twice the area long.
        return if cos_r > 0.0 && cos_s > 0.0 { 0.5 * cos_r * cos_s / (std::f32::consts::PI * dist2 * dist2) } else { 0.0 };
    }
    if normal.dot(p - corners[0]) <= 0.0 {
        return 0.0;
    }
    let (o, n) = (p.as_dvec3(), n.as_dvec3());
    let corners = corners.map(|c| c.as_dvec3() - o);
    let heights = corners.map(|c| c.dot(n));
    // The part above the horizon has at most four corners.
    let mut kept = arrayvec::ArrayVec::<DVec3, 4>::new();
    for i in 0..3 {
        let j = (i + 1) % 3;
        if heights[i] >= 0.0 {
            let _ = kept.try_push(corners[i]);
        }
        if (heights[i] > 0.0 && heights[j] < 0.0) || (heights[i] < 0.0 && heights[j] > 0.0) {
            let t = heights[i] / (heights[i] - heights[j]);
            let _ = kept.try_push(corners[i] + (corners[j] - corners[i]) * t);
        }
    }
    if kept.len() < 3 {
        return 0.0;
    }
    let mut sum = 0.0;
    for i in 0..kept.len() {
        let (a, b) = (kept[i], kept[(i + 1) % kept.len()]);
        let cross = a.cross(b);
        let sin = cross.length();
        if sin > 0.0 {
            sum -= n.dot(cross) / sin * libm::atan2(sin, a.dot(b));
        }
    }
    let f = (sum / std::f64::consts::TAU) as f32;
    if f.is_finite() { f.clamp(0.0, 1.0) } else { 0.0 }
}

/// Random numbers of a pair of things: a function of both and of the seed, so that the order of the work does not matter.
#[derive(Clone, Copy, Debug)]
pub struct PairRandom(u64);

impl PairRandom {
    /// For a pair.
    pub fn new(seed: u64, a: u32, b: u32) -> Self {
        Self(hash_words([seed, u64::from(a) << 32 | u64::from(b)]))
    }

    /// The `i`-th pair of numbers in [0, 1).
    #[inline]
    pub fn pair(self, i: u32) -> Vec2 {
        let bits = mix64(self.0 ^ u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        Vec2::new(crate::math::hash::unit_float(bits as u32), crate::math::hash::unit_float((bits >> 32) as u32))
    }
}

/// The corners of the `i`-th of the four triangles that the midpoints of the edges make; see [`super::mesh`].
#[inline]
pub fn quarter(c: &[Vec3; 3], i: usize) -> [Vec3; 3] {
    let m = [(c[0] + c[1]) * 0.5, (c[1] + c[2]) * 0.5, (c[2] + c[0]) * 0.5];
    match i {
        0 => [c[0], m[0], m[2]],
        1 => [m[0], c[1], m[1]],
        2 => [m[2], m[1], c[2]],
        _ => [m[1], m[2], m[0]],
    }
}

/// A uniform point of a triangle, without square roots: the unit square folded along its diagonal.
#[inline]
pub fn point_of(c: &[Vec3; 3], u: Vec2) -> Vec3 {
    let u = if u.x + u.y > 1.0 { Vec2::ONE - u } else { u };
    c[0] + (c[1] - c[0]) * u.x + (c[2] - c[0]) * u.y
}

/// Half of a triangle's edges' cross product: its area.
#[inline]
pub fn area_of(c: &[Vec3; 3]) -> f32 {
    let (a, b) = ((c[1] - c[0]).as_dvec3(), (c[2] - c[0]).as_dvec3());
    (0.5 * a.cross(b).length()) as f32
}

/// The share of light that passes straight between two surface points; normals on the sides that see each other.
#[inline]
pub fn visibility(scene: &Scene, p: Vec3, np: Vec3, q: Vec3, nq: Vec3) -> f32 {
    let o = offset(p, np);
    let d = offset(q, nq) - o;
    passes(scene, Ray { o, d, t_min: 0.0, t_max: SHADOW_END })
}

/// The share of light that passes along a ray: what lets light straight through lets it through here, and clear glass does without
/// bending it.
#[inline]
pub fn passes(scene: &Scene, ray: Ray) -> f32 {
    let Some(hit) = scene.accel.intersect(&ray) else { return 1.0 };
    if !super::material::may_pass(scene, scene.hit_material(&hit)) {
        return 0.0;
    }
    let (mut ray, mut hit, mut share) = (ray, hit, 1.0);
    for _ in 0..MAX_CROSSINGS {
        let s = scene.surface(&ray, &hit);
        let wo = -ray.d.normalize_or_zero();
        share *= super::material::passing_share(&scene.materials[s.material as usize].shade(scene, &s, wo), wo);
        if share < 1e-3 {
            return 0.0;
        }
        ray = Ray { o: s.offset_origin(ray.d), t_min: 0.0, t_max: ray.t_max - hit.t, ..ray };
        match scene.accel.intersect(&ray) {
            None => return share,
            Some(next) => hit = next,
        }
    }
    0.0
}

/// A form factor with what refinement wants to know of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// The factor from the receiver to the source.
    pub factor: f32,
    /// Largest less smallest value over the receiver.
    pub spread: f32,
}

/// A triangle that sends or receives on the side from which its corners are counter-clockwise.
#[derive(Clone, Copy, Debug)]
pub struct Side<'a> {
    /// Corners, counter-clockwise.
    pub corners: &'a [Vec3; 3],
    /// Unit normal.
    pub normal: Vec3,
}

/// The quadrature over a triangle that is exact for polynomials of degree 4, with six points (Cowper 1973, "Gaussian Quadrature Formulas
/// for Triangles", doi:10.1002/nme.1620070316): barycentric weights and shares.
const CORNER_POINT: f32 = 0.091_576_21;
const CORNER_WEIGHT: f32 = 0.109_951_74;
const MIDDLE_POINT: f32 = 0.445_948_5;
const MIDDLE_WEIGHT: f32 = 0.223_381_59;

/// The factor from a receiver to a source: the mean over the receiver of the exact factor of a point to the source, by six points, times
/// the share of `rays` (per quarter of the receiver, at least 1) that pass. Where some pass and some do not, four times as many are
/// traced. `passes` is the share of light that passes between a point of the receiver and one of the source.
pub fn between_triangles(receiver: &Side, source: &Side, rays: u32, random: PairRandom, passes: impl Fn(Vec3, Vec3) -> f32) -> Estimate {
    let above = |c: &[Vec3; 3], s: &Side| c.iter().any(|&c| (c - s.corners[0]).dot(s.normal) > 0.0);
    if !above(source.corners, receiver) || !above(receiver.corners, source) {
        return Estimate::default();
    }
    // Factors fall off from edges where surfaces meet and are convex there: the middle of an element alone would always be too dark.
    let at = |b: [f32; 3]| receiver.corners[0] * b[0] + receiver.corners[1] * b[1] + receiver.corners[2] * b[2];
    let of = |b: [f32; 3]| point_to_polygon(at(b), receiver.normal, source.corners);
    let [a, b] = [CORNER_POINT, MIDDLE_POINT];
    let (near, far) = (1.0 - 2.0 * a, 1.0 - 2.0 * b);
    let corner = [of([near, a, a]), of([a, near, a]), of([a, a, near])];
    let middle = [of([far, b, b]), of([b, far, b]), of([b, b, far])];
    let total = CORNER_WEIGHT * (corner[0] + corner[1] + corner[2]) + MIDDLE_WEIGHT * (middle[0] + middle[1] + middle[2]);
    if total <= 0.0 {
        return Estimate::default();
    }
    // The quarters' shares of it, for the share of rays that pass.
    let quarters = [corner[0], corner[1], corner[2], (middle[0] + middle[1] + middle[2]) / 3.0];
    let height = |p: Vec3| (p - receiver.corners[0]).dot(receiver.normal);
    let top = source.corners.iter().copied().fold(source.corners[0], |a, b| if height(b) > height(a) { b } else { a });
    let mut passed = [0.0f32; 4];
    // Which quarters are paired first is random: a fixed pairing would be wrong in the same way everywhere.
    let turn = (random.pair(u32::MAX).x * 4.0) as usize;
    let mut traced = 0u32;
    let mut trace = |passed: &mut [f32; 4], n: u32| {
        for k in traced..traced + n {
            #[expect(clippy::needless_range_loop, reason = "four quarters, of which `passed` is one list")]
            for i in 0..4 {
                let at = 4 * k + i as u32;
                let (u, v) = (random.pair(2 * at), random.pair(2 * at + 1));
                // Quarters of the source are paired with those of the receiver, turned by one each time.
                let mut to = point_of(&quarter(source.corners, (i + k as usize + turn) % 4), v);
                let below = height(to);
                if below <= 0.0 {
                    // What is below the horizon is not in the factor: move towards the highest corner, to somewhere above.
                    let above = height(top);
                    to = top + (to - top) * (above / (above - below) * u.x);
                }
                passed[i] += passes(point_of(&quarter(receiver.corners, i), u), to);
            }
        }
        traced += n;
        traced
    };
    let mut n = trace(&mut passed, rays.max(1));
    let all: f32 = passed.iter().sum();
    if all > 0.0 && all < 4.0 * n as f32 {
        n = trace(&mut passed, 3 * rays.max(1));
    }
    let values: [f32; 4] = std::array::from_fn(|i| quarters[i] * passed[i] / n as f32);
    let (lo, hi) = values.iter().fold((f32::INFINITY, 0.0f32), |(lo, hi), &v| (lo.min(v), hi.max(v)));
    let share = values.iter().sum::<f32>() / quarters.iter().sum::<f32>();
    Estimate { factor: total * share, spread: hi - lo }
}
