//! The `.photons` file: a photon map with what is needed to go on with it, merge it and use it (docs/guide/particles.md).
//!
//! Magic, version, length and checksum of a JSON header, the header; then the records on surfaces and those in media as blocks, each
//! with its checksum. All numbers are little-endian. Equal maps give equal bytes.

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{MapInfo, Photon, PhotonMap, Segment};
use crate::image::atomic::write_atomically;

const MAGIC: [u8; 8] = *b"ETNDPHOT";
const VERSION: u32 = 1;
/// Records in a block (the last may have fewer).
const BLOCK: usize = 1 << 15;
/// The largest header: what hundreds of thousands of segments need.
const MAX_HEADER: usize = 64 << 20;

/// Why a photon file cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PhotonFileError {
    /// The file system's error.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// It does not start as a photon file does.
    #[error("not a photon file")]
    NotPhotons,
    /// Written by a later version.
    #[error("photon file of version {0}; this program reads up to version {VERSION}")]
    Version(u32),
    /// The file ends early, as after a copy that was cut off.
    #[error("photon file is truncated")]
    Truncated,
    /// Damaged or made up.
    #[error("photon file is damaged: {0}")]
    Damaged(&'static str),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    info: MapInfo,
    level: u32,
    segments: Vec<Segment>,
    surface: u64,
    volume: u64,
}

impl PhotonMap {
    /// Whether bytes begin as a photon file does.
    pub fn is_file(bytes: &[u8]) -> bool {
        bytes.starts_with(&MAGIC)
    }

    /// Writes the map as a file's bytes.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_to(&self, out: &mut (impl Write + ?Sized)) -> Result<(), PhotonFileError> {
        let header = Header {
            info: self.info.clone(),
            level: self.level(),
            segments: self.segments().to_vec(),
            surface: self.surface().len() as u64,
            volume: self.volume().len() as u64,
        };
        let header = serde_json::to_vec(&header).map_err(io::Error::from)?;
        out.write_all(&MAGIC)?;
        out.write_all(&VERSION.to_le_bytes())?;
        out.write_all(&(header.len() as u32).to_le_bytes())?;
        out.write_all(&crc32fast::hash(&header).to_le_bytes())?;
        out.write_all(&header)?;
        let mut bytes = Vec::with_capacity(BLOCK * size_of::<Photon>());
        for block in self.surface().chunks(BLOCK).chain(self.volume().chunks(BLOCK)) {
            bytes.clear();
            for photon in block {
                let words: [u32; 8] = bytemuck::cast(*photon);
                words.iter().for_each(|w| bytes.extend_from_slice(&w.to_le_bytes()));
            }
            out.write_all(&crc32fast::hash(&bytes).to_le_bytes())?;
            out.write_all(&bytes)?;
        }
        Ok(())
    }

    /// Writes the map to a file that appears whole or not at all.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn save(&self, path: &Path) -> Result<(), PhotonFileError> {
        write_atomically(path, |out| self.write_to(out))
    }

    /// Reads a file. Memory is taken only for what the file really holds.
    ///
    /// # Errors
    /// [`PhotonFileError`]
    pub fn load(path: &Path) -> Result<Self, PhotonFileError> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Self::read_from(&mut BufReader::with_capacity(1 << 18, file), length)
    }

    /// Reads a map from bytes of which there are `length`.
    ///
    /// # Errors
    /// [`PhotonFileError`]
    pub fn read_from(input: &mut impl Read, length: u64) -> Result<Self, PhotonFileError> {
        let mut prefix = [0; 20];
        let got = read_up_to(input, &mut prefix)?;
        if got >= MAGIC.len() && !prefix.starts_with(&MAGIC) {
            return Err(PhotonFileError::NotPhotons);
        }
        if got < prefix.len() {
            return Err(PhotonFileError::Truncated);
        }
        let word = |at: usize| u32::from_le_bytes([prefix[at], prefix[at + 1], prefix[at + 2], prefix[at + 3]]);
        if word(8) != VERSION {
            return Err(PhotonFileError::Version(word(8)));
        }
        let size = word(12) as usize;
        if size > MAX_HEADER {
            return Err(PhotonFileError::Damaged("its header is too long"));
        }
        if size as u64 > length {
            return Err(PhotonFileError::Truncated);
        }
        let mut bytes = vec![0; size];
        if read_up_to(input, &mut bytes)? < size {
            return Err(PhotonFileError::Truncated);
        }
        if crc32fast::hash(&bytes) != word(16) {
            return Err(PhotonFileError::Damaged("the header's checksum is wrong"));
        }
        let header: Header = serde_json::from_slice(&bytes).map_err(|_| PhotonFileError::Damaged("its header is not understood"))?;
        let record = size_of::<Photon>() as u64;
        // Before anything is allocated.
        if header.surface.saturating_add(header.volume).saturating_mul(record) > length {
            return Err(PhotonFileError::Truncated);
        }
        let surface = read_photons(input, header.surface as usize)?;
        let volume = read_photons(input, header.volume as usize)?;
        if read_up_to(input, &mut [0])? > 0 {
            return Err(PhotonFileError::Damaged("it goes on after its end"));
        }
        Self::from_parts(header.info, header.segments, header.level, surface, volume)
            .ok_or(PhotonFileError::Damaged("its list of photons contradicts itself"))
    }
}

