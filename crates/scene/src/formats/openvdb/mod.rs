//! OpenVDB files (`.vdb`): sparse grids of numbers, of which those of 32- and 64-bit floats are read into dense volumes.
//!
//! A file is a header, tables of metadata, and for each grid a description with the offset of its content. A grid's content is metadata,
//! the map from indices to the world, a tree of fixed shape – root, upper nodes of 32³ lower ones, these of 16³ leaves, these of 8³
//! values – first without the leaves' values, then these in the same order (Museth 2013, "VDB: High-Resolution Sparse Volumes with
//! Dynamic Topology", doi:10.1145/2487228.2487235). Values of a node may be packed by zlib or Blosc, have 16 bits each, and be left
//! out where they are not active. Versions 222 (OpenVDB 3, 2014) to 225 (OpenVDB 13) of the format are the same in what is read here.

mod blosc;
mod stream;

use std::io::Read;

use glam::{DMat4, DVec3};
use half::f16;

use super::grids::{DenseGrid, Filler};
use stream::Stream;

const MAGIC: i64 = 0x5644_4220;
const VERSIONS: std::ops::RangeInclusive<u32> = 222..=225;
/// Ways to pack values, as bits.
const ZIP: u32 = 1;
const ACTIVE_ONLY: u32 = 2;
const BLOSC: u32 = 4;
/// Separates a grid's name from a number that makes it unique in its file.
const SEPARATOR: u8 = 0x1e;
/// Tiles that a dense volume may need, and as many again that lie outside of it.
const MOST_TILES: usize = 1 << 21;

/// Edges of the cubes that lower nodes and leaves stand for.
const LOWER_EDGE: i64 = 128;
const LEAF_EDGE: i64 = 8;
/// Logarithms of the children along an edge.
const UPPER_LOG: u32 = 5;
const LOWER_LOG: u32 = 4;
const LEAF_LOG: u32 = 3;
const LEAF_VALUES: usize = 1 << (3 * LEAF_LOG);

/// Whether a file begins as OpenVDB's do.
pub(super) fn is_one(file: &[u8]) -> bool {
    file.starts_with(&MAGIC.to_le_bytes())
}

/// What a file says of one of its grids.
struct Descriptor<'a> {
    unique_name: &'a [u8],
    kind: &'a [u8],
    /// The grid whose tree it shows; empty where it has its own.
    parent: &'a [u8],
    start: usize,
}

impl Descriptor<'_> {
    fn name(&self) -> &[u8] {
        self.unique_name.split(|b| *b == SEPARATOR).next().unwrap_or_default()
    }
}

/// Reads the grid of a name; `None` where the file has none of it.
///
/// # Errors
/// A sentence.
pub(super) fn read(file: &[u8], name: &str) -> Result<Option<DenseGrid>, String> {
    let grids = descriptors(file)?;
    let Some(grid) = grids.iter().find(|g| g.name() == name.as_bytes()) else { return Ok(None) };
    let mut own = Stream::new(file, grid.start);
    let (mut compression, world_from_index) = head(&mut own, name)?;
    let (mut tree, mut kind) = (own, grid.kind);
    if !grid.parent.is_empty() {
        let parent = grids.iter().find(|g| g.unique_name == grid.parent && g.parent.is_empty());
        let parent = parent.ok_or_else(|| format!("the grid `{name}` shows the tree of one that the file does not have"))?;
        (tree, kind) = (Stream::new(file, parent.start), parent.kind);
        (compression, _) = head(&mut tree, name)?;
    }
    let kind_text = String::from_utf8_lossy(kind);
    let (base, is_half) = kind_text.strip_suffix("_HalfFloat").map_or((&*kind_text, false), |base| (base, true));
    let is_double = match base {
        "Tree_float_5_4_3" => false,
        "Tree_double_5_4_3" => true,
        _ => return Err(format!("the grid `{name}` is a `{base}`; only Tree_float_5_4_3 and Tree_double_5_4_3 can be read")),
    };
    let values = Values { compression, is_double, is_half, background: 0.0 };
    dense(tree, values, name).map(|filler| Some(filler.finish(world_from_index)))
}

