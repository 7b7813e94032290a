//! Environment maps: a picture of radiance all round, in latitude and longitude.
//!
//! The picture's space has +y up (the first row), −z in the middle column, and +x a quarter to the right of it. Radiance is
//! interpolated bilinearly between texel centers, round the seam. Programs differ in where rows lie: see [`Rows`].
//! Samples are taken from cells (texels, or quarters of texels in pictures of moderate size) by the exact mean of the
//! interpolated luminance in the cell × sin θ: positive wherever the picture is.

use std::sync::Arc;

use rayon::prelude::*;

use super::directional::{infinite_emission, infinite_sample};
use super::visibility::TILES;
use super::{EmissionSample, LightContext, LightSample, SceneSphere};
use crate::math::{INV_PI, INV_TAU, Mat3, Mat4, PI, PiecewiseConstant1D, PiecewiseConstant2D, TAU, Vec2, Vec3, fns};
use crate::spectrum::Spectrum;

/// Where the rows of a picture lie between the poles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rows {
    /// Each in the middle of an equal share of the angle; constant beyond the first and last row's centers.
    #[default]
    Centered,
    /// The first and the last on the poles, the others evenly between, as in Mitsuba 3: up to half a row from [`Rows::Centered`].
    OnPoles,
}

impl Rows {
    /// A row's number, with a fraction, at v from 0 to 1.
    #[inline]
    fn at(self, v: f32, height: usize) -> f32 {
        let last = (height - 1) as f32;
        match self {
            Self::Centered => (v * height as f32 - 0.5).clamp(0.0, last),
            Self::OnPoles => (v * last).clamp(0.0, last),
        }
    }

    /// The shares of rows in the mean of the interpolation over v from `a` to `b`: at most four rows, by their numbers.
    fn shares(self, a: f64, b: f64, height: usize) -> [(usize, f64); 4] {
        let last = (height - 1) as f64;
        let [a, b] = [a, b].map(|v| match self {
            Self::Centered => v * height as f64 - 0.5,
            Self::OnPoles => v * last,
        });
        // The integral of the interpolation's hat, from −∞.
        let integral = |t: f64| {
            let t = t.clamp(-1.0, 1.0);
            if t < 0.0 { 0.5 * (t + 1.0) * (t + 1.0) } else { 1.0 - 0.5 * (1.0 - t) * (1.0 - t) }
        };
        let first = a.floor();
        std::array::from_fn(|k| {
            let row = first + k as f64;
            let share = if b > a { (integral(b - row) - integral(a - row)) / (b - a) } else { f64::from(u8::from(k == 0)) };
            // Beyond the first and last row's centers the row is its own neighbor.
            (row.clamp(0.0, last) as usize, share)
        })
    }
}

/// A picture all round. It is not fit for a light as small as the sun: texels are wider, and a `SunLight` does better.
#[derive(Clone, Debug)]
pub struct EnvironmentLight {
    width: usize,
    height: usize,
    texels: Arc<[[f32; 3]]>,
    scale: Spectrum,
    rows: Rows,
    /// Orthonormal.
    world_from_light: Mat3,
    light_from_world: Mat3,
    density: PiecewiseConstant2D,
    /// The probability of each tile by `density`; of rows, and columns in them.
    tiles: Vec<f32>,
    /// For each tile the rows of `density` in it, cumulated from 0 to 1.
    tile_rows: Vec<PiecewiseConstant1D>,
    /// For estimates that weigh it against other sampling: of what is brighter than the mean; `None` where nothing is.
    compensated: Option<PiecewiseConstant2D>,
    /// Mean over all directions.
    mean: Spectrum,
}

/// Pictures up to this many texels are sampled by quarters of texels.
const MAX_TEXELS_IN_QUARTERS: usize = 1 << 21;

