//! KTX2 files with Basis Universal pictures (ETC1S and UASTC), as glTF's KHR_texture_basisu has them; other KTX2 files are for graphics
//! cards alone. Transcoded to RGBA by the crate `basisu`.

use basisu::{DecodeFlags, TargetFormat, Transcoder};

use super::read::ReadLimits;
use super::{ImageError, TexelData};

/// True where the bytes start as a KTX2 file does (KTX 2.0, section 3.1).
pub(super) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\xABKTX 20\xBB\r\n\x1A\n")
}

/// Width, height, channels and the texels of the largest level. The header's fields are those of KTX 2.0, section 3.
pub(super) fn read_ktx2(bytes: &[u8], limits: ReadLimits) -> Result<(u32, u32, u32, TexelData), ImageError> {
    let word = |at: usize| bytes.get(at..at + 4).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let (width, height) = (word(20), word(24));
    let size = u64::from(width) * u64::from(height) * 4;
    if width == 0 || height == 0 {
        return Err(ImageError::Unsupported("a KTX2 file that is no picture with rows and columns".into()));
    }
    if width.max(height) > limits.max_side || size > limits.max_bytes {
        return Err(ImageError::TooLarge { width: width.into(), height: height.into() });
    }
    // The decoder takes what the file claims: a level of plain blocks is never longer than 16 bytes for each 4 × 4 texels.
    let blocks = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
    let claimed = u64::from(word(96)) | u64::from(word(100)) << 32;
    if word(28) > 0 || word(32) > 1 || word(36) != 1 || word(40) > 32 || claimed > 16 * blocks {
        return Err(ImageError::Unsupported("a KTX2 file with layers, faces or levels that a texture has not".into()));
    }
    let fail = |e: basisu::Error| ImageError::Unsupported(format!("this KTX2 file ({e:?}); those with Basis Universal pictures are read"));
    let transcoder = Transcoder::new(bytes).map_err(fail)?;
    let texels = transcoder.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(fail)?;
    if texels.len() as u64 != size {
        return Err(ImageError::Invalid("the KTX2 file has too few texels".into()));
    }
    if transcoder.has_alpha() {
        return Ok((width, height, 4, TexelData::U8(texels)));
    }
    Ok((width, height, 3, TexelData::U8(texels.as_chunks::<4>().0.iter().flat_map(|t| [t[0], t[1], t[2]]).collect())))
}
