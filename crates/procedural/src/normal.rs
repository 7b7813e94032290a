//! Perturbation of normals by patterns (documentation, "Normal").

use std::sync::Arc;

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

use crate::noise_cells::Waves;
use crate::{BlendMap, Context, ImageMap, Pattern, PatternKind, noise, pattern};

/// A normal perturbation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Normal {
    /// The pattern.
    pub pattern: Pattern,
    /// Depth of the bumps (`bump_size`).
    pub amount: f64,
    /// What the pattern chooses from or goes through.
    pub fill: NormalFill,
    /// Distance of the points that a gradient is measured from (`accuracy`).
    pub accuracy: f64,
    /// The point is (u, v, 0) of the surface.
    pub uv_mapping: bool,
    /// Scaling the normal does not scale the depth of bumps.
    pub no_bump_scale: bool,
    /// How deep patterns stand in one another; kept by [`Normal::settle`].
    pub depth: u32,
}

/// What the pattern of a normal chooses from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum NormalFill {
    /// The pattern's gradient, or its special perturbation.
    #[default]
    Pattern,
    /// The pattern's gradient through a curve of (height, slope).
    Slopes(Arc<BlendMap<(f64, f64)>>),
    /// Blends of normals; weighted in an `average`.
    Normals(Arc<BlendMap<Normal>>),
    /// A normal for each kind of block.
    List(Arc<Vec<Normal>>),
    /// The gradient of a picture; the pattern is only its place.
    Bump(ImageMap),
}

impl Default for Normal {
    fn default() -> Self {
        Self {
            pattern: Pattern::default(),
            amount: 0.5,
            fill: NormalFill::Pattern,
            accuracy: 0.02,
            uv_mapping: false,
            no_bump_scale: false,
            depth: 1,
        }
    }
}

impl Normal {
    /// The perturbed unit normal for the unit normal `n` at the context's point. Patterns are looked up, and normals bent, in the
    /// pattern's own space; there, a normal has length 1 unless `no_bump_scale` is set, so that scaling up deepens the bumps.
    ///
    /// Returns `n` where the result is not finite.
    pub fn perturb(&self, n: DVec3, context: &Context) -> DVec3 {
        let outer = if self.uv_mapping { context.moved(context.uv.extend(0.0)) } else { *context };
        let inner = self.pattern.enter(&outer);
        let placement = &self.pattern.placement;
        let mut bent = placement.normal_inwards(n);
        if !self.no_bump_scale && !placement.operations.is_empty() {
            bent = bent.normalize_or_zero();
        }
        let bent = placement.normal_outwards(self.bend(bent, &inner)).normalize_or_zero();
        if bent.is_finite() && bent != DVec3::ZERO { bent } else { n }
    }

    /// The normal bent in the pattern's own space; of any length.
    fn bend(&self, n: DVec3, inner: &Context) -> DVec3 {
        match &self.fill {
            NormalFill::Pattern => self.bend_by_pattern(n, inner),
            NormalFill::Slopes(map) => self.bend_by_gradient(n, inner, |value| height(map, value)),
            NormalFill::Normals(map) if matches!(self.pattern.kind, PatternKind::Average) => {
                map.entries.iter().map(|(weight, normal)| *weight * normal.perturb(n, inner)).sum()
            }
            NormalFill::Normals(map) => match map.around(self.pattern.value_here(inner)) {
                None => n,
                Some((a, _, 0.0)) => a.perturb(n, inner),
                Some((a, b, weight)) => a.perturb(n, inner) * (1.0 - weight) + b.perturb(n, inner) * weight,
            },
            NormalFill::List(list) => list.get(self.pattern.kind.block(inner)).map_or(n, |normal| normal.perturb(n, inner)),
            NormalFill::Bump(image) => bend_by_picture(image, self.amount, n, inner),
        }
    }

