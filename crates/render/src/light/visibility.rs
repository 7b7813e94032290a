//! Which part of an environment map is seen from where: what next-event estimation needs in rooms, where walls are in the way of most of
//! the sky (after Atanasov et al. 2018, "Adaptive environment sampling on CPU and GPU", doi:10.1145/3214745.3214808).
//!
//! The scene's box is cut into cells, and the directions into tiles. From points on surfaces that have a cell in front of them rays tell which
//! tiles are seen; a sample goes to one of these by its light, what is seen of it and the cosine, and inside it by the environment's own
//! density. Cells are made when they are first asked for, from nothing but the scene and their place: whoever asks, and when, changes
//! nothing. A share of the samples goes to all of the environment, so that nothing is ever left out, whatever the rays have missed.

use std::sync::OnceLock;

use super::directional::infinite_sample;
use super::{EnvironmentLight, LightContext, LightSample};
use crate::math::hash::{hash_words, unit_float};
use crate::math::{Aabb, Frame, INV_4PI, ONE_MINUS_EPSILON, Vec2, Vec3, fns, warp};

/// Cells along the longest edge of the scene's box. Tried: twice as many take more time than they save.
const CELLS: f32 = 16.0;
/// Columns and rows of tiles.
pub(super) const TILES: [usize; 2] = [32, 16];
/// Rays of a cell: so many by the environment's density, and so many through each tile.
const RAYS: u32 = 64;
const RAYS_OF_TILE: u32 = 4;
/// Places in a cell that rays start from, how often each looks for a surface, and how far above it it is, in cells.
const POINTS: u32 = 64;
const ATTEMPTS: u64 = 8;
const ABOVE: f32 = 1e-3;
/// The first of the random numbers for directions; those before are for places.
const U: u64 = 3 * ATTEMPTS;
/// Where more than this share of the first rays meets nothing, no others are needed.
const CLEAR: f32 = 0.95;
/// The share of the light in front of surfaces that has to be hidden for the cell to be of use.
const HIDDEN: f32 = 0.5;
/// The share of samples that go wherever the environment is bright.
const BRIGHT: f32 = 0.0625;
/// The share of samples that go by the cosine alone. Without them, what the rays have missed of a dark part of the environment is found as
/// seldom as that part is dark, and weighs as much as all of the environment's light then.
const EVEN: f32 = 0.25;
/// Rays that what is known of the tiles around one counts for.
const NEIGHBORS: f32 = 0.5;
/// A tile's weight goes with this power of the share of it that is seen: 0.5 would be best if the shares were known, 1 doubts tiles more of which
/// little is seen.
const POWER: f32 = 0.7;
/// A tile is as wide as this: the cosine of its middle is taken to be larger by it.
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
    /// For each facing what surfaces behind each cell see, where it is not nearly all.
    cells: Vec<OnceLock<Option<Box<[SeenTile]>>>>,
}

/// What the cells ask the scene; directions are unit vectors.
pub(crate) trait Sight {
    /// Whether nothing is in light's way from a point to the environment.
    fn is_open(&self, o: Vec3, d: Vec3) -> bool;

    /// The distance of the first surface, where it is below `t_max`.
    fn distance(&self, o: Vec3, d: Vec3, t_max: f32) -> Option<f32>;
}

/// A tile that is seen from a part of the scene.
#[derive(Debug)]
struct SeenTile {
    /// To its middle.
    direction: Vec3,
    /// How often it should be sampled, before the cosine.
    weight: f32,
    /// The share of the environment's light that is in it.
    light: f32,
    index: u32,
}

