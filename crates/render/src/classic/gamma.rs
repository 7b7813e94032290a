//! The working space of a scene: what its color numbers mean.
//!
//! `assumed_gamma` names the space in which POV-Ray computes; the picture is converted from it to the file's. Scenes of versions before
//! 3.7 without the keyword are written as they were computed, which shows as sRGB (both measured).

use etendue_procedural::fns;
use etendue_scene::desc::classic::GlobalSettings;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// How numbers of the working space become linear light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum WorkingSpace {
    /// As they are.
    #[default]
    Linear,
    /// By a power.
    Power(f64),
    /// Through the sRGB transfer function.
    Srgb,
}

impl WorkingSpace {
    /// The space of a scene.
    pub fn new(settings: &GlobalSettings) -> Self {
        if settings.assumed_srgb {
            Self::Srgb
        } else if settings.gamma_given {
            if settings.assumed_gamma == 1.0 { Self::Linear } else { Self::Power(settings.assumed_gamma) }
        } else if settings.version < 370 {
            Self::Srgb
        } else {
            Self::Linear
        }
    }

    /// Linear light of a number; odd for negative ones.
    pub fn linear(self, v: f64) -> f64 {
        match self {
            Self::Linear => v,
            Self::Power(g) => fns::pow_about(v.abs(), g).copysign(v),
            Self::Srgb => linear_from_srgb(v),
        }
    }

    /// Linear light of a color.
    pub fn linear_rgb(self, c: DVec3) -> DVec3 {
        if self == Self::Linear { c } else { DVec3::new(self.linear(c.x), self.linear(c.y), self.linear(c.z)) }
    }

    /// The number for linear light; odd for negative ones.
    pub fn from_linear(self, v: f64) -> f64 {
        match self {
            Self::Linear => v,
            Self::Power(g) => fns::pow_about(v.abs(), 1.0 / g).copysign(v),
            Self::Srgb => srgb_from_linear(v),
        }
    }
}

/// A linear value from an sRGB one; odd for negative ones.
pub(super) fn linear_from_srgb(v: f64) -> f64 {
    let a = v.abs();
    (if a <= 0.040_45 { a / 12.92 } else { fns::pow_about((a + 0.055) / 1.055, 2.4) }).copysign(v)
}

/// An sRGB value from a linear one; odd for negative ones.
pub(super) fn srgb_from_linear(v: f64) -> f64 {
    let a = v.abs();
    (if a <= 0.003_130_8 { a * 12.92 } else { 1.055 * fns::pow_about(a, 1.0 / 2.4) - 0.055 }).copysign(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spaces_round_trip_and_follow_the_version() {
        for space in [WorkingSpace::Linear, WorkingSpace::Power(2.2), WorkingSpace::Srgb] {
            for v in [-0.5, 0.0, 0.001, 0.5, 1.0, 7.0] {
                assert!((space.from_linear(space.linear(v)) - v).abs() < 1e-9, "{space:?} {v}");
            }
        }
        // Measured: rgb 0.5 becomes 187.5 with version 3.7 and 127.5 without version and assumed_gamma.
        let new = GlobalSettings::default();
        assert_eq!(WorkingSpace::new(&new), WorkingSpace::Linear);
        let old = GlobalSettings { version: 360, ..GlobalSettings::default() };
        assert_eq!(WorkingSpace::new(&old), WorkingSpace::Srgb);
        let given = GlobalSettings { version: 360, gamma_given: true, ..GlobalSettings::default() };
        assert_eq!(WorkingSpace::new(&given), WorkingSpace::Linear);
    }
}
