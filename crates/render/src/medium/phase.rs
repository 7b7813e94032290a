//! Phase functions: in which directions a medium scatters.
//!
//! Directions are unit, in world space, and both point away from the point: light that goes straight on has wi = −wo. `eval` is
//! normalized over the sphere.

use etendue_scene::desc::PhaseDesc;

use crate::math::{Frame, INV_4PI, ONE_MINUS_EPSILON, TAU, Vec2, Vec3, fns, warp};

/// A mean cosine this near to 0 counts as isotropic: the inversion divides by it.
const LEAST_G: f32 = 1e-3;

/// The closed set of phase functions.
#[derive(Clone, Debug, PartialEq)]
pub enum Phase {
    /// Every direction alike.
    Isotropic,
    /// Henyey and Greenstein 1941, doi:10.1086/144246: mean cosine g in (−1, 1), positive forward.
    HenyeyGreenstein(f32),
    /// Rayleigh's for unpolarized light: 3/16π (1 + cos²θ).
    Rayleigh,
    /// Weighted sum; the weights sum to 1.
    Mix(Box<[(f32, Phase)]>),
}

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhaseSample {
    /// Where the light comes from, unit.
    pub wi: Vec3,
    /// Density per solid angle.
    pub pdf: f32,
    /// Value of the phase function over the density.
    pub weight: f32,
}

impl Phase {
    /// From a validated description.
    pub fn new(desc: &PhaseDesc) -> Self {
        match desc {
            PhaseDesc::Isotropic => Self::Isotropic,
            PhaseDesc::HenyeyGreenstein { g } if g.abs() < LEAST_G => Self::Isotropic,
            // Nearer to ±1 single precision has no directions left to tell apart.
            PhaseDesc::HenyeyGreenstein { g } => Self::HenyeyGreenstein(g.clamp(-0.9999, 0.9999)),
            PhaseDesc::Rayleigh => Self::Rayleigh,
            PhaseDesc::Blend { first, second, weight } => Self::mix(Self::new(first), Self::new(second), weight.clamp(0.0, 1.0)),
        }
    }

    fn mix(first: Self, second: Self, weight: f32) -> Self {
        let mut parts = Vec::new();
        for (phase, share) in [(first, 1.0 - weight), (second, weight)] {
            match phase {
                _ if share == 0.0 => {}
                Self::Mix(nested) => parts.extend(nested.into_vec().into_iter().map(|(w, p)| (w * share, p))),
                other => parts.push((share, other)),
            }
        }
        Self::Mix(parts.into())
    }

