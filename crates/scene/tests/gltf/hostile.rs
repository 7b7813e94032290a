//! Files that are cut off, contradict themselves or want too much: an error with its place, in bounded time and memory.

use std::path::Path;
use std::time::{Duration, Instant};

use etendue_scene::formats::{ReadOptions, gltf};
use etendue_scene::{ReadError, SceneDesc};
use serde_json::json;

use crate::animation::moving;
use crate::build::{Build, F32, U16, f32s, glb, u16s};

/// All of these take well under a second; the limit only tells a hang from a busy machine.
const LIMIT: Duration = Duration::from_secs(20);

fn read(bytes: &[u8]) -> Result<SceneDesc, ReadError> {
    gltf::read_bytes(bytes, Path::new("hostile.glb"), &ReadOptions { time: Some(0.5), ..ReadOptions::default() })
}

/// A file with a bit of everything.
fn rich() -> Build {
    let mut b = Build::triangle().with_material(json!({
        "alphaMode": "MASK", "normalTexture": {"index": 0}, "emissiveFactor": [1, 1, 1],
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}},
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": {"thicknessFactor": 1,
            "attenuationDistance": 1, "attenuationColor": [0.5, 0.5, 0.5]}, "KHR_materials_ior": {"ior": 1.4}},
    }));
    let normal = b.accessor(&f32s(&[0.0, 0.0, 1.0].repeat(3)), F32, "VEC3", 3);
    let uv = b.accessor(&f32s(&[0.0; 6]), F32, "VEC2", 3);
    let indices = b.accessor(&u16s(&[0, 1, 2]), U16, "SCALAR", 3);
    let view = b.view(&[0xD1, 0x00, 0x04, 0x04, 0, 0, 0, 0]);
    let mut e = b.json["bufferViews"][view].clone();
    e["byteStride"] = json!(2);
    e["count"] = json!(3);
    e["mode"] = json!("INDICES");
    let v = b.push("bufferViews", json!({"buffer": 0, "byteLength": 6, "extensions": {"EXT_meshopt_compression": e}}));
    let a = b.push("accessors", json!({"bufferView": v, "componentType": U16, "type": "SCALAR", "count": 3}));
    b.primitive()["attributes"]["NORMAL"] = json!(normal);
    b.primitive()["attributes"]["TEXCOORD_0"] = json!(uv);
    b.primitive()["indices"] = json!(indices);
    let mut second = b.primitive().clone();
    second["indices"] = json!(a);
    b.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(second);
    let sparse_values = b.view(&f32s(&[1.0, 2.0, 3.0]));
    b.json["accessors"][0]["sparse"] =
        json!({"count": 1, "indices": {"bufferView": 0, "componentType": U16}, "values": {"bufferView": sparse_values}});
    b.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1, "aspectRatio": 1.5}}));
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}}]}});
    b.node(json!({"camera": 0, "children": [2], "rotation": [0, 0, 0, 1]}));
    b.push("nodes", json!({"extensions": {"KHR_lights_punctual": {"light": 0}}}));
    b
}

#[test]
fn the_rich_file_is_sound() {
    let desc = rich().read();
    assert_eq!((desc.shapes.len(), desc.cameras.len(), desc.lights.len()), (2, 1, 1));
}

#[test]
fn cut_off_files() {
    let bytes = rich().glb();
    for n in 0..bytes.len() {
        assert!(read(&bytes[..n]).is_err(), "{n} of {} bytes", bytes.len());
    }
}

#[test]
fn places_of_syntax_errors() {
    let Err(ReadError::Invalid { faults, .. }) = read(b"{\n  \"asset\": {\"version\": \"2.0\"},\n  \"nodes\": [}\n") else { panic!() };
    assert_eq!((faults[0].span.line, faults[0].span.column), (3, 13));
    let Err(ReadError::Invalid { faults, .. }) = read(b"{\n \"a\xff\": 1}") else { panic!() };
    assert_eq!((faults[0].span.line, faults[0].message.as_str()), (2, "the JSON is not UTF-8"));
    for bytes in [&b""[..], b"glTF", b"{}", b"[]", b"null", b"\"glTF\"", b"{\"asset\": 1}"] {
        assert!(read(bytes).is_err(), "{bytes:?}");
    }
}

