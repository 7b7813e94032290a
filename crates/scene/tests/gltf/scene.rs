//! Nodes, instances, cameras, lights, extensions, other files.

use std::path::Path;

use etendue_scene::desc::{FovAxis, ImageSource, LightDesc, ProjectionDesc, SpotFalloff};
use etendue_scene::formats::{ReadOptions, gltf};
use glam::{Quat, Vec3};
use serde_json::json;

use crate::build::{Build, F32, PNG, f32s, mesh};

#[test]
fn transforms_multiply_from_the_root() {
    let mut b = Build::triangle();
    let r = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2).to_array();
    b.json["nodes"][0] = json!({"mesh": 0, "translation": [1, 0, 0]});
    b.push("nodes", json!({"children": [0], "rotation": r, "scale": [2, 2, 2]}));
    b.push("nodes", json!({"children": [1], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]}));
    b.json["scenes"][0]["nodes"] = json!([2]);
    let p = b.read().shapes[0].value.world_from_object.transform_point3(Vec3::X);
    assert!((p - Vec3::new(0.0, 4.0, 5.0)).length() < 1e-5, "{p}");
}

#[test]
fn a_mirroring_node_keeps_the_outside() {
    let mut b = Build::triangle();
    b.json["nodes"][0]["scale"] = json!([1, 1, -1]);
    let normal = b.accessor(&f32s(&[0.0, 0.0, 1.0].repeat(3)), F32, "VEC3", 3);
    b.primitive()["attributes"]["NORMAL"] = json!(normal);
    let desc = b.read();
    let world = desc.shapes[0].value.world_from_object;
    assert!(world.determinant() > 0.0);
    let m = mesh(&desc);
    let [p, q, r] = m.triangles[0].map(|i| world.transform_point3(m.positions[i as usize]));
    let ng = (q - p).cross(r - p).normalize();
    let ns = world.transform_vector3(m.normals[0]).normalize();
    // The triangle's outside was +z; in the mirror it is −z.
    assert!((ng + Vec3::Z).length() < 1e-6 && (ns + Vec3::Z).length() < 1e-6, "{ng} {ns}");
    let mut points = [p, q, r].map(|p| p.to_array().map(|x| x + 0.0));
    points.sort_by(|a, b| a.partial_cmp(b).unwrap());
    assert_eq!(points, [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
}

#[test]
fn small_meshes_repeat_and_large_ones_are_instanced() {
    let mut b = Build::triangle();
    b.node(json!({"mesh": 0, "translation": [1, 2, 3]}));
    let desc = b.read();
    assert_eq!((desc.shapes.len(), desc.groups.len(), desc.meshes.len()), (2, 0, 1));

    let mut b = Build::new();
    let p: Vec<f32> = (0..3 * 3 * 1001).map(|i| (i % 7) as f32).collect();
    let position = b.accessor(&f32s(&p), F32, "VEC3", 3 * 1001);
    b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}}]}));
    b.node(json!({"mesh": 0, "name": "one"}));
    assert_eq!(b.read().groups.len(), 0);
    b.node(json!({"mesh": 0, "name": "two", "translation": [1, 2, 3]}));
    let desc = b.read();
    assert_eq!((desc.shapes.len(), desc.groups.len(), desc.instances.len(), desc.meshes.len()), (1, 1, 2, 1));
    assert_eq!(desc.instances[1].name, "two");
    assert_eq!(desc.instances[1].value.world_from_object.transform_point3(Vec3::ZERO), Vec3::new(1.0, 2.0, 3.0));
}

#[test]
fn gpu_instancing() {
    let mut b = Build::triangle();
    let t = b.accessor(&f32s(&[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]), F32, "VEC3", 2);
    let s = b.accessor(&f32s(&[1.0, 1.0, 1.0, 2.0, 2.0, 2.0]), F32, "VEC3", 2);
    b.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": t, "SCALE": s}}});
    b.json["nodes"][0]["translation"] = json!([0, 0, 1]);
    let desc = b.read();
    let p: Vec<_> = desc.shapes.iter().map(|s| s.value.world_from_object.transform_point3(Vec3::X)).collect();
    assert_eq!(p, [Vec3::new(1.0, 0.0, 1.0), Vec3::new(7.0, 0.0, 1.0)]);
}

#[test]
fn cameras() {
    let mut b = Build::triangle();
    b.push("cameras", json!({"name": "wide", "type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 2}}));
    b.push("cameras", json!({"type": "orthographic", "orthographic": {"xmag": 3, "ymag": -2, "znear": 0, "zfar": 10}}));
    b.node(json!({"camera": 0, "translation": [0, 0, 4], "scale": [3, 3, 3]}));
    b.node(json!({"camera": 1, "name": "plan"}));
    let desc = b.read();
    assert_eq!((desc.film.width, desc.film.height), (Some(1440), Some(720)));
    let camera = &desc.cameras[0].value;
    assert!(matches!(camera.projection, ProjectionDesc::Perspective { fov_rad: 0.8, fov_axis: FovAxis::Y, .. }));
    assert_eq!((camera.near, camera.far), (0.1, f32::MAX));
    // Cameras have no scale.
    assert_eq!(camera.world_from_camera.transform_point3(-Vec3::Z), Vec3::new(0.0, 0.0, 3.0));
    let plan = &desc.cameras[1];
    assert_eq!(plan.value.projection, ProjectionDesc::Orthographic { half_width: 3.0, half_height: Some(2.0) });
    assert_eq!((desc.cameras[0].name.as_str(), plan.name.as_str()), ("wide", "plan"));
}

#[test]
fn punctual_lights() {
    let mut b = Build::new();
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 683, "color": [1, 0.5, 0]},
        {"type": "directional", "intensity": 1366},
        {"type": "spot", "intensity": 683, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}, "range": 5},
    ]}});
    for i in 0..3 {
        b.node(json!({"extensions": {"KHR_lights_punctual": {"light": i}}, "translation": [1, 2, 3]}));
    }
    let desc = b.read();
    let position = Vec3::new(1.0, 2.0, 3.0);
    assert_eq!(desc.lights[0].value, LightDesc::Point { position, intensity: [1.0, 0.5, 0.0] });
    assert_eq!(desc.lights[1].value, LightDesc::Directional { direction: -Vec3::Z, irradiance: [2.0; 3] });
    let LightDesc::Spot { outer_rad, inner_rad, falloff, .. } = desc.lights[2].value else { panic!() };
    assert_eq!((outer_rad, inner_rad, falloff), (0.2, 0.1, SpotFalloff::CosineSquared));
    assert_eq!(desc.report.losses[0].feature, "light range");
    b.json["nodes"][0]["extensions"]["KHR_lights_punctual"]["light"] = json!(3);
    assert!(b.error().contains("/nodes/0/extensions/KHR_lights_punctual: light 3 is out of range: there are 3"));
}

