//! Pigments: color at every point.

use glam::DMat4;
use serde::{Deserialize, Serialize};

use crate::{Color, Context};

/// Color at every point of space or of a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Pigment {
    /// The same everywhere.
    Solid(Color),
}

impl Default for Pigment {
    fn default() -> Self {
        Self::Solid(Color::default())
    }
}

impl Pigment {
    /// The color at the context's point.
    pub fn color(&self, context: &Context) -> Color {
        let _ = context;
        match self {
            Self::Solid(c) => *c,
        }
    }

    /// Moves the pattern with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        let _ = world_from_old;
    }
}
