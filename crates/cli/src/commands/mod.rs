//! The commands, one file each: `Args` (clap) and `run`.

pub mod bench;
pub mod compare;
pub mod merge;

use std::io::Write;
use std::process::ExitCode;

/// Prints an error with its causes to standard error and returns the exit code for it.
pub fn report_error(e: &anyhow::Error) -> ExitCode {
    let _ = writeln!(std::io::stderr(), "etendue: error: {e:#}");
    ExitCode::from(1)
}
