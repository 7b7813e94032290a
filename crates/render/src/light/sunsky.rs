//! Sun and sky.
use super::Light;
/// None yet.
pub fn lights(_: &etendue_scene::desc::SunSkyDesc) -> Vec<Light> {
    Vec::new()
}
