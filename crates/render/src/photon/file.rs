//! The `.photons` file: a photon map with what is needed to go on with it, merge it and use it (docs/guide/particles.md).
//!
//! Magic, version, length and checksum of a JSON header, the header; then the records on surfaces and those in media as blocks, each
//! with its checksum. All numbers are little-endian. Equal maps give equal bytes.

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::map::{BYTES_PER_PHOTON, MAX_LEVEL, survives_thinning};
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

/// What a map holds: the header of its file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contents {
    /// What it is of.
    pub info: MapInfo,
    /// One of 2^level records was kept.
    pub level: u32,
    /// Which photons, in order, neighbors joined.
    pub segments: Vec<Segment>,
    /// Records on surfaces.
    pub surface: u64,
    /// Records in media.
    pub volume: u64,
}

impl Contents {
    /// Number of photons that were traced.
    pub fn traced(&self) -> u64 {
        self.segments.iter().map(|s| s.end - s.begin).sum()
    }

    /// Bytes that the map takes once it is in use.
    pub fn bytes(&self) -> u64 {
        (self.surface + self.volume) * BYTES_PER_PHOTON
    }

    /// Reads what a file says of itself, and whether the rest of it is whole, without keeping any record.
    ///
    /// # Errors
    /// [`PhotonFileError`]
    pub fn load(path: &Path) -> Result<Self, PhotonFileError> {
        let (mut input, length) = open(path)?;
        let contents = read_contents(&mut input, length)?;
        read_photons(&mut input, contents.surface, &mut |_| {})?;
        read_photons(&mut input, contents.volume, &mut |_| {})?;
        at_end(&mut input)?;
        Ok(contents)
    }

    /// Whether segments and numbers fit together.
    fn is_consistent(&self) -> bool {
        let ordered = self.segments.windows(2).all(|w| w[0].end < w[1].begin) && self.segments.iter().all(|s| s.begin < s.end);
        let sum = |of: fn(&Segment) -> u64| self.segments.iter().try_fold(0u64, |sum, s| sum.checked_add(of(s)));
        let complete = sum(|s| s.surface) == Some(self.surface) && sum(|s| s.volume) == Some(self.volume);
        ordered && complete && self.level <= MAX_LEVEL && sum(|s| s.end - s.begin).is_some()
    }
}

fn open(path: &Path) -> Result<(BufReader<File>, u64), PhotonFileError> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    Ok((BufReader::with_capacity(1 << 18, file), length))
}

impl PhotonMap {
    /// Whether bytes begin as a photon file does.
    pub fn is_file(bytes: &[u8]) -> bool {
        bytes.starts_with(&MAGIC)
    }

    /// What the map holds.
    pub fn contents(&self) -> Contents {
        Contents {
            info: self.info.clone(),
            level: self.level(),
            segments: self.segments().to_vec(),
            surface: self.surface().len() as u64,
            volume: self.volume().len() as u64,
        }
    }

    /// Writes the map as a file's bytes.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_to(&self, out: &mut (impl Write + ?Sized)) -> Result<(), PhotonFileError> {
        let header = serde_json::to_vec(&self.contents()).map_err(io::Error::from)?;
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

    /// Reads a file. Where it holds more than `budget` bytes of records in use, they are thinned as they come.
    ///
    /// # Errors
    /// [`PhotonFileError`]
    pub fn load(path: &Path, budget: u64) -> Result<Self, PhotonFileError> {
        let (mut input, length) = open(path)?;
        Self::read_from(&mut input, length, budget)
    }

    /// Reads a map from bytes of which there are `length`, as [`Self::load`] does.
    ///
    /// # Errors
    /// [`PhotonFileError`]
    pub fn read_from(input: &mut impl Read, length: u64, budget: u64) -> Result<Self, PhotonFileError> {
        let contents = read_contents(input, length)?;
        let mut filler = Filler::new(&contents, budget);
        read_photons(input, contents.surface, &mut |photon| filler.push(false, photon))?;
        filler.segment = 0;
        read_photons(input, contents.volume, &mut |photon| filler.push(true, photon))?;
        at_end(input)?;
        Ok(filler.map)
    }
}

