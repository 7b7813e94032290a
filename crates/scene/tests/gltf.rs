//! The glTF reader and writer.

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