#[test]
fn all_faults_are_listed() {
    let mut b = Build::triangle();
    b.json["nodes"][0]["mesh"] = json!(7);
    b.node(json!({"camera": 0}));
    b.node(json!({"matrix": [1, 2]}));
    let message = b.error();
    for part in
        ["/nodes/0/mesh: 7 is out of range: there are 1 meshes", "/nodes/1/camera: 0 is out of range", "/nodes/2/matrix: expected 16"]
    {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn references_and_sizes_out_of_range() {
    let huge = 4_000_000_000u64;
    for (pointer, value) in [
        ("/accessors/0/count", json!(huge)),
        ("/accessors/0/count", json!(9_007_199_254_740_991u64)),
        ("/accessors/0/count", json!(-1)),
        ("/accessors/0/count", json!(1.5)),
        ("/accessors/0/count", json!(1e300)),
        ("/accessors/0/count", json!("3")),
        ("/accessors/0/componentType", json!(1)),
        ("/accessors/0/componentType", json!(5125)),
        ("/accessors/0/type", json!("VEC5")),
        ("/accessors/0/type", json!("VEC2")),
        ("/accessors/0/byteOffset", json!(huge)),
        ("/accessors/0/byteOffset", json!(9_007_199_254_740_991u64)),
        ("/accessors/0/bufferView", json!(100)),
        ("/accessors/0/sparse/count", json!(huge)),
        ("/accessors/0/sparse/indices/bufferView", json!(99)),
        ("/bufferViews/0/byteLength", json!(huge)),
        ("/bufferViews/0/byteOffset", json!(9_007_199_254_740_991u64)),
        ("/bufferViews/0/byteStride", json!(0)),
        ("/bufferViews/0/byteStride", json!(4)),
        ("/bufferViews/0/byteStride", json!(huge)),
        ("/bufferViews/0/buffer", json!(1)),
        ("/bufferViews/6/extensions/EXT_meshopt_compression/count", json!(huge)),
        ("/bufferViews/6/extensions/EXT_meshopt_compression/byteStride", json!(huge)),
        ("/bufferViews/6/extensions/EXT_meshopt_compression/byteLength", json!(huge)),
        ("/bufferViews/6/extensions/EXT_meshopt_compression/mode", json!("TRIANGLES")),
        ("/meshes/0/primitives/0/indices", json!(0)),
        ("/meshes/0/primitives/0/mode", json!(7)),
        ("/meshes/0/primitives/0/material", json!(1)),
        ("/meshes/0/primitives/0/attributes/NORMAL", json!(2)),
        ("/materials/0/normalTexture/index", json!(5)),
        ("/textures/0/source", json!(5)),
        ("/images/0/bufferView", json!(500)),
        ("/nodes/0/mesh", json!(-1)),
        ("/nodes/1/rotation", json!([0, 0, 1])),
        ("/nodes/1/children", json!([1])),
        ("/nodes/1/children", json!([99])),
        ("/nodes/1/children", json!({})),
        ("/scenes/0/nodes", json!([0, 0])),
        ("/cameras/0/perspective/yfov", json!(0)),
        ("/cameras/0/perspective/yfov", json!(4)),
        ("/cameras/0/type", json!("fisheye")),
    ] {
        let mut b = rich();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        b.json.pointer_mut(parent).unwrap()[key] = value.clone();
        let start = Instant::now();
        let message = match b.read_with(&ReadOptions::default()) {
            Ok(_) => panic!("{pointer} = {value} was read"),
            Err(e) => e.to_string(),
        };
        assert!(message.contains(":1:") && message.contains(": error: /"), "{pointer} = {value}: {message}");
        assert!(start.elapsed() < LIMIT, "{pointer} = {value}");
    }
}

#[test]
fn cycles_and_depth_of_nodes() {
    let mut b = Build::triangle();
    b.json["nodes"] = json!([{"children": [1]}, {"children": [2]}, {"children": [0], "mesh": 0}]);
    assert!(b.error().contains("/nodes/0: the node is its own ancestor or has two parents"));
    // A chain of a hundred thousand nodes is no problem for the stack.
    let n = 100_000;
    b.json["nodes"] = (0..n).map(|i| if i + 1 < n { json!({"children": [i + 1]}) } else { json!({"mesh": 0}) }).collect();
    assert_eq!(b.read().shapes.len(), 1);
}

#[test]
fn deep_and_long_json() {
    assert!(read(&b"[".repeat(5_000_000)).unwrap_err().to_string().contains("nested more than 128 levels"));
    let mut text = br#"{"asset": {"version": "2.0"}, "extras": "#.to_vec();
    text.extend(b"{\"a\":".repeat(1_000_000));
    assert!(read(&text).is_err());
    // Faults without number keep their limit and do not take forever, even on one long line.
    let mut b = Build::new();
    b.json["nodes"] = (0..50_000).map(|_| json!({"mesh": 3})).collect();
    b.json["scenes"][0]["nodes"] = (0..50_000).map(|i| json!(i)).collect();
    let start = Instant::now();
    let Err(ReadError::Invalid { faults, .. }) = b.read_with(&ReadOptions::default()) else { panic!() };
    assert_eq!(faults.len(), 1000);
    assert!(start.elapsed() < LIMIT);
}

#[test]
fn large_base64() {
    let body = "A".repeat(20_000_000);
    let text = format!(
        r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"byteLength": 15000000, "uri": "data:;base64,{body}"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 15000000}}], "accessors": [{{"bufferView": 0, "componentType": 5126, "type": "VEC3",
        "count": 1250000}}], "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}}}]}}], "nodes": [{{"mesh": 0}}]}}"#
    );
    let start = Instant::now();
    assert_eq!(read(text.as_bytes()).unwrap().meshes.len(), 1);
    assert!(read(text.replace("AAAA\"", "AA*A\"").as_bytes()).unwrap_err().to_string().contains("/buffers/0: not base64"));
    assert!(start.elapsed() < LIMIT);
}

