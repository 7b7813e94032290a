//! The `etendue` command line: one module for each command under [`commands`].
//!
//! [`main`] parses arguments, runs the command and turns its result into an exit code. It is a library so that the
//! Python package can offer the same command.

mod clock;
pub mod commands;
pub mod exit;
pub mod progress;
pub mod scene_args;
pub mod settings;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// One renderer for the scene files you already have.
#[derive(Parser)]
#[command(name = "etendue", version, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render a scene.
    Render(Box<commands::render::Args>),
    /// Render a POV-Ray scene with POV-Ray's own switches and .ini files.
    Pov(commands::pov::Args),
    /// Bake a scene's light into textures or vertices, as glTF.
    Bake(Box<commands::bake::Args>),
    /// Measure lux and candela per square meter: sensor grids, false-color pictures, uniformity.
    Light(Box<commands::light::Args>),
    /// Print what a scene file holds and what of it is not honored.
    Info(commands::info::Args),
    /// Print the form factors of a scene's elements as a table.
    FormFactors(Box<commands::form_factors::Args>),
    /// Convert a scene to another format.
    Convert(commands::convert::Args),
    /// Measure the renderer's kernels.
    Bench(commands::bench::Args),
    /// Compare a picture with a reference: relMSE, FLIP, SSIM and others, thresholds, a heat map.
    Compare(commands::compare::Args),
    /// Render a scene by every method and report their errors over time.
    Study(Box<commands::study::Args>),
    /// Add up films of different samples of one picture, exactly.
    Merge(commands::merge::Args),
    /// Trace photons of a scene into a file that serves many views; merge such files.
    Photons(commands::photons::Args),
    /// Remove noise from a picture with Intel Open Image Denoise, where it is installed.
    Denoise(commands::denoise::Args),
    /// Render on many machines: up, submit, status, wait, fetch and more (needs the Python package).
    Farm(commands::python::Args),
    /// Look at a scene in the browser while it renders (needs the Python package).
    View(commands::python::Args),
}

/// Runs the command line and returns the process's exit code ([`exit`]).
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(e) => {
            // Help and version go to standard output with success, faults to standard error.
            let code = if e.use_stderr() { exit::USAGE } else { exit::OK };
            let _ = e.print();
            return ExitCode::from(code);
        }
    };
    let result = match cli.command {
        Command::Render(args) => commands::render::run(*args),
        Command::Pov(args) => commands::pov::run(args),
        Command::Bake(args) => commands::bake::run(*args),
        Command::Light(args) => commands::light::run(*args),
        Command::Info(args) => commands::info::run(args),
        Command::FormFactors(args) => commands::form_factors::run(*args),
        Command::Convert(args) => commands::convert::run(args),
        Command::Bench(args) => commands::bench::run(args),
        Command::Compare(args) => commands::compare::run(args),
        Command::Study(args) => commands::study::run(*args),
        Command::Merge(args) => commands::merge::run(args),
        Command::Photons(args) => commands::photons::run(args),
        Command::Denoise(args) => commands::denoise::run(args),
        Command::Farm(_) => commands::python::refuse("farm", "farm"),
        Command::View(_) => commands::python::refuse("view", "console"),
    };
    result.unwrap_or_else(|e| {
        commands::note(&format!("etendue: error: {}", with_causes(&e)));
        ExitCode::from(exit::code_of(&e))
    })
}

/// An error and its causes on one line; a cause that the error above it has told already is not told again.
fn with_causes(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_once() {
        let io = std::io::Error::other("disk on fire");
        let read = etendue_scene::ReadError::Io { path: "a.xml".into(), source: io };
        assert_eq!(with_causes(&anyhow::Error::new(read).context("while loading")), "while loading: a.xml: disk on fire");
    }
}
