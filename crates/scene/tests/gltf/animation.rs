//! Animations: nodes, cameras, skins and morph targets at a moment.

use etendue_scene::formats::ReadOptions;
use etendue_scene::{ReadError, SceneDesc};
use glam::{Mat4, Quat, Vec3};
use serde_json::json;

use crate::build::{Build, F32, I16, U8, f32s, mesh_of};

fn at(b: &Build, time: f64) -> Result<SceneDesc, ReadError> {
    b.read_with(&ReadOptions { time: Some(time), ..ReadOptions::default() })
}

/// A sampler with keys at 0 and 2 seconds.
fn sampler(b: &mut Build, values: &[f32], kind: &str, interpolation: &str) -> serde_json::Value {
    let input = b.accessor(&f32s(&[0.0, 2.0]), F32, "SCALAR", 2);
    b.json["accessors"][input]["min"] = json!([0.0]);
    b.json["accessors"][input]["max"] = json!([2.0]);
    let width = match kind {
        "VEC3" => 3,
        "VEC4" => 4,
        _ => 1,
    };
    let output = b.accessor(&f32s(values), F32, kind, values.len() / width);
    json!({"input": input, "output": output, "interpolation": interpolation})
}

/// The triangle on a node that moves, turns and grows below a parent that moves.
pub fn moving() -> Build {
    let mut b = Build::triangle();
    b.json["scenes"][0]["nodes"] = json!([1]);
    b.push("nodes", json!({"children": [0], "translation": [0, 0, 5], "camera": 0}));
    b.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}));
    let half = 0.5f32.sqrt();
    let samplers = [
        sampler(&mut b, &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0], "VEC3", "LINEAR"),
        sampler(&mut b, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half], "VEC4", "LINEAR"),
        sampler(&mut b, &[1.0, 1.0, 1.0, 3.0, 3.0, 3.0], "VEC3", "STEP"),
        sampler(&mut b, &[0.0, 0.0, 5.0, 0.0, 0.0, 7.0], "VEC3", "LINEAR"),
    ];
    let channel = |sampler: usize, node: usize, path: &str| json!({"sampler": sampler, "target": {"node": node, "path": path}});
    let channels = [channel(0, 0, "translation"), channel(1, 0, "rotation"), channel(2, 0, "scale"), channel(3, 1, "translation")];
    b.push("animations", json!({"name": "go", "samplers": samplers, "channels": channels}));
    b
}

#[test]
fn nodes_move_with_their_parents() {
    let b = moving();
    for (time, share, scale) in [(-1.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.5, 0.25, 1.0), (2.0, 1.0, 3.0), (9.0, 1.0, 3.0)] {
        let desc = at(&b, time).unwrap();
        let turn = Quat::from_rotation_z(share * std::f32::consts::FRAC_PI_2);
        let place = Vec3::new(4.0 * share, 0.0, 5.0 + 2.0 * share);
        let expected = Mat4::from_scale_rotation_translation(Vec3::splat(scale), turn, place);
        let found = desc.shapes[0].value.world_from_object;
        assert!(found.abs_diff_eq(expected, 1e-5), "{time}: {found} instead of {expected}");
        let camera = desc.cameras[0].value.world_from_camera.w_axis.truncate();
        assert!((camera - Vec3::new(0.0, 0.0, 5.0 + 2.0 * share)).length() < 1e-5, "{time}: {camera}");
        assert!(desc.report.losses.is_empty(), "{:?}", desc.report.losses);
    }
    // Without a time the nodes are where they say, which is reported.
    let still = b.read();
    assert_eq!(still.shapes[0].value.world_from_object, Mat4::from_translation(Vec3::new(0.0, 0.0, 5.0)));
    assert_eq!(still.report.losses[0].feature, "animations");
    assert_eq!((still.animations[0].name.as_str(), still.animations[0].secs), ("go", 2.0));
}

#[test]
fn the_animation_is_chosen_by_name_or_number() {
    let mut b = moving();
    let mut second = b.json["animations"][0].clone();
    second["name"] = json!("stay");
    second["channels"] = json!([]);
    b.push("animations", second);
    let place = |name: Option<&str>| {
        let options = ReadOptions { time: Some(2.0), animation: name.map(str::to_owned), ..ReadOptions::default() };
        b.read_with(&options).map(|d| (d.shapes[0].value.world_from_object.w_axis.x, d.report.faults.len())).map_err(|e| e.to_string())
    };
    // The first, with a warning that there are others.
    assert_eq!(place(None).unwrap(), (4.0, 1));
    assert_eq!(place(Some("go")).unwrap(), (4.0, 0));
    assert_eq!(place(Some("stay")).unwrap(), (0.0, 0));
    assert_eq!(place(Some("1")).unwrap(), (0.0, 0));
    assert!(place(Some("fly")).unwrap_err().contains("no animation `fly`; there are: 0 `go`, 1 `stay`"));
}

