//! `etendue form-factors`: the form factors of a scene's elements as a table.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use etendue_render::radiosity::direct::DirectLights;
use etendue_render::radiosity::matrix::{FactorMatrix, Options};
use etendue_render::radiosity::{Method, Progress, Settings, build_mesh};
use etendue_render::scene;
use etendue_scene::RenderSettings;

use super::{note, report_losses};
use crate::exit::{self, coded};
use crate::scene_args::SceneArgs;
use crate::settings::SettingsArgs;

/// More than this makes files that nobody reads.
const MAX_ELEMENTS: usize = 5000;

/// Which scene, and where to.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    settings: SettingsArgs,
    /// Output file (CSV); standard output where not given.
    #[arg(short, long, value_name = "FILE.csv", help_heading = "Output")]
    output: Option<PathBuf>,
}

/// Cuts the scene as the matrix method would and prints each element with its row of the matrix.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let given = &args.settings.0;
    let settings = RenderSettings {
        radiosity_method: Some("matrix".into()),
        radiosity_elements: given.radiosity_elements.or(Some(500)),
        ..given.clone()
    };
    let settings = Settings { method: Method::Matrix, ..Settings::new(&settings).map_err(|e| coded(exit::USAGE, e))? };
    if settings.limits.elements > MAX_ELEMENTS {
        return Err(coded(exit::USAGE, format!("a table of at most {MAX_ELEMENTS} elements can be printed (--radiosity-elements)")));
    }
    let desc = args.scene.read([given.width, given.height])?;
    report_losses(&desc);
    let compiled = scene::compile(&desc, given, [64, 64])
        .map_err(|f| coded(exit::INVALID, f.iter().map(|f| f.message.clone()).collect::<Vec<_>>().join("\n")))?;
    let lights = DirectLights::new(&compiled, settings.seed);
    let progress = Progress::silent();
    let (mesh, notes) = build_mesh(&compiled, &settings, &lights, &progress).map_err(|e| coded(exit::FAILURE, e))?;
    notes.iter().for_each(|n| note(n));
    let leaves = mesh.leaves();
    if leaves.len() > 2 * MAX_ELEMENTS {
        return Err(coded(exit::FAILURE, format!("the scene has {} elements, too many for a table", leaves.len())));
    }
    let options =
        Options { form_factors: settings.form_factors, solver: settings.solver, hemicube: settings.hemicube, seed: settings.seed };
    let table = FactorMatrix::new(&compiled, &mesh, &leaves, &options, &progress).to_csv(&compiled, &mesh, &leaves);
    match &args.output {
        Some(path) => std::fs::write(path, table).with_context(|| format!("{}", path.display()))?,
        None => std::io::stdout().write_all(table.as_bytes())?,
    }
    Ok(ExitCode::from(exit::OK))
}
