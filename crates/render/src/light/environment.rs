//! Environment maps: a picture of radiance all round, in latitude and longitude.
//!
//! The picture's space has +y up (the first row), −z in the middle column, and +x a quarter to the right of it. Radiance is
//! interpolated bilinearly between texel centers, round the seam and constant beyond the first and last row's centers.
//! Samples are taken from cells (texels, or quarters of texels in pictures of moderate size) by the exact mean of the
//! interpolated luminance in the cell × sin θ: positive wherever the picture is.

use std::sync::Arc;

use rayon::prelude::*;

use super::directional::{infinite_emission, infinite_sample};
use super::{EmissionSample, LightContext, LightSample, SceneSphere};
use crate::math::{INV_PI, INV_TAU, Mat3, Mat4, PI, PiecewiseConstant2D, TAU, Vec2, Vec3, fns};
use crate::spectrum::Spectrum;

/// A picture all round. It is not fit for a light as small as the sun: texels are wider, and a `SunLight` does better.
#[derive(Clone, Debug)]
pub struct EnvironmentLight {
    width: usize,
    height: usize,
    texels: Arc<[[f32; 3]]>,
    scale: Spectrum,
    /// Orthonormal.
    world_from_light: Mat3,
    light_from_world: Mat3,
    density: PiecewiseConstant2D,
    /// Mean over all directions.
    mean: Spectrum,
}

/// Pictures up to this many texels are sampled by quarters of texels.
const MAX_TEXELS_IN_QUARTERS: usize = 1 << 21;

impl EnvironmentLight {
    /// From `width` × `height` texels, row by row, of linear Rec. 709 radiance; negative and non-finite values count as 0.
    ///
    /// With `compensate_mis` directions darker than the mean are left to other sampling (Karlík et al. 2019, "MIS
    /// Compensation", doi:10.1145/3355089.3356565, section 5): better with multiple importance sampling and wrong without.
    /// `None` where sizes do not match, or the transform is singular or not finite.
    pub fn new(
        (width, height): (usize, usize),
        mut texels: Vec<[f32; 3]>,
        scale: [f32; 3],
        world_from_light: Mat4,
        compensate_mis: bool,
    ) -> Option<Self> {
        let world_from_light = orthonormal(Mat3::from_mat4(world_from_light))?;
        let scale = Spectrum::from_rgb(scale);
        if width == 0 || height == 0 || width.checked_mul(height) != Some(texels.len()) || !scale.is_finite() {
            return None;
        }
        for v in texels.iter_mut().flatten() {
            *v = if v.is_finite() { v.max(0.0) } else { 0.0 };
        }
        let sub = if texels.len() <= MAX_TEXELS_IN_QUARTERS { 2 } else { 1 };
        let cells = cell_means(width, height, &texels, scale, sub);
        let (columns, rows) = (width * sub, height * sub);
        // The mean of sin θ over a row of cells.
        let sin_theta: Vec<f32> = (0..rows)
            .map(|y| {
                let edge = |y: usize| libm::cos(std::f64::consts::PI * y as f64 / rows as f64);
                ((edge(y) - edge(y + 1)) * rows as f64 * std::f64::consts::FRAC_1_PI) as f32
            })
            .collect();
        let weighted = |floor: f32| -> Vec<f32> {
            cells.chunks_exact(columns).zip(&sin_theta).flat_map(|(row, &s)| row.iter().map(move |&c| (c - floor).max(0.0) * s)).collect()
        };
        let mut density = PiecewiseConstant2D::new(columns, rows, &weighted(0.0));
        if compensate_mis {
            // ∫∫ w sin θ over the unit square, by the mean of sin θ.
            let mean = (density.integral() * std::f64::consts::FRAC_PI_2) as f32;
            let compensated = PiecewiseConstant2D::new(columns, rows, &weighted(mean));
            if compensated.integral() > 0.0 {
                density = compensated;
            }
        }
        let mean = Spectrum::from_rgb(mean_over_sphere(width, height, &texels, &sin_theta)) * scale;
        let light_from_world = world_from_light.transpose();
        Some(Self { width, height, texels: texels.into(), scale, world_from_light, light_from_world, density, mean })
    }

    /// Picture coordinates in [0, 1]² of a unit direction of the picture's space, and sin θ.
    #[inline]
    fn uv_from_direction(d: Vec3) -> (Vec2, f32) {
        let sin_theta = (d.x * d.x + d.z * d.z).sqrt();
        (Vec2::new(0.5 + fns::atan2(d.x, -d.z) * INV_TAU, fns::atan2(sin_theta, d.y) * INV_PI), sin_theta)
    }

