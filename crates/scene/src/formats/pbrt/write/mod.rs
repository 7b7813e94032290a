//! Description → pbrt-v4 text, with PLY meshes and pictures beside it.

mod mapping;
mod materials;
mod media;
mod world;

use std::fmt::Write as _;
use std::io;
use std::path::Path;

use glam::Mat4;

use crate::desc::{Color, Param, Scalar, SceneDesc, TextureId};
use crate::formats::sidecar::{Sidecar, named};
use crate::report::Report;
use crate::span::Span;

/// Writes a scene as pbrt-v4 text. Meshes and pictures go into the folder `NAME_files` beside it; pictures that lie in its folder already
/// stay where they are. The losses of the report tell what pbrt cannot say.
///
/// # Errors
/// An I/O error that names the file.
pub fn write(desc: &SceneDesc, path: &Path) -> io::Result<Report> {
    let mut writer =
        Writer { desc, text: String::new(), report: Report::default(), files: Sidecar::new(desc, path), tessellated: 0, heights: 0 };
    writer.settings()?;
    writer.line("WorldBegin");
    for i in 0..desc.textures.len() {
        writer.texture(i)?;
    }
    for i in 0..desc.bsdfs.len() {
        writer.bsdf(i)?;
    }
    writer.lights()?;
    writer.shapes()?;
    let Writer { text, report, .. } = writer;
    std::fs::write(path, text).map_err(|e| named(path, &e))?;
    Ok(report)
}

struct Writer<'d> {
    desc: &'d SceneDesc,
    text: String,
    report: Report,
    files: Sidecar,
    /// Meshes made of shapes that pbrt lacks.
    tessellated: u32,
    /// Textures made of constant displacements.
    heights: u32,
}

impl Writer<'_> {
    fn lose(&mut self, span: Span, feature: impl Into<String>, effect: &str) {
        self.report.loss(span, feature, effect);
    }

    fn line(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push('\n');
    }

    fn float(&mut self, name: &str, v: f32) {
        let _ = write!(self.text, " \"float {name}\" {v}");
    }

    fn string(&mut self, name: &str, v: &str) {
        let v = v.replace('\\', "\\\\").replace('"', "\\\"");
        let _ = write!(self.text, " \"string {name}\" \"{v}\"");
    }

    fn boolean(&mut self, name: &str, v: bool) {
        let _ = write!(self.text, " \"bool {name}\" {v}");
    }

    fn rgb(&mut self, name: &str, [r, g, b]: [f32; 3]) {
        let _ = write!(self.text, " \"rgb {name}\" [{r} {g} {b}]");
    }

    fn color(&mut self, name: &str, color: Color) {
        match color {
            Param::Constant(c) => self.rgb(name, c),
            Param::Texture(id) => self.texture_ref(name, "c", id),
        }
    }

    fn scalar(&mut self, name: &str, scalar: Scalar) {
        match scalar {
            Param::Constant(v) => self.float(name, v),
            Param::Texture(id) => self.texture_ref(name, "f", id),
        }
    }

    /// Every texture is written as a spectrum (`c…`) and as a float (`f…`) one.
    fn texture_ref(&mut self, name: &str, prefix: &str, id: TextureId) {
        let _ = write!(self.text, " \"texture {name}\" \"{prefix}{}\"", id.0);
    }

    fn transform(&mut self, word: &str, m: Mat4) {
        let _ = write!(self.text, "{word} [");
        for v in m.to_cols_array() {
            let _ = write!(self.text, " {v}");
        }
        self.text.push_str(" ]\n");
    }
}
