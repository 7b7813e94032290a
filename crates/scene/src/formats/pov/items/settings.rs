//! `global_settings`.

use super::super::{Parse, Parser};

impl Parser {
    /// `global_settings { … }`, into the scene.
    pub(crate) fn global_settings(&mut self) -> Parse<()> {
        Err(self.unexpected("the scene"))
    }
}
