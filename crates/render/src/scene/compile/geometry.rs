//! From the description's shapes to flat geometry.

use std::collections::HashMap;

use etendue_scene::desc::{GeometryDesc, MeshData, Node, SceneDesc, ShapeDesc, ShapeId};
use glam::{Mat3, Mat4, Vec2, Vec3};

use crate::material::Material;
use crate::scene::Names;
use crate::scene::geometry::{Attribute, Emission, Geometry, NONE, Object};
use crate::shape::Shape;

/// What objects refer to.
pub(super) struct Context<'a> {
    pub desc: &'a SceneDesc,
    /// The meshes of displaced shapes.
    pub displaced: &'a HashMap<ShapeId, MeshData>,
    pub materials: &'a [Material],
    pub attributes: &'a mut Names,
    pub groups: &'a mut Names,
    /// Whether each named emitting shape is a light group of its own.
    pub light_groups: bool,
    /// Whether every object needs ∂p/∂uv.
    pub tangents: bool,
    /// Number of objects so far in the whole scene.
    pub object_count: u32,
}

/// A shape with the transform that brings it into its geometry's space.
pub(super) struct Placed {
    pub shape: ShapeId,
    pub geometry_from_object: Mat4,
}

/// Builds the geometry of some shapes. Shapes that are no surface (zero radius, singular transform) are left out; validation has
/// warned of them.
pub(super) fn build(shapes: &[Placed], ctx: &mut Context) -> Geometry {
    let mut g = Geometry::default();
    let mut analytic = Vec::new();
    for placed in shapes {
        let node = &ctx.desc[placed.shape];
        let shape = &node.value;
        let cube;
        let mesh = match &shape.geometry {
            GeometryDesc::Mesh { mesh, .. } => ctx.displaced.get(&placed.shape).or(ctx.desc[*mesh].value.data.as_ref()),
            GeometryDesc::Cube => {
                cube = cube_mesh();
                Some(&cube)
            }
            _ => {
                if let Some(s) = Shape::from_desc(&shape.geometry, placed.geometry_from_object, shape.flip_normals) {
                    analytic.push((s, object(node, ctx)));
                }
                continue;
            }
        };
        let Some(mesh) = mesh.filter(|m| !m.triangles.is_empty()) else { continue };
        let mut object = object(node, ctx);
        add_mesh(&mut g, mesh, shape, placed.geometry_from_object, &mut object, ctx);
        g.object_of_primitive.resize(g.triangles.len(), g.objects.len() as u32);
        g.objects.push(object);
    }
    for (shape, mut object) in analytic {
        object.first_primitive = (g.triangles.len() + g.shapes.len()) as u32;
        g.object_of_primitive.push(g.objects.len() as u32);
        g.shapes.push(shape);
        g.objects.push(object);
    }
    g
}

fn object(node: &Node<ShapeDesc>, ctx: &mut Context) -> Object {
    let shape = &node.value;
    let material = shape.bsdf.map_or(ctx.materials.len() as u32 - 1, |b| b.0);
    ctx.object_count += 1;
    Object {
        name: node.name.clone(),
        first_primitive: 0,
        first_vertex: 0,
        normals: NONE,
        uvs: NONE,
        tangents: NONE,
        attributes: Vec::new(),
        material,
        first_light: NONE,
        emission: shape.emission.as_ref().map(|e| Emission {
            radiance: e.radiance,
            two_sided: e.two_sided,
            group: ctx.groups.intern(if ctx.light_groups && e.group.is_empty() { &node.name } else { &e.group }),
        }),
        interior: shape.interior.map_or(NONE, |m| m.0),
        exterior: shape.exterior.map_or(NONE, |m| m.0),
        id: ctx.object_count,
        flip_normals: shape.flip_normals,
        wants_tangents: ctx.tangents || ctx.materials[material as usize].wants_tangents,
    }
}