impl EnvironmentLight {
    /// From `width` × `height` texels, row by row, of linear Rec. 709 radiance; negative and non-finite values count as 0.
    ///
    /// `None` where sizes do not match, or the transform is singular or not finite.
    pub fn new(
        (width, height): (usize, usize),
        mut texels: Vec<[f32; 3]>,
        scale: [f32; 3],
        world_from_light: Mat4,
        rows: Rows,
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
        let cells = cell_means(width, height, &texels, scale, sub, rows);
        let (columns, cell_rows) = (width * sub, height * sub);
        // The mean of sin θ over a row of cells.
        let sin_theta: Vec<f32> = (0..cell_rows)
            .map(|y| {
                let edge = |y: usize| libm::cos(std::f64::consts::PI * y as f64 / cell_rows as f64);
                ((edge(y) - edge(y + 1)) * cell_rows as f64 * std::f64::consts::FRAC_1_PI) as f32
            })
            .collect();
        let weighted = |floor: f32| -> Vec<f32> {
            cells.chunks_exact(columns).zip(&sin_theta).flat_map(|(row, &s)| row.iter().map(move |&c| (c - floor).max(0.0) * s)).collect()
        };
        let density = PiecewiseConstant2D::new(columns, cell_rows, &weighted(0.0));
        // ∫∫ w sin θ over the unit square, by the mean of sin θ.
        let mean = (density.integral() * std::f64::consts::FRAC_PI_2) as f32;
        let compensated = Some(PiecewiseConstant2D::new(columns, cell_rows, &weighted(mean))).filter(|d| d.integral() > 0.0);
        let mean = Spectrum::from_rgb(mean_over_sphere(width, height, &texels, &sin_theta, rows)) * scale;
        let light_from_world = world_from_light.transpose();
        let (tiles, tile_rows) = tiles_of(&density);
        let texels = texels.into();
        Some(Self { width, height, texels, scale, rows, world_from_light, light_from_world, density, tiles, tile_rows, compensated, mean })
    }

    /// The probability of each tile by [`Self::pdf`].
    pub(super) fn tile_probabilities(&self) -> &[f32] {
        &self.tiles
    }

    /// A direction by [`Self::pdf`], and its tile.
    pub(super) fn sample_tile(&self, u: Vec2) -> Option<(Vec3, usize)> {
        let (uv, pdf, cell) = self.density.sample(u);
        let (d, sin_theta) = Self::direction_from_uv(uv);
        (pdf > 0.0 && sin_theta > 0.0).then(|| (self.world_from_light * d, tile_of_cell(cell, self.density.size())))
    }

    /// The direction at a place in a tile.
    pub(super) fn direction_of_tile(&self, tile: usize, at: Vec2) -> Vec3 {
        let [columns, rows] = self.density.size();
        let ([x0, x1], [y0, y1]) = (cells_of_tile(tile % TILES[0], TILES[0], columns), cells_of_tile(tile / TILES[0], TILES[1], rows));
        let place = |a: usize, b: usize, t: f32, n: usize| (a as f32 + t * (b.max(a + 1) - a) as f32) / n as f32;
        self.world_from_light * Self::direction_from_uv(Vec2::new(place(x0, x1, at.x, columns), place(y0, y1, at.y, rows))).0
    }

    /// Samples a tile in proportion to [`Self::pdf`], which is the density that comes back.
    #[inline]
    pub(super) fn sample_in_tile(&self, ctx: &LightContext, tile: usize, u: Vec2) -> Option<LightSample> {
        let [columns, rows] = self.density.size();
        let [x0, x1] = cells_of_tile(tile % TILES[0], TILES[0], columns);
        let [y0, _] = cells_of_tile(tile / TILES[0], TILES[1], rows);
        let (row, _, y) = self.tile_rows[tile].sample_discrete(u.y);
        let row = y0 + row;
        let (x, pdf) = self.density.sample_in_row(row, [x0, x1], u.x);
        let uv = Vec2::new(x, (row as f32 + y) / rows as f32);
        let (d, sin_theta) = Self::direction_from_uv(uv);
        let pdf = pdf / (TAU * PI * sin_theta);
        let radiance = self.lookup(uv);
        (pdf > 0.0 && pdf.is_finite() && !radiance.is_black()).then(|| infinite_sample(ctx, self.world_from_light * d, radiance, pdf))
    }

