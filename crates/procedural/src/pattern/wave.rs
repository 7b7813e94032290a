//! Frequency, phase and wave forms (documentation, "Frequency and Phase" and "Waveforms").

use serde::{Deserialize, Serialize};

use super::PatternKind;
use crate::fns;

/// What a raw value goes through.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wave {
    /// Number of repetitions.
    pub frequency: f64,
    /// Shift, added after the frequency.
    pub phase: f64,
    /// Form of one repetition.
    pub form: WaveForm,
}

/// Wave forms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum WaveForm {
    /// Rises.
    #[default]
    Ramp,
    /// Rises and falls.
    Triangle,
    /// Sine, from 1/2.
    Sine,
    /// Half sine.
    Scallop,
    /// Smooth step.
    Cubic,
    /// Power with an exponent.
    Poly(f64),
}

impl Default for Wave {
    fn default() -> Self {
        Self { frequency: 1.0, phase: 0.0, form: WaveForm::Ramp }
    }
}

/// POV-Ray's remainders are to this divisor: so the value 1 stays 1. Measured: `gradient x` at −1.47 is 0.53001.
const PERIOD: f64 = 1.000_01;

impl Wave {
    /// The wave form that a pattern has when none is said.
    pub fn of(kind: &PatternKind) -> Self {
        let form = match kind {
            PatternKind::Marble | PatternKind::Wood | PatternKind::Spiral1(_) | PatternKind::Spiral2(_) => WaveForm::Triangle,
            _ => WaveForm::Ramp,
        };
        Self { form, ..Self::default() }
    }

    /// The value for a raw value; 0 for one that is not finite.
    pub fn apply(&self, raw: f64) -> f64 {
        let mut v = raw * self.frequency + self.phase;
        if !(0.0..PERIOD).contains(&v) {
            v %= PERIOD;
            if v < 0.0 {
                v += 1.0;
            }
            if !v.is_finite() {
                return 0.0;
            }
        }
        match self.form {
            WaveForm::Ramp => v,
            WaveForm::Triangle => triangle(v),
            WaveForm::Sine => (1.0 + fns::sin(v * std::f64::consts::TAU)) * 0.5,
            WaveForm::Scallop => fns::sin(v * std::f64::consts::PI).abs(),
            WaveForm::Cubic => v * v * (3.0 - 2.0 * v),
            WaveForm::Poly(exponent) => fns::pow(v, exponent),
        }
    }
}

/// Triangle wave of period 1: 0 at 0, 1 at 1/2.
pub(super) fn triangle(v: f64) -> f64 {
    let v = v - v.floor();
    if v < 0.5 { 2.0 * v } else { 2.0 * (1.0 - v) }
}
