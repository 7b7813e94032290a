//! Pictures as textures: in the precision of their files, decoded at each look-up.

use exr::prelude::f16;

use super::{ColorEncoding, linear_from_srgb, linear_from_srgb_u8};

/// Interleaved numbers of a picture, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub enum TexelData {
    /// 0 to 255 for 0 to 1.
    U8(Vec<u8>),
    /// 0 to 65535 for 0 to 1.
    U16(Vec<u16>),
    /// Half precision.
    F16(Vec<f16>),
    /// Single precision.
    F32(Vec<f32>),
}

impl TexelData {
    /// The number of numbers.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::F16(v) => v.len(),
            Self::F32(v) => v.len(),
        }
    }

    /// True where there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes in memory.
    pub fn byte_size(&self) -> usize {
        self.len()
            * match self {
                Self::U8(_) => 1,
                Self::U16(_) | Self::F16(_) => 2,
                Self::F32(_) => 4,
            }
    }
}

/// A picture in the form in which textures hold it.
#[derive(Clone, Debug, PartialEq)]
pub struct Texels {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Numbers a texel: 1 gray, 2 gray and alpha, 3 RGB, 4 RGB and alpha.
    pub channels: u32,
    /// What the color numbers mean.
    pub encoding: ColorEncoding,
    /// width × height × channels numbers.
    pub data: TexelData,
}

impl Texels {
    /// The encoding that files of this precision have unless something says otherwise: 8 and 16-bit integers are sRGB.
    pub fn default_encoding(data: &TexelData) -> ColorEncoding {
        match data {
            TexelData::U8(_) | TexelData::U16(_) => ColorEncoding::Srgb,
            TexelData::F16(_) | TexelData::F32(_) => ColorEncoding::Linear,
        }
    }

    /// The texel in column x and row y, which must lie within the picture: linear R, G, B and alpha (1 where there is none).
    #[inline]
    pub fn get(&self, x: u32, y: u32) -> [f32; 4] {
        let at = (y as usize * self.width as usize + x as usize) * self.channels as usize;
        let srgb = self.encoding == ColorEncoding::Srgb;
        match &self.data {
            TexelData::U8(v) => {
                self.expand(|i| v[at + i], |c| if srgb { linear_from_srgb_u8(c) } else { f32::from(c) / 255.0 }, |a| f32::from(a) / 255.0)
            }
            TexelData::U16(v) => self.expand(
                |i| v[at + i],
                |c| if srgb { linear_from_srgb(f32::from(c) / 65535.0) } else { f32::from(c) / 65535.0 },
                |a| f32::from(a) / 65535.0,
            ),
            TexelData::F16(v) => self.expand(|i| v[at + i], |c| if srgb { linear_from_srgb(c.to_f32()) } else { c.to_f32() }, f16::to_f32),
            TexelData::F32(v) => self.expand(|i| v[at + i], |c| if srgb { linear_from_srgb(c) } else { c }, |a| a),
        }
    }

    #[inline]
    fn expand<T>(&self, at: impl Fn(usize) -> T, color: impl Fn(T) -> f32, alpha: impl Fn(T) -> f32) -> [f32; 4] {
        match self.channels {
            1 => {
                let v = color(at(0));
                [v, v, v, 1.0]
            }
            2 => {
                let v = color(at(0));
                [v, v, v, alpha(at(1))]
            }
            3 => [color(at(0)), color(at(1)), color(at(2)), 1.0],
            _ => [color(at(0)), color(at(1)), color(at(2)), alpha(at(3))],
        }
    }

    /// True where texels carry alpha.
    pub fn has_alpha(&self) -> bool {
        matches!(self.channels, 2 | 4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_precision_and_layout_decodes() {
        let texels = |channels, encoding, data| Texels { width: 1, height: 1, channels, encoding, data };
        let half = linear_from_srgb(128.0 / 255.0);
        let gray = texels(2, ColorEncoding::Srgb, TexelData::U8(vec![128, 51]));
        assert_eq!(gray.get(0, 0), [half, half, half, 0.2]);
        let raw = texels(3, ColorEncoding::Linear, TexelData::U8(vec![255, 51, 0]));
        assert_eq!(raw.get(0, 0), [1.0, 0.2, 0.0, 1.0]);
        let deep = texels(1, ColorEncoding::Linear, TexelData::U16(vec![65535]));
        assert_eq!(deep.get(0, 0), [1.0; 4]);
        let float = texels(4, ColorEncoding::Linear, TexelData::F32(vec![3.0, -1.0, 0.5, 0.25]));
        assert_eq!(float.get(0, 0), [3.0, -1.0, 0.5, 0.25]);
        let short = texels(3, ColorEncoding::Linear, TexelData::F16([3.0, 0.5, 9.0].map(f16::from_f32).to_vec()));
        assert_eq!(short.get(0, 0), [3.0, 0.5, 9.0, 1.0]);
        assert_eq!(short.data.byte_size(), 6);
    }
}
