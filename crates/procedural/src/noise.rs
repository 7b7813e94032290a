//! Noise and turbulence of the three generators.

use glam::DVec3;

/// Noise in [0, 1] at a point, by generator 1, 2 or 3.
pub fn noise(p: DVec3, generator: u8) -> f64 {
    let _ = (p, generator);
    0.5
}

/// Vector-valued noise: three numbers, each about in [−1, 1].
pub fn vector_noise(p: DVec3, generator: u8) -> DVec3 {
    let _ = (p, generator);
    DVec3::ZERO
}

/// Parameters of turbulence.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Turbulence {
    /// Number of octaves, 1 to 10.
    pub octaves: u32,
    /// Frequency ratio of successive octaves.
    pub lambda: f64,
    /// Amplitude ratio of successive octaves.
    pub omega: f64,
}

impl Default for Turbulence {
    fn default() -> Self {
        Self { octaves: 6, lambda: 2.0, omega: 0.5 }
    }
}

/// Sum of octaves of [`noise`].
pub fn turbulence(p: DVec3, t: &Turbulence, generator: u8) -> f64 {
    let _ = (p, t, generator);
    0.0
}

/// Sum of octaves of [`vector_noise`].
pub fn vector_turbulence(p: DVec3, t: &Turbulence, generator: u8) -> DVec3 {
    let _ = (p, t, generator);
    DVec3::ZERO
}
