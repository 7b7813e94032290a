//! Shapes made of much data: meshes, blobs, height fields, letters, fractals.

use std::sync::Arc;

use etendue_procedural::{ImageId, Texture};
use glam::{DMat4, DVec2, DVec3, DVec4};
use serde::{Deserialize, Serialize};

/// `mesh` and `mesh2`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// Vertices.
    pub vertices: Vec<DVec3>,
    /// Normals, of any length.
    pub normals: Vec<DVec3>,
    /// Surface coordinates.
    pub uvs: Vec<DVec2>,
    /// Textures, in the mesh's own space.
    pub textures: Vec<Arc<Texture>>,
    /// Indices of vertices of the triangles; all within bounds.
    pub faces: Vec<[u32; 3]>,
    /// Indices of normals of the first triangles, no more than there are faces; [`Mesh::NONE`] and missing ones are flat.
    pub normal_faces: Vec<[u32; 3]>,
    /// Indices of surface coordinates, like `normal_faces`.
    pub uv_faces: Vec<[u32; 3]>,
    /// Textures of the corners, blended between; [`Mesh::NONE`] and missing ones have the object's texture.
    pub texture_faces: Vec<[u32; 3]>,
    /// Direction in which crossings are counted to tell the inside; `None`: there is no inside.
    pub inside_vector: Option<DVec3>,
}

impl Mesh {
    /// The index of a triangle that has no normals, coordinates or textures of its own.
    pub const NONE: [u32; 3] = [u32::MAX; 3];
}

/// `blob`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Blob {
    /// Field strength at the surface.
    pub threshold: f64,
    /// Components.
    pub components: Vec<BlobComponent>,
}

/// Part of a blob.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlobComponent {
    /// One center, or the two ends of a cylinder with rounded ends.
    pub kind: BlobKind,
    /// Radius where the field ends.
    pub radius: f64,
    /// Field strength at the center.
    pub strength: f64,
    /// Places the component.
    pub blob_from_component: DMat4,
    /// Its own texture, in the blob's space.
    pub texture: Option<Arc<Texture>>,
}

/// Shapes of blob components.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum BlobKind {
    /// Around a point.
    Sphere(DVec3),
    /// Around a line.
    Cylinder(DVec3, DVec3),
}

/// `height_field`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeightField {
    /// Heights.
    pub source: HeightSource,
    /// Interpolated normals.
    pub smooth: bool,
    /// Lower parts are left out.
    pub water_level: f64,
}

/// Where heights come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum HeightSource {
    /// Pixels of a picture with values as stored (gamma 1): the palette index / 255 where there is one, else
    /// (256 · red + green) / 257, which is red itself for gray pictures. Column → x, row → z from 1 (top) to 0.
    Image(ImageId),
    /// Pixels of a picture whose left half holds the upper bytes of the heights as palette indices, and the right half the lower ones
    /// (Fractint's 16-bit potentials, `pot`).
    Potential(ImageId),
    /// Sampled values in [0, 1], row by row, laid out like the pixels of a picture.
    Values {
        /// Number of columns (x).
        width: u32,
        /// Number of rows (z).
        height: u32,
        /// width · height numbers.
        values: Vec<f64>,
    },
}

/// `text`: outlines of letters, extruded along z.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TextShape {
    /// Distance from front (z = 0) to back.
    pub thickness: f64,
    /// Outlines of the different letters.
    pub outlines: Vec<Outline>,
    /// Letters in order: outline and place of its origin.
    pub glyphs: Vec<(u32, DVec3)>,
}

/// The outline of a letter in units of the em square.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outline {
    /// Closed contours; holes where contours wind the other way.
    pub contours: Vec<Vec<OutlineSegment>>,
}

/// A piece of an outline.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum OutlineSegment {
    /// Straight line.
    Line([DVec2; 2]),
    /// Quadratic Bézier curve.
    Quadratic([DVec2; 3]),
}

/// `julia_fractal`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JuliaFractal {
    /// Added in each iteration.
    pub parameter: DVec4,
    /// Hypercomplex algebra; quaternions otherwise.
    pub hypercomplex: bool,
    /// Iterated function.
    pub function: JuliaFunction,
    /// Iterations after which a point is inside.
    pub max_iteration: u32,
    /// Accuracy, at least 1.
    pub precision: f64,
    /// Normal of the slice; its fourth component is not 0.
    pub slice: DVec4,
    /// Distance of the slice from the origin.
    pub distance: f64,
}

/// Functions that Julia sets iterate; all but the first two are hypercomplex only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "their names are the functions'")]
pub enum JuliaFunction {
    #[default]
    Sqr,
    Cube,
    Exp,
    Reciprocal,
    Sin,
    Asin,
    Sinh,
    Asinh,
    Cos,
    Acos,
    Cosh,
    Acosh,
    Tan,
    Atan,
    Tanh,
    Atanh,
    Ln,
    /// To the power x + iy.
    Pwr(f64, f64),
}
