//! `etendue compare` and `etendue merge` as a script sees them.

// `allow-unwrap-in-tests` does not reach the helpers of integration tests.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use etendue_render::film::{Channel, Film, FilmSpec};
use etendue_render::image::{Image, WriteOptions};

struct Dir(PathBuf);

impl Dir {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("etendue-cli-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Runs `etendue` here with arguments separated by blanks.
    fn run(&self, args: &str) -> Output {
        Command::new(env!("CARGO_BIN_EXE_etendue")).args(args.split_whitespace()).current_dir(&self.0).output().unwrap()
    }
}

impl Drop for Dir {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn write_picture(path: &Path, width: u32, scale: f32) {
    let pixels: Vec<_> = (0..width * 16).map(|i| [0.2, 0.5, (i % width) as f32 / width as f32].map(|v| v * scale)).collect();
    let mut image = Image::from_rgb(width, 16, &pixels);
    image.push("N.X", vec![scale; pixels.len()]);
    for name in ["N.Y", "N.Z"] {
        image.push(name, vec![0.0; pixels.len()]);
    }
    image.save(path, &WriteOptions::default()).unwrap();
}

#[test]
fn compare_prints_figures_and_its_exit_code_tells_the_verdict() {
    let dir = Dir::new("compare");
    write_picture(&dir.path("a.exr"), 20, 1.0);
    write_picture(&dir.path("b.exr"), 20, 1.1);
    write_picture(&dir.path("wide.exr"), 21, 1.0);
    write_picture(&dir.path("a.png"), 20, 1.0);
    let same = dir.run("compare a.exr a.exr --threshold flip=0 --threshold ssim=1 --heatmap map.png");
    assert_eq!(same.status.code(), Some(0), "{}", text(&same.stdout));
    assert!(Image::load(&dir.path("map.png")).is_ok());
    let off = dir.run("compare b.exr a.exr --threshold mean=0.01 --threshold psnr=10");
    assert_eq!(off.status.code(), Some(10));
    let out = text(&off.stdout);
    assert!(out.contains("over threshold: mean is 0.1000") && out.contains("HDR-FLIP") && !out.contains("threshold: psnr"), "{out}");
    let json = dir.run("compare a.png a.exr --json --threshold mse=1");
    let value: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert!(value["mse"].as_f64().unwrap() < 1e-4 && value["exceeded"].as_array().unwrap().is_empty());
    let one = dir.run("compare b.exr a.exr --metric mae --channel N");
    assert_eq!(text(&one.stdout).trim(), "mae             0.033333");
    for (args, code, message) in [
        ("compare a.exr wide.exr", 3, "different sizes, 20x16 and 21x16"),
        ("compare a.exr missing.exr", 4, "missing.exr"),
        ("compare a.exr a.exr --channel uv", 1, "no channel or layer \"uv\""),
        ("compare a.exr a.exr --threshold fun=1", 2, "not one of"),
        ("compare a.exr a.exr --threshold mse=x", 2, "not a number"),
        ("compare a.exr a.exr --threshold mse=NaN", 2, "not a number"),
    ] {
        let output = dir.run(args);
        assert_eq!(output.status.code(), Some(code), "{args}");
        assert!(text(&output.stderr).contains(message), "{args}: {}", text(&output.stderr));
    }
}

/// A film of 20 × 10 pixels with samples `begin..end`.
fn film(begin: u32, end: u32, seed: u64) -> Film {
    let mut spec = FilmSpec::new(20, 10);
    spec.channels.extend([Channel::mean("albedo.R"), Channel::mean("Z"), Channel::first("id.object")]);
    let mut film = Film::new(spec).unwrap();
    film.meta.seed = seed;
    film.meta.renderer = "etendue test".into();
    for (index, x, y) in (begin..end).flat_map(|i| (0..200).map(move |p| (i, p % 20, p / 20))) {
        let v = 1.0 / (1 + index * 7 + x * y) as f32;
        film.add_sample(x, y, index, 1.0, &[v, 2.0 * v, 0.3, 1.0, 0.7, x as f32, 5.0]);
    }
    film.mark_held(film.rect(), begin, end).unwrap();
    film
}

#[test]
fn merge_is_exact_and_refuses_what_does_not_fit() {
    let dir = Dir::new("merge");
    for (name, begin, end, seed) in [("a", 0, 3, 0), ("b", 3, 8, 0), ("c", 8, 9, 0), ("all", 0, 9, 0), ("other", 9, 10, 1)] {
        film(begin, end, seed).save(&dir.path(&format!("{name}.film"))).unwrap();
    }
    let merged = dir.run("merge c.film a.film b.film -o sum.film");
    assert_eq!(merged.status.code(), Some(0), "{}", text(&merged.stderr));
    assert!(text(&merged.stderr).contains("merged 3 films: samples 0..9"));
    assert_eq!(std::fs::read(dir.path("sum.film")).unwrap(), std::fs::read(dir.path("all.film")).unwrap());
    assert_eq!(dir.run("merge a.film b.film -o ab.exr").status.code(), Some(0));
    assert_eq!(dir.run("merge b.film a.film -o ba.exr").status.code(), Some(0));
    assert_eq!(std::fs::read(dir.path("ab.exr")).unwrap(), std::fs::read(dir.path("ba.exr")).unwrap());
    let image = Image::load(&dir.path("ab.exr")).unwrap();
    assert_eq!(image.channel("sampleCount").unwrap()[7], 8.0);
    assert_eq!(dir.run("merge all.film -o x.png --exposure -1 --tonemap agx").status.code(), Some(0));
    assert_eq!(dir.run("compare all.film sum.film --threshold max=0").status.code(), Some(0));
    for (args, code, message) in [
        ("merge a.film all.film -o bad.film", 1, "both films hold samples 0..3"),
        ("merge a.film other.film -o bad.film", 1, "films differ in seed: 0 and 1"),
        ("merge a.film a.film.tmp -o bad.film", 4, "a.film.tmp"),
        ("merge a.film ab.exr -o bad.film", 3, "not a film file"),
        ("merge a.film -o bad.gif", 2, "no writer"),
    ] {
        let output = dir.run(args);
        assert_eq!(output.status.code(), Some(code), "{args}");
        assert!(text(&output.stderr).contains(message), "{args}: {}", text(&output.stderr));
    }
    assert!(!dir.path("bad.film").exists() && !dir.path("bad.gif").exists());
}
