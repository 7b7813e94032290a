//! `etendue convert`: a scene from one format to another.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use etendue_render::image::{is_rare, png_bytes};
use etendue_render::scene::bake_displacement;
use etendue_scene::desc::ImageSource;
use etendue_scene::formats::{Resolver, gltf, mitsuba, pbrt};
use etendue_scene::{Loss, SceneDesc};

use super::{note, report_losses, triangles};
use crate::exit::{self, coded};
use crate::scene_args::SceneArgs;

/// What to convert, and where to.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// File to write: .xml (Mitsuba 3) or .pbrt (pbrt-v4), with meshes and pictures in a folder beside it, .gltf or .glb.
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
    let mut desc = triangles(args.scene.read([None, None])?, args.tessellation)?;
    if extension != "pbrt"
        && let Err(faults) = bake_displacement(&mut desc)
    {
        let lines: Vec<String> = faults.iter().map(|f| format!("{}: {}", f.span.display(&desc.files), f.message)).collect();
        return Err(coded(exit::INVALID, lines.join("\n")));
    }
    if matches!(extension.as_str(), "xml" | "pbrt") {
        // pbrt reads GIF, Mitsuba does not.
        for message in common_pictures(&mut desc, extension == "xml") {
            note(&message);
        }
    }
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

/// Makes PNG of the pictures that neither Mitsuba nor pbrt reads; returns what could not be read, which stays as it is.
fn common_pictures(desc: &mut SceneDesc, gif: bool) -> Vec<String> {
    let mut messages = Vec::new();
    for (i, image) in desc.images.iter_mut().enumerate() {
        let (name, read);
        let bytes = match &image.value.source {
            ImageSource::File(path) => {
                // The writer says where a file cannot be read.
                let Ok(bytes) = Resolver::read(path) else { continue };
                (name, read) = (path.display().to_string(), bytes);
                &read
            }
            ImageSource::Embedded(bytes) => {
                name = format!("picture {i}");
                bytes
            }
            ImageSource::Pixels { .. } => continue,
        };
        if !is_rare(bytes, gif) {
            continue;
        }
        match png_bytes(bytes) {
            Ok(png) => image.value.source = ImageSource::Embedded(png),
            Err(e) => messages.push(format!("{name}: copied, not made a PNG, which the other program would read: {e}")),
        }
    }
    messages
}
