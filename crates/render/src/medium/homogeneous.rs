//! Media that are the same everywhere: everything in closed form.

use super::{Flight, Phase};
use crate::math::fns;
use crate::spectrum::Spectrum;

/// A homogeneous medium.
#[derive(Clone, Debug)]
pub struct Homogeneous {
    /// Absorption plus scattering per unit of length.
    pub sigma_t: Spectrum,
    /// Scattering per unit of length.
    pub sigma_s: Spectrum,
    /// Emitted radiance per unit of length.
    pub emission: Spectrum,
    /// Phase function.
    pub phase: Phase,
    /// Whether any lane scatters.
    pub scatters: bool,
}

impl Homogeneous {
    /// From coefficients for R, G, B.
    pub fn new(sigma_a: [f32; 3], sigma_s: [f32; 3], emission: [f32; 3], phase: Phase) -> Self {
        let sigma_t = Spectrum::from_rgb([0, 1, 2].map(|c| sigma_a[c] + sigma_s[c]));
        let sigma_s = Spectrum::from_rgb(sigma_s);
        Self { sigma_t, sigma_s, emission: Spectrum::from_rgb(emission), phase, scatters: !sigma_s.is_black() }
    }

    /// The share of light that passes a distance, which may be infinite (Beer–Lambert).
    #[inline]
    pub fn transmittance(&self, distance: f32) -> Spectrum {
        self.sigma_t.map(|a| if a > 0.0 { fns::exp(-a * distance) } else { 1.0 })
    }

    /// What a segment emits towards its start: ∫ exp(−σt t) dt times the emission. Lanes without extinction that go on for ever would
    /// emit infinitely much: they count as nothing.
    #[inline]
    pub fn emitted(&self, distance: f32) -> Spectrum {
        if self.emission.is_black() {
            return Spectrum::ZERO;
        }
        let length = self.sigma_t.map(|s| if s > 0.0 { -fns::exp_m1(-s * distance) / s } else { distance });
        self.emission.zip(length, |e, l| if e > 0.0 && (e * l).is_finite() { e * l } else { 0.0 })
    }

    /// Probabilities with which lanes are sampled: by the throughput, so that what carries light decides.
    #[inline]
    pub fn lanes(throughput: Spectrum) -> Spectrum {
        let t = Spectrum([throughput.0[0], throughput.0[1], throughput.0[2], 0.0]).map(|v| v.max(0.0));
        let sum = t.0[0] + t.0[1] + t.0[2];
        if sum > 0.0 && sum.is_finite() { t / sum } else { Spectrum::from_rgb([1.0 / 3.0; 3]) }
    }

    /// The density with which [`Self::sample_flight`] returns a distance before `t_max`, for the same lane probabilities.
    #[inline]
    pub fn pdf_flight(&self, t: f32, lanes: Spectrum) -> f32 {
        let each = lanes * self.sigma_t * self.transmittance(t);
        each.0[0] + each.0[1] + each.0[2]
    }

    /// The probability with which [`Self::sample_flight`] crosses a segment.
    #[inline]
    pub fn probability_to_pass(&self, t_max: f32, lanes: Spectrum) -> f32 {
        let each = lanes * self.transmittance(t_max);
        each.0[0] + each.0[1] + each.0[2]
    }

    /// See [`super::Medium::sample_flight`]. One lane is sampled, and the others take part by the balance heuristic (as in the
    /// single-sample model of Veach 1997, section 9.2.4).
    #[inline]
    pub fn sample_flight(&self, t_max: f32, throughput: Spectrum, u: f32) -> Flight {
        let lanes = Self::lanes(throughput);
        let (mut lane, mut rest) = (0, u);
        while lane < 2 && (rest >= lanes.0[lane] || lanes.0[lane] == 0.0) {
            rest -= lanes.0[lane];
            lane += 1;
        }
        let emitted = self.emitted(t_max);
        let sigma = self.sigma_t.0[lane];
        let v = if lanes.0[lane] > 0.0 { (rest / lanes.0[lane]).clamp(0.0, crate::math::ONE_MINUS_EPSILON) } else { 0.0 };
        let t = if sigma > 0.0 { -fns::ln_1p(-v) / sigma } else { f32::INFINITY };
        if t < t_max {
            let pdf = self.pdf_flight(t, lanes);
            let weight = if pdf > 0.0 { self.sigma_s * self.transmittance(t) / pdf } else { Spectrum::ZERO };
            Flight { scattered_at: Some(t), weight, emitted }
        } else {
            let pass = self.probability_to_pass(t_max, lanes);
            let weight = if pass > 0.0 { self.transmittance(t_max) / pass } else { Spectrum::ZERO };
            Flight { scattered_at: None, weight, emitted }
        }
    }
}
