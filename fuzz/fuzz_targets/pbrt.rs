//! `cargo +nightly fuzz run pbrt`
#![no_main]

use std::path::Path;

use etendue_scene::formats::{ReadOptions, pbrt};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = pbrt::read_bytes(Path::new("fuzz.pbrt"), bytes, &ReadOptions::default());
});
