//! Images and textures, and parameters that may be textured.

use std::path::PathBuf;

use etendue_procedural::SolidPattern;
use glam::{Mat3, Mat4, Vec3};
use serde::{Deserialize, Serialize};

use super::{ImageId, TextureId};

/// A parameter that is a constant or varies over a surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Param<T> {
    /// The same everywhere.
    Constant(T),
    /// A texture; a scalar parameter takes the texture's scalar value (see [`TextureDesc`]).
    Texture(TextureId),
}

/// A color: linear Rec. 709, usually in [0, 1] for reflectance.
pub type Color = Param<[f32; 3]>;
/// A number.
pub type Scalar = Param<f32>;

impl Color {
    /// The same value in each channel.
    pub const fn gray(v: f32) -> Self {
        Self::Constant([v; 3])
    }
}

/// Where a picture's bytes are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ImageSource {
    /// A file, already checked to be inside the folders that the scene may read.
    File(PathBuf),
    /// An encoded picture (PNG, JPEG, …) that the scene file holds.
    Embedded(Vec<u8>),
    /// Decoded values, row by row from the top, `channels` to a pixel; the encoding is linear.
    Pixels {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Values per pixel: 1, 2, 3 or 4.
        channels: u32,
        /// `width * height * channels` values.
        data: Vec<f32>,
    },
}

/// How stored numbers become linear values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Encoding {
    /// sRGB for pictures of 8 or 16 bits an integer channel, linear for floats.
    #[default]
    Auto,
    /// The numbers are linear values.
    Linear,
    /// The sRGB transfer function (alpha stays linear).
    Srgb,
}

/// A picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageDesc {
    /// Where its bytes are.
    pub source: ImageSource,
}

/// What happens beyond the edge of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Wrap {
    /// The picture repeats.
    #[default]
    Repeat,
    /// Every other copy is mirrored.
    Mirror,
    /// The edge goes on.
    Clamp,
    /// Black and transparent.
    Black,
}

/// How a picture is looked up between pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum TextureFilter {
    /// The nearest pixel.
    Nearest,
    /// Linear between four pixels of the full picture.
    #[default]
    Bilinear,
    /// Linear between four pixels of the levels that fit the ray's footprint.
    Trilinear,
}

/// Which of a picture's channels a scalar lookup takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Channel {
    /// The luminance of a color picture, the only channel of a gray one.
    #[default]
    Luminance,
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
    /// Alpha; 1 where there is none.
    A,
}

/// A picture mapped over texture coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BitmapDesc {
    /// The picture; its first row is at v = 1 (as if (0, 0) were its lower left corner).
    pub image: ImageId,
    /// How its numbers become linear values.
    pub encoding: Encoding,
    /// Beyond the edge in u and v.
    pub wrap: [Wrap; 2],
    /// Between pixels.
    pub filter: TextureFilter,
    /// `picture_from_uv`: applied to (u, v, 1) before the lookup.
    pub picture_from_uv: Mat3,
    /// What a scalar parameter takes.
    pub channel: Channel,
    /// Set of texture coordinates: 0 is the mesh's `uvs`, n > 0 its attribute `uv{n}`.
    pub uv_set: u32,
}

/// How texture coordinates follow from a place, in a space of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Projection {
    /// (x, y).
    Planar,
    /// (θ / π, φ / 2π) with the angle θ to +z and φ from +x towards +y, from 0 to 2π.
    Spherical,
    /// (½ + φ / 2π, z) with φ from −π to π.
    Cylindrical,
}

/// Where a pattern takes its place from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum PatternSpace {
    /// The point in the world, by this `pattern_from_world`.
    World(Mat4),
    /// (u, v, 1) by this `pattern_from_uv`, at z = 0.
    Uv(Mat3),
}

/// A texture: a color and a scalar for every surface point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TextureDesc {
    /// The same everywhere.
    Constant {
        /// The color; the scalar value is its luminance.
        value: [f32; 3],
    },
    /// A picture.
    Bitmap(BitmapDesc),
    /// Squares of two colors: the unit square of `pattern_from_uv`·uv holds 2 × 2 of them, `color0` at the origin.
    Checkerboard {
        /// Color of the square at the origin and its diagonal neighbors.
        color0: Color,
        /// Color of the others.
        color1: Color,
        /// Applied to (u, v, 1).
        pattern_from_uv: Mat3,
    },
    /// A vertex or face attribute of the mesh, interpolated; 0 where the mesh lacks it.
    Attribute {
        /// Name of the attribute, such as `color`.
        name: String,
        /// Factor.
        scale: f32,
    },
    /// The product of two textures.
    Multiply {
        /// First factor.
        a: Color,
        /// Second factor.
        b: Color,
    },
    /// `a` where `weight` is 0, `b` where it is 1.
    Mix {
        /// At weight 0.
        a: Color,
        /// At weight 1.
        b: Color,
        /// In [0, 1].
        weight: Scalar,
    },
    /// `scale` · texture + `offset`, clamped to `clamp` where given.
    Affine {
        /// What is scaled.
        texture: TextureId,
        /// Factor.
        scale: f32,
        /// Summand.
        offset: f32,
        /// Range of the result.
        clamp: Option<[f32; 2]>,
    },
    /// Each value, taken as not negative, to a power.
    Power {
        /// The base.
        texture: TextureId,
        /// The exponent, positive.
        exponent: f32,
    },
    /// A function of a place.
    Solid {
        /// The function.
        pattern: SolidPattern,
        /// Of which place.
        space: PatternSpace,
    },
    /// A texture, and all that it refers to, over texture coordinates that follow from the place instead of the mesh's own.
    Projected {
        /// What is projected.
        texture: TextureId,
        /// How.
        projection: Projection,
        /// To the projection's space.
        pattern_from_world: Mat4,
    },
    /// |cos| between the geometric normal and a direction.
    Facing {
        /// In the world, unit.
        direction: Vec3,
    },
}

impl TextureDesc {
    /// The textures that this one is made of.
    pub fn parts(&self) -> Vec<TextureId> {
        let of = |colors: &[Color]| colors.iter().filter_map(|c| if let Param::Texture(id) = c { Some(*id) } else { None }).collect();
        match self {
            Self::Checkerboard { color0: a, color1: b, .. } | Self::Multiply { a, b } => of(&[*a, *b]),
            Self::Mix { a, b, weight } => {
                let mut parts: Vec<TextureId> = of(&[*a, *b]);
                parts.extend(if let Param::Texture(id) = weight { Some(*id) } else { None });
                parts
            }
            Self::Affine { texture, .. } | Self::Power { texture, .. } | Self::Projected { texture, .. } => vec![*texture],
            Self::Constant { .. } | Self::Bitmap(_) | Self::Attribute { .. } | Self::Solid { .. } | Self::Facing { .. } => Vec::new(),
        }
    }
}
