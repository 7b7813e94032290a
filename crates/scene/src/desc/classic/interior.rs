//! What is inside of objects.

use glam::DMat4;
use serde::{Deserialize, Serialize};

/// `media`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Media {}

/// `interior`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interior {
    /// Index of refraction.
    pub ior: f64,
    /// Media.
    pub media: Vec<Media>,
}

impl Default for Interior {
    fn default() -> Self {
        Self { ior: 1.0, media: Vec::new() }
    }
}

impl Interior {
    /// Moves the media's densities with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        let _ = world_from_old;
    }
}
