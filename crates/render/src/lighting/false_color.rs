//! False-color pictures with a legend.

use super::glyphs::{SIZE, dots};
use crate::image::Image;
use crate::math::fns;

/// How numbers become colors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Scale {
    /// In proportion, from 0.
    #[default]
    Linear,
    /// By the logarithm, over three decades below the largest.
    Logarithmic,
}

/// What a false-color picture shows.
#[derive(Clone, Debug)]
pub struct FalseColor {
    /// The number of the topmost color; `None` takes a round number at or above nearly all values.
    pub max: Option<f64>,
    /// How numbers become colors.
    pub scale: Scale,
    /// The unit that stands above the legend.
    pub unit: String,
}

/// Decades that a logarithmic scale spans.
const DECADES: f32 = 3.0;
/// Dots of the legend's parts, before enlargement.
const BAR: usize = 10;
const MARGIN: usize = 4;
/// Widest number.
const CHARACTERS: usize = 7;

/// Nine colors of the map "viridis" (S. van der Walt and N. Smith 2015, CC0): their lightness rises evenly, for all eyes.
const COLORS: [[f32; 3]; 9] = [
    [0.267, 0.005, 0.329],
    [0.278, 0.175, 0.484],
    [0.230, 0.322, 0.546],
    [0.173, 0.449, 0.558],
    [0.128, 0.567, 0.551],
    [0.158, 0.684, 0.502],
    [0.369, 0.789, 0.383],
    [0.678, 0.864, 0.190],
    [0.993, 0.906, 0.144],
];

/// The color (sRGB, encoded) of a place of the scale in [0, 1].
fn color(t: f32) -> [f32; 3] {
    let at = if t > 0.0 { t.min(1.0) } else { 0.0 } * (COLORS.len() - 1) as f32;
    let i = (at as usize).min(COLORS.len() - 2);
    let f = at - i as f32;
    std::array::from_fn(|k| fns::lerp(f, COLORS[i][k], COLORS[i + 1][k]))
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `v`; 1 where there is no such number.
fn round_up(v: f64) -> f64 {
    if !(v > 1e-30 && v < 1e30) {
        return 1.0;
    }
    let mut power = 1.0;
    while power * 10.0 <= v {
        power *= 10.0;
    }
    while power > v {
        power /= 10.0;
    }
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|c| *c >= v * (1.0 - 1e-12)).unwrap_or(v)
}

