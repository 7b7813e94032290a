//! Finding and reading the files that a scene names.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::lexer::{self, Code};
use super::parser::{Parse, Parser};
use super::value::Value;
use crate::formats::{ResolveError, Resolver};
use crate::span::{FileId, Span};

/// Most bytes of all scene and include files together, and of each other file.
const TEXT_LIMIT: u64 = 1 << 30;

/// The files of a scene.
pub(super) struct Files {
    /// Paths that spans point at; the first is the scene's.
    pub(super) paths: Vec<PathBuf>,
    resolver: Resolver,
    folder: PathBuf,
    folders: Vec<PathBuf>,
    /// Include files as tokens.
    codes: HashMap<PathBuf, Arc<Code>>,
    bytes: u64,
    /// Files that the scene has written, by the name that it gave them.
    pub(super) written: HashMap<String, Vec<u8>>,
    /// Open files, by number.
    pub(super) open: Vec<Option<super::directive_file::OpenFile>>,
}

impl Files {
    /// For a scene with further folders in which it may read.
    pub(super) fn new(scene: PathBuf, search_paths: &[PathBuf]) -> Self {
        let folder = scene.parent().map(Path::to_path_buf).unwrap_or_default();
        let folder = if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder };
        let folders = std::iter::once(folder.clone()).chain(search_paths.iter().cloned()).collect();
        Self {
            resolver: Resolver::new(&folder, search_paths),
            folder: folder.canonicalize().unwrap_or(folder),
            folders,
            paths: vec![scene],
            codes: HashMap::new(),
            bytes: 0,
            written: HashMap::new(),
            open: Vec::new(),
        }
    }

    /// The path of a file by its name, with or without regard to letter case; whether the case differs.
    fn find(&self, including: Option<&Path>, name: &str) -> Result<(PathBuf, bool), ResolveError> {
        let first = match self.resolver.resolve(&self.folder, name) {
            Ok(path) => return Ok((path, false)),
            Err(e) => e,
        };
        if let Some(folder) = including
            && let Ok(path) = self.resolver.resolve(folder, name)
        {
            return Ok((path, false));
        }
        let trimmed = name.trim();
        for folder in including.into_iter().chain(self.folders.iter().map(PathBuf::as_path)) {
            if let Some(other) = other_case(folder, trimmed)
                && let Ok(path) = self.resolver.resolve(folder, &other)
            {
                return Ok((path, true));
            }
        }
        Err(first)
    }
}

/// The name of a file that differs in letter case only, relative to a folder.
fn other_case(folder: &Path, name: &str) -> Option<String> {
    let mut path = folder.to_path_buf();
    let mut found: Vec<String> = Vec::new();
    for part in name.replace('\\', "/").split('/').filter(|p| !p.is_empty() && *p != ".") {
        if part == ".." {
            return None;
        }
        let mut names: Vec<String> = std::fs::read_dir(&path)
            .ok()?
            .take(100_000)
            .filter_map(|e| e.ok()?.file_name().into_string().ok())
            .filter(|n| n.to_lowercase() == part.to_lowercase())
            .collect();
        names.sort();
        let there = names.into_iter().next()?;
        path.push(&there);
        found.push(there);
    }
    (!found.is_empty()).then(|| found.join("/"))
}

impl Parser {
    /// The folder of the file that is being read.
    fn including_folder(&self) -> Option<PathBuf> {
        let file = self.frames.last()?.code.file;
        self.files.paths.get(file.0 as usize)?.parent().map(Path::to_path_buf)
    }

    /// The path of a file by the name in the scene, perhaps with one of some endings added.
    pub(super) fn find_file(&mut self, name: &str, extensions: &[&str], span: Span) -> Parse<PathBuf> {
        let folder = self.including_folder();
        let mut result = self.files.find(folder.as_deref(), name);
        for extension in extensions {
            if result.is_ok() {
                break;
            }
            if let Ok(found) = self.files.find(folder.as_deref(), &format!("{name}.{extension}")) {
                result = Ok(found);
            }
        }
        match result {
            Ok((path, other_case)) => {
                if other_case {
                    self.warning(span, format!("no file `{name}`; `{}` is taken, which differs in letter case", path.display()));
                }
                Ok(path)
            }
            Err(e) => Err(self.error(span, e.to_string())),
        }
    }

