//! The `.film` file: a film's exact sums with what is needed to continue or merge it (docs/guide/film-format.md).
//!
//! Hostile files: sizes are checked against the spec's limits, against a memory limit and against the length of the
//! file (zlib cannot expand more than 1032 times) before anything is allocated, and every part has a checksum.

use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::Arc;

use flate2::Compression;
use flate2::bufread::{ZlibDecoder, ZlibEncoder};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Film, FilmCounters, FilmError, FilmMeta, FilmSpec, Held, Layout, Rect, SQUARES, SplatSums, Splats};
use crate::image::atomic::write_atomically;

const MAGIC: [u8; 8] = *b"ETNDFILM";
/// The version of films with splats; those without are of version 1.
const VERSION: u32 = 2;
/// Magic, version, header length, header checksum.
const PREFIX: usize = 20;
/// Pixels in a block (the last may have fewer).
const BLOCK_PIXELS: usize = 4096;
/// Compressed length and checksum.
const BLOCK_PREFIX: usize = 8;
/// The largest header: what hundreds of thousands of held tiles need.
const MAX_HEADER: usize = 64 << 20;
/// Deflate codes at best 258 bytes in 2 bits; a few bytes of framing are on top.
const MAX_EXPANSION: usize = 1032;

/// The default limit on the memory that a film from a file may take: 16 GiB.
pub const DEFAULT_MEMORY_LIMIT: u64 = 16 << 30;

/// Why a film file cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilmFileError {
    /// The file system's error.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// It does not start as a film file does.
    #[error("not a film file")]
    NotAFilm,
    /// Written by a later version.
    #[error("film file of version {0}; this program reads up to version {VERSION}")]
    Version(u32),
    /// The file ends early, as after a copy that was cut off.
    #[error("film file is truncated in {0}")]
    Truncated(&'static str),
    /// Damaged or made up.
    #[error("film file is damaged: {0}")]
    Damaged(String),
    /// More memory than allowed.
    #[error("film needs {needed} bytes of memory, the limit is {limit}")]
    TooLarge {
        /// Bytes in memory.
        needed: u64,
        /// The limit.
        limit: u64,
    },
    /// The spec in the file contradicts itself.
    #[error(transparent)]
    Film(#[from] FilmError),
}

/// The JSON header.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    spec: FilmSpec,
    rect: Rect,
    meta: FilmMeta,
    held: Held,
    counters: FilmCounters,
}

impl Film {
    /// Writes the film as a file's bytes; equal films give equal bytes.
    ///
    /// # Errors
    /// Those of the writer; [`FilmError::Spec`] after [`Film::drop_squares`].
    pub fn write_to(&self, out: &mut (impl Write + ?Sized)) -> Result<(), FilmFileError> {
        if !self.has_squares() {
            return Err(FilmError::Spec("a film without sums of squares cannot be kept".into()).into());
        }
        let header = Header {
            spec: self.spec().clone(),
            rect: self.rect,
            meta: self.meta.clone(),
            held: self.held.clone(),
            counters: self.counters,
        };
        let header = serde_json::to_vec(&header).map_err(io::Error::from)?;
        out.write_all(&MAGIC)?;
        let version = if self.spec().splats { VERSION } else { 1 };
        out.write_all(&version.to_le_bytes())?;
        out.write_all(&(header.len() as u32).to_le_bytes())?;
        out.write_all(&crc32fast::hash(&header).to_le_bytes())?;
        out.write_all(&header)?;
        let splats = self.splat_sums();
        let own = self.counts.len().div_ceil(BLOCK_PIXELS);
        let blocks = own + (splats.squares.len() / SQUARES).div_ceil(BLOCK_PIXELS);
        // Some at a time: as many as keep the threads busy, without a second copy of the film in memory.
        let group = 4 * rayon::current_num_threads();
        for first in (0..blocks).step_by(group) {
            let range = first..(first + group).min(blocks);
            let packed: Vec<Vec<u8>> = range
                .into_par_iter()
                .map(|block| if block < own { self.pack_block(block) } else { pack_splats(&splats, self.layout.splats.len(), block - own) })
                .collect::<Result<_, _>>()?;
            for block in packed {
                out.write_all(&(block.len() as u32).to_le_bytes())?;
                out.write_all(&crc32fast::hash(&block).to_le_bytes())?;
                out.write_all(&block)?;
            }
        }
        Ok(())
    }

