//! The upper level: instances of lower-level hierarchies in the world.
#![allow(unsafe_code)]

use super::bins::PrimRef;
use super::blas::Blas;
use super::build;
use super::emit::{Source, emit};
use super::layout::{Arena, ChildRef};
use super::ray::{Prepared, in_range};
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{Isa, IsaKind, Portable};
use super::traverse::{self, Best, Items};
use super::{Hit, Ray};
use crate::math::{Aabb, Mat4, Vec3};

/// A placement of a [`Blas`] in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Where it stands; affine.
    pub world_from_object: Mat4,
    /// Index of the hierarchy.
    pub blas: u32,
}

/// All geometry of a scene, ready to trace.
pub struct Accel {
    blases: Vec<Blas>,
    placed: Vec<Placed>,
    arena: Arena,
    root: ChildRef,
    /// Instances without bounds, tested with every ray.
    unbounded: Vec<u32>,
    bounds: Aabb,
    skipped: usize,
    /// The only instance, where there is one that stands still: rays go straight to its hierarchy.
    single: Option<u32>,
    isa: IsaKind,
}

/// An instance as tracing needs it.
struct Placed {
    object_from_world: Mat4,
    identity: bool,
    blas: u32,
}

impl Accel {
    /// Builds the upper level on the current rayon pool. Instances whose transform has no inverse or is not finite, that
    /// name no hierarchy, or that hold nothing are left out ([`Accel::skipped`]).
    pub fn build(blases: Vec<Blas>, instances: Vec<Instance>) -> Self {
        let mut refs = Vec::new();
        let (mut unbounded, mut placed) = (Vec::new(), Vec::with_capacity(instances.len()));
        let mut skipped = 0;
        for (i, instance) in instances.iter().enumerate() {
            let identity = instance.world_from_object == Mat4::IDENTITY;
            let object_from_world = instance.world_from_object.inverse();
            placed.push(Placed { object_from_world, identity, blas: instance.blas });
            let Some(blas) = blases.get(instance.blas as usize).filter(|_| object_from_world.is_finite()) else {
                skipped += 1;
                continue;
            };
            let b = if identity { blas.bounds() } else { placed_bounds(blas.bounds(), instance.world_from_object) };
            if b.is_empty() {
                skipped += usize::from(!blas.bounds().is_empty());
            } else if in_range(b.min) && in_range(b.max) {
                refs.push(PrimRef::new(b, i as u32));
            } else {
                unbounded.push(i as u32);
            }
        }
        let single = (instances.len() == 1 && skipped == 0 && placed[0].identity).then(|| instances[0].blas);
        let source = Source { positions: &[], triangles: &[] };
        let tree = build::build(refs, &source);
        let (arena, root) = emit(&tree, &source).unwrap_or_else(|| {
            skipped = instances.len();
            (Arena::new(0), 0)
        });
        let bounds = if unbounded.is_empty() { tree.bounds.aabb() } else { Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY } };
        Self { blases, placed, arena, root, unbounded, bounds, skipped, single, isa: IsaKind::detect() }
    }

    /// The same with another instruction set than the best, for tests and measurements. One that the machine lacks is
    /// not taken.
    pub fn with_isa(mut self, isa: IsaKind) -> Self {
        if IsaKind::available().contains(&isa) {
            self.isa = isa;
        }
        self
    }

    /// The instruction set that rays are traced with.
    pub fn isa(&self) -> IsaKind {
        self.isa
    }

    /// A box around everything; empty where there is nothing, infinite with unbounded shapes.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Memory that tracing needs, in bytes.
    pub fn bytes(&self) -> usize {
        self.arena.bytes() + self.placed.len() * size_of::<Placed>() + self.blases.iter().map(Blas::bytes).sum::<usize>()
    }

    /// How many instances were left out.
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    /// The hierarchies, by index.
    pub fn blases(&self) -> &[Blas] {
        &self.blases
    }

    /// The hierarchy of the only instance, where it stands still.
    pub(super) fn single(&self) -> Option<&Blas> {
        self.single.map(|b| &self.blases[b as usize])
    }

    /// The instances without bounds.
    pub(super) fn unbounded(&self) -> &[u32] {
        &self.unbounded
    }

    /// The upper level's arena and root.
    pub(super) fn tree(&self) -> (&Arena, ChildRef) {
        (&self.arena, self.root)
    }

    /// The nearest hit; among equally near ones that of the lowest (instance, primitive).
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let mut best = Best::new(ray.t_max);
        match self.single {
            Some(blas) => self.blases[blas as usize].closest(self.isa, ray, &mut best),
            None => self.closest(ray, &mut best),
        }
        let Best { t, u, v, prim, instance, .. } = best;
        (instance != u32::MAX).then_some(Hit { t, u, v, prim, instance })
    }

    /// Whether there is any hit, at less cost than finding the nearest.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        let t_last = ray.t_max.next_down();
        match self.single {
            Some(blas) => self.blases[blas as usize].any(self.isa, ray, t_last),
            None => self.any(ray, t_last),
        }
    }

    fn closest(&self, ray: &Ray, best: &mut Best) {
        let items = Instances { accel: self };
        self.unbounded.iter().for_each(|&i| items.trace(i, ray, best));
        // SAFETY: the instruction set comes from detection, and the root and arena from one build.
        unsafe {
            match self.isa {
                IsaKind::Portable => self.closest_in::<Portable>(ray, best),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx2 => self.closest_avx2(ray, best),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx512 => self.closest_avx512(ray, best),
            }
        }
    }

    fn any(&self, ray: &Ray, t_last: f32) -> bool {
        let items = Instances { accel: self };
        if self.unbounded.iter().any(|&i| items.occluded(i, ray, t_last)) {
            return true;
        }
        // SAFETY: as above.
        unsafe {
            match self.isa {
                IsaKind::Portable => self.any_in::<Portable>(ray, t_last),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx2 => self.any_avx2(ray, t_last),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx512 => self.any_avx512(ray, t_last),
            }
        }
    }

    #[inline(always)]
    unsafe fn closest_in<I: Isa>(&self, ray: &Ray, best: &mut Best) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            if let Some(ray) = Prepared::new::<I>(ray) {
                traverse::closest::<I>(&self.arena, self.root, &ray, best, &Instances { accel: self });
            }
        }
    }

    #[inline(always)]
    unsafe fn any_in<I: Isa>(&self, ray: &Ray, t_last: f32) -> bool {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            match Prepared::new::<I>(ray) {
                Some(ray) => traverse::any::<I>(&self.arena, self.root, &ray, t_last, &Instances { accel: self }),
                None => false,
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt")]
    fn closest_avx2(&self, ray: &Ray, best: &mut Best) {
        // SAFETY: this function is only called where the machine has the instruction set.
        unsafe { self.closest_in::<Avx2>(ray, best) }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt,avx512f,avx512vl")]
    fn closest_avx512(&self, ray: &Ray, best: &mut Best) {
        // SAFETY: as above.
        unsafe { self.closest_in::<Avx512>(ray, best) }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt")]
    fn any_avx2(&self, ray: &Ray, t_last: f32) -> bool {
        // SAFETY: as above.
        unsafe { self.any_in::<Avx2>(ray, t_last) }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt,avx512f,avx512vl")]
    fn any_avx512(&self, ray: &Ray, t_last: f32) -> bool {
        // SAFETY: as above.
        unsafe { self.any_in::<Avx512>(ray, t_last) }
    }
}

/// The instances of an upper level as items of its leaves.
pub(super) struct Instances<'a> {
    pub accel: &'a Accel,
}

impl Instances<'_> {
    /// The hierarchy of an instance, and the ray in its space. The direction is not normalized, so t means the same.
    pub(super) fn enter(&self, item: u32, ray: &Ray) -> (&Blas, Ray) {
        let placed = &self.accel.placed[item as usize];
        let blas = &self.accel.blases[placed.blas as usize];
        let m = &placed.object_from_world;
        let inner = || Ray { o: m.transform_point3(ray.o), d: m.transform_vector3(ray.d), ..*ray };
        (blas, if placed.identity { *ray } else { inner() })
    }

    /// Offers the hits of a ray of the world on an instance to `best`.
    pub(super) fn trace(&self, item: u32, ray: &Ray, best: &mut Best) {
        let (blas, ray) = self.enter(item, ray);
        best.current = item;
        blas.closest(self.accel.isa, &ray, best);
    }

    /// Whether a ray of the world hits an instance at `t_last` or before.
    pub(super) fn occluded(&self, item: u32, ray: &Ray, t_last: f32) -> bool {
        let (blas, ray) = self.enter(item, ray);
        blas.any(self.accel.isa, &ray, t_last)
    }
}

impl Items for Instances<'_> {
    fn closest(&self, item: u32, ray: &Prepared, best: &mut Best) {
        self.trace(item, &ray.ray(), best);
    }

    fn any(&self, item: u32, ray: &Prepared, t_last: f32) -> bool {
        self.occluded(item, &ray.ray(), t_last)
    }
}

/// The world box of an instance, with room for the rounding of transformed rays.
fn placed_bounds(object: Aabb, world_from_object: Mat4) -> Aabb {
    if !(in_range(object.min) && in_range(object.max)) {
        return if object.is_empty() { object } else { Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY } };
    }
    let b = object.transformed(world_from_object);
    let pad = Vec3::splat(b.min.abs().max(b.max.abs()).max(world_from_object.w_axis.truncate().abs()).max_element() * 4e-6);
    Aabb { min: b.min - pad, max: b.max + pad }
}
