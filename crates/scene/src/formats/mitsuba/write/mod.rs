//! Description → Mitsuba 3 XML, with PLY meshes and pictures beside it.

mod exr;
mod materials;
mod world;
mod xml;

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};

use crate::desc::{Color, Param, Scalar, SceneDesc};
use crate::report::Report;
use crate::span::Span;
use xml::Xml;

/// Writes a scene as Mitsuba 3 XML. Meshes and pictures go into the folder `NAME_files` beside it; pictures that lie in the XML's folder
/// already stay where they are. The losses of the report tell what Mitsuba cannot say.
///
/// # Errors
/// An I/O error that names the file.
pub fn write(desc: &SceneDesc, path: &Path) -> io::Result<Report> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned();
    let stem = path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned());
    let mut writer = Writer {
        desc,
        xml: Xml::new(),
        report: Report::default(),
        files_name: format!("{stem}_files"),
        folder,
        ids: Ids::new(desc),
        images: vec![None; desc.images.len()],
        mesh_names: vec![None; desc.meshes.len()],
    };
    writer.settings();
    for i in 0..desc.textures.len() {
        writer.texture(i)?;
    }
    for i in 0..desc.media.len() {
        writer.medium(i);
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

fn named(path: &Path, e: &io::Error) -> io::Error {
    io::Error::new(e.kind(), format!("{}: {e}", path.display()))
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
    folder: PathBuf,
    files_name: String,
    ids: Ids,
    images: Vec<Option<String>>,
    mesh_names: Vec<Option<String>>,
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

    /// Writes a file into the folder beside the XML and returns its name as the XML says it.
    fn put_file(&mut self, name: &str, bytes: &[u8]) -> io::Result<String> {
        let folder = self.folder.join(&self.files_name);
        std::fs::create_dir_all(&folder).map_err(|e| named(&folder, &e))?;
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(|e| named(&path, &e))?;
        Ok(format!("{}/{name}", self.files_name))
    }
}
