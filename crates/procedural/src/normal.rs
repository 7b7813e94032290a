//! Perturbation of normals by patterns.

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

use crate::Context;

/// A normal perturbation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Normal {}

impl Normal {
    /// The perturbed unit normal for the unit normal `n` at the context's point.
    pub fn perturb(&self, n: DVec3, context: &Context) -> DVec3 {
        let _ = context;
        n
    }

    /// Moves the pattern with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        let _ = world_from_old;
    }
}