/// The grids that a file says it has.
fn descriptors(file: &[u8]) -> Result<Vec<Descriptor<'_>>, String> {
    let mut s = Stream::new(file, 8);
    let version = s.u32()?;
    if !VERSIONS.contains(&version) {
        let (first, last) = (VERSIONS.start(), VERSIONS.end());
        return Err(format!("an OpenVDB file of format {version}; {first} (OpenVDB 3.0) to {last} can be read"));
    }
    s.take(8)?;
    let has_offsets = s.u8()? != 0;
    // The file's unique name.
    s.take(36)?;
    s.skip_metadata()?;
    let count = s.u32()?;
    if !has_offsets {
        return Err("an OpenVDB stream without the offsets of its grids; write it as a file".to_owned());
    }
    let mut grids = Vec::new();
    for _ in 0..count {
        let (unique_name, kind, parent) = (s.text()?, s.text()?, s.text()?);
        let (start, _, end) = (s.i64()?, s.i64()?, s.i64()?);
        let start = usize::try_from(start).map_err(|_| format!("a grid begins at byte {start}"))?;
        grids.push(Descriptor { unique_name, kind, parent, start });
        let end = usize::try_from(end).map_err(|_| format!("a grid ends at byte {end}"))?;
        if end < s.at() {
            return Err(format!("a grid ends at byte {end}, before its description"));
        }
        s = Stream::new(file, end);
    }
    Ok(grids)
}

/// How a grid's values are packed, and its map from indices to the world.
fn head(s: &mut Stream, name: &str) -> Result<(u32, DMat4), String> {
    let compression = s.u32()?;
    if compression & !(ZIP | ACTIVE_ONLY | BLOSC) != 0 {
        return Err(format!("the grid `{name}` is packed in an unknown way ({compression:#x})"));
    }
    s.skip_metadata()?;
    let kind = s.text()?;
    let mut vector = || Ok::<_, String>(DVec3::new(s.f64()?, s.f64()?, s.f64()?));
    let world_from_index = match kind {
        b"ScaleMap" | b"UniformScaleMap" => {
            let scale = DMat4::from_scale(vector()?);
            s.take(4 * 24)?;
            scale
        }
        b"TranslationMap" => DMat4::from_translation(vector()?),
        b"ScaleTranslateMap" | b"UniformScaleTranslateMap" => {
            let shift = DMat4::from_translation(vector()?);
            let scale = DMat4::from_scale(vector()?);
            s.take(4 * 24)?;
            shift * scale
        }
        // By rows, for rows of numbers on its left: by columns for ours.
        b"AffineMap" | b"UnitaryMap" => {
            let mut m = [0.0; 16];
            for v in &mut m {
                *v = s.f64()?;
            }
            DMat4::from_cols_array(&m)
        }
        _ => return Err(format!("the grid `{name}` is placed by a `{}`, which is not known here", String::from_utf8_lossy(kind))),
    };
    if world_from_index.is_finite() {
        Ok((compression, world_from_index))
    } else {
        Err(format!("the place of the grid `{name}` is not finite"))
    }
}

/// How values are stored.
struct Values {
    compression: u32,
    is_double: bool,
    /// Those of nodes have 16 bits; single ones never do.
    is_half: bool,
    background: f32,
}

fn is_on(mask: &[u8], i: usize) -> bool {
    mask[i / 8] >> (i % 8) & 1 == 1
}

impl Values {
    /// One value.
    fn single(&self, s: &mut Stream) -> Result<f32, String> {
        if self.is_double { s.f64().map(|v| v as f32) } else { s.u32().map(f32::from_bits) }
    }

