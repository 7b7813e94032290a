//! Any bytes: the readers of films, photon maps and parts of bakes answer with what they hold or with an error.
#![no_main]

use etendue_render::film::Film;
use etendue_render::lightmap::Part;
use etendue_render::photon::PhotonMap;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = Film::from_bytes(data, 1 << 28);
    let _ = PhotonMap::read_from(&mut &*data, data.len() as u64, 1 << 26);
    let _ = Part::from_bytes(data);
});
