//! Combinations, insides, normals and boxes of solids against what POV-Ray says of the same file by `trace`, `inside`, `min_extent`.

use std::path::Path;
use std::sync::{Arc, Mutex};

use etendue_render::solid::WorldProbe;
use etendue_scene::formats::ReadOptions;
use etendue_scene::formats::pov::{self, PovOptions, Stream};

/// Numbers with few digits may round either way.
fn same(a: &str, b: &str) -> bool {
    let split = |s: &str| -> Vec<String> { s.split([' ', '(', ')']).filter(|w| !w.is_empty()).map(str::to_owned).collect() };
    let (a, b) = (split(a), split(b));
    a.len() == b.len()
        && a.iter().zip(&b).all(|(a, b)| match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(x), Ok(y)) if a.contains('.') => (x - y).abs() < 0.1001 * if x.abs() > 1.01 { 0.11 } else { 1.0 },
            _ => a == b,
        })
}

#[test]
fn as_pov_ray_measures_them() {
    let lines = Arc::new(Mutex::new(String::new()));
    let sink = lines.clone();
    let options = PovOptions {
        probe: Some(Arc::new(WorldProbe::new())),
        messages: Some(Arc::new(move |stream, text: &str| {
            if stream == Stream::Debug {
                sink.lock().unwrap().push_str(text);
            }
        })),
        ..PovOptions::default()
    };
    let scene = include_bytes!("pov_solids/combinations.pov");
    let read = pov::read_bytes(Path::new("combinations.pov"), scene, &ReadOptions { pov: options, ..ReadOptions::default() });
    assert!(read.is_ok(), "{:?}", read.err());
    let found = lines.lock().unwrap().clone();
    let found: Vec<&str> = found.lines().filter_map(|l| l.strip_prefix("R ")).collect();
    let expected: Vec<&str> = include_str!("pov_solids/combinations.txt").lines().collect();
    let wrong: Vec<String> = found.iter().zip(&expected).filter(|(f, e)| !same(f, e)).map(|(f, e)| format!("{f}\n  not {e}")).collect();
    assert!(wrong.is_empty(), "{} of {} differ:\n{}", wrong.len(), expected.len(), wrong.join("\n"));
    assert_eq!(found.len(), expected.len());
}
