//! `function` and `spline`.

use etendue_procedural::{Function, Spline};

use super::super::{Parse, Parser};

impl Parser {
    /// `function [(a, b, …)] { … }` in all its forms (expression, `pigment`, `pattern`, `transform`, `spline`, `internal`).
    pub(crate) fn function(&mut self) -> Parse<Function> {
        Err(self.unexpected("the scene"))
    }

    /// `spline { … }`.
    pub(crate) fn spline(&mut self) -> Parse<Spline> {
        Err(self.unexpected("the scene"))
    }
}
