//! The lower level: triangles and analytic shapes in one hierarchy.
#![allow(unsafe_code)]

use super::Ray;
use super::bins::PrimRef;
use super::build::{self, MAX_DEPTH};
use super::emit::{Source, emit};
use super::layout::{Arena, Block, ChildRef, Node, TAG_ITEMS, TAG_NODE, UNIT};
use super::ray::{LIMIT, Prepared, in_range};
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{Isa, IsaKind, LANES, Portable, WIDTH};
use super::traverse::{self, Best, Items, lane_box};
use crate::math::{Aabb, Vec3};
use crate::shape::Shape;
use rayon::prelude::*;

/// Geometry to build a [`Blas`] from. Primitive ids: `0..triangles.len()` are triangles, `triangles.len() + i` is `shapes[i]`.
pub struct BlasInput<'a> {
    /// Vertices.
    pub positions: &'a [Vec3],
    /// Three vertex indices for each triangle.
    pub triangles: &'a [[u32; 3]],
    /// Analytic shapes; those without bounds are tested with every ray.
    pub shapes: &'a [Shape],
}

/// A hierarchy over triangles and shapes in one space.
pub struct Blas {
    pub(super) arena: Arena,
    pub(super) root: ChildRef,
    bounds: Aabb,
    pub(super) shapes: Shapes,
    /// Shapes without bounds, as indices of `shapes`.
    pub(super) unbounded: Vec<u32>,
    triangles: u32,
    skipped: usize,
}

/// The shapes with the boxes that hits on them are held against.
pub(super) struct Shapes {
    shapes: Vec<(Shape, Aabb)>,
    /// Primitive id of the first.
    first: u32,
}

impl Items for Shapes {
    #[inline]
    fn closest(&self, item: u32, ray: &Prepared, best: &mut Best) {
        let (shape, bounds) = &self.shapes[item as usize];
        // The ray's own interval, not the one up to the best hit: a hit must not depend on what was found before.
        if let Some(near) = ray.enters(bounds)
            && let Some(h) = shape.intersect(&ray.ray())
        {
            best.offer(h.t.max(near), h.u, h.v, self.first + item);
        }
    }

    #[inline]
    fn any(&self, item: u32, ray: &Prepared, t_last: f32) -> bool {
        let (shape, bounds) = &self.shapes[item as usize];
        ray.enters(bounds).is_some_and(|near| shape.intersect(&ray.ray()).is_some_and(|h| h.t.max(near) <= t_last))
    }
}

