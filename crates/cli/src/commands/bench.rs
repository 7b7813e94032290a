//! `etendue bench`: measurements of the renderer's kernels.

use std::process::ExitCode;

/// What to measure.
#[derive(clap::Args)]
pub struct Args {}

/// Runs the measurement.
pub fn run(_args: Args) -> anyhow::Result<ExitCode> {
    anyhow::bail!("no measurement named")
}
