//! Where finite lights are and where they shine, for the light hierarchy: Conty Estevez and Kulla 2018, "Importance Sampling
//! of Many Lights with Adaptive Tree Splitting", doi:10.1145/3233305, sections 4.1 and 4.4 (see also pbrt-v4, section 12.6.3).

use glam::Quat;

use crate::math::{Aabb, PI, TAU, Vec3, fns};
use crate::spectrum::Spectrum;

/// Bounds of one light or a group: a box, a cone of normals, and how far from the normals light goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightBounds {
    /// Holds the lights.
    pub bounds: Aabb,
    /// Unit axis of the cone of normals.
    pub axis: Vec3,
    /// Strength: intensity of points, radiance × area of surfaces.
    pub phi: f32,
    /// Cosine of the half-angle of the cone of normals; −1 for all directions.
    pub cos_o: f32,
    /// Cosine of the angle from a normal beyond which there is no light.
    pub cos_e: f32,
    /// Whether the opposite directions are lit too.
    pub two_sided: bool,
    /// The strength into a direction, averaged over all directions.
    pub mean: f32,
    /// How it leans: the strength into direction w is about `mean` + `lean`·w (the first two bands of spherical harmonics).
    pub lean: Vec3,
}

/// Factors of an importance are not let below this while light may arrive: rounding must not take the chance from a light
/// near the limit of its cone.
const FLOOR: f32 = 1e-3;
/// What the leaning estimate is not let below, relative to the mean.
const LEAN_FLOOR: f32 = 0.1;
const COS_SLACK: f32 = 1e-4;

/// The one number of a light's strength. Every color counts, and absurd values stay finite.
pub(crate) fn strength(s: Spectrum) -> f32 {
    let s = 0.5 * (s.luminance() + s.max_component());
    if s > 0.0 { s.min(1e30) } else { 0.0 }
}

/// cos(max(0, a − b)) from the angles' sines and cosines, for angles in [0, π].
#[inline]
fn cos_sub_clamped((sin_a, cos_a): (f32, f32), (sin_b, cos_b): (f32, f32)) -> f32 {
    if cos_a > cos_b { 1.0 } else { cos_a * cos_b + sin_a * sin_b }
}

/// sin(max(0, a − b)).
#[inline]
fn sin_sub_clamped((sin_a, cos_a): (f32, f32), (sin_b, cos_b): (f32, f32)) -> f32 {
    if cos_a > cos_b { 0.0 } else { sin_a * cos_b - cos_a * sin_b }
}

#[inline]
fn with_sine(cos: f32) -> (f32, f32) {
    (fns::safe_sqrt(1.0 - cos * cos), cos)
}

impl LightBounds {
    /// The bounds of nothing.
    pub const EMPTY: Self =
        Self { bounds: Aabb::EMPTY, axis: Vec3::Z, phi: 0.0, cos_o: 1.0, cos_e: 1.0, two_sided: false, mean: 0.0, lean: Vec3::ZERO };

    /// An estimate of how much light arrives at `p` on a surface with normal `n` (zero: no surface). Zero only where none can.
    ///
    /// The paper's bound on the cosine at the light decides where nothing arrives. For groups it is far from what arrives, so
    /// that the estimate is the lesser of it and the first two bands of the group's directional distribution, its distance
    /// is that to a ball of lights rather than to its center, and the receiver's cosine goes to its mean as the group surrounds it.
    pub fn importance(&self, p: Vec3, n: Vec3) -> f32 {
        let d = p - self.bounds.center();
        let radius2 = 0.25 * self.bounds.extent().length_squared();
        let dist2 = d.length_squared();
        let w = d.normalize_or_zero();
        // The angle under which the box is seen: all round from inside its sphere.
        let sin2_box = radius2 / dist2;
        let outside = sin2_box < 1.0;
        let mut cos = 1.0;
        if outside {
            let cos_w = self.axis.dot(w);
            let cos_w = with_sine(if self.two_sided { cos_w.abs() } else { cos_w });
            let normals = with_sine(self.cos_o);
            // θ′ = max(0, θw − θo − θb)
            let past_cone = (sin_sub_clamped(cos_w, normals), cos_sub_clamped(cos_w, normals));
            cos = cos_sub_clamped(past_cone, (sin2_box.sqrt(), (1.0 - sin2_box).sqrt()));
            if cos < self.cos_e - COS_SLACK {
                return 0.0;
            }
        }
        let surrounds = if outside { sin2_box } else { 1.0 };
        let leaning = (self.mean + self.lean.dot(w) * (1.0 - 0.5 * surrounds)).max(LEAN_FLOOR * self.mean);
        let strength = leaning.min(self.phi * cos.max(FLOOR));
        // The mean of 1/d² over a ball, whose volume is about the box's, to 10 %.
        let ball2 = 0.5 * radius2;
        let inverse_square = if dist2 > ball2 { 1.0 / (dist2 - ball2 * (1.0 / 3.0)) } else { 3.0 / (ball2 + dist2).max(f32::MIN_POSITIVE) };
        let mut importance = strength * inverse_square;
        if n != Vec3::ZERO {
            importance *= (w.dot(n).abs() * (1.0 - surrounds) + 0.5 * surrounds).max(FLOOR);
        }
        // A light at the very point must not make infinities.
        importance.min(f32::MAX * 1e-3)
    }

