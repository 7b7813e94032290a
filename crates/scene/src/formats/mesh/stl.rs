//! Stereolithography (STL), text and binary. Vertices at the same place are one vertex; the stored facet normals follow from them.

use std::collections::HashMap;

use glam::Vec3;

use super::{MeshFault, ParsedMesh};

/// Reads an STL file.
///
/// # Errors
/// [`MeshFault`] at a line of a text file, or at a triangle of a binary one.
pub fn parse(bytes: &[u8]) -> Result<ParsedMesh, MeshFault> {
    let count = bytes.get(80..84).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    // Binary files may begin with `solid` too; their length gives them away.
    let exact = count.is_some_and(|n| bytes.len() as u64 == 84 + 50 * n);
    if !exact && bytes.trim_ascii_start().starts_with(b"solid") {
        return text(bytes);
    }
    let Some(count) = count else { return Err(MeshFault::binary("too short for an STL file")) };
    let available = (bytes.len() as u64 - 84) / 50;
    if count > available {
        return Err(MeshFault::binary(format!("the file ends after {available} of {count} triangles")));
    }
    let mut builder = Builder::default();
    for record in bytes[84..].chunks_exact(50).take(count as usize) {
        let number = |i: usize| f32::from_le_bytes([record[i], record[i + 1], record[i + 2], record[i + 3]]);
        let corner = |i: usize| Vec3::new(number(i), number(i + 4), number(i + 8));
        builder.triangle([corner(12), corner(24), corner(36)]);
    }
    Ok(builder.mesh)
}

fn text(bytes: &[u8]) -> Result<ParsedMesh, MeshFault> {
    let mut builder = Builder::default();
    let mut corners = Vec::new();
    for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let line_number = i as u32 + 1;
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("vertex") => {
                let numbers: Vec<f32> = words.map_while(|w| w.parse().ok()).collect();
                let [x, y, z] = numbers[..] else { return Err(MeshFault::at(line_number, "a vertex takes three numbers")) };
                if corners.len() >= 3 {
                    return Err(MeshFault::at(line_number, "a facet with more than three vertices"));
                }
                corners.push(Vec3::new(x, y, z));
            }
            Some("endloop") => {
                let [a, b, c] = corners[..] else {
                    return Err(MeshFault::at(line_number, format!("a facet with {} vertices", corners.len())));
                };
                builder.triangle([a, b, c]);
                corners.clear();
            }
            Some("solid" | "facet" | "outer" | "endfacet" | "endsolid") | None => {}
            Some(word) => {
                let word: String = word.chars().take(40).collect();
                return Err(MeshFault::at(line_number, format!("unknown word `{word}`")));
            }
        }
    }
    if !corners.is_empty() {
        return Err(MeshFault::at(bytes.split(|b| *b == b'\n').count() as u32, "the file ends within a facet"));
    }
    Ok(builder.mesh)
}

#[derive(Default)]
struct Builder {
    mesh: ParsedMesh,
    known: HashMap<[u32; 3], u32>,
}

impl Builder {
    fn triangle(&mut self, corners: [Vec3; 3]) {
        let triangle = corners.map(|p| {
            // Adding 0 makes −0 and 0 the same place.
            *self.known.entry((p + 0.0).to_array().map(f32::to_bits)).or_insert_with(|| {
                self.mesh.data.positions.push(p);
                self.mesh.data.positions.len() as u32 - 1
            })
        });
        self.mesh.data.triangles.push(triangle);
    }
}
