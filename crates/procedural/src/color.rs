//! Colors with two kinds of transparency.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A color in the scene's working space (linear unless `assumed_gamma` says otherwise) with transparency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Color {
    /// Red, green, blue; any finite numbers.
    pub rgb: DVec3,
    /// Share of light that passes and takes on the color.
    pub filter: f64,
    /// Share of light that passes unchanged.
    pub transmit: f64,
}

impl Color {
    /// An opaque color.
    pub const fn rgb(r: f64, g: f64, b: f64) -> Self {
        Self { rgb: DVec3::new(r, g, b), filter: 0.0, transmit: 0.0 }
    }

    /// What light is multiplied by as it passes: rgb · filter + transmit.
    pub fn passing(&self) -> DVec3 {
        self.rgb * self.filter + DVec3::splat(self.transmit)
    }

    /// Share of the surface that is opaque: 1 − filter − transmit.
    pub fn opacity(&self) -> f64 {
        1.0 - self.filter - self.transmit
    }

    /// Component-wise interpolation: `self` at t = 0, `other` at t = 1.
    pub fn lerp(&self, other: &Self, t: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * t;
        Self {
            rgb: self.rgb + (other.rgb - self.rgb) * t,
            filter: mix(self.filter, other.filter),
            transmit: mix(self.transmit, other.transmit),
        }
    }
}
