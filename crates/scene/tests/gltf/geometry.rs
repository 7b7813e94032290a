//! Accessors, primitives, deformation.

use etendue_scene::desc::{MeshData, TextureDesc};
use glam::{Mat3, Mat4, Vec2, Vec3};
use serde_json::json;

use crate::build::{Build, F32, I8, I16, U8, U16, U32, f32s, mesh, u16s};

#[test]
fn a_triangle() {
    let desc = Build::triangle().read();
    assert_eq!(desc.format, "gltf");
    let m = mesh(&desc);
    assert_eq!(m.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(m.triangles, [[0, 1, 2]]);
    // Without normals the shape is flat.
    assert!(m.normals.is_empty());
    assert!(desc.report.faults.is_empty() && desc.report.losses.is_empty());
}

/// Five vertices of a zigzag, with a mode and indices.
fn zigzag(mode: u32) -> MeshData {
    let mut b = Build::triangle();
    let p = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 2.0, 0.0, 0.0];
    let position = b.accessor(&f32s(&p), F32, "VEC3", 5);
    let indices = b.accessor(&[0, 1, 2, 3, 4], U8, "SCALAR", 5);
    *b.primitive() = json!({"attributes": {"POSITION": position}, "indices": indices, "mode": mode});
    mesh(&b.read()).clone()
}

