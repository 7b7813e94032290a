//! What is inside of objects.

use std::sync::Arc;

use etendue_procedural::Pigment;
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// How media scatter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scattering {
    /// Phase function: 1 isotropic, 2 Mie haze, 3 Mie murky, 4 Rayleigh, 5 Henyey–Greenstein.
    pub phase: u8,
    /// Color of the scattered light per unit of length.
    pub color: DVec3,
    /// Eccentricity of Henyey and Greenstein's function.
    pub eccentricity: f64,
    /// How much of the scattered light is taken away from the ray: 1 is physical.
    pub extinction: f64,
}

/// `media`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Media {
    /// Sampling method, 1 to 3.
    pub method: u8,
    /// Intervals along a ray.
    pub intervals: u32,
    /// Fewest and most samples in an interval.
    pub samples: [u32; 2],
    /// Probability that a sum is within the tolerance when sampling stops early.
    pub confidence: f64,
    /// The tolerance.
    pub variance: f64,
    /// Share of samples in lit intervals.
    pub ratio: f64,
    /// Random shift of samples.
    pub jitter: f64,
    /// Difference that asks for samples between (method 3).
    pub aa_threshold: f64,
    /// How often samples are put between (method 3).
    pub aa_level: u32,
    /// Light taken away per unit of length.
    pub absorption: DVec3,
    /// Light given per unit of length.
    pub emission: DVec3,
    /// Scattering.
    pub scattering: Option<Scattering>,
    /// Densities; they multiply. None: 1 everywhere.
    pub densities: Vec<Arc<Pigment>>,
    /// Photons stay in it.
    pub collect_photons: bool,
}

impl Default for Media {
    fn default() -> Self {
        Self {
            method: 3,
            intervals: 1,
            samples: [10, 10],
            confidence: 0.9,
            variance: 1.0 / 128.0,
            ratio: 0.9,
            jitter: 0.0,
            aa_threshold: 0.1,
            aa_level: 3,
            absorption: DVec3::ZERO,
            emission: DVec3::ZERO,
            scattering: None,
            densities: Vec::new(),
            collect_photons: true,
        }
    }
}

impl Media {
    /// Moves the densities.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        for density in &mut self.densities {
            Arc::make_mut(density).transform(world_from_old);
        }
    }
}

/// `interior`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interior {
    /// Index of refraction.
    pub ior: f64,
    /// Ratio of the indices for violet and red; 1 for none.
    pub dispersion: f64,
    /// Colors into which light is split.
    pub dispersion_samples: u32,
    /// Strength of the brightening of shadows that stands for caustics; 0 for none.
    pub caustics: f64,
    /// Depth at which half of the light is gone; 0 for no fading.
    pub fade_distance: f64,
    /// Exponent of fading, exponential from 1000; 0 for none.
    pub fade_power: f64,
    /// Color that the faded light keeps.
    pub fade_color: DVec3,
    /// Factor of refracted light (`refraction` of old scenes).
    pub refraction: f64,
    /// Media.
    pub media: Vec<Media>,
}

impl Default for Interior {
    fn default() -> Self {
        Self {
            ior: 1.0,
            dispersion: 1.0,
            dispersion_samples: 7,
            caustics: 0.0,
            fade_distance: 0.0,
            fade_power: 0.0,
            fade_color: DVec3::ZERO,
            refraction: 1.0,
            media: Vec::new(),
        }
    }
}

impl Interior {
    /// Moves the media's densities with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.media.iter_mut().for_each(|m| m.transform(world_from_old));
    }
}