fn read_photons(input: &mut impl Read, count: usize) -> Result<Vec<Photon>, PhotonFileError> {
    let mut photons = Vec::with_capacity(count);
    let mut bytes = vec![0; BLOCK.min(count) * size_of::<Photon>()];
    while photons.len() < count {
        let block = &mut bytes[..(count - photons.len()).min(BLOCK) * size_of::<Photon>()];
        let mut crc = [0; 4];
        if read_up_to(input, &mut crc)? < 4 || read_up_to(input, block)? < block.len() {
            return Err(PhotonFileError::Truncated);
        }
        if crc32fast::hash(block) != u32::from_le_bytes(crc) {
            return Err(PhotonFileError::Damaged("the checksum of a block is wrong"));
        }
        for record in block.as_chunks::<32>().0 {
            let words: [u32; 8] =
                std::array::from_fn(|i| u32::from_le_bytes([record[4 * i], record[4 * i + 1], record[4 * i + 2], record[4 * i + 3]]));
            let photon: Photon = bytemuck::cast(words);
            if !photon.is_finite() {
                return Err(PhotonFileError::Damaged("a photon is not finite"));
            }
            photons.push(photon);
        }
    }
    Ok(photons)
}

/// Reads until the buffer is full or the input ends; returns how much there was.
fn read_up_to(input: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut got = 0;
    while got < buffer.len() {
        match input.read(&mut buffer[got..]) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(got)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::photon::Route;
    use crate::spectrum::Spectrum;

    fn map() -> PhotonMap {
        let photon = |i: u32| Photon::new(Vec3::splat(i as f32), Vec3::Y, Vec3::Z, Spectrum::splat(0.1 * i as f32), i, 3, Route::Caustic);
        let segments = vec![
            Segment { begin: 0, end: 10, surface: 30_000, volume: 0 },
            Segment { begin: 1 << 40, end: (1 << 40) + 5, surface: 10_000, volume: 7 },
        ];
        let info = MapInfo { scene_hash: "abc".into(), seed: u64::MAX, max_depth: Some(7) };
        PhotonMap::from_parts(info, segments, 2, (0..40_000).map(photon).collect(), (0..7).map(photon).collect()).unwrap()
    }

    fn read(bytes: &[u8]) -> Result<PhotonMap, PhotonFileError> {
        PhotonMap::read_from(&mut &*bytes, bytes.len() as u64)
    }

    #[test]
    fn round_trip() {
        let mut bytes = Vec::new();
        map().write_to(&mut bytes).unwrap();
        assert_eq!(read(&bytes).unwrap(), map());
        let mut again = Vec::new();
        read(&bytes).unwrap().write_to(&mut again).unwrap();
        assert_eq!(bytes, again);
        let empty = PhotonMap::new(MapInfo::default());
        let mut bytes = Vec::new();
        empty.write_to(&mut bytes).unwrap();
        assert_eq!(read(&bytes).unwrap(), empty);
    }

    #[test]
    fn damaged_files_are_refused() {
        let mut good = Vec::new();
        map().write_to(&mut good).unwrap();
        for cut in [0, 4, 19, 20, 100, 300, 5000, good.len() / 2, good.len() - 1] {
            assert!(matches!(read(&good[..cut]), Err(PhotonFileError::Truncated)), "cut at {cut}");
        }
        for at in [0, 8, 12, 16, 40, 120, 1000, good.len() - 9] {
            let mut bad = good.clone();
            bad[at] ^= 0x41;
            assert!(read(&bad).is_err(), "byte {at}");
        }
        good.push(0);
        assert!(matches!(read(&good), Err(PhotonFileError::Damaged(_))));
        // A header that claims more than the file could hold.
        let header = br#"{"info":{"scene_hash":"","seed":0,"max_depth":null},"level":0,"segments":[{"begin":0,"end":1,"surface":9000000000000000000,"volume":0}],"surface":9000000000000000000,"volume":0}"#;
        let mut bytes = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend((header.len() as u32).to_le_bytes());
        bytes.extend(crc32fast::hash(header).to_le_bytes());
        bytes.extend(header);
        assert!(matches!(read(&bytes), Err(PhotonFileError::Truncated)));
    }
}
