//! Focal blur of the classic model: pixels take rays through the lens until their color is known well enough.
//!
//! The documentation of POV-Ray ("Focal Blur") says that a pixel is done when it is, with a given confidence, within a variance of its true
//! color, and that there are least and most rays; its rule itself was not to be found by measuring, only that it first decides three rays
//! after the least number, and that colors count as they are, not cut at 1. Here it is the normal distribution's: done where
//! z · s / √n ≤ √variance in each of red, green and blue, of n rays with the standard deviation s, at every third ray.
//!
//! Whether a ray is needed is a function of those before it in the same pixel, so a film holds the same samples whoever renders which part
//! of it: what is known of a tile's pixels is kept from pass to pass, and rays that another run has made are made again for the decision.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use etendue_procedural::fns;
use etendue_scene::desc::classic::FocalBlur;

use super::{Session, own_rgb};
use crate::film::{Film, Rect};

/// Rays between decisions.
const STEP: u32 = 3;

/// When a blurred pixel takes no more rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Confidence {
    /// Rays after which there is no decision yet.
    pub least: u32,
    /// The variance of the mean that is good enough, over the square of the normal distribution's quantile.
    pub variance: f64,
}

impl Confidence {
    /// What a camera asks for; `None` where every pixel takes all rays.
    pub fn new(blur: &FocalBlur) -> Option<Self> {
        let is_usual = blur.variance > 0.0 && blur.confidence > 0.0 && blur.confidence < 1.0;
        let z = two_sided_quantile(blur.confidence);
        (blur.is_on() && is_usual && blur.samples[0] + STEP < blur.samples[1])
            .then(|| Self { least: blur.samples[0].max(1), variance: blur.variance / (z * z).max(1e-12) })
    }

    fn decides(&self, n: u32) -> bool {
        n > self.least && (n - self.least).is_multiple_of(STEP)
    }
}

/// The number of standard deviations around the mean between which a normal variable lies with a probability in (0, 1).
fn two_sided_quantile(probability: f64) -> f64 {
    let (mut lo, mut hi) = (0.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (lo + hi);
        if fns::erf(middle * std::f64::consts::FRAC_1_SQRT_2) < probability { lo = middle } else { hi = middle }
    }
    lo
}

/// When blurred pixels are done, and what is known of those of tiles, by the tile's first pixel.
pub(super) struct Blurred {
    confidence: Confidence,
    tiles: Mutex<HashMap<(u32, u32), Vec<Spread>>>,
}

impl Blurred {
    pub(super) fn new(confidence: Confidence) -> Self {
        Self { confidence, tiles: Mutex::default() }
    }

    /// For another part of the picture.
    pub(super) fn anew(&self) -> Self {
        Self::new(self.confidence)
    }

    fn tiles(&self) -> std::sync::MutexGuard<'_, HashMap<(u32, u32), Vec<Spread>>> {
        self.tiles.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Mean and squared differences from it, by color, of the samples of a pixel (Welford 1962, doi:10.1080/00401706.1962.10490022).
#[derive(Clone, Default)]
struct Spread {
    n: u32,
    is_done: bool,
    mean: [f64; 3],
    squares: [f64; 3],
}

impl Spread {
    fn add(&mut self, color: [f32; 3]) {
        self.n += 1;
        let n = f64::from(self.n);
        for ((v, mean), squares) in color.into_iter().zip(&mut self.mean).zip(&mut self.squares) {
            // What is no number counts as black, as in the film.
            let v = if v.is_finite() { f64::from(v) } else { 0.0 };
            let difference = v - *mean;
            *mean += difference / n;
            *squares += difference * (v - *mean);
        }
    }

    /// The largest variance of the mean of a color.
    fn variance_of_mean(&self) -> f64 {
        let n = f64::from(self.n);
        self.squares.iter().copied().fold(0.0, f64::max) / (n * (n - 1.0).max(1.0))
    }
}

impl Session {
    /// Samples `begin..end` of a tile's pixels, as far as each needs them.
    pub(super) fn blurred_tile(&self, blurred: &Blurred, tile: &mut Film, rect: Rect, begin: u32, end: u32) {
        let Blurred { confidence, .. } = blurred;
        let known = blurred.tiles().remove(&(rect.x0, rect.y0));
        let mut spreads = known.filter(|s| s.len() as u64 == rect.area()).unwrap_or_else(|| vec![Spread::default(); rect.area() as usize]);
        let mut of_pixels = spreads.iter_mut();
        let space = self.film.spec().space;
        let mut estimate = self.new_estimate();
        let mut values = Vec::new();
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                let Some(spread) = of_pixels.next() else { return };
                if spread.n > begin {
                    // A film that was begun anew.
                    *spread = Spread::default();
                }
                let stream = self.sampler.stream(x, y, 0);
                for index in spread.n..end {
                    spread.is_done |= confidence.decides(index) && spread.variance_of_mean() <= confidence.variance;
                    if spread.is_done {
                        break;
                    }
                    let (weight, _) = self.sample(x, y, stream.of_sample(index), &mut estimate);
                    spread.add(own_rgb(&estimate, space));
                    if index >= begin {
                        self.add(tile, x, y, index, weight, space, &estimate, &mut values);
                    }
                }
            }
        }
        blurred.tiles().insert((rect.x0, rect.y0), spreads);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_the_normal_distributions() {
        for (probability, z) in [(0.5, 0.67449), (0.9, 1.64485), (0.99, 2.57583)] {
            assert!((two_sided_quantile(probability) - z).abs() < 1e-5, "{probability}");
        }
    }

    #[test]
    fn spreads_are_those_of_the_samples() {
        let mut spread = Spread::default();
        [[1.0, 5.0, 0.0], [2.0, 5.0, f32::NAN], [4.0, 5.0, 0.0]].into_iter().for_each(|c| spread.add(c));
        // Mean 7/3, squares 14/3.
        assert!((spread.variance_of_mean() - 14.0 / 3.0 / 6.0).abs() < 1e-12 && spread.squares[1] == 0.0);
    }

    #[test]
    fn decisions_follow_the_least_number() {
        let blur = |samples: [u32; 2]| FocalBlur { aperture: 1.0, samples, ..FocalBlur::default() };
        let rule = Confidence::new(&blur([4, 100])).unwrap();
        assert_eq!((0..15).filter(|n| rule.decides(*n)).collect::<Vec<_>>(), [7, 10, 13]);
        assert!(Confidence::new(&blur([7, 7])).is_none());
        assert!(Confidence::new(&FocalBlur { variance: 0.0, ..blur([4, 100]) }).is_none());
    }
}
