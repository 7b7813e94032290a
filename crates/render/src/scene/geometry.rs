//! Flat geometry: what one bottom-level hierarchy is built from, and the objects that its primitives belong to.

use crate::math::{Mat4, Vec2, Vec3, Vec4};
use crate::shape::Shape;

/// No light, no material slot, no data: an index that means "none".
pub const NONE: u32 = u32::MAX;

/// All triangles and analytic shapes of the world, or of one instanced group, in one space.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex indices into `positions`. Primitive ids count these first, then `shapes`.
    pub triangles: Vec<[u32; 3]>,
    /// Exact analytic shapes.
    pub shapes: Vec<Shape>,
    /// The object of each primitive: index into [`Geometry::objects`].
    pub object_of_primitive: Vec<u32>,
    /// What the primitives belong to.
    pub objects: Vec<Object>,
    /// Vertex normals of the objects that have them, unit.
    pub normals: Vec<Vec3>,
    /// Texture coordinates of the objects that have them.
    pub uvs: Vec<Vec2>,
    /// Tangents (w: sign of the bitangent) of the objects that have them.
    pub tangents: Vec<Vec4>,
    /// Values of the attributes of all objects.
    pub attribute_data: Vec<f32>,
}

/// One shape of the description: a range of primitives that share everything but their corners.
#[derive(Clone, Debug)]
pub struct Object {
    /// Name in the file.
    pub name: String,
    /// First primitive.
    pub first_primitive: u32,
    /// First vertex in [`Geometry::positions`].
    pub first_vertex: u32,
    /// Where the vertex normals start; [`NONE`] is flat shading.
    pub normals: u32,
    /// Where the texture coordinates start; [`NONE`] for barycentrics.
    pub uvs: u32,
    /// Where the tangents start; [`NONE`] for tangents from the texture coordinates.
    pub tangents: u32,
    /// Attributes: (interned name, start in [`Geometry::attribute_data`], numbers per value, per face).
    pub attributes: Vec<Attribute>,
    /// Index into the scene's materials.
    pub material: u32,
    /// Light of the first primitive, the next primitives' follow; [`NONE`] for objects that do not emit.
    pub first_light: u32,
    /// Emission, where the object emits.
    pub emission: Option<Emission>,
    /// Medium on the side that the normal points away from; [`NONE`] for vacuum.
    pub interior: u32,
    /// Medium on the other side, where the file says so; [`NONE`] otherwise.
    pub exterior: u32,
    /// Number of the object in the whole scene, for the id AOV; from 1.
    pub id: u32,
    /// Geometric and shading normals point the other way round.
    pub flip_normals: bool,
    /// Whether the material looks at tangents.
    pub wants_tangents: bool,
}

/// An attribute of an object.
#[derive(Clone, Copy, Debug)]
pub struct Attribute {
    /// Interned name.
    pub name: u32,
    /// Start in [`Geometry::attribute_data`].
    pub start: u32,
    /// Numbers per value.
    pub width: u32,
    /// One value per triangle rather than per vertex.
    pub per_face: bool,
}

/// What an object emits.
#[derive(Clone, Copy, Debug)]
pub struct Emission {
    /// Radiance.
    pub radiance: etendue_scene::desc::Color,
    /// Whether the back emits too.
    pub two_sided: bool,
    /// Light group.
    pub group: u32,
}

/// A placed geometry.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Index into the scene's geometries.
    pub geometry: u32,
    /// Places the geometry's space in the world; `None` is the identity.
    pub world_from_object: Option<Mat4>,
    /// The inverse; `None` is the identity.
    pub object_from_world: Option<Mat4>,
    /// The inverse's upper 3×3, transposed: for normals.
    pub normal_matrix: glam::Mat3,
    /// The transform mirrors.
    pub mirrors: bool,
}

impl Placement {
    /// A geometry placed by a transform.
    pub fn new(geometry: u32, world_from_object: Mat4) -> Self {
        let m = glam::Mat3::from_mat4(world_from_object);
        let identity = world_from_object == Mat4::IDENTITY;
        Self {
            geometry,
            world_from_object: (!identity).then_some(world_from_object),
            object_from_world: (!identity).then(|| world_from_object.inverse()),
            normal_matrix: m.inverse().transpose(),
            mirrors: m.determinant() < 0.0,
        }
    }
}
