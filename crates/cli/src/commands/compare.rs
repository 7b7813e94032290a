//! `etendue compare`: how much a picture differs from a reference (docs/guide/compare.md).

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use etendue_render::film::Film;
use etendue_render::image::metrics::{Comparison, METRICS, compare, heatmap};
use etendue_render::image::{Image, WriteOptions};

/// The exit code of a comparison over a threshold: neither success nor a failure to compare.
pub const OVER_THRESHOLD: u8 = 10;

/// Two pictures and what to report.
#[derive(clap::Args)]
pub struct Args {
    /// The picture: EXR, HDR, PNG, JPEG, WebP, TIFF, BMP, TGA, GIF or .film.
    picture: PathBuf,
    /// The reference, of the same size.
    reference: PathBuf,
    /// Figures to print [default: all]: mse, relmse, relmse-trimmed, mae, psnr, ssim, flip, mean, max, nonfinite.
    #[arg(long = "metric", value_name = "NAME", value_parser = parse_metric)]
    metrics: Vec<String>,
    /// Exit with code 10 if a figure is worse than VALUE; may be repeated.
    #[arg(long = "threshold", value_name = "NAME=VALUE", value_parser = parse_threshold)]
    thresholds: Vec<(String, f64)>,
    /// Write FLIP of each pixel as a picture.
    #[arg(long, value_name = "FILE.png")]
    heatmap: Option<PathBuf>,
    /// Compare these channels as R, G and B: a layer's name such as "albedo" or "N", or a single channel.
    #[arg(long, value_name = "NAME")]
    channel: Option<String>,
    /// Which FLIP: HDR-FLIP over exposures or FLIP of the pictures clipped at 1 [default: ldr if both files are
    /// PNG, JPEG or the like, else hdr].
    #[arg(long, value_name = "KIND", value_parser = ["hdr", "ldr"])]
    flip: Option<String>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

fn parse_metric(name: &str) -> Result<String, String> {
    if METRICS.contains(&name) { Ok(name.into()) } else { Err(format!("not one of {}", METRICS.join(", "))) }
}

fn parse_threshold(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("not of the form NAME=VALUE")?;
    match value.parse::<f64>() {
        Ok(value) if !value.is_nan() => Ok((parse_metric(name)?, value)),
        _ => Err(format!("\"{value}\" is not a number")),
    }
}

/// Reads a picture of any format, films included.
pub(super) fn load_picture(path: &Path) -> anyhow::Result<Image> {
    let is_film = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("film"));
    if is_film {
        Ok(Film::load(path).with_context(|| path.display().to_string())?.develop())
    } else {
        Image::load(path).with_context(|| path.display().to_string())
    }
}

/// The channels of a layer (or one channel) as an image of its own.
fn select(image: &Image, name: &str, path: &Path) -> anyhow::Result<Image> {
    let mut selected = Image::new(image.width, image.height);
    if let Some(data) = image.channel(name) {
        selected.push("Y", data.to_vec());
        return Ok(selected);
    }
    for suffixes in [["R", "G", "B"], ["X", "Y", "Z"]] {
        let planes: Vec<_> = suffixes.iter().filter_map(|s| image.channel(&format!("{name}.{s}"))).collect();
        if let [r, g, b] = planes[..] {
            for (name, data) in ["R", "G", "B"].into_iter().zip([r, g, b]) {
                selected.push(name, data.to_vec());
            }
            return Ok(selected);
        }
    }
    let names: Vec<_> = image.channels.iter().map(|c| c.name.as_str()).collect();
    anyhow::bail!("{}: no channel or layer \"{name}\" (there are {})", path.display(), names.join(", "))
}

fn has_high_range(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    matches!(extension.as_str(), "exr" | "hdr" | "film" | "pfm" | "tif" | "tiff")
}

/// Runs the comparison.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let mut picture = load_picture(&args.picture)?;
    let mut reference = load_picture(&args.reference)?;
    if let Some(name) = &args.channel {
        picture = select(&picture, name, &args.picture)?;
        reference = select(&reference, name, &args.reference)?;
    }
    let hdr = match args.flip.as_deref() {
        Some(kind) => kind == "hdr",
        None => has_high_range(&args.picture) || has_high_range(&args.reference),
    };
    let (comparison, map) =
        compare(&picture, &reference, hdr).with_context(|| format!("{} and {}", args.picture.display(), args.reference.display()))?;
    if let Some(path) = &args.heatmap {
        let image = heatmap(picture.width, picture.height, &map);
        image.save(path, &WriteOptions::default()).with_context(|| path.display().to_string())?;
    }
    let exceeded: Vec<&(String, f64)> = args.thresholds.iter().filter(|(name, limit)| is_worse(&comparison, name, *limit)).collect();
    let mut out = std::io::stdout().lock();
    if args.json {
        let mut value = serde_json::to_value(&comparison)?;
        value["exceeded"] = exceeded.iter().map(|(name, _)| name.as_str()).collect();
        writeln!(out, "{value:#}")?;
    } else {
        print_table(&mut out, &args, &comparison)?;
        for (name, limit) in &exceeded {
            let value = comparison.get(name).map_or("undefined".into(), |v| format!("{v:.6}"));
            writeln!(out, "over threshold: {name} is {value}, allowed {limit}")?;
        }
    }
    Ok(if exceeded.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(OVER_THRESHOLD) })
}

/// A figure that cannot be computed (SSIM of a tiny picture) does not pass.
fn is_worse(comparison: &Comparison, name: &str, limit: f64) -> bool {
    match comparison.get(name) {
        Some(value) if Comparison::higher_is_better(name) => value < limit,
        Some(value) => value > limit,
        None => true,
    }
}

fn print_table(out: &mut impl Write, args: &Args, comparison: &Comparison) -> std::io::Result<()> {
    for name in METRICS {
        if !args.metrics.is_empty() && !args.metrics.iter().any(|m| m == name) {
            continue;
        }
        let note = match name {
            "flip" if comparison.flip_is_hdr => "  (HDR-FLIP)".into(),
            "mean" => {
                let [r, g, b] = comparison.mean_ratio.map(|ratio| (ratio - 1.0) * 100.0);
                format!("  (R {r:+.3}%, G {g:+.3}%, B {b:+.3}%)")
            }
            _ => String::new(),
        };
        match comparison.get(name) {
            Some(value) if value != 0.0 && value.abs() < 1e-3 => writeln!(out, "{name:<15} {value:.4e}{note}")?,
            Some(value) => writeln!(out, "{name:<15} {value:.6}{note}")?,
            None => writeln!(out, "{name:<15} undefined (a side is below 11 pixels)")?,
        }
    }
    Ok(())
}
