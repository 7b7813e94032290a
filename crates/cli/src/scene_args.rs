//! Flags that say how a scene file is read.

use std::path::PathBuf;

use etendue_scene::formats::{self, ReadOptions};
use etendue_scene::{ReadError, SceneDesc};

/// A scene file and how to read it.
#[derive(Clone, Debug, clap::Args)]
pub struct SceneArgs {
    /// Scene file: Mitsuba 3 (.xml), glTF (.gltf, .glb), .obj, .ply, .stl.
    pub scene: PathBuf,
    /// Folder beside the scene's own in which it may read files; may be given several times.
    #[arg(short = 'L', long = "search-path", value_name = "FOLDER", help_heading = "Reading")]
    pub search_paths: Vec<PathBuf>,
    /// Value for `$KEY` in a Mitsuba file; may be given several times.
    #[arg(short = 'D', long = "define", value_name = "KEY=VALUE", value_parser = parse_define, help_heading = "Reading")]
    pub defines: Vec<(String, String)>,
    /// Material variant of a glTF file.
    #[arg(long, value_name = "NAME", help_heading = "Reading")]
    pub variant: Option<String>,
    /// Scene of a glTF file, by name or number.
    #[arg(long = "gltf-scene", value_name = "NAME", help_heading = "Reading")]
    pub gltf_scene: Option<String>,
}

fn parse_define(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.is_empty() => Ok((key.to_owned(), value.to_owned())),
        _ => Err("expected KEY=VALUE".to_owned()),
    }
}

impl SceneArgs {
    /// Reads the scene; its report also names what the renderer does not honor.
    ///
    /// # Errors
    /// [`ReadError`]
    pub fn read(&self) -> Result<SceneDesc, ReadError> {
        let options = ReadOptions {
            search_paths: self.search_paths.clone(),
            defines: self.defines.iter().cloned().collect(),
            variant: self.variant.clone(),
            scene: self.gltf_scene.clone(),
            ..ReadOptions::default()
        };
        let mut desc = formats::read(&self.scene, &options)?;
        desc.report.losses.extend(etendue_render::scene::losses(&desc));
        Ok(desc)
    }
}
