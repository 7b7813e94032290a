//! Pictures outside of the film: what is read from files, developed from a film, compared and written.
//!
//! [`Image`] is planar `f32` with named channels and linear values; [`Texels`] is the compact form in which
//! textures stay in memory.

pub mod atomic;
mod encoding;
mod exr_write;
pub mod flip;
mod hdr;
mod ktx2;
pub mod metrics;
mod palette;
mod read;
mod recode;
mod texels;
pub mod tonemap;
mod write;

use std::io;

pub use encoding::{ColorEncoding, linear_from_srgb, linear_from_srgb_u8, srgb_from_linear};
pub use exr_write::{ExrAttribute, ExrOptions};
pub(crate) use palette::palette_indices;
pub use read::{ReadLimits, is_exr};
pub use recode::{is_rare, png_bytes};
pub use texels::{TexelData, Texels};
pub use write::{FileFormat, WriteOptions};

/// Why a picture cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file system's error.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A format, or a feature of one, that is not handled.
    #[error("unsupported image: {0}")]
    Unsupported(String),
    /// A damaged or made-up file.
    #[error("damaged image: {0}")]
    Invalid(String),
    /// More memory than the limits allow.
    #[error("image of {width} x {height} pixels is larger than the limit")]
    TooLarge {
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
    },
    /// The image lacks what is asked of it.
    #[error("image has no {0}")]
    Missing(String),
}

/// One named plane of an image, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelData {
    /// The field's name: `R`, `G`, `B`, `A`, `Z`, `N.X`, `albedo.R`, `id.object` …
    pub name: String,
    /// width × height values.
    pub data: Vec<f32>,
}

/// A picture of named `f32` planes.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Where the first pixel lies in the full picture (not 0 for a crop).
    pub origin: [i32; 2],
    /// The size of the full picture, [width, height].
    pub full_size: [u32; 2],
    /// The planes, in the order in which they were added or read.
    pub channels: Vec<ChannelData>,
}

impl Image {
    /// An image of its own full size without channels.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, origin: [0, 0], full_size: [width, height], channels: Vec::new() }
    }

    /// From interleaved `[r, g, b]` pixels, row by row; `rgb` must hold width × height of them.
    pub fn from_rgb(width: u32, height: u32, rgb: &[[f32; 3]]) -> Self {
        let mut image = Self::new(width, height);
        for (i, name) in ["R", "G", "B"].into_iter().enumerate() {
            image.push(name, rgb.iter().map(|p| p[i]).collect());
        }
        image
    }

    /// The number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Adds a plane; `data` is cut or filled with zeros to width × height values.
    pub fn push(&mut self, name: impl Into<String>, mut data: Vec<f32>) {
        data.resize(self.pixel_count(), 0.0);
        self.channels.push(ChannelData { name: name.into(), data });
    }

    /// The plane of that name.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|c| c.name == name).map(|c| &c.data[..])
    }

    /// Interleaved RGB: the planes `R`, `G`, `B`, or a single plane `Y` (or the only plane there is) as gray.
    /// None where there is neither.
    pub fn rgb(&self) -> Option<Vec<[f32; 3]>> {
        if let (Some(r), Some(g), Some(b)) = (self.channel("R"), self.channel("G"), self.channel("B")) {
            return Some(r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect());
        }
        let gray = match (self.channel("Y"), &self.channels[..]) {
            (Some(y), _) => y,
            (None, [only]) => &only.data,
            _ => return None,
        };
        Some(gray.iter().map(|&v| [v; 3]).collect())
    }
}

#[cfg(test)]
mod tests;
