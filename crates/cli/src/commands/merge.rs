//! `etendue merge`: exact sums of films that hold different samples of one picture (docs/guide/film-format.md).

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use etendue_render::film::{DevelopOptions, Film};
use etendue_render::image::tonemap::{ToneMap, ToneOperator};
use etendue_render::image::{ExrAttribute, FileFormat, Image, WriteOptions};

use crate::exit::{self, coded};

/// Films and where their sum goes.
#[derive(clap::Args)]
pub struct Args {
    /// Films of the same scene, settings and seed, with different samples.
    #[arg(required = true, value_name = "FILM")]
    films: Vec<PathBuf>,
    /// The result: .film keeps the exact sums, .exr, .png, .jpg, .hdr and .pfm are developed pictures.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Exposure of PNG and JPEG in stops.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,
    /// Tone curve of PNG and JPEG.
    #[arg(long, default_value = "standard", value_parser = ToneOperator::NAMES)]
    tonemap: String,
}

/// Runs the merge. Nothing is written unless all films belong together.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let is_film = args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("film"));
    if !is_film {
        // A wrong name is better known before the work.
        FileFormat::from_path(&args.output).map_err(|e| coded(exit::USAGE, format!("{}: {e}", args.output.display())))?;
    }
    let load = |path: &Path| Film::load(path).with_context(|| path.display().to_string());
    let mut total = load(&args.films[0])?;
    for path in &args.films[1..] {
        let film = load(path)?;
        total.merge(&film).with_context(|| format!("{} does not merge with {}", path.display(), args.films[0].display()))?;
    }
    if is_film {
        total.save(&args.output).with_context(|| args.output.display().to_string())?;
    } else {
        let operator = ToneOperator::from_name(&args.tonemap).unwrap_or_default();
        let mut options = WriteOptions { tone: ToneMap { exposure: args.exposure, operator }, ..WriteOptions::default() };
        options.exr.attributes = attributes(&total);
        let image: Image = total.develop_with(DevelopOptions { variance: true, sample_count: true });
        image.save(&args.output, &options).with_context(|| args.output.display().to_string())?;
    }
    let samples: Vec<String> = total.held().entries().iter().take(8).map(|h| format!("{}..{}", h.begin, h.end)).collect();
    writeln!(std::io::stderr(), "merged {} films: samples {} of {}", args.films.len(), samples.join(", "), total.rect())?;
    Ok(ExitCode::SUCCESS)
}

fn attributes(film: &Film) -> Vec<(String, ExrAttribute)> {
    let meta = &film.meta;
    vec![
        ("renderer".into(), ExrAttribute::Text(meta.renderer.clone())),
        ("integrator".into(), ExrAttribute::Text(meta.integrator.clone())),
        ("sceneHash".into(), ExrAttribute::Text(meta.scene_hash.clone())),
        // As text: a seed has 64 bits.
        ("seed".into(), ExrAttribute::Text(meta.seed.to_string())),
        ("spp".into(), ExrAttribute::Int(i32::try_from(film.declared_spp()).unwrap_or(i32::MAX))),
        ("renderSeconds".into(), ExrAttribute::Float(meta.render_ms as f32 / 1000.0)),
    ]
}
