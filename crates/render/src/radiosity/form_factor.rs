//! Form factors: the share of the light that leaves one surface and arrives at another.
//!
//! [`point_to_polygon`] is exact where nothing is in between (Lambert 1760, as in Baum, Rushmeier and Winget 1989, "Improving
//! Radiosity Solutions Through the Use of Analytically Determined Form-Factors", doi:10.1145/74333.74367). Times the share of rays
//! that pass, and averaged over points of the receiver, it is the factor of a pair of elements: [`Pair`].
//!
//! The convention of all of this module: F from a receiver to a source is the share of the receiver's view that the source fills, so
//! the receiver's irradiance is F times the source's radiosity (W·m⁻²), and the factors of a receiver in a closed room sum to 1.

use glam::DVec3;

use crate::accel::Ray;
use crate::math::fns;
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
    /// Largest less smallest value over the receiver's quarters.
    pub spread: f32,
    /// The factor of a source that is evenly bright: geometry and visibility alone.
    pub geometric: f32,
    /// The factor if nothing were in between.
    pub open: f32,
    /// The share of the rays that passed.
    pub passed: f32,
}

impl Estimate {
    /// Whether some rays passed and some did not.
    pub fn is_mixed(&self) -> bool {
        self.passed > 0.0 && self.passed < 1.0
    }
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
/// for Triangles", doi:10.1002/nme.1620070316): weights and barycentric places; first those near the corners, then those near the middles of
/// the edges.
const POINTS: [(f32, [f32; 3]); 6] = {
    const CORNER: f32 = 0.091_576_21;
    const MIDDLE: f32 = 0.445_948_5;
    const OF_CORNER: f32 = 0.109_951_74;
    const OF_MIDDLE: f32 = 0.223_381_59;
    let (near, far) = (1.0 - 2.0 * CORNER, 1.0 - 2.0 * MIDDLE);
    [
        (OF_CORNER, [near, CORNER, CORNER]),
        (OF_CORNER, [CORNER, near, CORNER]),
        (OF_CORNER, [CORNER, CORNER, near]),
        (OF_MIDDLE, [far, MIDDLE, MIDDLE]),
        (OF_MIDDLE, [MIDDLE, far, MIDDLE]),
        (OF_MIDDLE, [MIDDLE, MIDDLE, far]),
    ]
};

/// The factors to another side of a triangle of a side at [`POINTS`].
fn at_points(corners: &[Vec3; 3], normal: Vec3, to: &Side) -> [f32; 6] {
    POINTS.map(|(_, b)| point_to_polygon(corners[0] * b[0] + corners[1] * b[1] + corners[2] * b[2], normal, to.corners))
}

/// The mean over a side of the factor to another; by four times as many points where they are near each other, as the factor rises
/// steeply towards a common edge.
fn mean_over(from: &Side, to: &Side) -> f32 {
    let mean = |corners: &[Vec3; 3]| at_points(corners, from.normal, to).iter().zip(POINTS).map(|(f, (w, _))| f * w).sum::<f32>();
    let center = |c: &[Vec3; 3]| (c[0] + c[1] + c[2]) / 3.0;
    let radius2 = |s: &Side| s.corners.iter().map(|c| c.distance_squared(center(s.corners))).fold(0.0, f32::max);
    let reach = radius2(from).sqrt() + radius2(to).sqrt();
    if center(from.corners).distance_squared(center(to.corners)) > fns::sqr(reach) {
        return mean(from.corners);
    }
    (0..4).map(|i| mean(&quarter(from.corners, i))).sum::<f32>() / 4.0
}

/// How bright a source is at a point of it, and in the mean. What is near a receiver is often bright from the same light, and what is
/// hidden from it dark, as the floor under a table: mean radiosity times bare geometry would lose light.
pub struct SourceLight<'a> {
    /// At a point.
    pub at: &'a dyn Fn(Vec3) -> f32,
    /// The mean over the area.
    pub mean: f32,
}

/// A receiver and a source that see each other's right sides, with the factor that they have if nothing is in between.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    receiver: Side<'a>,
    source: Side<'a>,
    open: f32,
}

