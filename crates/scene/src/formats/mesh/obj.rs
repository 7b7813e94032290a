//! Wavefront OBJ: polygons, negative indices, vertex colors, materials by name.

use glam::{Vec2, Vec3};

use super::{COUNT_LIMIT, MeshFault, ParsedMesh};
use crate::desc::{MeshAttribute, MeshData};

/// A corner of a face: indices from 0 of its position, texture coordinates and normal; `NONE` for neither of the latter.
type Corner = [u32; 3];
const NONE: u32 = u32::MAX;

/// Faces that share a material.
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// Name of the material; empty for none.
    pub material: String,
    /// Line of the `usemtl`.
    pub line: u32,
    triangles: Vec<[Corner; 3]>,
}

/// An OBJ file.
#[derive(Clone, Debug, Default)]
pub struct Obj {
    positions: Vec<Vec3>,
    colors: Vec<Vec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    /// Faces by material, in the order in which the materials first appear.
    pub parts: Vec<Part>,
    /// Names of material libraries and their lines.
    pub libraries: Vec<(String, u32)>,
    /// Oddities.
    pub warnings: Vec<String>,
}

/// Reads an OBJ file.
///
/// # Errors
/// [`MeshFault`] at a line.
pub fn parse(bytes: &[u8]) -> Result<Obj, MeshFault> {
    let mut obj = Obj { parts: vec![Part::default()], ..Obj::default() };
    let mut part = 0;
    let mut corners: Vec<Corner> = Vec::new();
    let mut ignored: Vec<String> = Vec::new();
    let mut lines = bytes.split(|b| *b == b'\n').enumerate();
    let mut joined = Vec::new();
    while let Some((i, line)) = lines.next() {
        let number = i as u32 + 1;
        // A backslash at its end continues a line.
        let mut line = line.trim_ascii_end();
        if line.ends_with(b"\\") {
            joined.clear();
            while let Some(begun) = line.strip_suffix(b"\\") {
                joined.extend_from_slice(begun);
                joined.push(b' ');
                line = lines.next().map_or(&b""[..], |(_, l)| l.trim_ascii_end());
            }
            joined.extend_from_slice(line);
            line = &joined;
        }
        let line = std::str::from_utf8(line).map_err(|_| MeshFault::at(number, "not text in UTF-8"))?;
        let mut words = line.split_ascii_whitespace();
        let Some(word) = words.next() else { continue };
        match word {
            "v" => {
                let mut v = [0.0f32; 6];
                let n = numbers(&mut words, &mut v, number)?;
                if n < 3 {
                    return Err(MeshFault::at(number, "`v` takes three numbers"));
                }
                obj.positions.push(Vec3::new(v[0], v[1], v[2]));
                // Colors after the position: all vertices or none.
                if n == 6 && obj.colors.len() + 1 == obj.positions.len() {
                    obj.colors.push(Vec3::new(v[3], v[4], v[5]));
                }
            }
            "vt" => {
                let mut v = [0.0f32; 3];
                if numbers(&mut words, &mut v, number)? == 0 {
                    return Err(MeshFault::at(number, "`vt` takes one to three numbers"));
                }
                obj.uvs.push(Vec2::new(v[0], v[1]));
            }
            "vn" => {
                let mut v = [0.0f32; 3];
                if numbers(&mut words, &mut v, number)? < 3 {
                    return Err(MeshFault::at(number, "`vn` takes three numbers"));
                }
                let v = Vec3::from_array(v);
                obj.normals.push(if v.is_finite() { v.normalize_or_zero() } else { v });
            }
            "f" => {
                corners.clear();
                for word in words {
                    corners.push(corner(word, &obj, number)?);
                }
                if corners.len() < 3 {
                    return Err(MeshFault::at(number, "a face with fewer than three corners"));
                }
                for i in 2..corners.len() {
                    obj.parts[part].triangles.push([corners[0], corners[i - 1], corners[i]]);
                }
            }
            "usemtl" => {
                let name = line[word.len()..].trim_start_matches(|c: char| c.is_whitespace()).trim();
                part = match obj.parts.iter().rposition(|p| p.material == name) {
                    Some(found) => found,
                    None if obj.parts.len() < 65536 => {
                        obj.parts.push(Part { material: name.to_owned(), line: number, triangles: Vec::new() });
                        obj.parts.len() - 1
                    }
                    None => return Err(MeshFault::at(number, "more than 65536 materials")),
                };
            }
            "mtllib" => {
                if obj.libraries.len() < 64 {
                    obj.libraries.push((line["mtllib".len()..].trim().to_owned(), number));
                }
            }
            "o" | "g" | "s" => {}
            w if w.starts_with('#') => {}
            w => {
                if ignored.len() < 16 && !ignored.iter().any(|i| i == w) {
                    ignored.push(w.chars().take(40).collect());
                    obj.warnings.push(format!("line {number}: `{}` is ignored", ignored[ignored.len() - 1]));
                }
            }
        }
    }
    if obj.positions.len() as u64 >= COUNT_LIMIT {
        return Err(MeshFault::binary("too many vertices"));
    }
    if obj.colors.len() < obj.positions.len() {
        obj.colors.clear();
    }
    obj.parts.retain(|p| !p.triangles.is_empty());
    Ok(obj)
}