#[test]
fn numbers_that_are_none() {
    let mut b = Build::triangle();
    for i in 0..4 {
        b.bin[4 * i..4 * i + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    }
    assert!(b.error().contains("/meshes/0/primitives/0/attributes/POSITION: the position of vertex 0 is not finite"));
    for matrix in [[1e38; 16], [f32::MIN_POSITIVE; 16]] {
        let mut b = Build::triangle();
        b.json["nodes"][0]["matrix"] = json!(matrix);
        assert!(b.error().contains("/nodes/0"));
    }
    let mut b = Build::triangle();
    b.json["nodes"][0] = json!({"scale": [1e30, 1e30, 1e30], "children": [1]});
    b.push("nodes", json!({"scale": [1e30, 1e30, 1e30], "mesh": 0}));
    assert!(b.error().contains("/nodes/1: the node's transform is not finite"));
    let mut b = Build::triangle();
    b.json["nodes"][0]["scale"] = json!([0, 0, 0]);
    let desc = b.read();
    assert!(desc.shapes.is_empty() && desc.report.faults[0].message.contains("makes everything flat"));
}

#[test]
fn a_fault_is_told_once() {
    let mut b = rich();
    b.json["bufferViews"][0]["byteLength"] = json!(1 << 30);
    let message = b.error();
    assert_eq!(message.matches("/bufferViews/0: ").count(), 1, "{message}");
}

/// Little that asks for much: many primitives that take the same accessor, accessors without data.
#[test]
fn memory_is_bounded() {
    let mut b = Build::triangle();
    b.json["accessors"][0] = json!({"componentType": F32, "type": "VEC3", "count": 1_000_000});
    let primitive = b.primitive().clone();
    b.json["meshes"][0]["primitives"] = (0..1000).map(|_| primitive.clone()).collect();
    let start = Instant::now();
    assert!(b.error().contains("more than a file of this size may ask for"));
    assert!(start.elapsed() < LIMIT);
}

/// The seeds of the fuzz target (`fuzz/corpus/gltf`).
fn corpus() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/gltf");
    let mut paths: Vec<_> = std::fs::read_dir(folder).map(|d| d.map(|e| e.unwrap().path()).collect()).unwrap_or_default();
    paths.sort();
    paths.iter().map(|p| std::fs::read(p).unwrap()).collect()
}

