//! From linear radiance to the numbers a display takes.

use serde::{Deserialize, Serialize};

use super::{linear_from_srgb, srgb_from_linear};
use crate::math::fns;

/// The curve that fits the range of the picture into that of the display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ToneOperator {
    /// No curve: clipped at 1, then the sRGB transfer function.
    #[default]
    Standard,
    /// Hable 2010, "Uncharted 2: HDR Lighting" (Game Developers Conference): the curve with white at 11.2, after an
    /// exposure of 2 as given there.
    Filmic,
    /// The Academy's reference rendering and output transforms in the fit by Stephen Hill (in MJP's BakingLab, 2016).
    Aces,
    /// Troy Sobotka's AgX (2022) with the sixth-order fit of its contrast curve by Benjamin Wrensch ("Minimal AgX", 2023).
    Agx,
}

impl ToneOperator {
    /// Names for [`ToneOperator::from_name`].
    pub const NAMES: [&str; 4] = ["standard", "filmic", "aces", "agx"];

    /// The operator of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "standard" => Self::Standard,
            "filmic" => Self::Filmic,
            "aces" => Self::Aces,
            "agx" => Self::Agx,
            _ => return None,
        })
    }
}

/// Exposure and curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ToneMap {
    /// In stops: each doubles the light.
    pub exposure: f32,
    /// The curve.
    pub operator: ToneOperator,
}

impl ToneMap {
    /// Display numbers in [0, 1], encoded for sRGB, of linear Rec. 709 values. NaN becomes 0.
    pub fn apply(&self, rgb: [f32; 3]) -> [f32; 3] {
        let scale = fns::exp2(self.exposure);
        // Far beyond any display and far from overflow in the curves.
        let x = rgb.map(|v| if v > 0.0 { (v * scale).min(1e6) } else { 0.0 });
        match self.operator {
            ToneOperator::Standard => x.map(|v| srgb_from_linear(v.min(1.0))),
            ToneOperator::Filmic => x.map(|v| srgb_from_linear((hable(2.0 * v) / hable(11.2)).clamp(0.0, 1.0))),
            ToneOperator::Aces => aces(x).map(srgb_from_linear),
            ToneOperator::Agx => agx(x),
        }
    }
}

/// Eight bits of a display number in [0, 1].
pub(super) fn code_u8(v: f32) -> u8 {
    (v * 255.0 + 0.5) as u8
}

/// Cells of the table of [`Codes`].
const CELLS: usize = 4096;

/// Eight-bit codes through the operator [`ToneOperator::Standard`] without a power for each: the codes' lower ends are known.
pub(super) struct Codes {
    scale: f32,
    /// The least value of each code; the last is never reached.
    ends: [f32; 257],
    /// The code at the lower end of each cell of [0, 1].
    cells: Vec<u8>,
}

impl Codes {
    /// For an exposure; `None` where the operator is another.
    pub(super) fn new(tone: &ToneMap) -> Option<Self> {
        if tone.operator != ToneOperator::Standard {
            return None;
        }
        let mut ends = [f32::INFINITY; 257];
        ends[0] = 0.0;
        for (code, end) in ends.iter_mut().enumerate().take(256).skip(1) {
            let is_below = |bits: u32| usize::from(code_u8(srgb_from_linear(f32::from_bits(bits)))) < code;
            let guess = linear_from_srgb((code as f32 - 0.5) / 255.0);
            let (mut lo, mut hi) = ((guess * 0.999_99).to_bits(), (guess * 1.000_01).to_bits());
            if !is_below(lo) || is_below(hi) {
                (lo, hi) = (0, 1.0f32.to_bits());
            }
            // `lo` is below, `hi` is not.
            while hi - lo > 1 {
                let middle = lo + (hi - lo) / 2;
                if is_below(middle) { lo = middle } else { hi = middle }
            }
            *end = f32::from_bits(hi);
        }
        let mut code = 0;
        let cells = (0..=CELLS).map(|i| {
            while ends[code + 1] <= i as f32 / CELLS as f32 {
                code += 1;
            }
            code as u8
        });
        let cells = cells.collect();
        Some(Self { scale: fns::exp2(tone.exposure), ends, cells })
    }

    /// The code of a linear value; that of [`ToneMap::apply`].
    #[inline]
    pub(super) fn code(&self, v: f32) -> u8 {
        let x = if v > 0.0 { (v * self.scale).min(1.0) } else { 0.0 };
        let mut code = self.cells[(x * CELLS as f32) as usize];
        while x >= self.ends[usize::from(code) + 1] {
            code += 1;
        }
        code
    }
}