/// What is seen of an environment from a place.
pub(crate) struct SeenPart<'a> {
    environment: &'a EnvironmentLight,
    tiles: &'a [SeenTile],
    n: Vec3,
    /// Of the weights of all tiles.
    sum: f32,
    /// The share of samples that go to the tiles, and the one that goes by the cosine.
    shares: [f32; 2],
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
        let cells = (0..FACINGS * size.iter().product::<usize>()).map(|_| OnceLock::new()).collect();
        Some(Self { light, min: bounds.min, scale, size, extent, cells })
    }

    /// How the environment is sampled at a place; `None` where most of its light is in sight, or the place is beyond the box.
    #[inline]
    pub(crate) fn at<'a>(&'a self, environment: &'a EnvironmentLight, ctx: &LightContext, sight: &impl Sight) -> Option<SeenPart<'a>> {
        let at = (ctx.p - self.min) * self.scale;
        // Rounding may put what lies on the box's sides beyond them.
        let is_inside = at.cmpge(Vec3::splat(-1e-3)).all() && at.cmple(self.extent + 1e-3).all();
        if !is_inside {
            return None;
        }
        // The cell in front of the surface, as there may be next to nothing in front of it in its own.
        let in_front = (at + 0.5 * ctx.n).max(Vec3::ZERO);
        let place = std::array::from_fn(|a| (in_front[a] as usize).min(self.size[a] - 1));
        let ([x, y, z], facing) = (place, facing(ctx.n));
        let cell = &self.cells[((z * self.size[1] + y) * self.size[0] + x) * FACINGS + facing];
        let tiles = cell.get_or_init(|| self.look(environment, place, direction(facing), sight)).as_deref()?;
        Some(SeenPart::new(environment, tiles, ctx.n))
    }

    /// What surfaces see that face a direction and have a cell in front of them (zero: any place in the cell), where it is not most of what they face.
    #[cold]
    fn look(&self, environment: &EnvironmentLight, place: [usize; 3], n: Vec3, sight: &impl Sight) -> Option<Box<[SeenTile]>> {
        let key = hash_words(place.map(|i| i as u64));
        let u = |i: u32, k: u64| unit_float(hash_words([key, u64::from(i), k]) as u32);
        let corner = Vec3::from_array(place.map(|i| i as f32));
        let in_world = |at: Vec3| self.min + at / self.scale;
        let point = |i: u32| {
            let somewhere = |k: u64| (corner + Vec3::new(u(i, k), u(i, k + 1), u(i, k + 2))).min(self.extent);
            if n != Vec3::ZERO {
                for attempt in 0..ATTEMPTS {
                    let at = somewhere(3 * attempt);
                    // Back to a surface that faces there.
                    if let Some(t) = sight.distance(in_world(at), -n, 1.0 / self.scale) {
                        return in_world(at - n * (t * self.scale - ABOVE));
                    }
                }
            }
            in_world(somewhere(0))
        };
        let points: Vec<Vec3> = (0..POINTS).map(point).collect();
        // Seen, and all.
        let mut rays = vec![[0.0f32; 2]; TILES[0] * TILES[1]];
        let add = |rays: &mut [[f32; 2]], i: u32, tile: usize, d: Vec3| {
            rays[tile][0] += f32::from(u8::from(sight.is_open(points[(i % POINTS) as usize], d)));
            rays[tile][1] += 1.0;
        };
        for i in 0..RAYS {
            if let Some((d, tile)) = environment.sample_tile(Vec2::new(u(i, U), u(i, U + 1))) {
                add(&mut rays, i, tile, d);
            }
        }
        let [seen, all] = rays.iter().fold([0.0; 2], |sum, r| [sum[0] + r[0], sum[1] + r[1]]);
        if seen > CLEAR * all {
            return None;
        }
        let middles: Vec<Vec3> = (0..rays.len()).map(|tile| environment.direction_of_tile(tile, Vec2::splat(0.5))).collect();
        let light = environment.tile_probabilities();
        for (i, tile) in (0..rays.len()).flat_map(|tile| [tile; RAYS_OF_TILE as usize]).enumerate() {
            let i = RAYS + i as u32;
            if light[tile] > 0.0 && cosine(n, middles[tile]) > 0.0 {
                // A prime step, so that a tile's rays and those of its neighbors start from other points each.
                add(&mut rays, i.wrapping_mul(7), tile, environment.direction_of_tile(tile, Vec2::new(u(i, U), u(i, U + 1))));
            }
        }
        let faced = |tile: usize| light[tile] * cosine(n, middles[tile]);
        let shares: Vec<f32> = (0..rays.len()).map(|tile| share_seen(&rays, tile)).collect();
        let seen: f32 = shares.iter().enumerate().map(|(tile, share)| share * faced(tile)).sum();
        if seen > (1.0 - HIDDEN) * (0..rays.len()).map(faced).sum::<f32>() {
            return None;
        }
        let tiles = shares.iter().enumerate().filter(|(tile, share)| light[*tile] > 0.0 && **share > 0.0).map(|(tile, share)| SeenTile {
            direction: middles[tile],
            weight: light[tile] * fns::pow(*share, POWER),
            light: light[tile],
            index: tile as u32,
        });
        Some(tiles.collect())
    }
}

