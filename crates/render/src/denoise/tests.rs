use std::io::Write;

use super::*;
use crate::math::fns;
use crate::math::hash;

/// The installed library, or a remark that the test could not run.
fn installed() -> Option<Denoiser> {
    match Denoiser::load() {
        Ok(denoiser) => Some(denoiser),
        Err(e) => {
            // Past the test harness, which hides what passing tests print.
            let _ = writeln!(std::io::stderr(), "SKIPPED, nothing was tested: {e}");
            None
        }
    }
}

/// A shaded ball before a wall with a dark stripe: the clean picture with albedo and normals.
fn ball(size: u32) -> Image {
    let mut planes = vec![Vec::new(); 9];
    for i in 0..size * size {
        let (x, y) = ((i % size) as f32 / size as f32 * 2.0 - 1.0, (i / size) as f32 / size as f32 * 2.0 - 1.0);
        let z2 = 0.4 - x * x - y * y;
        let (albedo, n) = if z2 > 0.0 {
            let k = 1.0 / 0.4f32.sqrt();
            ([0.8, 0.3, 0.2], [x * k, -y * k, z2.sqrt() * k])
        } else if x.abs() < 0.1 || y > 0.8 {
            ([0.05, 0.05, 0.1], [0.0, 0.0, 1.0])
        } else {
            ([0.6, 0.7, 0.6], [0.0, 0.0, 1.0])
        };
        let light = 2.0 * (0.6 * n[2] + 0.5 * n[0] + 0.3 * n[1]).max(0.0) + 0.1;
        for (plane, v) in planes.iter_mut().zip(albedo.map(|a| a * light).into_iter().chain(albedo).chain(n)) {
            plane.push(v);
        }
    }
    let mut image = Image::new(size, size);
    let names = ["R", "G", "B", "albedo.R", "albedo.G", "albedo.B", "N.X", "N.Y", "N.Z"];
    for (name, plane) in names.into_iter().zip(planes) {
        image.push(name, plane);
    }
    image
}

/// The picture with noise of mean 1 multiplied on (exponential, as of few samples): unbiased.
fn with_noise(clean: &Image) -> Image {
    let mut noisy = clean.clone();
    for (c, channel) in noisy.channels.iter_mut().take(3).enumerate() {
        for (i, v) in channel.data.iter_mut().enumerate() {
            *v *= -fns::ln(1.0 - unit(i as u64 * 3 + c as u64));
        }
    }
    noisy
}

fn unit(i: u64) -> f32 {
    (hash::mix64(i) >> 40) as f32 / (1u32 << 24) as f32
}

fn squared_error(a: &Image, b: &Image) -> f64 {
    let difference = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
    a.rgb().unwrap().iter().zip(&b.rgb().unwrap()).map(difference).sum::<f64>() / a.pixel_count() as f64
}

#[test]
fn without_a_library_the_message_says_how_to_get_one() {
    let nowhere = ["libNoSuchOpenImageDenoise.so.2", "libNoSuchOpenImageDenoise.so"].map(PathBuf::from);
    let error = Denoiser::load_first(nowhere.into_iter()).unwrap_err();
    assert!(matches!(error, DenoiseError::NotInstalled), "{error}");
    let text = error.to_string();
    assert!(text.contains(HOW_TO_GET) && text.contains("ETENDUE_OIDN"), "{text}");
}

