//! Which part of an environment map is seen from where: what next-event estimation needs in rooms, where walls are in the way of most of
//! the sky (after Atanasov et al. 2018, "Adaptive environment sampling on CPU and GPU", doi:10.1145/3214745.3214808).
//!
//! The scene's box is cut into cells, and the directions into tiles. From random points of a cell rays tell which tiles are seen, and the
//! environment's own density is multiplied by a factor for each tile, by the direction into which a surface faces as well. Cells are made
//! when they are first asked for, from nothing but the scene and their place: whoever asks, and when, changes nothing. A share of the
//! samples goes to all of the environment, so that nothing is ever left out, whatever the rays have missed.

use std::sync::OnceLock;

use super::{EnvironmentLight, LightContext, LightSample};
use crate::math::hash::{hash_words, unit_float};
use crate::math::{Aabb, PiecewiseConstant1D, Vec2, Vec3, fns};

/// Cells along the longest edge of the scene's box. Tried: twice as many take more time than they save.
const CELLS: f32 = 16.0;
/// Columns and rows of tiles.
pub(super) const TILES: [usize; 2] = [32, 16];
/// Rays of a cell: so many by the environment's density, and so many through each tile.
const RAYS: u32 = 64;
const RAYS_OF_TILE: u32 = 4;
/// Where more than this share of the first rays meets nothing, no others are needed.
const CLEAR: f32 = 0.95;
/// The share of the light that has to be hidden for the cell to be of use.
const HIDDEN: f32 = 0.5;
/// The share of samples that go wherever the environment is bright.
const DEFENSIVE: f32 = 0.125;
/// Rays that what is known of the tiles around one counts for.
const NEIGHBORS: f32 = 0.5;
/// A tile's factor goes with this power of the share of it that is seen: 0.5 would be best if the shares were known, 1 doubts tiles more of which
/// little is seen.
const POWER: f32 = 0.7;
/// A surface may face this much off its direction: the cosine is taken to be larger by this.
const SLACK: f32 = 0.1;
/// Directions of normals, and none at all.
const FACINGS: usize = 27;
/// A component of a normal from which on it counts: half way between an axis and a diagonal.
const DIAGONAL: f32 = 0.38;

/// What is seen of an environment map from the parts of a scene.
#[derive(Debug)]
pub struct EnvironmentVisibility {
    /// The light.
    pub light: u32,
    min: Vec3,
    /// Cells by unit of length.
    scale: f32,
    size: [usize; 3],
    /// The box, in cells.
    extent: Vec3,
    cells: Vec<OnceLock<Option<Box<Cell>>>>,
}

/// What is seen from a part of the scene.
#[derive(Debug)]
struct Cell {
    /// For each tile the share that is seen.
    shares: Vec<f32>,
    factors: [OnceLock<Option<Factors>>; FACINGS],
}

/// How often the tiles of an environment are sampled.
#[derive(Debug)]
pub(crate) struct Factors {
    tiles: PiecewiseConstant1D,
}

impl EnvironmentVisibility {
    /// For a light of a scene in a box; `None` where the box is empty or has no size.
    pub fn new(light: u32, bounds: Aabb) -> Option<Self> {
        let extent = bounds.max - bounds.min;
        let scale = CELLS / extent.max_element();
        if !(scale.is_finite() && scale > 0.0 && extent.min_element() >= 0.0) {
            return None;
        }
        let extent = extent * scale;
        let size = extent.to_array().map(|n| (n.ceil() as usize).clamp(1, CELLS as usize));
        let cells = (0..size.iter().product()).map(|_| OnceLock::new()).collect();
        Some(Self { light, min: bounds.min, scale, size, extent, cells })
    }

