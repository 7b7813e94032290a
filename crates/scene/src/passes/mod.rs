//! Steps from a description to a description: loading what it refers to, filling in what it leaves open.

mod complete;
mod meshes;

pub use complete::{complete, world_bounds};
pub use meshes::load_meshes;
