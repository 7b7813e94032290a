//! The items of a scene: what stands at its top level and in `#declare`.
//!
//! Each function reads a whole item from its first word, such as `pigment { … }`, and returns it. Blocks are loops over words until
//! the closing brace; an identifier of the same kind at the start of a block is a copy to begin with.

mod atmosphere;
mod camera;
mod finish;
mod function;
mod function_solids;
mod image_map;
mod interior;
mod light;
mod maps;
mod modifiers;
mod normal;
mod object;
#[cfg(test)]
mod object_tests;
mod pattern;
mod pigment;
mod settings;
mod solids;
mod solids_large;
mod solids_mesh;
mod solids_text;
mod texture;
mod warp;
pub(crate) use function::{SPLINE_WORDS, spline_kind};
pub(crate) use object::OBJECT_WORDS;
