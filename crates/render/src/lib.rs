//! The renderer on CPU, from a [`etendue_scene::SceneDesc`] to a [`film::Film`].
//!
//! Data flows one way: `scene::compile` turns a description into flat, immutable arrays; an integrator
//! computes samples of it; a session schedules the samples into a film; `film::develop` makes images.

pub mod accel;
pub mod bsdf;
pub mod light;
pub mod math;
pub mod shape;
pub mod spectrum;
