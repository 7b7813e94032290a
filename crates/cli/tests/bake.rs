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
