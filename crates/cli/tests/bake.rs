//! `etendue bake` as a script sees it.

use std::path::Path;
use std::process::{Command, Output};

fn run(dir: &Path, args: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_etendue")).args(args.split_whitespace()).current_dir(dir).output().expect("the command starts")
}

/// A cube under a lamp.
const SCENE: &str = r#"<scene version="3.0.0">
    <sensor type="perspective"><transform name="to_world"><lookat origin="0, 2, 5" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
    <shape type="cube"><bsdf type="diffuse"/></shape>
    <emitter type="point"><point name="position" x="1" y="3" z="2"/><rgb name="intensity" value="10, 10, 10"/></emitter>
</scene>"#;

#[test]
fn a_bake_has_the_same_bytes_for_any_threads_and_after_interruptions() {
    let dir = std::env::temp_dir().join(format!("etendue-cli-bake-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    std::fs::write(dir.join("a.xml"), SCENE).unwrap();
    let bake = |args: &str| {
        let output = run(&dir, &format!("bake a.xml --resolution 64 {args}"));
        assert_eq!(output.status.code(), Some(0), "{args}: {}", String::from_utf8_lossy(&output.stderr));
    };
    bake("-o one.glb --spp 5 -j 1 --exr --directional --probes 2,1,1");
    bake("-o two.glb --spp 2 -j 2 --checkpoint half --probes 2,1,1");
    bake("-o two.glb --spp 5 -j 2 --checkpoint half --resume --probes 2,1,1");
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert!(read("one.glb") == read("two.glb"));
    assert!(dir.join("one.0.exr").exists() && dir.join("one.probes.json").exists());
    let refused = |args: &str, code: i32, said: &str| {
        let output = run(&dir, args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{args}: {message}");
        assert!(message.contains(said), "{args}: {message}");
    };
    refused("bake a.xml -o a.obj", 2, ".glb");
    refused("bake a.xml -o a.glb --method magic", 2, "radiosity");
    refused("bake a.xml -o a.glb --resolution 3", 2, "16 to 16384");
    refused("bake a.xml -o a.glb --resolution 32 --resume half", 3, "another scene or other settings");
    refused("bake nowhere.xml -o a.glb", 4, "nowhere.xml");
    std::fs::remove_dir_all(&dir).unwrap();
}

/// An OBJ file of a square with what is broken about it.
fn broken(vertices: &str, faces: &str) -> String {
    format!("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n{vertices}f 1 2 3\nf 1 3 4\n{faces}")
}

#[test]
fn broken_meshes_are_baked_with_a_report_or_refused_with_a_sentence() {
    let dir = std::env::temp_dir().join(format!("etendue-cli-broken-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    let scene = r#"<scene version="3.0.0">
        <sensor type="perspective"><transform name="to_world"><lookat origin="0, -2, 3" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>
        <shape type="obj"><string name="filename" value="a.obj"/><bsdf type="diffuse"/></shape>
        <emitter type="constant"><rgb name="radiance" value="1, 1, 1"/></emitter>
    </scene>"#;
    std::fs::write(dir.join("a.xml"), scene).unwrap();
    // What it is, the file, the exit code and what is said.
    let cases = [
        ("sound", broken("", ""), 0, ""),
        ("non-manifold", broken("v 0.5 0.5 1\n", "f 1 3 5\n"), 0, ""),
        ("zero-area", broken("v 0.5 0 0\n", "f 1 5 2\n"), 0, "without area"),
        ("twice", broken("", "f 2 3 1\n"), 0, "lie twice"),
        ("overlapping", broken("v 0.2 0.9 0\n", "f 2 5 1\n"), 0, ""),
        ("normals of length 0", broken("vn 0 0 0\n", "").replace("f 1 2 3", "f 1//1 2//1 3//1"), 0, ""),
        ("not a number", broken("v nan 0 0\n", "f 1 2 5\n"), 0, "no finite position"),
        ("infinite", broken("v 1e39 0 0\n", "f 1 2 5\n"), 0, "no finite position"),
        ("far beyond", broken("v 1e30 0 0\n", "f 1 2 5\n"), 0, "not finite"),
        ("giant", "v 0 0 0\nv 1e12 0 0\nv 0 1e12 0\nf 1 2 3\n".into(), 0, ""),
        ("no triangles", "v 0 0 0\n".into(), 3, "nothing to bake"),
        ("all without area", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n".into(), 3, "nothing to bake"),
    ];
    for (what, mesh, code, said) in &cases {
        std::fs::write(dir.join("a.obj"), mesh).unwrap();
        let methods: &[&str] = if *code == 0 { &["path", "radiosity", "particles"] } else { &["path"] };
        for method in methods {
            let _ = std::fs::remove_file(dir.join("a.glb"));
            let output = run(&dir, &format!("bake a.xml -o a.glb --method {method} --resolution 32 --spp 2 --photons 2000"));
            let message = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(!message.contains("panicked"), "{what} by {method}: {message}");
            assert!(message.contains(said), "{what} by {method}: {message}");
            if *code == 0 {
                assert_eq!(output.status.code(), Some(0), "{what} by {method}: {message}");
                assert!(std::fs::metadata(dir.join("a.glb")).unwrap().len() > 500, "{what} by {method}");
                let shown = run(&dir, "render a.glb -o a.png --width 8 --height 8 --spp 1 --max-depth 0 --quiet");
                assert_eq!(shown.status.code(), Some(0), "{what} by {method}: {}", String::from_utf8_lossy(&shown.stderr));
            } else {
                assert!(output.status.code().is_some_and(|c| c != 0), "{what} by {method}: {message}");
                assert!(!dir.join("a.glb").exists(), "{what}: nothing is written");
            }
        }
    }
    std::fs::remove_dir_all(&dir).unwrap();
}
