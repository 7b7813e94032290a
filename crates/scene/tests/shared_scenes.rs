//! Real scenes that are no part of the project; skipped aloud where they are not beside it.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use std::path::PathBuf;

use etendue_scene::formats::{ReadOptions, read};

fn shared(name: &str) -> Option<PathBuf> {
    let mut folder = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    loop {
        let path = folder.join("shared/scenes").join(name);
        if path.is_file() {
            return Some(path);
        }
        if !folder.pop() {
            println!("skipped: no shared/scenes/{name} beside the project");
            return None;
        }
    }
}

#[test]
fn mitsuba_scenes_are_read_without_fault() {
    for (name, shapes) in [
        ("cornell.xml", 8),
        ("caustic.xml", 8),
        ("veach-mis.xml", 11),
        ("env-materials.xml", 4),
        ("many-lights.xml", 246),
        ("kitchen/scene.xml", 286),
    ] {
        let Some(path) = shared(name) else { continue };
        let start = std::time::Instant::now();
        let desc = read(&path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        let triangles: usize = desc.meshes.iter().filter_map(|m| m.value.data.as_ref()).map(|d| d.triangles.len()).sum();
        println!("{name}: {} shapes, {triangles} triangles, {:?}", desc.shapes.len(), start.elapsed());
        assert_eq!(desc.shapes.len(), shapes, "{name}");
        assert!(desc.report.faults.is_empty() && desc.report.losses.is_empty(), "{name}: {:?}", desc.report);
        assert_eq!(desc.cameras.len(), 1);
        assert_eq!(desc.integrator.max_depth, Some(if name == "many-lights.xml" { 7 } else { 15 }));
    }
}