    /// The values of a node, one for each bit of the mask of active ones.
    fn node(&self, s: &mut Stream, active: &[u8], out: &mut Vec<f32>) -> Result<(), String> {
        let at = s.at();
        let way = s.u8()?;
        // Values that are not active and left out: one or two kinds of them, between which a mask chooses.
        let mut inactive = [if way == 0 { self.background } else { -self.background }, self.background];
        match way {
            0 | 1 | 3 | 6 => {}
            2 | 4 => inactive[0] = self.single(s)?,
            5 => inactive = [self.single(s)?, self.single(s)?],
            _ => return Err(format!("values at byte {at} are kept in the unknown way {way}")),
        }
        let chooses = if (3..=5).contains(&way) { Some(s.take(active.len() as u64)?) } else { None };
        let all = 8 * active.len();
        let leaves_out = self.compression & ACTIVE_ONLY != 0 && way != 6;
        let count = if leaves_out { active.iter().map(|b| b.count_ones() as usize).sum() } else { all };
        out.clear();
        self.packed(s, count, out)?;
        if count == all {
            return Ok(());
        }
        // From the last one on, so that values which move do not overwrite others.
        out.resize(all, 0.0);
        let mut next = count;
        for i in (0..all).rev() {
            out[i] = if is_on(active, i) {
                next -= 1;
                out[next]
            } else {
                inactive[usize::from(chooses.is_some_and(|mask| is_on(mask, i)))]
            };
        }
        Ok(())
    }

    /// Appends so many values, packed or not.
    fn packed(&self, s: &mut Stream, count: usize, out: &mut Vec<f32>) -> Result<(), String> {
        let value_size = if self.is_half {
            2
        } else if self.is_double {
            8
        } else {
            4
        };
        if count == 0 && self.is_half {
            return Ok(());
        }
        let (at, size) = (s.at(), count * value_size);
        let unpacked;
        let bytes = if self.compression & (ZIP | BLOSC) == 0 {
            s.take(size as u64)?
        } else {
            let packed = s.i64()?;
            if packed <= 0 {
                if packed.unsigned_abs() != size as u64 {
                    return Err(format!("values at byte {at} have {} bytes instead of {size}", packed.unsigned_abs()));
                }
                s.take(size as u64)?
            } else {
                let chunk = s.take(packed.unsigned_abs())?;
                let result = if self.compression & BLOSC != 0 { blosc::unpack(chunk, size) } else { unzip(chunk, size) };
                unpacked = result.map_err(|e| format!("values at byte {at}: {e}"))?;
                &unpacked
            }
        };
        match value_size {
            2 => out.extend(bytes.as_chunks().0.iter().map(|b| f16::from_le_bytes(*b).to_f32())),
            8 => out.extend(bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b) as f32)),
            _ => out.extend(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b))),
        }
        Ok(())
    }
}

fn unzip(chunk: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let mut out = vec![0; size];
    flate2::read::ZlibDecoder::new(chunk).read_exact(&mut out).map_err(|e| format!("a zip stream cannot be unpacked: {e}"))?;
    Ok(out)
}

/// A cube of one value.
struct Tile {
    origin: [i64; 3],
    edge: i64,
    value: f32,
}

/// What lies in a box of indices that grows.
struct Extent {
    min: [i64; 3],
    max: [i64; 3],
}

impl Extent {
    fn add(&mut self, min: [i64; 3], max: [i64; 3]) {
        for k in 0..3 {
            self.min[k] = self.min[k].min(min[k]);
            self.max[k] = self.max[k].max(max[k]);
        }
    }
}

/// The tree but for the values of its leaves.
struct Topology<'a> {
    tiles: Vec<Tile>,
    /// Where they begin, and which of their values are active.
    leaves: Vec<([i64; 3], &'a [u8])>,
    active: Extent,
}

