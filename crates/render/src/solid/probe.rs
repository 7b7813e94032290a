//! What the scene language asks of geometry while it is read: `trace`, `inside`, `min_extent`, `max_extent`.

use std::sync::{Arc, Mutex, PoisonError};

use etendue_procedural::{ImageId, Images};
use etendue_scene::desc::classic::{ClassicImage, GlobalSettings, Object, Solid};
use etendue_scene::formats::pov::Probe;
use glam::{DAffine3, DVec3};

use super::compile::{Compiler, Shape};
use crate::classic::NotedPictures;

use super::{Bounds, Line, Primitive, RayKind, World};

/// Sides of boxes without bound (as measured).
const BEYOND: f64 = 1e10;

/// Prepared objects that are kept.
const KEPT: usize = 64;

/// Answers by [`World`]s of single objects, the last few of which are kept: scripts ask of one object many times.
#[derive(Default)]
pub struct WorldProbe {
    /// The last asked at the end. The objects are kept, so that their addresses stay theirs.
    worlds: Mutex<Vec<(Arc<Object>, Arc<World>)>>,
    pictures: NotedPictures,
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
            None => (object.clone(), Arc::new(World::with_images(std::slice::from_ref(object), Some(&self.pictures)))),
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

    fn add_image(&self, id: ImageId, image: &ClassicImage, settings: &GlobalSettings) {
        self.pictures.add(id, image, settings);
    }

    fn images(&self) -> Option<&dyn Images> {
        Some(&self.pictures)
    }

    fn extent(&self, object: &Arc<Object>) -> (DVec3, DVec3) {
        let b = extent(object, &mut Compiler::new(None), false);
        if b.is_empty() { (DVec3::ZERO, DVec3::ZERO) } else { (b.min.max(DVec3::splat(-BEYOND)), b.max.min(DVec3::splat(BEYOND))) }
    }
}

/// The box of an object: boxes of parts joined or cut in the space of their parent, then moved as boxes, clips left out (as measured).
/// `cut`: as part of an intersection, where half-spaces along axes count.
fn extent(object: &Object, compiler: &mut Compiler, cut: bool) -> Bounds {
    let m = DAffine3::from_mat4(object.world_from_solid);
    let own = match &object.solid {
        Solid::Union(parts) | Solid::Merge(parts) => parts.iter().fold(Bounds::EMPTY, |b, p| b.union(extent(p, compiler, cut))),
        Solid::Intersection(parts) => parts.iter().fold(Bounds::INFINITE, |b, p| b.intersection(extent(p, compiler, true))),
        Solid::Difference(parts) => parts.first().map_or(Bounds::EMPTY, |p| extent(p, compiler, true)),
        // As high as it can be, whatever the picture.
        Solid::HeightField(_) => Bounds::of(DVec3::ZERO, DVec3::ONE),
        solid => match compiler.shape(solid) {
            None => Bounds::EMPTY,
            Some(shape) if cut => return turned(shape.inside_bounds().transformed(&m), object.inverse),
            Some(Shape::Plane(_)) => Bounds::INFINITE,
            Some(shape) => return turned(shape.extent(&m), object.inverse && cut),
        },
    };
    turned(own.transformed(&m), object.inverse && cut)
}

/// Turned inside out, a shape reaches everywhere.
fn turned(b: Bounds, inverse: bool) -> Bounds {
    if inverse { Bounds::INFINITE } else { b }
}
