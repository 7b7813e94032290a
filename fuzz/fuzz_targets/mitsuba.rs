//! `cargo +nightly fuzz run mitsuba`
#![no_main]

use std::path::Path;

use etendue_scene::formats::{ReadOptions, mitsuba};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = mitsuba::read_bytes(Path::new("fuzz.xml"), bytes, &ReadOptions::default());
});
