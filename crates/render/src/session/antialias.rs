//! Adaptive antialiasing: more samples only where the color of a pixel's center differs from that of a neighbor's center.
//!
//! As POV-Ray's non-recursive method (documentation, 3.2.8.7 "Anti-Aliasing Options"): the first sample of a pixel goes through its
//! center, and pixels whose colors differ by more than a threshold get n × n more, all counted alike. The difference is the sum over
//! red, green and blue of |a^(1/2.5) − b^(1/2.5)|. Measured with POV-Ray 3.7.0.10: a and b are linear light, not cut at 1, and the
//! center's sample stays one of the n² + 1.
//!
//! Whether a sample is needed is a function of the scene, the settings and the pixel, so a film holds the same samples whoever
//! renders which part of it: a neighbor's center that has not been traced here is traced for the comparison.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use etendue_procedural::fns;

use crate::classic::WorkingSpace;
use crate::film::Rect;
use crate::spectrum::Spectrum;

/// When a pixel gets more than one sample, and how many.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Antialias {
    /// Smallest difference of neighbors that is smoothed, 0 to 3.
    pub threshold: f32,
    /// Rows and columns of the further samples.
    pub depth: u32,
}

impl Antialias {
    /// Samples of a pixel that needs all of them: the center and the grid.
    pub fn spp(&self) -> u32 {
        1 + self.depth * self.depth
    }
}

/// Not the bits of a finite number.
const UNKNOWN: u32 = u32::MAX;

/// The colors of pixel centers as they are compared.
pub(super) struct Centers {
    antialias: Antialias,
    /// The pixels that are rendered and those around them, within the picture.
    rect: Rect,
    /// Bits of three numbers; [`UNKNOWN`] until they are known. Threads that meet write the same numbers, so that no order matters.
    colors: Vec<[AtomicU32; 3]>,
}

impl Centers {
    /// For the pixels of `crop` in a picture of a size. Takes 12 bytes a pixel.
    pub(super) fn new(antialias: Antialias, crop: Rect, width: u32, height: u32) -> Self {
        let rect = Rect::new(crop.x0.saturating_sub(1), crop.y0.saturating_sub(1), (crop.x1 + 1).min(width), (crop.y1 + 1).min(height));
        let mut colors = Vec::new();
        colors.resize_with(rect.area() as usize, || [const { AtomicU32::new(UNKNOWN) }; 3]);
        Self { antialias, rect, colors }
    }

    /// The settings.
    pub(super) fn antialias(&self) -> Antialias {
        self.antialias
    }

    /// Keeps the radiance of a center that has been traced, in numbers of a space.
    pub(super) fn keep(&self, x: u32, y: u32, radiance: Spectrum, space: WorkingSpace) {
        if let Some(slot) = self.slot(x, y) {
            write(slot, compared(radiance, space));
        }
    }

    /// Whether a pixel needs the samples after its first; `trace` gives the radiance of a center and the space of its numbers.
    pub(super) fn differs(&self, x: u32, y: u32, mut trace: impl FnMut(u32, u32) -> (Spectrum, WorkingSpace)) -> bool {
        if let Some(differs) = self.differs_from_known(x, y) {
            return differs;
        }
        let Some(own) = self.color(x, y, &mut trace) else { return false };
        let neighbors = [(x.wrapping_sub(1), y), (x, y.wrapping_sub(1)), (x + 1, y), (x, y + 1)];
        neighbors.into_iter().any(|(x, y)| {
            let Some(other) = self.color(x, y, &mut trace) else { return false };
            self.is_far(&own, &other)
        })
    }

    fn is_far(&self, a: &[f32; 3], b: &[f32; 3]) -> bool {
        let difference = (a[0] - b[0]).abs() + (a[1] - b[1]).abs() + (a[2] - b[2]).abs();
        difference > self.antialias.threshold
    }

    /// [`Centers::differs`] for the usual pixel: not at the edge, and all around it known.
    fn differs_from_known(&self, x: u32, y: u32) -> Option<bool> {
        let r = &self.rect;
        if !(x > r.x0 && y > r.y0 && x + 1 < r.x1 && y + 1 < r.y1) {
            return None;
        }
        let width = r.width() as usize;
        let at = (y - r.y0) as usize * width + (x - r.x0) as usize;
        let rows = self.colors.get(at - width..=at + width)?;
        let known = |i: usize| {
            let [r, g, b] = &rows[i];
            let [r, g, b] = [r.load(Relaxed), g.load(Relaxed), b.load(Relaxed)];
            let is_known = r != UNKNOWN && g != UNKNOWN && b != UNKNOWN;
            is_known.then(|| [f32::from_bits(r), f32::from_bits(g), f32::from_bits(b)])
        };
        let own = known(width)?;
        for i in [width - 1, width + 1, 0, 2 * width] {
            if self.is_far(&own, &known(i)?) {
                return Some(true);
            }
        }
        Some(false)
    }