    /// How the environment is sampled at a place; `None` where most of its light is in sight, or the place is beyond the box. `sees`: whether
    /// nothing is in the way from a point into a unit direction.
    #[inline]
    pub(crate) fn at(&self, environment: &EnvironmentLight, ctx: &LightContext, sees: impl Fn(Vec3, Vec3) -> bool) -> Option<&Factors> {
        let at = (ctx.p - self.min) * self.scale;
        // Rounding may put what lies on the box's sides beyond them.
        let is_inside = at.cmpge(Vec3::splat(-1e-3)).all() && at.cmple(self.extent + 1e-3).all();
        if !is_inside {
            return None;
        }
        let place = std::array::from_fn(|a| (at[a] as usize).min(self.size[a] - 1));
        let [x, y, z] = place;
        let cell = &self.cells[(z * self.size[1] + y) * self.size[0] + x];
        let cell = cell.get_or_init(|| self.look(environment, place, sees).map(Box::new)).as_ref()?;
        let facing = facing(ctx.n);
        cell.factors[facing].get_or_init(|| Factors::new(environment, direction(facing), &cell.shares)).as_ref()
    }

    /// What is seen from a cell, where it is not nearly all.
    #[cold]
    fn look(&self, environment: &EnvironmentLight, place: [usize; 3], sees: impl Fn(Vec3, Vec3) -> bool) -> Option<Cell> {
        let key = hash_words(place.map(|i| i as u64));
        let u = |i: u32, k: u64| unit_float(hash_words([key, u64::from(i), k]) as u32);
        let corner = Vec3::from_array(place.map(|i| i as f32));
        let sees_from_cell = |i: u32, d: Vec3| {
            let at = (corner + Vec3::new(u(i, 0), u(i, 1), u(i, 2))).min(self.extent);
            sees(self.min + at / self.scale, d)
        };
        // Seen, and all.
        let mut rays = vec![[0.0f32; 2]; TILES[0] * TILES[1]];
        let add = |rays: &mut [[f32; 2]], i: u32, tile: usize, d: Vec3| {
            rays[tile][0] += f32::from(u8::from(sees_from_cell(i, d)));
            rays[tile][1] += 1.0;
        };
        for i in 0..RAYS {
            if let Some((d, tile)) = environment.sample_tile(Vec2::new(u(i, 3), u(i, 4))) {
                add(&mut rays, i, tile, d);
            }
        }
        let [seen, all] = rays.iter().fold([0.0; 2], |sum, r| [sum[0] + r[0], sum[1] + r[1]]);
        if seen > CLEAR * all {
            return None;
        }
        for (i, tile) in (0..TILES[0] * TILES[1]).flat_map(|tile| [tile; RAYS_OF_TILE as usize]).enumerate() {
            let i = RAYS + i as u32;
            add(&mut rays, i, tile, environment.direction_of_tile(tile, Vec2::new(u(i, 3), u(i, 4))));
        }
        let shares = (0..rays.len()).map(|tile| share_seen(&rays, tile)).collect();
        Some(Cell { shares, factors: std::array::from_fn(|_| OnceLock::new()) })
    }
}

impl Factors {
    /// For surfaces that face a direction (zero: none), by the shares of tiles that are seen; `None` where most of the light is in sight.
    fn new(environment: &EnvironmentLight, facing: Vec3, shares: &[f32]) -> Option<Self> {
        let own = environment.tile_probabilities();
        let weighted = |weight: &dyn Fn(usize) -> f32, slack: f32| -> Vec<f32> {
            let cos = |tile| cosine(facing, environment.direction_of_tile(tile, Vec2::splat(0.5)), slack);
            (0..own.len()).map(|tile| own[tile] * cos(tile) * weight(tile)).collect()
        };
        let sum = |values: &[f32]| values.iter().sum::<f32>();
        if sum(&weighted(&|tile| shares[tile], 0.0)) > (1.0 - HIDDEN) * sum(&weighted(&|_| 1.0, 0.0)) {
            return None;
        }
        let mut weights = weighted(&|tile| fns::pow(shares[tile], POWER), SLACK);
        let all = sum(&weights);
        let learned = if all > 0.0 { (1.0 - DEFENSIVE) / all } else { 0.0 };
        for (weight, own) in weights.iter_mut().zip(own) {
            *weight = *weight * learned + own * DEFENSIVE;
        }
        Some(Self { tiles: PiecewiseConstant1D::new(&weights) })
    }

