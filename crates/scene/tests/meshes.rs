//! Mesh files: what is read, what is refused and where, and what a broken file may not do.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use etendue_scene::desc::*;
use etendue_scene::formats::mesh::{parse, ply_write};
use etendue_scene::formats::{ReadOptions, read};
use glam::{Vec2, Vec3};
use support::TempFolder;

fn ply_header(format: &str, vertices: usize, properties: &[&str], faces: usize, list: &str) -> String {
    let properties: String = properties.iter().map(|p| format!("property {p}\n")).collect();
    format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex {vertices}\n{properties}element face {faces}\nproperty list {list} vertex_indices\nend_header\n"
    )
}

fn error(bytes: impl AsRef<[u8]>, format: MeshFormat) -> (u32, String) {
    let fault = parse(bytes.as_ref(), format, 0).unwrap_err();
    (fault.line, fault.message)
}

#[test]
fn ply_text_and_binary_of_both_orders_agree() {
    // Properties out of order, of several types, with extras.
    let properties = [
        "float y",
        "double x",
        "float z",
        "uchar red",
        "uchar green",
        "uchar blue",
        "float s",
        "float t",
        "float vertex_heat_x",
        "float vertex_heat_y",
    ];
    let rows: [[f64; 10]; 4] = [
        [0.0, 0.0, 0.5, 255.0, 0.0, 51.0, 0.0, 0.25, 1.0, 2.0],
        [0.0, 1.0, 0.5, 255.0, 0.0, 51.0, 1.0, 0.25, 3.0, 4.0],
        [1.0, 1.0, 0.5, 255.0, 0.0, 51.0, 1.0, 0.75, 5.0, 6.0],
        [1.0, 0.0, 0.5, 255.0, 0.0, 51.0, 0.0, 0.75, 7.0, 8.0],
    ];
    let mut text = ply_header("ascii", 4, &properties, 1, "uchar int");
    for row in rows {
        text += &(row.map(|v| v.to_string()).join(" ") + "\n");
    }
    text += "4 0 1 2 3\n";
    let binary = |big: bool| {
        let mut out =
            ply_header(if big { "binary_big_endian" } else { "binary_little_endian" }, 4, &properties, 1, "uchar ushort").into_bytes();
        let f32_ = |out: &mut Vec<u8>, v: f64| out.extend(if big { (v as f32).to_be_bytes() } else { (v as f32).to_le_bytes() });
        for row in rows {
            for (i, v) in row.into_iter().enumerate() {
                match i {
                    1 => out.extend(if big { v.to_be_bytes() } else { v.to_le_bytes() }),
                    3..=5 => out.push(v as u8),
                    _ => f32_(&mut out, v),
                }
            }
        }
        out.push(4);
        for i in 0u16..4 {
            out.extend(if big { i.to_be_bytes() } else { i.to_le_bytes() });
        }
        out
    };
    let mesh = parse(text.as_bytes(), MeshFormat::Ply, 0).unwrap();
    assert_eq!(mesh.data.positions[1], Vec3::new(1.0, 0.0, 0.5));
    assert_eq!(mesh.data.uvs[2], Vec2::new(1.0, 0.75));
    assert_eq!(mesh.data.triangles, [[0, 1, 2], [0, 2, 3]]);
    let attributes: Vec<(&str, u32)> = mesh.data.attributes.iter().map(|a| (a.name.as_str(), a.width)).collect();
    assert_eq!(attributes, [("color", 3), ("heat", 2)]);
    assert_eq!(mesh.data.attributes[0].data[..3], [1.0, 0.0, 0.2]);
    assert!(mesh.warnings.is_empty());
    for big in [false, true] {
        assert_eq!(parse(&binary(big), MeshFormat::Ply, 0).unwrap(), mesh);
    }
    assert_eq!(parse(&ply_write::to_bytes(&mesh.data), MeshFormat::Ply, 0).unwrap(), mesh);
}

