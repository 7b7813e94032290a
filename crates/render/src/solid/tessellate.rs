//! Triangle meshes of a world of solids.
//!
//! Each leaf is turned into triangles by itself: meshes, patches and flat shapes exactly, bodies with a parametrization by it
//! ([`super::facets`]), all others by [`contour`]. What combinations and clips take away is then cut off: triangles near another surface
//! are divided until they are small against it, and their sides are cut where the inside of the combination ends. So all corners lie on the
//! exact surfaces (of contours: within a fraction of a cell), edges of combinations are as straight as the triangles are small, and two parts
//! that meet at an edge have corners of their own there.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::contour::contour;
use super::facets::{Facet, has_area, trim};
use super::trace::RawHit;
use super::tree::{Kind, NodeId, Tree};
use super::{Bounds, Crossing, Line, Primitive, SolidHit, World};

/// Segments of a full circle where the user does not say.
pub const SEGMENTS: u32 = 64;
/// Most triangles of all meshes together.
pub const MOST_TRIANGLES: usize = 1 << 23;
/// Most often that a triangle is halved beside another surface.
const DIVISIONS: u32 = 16;
/// Groups with more parts are taken to be everywhere.
const MANY: usize = 4096;

/// The triangles of a leaf in world space.
#[derive(Debug)]
pub struct Patch {
    /// As in [`SolidHit::leaf`].
    pub leaf: u32,
    /// The top-level object it belongs to, by number.
    pub root: u32,
    /// Not empty.
    pub facets: Vec<Facet>,
    /// The leaf bounds an inside, and nothing is clipped away: its back is never seen unless it lets light through.
    pub closed: bool,
}

/// A combination that a leaf is part of.
struct Step {
    node: NodeId,
    /// Which of its parts.
    child: u32,
    up: Option<Arc<Step>>,
}

/// What is to be done for a leaf.
struct Job {
    leaf: u32,
    root: u32,
    within: Bounds,
    step: Option<Arc<Step>>,
}

/// How finely to divide, and where.
struct Fineness<'a> {
    tree: &'a Tree,
    step: Option<&'a Step>,
    /// Least and usual edge beside other surfaces.
    edges: [f64; 2],
    segments: f64,
}

impl World {
    /// Triangles of all leaves with so many segments to a full circle; unbounded ones reach as far as a box.
    ///
    /// # Errors
    /// A sentence where there would be more than [`MOST_TRIANGLES`].
    pub fn tessellate(&self, segments: u32, within: &Bounds) -> Result<Vec<Patch>, String> {
        let mut jobs = Vec::new();
        for (root, &node) in (0u32..).zip(&self.tree.roots) {
            self.tree.jobs(node, root, *within, None, &mut jobs);
        }
        let segments = segments.clamp(8, 1024) as usize;
        let count = std::sync::atomic::AtomicUsize::new(0);
        let is_full = || count.load(std::sync::atomic::Ordering::Relaxed) > MOST_TRIANGLES;
        let patch = |job: &Job| {
            let facets = if is_full() { Vec::new() } else { self.tree.patch(job, segments) };
            count.fetch_add(facets.len(), std::sync::atomic::Ordering::Relaxed);
            let bounded = self.tree.leaves[job.leaf as usize].shape.inside_bounds() != Bounds::EMPTY;
            let closed = bounded && self.tree.is_closed(job.step.as_deref()) && is_solid(&self.tree.leaves[job.leaf as usize].object.solid);
            (!facets.is_empty()).then_some(Patch { leaf: job.leaf, root: job.root, facets, closed })
        };
        let patches: Vec<Option<Patch>> = jobs.par_iter().map(patch).collect();
        if is_full() {
            return Err(format!("more than {MOST_TRIANGLES} triangles: a coarser tessellation is needed"));
        }
        Ok(patches.into_iter().flatten().collect())
    }