#[test]
fn joints_and_weights_move() {
    let mut b = Build::triangle();
    let joints = b.accessor(&[0; 12], U8, "VEC4", 3);
    let weights = b.accessor(&f32s(&[1.0, 0.0, 0.0, 0.0].repeat(3)), F32, "VEC4", 3);
    b.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    b.primitive()["attributes"]["WEIGHTS_0"] = json!(weights);
    let delta = b.accessor(&f32s(&[0.0, 1.0, 0.0].repeat(3)), F32, "VEC3", 3);
    b.primitive()["targets"] = json!([{"POSITION": delta}, {"POSITION": delta}]);
    let joint = b.node(json!({}));
    b.push("skins", json!({"joints": [joint]}));
    b.json["nodes"][0]["skin"] = json!(0);
    let samplers = [
        sampler(&mut b, &[0.0, 0.0, 0.0, 0.0, 0.0, 8.0], "VEC3", "LINEAR"),
        // Two targets: two values for each key.
        sampler(&mut b, &[0.0, 0.0, 1.0, 0.5], "SCALAR", "LINEAR"),
    ];
    let channels =
        json!([{"sampler": 0, "target": {"node": joint, "path": "translation"}}, {"sampler": 1, "target": {"node": 0, "path": "weights"}}]);
    b.push("animations", json!({"samplers": samplers, "channels": channels}));
    let desc = at(&b, 1.0).unwrap();
    assert_eq!(mesh_of(&desc, &desc.shapes[0].value).positions[0], Vec3::new(0.0, 0.75, 4.0));
}

#[test]
fn rotations_may_be_short_integers() {
    let mut b = moving();
    let values: Vec<u8> = [0i16, 0, 0, 32767, 0, 0, 32767, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let output = b.accessor(&values, I16, "VEC4", 2);
    b.json["accessors"][output]["normalized"] = json!(true);
    b.json["animations"][0]["samplers"][1]["output"] = json!(output);
    let x = at(&b, 1.0).unwrap().shapes[0].value.world_from_object.x_axis.truncate();
    assert!((x - Vec3::Y).length() < 1e-5, "{x}");
}

#[test]
fn faults_have_their_places() {
    let broken = |change: fn(&mut serde_json::Value)| {
        let mut b = moving();
        change(&mut b.json);
        at(&b, 1.0).map_err(|e| e.to_string())
    };
    type Case = (fn(&mut serde_json::Value), &'static str);
    let cases: [Case; 8] = [
        (|j| j["animations"][0]["channels"][0]["sampler"] = json!(9), "/animations/0/channels/0: there is no sampler 9"),
        (|j| j["animations"][0]["channels"][0]["target"]["node"] = json!(9), "/animations/0/channels/0/target/node"),
        (|j| j["animations"][0]["channels"][0]["target"]["path"] = json!("color"), "unknown or missing `path`"),
        (|j| j["animations"][0]["samplers"][0]["interpolation"] = json!("BEZIER"), "unknown interpolation `BEZIER`"),
        (|j| j["animations"][0]["samplers"][0]["interpolation"] = json!("CUBICSPLINE"), "2 keys do not go with 2 values"),
        (|j| j["animations"][0]["samplers"][0]["output"] = json!(9_999), "/animations/0/samplers/0/output"),
        (|j| j["nodes"][0]["matrix"] = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), "the node has a matrix"),
        (|j| j["animations"][0]["samplers"][0]["input"] = j["animations"][0]["samplers"][0]["output"].clone(), "type that is not allowed"),
    ];
    for (change, message) in cases {
        let error = broken(change).unwrap_err();
        assert!(error.contains(message), "{message}: {error}");
    }
    // A channel without a node is an extension's.
    let odd = broken(|j| drop(j["animations"][0]["channels"][0]["target"].as_object_mut().unwrap().remove("node"))).unwrap();
    assert_eq!(odd.shapes[0].value.world_from_object.w_axis.x, 0.0);
    let mut b = moving();
    let input = b.accessor(&f32s(&[2.0, 1.0]), F32, "SCALAR", 2);
    b.json["animations"][0]["samplers"][0]["input"] = json!(input);
    assert!(at(&b, 1.0).unwrap_err().to_string().contains("each later than the one before"));
}
