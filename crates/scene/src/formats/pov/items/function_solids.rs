//! Surfaces of functions: `isosurface`, `parametric`.

use super::super::{Parse, Parser};
use crate::desc::classic::Solid;

impl Parser {
    /// What stands in the braces of `isosurface` before the modifiers.
    pub(super) fn isosurface(&mut self) -> Parse<Solid> {
        Err(self.unexpected("the scene"))
    }

    /// What stands in the braces of `parametric` before the modifiers.
    pub(super) fn parametric(&mut self) -> Parse<Solid> {
        Err(self.unexpected("the scene"))
    }
}