#[test]
fn strips_and_fans() {
    let strip = zigzag(5);
    assert_eq!(strip.triangles, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    let normals: Vec<f32> = strip
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| strip.positions[i as usize]);
            (b - a).cross(c - a).z
        })
        .collect();
    assert!(normals.iter().all(|&z| z < 0.0), "all face the same way: {normals:?}");
    assert_eq!(zigzag(6).triangles, [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
}

#[test]
fn points_and_lines_are_losses() {
    for mode in 0..4 {
        let mut b = Build::triangle();
        b.primitive()["mode"] = json!(mode);
        let desc = b.read();
        assert!(desc.shapes.is_empty());
        assert_eq!(desc.report.losses[0].feature, if mode == 0 { "points" } else { "lines" });
    }
}

#[test]
fn indices_of_all_types() {
    for (component, bytes) in
        [(U8, vec![2u8, 0, 1]), (U16, u16s(&[2, 0, 1])), (U32, [2u32, 0, 1].iter().flat_map(|i| i.to_le_bytes()).collect())]
    {
        let mut b = Build::triangle();
        let i = b.accessor(&bytes, component, "SCALAR", 3);
        b.primitive()["indices"] = json!(i);
        assert_eq!(mesh(&b.read()).triangles, [[2, 0, 1]]);
    }
}

#[test]
fn strides_and_offsets() {
    let mut b = Build::triangle();
    // Position and a float of padding, interleaved, after one float.
    let p = [9.0, 0.0, 0.0, 0.0, 7.0, 1.0, 0.0, 0.0, 7.0, 0.0, 1.0, 0.0, 7.0];
    let view = b.view(&f32s(&p));
    b.json["bufferViews"][view]["byteStride"] = json!(16);
    let a = b.push("accessors", json!({"bufferView": view, "byteOffset": 4, "componentType": F32, "type": "VEC3", "count": 3}));
    b.primitive()["attributes"]["POSITION"] = json!(a);
    assert_eq!(mesh(&b.read()).positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn sparse_accessors() {
    let mut b = Build::triangle();
    let indices = b.view(&u16s(&[1]));
    let values = b.view(&f32s(&[5.0, 6.0, 7.0]));
    let sparse = json!({
        "count": 1,
        "indices": {"bufferView": indices, "componentType": U16},
        "values": {"bufferView": values},
    });
    b.json["accessors"][0]["sparse"] = sparse.clone();
    assert_eq!(mesh(&b.read()).positions, [Vec3::ZERO, Vec3::new(5.0, 6.0, 7.0), Vec3::Y]);
    // Without a view the rest is zero.
    let a = b.push("accessors", json!({"componentType": F32, "type": "VEC3", "count": 3, "sparse": sparse}));
    b.primitive()["attributes"]["POSITION"] = json!(a);
    assert_eq!(mesh(&b.read()).positions, [Vec3::ZERO, Vec3::new(5.0, 6.0, 7.0), Vec3::ZERO]);
    b.json["accessors"][a]["sparse"]["indices"]["byteOffset"] = json!(1);
    assert!(b.error().contains("do not fit into the 2 bytes"), "{}", b.error());
}

#[test]
fn quantized_attributes() {
    let mut b = Build::triangle();
    let p: Vec<u8> = [0i16, 0, 0, 0, 100, 0, 0, 0, 0, -100, 0, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let view = b.view(&p);
    b.json["bufferViews"][view]["byteStride"] = json!(8);
    let position = b.push("accessors", json!({"bufferView": view, "componentType": I16, "type": "VEC3", "count": 3}));
    let normal = b.accessor(&[0u8, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0], I8, "VEC3", 3);
    let nv = b.json["accessors"][normal]["bufferView"].as_u64().unwrap() as usize;
    b.json["bufferViews"][nv]["byteStride"] = json!(4);
    b.json["accessors"][normal]["normalized"] = json!(true);
    let uv = b.accessor(&u16s(&[0, 0, 65535, 0, 0, 65535]), U16, "VEC2", 3);
    b.json["accessors"][uv]["normalized"] = json!(true);
    *b.primitive() = json!({"attributes": {"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv}});
    let desc = b.read();
    let m = mesh(&desc);
    assert_eq!(m.positions, [Vec3::ZERO, Vec3::new(100.0, 0.0, 0.0), Vec3::new(0.0, -100.0, 0.0)]);
    assert_eq!(m.normals, [Vec3::Z; 3]);
    assert_eq!(m.uvs, [Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 0.0)]);
}

#[test]
fn further_texture_coordinates_and_colors() {
    let mut b = Build::triangle();
    let uv = b.accessor(&f32s(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]), F32, "VEC2", 3);
    let color = b.accessor(&[255, 0, 0, 255, 0, 255, 0, 0, 0, 0, 255, 255], U8, "VEC4", 3);
    b.json["accessors"][color]["normalized"] = json!(true);
    b.primitive()["attributes"]["TEXCOORD_0"] = json!(uv);
    b.primitive()["attributes"]["TEXCOORD_1"] = json!(uv);
    b.primitive()["attributes"]["COLOR_0"] = json!(color);
    let desc = b.with_material(json!({"alphaMode": "BLEND"})).read();
    let m = mesh(&desc);
    let find = |name: &str| m.attributes.iter().find(|a| a.name == name).unwrap();
    assert_eq!((find("uv1").width, &find("uv1").data[..]), (2, &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0][..]));
    assert_eq!((find("color").width, &find("color").data[..3]), (3, &[1.0, 0.0, 0.0][..]));
    assert_eq!((find("alpha").width, &find("alpha").data[..]), (1, &[1.0, 0.0, 1.0][..]));
    let attributes: Vec<_> = desc
        .textures
        .iter()
        .filter_map(|t| if let TextureDesc::Attribute { name, .. } = &t.value { Some(name.as_str()) } else { None })
        .collect();
    assert_eq!(attributes, ["color", "alpha"]);
}

/// The tangent frame that the renderer derives must be the one that the normal map of the file was made for: with texture coordinates
/// that show the picture upright and unmirrored, the bitangent points up the picture, which is along our +v.
#[test]
fn bitangents_point_along_v_after_the_flip() {
    let mut b = Build::triangle();
    // glTF: v runs down, so the vertex at y = 1 has v = 0.
    let uv = b.accessor(&f32s(&[0.0, 1.0, 1.0, 1.0, 0.0, 0.0]), F32, "VEC2", 3);
    let normal = b.accessor(&f32s(&[0.0, 0.0, 1.0].repeat(3)), F32, "VEC3", 3);
    let tangent = b.accessor(&f32s(&[1.0, 0.0, 0.0, 1.0].repeat(3)), F32, "VEC4", 3);
    for (name, a) in [("TEXCOORD_0", uv), ("NORMAL", normal), ("TANGENT", tangent)] {
        b.primitive()["attributes"][name] = json!(a);
    }
    let desc = b.read();
    let m = mesh(&desc);
    let (e1, e2) = (m.positions[1] - m.positions[0], m.positions[2] - m.positions[0]);
    let (d1, d2) = (m.uvs[1] - m.uvs[0], m.uvs[2] - m.uvs[0]);
    let det = d1.x * d2.y - d1.y * d2.x;
    let (dpdu, dpdv) = ((e1 * d2.y - e2 * d1.y) / det, (e2 * d1.x - e1 * d2.x) / det);
    let t = m.tangents[0];
    assert!(dpdu.dot(t.truncate()) > 0.0);
    assert!(dpdv.dot(m.normals[0].cross(t.truncate()) * t.w) > 0.0);
    // First row of the picture (v = 1 here) is at the top.
    assert_eq!(m.uvs[2].y, 1.0);
}

#[test]
fn texture_transforms_are_turned_with_v() {
    let b = Build::triangle().with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {
        "KHR_texture_transform": {"offset": [0.0, 1.0], "rotation": std::f32::consts::FRAC_PI_2, "scale": [0.5, 0.5]}}}}}));
    let desc = b.read();
    let bitmap = desc.textures.iter().find_map(|t| if let TextureDesc::Bitmap(b) = &t.value { Some(b) } else { None }).unwrap();
    // The example of the extension's specification: the lower left quadrant of the picture, turned clockwise.
    let lookup = |u: f32, v: f32| {
        // Our coordinates of glTF's (u, v), then back to glTF's in the picture.
        let p: Vec3 = bitmap.picture_from_uv * Vec3::new(u, 1.0 - v, 1.0);
        Vec2::new(p.x, 1.0 - p.y)
    };
    for (uv, expected) in [((0.0, 0.0), (0.0, 1.0)), ((1.0, 0.0), (0.0, 0.5)), ((0.0, 1.0), (0.5, 1.0)), ((1.0, 1.0), (0.5, 0.5))] {
        let p = lookup(uv.0, uv.1);
        assert!((p - Vec2::new(expected.0, expected.1)).length() < 1e-6, "{uv:?} → {p}");
    }
    assert_ne!(bitmap.picture_from_uv, Mat3::IDENTITY);
}

