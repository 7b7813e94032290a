//! Description → Mitsuba 3 XML, with PLY meshes and pictures beside it.

mod materials;
mod world;
mod xml;

use std::collections::HashSet;
use std::io;
use std::path::Path;

use crate::desc::{Color, Param, Scalar, SceneDesc};
use crate::formats::sidecar::{Sidecar, named};
use crate::report::Report;
use crate::span::Span;
use xml::Xml;

/// Writes a scene as Mitsuba 3 XML. Meshes and pictures go into the folder `NAME_files` beside it; pictures that lie in the XML's folder
/// already stay where they are. The losses of the report tell what Mitsuba cannot say.
///
/// # Errors
/// An I/O error that names the file.
pub fn write(desc: &SceneDesc, path: &Path) -> io::Result<Report> {
    let mut writer =
        Writer { desc, xml: Xml::new(), report: Report::default(), files: Sidecar::new(desc, path), volumes: 0, ids: Ids::new(desc) };
    for i in 0..desc.media.len() {
        writer.medium(i)?;
    }
    writer.settings();
    for i in 0..desc.textures.len() {
        writer.texture(i)?;
    }
    for i in 0..desc.bsdfs.len() {
        writer.bsdf(i);
    }
    writer.shapes()?;
    writer.lights()?;
    let Writer { xml, report, .. } = writer;
    std::fs::write(path, xml.finish()).map_err(|e| named(path, &e))?;
    Ok(report)
}

/// Ids of the nodes that others refer to: their names where these are unique.
struct Ids {
    textures: Vec<String>,
    bsdfs: Vec<String>,
    media: Vec<String>,
    groups: Vec<String>,
    cameras: Vec<String>,
}

impl Ids {
    fn new(desc: &SceneDesc) -> Self {
        let mut taken = HashSet::new();
        let mut unique = |name: &str, kind: &str, i: usize| {
            let name: String = name.chars().map(|c| if c.is_alphanumeric() || "_-.".contains(c) { c } else { '_' }).take(80).collect();
            let mut id = if name.is_empty() { format!("{kind}_{i}") } else { name };
            while !taken.insert(id.clone()) {
                id = format!("{id}_{kind}_{i}");
            }
            id
        };
        Self {
            bsdfs: desc.bsdfs.iter().enumerate().map(|(i, n)| unique(&n.name, "bsdf", i)).collect(),
            textures: desc.textures.iter().enumerate().map(|(i, n)| unique(&n.name, "texture", i)).collect(),
            media: desc.media.iter().enumerate().map(|(i, n)| unique(&n.name, "medium", i)).collect(),
            cameras: desc.cameras.iter().enumerate().map(|(i, n)| unique(&n.name, "sensor", i)).collect(),
            groups: desc.groups.iter().enumerate().map(|(i, n)| unique(&n.name, "group", i)).collect(),
        }
    }
}

struct Writer<'d> {
    desc: &'d SceneDesc,
    xml: Xml,
    report: Report,
    files: Sidecar,
    /// Volumes that were made of others.
    volumes: usize,
    ids: Ids,
}

impl Writer<'_> {
    fn lose(&mut self, span: Span, feature: impl Into<String>, effect: &str) {
        self.report.loss(span, feature, effect);
    }

    fn color(&mut self, name: &str, color: Color) {
        match color {
            Param::Constant(c) => self.xml.triple("rgb", name, c),
            Param::Texture(id) => self.texture_ref(name, id.0),
        }
    }

    fn scalar(&mut self, name: &str, scalar: Scalar) {
        match scalar {
            Param::Constant(v) => self.xml.float(name, v),
            Param::Texture(id) => self.texture_ref(name, id.0),
        }
    }

    fn texture_ref(&mut self, name: &str, id: u32) {
        if let Some(id) = self.ids.textures.get(id as usize).cloned() {
            self.xml.reference(name, &id);
        }
    }
}