    /// The inverse.
    #[inline]
    pub(crate) fn direction_from_uv(uv: Vec2) -> (Vec3, f32) {
        let (sin_phi, cos_phi) = fns::sin_cos((uv.x - 0.5) * TAU);
        let (sin_theta, cos_theta) = fns::sin_cos(uv.y * PI);
        (Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi), sin_theta)
    }

    #[inline]
    fn lookup(&self, uv: Vec2) -> Spectrum {
        let (x, y) = (uv.x * self.width as f32 - 0.5, (uv.y * self.height as f32 - 0.5).clamp(0.0, (self.height - 1) as f32));
        let (fx, fy) = (x - x.floor(), y - y.floor());
        // x is in [−0.5, width − 0.5].
        let x0 = if x < 0.0 { self.width - 1 } else { (x as usize).min(self.width - 1) };
        let x1 = if x0 + 1 == self.width { 0 } else { x0 + 1 };
        let y0 = y as usize;
        let y1 = (y0 + 1).min(self.height - 1);
        let at = |x: usize, y: usize| Spectrum::from_rgb(self.texels[y * self.width + x]);
        let row = |y: usize| at(x0, y).lerp(at(x1, y), fx);
        row(y0).lerp(row(y1), fy) * self.scale
    }

    /// Radiance from a unit direction in the world.
    #[inline]
    pub fn radiance(&self, wi: Vec3) -> Spectrum {
        self.lookup(Self::uv_from_direction(self.light_from_world * wi).0)
    }

    /// Mean radiance over all directions.
    pub fn mean(&self) -> Spectrum {
        self.mean
    }

    /// The density of `sample` for a unit direction in the world.
    #[inline]
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let (uv, sin_theta) = Self::uv_from_direction(self.light_from_world * wi);
        if sin_theta > 0.0 { self.density.pdf(uv) / (TAU * PI * sin_theta) } else { 0.0 }
    }

    #[inline]
    fn sample_direction(&self, u: Vec2) -> Option<(Vec3, Spectrum, f32)> {
        let (uv, pdf_uv, _) = self.density.sample(u);
        let (d, sin_theta) = Self::direction_from_uv(uv);
        let pdf = pdf_uv / (TAU * PI * sin_theta);
        let radiance = self.lookup(uv);
        (pdf > 0.0 && pdf.is_finite() && !radiance.is_black()).then(|| (self.world_from_light * d, radiance, pdf))
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let (wi, radiance, pdf) = self.sample_direction(u)?;
        Some(infinite_sample(ctx, wi, radiance, pdf))
    }

    /// See [`super::Light::power`].
    pub fn power(&self, scene: &SceneSphere) -> Spectrum {
        self.mean * (4.0 * PI * PI * scene.radius * scene.radius)
    }

    /// See [`super::Light::emit`]. Not to be used with `compensate_mis`.
    pub fn emit(&self, scene: &SceneSphere, u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        let (wi, radiance, pdf) = self.sample_direction(u_direction)?;
        infinite_emission(scene, u_position, wi, radiance, pdf)
    }
}

/// The mean over all directions; `sin_theta` holds the means of sin θ over rows or half rows. The interpolation is taken as
/// constant in each.
fn mean_over_sphere(width: usize, height: usize, texels: &[[f32; 3]], sin_theta: &[f32]) -> [f32; 3] {
    let sub = sin_theta.len() / height;
    let mut mean = [0.0f64; 3];
    for (y, row) in texels.chunks_exact(width).enumerate() {
        // The same kernels as in `cell_means`: what a texel's row has in its own cells, and in its neighbors'.
        let s = |y: usize| f64::from(sin_theta[y]);
        let (first, last) = (y * sub, y * sub + sub - 1);
        let own: f64 = (first..=last).map(s).sum::<f64>() * 0.75;
        let side = if sub == 2 { 0.25 } else { 0.125 };
        // Beyond the first and last row's centers the row is its own neighbor.
        let weight = own + side * (s(if y > 0 { first - 1 } else { first }) + s((last + 1).min(sin_theta.len() - 1)));
        for texel in row {
            for (m, &c) in mean.iter_mut().zip(texel) {
                *m += weight * f64::from(c);
            }
        }
    }
    mean.map(|m| (m * std::f64::consts::FRAC_PI_2 / (width * sin_theta.len()) as f64) as f32)
}

/// The nearest map that keeps angles: scalings are dropped, mirrors kept. `None` where singular or not finite.
fn orthonormal(m: Mat3) -> Option<Mat3> {
    let y = m.y_axis.normalize_or_zero();
    let z = (m.z_axis - y * y.dot(m.z_axis)).normalize_or_zero();
    let x = y.cross(z);
    let x = if x.dot(m.x_axis) < 0.0 { -x } else { x };
    (m.is_finite() && y != Vec3::ZERO && z != Vec3::ZERO && m.determinant() != 0.0).then_some(Mat3::from_cols(x, y, z))
}

/// The mean of the bilinear interpolation of the luminance in each cell, with `sub` cells along each side of a texel.
///
/// Along one axis a texel's share in the mean over its own width is 6/8 (its neighbors have 1/8 each), and 3/4 (one neighbor 1/4)
/// in the mean over half of it.
fn cell_means(width: usize, height: usize, texels: &[[f32; 3]], scale: Spectrum, sub: usize) -> Vec<f32> {
    // (previous, own, next)
    let kernels: &[[f32; 3]] = if sub == 2 { &[[0.25, 0.75, 0.0], [0.0, 0.75, 0.25]] } else { &[[0.125, 0.75, 0.125]] };
    let columns = width * sub;
    let mut blurred = vec![0.0; columns * height];
    blurred.par_chunks_exact_mut(columns).zip(texels.par_chunks_exact(width)).for_each(|(out, row)| {
        let row: Vec<f32> = row.iter().map(|t| (Spectrum::from_rgb(*t) * scale).map(f32::abs).luminance()).collect();
        for x in 0..width {
            let taps = [row[(x + width - 1) % width], row[x], row[(x + 1) % width]];
            for (i, k) in kernels.iter().enumerate() {
                out[x * sub + i] = k[0] * taps[0] + k[1] * taps[1] + k[2] * taps[2];
            }
        }
    });
    let mut out = vec![0.0; columns * height * sub];
    out.par_chunks_exact_mut(columns).enumerate().for_each(|(row, out)| {
        let (y, k) = (row / sub, kernels[row % sub]);
        let at = |y: usize| &blurred[y * columns..(y + 1) * columns];
        let (above, own, below) = (at(y.saturating_sub(1)), at(y), at((y + 1).min(height - 1)));
        for (x, v) in out.iter_mut().enumerate() {
            *v = k[0] * above[x] + k[1] * own[x] + k[2] * below[x];
        }
    });
    out
}
