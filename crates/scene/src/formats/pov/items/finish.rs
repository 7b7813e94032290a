//! `finish`.

use etendue_procedural::Finish;

use super::super::{Parse, Parser};

impl Parser {
    /// `finish { … }`; begins with the default texture's finish unless an identifier starts the block.
    pub(crate) fn finish(&mut self) -> Parse<Finish> {
        Err(self.unexpected("the scene"))
    }
}
