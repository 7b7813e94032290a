//! `etendue render` as a script sees it: exit codes, files, messages.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use etendue_render::film::Film;
use etendue_render::image::Image;

const SCENE: &str = r#"<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, -5, 2" target="0, 0, 0.5" up="0, 0, 1"/></transform>
    <sampler type="independent"><integer name="sample_count" value="8"/></sampler>
    <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="36"/></film>
  </sensor>
  <shape type="rectangle" id="floor">
    <transform name="to_world"><scale value="3"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.4"/></bsdf>
  </shape>
  <shape type="sphere" id="ball">
    <point name="center" x="0" y="0" z="0.6"/><float name="radius" value="0.6"/>
    <bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf>
  </shape>
  <shape type="sphere" id="lamp">
    <point name="center" x="1" y="-1" z="3"/><float name="radius" value="0.4"/>
    <emitter type="area"><rgb name="radiance" value="8"/></emitter>
  </shape>
  <emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>
</scene>
"#;

/// A folder of its own that holds `scene.xml`.
struct Dir(PathBuf);

impl Dir {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("etendue-render-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        std::fs::write(path.join("scene.xml"), SCENE).unwrap();
        Self(path)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn command(&self, args: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_etendue"));
        command.args(args.split_whitespace()).current_dir(&self.0);
        command
    }

    /// Runs `etendue` here with arguments separated by blanks.
    fn run(&self, args: &str) -> Output {
        self.command(args).output().unwrap()
    }

    /// The same, which must succeed.
    fn ok(&self, args: &str) -> Output {
        let output = self.run(args);
        assert_eq!(output.status.code(), Some(0), "{args}: {}", text(&output.stderr));
        output
    }

    fn files(&self) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(&self.0).unwrap().map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
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

fn samples(path: &Path) -> f32 {
    Image::load(path).unwrap().channel("sampleCount").unwrap()[0]
}

#[test]
fn every_format_is_written_and_they_show_the_same() {
    let dir = Dir::new("formats");
    let output = dir.ok("render scene.xml -o a.exr -o a.png -o a.jpg -o a.hdr -o a.pfm -o a.film");
    assert!(text(&output.stdout).is_empty() && text(&output.stderr).contains("48×36, 8 spp, path"), "{}", text(&output.stderr));
    assert_eq!(dir.files(), ["a.exr", "a.film", "a.hdr", "a.jpg", "a.pfm", "a.png", "scene.xml"]);
    let exr = Image::load(&dir.path("a.exr")).unwrap();
    assert_eq!((exr.width, exr.height), (48, 36));
    assert!(exr.rgb().unwrap().iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    let pfm = std::fs::read(dir.path("a.pfm")).unwrap();
    let last_row: Vec<u8> = exr.rgb().unwrap()[..48].iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    assert!(pfm.starts_with(b"PF") && pfm.ends_with(&last_row), "rows from the bottom up, 32-bit");
    assert_eq!(Film::load(&dir.path("a.film")).unwrap().develop().rgb(), exr.rgb());
    // Eight bits, clipped lights and JPEG's blocks are some way off.
    for (name, limit) in [("a.hdr", 1e-3), ("a.film", 1e-12)] {
        dir.ok(&format!("compare {name} a.exr --threshold relmse={limit}"));
    }
    for name in ["a.png", "a.jpg"] {
        let image = Image::load(&dir.path(name)).unwrap();
        let (a, b) = (image.rgb().unwrap(), exr.rgb().unwrap());
        let off = a.iter().zip(&b).map(|(a, b)| (a[0] - b[0].min(1.0)).abs()).sum::<f32>() / a.len() as f32;
        assert!(off < 0.03, "{name}: {off}");
    }
    // Without -o: the scene's name.
    dir.ok("render scene.xml --spp 1 --quiet");
    assert!(dir.path("scene.png").is_file());
}

#[test]
fn settings_say_what_is_rendered() {
    let dir = Dir::new("settings");
    dir.ok("render scene.xml --spp 3 -o full.exr --aov all");
    let full = Image::load(&dir.path("full.exr")).unwrap();
    let mut names: Vec<&str> = full.channels.iter().map(|c| c.name.as_str()).collect();
    names.sort_unstable();
    let mut expected: Vec<&str> = "R G B A albedo.R albedo.G albedo.B N.X N.Y N.Z Z P.X P.Y P.Z uv.U uv.V id.object id.material \
        variance.R variance.G variance.B sampleCount"
        .split_whitespace()
        .collect();
    expected.sort_unstable();
    assert_eq!(names, expected);
    assert_eq!(full.channel("sampleCount").unwrap()[5], 3.0);
    // The ball in the middle, the floor in front of it, and their distances.
    let at = |name: &str, x: usize, y: usize| full.channel(name).unwrap()[y * 48 + x];
    assert!(at("id.object", 24, 18) > 0.0 && at("id.object", 24, 18) != at("id.object", 24, 33));
    assert!(at("Z", 24, 18) > 4.0 && at("Z", 24, 18) < 5.5 && (at("N.Z", 24, 33) - 1.0).abs() < 1e-4);
    // Samples belong to their pixels: a crop shows the same, and the file knows where it lies.
    dir.ok("render scene.xml --spp 3 -o crop.exr --crop 10,5,30,20");
    let crop = Image::load(&dir.path("crop.exr")).unwrap();
    assert_eq!((crop.width, crop.height, crop.origin, crop.full_size), (20, 15, [10, 5], [48, 36]));
    let (c, f) = (crop.channel("G").unwrap(), full.channel("G").unwrap());
    assert!((0..300).all(|i| c[i] == f[(5 + i / 20) * 48 + 10 + i % 20]));
    // One edge keeps the aspect ratio; seeds differ, equal seeds do not.
    dir.ok("render scene.xml --spp 1 --width 24 -o small.exr --seed 3");
    dir.ok("render scene.xml --spp 1 --width 24 -o again.exr --seed 3 -j 1");
    dir.ok("render scene.xml --spp 1 --width 24 -o other.exr --seed 4");
    let [a, b, other] = ["small.exr", "again.exr", "other.exr"].map(|n| std::fs::read(dir.path(n)).unwrap());
    assert!(a == b && a != other);
    assert_eq!(Image::load(&dir.path("small.exr")).unwrap().height, 18);
}

#[test]
fn light_groups_add_up_to_the_picture() {
    let dir = Dir::new("groups");
    dir.ok("render scene.xml --spp 4 --light-groups -o groups.exr -o groups.film");
    dir.ok("render scene.xml --spp 4 --light-groups=false -o plain.exr");
    let (groups, plain) = (Image::load(&dir.path("groups.exr")).unwrap(), Image::load(&dir.path("plain.exr")).unwrap());
    for c in ["R", "G", "B"] {
        let whole = groups.channel(c).unwrap();
        assert_eq!(whole, plain.channel(c).unwrap(), "groups do not change the picture");
        let (lamp, rest) = (groups.channel(&format!("light.lamp.{c}")).unwrap(), groups.channel(&format!("light.rest.{c}")).unwrap());
        assert!(lamp.iter().zip(rest).zip(whole).all(|((a, b), w)| (a + b - w).abs() <= 1e-5 * w.max(1.0)));
        assert!(lamp.iter().sum::<f32>() > 1.0 && rest.iter().sum::<f32>() > 1.0, "both lights shine");
    }
    assert!(plain.channels.iter().all(|c| !c.name.starts_with("light.")));
}

#[test]
fn exit_codes_tell_what_is_wrong_before_any_work() {
    let dir = Dir::new("codes");
    std::fs::write(dir.path("bad.xml"), SCENE.replace(r#"<shape type="sphere" id="ball">"#, r#"<shape type="sfere" id="ball">"#)).unwrap();
    std::fs::write(dir.path("open.xml"), &SCENE[..SCENE.len() / 2]).unwrap();
    std::fs::write(dir.path("unknown.xml"), SCENE.replace("\"alpha\"", "\"alhpa\"")).unwrap();
    std::fs::write(dir.path("scene.txt"), "?").unwrap();
    let before = dir.files();
    for (args, code, message) in [
        ("render", 2, "Usage"),
        ("render scene.xml --sharpness 3", 2, "--sharpness"),
        ("render scene.xml --spp many", 2, "--spp"),
        ("render scene.xml --spp 0", 2, "at least one sample"),
        ("render scene.xml --integrator magic", 2, "there are auto, path"),
        ("render scene.xml --sampler magic", 2, "there are sobol"),
        ("render scene.xml --filter magic", 2, "there are box"),
        ("render scene.xml --light-sampler magic", 2, "there are bvh"),
        ("render scene.xml --aov magic", 2, "there are albedo"),
        ("render scene.xml --tonemap magic", 2, "there are standard"),
        ("render scene.xml --camera magic", 3, "no camera `magic`"),
        ("render scene.xml --crop 0,0,99,9", 2, "not inside"),
        ("render scene.xml --crop 0,0,9", 2, "four whole numbers"),
        ("render scene.xml --width 0", 2, "not possible"),
        ("render scene.xml --width 4000000000", 2, "not possible"),
        ("render scene.xml --time soon", 2, "--time"),
        ("render scene.xml --resume", 2, "--resume needs"),
        ("render scene.xml -o picture.gif", 2, "picture.gif"),
        ("render scene.xml -o picture", 2, "picture"),
        ("render bad.xml", 3, "bad.xml:13:"),
        ("render open.xml", 3, "open.xml:"),
        ("render unknown.xml", 3, "unknown.xml:15:"),
        ("render scene.txt", 3, "scene.txt"),
        ("render missing.xml", 4, "missing.xml"),
        ("render scene.xml -o nowhere/a.png", 4, "no folder nowhere"),
        ("render scene.xml --resume missing.film -o a.png", 4, "missing.film"),
        ("render scene.xml --resume scene.xml -o a.png", 3, "scene.xml"),
    ] {
        let output = dir.run(args);
        let errors = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{args}: {errors}");
        assert!(errors.contains(message), "{args}: {errors}");
    }
    assert_eq!(dir.files(), before, "nothing was written");
    // The wrong output name is known before the scene is even read.
    assert_eq!(dir.run("render missing.xml -o picture.gif").status.code(), Some(2));
    dir.ok("render scene.xml --spp 1 -o a.exr");
    dir.ok("render scene.xml --spp 1 --seed 1 -o b.exr");
    assert_eq!(dir.run("compare b.exr a.exr --threshold mse=1e-9").status.code(), Some(10));
}

#[test]
fn progress_as_json_is_lines_that_rise_to_one() {
    let dir = Dir::new("progress");
    let output = dir.ok("render scene.xml --progress json --quiet -o a.png");
    let errors = text(&output.stderr);
    let lines: Vec<serde_json::Value> = errors.lines().map(|l| serde_json::from_str(l).unwrap_or_else(|e| panic!("{l}: {e}"))).collect();
    let fractions: Vec<f64> = lines.iter().map(|l| l["fraction"].as_f64().unwrap()).collect();
    assert!(!lines.is_empty() && lines.iter().all(|l| l["event"] == "progress" && l["elapsed_s"].as_f64().unwrap() >= 0.0));
    assert!(fractions.windows(2).all(|f| f[0] <= f[1]) && *fractions.last().unwrap() == 1.0, "{fractions:?}");
    assert_eq!(lines.last().unwrap()["spp"], 8);
    // Quiet where nobody looks: standard error is no terminal here.
    assert_eq!(text(&dir.ok("render scene.xml --quiet -o a.png").stderr), "");
    assert!(!text(&dir.ok("render scene.xml -o a.png").stderr).contains('%'));
}

#[test]
fn time_and_noise_stop() {
    let dir = Dir::new("stop");
    let start = Instant::now();
    dir.ok("render scene.xml --time 0.5s -o time.exr --aov samples");
    assert!(start.elapsed() >= Duration::from_millis(500) && start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
    assert!(samples(&dir.path("time.exr")) >= 1.0);
    dir.ok("render scene.xml --time 1h --spp 2 -o both.exr --aov samples");
    assert_eq!(samples(&dir.path("both.exr")), 2.0);
    let [loose, tight] = [0.2, 0.03].map(|noise| {
        dir.ok(&format!("render scene.xml --noise {noise} -o noise.exr --aov samples,variance"));
        let image = Image::load(&dir.path("noise.exr")).unwrap();
        // The stated error, from the file: relative, as in `Film::relative_error`.
        let [r, g, b] = ["R", "G", "B"].map(|c| image.channel(c).unwrap());
        let variances = image.channel("variance.G").unwrap();
        let terms = (0..r.len()).map(|i| variances[i] / ((0.2127 * r[i] + 0.7152 * g[i] + 0.0722 * b[i]).powi(2) + 0.01));
        let error = (terms.sum::<f32>() / r.len() as f32).sqrt();
        assert!(error < 1.3 * noise, "{error} for {noise}");
        image.channel("sampleCount").unwrap()[0]
    });
    assert!(loose >= 16.0 && tight > loose, "{loose}, {tight}");
}

#[test]
fn a_resumed_rendering_ends_in_the_same_bits() {
    let dir = Dir::new("resume");
    dir.ok("render scene.xml --spp 13 -o whole.exr --aov all");
    dir.ok("render scene.xml --spp 5 -o part.exr --aov all --checkpoint c.film --resume");
    dir.ok("render scene.xml --spp 13 -o done.exr --aov all --checkpoint c.film --resume");
    let [whole, part, done] = ["whole.exr", "part.exr", "done.exr"].map(|n| std::fs::read(dir.path(n)).unwrap());
    assert!(done == whole && part != whole);
    // A film of other settings or of another scene is refused.
    let other = dir.run("render scene.xml --spp 13 -o x.exr --aov all --checkpoint c.film --resume --seed 1");
    assert_eq!(other.status.code(), Some(3));
    assert!(text(&other.stderr).contains("films differ in seed"), "{}", text(&other.stderr));
    std::fs::write(dir.path("scene.xml"), SCENE.replace("0.6, 0.5, 0.4", "0.6, 0.5, 0.3")).unwrap();
    let other = dir.run("render scene.xml --spp 13 -o x.exr --aov all --resume c.film");
    assert!(text(&other.stderr).contains("films differ in scene"), "{}", text(&other.stderr));
    assert!(!dir.path("x.exr").exists());
}

#[test]
fn merged_sample_ranges_are_the_whole_bit_for_bit() {
    let dir = Dir::new("merge");
    dir.ok("render scene.xml --spp 9 -o whole.film -o whole.exr");
    dir.ok("render scene.xml --spp 4 -o a.film");
    dir.ok("render scene.xml --first-sample 4 --spp 5 -o b.film");
    dir.ok("merge b.film a.film -o sum.film");
    dir.ok("merge sum.film -o sum.exr");
    let [whole, sum] = ["whole.film", "sum.film"].map(|name| {
        let mut film = Film::load(&dir.path(name)).unwrap();
        film.meta.render_ms = 0;
        let mut bytes = Vec::new();
        film.write_to(&mut bytes).unwrap();
        bytes
    });
    assert!(whole == sum);
    let [whole, sum] = ["whole.exr", "sum.exr"].map(|name| Image::load(&dir.path(name)).unwrap());
    assert!(whole.channels.iter().all(|c| sum.channel(&c.name) == Some(&c.data[..])));
}

#[test]
fn failing_writes_leave_no_file_and_say_which() {
    let dir = Dir::new("unwritable");
    // A folder of that name cannot become a file, whoever runs this.
    std::fs::create_dir(dir.path("a.exr")).unwrap();
    let output = dir.run("render scene.xml --spp 1 -o a.exr");
    assert_eq!(output.status.code(), Some(4), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("a.exr"));
    assert_eq!(dir.files(), ["a.exr", "scene.xml"]);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let locked = dir.path("locked");
        std::fs::create_dir(&locked).unwrap();
        std::fs::set_permissions(&locked, std::fs::Permissions::from_mode(0o555)).unwrap();
        if std::fs::write(locked.join("probe"), "").is_ok() {
            println!("skipped: this user writes to folders that are closed");
        } else {
            for name in ["a.exr", "a.png", "a.film"] {
                let output = dir.run(&format!("render scene.xml --spp 1 -o locked/{name}"));
                assert_eq!(output.status.code(), Some(4), "{}", text(&output.stderr));
                assert_eq!(std::fs::read_dir(&locked).unwrap().count(), 0);
            }
        }
        std::fs::set_permissions(&locked, std::fs::Permissions::from_mode(0o755)).unwrap();
        if Path::new("/dev/full").exists() {
            std::os::unix::fs::symlink("/dev/full", dir.path("full.png")).unwrap();
            let output = dir.run("render scene.xml --spp 1 -o full.png");
            assert_eq!(output.status.code(), Some(4), "{}", text(&output.stderr));
        }
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_what_is_done() {
    let dir = Dir::new("interrupt");
    let args =
        "render scene.xml --spp 100000000 --time 60 --progress json -o a.exr --aov samples --checkpoint c.film --checkpoint-interval 1000";
    let mut child = dir.command(args).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let line = lines.next().unwrap().unwrap();
    assert!(line.contains("progress"), "{line}");
    let kill = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().unwrap();
    assert!(kill.success());
    let asked = Instant::now();
    let rest: Vec<String> = lines.map_while(Result::ok).collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
    assert!(asked.elapsed() < Duration::from_secs(20), "it takes {:?}", asked.elapsed());
    assert!(Image::load(&dir.path("a.exr")).unwrap().rgb().unwrap().iter().flatten().any(|v| *v > 0.0));
    let done = Film::load(&dir.path("c.film")).unwrap();
    let before = done.declared_spp();
    // What was kept is worth going on from.
    let spp = before + 2;
    dir.ok(&format!("render scene.xml --spp {spp} -o b.exr --aov samples --checkpoint c.film --resume"));
    assert_eq!(samples(&dir.path("b.exr")), spp as f32);
}