/// A number in few characters.
fn label(v: f64) -> String {
    let text = match v {
        0.0 => "0".to_owned(),
        v if !(1e-3..1e5).contains(&v) => {
            let t = format!("{v:.1e}");
            t.replace(".0e", "e")
        }
        v if v >= 100.0 => format!("{v:.0}"),
        v => {
            let digits = if v >= 10.0 {
                1
            } else if v >= 1.0 {
                2
            } else {
                4
            };
            let t = format!("{v:.digits$}");
            t.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
    };
    text.chars().take(CHARACTERS).collect()
}

/// A picture of `width` × `height` numbers (row by row; those that are not finite are left black) with a legend at its right. The
/// picture is linear and is to be written without tone mapping.
pub fn false_color(values: &[f64], width: u32, height: u32, options: &FalseColor) -> Image {
    let (w, h) = (width as usize, height as usize);
    let largest = || {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        // A few glints do not set the scale.
        round_up(sorted.get(sorted.len().saturating_sub(1) * 995 / 1000).copied().unwrap_or(1.0))
    };
    let max = options.max.filter(|m| *m > 0.0 && m.is_finite()).unwrap_or_else(largest);
    let place = |v: f64| match options.scale {
        Scale::Linear => (v / max) as f32,
        Scale::Logarithmic if v > 0.0 => 1.0 + fns::log2((v / max) as f32) / (DECADES * fns::log2(10.0)),
        Scale::Logarithmic => 0.0,
    };
    let enlarge = (h / 160).max(1);
    let legend = (BAR + 3 * MARGIN + CHARACTERS * (SIZE[0] + 1)) * enlarge;
    let columns = w + legend;
    let rows = h.max(((SIZE[1] + 2) * 4 + 2 * MARGIN) * enlarge);
    let mut pixels = vec![[0.0f32; 3]; columns * rows];
    for y in 0..h {
        for x in 0..w {
            let v = values.get(y * w + x).copied().unwrap_or(f64::NAN);
            if v.is_finite() {
                pixels[y * columns + x] = color(place(v));
            }
        }
    }
    let mut text = |s: &str, x: usize, y: usize| {
        for (i, c) in s.chars().enumerate() {
            for (dy, row) in dots(c).into_iter().enumerate() {
                for dx in (0..SIZE[0]).filter(|dx| row >> (SIZE[0] - 1 - dx) & 1 == 1) {
                    for k in 0..enlarge * enlarge {
                        let px = x + ((i * (SIZE[0] + 1) + dx) * enlarge) + k % enlarge;
                        let py = y + dy * enlarge + k / enlarge;
                        if px < columns && py < rows {
                            pixels[py * columns + px] = [1.0; 3];
                        }
                    }
                }
            }
        }
    };
    let left = w + MARGIN * enlarge;
    let top = (MARGIN + SIZE[1] + MARGIN) * enlarge;
    let bottom = rows - (MARGIN + SIZE[1] / 2) * enlarge;
    text(&options.unit, left, MARGIN * enlarge);
    // As many marks as fit, on the same steps as the colors.
    let fits = ((bottom - top) / ((SIZE[1] + 3) * enlarge)).max(1);
    let steps = [10, 5, 4, 2, 1].into_iter().find(|n| *n <= fits).unwrap_or(1);
    let marks: Vec<(f32, f64)> = match options.scale {
        Scale::Linear => (0..=steps).map(|i| (i as f32 / steps as f32, max * i as f64 / steps as f64)).collect(),
        Scale::Logarithmic => {
            (0..=3).map(|i| (i as f32 / DECADES, max * [1e-3, 1e-2, 0.1, 1.0][i as usize])).filter(|_| fits >= 3).collect()
        }
    };
    let y_of = |t: f32| bottom - 1 - ((bottom - 1 - top) as f32 * t) as usize;
    for (t, v) in &marks {
        text(&label(*v), left + (BAR + MARGIN) * enlarge, y_of(*t).saturating_sub(SIZE[1] / 2 * enlarge));
    }
    for y in top..bottom {
        let t = (bottom - 1 - y) as f32 / (bottom - 1 - top).max(1) as f32;
        pixels[y * columns + left..][..BAR * enlarge].fill(color(t));
    }
    // Pictures are linear; the colors are meant as they appear.
    let linear = |v: f32| if v <= 0.04045 { v / 12.92 } else { fns::pow((v + 0.055) / 1.055, 2.4) };
    let rgb: Vec<[f32; 3]> = pixels.into_iter().map(|p| p.map(linear)).collect();
    Image::from_rgb(columns as u32, rows as u32, &rgb)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_end_at_round_numbers_and_labels_are_short() {
        for (v, expected) in [(0.3, 0.5), (1.0, 1.0), (1.01, 2.0), (730.0, 1000.0), (0.0, 1.0), (f64::NAN, 1.0), (4.9e6, 5e6)] {
            assert!((round_up(v) / expected - 1.0).abs() < 1e-9, "{v}: {}", round_up(v));
        }
        for (v, expected) in [(0.0, "0"), (0.25, "0.25"), (500.0, "500"), (12.5, "12.5"), (2e6, "2e6"), (1e-5, "1e-5"), (2.0, "2")] {
            assert_eq!(label(v), expected);
        }
    }

    #[test]
    fn larger_numbers_are_lighter_and_pictures_have_a_legend() {
        let values: Vec<f64> = (0..100).map(|i| f64::from(i % 10) / 10.0).collect();
        for scale in [Scale::Linear, Scale::Logarithmic] {
            let options = FalseColor { max: Some(1.0), scale, unit: "lx".into() };
            let image = false_color(&values, 10, 10, &options);
            let rgb = image.rgb().unwrap();
            let y = |x: usize| {
                let [r, g, b] = rgb[x];
                0.2126 * r + 0.7152 * g + 0.0722 * b
            };
            assert!((1..9).all(|x| y(x + 1) >= y(x)) && image.width > 10);
            assert!(rgb.contains(&[1.0; 3]), "there are numbers");
        }
        let hostile = [f64::NAN, f64::INFINITY, -1.0, 1e300];
        assert_eq!(
            false_color(&hostile, 2, 2, &FalseColor { max: None, scale: Scale::Linear, unit: String::new() }).rgb().unwrap()[0],
            [0.0; 3]
        );
        false_color(&[], 0, 0, &FalseColor { max: Some(f64::NAN), scale: Scale::Logarithmic, unit: "cd/m²".into() });
    }
}