impl<'a> Pair<'a> {
    /// `None` where no light can go from one to the other.
    ///
    /// The mean is over points of the smaller of both, as Aᵣ Fᵣₛ = Aₛ Fₛᵣ: a small source at the edge of a large receiver may lie
    /// between all points of the receiver, and light would be lost.
    pub fn new(receiver: Side<'a>, source: Side<'a>) -> Option<Self> {
        let above = |c: &[Vec3; 3], s: &Side| c.iter().any(|&c| (c - s.corners[0]).dot(s.normal) > 0.0);
        if !above(source.corners, &receiver) || !above(receiver.corners, &source) {
            return None;
        }
        let (area_r, area_s) = (area_of(receiver.corners), area_of(source.corners));
        let open =
            if area_s < area_r { (mean_over(&source, &receiver) * (area_s / area_r)).min(1.0) } else { mean_over(&receiver, &source) };
        (open > 0.0).then_some(Self { receiver, source, open })
    }

    /// The factor if nothing were in between.
    pub fn open(&self) -> f32 {
        self.open
    }

    /// The factor by `rays` from each quarter of the receiver (at least 1): the open one times the share of them that pass, each
    /// weighted by cosines over squared distance, so that what stands between the near parts of both counts for what it hides.
    /// `passes` is the share of light that passes between a point of the receiver and one of the source.
    ///
    /// How many rays are worth their time must not be decided by what the same rays found, nor whether to refine: a place that one
    /// ray in ten reaches would lose most of its light, as the estimates that happen to be high would be replaced and those that happen to
    /// be zero would stay.
    pub fn trace(&self, rays: u32, random: PairRandom, passes: impl Fn(Vec3, Vec3) -> f32, light: Option<&SourceLight>) -> Estimate {
        let (receiver, source) = (&self.receiver, &self.source);
        let height = |p: Vec3| (p - receiver.corners[0]).dot(receiver.normal);
        let top = source.corners.iter().copied().fold(source.corners[0], |a, b| if height(b) > height(a) { b } else { a });
        // Of each quarter of the receiver: weights, what passes of them, and the light that passes.
        let (mut weights, mut passed, mut lit) = ([0.0f32; 4], [0.0f32; 4], [0.0f32; 4]);
        let (mut count, mut traced) = (0.0f32, 0u32);
        // Which quarters are paired first is random: a fixed pairing would be wrong in the same way everywhere.
        let turn = (random.pair(u32::MAX).x * 4.0) as usize;
        let rays = rays.max(1);
        for k in 0..rays {
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
                let from = point_of(&quarter(receiver.corners, i), u);
                let d = to - from;
                let dist2 = d.length_squared();
                let cosines = d.dot(receiver.normal) * -d.dot(source.normal);
                // Behind the source, or so near that the numbers end.
                let weight = if cosines > 0.0 { cosines / (dist2 * dist2) } else { 0.0 };
                if !(weight > 0.0 && weight.is_finite()) {
                    continue;
                }
                let share = passes(from, to);
                weights[i] += weight;
                passed[i] += weight * share;
                lit[i] += weight * share * light.map_or(1.0, |l| (l.at)(to));
                count += share;
                traced += 1;
            }
        }
        let sum = |v: &[f32; 4]| v.iter().sum::<f32>();
        let all = sum(&weights);
        if !(all > 0.0) {
            // A pair that sees each other at grazing angles only, and of which no ray was above both horizons.
            return Estimate { open: self.open, spread: self.open, ..Estimate::default() };
        }
        let mean = light.map_or(1.0, |l| l.mean);
        let scale = if mean > 0.0 { 1.0 / mean } else { 0.0 };
        let at = at_points(receiver.corners, receiver.normal, source);
        let quarters = [at[0], at[1], at[2], (at[3] + at[4] + at[5]) / 3.0];
        let values: [f32; 4] = std::array::from_fn(|i| quarters[i] * lit[i] / weights[i].max(1e-30) * scale);
        let (lo, hi) = values.iter().fold((f32::INFINITY, 0.0f32), |(lo, hi), &v| (lo.min(v), hi.max(v)));
        Estimate {
            factor: self.open * sum(&lit) / all * scale,
            spread: hi - lo,
            geometric: self.open * sum(&passed) / all,
            open: self.open,
            passed: count / traced as f32,
        }
    }
}
