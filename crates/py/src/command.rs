//! The `etendue` command for the package's console script.

use std::ffi::OsString;
use std::process::ExitCode;

use pyo3::prelude::*;

/// Runs the command line with these arguments, the program's name first, and returns its exit code.
#[pyfunction]
pub fn cli_main(py: Python<'_>, argv: Vec<OsString>) -> u8 {
    let code = py.detach(|| etendue_cli::main(argv));
    // An exit code can be compared but not read.
    (0..=u8::MAX).find(|&n| code == ExitCode::from(n)).unwrap_or(etendue_cli::exit::FAILURE)
}