fn add_mesh(g: &mut Geometry, mesh: &MeshData, shape: &ShapeDesc, m: Mat4, object: &mut Object, ctx: &mut Context) {
    object.first_primitive = g.triangles.len() as u32;
    object.first_vertex = g.positions.len() as u32;
    let base = object.first_vertex;
    let m3 = Mat3::from_mat4(m);
    let mirrors = m3.determinant() < 0.0;
    g.positions.extend(mesh.positions.iter().map(|p| m.transform_point3(*p)));
    // Keep the geometric normal on the outside under mirrors: turn the winding with them.
    g.triangles.extend(
        mesh.triangles.iter().map(|&[a, b, c]| if mirrors { [a + base, c + base, b + base] } else { [a + base, b + base, c + base] }),
    );
    let (face_normals, smooth) = match shape.geometry {
        _ if shape.displacement.is_some() => (false, false),
        GeometryDesc::Mesh { face_normals, smooth, .. } => (face_normals, smooth),
        _ => (true, false),
    };
    if !face_normals {
        let normal_matrix = m3.inverse().transpose();
        let computed;
        let normals = if mesh.normals.is_empty() && smooth {
            computed = vertex_normals(mesh);
            &computed
        } else {
            &mesh.normals
        };
        if !normals.is_empty() {
            object.normals = g.normals.len() as u32;
            g.normals.extend(normals.iter().map(|n| (normal_matrix * *n).normalize_or(Vec3::ZERO)));
        }
    }
    if !mesh.uvs.is_empty() {
        object.uvs = g.uvs.len() as u32;
        g.uvs.extend_from_slice(&mesh.uvs);
    }
    if !mesh.tangents.is_empty() && object.wants_tangents {
        object.tangents = g.tangents.len() as u32;
        let sign = if mirrors { -1.0 } else { 1.0 };
        g.tangents.extend(mesh.tangents.iter().map(|t| (m3 * t.truncate()).normalize_or(Vec3::ZERO).extend(t.w * sign)));
    }
    for a in &mesh.attributes {
        let start = g.attribute_data.len() as u32;
        object.attributes.push(Attribute { name: ctx.attributes.intern(&a.name), start, width: a.width, per_face: a.per_face });
        g.attribute_data.extend_from_slice(&a.data);
    }
}

/// Vertex normals as angle-weighted means of face normals (Thürmer and Wüthrich 1998, doi:10.1080/10867651.1998.10487487).
pub(crate) fn vertex_normals(mesh: &MeshData) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; mesh.positions.len()];
    for tri in &mesh.triangles {
        let p = tri.map(|i| mesh.positions[i as usize]);
        let Some(n) = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize() else { continue };
        for k in 0..3 {
            let (a, b) = ((p[(k + 1) % 3] - p[k]).normalize_or_zero(), (p[(k + 2) % 3] - p[k]).normalize_or_zero());
            normals[tri[k] as usize] += n * crate::math::fns::acos(a.dot(b));
        }
    }
    for n in &mut normals {
        *n = n.normalize_or_zero();
    }
    normals
}

/// The cube [−1, 1]³ with four vertices a face and uv in [0, 1]² on each.
fn cube_mesh() -> MeshData {
    let mut mesh = MeshData::default();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut n = Vec3::ZERO;
            n[axis] = sign;
            let u = Vec3::from_array(std::array::from_fn(|i| if i == (axis + 1) % 3 { 1.0 } else { 0.0 })) * sign;
            let v = n.cross(u);
            let base = mesh.positions.len() as u32;
            for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                mesh.positions.push(n + u * a + v * b);
                mesh.uvs.push(Vec2::new(a, b) * 0.5 + 0.5);
            }
            mesh.triangles.push([base, base + 1, base + 2]);
            mesh.triangles.push([base, base + 2, base + 3]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cube_is_closed_and_faces_outwards() {
        let cube = cube_mesh();
        assert_eq!((cube.triangles.len(), cube.positions.len()), (12, 24));
        let mut volume = 0.0;
        for t in &cube.triangles {
            let [a, b, c] = t.map(|i| cube.positions[i as usize]);
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0);
            volume += a.dot(b.cross(c)) / 6.0;
        }
        assert!((volume - 8.0f32).abs() < 1e-5);
    }

    #[test]
    fn vertex_normals_of_a_cube_with_shared_corners_point_along_the_diagonals() {
        let cube = cube_mesh();
        // Join equal corners.
        let corner = |p: Vec3| (u32::from(p.x > 0.0)) | (u32::from(p.y > 0.0) << 1) | (u32::from(p.z > 0.0) << 2);
        let mesh = MeshData {
            positions: (0..8).map(|i| Vec3::new(i as f32 % 2.0, (i / 2) as f32 % 2.0, (i / 4) as f32) * 2.0 - 1.0).collect(),
            triangles: cube.triangles.iter().map(|t| t.map(|i| corner(cube.positions[i as usize]))).collect(),
            ..MeshData::default()
        };
        for (n, p) in vertex_normals(&mesh).iter().zip(&mesh.positions) {
            assert!((*n - p.normalize()).length() < 1e-5, "{n} at {p}");
        }
    }
}
