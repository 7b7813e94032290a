//! Checkpoints: all sums so far in a file, to go on from.
//!
//! `ETBAKE01`, samples per point (u32), number of points (u64), a text that names scene and settings (u32 length, UTF-8), the sums
//! compressed by zlib, and a CRC-32 of all before it; little-endian.

use std::io::{Read, Write};
use std::path::Path;

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;

use super::BakeError;
use super::solve::{Solution, Sums};
use crate::image::atomic::write_atomically;

const MAGIC: &[u8; 8] = b"ETBAKE01";

/// Writes a checkpoint; the file appears whole or not at all.
///
/// # Errors
/// The system's.
pub fn save(path: &Path, name: &str, solution: &Solution) -> std::io::Result<()> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend(solution.spp.to_le_bytes());
    bytes.extend((solution.sums.len() as u64).to_le_bytes());
    bytes.extend((name.len() as u32).to_le_bytes());
    bytes.extend(name.as_bytes());
    let mut encoder = ZlibEncoder::new(bytes, Compression::fast());
    for sums in &solution.sums {
        for v in sums.to_array() {
            encoder.write_all(&v.to_le_bytes())?;
        }
    }
    let mut bytes = encoder.finish()?;
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    write_atomically(path, |out| out.write_all(&bytes))
}

/// Reads a checkpoint of the same scene and settings.
///
/// # Errors
/// [`BakeError::Checkpoint`] where it is damaged or of another scene or other settings; [`BakeError::Io`].
pub fn load(path: &Path, name: &str, points: usize) -> Result<Solution, BakeError> {
    let bytes = std::fs::read(path).map_err(|e| BakeError::Io { path: path.to_owned(), source: e })?;
    let fail = |why: &str| BakeError::Checkpoint(format!("{}: {why}", path.display()));
    let damaged = || fail("is no checkpoint of a bake, or a damaged one");
    let (body, crc) = bytes.split_last_chunk::<4>().ok_or_else(damaged)?;
    if !body.starts_with(MAGIC) || crc32fast::hash(body) != u32::from_le_bytes(*crc) {
        return Err(damaged());
    }
    let (head, rest) = body[8..].split_first_chunk::<16>().ok_or_else(damaged)?;
    let word = |i: usize| u32::from_le_bytes([head[i], head[i + 1], head[i + 2], head[i + 3]]);
    let count = u64::from(word(4)) | u64::from(word(8)) << 32;
    let (text, packed) = rest.split_at_checked(word(12) as usize).ok_or_else(damaged)?;
    if text != name.as_bytes() || count != points as u64 {
        return Err(fail("belongs to another scene or other settings"));
    }
    let mut raw = Vec::new();
    let size = points * Sums::WIDTH * 8;
    ZlibDecoder::new(packed).take(size as u64 + 1).read_to_end(&mut raw).map_err(|_| damaged())?;
    if raw.len() != size {
        return Err(damaged());
    }
    let number = |b: &[u8]| f64::from_le_bytes(std::array::from_fn(|i| b[i]));
    let sums = raw.chunks_exact(Sums::WIDTH * 8).map(|c| Sums::from_array(std::array::from_fn(|i| number(&c[8 * i..8 * i + 8]))));
    Ok(Solution { sums: sums.collect(), spp: word(0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checkpoints_come_back_bit_for_bit_and_damage_is_noticed() {
        let dir = std::env::temp_dir().join(format!("etendue-bake-checkpoint-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        let path = dir.join("a.bake");
        let solution =
            Solution { sums: (0..100).map(|i| Sums::from_array(std::array::from_fn(|k| (i * 7 + k) as f64 / 3.0))).collect(), spp: 9 };
        save(&path, "scene", &solution).unwrap();
        assert_eq!(load(&path, "scene", 100).unwrap(), solution);
        assert!(load(&path, "other", 100).is_err());
        assert!(load(&path, "scene", 99).is_err());
        let bytes = std::fs::read(&path).unwrap();
        for n in (0..bytes.len()).step_by(7) {
            std::fs::write(&path, &bytes[..n]).unwrap();
            assert!(load(&path, "scene", 100).is_err());
        }
        let mut flipped = bytes;
        flipped[60] ^= 1;
        std::fs::write(&path, &flipped).unwrap();
        assert!(load(&path, "scene", 100).is_err());
        std::fs::remove_dir_all(&dir).unwrap();
    }
}
