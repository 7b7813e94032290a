//! Faces: the sides of all triangles of a scene, in world space. What elements are subdivided from.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use super::bodies;
use super::form_factor::area_of;
use super::material::{SideOptics, side_optics};
use super::shapes::{self, Extent, Grid};
use crate::accel::{Hit, Ray};
use crate::math::Vec2;
use crate::scene::geometry::NONE;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Coordinates beyond this lose the form factors' digits; such triangles are left out.
const MAX_COORDINATE: f32 = 1e12;
/// More analytic shapes than this are cut into fewer triangles each.
const MANY_SHAPES: usize = 64;

/// One side of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Corners in the world, counter-clockwise seen from this side.
    pub corners: [Vec3; 3],
    /// Unit normal of this side.
    pub normal: Vec3,
    /// Index into [`Scene::placements`].
    pub instance: u32,
    /// Primitive of the placed geometry.
    pub primitive: u32,
    /// Object of the placed geometry.
    pub object: u32,
    /// Whether this is the side that the surface's normal points away from.
    pub is_back: bool,
    /// Whether corners 1 and 2 are exchanged against the primitive's.
    pub is_turned: bool,
    /// Index into [`Faces::shapes`]; [`NONE`] for a triangle of a mesh.
    pub shape: u32,
}

/// An analytic shape that was cut into triangles.
#[derive(Clone, Debug)]
pub struct ShapePatch {
    instance: u32,
    grid: Option<Grid>,
    extent: Extent,
    /// The triangles of a polygon, in the shape's space.
    polygon: Vec<[Vec3; 3]>,
    /// First entry of its triangles in [`Faces::sides`].
    first: u32,
}

/// What was left out or simplified, for the user.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FaceReport {
    /// Triangles without area.
    pub zero_area: u64,
    /// Triangles with a corner that is no number.
    pub not_finite: u64,
    /// Triangles with a corner too far from the origin.
    pub too_far: u64,
    /// Names of the objects that are taken for diffuse though they are not; at most some.
    pub not_diffuse: BTreeMap<String, u64>,
    /// Infinite planes, of which only a part is lit.
    pub planes: u64,
}

/// All faces of a scene.
#[derive(Clone, Debug, Default)]
pub struct Faces {
    /// The faces; fronts first where a triangle has both.
    pub faces: Vec<Face>,
    /// Shapes that were cut into triangles.
    pub shapes: Vec<ShapePatch>,
    /// Front and back face of each triangle: indices into `faces`, or [`NONE`].
    sides: Vec<[u32; 2]>,
    /// For each instance where its primitives start in `of_primitive`.
    first_primitive: Vec<u32>,
    /// For each primitive of each instance: its entry in `sides`, or for shapes its index in `shapes` with the highest bit set.
    of_primitive: Vec<u32>,
    /// What was left out.
    pub report: FaceReport,
}

const SHAPE_BIT: u32 = 1 << 31;

/// A triangle to be, before it is known which of its sides count.
pub(super) struct Candidate {
    pub corners: [Vec3; 3],
    pub instance: u32,
    pub primitive: u32,
    /// As [`Face::shape`].
    pub shape: u32,
}

