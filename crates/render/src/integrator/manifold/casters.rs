//! The surfaces that bend light into chains.

use super::walk::Caster;
use crate::math::{Aabb, PiecewiseConstant1D, Vec2, Vec3};
use crate::sampler::HashRng;
use crate::scene::Scene;
use crate::scene::geometry::Geometry;
use crate::shape::{Shape, triangle};
use etendue_scene::desc::BsdfDesc;

/// With more casters than this one is chosen without regard to where it is.
const MOST_WEIGHED: usize = 64;

/// Smooth glass and mirrors of a scene.
pub(super) struct Casters {
    by_material: Vec<Option<Caster>>,
    placed: Vec<Placed>,
    /// Areas of the triangles of the objects, for [`Placed::table`].
    tables: Vec<PiecewiseConstant1D>,
}

/// An object of such a material.
struct Placed {
    placement: u32,
    first: u32,
    count: u32,
    table: Option<u32>,
    center: Vec3,
    radius: f32,
}

impl Casters {
    /// Those of a scene; `None` where there are none.
    pub fn new(scene: &Scene) -> Option<Self> {
        let mut by_material: Vec<Option<Caster>> = scene.materials.iter().map(|m| caster(scene, &m.desc)).collect();
        // No start aims at an unbounded surface: its material makes no chains.
        for object in scene.geometries.iter().flat_map(|g| g.objects.iter().map(move |o| (g, o))) {
            let (g, o) = object;
            let range = primitives(g, o.first_primitive, o.id);
            if range.filter_map(|i| g.shapes.get(i.checked_sub(g.triangles.len())?)).any(|s| matches!(s, Shape::Plane(_)))
                && let Some(event) = by_material.get_mut(o.material as usize)
            {
                *event = None;
            }
        }
        let (mut placed, mut tables) = (Vec::new(), Vec::new());
        let mut table_of = std::collections::BTreeMap::new();
        for (p, placement) in scene.placements.iter().enumerate() {
            let g = &scene.geometries[placement.geometry as usize];
            for o in &g.objects {
                if by_material.get(o.material as usize).copied().flatten().is_none() {
                    continue;
                }
                let range = primitives(g, o.first_primitive, o.id);
                let (first, count) = (range.start as u32, range.len() as u32);
                let mut bounds = bounds_of(g, range.clone());
                if let Some(m) = placement.world_from_object {
                    bounds = bounds.transformed(m);
                }
                let (center, radius) = bounds.bounding_sphere();
                if count == 0 || !(center.is_finite() && radius.is_finite()) {
                    continue;
                }
                let table = (range.end <= g.triangles.len()).then(|| {
                    *table_of.entry((placement.geometry, first)).or_insert_with(|| {
                        let areas: Vec<f32> =
                            range.map(|i| triangle::area(&corners(g, i))).map(|a| if a.is_finite() { a } else { 0.0 }).collect();
                        tables.push(PiecewiseConstant1D::new(&areas));
                        tables.len() as u32 - 1
                    })
                });
                placed.push(Placed { placement: p as u32, first, count, table, center, radius });
            }
        }
        (!placed.is_empty()).then_some(Self { by_material, placed, tables })
    }

    /// What a material does to chains; `None` where it makes none.
    #[inline]
    pub fn of_material(&self, material: u32) -> Option<Caster> {
        self.by_material.get(material as usize).copied().flatten()
    }

    /// The same for all materials.
    pub fn by_material(&self) -> &[Option<Caster>] {
        &self.by_material
    }

    /// The middle and radius of an object of the world.
    pub fn ball_of_light(&self, scene: &Scene, object: u32) -> Option<(Vec3, f32)> {
        let g = scene.geometries.first()?;
        let o = g.objects.get(object as usize)?;
        Some(bounds_of(g, primitives(g, o.first_primitive, o.id)).bounding_sphere())
    }

    /// A random point of a caster, rather of one that looks large from `p`.
    pub fn point(&self, scene: &Scene, p: Vec3, rng: &mut HashRng) -> Option<Vec3> {
        let u = rng.next_1d();
        let placed = &self.placed[if self.placed.len() > MOST_WEIGHED { index(u, self.placed.len()) } else { self.choose(p, u) }];
        let placement = &scene.placements[placed.placement as usize];
        let g = &scene.geometries[placement.geometry as usize];
        let (u, v) = (rng.next_1d(), Vec2::new(rng.next_1d(), rng.next_1d()));
        let of_all = |u| index(u, placed.count as usize);
        let primitive = placed.first as usize + placed.table.map_or_else(|| of_all(u), |t| self.tables[t as usize].sample_discrete(u).0);
        let local = match primitive.checked_sub(g.triangles.len()) {
            None => triangle::sample_area(&corners(g, primitive), v)?.p,
            Some(shape) => {
                let seen_from = placement.object_from_world.map_or(p, |m| m.transform_point3(p));
                let shape = &g.shapes[shape];
                shape.sample_solid_angle(seen_from, v).or_else(|| shape.sample_area(v))?.p
            }
        };
        Some(placement.world_from_object.map_or(local, |m| m.transform_point3(local)))
    }

    /// By the share of the sphere of directions that a caster covers, about.
    fn choose(&self, p: Vec3, u: f32) -> usize {
        let weight = |c: &Placed| {
            let share = c.radius * c.radius / (c.center - p).length_squared();
            if share < 1.0 { share.max(1e-6) } else { 1.0 }
        };
        let mut rest = u * self.placed.iter().map(weight).sum::<f32>();
        for (i, c) in self.placed.iter().enumerate() {
            rest -= weight(c);
            if rest < 0.0 {
                return i;
            }
        }
        self.placed.len() - 1
    }
}

/// The primitives of an object: its own follow each other.
fn primitives(g: &Geometry, first: u32, id: u32) -> std::ops::Range<usize> {
    let first = first as usize;
    let of = |&i: &u32| g.objects.get(i as usize).is_some_and(|o| o.id == id && o.first_primitive as usize == first);
    let count = g.object_of_primitive.get(first..).unwrap_or_default().iter().take_while(|i| of(i)).count();
    first..first + count
}

fn corners(g: &Geometry, i: usize) -> [Vec3; 3] {
    g.triangles[i].map(|v| g.positions[v as usize])
}

fn bounds_of(g: &Geometry, range: std::ops::Range<usize>) -> Aabb {
    let of = |i: usize| match i.checked_sub(g.triangles.len()) {
        None => Aabb::from_points(corners(g, i)),
        Some(shape) => g.shapes[shape].bounds(),
    };
    range.map(of).fold(Aabb::from_points([]), Aabb::union)
}

/// One of `n` for a random number in [0, 1).
fn index(u: f32, n: usize) -> usize {
    ((f64::from(u) * n as f64) as usize).min(n - 1)
}

/// What a material does to chains.
fn caster(scene: &Scene, desc: &BsdfDesc) -> Option<Caster> {
    match desc {
        BsdfDesc::Dielectric { roughness: None, int_ior, ext_ior, .. } => {
            let eta = int_ior / ext_ior;
            (eta > 0.0 && eta.is_finite()).then_some(Caster::Glass(eta))
        }
        BsdfDesc::Conductor { roughness: None, .. } => Some(Caster::Mirror),
        BsdfDesc::TwoSided { front, back } => {
            let is_metal = |side: u32| {
                let desc = scene.materials.get(side as usize).map(|m| &m.desc);
                matches!(desc, Some(BsdfDesc::Conductor { roughness: None, .. }))
            };
            (is_metal(front.0) && is_metal(back.0)).then_some(Caster::Mirror)
        }
        _ => None,
    }
}