fn hable(x: f32) -> f32 {
    let [a, b, c, d, e, f] = [0.15, 0.5, 0.1, 0.2, 0.02, 0.3];
    (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f
}

fn mul(m: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Linear display values of linear Rec. 709.
fn aces(rgb: [f32; 3]) -> [f32; 3] {
    // Rec. 709 to AP1 with the reference rendering transform's desaturation, and back with the output transform's.
    const INPUT: [[f32; 3]; 3] = [[0.597_19, 0.354_58, 0.048_23], [0.076, 0.908_34, 0.015_66], [0.0284, 0.133_83, 0.837_77]];
    const OUTPUT: [[f32; 3]; 3] = [[1.604_75, -0.531_08, -0.073_67], [-0.102_08, 1.108_13, -0.006_05], [-0.003_27, -0.072_76, 1.076_02]];
    let fitted = mul(&INPUT, rgb).map(|v| (v * (v + 0.024_578_6) - 0.000_090_537) / (v * (0.983_729 * v + 0.432_951) + 0.238_081));
    mul(&OUTPUT, fitted).map(|v| v.clamp(0.0, 1.0))
}

/// Encoded display values of linear Rec. 709.
fn agx(rgb: [f32; 3]) -> [f32; 3] {
    const INSET: [[f32; 3]; 3] = [
        [0.842_479_06, 0.078_433_6, 0.079_223_745],
        [0.042_328_242, 0.878_468_64, 0.079_166_13],
        [0.042_375_655, 0.078_433_6, 0.879_142_97],
    ];
    const OUTSET: [[f32; 3]; 3] = [
        [1.196_879, -0.098_020_88, -0.099_029_744],
        [-0.052_896_85, 1.151_903_1, -0.098_961_18],
        [-0.052_971_635, -0.098_043_45, 1.151_073_7],
    ];
    let (ev_min, ev_max) = (-12.473_93, 4.026_069);
    let curved = mul(&INSET, rgb).map(|v| {
        let t = ((fns::log2(v.max(1e-10)) - ev_min) / (ev_max - ev_min)).clamp(0.0, 1.0);
        let fit = [-0.002_32, 0.1191, 0.4298, -6.868, 31.96, -40.14, 15.5];
        fit.iter().rev().fold(0.0, |sum, c| sum * t + c)
    });
    mul(&OUTSET, curved).map(|v| v.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> [ToneMap; 4] {
        ToneOperator::NAMES.map(|n| ToneMap { exposure: 0.0, operator: ToneOperator::from_name(n).unwrap() })
    }

    #[test]
    fn grays_are_monotone_from_black_to_white_and_stay_gray() {
        for tone in all() {
            let mut previous = -1.0;
            for i in 0..=2000 {
                let v = if i == 0 { 0.0 } else { fns::exp2(i as f32 / 80.0 - 15.0) };
                let out = tone.apply([v; 3]);
                assert!(out.iter().all(|o| (0.0..=1.0).contains(o)));
                assert!(out[0] >= previous - 1e-6, "{tone:?} falls at {v}");
                assert!((out[0] - out[1]).abs() < 2e-3 && (out[0] - out[2]).abs() < 2e-3, "{tone:?}: {v} gives {out:?}");
                previous = out[0];
            }
            assert!(tone.apply([0.0; 3]).iter().all(|&v| v < 2e-3), "{tone:?}: black gives {:?}", tone.apply([0.0; 3]));
            assert!(previous > 0.97, "{tone:?}: bright gives {previous}");
            assert_eq!(tone.apply([f32::NAN, f32::INFINITY, -1.0]).map(f32::is_nan), [false; 3]);
        }
    }

    #[test]
    fn codes_are_those_of_the_curve() {
        for exposure in [0.0, -1.3, 2.0] {
            let tone = ToneMap { exposure, ..ToneMap::default() };
            let codes = Codes::new(&tone).unwrap();
            let specials = [f32::NAN, f32::INFINITY, -1.0, 0.0, -0.0, 1.0, 5.0, f32::MIN_POSITIVE, 1e-40];
            for v in (0..200_000).map(|i| i as f32 * 6e-6).chain(specials) {
                assert_eq!(codes.code(v), code_u8(tone.apply([v; 3])[0]), "{v} at {exposure}");
            }
            for v in codes.ends.iter().take(256).flat_map(|&v| [v.next_down(), v, v.next_up()]) {
                let v = v / codes.scale;
                assert!(codes.code(v).abs_diff(code_u8(tone.apply([v; 3])[0])) == 0, "{v} at {exposure}");
            }
        }
        assert!(Codes::new(&ToneMap { operator: ToneOperator::Agx, exposure: 0.0 }).is_none());
    }

    #[test]
    fn mid_gray_and_exposure() {
        // 0.18 as code values, worked out by hand from the formulas. AgX is made to pass near 0.5 there.
        let expected = [0.4614, 0.3938, 0.3589, 0.4967];
        for (tone, expected) in all().into_iter().zip(expected) {
            let gray = tone.apply([0.18; 3])[1];
            assert!((gray - expected).abs() < 1e-3, "{tone:?}: {gray} instead of {expected}");
            let brighter = ToneMap { exposure: 1.0, ..tone };
            assert_eq!(brighter.apply([0.1, 0.2, 0.3]), tone.apply([0.2, 0.4, 0.6]));
        }
    }
}