    /// The share of light per solid angle that is scattered from `wi` to `wo`.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.of_cos(-wo.dot(wi))
    }

    /// The density of `wi` per solid angle.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.eval(wo, wi)
    }

    /// By the cosine of the angle by which light is turned.
    fn of_cos(&self, cos: f32) -> f32 {
        match self {
            Self::Isotropic => INV_4PI,
            Self::HenyeyGreenstein(g) => {
                // 1 + g² − 2g·cos, without cancellation at the peak.
                let d = fns::sqr(1.0 - g.abs()) + 2.0 * g.abs() * (1.0 - cos * g.signum()).max(0.0);
                INV_4PI * (1.0 - g * g) / (d * d.sqrt())
            }
            Self::Rayleigh => 0.75 * INV_4PI * (1.0 + cos * cos),
            Self::Mix(parts) => parts.iter().map(|(w, p)| w * p.of_cos(cos)).sum(),
        }
    }

    /// Samples a direction.
    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> PhaseSample {
        match self {
            Self::Isotropic => PhaseSample { wi: warp::uniform_sphere(u), pdf: INV_4PI, weight: 1.0 },
            Self::Mix(parts) => {
                let (mut chosen, mut rest) = (0, u.x);
                while chosen + 1 < parts.len() && rest >= parts[chosen].0 {
                    rest -= parts[chosen].0;
                    chosen += 1;
                }
                let Some((share, phase)) = parts.get(chosen) else { return Self::Isotropic.sample(wo, u) };
                let u = Vec2::new((rest / share).clamp(0.0, ONE_MINUS_EPSILON), u.y);
                let wi = phase.sample(wo, u).wi;
                PhaseSample { wi, pdf: self.pdf(wo, wi), weight: 1.0 }
            }
            _ => {
                let cos = self.sample_cos(u.x);
                let sin = fns::safe_sqrt(1.0 - cos * cos);
                let (sin_phi, cos_phi) = fns::sin_cos(TAU * u.y);
                let wi = Frame::from_normal(-wo).world_from_local(Vec3::new(sin * cos_phi, sin * sin_phi, cos));
                PhaseSample { wi, pdf: self.of_cos(cos), weight: 1.0 }
            }
        }
    }

    /// The cosine by inversion of its distribution.
    fn sample_cos(&self, u: f32) -> f32 {
        match self {
            Self::HenyeyGreenstein(g) => {
                let a = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
                ((1.0 + g * g - a * a) / (2.0 * g)).clamp(-1.0, 1.0)
            }
            Self::Rayleigh => {
                // ∫ 3/8 (1 + c²) dc = u: Cardano's formula for c³ + 3c = 8u − 4 (Frisvad 2011, doi:10.1364/JOSAA.28.002436).
                let q = 4.0 * u - 2.0;
                let d = (q * q + 1.0).sqrt();
                let cube = |x: f32| libm::cbrtf(x);
                (cube(q + d) - cube(d - q)).clamp(-1.0, 1.0)
            }
            _ => 1.0 - 2.0 * u,
        }
    }

    /// The mean cosine.
    pub fn mean_cos(&self) -> f32 {
        match self {
            Self::Isotropic | Self::Rayleigh => 0.0,
            Self::HenyeyGreenstein(g) => *g,
            Self::Mix(parts) => parts.iter().map(|(w, p)| w * p.mean_cos()).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::chi2::{Chi2, sidak};

    fn phases() -> Vec<Phase> {
        let desc = [
            PhaseDesc::Isotropic,
            PhaseDesc::Rayleigh,
            PhaseDesc::HenyeyGreenstein { g: 0.8 },
            PhaseDesc::HenyeyGreenstein { g: -0.5 },
            PhaseDesc::HenyeyGreenstein { g: 0.01 },
            PhaseDesc::Blend {
                first: Box::new(PhaseDesc::HenyeyGreenstein { g: 0.7 }),
                second: Box::new(PhaseDesc::Blend {
                    first: Box::new(PhaseDesc::Rayleigh),
                    second: Box::new(PhaseDesc::HenyeyGreenstein { g: -0.4 }),
                    weight: 0.5,
                }),
                weight: 0.3,
            },
        ];
        desc.iter().map(Phase::new).collect()
    }

    #[test]
    fn samples_have_their_density() {
        let settings = Chi2::default();
        let directions = [Vec3::Z, Vec3::new(0.6, -0.48, 0.64), Vec3::NEG_X];
        let significance = sidak(1e-3, phases().len() * directions.len());
        for phase in phases() {
            for wo in directions {
                let outcome = settings.run(|_, u| Some(phase.sample(wo, u).wi), |wi| phase.pdf(wo, wi));
                outcome.check(&settings, significance, 2e-3, &format!("{phase:?} from {wo}"));
            }
        }
    }

    #[test]
    fn samples_tell_their_own_density_and_mean_cosine() {
        for phase in phases() {
            let wo = Vec3::new(0.36, 0.48, 0.8);
            let (mut mean, n) = (0.0, 20_000);
            for i in 0..n {
                let (_, u) = crate::testing::chi2::random(3, i);
                let s = phase.sample(wo, u);
                assert!((s.wi.length() - 1.0).abs() < 1e-5);
                assert!((s.pdf - phase.pdf(wo, s.wi)).abs() < 2e-3 * s.pdf, "{phase:?} {s:?}");
                assert!((s.weight * s.pdf - phase.eval(wo, s.wi)).abs() < 2e-3 * s.pdf);
                mean -= f64::from(s.wi.dot(wo)) / n as f64;
            }
            // The cosine's standard deviation is at most 1 / √3 for these: four standard errors.
            assert!((mean - f64::from(phase.mean_cos())).abs() < 4.0 * 0.58 / (n as f64).sqrt(), "{phase:?} {mean}");
        }
    }

    #[test]
    fn extreme_mean_cosines_give_finite_numbers() {
        for g in [0.999_99, -0.999_99] {
            let phase = Phase::new(&PhaseDesc::HenyeyGreenstein { g });
            for u in [0.0, 0.5, ONE_MINUS_EPSILON] {
                let s = phase.sample(Vec3::Z, Vec2::new(u, 0.3));
                assert!(s.pdf.is_finite() && s.pdf > 0.0 && s.wi.is_finite(), "{s:?}");
            }
        }
    }
}
