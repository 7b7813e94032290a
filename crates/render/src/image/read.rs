//! Readers: OpenEXR through `exr`; PNG, JPEG, WebP, BMP, TGA, GIF and TIFF through `image`; Radiance HDR in
//! [`super::hdr`]; KTX2 in [`super::ktx2`].
//!
//! Sizes are checked against limits before pixels are allocated. The `image` crate has its own limit of 512 MiB: only
//! its entry that is no generic function is used here, since setting limits would compile every decoder into this
//! crate, forty seconds at each change.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use exr::prelude as exrs;
use exrs::{ReadChannels, ReadLayers};
use image::{DynamicImage, ImageFormat};

use super::hdr::{is_hdr, read_hdr};
use super::ktx2::{is_ktx2, read_ktx2};
use super::{ChannelData, ColorEncoding, Image, ImageError, TexelData, Texels};

/// What a picture may take at most.
#[derive(Clone, Copy, Debug)]
pub struct ReadLimits {
    /// Columns or rows.
    pub max_side: u32,
    /// Bytes of decoded pixels, all channels and layers together (PNG, JPEG and the like never take more than 512 MiB).
    pub max_bytes: u64,
}

impl Default for ReadLimits {
    /// 2^17 on a side and 4 GiB.
    fn default() -> Self {
        Self { max_side: 1 << 17, max_bytes: 4 << 30 }
    }
}

/// True where the bytes start as an OpenEXR file does.
pub fn is_exr(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

impl Image {
    /// Reads a picture with all its channels as linear values: integer files are decoded from sRGB.
    ///
    /// # Errors
    /// [`ImageError`]
    pub fn load(path: &Path) -> Result<Self, ImageError> {
        let extension = path.extension().and_then(|e| e.to_str());
        Self::from_bytes(&std::fs::read(path)?, extension, None, ReadLimits::default())
    }

    /// Reads a picture from a file's bytes. `extension` tells formats that have no mark of their own (TGA); `encoding` is what
    /// the numbers of a non-EXR file mean, None for [`Texels::default_encoding`].
    ///
    /// EXR files: all flat channels of the largest level; channels of layers after the first are named `layer.channel`.
    /// Layers of another size than the first are an error.
    ///
    /// # Errors
    /// [`ImageError`]
    pub fn from_bytes(
        bytes: &[u8],
        extension: Option<&str>,
        encoding: Option<ColorEncoding>,
        limits: ReadLimits,
    ) -> Result<Self, ImageError> {
        if is_exr(bytes) {
            return read_exr(bytes, limits);
        }
        let texels = Texels::from_bytes(bytes, extension, encoding, limits)?;
        let mut image = Self::new(texels.width, texels.height);
        let planes: &[(usize, &str)] = match texels.channels {
            1 => &[(0, "Y")],
            2 => &[(0, "Y"), (3, "A")],
            3 => &[(0, "R"), (1, "G"), (2, "B")],
            _ => &[(0, "R"), (1, "G"), (2, "B"), (3, "A")],
        };
        for &(lane, name) in planes {
            let pixels = (0..texels.height).flat_map(|y| (0..texels.width).map(move |x| (x, y)));
            image.push(name, pixels.map(|(x, y)| texels.get(x, y)[lane]).collect());
        }
        Ok(image)
    }
}

impl Texels {
    /// Reads a picture as a texture in the precision of its file.
    ///
    /// # Errors
    /// As [`Texels::from_bytes`]
    pub fn load(path: &Path, encoding: Option<ColorEncoding>) -> Result<Self, ImageError> {
        let extension = path.extension().and_then(|e| e.to_str());
        Self::from_bytes(&std::fs::read(path)?, extension, encoding, ReadLimits::default())
    }

    /// Reads a texture from a file's bytes; `extension` and `encoding` as in [`Image::from_bytes`]. Of EXR files it takes
    /// R, G, B and A, or Y and A, or the only channel.
    ///
    /// # Errors
    /// [`ImageError`]
    pub fn from_bytes(
        bytes: &[u8],
        extension: Option<&str>,
        encoding: Option<ColorEncoding>,
        limits: ReadLimits,
    ) -> Result<Self, ImageError> {
        let (width, height, channels, data) = if is_exr(bytes) {
            exr_texels(bytes, limits)?
        } else if is_hdr(bytes) {
            let (width, height, rgb) = read_hdr(bytes, limits)?;
            (width, height, 3, TexelData::F32(rgb))
        } else if is_ktx2(bytes) {
            guarded(|| read_ktx2(bytes, limits))?
        } else {
            guarded(|| decode(bytes, extension, limits))?
        };
        let encoding = encoding.unwrap_or(Self::default_encoding(&data));
        Ok(Self { width, height, channels, encoding, data })
    }
}

/// Runs a decoder so that a panic in it (a bug there, met by a hostile file) is an error here.
fn guarded<T>(decode: impl FnOnce() -> Result<T, ImageError>) -> Result<T, ImageError> {
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err(ImageError::Invalid("the decoder failed".into())))
}

