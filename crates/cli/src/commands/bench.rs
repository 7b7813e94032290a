//! `etendue bench`: measurements of the renderer's kernels.

mod intersect;

use std::process::ExitCode;

/// What to measure.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Trace rays from files against a mesh from a file and print the speed as a line of JSON.
    Intersect(intersect::Args),
}

/// Runs the measurement.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    match args.what {
        What::Intersect(args) => intersect::run(args),
    }
}