    /// Patterns made for normals have perturbations of their own (measured); all others go by their gradient.
    fn bend_by_pattern(&self, n: DVec3, inner: &Context) -> DVec3 {
        let (p, generator) = (inner.p, inner.noise_generator);
        match &self.pattern.kind {
            PatternKind::None | PatternKind::Average => n,
            PatternKind::Bumps => n + self.amount * noise::vector_noise(p, generator),
            PatternKind::Dents => {
                let depth = noise::noise(p, generator);
                n + self.amount * depth * depth * depth * noise::vector_noise(p, generator)
            }
            PatternKind::Wrinkles => {
                let (mut sum, mut scale) = (DVec3::ZERO, 1.0);
                for _ in 0..10 {
                    sum += noise::vector_noise(p * scale, generator).abs() / scale;
                    scale *= 2.0;
                }
                n + self.amount * sum
            }
            PatternKind::Quilted { control0, control1 } => n + self.amount * pattern::quilted_vector(p, *control0, *control1),
            PatternKind::Ripples => {
                let wave = &self.pattern.wave;
                n + self.amount * Waves::new(inner.number_of_waves).ripples_vector(p, wave.frequency, wave.phase)
            }
            PatternKind::Waves => {
                let wave = &self.pattern.wave;
                n + self.amount * Waves::new(inner.number_of_waves).waves_vector(p, wave.frequency, wave.phase)
            }
            _ => self.bend_by_gradient(n, inner, |value| value),
        }
    }

    /// Bends by the gradient of heights at the corners of a tetrahedron around the point (documentation, "Normals, Accuracy"; its
    /// orientation and the factor are measured).
    fn bend_by_gradient(&self, n: DVec3, inner: &Context, height: impl Fn(f64) -> f64) -> DVec3 {
        let distance = if self.accuracy.is_finite() && self.accuracy != 0.0 { self.accuracy } else { 0.02 };
        let mut gradient = DVec3::ZERO;
        for corner in CORNERS {
            gradient += corner * height(self.pattern.value_here(&inner.moved(inner.p + corner * distance)));
        }
        n - gradient * (self.amount * 0.1 / distance)
    }
}

/// Corners of the tetrahedron around a point.
const CORNERS: [DVec3; 4] = [
    DVec3::new(0.942_809_041_582_063_4, -1.0 / 3.0, 0.0),
    DVec3::new(-0.471_404_520_791_031_7, -1.0 / 3.0, 0.816_496_580_927_726),
    DVec3::new(-0.471_404_520_791_031_7, -1.0 / 3.0, -0.816_496_580_927_726),
    DVec3::Y,
];

/// Height of a slope map: a cubic Hermite curve. Its slopes count per entry, not per unit (measured).
fn height(map: &BlendMap<(f64, f64)>, value: f64) -> f64 {
    let Some((a, b, t)) = map.around(value) else { return value };
    if t == 0.0 {
        return a.0;
    }
    let s = 1.0 - t;
    (1.0 + 2.0 * t) * s * s * a.0 + t * s * s * a.1 + t * t * (3.0 - 2.0 * t) * b.0 - t * t * s * b.1
}

impl Normal {
    /// Brings the depth up to date after a change of the fill or of the pattern's kind; returns it.
    pub fn settle(&mut self) -> u32 {
        let of_fill = match &self.fill {
            NormalFill::Normals(map) => map.entries.iter().map(|e| e.1.depth).max().unwrap_or(0),
            NormalFill::List(list) => list.iter().map(|n| n.depth).max().unwrap_or(0),
            NormalFill::Pattern | NormalFill::Slopes(_) | NormalFill::Bump(_) => 0,
        };
        self.depth = of_fill.max(self.pattern.kind.depth()).saturating_add(1);
        self.depth
    }

    /// Moves the pattern with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.pattern.transform(world_from_old);
    }
}

