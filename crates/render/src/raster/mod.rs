//! The z-buffer renderer: triangles to pixels, without rays.
//!
//! The core is [`draw`]: it fills an [`ItemBuffer`], for each pixel the nearest triangle and its depth, from [`Triangles`] as a
//! [`View`] shows them. Everything else asks it: the camera's picture, shadow maps, environment maps captured in a scene, the
//! hemicubes of radiosity. [`ShadowMap`] and [`Environment`] are such pictures with their look-ups, [`Lighting`] shades with them.
//!
//! How it works and what it guarantees:
//!
//! - Triangles stay in homogeneous coordinates (Olano and Greer 1997, "Triangle Scan Conversion using 2D Homogeneous Coordinates",
//!   doi:10.1145/258694.258723): the three edges are planes through the eye, and a pixel is covered where the ray through its center
//!   is inside all three. No triangle is ever cut: those that cross the near plane, or reach behind the eye, need no special care.
//! - Edges are set up in double precision with operations that are exactly odd under exchange of their ends. So two triangles
//!   that share an edge compute opposite numbers there: no pixel is lost or drawn twice, at any size (top-left rule for zeros). Where
//!   a corner falls on a pixel's center, its triangles are closed sets: such pixels may be drawn twice, but are not lost.
//! - The depth that is kept is linear on the screen and larger when nearer: 1/w for perspective, minus the distance for
//!   orthographic views. In `f32` 1/w has the same relative precision at all distances, however near the near plane is.
//! - Of equal depths the lower triangle number wins. So nothing depends on threads, tiles or the order of drawing.
//! - Triangles with coordinates that are not finite, and those without area on the screen, are not drawn.

mod ambient;
mod capture;
mod draw;
pub mod environment;
mod lighting;
mod lights;
mod shadow;
mod tile;
mod triangles;
mod view;
mod visible;

pub use draw::{DrawOptions, ItemBuffer, NO_ITEM, draw};
pub use environment::{Correction, Environment};
pub use lighting::{ENVIRONMENT_SOURCES, EnvironmentSource, Lighting, LightingOptions};
pub use lights::{Extent, Form, LightGroup, Place, light_groups};
pub use shadow::{Casters, SHADOW_FILTERS, ShadowFilter, ShadowMap};
pub use triangles::{Located, Mesh, Part, Triangles};
pub use view::{Pose, View};
pub use visible::Visible;
pub(crate) use visible::surface_at;

#[cfg(test)]
mod tests;
