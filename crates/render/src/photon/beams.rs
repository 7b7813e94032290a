//! Photon beams: the whole way of a photon through a homogeneous medium as a source of scattered light, instead of the one point where
//! it happens to be scattered (Jarosz, Nowrouzezahrai, Sadeghi, Jensen 2011, "A Comprehensive Theory of Volumetric Radiance Estimation Using
//! Photon Points and Beams", doi:10.1145/1899404.1899409; the beam × beam estimate with a blur in one dimension, its equation 38).
//!
//! A ray and a beam pass each other where they are nearest, d apart at the angle θ. Of the beam's power Φ arrives there Φ T(s), of
//! which the medium sends σs f Φ T(s) K(d) / sin θ along the ray, with Epanechnikov's kernel K over −R … R. Blur is in one direction
//! alone, so few beams with a small radius do what many points with a large one do.

use crate::accel::Ray;
use crate::math::{Aabb, Vec3};
use crate::medium::{Homogeneous, Phase};
use crate::photon::Route;
use crate::spectrum::Spectrum;

/// Longest way of a beam as an optical distance, in the lane that sees farthest.
const OPTICAL_END: f32 = 12.0;
/// Ranges of pieces up to this long are looked at one by one.
const LEAF: usize = 4;
/// Most pieces of a beam: boxes about long slanted beams are mostly empty.
const MOST_PIECES: usize = 16;
/// Squared sine of the least angle between ray and beam.
const LEAST_SIN2: f32 = 1e-8;

/// The way of a photon through a homogeneous medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Where it starts.
    pub o: Vec3,
    /// Unit direction.
    pub d: Vec3,
    /// How long it is.
    pub length: f32,
    /// Power in W at its start, if the photon were the only one.
    pub power: Spectrum,
    /// Index of the medium in the scene.
    pub medium: u32,
    /// Light group.
    pub group: u32,
    /// Scattering events before it.
    pub depth: u32,
    /// How the photon came.
    pub route: Route,
}

impl Beam {
    /// Cuts the length, which may be infinite, where nothing comes any more.
    pub fn new(ray: &Ray, t_max: f32, homogeneous: &Homogeneous, power: Spectrum, rest: (u32, u32, u32, Route)) -> Self {
        let least = homogeneous.sigma_t.0.iter().filter(|s| **s > 0.0).fold(f32::INFINITY, |a, b| a.min(*b));
        let (medium, group, depth, route) = rest;
        Self { o: ray.o, d: ray.d, length: t_max.min(OPTICAL_END / least), power, medium, group, depth, route }
    }

    /// Whether it carries light, and all its numbers are finite.
    pub fn is_usable(&self) -> bool {
        self.o.is_finite() && self.length.is_finite() && self.length > 0.0 && self.power.is_finite() && !self.power.is_black()
    }

    /// Where a ray passes: its parameter, the beam's, the distance and the sine of the angle; `None` where they pass farther than
    /// `radius` away, or beyond one of the ends.
    #[inline]
    fn pass(&self, ray: &Ray, t_max: f32, radius: f32) -> Option<Passing> {
        let n = ray.d.cross(self.d);
        let sin2 = n.length_squared();
        if !(sin2 > LEAST_SIN2) {
            return None;
        }
        let to = self.o - ray.o;
        let across = to.dot(n);
        if across * across >= radius * radius * sin2 {
            return None;
        }
        let t = to.cross(self.d).dot(n) / sin2;
        let s = to.cross(ray.d).dot(n) / sin2;
        let inside = t > 0.0 && t < t_max && s >= 0.0 && s < self.length;
        let sin = sin2.sqrt();
        inside.then(|| Passing { t, s, distance: across.abs() / sin, sin })
    }
}

/// Where a ray passes a beam.
#[derive(Clone, Copy, Debug)]
struct Passing {
    t: f32,
    s: f32,
    distance: f32,
    sin: f32,
}

/// A part of a beam.
#[derive(Clone, Copy, Debug)]
struct Piece {
    beam: u32,
    begin: f32,
    end: f32,
    center: Vec3,
}

/// A box of the tree about pieces.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    /// The second child (the first is the next node), or the first piece of a leaf.
    index: u32,
    /// Pieces of a leaf; 0 for others.
    count: u32,
}

/// Beams by place, seen within a radius.
#[derive(Clone, Debug, Default)]
pub struct BeamTree {
    beams: Vec<Beam>,
    pieces: Vec<Piece>,
    nodes: Vec<Node>,
    radius: f32,
}