impl Faces {
    /// Collects the faces of a scene. Both sides of a triangle count if they reflect or emit, but for the dark insides of [`bodies`]; its
    /// front always does, so that the light on it is known.
    ///
    /// # Errors
    /// A sentence where there are more triangles than `limit`.
    pub fn new(scene: &Scene, limit: usize) -> Result<Self, String> {
        let mut out = Self::default();
        let mut candidates = Vec::new();
        let total: usize = scene.placements.iter().map(|p| scene.geometries[p.geometry as usize].triangles.len()).sum();
        if total > limit {
            return Err(format!("radiosity: the scene has {total} triangles and --radiosity-elements allows {limit}"));
        }
        let shape_count: usize = scene.placements.iter().map(|p| scene.geometries[p.geometry as usize].shapes.len()).sum();
        if shape_count > limit {
            return Err(format!("radiosity: the scene has {shape_count} shapes and --radiosity-elements allows {limit} elements"));
        }
        let extent = bounded_extent(scene);
        for (instance, placement) in scene.placements.iter().enumerate() {
            let g = &scene.geometries[placement.geometry as usize];
            let m = placement.world_from_object;
            let to_world = |p: Vec3| m.map_or(p, |m| m.transform_point3(p));
            out.first_primitive.push(out.of_primitive.len() as u32);
            for (primitive, t) in g.triangles.iter().enumerate() {
                let corners = t.map(|i| to_world(g.positions[i as usize]));
                out.of_primitive.push(candidates.len() as u32);
                candidates.push(Candidate { corners, instance: instance as u32, primitive: primitive as u32, shape: NONE });
            }
            for (i, shape) in g.shapes.iter().enumerate() {
                let grid = shapes::grid(shape, shape_count > MANY_SHAPES);
                let extent = extent.transformed(placement.object_from_world);
                let triangles = shapes::triangles(shape, grid, extent);
                out.report.planes += u64::from(matches!(shape, crate::shape::Shape::Plane(_)));
                let first = candidates.len() as u32;
                let index = out.shapes.len() as u32;
                out.of_primitive.push(SHAPE_BIT | index);
                let primitive = (g.triangles.len() + i) as u32;
                for t in &triangles {
                    candidates.push(Candidate { corners: t.map(to_world), instance: instance as u32, primitive, shape: index });
                }
                let polygon = if grid.is_none() { triangles } else { Vec::new() };
                out.shapes.push(ShapePatch { instance: instance as u32, grid, extent, polygon, first });
            }
        }
        // Sides are decided in parallel; the order is that of the candidates.
        let decided: Vec<Decided> = candidates.par_iter().map(|c| decide(scene, &out, c)).collect();
        let dark = bodies::dark_insides(scene, &out, &candidates, &decided);
        out.sides = vec![[NONE; 2]; candidates.len()];
        for (i, (decided, c)) in decided.iter().zip(&candidates).enumerate() {
            match decided {
                Decided::ZeroArea => out.report.zero_area += u64::from(c.shape == NONE),
                Decided::NotFinite => out.report.not_finite += 1,
                Decided::TooFar => out.report.too_far += 1,
                Decided::Sides { sides, inexact } => {
                    if *inexact {
                        let g = &scene.geometries[scene.placements[c.instance as usize].geometry as usize];
                        let object = &g.objects[g.object_of_primitive[c.primitive as usize] as usize];
                        *out.report.not_diffuse.entry(object.name.clone()).or_default() += 1;
                    }
                    for face in sides.iter().flatten().filter(|face| !(face.is_back && dark[i])) {
                        out.sides[i][usize::from(face.is_back)] = out.faces.len() as u32;
                        out.faces.push(*face);
                    }
                }
            }
        }
        Ok(out)
    }

    /// The surface at a face's barycentric weights, as a ray that comes from the face's side would find it; on an analytic shape the
    /// point of it that is next to the triangle's.
    pub fn surface(&self, scene: &Scene, face: &Face, b: Vec3) -> Surface {
        surface(scene, face.shape, face.instance, face.primitive, &face.corners, face.is_turned, b)
    }

    /// The point of the real surface that a point of a face stands for.
    #[inline]
    pub fn on_surface(&self, scene: &Scene, face: &Face, p: Vec3) -> (Vec3, Vec3) {
        if face.shape == NONE {
            return (p, face.normal);
        }
        let (q, n) = on_shape(scene, face.instance, face.primitive, p);
        (q, if n.dot(face.normal) < 0.0 { -n } else { n })
    }

    /// Diffuse reflectance and emission of a face at barycentric weights.
    pub fn optics(&self, scene: &Scene, face: &Face, b: Vec3) -> SideOptics {
        let s = self.surface(scene, face, b);
        let wo = if s.ng.dot(face.normal) < 0.0 { -s.ng } else { s.ng };
        side_optics(scene, &s, wo)
    }

