//! `normal`.

use etendue_procedural::Normal;

use super::super::{Parse, Parser};

impl Parser {
    /// `normal { … }`.
    pub(crate) fn normal(&mut self) -> Parse<Normal> {
        Err(self.unexpected("the scene"))
    }
}
