//! The sRGB transfer function (IEC 61966-2-1).

use serde::{Deserialize, Serialize};

use crate::math::fns;

/// What stored numbers mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColorEncoding {
    /// Through the sRGB transfer function: colors of 8-bit files. Alpha is linear all the same.
    Srgb,
    /// As they are: float files, normal maps, roughness, masks.
    Linear,
}

/// A linear value in [0, 1] from an encoded one; monotone and odd beyond.
pub fn linear_from_srgb(v: f32) -> f32 {
    let a = v.abs();
    (if a <= 0.040_45 { a / 12.92 } else { fns::pow((a + 0.055) / 1.055, 2.4) }).copysign(v)
}

/// The encoded value of a linear one in [0, 1]; monotone and odd beyond.
pub fn srgb_from_linear(v: f32) -> f32 {
    let a = v.abs();
    (if a <= 0.003_130_8 { a * 12.92 } else { 1.055 * fns::pow(a, 1.0 / 2.4) - 0.055 }).copysign(v)
}

/// [`linear_from_srgb`] of an 8-bit code, from a table.
#[inline]
pub fn linear_from_srgb_u8(code: u8) -> f32 {
    static TABLE: std::sync::LazyLock<[f32; 256]> =
        std::sync::LazyLock::new(|| std::array::from_fn(|i| linear_from_srgb(i as f32 / 255.0)));
    TABLE[code as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values_and_round_trip() {
        assert!((linear_from_srgb(0.5) - 0.214_041).abs() < 1e-6);
        assert!((srgb_from_linear(0.18) - 0.461_356).abs() < 1e-5);
        for code in 0..=255u8 {
            let encoded = srgb_from_linear(linear_from_srgb_u8(code)) * 255.0;
            assert!((encoded - f32::from(code)).abs() < 1e-3);
        }
        assert!((1..=255).all(|c| linear_from_srgb_u8(c) > linear_from_srgb_u8(c - 1)));
    }
}
