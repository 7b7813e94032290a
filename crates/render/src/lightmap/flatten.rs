//! The scene as baking sees it: triangles in world space, one object for each placed shape, without what is broken.

use std::collections::HashSet;

use etendue_scene::SceneDesc;
use etendue_scene::desc::{AddNode, BsdfDesc, BsdfId, GeometryDesc, MeshData, MeshDesc, Node, Param, Scalar, ShapeDesc, ShapeId};
use etendue_scene::formats::tessellate::tessellate;

use super::BakeError;
use super::topology::Topology;
use crate::math::{Aabb, Mat3, Mat4, Vec2, Vec3};
use crate::scene::displace;

/// Most triangles of the flat scene: instances count as often as they stand in it.
const TRIANGLE_LIMIT: usize = 1 << 24;
/// Coordinates beyond this are taken for a fault: their squares would not fit into single precision.
const COORDINATE_LIMIT: f32 = 1e15;
/// How deep models in models are followed.
const DEPTH_LIMIT: u32 = 32;
/// Beyond so many objects it is not looked for those that stand inside of others.
const ENCLOSING_LIMIT: usize = 4096;

/// Which sides of two-sided surfaces are baked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sides {
    /// Both sides of surfaces that scatter on both, unless the back is the inside of a closed body in which nothing stands.
    #[default]
    Auto,
    /// The side of the normals alone.
    Front,
    /// Both sides of all surfaces that scatter on both.
    Both,
}

/// The flat scene.
#[derive(Debug)]
pub struct Flat {
    /// All shapes are meshes in world space with an identity transform; no groups, no instances.
    pub desc: SceneDesc,
    /// What is known of each shape of [`Flat::desc`].
    pub shapes: Vec<FlatShape>,
    /// Sentences about what was repaired or left out.
    pub notes: Vec<String>,
}

/// What is known of a flat shape.
#[derive(Clone, Debug)]
pub struct FlatShape {
    /// Neighbors of its triangles.
    pub topology: Topology,
    /// Sides that get light: of the front, of the back.
    pub bake: [bool; 2],
    /// A closed body with its normals to the outside: what is in it is never seen.
    pub solid: bool,
}

impl Flat {
    /// The triangles of a shape.
    pub fn mesh(&self, shape: usize) -> &MeshData {
        // `flatten` makes nothing but loaded meshes; an empty one stands for the impossible rest.
        static EMPTY: MeshData = MeshData {
            positions: Vec::new(),
            triangles: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            tangents: Vec::new(),
            attributes: Vec::new(),
        };
        match self.desc.shapes.get(shape).map(|s| &s.value.geometry) {
            Some(GeometryDesc::Mesh { mesh, .. }) => self.desc[*mesh].value.data.as_ref().unwrap_or(&EMPTY),
            _ => &EMPTY,
        }
    }
}

/// Counts of what was wrong.
#[derive(Default)]
struct Faults {
    positions: usize,
    degenerate: usize,
    duplicate: usize,
    normals: usize,
    polygons: usize,
    empty: usize,
}

