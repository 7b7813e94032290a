//! `etendue denoise`: a picture without its noise (docs/guide/denoise.md).

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context;
use etendue_render::denoise::{DenoiseError, DenoiseOptions, Denoiser};
use etendue_render::image::tonemap::{ToneMap, ToneOperator};
use etendue_render::image::{FileFormat, WriteOptions};

use super::compare::load_picture;
use super::note;
use crate::exit::{self, coded};
use crate::progress;

/// A noisy picture and where the clean one goes.
#[derive(clap::Args)]
pub struct Args {
    /// The picture: EXR or film with the layers albedo and N for the best result (render with `--aov albedo,normal`), or any other.
    picture: PathBuf,
    /// The result: .exr keeps all channels; .png, .jpg, .hdr, .pfm.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Take albedo and normals as they are: faster, and better where they have no noise to speak of.
    #[arg(long)]
    no_prefilter: bool,
    /// The library's file, or the folder that holds it [default: the environment variable ETENDUE_OIDN, else the
    /// system's libraries, else the packages of Python].
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
    /// Exposure of PNG and JPEG in stops.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,
    /// Tone curve of PNG and JPEG.
    #[arg(long, value_name = "NAME", default_value = "standard", value_parser = ToneOperator::NAMES)]
    tonemap: String,
    /// Threads; 0 leaves the number to the library.
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Say nothing but errors.
    #[arg(short, long)]
    quiet: bool,
}

/// Runs the command.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    // A wrong name is better known before the work.
    FileFormat::from_path(&args.output).map_err(|e| coded(exit::USAGE, format!("{}: {e}", args.output.display())))?;
    let denoiser = match &args.library {
        Some(file) => Denoiser::load_file(file),
        None => Denoiser::load(),
    };
    let denoiser = denoiser.map_err(|e| coded(exit::FAILURE, e))?;
    let mut image = load_picture(&args.picture)?;
    let start = Instant::now();
    let options = DenoiseOptions { prefilter: !args.no_prefilter, threads: args.threads };
    denoiser.denoise(&mut image, &options).map_err(|e| {
        let code = if matches!(e, DenoiseError::NoColor) { exit::INVALID } else { exit::FAILURE };
        coded(code, format!("{}: {e}", args.picture.display()))
    })?;
    let elapsed = start.elapsed();
    let operator = ToneOperator::from_name(&args.tonemap).unwrap_or_default();
    let options = WriteOptions { tone: ToneMap { exposure: args.exposure, operator }, ..WriteOptions::default() };
    image.save(&args.output, &options).with_context(|| args.output.display().to_string())?;
    if !args.quiet {
        let guides = [("albedo.R", "albedo"), ("N.X", "normals")].map(|(channel, name)| image.channel(channel).map(|_| name));
        let guides = match guides {
            [Some(albedo), Some(normals)] => format!("guided by {albedo} and {normals}"),
            [Some(albedo), None] => format!("guided by {albedo}"),
            _ => "without guides".to_owned(),
        };
        let (file, time) = (args.output.display(), progress::human(elapsed));
        note(&format!("{file}: Open Image Denoise {} in {time}, {guides}", denoiser.version()));
    }
    Ok(ExitCode::SUCCESS)
}
