//! Lighting reports: how many lux arrive where, how many candela per square meter leave, and how evenly.
//!
//! Photometry, written down once: the lanes of radiance and irradiance are linear Rec. 709 in W·m⁻²(·sr⁻¹), scaled so that their luminance
//! Y = 0.2127 R + 0.7152 G + 0.0722 B, times 683 lm/W (the efficacy at 555 nm), is in photometric units: a radiance gives 683 Y cd·m⁻², an
//! irradiance 683 Y lx (the reader of glTF turns candela and lux into watts by the same number). Scenes whose numbers mean something else
//! (candela and lux themselves, or Radiance's watts, of which 1 W of white is 179 lm) ask for another factor than [`EFFICACY`].

mod false_color;
mod glyphs;
mod grid;
mod sensors;

pub use false_color::{FalseColor, Scale, false_color};
pub use grid::{GridError, SensorGrid};
pub use sensors::{Reading, SensorOptions, Summary, measure};

use crate::spectrum::Spectrum;

/// Lumens per watt at 555 nm: what the lanes' luminance is multiplied by.
pub const EFFICACY: f64 = 683.0;

/// Lux of an irradiance in W·m⁻², or cd·m⁻² of a radiance in W·m⁻²·sr⁻¹.
pub fn photometric(value: Spectrum, efficacy: f64) -> f64 {
    f64::from(value.luminance()) * efficacy
}
