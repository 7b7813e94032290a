//! Flags that say how a scene file is read.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use etendue_render::solid::WorldProbe;
use etendue_scene::formats::pov::{PovOptions, Stream};
use etendue_scene::formats::{self, ReadOptions};
use etendue_scene::{ReadError, SceneDesc};

/// A scene file and how to read it.
#[derive(Clone, Debug, clap::Args)]
pub struct SceneArgs {
    /// Scene file: Mitsuba 3 (.xml), POV-Ray (.pov), pbrt-v4 (.pbrt), glTF (.gltf, .glb), .obj, .ply, .stl.
    pub scene: PathBuf,
    /// Folder beside the scene's own in which it may read files; may be given several times.
    #[arg(short = 'L', long = "search-path", value_name = "FOLDER", help_heading = "Reading")]
    pub search_paths: Vec<PathBuf>,
    /// Value for `$KEY` in a Mitsuba file, or of an identifier in a POV-Ray scene; may be given several times.
    #[arg(short = 'D', long = "define", value_name = "KEY=VALUE", value_parser = parse_define, help_heading = "Reading")]
    pub defines: Vec<(String, String)>,
    /// Material variant of a glTF file.
    #[arg(long, value_name = "NAME", help_heading = "Reading")]
    pub variant: Option<String>,
    /// Scene of a glTF file, by name or number.
    #[arg(long = "gltf-scene", value_name = "NAME", help_heading = "Reading")]
    pub gltf_scene: Option<String>,
    /// `clock` of a POV-Ray scene.
    #[arg(long, value_name = "NUMBER", default_value_t = 0.0, allow_negative_numbers = true, help_heading = "Reading")]
    pub clock: f64,
    /// `frame_number` of a POV-Ray scene; 0 for a picture that is no frame of an animation.
    #[arg(long, value_name = "NUMBER", default_value_t = 0, help_heading = "Reading")]
    pub frame: i32,
    /// `final_frame` of a POV-Ray scene.
    #[arg(long, value_name = "NUMBER", default_value_t = 0, help_heading = "Reading")]
    pub frames: i32,
    /// Folder in which a POV-Ray scene may write files (#fopen); without one they are kept in memory.
    #[arg(long, value_name = "FOLDER", help_heading = "Reading")]
    pub script_output: Option<PathBuf>,
    /// What POV-Ray's own command line says; replaces size and clock.
    #[arg(skip)]
    pub pov: Option<PovOptions>,
}

fn parse_define(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.is_empty() => Ok((key.to_owned(), value.to_owned())),
        _ => Err("expected KEY=VALUE".to_owned()),
    }
}

impl SceneArgs {
    /// Reads the scene; its report also names what the renderer does not honor. `size` is the picture's, as far as the user gives it: the
    /// scenes of POV-Ray may ask for it.
    ///
    /// # Errors
    /// [`ReadError`]
    pub fn read(&self, size: [Option<u32>; 2]) -> Result<SceneDesc, ReadError> {
        let options = ReadOptions {
            search_paths: self.search_paths.clone(),
            defines: self.defines.iter().cloned().collect(),
            variant: self.variant.clone(),
            scene: self.gltf_scene.clone(),
            pov: self.pov_options(size),
        };
        let mut desc = formats::read(&self.scene, &options)?;
        desc.report.losses.extend(etendue_render::scene::losses(&desc));
        Ok(desc)
    }

    fn pov_options(&self, size: [Option<u32>; 2]) -> PovOptions {
        let mut options = self.pov.clone().unwrap_or_else(|| {
            let default = PovOptions::default();
            // One given edge keeps the ratio of the default size, as the film does.
            let scaled = |n: u32, a: u32, b: u32| (f64::from(n) * f64::from(a) / f64::from(b)).round().max(1.0) as u32;
            let [w, h] = default.size;
            let size = match size {
                [Some(w), Some(h)] => [w, h],
                [Some(n), None] => [n, scaled(n, h, w)],
                [None, Some(n)] => [scaled(n, w, h), n],
                [None, None] => [w, h],
            };
            let mut options = PovOptions { declares: self.defines.clone(), clock: self.clock, size, ..default };
            if self.frame > 0 {
                options.is_animation = true;
                options.frame = self.frame;
                options.frames = [1, self.frames.max(self.frame)];
                options.clocks = [0.0, 1.0];
            }
            options
        });
        options.output_folder.clone_from(&self.script_output);
        options.probe = Some(Arc::new(WorldProbe::new()));
        options.messages = Some(Arc::new(|stream, text: &str| {
            // Warnings are in the report.
            if stream != Stream::Warning {
                let _ = std::io::stderr().write_all(text.as_bytes());
            }
        }));
        options
    }
}
