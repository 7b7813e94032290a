//! Z-tests of the means of picture blocks against known values and against other pictures. A failed test leaves pictures of
//! the result, the reference and the p-values under `target/test-failures`.

use std::path::Path;

use etendue_render::film::{DevelopOptions, Film};
use etendue_render::image::{Image, WriteOptions};
use etendue_render::testing::chi2::sidak;
use etendue_scene::{RenderSettings, SceneDesc};

use super::render_seeds;

/// With how high a probability a test function rejects a right picture.
const LEVEL: f64 = 1e-3;
/// Bound on what single precision, quadrature tables and the like may be off, relative.
pub const ROUNDING: f64 = 2e-4;

/// Means over blocks of a picture and the variances of these means, by channel R, G, B.
#[derive(Clone, Debug)]
pub struct Blocks {
    pub columns: usize,
    pub mean: Vec<[f64; 3]>,
    pub variance: Vec<[f64; 3]>,
}

impl Blocks {
    /// Of independently seeded films of one size, in blocks of `edge` × `edge` pixels.
    pub fn new(films: &[Film], edge: usize) -> Self {
        let first = films[0].develop();
        let (width, height) = (first.width as usize, first.height as usize);
        assert!(width % edge == 0 && height % edge == 0, "blocks must fill the picture");
        let columns = width / edge;
        let count = columns * (height / edge);
        let mut blocks = Self { columns, mean: vec![[0.0; 3]; count], variance: vec![[0.0; 3]; count] };
        let n = (edge * edge * films.len()) as f64;
        for film in films {
            let image = film.develop_with(DevelopOptions { variance: true, sample_count: false });
            for (c, (name, variance)) in [("R", "variance.R"), ("G", "variance.G"), ("B", "variance.B")].into_iter().enumerate() {
                let (values, variances) = (image.channel(name).unwrap(), image.channel(variance).unwrap());
                for i in 0..width * height {
                    let block = (i / width / edge) * columns + i % width / edge;
                    blocks.mean[block][c] += f64::from(values[i]) / n;
                    blocks.variance[block][c] += f64::from(variances[i]) / (n * n);
                }
            }
        }
        blocks
    }

    /// Of a scene rendered with seeds 0 to 9; the variance is that between seeds, raised by so much that its own uncertainty (of nine
    /// degrees of freedom) does not make false alarms. For methods whose pixels are not independent, as those that splat or share
    /// photons, and for those whose few rare samples make most of the noise.
    pub fn of_seeds(desc: &SceneDesc, settings: &RenderSettings, edge: usize) -> Self {
        Self::of_films(&render_seeds(desc, settings, 0..10), edge)
    }

    /// The same of ten films of different seeds.
    pub fn of_films(films: &[Film], edge: usize) -> Self {
        let parts: Vec<Self> = films.iter().map(|film| Self::new(std::slice::from_ref(film), edge)).collect();
        let n = parts.len() as f64;
        let mut all = parts[0].clone();
        for i in 0..all.mean.len() {
            for c in 0..3 {
                let values = || parts.iter().map(|p| p.mean[i][c]);
                let mean = values().sum::<f64>() / n;
                all.mean[i][c] = mean;
                all.variance[i][c] = 3.0 * values().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n * (n - 1.0));
            }
        }
        all
    }

    /// What pictures with smaller and smaller radii tend to: a blur goes with the square of the radius, so that two radii, this one and half
    /// of it, tell what none would give.
    pub fn without_radius(radius: f32, with: impl Fn(f32) -> Self) -> Self {
        let (wide, narrow) = (with(radius), with(0.5 * radius));
        let mut zero = narrow.clone();
        for i in 0..zero.mean.len() {
            for c in 0..3 {
                zero.mean[i][c] = (4.0 * narrow.mean[i][c] - wide.mean[i][c]) / 3.0;
                zero.variance[i][c] = (16.0 * narrow.variance[i][c] + wide.variance[i][c]) / 9.0;
            }
        }
        zero
    }

    /// A picture that is known exactly.
    pub fn known(&self, value: [f64; 3]) -> Self {
        Self { columns: self.columns, mean: vec![value; self.mean.len()], variance: vec![[0.0; 3]; self.mean.len()] }
    }

    /// The largest standard error of a block relative to its mean, over blocks that are not black.
    pub fn noise(&self) -> f64 {
        let relative =
            |(m, v): (&[f64; 3], &[f64; 3])| (0..3).map(|c| if m[c] > 1e-6 { v[c].sqrt() / m[c] } else { 0.0 }).fold(0.0, f64::max);
        self.mean.iter().zip(&self.variance).map(relative).fold(0.0, f64::max)
    }

    fn image(&self, value: impl Fn(usize, usize) -> f64) -> Image {
        let pixels: Vec<[f32; 3]> = (0..self.mean.len()).map(|i| std::array::from_fn(|c| value(i, c) as f32)).collect();
        Image::from_rgb(self.columns as u32, (pixels.len() / self.columns) as u32, &pixels)
    }
}

/// Panics where two pictures differ by more than chance and a relative `slack` explain, or where `most_noise` (relative, of the
/// noisiest block) is exceeded, so that a test that could find nothing does not pass.
pub fn assert_same(name: &str, a: &Blocks, b: &Blocks, slack: f64, most_noise: f64) {
    let tests = 3 * a.mean.len();
    let p = |i: usize, c: usize| {
        let difference = ((a.mean[i][c] - b.mean[i][c]).abs() - slack * b.mean[i][c].abs() - 1e-7).max(0.0);
        let deviation = (a.variance[i][c] + b.variance[i][c]).sqrt();
        if difference == 0.0 { 1.0 } else { libm::erfc(difference / deviation.max(1e-12) / std::f64::consts::SQRT_2) }
    };
    let all = || (0..a.mean.len()).flat_map(|i| (0..3).map(move |c| (i, c)));
    let (i, c) = all().min_by(|x, y| p(x.0, x.1).total_cmp(&p(y.0, y.1))).unwrap();
    let noise = a.noise().max(b.noise());
    let summary = format!(
        "{name}: block {i} channel {c}: {} ± {:.1e} instead of {} ± {:.1e}, p = {:.1e}; noise {noise:.1e}",
        a.mean[i][c],
        a.variance[i][c].sqrt(),
        b.mean[i][c],
        b.variance[i][c].sqrt(),
        p(i, c)
    );
    println!("{summary}");
    if p(i, c) < sidak(LEVEL, tests) {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("../test-failures");
        std::fs::create_dir_all(&folder).unwrap();
        let stem: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
        for (what, image) in [("result", a.image(|i, c| a.mean[i][c])), ("reference", b.image(|i, c| b.mean[i][c])), ("p", a.image(p))] {
            image.save(&folder.join(format!("{stem}.{what}.exr")), &WriteOptions::default()).unwrap();
        }
        panic!("{summary}; pictures in {}", folder.display());
    }
    assert!(noise <= most_noise, "too noisy to find anything: {summary}");
}

/// Panics unless every block is `value` within chance and rounding.
pub fn assert_known(name: &str, films: &[Film], edge: usize, value: [f64; 3], most_noise: f64) {
    let blocks = Blocks::new(films, edge);
    let known = blocks.known(value);
    assert_same(name, &blocks, &known, ROUNDING, most_noise);
}
