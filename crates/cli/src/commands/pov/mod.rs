//! `etendue pov`: POV-Ray's own command line, `.ini` files and animations.

mod frames;
mod options;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use etendue_scene::formats::pov::PovOptions;

use super::{note, render};
use crate::exit::{self, coded};
use frames::Frame;
use options::{Options, Smoothing};

/// Switches, `.ini` files (`file.ini[Section]`), settings (`Width=640`) and a scene, as POV-Ray takes them.
#[derive(clap::Args)]
#[command(disable_help_flag = true, disable_version_flag = true)]
pub struct Args {
    /// Print help.
    #[arg(long, action = clap::ArgAction::Help)]
    help: Option<bool>,
    /// Scene, `.ini` files and switches: +I +O +W +H +A +R +AM +Q +F +L +K +KFI +KFF +KI +KF +KC +SF +EF +STP +SC +SR +EC +ER +MV +WT.
    #[arg(value_name = "ARGUMENT", trailing_var_arg = true, allow_hyphen_values = true, required = true)]
    arguments: Vec<String>,
}

#[derive(clap::Parser)]
struct Rendering {
    #[command(flatten)]
    args: render::Args,
}

/// Renders the scene, or all frames of its animation.
///
/// # Errors
/// Of the command line, and those of `render`.
pub fn run(args: Args) -> anyhow::Result<ExitCode> {
    let mut options = Options::default();
    for argument in &args.arguments {
        options.argument(argument).map_err(|e| coded(exit::USAGE, e))?;
    }
    for warning in &options.warnings {
        note(&format!("warning: {warning}"));
    }
    let Some(input) = options.input.clone() else {
        return Err(coded(exit::USAGE, "no scene is named: +Iscene.pov"));
    };
    let input = find_scene(&input, &options.library);
    for frame in frames::frames(&options) {
        let code = render_frame(&options, &input, &frame)?;
        if code != ExitCode::SUCCESS {
            return Ok(code);
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The scene's file: the name may lack its ending, and may be in a folder of the library.
fn find_scene(name: &str, library: &[PathBuf]) -> PathBuf {
    let names = [name.to_owned(), format!("{name}.pov"), format!("{name}.POV")];
    let folders = || std::iter::once(PathBuf::new()).chain(library.iter().cloned());
    let found = folders().flat_map(|f| names.clone().map(|n| f.join(n))).find(|p| p.is_file());
    found.unwrap_or_else(|| PathBuf::from(name))
}

fn render_frame(options: &Options, input: &Path, frame: &Frame) -> anyhow::Result<ExitCode> {
    let output = options.output_path(input, frame.suffix.as_deref());
    let mut words: Vec<std::ffi::OsString> = vec!["render".into(), input.into()];
    let mut flag = |name: &str, value: std::ffi::OsString| words.extend([name.into(), value]);
    flag("--output", output.into());
    flag("--width", options.width.to_string().into());
    flag("--height", options.height.to_string().into());
    match options.antialias() {
        Smoothing::None => flag("--antialias", "0".into()),
        Smoothing::All { spp } => flag("--spp", spp.to_string().into()),
        Smoothing::Adaptive { threshold, depth } => {
            flag("--antialias", threshold.to_string().into());
            flag("--antialias-depth", depth.to_string().into());
        }
    }
    flag("--threads", options.threads.to_string().into());
    if let Some([x0, y0, x1, y1]) = options.crop() {
        flag("--crop", format!("{x0},{y0},{x1},{y1}").into());
    }
    for folder in &options.library {
        flag("--search-path", folder.into());
    }
    if options.is_quiet {
        words.push("--quiet".into());
    }
    let mut rendering = Rendering::try_parse_from(words).map_err(|e| coded(exit::USAGE, e))?;
    rendering.args.scene.pov = Some(PovOptions {
        declares: options.declares.clone(),
        clock: frame.clock,
        is_animation: frame.suffix.is_some(),
        frame: frame.number,
        frames: frame.range,
        clocks: frame.clocks,
        size: [options.width, options.height],
        version: options.version,
        ..PovOptions::default()
    });
    render::run(rendering.args)
}
