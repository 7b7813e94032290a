//! `etendue light`: lux and candela per square meter, on sensor grids and in false color (docs/guide/lighting.md).

use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use etendue_render::film::Film;
use etendue_render::image::atomic::write_atomically;
use etendue_render::image::{Image, WriteOptions};
use etendue_render::integrator;
use etendue_render::lighting::{
    EFFICACY, FalseColor, Reading, Scale, SensorGrid, SensorOptions, Summary, false_color, measure, photometric,
};
use etendue_render::scene;
use etendue_render::session::job::{self, Plan};
use etendue_render::session::{Cancel, Silent, Stop};
use etendue_render::spectrum::Spectrum;
use etendue_scene::{RenderSettings, SceneDesc};
use serde_json::{Value, json};

use super::render::job_error;
use super::{note, on_interrupt, report_losses};
use crate::exit::{self, coded};
use crate::scene_args::SceneArgs;
use crate::settings::SettingsArgs;

/// What to measure and where to write it.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    /// Sensors: "name=desk,position=0 0.8 0,normal=0 1 0,columns=5,rows=4,spacing=0.5"; the position is the grid's center; may be repeated.
    #[arg(long, value_name = "GRID", value_parser = SensorGrid::parse, help_heading = "What to measure")]
    grid: Vec<SensorGrid>,
    /// Samples of each sensor.
    #[arg(long, value_name = "N", default_value_t = 1024, help_heading = "What to measure")]
    sensor_samples: u32,
    /// Illuminance of what the camera sees, in false color: .png or .jpg; or as numbers in lux (channel Y): .exr.
    #[arg(long, value_name = "FILE", help_heading = "What to measure")]
    illuminance: Vec<PathBuf>,
    /// Luminance of what the camera sees, in false color: .png or .jpg; or as numbers in cd/m² (channel Y): .exr.
    #[arg(long, value_name = "FILE", help_heading = "What to measure")]
    luminance: Vec<PathBuf>,
    /// Readings of all sensors: .csv or .json; may be repeated.
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Vec<PathBuf>,
    /// False-color picture of each grid, one field for each sensor; with several grids the name is put before the ending.
    #[arg(long, value_name = "FILE.png", help_heading = "Output")]
    grid_picture: Option<PathBuf>,
    /// The topmost number of false-color scales [default: a round number above nearly all values].
    #[arg(long, value_name = "NUMBER", help_heading = "Output")]
    max: Option<f64>,
    /// Logarithmic scales over three decades.
    #[arg(long, help_heading = "Output")]
    log: bool,
    /// Lumens per watt of the scene's numbers: 683 for watts, 1 for scenes in candela and lux, 179 for Radiance's white watts.
    #[arg(long, value_name = "LM/W", default_value_t = EFFICACY, help_heading = "What to measure")]
    efficacy: f64,
    /// Threads; 0 takes one for each core.
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0, help_heading = "Running")]
    threads: usize,
    /// Say nothing but errors.
    #[arg(short, long, help_heading = "Running")]
    quiet: bool,
}

/// A grid with what was read there.
struct Measured<'a> {
    grid: &'a SensorGrid,
    readings: Vec<Reading>,
    summary: Summary,
}

/// Measures; returns [`exit::INTERRUPTED`] after Ctrl-C.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    check(&args)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).stack_size(32 << 20).build().context("no threads")?;
    let settings = &args.settings.0;
    let desc = pool.install(|| args.scene.read([settings.width, settings.height]))?;
    if desc.classic.is_some() {
        return Err(coded(exit::USAGE, "scenes of POV-Ray have no physical units: there is nothing to measure in lux".to_owned()));
    }
    if !args.quiet {
        report_losses(&desc);
    }
    let cancel = on_interrupt();
    let Some(measured) = pool.install(|| measure_grids(&args, &desc, &cancel))? else { return Ok(ExitCode::from(exit::INTERRUPTED)) };
    for path in &args.output {
        let text = if has_extension(path, "json") { report_json(&measured, args.efficacy) } else { report_csv(&measured) };
        write_atomically::<std::io::Error>(path, |out| out.write_all(text.as_bytes())).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.grid_picture {
        for m in &measured {
            let path = if measured.len() > 1 { numbered(path, &m.grid.name) } else { path.clone() };
            grid_picture(m, &args).save(&path, &WriteOptions::default()).with_context(|| path.display().to_string())?;
        }
    }
    if !args.quiet || args.output.is_empty() {
        print_summaries(&measured)?;
    }
    for (files, method, unit) in [(&args.illuminance, "illuminance", "lx"), (&args.luminance, "", "cd/m²")] {
        if files.is_empty() {
            continue;
        }
        let Some(film) = pool.install(|| picture(&desc, settings, method, &cancel))? else { return Ok(ExitCode::from(exit::INTERRUPTED)) };
        for path in files {
            photometric_picture(&film, unit, &args, path)?;
        }
    }
    Ok(ExitCode::from(exit::OK))
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted))
}

