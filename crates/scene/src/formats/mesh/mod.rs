//! Readers of triangle meshes: as parts of a scene ([`load`]) and as scenes of their own ([`read`]).

mod mtl;
pub mod obj;
pub mod ply;
pub mod ply_write;
mod serialized;
mod stl;

use std::path::{Path, PathBuf};

use glam::{Mat4, Vec2};

use super::ReadOptions;
use crate::desc::{AddNode, GeometryDesc, MeshData, MeshDesc, MeshFormat, Node, SceneDesc, ShapeDesc};
use crate::formats::Resolver;
use crate::formats::resolver::FILE_SIZE_LIMIT;
use crate::report::ReadError;
use crate::span::{FileId, Span};

/// The most vertices or triangles of a mesh: indices have 32 bits.
pub const COUNT_LIMIT: u64 = u32::MAX as u64;

/// Most meshes that are read of one `.serialized` file opened as a scene.
const SERIALIZED_LIMIT: u32 = 10_000;

/// Why a mesh file cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct MeshFault {
    /// Line from 1; 0 where the place is told in the message.
    pub line: u32,
    /// What is wrong.
    pub message: String,
}

impl MeshFault {
    /// A fault at a line of a text file.
    pub fn at(line: u32, message: impl Into<String>) -> Self {
        Self { line, message: message.into() }
    }

    /// A fault in binary data.
    pub fn binary(message: impl Into<String>) -> Self {
        Self { line: 0, message: message.into() }
    }
}

/// A mesh and what is odd about it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParsedMesh {
    /// The triangles.
    pub data: MeshData,
    /// Oddities that were put right.
    pub warnings: Vec<String>,
}

/// Reads one mesh file of a scene.
///
/// # Errors
/// [`MeshFault`] with a line where the format has lines.
pub fn load(path: &Path, format: MeshFormat, index: u32) -> Result<ParsedMesh, MeshFault> {
    let bytes = inflated(Resolver::read(path).map_err(|e| MeshFault::binary(e.to_string()))?)?;
    parse(&bytes, format, index)
}

/// The contents of a file that may be compressed by gzip, as pbrt's scenes have `.ply.gz`.
///
/// # Errors
/// [`MeshFault`] where the compressed data are broken or hold more than [`FILE_SIZE_LIMIT`] bytes.
pub(crate) fn inflated(bytes: Vec<u8>) -> Result<Vec<u8>, MeshFault> {
    use std::io::Read;
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let mut out = Vec::new();
    let read = flate2::read::MultiGzDecoder::new(bytes.as_slice()).take(FILE_SIZE_LIMIT + 1).read_to_end(&mut out);
    match read {
        Ok(n) if n as u64 <= FILE_SIZE_LIMIT => Ok(out),
        Ok(_) => Err(MeshFault::binary("more than 4 GiB after decompression")),
        Err(e) => Err(MeshFault::binary(format!("broken gzip data: {e}"))),
    }
}

/// Reads one mesh from the bytes of a file.
///
/// # Errors
/// [`MeshFault`] with a line where the format has lines.
pub fn parse(bytes: &[u8], format: MeshFormat, index: u32) -> Result<ParsedMesh, MeshFault> {
    let mut parsed = match format {
        MeshFormat::Ply => ply::parse(bytes)?,
        MeshFormat::Obj => obj::parse(bytes)?.merged(),
        MeshFormat::Stl => stl::parse(bytes)?,
        MeshFormat::MitsubaSerialized => serialized::parse(bytes, index)?,
    };
    drop_broken_triangles(&mut parsed);
    Ok(parsed)
}

/// Turns v round.
pub fn flip_v(data: &mut MeshData) {
    for Vec2 { y, .. } in &mut data.uvs {
        *y = 1.0 - *y;
    }
}

/// Leaves out triangles with a vertex that has no finite position, and counts them.
fn drop_broken_triangles(parsed: &mut ParsedMesh) {
    let data = &mut parsed.data;
    let broken: Vec<bool> = data.positions.iter().map(|p| !p.is_finite()).collect();
    let count = broken.iter().filter(|b| **b).count();
    if count > 0 {
        let keep: Vec<bool> = data.triangles.iter().map(|t| !t.iter().any(|i| broken[*i as usize])).collect();
        let dropped = keep.iter().filter(|k| !**k).count();
        let mut flags = keep.iter();
        data.triangles.retain(|_| flags.next().copied().unwrap_or(true));
        for attribute in data.attributes.iter_mut().filter(|a| a.per_face) {
            let width = attribute.width as usize;
            let mut i = 0;
            attribute.data.retain(|_| {
                i += 1;
                keep.get((i - 1) / width).copied().unwrap_or(true)
            });
        }
        parsed.warnings.push(format!("{count} vertices have no finite position; {dropped} triangles are left out"));
    }
    let odd = data.normals.iter_mut().filter(|n| !n.is_finite()).map(|n| *n = glam::Vec3::ZERO).count();
    let odd = odd + data.uvs.iter_mut().filter(|t| !t.is_finite()).map(|t| *t = Vec2::ZERO).count();
    if odd > 0 {
        parsed.warnings.push(format!("{odd} normals or texture coordinates are not finite and count as 0"));
    }
}

/// Reads a mesh file as a scene of its own: an OBJ file becomes a shape for each of its materials.
///
/// # Errors
/// [`ReadError`] with every fault that was found.
pub fn read(path: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let format = match extension.as_str() {
        "obj" => return mtl::read_scene(path, options),
        "stl" => MeshFormat::Stl,
        "serialized" => MeshFormat::MitsubaSerialized,
        _ => MeshFormat::Ply,
    };
    let canonical: PathBuf = path.canonicalize().map_err(|source| ReadError::Io { path: path.to_owned(), source })?;
    let mut desc = SceneDesc::new(&extension, path);
    let span = Span::file(FileId(0));
    let count = match format {
        MeshFormat::MitsubaSerialized => {
            let bytes = Resolver::read(&canonical)
                .map_err(|e| ReadError::Io { path: path.to_owned(), source: std::io::Error::other(e.to_string()) })?;
            serialized::count(&bytes).clamp(1, SERIALIZED_LIMIT)
        }
        _ => 1,
    };
    for index in 0..count {
        let mesh = desc.add(Node::new(span, MeshDesc { file: Some((canonical.clone(), format, index)), flip_v: false, data: None }));
        let geometry = GeometryDesc::Mesh { mesh, face_normals: false, smooth: false };
        desc.add(Node::new(span, ShapeDesc::new(geometry, Mat4::IDENTITY)));
    }
    Ok(desc)
}