impl SeenTile {
    /// The weight for a surface that faces `n` (zero: all directions).
    #[inline]
    fn weight_towards(&self, n: Vec3) -> f32 {
        self.weight * cosine(n, self.direction)
    }
}

impl<'a> SeenPart<'a> {
    #[inline]
    fn new(environment: &'a EnvironmentLight, tiles: &'a [SeenTile], n: Vec3) -> Self {
        let sum = tiles.iter().map(|tile| tile.weight_towards(n)).sum();
        let shares = if sum > 0.0 { [1.0 - BRIGHT - EVEN, EVEN] } else { [0.0, 0.5] };
        Self { environment, tiles, n, sum, shares }
    }

    /// Samples the environment.
    #[inline]
    pub fn sample(&self, ctx: &LightContext, u: Vec2) -> Option<LightSample> {
        let [learned, even] = self.shares;
        let mut sample = if u.x < learned {
            let mut rest = u.x / learned * self.sum;
            let mut chosen = None;
            for tile in self.tiles {
                let weight = tile.weight_towards(self.n);
                if weight > 0.0 {
                    chosen = Some((tile, (rest / weight).min(ONE_MINUS_EPSILON)));
                    if rest < weight {
                        break;
                    }
                }
                rest -= weight;
            }
            let (tile, x) = chosen?;
            self.environment.sample_in_tile(ctx, tile.index as usize, Vec2::new(x, u.y))?
        } else if u.x < learned + even {
            let u = Vec2::new((u.x - learned) / even, u.y);
            let wi = if self.n == Vec3::ZERO {
                warp::uniform_sphere(u)
            } else {
                Frame::from_normal(self.n).world_from_local(warp::cosine_hemisphere(u))
            };
            let radiance = self.environment.radiance(wi);
            (!radiance.is_black()).then(|| infinite_sample(ctx, wi, radiance, 1.0))?
        } else {
            self.environment.sample(ctx, Vec2::new((u.x - learned - even) / (1.0 - learned - even), u.y))?
        };
        sample.pdf = self.pdf(sample.wi);
        (sample.pdf > 0.0).then_some(sample)
    }

    /// The density of [`Self::sample`] for a unit direction.
    #[inline]
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let [learned, even] = self.shares;
        let (own, index) = self.environment.pdf_and_tile(wi);
        let tile = self.tiles.binary_search_by_key(&(index as u32), |tile| tile.index).map(|i| &self.tiles[i]);
        let by_tile = tile.map_or(0.0, |tile| own * tile.weight_towards(self.n) / (tile.light * self.sum));
        let by_cosine = if self.n == Vec3::ZERO { INV_4PI } else { warp::cosine_hemisphere_pdf(self.n.dot(wi)) };
        let learned_pdf = if learned > 0.0 { learned * by_tile } else { 0.0 };
        learned_pdf + even * by_cosine + (1.0 - learned - even) * own
    }
}

/// The cosine of a tile's direction, where a part of it is in front of a surface; 1 where there is no normal.
#[inline]
fn cosine(n: Vec3, d: Vec3) -> f32 {
    if n == Vec3::ZERO { 1.0 } else { (n.dot(d) + SLACK).max(0.0) }
}

/// The one of the 26 directions to the faces, edges and corners of a cube that a normal is near to; the number between where there is none.
#[inline]
fn facing(n: Vec3) -> usize {
    let digit = |x: f32| usize::from(x > -DIAGONAL) + usize::from(x > DIAGONAL);
    digit(n.x) + 3 * digit(n.y) + 9 * digit(n.z)
}

