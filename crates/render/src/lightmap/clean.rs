//! Lightmaps without noise, by Open Image Denoise.

use super::fill::Map;
use crate::denoise::{DenoiseError, DenoiseOptions, Denoiser};
use crate::image::Image;

/// Removes noise from irradiance. The normals of the texels guide it: so charts of other directions count as other surfaces, and
/// the gutters, which are filled, keep those of the same direction apart. Black texels between charts are filled beforehand as well.
///
/// # Errors
/// The denoiser's.
pub fn denoise(denoiser: &Denoiser, irradiance: &mut Map, normal: &Map) -> Result<(), DenoiseError> {
    let [width, height] = irradiance.size;
    let mut image = Image::from_rgb(width, height, &irradiance.data);
    // The library wants an albedo beside normals; that of irradiance is one.
    for name in ["albedo.R", "albedo.G", "albedo.B"] {
        image.push(name, vec![1.0; irradiance.data.len()]);
    }
    for (k, name) in ["N.X", "N.Y", "N.Z"].into_iter().enumerate() {
        image.push(name, normal.data.iter().map(|n| n[k]).collect());
    }
    denoiser.denoise(&mut image, &DenoiseOptions { prefilter: false, ..DenoiseOptions::default() })?;
    if let Some(rgb) = image.rgb() {
        irradiance.data = rgb;
    }
    Ok(())
}
