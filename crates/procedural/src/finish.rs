//! How a surface answers light in the classic model.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The finish of a layer. Defaults are those of scenes of version 3.7.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finish {
    /// Light of the ambient term, multiplied by the scene's `ambient_light`.
    pub ambient: DVec3,
    /// Light that the surface gives by itself.
    pub emission: DVec3,
    /// Lambert reflection.
    pub diffuse: f64,
}

impl Default for Finish {
    fn default() -> Self {
        Self { ambient: DVec3::splat(0.1), emission: DVec3::ZERO, diffuse: 0.6 }
    }
}
