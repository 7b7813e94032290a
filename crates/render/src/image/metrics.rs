//! How much two pictures differ.

use serde::Serialize;

use super::flip::{FlipOptions, flip_hdr, flip_ldr};
use super::srgb_from_linear;
use super::{Image, ImageError};

/// Every figure for a picture against a reference, over R, G and B.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Mean of (x − ref)², linear.
    pub mse: f64,
    /// Mean of (x − ref)² / (ref² + 0.01), linear.
    pub relmse: f64,
    /// The same without the 0.1% of the pixels where it is worst.
    pub relmse_trimmed: f64,
    /// Mean of |x − ref|, linear.
    pub mae: f64,
    /// 10·log10(1 / MSE) in dB of the values encoded for display (clipped, sRGB). Infinite for equal pictures.
    #[serde(serialize_with = "finite_or_null")]
    pub psnr: f64,
    /// Mean structural similarity of the encoded luminance; 1 for equal pictures. None for pictures with a side below 11.
    pub ssim: Option<f64>,
    /// Mean FLIP of the encoded pictures (HDR-FLIP where asked for), in [0, 1].
    pub flip: f64,
    /// True where `flip` is HDR-FLIP.
    pub flip_is_hdr: bool,
    /// Mean of the picture over mean of the reference, for each of R, G and B (1 where both are black).
    pub mean_ratio: [f64; 3],
    /// Largest |x − ref|.
    pub max_abs: f64,
    /// Values that are not finite in the picture and in the reference; they count as 0 above.
    pub non_finite: [u64; 2],
}

/// JSON has no infinity.
fn finite_or_null<S: serde::Serializer>(v: &f64, s: S) -> Result<S::Ok, S::Error> {
    if v.is_finite() { s.serialize_some(v) } else { s.serialize_none() }
}

/// What else a comparison yields: FLIP of each pixel, row by row.
pub type ErrorMap = Vec<f32>;

/// Names for [`Comparison::get`].
pub const METRICS: [&str; 10] = ["mse", "relmse", "relmse-trimmed", "mae", "psnr", "ssim", "flip", "mean", "max", "nonfinite"];

impl Comparison {
    /// A figure by its name in [`METRICS`]; `mean` is the largest |ratio − 1| of the means.
    pub fn get(&self, name: &str) -> Option<f64> {
        Some(match name {
            "mse" => self.mse,
            "relmse" => self.relmse,
            "relmse-trimmed" => self.relmse_trimmed,
            "mae" => self.mae,
            "psnr" => self.psnr,
            "ssim" => self.ssim?,
            "flip" => self.flip,
            "mean" => self.mean_ratio.iter().map(|r| (r - 1.0).abs()).fold(0.0, f64::max),
            "max" => self.max_abs,
            "nonfinite" => (self.non_finite[0] + self.non_finite[1]) as f64,
            _ => return None,
        })
    }

    /// True where more of the figure is better (PSNR, SSIM).
    pub fn higher_is_better(name: &str) -> bool {
        matches!(name, "psnr" | "ssim")
    }
}

