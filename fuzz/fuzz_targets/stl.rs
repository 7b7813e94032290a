//! `cargo +nightly fuzz run stl`
#![no_main]

use etendue_scene::desc::MeshFormat;
use etendue_scene::formats::mesh;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = mesh::parse(bytes, MeshFormat::Stl, 0);
});
