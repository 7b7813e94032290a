//! Writes binary PLY.

use crate::desc::MeshData;

/// The bytes of a binary little-endian PLY file of a mesh. Tangents are not written; attributes keep their names with a `vertex_` or
/// `face_` prefix, as Mitsuba reads them.
pub fn to_bytes(mesh: &MeshData) -> Vec<u8> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    let strings = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
    let mut vertex = strings(&["x", "y", "z"]);
    if !mesh.normals.is_empty() {
        vertex.extend(strings(&["nx", "ny", "nz"]));
    }
    if !mesh.uvs.is_empty() {
        vertex.extend(strings(&["u", "v"]));
    }
    let columns = |per_face: bool| {
        let mut names = Vec::new();
        for a in mesh.attributes.iter().filter(|a| a.per_face == per_face) {
            let prefix = if per_face { "face" } else { "vertex" };
            let name: String = a.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
            names.extend(["x", "y", "z", "w"].iter().take(a.width as usize).map(|c| format!("{prefix}_{name}_{c}")));
        }
        names
    };
    vertex.extend(columns(false));
    let counts = (mesh.positions.len(), mesh.triangles.len());
    header += &format!("element vertex {}\n", counts.0);
    for name in &vertex {
        header += &format!("property float {name}\n");
    }
    header += &format!("element face {}\nproperty list uchar int vertex_indices\n", counts.1);
    for name in columns(true) {
        header += &format!("property float {name}\n");
    }
    header += "end_header\n";
    let mut out = header.into_bytes();
    out.reserve(counts.0 * vertex.len() * 4 + counts.1 * 13);
    let mut put = |values: &[f32]| values.iter().for_each(|v| out.extend(v.to_le_bytes()));
    for i in 0..counts.0 {
        put(&mesh.positions[i].to_array());
        if let Some(n) = mesh.normals.get(i) {
            put(&n.to_array());
        }
        if let Some(t) = mesh.uvs.get(i) {
            put(&t.to_array());
        }
        for a in mesh.attributes.iter().filter(|a| !a.per_face) {
            put(a.data.get(i * a.width as usize..(i + 1) * a.width as usize).unwrap_or_default());
        }
    }
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        out.push(3);
        triangle.iter().for_each(|v| out.extend(v.to_le_bytes()));
        for a in mesh.attributes.iter().filter(|a| a.per_face) {
            let values = a.data.get(i * a.width as usize..(i + 1) * a.width as usize).unwrap_or_default();
            values.iter().for_each(|v| out.extend(v.to_le_bytes()));
        }
    }
    out
}
