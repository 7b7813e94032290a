//! From the description's textures and images to [`Texture`]s.

use std::collections::HashMap;
use std::sync::Arc;

use etendue_scene::desc::{Encoding, ImageDesc, ImageId, ImageSource, SceneDesc, TextureDesc, TextureFilter};
use etendue_scene::{Fault, Severity, Span};
use rayon::prelude::*;

use super::{Bitmap, Projected, Solid, Texture, pyramid};
use crate::image::{ColorEncoding, ReadLimits, TexelData, Texels};
use crate::scene::Names;
use crate::spectrum::Spectrum;

/// Decodes all pictures that textures use, in parallel, and makes the textures; with pyramids for trilinear ones if `mipmap` is set.
///
/// # Errors
/// A fault for each picture that cannot be read.
pub fn compile(desc: &SceneDesc, names: &mut Names, mipmap: bool) -> Result<Vec<Texture>, Vec<Fault>> {
    // A picture may be wanted in two encodings; each is decoded once.
    let mut wanted: Vec<(ImageId, Encoding)> = desc
        .textures
        .iter()
        .filter_map(|t| if let TextureDesc::Bitmap(b) = &t.value { Some((b.image, b.encoding)) } else { None })
        .collect();
    wanted.sort_by_key(|(id, encoding)| (*id, *encoding as u8));
    wanted.dedup();
    let decoded: Vec<_> = wanted.par_iter().map(|&(id, encoding)| decode(desc, id, encoding).map(|t| picture(t, mipmap))).collect();
    let mut pictures = HashMap::new();
    let mut faults = Vec::new();
    for ((id, encoding), result) in wanted.into_iter().zip(decoded) {
        match result {
            Ok(texels) => {
                pictures.insert((id, encoding as u8), texels);
            }
            Err(message) => faults.push(Fault { severity: Severity::Error, span: image_span(desc, id), message }),
        }
    }
    if !faults.is_empty() {
        return Err(faults);
    }
    Ok(desc.textures.iter().map(|node| texture(&node.value, &pictures, names)).collect())
}

/// A decoded picture, shared by the textures that show it.
struct Picture {
    texels: Arc<Texels>,
    levels: Arc<[Texels]>,
}

fn picture(texels: Texels, mipmap: bool) -> Picture {
    let levels = if mipmap { pyramid::levels(&texels) } else { Vec::new() };
    Picture { texels: Arc::new(texels), levels: levels.into() }
}

fn image_span(desc: &SceneDesc, id: ImageId) -> Span {
    desc[id].span
}

fn texture(desc: &TextureDesc, pictures: &HashMap<(ImageId, u8), Picture>, names: &mut Names) -> Texture {
    match desc {
        TextureDesc::Constant { value } => Texture::Constant(Spectrum::from_rgb(*value)),
        TextureDesc::Bitmap(b) => match pictures.get(&(b.image, b.encoding as u8)) {
            Some(picture) => Texture::Bitmap(Box::new(Bitmap {
                texels: Arc::clone(&picture.texels),
                levels: if b.filter == TextureFilter::Trilinear { Arc::clone(&picture.levels) } else { Arc::default() },
                wrap: b.wrap,
                filter: b.filter,
                picture_from_uv: b.picture_from_uv,
                channel: b.channel,
                uv_attribute: (b.uv_set > 0).then(|| names.intern(&format!("uv{}", b.uv_set))),
            })),
            None => Texture::Constant(Spectrum::ZERO),
        },
        TextureDesc::Checkerboard { color0, color1, pattern_from_uv } => {
            Texture::Checkerboard { color0: *color0, color1: *color1, pattern_from_uv: *pattern_from_uv }
        }
        TextureDesc::Attribute { name, scale } => Texture::Attribute { name: names.intern(name), scale: *scale },
        TextureDesc::Multiply { a, b } => Texture::Multiply(*a, *b),
        TextureDesc::Mix { a, b, weight } => Texture::Mix(*a, *b, *weight),
        TextureDesc::Solid { pattern, space } => Texture::Solid(Box::new(Solid { pattern: *pattern, space: *space })),
        TextureDesc::Projected { texture, projection, pattern_from_world } => {
            Texture::Projected(Box::new(Projected { texture: *texture, projection: *projection, pattern_from_world: *pattern_from_world }))
        }
        TextureDesc::Facing { direction } => Texture::Facing { direction: *direction },
        TextureDesc::Power { texture, exponent } => Texture::Power { texture: *texture, exponent: *exponent },
        TextureDesc::Affine { texture, scale, offset, clamp } => {
            Texture::Affine { texture: *texture, scale: *scale, offset: *offset, clamp: *clamp }
        }
    }
}

/// Reads a picture of the description in the precision of its file.
///
/// # Errors
/// A sentence on why not.
pub fn decode(desc: &SceneDesc, id: ImageId, encoding: Encoding) -> Result<Texels, String> {
    let color = match encoding {
        Encoding::Auto => None,
        Encoding::Linear => Some(ColorEncoding::Linear),
        Encoding::Srgb => Some(ColorEncoding::Srgb),
    };
    let ImageDesc { source } = &desc[id].value;
    match source {
        ImageSource::File(path) => Texels::load(path, color).map_err(|e| e.to_string()),
        ImageSource::Embedded(bytes) => Texels::from_bytes(bytes, None, color, ReadLimits::default()).map_err(|e| e.to_string()),
        ImageSource::Pixels { width, height, channels, data } => {
            if data.len() as u64 != u64::from(*width) * u64::from(*height) * u64::from(*channels) || data.is_empty() || *channels > 4 {
                return Err("the picture's size does not match its data".to_owned());
            }
            let encoding = color.unwrap_or(ColorEncoding::Linear);
            Ok(Texels { width: *width, height: *height, channels: *channels, encoding, data: TexelData::F32(data.clone()) })
        }
    }
}
