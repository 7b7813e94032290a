//! FLIP, the difference that a person sees when two pictures alternate: values from 0 (same) to 1.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild 2020, "FLIP: A Difference Evaluator for
//! Alternating Images", doi:10.1145/3406183 ("the paper" below), and Andersson, Nilsson, Shirley, Akenine-Möller 2021,
//! "Visualizing Errors in Rendered High Dynamic Range Images", doi:10.2312/egs.20211015 (HDR-FLIP).
//! The convolutions are split into passes over rows and columns; everything else is as published.

use rayon::prelude::*;

use crate::math::fns;

/// Where the observer is.
#[derive(Clone, Copy, Debug)]
pub struct FlipOptions {
    /// Pixels of the display per degree of the field of view.
    pub pixels_per_degree: f32,
}

impl Default for FlipOptions {
    /// The paper's: a display of 3840 pixels over 0.7 m seen from 0.7 m.
    fn default() -> Self {
        Self { pixels_per_degree: 3840.0 * std::f32::consts::PI / 180.0 }
    }
}

type Rgb = [f32; 3];

/// FLIP of two pictures for a display: linear values, clipped to [0, 1]; `width` pixels a row. The first is the reference (the measure
/// is symmetric).
pub fn flip_ldr(reference: &[Rgb], test: &[Rgb], width: usize, options: FlipOptions) -> Vec<f32> {
    let clip = |pixels: &[Rgb]| -> Vec<Rgb> { pixels.iter().map(|p| p.map(|v| if v > 0.0 { v.min(1.0) } else { 0.0 })).collect() };
    let filters = Filters::new(options.pixels_per_degree);
    let [a, b] = [reference, test].map(|p| Perceived::new(&clip(p), width, &filters));
    let cmax = fns::pow(hyab(hunt(lab([0.0, 1.0, 0.0])), hunt(lab([0.0, 0.0, 1.0]))), COLOR_EXPONENT);
    (0..reference.len())
        .map(|i| {
            let color = redistribute(fns::pow(hyab(a.lab[i], b.lab[i]), COLOR_EXPONENT), cmax);
            let feature = (a.edges[i] - b.edges[i]).abs().max((a.points[i] - b.points[i]).abs());
            // The paper's eq. 20 and 21, with an exponent of 1/2.
            let feature = (feature * std::f32::consts::FRAC_1_SQRT_2).sqrt();
            fns::pow(color, 1.0 - feature)
        })
        .collect()
}

/// HDR-FLIP of two linear pictures: the largest FLIP over exposures that are chosen from the reference.
pub fn flip_hdr(reference: &[Rgb], test: &[Rgb], width: usize, options: FlipOptions) -> Vec<f32> {
    let (start, stop) = exposure_range(reference);
    let steps = ((stop - start).ceil() as usize).clamp(2, 64);
    let mut worst = vec![0.0f32; reference.len()];
    for step in 0..steps {
        let exposure = start + (stop - start) * step as f32 / (steps - 1) as f32;
        let scale = fns::exp2(exposure);
        let [a, b] = [reference, test].map(|p| p.iter().map(|p| p.map(|v| tone(v * scale))).collect::<Vec<_>>());
        for (worst, value) in worst.iter_mut().zip(flip_ldr(&a, &b, width, options)) {
            *worst = worst.max(value);
        }
    }
    worst
}

/// The curve of HDR-FLIP: Narkowicz's fit of ACES, (a x² + b x + c) / (d x² + e x + f).
const TONE: [f32; 6] = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.0, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];

fn tone(x: f32) -> f32 {
    let x = if x > 0.0 { x.min(1e8) } else { 0.0 };
    let [a, b, c, d, e, f] = TONE;
    (((a * x + b) * x + c) / ((d * x + e) * x + f)).min(1.0)
}