    /// How much more often a tile is sampled than by the environment's own density.
    #[inline]
    fn of(&self, environment: &EnvironmentLight, tile: usize) -> f32 {
        let own = environment.tile_probabilities()[tile];
        if own > 0.0 { self.tiles.probability(tile) / own } else { 0.0 }
    }

    /// Samples the environment.
    #[inline]
    pub fn sample(&self, environment: &EnvironmentLight, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let (tile, _, x) = self.tiles.sample_discrete(u.x);
        environment.sample_in_tile(ctx, tile, self.of(environment, tile), Vec2::new(x, u.y))
    }

    /// The density of [`Self::sample`] for a unit direction.
    #[inline]
    pub fn pdf(&self, environment: &EnvironmentLight, wi: Vec3) -> f32 {
        let (pdf, tile) = environment.pdf_and_tile(wi);
        pdf * self.of(environment, tile)
    }
}

/// The one of the 26 directions to the faces, edges and corners of a cube that a normal is near to; the number between where there is none.
#[inline]
fn facing(n: Vec3) -> usize {
    let digit = |x: f32| {
        if x > DIAGONAL {
            2
        } else if x < -DIAGONAL {
            0
        } else {
            1
        }
    };
    digit(n.x) + 3 * digit(n.y) + 9 * digit(n.z)
}

/// The direction of a number; zero for none.
fn direction(facing: usize) -> Vec3 {
    let digit = |i: usize| (i % 3) as f32 - 1.0;
    Vec3::new(digit(facing), digit(facing / 3), digit(facing / 9)).normalize_or_zero()
}

/// The cosine between a direction and what a surface faces, at most 1, for surfaces that face a little off it; 1 for those without a normal.
fn cosine(facing: Vec3, d: Vec3, slack: f32) -> f32 {
    if facing == Vec3::ZERO { 1.0 } else { ((facing.dot(d) + slack) / (1.0 + slack)).max(0.0) }
}

