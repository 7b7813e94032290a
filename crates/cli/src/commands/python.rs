//! Commands of the Python package: its `etendue` runs them before the command line here sees them. They are listed here so that `--help` has
//! them and the binary alone says what they need.

use std::process::ExitCode;

use crate::exit::{self, coded};

/// Whatever the command is given.
#[derive(Clone, Debug, clap::Args)]
#[command(disable_help_flag = true)]
pub struct Args {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    rest: Vec<std::ffi::OsString>,
}

/// Says where the command is.
///
/// # Errors
/// Always.
pub fn refuse(command: &str, extra: &str) -> anyhow::Result<ExitCode> {
    Err(coded(exit::USAGE, format!("`etendue {command}` comes with the Python package: pip install \"etendue[{extra}]\"")))
}
