//! Parts of a solution: some points with all of their samples, as a file's bytes. A checkpoint is the part that has all points; what
//! machines of a farm have done side by side is put together from parts, with the bits of one run.
//!
//! `ETBAKE02`, samples per point (u32), first point (u64), number of points (u64), points of the whole (u64), a text that names scene
//! and settings (u32 length, UTF-8), the sums compressed by zlib, and a CRC-32 of all before it; little-endian.

use std::io::{self, Read, Write};
use std::path::Path;

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;

use super::BakeError;
use super::solve::{Solution, Sums};
use crate::image::atomic::write_atomically;

const MAGIC: &[u8; 8] = b"ETBAKE02";
/// The most points of a part.
const MAX_POINTS: u64 = 1 << 32;

/// Some points of a solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Scene and settings.
    pub(super) name: String,
    /// The first point.
    pub(super) begin: u64,
    /// Points of the whole solution.
    pub(super) total: u64,
    /// The points.
    pub(super) solution: Solution,
}

impl Part {
    /// The first point, the one after the last, and the samples of each.
    pub fn held(&self) -> (u64, u64, u32) {
        (self.begin, self.begin + self.solution.sums.len() as u64, self.solution.spp)
    }

    /// Whether bytes begin as a part does.
    pub fn is_part(bytes: &[u8]) -> bool {
        bytes.starts_with(MAGIC)
    }

    /// The file's bytes.
    ///
    /// # Errors
    /// The compressor's.
    pub fn to_bytes(&self) -> io::Result<Vec<u8>> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(self.solution.spp.to_le_bytes());
        for number in [self.begin, self.solution.sums.len() as u64, self.total] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend((self.name.len() as u32).to_le_bytes());
        bytes.extend(self.name.as_bytes());
        let mut encoder = ZlibEncoder::new(bytes, Compression::fast());
        for sums in &self.solution.sums {
            for v in sums.to_array() {
                encoder.write_all(&v.to_le_bytes())?;
            }
        }
        let mut bytes = encoder.finish()?;
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        Ok(bytes)
    }

    /// Reads a file's bytes; `None` where they are no part, or a damaged one.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (body, crc) = bytes.split_last_chunk::<4>()?;
        if !Self::is_part(body) || crc32fast::hash(body) != u32::from_le_bytes(*crc) {
            return None;
        }
        let (head, rest) = body[MAGIC.len()..].split_first_chunk::<32>()?;
        let word = |i: usize| u32::from_le_bytes([head[i], head[i + 1], head[i + 2], head[i + 3]]);
        let long = |i: usize| u64::from(word(i)) | u64::from(word(i + 4)) << 32;
        let (begin, count, total) = (long(4), long(12), long(20));
        if total > MAX_POINTS || begin.checked_add(count).is_none_or(|end| end > total) {
            return None;
        }
        let (name, packed) = rest.split_at_checked(word(28) as usize)?;
        let name = String::from_utf8(name.to_vec()).ok()?;
        let mut raw = Vec::new();
        let size = count as usize * Sums::WIDTH * 8;
        ZlibDecoder::new(packed).take(size as u64 + 1).read_to_end(&mut raw).ok()?;
        if raw.len() != size {
            return None;
        }
        let number = |b: &[u8]| f64::from_le_bytes(std::array::from_fn(|i| b[i]));
        let sums = raw.chunks_exact(Sums::WIDTH * 8).map(|c| Sums::from_array(std::array::from_fn(|i| number(&c[8 * i..8 * i + 8]))));
        Some(Self { name, begin, total, solution: Solution { sums: sums.collect(), spp: word(0) } })
    }

    /// Puts neighbors together, in any order.
    ///
    /// # Errors
    /// [`BakeError::Checkpoint`] where they are of different bakes or settings, overlap, or leave points out.
    pub fn merge(mut parts: Vec<Self>) -> Result<Self, BakeError> {
        let fail = |why: &str| BakeError::Checkpoint(format!("the parts of the bake do not go together: {why}"));
        parts.sort_by_key(|p| p.begin);
        let mut parts = parts.into_iter();
        let mut whole = parts.next().ok_or_else(|| fail("there are none"))?;
        for part in parts {
            if (&part.name, part.total, part.solution.spp) != (&whole.name, whole.total, whole.solution.spp) {
                return Err(fail("they are of different scenes, settings or numbers of samples"));
            }
            if part.begin != whole.begin + whole.solution.sums.len() as u64 {
                return Err(fail("they overlap, or points are missing between them"));
            }
            whole.solution.sums.extend(part.solution.sums);
        }
        Ok(whole)
    }

    /// The solution, if the part is that of all points of this bake.
    pub(super) fn whole(self, name: &str, points: usize) -> Option<Solution> {
        let fits = self.name == name && self.begin == 0 && self.total == points as u64 && self.solution.sums.len() == points;
        fits.then_some(self.solution)
    }
}