fn check(args: &Args) -> anyhow::Result<()> {
    let usage = |m: String| Err(coded(exit::USAGE, m));
    if args.grid.is_empty() && args.illuminance.is_empty() && args.luminance.is_empty() {
        return usage("nothing to measure: give --grid, --illuminance or --luminance".into());
    }
    if !(args.efficacy > 0.0 && args.efficacy.is_finite()) || args.sensor_samples == 0 {
        return usage("the efficacy must be above 0, and sensors need samples".into());
    }
    if let Some(path) = args.output.iter().find(|p| !has_extension(p, "csv") && !has_extension(p, "json")) {
        return usage(format!("{}: readings are written as .csv or .json", path.display()));
    }
    Ok(())
}

/// Readings of all grids; `None` where it was cancelled.
fn measure_grids<'a>(args: &'a Args, desc: &SceneDesc, cancel: &Cancel) -> anyhow::Result<Option<Vec<Measured<'a>>>> {
    if args.grid.is_empty() {
        return Ok(Some(Vec::new()));
    }
    let settings = RenderSettings { integrator: Some("path".into()), ..args.settings.0.clone() };
    let mut scene = scene::compile(desc, &settings, [1, 1]).map_err(|faults| job_error(job::JobError::Scene(faults), desc))?;
    scene.hide_lights = true;
    let inner = integrator::create(&settings, &desc.integrator).map_err(|m| coded(exit::USAGE, m))?;
    let options = SensorOptions { samples: args.sensor_samples, seed: settings.seed, efficacy: args.efficacy };
    let mut measured = Vec::new();
    for grid in &args.grid {
        let is_cancelled = || cancel.is_cancelled();
        let Some(readings) = measure(&scene, inner.as_ref(), grid, &options, &is_cancelled, &|_| ()) else { return Ok(None) };
        let Some(summary) = Summary::of(&readings) else { continue };
        measured.push(Measured { grid, readings, summary });
    }
    Ok(Some(measured))
}

/// A picture by an integrator (the scene's own where the name is empty); `None` where it was cancelled.
fn picture(desc: &SceneDesc, settings: &RenderSettings, method: &str, cancel: &Cancel) -> anyhow::Result<Option<Film>> {
    let settings = RenderSettings {
        integrator: if method.is_empty() { settings.integrator.clone() } else { Some(method.to_owned()) },
        ..settings.clone()
    };
    let plan = Plan::new(desc, &settings, None).map_err(|e| job_error(e, desc))?;
    let mut session = job::prepare(desc, &settings, &plan, &[]).map_err(|e| job_error(e, desc))?;
    let stop = Stop { spp: Some(plan.spp), ..Stop::default() };
    session.render(&stop, cancel, &Silent)?;
    Ok((!cancel.is_cancelled()).then(|| session.into_film()))
}