    /// Writes the film to a file that appears whole or not at all.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn save(&self, path: &Path) -> Result<(), FilmFileError> {
        write_atomically(path, |out| self.write_to(out))
    }

    /// Reads a film file of at most [`DEFAULT_MEMORY_LIMIT`] in memory.
    ///
    /// # Errors
    /// [`FilmFileError`].
    pub fn load(path: &Path) -> Result<Self, FilmFileError> {
        Self::from_bytes(&std::fs::read(path)?, DEFAULT_MEMORY_LIMIT)
    }

    /// Reads a film from a file's bytes.
    ///
    /// # Errors
    /// [`FilmFileError`]; no more than about `memory_limit` bytes are ever allocated.
    pub fn from_bytes(bytes: &[u8], memory_limit: u64) -> Result<Self, FilmFileError> {
        let (header, body) = read_header(bytes)?;
        check_values(&header)?;
        let layout = Layout::new(&header.spec)?;
        let pixels = header.rect.area();
        let splat_pixels = if header.spec.splats { header.spec.crop.area() } else { 0 };
        let (bytes, splat_bytes) = (layout.bytes_per_pixel(), layout.bytes_per_splat_pixel());
        let needed = pixels.saturating_mul(bytes as u64).saturating_add(splat_pixels.saturating_mul(splat_bytes as u64));
        if needed > memory_limit {
            return Err(FilmFileError::TooLarge { needed, limit: memory_limit });
        }
        let (blocks, behind) = split_blocks(body, pixels as usize, bytes)?;
        let (splat_blocks, behind) = split_blocks(behind, splat_pixels as usize, splat_bytes)?;
        if !behind.is_empty() {
            return Err(FilmFileError::Damaged(format!("{} bytes after its end", behind.len())));
        }
        let mut film = Self::with_layout(Arc::clone(&layout), header.rect, header.meta, true)?;
        film.held = header.held;
        film.counters = header.counters;
        film.unpack_blocks(&blocks)?;
        film.sum_splats()?;
        if let Splats::Sums(sums) = &mut film.splats {
            unpack_splats(sums, layout.splats.len(), &splat_blocks)?;
        }
        Ok(film)
    }

    fn pack_block(&self, block: usize) -> Result<Vec<u8>, io::Error> {
        let begin = block * BLOCK_PIXELS;
        let end = (begin + BLOCK_PIXELS).min(self.counts.len());
        let (means, firsts) = (self.layout.means.len(), self.layout.firsts.len());
        let mut raw = Vec::with_capacity((end - begin) * self.layout.bytes_per_pixel());
        write_planes(&mut raw, self.sums[begin * means..end * means].iter().map(|v| v.to_le_bytes()));
        write_planes(&mut raw, self.squares[begin * SQUARES..end * SQUARES].iter().map(|v| v.to_le_bytes()));
        write_planes(&mut raw, self.weights[begin..end].iter().map(|v| v.to_le_bytes()));
        write_planes(&mut raw, self.counts[begin..end].iter().map(|v| v.to_le_bytes()));
        if firsts > 0 {
            write_planes(&mut raw, self.first_indices[begin..end].iter().map(|v| v.to_le_bytes()));
            write_planes(&mut raw, self.first_values[begin * firsts..end * firsts].iter().map(|v| v.to_le_bytes()));
        }
        pack(&raw)
    }

    fn unpack_blocks(&mut self, blocks: &[&[u8]]) -> Result<(), FilmFileError> {
        let (means, firsts) = (self.layout.means.len(), self.layout.firsts.len());
        let bytes_per_pixel = self.layout.bytes_per_pixel();
        // Films without first channels have no such data; empty chunks stand in for it.
        let mut first_indices: Vec<&mut [u32]> = self.first_indices.chunks_mut(BLOCK_PIXELS).collect();
        let mut first_values: Vec<&mut [f32]> = self.first_values.chunks_mut(BLOCK_PIXELS * firsts.max(1)).collect();
        first_indices.resize_with(blocks.len(), Default::default);
        first_values.resize_with(blocks.len(), Default::default);
        let first_parts: Vec<_> = first_indices.into_iter().zip(first_values).collect();
        blocks
            .par_iter()
            .zip(self.sums.par_chunks_mut(BLOCK_PIXELS * means))
            .zip(self.squares.par_chunks_mut(BLOCK_PIXELS * SQUARES))
            .zip(self.weights.par_chunks_mut(BLOCK_PIXELS))
            .zip(self.counts.par_chunks_mut(BLOCK_PIXELS))
            .zip(first_parts)
            .try_for_each(|(((((packed, sums), squares), weights), counts), (first_indices, first_values))| {
                let raw = unpack(packed, counts.len() * bytes_per_pixel)?;
                let mut rest = &raw[..];
                read_planes(&mut rest, sums, i128::from_le_bytes);
                read_planes(&mut rest, squares, i128::from_le_bytes);
                read_planes(&mut rest, weights, i128::from_le_bytes);
                read_planes(&mut rest, counts, u32::from_le_bytes);
                read_planes(&mut rest, first_indices, u32::from_le_bytes);
                read_planes(&mut rest, first_values, f32::from_le_bytes);
                if first_values.iter().all(|v| v.is_finite()) {
                    Ok(())
                } else {
                    Err(FilmFileError::Damaged("a first value is not finite".into()))
                }
            })
    }
}