    /// The bounds of both.
    pub fn union(&self, o: &Self) -> Self {
        if self.phi == 0.0 {
            return *o;
        }
        if o.phi == 0.0 {
            return *self;
        }
        let (axis, cos_o) = cone_union((self.axis, self.cos_o), (o.axis, o.cos_o));
        Self {
            bounds: self.bounds.union(o.bounds),
            axis,
            phi: (self.phi + o.phi).min(1e37),
            cos_o,
            cos_e: self.cos_e.min(o.cos_e),
            two_sided: self.two_sided || o.two_sided,
            mean: (self.mean + o.mean).min(1e37),
            lean: (self.lean + o.lean).clamp(Vec3::splat(-1e37), Vec3::splat(1e37)),
        }
    }

    /// The bounds of a surface of the given strength that emits diffusely, to the side of `normal` or (two-sided) to both; of one
    /// that is curved all round without a normal.
    pub(super) fn of_surface(bounds: Aabb, phi: f32, normal: Option<Vec3>, two_sided: bool) -> Self {
        // The clamped cosine is 1/4 + cos/2 + …, its absolute value 1/2 + 0·cos + …
        let lean = normal.filter(|_| !two_sided).map_or(Vec3::ZERO, |n| n * (0.5 * phi));
        let mean = if two_sided { 0.5 } else { 0.25 } * phi;
        let cos_o = if normal.is_some() { 1.0 } else { -1.0 };
        Self { bounds, axis: normal.unwrap_or(Vec3::Z), phi, cos_o, cos_e: 0.0, two_sided, mean, lean }
    }
}

/// What the choice of a split needs to know of a group: bounds whose cone is estimated rather than exact, at a fraction of the work.
#[derive(Clone, Copy)]
pub(super) struct Group {
    bounds: Aabb,
    phi: f32,
    axes: Vec3,
    cos_e: f32,
}

impl Group {
    pub const EMPTY: Self = Self { bounds: Aabb::EMPTY, phi: 0.0, axes: Vec3::ZERO, cos_e: 1.0 };

    /// Whether nothing was added (a light's strength is not zero).
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.phi == 0.0
    }

    /// Adds a light.
    #[inline]
    pub fn add(&mut self, b: &LightBounds) {
        self.bounds = self.bounds.union(b.bounds);
        self.phi += b.phi;
        // The mean direction of a cone of directions is as long as (1 + cos of its half-angle) / 2.
        self.axes += b.axis * (b.phi * 0.5 * (1.0 + b.cos_o));
        self.cos_e = self.cos_e.min(b.cos_e);
    }

    #[inline]
    pub fn join(&mut self, o: &Self) {
        self.bounds = self.bounds.union(o.bounds);
        self.phi += o.phi;
        self.axes += o.axes;
        self.cos_e = self.cos_e.min(o.cos_e);
    }

    /// What a group costs (section 4.4): strength × area of the box × measure of the directions. `stretch` is the parent's
    /// longest side over its side along the split, against thin groups.
    pub fn cost(&self, stretch: f32) -> f32 {
        if self.phi == 0.0 {
            return 0.0;
        }
        let cos_o = (2.0 * self.axes.length() / self.phi - 1.0).clamp(-1.0, 1.0);
        let (theta_o, theta_e) = (fns::acos(cos_o), fns::acos(self.cos_e));
        let theta_w = (theta_o + theta_e).min(PI);
        let sin_o = fns::safe_sqrt(1.0 - cos_o * cos_o);
        let directions =
            TAU * (1.0 - cos_o) + PI / 2.0 * (2.0 * theta_w * sin_o - fns::cos(theta_o - 2.0 * theta_w) - 2.0 * theta_o * sin_o + cos_o);
        // Lights on a line have no area, but their extent still counts.
        let extent = self.bounds.half_area() + 0.01 * self.bounds.extent().length_squared();
        self.phi * directions * stretch * extent
    }
}

/// The smallest cone about two cones, each an axis and the cosine of its half-angle.
fn cone_union(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let (a, b) = if a.1 < b.1 { (a, b) } else { (b, a) };
    // `a` is the wider one.
    if a.1 <= -1.0 {
        return (a.0, -1.0);
    }
    let cross = a.0.cross(b.0);
    let between = fns::atan2(cross.length(), a.0.dot(b.0));
    let (theta_a, theta_b) = (fns::acos(a.1), fns::acos(b.1));
    if (between + theta_b).min(PI) <= theta_a {
        return a;
    }
    let theta = 0.5 * (theta_a + between + theta_b);
    if theta >= PI {
        return (a.0, -1.0);
    }
    let axis = match cross.try_normalize() {
        Some(about) => {
            let (sin, cos) = fns::sin_cos(0.5 * (theta - theta_a));
            (Quat::from_xyzw(about.x * sin, about.y * sin, about.z * sin, cos) * a.0).normalize_or(a.0)
        }
        // Opposite axes.
        None => return (a.0, -1.0),
    };
    // A little wider, for the rounding of the axis.
    (axis, (fns::cos(theta) - 1e-6).max(-1.0))
}