#[test]
fn scenes_by_name_and_number() {
    let mut b = Build::triangle();
    b.json["scenes"] = json!([{"name": "full", "nodes": [0]}, {"name": "empty", "nodes": []}]);
    let shapes = |scene: Option<&str>| {
        let options = ReadOptions { scene: scene.map(str::to_owned), ..ReadOptions::default() };
        b.read_with(&options).map(|d| d.shapes.len()).map_err(|e| e.to_string())
    };
    assert_eq!(shapes(None), Ok(1));
    assert_eq!(shapes(Some("empty")), Ok(0));
    assert_eq!(shapes(Some("1")), Ok(0));
    assert!(shapes(Some("other")).unwrap_err().contains("no scene `other`; there are: 0 `full`, 1 `empty`"));
}

#[test]
fn a_file_without_scenes_shows_its_roots() {
    let mut b = Build::triangle();
    b.push("nodes", json!({"children": [0], "translation": [0, 0, 1]}));
    b.json.as_object_mut().unwrap().remove("scenes");
    b.json.as_object_mut().unwrap().remove("scene");
    let desc = b.read();
    assert_eq!(desc.shapes.len(), 1);
    assert_eq!(desc.shapes[0].value.world_from_object.w_axis.z, 1.0);
}

#[test]
fn hidden_nodes_are_left_out() {
    let mut b = Build::triangle();
    b.json["nodes"][0]["extensions"] = json!({"KHR_node_visibility": {"visible": false}});
    assert!(b.read().shapes.is_empty());
}

#[test]
fn extensions_and_versions() {
    let mut b = Build::triangle();
    b.json["extensionsUsed"] = json!(["KHR_materials_diffuse_transmission", "ACME_thing", "KHR_materials_ior"]);
    b.push("animations", json!({}));
    let losses: Vec<_> = b.read().report.losses.into_iter().map(|l| l.feature).collect();
    assert_eq!(losses, ["KHR_materials_diffuse_transmission", "ACME_thing", "animations"]);
    b.json["extensionsRequired"] = json!(["KHR_mesh_quantization", "ACME_thing"]);
    assert!(b.error().contains("/extensionsRequired/1: the file requires the extension ACME_thing"));
    b.json["asset"]["version"] = json!("1.0");
    assert!(b.error().contains("glTF version 1.0"));
}

#[test]
fn other_files_and_data_addresses() {
    let folder = std::env::temp_dir().join(format!("etendue-gltf-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("a b")).unwrap();
    let b = Build::triangle().with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    let mut json = b.json.clone();
    json["images"] = json!([{"uri": "a%20b/p.png"}]);
    json["buffers"] = json!([{"byteLength": b.bin.len(), "uri": "data.bin"}]);
    std::fs::write(folder.join("data.bin"), &b.bin).unwrap();
    std::fs::write(folder.join("a b/p.png"), PNG).unwrap();
    let path = folder.join("scene.gltf");
    let write = |json: &serde_json::Value| std::fs::write(&path, serde_json::to_vec_pretty(json).unwrap()).unwrap();
    write(&json);
    let desc = gltf::read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(desc.shapes.len(), 1);
    assert!(matches!(&desc.images[0].value.source, ImageSource::File(p) if p.ends_with("a b/p.png")));
    assert_eq!(desc.files.len(), 2);

    // Missing files and files elsewhere, with their places.
    json["buffers"][0]["uri"] = json!("missing.bin");
    json["images"][0]["uri"] = json!("../../../../etc/hostname");
    write(&json);
    let message = gltf::read(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(message.contains("/buffers/0: no file `missing.bin`"), "{message}");
    let place = message.split(": error").next().unwrap().rsplit(':').map(str::to_owned).collect::<Vec<_>>();
    assert!(place[1].parse::<u32>().unwrap() > 10, "{message}");

    json["images"] = json!([{"uri": "data:image/png;base64,iVBORw0KGgo="}]);
    json["buffers"][0]["uri"] = json!("data.bin");
    json["buffers"][0]["byteLength"] = json!(b.bin.len() + 1);
    write(&json);
    let message = gltf::read(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(message.contains("but there are only"), "{message}");
    json["buffers"][0]["byteLength"] = json!(b.bin.len());
    write(&json);
    let desc = gltf::read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(desc.images[0].value.source, ImageSource::Embedded(b"\x89PNG\r\n\x1a\n".to_vec()));
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(gltf::read(Path::new("no/such.glb"), &ReadOptions::default()).is_err());
}
