//! `texture`.

use etendue_procedural::Texture;

use super::super::{Parse, Parser};

impl Parser {
    /// One or more `texture { … }` in a row: layers of one texture. Begins with the default texture unless an identifier starts the
    /// block.
    pub(crate) fn texture(&mut self) -> Parse<Texture> {
        Err(self.unexpected("the scene"))
    }

    /// `texture { … }` alone, as in texture maps.
    pub(crate) fn texture_block(&mut self) -> Parse<Texture> {
        Err(self.unexpected("the scene"))
    }
}
