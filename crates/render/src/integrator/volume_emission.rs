//! Light that leaves media: points of flames and other glowing volumes, and directions from there.
//!
//! Where a medium may be is covered by boxes: that of its grid, or those of the shapes that it fills. A box is divided into cells, chosen
//! by the power that some look-ups find in them, with a floor that gives every cell its chance; so the estimate has the right mean
//! whatever the look-ups miss. Which medium a point is in says the straight way from the camera, as for lights; points where it is another
//! one emit nothing. Directions are uniform.
//!
//! Methods that meet what media emit by their paths from the camera do not take part: `path` and its kin, `bdpt`, `vcm`, `mlt`. `light` and
//! the methods with photons do.

use rayon::prelude::*;

use super::emission::media_at;
use crate::accel::Ray;
use crate::light::strength;
use crate::math::{Aabb, Mat4, PiecewiseConstant1D, Vec2, Vec3, warp};
use crate::medium::{Medium, MediumStack};
use crate::sampler::HashRng;
use crate::scene::Scene;
use crate::scene::geometry::{Geometry, Object};
use crate::spectrum::Spectrum;

/// The most cells along an axis, and those of all grids together: thousands of grids have coarser ones.
const MOST_CELLS: u32 = 32;
const ALL_CELLS: u32 = 1 << 19;
/// The mean weight of cells that is added to all of them.
const FLOOR: f32 = 0.1;
/// Shapes of one medium that have boxes of their own; more share one.
const MOST_SHAPES: usize = 32;
/// What boxes of shapes may stick out of each other and count as within.
const SLACK: f32 = 1e-3;

/// A ray that leaves a medium.
#[derive(Clone, Copy, Debug)]
pub struct VolumeRay {
    /// The ray.
    pub ray: Ray,
    /// The power in W that it carries if it is the only one: the mean over rays is the power of all media.
    pub power: Spectrum,
    /// The media at its start.
    pub media: MediumStack,
}

/// A box in which a medium may be.
#[derive(Clone, Debug)]
struct Region {
    medium: u32,
    world_from_box: Mat4,
    box_from_world: Mat4,
    /// In scene units.
    volume: f32,
    size: [u32; 3],
    cells: PiecewiseConstant1D,
    /// About what all of the box emits.
    power: f32,
}

/// Chooses points of media by power.
#[derive(Clone, Debug)]
pub struct VolumeEmission {
    /// In the order of their media.
    regions: Vec<Region>,
    /// The first region of each medium of the scene, and the number of all.
    first: Vec<u32>,
    choice: PiecewiseConstant1D,
    /// About what all media emit, as [`strength`] measures it.
    power: f32,
}

impl VolumeEmission {
    /// For the media of a scene; `None` where none emits.
    ///
    /// # Errors
    /// A sentence about media that emit and have no end.
    pub fn new(scene: &Scene) -> Result<Option<Self>, String> {
        if !scene.media.iter().any(Medium::emits) {
            return Ok(None);
        }
        let fills = Fills::of_all(scene);
        let grids = scene.media.iter().filter(|m| m.emits() && matches!(m, Medium::Grid(_))).count();
        let most_cells = (1..=MOST_CELLS).rev().find(|n| n.pow(3) as usize * grids <= ALL_CELLS as usize).unwrap_or(1);
        let (mut regions, mut first) = (Vec::new(), vec![0]);
        for (index, (medium, fills)) in scene.media.iter().zip(&fills).enumerate() {
            if medium.emits() && (fills.is_used || scene.camera_medium.top() == index as u32) {
                let found = boxes(scene, index as u32, fills, most_cells)?;
                regions.extend(found.into_iter().filter_map(|(m, size)| Region::new(medium, index as u32, m, size)));
            }
            first.push(regions.len() as u32);
        }
        if regions.is_empty() {
            return Ok(None);
        }
        let most = regions.iter().map(|r| r.power).fold(0.0, f32::max);
        // The floor keeps every box within what a table of `f32` can tell apart.
        let weights: Vec<f32> = regions.iter().map(|r| (r.power / most).max(1e-3 / regions.len() as f32)).collect();
        let power = regions.iter().map(|r| r.power).sum::<f32>().min(1e30);
        Ok(Some(Self { choice: PiecewiseConstant1D::new(&weights), regions, first, power }))
    }

