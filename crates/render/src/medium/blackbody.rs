//! Colors of bodies that glow.

use crate::math::fns;
use crate::spectrum::Spectrum;

/// Step of [`Table`] in kelvin.
const STEP: f32 = 25.0;
/// Steps of [`Table`].
const STEPS: usize = 512;

/// [`color`] in steps, for look-ups at every collision.
#[derive(Clone, Debug)]
pub struct Table(Box<[Spectrum]>);

impl Table {
    /// Up to 12 800 K; beyond, [`color`] is computed anew.
    pub fn new() -> Self {
        Self((0..=STEPS).map(|i| Spectrum::from_rgb(color(i as f32 * STEP))).collect())
    }

    /// The color of a temperature.
    #[inline]
    pub fn color(&self, kelvin: f32) -> Spectrum {
        let x = kelvin / STEP;
        if !(x >= 0.0) {
            return Spectrum::ZERO;
        }
        match self.0.get((x as usize).saturating_add(1)) {
            Some(next) => self.0[x as usize].lerp(*next, x - x.floor()),
            None => Spectrum::from_rgb(color(kelvin)),
        }
    }
}

/// Linear Rec. 709 color of a black body, for a spectral radiance that is 1 at its highest over all wavelengths (Planck's law divided
/// by its maximum at Wien's wavelength). Black below 100 K, where nothing glows.
///
/// The spectrum is integrated against the color matching functions of Wyman, Sloan and Shirley 2013 ("Simple Analytic Approximations to
/// the CIE XYZ Color Matching Functions", JCGT 2(2)), scaled so that an equal-energy spectrum of 1 has Y = 1.
pub fn color(kelvin: f32) -> [f32; 3] {
    if !(kelvin >= 100.0) {
        return [0.0; 3];
    }
    const C2: f32 = 1.438_777e7;
    // The largest value of x⁵ / (eˣ − 1), in the variable x = hc/λkT of Planck's law.
    const AT_PEAK: f32 = 21.201_436;
    let kelvin = kelvin.min(1e6);
    let gauss = |x: f32, mean: f32, below: f32, above: f32| {
        let t = (x - mean) * if x < mean { below } else { above };
        fns::exp(-0.5 * t * t)
    };
    let mut xyz = [0.0f32; 3];
    let mut nm = 380.0;
    while nm <= 780.0 {
        let x = C2 / (nm * kelvin);
        let radiance = if x > 80.0 { 0.0 } else { fns::pow(x, 5.0) / (fns::exp_m1(x) * AT_PEAK) };
        let bars = [
            1.056 * gauss(nm, 599.8, 0.0264, 0.0323) + 0.362 * gauss(nm, 442.0, 0.0624, 0.0374) - 0.065 * gauss(nm, 501.1, 0.0490, 0.0382),
            0.821 * gauss(nm, 568.8, 0.0213, 0.0247) + 0.286 * gauss(nm, 530.9, 0.0613, 0.0322),
            1.217 * gauss(nm, 437.0, 0.0845, 0.0278) + 0.681 * gauss(nm, 459.0, 0.0385, 0.0725),
        ];
        for k in 0..3 {
            xyz[k] += 10.0 * radiance * bars[k] / 106.857;
        }
        nm += 10.0;
    }
    let [x, y, z] = xyz;
    // Negative where the color is more saturated than the primaries: reds of low temperatures lose their blue.
    [
        (3.240_479 * x - 1.537_150 * y - 0.498_535 * z).max(0.0),
        (-0.969_256 * x + 1.875_991 * y + 0.041_556 * z).max(0.0),
        (0.055_648 * x - 0.204_043 * y + 1.057_311 * z).max(0.0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hotter_bodies_are_bluer_and_the_table_agrees() {
        let mut last = 0.0;
        for kelvin in [1200.0, 2000.0, 3000.0, 4500.0, 6500.0, 10_000.0] {
            let [r, g, b] = color(kelvin);
            assert!(b / r >= last && g > 0.0, "{kelvin}: {r} {g} {b}");
            last = b / r;
            let t = Table::new().color(kelvin + 3.0).rgb();
            let exact = color(kelvin + 3.0);
            assert!((0..3).all(|k| (t[k] - exact[k]).abs() < 2e-3), "{kelvin} {t:?} {exact:?}");
        }
        // 6500 K is nearly white, and nearly all of the visible spectrum is near its peak.
        let [r, g, b] = color(6500.0);
        assert!((r / g - 1.0).abs() < 0.12 && (b / g - 1.0).abs() < 0.12 && (g - 0.93).abs() < 0.07, "{r} {g} {b}");
        assert_eq!(color(50.0), [0.0; 3]);
        assert!(Table::new().color(f32::NAN).is_black() && Table::new().color(f32::INFINITY).is_finite());
    }
}
