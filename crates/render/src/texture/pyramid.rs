//! Picture pyramids: a picture at half, a quarter … of its size, for footprints larger than a texel (Williams 1983, "Pyramidal
//! Parametrics", doi:10.1145/964967.801126).

use exr::prelude::f16;

use crate::image::{ColorEncoding, TexelData, Texels};

/// The levels above the full picture, each half the size of the one before (rounded up), linear, in half precision: together at most
/// two thirds of the memory of a picture of 8 bits.
pub(super) fn levels(base: &Texels) -> Vec<Texels> {
    let mut levels: Vec<Texels> = Vec::new();
    loop {
        let below = levels.last().unwrap_or(base);
        if below.width == 1 && below.height == 1 {
            return levels;
        }
        let half = half(below);
        levels.push(half);
    }
}

/// The mean of each 2 × 2 texels; the last row and column of odd sizes count twice.
fn half(from: &Texels) -> Texels {
    let (width, height, channels) = (from.width.div_ceil(2), from.height.div_ceil(2), from.channels);
    let lanes: &[usize] = match channels {
        1 => &[0],
        2 => &[0, 3],
        3 => &[0, 1, 2],
        _ => &[0, 1, 2, 3],
    };
    let mut data = Vec::with_capacity(width as usize * height as usize * lanes.len());
    for y in 0..height {
        for x in 0..width {
            let (x1, y1) = ((2 * x + 1).min(from.width - 1), (2 * y + 1).min(from.height - 1));
            let corners = [(2 * x, 2 * y), (x1, 2 * y), (2 * x, y1), (x1, y1)].map(|(x, y)| from.get(x, y));
            data.extend(lanes.iter().map(|&i| f16::from_f32(corners.iter().map(|c| c[i]).sum::<f32>() * 0.25)));
        }
    }
    Texels { width, height, channels, encoding: ColorEncoding::Linear, data: TexelData::F16(data) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_halve_down_to_one_texel_and_keep_the_mean() {
        let data: Vec<f32> = (0..8 * 4 * 3).map(|i| (i % 7) as f32).collect();
        let mean = data.iter().sum::<f32>() / data.len() as f32;
        let base = Texels { width: 8, height: 4, channels: 3, encoding: ColorEncoding::Linear, data: TexelData::F32(data) };
        let levels = levels(&base);
        assert_eq!(levels.iter().map(|l| (l.width, l.height)).collect::<Vec<_>>(), [(4, 2), (2, 1), (1, 1)]);
        let [r, g, b, a] = levels[2].get(0, 0);
        assert!(((r + g + b) / 3.0 - mean).abs() < 0.01 && a == 1.0, "{r} {g} {b} {mean}");
    }
}