    /// About the power of all media in W.
    pub fn power(&self) -> f32 {
        self.power
    }

    /// A ray for random numbers in [0, 1); `None` where nothing is emitted, which counts as a ray without power.
    pub fn sample(&self, scene: &Scene, u: f32, u_position: Vec2, u_direction: Vec2, rng: &mut HashRng) -> Option<VolumeRay> {
        let (index, _, u) = self.choice.sample_discrete(u);
        let region = &self.regions[index];
        let (cell, _, _) = region.cells.sample_discrete(u);
        let cell = cell as u32;
        let [nx, ny, nz] = region.size;
        let corner = Vec3::new((cell % nx) as f32, (cell / nx % ny) as f32, (cell / nx / ny) as f32);
        let local = (corner + Vec3::new(u_position.x, u_position.y, rng.next_1d())) / Vec3::new(nx as f32, ny as f32, nz as f32);
        let p = region.world_from_box.transform_point3(local);
        let radiance = scene.media[region.medium as usize].coefficients(p).emission;
        if radiance.is_black() {
            return None;
        }
        let media = media_at(scene, p);
        if media.top() != region.medium {
            return None;
        }
        // The point itself may have been rounded out of its box.
        let pdf = self.density(region.medium, p).max(region.density(local.clamp(Vec3::ZERO, Vec3::ONE)) * self.choice.probability(index));
        let power = radiance * (1.0 / (pdf * warp::UNIFORM_SPHERE_PDF));
        (power.is_finite() && !power.is_black()).then(|| VolumeRay { ray: Ray::new(p, warp::uniform_sphere(u_direction)), power, media })
    }

    /// The density by volume of points of a medium, of all its boxes that hold the point: [`MOST_SHAPES`] at most, however many media emit.
    fn density(&self, medium: u32, p: Vec3) -> f32 {
        let [begin, end] = [medium, medium + 1].map(|m| self.first[m as usize] as usize);
        let of = |i: usize| {
            let r = &self.regions[i];
            let local = r.box_from_world.transform_point3(p);
            let inside = local.cmpge(Vec3::ZERO).all() && local.cmple(Vec3::ONE).all();
            if inside { self.choice.probability(i) * r.density(local) } else { 0.0 }
        };
        (begin..end).map(of).sum()
    }
}

impl Region {
    /// `None` for boxes without a volume.
    fn new(medium: &Medium, index: u32, world_from_box: Mat4, size: [u32; 3]) -> Option<Self> {
        let volume = world_from_box.determinant().abs();
        let box_from_world = world_from_box.inverse();
        if !(volume > 0.0 && volume.is_finite() && box_from_world.is_finite()) {
            return None;
        }
        let [nx, ny, nz] = size;
        let scale = Vec3::new(nx as f32, ny as f32, nz as f32);
        let mut weights: Vec<f32> = (0..nx * ny * nz)
            .into_par_iter()
            .map(|cell| {
                let corner = Vec3::new((cell % nx) as f32, (cell / nx % ny) as f32, (cell / nx / ny) as f32);
                (0..8)
                    .map(|i| {
                        let at = [0, 1, 2].map(|k| if i >> k & 1 == 0 { 0.25 } else { 0.75 });
                        let p = world_from_box.transform_point3((corner + Vec3::from_array(at)) / scale);
                        0.125 * strength(medium.coefficients(p).emission)
                    })
                    .sum()
            })
            .collect();
        let mean = weights.iter().map(|&w| f64::from(w)).sum::<f64>() / weights.len() as f64;
        // Emission that no look-up has met may still be there.
        let mean = (mean as f32).max(1e-30);
        weights.iter_mut().for_each(|w| *w = *w / mean + FLOOR);
        let power = (mean * volume / warp::UNIFORM_SPHERE_PDF).clamp(1e-30, 1e30);
        let cells = PiecewiseConstant1D::new(&weights);
        Some(Self { medium: index, world_from_box, box_from_world, volume, size, cells, power })
    }

    /// The density by volume at a point of the unit cube.
    fn density(&self, local: Vec3) -> f32 {
        let at = |k: usize| ((local[k] * self.size[k] as f32) as u32).min(self.size[k] - 1);
        let cell = (at(2) * self.size[1] + at(1)) * self.size[0] + at(0);
        self.cells.probability(cell as usize) * self.cells.len() as f32 / self.volume
    }
}

