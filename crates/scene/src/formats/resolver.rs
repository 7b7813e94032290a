//! Which files a scene may read: those in its own folder and in the search paths that the user names, and no others.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// The largest file that is read whole, in bytes.
pub const FILE_SIZE_LIMIT: u64 = 4 << 30;

/// Finds files for a scene without leaving the folders that it may read.
#[derive(Clone, Debug)]
pub struct Resolver {
    /// Canonical folders; the first is the scene's own.
    roots: Vec<PathBuf>,
}

/// Why a file was not found.
#[derive(Debug, thiserror::Error)]
pub enum ResolveError {
    /// No such file in any folder.
    #[error("no file `{0}` in the scene's folder or the search paths")]
    NotFound(String),
    /// The path leads out of the folders.
    #[error("`{0}` is outside the scene's folder and the search paths; allow its folder with --search-path")]
    Outside(String),
    /// The file is too large, or no ordinary file.
    #[error("`{0}` is no ordinary file of at most 4 GiB")]
    Unfit(String),
    /// The system would not read it.
    #[error("`{0}`: {1}")]
    Io(String, std::io::Error),
}

impl Resolver {
    /// For a scene file in `folder`, with further search paths. Folders that do not exist are left out.
    pub fn new(folder: &Path, search_paths: &[PathBuf]) -> Self {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let roots =
            std::iter::once(folder).chain(search_paths.iter().map(PathBuf::as_path)).filter_map(|p| p.canonicalize().ok()).collect();
        Self { roots }
    }

    /// The canonical path of a file that a scene names, relative to `base` (the folder of the file that names it), to the scene's
    /// folder or to a search path. Backslashes count as slashes; links are followed and must stay inside.
    ///
    /// # Errors
    /// [`ResolveError`] where there is no such file or it is outside.
    pub fn resolve(&self, base: &Path, name: &str) -> Result<PathBuf, ResolveError> {
        let relative = PathBuf::from(name.replace('\\', "/"));
        let mut outside = false;
        for root in std::iter::once(base).chain(self.roots.iter().map(PathBuf::as_path)) {
            let Ok(path) = root.join(&relative).canonicalize() else { continue };
            if self.roots.iter().any(|r| path.starts_with(r)) {
                return if path.is_file() { Ok(path) } else { Err(ResolveError::Unfit(name.to_owned())) };
            }
            outside = true;
        }
        // Do not tell a scene which files exist elsewhere.
        let climbs = relative.is_absolute() || relative.components().any(|c| c == Component::ParentDir);
        Err(if outside || climbs { ResolveError::Outside(name.to_owned()) } else { ResolveError::NotFound(name.to_owned()) })
    }

    /// The bytes of a file that [`Resolver::resolve`] returned.
    ///
    /// # Errors
    /// [`ResolveError`] where the file is too large or cannot be read.
    pub fn read(path: &Path) -> Result<Vec<u8>, ResolveError> {
        let name = || path.display().to_string();
        let io = |e| ResolveError::Io(name(), e);
        let file = File::open(path).map_err(io)?;
        let meta = file.metadata().map_err(io)?;
        if !meta.is_file() || meta.len() > FILE_SIZE_LIMIT {
            return Err(ResolveError::Unfit(name()));
        }
        let mut bytes = Vec::with_capacity(meta.len() as usize);
        file.take(FILE_SIZE_LIMIT).read_to_end(&mut bytes).map_err(io)?;
        Ok(bytes)
    }
}