/// Compares a picture with a reference of the same size; `hdr` asks for HDR-FLIP, otherwise FLIP sees both clipped at 1.
///
/// # Errors
/// [`ImageError::Unsupported`] for different sizes, [`ImageError::Missing`] without R, G and B (or Y).
pub fn compare(image: &Image, reference: &Image, hdr: bool) -> Result<(Comparison, ErrorMap), ImageError> {
    if [image.width, image.height] != [reference.width, reference.height] {
        return Err(ImageError::Unsupported(format!(
            "pictures of different sizes, {}x{} and {}x{}",
            image.width, image.height, reference.width, reference.height
        )));
    }
    let load = |image: &Image| image.rgb().filter(|p| !p.is_empty()).ok_or_else(|| ImageError::Missing("channels R, G and B".into()));
    let (mut a, mut b) = (load(image)?, load(reference)?);
    let non_finite = [&mut a, &mut b].map(|pixels| {
        let bad = pixels.iter_mut().flatten().filter(|v| !v.is_finite());
        bad.map(|v| *v = 0.0).count() as u64
    });
    let width = image.width as usize;
    let n = (a.len() * 3) as f64;
    let differences = || a.iter().flatten().zip(b.iter().flatten()).map(|(&x, &r)| (f64::from(x) - f64::from(r), f64::from(r)));
    let mut relative: Vec<f64> = a.iter().zip(&b).map(|(x, r)| relative_square(*x, *r)).collect();
    let relmse = relative.iter().sum::<f64>() / a.len() as f64;
    relative.sort_by(f64::total_cmp);
    let kept = a.len() - a.len() / 1000;
    let encode = |p: &[[f32; 3]]| -> Vec<[f32; 3]> { p.iter().map(|p| p.map(|v| srgb_from_linear(v.clamp(0.0, 1.0)))).collect() };
    let (a_encoded, b_encoded) = (encode(&a), encode(&b));
    let encoded_mse = a_encoded.iter().flatten().zip(b_encoded.iter().flatten()).map(|(x, r)| f64::from(x - r).powi(2)).sum::<f64>() / n;
    let map = if hdr { flip_hdr(&b, &a, width, FlipOptions::default()) } else { flip_ldr(&b, &a, width, FlipOptions::default()) };
    let mean = |p: &[[f32; 3]], c: usize| p.iter().map(|p| f64::from(p[c])).sum::<f64>();
    let comparison = Comparison {
        mse: differences().map(|(d, _)| d * d).sum::<f64>() / n,
        relmse,
        relmse_trimmed: relative[..kept].iter().sum::<f64>() / kept as f64,
        mae: differences().map(|(d, _)| d.abs()).sum::<f64>() / n,
        psnr: -10.0 * libm::log10(encoded_mse),
        ssim: ssim(&luminance(&a_encoded), &luminance(&b_encoded), width),
        flip: map.iter().map(|&v| f64::from(v)).sum::<f64>() / map.len() as f64,
        flip_is_hdr: hdr,
        mean_ratio: [0, 1, 2].map(|c| {
            let (x, r) = (mean(&a, c), mean(&b, c));
            if x == r { 1.0 } else { x / r }
        }),
        max_abs: differences().map(|(d, _)| d.abs()).fold(0.0, f64::max),
        non_finite,
    };
    Ok((comparison, map))
}

/// relMSE alone, for pictures of the same size; values that are not finite count as 0.
///
/// # Errors
/// As [`compare`].
pub fn relmse(image: &Image, reference: &Image) -> Result<f64, ImageError> {
    let load = |image: &Image| image.rgb().filter(|p| !p.is_empty()).ok_or_else(|| ImageError::Missing("channels R, G and B".into()));
    let (a, b) = (load(image)?, load(reference)?);
    if [image.width, image.height] != [reference.width, reference.height] {
        return Err(ImageError::Unsupported("pictures of different sizes".into()));
    }
    let finite = |p: &[f32; 3]| p.map(|v| if v.is_finite() { v } else { 0.0 });
    Ok(a.iter().zip(&b).map(|(x, r)| relative_square(finite(x), finite(r))).sum::<f64>() / a.len() as f64)
}

fn relative_square(x: [f32; 3], r: [f32; 3]) -> f64 {
    x.iter().zip(r).map(|(&x, r)| (f64::from(x) - f64::from(r)).powi(2) / (f64::from(r).powi(2) + 0.01)).sum::<f64>() / 3.0
}

fn luminance(rgb: &[[f32; 3]]) -> Vec<f64> {
    rgb.iter().map(|p| 0.212_671 * f64::from(p[0]) + 0.715_16 * f64::from(p[1]) + 0.072_169 * f64::from(p[2])).collect()
}

/// Wang, Bovik, Sheikh, Simoncelli 2004, "Image Quality Assessment: From Error Visibility to Structural Similarity",
/// doi:10.1109/TIP.2003.819861, eq. 13: Gaussian windows of 11×11 and standard deviation 1.5 that lie within the
/// picture, K1 = 0.01, K2 = 0.03, range 1.
fn ssim(a: &[f64], b: &[f64], width: usize) -> Option<f64> {
    const WINDOW: usize = 11;
    let height = a.len() / width;
    if width < WINDOW || height < WINDOW {
        return None;
    }
    let taps: [f64; WINDOW] = std::array::from_fn(|i| libm::exp(-(i as f64 - 5.0).powi(2) / 4.5));
    let sum: f64 = taps.iter().sum();
    let taps = taps.map(|t| t / sum);
    let blur = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let inner = width - WINDOW + 1;
        let rows: Vec<f64> = (0..height * inner)
            .map(|i| {
                let start = i / inner * width + i % inner;
                taps.iter().enumerate().map(|(k, t)| t * value(start + k)).sum()
            })
            .collect();
        (0..(height - WINDOW + 1) * inner).map(|i| taps.iter().enumerate().map(|(k, t)| t * rows[i + k * inner]).sum()).collect()
    };
    let mean_a = blur(&|i| a[i]);
    let mean_b = blur(&|i| b[i]);
    let squares_a = blur(&|i| a[i] * a[i]);
    let squares_b = blur(&|i| b[i] * b[i]);
    let products = blur(&|i| a[i] * b[i]);
    let (c1, c2) = (0.01f64.powi(2), 0.03f64.powi(2));
    let total: f64 = (0..mean_a.len())
        .map(|i| {
            let (ma, mb) = (mean_a[i], mean_b[i]);
            let (va, vb, cov) = (squares_a[i] - ma * ma, squares_b[i] - mb * mb, products[i] - ma * mb);
            (2.0 * ma * mb + c1) * (2.0 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
        })
        .sum();
    Some(total / mean_a.len() as f64)
}

