//! Light sources of the classic model.

use glam::DMat4;
use serde::{Deserialize, Serialize};

/// `light_source`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Light group, from 1; 0 for none.
    pub group: u32,
}

impl Light {
    /// Moves the light.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        let _ = world_from_old;
    }
}
