//! `global_settings`.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// `global_settings`, with POV-Ray 3.7's defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GlobalSettings {
    /// Exponent of the scene's working color space: 1 is linear.
    pub assumed_gamma: f64,
    /// The working color space follows the sRGB transfer function instead of a power.
    pub assumed_srgb: bool,
    /// The scene says its `assumed_gamma`; without it, pictures are read and written as old versions did.
    pub gamma_given: bool,
    /// Language version at the end of the file: 3.7 is 370.
    pub version: u32,
    /// Recursion level.
    pub max_trace_level: u32,
    /// Rays that carry less are not followed.
    pub adc_bailout: f64,
    /// Factor of all ambient terms.
    pub ambient_light: DVec3,
    /// Noise generator: 1, 2 or 3.
    pub noise_generator: u8,
    /// Wavelengths of red, green and blue for iridescence, in micrometers.
    pub irid_wavelength: DVec3,
    /// Waves in `waves` and `ripples`.
    pub number_of_waves: u32,
    /// Millimeters to a unit, for subsurface scattering.
    pub mm_per_unit: f64,
    /// Radiosity, where it is on.
    pub radiosity: Option<Radiosity>,
    /// Photons, where they are on.
    pub photons: Option<Photons>,
    /// Subsurface scattering, where it is on.
    pub subsurface: Option<Subsurface>,
}

impl Default for GlobalSettings {
    fn default() -> Self {
        Self {
            assumed_gamma: 1.0,
            assumed_srgb: false,
            gamma_given: false,
            version: 370,
            max_trace_level: 5,
            adc_bailout: 1.0 / 255.0,
            ambient_light: DVec3::ONE,
            noise_generator: 2,
            irid_wavelength: DVec3::new(0.70, 0.52, 0.48),
            number_of_waves: 10,
            mm_per_unit: 10.0,
            radiosity: None,
            photons: None,
            subsurface: None,
        }
    }
}

/// `radiosity`: light between diffuse surfaces, gathered at scattered points and interpolated (Ward et al. 1988).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Radiosity {
    /// Gathering rays that carry less are not followed.
    pub adc_bailout: f64,
    /// New points are gathered while the picture is made.
    pub always_sample: bool,
    /// Factor of gathered light.
    pub brightness: f64,
    /// Rays gathered at a point.
    pub count: u32,
    /// Directions to choose from; 0: as many as `count`.
    pub directions: u32,
    /// Tolerated error.
    pub error_bound: f64,
    /// Share of gray in gathered light.
    pub gray_threshold: f64,
    /// Factor of the error bound before the picture is made.
    pub low_error_factor: f64,
    /// Brightest gathered light; 0 or less for any.
    pub max_sample: f64,
    /// Longest reuse distance as a share of the picture's width.
    pub maximum_reuse: f64,
    /// Shortest reuse distance as a share of the picture's width.
    pub minimum_reuse: f64,
    /// Points to interpolate from.
    pub nearest_count: u32,
    /// Media take part.
    pub media: bool,
    /// Perturbed normals take part.
    pub normal: bool,
    /// Subsurface scattering takes part.
    pub subsurface: bool,
    /// Coarsest grid of the prepass, as a share of the picture.
    pub pretrace_start: f64,
    /// Finest grid of the prepass, as a share of the picture.
    pub pretrace_end: f64,
    /// Bounces.
    pub recursion_limit: u32,
}

impl Default for Radiosity {
    fn default() -> Self {
        Self {
            adc_bailout: 0.01,
            always_sample: false,
            brightness: 1.0,
            count: 35,
            directions: 0,
            error_bound: 1.8,
            gray_threshold: 0.0,
            low_error_factor: 0.5,
            max_sample: -1.0,
            maximum_reuse: 0.2,
            minimum_reuse: 0.015,
            nearest_count: 5,
            media: false,
            normal: false,
            subsurface: false,
            pretrace_start: 0.08,
            pretrace_end: 0.04,
            recursion_limit: 2,
        }
    }
}

/// `photons` of the global settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Photons {
    /// Distance of photons on surfaces; 0 where `count` rules.
    pub spacing: f64,
    /// About so many photons; 0 where `spacing` rules.
    pub count: u32,
    /// Fewest and most photons gathered at a point.
    pub gather: [u32; 2],
    /// Most photons left in media along a ray; 0 for none.
    pub media: u32,
    /// Spacing in media as a multiple of that on surfaces.
    pub media_factor: f64,
    /// Random shift of the rays.
    pub jitter: f64,
    /// Recursion level; `None`: the scene's.
    pub max_trace_level: Option<u32>,
    /// Photons that carry less are dropped; `None`: the scene's.
    pub adc_bailout: Option<f64>,
    /// Share of a target after which shooting may stop.
    pub autostop: f64,
    /// Growth of the search radius and its lower limit.
    pub expand_thresholds: [f64; 2],
    /// Search radius and its factor on surfaces, then in media; 0 guesses.
    pub radius: [f64; 4],
}

impl Default for Photons {
    fn default() -> Self {
        Self {
            spacing: 0.0,
            count: 0,
            gather: [20, 100],
            media: 0,
            media_factor: 1.0,
            jitter: 0.4,
            max_trace_level: None,
            adc_bailout: None,
            autostop: 1.0,
            expand_thresholds: [0.2, 40.0],
            radius: [0.0, 1.0, 0.0, 1.0],
        }
    }
}

/// `subsurface` of the global settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Subsurface {
    /// Samples of diffuse and of single scattering.
    pub samples: [u32; 2],
    /// Gathered light is scattered too.
    pub radiosity: bool,
}

impl Default for Subsurface {
    fn default() -> Self {
        Self { samples: [50, 50], radiosity: false }
    }
}
