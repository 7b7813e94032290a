//! `etendue info`: what a scene file holds and what of it is not honored.

use std::io::Write;
use std::process::ExitCode;

use etendue_scene::formats::{self, Summary};

use crate::exit;
use crate::scene_args::SceneArgs;

/// Which scene to look at.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Prints the summary to standard output.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let desc = args.scene.read([None, None])?;
    let text = if args.json { format!("{:#}", Summary::new(&desc).to_json()) } else { formats::summary(&desc) };
    writeln!(std::io::stdout(), "{}", text.trim_end())?;
    Ok(ExitCode::from(exit::OK))
}
