//! `light_source`, `light_group`.

use super::super::{Parse, Parser};
use crate::desc::classic::Object;

impl Parser {
    /// `light_source { … }`, as an object of [`crate::desc::classic::Solid::Light`] (a union with it, where it `looks_like` something).
    pub(crate) fn light_source(&mut self) -> Parse<Object> {
        Err(self.unexpected("the scene"))
    }

    /// `light_group { … }`: a union with a light group number of its own.
    pub(crate) fn light_group(&mut self) -> Parse<Object> {
        Err(self.unexpected("the scene"))
    }
}
