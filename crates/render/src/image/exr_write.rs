//! Multi-channel OpenEXR files: one part, scan lines, ZIP compression, any attributes.
//!
//! Written here rather than through the `exr` crate because that keeps custom attributes in a hash map, so that
//! the same picture would not give the same bytes. The layout is that of the "OpenEXR File Layout" document.

use std::io::Write;

use exr::prelude::f16;
use flate2::Compression;
use flate2::bufread::ZlibEncoder;
use rayon::prelude::*;

use super::{Image, ImageError};

/// A value of a custom attribute.
#[derive(Clone, Debug, PartialEq)]
pub enum ExrAttribute {
    /// `string`
    Text(String),
    /// `float`
    Float(f32),
    /// `int`
    Int(i32),
}

/// How an EXR file is written.
#[derive(Clone, Debug, Default)]
pub struct ExrOptions {
    /// Colors and normals as half floats (depth, positions, ids, variances and counts stay single).
    pub half: bool,
    /// Custom attributes: renderer, spp, seed, time … Names are up to 255 bytes.
    pub attributes: Vec<(String, ExrAttribute)>,
}

/// Rows in a block of ZIP compression.
const BLOCK_ROWS: usize = 16;

/// What half precision would spoil.
fn needs_single(name: &str) -> bool {
    let layer = name.split('.').next().unwrap_or(name);
    matches!(layer, "Z" | "P" | "id" | "variance" | "sampleCount" | "uv")
}

/// Appends one header attribute.
fn attribute(header: &mut Vec<u8>, name: &str, kind: &str, value: &[u8]) {
    for text in [name, kind] {
        header.extend(text.as_bytes());
        header.push(0);
    }
    header.extend((value.len() as i32).to_le_bytes());
    header.extend(value);
}

fn ints(values: &[i32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Writes the file's bytes; equal images and options give equal bytes.
pub(super) fn write_exr(image: &Image, options: &ExrOptions, out: &mut (impl Write + ?Sized)) -> Result<(), ImageError> {
    // OpenEXR wants channels sorted by the bytes of their names.
    let mut channels: Vec<(&str, &[f32], bool)> =
        image.channels.iter().map(|c| (c.name.as_str(), &c.data[..], options.half && !needs_single(&c.name))).collect();
    channels.sort_by_key(|c| c.0);
    if image.width == 0 || image.height == 0 || channels.is_empty() {
        return Err(ImageError::Missing("pixels to write".into()));
    }
    let names = channels.iter().map(|c| c.0).chain(options.attributes.iter().map(|a| a.0.as_str()));
    if names.clone().any(|n| n.is_empty() || n.len() > 255 || n.contains('\0')) || channels.windows(2).any(|w| w[0].0 == w[1].0) {
        return Err(ImageError::Unsupported("channel or attribute names that are doubled, empty or longer than 255 bytes".into()));
    }
    let header = header_bytes(image, options, &channels, names.map(str::len).max().unwrap_or(0) > 31);
    let (width, height) = (image.width as usize, image.height as usize);
    let blocks: Vec<Vec<u8>> = (0..height.div_ceil(BLOCK_ROWS))
        .into_par_iter()
        .map(|block| {
            let rows = block * BLOCK_ROWS..((block + 1) * BLOCK_ROWS).min(height);
            let mut raw = Vec::with_capacity(rows.len() * width * channels.len() * 4);
            for y in rows {
                for (_, data, half) in &channels {
                    let row = &data[y * width..(y + 1) * width];
                    if *half {
                        // The largest finite half rather than infinity.
                        raw.extend(row.iter().flat_map(|v| f16::from_f32(v.clamp(-65504.0, 65504.0)).to_le_bytes()));
                    } else {
                        raw.extend(row.iter().flat_map(|v| v.to_le_bytes()));
                    }
                }
            }
            compress(raw)
        })
        .collect();
    out.write_all(&header)?;
    let mut offset = (header.len() + 8 * blocks.len()) as u64;
    for block in &blocks {
        out.write_all(&offset.to_le_bytes())?;
        offset += 8 + block.len() as u64;
    }
    for (index, block) in blocks.iter().enumerate() {
        out.write_all(&(image.origin[1] + (index * BLOCK_ROWS) as i32).to_le_bytes())?;
        out.write_all(&(block.len() as i32).to_le_bytes())?;
        out.write_all(block)?;
    }
    Ok(())
}

fn header_bytes(image: &Image, options: &ExrOptions, channels: &[(&str, &[f32], bool)], long_names: bool) -> Vec<u8> {
    let mut header = Vec::new();
    header.extend(20_000_630u32.to_le_bytes());
    header.extend((2u32 | if long_names { 0x400 } else { 0 }).to_le_bytes());
    let mut list = Vec::new();
    for (name, _, half) in channels {
        list.extend(name.as_bytes());
        list.push(0);
        // Type, "perceptually linear" flag with padding, sampling in x and y.
        list.extend(ints(&[if *half { 1 } else { 2 }, 0, 1, 1]));
    }
    list.push(0);
    let [x, y] = image.origin;
    attribute(&mut header, "channels", "chlist", &list);
    // Rec. 709 primaries and white, which is also what is assumed without this.
    attribute(&mut header, "chromaticities", "chromaticities", &floats(&[0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329]));
    attribute(&mut header, "compression", "compression", &[3]);
    let data_window = [x, y, x + image.width as i32 - 1, y + image.height as i32 - 1];
    attribute(&mut header, "dataWindow", "box2i", &ints(&data_window));
    let [full_width, full_height] = image.full_size.map(|s| s as i32 - 1);
    attribute(&mut header, "displayWindow", "box2i", &ints(&[0, 0, full_width, full_height]));
    attribute(&mut header, "lineOrder", "lineOrder", &[0]);
    attribute(&mut header, "pixelAspectRatio", "float", &floats(&[1.0]));
    attribute(&mut header, "screenWindowCenter", "v2f", &floats(&[0.0, 0.0]));
    attribute(&mut header, "screenWindowWidth", "float", &floats(&[1.0]));
    for (name, value) in &options.attributes {
        match value {
            ExrAttribute::Text(text) => attribute(&mut header, name, "string", text.as_bytes()),
            ExrAttribute::Float(v) => attribute(&mut header, name, "float", &floats(&[*v])),
            ExrAttribute::Int(v) => attribute(&mut header, name, "int", &ints(&[*v])),
        }
    }
    header.push(0);
    header
}

/// ZIP compression of a block: even bytes before odd ones, then differences of neighbors, then zlib; the raw block where
/// that is not smaller.
fn compress(raw: Vec<u8>) -> Vec<u8> {
    let half = raw.len().div_ceil(2);
    let mut shuffled = vec![0; raw.len()];
    for (i, &byte) in raw.iter().enumerate() {
        shuffled[if i % 2 == 0 { i / 2 } else { half + i / 2 }] = byte;
    }
    let mut previous = shuffled.first().copied().unwrap_or(0);
    for byte in shuffled.iter_mut().skip(1) {
        let current = *byte;
        *byte = current.wrapping_sub(previous).wrapping_add(128);
        previous = current;
    }
    let mut packed = Vec::with_capacity(raw.len() / 2);
    let encoded = std::io::Read::read_to_end(&mut ZlibEncoder::new(&shuffled[..], Compression::new(4)), &mut packed);
    if encoded.is_ok() && packed.len() < raw.len() { packed } else { raw }
}