/// Flattens a scene. Meshes must be loaded.
///
/// # Errors
/// [`BakeError::Scene`] where nothing is left to bake, where the scene is too large or of the classic model; [`BakeError::Faults`] where its meshes
/// cannot be displaced.
pub fn flatten(desc: &SceneDesc, sides: Sides) -> Result<Flat, BakeError> {
    if desc.classic.is_some() {
        return Err(BakeError::Scene("POV-Ray scenes cannot be baked yet: their solids have no triangles".into()));
    }
    let displaced = displace(desc).map_err(BakeError::Faults)?;
    let mut flat = desc.clone_without_shapes();
    let mut faults = Faults::default();
    let mut budget = TRIANGLE_LIMIT;
    for (id, world) in placed(desc) {
        let node = &desc[id];
        let owned;
        let data = match &node.value.geometry {
            GeometryDesc::Mesh { mesh, .. } => displaced.meshes.get(&id).or(desc[*mesh].value.data.as_ref()),
            other => {
                owned = tessellate(other);
                faults.polygons += usize::from(owned.is_none());
                owned.as_ref()
            }
        };
        let Some(data) = data else { continue };
        budget = budget.checked_sub(data.triangles.len()).ok_or_else(|| {
            BakeError::Scene(format!("more than {TRIANGLE_LIMIT} triangles when all instances are placed: too many to bake at once"))
        })?;
        let (mesh, bad) = to_world(data, &node.value, world);
        faults.add(&bad);
        if mesh.triangles.is_empty() {
            faults.empty += 1;
            continue;
        }
        let mesh = flat.add(Node::named(node.name.clone(), node.span, MeshDesc { file: None, flip_v: false, data: Some(mesh) }));
        let geometry = GeometryDesc::Mesh { mesh, face_normals: false, smooth: false };
        let shape =
            ShapeDesc { geometry, world_from_object: Mat4::IDENTITY, flip_normals: false, displacement: None, ..node.value.clone() };
        flat.add(Node::named(node.name.clone(), node.span, shape));
    }
    if flat.shapes.is_empty() {
        return Err(BakeError::Scene("there is nothing to bake: the scene has no triangle of any area".into()));
    }
    let notes = displaced.warnings.into_iter().chain(faults.sentences()).collect();
    let mut flat = Flat { desc: flat, shapes: Vec::new(), notes };
    inspect(&mut flat, sides);
    if !flat.shapes.iter().any(|s| s.bake != [false; 2]) {
        return Err(BakeError::Scene("there is nothing to bake: all surfaces are lights, glass or invisible".into()));
    }
    Ok(flat)
}

/// All shapes of the world and of instances with their transforms.
fn placed(desc: &SceneDesc) -> Vec<(ShapeId, Mat4)> {
    let in_group: HashSet<ShapeId> = desc.groups.iter().flat_map(|g| g.value.shapes.iter().copied()).collect();
    let world = (0..desc.shapes.len() as u32).map(ShapeId).filter(|s| !in_group.contains(s));
    let mut all: Vec<_> = world.map(|s| (s, desc[s].value.world_from_object)).collect();
    for instance in &desc.instances {
        let place = instance.value.world_from_object;
        all.extend(desc[instance.value.group].value.shapes.iter().map(|s| (*s, place * desc[*s].value.world_from_object)));
    }
    all
}

trait WithoutShapes {
    fn clone_without_shapes(&self) -> SceneDesc;
}

impl WithoutShapes for SceneDesc {
    /// Everything but geometry, which may be large.
    fn clone_without_shapes(&self) -> SceneDesc {
        SceneDesc {
            format: self.format.clone(),
            files: self.files.clone(),
            images: self.images.clone(),
            textures: self.textures.clone(),
            bsdfs: self.bsdfs.clone(),
            media: self.media.clone(),
            lights: self.lights.clone(),
            cameras: self.cameras.clone(),
            film: self.film.clone(),
            integrator: self.integrator.clone(),
            ..SceneDesc::default()
        }
    }
}

