//! `etendue study`: every method on one scene, with its error over time (docs/guide/study.md).

mod curve;
mod limits;
mod plot;
mod report;
mod sheet;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use etendue_render::image::{Image, WriteOptions};
use etendue_render::integrator;
use etendue_render::session::Stop;

use super::compare::load_picture;
use super::{note, report_losses};
use crate::exit::{self, coded};
use crate::progress::human;
use crate::scene_args::SceneArgs;
use crate::settings::SettingsArgs;
use curve::{Bench, Curve};

/// Time for each method where none is given.
const DEFAULT_TIME: Duration = Duration::from_secs(10);
/// A reference that the study makes itself gets this many times the methods' samples or time.
const REFERENCE_FACTOR: u32 = 8;
/// Methods that make no picture of the scene's light.
const NOT_STUDIED: [&str; 3] = ["ao", "normals", "illuminance"];

/// Which methods to compare, for how long, and against what.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    /// Folder for the report [default: the scene's name with -study].
    #[arg(short, long, value_name = "FOLDER", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Methods, as `--integrator` names them [default: all].
    #[arg(long, value_name = "NAMES", value_delimiter = ',', help_heading = "Study")]
    methods: Vec<String>,
    /// Time for each method, such as 10s or 2m [default: 10s; with --spp: no limit].
    #[arg(long, value_name = "DURATION", value_parser = super::render::parse_duration, help_heading = "Study")]
    time: Option<Duration>,
    /// The true picture, of the same size; without it the study makes one.
    #[arg(long, value_name = "FILE", help_heading = "Study")]
    reference: Option<PathBuf>,
    /// Method of the reference that the study makes.
    #[arg(long, value_name = "NAME", default_value = "path", help_heading = "Study")]
    reference_method: String,
    /// Samples per pixel of that reference [default: eight times the methods' samples or time].
    #[arg(long, value_name = "SAMPLES", help_heading = "Study")]
    reference_spp: Option<u32>,
    /// Threads; 0 takes one for each core.
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0, help_heading = "Running")]
    threads: usize,
    /// Say nothing but errors.
    #[arg(short, long, help_heading = "Running")]
    quiet: bool,
}

/// What the methods are measured against.
struct Reference {
    image: Image,
    /// Where it comes from, for people.
    origin: String,
}

/// Runs the study; fails where no method could render the scene.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let settings = &args.settings.0;
    if settings.integrator.is_some() {
        return Err(coded(exit::USAGE, "a study renders by several methods: name them with --methods"));
    }
    let methods = methods(&args.methods).map_err(|e| coded(exit::USAGE, e))?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads)
        .stack_size(32 << 20)
        .build()
        .context("the threads could not be started")?;
    let desc = pool.install(|| args.scene.read([settings.width, settings.height]))?;
    let say = |line: &str| {
        if !args.quiet {
            note(line);
        }
    };
    if !args.quiet {
        report_losses(&desc);
    }
    let stop = match (settings.spp, args.time) {
        (Some(spp), time) => Stop { spp: Some(spp), time, noise: None },
        (None, time) => Stop { spp: None, time: Some(time.unwrap_or(DEFAULT_TIME)), noise: None },
    };
    let folder = args.output.clone().unwrap_or_else(|| default_folder(&args.scene.scene));
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let bench = Bench { desc: &desc, settings, pool: &pool };
    let reference = reference(&args, &bench, &stop, &say)?;
    let (mut curves, mut failures) = (Vec::new(), Vec::new());
    for method in &methods {
        match bench.run(method, settings.seed, &stop, Some(&reference.image)) {
            Ok(curve) => {
                if let Some(p) = curve.points.last() {
                    say(&format!("{method}: {} spp in {}, relMSE {:.3e}", p.spp, human(Duration::from_secs_f64(p.wall_s)), p.relmse));
                }
                curves.push(curve);
            }
            Err(why) => {
                say(&format!("{method}: {why}"));
                failures.push((method.clone(), why));
            }
        }
    }
    if curves.is_empty() {
        return Err(coded(exit::FAILURE, "none of the methods could render the scene"));
    }
    write(&folder, &args.scene.scene, &reference, &curves, &failures)?;
    say(&format!("The report is {}", folder.join("index.html").display()));
    Ok(ExitCode::SUCCESS)
}

