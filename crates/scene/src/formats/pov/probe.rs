//! What the language asks of geometry while a scene is read.

use std::sync::Arc;

use etendue_procedural::{ImageId, Images};
use glam::DVec3;

use crate::desc::classic::{ClassicImage, GlobalSettings, Object};

/// Answers `trace`, `inside`, `min_extent` and `max_extent`. The renderer implements it; without one these are errors by name.
pub trait Probe: Send + Sync {
    /// The nearest hit of a ray with the object: point and unit normal.
    fn trace(&self, object: &Arc<Object>, origin: DVec3, direction: DVec3) -> Option<(DVec3, DVec3)>;
    /// Whether the point is inside.
    fn inside(&self, object: &Arc<Object>, p: DVec3) -> bool;
    /// Takes note of a picture of the scene, by its number, so that functions and height fields find it.
    fn add_image(&self, id: ImageId, image: &ClassicImage, settings: &GlobalSettings);
    /// The pictures noted so far, where they can be read.
    fn images(&self) -> Option<&dyn Images>;
    /// Lower and upper corner of a box around the object; infinite where it is unbounded.
    fn extent(&self, object: &Arc<Object>) -> (DVec3, DVec3);
}
