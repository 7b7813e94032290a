//! `pavement`: polyforms that pave the x-z plane.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Parameters of `pavement`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pavement {
    /// Sides of the basic polygon: 3, 4 or 6.
    pub sides: u8,
    /// Number of basic polygons in a tile, 1 to 6.
    pub tiles: u8,
    /// Which of the tiles, from 1.
    pub pattern: u8,
    /// Look of pointed corners: 0, 1, 2.
    pub exterior: u8,
    /// Look of inner corners: 0, 1, 2.
    pub interior: u8,
    /// Look of blunt corners: 0 to 3.
    pub form: u8,
}

impl Default for Pavement {
    fn default() -> Self {
        Self { sides: 4, tiles: 1, pattern: 1, exterior: 0, interior: 0, form: 0 }
    }
}

impl Pavement {
    /// The value at a point: 0 at the edges of tiles, 1 in their middle.
    pub fn value(&self, p: DVec3) -> f64 {
        let _ = p;
        0.0
    }
}