impl BeamTree {
    /// Sorts usable beams, to be seen from up to `radius` away. O(n log n).
    pub fn new(beams: Vec<Beam>, radius: f32) -> Self {
        let longest = beams.iter().fold(0.0f32, |l, b| l.max(b.length));
        let mut pieces = Vec::with_capacity(beams.len() * 4);
        for (i, beam) in beams.iter().enumerate() {
            let count = ((beam.length / longest * MOST_PIECES as f32).ceil() as usize).clamp(1, MOST_PIECES);
            for k in 0..count {
                let [begin, end] = [k, k + 1].map(|k| beam.length * (k as f32 / count as f32));
                pieces.push(Piece { beam: i as u32, begin, end, center: beam.o + beam.d * (0.5 * (begin + end)) });
            }
        }
        let mut tree = Self { beams, pieces: Vec::new(), nodes: Vec::with_capacity(pieces.len()), radius };
        if !pieces.is_empty() {
            tree.build(&mut pieces, 0);
        }
        tree.pieces = pieces;
        tree
    }

    /// How far away beams are seen.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    fn bounds(&self, piece: &Piece) -> Aabb {
        let beam = &self.beams[piece.beam as usize];
        let b = Aabb::from_points([beam.o + beam.d * piece.begin, beam.o + beam.d * piece.end]);
        Aabb { min: b.min - Vec3::splat(self.radius), max: b.max + Vec3::splat(self.radius) }
    }

    fn build(&mut self, pieces: &mut [Piece], first: u32) {
        let bounds = pieces.iter().fold(Aabb::EMPTY, |b, p| b.union(self.bounds(p)));
        let node = self.nodes.len();
        self.nodes.push(Node { bounds, index: first, count: pieces.len() as u32 });
        if pieces.len() <= LEAF {
            return;
        }
        let centers = Aabb::from_points(pieces.iter().map(|p| p.center));
        let axis = centers.extent().max_position();
        let middle = pieces.len() / 2;
        let key = |p: &Piece| (p.beam, p.begin.to_bits());
        pieces.select_nth_unstable_by(middle, |a, b| a.center[axis].total_cmp(&b.center[axis]).then_with(|| key(a).cmp(&key(b))));
        let (low, high) = pieces.split_at_mut(middle);
        self.build(low, first);
        let second = self.nodes.len() as u32;
        (self.nodes[node].index, self.nodes[node].count) = (second, 0);
        self.build(high, first + middle as u32);
    }

    /// Calls `add` with each beam that a ray passes before `t_max`: the ray's parameter, the beam's, and kernel / sin θ.
    #[inline]
    pub fn along(&self, ray: &Ray, t_max: f32, mut add: impl FnMut(&Beam, f32, f32, f32)) {
        if self.nodes.is_empty() {
            return;
        }
        let inverse = ray.d.recip();
        let norm = 0.75 / self.radius;
        // The tree halves its pieces: it is not deeper than 32.
        let mut pending: arrayvec::ArrayVec<u32, 40> = arrayvec::ArrayVec::new();
        let mut at = 0;
        loop {
            let node = &self.nodes[at as usize];
            let mut next = None;
            if crosses(&node.bounds, ray.o, inverse, t_max) {
                if node.count == 0 {
                    pending.push(node.index);
                    next = Some(at + 1);
                } else {
                    for piece in &self.pieces[node.index as usize..(node.index + node.count) as usize] {
                        let beam = &self.beams[piece.beam as usize];
                        if let Some(p) = beam.pass(ray, t_max, self.radius)
                            && p.s >= piece.begin
                            && p.s < piece.end
                        {
                            let x = p.distance / self.radius;
                            add(beam, p.t, p.s, norm * (1.0 - x * x) / p.sin);
                        }
                    }
                }
            }
            match next.or_else(|| pending.pop()) {
                Some(node) => at = node,
                None => return,
            }
        }
    }
}

/// Whether a ray meets a box before `t_max`. Axes along which the ray does not go count by the origin.
#[inline]
fn crosses(b: &Aabb, o: Vec3, inverse: Vec3, t_max: f32) -> bool {
    let (a, z) = ((b.min - o) * inverse, (b.max - o) * inverse);
    // `min` and `max` of Rust leave numbers that are none out: 0 × ∞ on a border does not decide.
    let near = a.x.min(z.x).max(a.y.min(z.y)).max(a.z.min(z.z)).max(0.0);
    let far = a.x.max(z.x).min(a.y.max(z.y)).min(a.z.max(z.z)).min(t_max);
    near <= far * (1.0 + 1e-5)
}

/// The share of a beam's power that a homogeneous medium sends back along a ray from where they pass each other, what it loses on both ways
/// taken off.
#[inline]
pub fn scattered(medium: &Homogeneous, phase: &Phase, ray: &Ray, beam: &Beam, t: f32, s: f32) -> Spectrum {
    medium.sigma_s * medium.transmittance(t + s) * phase.eval(-ray.d, -beam.d)
}

