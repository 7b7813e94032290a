//! Procedural textures and functions as plain data, with their evaluation.
//!
//! A reader evaluates functions while it reads (`f(1, 2, 3)` in a `.pov` file), and the renderer evaluates patterns and functions at
//! every hit, so both stand on this crate: `render → scene → procedural`. All elementary functions come from [`fns`], so values have the
//! same bits on every machine.
//!
//! The models are those of POV-Ray 3.7, in `f64`, as its documentation and its output tell (no source of it was used); and, in
//! [`gradient_noise`] and [`solid_pattern`], those of pbrt-v4, in `f32`.

mod always;
pub mod color;
pub mod context;
mod default_colors;
pub mod finish;
pub mod fns;
pub mod function;
pub mod gradient_noise;
pub mod image_map;
pub mod map;
pub mod noise;
pub mod noise_cells;
mod noise_tables;
pub mod normal;
pub mod pattern;
pub mod pigment;
mod power;
#[allow(clippy::approx_constant)] // √2 is one entry of a table.
mod power_tables;
pub mod solid_pattern;
pub mod spline;
pub mod texture;
pub mod warp;

pub use color::Color;
pub use context::{Context, Images, Inside};
pub use finish::{Finish, Irid, OldInterior, Reflection};
pub use function::Function;
pub use image_map::ImageMap;
pub use map::BlendMap;
pub use normal::{Normal, NormalFill};
pub use pattern::{Pattern, PatternKind};
pub use pigment::{PatternedPigment, Pigment, PigmentFill};
pub use solid_pattern::SolidPattern;
pub use spline::{Spline, SplineKind};
pub use texture::{Layer, PatternedTexture, Texture, TextureFill};
pub use warp::Warp;

/// Number of an object that patterns ask about (`object { … }` patterns): index into the scene's list of pattern objects.
pub type ObjectId = u32;
/// Number of a picture: index into the scene's list of pictures.
pub type ImageId = u32;