/// The direction of a number; zero for none.
fn direction(facing: usize) -> Vec3 {
    let digit = |i: usize| (i % 3) as f32 - 1.0;
    Vec3::new(digit(facing), digit(facing / 3), digit(facing / 9)).normalize_or_zero()
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

    /// A box from −1 to 1, out of which one sees as this says.
    struct Room(fn(Vec3, Vec3) -> bool);

    impl Sight for Room {
        fn is_open(&self, o: Vec3, d: Vec3) -> bool {
            (self.0)(o, d)
        }

        fn distance(&self, o: Vec3, d: Vec3, t_max: f32) -> Option<f32> {
            let walls = (d.signum() - o) / d;
            Some(walls.min_element()).filter(|t| *t < t_max)
        }
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
            let part = cells.at(&sky, &ctx, &Room(through_window)).unwrap();
            let (mut sum, mut squares, mut seen, mut seen_by_own, mut other) = (0.0, 0.0, 0, 0, 0);
            for i in 0..count {
                let u = Vec2::new(u(i, 3), u(i, 4));
                if let Some(sample) = part.sample(&ctx, u) {
                    let pdf = part.pdf(sample.wi);
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

    /// A ceiling at the lower side of its cell, which has next to nothing of the room in it; above is the open sky.
    #[test]
    fn ceilings_see_the_room_below_them() {
        fn under_a_ceiling(o: Vec3, d: Vec3) -> bool {
            o.z > 0.001 && d.z > 0.0 || o.z < 0.001 && through_window(o, d) && (o + d * ((1.0 - o.x) / d.x)).z < 0.0
        }
        struct Ceiling;
        impl Sight for Ceiling {
            fn is_open(&self, o: Vec3, d: Vec3) -> bool {
                under_a_ceiling(o, d)
            }

            fn distance(&self, o: Vec3, d: Vec3, t_max: f32) -> Option<f32> {
                Some((0.001 - o.z) / d.z).filter(|t| *t > 0.0 && *t < t_max)
            }
        }
        let (sky, cells) = (sky(), cells());
        let ctx = LightContext { p: Vec3::new(0.5, 0.1, 0.001), n: Vec3::NEG_Z };
        let part = cells.at(&sky, &ctx, &Ceiling).unwrap();
        let count = 4000;
        let goes_out = |i: &u32| {
            let sample = part.sample(&ctx, Vec2::new(u(*i, 3), u(*i, 4)));
            sample.is_some_and(|s| under_a_ceiling(ctx.p - 1e-4 * Vec3::Z, s.wi))
        };
        let seen = (0..count).filter(goes_out).count();
        assert!(seen * 3 > count as usize, "{seen} of {count}");
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
        let ask = |cells: &EnvironmentVisibility, ctx: &LightContext| cells.at(&sky, ctx, &Room(through_window)).map(|f| f.pdf(wi));
        let forward: Vec<_> = places.iter().map(|ctx| ask(&one, ctx)).collect();
        let mut backward: Vec<_> = places.iter().rev().map(|ctx| ask(&other, ctx)).collect();
        backward.reverse();
        assert_eq!(forward, backward);
        assert!(forward.iter().flatten().count() > 100);
    }

    #[test]
    fn under_an_open_sky_there_are_no_cells() {
        let (sky, cells) = (sky(), cells());
        assert!(cells.at(&sky, &at(Vec3::Z), &Room(|_, _| true)).is_none());
        assert!(cells.at(&sky, &LightContext { p: Vec3::splat(1.5), n: Vec3::Z }, &Room(through_window)).is_none());
        assert!(cells.at(&sky, &LightContext { p: Vec3::splat(f32::NAN), n: Vec3::Z }, &Room(through_window)).is_none());
        for max in [Vec3::NEG_INFINITY, Vec3::ZERO, Vec3::INFINITY, Vec3::NAN] {
            assert!(EnvironmentVisibility::new(0, Aabb { min: Vec3::ZERO, max }).is_none());
        }
        // From where nothing is seen at all samples go everywhere.
        let part = cells.at(&sky, &at(Vec3::Z), &Room(|_, _| false));
        assert!(part.is_none() || part.unwrap().sample(&at(Vec3::Z), Vec2::splat(0.5)).is_some());
    }
}