    /// The face that a surface point belongs to, on the side of its shading normal, with the barycentric weights there; `None` for
    /// what was left out.
    pub fn locate(&self, scene: &Scene, s: &Surface) -> Option<(u32, Vec3)> {
        let entry = *self.of_primitive.get((*self.first_primitive.get(s.instance as usize)? + s.primitive) as usize)?;
        let (side, b) = if entry & SHAPE_BIT == 0 {
            (entry, Vec3::new(1.0 - s.bary.x - s.bary.y, s.bary.x, s.bary.y))
        } else {
            let patch = &self.shapes[(entry & !SHAPE_BIT) as usize];
            let placement = &scene.placements[patch.instance as usize];
            let g = &scene.geometries[placement.geometry as usize];
            let shape = &g.shapes[s.primitive as usize - g.triangles.len()];
            let p = placement.object_from_world.map_or(s.p, |m| m.transform_point3(s.p));
            let uv = shape.surface(p).uv;
            let (i, b) = shapes::locate(shape, patch.grid, patch.extent, uv, p, &patch.polygon);
            (patch.first + i as u32, b)
        };
        let [front, back] = *self.sides.get(side as usize)?;
        // A triangle without a front has been left out.
        let is_back = self.faces.get(front as usize)?.normal.dot(s.frame.n) < 0.0;
        let face = if is_back { back } else { front };
        let b = if self.faces.get(face as usize)?.is_turned { Vec3::new(b.x, b.z, b.y) } else { b };
        Some((face, b))
    }

    /// Whether the other side of a face's triangle is a face as well.
    pub fn has_both_sides(&self, face: u32) -> bool {
        // A front and its back are neighbors.
        let face = face as usize;
        let is_twin = |other: &Face| {
            let f = &self.faces[face];
            other.is_back != f.is_back && other.corners[0] == f.corners[0] && other.corners[1] == f.corners[2]
        };
        let near = if self.faces[face].is_back { face.wrapping_sub(1) } else { face + 1 };
        self.faces.get(near).is_some_and(is_twin)
    }

    /// How an object's face is shaded at barycentric weights: the unit shading normal on the face's side.
    pub fn shading_normal(&self, scene: &Scene, face: &Face, b: Vec3) -> Vec3 {
        let n = self.surface(scene, face, b).frame.n;
        if n.dot(face.normal) < 0.0 { -n } else { n }
    }
}

/// Which sides of a triangle count.
pub(super) enum Decided {
    ZeroArea,
    NotFinite,
    TooFar,
    /// Front and back.
    Sides {
        sides: [Option<Face>; 2],
        inexact: bool,
    },
}

fn decide(scene: &Scene, faces: &Faces, c: &Candidate) -> Decided {
    if !c.corners.iter().all(|p| p.is_finite()) {
        return Decided::NotFinite;
    }
    if c.corners.iter().any(|p| p.abs().max_element() > MAX_COORDINATE) {
        return Decided::TooFar;
    }
    let area = area_of(&c.corners);
    let longest = (0..3).map(|i| (c.corners[i] - c.corners[(i + 1) % 3]).length()).fold(0.0, f32::max);
    // Less than rounding leaves of a triangle with such edges.
    if !(area > 1e-6 * longest * longest && area.is_finite() && area > f32::MIN_POSITIVE) {
        return Decided::ZeroArea;
    }
    let mut normal = (c.corners[1] - c.corners[0]).as_dvec3().cross((c.corners[2] - c.corners[0]).as_dvec3()).normalize().as_vec3();
    let third = Vec3::splat(1.0 / 3.0);
    let s = surface(scene, c.shape, c.instance, c.primitive, &c.corners, false, third);
    // The winding that the scene's normal belongs to may be the other one: `flip_normals`, or a shape that was cut.
    let is_front_turned = s.ng.dot(normal) < 0.0;
    if is_front_turned {
        normal = -normal;
    }
    let [c0, c1, c2] = c.corners;
    let side = |is_back: bool| {
        let is_turned = is_front_turned != is_back;
        let corners = if is_turned { [c0, c2, c1] } else { c.corners };
        let normal = if is_back { -normal } else { normal };
        Face { corners, normal, instance: c.instance, primitive: c.primitive, object: s.object, is_back, is_turned, shape: c.shape }
    };
    let (front, back) = (side(false), side(true));
    let mut optics = [SideOptics::default(); 2];
    for b in [third, Vec3::new(0.8, 0.1, 0.1), Vec3::new(0.1, 0.8, 0.1), Vec3::new(0.1, 0.1, 0.8)] {
        for (sum, face) in optics.iter_mut().zip([&front, &back]) {
            let o = faces.optics(scene, face, b);
            sum.reflectance += o.reflectance;
            sum.emission += o.emission;
            sum.inexact |= o.inexact;
        }
    }
    let counts = |o: &SideOptics| !o.reflectance.is_black() || !o.emission.is_black();
    let inexact = optics[0].inexact || optics[1].inexact;
    Decided::Sides { sides: [Some(front), counts(&optics[1]).then_some(back)], inexact }
}