/// The share of a tile that is seen, by the rays through it and through those around it.
fn share_seen(rays: &[[f32; 2]], tile: usize) -> f32 {
    let [columns, rows] = TILES;
    let (x, y) = (tile % columns, tile / columns);
    let mut around = [0.0, 0.0];
    for row in y.saturating_sub(1)..=(y + 1).min(rows - 1) {
        for column in [x + columns - 1, x, x + 1] {
            let [seen, all] = rays[row * columns + column % columns];
            around = [around[0] + seen / all.max(1.0), around[1] + 1.0];
        }
    }
    let [seen, all] = rays[tile];
    (seen + NEIGHBORS * around[0] / around[1]) / (all + NEIGHBORS)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]

    use super::*;
    use crate::light::Rows;
    use crate::math::{Mat4, warp};

    fn u(i: u32, k: u64) -> f32 {
        unit_float(hash_words([u64::from(i), k]) as u32)
    }

    /// A sky with a sun.
    fn sky() -> EnvironmentLight {
        let (width, height) = (70, 33);
        let mut texels: Vec<[f32; 3]> = (0..width * height).map(|i| [0.5 + u(i as u32, 9); 3]).collect();
        texels[8 * width + 60] = [2e4; 3];
        EnvironmentLight::new((width, height), texels, [1.0; 3], Mat4::from_rotation_x(0.3), Rows::Centered).unwrap()
    }

    fn cells() -> EnvironmentVisibility {
        EnvironmentVisibility::new(0, Aabb { min: Vec3::splat(-1.0), max: Vec3::ONE }).unwrap()
    }

    /// The inside of a box with a window in one of its walls.
    fn through_window(o: Vec3, d: Vec3) -> bool {
        let p = o + d * ((1.0 - o.x) / d.x);
        d.x > 0.0 && p.y.abs() < 0.4 && p.z.abs() < 0.3
    }

    fn at(n: Vec3) -> LightContext {
        LightContext { p: Vec3::new(-0.4, 0.1, -0.9), n }
    }

    /// Samples go through the window, by the density that is told, and their mean is the light that comes through it.
    #[test]
    fn samples_go_where_the_sky_is_seen() {
        let (sky, cells) = (sky(), cells());
        let count = 40_000;
        // The same by directions that know nothing.
        let expected: f64 = (0..400_000)
            .map(|i| {
                let d = warp::uniform_sphere(Vec2::new(u(i, 1), u(i, 2)));
                if through_window(at(d).p, d) { f64::from(sky.radiance(d).luminance()) * 4.0 * std::f64::consts::PI / 4e5 } else { 0.0 }
            })
            .sum();
        for n in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::ZERO] {
            let ctx = at(n);
            let factors = cells.at(&sky, &ctx, through_window).unwrap();
            let (mut sum, mut squares, mut seen, mut seen_by_own, mut other) = (0.0, 0.0, 0, 0, 0);
            for i in 0..count {
                let u = Vec2::new(u(i, 3), u(i, 4));
                if let Some(sample) = factors.sample(&sky, &ctx, u) {
                    let pdf = factors.pdf(&sky, sample.wi);
                    other += u32::from((pdf / sample.pdf - 1.0).abs() > 1e-3);
                    if through_window(ctx.p, sample.wi) {
                        seen += 1;
                        let value = f64::from(sample.radiance.luminance() / sample.pdf);
                        sum += value;
                        squares += value * value;
                    }
                }
                seen_by_own += u32::from(sky.sample(&ctx, u).is_some_and(|s| through_window(ctx.p, s.wi)));
            }
            // Rounding takes a few to the next texel.
            assert!(other < count / 2000, "{n}: {other} of {count} samples have another density than they tell");
            let n_samples = f64::from(count);
            let mean = sum / n_samples;
            let error = ((squares / n_samples - mean * mean) / n_samples).sqrt();
            assert!((mean - expected).abs() < 4.0 * (error + 0.01 * expected), "{n}: {mean} ± {error} instead of {expected}");
            assert!(error < 0.02 * mean, "{n}: {mean} ± {error}");
            assert!(
                seen * 3 > count && seen > 100 * seen_by_own,
                "{n}: {seen} of {count} go through the window, {seen_by_own} without cells"
            );
        }
    }

    #[test]
    fn cells_know_nothing_of_who_asks() {
        let sky = sky();
        let places: Vec<LightContext> = (0..200)
            .map(|i| LightContext {
                p: Vec3::new(u(i, 5), u(i, 6), u(i, 7)) * 2.0 - 1.0,
                n: [Vec3::X, Vec3::NEG_Y, Vec3::ZERO][i as usize % 3],
            })
            .collect();
        let (one, other) = (cells(), cells());
        let wi = Vec3::new(1.0, 0.1, 0.2).normalize();
        let ask = |cells: &EnvironmentVisibility, ctx: &LightContext| cells.at(&sky, ctx, through_window).map(|f| f.pdf(&sky, wi));
        let forward: Vec<_> = places.iter().map(|ctx| ask(&one, ctx)).collect();
        let mut backward: Vec<_> = places.iter().rev().map(|ctx| ask(&other, ctx)).collect();
        backward.reverse();
        assert_eq!(forward, backward);
        assert!(forward.iter().flatten().count() > 100);
    }

    #[test]
    fn under_an_open_sky_there_are_no_cells() {
        let (sky, cells) = (sky(), cells());
        assert!(cells.at(&sky, &at(Vec3::Z), |_, _| true).is_none());
        assert!(cells.at(&sky, &LightContext { p: Vec3::splat(1.5), n: Vec3::Z }, through_window).is_none());
        assert!(cells.at(&sky, &LightContext { p: Vec3::splat(f32::NAN), n: Vec3::Z }, through_window).is_none());
        for max in [Vec3::NEG_INFINITY, Vec3::ZERO, Vec3::INFINITY, Vec3::NAN] {
            assert!(EnvironmentVisibility::new(0, Aabb { min: Vec3::ZERO, max }).is_none());
        }
        // From where nothing is seen at all samples go everywhere.
        let factors = cells.at(&sky, &at(Vec3::Z), |_, _| false);
        assert!(factors.is_none() || factors.unwrap().sample(&sky, &at(Vec3::Z), Vec2::splat(0.5)).is_some());
    }
}