type Decoded = (u32, u32, u32, TexelData);

fn decode(bytes: &[u8], extension: Option<&str>, limits: ReadLimits) -> Result<Decoded, ImageError> {
    let format = image::guess_format(bytes)
        .ok()
        .or_else(|| extension.and_then(ImageFormat::from_extension))
        .ok_or_else(|| ImageError::Unsupported("unknown format".into()))?;
    let picture = image::load_from_memory_with_format(bytes, format).map_err(|e| match e {
        image::ImageError::Unsupported(e) => ImageError::Unsupported(e.to_string()),
        image::ImageError::Limits(_) => ImageError::Unsupported("an image of more than 512 MiB in this format".into()),
        e => ImageError::Invalid(e.to_string()),
    })?;
    let (width, height) = (picture.width(), picture.height());
    if width.max(height) > limits.max_side || picture.as_bytes().len() as u64 > limits.max_bytes {
        return Err(ImageError::TooLarge { width: width.into(), height: height.into() });
    }
    let (channels, data) = match picture {
        DynamicImage::ImageLuma8(p) => (1, TexelData::U8(p.into_raw())),
        DynamicImage::ImageLumaA8(p) => (2, TexelData::U8(p.into_raw())),
        DynamicImage::ImageRgb8(p) => (3, TexelData::U8(p.into_raw())),
        DynamicImage::ImageRgba8(p) => (4, TexelData::U8(p.into_raw())),
        DynamicImage::ImageLuma16(p) => (1, TexelData::U16(p.into_raw())),
        DynamicImage::ImageLumaA16(p) => (2, TexelData::U16(p.into_raw())),
        DynamicImage::ImageRgb16(p) => (3, TexelData::U16(p.into_raw())),
        DynamicImage::ImageRgba16(p) => (4, TexelData::U16(p.into_raw())),
        DynamicImage::ImageRgb32F(p) => (3, TexelData::F32(p.into_raw())),
        DynamicImage::ImageRgba32F(p) => (4, TexelData::F32(p.into_raw())),
        other => return Err(ImageError::Unsupported(format!("pixels of type {:?}", other.color()))),
    };
    Ok((width, height, channels, data))
}

type ExrLayers = exrs::Layers<exrs::AnyChannels<exrs::FlatSamples>>;

fn exr_error(e: exrs::Error) -> ImageError {
    match e {
        exrs::Error::NotSupported(what) => ImageError::Unsupported(what.into_owned()),
        exrs::Error::Invalid(what) => ImageError::Invalid(what.into_owned()),
        exrs::Error::Io(e) => ImageError::Invalid(e.to_string()),
        exrs::Error::Aborted => ImageError::Invalid("aborted".into()),
    }
}

