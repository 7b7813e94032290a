//! `pigment` and `density`.

use etendue_procedural::{Pattern, Pigment};

use super::super::{Parse, Parser};

impl Parser {
    /// `pigment { … }`; begins with the default texture's pigment unless an identifier starts the block.
    pub(crate) fn pigment(&mut self) -> Parse<Pigment> {
        Err(self.unexpected("the scene"))
    }

    /// `density { … }` of media: a pigment whose default map runs from black to white.
    pub(crate) fn density(&mut self) -> Parse<Pigment> {
        Err(self.unexpected("the scene"))
    }

    /// The inside of `pattern { … }` in functions.
    pub(crate) fn pattern(&mut self) -> Parse<Pattern> {
        Err(self.unexpected("the scene"))
    }
}
