//! `etendue denoise` and `etendue render --denoise` as a script sees them.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Output};

use etendue_render::denoise::Denoiser;
use etendue_render::image::{Image, WriteOptions};

fn run(dir: &Path, args: &str, library: Option<&str>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_etendue"));
    command.args(args.split_whitespace()).current_dir(dir);
    if let Some(library) = library {
        command.env("ETENDUE_OIDN", library);
    }
    command.output().expect("the command starts")
}

#[test]
fn a_missing_library_is_told_before_any_work() {
    let dir = std::env::temp_dir();
    // Neither the picture nor the scene exists: the library comes first.
    for args in ["denoise nowhere.exr -o out.exr --library none.so", "denoise nowhere.exr -o out.exr", "render nowhere.xml --denoise"] {
        let output = run(&dir, args, Some("none.so"));
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{args}: {message}");
        assert!(message.contains("none.so cannot be used as Open Image Denoise"), "{args}: {message}");
    }
    assert_eq!(run(&dir, "denoise nowhere.exr -o out.doc", Some("none.so")).status.code(), Some(2));
}

#[test]
fn a_picture_is_denoised_and_its_other_channels_are_kept() {
    if let Err(e) = Denoiser::load() {
        // Past the test harness, which hides what passing tests print.
        let _ = writeln!(std::io::stderr(), "SKIPPED, nothing was tested: {e}");
        return;
    }
    let dir = std::env::temp_dir().join(format!("etendue-cli-denoise-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    let noisy: Vec<_> = (0..64 * 64).map(|i: u32| [(i.wrapping_mul(2_654_435_769) >> 16) as f32 / 32768.0; 3]).collect();
    let mut image = Image::from_rgb(64, 64, &noisy);
    image.push("Z", vec![3.5; noisy.len()]);
    image.save(&dir.join("noisy.exr"), &WriteOptions::default()).unwrap();
    let output = run(&dir, "denoise noisy.exr -o clean.exr -j 2", None);
    let clean = Image::load(&dir.join("clean.exr"));
    std::fs::remove_dir_all(&dir).unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{message}");
    assert!(message.contains("without guides"), "{message}");
    let clean = clean.unwrap();
    let deviation = |pixels: &[[f32; 3]]| pixels.iter().map(|p| f64::from(p[0] - 1.0).powi(2)).sum::<f64>();
    assert!(deviation(&clean.rgb().unwrap()) < 0.1 * deviation(&noisy));
    assert!(clean.channel("Z").unwrap().iter().all(|&z| z == 3.5));
}
