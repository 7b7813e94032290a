//! Any bytes: the glTF reader answers with a description or with faults, and what it describes can be written.
#![no_main]

use std::path::Path;

use etendue_scene::formats::{ReadOptions, gltf};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let Ok(desc) = gltf::read_bytes(data, Path::new("fuzz.glb"), &ReadOptions { time: Some(0.5), ..ReadOptions::default() }) {
        let _ = gltf::write_glb(&desc);
    }
});