/// Writes a checkpoint; the file appears whole or not at all.
///
/// # Errors
/// The system's.
pub(super) fn save(path: &Path, name: &str, solution: &Solution) -> io::Result<()> {
    let part = Part { name: name.to_owned(), begin: 0, total: solution.sums.len() as u64, solution: solution.clone() };
    let bytes = part.to_bytes()?;
    write_atomically(path, |out| out.write_all(&bytes))
}

/// Reads a checkpoint of the same scene and settings.
///
/// # Errors
/// [`BakeError::Checkpoint`] where it is damaged or of another scene or other settings; [`BakeError::Io`].
pub(super) fn load(path: &Path, name: &str, points: usize) -> Result<Solution, BakeError> {
    let bytes = std::fs::read(path).map_err(|e| BakeError::Io { path: path.to_owned(), source: e })?;
    let fail = |why: &str| BakeError::Checkpoint(format!("{}: {why}", path.display()));
    let part = Part::from_bytes(&bytes).ok_or_else(|| fail("is no checkpoint of a bake, or a damaged one"))?;
    part.whole(name, points).ok_or_else(|| fail("belongs to another scene or other settings"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solution(points: usize) -> Solution {
        Solution { sums: (0..points).map(|i| Sums::from_array(std::array::from_fn(|k| (i * 7 + k) as f64 / 3.0))).collect(), spp: 9 }
    }

    #[test]
    fn checkpoints_come_back_bit_for_bit_and_damage_is_noticed() {
        let dir = std::env::temp_dir().join(format!("etendue-bake-checkpoint-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        let path = dir.join("a.bake");
        let solution = solution(100);
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

    #[test]
    fn parts_in_any_order_are_the_whole_and_gaps_are_refused() {
        let whole = solution(100);
        let part = |begin: usize, end: usize| {
            let sums = whole.sums[begin..end].to_vec();
            Part { name: "scene".into(), begin: begin as u64, total: 100, solution: Solution { sums, spp: 9 } }
        };
        let again = |p: Part| Part::from_bytes(&p.to_bytes().unwrap()).unwrap();
        let merged = Part::merge(vec![again(part(60, 100)), part(0, 33), again(part(33, 60))]).unwrap();
        assert_eq!(merged.held(), (0, 100, 9));
        assert_eq!(merged.whole("scene", 100), Some(whole.clone()));
        assert_eq!(part(0, 99).whole("scene", 100), None);
        for bad in [vec![], vec![part(0, 33), part(34, 100)], vec![part(0, 33), part(32, 100)]] {
            assert!(Part::merge(bad).is_err());
        }
        let mut other = part(33, 100);
        other.solution.spp = 8;
        assert!(Part::merge(vec![part(0, 33), other]).is_err());
        // A part that claims points it cannot have.
        let mut bytes = part(0, 10).to_bytes().unwrap();
        bytes[20..28].copy_from_slice(&u64::MAX.to_le_bytes());
        let end = bytes.len() - 4;
        let crc = crc32fast::hash(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&crc);
        assert_eq!(Part::from_bytes(&bytes), None);
    }
}