/// Exposures, in stops, at which the brightest pixel and the median one reach 0.85 on the display.
fn exposure_range(reference: &[Rgb]) -> (f32, f32) {
    let mut luminances: Vec<f32> =
        reference.iter().map(|p| (0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]).max(0.0)).filter(|y| y.is_finite()).collect();
    if luminances.is_empty() {
        return (0.0, 1.0);
    }
    luminances.sort_by(f32::total_cmp);
    let n = luminances.len();
    let median = 0.5 * (luminances[(n - 1) / 2] + luminances[n / 2]);
    let max = luminances[n - 1];
    // Where the curve is 0.85: the larger root of a quadratic.
    let [a, b, c] = [0, 1, 2].map(|i| TONE[i] - 0.85 * TONE[i + 3]);
    let x_max = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    // Black pictures have no exposure of their own.
    let stops = |y: f32| fns::log2(x_max / y.max(f32::EPSILON)).clamp(-60.0, 60.0);
    (stops(max), stops(median))
}

const COLOR_EXPONENT: f32 = 0.7;

/// The paper's eq. 15: large color differences are squeezed into [0.95, 1].
fn redistribute(difference: f32, cmax: f32) -> f32 {
    const PC: f32 = 0.4;
    const PT: f32 = 0.95;
    let knee = PC * cmax;
    if difference < knee { difference * PT / knee } else { PT + (difference - knee) / (cmax - knee) * (1.0 - PT) }
}

/// The distance of Abasi et al. 2020: city block in lightness, Euclidean in chroma.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0].abs() + (d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// Chroma fades with lightness (Hunt 1952; the paper's section 4.1.2).
fn hunt(lab: [f32; 3]) -> [f32; 3] {
    [lab[0], 0.01 * lab[0] * lab[1], 0.01 * lab[0] * lab[2]]
}

/// White of linear Rec. 709 in XYZ.
const WHITE: [f32; 3] = [0.950_428_5, 1.0, 1.088_900_4];

fn xyz_from_rgb(c: Rgb) -> [f32; 3] {
    [
        0.412_386_6 * c[0] + 0.357_591_5 * c[1] + 0.180_450_5 * c[2],
        0.212_636_8 * c[0] + 0.715_183 * c[1] + 0.072_180_2 * c[2],
        0.019_330_6 * c[0] + 0.119_197_2 * c[1] + 0.950_372_6 * c[2],
    ]
}

fn rgb_from_xyz(c: [f32; 3]) -> Rgb {
    [
        3.241_003_2 * c[0] - 1.537_399 * c[1] - 0.498_615_9 * c[2],
        -0.969_224_25 * c[0] + 1.875_93 * c[1] + 0.041_554_23 * c[2],
        0.055_639_42 * c[0] - 0.204_011_2 * c[1] + 1.057_149 * c[2],
    ]
}