#[test]
fn broken_normals_are_replaced() {
    let mut b = Build::triangle();
    let normal = b.accessor(&f32s(&[0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0, 0.0, 2.0, 0.0]), F32, "VEC3", 3);
    b.primitive()["attributes"]["NORMAL"] = json!(normal);
    let desc = b.read();
    assert_eq!(mesh(&desc).normals, [Vec3::Z, Vec3::Z, Vec3::Y]);
    assert!(desc.report.faults[0].message.starts_with("/meshes/0/primitives/0/attributes/NORMAL: normals of length 0"));
}

#[test]
fn morph_targets_take_the_default_weights() {
    let mut b = Build::triangle();
    let delta = b.accessor(&f32s(&[0.0, 0.0, 2.0].repeat(3)), F32, "VEC3", 3);
    b.primitive()["targets"] = json!([{"POSITION": delta}, {"POSITION": delta}]);
    b.json["meshes"][0]["weights"] = json!([0.5, 0.0]);
    b.node(json!({"mesh": 0, "weights": [1.0, 1.0]}));
    let desc = b.read();
    assert_eq!(mesh(&desc).positions[0], Vec3::new(0.0, 0.0, 1.0));
    assert_eq!(crate::build::mesh_of(&desc, &desc.shapes[1].value).positions[0], Vec3::new(0.0, 0.0, 4.0));
}

#[test]
fn skins_place_vertices_by_their_joints() {
    let mut b = Build::triangle();
    let joints = b.accessor(&[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], U8, "VEC4", 3);
    let weights = b.accessor(&f32s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]), F32, "VEC4", 3);
    b.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    b.primitive()["attributes"]["WEIGHTS_0"] = json!(weights);
    let first = b.node(json!({"translation": [0, 0, 10]}));
    let second = b.node(json!({"translation": [0, 0, 20]}));
    let bind = Mat4::from_translation(Vec3::new(0.0, 0.0, -10.0)).to_cols_array();
    let matrices = b.accessor(&f32s(&[bind, bind].concat()), F32, "MAT4", 2);
    b.push("skins", json!({"joints": [first, second], "inverseBindMatrices": matrices}));
    b.json["nodes"][0] = json!({"mesh": 0, "skin": 0, "translation": [100, 0, 0]});
    let desc = b.read();
    assert_eq!(desc.shapes[0].value.world_from_object, Mat4::IDENTITY);
    assert_eq!(mesh(&desc).positions, [Vec3::ZERO, Vec3::new(1.0, 0.0, 10.0), Vec3::new(0.0, 1.0, 5.0)]);
}

#[test]
fn compressed_views() {
    // Mode INDICES, version 1: deltas 0, +1, +1 from the first baseline.
    let mut b = Build::triangle();
    let view = b.view(&[0xD1, 0x00, 0x04, 0x04, 0, 0, 0, 0]);
    let compressed = b.json["bufferViews"][view].clone();
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let mut b = b.clone();
        let v = b.push("bufferViews", json!({"buffer": 1, "byteLength": 6, "extensions": {}}));
        let mut extension = compressed.clone();
        extension["byteStride"] = json!(2);
        extension["count"] = json!(3);
        extension["mode"] = json!("INDICES");
        b.json["bufferViews"][v]["extensions"][name] = extension;
        let a = b.push("accessors", json!({"bufferView": v, "componentType": U16, "type": "SCALAR", "count": 3}));
        b.primitive()["indices"] = json!(a);
        assert_eq!(mesh(&b.read()).triangles, [[0, 1, 2]]);
        b.json["bufferViews"][v]["extensions"][name]["count"] = json!(4);
        assert!(b.error().contains(&format!("/bufferViews/{v}/extensions/{name}: the compressed data ends too early")), "{}", b.error());
    }
}

#[test]
fn draco_is_refused_by_name_unless_there_is_plain_data() {
    let mut b = Build::triangle();
    b.primitive()["extensions"] = json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}});
    assert_eq!(b.read().shapes.len(), 1);
    b.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert!(b.error().contains("KHR_draco_mesh_compression"));
}