/// The shapes of a medium, as boxes in the world.
#[derive(Clone, Debug, Default)]
struct Fills {
    inside: Vec<Aabb>,
    outside: Vec<Aabb>,
    /// Whether any object names the medium, be it one that is placed nowhere.
    is_used: bool,
}

impl Fills {
    /// Those of each medium of a scene that emits; empty for others. One pass over all primitives.
    fn of_all(scene: &Scene) -> Vec<Self> {
        let emits: Vec<bool> = scene.media.iter().map(Medium::emits).collect();
        let emits = |medium: u32| emits.get(medium as usize).copied().unwrap_or(false);
        let concerned = |o: &Object| emits(o.interior) || emits(o.exterior);
        let mut fills = vec![Self::default(); scene.media.len()];
        for o in scene.geometries.iter().flat_map(|g| &g.objects) {
            for medium in [o.interior, o.exterior] {
                if let Some(fill) = fills.get_mut(medium as usize) {
                    fill.is_used = true;
                }
            }
        }
        let bounds_of = |geometry: &Geometry| {
            let mut bounds = vec![Aabb::EMPTY; geometry.objects.len()];
            if !geometry.objects.iter().any(concerned) {
                return bounds;
            }
            for (primitive, &object) in geometry.object_of_primitive.iter().enumerate() {
                if concerned(&geometry.objects[object as usize]) {
                    let own = match geometry.triangles.get(primitive) {
                        Some(corners) => Aabb::from_points(corners.map(|i| geometry.positions[i as usize])),
                        None => geometry.shapes[primitive - geometry.triangles.len()].bounds(),
                    };
                    bounds[object as usize] = bounds[object as usize].union(own);
                }
            }
            bounds
        };
        let bounds: Vec<Vec<Aabb>> = scene.geometries.iter().map(bounds_of).collect();
        for placement in &scene.placements {
            let objects = &scene.geometries[placement.geometry as usize].objects;
            for (object, &b) in objects.iter().zip(&bounds[placement.geometry as usize]).filter(|(_, b)| !b.is_empty()) {
                let b = placement.world_from_object.map_or(b, |m| b.transformed(m));
                if emits(object.interior) {
                    fills[object.interior as usize].inside.push(b);
                }
                if emits(object.exterior) && object.exterior != object.interior {
                    fills[object.exterior as usize].outside.push(b);
                }
            }
        }
        fills
    }
}

/// Boxes that hold all of a medium (the world from the unit cube), and the cells of each, up to so many along an axis.
fn boxes(scene: &Scene, medium: u32, fills: &Fills, most_cells: u32) -> Result<Vec<(Mat4, [u32; 3])>, String> {
    if let Medium::Grid(grid) = &scene.media[medium as usize]
        && let Some((m, values)) = grid.bounds()
    {
        return Ok(vec![(m, values.map(|n| n.clamp(1, most_cells as i32) as u32))]);
    }
    let Fills { inside, outside, .. } = fills;
    let whole = inside.iter().fold(Aabb::EMPTY, |a, b| a.union(*b));
    let slack = Vec3::splat(SLACK * whole.bounding_sphere().1);
    let holds = |b: &Aabb| b.min.cmpge(whole.min - slack).all() && b.max.cmple(whole.max + slack).all();
    let eye = scene.camera_origin();
    let camera_is_out = scene.camera_medium.top() == medium && !holds(&Aabb { min: eye, max: eye });
    if whole.is_empty() || !(whole.min.is_finite() && whole.max.is_finite()) || camera_is_out || !outside.iter().all(holds) {
        return Err("photons can leave media that emit only where they have an end: a homogeneous medium that emits and fills no closed \
                    shape (it is around the camera, or outside of a shape) is for path, bdpt, vcm, mlt, mnee and pathmap"
            .into());
    }
    let boxes = if inside.len() > MOST_SHAPES { std::slice::from_ref(&whole) } else { inside };
    Ok(boxes.iter().map(|b| (Mat4::from_translation(b.min) * Mat4::from_scale(b.extent()), [1; 3])).collect())
}
