//! `etendue photons` as a script sees it: maps in parts, merged, gone on with, used for views; exit codes.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SCENE: &str = r#"<scene version="3.0.0">
  <sensor type="perspective" id="front">
    <transform name="to_world"><lookat origin="0, -5, 2" target="0, 0, 0.5" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film>
  </sensor>
  <sensor type="perspective" id="top">
    <transform name="to_world"><lookat origin="0, 0, 6" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/></transform></shape>
  <shape type="sphere">
    <point name="center" x="0" y="0" z="0.6"/><float name="radius" value="0.6"/><bsdf type="dielectric"/>
  </shape>
  <emitter type="point"><point name="position" x="1" y="-1" z="3"/></emitter>
</scene>
"#;

struct Dir(PathBuf);

impl Dir {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("etendue-photons-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        std::fs::write(path.join("scene.xml"), SCENE).unwrap();
        Self(path)
    }

    fn run(&self, args: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_etendue")).args(args).current_dir(&self.0).output().unwrap()
    }

    #[track_caller]
    fn ok(&self, args: &str) {
        let args: Vec<&str> = args.split(' ').collect();
        let out = self.run(&args);
        assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(Path::new(&self.0).join(name)).unwrap()
    }
}

impl Drop for Dir {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn parts_merge_into_the_bytes_of_one_run_and_serve_two_views() {
    let dir = Dir::new("merge");
    dir.ok("photons trace scene.xml -o all.photons --photons 20000 --seed 3 -q");
    dir.ok("photons trace scene.xml -o a.photons --photons 7000 --seed 3 -j 1");
    dir.ok("photons trace scene.xml -o b.photons --first-photon 7000 --photons 13000 --seed 3 -q");
    dir.ok("photons merge b.photons a.photons -o merged.photons");
    assert!(dir.bytes("merged.photons") == dir.bytes("all.photons"));
    // Going on with a part.
    dir.ok("photons trace scene.xml -o a.photons --photons 20000 --seed 3 --resume -q");
    assert!(dir.bytes("a.photons") == dir.bytes("all.photons"));
    let info = dir.run(&["photons", "info", "all.photons"]);
    assert!(String::from_utf8_lossy(&info.stdout).contains("20000 photons"));
    for camera in ["front", "top"] {
        dir.ok(&format!("render scene.xml --integrator particles --photon-map all.photons --camera {camera} --spp 1 -q -o {camera}.exr"));
    }
    assert!(dir.bytes("front.exr") != dir.bytes("top.exr"));
}

#[test]
fn what_cannot_be_says_so() {
    let dir = Dir::new("errors");
    dir.ok("photons trace scene.xml -o a.photons --photons 2000 -q");
    let code = |args: &str| dir.run(&args.split(' ').collect::<Vec<_>>()).status.code();
    assert_eq!(code("photons merge a.photons a.photons -o b.photons"), Some(3));
    assert!(!dir.0.join("b.photons").exists());
    assert_eq!(code("photons trace scene.xml -o c.photons --photons 0"), Some(2));
    assert_eq!(code("photons trace scene.xml -o missing/c.photons"), Some(4));
    assert_eq!(code("photons info missing.photons"), Some(4));
    assert_eq!(code("photons info scene.xml"), Some(3));
    assert_eq!(code("photons trace scene.xml -o a.photons --seed 9 --resume -q"), Some(3));
    std::fs::write(dir.0.join("other.xml"), SCENE.replace("0.6", "0.7")).unwrap();
    let out = dir.run(&["render", "other.xml", "--integrator", "particles", "--photon-map", "a.photons", "-o", "x.exr"]);
    assert!(!out.status.success() && String::from_utf8_lossy(&out.stderr).contains("another scene"));
}