    /// Whether a file is there that the scene may read.
    pub(super) fn file_is_there(&self, name: &str) -> bool {
        self.files.written.contains_key(name) || self.files.find(self.including_folder().as_deref(), name).is_ok()
    }

    /// The bytes of a file by the name in the scene; those that the scene has written itself come first.
    pub(super) fn read_file(&mut self, name: &str, extensions: &[&str], span: Span) -> Parse<Vec<u8>> {
        if let Some(bytes) = self.files.written.get(name) {
            return Ok(bytes.clone());
        }
        let path = self.find_file(name, extensions, span)?;
        self.read_path(&path, span)
    }

    fn read_path(&mut self, path: &Path, span: Span) -> Parse<Vec<u8>> {
        match std::fs::metadata(path) {
            Ok(m) if m.len() <= TEXT_LIMIT => {}
            _ => return Err(self.error(span, format!("`{}` cannot be read or has more than 1 GiB", path.display()))),
        }
        match Resolver::read(path) {
            Ok(bytes) => Ok(bytes),
            Err(e) => Err(self.error(span, e.to_string())),
        }
    }

    /// The tokens of an include file.
    pub(super) fn include_code(&mut self, name: &str, span: Span) -> Parse<Arc<Code>> {
        if let Some(bytes) = self.files.written.get(name) {
            // Written by this very scene: it may have changed since the last time.
            let bytes = bytes.clone();
            return self.lex_include(PathBuf::from(name), &bytes, span);
        }
        let path = self.find_file(name, &["inc", "pov"], span)?;
        if let Some(code) = self.files.codes.get(&path) {
            return Ok(code.clone());
        }
        let bytes = self.read_path(&path, span)?;
        let code = self.lex_include(path.clone(), &bytes, span)?;
        self.files.codes.insert(path, code.clone());
        Ok(code)
    }

    fn lex_include(&mut self, path: PathBuf, bytes: &[u8], span: Span) -> Parse<Arc<Code>> {
        self.files.bytes += bytes.len() as u64;
        if self.files.bytes > TEXT_LIMIT {
            return Err(self.error(span, "the include files have more than 1 GiB together"));
        }
        let at = self.files.paths.iter().position(|p| *p == path).unwrap_or_else(|| {
            self.files.paths.push(path);
            self.files.paths.len() - 1
        });
        Ok(Arc::new(lexer::lex(FileId(at as u32), bytes, &mut self.names)))
    }
}

impl Parser {
    /// Declares the identifiers that the caller names.
    pub(super) fn declare_options(&mut self) -> Parse<()> {
        self.version = self.options.version.unwrap_or(362);
        self.stated_version = self.options.version.unwrap_or(370);
        self.scene.settings.noise_generator = self.default_noise_generator();
        for (name, text) in self.options.declares.clone() {
            let is_name = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
                && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
                && super::words::find(&name).is_none();
            if !is_name {
                return Err(self.error(Span::default(), format!("`{name}` cannot be declared: it is no identifier")));
            }
            let value = text.trim().parse().map_or_else(|_| Value::String(text.trim_matches('"').into()), Value::Float);
            let name = self.names.intern(&name);
            self.symbols.set(&self.symbols.place(name), value);
        }
        Ok(())
    }

    /// Puts what the scene has written into the folder that the options allow.
    pub(super) fn write_files(&mut self) {
        let Some(folder) = self.options.output_folder.clone() else { return };
        let mut written: Vec<(String, Vec<u8>)> = self.files.written.drain().collect();
        written.sort();
        for (name, bytes) in written {
            let relative = PathBuf::from(name.replace('\\', "/"));
            let is_plain = relative.components().all(|c| matches!(c, std::path::Component::Normal(_)));
            let result = if is_plain { write_inside(&folder, &relative, &bytes) } else { Err(std::io::ErrorKind::PermissionDenied.into()) };
            if let Err(e) = result {
                self.warning(Span::default(), format!("`{name}` is not written: {e}"));
            }
        }
    }
}

/// Writes a file whose folder, links followed, is inside of `folder`.
fn write_inside(folder: &Path, relative: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let root = folder.canonicalize()?;
    let path = root.join(relative);
    let parent = path.parent().unwrap_or(&root).canonicalize()?;
    // An existing link could lead anywhere.
    if !parent.starts_with(&root) || path.symlink_metadata().is_ok_and(|m| !m.is_file()) {
        return Err(std::io::ErrorKind::PermissionDenied.into());
    }
    std::fs::write(path, bytes)
}