/// The methods to study, each once.
fn methods(given: &[String]) -> Result<Vec<String>, String> {
    if given.is_empty() {
        return Ok(integrator::NAMES.iter().copied().filter(|n| !NOT_STUDIED.contains(n)).map(str::to_owned).collect());
    }
    let mut methods: Vec<String> = Vec::new();
    for name in given.iter().map(|n| n.trim()) {
        if !integrator::NAMES.contains(&name) {
            return Err(format!("no integrator `{name}`; there are {}", integrator::NAMES.join(", ")));
        }
        if !methods.iter().any(|m| m == name) {
            methods.push(name.to_owned());
        }
    }
    Ok(methods)
}

fn default_folder(scene: &Path) -> PathBuf {
    let stem = scene.file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy());
    PathBuf::from(format!("{stem}-study"))
}

/// Loads the reference or makes it, with other random numbers than the studied pictures have.
fn reference(args: &Args, bench: &Bench, stop: &Stop, say: &dyn Fn(&str)) -> anyhow::Result<Reference> {
    if let Some(path) = &args.reference {
        let name = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
        return Ok(Reference { image: load_picture(path)?, origin: name });
    }
    let stop = match args.reference_spp {
        Some(spp) => Stop { spp: Some(spp), ..Stop::default() },
        None => Stop {
            spp: stop.spp.map(|n| n.saturating_mul(REFERENCE_FACTOR)),
            time: stop.time.filter(|_| stop.spp.is_none()).map(|t| t * REFERENCE_FACTOR),
            noise: None,
        },
    };
    let method = &args.reference_method;
    say(&format!("reference: {method}"));
    let seed = args.settings.0.seed ^ 0x5EED_0F0A_7E57_1234;
    let curve = bench.run(method, seed, &stop, None).map_err(|why| coded(exit::FAILURE, format!("the reference by {method}: {why}")))?;
    let noise = curve.relative_error.map_or(String::new(), |e| format!(", estimated relative error {:.2}%", e * 100.0));
    Ok(Reference { image: curve.image, origin: format!("{method}, {} spp, another seed{noise}", curve.spp) })
}

fn write(folder: &Path, scene: &Path, reference: &Reference, curves: &[Curve], failures: &[(String, String)]) -> anyhow::Result<()> {
    let save = |image: &Image, name: &str| {
        let path = folder.join(name);
        image.save(&path, &WriteOptions::default()).with_context(|| path.display().to_string())
    };
    let write = |name: &str, text: String| {
        let path = folder.join(name);
        etendue_render::image::atomic::write_atomically(&path, |out| out.write_all(text.as_bytes()))
            .with_context(|| path.display().to_string())
    };
    save(&reference.image, "reference.exr")?;
    save(&reference.image, "reference.png")?;
    for curve in curves {
        save(&curve.image, &format!("{}.exr", curve.method))?;
        save(&curve.image, &format!("{}.png", curve.method))?;
        save(&curve.heat_image(), &format!("{}-flip.png", curve.method))?;
    }
    save(&sheet::contact_sheet(&reference.image, curves), "sheet.png")?;
    write("error.svg", plot::error_over_time(curves)?)?;
    write("errors.csv", report::csv(curves))?;
    write("study.json", report::json(scene, &reference.origin, curves, failures))?;
    write("index.html", report::html(scene, &reference.origin, curves, failures))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_known_and_studied_once() {
        assert_eq!(methods(&["path".into(), " whitted".into(), "path".into()]).unwrap(), ["path", "whitted"]);
        assert!(methods(&["magic".into()]).unwrap_err().contains("magic"));
        let all = methods(&[]).unwrap();
        assert!(all.contains(&"path".to_owned()) && !all.contains(&"normals".to_owned()));
    }
}
