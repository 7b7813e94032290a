//! How a surface answers light in the classic model (documentation, "Finish").

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The finish of a layer. Defaults are those of scenes of version 3.7.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finish {
    /// Light of the ambient term, multiplied by the scene's `ambient_light`.
    pub ambient: DVec3,
    /// Light that the surface gives by itself.
    pub emission: DVec3,
    /// Lambert reflection of light from the viewer's side.
    pub diffuse: f64,
    /// Lambert reflection of light from the other side.
    pub diffuse_back: f64,
    /// `diffuse albedo`: both values are total, not peak, reflectance.
    pub diffuse_albedo: bool,
    /// Exponent of the cosine of the diffuse term.
    pub brilliance: f64,
    /// Largest random darkening of the diffuse term.
    pub crand: f64,
    /// Phong highlight.
    pub phong: f64,
    /// Exponent of the Phong highlight.
    pub phong_size: f64,
    /// `phong albedo`: `phong` is total, not peak, reflectance.
    pub phong_albedo: bool,
    /// Blinn highlight.
    pub specular: f64,
    /// Roughness of the Blinn highlight; its exponent is 1 / roughness. Never 0.
    pub roughness: f64,
    /// `specular albedo`: `specular` is total, not peak, reflectance.
    pub specular_albedo: bool,
    /// Share of the pigment in the color of highlights.
    pub metallic: f64,
    /// Mirror reflection.
    pub reflection: Reflection,
    /// Filter and transmit are multiplied by what reflection leaves.
    pub conserve_energy: bool,
    /// Thin film.
    pub irid: Option<Irid>,
    /// `subsurface { translucency }`.
    pub translucency: Option<DVec3>,
    /// `use_alpha`: opacity of the pigment scales diffuse and specular terms.
    pub use_alpha: bool,
    /// What old scenes say here and newer ones in `interior`.
    pub old_interior: OldInterior,
}

/// Mirror reflection: `reflection { min, max … }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reflection {
    /// Reflectance for a view along the normal.
    pub min: DVec3,
    /// Reflectance at grazing view.
    pub max: DVec3,
    /// Reflectance by Fresnel's equations with the interior's index instead of the falloff.
    pub fresnel: bool,
    /// Exponent of the passage from `min` to `max`.
    pub falloff: f64,
    /// Exponent of the reflected intensity.
    pub exponent: f64,
    /// Share of the pigment in the color of the reflection.
    pub metallic: f64,
}

impl Default for Reflection {
    fn default() -> Self {
        Self { min: DVec3::ZERO, max: DVec3::ZERO, fresnel: false, falloff: 1.0, exponent: 1.0, metallic: 0.0 }
    }
}

/// Thin film interference: `irid { amount thickness turbulence }`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Irid {
    /// Contribution.
    pub amount: f64,
    /// Thickness of the film, in micrometers.
    pub thickness: f64,
    /// Turbulence of the thickness.
    pub turbulence: f64,
}

/// Items of `interior` that scenes before version 3.1 have in `finish`; `None` where they are not said.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OldInterior {
    /// Index of refraction.
    pub ior: Option<f64>,
    /// `refraction`: whether, and how much, light is refracted.
    pub refraction: Option<f64>,
    /// Simulated caustics.
    pub caustics: Option<f64>,
    /// Distance of half attenuation.
    pub fade_distance: Option<f64>,
    /// Exponent of attenuation.
    pub fade_power: Option<f64>,
}

impl Default for Finish {
    fn default() -> Self {
        Self {
            ambient: DVec3::splat(0.1),
            emission: DVec3::ZERO,
            diffuse: 0.6,
            diffuse_back: 0.0,
            diffuse_albedo: false,
            brilliance: 1.0,
            crand: 0.0,
            phong: 0.0,
            phong_size: 40.0,
            phong_albedo: false,
            specular: 0.0,
            roughness: 0.05,
            specular_albedo: false,
            metallic: 0.0,
            reflection: Reflection::default(),
            conserve_energy: false,
            irid: None,
            translucency: None,
            use_alpha: false,
            old_interior: OldInterior::default(),
        }
    }
}
