//! `camera`.

use super::super::{Parse, Parser};
use crate::desc::classic::Camera;

impl Parser {
    /// `camera { … }`.
    pub(crate) fn camera(&mut self) -> Parse<Camera> {
        Err(self.unexpected("the scene"))
    }
}