/// A picture of values from 0 to 1 in the colors of matplotlib's "magma", from black over purple to pale yellow, as
/// linear R, G, B (written as PNG it has the map's own colors). The polynomial fit is Matt Zucker's (2019, public domain).
pub fn heatmap(width: u32, height: u32, values: &[f32]) -> Image {
    const FIT: [[f32; 3]; 7] = [
        [-0.002_136_485, -0.000_749_655, -0.005_386_128],
        [0.251_660_54, 0.677_523_24, 2.494_026_6],
        [8.353_717, -3.577_719_5, 0.314_467_9],
        [-27.668_733, 14.264_731, -13.649_213],
        [52.176_14, -27.943_606, 12.944_169],
        [-50.768_525, 29.046_583, 4.234_153],
        [18.655_705, -11.489_774, -5.601_961_5],
    ];
    let color = |t: f32| {
        let t = if t > 0.0 { t.min(1.0) } else { 0.0 };
        [0, 1, 2].map(|c| super::linear_from_srgb(FIT.iter().rev().fold(0.0, |sum, k| sum * t + k[c]).clamp(0.0, 1.0)))
    };
    let pixels: Vec<[f32; 3]> = values.iter().map(|&v| color(v)).collect();
    Image::from_rgb(width, height, &pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::linear_from_srgb_u8;
    use crate::math::hash::mix32;

    const SIZE: [u32; 2] = [61, 47];

    /// 8-bit codes of a gradient cut into checks, and the same with noise and a darker rectangle.
    fn code(x: u32, y: u32, c: u32, noisy: bool) -> u8 {
        let mut v = ((x * 3 + y * 2 + c * 40) % 256) as i64;
        if (x / 9 + y / 7) % 2 == 1 {
            v = 255 - v;
        }
        if noisy {
            v += i64::from(mix32((y * SIZE[0] + x) * 3 + c) % 41) - 20;
            if (20..35).contains(&x) && (10..30).contains(&y) {
                v = v.div_euclid(2);
            }
        }
        v.clamp(0, 255) as u8
    }

    fn picture(noisy: bool, decode: impl Fn(u8) -> f32) -> Image {
        let pixels = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)));
        let pixels: Vec<_> = pixels.map(|(x, y)| [0, 1, 2].map(|c| decode(code(x, y, c, noisy)))).collect();
        Image::from_rgb(SIZE[0], SIZE[1], &pixels)
    }

    fn close(a: f64, b: f64, tolerance: f64) {
        assert!((a - b).abs() < tolerance, "{a} instead of {b}");
    }

    /// Expected figures: NumPy, scikit-image 0.26 (SSIM) and the authors' flip-evaluator 1.7 on the same pictures.
    #[test]
    fn figures_agree_with_other_programs() {
        let (test, reference) = (picture(true, linear_from_srgb_u8), picture(false, linear_from_srgb_u8));
        let (c, map) = compare(&test, &reference, false).unwrap();
        close(c.mse, 0.009_155_933, 1e-8);
        close(c.mae, 0.055_274_469, 1e-7);
        close(c.relmse, 0.062_524_231, 1e-7);
        close(c.relmse_trimmed, 0.062_130_411, 1e-7);
        close(c.psnr, 20.172_795_06, 1e-5);
        close(c.ssim.unwrap(), 0.815_491_548, 1e-6);
        close(c.flip, 0.178_382_561, 1e-6);
        close(c.mean_ratio[2], 0.923_651_71, 1e-6);
        close(c.get("mean").unwrap(), 1.0 - 0.923_651_71, 1e-6);
        let pixels = |map: &ErrorMap| [(0, 0), (30, 20), (60, 46), (10, 40)].map(|(x, y)| f64::from(map[y * SIZE[0] as usize + x]));
        let all_close = |a: [f64; 4], b: [f64; 4]| a.into_iter().zip(b).for_each(|(a, b)| close(a, b, 1e-5));
        all_close(pixels(&map), [0.083_661_79, 0.732_470_81, 0.076_887_82, 0.134_317_46]);
        let hdr = |power: i32, scale: f64| {
            let decode = move |v: u8| ((f64::from(v) / 255.0).powi(power) * scale) as f32;
            compare(&picture(true, decode), &picture(false, decode), true).unwrap()
        };
        let (c, map) = hdr(2, 8.0);
        close(c.flip, 0.218_401_879, 1e-6);
        all_close(pixels(&map), [0.231_243_86, 0.839_619_34, 0.273_612_17, 0.105_143_88]);
        // Over more exposures.
        let (c, _) = hdr(5, 800.0);
        close(c.flip, 0.281_357_050, 1e-6);
    }

    #[test]
    fn equal_pictures_and_simple_differences() {
        let picture = picture(false, linear_from_srgb_u8);
        for hdr in [false, true] {
            let (c, map) = compare(&picture, &picture, hdr).unwrap();
            assert_eq!([c.mse, c.relmse, c.mae, c.max_abs, c.flip], [0.0; 5]);
            assert!(c.psnr.is_infinite() && (c.ssim.unwrap() - 1.0).abs() < 1e-12 && c.mean_ratio == [1.0; 3]);
            assert!(map.iter().all(|&v| v == 0.0));
        }
        let flat = |v: f32| Image::from_rgb(20, 50, &[[v; 3]; 1000]);
        let (c, _) = compare(&flat(0.3), &flat(0.2), false).unwrap();
        close(c.mse, 0.01, 1e-8);
        close(c.mae, 0.1, 1e-8);
        close(c.relmse, 0.01 / 0.05, 1e-7);
        close(c.get("mean").unwrap(), 0.5, 1e-6);
        // Black and white differ as much as anything can; the features of flat pictures are equal.
        let (c, _) = compare(&flat(0.0), &flat(1.0), false).unwrap();
        close(c.psnr, 0.0, 1e-5);
        assert!(c.flip > 0.95 && c.flip <= 1.0, "{}", c.flip);
    }

    #[test]
    fn outliers_are_trimmed_and_odd_values_counted() {
        let mut image = Image::from_rgb(40, 50, &[[0.5; 3]; 2000]);
        let reference = image.clone();
        image.channels[0].data[77] = 1e6;
        image.channels[1].data[78] = f32::NAN;
        let (c, map) = compare(&image, &reference, true).unwrap();
        assert!(c.relmse > 1e6 && c.relmse_trimmed == 0.0);
        assert_eq!(c.non_finite, [1, 0]);
        assert_eq!(c.get("nonfinite"), Some(1.0));
        assert!(map.iter().all(|v| (0.0..=1.0).contains(v)));
        assert!(METRICS.iter().all(|m| c.get(m).is_some()) && c.get("fun").is_none());
        assert!(compare(&Image::from_rgb(50, 40, &[[0.5; 3]; 2000]), &reference, false).is_err());
        assert!(compare(&Image::new(40, 50), &reference, false).is_err());
        let tiny = Image::from_rgb(3, 1, &[[0.0; 3]; 3]);
        let (c, _) = compare(&tiny, &tiny, true).unwrap();
        assert!(c.ssim.is_none() && c.flip == 0.0);
        assert!(serde_json::to_string(&c).unwrap().contains("\"psnr\":null"));
    }

    #[test]
    fn heat_map_goes_from_black_to_pale_yellow() {
        let image = heatmap(4, 1, &[0.0, 0.5, 1.0, f32::NAN]);
        let codes: Vec<_> = image.rgb().unwrap().iter().map(|p| p.map(|v| (srgb_from_linear(v) * 255.0).round() as i32)).collect();
        assert_eq!(codes[0], codes[3]);
        // matplotlib: (0, 0, 4), (183, 55, 121), (252, 253, 191); the fit is within a few codes.
        for (code, expected) in codes.iter().zip([[0, 0, 4], [183, 55, 121], [252, 253, 191]]) {
            assert!(code.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 8), "{code:?} instead of {expected:?}");
        }
    }
}