/// A mesh in world space, its normals to the outside of its winding, without triangles that have no area.
fn to_world(data: &MeshData, shape: &ShapeDesc, world: Mat4) -> (MeshData, Faults) {
    let mut faults = Faults::default();
    let m3 = Mat3::from_mat4(world);
    let mut out = data.clone();
    for p in &mut out.positions {
        *p = world.transform_point3(*p);
    }
    let is_good = |p: &Vec3| p.is_finite() && p.abs().max_element() <= COORDINATE_LIMIT;
    let (face_normals, smooth) = match shape.geometry {
        _ if shape.displacement.is_some() => (false, false),
        GeometryDesc::Mesh { face_normals, smooth, .. } => (face_normals, smooth),
        _ => (false, false),
    };
    if face_normals {
        out.normals.clear();
    }
    if smooth && !face_normals && out.normals.is_empty() {
        out.normals = crate::scene::vertex_normals(data);
    }
    let normal_matrix = m3.inverse().transpose();
    let turn = (m3.determinant() < 0.0) != shape.flip_normals;
    let normal_sign = if shape.flip_normals { -1.0 } else { 1.0 };
    for n in &mut out.normals {
        *n = (normal_matrix * *n).normalize_or_zero() * normal_sign;
    }
    let tangent_sign = if m3.determinant() < 0.0 { -1.0 } else { 1.0 };
    for t in &mut out.tangents {
        *t = (m3 * t.truncate()).normalize_or_zero().extend(t.w * tangent_sign);
    }
    if turn {
        out.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    for uv in &mut out.uvs {
        if !uv.is_finite() {
            *uv = Vec2::ZERO;
        }
    }
    for a in &mut out.attributes {
        a.data.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
    }
    // The values of faces go with their triangles.
    let mut keep = Vec::with_capacity(out.triangles.len());
    let mut seen = HashSet::new();
    for t in &out.triangles {
        let [a, b, c] = t.map(|i| out.positions.get(i as usize).copied().unwrap_or(Vec3::NAN));
        let fault = if ![a, b, c].iter().all(is_good) {
            Some(&mut faults.positions)
        } else if !(area2(a, b, c) > 0.0) {
            Some(&mut faults.degenerate)
        } else {
            // The same triangle twice would be baked twice, and the two would fight for each pixel.
            (!seen.insert(canonical([a, b, c]))).then_some(&mut faults.duplicate)
        };
        keep.push(fault.map(|f| *f += 1).is_none());
    }
    let retain = |width: usize, data: &mut Vec<f32>| {
        let mut i = 0;
        data.retain(|_| {
            i += 1;
            keep.get((i - 1) / width.max(1)).copied().unwrap_or(false)
        });
    };
    for a in out.attributes.iter_mut().filter(|a| a.per_face) {
        retain(a.width as usize, &mut a.data);
    }
    let mut i = 0;
    out.triangles.retain(|_| {
        i += 1;
        keep[i - 1]
    });
    faults.normals += repair_normals(&mut out);
    // No triangle has them any more.
    out.positions.iter_mut().filter(|p| !is_good(p)).for_each(|p| *p = Vec3::ZERO);
    (out, faults)
}

/// Twice the area of a triangle, in double precision; not a number for one that has none.
fn area2(a: Vec3, b: Vec3, c: Vec3) -> f64 {
    (b.as_dvec3() - a.as_dvec3()).cross(c.as_dvec3() - a.as_dvec3()).length()
}

/// A triangle's corners from the smallest on: equal for equal triangles of the same winding.
fn canonical(corners: [Vec3; 3]) -> [[u32; 3]; 3] {
    let bits = corners.map(|p| p.to_array().map(|v| (v + 0.0).to_bits()));
    let first = (0..3).min_by_key(|&i| bits[i]).unwrap_or(0);
    std::array::from_fn(|i| bits[(first + i) % 3])
}

/// Gives corners without a usable normal that of a triangle; returns how many.
fn repair_normals(mesh: &mut MeshData) -> usize {
    if mesh.normals.is_empty() {
        return 0;
    }
    mesh.normals.resize(mesh.positions.len(), Vec3::ZERO);
    let mut repaired = 0;
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
        let ng = (b - a).cross(c - a).normalize_or(glam::DVec3::Z).as_vec3();
        for &i in t {
            let n = &mut mesh.normals[i as usize];
            if !(n.length_squared() > 0.5) {
                *n = ng;
                repaired += 1;
            }
        }
    }
    repaired
}

impl Faults {
    fn add(&mut self, o: &Self) {
        self.positions += o.positions;
        self.degenerate += o.degenerate;
        self.duplicate += o.duplicate;
        self.normals += o.normals;
    }

    fn sentences(&self) -> Vec<String> {
        let all = [
            (self.positions, "triangles with coordinates that are not finite or beyond 1e15 are left out"),
            (self.degenerate, "triangles without area are left out"),
            (self.duplicate, "triangles that lie twice in the same place are left out once"),
            (self.normals, "vertices without a usable normal take that of a triangle"),
            (self.polygons, "polygons with holes are left out: they have no triangles yet"),
            (self.empty, "meshes have no triangle left"),
        ];
        all.iter().filter(|(n, _)| *n > 0).map(|(n, text)| format!("{n} {text}")).collect()
    }
}

