//! NanoVDB files (`.nvdb`): sparse grids of numbers, of which those of 32-bit floats are read into dense volumes.
//!
//! A file is a sequence of segments: a header of 16 bytes (magic, version, number of grids, codec), the grids' metadata (176 bytes and a name
//! each), then the grids, packed by zlib or not. A grid is a tree of fixed shape – root, upper nodes of 32³ lower ones, these of 16³
//! leaves, these of 8³ values – whose nodes refer to each other by offsets in bytes. Offsets are those of versions 32.3 and later (Museth 2021,
//! "NanoVDB: A GPU-Friendly and Portable VDB Data Structure", doi:10.1145/3450623.3464653).

use std::io::Read;

use glam::{DMat3, DMat4, DVec3};

use super::grids::{DenseGrid, Filler};
use crate::desc::VOLUME_LIMIT;

const FILE_MAGICS: [&[u8]; 2] = [b"NanoVDB0", b"NanoVDB2"];
const META_SIZE: usize = 176;
const GRID_SIZE: usize = 672;
/// Bytes with bounds.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn array<const N: usize>(&self, at: u64) -> Result<[u8; N], String> {
        let at = usize::try_from(at).map_err(|_| ENDS.to_owned())?;
        let end = at.checked_add(N).ok_or(ENDS)?;
        self.0.get(at..end).and_then(|b| b.try_into().ok()).ok_or_else(|| ENDS.to_owned())
    }

    fn u16(&self, at: u64) -> Result<u16, String> {
        self.array(at).map(u16::from_le_bytes)
    }

    fn u32(&self, at: u64) -> Result<u32, String> {
        self.array(at).map(u32::from_le_bytes)
    }

    fn u64(&self, at: u64) -> Result<u64, String> {
        self.array(at).map(u64::from_le_bytes)
    }

    fn f32(&self, at: u64) -> Result<f32, String> {
        self.array(at).map(f32::from_le_bytes)
    }

    fn f64(&self, at: u64) -> Result<f64, String> {
        self.array(at).map(f64::from_le_bytes)
    }

    fn bit(&self, mask: u64, i: u64) -> Result<bool, String> {
        let [byte] = self.array::<1>(mask.saturating_add(i / 8))?;
        Ok(byte >> (i % 8) & 1 == 1)
    }
}

const ENDS: &str = "the file ends within a grid";

/// Reads the grid of a name; `None` where the file has none of it.
///
/// # Errors
/// A sentence.
pub(super) fn read(file: &[u8], name: &str) -> Result<Option<DenseGrid>, String> {
    let bytes = Bytes(file);
    let mut at = 0u64;
    while at < file.len() as u64 {
        let magic: [u8; 8] = bytes.array(at)?;
        if !FILE_MAGICS.contains(&magic.as_slice()) {
            return Err("no NanoVDB file of segments: it does not begin with NanoVDB0 or NanoVDB2".to_owned());
        }
        let count = bytes.u16(at + 12)?;
        at += 16;
        let mut grids = Vec::new();
        for _ in 0..count {
            let (grid_size, file_size, kind) = (bytes.u64(at)?, bytes.u64(at + 8)?, bytes.u32(at + 32)?);
            let (name_size, codec) = (u64::from(bytes.u32(at + 136)?), bytes.u16(at + 168)?);
            at += META_SIZE as u64;
            let end = at.checked_add(name_size).ok_or(ENDS)?;
            let grid_name = usize::try_from(end).ok().and_then(|end| file.get(at as usize..end)).ok_or(ENDS)?;
            let is_wanted = grid_name.split(|b| *b == 0).next() == Some(name.as_bytes());
            at = end;
            grids.push((is_wanted, grid_size, file_size, kind, codec));
        }
        for (is_wanted, grid_size, file_size, kind, codec) in grids {
            let end = at.checked_add(file_size).ok_or(ENDS)?;
            let packed = usize::try_from(end).ok().and_then(|end| file.get(at as usize..end)).ok_or(ENDS)?;
            at = end;
            if !is_wanted {
                continue;
            }
            if kind != 1 {
                return Err(format!("the grid `{name}` holds values of type {kind}; only 32-bit floats (type 1) can be read"));
            }
            let unpacked;
            let grid = match codec {
                0 => packed,
                1 => {
                    unpacked = unzip(packed, grid_size)?;
                    &unpacked
                }
                _ => return Err(format!("the grid `{name}` is packed by codec {codec}; only none (0) and zip (1) can be read")),
            };
            return dense(&Bytes(grid), name).map(Some);
        }
    }
    Ok(None)
}

fn unzip(packed: &[u8], size: u64) -> Result<Vec<u8>, String> {
    // The dense copy will be limited; the tree is about as large.
    if size > 8 * VOLUME_LIMIT {
        return Err(format!("a grid of {size} bytes is too large"));
    }
    let mut out = Vec::new();
    let stream = packed.get(8..).ok_or(ENDS)?;
    flate2::read::ZlibDecoder::new(stream).take(size).read_to_end(&mut out).map_err(|e| format!("a grid cannot be unpacked: {e}"))?;
    if (out.len() as u64) < size { Err(ENDS.to_owned()) } else { Ok(out) }
}

