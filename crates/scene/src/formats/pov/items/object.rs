//! Objects and their modifiers.

use super::super::{Parse, Parser};
use crate::desc::classic::Object;

/// Words that begin an object.
pub(crate) const OBJECT_WORDS: &[&str] = &["sphere", "union", "object", "light_source", "light_group"];

impl Parser {
    /// Any object, from its first word (one of [`OBJECT_WORDS`]).
    pub(crate) fn object(&mut self) -> Parse<Object> {
        Err(self.unexpected("the scene"))
    }

    /// Adds an object to the scene: takes its lights out, gives parts without texture their parent's or the default.
    pub(crate) fn add_object(&mut self, object: Object) {
        self.scene.objects.push(std::sync::Arc::new(object));
    }
}
