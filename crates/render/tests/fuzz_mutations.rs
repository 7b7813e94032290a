//! Deterministic mutation of picture, film and photon files: no reader may panic, hang or reserve more memory than it is allowed.
//!
//! `ETENDUE_FUZZ_ROUNDS=100000` runs longer. The same entry points have cargo-fuzz targets under `fuzz/`.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use etendue_render::film::{Film, FilmSpec};
use etendue_render::image::{FileFormat, Image, ReadLimits, Texels, WriteOptions, is_rare, linear_from_srgb_u8, png_bytes};
use etendue_render::lightmap::Part;
use etendue_render::photon::{MapInfo, PhotonMap};

/// SplitMix64 (Steele, Lea, Flood 2014, doi:10.1145/2660193.2660195).
fn next(state: &mut u64) -> usize {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 1) as usize
}

/// Changed bytes, numbers that are too large, and pieces left out, doubled or cut off.
fn mutate(state: &mut u64, seed: &[u8]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..=next(state) % 4 {
        if bytes.is_empty() {
            return bytes;
        }
        // Mostly in the head, which says how large everything is.
        let most = if next(state).is_multiple_of(2) { bytes.len().min(400) } else { bytes.len() };
        let at = next(state) % most;
        let end = (at + next(state) % 8).min(bytes.len());
        match next(state) % 6 {
            0 => bytes[at] = next(state) as u8,
            1 => bytes[at..end].fill(0xff),
            2 => bytes[at..end].fill(0),
            3 => drop(bytes.drain(at..end)),
            4 => bytes.truncate(at),
            _ => bytes.extend_from_within(at..end),
        }
    }
    bytes
}

fn check(name: &str, seed: &[u8], read: impl Fn(&[u8]) -> bool) {
    let rounds = std::env::var("ETENDUE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(300);
    assert!(read(seed), "{name} itself must be read");
    let mut state = name.bytes().fold(7u64, |h, b| h.wrapping_mul(31).wrapping_add(u64::from(b)));
    let mut refused = 0;
    for _ in 0..rounds {
        let bytes = mutate(&mut state, seed);
        let start = Instant::now();
        refused += u32::from(!read(&bytes));
        assert!(start.elapsed() < Duration::from_secs(10), "{name}: {} bytes take too long", bytes.len());
    }
    assert!(refused > 0, "{name}: no mutation was refused");
}

fn picture() -> Image {
    let pixels: Vec<[f32; 3]> = (0..24 * 17).map(|i| [i as f32 / 400.0, 0.5, (i % 7) as f32]).collect();
    Image::from_rgb(24, 17, &pixels)
}

#[test]
fn pictures() {
    let limits = ReadLimits { max_bytes: 1 << 24, ..ReadLimits::default() };
    for (format, extension) in [(FileFormat::Exr, "exr"), (FileFormat::Hdr, "hdr"), (FileFormat::Png, "png"), (FileFormat::Jpeg, "jpg")] {
        let mut bytes = Vec::new();
        picture().write_to(&mut bytes, format, &WriteOptions::default()).unwrap();
        check(extension, &bytes, |b| Image::from_bytes(b, Some(extension), None, limits).is_ok());
    }
}

#[test]
fn ktx2_pictures() {
    let limits = ReadLimits { max_bytes: 1 << 24, ..ReadLimits::default() };
    let etc1s: (_, &[u8], _) = ("etc1s", include_bytes!("data/etc1s.ktx2"), 0.12);
    for (name, seed, tolerance) in [etc1s, ("uastc", include_bytes!("data/uastc.ktx2"), 0.04)] {
        check(name, seed, |b| Image::from_bytes(b, Some("ktx2"), None, limits).is_ok());
        // 64 × 48: red rises to the right, green downwards, both from 0; the squares of blue have 40 and 200.
        let image = Image::from_bytes(seed, None, None, limits).unwrap();
        assert_eq!((image.width, image.height), (64, 48));
        let [red, green, blue] = ["R", "G", "B"].map(|c| image.channel(c).unwrap());
        let at = |plane: &[f32], x: usize, y: usize| plane[64 * y + x];
        let linear = |code: usize| linear_from_srgb_u8(code as u8);
        for (x, y) in [(20, 20), (36, 4), (52, 44), (60, 28)] {
            let expected = [linear(4 * x), linear(5 * y), linear(if ((x / 8) ^ (y / 8)) & 1 == 1 { 200 } else { 40 })];
            for (found, expected) in [at(red, x, y), at(green, x, y), at(blue, x, y)].into_iter().zip(expected) {
                assert!((found - expected).abs() < tolerance, "{name} at {x}, {y}: {found} instead of {expected}");
            }
        }
    }
}

/// As PNG every number is what it was, and common formats stay as they are.
#[test]
fn rare_pictures_as_png() {
    for ktx2 in [&include_bytes!("data/etc1s.ktx2")[..], include_bytes!("data/uastc.ktx2")] {
        assert!(is_rare(ktx2, false));
        let png = png_bytes(ktx2).unwrap();
        assert!(png.starts_with(b"\x89PNG") && !is_rare(&png, true));
        let of = |bytes: &[u8]| Texels::from_bytes(bytes, None, None, ReadLimits::default()).unwrap();
        assert_eq!(of(ktx2), of(&png));
    }
    assert!(is_rare(b"GIF89a", true) && !is_rare(b"GIF89a", false) && !is_rare(b"", true));
    assert!(png_bytes(b"\xABKTX 20\xBB\r\n\x1A\n").is_err());
}

#[test]
fn films() {
    let mut film = Film::new(FilmSpec::new(37, 21)).unwrap();
    for i in 0..37 * 21 {
        film.add_sample(i % 37, i / 37, 0, 1.0, &[i as f32; 4]);
    }
    let mut bytes = Vec::new();
    film.write_to(&mut bytes).unwrap();
    check("film", &bytes, |b| Film::from_bytes(b, 1 << 26).is_ok());
}

#[test]
fn photon_maps_and_parts_of_bakes() {
    let mut bytes = Vec::new();
    PhotonMap::new(MapInfo { scene_hash: "scene".into(), seed: 3, max_depth: Some(4) }).write_to(&mut bytes).unwrap();
    check("photons", &bytes, |b| PhotonMap::read_from(&mut &*b, b.len() as u64, 1 << 26).is_ok());
    // A part without points; those with points are tested where they can be made.
    let mut part = b"ETBAKE02".to_vec();
    part.extend([0; 32]);
    part.extend([0x78, 0x01, 0x03, 0, 0, 0, 0, 1]);
    part.extend(crc32fast::hash(&part).to_le_bytes());
    check("bake", &part, |b| Part::from_bytes(b).is_some());
}
