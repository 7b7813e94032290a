//! `cargo +nightly fuzz run pov`
#![no_main]

use std::path::Path;

use etendue_scene::formats::{ReadOptions, pov};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let mut options = ReadOptions::default();
    options.pov.work_limit = 200_000;
    let _ = pov::read_bytes(Path::new("fuzz.pov"), bytes, &options);
});
