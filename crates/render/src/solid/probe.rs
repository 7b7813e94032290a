//! What the scene language asks of geometry while it is read: `trace`, `inside`, `min_extent`, `max_extent`.

use std::sync::{Arc, Mutex, PoisonError};

use etendue_scene::desc::classic::Object;
use etendue_scene::formats::pov::Probe;
use glam::DVec3;

use super::{Line, RayKind, World};

/// Prepared objects that are kept.
const KEPT: usize = 64;

/// Answers by [`World`]s of single objects, the last few of which are kept: scripts ask of one object many times.
#[derive(Default)]
pub struct WorldProbe {
    /// The last asked at the end. The objects are kept, so that their addresses stay theirs.
    worlds: Mutex<Vec<(Arc<Object>, Arc<World>)>>,
}

impl WorldProbe {
    /// With nothing prepared yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn world(&self, object: &Arc<Object>) -> Arc<World> {
        let mut worlds = self.worlds.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = match worlds.iter().position(|(o, _)| Arc::ptr_eq(o, object)) {
            Some(at) => worlds.remove(at),
            None => (object.clone(), Arc::new(World::new(std::slice::from_ref(object)))),
        };
        let world = entry.1.clone();
        if worlds.len() >= KEPT {
            worlds.remove(0);
        }
        worlds.push(entry);
        world
    }
}

impl Probe for WorldProbe {
    fn trace(&self, object: &Arc<Object>, origin: DVec3, direction: DVec3) -> Option<(DVec3, DVec3)> {
        let d = direction.try_normalize()?;
        let world = self.world(object);
        let hit = world.nearest(&Line { o: origin, d }, 1e-10, f64::INFINITY, RayKind::Photon)?;
        Some((hit.p, hit.n))
    }

    fn inside(&self, object: &Arc<Object>, p: DVec3) -> bool {
        self.world(object).inside(p)
    }

    fn extent(&self, object: &Arc<Object>) -> (DVec3, DVec3) {
        let b = self.world(object).bounds();
        if b.is_empty() { (DVec3::ZERO, DVec3::ZERO) } else { (b.min, b.max) }
    }
}
