//! The contact sheet: reference and methods side by side, each above its error.

use etendue_render::image::Image;
use font8x8::UnicodeFonts;

use super::curve::Curve;

/// Pictures are shrunk to at most this width.
const CELL_WIDTH: u32 = 360;
/// Narrower ones are enlarged, so that they do not run into each other's names.
const LEAST_WIDTH: u32 = 272;
/// Higher than this none is enlarged.
const MOST_HEIGHT: u32 = 4096;
const GAP: u32 = 8;
/// Height of a line of text: eight pixels at twice the size, and space.
const LINE: u32 = 24;
const COLUMNS: u32 = 4;
const PAPER: [f32; 3] = [0.9; 3];
const INK: [f32; 3] = [0.01; 3];

/// A picture shrunk by a whole factor, by means of squares; or enlarged by one, if it is small.
fn fit(image: &Image) -> (u32, u32, Vec<[f32; 3]>) {
    let rgb = image.rgb().unwrap_or_default();
    if image.width < LEAST_WIDTH && image.width > 0 {
        // Tall ones stay as they are.
        let factor = LEAST_WIDTH.div_ceil(image.width).min((MOST_HEIGHT / image.height.max(1)).max(1));
        let (width, height) = (image.width * factor, image.height * factor);
        let pixel = |x: u32, y: u32| rgb.get((y / factor * image.width + x / factor) as usize).copied().unwrap_or_default();
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
        return (width, height, pixels);
    }
    let factor = image.width.div_ceil(CELL_WIDTH).max(1);
    let (width, height) = ((image.width / factor).max(1), (image.height / factor).max(1));
    let pixel = |i: u32| {
        let (x0, y0) = (i % width * factor, i / width * factor);
        let mut sum = [0.0f32; 3];
        let mut count = 0.0f32;
        for (x, y) in (y0..y0 + factor).flat_map(|y| (x0..x0 + factor).map(move |x| (x, y))) {
            if let Some(p) = rgb.get((y * image.width + x) as usize).filter(|_| x < image.width) {
                // Clipped as on a display, so that one bright sample does not outshine its neighbors.
                (0..3).for_each(|c| sum[c] += p[c].clamp(0.0, 1.0));
                count += 1.0;
            }
        }
        sum.map(|s| s / count.max(1.0))
    };
    (width, height, (0..width * height).map(pixel).collect())
}

/// A sheet under construction.
struct Sheet {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 3]>,
}

impl Sheet {
    fn put(&mut self, x: u32, y: u32, color: [f32; 3]) {
        if x < self.width && y < self.height {
            self.pixels[(y * self.width + x) as usize] = color;
        }
    }

    fn picture(&mut self, x0: u32, y0: u32, (width, height, pixels): &(u32, u32, Vec<[f32; 3]>)) {
        for (i, &p) in (0..width * height).zip(pixels) {
            self.put(x0 + i % width, y0 + i / width, p);
        }
    }

    fn text(&mut self, x0: u32, y0: u32, text: &str) {
        for (i, c) in (0..).zip(text.chars()) {
            let Some(glyph) = font8x8::BASIC_FONTS.get(c) else { continue };
            for (y, row) in (0..).zip(glyph) {
                for x in (0..8).filter(|x| row >> x & 1 == 1) {
                    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        self.put(x0 + i * 16 + x * 2 + dx, y0 + y * 2 + dy, INK);
                    }
                }
            }
        }
    }
}

/// Reference first, then each method with its FLIP map under it.
pub(super) fn contact_sheet(reference: &Image, curves: &[Curve]) -> Image {
    let cell = fit(reference);
    let (w, h) = (cell.0, cell.1);
    let count = curves.len() as u32 + 1;
    let columns = count.min(COLUMNS);
    let (step_x, step_y) = (w + GAP, LINE + 2 * h + 2 * GAP);
    let (width, height) = (columns * step_x + GAP, count.div_ceil(columns) * step_y + GAP);
    let mut sheet = Sheet { width, height, pixels: vec![PAPER; (width * height) as usize] };
    let at = |i: u32| (GAP + i % columns * step_x, GAP + i / columns * step_y);
    let (x, y) = at(0);
    sheet.text(x, y, "reference");
    sheet.picture(x, y + LINE, &cell);
    for (i, curve) in (1..).zip(curves) {
        let (x, y) = at(i);
        let error = curve.points.last().map_or(String::new(), |p| format!(" {:.1e}", p.relmse));
        sheet.text(x, y, &format!("{}{error}", curve.method));
        sheet.picture(x, y + LINE, &fit(&curve.image));
        sheet.picture(x, y + LINE + h + GAP, &fit(&curve.heat_image()));
    }
    Image::from_rgb(width, height, &sheet.pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_are_enlarged_and_large_ones_shrunk() {
        let image = |width: u32, height: u32| {
            let pixels: Vec<[f32; 3]> = (0..width * height).map(|i| [(i % width) as f32 / width as f32; 3]).collect();
            Image::from_rgb(width, height, &pixels)
        };
        for (width, height) in [(1, 1), (48, 36), (271, 3), (272, 3), (360, 10), (4000, 20)] {
            let (w, h, pixels) = fit(&image(width, height));
            assert!((LEAST_WIDTH..=2 * LEAST_WIDTH).contains(&w) && pixels.len() as u32 == w * h, "{width} to {w}");
            assert!((pixels[(w - 1) as usize][0] - (width - 1) as f32 / width as f32).abs() < 0.01);
        }
        let (w, h, pixels) = fit(&image(1, 60_000));
        assert!((w, h) == (1, 60_000) && pixels.len() == 60_000);
    }
}