impl<'a> Topology<'a> {
    fn add_tile(&mut self, origin: [i64; 3], edge: i64, value: f32, is_active: bool, background: f32) -> Result<(), String> {
        if is_active {
            self.active.add(origin, origin.map(|v| v + edge - 1));
        } else if value == background {
            return Ok(());
        }
        if self.tiles.len() == MOST_TILES {
            return Err(format!("a grid with more than {MOST_TILES} tiles"));
        }
        self.tiles.push(Tile { origin, edge, value });
        Ok(())
    }

    fn add_leaf(&mut self, origin: [i64; 3], mask: &'a [u8]) {
        for i in (0..LEAF_VALUES).filter(|i| is_on(mask, *i)) {
            let at = position(origin, i, LEAF_LOG, 1);
            self.active.add(at, at);
        }
        self.leaves.push((origin, mask));
    }

    /// An inner node's own part: adds its tiles, and returns the origins of its children.
    fn inner(&mut self, s: &mut Stream, values: &Values, (log, edge): (u32, i64), origin: [i64; 3]) -> Result<Vec<[i64; 3]>, String> {
        let bits = 1usize << (3 * log);
        let (children, active) = (s.take(bits as u64 / 8)?, s.take(bits as u64 / 8)?);
        let mut table = Vec::new();
        values.node(s, active, &mut table)?;
        let mut below = Vec::new();
        for (i, &value) in table.iter().enumerate() {
            let at = position(origin, i, log, edge);
            if is_on(children, i) {
                below.push(at);
            } else {
                self.add_tile(at, edge, value, is_on(active, i), values.background)?;
            }
        }
        Ok(below)
    }
}

/// Where entry `i` of a node begins, of which each stands for a cube of so many values; z goes fastest.
fn position(origin: [i64; 3], i: usize, log: u32, edge: i64) -> [i64; 3] {
    let axis = |shift: u32| ((i >> shift) & ((1 << log) - 1)) as i64 * edge;
    [origin[0] + axis(2 * log), origin[1] + axis(log), origin[2] + axis(0)]
}

