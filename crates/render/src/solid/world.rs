//! All objects of a scene in a hierarchy of boxes.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use etendue_procedural::{Images, Texture};
use etendue_scene::desc::classic::Object;
use glam::{DVec2, DVec3};

use super::bvh::Bvh;
use super::trace::{Query, RawHit, Scratch};
use super::tree::{Builder, Kind, NodeId, Tree};
use super::{Bounds, Crossing, Line, NO_UV, Outlook, Primitive, RayKind, SolidHit};

/// So many roots of finite size are tested one by one: a hierarchy over them costs more than it saves.
const FEW: usize = 4;
/// Worlds of more roots have no [`Outlook`]s.
const MOST_IN_OUTLOOKS: usize = 1 << 12;
/// Nor have those of fewer roots of finite size: to ask costs as much as a simple shape.
const LEAST_IN_OUTLOOKS: usize = 3;

/// What photons are shot at.
#[derive(Clone, Debug)]
pub struct PhotonTarget {
    /// Holds its surface.
    pub bounds: Bounds,
    /// Multiple of the scene's spacing.
    pub spacing: f64,
    /// Numbers of its leaves.
    pub leaves: Vec<u32>,
}

/// All objects of a scene.
pub struct World {
    pub(super) tree: Tree,
    /// Over the roots of finite size, by index into the tree's roots.
    bvh: Bvh,
    /// Roots that every line is tested against: those without finite box.
    each: Vec<u32>,
    /// Roots of finite size, where they are few: the hierarchy is not asked then.
    few: Vec<u32>,
    /// Roots whose inside has no finite box, or one larger than their surface's.
    unbounded_inside: Vec<u32>,
}

