//! `etendue convert`: a scene from one format to another.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use etendue_scene::Loss;
use etendue_scene::formats::{gltf, mitsuba, pbrt};

use super::{note, report_losses, triangles};
use crate::exit::{self, coded};
use crate::scene_args::SceneArgs;

/// What to convert, and where to.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// File to write: .xml (Mitsuba 3, with meshes and pictures in a folder beside it), .gltf or .glb.
    output: PathBuf,
    /// Segments of a full circle where POV-Ray's solids become triangles; 64 where not given.
    #[arg(long, value_name = "N")]
    tessellation: Option<u32>,
    /// Say nothing but errors.
    #[arg(short, long)]
    quiet: bool,
}

/// Converts; what the other format cannot say goes to standard error.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let extension = args.output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if !matches!(extension.as_str(), "xml" | "pbrt" | "gltf" | "glb") {
        return Err(coded(exit::USAGE, format!("{}: a scene can be written as .xml, .pbrt, .gltf or .glb", args.output.display())));
    }
    let desc = triangles(args.scene.read([None, None])?, args.tessellation)?;
    if !args.quiet {
        report_losses(&desc);
    }
    let written = match extension.as_str() {
        "xml" => mitsuba::write(&desc, &args.output).map(|report| report.losses),
        "pbrt" => pbrt::write(&desc, &args.output).map(|report| report.losses),
        _ => gltf::write(&desc, &args.output),
    };
    let losses: Vec<Loss> = written.with_context(|| args.output.display().to_string())?;
    if !args.quiet {
        for loss in &losses {
            note(&format!("{}: not written: {}: {}", loss.span.display(&desc.files), loss.feature, loss.effect));
        }
        note(&format!("{}: written, {} losses", args.output.display(), losses.len()));
    }
    Ok(ExitCode::from(exit::OK))
}
