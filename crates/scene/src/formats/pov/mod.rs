//! POV-Ray 3.7 scene description language.
//!
//! ```text
//! text ─lexer→ tokens ─directives (#declare, #while, #macro, #include …)→ tokens ─items→ ClassicScene
//! ```
//!
//! The language is one recursive descent over a stream of tokens in which directives may stand anywhere, so all of it is one
//! [`Parser`] with its methods in several files: the language itself in `lexer`, `directive`, `expression` …, the items of a scene in
//! `items/`.

mod directive;
mod directive_file;
mod directive_flow;
mod dispatch;
mod expression;
mod expression_function;
mod files;
mod fonts;
mod items;
mod lexer;
mod options;
mod parser;
mod probe;
mod random;
mod stream;
mod strings;
mod symbols;
mod value;
mod words;

pub use options::{MessageSink, PovOptions, Stream};
pub use parser::{Parse, Parser, Stop, Token};
pub use probe::Probe;
pub use value::{Array, Macro, Material, Num, Value};

use std::path::{Path, PathBuf};

use super::{ReadOptions, Resolver};
use crate::desc::SceneDesc;
use crate::report::ReadError;
use files::Files;

/// Bytes of stack for the parser: it goes into itself with every open brace and every macro in an expression.
const STACK_SIZE: usize = 256 << 20;

/// Most bytes of a scene file.
const SCENE_LIMIT: u64 = 1 << 30;

/// Folders of POV-Ray's own include files, as far as they exist: those that the environment variable `ETENDUE_POV_INCLUDE` names, else
/// those of an installed POV-Ray.
pub fn library_folders() -> Vec<PathBuf> {
    let named = std::env::var_os("ETENDUE_POV_INCLUDE");
    let folders: Vec<PathBuf> = match &named {
        Some(text) => std::env::split_paths(text).collect(),
        None => ["/usr/share", "/usr/local/share"]
            .iter()
            .flat_map(|root| ["povray-3.7/include", "povray/include", "fonts/truetype/povray"].map(|f| Path::new(root).join(f)))
            .collect(),
    };
    folders.into_iter().filter(|f| f.is_dir()).collect()
}

/// Reads a scene file. Include files are looked for in its folder, in the folder of the file that names them, in the search paths, and in
/// [`library_folders`].
///
/// # Errors
/// [`ReadError`] with the fault at which reading ended.
pub fn read(path: &Path, options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let io = |source| ReadError::Io { path: path.to_owned(), source };
    let length = std::fs::metadata(path).map_err(io)?.len();
    if length > SCENE_LIMIT {
        return Err(ReadError::Unsupported { path: path.to_owned(), reason: "more than 1 GiB".to_owned() });
    }
    let bytes = Resolver::read(path).map_err(|e| match e {
        super::ResolveError::Io(_, source) => io(source),
        other => ReadError::Unsupported { path: path.to_owned(), reason: other.to_string() },
    })?;
    let mut options = options.clone();
    options.search_paths.extend(library_folders());
    read_bytes(path, &bytes, &options)
}

/// Reads a scene from the bytes of a file; `path` names it in messages, and its folder is where the names of other files start.
///
/// # Errors
/// [`ReadError`] with the fault at which reading ended.
pub fn read_bytes(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let io = |source| ReadError::Io { path: path.to_owned(), source };
    std::thread::scope(|scope| {
        let reading = std::thread::Builder::new().name("pov".to_owned()).stack_size(STACK_SIZE);
        let reading = reading.spawn_scoped(scope, || read_here(path, bytes, options)).map_err(io)?;
        reading.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

fn read_here(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<SceneDesc, ReadError> {
    let mut parser = Parser::new(options.pov.clone(), Files::new(path.to_owned(), &options.search_paths));
    parser.begin(bytes);
    let result = parser.declare_options().and_then(|()| parser.parse_scene());
    parser.write_files();
    let size = parser.options.size;
    parser.scene.settings.version = parser.version();
    let mut desc = SceneDesc { format: "pov".to_owned(), files: parser.files.paths, report: parser.report, ..SceneDesc::default() };
    if result.is_err() || desc.report.has_errors() {
        return Err(ReadError::Invalid { files: desc.files, faults: desc.report.faults });
    }
    desc.film.width = Some(size[0]);
    desc.film.height = Some(size[1]);
    desc.classic = Some(Box::new(parser.scene));
    desc.integrator.name = "whitted".to_owned();
    Ok(desc)
}
