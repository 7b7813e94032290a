//! Shapes, meshes, groups and instances.

use std::path::PathBuf;

use glam::{Mat4, Vec2, Vec3, Vec4};
use serde::{Deserialize, Serialize};

use super::{BsdfId, Color, GroupId, MediumId, MeshId, Scalar, ShapeId};

/// Values at vertices or faces of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshAttribute {
    /// Name without a `vertex_` or `face_` prefix, such as `color` or `uv1`.
    pub name: String,
    /// True where there is a value per triangle rather than per vertex.
    pub per_face: bool,
    /// Numbers per value: 1 to 4.
    pub width: u32,
    /// `width` numbers for each vertex or triangle.
    pub data: Vec<f32>,
}

/// Triangles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeshData {
    /// Vertex positions in object space.
    pub positions: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from the outside.
    pub triangles: Vec<[u32; 3]>,
    /// Vertex normals, unit; empty for none.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; empty for none.
    pub uvs: Vec<Vec2>,
    /// Vertex tangents as in glTF (w is the sign of the bitangent); empty for none.
    pub tangents: Vec<Vec4>,
    /// Further values.
    pub attributes: Vec<MeshAttribute>,
}

/// File formats of meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum MeshFormat {
    /// Wavefront OBJ.
    Obj,
    /// Stanford PLY, text or binary.
    Ply,
    /// Stereolithography, text or binary.
    Stl,
    /// Mitsuba's compressed meshes (`.serialized`).
    MitsubaSerialized,
}

/// A mesh: its data, or the file that holds them until [`crate::passes::load_meshes`] has run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshDesc {
    /// The file it comes from, with its format and the number of the mesh in it.
    pub file: Option<(PathBuf, MeshFormat, u32)>,
    /// Whether v counts from the top of the picture and is to be turned (`v → 1 − v`) when the file is loaded.
    pub flip_v: bool,
    /// The triangles; `None` until loaded.
    pub data: Option<MeshData>,
}

/// What a shape is made of, in object space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum GeometryDesc {
    /// Triangles.
    Mesh {
        /// The mesh.
        mesh: MeshId,
        /// Flat shading, even where the mesh has vertex normals. A mesh without normals is shaded flat unless
        /// `smooth` is set.
        face_normals: bool,
        /// Compute vertex normals where the mesh has none.
        smooth: bool,
    },
    /// A sphere; u runs about +z, v from +z (0) to −z (1).
    Sphere {
        /// Center.
        center: Vec3,
        /// Radius, positive.
        radius: f32,
    },
    /// The unit disk in the xy plane, normal +z; u is the radius, v the angle about +z over 2π.
    Disk,
    /// The square [−1, 1]² in the xy plane, normal +z; u and v run along x and y.
    Rectangle,
    /// The cube [−1, 1]³; each face has uv in [0, 1]².
    Cube,
    /// An open cylinder without caps, normal to the outside; u is the angle over 2π, v runs from `p0` to `p1`.
    Cylinder {
        /// Center of one end.
        p0: Vec3,
        /// Center of the other end.
        p1: Vec3,
        /// Radius, positive.
        radius: f32,
    },
    /// The infinite plane z = 0, normal +z; u and v are x and y.
    Plane,
    /// A polygon in the xy plane with holes by the even–odd rule, normal +z; u and v are x and y.
    Polygon {
        /// Closed contours (the last point joins the first).
        contours: Vec<Vec<Vec2>>,
    },
}

/// Light that a shape's surface emits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EmissionDesc {
    /// Emitted radiance.
    pub radiance: Color,
    /// Whether the side that the normal points away from emits too.
    pub two_sided: bool,
    /// Name of the light group; empty for none.
    pub group: String,
}

/// Vertices of a mesh that move along their normals, after its triangles were split until no edge is too long. The normals of what comes out are
/// smooth. A mesh without normals moves along smooth ones; one without texture coordinates cannot be displaced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DisplacementDesc {
    /// How far vertices move, in units of object space; negative values move them inwards.
    pub height: Scalar,
    /// What edges stay shorter than, in the space that `world_from_object` of the shape leads to; positive.
    pub edge_length: f32,
}

/// A shape of the world or of a group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShapeDesc {
    /// What it is made of.
    pub geometry: GeometryDesc,
    /// Places it in the world (or its group's space).
    pub world_from_object: Mat4,
    /// Turns the normals round.
    pub flip_normals: bool,
    /// How it scatters; `None` is Lambert with reflectance 0.5.
    pub bsdf: Option<BsdfId>,
    /// What it emits.
    pub emission: Option<EmissionDesc>,
    /// What is on the side that the normal points away from.
    pub interior: Option<MediumId>,
    /// What is on the other side.
    pub exterior: Option<MediumId>,
    /// How its vertices move, where it is a mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displacement: Option<DisplacementDesc>,
}

impl ShapeDesc {
    /// A shape without material, light or media, placed by a transform.
    pub fn new(geometry: GeometryDesc, world_from_object: Mat4) -> Self {
        Self {
            geometry,
            world_from_object,
            flip_normals: false,
            bsdf: None,
            emission: None,
            interior: None,
            exterior: None,
            displacement: None,
        }
    }
}

/// Shapes that are placed together. The shapes are in [`super::SceneDesc::shapes`] and belong to the world only through instances.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GroupDesc {
    /// The shapes.
    pub shapes: Vec<ShapeId>,
}

/// A placed group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InstanceDesc {
    /// The group.
    pub group: GroupId,
    /// Places the group's space in the world.
    pub world_from_object: Mat4,
}