fn pack(raw: &[u8]) -> Result<Vec<u8>, io::Error> {
    let mut packed = Vec::new();
    ZlibEncoder::new(raw, Compression::fast()).read_to_end(&mut packed)?;
    Ok(packed)
}

fn unpack(packed: &[u8], size: usize) -> Result<Vec<u8>, FilmFileError> {
    let mut raw = Vec::with_capacity(size);
    ZlibDecoder::new(packed)
        .take(size as u64 + 1)
        .read_to_end(&mut raw)
        .map_err(|e| FilmFileError::Damaged(format!("a block does not decompress: {e}")))?;
    if raw.len() == size { Ok(raw) } else { Err(FilmFileError::Damaged("a block has another size than the film's".into())) }
}

/// A block of the splats of the crop's pixels.
fn pack_splats(splats: &SplatSums, channels: usize, block: usize) -> Result<Vec<u8>, io::Error> {
    let begin = block * BLOCK_PIXELS;
    let end = (begin + BLOCK_PIXELS).min(splats.squares.len() / SQUARES);
    let mut raw = Vec::new();
    write_planes(&mut raw, splats.sums[begin * channels..end * channels].iter().map(|v| v.to_le_bytes()));
    write_planes(&mut raw, splats.squares[begin * SQUARES..end * SQUARES].iter().map(|v| v.to_le_bytes()));
    pack(&raw)
}

fn unpack_splats(splats: &mut SplatSums, channels: usize, blocks: &[&[u8]]) -> Result<(), FilmFileError> {
    let chunks = splats.sums.par_chunks_mut(BLOCK_PIXELS * channels).zip(splats.squares.par_chunks_mut(BLOCK_PIXELS * SQUARES));
    blocks.par_iter().zip(chunks).try_for_each(|(packed, (sums, squares))| {
        let raw = unpack(packed, (sums.len() + squares.len()) * 16)?;
        let mut rest = &raw[..];
        read_planes(&mut rest, sums, i128::from_le_bytes);
        read_planes(&mut rest, squares, i128::from_le_bytes);
        Ok(())
    })
}

/// The pixels that a film file is about, from its header alone.
///
/// # Errors
/// [`FilmFileError`] where the bytes do not start as a film file does.
pub fn rect_of(bytes: &[u8]) -> Result<Rect, FilmFileError> {
    read_header(bytes).map(|(header, _)| header.rect)
}

/// Numbers of N bytes by planes: first the lowest byte of each, then the next. High bytes, mostly equal, compress well.
fn write_planes<const N: usize>(out: &mut Vec<u8>, numbers: impl ExactSizeIterator<Item = [u8; N]>) {
    let count = numbers.len();
    let start = out.len();
    out.resize(start + count * N, 0);
    let planes = &mut out[start..];
    for (i, number) in numbers.enumerate() {
        for (plane, byte) in number.into_iter().enumerate() {
            planes[plane * count + i] = byte;
        }
    }
}