    /// What a line would hit at a corner of a triangle of [`World::tessellate`]: the exact normal and coordinates of the surface there.
    pub fn corner(&self, leaf: u32, facet: &Facet, corner: usize) -> SolidHit<'_> {
        let cross = facet.cross();
        let n = cross.normalize_or(DVec3::Y);
        let p = facet.p[corner];
        let hit = |p: DVec3, crossing: Crossing| {
            let line = Line { o: p, d: -n };
            SolidHit { t: 0.0, ..self.hit(&line, &RawHit { leaf, crossing: Crossing { t: 0.0, ..crossing } }) }
        };
        if let Some(at) = facet.at {
            return hit(p, at[corner]);
        }
        // A little towards the middle, so that corners at edges belong to the right side.
        let middle = (facet.p[0] + facet.p[1] + facet.p[2]) / 3.0;
        let q = p + (middle - p) * 0.02;
        let reach = facet.p.iter().map(|p| (*p - middle).length()).fold(0.0, f64::max);
        let line = Line { o: q + n * reach, d: -n };
        let solid = &self.tree.leaves[leaf as usize];
        let mut found = Vec::new();
        solid.shape.crossings(&solid.local(&line), 0.0, 2.0 * reach, &mut found);
        let off = |c: &Crossing| (c.t - reach).abs();
        found.sort_by(|a, b| off(a).total_cmp(&off(b)));
        for crossing in found {
            let p = line.at(crossing.t);
            let found = hit(p, crossing);
            if found.n.dot(n).abs() > 0.3 {
                return found;
            }
        }
        // The surface turns away within the triangle: it speaks for itself.
        let mut flat = hit(p, Crossing::new(0.0, 0));
        let side = if flat.n.dot(n) < 0.0 { -n } else { n };
        flat.n = side;
        flat
    }
}

/// Whether a shape has no back that is seen.
fn is_solid(solid: &etendue_scene::desc::classic::Solid) -> bool {
    use etendue_scene::desc::classic::Solid;
    match solid {
        Solid::Cone { open, .. } | Solid::Cylinder { open, .. } | Solid::Sor { open, .. } => !open,
        Solid::Prism(p) => !p.open,
        Solid::Isosurface(i) => !i.open,
        Solid::Disc { .. }
        | Solid::Triangle(_)
        | Solid::Polygon(_)
        | Solid::BicubicPatch(_)
        | Solid::Parametric(_)
        | Solid::HeightField(_) => false,
        Solid::Mesh(m) => m.inside_vector.is_some(),
        _ => true,
    }
}

impl Tree {
    fn jobs(&self, id: NodeId, root: u32, within: Bounds, step: Option<Arc<Step>>, out: &mut Vec<Job>) {
        let node = &self.nodes[id as usize];
        let within = within.intersection(node.bounds);
        if within.is_empty() {
            return;
        }
        match &node.kind {
            Kind::Leaf(leaf) => {
                let step = Some(Arc::new(Step { node: id, child: 0, up: step }));
                out.push(Job { leaf: *leaf, root, within, step });
            }
            Kind::Union(group) | Kind::Intersection(group) | Kind::Merge(group) => {
                for (child, &part) in (0u32..).zip(&group.children) {
                    let step = Step { node: id, child, up: step.clone() };
                    self.jobs(part, root, within, Some(Arc::new(step)), out);
                }
            }
        }
    }

    /// Whether a point of a leaf's surface is a point of the whole object's.
    fn keeps(&self, step: Option<&Step>, p: DVec3) -> bool {
        let mut at = step;
        while let Some(Step { node, child, up }) = at {
            let node = &self.nodes[*node as usize];
            let kept = match &node.kind {
                Kind::Intersection(group) => self.all_inside(group, p, Some(*child)),
                Kind::Merge(group) => !self.any_inside(group, p, Some(*child)),
                Kind::Leaf(_) | Kind::Union(_) => true,
            };
            if !kept || !node.clips.iter().all(|&c| self.inside(c, p)) {
                return false;
            }
            at = up.as_deref();
        }
        true
    }