/// Finds out which sides to bake.
fn inspect(flat: &mut Flat, sides: Sides) {
    let bounds: Vec<Aabb> = (0..flat.desc.shapes.len()).map(|i| bounds_of(flat.mesh(i))).collect();
    let eyes: Vec<Vec3> = flat.desc.cameras.iter().map(|c| c.value.world_from_camera.w_axis.truncate()).collect();
    for i in 0..flat.desc.shapes.len() {
        let topology = Topology::new(flat.mesh(i));
        let inside = |p: Vec3| p.cmpgt(bounds[i].min).all() && p.cmplt(bounds[i].max).all();
        let encloses = eyes.iter().any(|p| inside(*p))
            || bounds.len() <= ENCLOSING_LIMIT && bounds.iter().enumerate().any(|(k, b)| k != i && inside(b.min) && inside(b.max));
        let solid = topology.is_closed() && volume(flat.mesh(i)) > 0.0 && !encloses;
        let shape = &flat.desc.shapes[i].value;
        let front = !emits(shape) && shape.bsdf.is_none_or(|b| shows_light(&flat.desc, b, 0));
        let both = front && shape.bsdf.is_some_and(|b| scatters_behind(&flat.desc, b, 0));
        let back = match sides {
            Sides::Front => false,
            Sides::Both => both,
            Sides::Auto => both && !solid,
        };
        flat.shapes.push(FlatShape { topology, bake: [front, back], solid });
    }
}

fn bounds_of(mesh: &MeshData) -> Aabb {
    Aabb::from_points(mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]))
}

/// Signed volume by the divergence theorem, relative to the first vertex.
fn volume(mesh: &MeshData) -> f64 {
    let at = |i: u32| mesh.positions[i as usize].as_dvec3();
    let Some(o) = mesh.triangles.first().map(|t| at(t[0])) else { return 0.0 };
    mesh.triangles.iter().map(|t| (at(t[0]) - o).dot((at(t[1]) - o).cross(at(t[2]) - o)) / 6.0).sum()
}

/// Whether a shape shines.
pub(super) fn emits(shape: &ShapeDesc) -> bool {
    shape.emission.as_ref().is_some_and(|e| match e.radiance {
        Param::Constant(c) => c.iter().any(|v| *v > 0.0),
        Param::Texture(_) => true,
    })
}

/// Whether a surface keeps light that a lightmap can show: neither glass nor nothing.
fn shows_light(desc: &SceneDesc, id: BsdfId, depth: u32) -> bool {
    let clear = |s: &Scalar| matches!(s, Param::Constant(v) if *v >= 0.5);
    match &desc[id].value {
        _ if depth > DEPTH_LIMIT => false,
        BsdfDesc::Null | BsdfDesc::Dielectric { .. } | BsdfDesc::ThinDielectric { .. } => false,
        BsdfDesc::Pbr(p) => !clear(&p.transmission),
        BsdfDesc::Principled(p) => !clear(&p.spec_trans),
        BsdfDesc::Mask { nested, opacity } => *opacity != Param::Constant(0.0) && shows_light(desc, *nested, depth + 1),
        BsdfDesc::BumpMap { nested, .. } | BsdfDesc::NormalMap { nested, .. } => shows_light(desc, *nested, depth + 1),
        BsdfDesc::Blend { first, second, .. } => shows_light(desc, *first, depth + 1) || shows_light(desc, *second, depth + 1),
        BsdfDesc::TwoSided { front, back } => shows_light(desc, *front, depth + 1) || shows_light(desc, *back, depth + 1),
        _ => true,
    }
}

/// Whether light that falls on the back is scattered there.
fn scatters_behind(desc: &SceneDesc, id: BsdfId, depth: u32) -> bool {
    match &desc[id].value {
        _ if depth > DEPTH_LIMIT => false,
        BsdfDesc::TwoSided { .. } | BsdfDesc::DiffuseTransmission { .. } => true,
        BsdfDesc::Principled(p) => p.thin,
        BsdfDesc::Mask { nested, .. } | BsdfDesc::BumpMap { nested, .. } | BsdfDesc::NormalMap { nested, .. } => {
            scatters_behind(desc, *nested, depth + 1)
        }
        BsdfDesc::Blend { first, second, .. } => scatters_behind(desc, *first, depth + 1) || scatters_behind(desc, *second, depth + 1),
        _ => false,
    }
}
