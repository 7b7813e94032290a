//! Pictures in formats that few programs read, as PNG.

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageFormat};

use super::ktx2::is_ktx2;
use super::read::ReadLimits;
use super::{ImageError, TexelData, Texels};

/// Whether a file's bytes are a picture that renderers other than this one and players of glTF do not read: KTX2, WebP, TIFF, and GIF where
/// `gif` says so. TIFF in floating point is none of them: PNG could not hold it.
pub fn is_rare(bytes: &[u8], gif: bool) -> bool {
    is_ktx2(bytes)
        || match image::guess_format(bytes) {
            Ok(ImageFormat::WebP | ImageFormat::Tiff) => true,
            Ok(ImageFormat::Gif) => gif,
            _ => false,
        }
}

/// The largest level of such a picture as the bytes of a PNG file: the numbers are the same, so that they mean what they meant before.
///
/// # Errors
/// [`ImageError`] of the reader; [`ImageError::Unsupported`] for numbers in floating point.
pub fn png_bytes(bytes: &[u8]) -> Result<Vec<u8>, ImageError> {
    let texels = Texels::from_bytes(bytes, None, None, ReadLimits::default())?;
    let (numbers, wide): (Vec<u8>, bool) = match texels.data {
        TexelData::U8(v) => (v, false),
        // In the byte order of this machine, as the encoder wants it.
        TexelData::U16(v) => (v.into_iter().flat_map(u16::to_ne_bytes).collect(), true),
        TexelData::F16(_) | TexelData::F32(_) => return Err(ImageError::Unsupported("numbers in floating point for a PNG".into())),
    };
    let color = match (texels.channels, wide) {
        (1, false) => ExtendedColorType::L8,
        (2, false) => ExtendedColorType::La8,
        (3, false) => ExtendedColorType::Rgb8,
        (_, false) => ExtendedColorType::Rgba8,
        (1, true) => ExtendedColorType::L16,
        (2, true) => ExtendedColorType::La16,
        (3, true) => ExtendedColorType::Rgb16,
        (_, true) => ExtendedColorType::Rgba16,
    };
    let mut out = Vec::new();
    let encoded = PngEncoder::new(&mut out).write_image(&numbers, texels.width, texels.height, color);
    encoded.map_err(|e| ImageError::Unsupported(e.to_string()))?;
    Ok(out)
}
