//! `tiling`: 27 tilings of the x-z plane.

use glam::DVec3;

/// The value of a tiling at a point.
pub(super) fn value(p: DVec3, number: u8) -> f64 {
    let _ = (p, number);
    0.0
}