    /// The density of [`Self::pdf`] for a unit direction in the world, and its tile.
    #[inline]
    pub(super) fn pdf_and_tile(&self, wi: Vec3) -> (f32, usize) {
        let (uv, sin_theta) = Self::uv_from_direction(self.light_from_world * wi);
        let size @ [columns, rows] = self.density.size();
        let cell = [((uv.x * columns as f32) as usize).min(columns - 1), ((uv.y * rows as f32) as usize).min(rows - 1)];
        (Self::pdf_at(&self.density, uv, sin_theta), tile_of_cell(cell, size))
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
        let (x, y) = (uv.x * self.width as f32 - 0.5, self.rows.at(uv.y, self.height));
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

    /// ∫ L cos θ over the directions on the side of a unit normal: what comes through a unit of area from that side.
    pub(super) fn flux_through(&self, n: Vec3) -> Spectrum {
        // The map in as many cells as it has, at least so many that the cosine is even in each.
        let (columns, rows) = (self.width.max(64), self.height.max(32));
        let of_row = |y: usize| {
            let mut sum = [0.0f64; 3];
            for x in 0..columns {
                let uv = Vec2::new((x as f32 + 0.5) / columns as f32, (y as f32 + 0.5) / rows as f32);
                let (d, sin_theta) = Self::direction_from_uv(uv);
                let cos = (self.world_from_light * d).dot(n).max(0.0) * sin_theta;
                let radiance = self.lookup(uv);
                sum.iter_mut().enumerate().for_each(|(k, s)| *s += f64::from(radiance[k] * cos));
            }
            sum
        };
        let of_rows: Vec<[f64; 3]> = (0..rows).into_par_iter().map(of_row).collect();
        let cell = 2.0 * std::f64::consts::PI.powi(2) / (columns * rows) as f64;
        Spectrum::from_rgb(std::array::from_fn(|k| (of_rows.iter().map(|r| r[k]).sum::<f64>() * cell) as f32))
    }

    /// The density of `sample` for a unit direction in the world.
    #[inline]
    pub fn pdf(&self, wi: Vec3) -> f32 {
        self.pdf_by(&self.density, wi)
    }

    /// The density of `sample_compensated` for a unit direction in the world.
    #[inline]
    pub fn pdf_compensated(&self, wi: Vec3) -> f32 {
        self.pdf_by(self.compensated.as_ref().unwrap_or(&self.density), wi)
    }

    /// [`Self::radiance`] and [`Self::pdf_compensated`] in one.
    #[inline]
    pub fn radiance_and_pdf_compensated(&self, wi: Vec3) -> (Spectrum, f32) {
        let (uv, sin_theta) = Self::uv_from_direction(self.light_from_world * wi);
        (self.lookup(uv), Self::pdf_at(self.compensated.as_ref().unwrap_or(&self.density), uv, sin_theta))
    }

    #[inline]
    fn pdf_by(&self, density: &PiecewiseConstant2D, wi: Vec3) -> f32 {
        let (uv, sin_theta) = Self::uv_from_direction(self.light_from_world * wi);
        Self::pdf_at(density, uv, sin_theta)
    }

    #[inline]
    fn pdf_at(density: &PiecewiseConstant2D, uv: Vec2, sin_theta: f32) -> f32 {
        if sin_theta > 0.0 { density.pdf(uv) / (TAU * PI * sin_theta) } else { 0.0 }
    }

    #[inline]
    fn sample_direction(&self, density: &PiecewiseConstant2D, u: Vec2) -> Option<(Vec3, Spectrum, f32)> {
        let (uv, pdf_uv, _) = density.sample(u);
        let (d, sin_theta) = Self::direction_from_uv(uv);
        let pdf = pdf_uv / (TAU * PI * sin_theta);
        let radiance = self.lookup(uv);
        (pdf > 0.0 && pdf.is_finite() && !radiance.is_black()).then(|| (self.world_from_light * d, radiance, pdf))
    }

    /// See the contract in [`crate::light`].
    #[inline]
    pub fn sample(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let (wi, radiance, pdf) = self.sample_direction(&self.density, u)?;
        Some(infinite_sample(ctx, wi, radiance, pdf))
    }

    /// See [`super::Light::sample_compensated`]: directions darker than the mean are left to other sampling (Karlík et al. 2019, "MIS
    /// Compensation", doi:10.1145/3355089.3356565, section 5).
    #[inline]
    pub fn sample_compensated(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let (wi, radiance, pdf) = self.sample_direction(self.compensated.as_ref().unwrap_or(&self.density), u)?;
        Some(infinite_sample(ctx, wi, radiance, pdf))
    }

    /// See [`super::Light::power`].
    pub fn power(&self, scene: &SceneSphere) -> Spectrum {
        self.mean * (4.0 * PI * PI * scene.radius * scene.radius)
    }

    /// See [`super::Light::emit`].
    pub fn emit(&self, scene: &SceneSphere, u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
        let (wi, radiance, pdf) = self.sample_direction(&self.density, u_direction)?;
        infinite_emission(scene, u_position, wi, radiance, pdf)
    }
}

/// The first of the cells of a tile, and the one after the last.
#[inline]
fn cells_of_tile(tile: usize, tiles: usize, cells: usize) -> [usize; 2] {
    [(tile * cells).div_ceil(tiles), ((tile + 1) * cells).div_ceil(tiles)]
}

/// The tile that a cell is in.
#[inline]
fn tile_of_cell([x, y]: [usize; 2], [columns, rows]: [usize; 2]) -> usize {
    y * TILES[1] / rows * TILES[0] + x * TILES[0] / columns
}

/// The probabilities of tiles, and of rows in each of them.
fn tiles_of(density: &PiecewiseConstant2D) -> (Vec<f32>, Vec<PiecewiseConstant1D>) {
    let [columns, rows] = density.size();
    let of_tile = |tile: usize| {
        let ([x0, x1], [y0, y1]) = (cells_of_tile(tile % TILES[0], TILES[0], columns), cells_of_tile(tile / TILES[0], TILES[1], rows));
        let weights: Vec<f32> = (y0..y1).map(|y| density.probability_in_row(y, [x0, x1])).collect();
        (weights.iter().sum::<f32>(), PiecewiseConstant1D::new(&weights))
    };
    (0..TILES[0] * TILES[1]).map(of_tile).unzip()
}

/// The mean over all directions; `sin_theta` holds the means of sin θ over rows of cells. The interpolation is taken as constant in
/// each.
fn mean_over_sphere(width: usize, height: usize, texels: &[[f32; 3]], sin_theta: &[f32], rows: Rows) -> [f32; 3] {
    let cells = sin_theta.len() as f64;
    let mut weights = vec![0.0f64; height];
    for (y, &s) in sin_theta.iter().enumerate() {
        for (row, share) in rows.shares(y as f64 / cells, (y + 1) as f64 / cells, height) {
            weights[row] += share * f64::from(s);
        }
    }
    let mut mean = [0.0f64; 3];
    for (row, weight) in texels.chunks_exact(width).zip(weights) {
        for texel in row {
            for (m, &c) in mean.iter_mut().zip(texel) {
                *m += weight * f64::from(c);
            }
        }
    }
    mean.map(|m| (m * std::f64::consts::FRAC_PI_2 / (width as f64 * cells)) as f32)
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
/// Along a row a texel's share in the mean over its own width is 6/8 (its neighbors have 1/8 each), and 3/4 (one neighbor 1/4)
/// in the mean over half of it. Cells need not begin with rows: [`Rows::shares`].
fn cell_means(width: usize, height: usize, texels: &[[f32; 3]], scale: Spectrum, sub: usize, rows: Rows) -> Vec<f32> {
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
    let cells = (height * sub) as f64;
    let mut out = vec![0.0; columns * height * sub];
    out.par_chunks_exact_mut(columns).enumerate().for_each(|(y, out)| {
        for (row, share) in rows.shares(y as f64 / cells, (y + 1) as f64 / cells, height) {
            let share = share as f32;
            for (v, &b) in out.iter_mut().zip(&blurred[row * columns..(row + 1) * columns]) {
                *v += share * b;
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shares against a sum of many interpolated values.
    #[test]
    fn shares_of_rows_are_means_of_the_interpolation() {
        for rows in [Rows::Centered, Rows::OnPoles] {
            for (height, cells) in [(1, 2), (2, 4), (5, 5), (7, 14)] {
                for y in 0..cells {
                    let (a, b) = (y as f64 / cells as f64, (y + 1) as f64 / cells as f64);
                    let mut found = vec![0.0; height];
                    rows.shares(a, b, height).iter().for_each(|(row, share)| found[*row] += share);
                    let mut expected = vec![0.0; height];
                    for i in 0..2000 {
                        let at = rows.at((a + (b - a) * (f64::from(i) + 0.5) / 2000.0) as f32, height);
                        let (row, f) = (at as usize, f64::from(at.fract()));
                        expected[row] += (1.0 - f) / 2000.0;
                        expected[(row + 1).min(height - 1)] += f / 2000.0;
                    }
                    for (f, e) in found.iter().zip(&expected) {
                        assert!((f - e).abs() < 1e-3, "{rows:?}, {height} rows, cell {y}: {found:?} instead of {expected:?}");
                    }
                }
            }
        }
    }
}
