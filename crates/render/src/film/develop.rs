//! From sums to pictures and error estimates.

use super::splat::DevelopedSplats;
use super::{Film, Rect, SQUARE_ONE, SQUARES, real};
use crate::classic::WorkingSpace;
use crate::image::Image;

/// Planes beside the film's own channels.
#[derive(Clone, Copy, Debug, Default)]
pub struct DevelopOptions {
    /// Adds `variance.R`, `variance.G`, `variance.B`: of the pixel's mean, see [`Film::variance`].
    pub variance: bool,
    /// Adds `sampleCount`.
    pub sample_count: bool,
}

impl Film {
    /// The picture: every channel of the spec.
    pub fn develop(&self) -> Image {
        self.develop_with(DevelopOptions::default())
    }

    /// The picture with further planes.
    pub fn develop_with(&self, options: DevelopOptions) -> Image {
        let mut image = Image::new(self.rect.width(), self.rect.height());
        image.origin = [self.rect.x0 as i32, self.rect.y0 as i32];
        image.full_size = [self.spec().width, self.spec().height];
        let splats = DevelopedSplats::new(self);
        let is_plain = self.is_plain();
        // Plain films have no weights, and most of their pixels need no division.
        let divisors: Vec<f64> = if is_plain { Vec::new() } else { (0..self.counts.len()).map(|pixel| self.divisor(pixel)).collect() };
        for (index, channel) in self.spec().channels.iter().enumerate() {
            let data = match self.layout.means.iter().position(|&c| c == index) {
                Some(slot) if is_plain => {
                    let space = if index < 3 { self.spec().space } else { WorkingSpace::Linear };
                    let mean = |p: usize| self.plain_sum(p, slot) * self.divisor(p);
                    (0..self.counts.len()).map(|p| space.linear(mean(p)) as f32).collect()
                }
                Some(slot) => {
                    let stride = self.layout.means.len();
                    let space = if index < 3 { self.spec().space } else { WorkingSpace::Linear };
                    let splat = |p: usize| splats.as_ref().map_or(0.0, |s| s.mean(p, index));
                    let mean = |(p, d): (usize, &f64)| real(self.sums[p * stride + slot]) * d + splat(p);
                    if space == WorkingSpace::Linear {
                        divisors.iter().enumerate().map(|each| mean(each) as f32).collect()
                    } else {
                        divisors.iter().enumerate().map(|each| space.linear(mean(each)) as f32).collect()
                    }
                }
                None => {
                    let stride = self.layout.firsts.len();
                    let slot = self.layout.firsts.iter().position(|&c| c == index).unwrap_or(0);
                    (0..self.counts.len()).map(|p| self.first_values[p * stride + slot]).collect()
                }
            };
            image.push(channel.name.clone(), data);
        }
        if options.variance {
            for (slot, name) in ["variance.R", "variance.G", "variance.B"].into_iter().enumerate() {
                let splat = |p: usize| splats.as_ref().map_or(0.0, |s| s.variance(p, slot));
                image.push(name, (0..self.counts.len()).map(|pixel| (self.pixel_variance(pixel, slot) + splat(pixel)) as f32).collect());
            }
        }
        if options.sample_count {
            image.push("sampleCount", self.counts.iter().map(|&c| c as f32).collect());
        }
        image
    }

    /// One over what the sums of a pixel are divided by: the sum of weights. With filters that have negative parts
    /// it can come near zero or below for a pixel of few samples; then the count, its expectation, is used.
    fn divisor(&self, pixel: usize) -> f64 {
        if let (true, &n) = (self.is_plain(), &self.counts[pixel]) {
            return if n <= 1 { f64::from(n) } else { 1.0 / f64::from(n) };
        }
        let count = f64::from(self.counts[pixel]);
        let weight = real(self.weights[pixel]);
        if count == 0.0 { 0.0 } else { 1.0 / if weight > 0.25 * count { weight } else { count } }
    }

    /// Unbiased estimate of the variance of a pixel's mean; slot 0 to 2 = R, G, B, 3 = luminance. Infinite with less than
    /// two samples, and without sums of squares.
    fn pixel_variance(&self, pixel: usize, slot: usize) -> f64 {
        let n = f64::from(self.counts[pixel]);
        if n < 2.0 || !self.has_squares() {
            return f64::INFINITY;
        }
        let sum = if slot < 3 { self.sum(pixel, slot) } else { self.luminance_sum(pixel) };
        let squares = self.squares[pixel * SQUARES + slot] as f64 / SQUARE_ONE;
        ((squares - sum * sum / n) / (n * (n - 1.0))).max(0.0)
    }

    fn sum(&self, pixel: usize, slot: usize) -> f64 {
        if self.is_plain() {
            return self.plain_sum(pixel, slot);
        }
        real(self.sums[pixel * self.layout.means.len() + slot])
    }

    fn luminance_sum(&self, pixel: usize) -> f64 {
        0.212_671 * self.sum(pixel, 0) + 0.715_16 * self.sum(pixel, 1) + 0.072_169 * self.sum(pixel, 2)
    }

    /// Unbiased estimates of the variance of the mean luminance of each pixel, row by row:
    /// (Σ(wL)² − (ΣwL)²/n) / (n(n−1)), and that of the light that splats bring. It takes samples as independent; stratified and low-discrepancy samples have
    /// less error than it says. Infinite for pixels with less than two samples.
    pub fn variance(&self) -> Vec<f64> {
        let splats = DevelopedSplats::new(self);
        let splat = |p: usize| splats.as_ref().map_or(0.0, |s| s.variance(p, 3));
        (0..self.counts.len()).map(|pixel| self.pixel_variance(pixel, 3) + splat(pixel)).collect()
    }

    /// An estimate of the picture's relative error: √ of the mean over pixels of var / (mean² + 0.01), with the variance
    /// of the mean luminance. That is the square root of the relMSE which a comparison with the exact picture would find.
    /// Summed in a fixed order from exact sums, so it is the same on any machine. Infinite if a pixel has less than two samples.
    pub fn relative_error(&self) -> f64 {
        let splats = DevelopedSplats::new(self);
        let terms = (0..self.counts.len()).map(|pixel| {
            let (splat, splat_variance) = splats.as_ref().map_or((0.0, 0.0), |s| (s.luminance(pixel), s.variance(pixel, 3)));
            self.relative_variance(pixel, splat, splat_variance)
        });
        (terms.sum::<f64>() / self.counts.len() as f64).sqrt()
    }

    /// The same over the pixels of a rectangle within the film's, without the light of splats.
    pub(crate) fn relative_error_within(&self, rect: Rect) -> f64 {
        let rows = (rect.y0..rect.y1).map(|y| self.pixel(rect.x0, y));
        let pixels = rows.flat_map(|first| first..first + rect.width() as usize);
        (pixels.map(|pixel| self.relative_variance(pixel, 0.0, 0.0)).sum::<f64>() / rect.area() as f64).sqrt()
    }

    /// Variance of a pixel's mean luminance over its square, which counts as 0.01 more; both with what splats bring.
    fn relative_variance(&self, pixel: usize, splat: f64, splat_variance: f64) -> f64 {
        let mean = self.luminance_sum(pixel) * self.divisor(pixel) + splat;
        (self.pixel_variance(pixel, 3) + splat_variance) / (mean * mean + 0.01)
    }
}
