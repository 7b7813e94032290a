//! Flags for [`RenderSettings`], made from its own declaration: names, help and defaults are written once, there.

use clap::{Arg, ArgMatches, Command};
use etendue_scene::RenderSettings;

/// The settings that the command line gives; the rest keep their defaults.
#[derive(Clone, Debug, Default)]
pub struct SettingsArgs(pub RenderSettings);

impl clap::FromArgMatches for SettingsArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut args = Self::default();
        args.update_from_arg_matches(matches)?;
        Ok(args)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        for spec in RenderSettings::SPECS {
            if let Some(text) = matches.get_one::<String>(spec.name) {
                self.0.set(spec.name, text).map_err(|e| {
                    let flag = spec.name.replace('_', "-");
                    clap::Error::raw(clap::error::ErrorKind::ValueValidation, format!("--{flag}: {e}\n"))
                })?;
            }
        }
        Ok(())
    }
}

impl clap::Args for SettingsArgs {
    fn augment_args(command: Command) -> Command {
        RenderSettings::SPECS.iter().fold(command, |command, spec| {
            let doc = spec.doc.trim();
            let help = match spec.default {
                "None" => doc.to_owned(),
                default => format!("{doc} [default: {default}]"),
            };
            let value = if spec.unit.is_empty() { spec.kind } else { spec.unit };
            let arg = Arg::new(spec.name)
                .long(spec.name.replace('_', "-"))
                .value_name(value.to_ascii_uppercase().replace(' ', "_"))
                .help(help)
                .allow_hyphen_values(true)
                .help_heading("Picture and light");
            // A switch alone means yes; `--switch=false` takes it back.
            let is_switch = spec.kind == "switch";
            command.arg(if is_switch {
                arg.value_name("BOOL").num_args(0..=1).require_equals(true).default_missing_value("true")
            } else {
                arg
            })
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}