/// Fills a map with the records of a file.
struct Filler {
    map: PhotonMap,
    /// Records that the file has of each segment, on surfaces and in media, those not yet read.
    left: Vec<[u64; 2]>,
    /// The segment of the next record.
    segment: usize,
    /// Records that the budget has room for.
    room: u64,
    /// Thinning of the file.
    level: u32,
}

impl Filler {
    fn new(contents: &Contents, budget: u64) -> Self {
        let left = contents.segments.iter().map(|s| [s.surface, s.volume]).collect();
        Self { map: PhotonMap::empty(contents), left, segment: 0, room: budget / BYTES_PER_PHOTON, level: contents.level }
    }

    fn push(&mut self, volume: bool, photon: Photon) {
        // The contents are consistent: there are as many records as the segments have together.
        while self.left[self.segment][usize::from(volume)] == 0 {
            self.segment += 1;
        }
        self.left[self.segment][usize::from(volume)] -= 1;
        if self.map.level() > self.level && !survives_thinning(&photon, self.map.level()) {
            return;
        }
        self.map.push(self.segment, volume, photon);
        while (self.map.surface().len() + self.map.volume().len()) as u64 > self.room && self.map.level() < MAX_LEVEL {
            self.map.thin(self.map.level() + 1);
        }
    }
}

/// Reads magic, version and header.
fn read_contents(input: &mut impl Read, length: u64) -> Result<Contents, PhotonFileError> {
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
    let contents: Contents = serde_json::from_slice(&bytes).map_err(|_| PhotonFileError::Damaged("its header is not understood"))?;
    // Before anything is allocated.
    let record = size_of::<Photon>() as u64;
    if contents.surface.saturating_add(contents.volume).saturating_mul(record) > length {
        return Err(PhotonFileError::Truncated);
    }
    if !contents.is_consistent() {
        return Err(PhotonFileError::Damaged("its list of photons contradicts itself"));
    }
    Ok(contents)
}

/// Reads the blocks of so many records.
fn read_photons(input: &mut impl Read, count: u64, found: &mut dyn FnMut(Photon)) -> Result<(), PhotonFileError> {
    let mut bytes = vec![0; (BLOCK as u64).min(count) as usize * size_of::<Photon>()];
    let mut left = count;
    while left > 0 {
        let records = left.min(BLOCK as u64);
        let block = &mut bytes[..records as usize * size_of::<Photon>()];
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
            found(photon);
        }
        left -= records;
    }
    Ok(())
}

fn at_end(input: &mut impl Read) -> Result<(), PhotonFileError> {
    match read_up_to(input, &mut [0])? {
        0 => Ok(()),
        _ => Err(PhotonFileError::Damaged("it goes on after its end")),
    }
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
        let contents = Contents { info, level: 2, segments, surface: 40_000, volume: 7 };
        assert!(contents.is_consistent());
        let mut filler = Filler::new(&contents, u64::MAX);
        (0..40_000).for_each(|i| filler.push(false, photon(i)));
        filler.segment = 0;
        (0..7).for_each(|i| filler.push(true, photon(i)));
        assert_eq!(filler.map.contents(), contents);
        filler.map
    }

    fn read(bytes: &[u8]) -> Result<PhotonMap, PhotonFileError> {
        PhotonMap::read_from(&mut &*bytes, bytes.len() as u64, u64::MAX)
    }

    #[test]
    fn budgets_hold_while_reading() {
        let mut bytes = Vec::new();
        map().write_to(&mut bytes).unwrap();
        for budget in [0, 5000, 100_000, 1 << 20, map().bytes(), u64::MAX] {
            let read = PhotonMap::read_from(&mut &bytes[..], bytes.len() as u64, budget).unwrap();
            let mut expected = map();
            expected.limit(budget);
            assert_eq!(read, expected, "{budget}");
        }
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