/// Bends by the slopes of a picture's heights in the plane of the surface: the picture's way up is the y axis, as far as it lies in
/// that plane (measured with planes turned about x and y).
fn bend_by_picture(image: &ImageMap, amount: f64, n: DVec3, inner: &Context) -> DVec3 {
    let Some(slopes) = image.slopes(inner) else { return n };
    let right = n.cross(DVec3::Y).try_normalize().unwrap_or(DVec3::X);
    let up = right.cross(n);
    n - amount * (slopes.x * right + slopes.y * up)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::{Wave, WaveForm};

    fn triangle_gradient(direction: DVec3, amount: f64) -> Normal {
        let wave = Wave { form: WaveForm::Triangle, ..Wave::default() };
        Normal { pattern: Pattern { wave, ..Pattern::new(PatternKind::Gradient(direction)) }, amount, ..Normal::default() }
    }

    fn bent(normal: &Normal, x: f64, y: f64) -> DVec3 {
        normal.perturb(DVec3::NEG_Z, &Context::at(DVec3::new(x, y, 0.0)))
    }

    fn close(got: DVec3, expected: [f64; 3]) {
        assert!((got - DVec3::from_array(expected)).length() < 6e-5, "{got}, measured {expected:?}");
    }

    /// Normals of a plane by pictures of POV-Ray with three lights.
    #[test]
    fn normals_are_as_measured() {
        let gradient = triangle_gradient(DVec3::X, 0.5);
        close(bent(&gradient, 0.21875, 0.5), [-0.132_17, 0.0, -0.991_24]);
        close(bent(&Normal { accuracy: 0.1, ..gradient.clone() }, 0.443_75, 0.5), [-0.061_50, -0.025_30, -0.997_79]);
        close(bent(&triangle_gradient(DVec3::X, 2.0), 0.21875, 0.5), [-0.470_58, 0.0, -0.882_34]);
        for (scale, keep, expected) in [
            (DVec3::splat(2.0), false, -0.133_34),
            (DVec3::splat(2.0), true, -0.066_68),
            (DVec3::new(2.0, 1.0, 1.0), false, -0.066_68),
            (DVec3::new(1.0, 1.0, 3.0), false, -0.400_01),
            (DVec3::new(1.0, 1.0, 3.0), true, -0.133_34),
        ] {
            let mut scaled = Normal { no_bump_scale: keep, ..gradient.clone() };
            scaled.transform(&DMat4::from_scale(scale));
            let n = bent(&scaled, 0.16, 0.84);
            assert!((n.x / -n.z - expected).abs() < 3e-5, "{scale} {keep}: {}", n.x / -n.z);
        }
        let mut turned = gradient.clone();
        turned.transform(&DMat4::from_rotation_y(30.0_f64.to_radians()));
        let slope = bent(&turned, 0.1625, 0.8375);
        assert!((slope.x / -slope.z + 0.123_73).abs() < 3e-5, "{slope}");
        let of = |kind: PatternKind| Normal { pattern: Pattern::new(kind), amount: 0.4, ..Normal::default() };
        for (kind, x, y, slopes) in [
            (PatternKind::Bumps, 0.1625, 0.8375, [-0.0763, -0.0749]),
            (PatternKind::Dents, 0.3875, 0.8375, [-0.0056, -0.0153]),
            (PatternKind::Wrinkles, 0.1625, 0.8375, [0.2181, 0.1629]),
            (PatternKind::Quilted { control0: 1.0, control1: 1.0 }, 0.1625, 0.8375, [-0.1236, 0.1236]),
            (PatternKind::Ripples, 0.1625, 0.8375, [-0.0097, -0.1735]),
            (PatternKind::Waves, 0.3875, 0.8375, [-0.0307, 0.1073]),
            (PatternKind::Crackle(pattern::Crackle::default()), 0.1625, 0.8375, [-0.0099, -0.0364]),
            (PatternKind::Granite, 0.6125, 0.8375, [-0.2537, 0.0587]),
        ] {
            let n = bent(&of(kind.clone()), x, y);
            let got = [n.x / -n.z, n.y / -n.z];
            assert!(got.iter().zip(slopes).all(|(g, s)| (g - s).abs() < 1e-4), "{kind:?}: {got:?}, measured {slopes:?}");
        }
    }

    #[test]
    fn maps_of_normals_are_as_measured() {
        let gradient = triangle_gradient(DVec3::X, 1.0);
        let bumps = Normal { pattern: Pattern::new(PatternKind::Bumps), amount: 1.0, ..Normal::default() };
        let map = |a: f64, b: f64| NormalFill::Normals(Arc::new(BlendMap { entries: vec![(a, gradient.clone()), (b, bumps.clone())] }));
        let average = Normal { pattern: Pattern::new(PatternKind::Average), fill: map(1.0, 2.0), ..Normal::default() };
        close(bent(&average, 0.2, 0.8), [-0.218_93, -0.129, -0.967_18]);
        let mut blend = triangle_gradient(DVec3::Y, 1.0);
        blend.fill = map(0.0, 1.0);
        close(bent(&blend, 0.2, 0.8), [-0.234_98, -0.077_42, -0.968_91]);
        blend.transform(&DMat4::from_scale(DVec3::new(2.0, 1.0, 1.0)));
        close(bent(&blend, 0.2, 0.8), [-0.126_94, -0.030_08, -0.991_45]);
    }

    #[test]
    fn hostile_normals_stay_unit_vectors() {
        for v in [0.0, 1e300, f64::NAN, f64::INFINITY] {
            let mut normal = Normal { accuracy: v, ..triangle_gradient(DVec3::splat(v), v) };
            normal.transform(&DMat4::from_scale(DVec3::splat(v)));
            assert!((bent(&normal, v, 0.3).length() - 1.0).abs() < 1e-9);
        }
    }
}
