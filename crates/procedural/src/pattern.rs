//! The pattern library.

use glam::DMat4;
use serde::{Deserialize, Serialize};

use crate::Context;

/// A pattern with its modifiers (warps, transforms, turbulence, frequency, phase, wave form).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pattern {}

impl Pattern {
    /// The pattern's value at the context's point, usually in [0, 1].
    pub fn value(&self, context: &Context) -> f64 {
        let _ = context;
        0.0
    }

    /// Moves the pattern with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        let _ = world_from_old;
    }
}