/// The kinds of inner nodes: logarithms of the children along an edge and of the values along a child's edge, and offsets in a node.
#[derive(Clone, Copy)]
struct Level {
    children_log2: u32,
    child_log2: u32,
    child_mask: u64,
    table: u64,
}

const UPPER: Level = Level { children_log2: 5, child_log2: 7, child_mask: 4128, table: 8256 };
const LOWER: Level = Level { children_log2: 4, child_log2: 3, child_mask: 544, table: 1088 };
const LEAF_TABLE: u64 = 96;

fn dense(grid: &Bytes, name: &str) -> Result<DenseGrid, String> {
    let version = grid.u32(16)?;
    if version >> 21 != 32 {
        return Err(format!("the grid `{name}` has version {}; only 32 is known", version >> 21));
    }
    // The map from indices to the world in double precision: a matrix by rows, its inverse, a shift.
    let map = 296 + 88;
    let m = |i: u64| grid.f64(map + 8 * i);
    let rows = [DVec3::new(m(0)?, m(1)?, m(2)?), DVec3::new(m(3)?, m(4)?, m(5)?), DVec3::new(m(6)?, m(7)?, m(8)?)];
    let shift = DVec3::new(m(18)?, m(19)?, m(20)?);
    let world_from_index = DMat4::from_translation(shift) * DMat4::from_mat3(DMat3::from_cols(rows[0], rows[1], rows[2]).transpose());

    let root = GRID_SIZE as u64 + grid.u64(GRID_SIZE as u64 + 24)?.min(1 << 48);
    let corner = |i: u64| grid.u32(root + 4 * i).map(|v| i64::from(v as i32));
    let (min, max) = ([corner(0)?, corner(1)?, corner(2)?], [corner(3)?, corner(4)?, corner(5)?]);
    let tiles = u64::from(grid.u32(root + 24)?);
    let mut filler = Filler::new(name, min, max, grid.f32(root + 28)?)?;
    for i in 0..tiles {
        filler.count(1)?;
        let tile = root + 64 + 32 * i;
        let key = grid.u64(tile)?;
        let part = |shift: u32| i64::from((((key >> shift) & 0x1f_ffff) as u32).wrapping_shl(12) as i32);
        let origin = [part(42), part(21), part(0)];
        let child = grid.u64(tile + 8)?;
        if !filler.meets(origin, 4096) {
            continue;
        }
        if child == 0 {
            filler.fill(origin, 4096, grid.f32(tile + 20)?)?;
        } else {
            inner(grid, UPPER, Some(LOWER), root.wrapping_add(child), origin, &mut filler)?;
        }
    }
    Ok(filler.finish(world_from_index))
}

/// Goes through an inner node; `below` is the level of its children, `None` for leaves.
fn inner(grid: &Bytes, level: Level, below: Option<Level>, node: u64, origin: [i64; 3], filler: &mut Filler) -> Result<(), String> {
    let log = level.children_log2;
    let edge = 1i64 << level.child_log2;
    filler.count(1 << (3 * log))?;
    for i in 0..1u64 << (3 * log) {
        let axis = |shift: u32| ((i >> shift) & ((1 << log) - 1)) as i64 * edge;
        let at = [origin[0] + axis(2 * log), origin[1] + axis(log), origin[2] + axis(0)];
        if !filler.meets(at, edge) {
            continue;
        }
        let entry = node.checked_add(level.table + 8 * i).ok_or(ENDS)?;
        if !grid.bit(node.saturating_add(level.child_mask), i)? {
            filler.fill(at, edge, grid.f32(entry)?)?;
            continue;
        }
        let child = node.wrapping_add(grid.u64(entry)?);
        match below {
            Some(below) => inner(grid, below, None, child, at, filler)?,
            None => leaf(grid, child, at, filler)?,
        }
    }
    Ok(())
}

