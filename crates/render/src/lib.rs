//! The renderer on CPU, from a [`etendue_scene::SceneDesc`] to a [`film::Film`].
//!
//! Data flows one way: `scene::compile` turns a description into flat, immutable arrays; an integrator
//! computes samples of it; a session schedules the samples into a film; `film::develop` makes images.

pub mod accel;
pub mod bsdf;
pub mod camera;
pub mod classic;
pub mod denoise;
pub mod film;
pub mod image;
pub mod integrator;
pub mod light;
pub mod lighting;
pub mod lightmap;
pub mod material;
pub mod math;
pub mod medium;
pub mod photon;
pub mod radiosity;
pub mod raster;
pub mod sampler;
pub mod scene;
pub mod session;
pub mod shape;
pub mod solid;
pub mod spectrum;
#[doc(hidden)]
pub mod testing;
pub mod texture;
