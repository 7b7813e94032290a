//! What fills closed shapes.
//!
//! Absorption is computed (Beer–Lambert); scattering and emission are not yet, and the compiler reports media that have them.

use etendue_scene::desc::MediumDesc;

use crate::math::fns;
use crate::spectrum::Spectrum;

/// A homogeneous medium that absorbs.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    /// Absorption per unit of length.
    pub sigma_a: Spectrum,
}

impl Medium {
    /// From a description; scattering counts as not being there.
    pub fn new(desc: &MediumDesc) -> Self {
        match desc {
            MediumDesc::Homogeneous { sigma_a, .. } => Self { sigma_a: Spectrum::from_rgb(*sigma_a) },
        }
    }

    /// The share of light that passes a distance.
    #[inline]
    pub fn transmittance(&self, distance: f32) -> Spectrum {
        self.sigma_a.map(|a| if a > 0.0 { fns::exp(-a * distance) } else { 1.0 })
    }
}
