//! Files that a written scene refers to: meshes and pictures in a folder `NAME_files` beside it.

use std::io;
use std::path::{Path, PathBuf};

use super::mesh::ply_write;
use super::volume::VolFile;
use super::{Resolver, exr};
use crate::desc::{ImageId, ImageSource, MeshData, MeshId, SceneDesc, VolumeDesc};

/// Writes each file on first use and remembers its name.
pub(super) struct Sidecar {
    folder: PathBuf,
    files_name: String,
    images: Vec<Option<String>>,
    meshes: Vec<Option<String>>,
}

impl Sidecar {
    /// For a scene that will be written to `path`.
    pub fn new(desc: &SceneDesc, path: &Path) -> Self {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned();
        let stem = path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned());
        Self { folder, files_name: format!("{stem}_files"), images: vec![None; desc.images.len()], meshes: vec![None; desc.meshes.len()] }
    }

    /// Writes a file and returns its name as the scene says it.
    fn put(&mut self, name: &str, bytes: &[u8]) -> io::Result<String> {
        let folder = self.folder.join(&self.files_name);
        std::fs::create_dir_all(&folder).map_err(|e| named(&folder, &e))?;
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(|e| named(&path, &e))?;
        Ok(format!("{}/{name}", self.files_name))
    }

    /// The name of a mesh's PLY file.
    ///
    /// # Errors
    /// An I/O error that names the file.
    pub fn mesh(&mut self, id: MeshId, data: &MeshData) -> io::Result<String> {
        let i = id.0 as usize;
        if let Some(Some(name)) = self.meshes.get(i) {
            return Ok(name.clone());
        }
        let name = self.put(&format!("mesh_{i}.ply"), &ply_write::to_bytes(data))?;
        if let Some(slot) = self.meshes.get_mut(i) {
            *slot = Some(name.clone());
        }
        Ok(name)
    }

    /// The name of a picture's file. Pictures that lie in the scene's folder already stay where they are.
    ///
    /// # Errors
    /// An I/O error that names the file.
    pub fn image(&mut self, desc: &SceneDesc, id: ImageId) -> io::Result<String> {
        let i = id.0 as usize;
        if let Some(Some(name)) = self.images.get(i) {
            return Ok(name.clone());
        }
        let name = match desc.images.get(i).map(|n| &n.value.source) {
            Some(ImageSource::File(path)) => {
                let folder = self.folder.canonicalize().ok();
                let inside = folder.and_then(|f| path.strip_prefix(f).ok().map(|p| p.to_string_lossy().replace('\\', "/")));
                match inside {
                    Some(name) => name,
                    None => {
                        let bytes = Resolver::read(path).map_err(|e| named(path, &io::Error::other(e.to_string())))?;
                        let file = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
                        self.put(&format!("{i}_{file}"), &bytes)?
                    }
                }
            }
            Some(ImageSource::Embedded(bytes)) => {
                let extension = match bytes.as_slice() {
                    [0x89, b'P', b'N', b'G', ..] => "png",
                    [0xff, 0xd8, ..] => "jpg",
                    [b'#', b'?', ..] => "hdr",
                    [0x76, 0x2f, 0x31, 0x01, ..] => "exr",
                    [b'R', b'I', b'F', b'F', ..] => "webp",
                    [b'B', b'M', ..] => "bmp",
                    _ => "img",
                };
                self.put(&format!("image_{i}.{extension}"), bytes)?
            }
            Some(ImageSource::Pixels { width, height, channels, data }) => {
                let bytes = exr::to_bytes(*width, *height, *channels, data);
                self.put(&format!("image_{i}.exr"), &bytes)?
            }
            None => String::new(),
        };
        if let Some(slot) = self.images.get_mut(i) {
            *slot = Some(name.clone());
        }
        Ok(name)
    }
}

impl Sidecar {
    /// The name of a file of text.
    ///
    /// # Errors
    /// An I/O error that names the file.
    pub fn text(&mut self, name: &str, text: &str) -> io::Result<String> {
        self.put(name, text.as_bytes())
    }

    /// The name of a volume's `.vol` file.
    ///
    /// # Errors
    /// An I/O error that names the file.
    pub fn volume(&mut self, i: usize, volume: &VolumeDesc) -> io::Result<String> {
        self.put(&format!("volume_{i}.vol"), &VolFile::to_bytes(volume.size, volume.channels, &volume.data))
    }
}

/// An I/O error that names its file.
pub(super) fn named(path: &Path, e: &io::Error) -> io::Error {
    io::Error::new(e.kind(), format!("{}: {e}", path.display()))
}
