//! Mitsuba's `.serialized` meshes, versions 3 and 4: zlib streams, with their offsets at the end of the file.

use std::io::Read;

use flate2::read::ZlibDecoder;
use glam::{Vec2, Vec3};

use super::{COUNT_LIMIT, MeshFault, ParsedMesh};
use crate::desc::MeshAttribute;

const MAGIC: u16 = 0x041C;
const HAS_NORMALS: u32 = 0x0001;
const HAS_UVS: u32 = 0x0002;
const HAS_COLORS: u32 = 0x0008;
const DOUBLE: u32 = 0x2000;
/// zlib cannot shrink data further than this.
const LARGEST_RATIO: u64 = 1032;

/// Most numbers for which memory is reserved before they are there.
const RESERVE_LIMIT: u64 = 1 << 22;

/// How many meshes a file says that it holds; 0 where it is too short to say.
pub fn count(bytes: &[u8]) -> u32 {
    bytes.last_chunk::<4>().map_or(0, |b| u32::from_le_bytes(*b))
}

/// Reads the mesh of a number, from 0.
///
/// # Errors
/// [`MeshFault`] where the file is no such file, ends early, or has no mesh of that number.
pub fn parse(bytes: &[u8], index: u32) -> Result<ParsedMesh, MeshFault> {
    let fail = |message: String| Err(MeshFault::binary(message));
    let u16_at = |at: usize| bytes.get(at..at + 2).map(|b| u16::from_le_bytes([b[0], b[1]]));
    if u16_at(0) != Some(MAGIC) {
        return fail("not a serialized mesh of Mitsuba".to_owned());
    }
    let version = u16_at(2).unwrap_or(0);
    if version != 3 && version != 4 {
        return fail(format!("version {version} of serialized meshes is not known"));
    }
    let offset_size = if version == 4 { 8 } else { 4 };
    let Some(end) = bytes.len().checked_sub(4) else { return fail("the file ends within its header".to_owned()) };
    let count = u32::from_le_bytes([bytes[end], bytes[end + 1], bytes[end + 2], bytes[end + 3]]);
    let Some(table) = (end as u64).checked_sub(u64::from(count) * offset_size as u64) else {
        return fail(format!("the table of {count} meshes does not fit into the file"));
    };
    if index >= count {
        return fail(format!("there is no mesh {index}; the file has {count}"));
    }
    let offset_at = |i: u32| {
        let at = table as usize + i as usize * offset_size;
        let mut b = [0u8; 8];
        b[..offset_size].copy_from_slice(&bytes[at..at + offset_size]);
        u64::from_le_bytes(b)
    };
    let start = offset_at(index);
    let stop = if index + 1 < count { offset_at(index + 1) } else { table };
    if stop > table || start.saturating_add(4) > stop {
        return fail(format!("mesh {index} lies outside the file"));
    }
    // Each mesh repeats magic and version.
    let stream = &bytes[start as usize + 4..stop as usize];
    let mut reader = Stream { limit: stream.len() as u64 * LARGEST_RATIO, decoder: ZlibDecoder::new(stream), index };
    mesh(&mut reader, version)
}

struct Stream<'b> {
    decoder: ZlibDecoder<&'b [u8]>,
    /// The most bytes that can come out.
    limit: u64,
    index: u32,
}

impl Stream<'_> {
    fn exact(&mut self, out: &mut [u8]) -> Result<(), MeshFault> {
        self.decoder.read_exact(out).map_err(|e| MeshFault::binary(format!("mesh {} ends early or is damaged: {e}", self.index)))
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], MeshFault> {
        let mut b = [0; N];
        self.exact(&mut b)?;
        Ok(b)
    }

    /// `count` numbers, single or double.
    fn floats(&mut self, count: u64, double: bool) -> Result<Vec<f32>, MeshFault> {
        let size = if double { 8 } else { 4 };
        if count.saturating_mul(size) > self.limit {
            return Err(MeshFault::binary(format!("mesh {}: {count} numbers cannot be in this file", self.index)));
        }
        let mut out = Vec::with_capacity(count.min(RESERVE_LIMIT) as usize);
        let mut chunk = vec![0u8; 1 << 16];
        let mut left = (count * size) as usize;
        while left > 0 {
            let n = left.min(chunk.len());
            self.exact(&mut chunk[..n])?;
            if double {
                out.extend(chunk[..n].as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b) as f32));
            } else {
                out.extend(chunk[..n].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)));
            }
            left -= n;
        }
        Ok(out)
    }
}

fn mesh(s: &mut Stream, version: u16) -> Result<ParsedMesh, MeshFault> {
    let flags = u32::from_le_bytes(s.array()?);
    if version == 4 {
        // The name, up to a zero byte.
        let mut length = 0;
        while s.array::<1>()? != [0] {
            length += 1;
            if length > 1 << 16 {
                return Err(MeshFault::binary(format!("mesh {}: its name does not end", s.index)));
            }
        }
    }
    let vertices = u64::from_le_bytes(s.array()?);
    let triangles = u64::from_le_bytes(s.array()?);
    if vertices > COUNT_LIMIT || triangles > COUNT_LIMIT {
        return Err(MeshFault::binary(format!("mesh {}: {vertices} vertices or {triangles} triangles are too many", s.index)));
    }
    let double = flags & DOUBLE != 0;
    let vec3s = |v: Vec<f32>| v.as_chunks::<3>().0.iter().map(|c| Vec3::from_array(*c)).collect::<Vec<_>>();
    let mut parsed = ParsedMesh::default();
    let data = &mut parsed.data;
    data.positions = vec3s(s.floats(vertices * 3, double)?);
    if flags & HAS_NORMALS != 0 {
        data.normals = vec3s(s.floats(vertices * 3, double)?);
        for n in data.normals.iter_mut().filter(|n| n.is_finite()) {
            *n = n.normalize_or_zero();
        }
    }
    if flags & HAS_UVS != 0 {
        data.uvs = s.floats(vertices * 2, double)?.as_chunks::<2>().0.iter().map(|c| Vec2::from_array(*c)).collect();
    }
    if flags & HAS_COLORS != 0 {
        let values = s.floats(vertices * 3, double)?;
        data.attributes.push(MeshAttribute { name: "color".to_owned(), per_face: false, width: 3, data: values });
    }
    // As many bytes as that many floats.
    let indices = s.floats(triangles * 3, false)?;
    data.triangles.reserve_exact(triangles as usize);
    for (i, corner) in indices.as_chunks::<3>().0.iter().enumerate() {
        let triangle = corner.map(f32::to_bits);
        if let Some(v) = triangle.iter().find(|v| u64::from(**v) >= vertices) {
            return Err(MeshFault::binary(format!("mesh {}: triangle {i}: there is no vertex {v}, only {vertices}", s.index)));
        }
        data.triangles.push(triangle);
    }
    Ok(parsed)
}
