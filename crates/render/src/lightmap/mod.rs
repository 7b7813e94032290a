//! Light on surfaces: what view-independent methods leave, and what is baked.
//!
//! Radiosity and particle tracing solve a static scene once. What they find is a [`SurfaceLight`]: anyone may ask it for the
//! irradiance at a point of a surface, be it a camera ray, a texel of a lightmap or a lux meter.

use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Light that arrives at surfaces, solved beforehand.
pub trait SurfaceLight: Send + Sync {
    /// Irradiance in W·m⁻² at a surface point, on the side to which its shading normal points. Direct light is included.
    fn irradiance(&self, scene: &Scene, surface: &Surface) -> Spectrum;
}