thread_local! {
    // Boxed, so that taking it out and putting it back moves a pointer.
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

/// Runs with memory that the thread keeps; queries from within queries, which are rare, get their own.
#[inline]
fn with_scratch<T>(run: impl FnOnce(&mut Scratch) -> T) -> T {
    SCRATCH.with(|kept| {
        let mut scratch = kept.take().unwrap_or_default();
        let result = run(&mut scratch);
        scratch.hits.clear();
        kept.set(Some(scratch));
        result
    })
}

impl World {
    /// Prepares objects for tracing; height fields of pictures are left out.
    pub fn new(objects: &[Arc<Object>]) -> Self {
        Self::with_images(objects, None)
    }

    /// Prepares objects for tracing, with the pictures of height fields.
    pub fn with_images(objects: &[Arc<Object>], images: Option<&dyn Images>) -> Self {
        let mut builder = Builder::new(images);
        for object in objects {
            builder.add(object);
        }
        let tree = builder.finish();
        let node = |i: u32| &tree.nodes[tree.roots[i as usize] as usize];
        let roots = 0..tree.roots.len() as u32;
        let each = roots.clone().filter(|&i| !node(i).bounds.is_finite() && !node(i).bounds.is_empty()).collect();
        let mut few: Vec<u32> = roots.clone().filter(|&i| node(i).bounds.is_finite() && !node(i).bounds.is_empty()).collect();
        if few.len() > FEW {
            few = Vec::new();
        }
        let within = |i: Bounds, o: Bounds| i.is_empty() || (o.contains(i.min) && o.contains(i.max));
        let unbounded_inside =
            roots.filter(|&i| node(i).inverse || !node(i).bounds.is_finite() || !within(node(i).inside_bounds, node(i).bounds)).collect();
        let bvh = Bvh::new(tree.roots.iter().map(|&r| tree.nodes[r as usize].bounds));
        Self { tree, bvh, each, few, unbounded_inside }
    }

    /// The box of all surfaces; infinite where one is.
    pub fn bounds(&self) -> Bounds {
        self.tree.roots.iter().fold(Bounds::EMPTY, |b, &r| b.union(self.tree.nodes[r as usize].bounds))
    }

    /// The box of all surfaces that have a finite one; empty where none has.
    pub fn finite_bounds(&self) -> Bounds {
        let bounds = self.tree.roots.iter().map(|&r| self.tree.nodes[r as usize].bounds);
        bounds.filter(Bounds::is_finite).fold(Bounds::EMPTY, Bounds::union)
    }

    /// Whether some surfaces have no finite box.
    pub fn is_endless(&self) -> bool {
        self.tree.roots.iter().any(|&r| !self.tree.nodes[r as usize].bounds.is_finite())
    }

    /// The objects of the leaves, by [`SolidHit::leaf`].
    pub fn leaf_objects(&self) -> impl Iterator<Item = &Object> {
        self.tree.leaves.iter().map(|l| &*l.object)
    }

    /// Whether parts of a leaf have textures of their own, as triangles of a mesh may.
    pub fn has_own_textures(&self, leaf: u32) -> bool {
        self.tree.leaves.get(leaf as usize).is_some_and(|l| !l.own_textures.is_empty() || l.cutaway.is_some())
    }

    /// Whether the textures of a leaf may show light from behind.
    pub(crate) fn shows_light_behind(&self, leaf: u32) -> bool {
        self.tree.leaves.get(leaf as usize).is_some_and(|l| l.shows_light_behind)
    }

    /// A hit once more: that of a leaf, with the point as the line's origin.
    pub(crate) fn revisit(&self, leaf: u32, line: &Line, crossing: Crossing) -> SolidHit<'_> {
        let hit = RawHit { leaf, crossing: Crossing { t: 0.0, ..crossing } };
        SolidHit { t: crossing.t, crossing, ..self.hit(line, &hit) }
    }

    /// Top-level objects that photons are shot at.
    pub fn photon_targets(&self) -> Vec<PhotonTarget> {
        let mut targets = Vec::new();
        for &root in &self.tree.roots {
            let mut leaves = Vec::new();
            self.leaves_below(root, &mut leaves);
            let spacing = leaves.iter().filter_map(|&l| self.tree.leaves[l as usize].object.photons.target).reduce(f64::min);
            if let Some(spacing) = spacing {
                targets.push(PhotonTarget { bounds: self.tree.nodes[root as usize].bounds, spacing, leaves });
            }
        }
        targets
    }

    fn leaves_below(&self, id: NodeId, out: &mut Vec<u32>) {
        match &self.tree.nodes[id as usize].kind {
            Kind::Leaf(leaf) => out.push(*leaf),
            Kind::Union(group) | Kind::Intersection(group) | Kind::Merge(group) => {
                group.children.iter().for_each(|&c| self.leaves_below(c, out));
            }
        }
    }

    /// Number of primitives.
    pub fn leaves(&self) -> usize {
        self.tree.leaves.len()
    }

    /// What is seen from a place in each direction, for [`World::nearest_from`] and [`World::shadow`]; `None` where that would not help.
    pub fn outlook(&self, origin: DVec3) -> Option<Outlook> {
        let boxes = self.tree.roots.iter().map(|&r| self.tree.nodes[r as usize].bounds);
        if self.tree.roots.len() > MOST_IN_OUTLOOKS || boxes.clone().filter(Bounds::is_finite).count() < LEAST_IN_OUTLOOKS {
            return None;
        }
        Outlook::new(origin, (0..).zip(boxes))
    }

    /// The nearest hit with `t_min` < t < `t_max`; `line.d` is unit.
    pub fn nearest(&self, line: &Line, t_min: f64, t_max: f64, kind: RayKind) -> Option<SolidHit<'_>> {
        self.nearest_from(None, line, t_min, t_max, kind)
    }

    /// The same; `outlook` is that from the line's origin, where there is one.
    pub fn nearest_from(&self, outlook: Option<&Outlook>, line: &Line, t_min: f64, t_max: f64, kind: RayKind) -> Option<SolidHit<'_>> {
        let query = Query::new(line, t_min, kind);
        let mut best = None;
        let mut limit = t_max;
        let listed = outlook.filter(|o| o.origin() == line.o).and_then(|o| o.towards(line.d));
        with_scratch(|scratch| {
            for &i in &self.each {
                self.tree.nearest(self.root(i), &query, &mut limit, &mut best, scratch);
            }
            if let Some(listed) = listed {
                for &(i, near) in listed {
                    if f64::from(near) > limit {
                        break;
                    }
                    self.tree.nearest(self.root(i), &query, &mut limit, &mut best, scratch);
                }
                return;
            }
            for &i in &self.few {
                self.tree.nearest(self.root(i), &query, &mut limit, &mut best, scratch);
            }
            if self.few.is_empty() {
                self.bvh.visit(line, t_min, limit, |i, t| {
                    self.tree.nearest(self.root(i), &query, &mut limit, &mut best, scratch);
                    *t = limit;
                    true
                });
            }
        });
        best.map(|hit| self.hit(line, &hit))
    }

    /// Visits hits with `t_min` < t < `t_max` in no particular order until `visit` returns false: for shadow rays.
    pub fn visit(&self, line: &Line, t_min: f64, t_max: f64, kind: RayKind, visit: &mut dyn FnMut(SolidHit<'_>) -> bool) {
        let query = Query::new(line, t_min, kind);
        with_scratch(|scratch| {
            let mut root = |i: u32| {
                scratch.hits.clear();
                self.tree.collect(self.root(i), &query, t_max, scratch);
                for k in 0..scratch.hits.len() {
                    let hit = scratch.hits[k];
                    if !visit(self.hit(line, &hit)) {
                        return false;
                    }
                }
                true
            };
            for &i in self.each.iter().chain(&self.few) {
                if !root(i) {
                    return;
                }
            }
            if self.few.is_empty() {
                self.bvh.visit(line, t_min, t_max, |i, _| root(i));
            }
        });
    }

    /// Visits what light passes on a line between `t_min` and `t_max`, in no particular order, until `visit` returns false; returns whether
    /// something opaque blocks it altogether, which `visit` need not have seen.
    ///
    /// `last` is what blocked the line before: it is asked first, as it mostly blocks its neighbors too. `outlook` is that from a place
    /// `t_min` behind the line's end, where there is one. Neither changes an answer.
    pub fn shadow(
        &self,
        outlook: Option<&Outlook>,
        line: &Line,
        t_min: f64,
        t_max: f64,
        last: &AtomicU32,
        visit: &mut dyn FnMut(SolidHit<'_>) -> bool,
    ) -> bool {
        let query = Query::new(line, t_min, RayKind::Shadow);
        with_scratch(|scratch| {
            let before = last.load(Relaxed);
            if (before as usize) < self.tree.roots.len() {
                if self.tree.blocks(self.root(before), &query, t_max, scratch) {
                    return true;
                }
                last.store(u32::MAX, Relaxed);
            }
            let mut blocked = false;
            let mut root = |i: u32| {
                scratch.hits.clear();
                if self.tree.blocks(self.root(i), &query, t_max, scratch) {
                    last.store(i, Relaxed);
                    blocked = true;
                    return false;
                }
                for k in 0..scratch.hits.len() {
                    let hit = scratch.hits[k];
                    if !visit(self.hit(line, &hit)) {
                        return false;
                    }
                }
                true
            };
            if !self.each.iter().all(|&i| root(i)) {
                return blocked;
            }
            if let Some(listed) = outlook.and_then(|o| o.towards(-line.d)) {
                // What begins farther from the light than the line's origin is behind it.
                let _ = listed.iter().take_while(|(_, near)| f64::from(*near) <= t_max + t_min).all(|&(i, _)| root(i));
            } else if self.few.is_empty() {
                self.bvh.visit(line, t_min, t_max, |i, _| root(i));
            } else {
                let _ = self.few.iter().all(|&i| root(i));
            }
            blocked
        })
    }

    /// The objects (leaves with interiors and textures filled in, and the number of the top-level object) that a point is inside of, and in
    /// the box of their surfaces: a point below a disc or beside a sphere with its inside out does not count, as in POV-Ray (measured).
    pub fn containing(&self, p: DVec3, visit: &mut dyn FnMut(&Object, u32)) {
        for &i in &self.each {
            self.contained(self.root(i), p, visit);
        }
        self.bvh.visit_point(p, |i| {
            self.contained(self.root(i), p, visit);
            true
        });
    }

    /// Whether a point is inside of any object.
    pub fn inside(&self, p: DVec3) -> bool {
        let mut found = self.unbounded_inside.iter().any(|&i| self.tree.inside(self.root(i), p));
        if !found {
            self.bvh.visit_point(p, |i| {
                found = self.tree.inside(self.root(i), p);
                !found
            });
        }
        found
    }

    /// Visits the textures that count at a hit with their weights (sum 1): those of the triangle or blob component, of the objects cut
    /// (`cutaway_textures`), else the object's. `back`: of the inside. `None`: the object has no texture at all.
    pub fn textures<'a>(&'a self, hit: &SolidHit<'a>, back: bool, visit: &mut dyn FnMut(f64, Option<&'a Texture>)) {
        let Some(leaf) = self.tree.leaves.get(hit.leaf as usize) else { return };
        let own = |leaf: &'a super::tree::Leaf| {
            let back = if back { leaf.object.interior_texture.as_ref() } else { None };
            back.or(leaf.object.texture.as_ref()).map(|t| &**t)
        };
        if back && leaf.object.interior_texture.is_some() {
            visit(1.0, own(leaf));
        } else if let Some(node) = leaf.cutaway {
            let mut cut = Vec::new();
            self.cut(node, hit.p, hit.leaf, &mut cut);
            for &other in &cut {
                visit(1.0 / cut.len() as f64, own(&self.tree.leaves[other as usize]));
            }
            if cut.is_empty() {
                visit(1.0, own(leaf));
            }
        } else if leaf.own_textures.is_empty() {
            visit(1.0, own(leaf));
        } else {
            leaf.shape.part_textures(leaf.local_point(hit.p), &hit.crossing, &mut |weight, index| {
                visit(weight, index.and_then(|i| leaf.own_textures.get(i)).map(|t| &**t).or_else(|| own(leaf)));
            });
        }
    }

    /// The layers that count at a hit where they are those of one texture that is no map; what [`World::textures`] visits otherwise.
    pub(crate) fn only_layers<'a>(&'a self, hit: &SolidHit<'a>, back: bool) -> Option<&'a [etendue_procedural::Layer]> {
        let leaf = self.tree.leaves.get(hit.leaf as usize)?;
        let inner = if back { leaf.object.interior_texture.as_ref() } else { None };
        if inner.is_none() && (leaf.cutaway.is_some() || !leaf.own_textures.is_empty()) {
            return None;
        }
        inner.or(leaf.object.texture.as_ref())?.layers()
    }

    /// Surface coordinates of a hit, which [`SolidHit::uv`] has only where a texture needs them.
    pub fn uv(&self, hit: &SolidHit<'_>) -> DVec2 {
        let Some(leaf) = self.tree.leaves.get(hit.leaf as usize) else { return hit.uv };
        let uv = leaf.shape.uv(leaf.local_point(hit.p), &hit.crossing);
        if uv.is_nan() { DVec2::new(hit.p.x, hit.p.y) } else { uv }
    }

    /// The unit geometric normal on the side of [`SolidHit::n`], from which it differs on smooth meshes.
    pub fn geometric_normal(&self, hit: &SolidHit<'_>) -> DVec3 {
        let Some(leaf) = self.tree.leaves.get(hit.leaf as usize) else { return hit.n };
        leaf.world_normal(leaf.shape.geometric_normal(leaf.local_point(hit.p), &hit.crossing))
    }

    #[inline]
    fn root(&self, i: u32) -> NodeId {
        self.tree.roots[i as usize]
    }

    #[inline]
    pub(super) fn hit(&self, line: &Line, hit: &RawHit) -> SolidHit<'_> {
        let leaf = &self.tree.leaves[hit.leaf as usize];
        let p = line.at(hit.crossing.t);
        let local = leaf.local_point(p);
        let n = leaf.shape.normal(local, &hit.crossing);
        let uv = if leaf.uses_uv { leaf.shape.uv(local, &hit.crossing) } else { NO_UV };
        SolidHit {
            t: hit.crossing.t,
            p,
            n: leaf.world_normal(n),
            uv: if uv.is_nan() { DVec2::new(p.x, p.y) } else { uv },
            object: &leaf.object,
            leaf: hit.leaf,
            whole: leaf.whole,
            crossing: hit.crossing,
        }
    }

    /// Visits the leaves of a node that a point is inside of; one of them where a combination has no leaf that holds the point.
    fn contained(&self, id: NodeId, p: DVec3, visit: &mut dyn FnMut(&Object, u32)) {
        if !self.tree.inside(id, p) {
            return;
        }
        let node = &self.tree.nodes[id as usize];
        match &node.kind {
            Kind::Leaf(leaf) => {
                let leaf = &self.tree.leaves[*leaf as usize];
                visit(&leaf.object, leaf.whole);
            }
            // All parts hold the point; the first says what the object is made of.
            Kind::Intersection(group) => match group.children.first() {
                Some(&first) if !node.inverse => self.contained(first, p, visit),
                Some(&first) => self.first_leaf(first, visit),
                None => {}
            },
            Kind::Union(group) | Kind::Merge(group) => {
                if node.inverse {
                    if let Some(&first) = group.children.first() {
                        self.first_leaf(first, visit);
                    }
                } else if matches!(node.kind, Kind::Union(_)) {
                    let near = |c: &NodeId| self.tree.nodes[*c as usize].bounds.contains(p);
                    group.children.iter().filter(|c| near(c)).for_each(|&c| self.contained(c, p, visit));
                } else if let Some(&c) = group.children.iter().find(|&&c| self.tree.inside(c, p)) {
                    self.contained(c, p, visit);
                }
            }
        }
    }

    fn first_leaf(&self, id: NodeId, visit: &mut dyn FnMut(&Object, u32)) {
        match &self.tree.nodes[id as usize].kind {
            Kind::Leaf(leaf) => {
                let leaf = &self.tree.leaves[*leaf as usize];
                visit(&leaf.object, leaf.whole);
            }
            Kind::Union(group) | Kind::Intersection(group) | Kind::Merge(group) => {
                if let Some(&first) = group.children.first() {
                    self.first_leaf(first, visit);
                }
            }
        }
    }

    /// The leaves with textures that hold a point of a cut face: what was cut there.
    fn cut(&self, id: NodeId, p: DVec3, face: u32, out: &mut Vec<u32>) {
        match &self.tree.nodes[id as usize].kind {
            Kind::Leaf(leaf) => {
                let other = &self.tree.leaves[*leaf as usize];
                if *leaf != face && other.cutaway.is_none() && !other.flip && self.tree.inside(id, p) {
                    out.push(*leaf);
                }
            }
            Kind::Union(group) | Kind::Intersection(group) | Kind::Merge(group) => {
                group.children.iter().for_each(|&c| self.cut(c, p, face, out));
            }
        }
    }
}