    fn slot(&self, x: u32, y: u32) -> Option<&[AtomicU32; 3]> {
        let inside = self.rect.contains(x, y);
        let at = || (y - self.rect.y0) as usize * self.rect.width() as usize + (x - self.rect.x0) as usize;
        if inside { self.colors.get(at()) } else { None }
    }

    /// `None` beyond the picture.
    fn color(&self, x: u32, y: u32, trace: &mut impl FnMut(u32, u32) -> (Spectrum, WorkingSpace)) -> Option<[f32; 3]> {
        let slot = self.slot(x, y)?;
        let bits = slot.each_ref().map(|v| v.load(Relaxed));
        if !bits.contains(&UNKNOWN) {
            return Some(bits.map(f32::from_bits));
        }
        let (radiance, space) = trace(x, y);
        let color = compared(radiance, space);
        write(slot, color);
        Some(color)
    }
}

fn write(slot: &[AtomicU32; 3], color: [f32; 3]) {
    for (to, v) in slot.iter().zip(color) {
        to.store(v.to_bits(), Relaxed);
    }
}

/// The measure of the comparison; what is no number counts as black, as in the film.
fn compared(radiance: Spectrum, space: WorkingSpace) -> [f32; 3] {
    let measure = |v: f32| {
        let v = f64::from(if v.is_finite() { v } else { 0.0 });
        let measure = match space {
            WorkingSpace::Power(g) => fns::pow_about(v.abs(), 0.4 * g),
            _ => two_fifths(space.linear(v.abs())),
        };
        measure.copysign(v) as f32
    };
    let [r, g, b] = radiance.rgb();
    let of_r = measure(r);
    [of_r, if g == r { of_r } else { measure(g) }, if b == r { of_r } else { measure(b) }]
}

/// x^(2/5) to about 1e-9, for x ≥ 0: two steps of Halley's method for y⁵ = x², which take half of the time of a power.
fn two_fifths(x: f64) -> f64 {
    let square = x * x;
    if !(square > 1e-300 && square < 1e300) {
        return fns::pow(x, 0.4);
    }
    // A fifth of the exponent, and of the mantissa as it stands for its logarithm.
    let mut y = f64::from_bits(square.to_bits() / 5 + (1023 << 52) / 5 * 4);
    for _ in 0..2 {
        let fifth = y * y * (y * y) * y;
        y *= (2.0 * fifth + 3.0 * square) / (3.0 * fifth + 2.0 * square);
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the left of two pixels of gray a and b is smoothed.
    fn smooths(a: f32, b: f32, threshold: f32) -> bool {
        let centers = Centers::new(Antialias { threshold, depth: 3 }, Rect::new(0, 0, 1, 1), 2, 1);
        centers.differs(0, 0, |x, _| (Spectrum::splat(if x == 0 { a } else { b }), WorkingSpace::Linear))
    }

    #[test]
    fn pixels_differ_as_measured() {
        // POV-Ray 3.7.0.10 with +A0.3: an edge between two grays is smoothed or is not.
        for (a, b, smooth) in [(0.01, 0.05, true), (0.5, 0.62, false), (0.5, 0.68, false), (0.9, 8.0, true), (4e-5, 1.37e-3, false)] {
            assert_eq!(smooths(a, b, 0.3), smooth, "{a} {b}");
        }
        assert!(!smooths(0.0, f32::NAN, 0.3) && !smooths(0.2, 0.2, 0.0) && smooths(0.2, 0.21, 0.0));
    }

    #[test]
    fn the_measure_is_a_power_of_linear_light() {
        for i in 0..4000 {
            let x = fns::exp(f64::from(i) * 0.02 - 40.0);
            assert!((two_fifths(x) / fns::pow(x, 0.4) - 1.0).abs() < 1e-8, "{x}");
        }
        for space in [WorkingSpace::Power(2.2), WorkingSpace::Srgb] {
            for v in [0.0, 1e-3, 0.3, -0.7, 4.0] {
                let [a, b] = [(v, space), (space.linear(v), WorkingSpace::Linear)].map(|(v, s)| compared(Spectrum::splat(v as f32), s)[0]);
                assert!((a - b).abs() < 1e-6, "{space:?} {v}: {a} {b}");
            }
        }
        assert_eq!(compared(Spectrum::splat(f32::NAN), WorkingSpace::Linear), [0.0; 3]);
    }

    #[test]
    fn centers_are_traced_once_and_within_the_picture() {
        let centers = Centers::new(Antialias { threshold: 0.3, depth: 3 }, Rect::new(2, 0, 4, 2), 4, 2);
        let mut traced = Vec::new();
        for y in 0..2 {
            for x in 2..4 {
                assert!(!centers.differs(x, y, |x, y| {
                    traced.push((x, y));
                    (Spectrum::ZERO, WorkingSpace::Linear)
                }));
            }
        }
        traced.sort_unstable();
        assert_eq!(traced, [(1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1)]);
    }
}
