//! Any bytes: the readers of pictures answer with a picture or with an error.
#![no_main]

use etendue_render::image::{Image, ReadLimits};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let limits = ReadLimits { max_bytes: 1 << 26, ..ReadLimits::default() };
    let _ = Image::from_bytes(data, Some("tga"), None, limits);
});