/// The inverse of [`write_planes`]; takes its bytes from `rest`, which must hold enough.
fn read_planes<T, const N: usize>(rest: &mut &[u8], numbers: &mut [T], from_bytes: impl Fn([u8; N]) -> T) {
    let count = numbers.len();
    let (planes, behind) = rest.split_at(count * N);
    *rest = behind;
    for (i, number) in numbers.iter_mut().enumerate() {
        *number = from_bytes(std::array::from_fn(|plane| planes[plane * count + i]));
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes)
}

fn read_header(bytes: &[u8]) -> Result<(Header, &[u8]), FilmFileError> {
    if bytes.len() >= MAGIC.len() && !bytes.starts_with(&MAGIC) {
        return Err(FilmFileError::NotAFilm);
    }
    let (Some(version), Some(length), Some(crc)) = (word(bytes, 8), word(bytes, 12), word(bytes, 16)) else {
        return Err(FilmFileError::Truncated("its first bytes"));
    };
    if version == 0 || version > VERSION {
        return Err(FilmFileError::Version(version));
    }
    let length = length as usize;
    if length > MAX_HEADER {
        return Err(FilmFileError::Damaged(format!("header of {length} bytes")));
    }
    let header = bytes.get(PREFIX..PREFIX + length).ok_or(FilmFileError::Truncated("its header"))?;
    if crc32fast::hash(header) != crc {
        return Err(FilmFileError::Damaged("the header's checksum is wrong".into()));
    }
    let parsed: Header = serde_json::from_slice(header).map_err(|e| FilmFileError::Damaged(format!("header: {e}")))?;
    if parsed.spec.splats != (version == VERSION) {
        return Err(FilmFileError::Damaged("splats do not go with the version".into()));
    }
    Ok((parsed, &bytes[PREFIX + length..]))
}

/// What the types of the header cannot say.
fn check_values(header: &Header) -> Result<(), FilmFileError> {
    header.spec.validate()?;
    if header.rect.area() == 0 || !header.spec.crop.contains_rect(&header.rect) {
        return Err(FilmError::Outside { inner: header.rect, outer: header.spec.crop }.into());
    }
    let samples: Option<u64> = header.held.entries().iter().try_fold(0u64, |sum, part| {
        if !header.rect.contains_rect(&part.rect) || part.rect.area() == 0 || part.begin >= part.end {
            return None;
        }
        sum.checked_add(part.rect.area().checked_mul(u64::from(part.end - part.begin))?)
    });
    if samples.is_none_or(|s| s > header.rect.area().saturating_mul(u64::from(u32::MAX))) {
        return Err(FilmFileError::Damaged("impossible list of held samples".into()));
    }
    Ok(())
}

/// The compressed blocks of all pixels, their checksums verified and their number and sizes plausible; and what follows them.
fn split_blocks(mut body: &[u8], pixels: usize, bytes_per_pixel: usize) -> Result<(Vec<&[u8]>, &[u8]), FilmFileError> {
    let count = pixels.div_ceil(BLOCK_PIXELS);
    if body.len() < count.saturating_mul(BLOCK_PREFIX) {
        return Err(FilmFileError::Truncated("its blocks"));
    }
    let mut blocks = Vec::with_capacity(count);
    for block in 0..count {
        let (Some(length), Some(crc)) = (word(body, 0), word(body, 4)) else {
            return Err(FilmFileError::Truncated("its blocks"));
        };
        let packed = body.get(BLOCK_PREFIX..BLOCK_PREFIX + length as usize).ok_or(FilmFileError::Truncated("its blocks"))?;
        let size = (pixels - block * BLOCK_PIXELS).min(BLOCK_PIXELS) * bytes_per_pixel;
        if packed.len().saturating_mul(MAX_EXPANSION) < size {
            return Err(FilmFileError::Damaged(format!("block {block} is too short")));
        }
        if crc32fast::hash(packed) != crc {
            return Err(FilmFileError::Damaged(format!("the checksum of block {block} is wrong")));
        }
        blocks.push(packed);
        body = &body[BLOCK_PREFIX + length as usize..];
    }
    Ok((blocks, body))
}
