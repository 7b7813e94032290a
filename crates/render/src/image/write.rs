//! Writers: EXR, PNG (8 and 16 bits), JPEG, Radiance HDR and PFM. The same picture gives the same bytes, and files
//! appear whole or not at all.

use std::io::Write;
use std::path::Path;

use image::codecs::{hdr::HdrEncoder, jpeg::JpegEncoder, png::PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::atomic::write_atomically;
use super::exr_write::{ExrOptions, write_exr};
use super::tonemap::{Codes, ToneMap, code_u8};
use super::{Image, ImageError};

/// A format that can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileFormat {
    /// OpenEXR: all channels, linear.
    Exr,
    /// PNG: R, G, B (and A), tone mapped.
    Png,
    /// JPEG: R, G, B, tone mapped.
    Jpeg,
    /// Radiance RGBE: R, G, B, linear.
    Hdr,
    /// Portable float map: R, G, B, linear.
    Pfm,
}

impl FileFormat {
    /// By a path's extension.
    ///
    /// # Errors
    /// [`ImageError::Unsupported`] for others than exr, png, jpg, jpeg, hdr and pfm.
    pub fn from_path(path: &Path) -> Result<Self, ImageError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        match extension.as_str() {
            "exr" => Ok(Self::Exr),
            "png" => Ok(Self::Png),
            "jpg" | "jpeg" => Ok(Self::Jpeg),
            "hdr" => Ok(Self::Hdr),
            "pfm" => Ok(Self::Pfm),
            _ => Err(ImageError::Unsupported(format!("no writer for \"{}\" (exr, png, jpg, hdr, pfm)", path.display()))),
        }
    }
}

/// How pictures are written; each format takes what concerns it.
#[derive(Clone, Debug)]
pub struct WriteOptions {
    /// Exposure and curve of PNG and JPEG.
    pub tone: ToneMap,
    /// PNG with 16 instead of 8 bits.
    pub sixteen_bit: bool,
    /// PNG with the channel A, if there is one, as its alpha.
    pub alpha: bool,
    /// JPEG quality from 1 to 100.
    pub jpeg_quality: u8,
    /// EXR precision and attributes.
    pub exr: ExrOptions,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self { tone: ToneMap::default(), sixteen_bit: false, alpha: false, jpeg_quality: 92, exr: ExrOptions::default() }
    }
}

impl Image {
    /// Writes the picture to a file in the format of its extension.
    ///
    /// # Errors
    /// [`ImageError`]
    pub fn save(&self, path: &Path, options: &WriteOptions) -> Result<(), ImageError> {
        let format = FileFormat::from_path(path)?;
        write_atomically(path, |out| self.write_to(out, format, options))
    }

    /// Writes the picture as a file's bytes.
    ///
    /// # Errors
    /// [`ImageError`]
    pub fn write_to(&self, out: &mut (impl Write + ?Sized), format: FileFormat, options: &WriteOptions) -> Result<(), ImageError> {
        if format == FileFormat::Exr {
            return write_exr(self, &options.exr, out);
        }
        let rgb = self.rgb().ok_or_else(|| ImageError::Missing("channels R, G and B".into()))?;
        match format {
            FileFormat::Png => self.write_png(out, &rgb, options),
            FileFormat::Jpeg => {
                let codes = codes(&rgb, &options.tone);
                let quality = options.jpeg_quality.clamp(1, 100);
                let encoder = JpegEncoder::new_with_quality(out, quality);
                encoder.write_image(&codes, self.width, self.height, ExtendedColorType::Rgb8).map_err(encode_error)
            }
            FileFormat::Hdr => {
                let pixels: Vec<_> = rgb.iter().map(|&p| image::Rgb(p.map(|v| v.max(0.0)))).collect();
                HdrEncoder::new(out).encode(&pixels, self.width as usize, self.height as usize).map_err(encode_error)
            }
            FileFormat::Pfm | FileFormat::Exr => {
                write!(out, "PF\n{} {}\n-1.0\n", self.width, self.height)?;
                // Rows from the bottom up.
                for row in rgb.chunks(self.width as usize).rev() {
                    out.write_all(bytemuck::cast_slice(&row.iter().flatten().map(|v| v.to_bits().to_le()).collect::<Vec<u32>>()))?;
                }
                Ok(())
            }
        }
    }

    fn write_png(&self, out: &mut (impl Write + ?Sized), rgb: &[[f32; 3]], options: &WriteOptions) -> Result<(), ImageError> {
        let alpha = self.channel("A").filter(|_| options.alpha);
        if alpha.is_none() && !options.sixteen_bit {
            let bytes = codes(rgb, &options.tone);
            return PngEncoder::new(out).write_image(&bytes, self.width, self.height, ExtendedColorType::Rgb8).map_err(encode_error);
        }
        let mut values = Vec::with_capacity(rgb.len() * 4);
        for (i, &pixel) in rgb.iter().enumerate() {
            match alpha {
                // The film's colors are premultiplied, those of PNG are not.
                Some(alpha) => {
                    let a = alpha[i].clamp(0.0, 1.0);
                    values.extend(options.tone.apply(if a > 0.0 { pixel.map(|v| v / a) } else { [0.0; 3] }));
                    values.push(a);
                }
                None => values.extend(options.tone.apply(pixel)),
            }
        }
        let (bytes, color): (Vec<u8>, _) = match (options.sixteen_bit, alpha.is_some()) {
            (false, _) => (values.into_iter().map(code_u8).collect(), ExtendedColorType::Rgba8),
            (true, false) => (values.into_iter().flat_map(code_u16).collect(), ExtendedColorType::Rgb16),
            (true, true) => (values.into_iter().flat_map(code_u16).collect(), ExtendedColorType::Rgba16),
        };
        PngEncoder::new(out).write_image(&bytes, self.width, self.height, color).map_err(encode_error)
    }
}

fn encode_error(e: image::ImageError) -> ImageError {
    match e {
        image::ImageError::IoError(e) => ImageError::Io(e),
        e => ImageError::Unsupported(e.to_string()),
    }
}

/// Tone mapped colors with eight bits a channel.
fn codes(rgb: &[[f32; 3]], tone: &ToneMap) -> Vec<u8> {
    match Codes::new(tone) {
        Some(codes) => rgb.as_flattened().iter().map(|&v| codes.code(v)).collect(),
        None => rgb.iter().flat_map(|&p| tone.apply(p)).map(code_u8).collect(),
    }
}

/// In the byte order of this machine, as the encoder wants it.
fn code_u16(v: f32) -> [u8; 2] {
    ((v * 65535.0 + 0.5) as u16).to_ne_bytes()
}