#[test]
fn ply_faults_have_places() {
    let xyz = ["float x", "float y", "float z"];
    let ascii = |v: usize, f: usize, body: &str| ply_header("ascii", v, &xyz, f, "uchar int") + body;
    let e = |text: String| error(text, MeshFormat::Ply);
    assert_eq!(error("solid", MeshFormat::Ply), (1, "the header does not end".into()));
    assert_eq!(e("plx\n".into()), (1, "not a PLY file: it must begin with `ply`".into()));
    assert_eq!(e(ascii(1, 0, "0 0 q\n")), (11, "`q` is not a number".into()));
    assert_eq!(e(ascii(3, 1, "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n")), (14, "face 0: there is no vertex 3, only 3".into()));
    assert_eq!(e(ascii(3, 1, "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n")), (14, "face 0: there is no vertex -1, only 3".into()));
    assert_eq!(e(ascii(4_000_000_000, 0, "0 0 0\n")).1, "the file ends within element `vertex`: 4000000000 of them cannot be there");
    assert_eq!(e(ascii(2, 0, "0 0 0\n1.00 1.00\n")), (13, "the file ends within an element".into()));
    assert_eq!(e("ply\nformat ascii 1.0\nelement vertex 99999999999\n".into()).0, 3);
    assert_eq!(
        e("ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n".into()),
        (4, "not a property: `property half x`".into())
    );
    let mut binary = ply_header("binary_little_endian", 3, &xyz, 1, "uchar int").into_bytes();
    let header = binary.len();
    binary.extend([0u8; 36]);
    binary.push(255);
    binary.extend([0u8; 12]);
    let (line, message) = error(&binary, MeshFormat::Ply);
    assert_eq!((line, message.as_str()), (0, "the file ends within an element (byte 49)"), "{header}");
}

#[test]
fn triangles_without_finite_vertices_are_left_out_and_counted() {
    let text =
        ply_header("ascii", 4, &["float x", "float y", "float z"], 2, "uchar int") + "0 0 0\n1 0 0\n0 1 0\nnan 0 0\n3 0 1 2\n3 1 2 3\n";
    let mesh = parse(text.as_bytes(), MeshFormat::Ply, 0).unwrap();
    assert_eq!(mesh.data.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.warnings, ["1 vertices have no finite position; 1 triangles are left out"]);
}

#[test]
fn obj_polygons_negative_indices_and_continued_lines() {
    let text =
        "# comment\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 2\nf 1/1/1 2/2/1 3/1/1 \\\n 4/2/1\nf -4//-1 -3//-1 -2//-1\n";
    let mesh = parse(text.as_bytes(), MeshFormat::Obj, 0).unwrap().data;
    assert_eq!(mesh.triangles.len(), 3);
    assert_eq!(mesh.normals[0], Vec3::Z);
    // The second face has no texture coordinates: its vertices are others.
    assert_eq!(mesh.positions.len(), 7);
    assert_eq!(mesh.triangles[0], [0, 1, 2]);
    let e = |text: &str| error(text, MeshFormat::Obj);
    assert_eq!(e("v 0 0 0\nf 1 2 3\n"), (2, "there is no vertex 2, only 1 so far".into()));
    assert_eq!(e("v 0 0 0\nf -2 1 1\n"), (2, "there is no vertex -2, only 1 so far".into()));
    assert_eq!(e("v 0 0 0\nf 0 1 1\n"), (2, "there is no vertex 0, only 1 so far".into()));
    assert_eq!(e("v 0 x 0\n"), (1, "`x` is not a number".into()));
    assert_eq!(e("v 0 0 0\nf 1 1\n"), (2, "a face with fewer than three corners".into()));
    assert_eq!(e("v 0 0 0\nf 1//// a b\n").0, 2);
}

#[test]
fn obj_scenes_have_a_shape_for_each_material() {
    let folder = TempFolder::new("obj");
    folder.put("tex.png", [0u8; 8]);
    folder.put(
        "lib.mtl",
        "newmtl red\nKd 1 0 0\nnewmtl glass\nillum 7\nd 0.1\nNi 1.4\nnewmtl lamp\nKe 5 5 5\nnewmtl shiny\nKs 0.5 0.5 0.5\nNs 98\nmap_Kd -s 2 2 1 tex.png\nnewmtl metal\nPm 1\nPr 0.3\nfoo 1\n",
    );
    let faces: String =
        ["red", "glass", "lamp", "shiny", "metal", "none", "red"].iter().map(|m| format!("usemtl {m}\nf 1/1 2/1 3/1\n")).collect();
    let path = folder.put("scene.obj", format!("mtllib lib.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n{faces}"));
    let desc = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(desc.shapes.len(), 6);
    let count = |i: usize| desc.meshes[i].value.data.as_ref().unwrap().triangles.len();
    assert_eq!((count(0), count(1)), (2, 1));
    assert!(desc.shapes[2].value.emission.is_some());
    let kinds: Vec<&str> = desc.bsdfs.iter().map(|b| b.value.type_name()).collect();
    assert_eq!(kinds, ["diffuse", "twosided", "dielectric", "diffuse", "twosided", "roughplastic", "twosided", "pbr", "twosided"]);
    let BsdfDesc::Plastic { roughness: Some(r), diffuse_reflectance: Param::Texture(_), .. } = &desc.bsdfs[5].value else { panic!() };
    assert_eq!(r.alpha_u, Param::Constant((2.0f32 / 100.0).sqrt()));
    let warnings: Vec<&str> = desc.report.faults.iter().map(|f| f.message.as_str()).collect();
    assert!(warnings.contains(&"`foo` is ignored") && warnings.contains(&"no library has the material `none`"), "{warnings:?}");
}

