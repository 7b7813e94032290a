//! Textures: colors and numbers that vary over surfaces.
//!
//! Every texture gives a color and a scalar at a surface point. The scalar of a color is its luminance, unless a bitmap names
//! a channel.

mod bitmap;
mod compile;
mod pyramid;
mod solid;

pub use bitmap::Bitmap;
pub use compile::{compile, decode};
pub use solid::{Projected, Solid};

use etendue_scene::desc::{Color, Param, Scalar, TextureId};
use glam::Mat3;

use crate::math::{Vec2, Vec3};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// The closed set of textures.
#[derive(Clone, Debug)]
pub enum Texture {
    /// The same everywhere.
    Constant(Spectrum),
    /// A picture.
    Bitmap(Box<Bitmap>),
    /// Squares of two colors.
    Checkerboard {
        /// At the origin.
        color0: Color,
        /// Beside it.
        color1: Color,
        /// Applied to (u, v, 1).
        pattern_from_uv: Mat3,
    },
    /// An interpolated attribute of the mesh.
    Attribute {
        /// Interned name.
        name: u32,
        /// Factor.
        scale: f32,
    },
    /// A product.
    Multiply(Color, Color),
    /// A blend: first, second, weight of the second.
    Mix(Color, Color, Scalar),
    /// Scaled, shifted and clamped.
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
        /// The exponent.
        exponent: f32,
    },
    /// A function of a place.
    Solid(Box<Solid>),
    /// A texture over projected coordinates.
    Projected(Box<Projected>),
    /// |cos| between the geometric normal and a direction.
    Facing {
        /// Unit.
        direction: Vec3,
    },
}

impl Texture {
    /// The color at a surface point.
    pub fn color(&self, scene: &Scene, s: &Surface) -> Spectrum {
        match self {
            Self::Constant(c) => *c,
            Self::Bitmap(b) => b.color(scene, s),
            Self::Checkerboard { color0, color1, pattern_from_uv } => {
                scene.color(if checker(pattern_from_uv, s.uv) { color0 } else { color1 }, s)
            }
            Self::Attribute { name, scale } => {
                let [r, g, b, _] = s.attribute(scene, *name).unwrap_or_default();
                Spectrum::from_rgb([r, g, b]) * *scale
            }
            Self::Multiply(a, b) => scene.color(a, s) * scene.color(b, s),
            Self::Mix(a, b, weight) => scene.color(a, s).lerp(scene.color(b, s), scene.scalar(weight, s)),
            Self::Power { texture, exponent } => {
                scene.texture(*texture).color(scene, s).map(|v| crate::math::fns::pow(v.max(0.0), *exponent))
            }
            Self::Solid(solid) => solid.color(s),
            Self::Projected(projected) => scene.texture(projected.texture).color(scene, &projected.surface(s)),
            Self::Facing { direction } => Spectrum::splat(s.ng.dot(*direction).abs()),
            Self::Affine { texture, scale, offset, clamp } => {
                let v = scene.texture(*texture).color(scene, s) * *scale + Spectrum::splat(*offset);
                clamp.map_or(v, |[lo, hi]| v.clamp(lo, hi))
            }
        }
    }

    /// The scalar at a surface point.
    pub fn scalar(&self, scene: &Scene, s: &Surface) -> f32 {
        match self {
            Self::Bitmap(b) => b.scalar(scene, s),
            Self::Affine { texture, scale, offset, clamp } => {
                let v = scene.texture(*texture).scalar(scene, s) * scale + offset;
                clamp.map_or(v, |[lo, hi]| v.clamp(lo, hi))
            }
            Self::Power { texture, exponent } => crate::math::fns::pow(scene.texture(*texture).scalar(scene, s).max(0.0), *exponent),
            Self::Attribute { name, scale } => {
                // Attributes of one number are copied to all lanes, so that the luminance is the number.
                s.attribute(scene, *name).map_or(0.0, |[r, g, b, _]| Spectrum::from_rgb([r, g, b]).luminance()) * scale
            }
            Self::Multiply(a, b) => scalar_of(scene, a, s) * scalar_of(scene, b, s),
            Self::Projected(projected) => scene.texture(projected.texture).scalar(scene, &projected.surface(s)),
            Self::Constant(_) | Self::Checkerboard { .. } | Self::Mix(..) | Self::Solid(_) | Self::Facing { .. } => {
                self.color(scene, s).luminance()
            }
        }
    }

    /// ∂(scalar)/∂(u, v) at a surface point, for bump maps.
    pub fn scalar_gradient(&self, scene: &Scene, s: &Surface) -> Vec2 {
        if let Self::Bitmap(b) = self {
            return b.gradient(scene, s);
        }
        // Central differences over a thousandth of the coordinate square.
        const H: f32 = 5e-4;
        let at = |du: f32, dv: f32| {
            let d = Vec2::new(du, dv);
            let moved = Surface { uv: s.uv + d, p: s.p + s.dpdu * du + s.dpdv * dv, ..s.clone() };
            self.scalar(scene, &moved)
        };
        Vec2::new(at(H, 0.0) - at(-H, 0.0), at(0.0, H) - at(0.0, -H)) / (2.0 * H)
    }
}

fn scalar_of(scene: &Scene, color: &Color, s: &Surface) -> f32 {
    match color {
        Param::Constant(c) => Spectrum::from_rgb(*c).luminance(),
        Param::Texture(id) => scene.texture(*id).scalar(scene, s),
    }
}

/// True on the squares like the one at the origin.
fn checker(m: &Mat3, uv: Vec2) -> bool {
    let q = *m * Vec3::new(uv.x, uv.y, 1.0);
    let half = |v: f32| v - v.floor() < 0.5;
    half(q.x) == half(q.y)
}