/// The seeds are those that this file makes. `ETENDUE_WRITE_CORPUS=1 cargo test -p etendue-scene --test gltf corpus` makes them anew.
#[test]
fn corpus_is_current() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/gltf");
    let write = std::env::var_os("ETENDUE_WRITE_CORPUS").is_some();
    let seed = |name: &str, bytes: Vec<u8>| {
        let path = folder.join(name);
        if write {
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(&path, &bytes).unwrap();
        }
        assert!(std::fs::read(&path).unwrap() == bytes, "{name} is not what the test makes");
    };
    let b = rich();
    seed("rich.glb", b.glb());
    seed("animation.glb", moving().glb());
    seed("triangle.glb", Build::triangle().glb());
    let mut json = b.json;
    json["buffers"] = json!([{"byteLength": 9, "uri": "data:;base64,AAAAAAAAgD8A"}]);
    seed("data.gltf", serde_json::to_vec_pretty(&json).unwrap());
    let compressed = "a1ffff00efaf682787c1e00bf43b163e85b7c9e";
    seed("text.gltf", format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"extras\": \"{compressed}\\u00e9\"}}").into_bytes());
}

/// Changes bytes and JSON values at random, always the same ones; nothing may panic or hang. `ETENDUE_MUTATIONS` asks for more.
#[test]
fn mutated_files() {
    let mut state = 0x2545_F491_4F6C_DD1Du64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as usize
    };
    let seeds_of_json = [rich(), moving()];
    let mut seeds = corpus();
    seeds.extend(seeds_of_json.iter().map(Build::glb));
    let numbers = ["0", "-1", "1", "3", "255", "65536", "4294967296", "9007199254740993", "1e308", "0.5", "null", "[]", "{}", "\"x\""];
    let start = Instant::now();
    let mut good = 0;
    let count = std::env::var("ETENDUE_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(6000);
    for i in 0..count {
        let result = if i % 2 == 0 {
            let mut changed = seeds[random() % seeds.len()].clone();
            for _ in 0..1 + random() % 4 {
                let at = random() % changed.len();
                changed[at] = random() as u8;
            }
            read(&changed)
        } else {
            // Replace one number of the JSON.
            let seed = &seeds_of_json[i / 2 % 2];
            let text = serde_json::to_string(&seed.json).unwrap();
            let places: Vec<usize> = text.match_indices(|c: char| c.is_ascii_digit()).map(|(i, _)| i).collect();
            let at = places[random() % places.len()];
            let end = at + text[at..].find(|c: char| !c.is_ascii_digit()).unwrap();
            let changed = format!("{}{}{}", &text[..at], numbers[random() % numbers.len()], &text[end..]);
            let with_buffer = changed.replacen('{', &format!("{{\"buffers\":[{{\"byteLength\":{}}}],", seed.bin.len()), 1);
            read(&glb(with_buffer.as_bytes(), &seed.bin))
        };
        // What was read can be written.
        good += usize::from(result.is_ok_and(|desc| gltf::write_glb(&desc).is_ok()));
    }
    assert!(good > 500, "only {good} were read: the mutations are too wild to test much");
    assert!(count > 6000 || start.elapsed() < LIMIT);
}