/// Writes a film as lux or cd/m², in colors or as numbers.
fn photometric_picture(film: &Film, unit: &str, args: &Args, path: &Path) -> anyhow::Result<()> {
    let image = film.develop();
    let rgb = image.rgb().unwrap_or_default();
    let alpha = image.channel("A");
    let values: Vec<f64> = rgb
        .iter()
        .enumerate()
        .map(|(i, c)| {
            // Nothing is there to be lit; coverage less than one belongs to what is.
            let a = alpha.map_or(1.0, |a| f64::from(a[i]));
            let v = photometric(Spectrum::from_rgb(*c), args.efficacy);
            if unit != "lx" {
                v
            } else if a > 0.0 {
                v / a
            } else {
                f64::NAN
            }
        })
        .collect();
    let picture = if has_extension(path, "exr") {
        let mut numbers = Image::new(image.width, image.height);
        numbers.push("Y", values.iter().map(|v| if v.is_finite() { *v as f32 } else { 0.0 }).collect());
        numbers
    } else {
        false_color(&values, image.width, image.height, &colors(args, unit))
    };
    picture.save(path, &WriteOptions::default()).with_context(|| path.display().to_string())?;
    if !args.quiet {
        let finite: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        let mean = finite.iter().sum::<f64>() / finite.len().max(1) as f64;
        let max = finite.iter().fold(0.0f64, |m, v| m.max(*v));
        note(&format!("{}: mean {mean:.4} {unit}, at most {max:.4} {unit}", path.display()));
    }
    Ok(())
}

fn colors(args: &Args, unit: &str) -> FalseColor {
    FalseColor { max: args.max, scale: if args.log { Scale::Logarithmic } else { Scale::Linear }, unit: unit.to_owned() }
}

/// A grid as a picture: one square for each sensor, the last row at the top, as seen from the normal's side.
fn grid_picture(m: &Measured, args: &Args) -> Image {
    let (columns, rows) = (m.grid.columns as usize, m.grid.rows as usize);
    let edge = (480 / columns.max(rows)).max(1);
    let (w, h) = (columns * edge, rows * edge);
    let at = |x: usize, y: usize| m.readings[(rows - 1 - y / edge) * columns + x / edge].lux;
    let values: Vec<f64> = (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect();
    false_color(&values, w as u32, h as u32, &colors(args, "lx"))
}

fn numbered(path: &Path, name: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let safe: String = name.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
    path.with_file_name(format!("{stem}-{safe}")).with_extension(path.extension().unwrap_or_default())
}

/// One line for each sensor.
fn report_csv(measured: &[Measured]) -> String {
    let mut text = "grid,row,column,x,y,z,nx,ny,nz,lux,standard_error\n".to_owned();
    for m in measured {
        let n = m.grid.axes()[0];
        // Quotes within a name are doubled (RFC 4180).
        let name = m.grid.name.replace('"', "\"\"");
        for (i, r) in m.readings.iter().enumerate() {
            let (row, column) = (i / m.grid.columns as usize, i % m.grid.columns as usize);
            let (p, lux, error) = (r.p, r.lux, r.error);
            // Writing to a string does not fail.
            let _ = writeln!(text, "\"{name}\",{row},{column},{},{},{},{},{},{},{lux:.6e},{error:.3e}", p.x, p.y, p.z, n.x, n.y, n.z);
        }
    }
    text
}

/// Everything, the summaries too.
fn report_json(measured: &[Measured], efficacy: f64) -> String {
    let grids: Vec<Value> = measured
        .iter()
        .map(|m| {
            let (s, g) = (&m.summary, m.grid);
            let readings: Vec<Value> =
                m.readings.iter().map(|r| json!({"position": r.p.to_array(), "lux": r.lux, "standard_error": r.error})).collect();
            json!({
                "name": g.name, "columns": g.columns, "rows": g.rows, "spacing": g.spacing, "normal": g.axes()[0].to_array(),
                "min_lux": s.min, "max_lux": s.max, "mean_lux": s.mean, "median_lux": s.median,
                "uniformity_min_over_mean": s.min_over_mean, "diversity_min_over_max": s.min_over_max,
                "readings": readings,
            })
        })
        .collect();
    let report = json!({"lumens_per_watt": efficacy, "grids": grids});
    serde_json::to_string_pretty(&report).unwrap_or_default() + "\n"
}

fn print_summaries(measured: &[Measured]) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    for m in measured {
        let s = &m.summary;
        let error = m.readings.iter().map(|r| if r.lux > 0.0 { r.error / r.lux } else { 0.0 }).fold(0.0, f64::max);
        writeln!(
            out,
            "{}: {} sensors, mean {:.1} lx, min {:.1}, max {:.1}, median {:.1}; min/mean {:.3}, min/max {:.3}; standard errors up to {:.1}%",
            m.grid.name,
            m.readings.len(),
            s.mean,
            s.min,
            s.max,
            s.median,
            s.min_over_mean,
            s.min_over_max,
            100.0 * error
        )?;
    }
    Ok(())
}