fn dense(mut s: Stream, mut values: Values, name: &str) -> Result<Filler, String> {
    let buffers = s.u32()?;
    if buffers != 1 {
        return Err(format!("the tree of the grid `{name}` has {buffers} sets of values; only one can be read"));
    }
    values.background = values.single(&mut s)?;
    let (tiles, children) = (s.u32()?, s.u32()?);
    let active = Extent { min: [i64::MAX; 3], max: [i64::MIN; 3] };
    let mut tree = Topology { tiles: Vec::new(), leaves: Vec::new(), active };
    for _ in 0..tiles {
        let (origin, value) = (s.coord()?, values.single(&mut s)?);
        let is_active = s.u8()? != 0;
        tree.add_tile(origin, LOWER_EDGE << UPPER_LOG, value, is_active, values.background)?;
    }
    for _ in 0..children {
        let origin = s.coord()?;
        for lower in tree.inner(&mut s, &values, (UPPER_LOG, LOWER_EDGE), origin)? {
            for leaf in tree.inner(&mut s, &values, (LOWER_LOG, LEAF_EDGE), lower)? {
                tree.add_leaf(leaf, s.take(LEAF_VALUES as u64 / 8)?);
            }
        }
    }
    if tree.active.min[0] > tree.active.max[0] {
        return Err(format!("the grid `{name}` has no active values"));
    }
    let mut filler = Filler::new(name, tree.active.min, tree.active.max, values.background)?;
    for tile in &tree.tiles {
        if filler.meets(tile.origin, tile.edge) {
            filler.fill(tile.origin, tile.edge, tile.value)?;
        }
    }
    let mut buffer = Vec::new();
    for (origin, mask) in tree.leaves {
        filler.count(LEAF_VALUES as u64)?;
        s.take(LEAF_VALUES as u64 / 8)?;
        values.node(&mut s, mask, &mut buffer)?;
        if filler.meets(origin, LEAF_EDGE) {
            for (i, value) in buffer.iter().enumerate() {
                filler.fill(position(origin, i, LEAF_LOG, 1), 1, *value)?;
            }
        }
    }
    Ok(filler)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Written by OpenVDB 10.0.1: `tests/data/openvdb/make.cc`.
    const PACKED_BY_BLOSC: &[u8] = include_bytes!("../../../tests/data/openvdb/grid-blosc.vdb");
    const HALVES_IN_ZIP: &[u8] = include_bytes!("../../../tests/data/openvdb/grid-half-zip.vdb");

    /// What `make.cc` puts at an index.
    fn value(i: i64, j: i64, k: i64) -> f32 {
        if (16..24).contains(&i) && (0..8).contains(&j) && (8..16).contains(&k) {
            return 0.75;
        }
        match [i, j, k] {
            [3, 3, 4] => return 7.0,
            [3, 3, 5] => return 8.0,
            _ => {}
        }
        let (i, j, k) = (i - 1, j - 2, k - 3);
        let is_set = (0..12).contains(&i) && (0..9).contains(&j) && (0..10).contains(&k) && (i * 7 + j * 5 + k * 3) % 4 != 0;
        if is_set { 0.125 * i as f32 + 0.5 * j as f32 + 0.25 * k as f32 + 1.0 } else { 0.0 }
    }

    #[test]
    fn every_value_is_where_openvdb_put_it() {
        for file in [PACKED_BY_BLOSC, HALVES_IN_ZIP] {
            let grid = read(file, "density").unwrap().unwrap();
            // Indices 1 to 23, 0 to 10 and 3 to 15, and the border.
            assert_eq!(grid.size, [25, 13, 15]);
            let [nx, ny, _] = grid.size.map(|n| n as usize);
            for (at, found) in grid.data.iter().enumerate() {
                let (i, j, k) = (at % nx, at / nx % ny, at / nx / ny);
                let expected = value(i as i64, j as i64 - 1, k as i64 + 2);
                assert_eq!(*found, expected, "{i} {j} {k}");
            }
            assert_eq!(read(file, "temperature"), Ok(None));
        }
    }

    #[test]
    fn grids_are_placed_by_their_maps() {
        let place = |file| {
            let grid: DenseGrid = read(file, "density").unwrap().unwrap();
            // The middle of the value with the indices 1, 0, 3.
            let at = DVec3::new(1.5 / 25.0, 1.5 / 13.0, 1.5 / 15.0);
            let step = DVec3::new(1.0 / 25.0, 1.0 / 13.0, 0.0);
            (grid.world_from_volume.transform_point3(at), grid.world_from_volume.transform_vector3(step))
        };
        let is = |a: DVec3, b: [f64; 3]| assert!((a - DVec3::from_array(b)).length() < 1e-12, "{a} instead of {b:?}");
        let (p, step) = place(PACKED_BY_BLOSC);
        is(p, [1.2, 2.1, 3.9]);
        is(step, [0.1, 0.3, 0.0]);
        let (p, step) = place(HALVES_IN_ZIP);
        is(p, [0.5, 0.0, 1.5]);
        is(step, [0.5, 0.5, 0.0]);
    }

    #[test]
    fn broken_files_are_refused() {
        for good in [PACKED_BY_BLOSC, HALVES_IN_ZIP] {
            for n in (8..good.len()).step_by(61).chain([good.len() - 1]) {
                let error = read(&good[..n], "density").unwrap_err();
                assert!(error.contains("byte"), "{error}");
            }
            // Any byte may be anything; large boxes take time to fill.
            for at in (8..1400).chain((1400..good.len()).step_by(37)) {
                for flip in [0x01, 0xa5] {
                    let mut bytes = good.to_vec();
                    bytes[at] ^= flip;
                    let _ = read(&bytes, "density");
                }
            }
        }
        let with_version = |v: u8| [&PACKED_BY_BLOSC[..8], &[v], &PACKED_BY_BLOSC[9..]].concat();
        assert!(read(&with_version(218), "density").unwrap_err().contains("format 218"));
        assert!(read(&with_version(225), "density").is_ok());
    }
}
