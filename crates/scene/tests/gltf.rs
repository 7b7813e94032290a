//! The glTF reader and writer.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr)]

#[path = "gltf/animation.rs"]
mod animation;
#[path = "gltf/build.rs"]
mod build;
#[path = "gltf/geometry.rs"]
mod geometry;
#[path = "gltf/hostile.rs"]
mod hostile;
#[path = "gltf/material.rs"]
mod material;
#[path = "gltf/samples.rs"]
mod samples;
#[path = "gltf/scene.rs"]
mod scene;
#[path = "gltf/write.rs"]
mod write;