    fn is_closed(&self, step: Option<&Step>) -> bool {
        let mut at = step;
        while let Some(Step { node, up, .. }) = at {
            if !self.nodes[*node as usize].clips.is_empty() {
                return false;
            }
            at = up.as_deref();
        }
        true
    }

    fn patch(&self, job: &Job, segments: usize) -> Vec<Facet> {
        let leaf = &self.leaves[job.leaf as usize];
        let world_from_local = leaf.solid_from_world.as_ref().map_or(DAffine3::IDENTITY, |m| m.inverse());
        let local_box = leaf.solid_from_world.as_ref().map_or(job.within, |m| job.within.transformed(m));
        let mut facets = leaf.shape.facets(segments, &local_box).unwrap_or_else(|| contour(&leaf.shape, &local_box, segments));
        for f in &mut facets {
            f.p = f.p.map(|p| world_from_local.transform_point3(p));
        }
        let extent = facets.iter().fold(Bounds::EMPTY, |b, f| b.union(Bounds::of_points(f.p)));
        let size = (extent.max - extent.min).length();
        let segments = segments as f64;
        let fineness = Fineness { tree: self, step: job.step.as_deref(), edges: [0.25 * size / segments, 3.0 * size / segments], segments };
        let keep = |p: DVec3| self.keeps(job.step.as_deref(), p);
        let mut out = Vec::with_capacity(facets.len());
        let mut pending = Vec::new();
        for facet in facets {
            pending.push((facet, 0));
            while let Some((facet, depth)) = pending.pop() {
                if out.len() > MOST_TRIANGLES {
                    return out;
                }
                let (edge, length) = longest(&facet);
                if depth < DIVISIONS && length > fineness.wanted(&Bounds::of_points(facet.p)) {
                    pending.extend(halves(&facet, edge).map(|half| (half, depth + 1)));
                } else {
                    trim(&facet, &keep, &mut out);
                }
            }
        }
        out.retain(has_area);
        out
    }
}

impl Fineness<'_> {
    /// The longest edge that a triangle in a box may have.
    fn wanted(&self, b: &Bounds) -> f64 {
        let edge = std::cell::Cell::new(f64::INFINITY);
        let near = |id: NodeId| {
            let node = &self.tree.nodes[id as usize];
            let is_flat =
                matches!(&node.kind, Kind::Leaf(l) if matches!(self.tree.leaves[*l as usize].shape, super::compile::Shape::Plane(_)));
            if is_flat || b.intersection(node.bounds).is_empty() {
                return;
            }
            let size = (node.bounds.max - node.bounds.min).length();
            edge.set(edge.get().min(if size.is_finite() {
                (3.0 * size / self.segments).clamp(self.edges[0], self.edges[1])
            } else {
                self.edges[1]
            }));
        };
        let mut at = self.step;
        while let Some(Step { node, child, up }) = at {
            let node = &self.tree.nodes[*node as usize];
            match &node.kind {
                Kind::Intersection(group) | Kind::Merge(group) if group.children.len() <= MANY => {
                    group.children.iter().zip(0u32..).filter(|(_, i)| i != child).for_each(|(&c, _)| near(c));
                }
                Kind::Intersection(_) | Kind::Merge(_) => edge.set(edge.get().min(self.edges[1])),
                Kind::Leaf(_) | Kind::Union(_) => {}
            }
            node.clips.iter().for_each(|&c| near(c));
            at = up.as_deref();
        }
        edge.get()
    }
}

/// The longest side, from corner i to the next, and its length.
pub fn longest(facet: &Facet) -> (usize, f64) {
    let length = |i: usize| (facet.p[(i + 1) % 3] - facet.p[i]).length();
    let i = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
    (i, length(i))
}

/// Two triangles by the middle of a side.
pub fn halves(facet: &Facet, side: usize) -> [Facet; 2] {
    let w = |i: usize| DVec3::AXES[(side + i) % 3];
    let middle = 0.5 * (w(0) + w(1));
    [facet.part([w(0), middle, w(2)]), facet.part([middle, w(1), w(2)])]
}