fn leaf(grid: &Bytes, node: u64, origin: [i64; 3], filler: &mut Filler) -> Result<(), String> {
    filler.count(512)?;
    for i in 0..512u64 {
        let at = [origin[0] + (i >> 6) as i64, origin[1] + (i >> 3 & 7) as i64, origin[2] + (i & 7) as i64];
        if filler.meets(at, 1) {
            let value = node.checked_add(LEAF_TABLE + 4 * i).ok_or(ENDS)?;
            filler.fill(at, 1, grid.f32(value)?)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// A file with one grid whose leaf at the origin (and one before it) hold 1 + the leaf's index of the value, below one tile of 0.25.
    fn file(name: &str, codec: u16) -> Vec<u8> {
        let mut grid = vec![0u8; GRID_SIZE + 64];
        let put = |g: &mut Vec<u8>, at: usize, bytes: &[u8]| {
            if g.len() < at + bytes.len() {
                g.resize(at + bytes.len(), 0);
            }
            g[at..at + bytes.len()].copy_from_slice(bytes);
        };
        put(&mut grid, 0, b"NanoVDB0");
        put(&mut grid, 16, &(32u32 << 21 | 3 << 10).to_le_bytes());
        for (i, v) in [0.5f64, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5].iter().enumerate() {
            put(&mut grid, 296 + 88 + 8 * i, &v.to_le_bytes());
        }
        put(&mut grid, 296 + 88 + 8 * 18, &10.0f64.to_le_bytes());
        let root = GRID_SIZE + 64;
        put(&mut grid, GRID_SIZE + 24, &64u64.to_le_bytes());
        for (i, v) in [0i32, 0, 0, 15, 7, 7].iter().enumerate() {
            put(&mut grid, root + 4 * i, &v.to_le_bytes());
        }
        put(&mut grid, root + 24, &1u32.to_le_bytes());
        let (tile, upper) = (root + 64, root + 96);
        put(&mut grid, tile + 8, &96u64.to_le_bytes());
        let lower = upper + 8256 + 8 * 32768;
        put(&mut grid, upper + 4128, &[1]);
        put(&mut grid, upper + 8256, &((lower - upper) as u64).to_le_bytes());
        let leaf = lower + 1088 + 8 * 4096;
        put(&mut grid, lower + 544, &[1]);
        put(&mut grid, lower + 1088, &((leaf - lower) as u64).to_le_bytes());
        // The child at x = 8: number 1 << 8.
        put(&mut grid, lower + 1088 + 8 * 256, &0.25f32.to_le_bytes());
        for i in 0..512 {
            put(&mut grid, leaf + 96 + 4 * i, &(1.0 + i as f32).to_le_bytes());
        }
        let mut packed = Vec::new();
        if codec == 1 {
            let mut z = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
            z.write_all(&grid).unwrap();
            let z = z.finish().unwrap();
            packed.extend((z.len() as u64).to_le_bytes());
            packed.extend(z);
        } else {
            packed.clone_from(&grid);
        }
        let mut out = b"NanoVDB0".to_vec();
        out.extend((32u32 << 21 | 3 << 10).to_le_bytes());
        out.extend(1u16.to_le_bytes());
        out.extend(codec.to_le_bytes());
        let mut meta = vec![0u8; META_SIZE];
        meta[0..8].copy_from_slice(&(grid.len() as u64).to_le_bytes());
        meta[8..16].copy_from_slice(&(packed.len() as u64).to_le_bytes());
        meta[32..36].copy_from_slice(&1u32.to_le_bytes());
        meta[136..140].copy_from_slice(&(name.len() as u32 + 1).to_le_bytes());
        meta[168..170].copy_from_slice(&codec.to_le_bytes());
        out.extend(meta);
        out.extend(name.as_bytes());
        out.push(0);
        out.extend(packed);
        out
    }

    #[test]
    fn leaves_and_tiles_are_where_the_tree_says() {
        for codec in [0, 1] {
            let file = file("density", codec);
            let grid = read(&file, "density").unwrap().unwrap();
            assert_eq!(grid.size, [18, 10, 10]);
            let value = |x: usize, y: usize, z: usize| grid.data[(z * 10 + y) * 18 + x];
            // With the border of one: index (i, j, k) is at (i + 1, j + 1, k + 1).
            assert_eq!((value(0, 5, 5), value(1, 1, 1), value(1, 1, 2), value(1, 2, 1), value(2, 1, 1)), (0.0, 1.0, 2.0, 9.0, 65.0));
            assert_eq!((value(8, 8, 8), value(9, 1, 1), value(16, 8, 8), value(17, 5, 5)), (512.0, 0.25, 0.25, 0.0));
            // Index 0 is at the world's (10, 0, 0); values are half a unit apart.
            let middle = DVec3::new(1.5 / 18.0, 0.15, 0.15);
            assert!((grid.world_from_volume.transform_point3(middle) - DVec3::new(10.0, 0.0, 0.0)).length() < 1e-9);
            assert_eq!(read(&file, "temperature"), Ok(None));
        }
    }

    #[test]
    fn broken_files_are_refused() {
        assert!(read(&file("density", 2), "density").unwrap_err().contains("codec 2"));
        let good = file("density", 0);
        for n in [4, 15, 40, 180, 200, 900, 1500, 9000, good.len() - 1] {
            assert!(read(&good[..n], "density").is_err(), "{n}");
        }
        // Any byte of the grid's header, root and first entries may be anything.
        for at in (200..1200).step_by(3) {
            let mut bytes = good.clone();
            bytes[at] ^= 0xa5;
            let _ = read(&bytes, "density");
        }
    }
}
