//! `etendue light` as a script sees it.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

use std::path::PathBuf;
use std::process::{Command, Output};

use etendue_render::image::Image;

/// A floor under a point light of 1 W/sr at height 2.
const SCENE: &str = r#"<scene version="3.0.0">
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, -5, 2" target="0, 0, 0.5" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film>
  </sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/></transform><bsdf type="diffuse"/></shape>
  <emitter type="point"><point name="position" x="0" y="0" z="2"/><rgb name="intensity" value="1"/></emitter>
</scene>
"#;

struct Dir(PathBuf);

impl Dir {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("etendue-light-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        std::fs::write(path.join("scene.xml"), SCENE).unwrap();
        Self(path)
    }

    fn run(&self, args: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_etendue")).args(["light", "scene.xml"]).args(args).current_dir(&self.0).output().unwrap()
    }
}

impl Drop for Dir {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const GRID: &str = "name=a \"b\",position=0 0 1,normal=0 0 1,columns=3,rows=2,spacing=0.5";

#[test]
fn grids_are_reported_as_csv_json_and_pictures() {
    let dir = Dir::new("grid");
    let out =
        dir.run(&["--grid", GRID, "--sensor-samples", "16", "--max-depth", "1", "-o", "a.csv", "-o", "a.json", "--grid-picture", "a.png"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    assert!(String::from_utf8_lossy(&out.stdout).contains("6 sensors"));
    let csv = std::fs::read_to_string(dir.0.join("a.csv")).unwrap();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 7);
    assert!(lines[1].starts_with("\"a \"\"b\"\"\",0,0,"));
    // Below the light but for a quarter of a unit: 683 / d² · cos.
    let middle: f64 = lines[2].split(',').nth(9).unwrap().parse().unwrap();
    let d2: f64 = 1.0 + 0.25 * 0.25;
    assert!((middle / (683.0 / (d2 * d2.sqrt())) - 1.0).abs() < 1e-3, "{middle}");
    let json: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(dir.0.join("a.json")).unwrap()).unwrap();
    let grid = &json["grids"][0];
    assert_eq!(grid["readings"].as_array().unwrap().len(), 6);
    let ratio = grid["min_lux"].as_f64().unwrap() / grid["mean_lux"].as_f64().unwrap();
    assert!((grid["uniformity_min_over_mean"].as_f64().unwrap() - ratio).abs() < 1e-9);
    let picture = Image::load(&dir.0.join("a.png")).unwrap();
    assert!(picture.width > 480 && picture.height == 320);
}

#[test]
fn pictures_are_in_false_color_or_numbers() {
    let dir = Dir::new("picture");
    let out = dir.run(&["--illuminance", "e.exr", "--illuminance", "e.png", "--luminance", "l.exr", "--max", "200", "--max-depth", "1"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let numbers = |name: &str| Image::load(&dir.0.join(name)).unwrap().channel("Y").unwrap().to_vec();
    let (lux, nits) = (numbers("e.exr"), numbers("l.exr"));
    // A diffuse floor of reflectance one half: L = E / 2π.
    let (i, e) = lux.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
    assert!(*e > 100.0 && (nits[i] / (e * 0.5 / std::f32::consts::PI) - 1.0).abs() < 0.1, "{e} lx, {} cd/m²", nits[i]);
    assert!(dir.0.join("e.png").exists());
}

#[test]
fn mistakes_are_told_before_any_work() {
    let dir = Dir::new("mistakes");
    for (args, part) in [
        (&[][..], "nothing to measure"),
        (&["--grid", "position=0 0 0"][..], "normal"),
        (&["--grid", GRID, "-o", "a.txt"][..], ".csv or .json"),
        (&["--grid", GRID, "--efficacy", "0"][..], "efficacy"),
        (&["--grid", GRID, "--sensor-samples", "0"][..], "samples"),
    ] {
        let out = dir.run(args);
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(!out.status.success() && text.contains(part), "{args:?}: {text}");
    }
}