/// The radius within which rays in lit places pass about `count` of the beams, at most `reach`: the median over `probes`, rays with their lengths
/// that go through a beam whose index is given with them.
pub fn radius(beams: &[Beam], probes: impl Iterator<Item = (usize, Ray, f32)>, count: usize, reach: f32) -> f32 {
    let mut radii: Vec<f32> = probes
        .map(|(own, ray, length)| {
            let others = beams.iter().enumerate().filter(|(i, _)| *i != own);
            let mut near: Vec<f32> = others.filter_map(|(_, b)| b.pass(&ray, length, reach)).map(|p| p.distance).collect();
            if near.len() < count {
                return reach;
            }
            *near.select_nth_unstable_by(count - 1, f32::total_cmp).1
        })
        .collect();
    radii.sort_by(f32::total_cmp);
    radii.get(radii.len() / 2).copied().unwrap_or(reach)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{mix32, unit_float};
    use crate::math::{Vec2, warp};

    fn beams(n: u32) -> Vec<Beam> {
        let u = |i: u32| unit_float(mix32(i ^ 0x5bd1));
        (0..n)
            .map(|i| {
                let o = Vec3::new(u(8 * i), u(8 * i + 1), u(8 * i + 2)) * 2.0 - 1.0;
                let d = warp::uniform_sphere(Vec2::new(u(8 * i + 3), u(8 * i + 4)));
                let power = Spectrum::splat(i as f32 + 1.0);
                Beam { o, d, length: 2.0 * u(8 * i + 5), power, medium: 0, group: 0, depth: 0, route: Route::Direct }
            })
            .filter(Beam::is_usable)
            .collect()
    }

    #[test]
    fn trees_find_what_looking_at_all_finds() {
        for n in [0, 1, 3, 5, 40, 1000] {
            let all = beams(n);
            for radius in [1e-3, 0.05, 0.7] {
                let tree = BeamTree::new(all.clone(), radius);
                for q in beams(60) {
                    let ray = Ray::new(q.o, q.d);
                    let mut found = Vec::new();
                    tree.along(&ray, q.length, |b, t, s, _| found.push((b.power.0[0], t, s)));
                    let mut expected: Vec<_> =
                        all.iter().filter_map(|b| b.pass(&ray, q.length, radius).map(|p| (b.power.0[0], p.t, p.s))).collect();
                    found.sort_by(|a, b| a.partial_cmp(b).unwrap());
                    expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
                    assert_eq!(found, expected, "{n} beams, {radius}");
                }
            }
        }
    }

    /// The estimate of parallel beams of unit density through a slab is the slab's thickness, however they lie to the ray.
    #[test]
    fn even_light_is_even() {
        for (sin, cos) in [(1.0f32, 0.0f32), (0.6, 0.8), (0.28, 0.96)] {
            let d = Vec3::new(sin, 0.0, cos);
            // Over an area of the plane across them; the ray goes along z through the middle.
            let (e1, size, n) = (Vec3::new(cos, 0.0, -sin), [2.0f32, 0.8], [1000, 20]);
            let all = (0..n[0] * n[1])
                .map(|i| {
                    let at = |k: i32, axis: usize| ((k as f32 + 0.5) / n[axis] as f32 - 0.5) * size[axis];
                    let o = e1 * at(i % n[0], 0) + Vec3::Y * at(i / n[0], 1) - d * 20.0;
                    let power = Spectrum::splat(size[0] * size[1] / (n[0] * n[1]) as f32);
                    Beam { o, d, length: 40.0, power, medium: 0, group: 0, depth: 0, route: Route::Direct }
                })
                .collect();
            let tree = BeamTree::new(all, 0.3);
            let mut sum = 0.0;
            let length = 1.5;
            tree.along(&Ray::new(Vec3::Z * -0.75, Vec3::Z), length, |b, _, _, k| sum += k * b.power.0[0]);
            assert!((sum / length - 1.0).abs() < 0.02, "{sin}: {sum}");
        }
    }

    #[test]
    fn hostile_beams_do_no_harm() {
        let mut all = beams(20);
        for (o, d, length) in [(Vec3::splat(1e30), Vec3::X, 1e30), (Vec3::ZERO, Vec3::X, f32::MAX), (Vec3::ZERO, Vec3::Z, 1e-30)] {
            all.push(Beam { o, d, length, ..all[0] });
        }
        assert!(!Beam { length: f32::INFINITY, ..all[0] }.is_usable() && !Beam { o: Vec3::NAN, ..all[0] }.is_usable());
        let tree = BeamTree::new(all, 0.1);
        for d in [Vec3::X, Vec3::Y, Vec3::new(1.0, 1e-20, 0.0).normalize()] {
            tree.along(&Ray::new(Vec3::ZERO, d), f32::INFINITY, |_, t, s, k| assert!(t >= 0.0 && s >= 0.0 && k.is_finite()));
        }
    }
}