#[test]
fn stl_text_and_binary_agree() {
    let text = "solid part\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
        facet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    let mesh = parse(text.as_bytes(), MeshFormat::Stl, 0).unwrap();
    assert_eq!((mesh.data.positions.len(), mesh.data.triangles.len()), (4, 2));
    let mut binary = b"solid but binary all the same".to_vec();
    binary.resize(80, 0);
    binary.extend(2u32.to_le_bytes());
    for t in &mesh.data.triangles {
        binary.extend([0; 12]);
        for i in t {
            mesh.data.positions[*i as usize].to_array().iter().for_each(|v| binary.extend(v.to_le_bytes()));
        }
        binary.extend([0; 2]);
    }
    assert_eq!(parse(&binary, MeshFormat::Stl, 0).unwrap(), mesh);
    binary[0] = b'x';
    binary.truncate(150);
    assert_eq!(error(&binary, MeshFormat::Stl), (0, "the file ends after 1 of 2 triangles".into()));
    assert_eq!(error("solid\nfacet\nvertex 0 0\n", MeshFormat::Stl), (3, "a vertex takes three numbers".into()));
}

/// A serialized file (version 4) with one triangle and the given counts.
fn serialized(vertices: u64, triangles: u64) -> Vec<u8> {
    use std::io::Write;
    let mut stream = Vec::new();
    stream.extend(0x1002u32.to_le_bytes());
    stream.extend(b"name\0");
    stream.extend(vertices.to_le_bytes());
    stream.extend(triangles.to_le_bytes());
    for v in [0f32, 0., 0., 1., 0., 0., 0., 1., 0., /* uv */ 0., 0., 1., 0., 0., 1.] {
        stream.extend(v.to_le_bytes());
    }
    for i in [0u32, 1, 2] {
        stream.extend(i.to_le_bytes());
    }
    let mut out = vec![0x1c, 0x04, 4, 0];
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(&stream).unwrap();
    out.extend(encoder.finish().unwrap());
    out.extend(0u64.to_le_bytes());
    out.extend(1u32.to_le_bytes());
    out
}

#[test]
fn serialized_meshes_are_read_and_absurd_counts_refused() {
    let mesh = parse(&serialized(3, 1), MeshFormat::MitsubaSerialized, 0).unwrap().data;
    assert_eq!((mesh.positions[1], mesh.uvs[2], mesh.triangles.as_slice()), (Vec3::X, Vec2::Y, &[[0, 1, 2]][..]));
    let e = |bytes: Vec<u8>, i| parse(&bytes, MeshFormat::MitsubaSerialized, i).unwrap_err().message;
    assert_eq!(e(serialized(3, 1), 1), "there is no mesh 1; the file has 1");
    assert!(e(serialized(4_000_000_000, 1), 0).contains("cannot be in this file"));
    assert!(e(serialized(u64::MAX, 1), 0).contains("too many"));
    assert!(e(serialized(2, 1), 0).contains("there is no vertex"));
    let whole = serialized(3, 1);
    for n in 0..whole.len() {
        assert!(parse(&whole[..n], MeshFormat::MitsubaSerialized, 0).is_err(), "cut at {n}");
    }
}

#[test]
fn files_that_end_early_never_pass_unnoticed() {
    let binary = {
        let data = MeshData { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]; 5], ..MeshData::default() };
        ply_write::to_bytes(&data)
    };
    for n in 0..binary.len() {
        assert!(parse(&binary[..n], MeshFormat::Ply, 0).is_err(), "cut at {n}");
    }
}

#[test]
fn a_faulty_mesh_of_a_scene_is_told_with_its_own_line() {
    let folder = TempFolder::new("faulty-mesh");
    folder.put("bad.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n");
    folder.put("bad.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n");
    let path = folder.put(
        "s.xml",
        r#"<scene version="3.0.0"><shape type="obj"><string name="filename" value="bad.obj"/></shape><shape type="ply"><string name="filename" value="bad.ply"/></shape></scene>"#,
    );
    let text = read(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(text.contains("bad.obj:3:1: error: there is no vertex 9, only 2 so far"), "{text}");
    assert!(text.contains("bad.ply:6:1: error: element `vertex` lacks x, y or z"), "{text}");
}