fn surface(scene: &Scene, shape: u32, instance: u32, primitive: u32, corners: &[Vec3; 3], is_turned: bool, b: Vec3) -> Surface {
    if shape != NONE {
        let p = corners[0] * b.x + corners[1] * b.y + corners[2] * b.z;
        let (q, n) = on_shape(scene, instance, primitive, p);
        let hit = Hit { t: 0.0, u: 0.0, v: 0.0, prim: primitive, instance };
        return scene.surface(&Ray::new(q, -n), &hit);
    }
    // A turned face counts its corners 1 and 2 the other way round; see [`Faces::locate`].
    let (u, v) = if is_turned { (b.z, b.y) } else { (b.y, b.z) };
    let hit = Hit { t: 0.0, u, v, prim: primitive, instance };
    scene.surface(&Ray::new(Vec3::ZERO, Vec3::Z), &hit)
}

/// The point of a shape next to one of its triangles' and the normal there, in the world.
fn on_shape(scene: &Scene, instance: u32, primitive: u32, p: Vec3) -> (Vec3, Vec3) {
    let placement = &scene.placements[instance as usize];
    let g = &scene.geometries[placement.geometry as usize];
    let Some(shape) = g.shapes.get((primitive as usize).wrapping_sub(g.triangles.len())) else { return (p, Vec3::Z) };
    let local = placement.object_from_world.map_or(p, |m| m.transform_point3(p));
    let at = shape.surface(local);
    match placement.world_from_object {
        None => (at.p, at.ng),
        Some(m) => (m.transform_point3(at.p), (placement.normal_matrix * at.ng).normalize_or(Vec3::Z)),
    }
}

/// The extent of what has bounds.
fn bounded_extent(scene: &Scene) -> Extent {
    let mut bounds = crate::math::Aabb::EMPTY;
    for placement in &scene.placements {
        let g = &scene.geometries[placement.geometry as usize];
        let own = g.shapes.iter().map(|s| s.bounds()).filter(|b| b.min.is_finite() && b.max.is_finite());
        let points = g.positions.iter().copied().filter(|p| p.is_finite() && p.abs().max_element() < MAX_COORDINATE);
        let b = own.fold(crate::math::Aabb::from_points(points), crate::math::Aabb::union);
        bounds = bounds.union(placement.world_from_object.map_or(b, |m| b.transformed(m)));
    }
    for light in &scene.lights {
        if let crate::light::Light::Point(l) = light {
            bounds = bounds.grow(l.p);
        }
    }
    let (center, radius) = bounds.bounding_sphere();
    if radius.is_finite() && radius > 0.0 { Extent { center, radius } } else { Extent { center: Vec3::ZERO, radius: 10.0 } }
}

/// Mean optics of a part of a face: over `n`² strata of the triangle between three barycentric corners.
pub fn mean_optics(scene: &Scene, faces: &Faces, face: &Face, corners: &[Vec3; 3], n: u32) -> (Spectrum, Spectrum) {
    let (mut rho, mut emission) = (Spectrum::ZERO, Spectrum::ZERO);
    for i in 0..n {
        for j in 0..n {
            let u = Vec2::new((i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32);
            // By area: the square root spreads rows of a triangle evenly.
            let b = crate::math::warp::triangle(u);
            let at = corners[0] * (1.0 - b.x - b.y) + corners[1] * b.x + corners[2] * b.y;
            let o = faces.optics(scene, face, at);
            rho += o.reflectance;
            emission += o.emission;
        }
    }
    let count = (n * n) as f32;
    (rho / count, emission / count)
}
