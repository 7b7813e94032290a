//! Exit codes, documented in docs/guide/exit-codes.md.

use std::fmt;

/// Everything went well.
pub const OK: u8 = 0;
/// A fault that no other code names.
pub const FAILURE: u8 = 1;
/// The command line is wrong.
pub const USAGE: u8 = 2;
/// A scene or picture file is invalid or not supported.
pub const INVALID: u8 = 3;
/// A file could not be read or written.
pub const IO: u8 = 4;
/// A comparison found more difference than allowed.
pub const DIFFERENT: u8 = 10;
/// Stopped by Ctrl-C; what was done has been written.
pub const INTERRUPTED: u8 = 130;

/// An error that knows its exit code.
#[derive(Debug)]
pub struct Coded {
    /// The exit code.
    pub code: u8,
    /// What went wrong.
    pub message: String,
}

impl fmt::Display for Coded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Coded {}

/// An error with an exit code.
pub fn coded(code: u8, message: impl fmt::Display) -> anyhow::Error {
    anyhow::Error::new(Coded { code, message: message.to_string() })
}

/// The exit code of an error.
pub fn code_of(error: &anyhow::Error) -> u8 {
    use etendue_render::film::file::FilmFileError;
    use etendue_render::image::ImageError;
    use etendue_render::photon::file::PhotonFileError;
    use etendue_scene::ReadError;
    for cause in error.chain() {
        if let Some(c) = cause.downcast_ref::<Coded>() {
            return c.code;
        }
        match cause.downcast_ref::<ReadError>() {
            Some(ReadError::Io { .. }) => return IO,
            Some(_) => return INVALID,
            None => {}
        }
        // These show their io::Error as themselves, so the chain does not list it.
        match cause.downcast_ref::<ImageError>() {
            Some(ImageError::Io(_)) => return IO,
            Some(ImageError::Unsupported(_) | ImageError::Invalid(_) | ImageError::TooLarge { .. }) => return INVALID,
            _ => {}
        }
        match cause.downcast_ref::<FilmFileError>() {
            Some(FilmFileError::Io(_)) => return IO,
            Some(FilmFileError::Film(_)) | None => {}
            Some(_) => return INVALID,
        }
        match cause.downcast_ref::<PhotonFileError>() {
            Some(PhotonFileError::Io(_)) => return IO,
            Some(_) => return INVALID,
            None => {}
        }
        if cause.is::<std::io::Error>() {
            return IO;
        }
    }
    FAILURE
}
