//! `interior`, `media`, `material`.

use super::super::value::Material;
use super::super::{Parse, Parser};
use crate::desc::classic::{Interior, Media};

impl Parser {
    /// `interior { … }`.
    pub(crate) fn interior(&mut self) -> Parse<Interior> {
        Err(self.unexpected("the scene"))
    }

    /// `media { … }`.
    pub(crate) fn media(&mut self) -> Parse<Media> {
        Err(self.unexpected("the scene"))
    }

    /// `material { … }`.
    pub(crate) fn material(&mut self) -> Parse<Material> {
        Err(self.unexpected("the scene"))
    }
}