impl Blas {
    /// Builds the hierarchy on the current rayon pool; the result does not depend on the number of threads. Triangles
    /// and shapes with coordinates that are no numbers or beyond 1e18, with indices out of range, or with fewer than
    /// three different corners are left out; so is everything if the hierarchy would exceed 16 GiB ([`Blas::skipped`]).
    pub fn build(input: BlasInput) -> Self {
        let BlasInput { positions, triangles, shapes } = input;
        let triangle_box = |t: &[u32; 3]| -> Option<Aabb> {
            let [a, b, c] = [*positions.get(t[0] as usize)?, *positions.get(t[1] as usize)?, *positions.get(t[2] as usize)?];
            let usable = in_range(a) && in_range(b) && in_range(c) && a != b && b != c && c != a;
            usable.then(|| Aabb { min: a.min(b).min(c), max: a.max(b).max(c) })
        };
        let mut refs: Vec<PrimRef> = triangles
            .par_iter()
            .enumerate()
            .with_min_len(4096)
            .filter_map(|(i, t)| triangle_box(t).map(|b| PrimRef::new(b, i as u32)))
            .collect();
        let mut skipped = triangles.len() - refs.len();
        let first = triangles.len() as u32;
        let mut kept = Vec::with_capacity(shapes.len());
        let mut unbounded = Vec::new();
        for (i, shape) in shapes.iter().enumerate() {
            let b = widened(shape.bounds());
            if in_range(b.min) && in_range(b.max) && !b.is_empty() {
                refs.push(PrimRef::new(b, first + i as u32));
            } else if b.min.is_nan() || b.max.is_nan() || b.is_empty() {
                skipped += 1;
            } else {
                unbounded.push(i as u32);
            }
            kept.push((shape.clone(), b));
        }
        let source = Source { positions, triangles };
        let tree = build::build(refs, &source);
        let (arena, root) = emit(&tree, &source).unwrap_or_else(|| {
            skipped = triangles.len() + shapes.len() - unbounded.len();
            (Arena::new(0), 0)
        });
        let everywhere = Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };
        let bounds = if unbounded.is_empty() { tree.bounds.aabb() } else { everywhere };
        for &i in &unbounded {
            kept[i as usize].1 = everywhere;
        }
        Self { arena, root, bounds, shapes: Shapes { shapes: kept, first }, unbounded, triangles: first, skipped }
    }

    /// A box around everything; empty where there is nothing, infinite with unbounded shapes.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Memory that tracing needs, in bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + self.arena.bytes() + self.shapes.shapes.len() * size_of::<(Shape, Aabb)>() + self.unbounded.len() * 4
    }

    /// How many triangles and shapes were left out, because nothing can hit them or they are not finite.
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    /// The contents of nodes and leaves.
    #[cfg(test)]
    pub(super) fn words(&self) -> Vec<u32> {
        self.arena.units().iter().flat_map(|u| u.0).collect()
    }

    /// Offers the hits on shapes without bounds to `best`.
    #[inline]
    pub(super) fn closest_unbounded(&self, ray: &Ray, best: &mut Best) {
        for &i in &self.unbounded {
            if let Some(h) = self.shapes.shapes[i as usize].0.intersect(ray) {
                best.offer(h.t, h.u, h.v, self.shapes.first + i);
            }
        }
    }

    /// Whether a shape without bounds is hit at `t_last` or before.
    #[inline]
    pub(super) fn any_unbounded(&self, ray: &Ray, t_last: f32) -> bool {
        let hit = |i: &u32| self.shapes.shapes[*i as usize].0.intersect(ray).is_some_and(|h| h.t <= t_last);
        self.unbounded.iter().any(hit)
    }

    /// Offers all hits of a ray in this space to `best`.
    #[inline]
    pub(super) fn closest(&self, isa: IsaKind, ray: &Ray, best: &mut Best) {
        self.closest_unbounded(ray, best);
        #[cfg(target_arch = "x86_64")]
        let Ray { o, d, .. } = *ray;
        // SAFETY: `isa` comes from detection, and the root and arena from one build.
        unsafe {
            match isa {
                IsaKind::Portable => self.closest_in::<Portable>(ray, best),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx2 => self.closest_avx2(o.x, o.y, o.z, d.x, d.y, d.z, ray.t_min, ray.t_max, best),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx512 => self.closest_avx512(o.x, o.y, o.z, d.x, d.y, d.z, ray.t_min, ray.t_max, best),
            }
        }
    }

    /// Whether a ray in this space hits anything at `t_last` or before.
    #[inline]
    pub(super) fn any(&self, isa: IsaKind, ray: &Ray, t_last: f32) -> bool {
        if self.any_unbounded(ray, t_last) {
            return true;
        }
        #[cfg(target_arch = "x86_64")]
        let Ray { o, d, .. } = *ray;
        // SAFETY: as above.
        unsafe {
            match isa {
                IsaKind::Portable => self.any_in::<Portable>(ray, t_last),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx2 => self.any_avx2(o.x, o.y, o.z, d.x, d.y, d.z, ray.t_min, ray.t_max),
                #[cfg(target_arch = "x86_64")]
                IsaKind::Avx512 => self.any_avx512(o.x, o.y, o.z, d.x, d.y, d.z, ray.t_min, ray.t_max),
            }
        }
    }

    #[inline(always)]
    unsafe fn closest_in<I: Isa>(&self, ray: &Ray, best: &mut Best) {
        // Prepared here, after inlining in registers: what is written in small pieces and read in large ones stalls.
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            if let Some(ray) = Prepared::new::<I>(ray) {
                traverse::closest::<I>(&self.arena, self.root, &ray, best, &self.shapes);
            }
        }
    }

    #[inline(always)]
    unsafe fn any_in<I: Isa>(&self, ray: &Ray, t_last: f32) -> bool {
        // SAFETY: the caller vouches for the instruction set.
        unsafe {
            match Prepared::new::<I>(ray) {
                Some(ray) => traverse::any::<I>(&self.arena, self.root, &ray, t_last, &self.shapes),
                None => false,
            }
        }
    }

    // The ray comes in registers: read from memory in vectors, just after it was written by the number, it would stall.
    #[cfg(target_arch = "x86_64")]
    #[allow(clippy::too_many_arguments)]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt")]
    fn closest_avx2(&self, ox: f32, oy: f32, oz: f32, dx: f32, dy: f32, dz: f32, t_min: f32, t_max: f32, best: &mut Best) {
        let ray = Ray { o: Vec3::new(ox, oy, oz), d: Vec3::new(dx, dy, dz), t_min, t_max };
        // SAFETY: this function is only called where the machine has the instruction set.
        unsafe { self.closest_in::<Avx2>(&ray, best) }
    }

    #[cfg(target_arch = "x86_64")]
    #[allow(clippy::too_many_arguments)]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt,avx512f,avx512vl")]
    fn closest_avx512(&self, ox: f32, oy: f32, oz: f32, dx: f32, dy: f32, dz: f32, t_min: f32, t_max: f32, best: &mut Best) {
        let ray = Ray { o: Vec3::new(ox, oy, oz), d: Vec3::new(dx, dy, dz), t_min, t_max };
        // SAFETY: as above.
        unsafe { self.closest_in::<Avx512>(&ray, best) }
    }

    #[cfg(target_arch = "x86_64")]
    #[allow(clippy::too_many_arguments)]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt")]
    fn any_avx2(&self, ox: f32, oy: f32, oz: f32, dx: f32, dy: f32, dz: f32, t_min: f32, t_max: f32) -> bool {
        let ray = Ray { o: Vec3::new(ox, oy, oz), d: Vec3::new(dx, dy, dz), t_min, t_max };
        // SAFETY: as above.
        unsafe { self.any_in::<Avx2>(&ray, t_max.next_down()) }
    }

    #[cfg(target_arch = "x86_64")]
    #[allow(clippy::too_many_arguments)]
    #[target_feature(enable = "avx2,fma,bmi1,popcnt,avx512f,avx512vl")]
    fn any_avx512(&self, ox: f32, oy: f32, oz: f32, dx: f32, dy: f32, dz: f32, t_min: f32, t_max: f32) -> bool {
        let ray = Ray { o: Vec3::new(ox, oy, oz), d: Vec3::new(dx, dy, dz), t_min, t_max };
        // SAFETY: as above.
        unsafe { self.any_in::<Avx512>(&ray, t_max.next_down()) }
    }

    /// Checks the hierarchy: references point into the arena, depth stays below the stack's, and every triangle and
    /// bounded shape that was not left out is in a leaf whose boxes, up to the root, hold the part of it that they
    /// stand for. Returns a sentence on the first fault. Linear in size.
    pub fn validate(&self) -> Result<(), String> {
        let mut seen = vec![Aabb::EMPTY; self.triangles as usize + self.shapes.shapes.len()];
        let mut whole = seen.clone();
        let mut stack = vec![(self.root, self.bounds, 0usize)];
        let bytes = self.arena.bytes();
        while let Some((r, bounds, depth)) = stack.pop() {
            let at = (r >> 3) as usize * UNIT;
            let inside = |size: usize| at + size <= bytes;
            match r & 7 {
                TAG_NODE => {
                    if !inside(size_of::<Node>()) || !at.is_multiple_of(align_of::<Node>()) || depth >= MAX_DEPTH {
                        return Err(format!("node at {at}, depth {depth}: beyond the arena, not aligned or too deep"));
                    }
                    // SAFETY: inside the arena and aligned, plain numbers.
                    let node = unsafe { &*self.arena.base().add(at).cast::<Node>() };
                    for slot in 0..WIDTH {
                        let p = |i: usize| Vec3::new(node.planes[i][slot], node.planes[i + 2][slot], node.planes[i + 4][slot]);
                        let b = Aabb { min: p(0), max: p(1) };
                        let wild = b.min.x == f32::MIN;
                        if node.children[slot] == 0 {
                            continue;
                        }
                        if !wild && (b.is_empty() || b.union(bounds) != bounds) {
                            return Err(format!("node at {at}: box {slot} is empty or outside its parent's"));
                        }
                        stack.push((node.children[slot], if wild { bounds } else { b }, depth + 1));
                    }
                }
                TAG_ITEMS => {
                    if !inside(UNIT) {
                        return Err(format!("list at {at} beyond the arena"));
                    }
                    let words: Vec<u32> = self.arena.units()[r as usize >> 3..].iter().flat_map(|u| u.0).take(64).collect();
                    for &i in &words[1..=words[0] as usize] {
                        let id = (self.triangles + i) as usize;
                        seen[id] = seen[id].union(bounds);
                        whole[id] = self.shapes.shapes[i as usize].1;
                    }
                }
                blocks => {
                    if !inside(blocks as usize * size_of::<Block>()) {
                        return Err(format!("blocks at {at} beyond the arena"));
                    }
                    for i in 0..blocks as usize {
                        // SAFETY: inside the arena, aligned by its unit, plain numbers.
                        let block = unsafe { &*self.arena.base().add(at).cast::<Block>().add(i) };
                        for lane in (0..LANES).filter(|&l| block.prims[l] != u32::MAX) {
                            let id = block.prims[lane] as usize;
                            seen[id] = seen[id].union(bounds);
                            whole[id] = lane_box(block, lane);
                        }
                    }
                }
            }
        }
        let found = whole.iter().filter(|b| !b.is_empty()).count();
        if found + self.skipped + self.unbounded.len() != whole.len() {
            return Err(format!("{found} of {} primitives in leaves, {} left out", whole.len(), self.skipped));
        }
        match seen.iter().zip(&whole).position(|(s, w)| !w.is_empty() && s.union(*w) != *s) {
            Some(id) => Err(format!("the leaves of primitive {id} do not cover it")),
            None => Ok(()),
        }
    }
}

/// A shape's box with room for the rounding of its bounds and of its hits.
fn widened(b: Aabb) -> Aabb {
    let pad = |x: f32| x.abs() * 1e-6;
    let lower = |v: Vec3| Vec3::new(v.x - pad(v.x), v.y - pad(v.y), v.z - pad(v.z));
    let upper = |v: Vec3| Vec3::new(v.x + pad(v.x), v.y + pad(v.y), v.z + pad(v.z));
    if b.min.abs().max_element() > LIMIT || b.max.abs().max_element() > LIMIT { b } else { Aabb { min: lower(b.min), max: upper(b.max) } }
}