/// CIELAB of linear Rec. 709.
fn lab(rgb: Rgb) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let xyz = xyz_from_rgb(rgb);
    let f = |i: usize| {
        let t = xyz[i] / WHITE[i];
        if t > DELTA * DELTA * DELTA { fns::pow(t, 1.0 / 3.0) } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let [x, y, z] = [f(0), f(1), f(2)];
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// A symmetric or antisymmetric kernel, from −radius to radius.
type Kernel = Vec<f32>;

/// One Gaussian of a contrast sensitivity: its weight at the normalized sum, and its taps.
struct Filters {
    /// For the three opponent channels: terms whose weights sum to one.
    sensitivity: [Vec<(f32, Kernel)>; 3],
    smooth: Kernel,
    edge: Kernel,
    point: Kernel,
}

impl Filters {
    fn new(ppd: f32) -> Self {
        // The paper's table 1: (a, b) of each term for luminance, red–green and blue–yellow.
        let tables: [&[(f32, f32)]; 3] = [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
        let pi = std::f32::consts::PI;
        let radius = (3.0 * (0.04 / (2.0 * pi * pi)).sqrt() * ppd).ceil() as i32;
        let sensitivity = tables.map(|table| {
            let mut terms: Vec<(f32, Kernel)> = Vec::new();
            for &(a, b) in table {
                let taps: Kernel = (-radius..=radius).map(|x| fns::exp(-pi * pi * fns::sqr(x as f32 / ppd) / b)).collect();
                let sum: f32 = taps.iter().sum();
                terms.push((a * (pi / b).sqrt() * sum * sum, taps.iter().map(|t| t / sum).collect()));
            }
            let total: f32 = terms.iter().map(|t| t.0).sum();
            terms.into_iter().map(|(weight, taps)| (weight / total, taps)).collect()
        });
        // Feature detection (section 4.2): derivatives of a Gaussian whose width is 0.082 degrees.
        let sd = 0.5 * 0.082 * ppd;
        let radius = (3.0 * sd).ceil() as i32;
        let gauss = |x: i32| fns::exp(-fns::sqr(x as f32) / (2.0 * sd * sd));
        let smooth: Kernel = (-radius..=radius).map(gauss).collect();
        let sum: f32 = smooth.iter().sum();
        let edge = (-radius..=radius).map(|x| -(x as f32) * gauss(x)).collect();
        let point = (-radius..=radius).map(|x| (fns::sqr(x as f32 / sd) - 1.0) * gauss(x)).collect();
        Self { sensitivity, smooth: smooth.iter().map(|t| t / sum).collect(), edge: balance(edge), point: balance(point) }
    }
}

/// Scales positive taps to sum 1 and negative ones to sum −1.
fn balance(kernel: Kernel) -> Kernel {
    let positive: f32 = kernel.iter().filter(|t| **t > 0.0).sum();
    let negative: f32 = -kernel.iter().filter(|t| **t < 0.0).sum::<f32>();
    kernel.into_iter().map(|t| if t > 0.0 { t / positive } else { t / negative }).collect()
}

/// What is left of a picture for the observer.
struct Perceived {
    /// Filtered color in Hunt-adjusted CIELAB.
    lab: Vec<[f32; 3]>,
    /// Strength of edges and of points.
    edges: Vec<f32>,
    points: Vec<f32>,
}

impl Perceived {
    fn new(rgb: &[Rgb], width: usize, filters: &Filters) -> Self {
        // YCxCz, the opponent space of the contrast sensitivity.
        let opponent: Vec<[f32; 3]> = rgb
            .iter()
            .map(|&p| {
                let xyz = xyz_from_rgb(p);
                let [x, y, z] = [0, 1, 2].map(|i| xyz[i] / WHITE[i]);
                [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
            })
            .collect();
        let planes: Vec<Vec<f32>> = (0..3).map(|c| opponent.iter().map(|p| p[c]).collect()).collect();
        let mut filtered = vec![[0.0f32; 3]; rgb.len()];
        for c in 0..3 {
            for (weight, taps) in &filters.sensitivity[c] {
                let plane = convolve(&planes[c], width, taps, taps);
                filtered.iter_mut().zip(plane).for_each(|(f, v)| f[c] += weight * v);
            }
        }
        let lab = filtered
            .par_iter()
            .map(|&[cy, cx, cz]| {
                let y = (cy + 16.0) / 116.0;
                let xyz = [(y + cx / 500.0) * WHITE[0], y, (y - cz / 200.0) * WHITE[2]];
                hunt(lab(rgb_from_xyz(xyz).map(|v| v.clamp(0.0, 1.0))))
            })
            .collect();
        let luminance: Vec<f32> = planes[0].iter().map(|y| (y + 16.0) / 116.0).collect();
        let strength = |kernel: &Kernel| -> Vec<f32> {
            let dx = convolve(&luminance, width, kernel, &filters.smooth);
            let dy = convolve(&luminance, width, &filters.smooth, kernel);
            dx.iter().zip(dy).map(|(x, y)| (x * x + y * y).sqrt()).collect()
        };
        Self { lab, edges: strength(&filters.edge), points: strength(&filters.point) }
    }
}

/// Convolution with `across` along rows and `down` along columns; the border pixels go on outside.
fn convolve(plane: &[f32], width: usize, across: &[f32], down: &[f32]) -> Vec<f32> {
    let height = plane.len() / width;
    let mut rows = vec![0.0f32; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(out, row)| {
        let radius = across.len() / 2;
        for (x, out) in out.iter_mut().enumerate() {
            *out = across.iter().enumerate().map(|(i, t)| t * row[(x + i).saturating_sub(radius).min(width - 1)]).sum();
        }
    });
    let mut result = vec![0.0f32; plane.len()];
    result.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let radius = down.len() / 2;
        for (i, t) in down.iter().enumerate() {
            let from = (y + i).saturating_sub(radius).min(height - 1) * width;
            out.iter_mut().zip(&rows[from..from + width]).for_each(|(o, v)| *o += t * v);
        }
    });
    result
}