/// Checks the header against the limits and the length of the file, then decodes.
fn exr_layers(bytes: &[u8], limits: ReadLimits) -> Result<ExrLayers, ImageError> {
    guarded(|| {
        let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(exr_error)?;
        let (mut total, mut chunks) = (0u64, 0u64);
        for header in &meta.headers {
            let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
            // Integer and half channels are decoded to their own size, but may be held once more as f32.
            let bytes_here = width.saturating_mul(height).saturating_mul(4 * header.channels.list.len() as u64);
            total = total.saturating_add(bytes_here);
            chunks = chunks.saturating_add(header.chunk_count as u64);
            if width.max(height) > u64::from(limits.max_side) || total > limits.max_bytes {
                return Err(ImageError::TooLarge { width, height });
            }
        }
        // Each chunk has an entry of eight bytes in the offset table.
        if chunks.saturating_mul(8) > bytes.len() as u64 {
            return Err(ImageError::Invalid("the file is shorter than its own table of contents".into()));
        }
        let image = exrs::read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
        // Pictures are often read from several threads at once; the crate's own pool for each would be too many threads.
        Ok(image.non_parallel().from_buffered(Cursor::new(bytes)).map_err(exr_error)?.layer_data)
    })
}

fn read_exr(bytes: &[u8], limits: ReadLimits) -> Result<Image, ImageError> {
    let meta = guarded(|| exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(exr_error))?;
    let layers = exr_layers(bytes, limits)?;
    let first = layers.first().ok_or_else(|| ImageError::Missing("layers".into()))?;
    let (size, position) = (first.size, first.attributes.layer_position);
    let mut image = Image::new(size.0 as u32, size.1 as u32);
    let display = meta.headers.first().map_or(exrs::Vec2(size.0, size.1), |h| h.shared_attributes.display_window.size);
    let display_origin = meta.headers.first().map_or(exrs::Vec2(0, 0), |h| h.shared_attributes.display_window.position);
    image.origin = [position.0.saturating_sub(display_origin.0), position.1.saturating_sub(display_origin.1)];
    image.full_size = [display.0 as u32, display.1 as u32];
    for (index, layer) in layers.iter().enumerate() {
        if layer.size != size || layer.attributes.layer_position != position {
            return Err(ImageError::Unsupported("EXR layers of different sizes".into()));
        }
        let prefix = match &layer.attributes.layer_name {
            Some(name) if index > 0 => format!("{name}."),
            _ => String::new(),
        };
        for channel in &layer.channel_data.list {
            let data = channel.sample_data.values_as_f32().collect();
            image.channels.push(ChannelData { name: format!("{prefix}{}", channel.name), data });
        }
    }
    Ok(image)
}

fn exr_texels(bytes: &[u8], limits: ReadLimits) -> Result<Decoded, ImageError> {
    let layers = exr_layers(bytes, limits)?;
    let layer = layers.first().ok_or_else(|| ImageError::Missing("layers".into()))?;
    let find = |name: &str| layer.channel_data.list.iter().find(|c| c.name.eq(name)).map(|c| &c.sample_data);
    let color = match (find("R"), find("G"), find("B"), find("Y"), &layer.channel_data.list[..]) {
        (Some(r), Some(g), Some(b), ..) => vec![r, g, b],
        (_, _, _, Some(y), _) => vec![y],
        (.., [only]) => vec![&only.sample_data],
        _ => return Err(ImageError::Missing("channels R, G and B, or Y".into())),
    };
    let planes: Vec<_> = color.into_iter().chain(find("A").filter(|_| layer.channel_data.list.len() > 1)).collect();
    let pixels = layer.size.area();
    let all_half = planes.iter().all(|p| matches!(p, exrs::FlatSamples::F16(_)));
    let data = if all_half {
        let halves: Vec<&[exrs::f16]> =
            planes.iter().filter_map(|p| if let exrs::FlatSamples::F16(v) = p { Some(&v[..]) } else { None }).collect();
        TexelData::F16((0..pixels).flat_map(|i| halves.iter().map(move |p| p[i])).collect())
    } else {
        let mut data = vec![0.0; pixels * planes.len()];
        for (lane, plane) in planes.iter().enumerate() {
            for (texel, value) in data.chunks_exact_mut(planes.len()).zip(plane.values_as_f32()) {
                texel[lane] = value;
            }
        }
        TexelData::F32(data)
    };
    Ok((layer.size.0 as u32, layer.size.1 as u32, planes.len() as u32, data))
}