/// Reads as many numbers as fit; more words are left unread.
fn numbers<'w>(words: &mut impl Iterator<Item = &'w str>, out: &mut [f32], line: u32) -> Result<usize, MeshFault> {
    let mut n = 0;
    for (slot, word) in out.iter_mut().zip(words) {
        *slot =
            word.parse().map_err(|_| MeshFault::at(line, format!("`{}` is not a number", word.chars().take(40).collect::<String>())))?;
        n += 1;
    }
    Ok(n)
}

/// `v`, `v/vt`, `v//vn` or `v/vt/vn`; negative numbers count from the end of what has been read.
fn corner(word: &str, obj: &Obj, line: u32) -> Result<Corner, MeshFault> {
    let mut parts = word.split('/');
    let mut index = |count: usize, what: &str, required: bool| -> Result<u32, MeshFault> {
        let text = parts.next().unwrap_or("");
        if text.is_empty() && !required {
            return Ok(NONE);
        }
        let number: i64 = text
            .parse()
            .map_err(|_| MeshFault::at(line, format!("`{}` is not a corner of a face", word.chars().take(40).collect::<String>())))?;
        let i = if number < 0 { (count as i64).checked_add(number).unwrap_or(-1) } else { number - 1 };
        if i >= 0 && i < count as i64 {
            Ok(i as u32)
        } else {
            Err(MeshFault::at(line, format!("there is no {what} {number}, only {count} so far")))
        }
    };
    Ok([
        index(obj.positions.len(), "vertex", true)?,
        index(obj.uvs.len(), "texture coordinate", false)?,
        index(obj.normals.len(), "normal", false)?,
    ])
}

impl Obj {
    /// All parts as one mesh.
    pub fn merged(self) -> ParsedMesh {
        let parts: Vec<&Part> = self.parts.iter().collect();
        let data = self.mesh(&parts);
        ParsedMesh { data, warnings: self.warnings }
    }

    /// The mesh of some parts. Corners with the same indices become one vertex.
    pub fn mesh(&self, parts: &[&Part]) -> MeshData {
        let triangles = || parts.iter().flat_map(|p| &p.triangles);
        // Some faces may lack what others have: then theirs are 0, and such normals are computed by whoever shades.
        let has_uvs = triangles().flatten().any(|c| c[1] != NONE);
        let has_normals = triangles().flatten().all(|c| c[2] != NONE);
        let mut data = MeshData::default();
        let mut colors = Vec::new();
        // Vertices made of each position, chained, so that no hashing is needed.
        let mut first = vec![NONE; self.positions.len()];
        let mut made: Vec<([u32; 2], u32)> = Vec::new();
        for triangle in triangles() {
            let triangle = triangle.map(|[p, t, n]| {
                let key = [t, if has_normals { n } else { NONE }];
                let mut at = first[p as usize];
                while at != NONE && made[at as usize].0 != key {
                    at = made[at as usize].1;
                }
                if at != NONE {
                    return at;
                }
                let new = made.len() as u32;
                made.push((key, first[p as usize]));
                first[p as usize] = new;
                data.positions.push(self.positions[p as usize]);
                if has_uvs {
                    data.uvs.push(self.uvs.get(t as usize).copied().unwrap_or_default());
                }
                if has_normals {
                    data.normals.push(self.normals[n as usize]);
                }
                if let Some(c) = self.colors.get(p as usize) {
                    colors.extend(c.to_array());
                }
                new
            });
            data.triangles.push(triangle);
        }
        if !colors.is_empty() {
            data.attributes.push(MeshAttribute { name: "color".to_owned(), per_face: false, width: 3, data: colors });
        }
        data
    }
}
