//! `fog`, `sky_sphere`, `rainbow`, `background`.

use super::super::{Parse, Parser};
use crate::desc::classic::{Fog, Rainbow, SkySphere};

impl Parser {
    /// `fog { … }`.
    pub(crate) fn fog(&mut self) -> Parse<Fog> {
        Err(self.unexpected("the scene"))
    }

    /// `sky_sphere { … }`.
    pub(crate) fn sky_sphere(&mut self) -> Parse<SkySphere> {
        Err(self.unexpected("the scene"))
    }

    /// `rainbow { … }`.
    pub(crate) fn rainbow(&mut self) -> Parse<Rainbow> {
        Err(self.unexpected("the scene"))
    }

    /// `background { … }`, into the scene.
    pub(crate) fn background(&mut self) -> Parse<()> {
        Err(self.unexpected("the scene"))
    }
}