#[test]
fn a_file_that_is_no_library_is_unusable_and_named() {
    let folder = std::env::temp_dir().join(format!("etendue-oidn-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let empty = Denoiser::load_file(&folder).unwrap_err();
    let file = folder.join("libOpenImageDenoise.so.2");
    std::fs::write(&file, b"not a library").unwrap();
    let fault = Denoiser::load_first([file.clone()].into_iter()).unwrap_err();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(matches!(&empty, DenoiseError::Unusable { file, .. } if *file == folder), "{empty}");
    assert!(matches!(&fault, DenoiseError::Unusable { file: f, .. } if *f == file), "{fault}");
}

#[test]
#[cfg(target_os = "linux")]
fn another_library_is_told_from_the_right_one() {
    // Every Linux program has the C library loaded.
    let fault = Denoiser::load_file(Path::new("libc.so.6")).unwrap_err();
    assert!(fault.to_string().contains("no function oidnNewDevice"), "{fault}");
}

#[test]
fn a_missing_part_is_not_a_missing_library() {
    let name = Path::new("libOpenImageDenoise.so.2");
    assert!(is_absent(name, "libOpenImageDenoise.so.2: cannot open shared object file: No such file or directory"));
    if cfg!(target_os = "linux") {
        assert!(!is_absent(name, "libtbb.so.12: cannot open shared object file: No such file or directory"));
    }
    assert!(!is_absent(Path::new("/opt/libOpenImageDenoise.so.2"), "/opt/libOpenImageDenoise.so.2: cannot open"));
}

#[test]
fn values_that_are_not_finite_take_the_mean_of_their_neighbors() {
    let mut pixels = vec![2.0; 27];
    (pixels[12], pixels[0], pixels[1], pixels[2]) = (f32::NAN, f32::INFINITY, -5.0, 6.0);
    let repaired = repair([3, 3], pixels);
    assert_eq!(repaired[12], 2.0);
    assert_eq!(repaired[..3], [2.0, 0.0, 6.0]);
    assert_eq!(repair([1, 1], vec![f32::NAN; 3]), [0.0; 3]);
}

#[test]
fn a_noisy_picture_gets_closer_to_the_clean_one() {
    let Some(denoiser) = installed() else { return };
    let clean = ball(128);
    let noisy = with_noise(&clean);
    let before = squared_error(&noisy, &clean);
    for prefilter in [false, true] {
        let mut picture = noisy.clone();
        picture.push("A", vec![0.5; picture.pixel_count()]);
        denoiser.denoise(&mut picture, &DenoiseOptions { prefilter, threads: 2 }).unwrap();
        let after = squared_error(&picture, &clean);
        assert!(after < before / 20.0, "{before} before, {after} after");
        // Nothing but R, G and B changes.
        assert!(picture.channels[3..9] == noisy.channels[3..] && picture.channel("A").unwrap().iter().all(|&a| a == 0.5));
        let mean = |image: &Image| image.rgb().unwrap().iter().flatten().map(|&v| f64::from(v)).sum::<f64>();
        assert!((mean(&picture) / mean(&clean) - 1.0).abs() < 0.03, "{}", mean(&picture) / mean(&clean));
    }
}

#[test]
fn the_picture_depends_neither_on_the_run_nor_on_threads() {
    let Some(denoiser) = installed() else { return };
    let run = |threads| {
        let mut picture = with_noise(&ball(200));
        denoiser.denoise(&mut picture, &DenoiseOptions { threads, ..DenoiseOptions::default() }).unwrap();
        picture
    };
    let picture = run(1);
    assert!([1, 2, 0].into_iter().all(|threads| run(threads) == picture));
}

#[test]
fn guides_help_and_their_faults_do_no_harm() {
    let Some(denoiser) = installed() else { return };
    let clean = ball(128);
    let mut guided = with_noise(&clean);
    let mut alone = guided.clone();
    alone.channels.truncate(3);
    // Without albedo the library takes no normals.
    alone.channels.extend(guided.channels[6..].iter().cloned());
    for channel in &mut guided.channels {
        channel.data[77] = f32::NAN;
        channel.data[5000] = f32::INFINITY;
    }
    denoiser.denoise(&mut guided, &DenoiseOptions::default()).unwrap();
    denoiser.denoise(&mut alone, &DenoiseOptions::default()).unwrap();
    assert!(guided.rgb().unwrap().iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    let errors = [&guided, &alone].map(|image| squared_error(image, &clean));
    assert!(errors[0] < errors[1], "{errors:?}");
}

#[test]
fn odd_sizes_pass_and_pictures_without_color_do_not() {
    let Some(denoiser) = installed() else { return };
    for (width, height) in [(0, 0), (1, 1), (1, 37), (300, 2)] {
        let mut image = Image::from_rgb(width, height, &vec![[0.25, 0.5, 1.0]; (width * height) as usize]);
        denoiser.denoise(&mut image, &DenoiseOptions::default()).unwrap();
        assert!(image.rgb().unwrap().iter().flatten().all(|v| v.is_finite()));
    }
    let mut gray = Image::new(4, 4);
    gray.push("Y", vec![1.0; 16]);
    assert!(matches!(denoiser.denoise(&mut gray, &DenoiseOptions::default()), Err(DenoiseError::NoColor)));
}
