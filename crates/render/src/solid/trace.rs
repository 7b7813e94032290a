//! Questions to the tree: crossings, nearest hit, inside.
//!
//! Combinations are evaluated at points of the surface: a crossing with a part counts where it is inside (merge: outside) of all other
//! parts. That needs no intervals, so that surfaces without inside can take part as well.

use glam::DVec3;

use super::tree::{Group, Kind, Leaf, NodeId, Tree};
use super::{Crossing, Line, Primitive, RayKind};

/// A crossing with a leaf.
#[derive(Clone, Copy, Debug)]
pub(super) struct RawHit {
    pub leaf: u32,
    pub crossing: Crossing,
}

/// Memory that queries use again and again.
#[derive(Default)]
pub(super) struct Scratch {
    crossings: Vec<Crossing>,
    pub hits: Vec<RawHit>,
}

/// What stays the same during a query.
#[derive(Clone, Copy)]
pub(super) struct Query {
    pub line: Line,
    /// 1 / direction.
    pub inverse: DVec3,
    pub t_min: f64,
    /// Bit of the kind of ray in [`Leaf::hidden`]; 0 sees everything.
    pub kind: u8,
}

impl Query {
    pub(super) fn new(line: &Line, t_min: f64, kind: RayKind) -> Self {
        let kind = match kind {
            RayKind::Camera => 1,
            RayKind::Reflection => 2,
            RayKind::Shadow => 4,
            RayKind::Radiosity => 8,
            RayKind::Photon => 0,
        };
        Self { line: *line, inverse: line.d.recip(), t_min, kind }
    }
}

impl Leaf {
    /// The line in the shape's own space.
    #[inline]
    pub(super) fn local(&self, line: &Line) -> Line {
        match &self.solid_from_world {
            None => *line,
            Some(m) => Line { o: m.transform_point3(line.o), d: m.matrix3 * line.d },
        }
    }

    /// A point in the shape's own space.
    #[inline]
    pub(super) fn local_point(&self, p: DVec3) -> DVec3 {
        self.solid_from_world.as_ref().map_or(p, |m| m.transform_point3(p))
    }

    /// The unit normal in world space of one in the shape's own, turned for inverses.
    pub(super) fn world_normal(&self, n: DVec3) -> DVec3 {
        let n = self.solid_from_world.as_ref().map_or(n, |m| (m.matrix3.transpose() * n).normalize_or_zero());
        if self.flip { -n } else { n }
    }
}

impl Tree {
    /// Whether a point is inside of a node.
    pub(super) fn inside(&self, node: NodeId, p: DVec3) -> bool {
        let node = &self.nodes[node as usize];
        let held = node.inside_bounds.contains(p)
            && match &node.kind {
                Kind::Leaf(leaf) => {
                    let leaf = &self.leaves[*leaf as usize];
                    leaf.shape.inside(leaf.local_point(p))
                }
                Kind::Union(group) | Kind::Merge(group) => self.any_inside(group, p, None),
                Kind::Intersection(group) => self.all_inside(group, p, None),
            };
        // Clips cut what is there, whichever side of it counts as inside.
        held != node.inverse && node.clips.iter().all(|&c| self.inside(c, p))
    }

    /// Whether a point is inside of any part but one.
    pub(super) fn any_inside(&self, group: &Group, p: DVec3, except: Option<u32>) -> bool {
        let test = |i: u32| Some(i) != except && self.inside(group.children[i as usize], p);
        if group.unbounded_inside.iter().any(|&i| test(i)) {
            return true;
        }
        let mut found = false;
        if let Some(bvh) = &group.by_point {
            bvh.visit_point(p, |i| {
                found = test(i);
                !found
            });
        }
        found
    }

    /// Whether a point is inside of all parts but one.
    pub(super) fn all_inside(&self, group: &Group, p: DVec3, except: Option<u32>) -> bool {
        let Some(bvh) = &group.by_point else {
            return group.children.iter().enumerate().all(|(i, &c)| Some(i as u32) == except || self.inside(c, p));
        };
        // Of many parts most are subtracted ones, which only matter where their boxes hold the point.
        let test = |i: u32| Some(i) == except || self.inside(group.children[i as usize], p);
        for (i, &c) in group.children.iter().enumerate() {
            let node = &self.nodes[c as usize];
            let only_near_box = node.inverse && node.clips.is_empty();
            if !(only_near_box || test(i as u32)) {
                return false;
            }
        }
        if !group.unbounded_inside.iter().all(|&i| test(i)) {
            return false;
        }
        let mut all = true;
        bvh.visit_point(p, |i| {
            all = test(i);
            all
        });
        all
    }

    /// Whether a point of a part's surface belongs to the surface of the combination.
    #[inline]
    fn counts(&self, kind: &Kind, child: u32, p: DVec3) -> bool {
        match kind {
            Kind::Leaf(_) | Kind::Union(_) => true,
            Kind::Intersection(group) => self.all_inside(group, p, Some(child)),
            Kind::Merge(group) => !self.any_inside(group, p, Some(child)),
        }
    }

    /// Whether a line may meet a node at all, by its bounding shapes.
    fn within_bounding(&self, bounding: &[NodeId], query: &Query, scratch: &mut Scratch) -> bool {
        bounding.iter().all(|&b| {
            if self.inside(b, query.line.at(query.t_min)) {
                return true;
            }
            let start = scratch.hits.len();
            let all = Query { kind: 0, ..*query };
            self.collect(b, &all, f64::INFINITY, scratch);
            let met = scratch.hits.len() > start;
            scratch.hits.truncate(start);
            met
        })
    }

    /// Pushes all hits of a node with `t_min` < t < `t_max`.
    pub(super) fn collect(&self, node: NodeId, query: &Query, t_max: f64, scratch: &mut Scratch) {
        let node = &self.nodes[node as usize];
        if node.bounds.clip(&query.line, query.inverse, query.t_min, t_max).is_none() {
            return;
        }
        if !node.bounding.is_empty() && !self.within_bounding(&node.bounding, query, scratch) {
            return;
        }
        let start = scratch.hits.len();
        match &node.kind {
            Kind::Leaf(index) => {
                let leaf = &self.leaves[*index as usize];
                if leaf.hidden & query.kind != 0 {
                    return;
                }
                scratch.crossings.clear();
                leaf.shape.crossings(&leaf.local(&query.line), query.t_min, t_max, &mut scratch.crossings);
                scratch.hits.extend(scratch.crossings.iter().map(|&crossing| RawHit { leaf: *index, crossing }));
            }
            kind @ (Kind::Union(group) | Kind::Intersection(group) | Kind::Merge(group)) => {
                let child = |i: u32, scratch: &mut Scratch| {
                    let first = scratch.hits.len();
                    self.collect(group.children[i as usize], query, t_max, scratch);
                    self.retain(first, scratch, |hit| self.counts(kind, i, query.line.at(hit.crossing.t)));
                };
                group.unbounded.iter().for_each(|&i| child(i, scratch));
                if let Some(bvh) = &group.by_line {
                    bvh.visit(&query.line, query.t_min, t_max, |i, _| {
                        child(i, scratch);
                        true
                    });
                }
            }
        }
        if !node.clips.is_empty() {
            self.retain(start, scratch, |hit| {
                let p = query.line.at(hit.crossing.t);
                node.clips.iter().all(|&c| self.inside(c, p))
            });
        }
    }

    /// Whether a node blocks all light of a line between `t_min` and `t_max`. If not, its hits are pushed: none is with an opaque leaf.
    pub(super) fn blocks(&self, id: NodeId, query: &Query, t_max: f64, scratch: &mut Scratch) -> bool {
        let node = &self.nodes[id as usize];
        if node.clips.is_empty() && node.bounding.is_empty() {
            match &node.kind {
                Kind::Leaf(index) => {
                    let leaf = &self.leaves[*index as usize];
                    if leaf.opaque {
                        // Any crossing will do.
                        return leaf.hidden & query.kind == 0
                            && (!leaf.box_first || node.bounds.clip(&query.line, query.inverse, query.t_min, t_max).is_some())
                            && leaf.shape.nearest(&leaf.local(&query.line), query.t_min, t_max, &mut scratch.crossings).is_some();
                    }
                }
                Kind::Union(group) => {
                    if node.bounds.clip(&query.line, query.inverse, query.t_min, t_max).is_none() {
                        return false;
                    }
                    if group.unbounded.iter().any(|&i| self.blocks(group.children[i as usize], query, t_max, scratch)) {
                        return true;
                    }
                    let mut blocked = false;
                    if let Some(bvh) = &group.by_line {
                        bvh.visit(&query.line, query.t_min, t_max, |i, _| {
                            blocked = self.blocks(group.children[i as usize], query, t_max, scratch);
                            !blocked
                        });
                    }
                    return blocked;
                }
                Kind::Intersection(_) | Kind::Merge(_) => {}
            }
        }
        let start = scratch.hits.len();
        self.collect(id, query, t_max, scratch);
        scratch.hits[start..].iter().any(|hit| self.leaves[hit.leaf as usize].opaque)
    }

    fn retain(&self, first: usize, scratch: &mut Scratch, keep: impl Fn(&RawHit) -> bool) {
        let mut kept = first;
        for i in first..scratch.hits.len() {
            let hit = scratch.hits[i];
            if keep(&hit) {
                scratch.hits[kept] = hit;
                kept += 1;
            }
        }
        scratch.hits.truncate(kept);
    }

    /// Lowers `best` to the nearest hit of a node with `t_min` < t < `t_max`, and `t_max` with it.
    pub(super) fn nearest(&self, id: NodeId, query: &Query, t_max: &mut f64, best: &mut Option<RawHit>, scratch: &mut Scratch) {
        let node = &self.nodes[id as usize];
        if let Kind::Leaf(index) = &node.kind
            && node.clips.is_empty()
            && node.bounding.is_empty()
        {
            let leaf = &self.leaves[*index as usize];
            if leaf.hidden & query.kind != 0 {
                return;
            }
            if leaf.box_first && node.bounds.clip(&query.line, query.inverse, query.t_min, *t_max).is_none() {
                return;
            }
            if let Some(crossing) = leaf.shape.nearest(&leaf.local(&query.line), query.t_min, *t_max, &mut scratch.crossings)
                && crossing.t < *t_max
            {
                *t_max = crossing.t;
                *best = Some(RawHit { leaf: *index, crossing });
            }
            return;
        }
        if node.bounds.clip(&query.line, query.inverse, query.t_min, *t_max).is_none() {
            return;
        }
        if !node.bounding.is_empty() && !self.within_bounding(&node.bounding, query, scratch) {
            return;
        }
        let clipped = |p: DVec3| node.clips.iter().all(|&c| self.inside(c, p));
        match &node.kind {
            Kind::Union(group) if node.clips.is_empty() => {
                for &i in &group.unbounded {
                    self.nearest(group.children[i as usize], query, t_max, best, scratch);
                }
                if let Some(bvh) = &group.by_line {
                    bvh.visit(&query.line, query.t_min, *t_max, |i, limit| {
                        self.nearest(group.children[i as usize], query, t_max, best, scratch);
                        *limit = *t_max;
                        true
                    });
                }
            }
            Kind::Leaf(_) => {
                let start = scratch.hits.len();
                self.collect(id, query, *t_max, scratch);
                self.take_nearest(start, scratch, query, t_max, best, |_| true);
            }
            kind @ (Kind::Union(group) | Kind::Intersection(group) | Kind::Merge(group)) => {
                let mut child = |i: u32, t_max: &mut f64, scratch: &mut Scratch| {
                    let start = scratch.hits.len();
                    self.collect(group.children[i as usize], query, *t_max, scratch);
                    self.take_nearest(start, scratch, query, t_max, best, |p| self.counts(kind, i, p) && clipped(p));
                };
                for &i in &group.unbounded {
                    child(i, t_max, scratch);
                }
                if let Some(bvh) = &group.by_line {
                    bvh.visit(&query.line, query.t_min, *t_max, |i, limit| {
                        child(i, t_max, scratch);
                        *limit = *t_max;
                        true
                    });
                }
            }
        }
    }

    /// Takes the hits from `start` on off the scratch and lowers `best` to the nearest that counts; near ones are asked first, so that
    /// most are never asked.
    fn take_nearest(
        &self,
        start: usize,
        scratch: &mut Scratch,
        query: &Query,
        t_max: &mut f64,
        best: &mut Option<RawHit>,
        counts: impl Fn(DVec3) -> bool,
    ) {
        while scratch.hits.len() > start {
            let mut at = start;
            for i in start + 1..scratch.hits.len() {
                if scratch.hits[i].crossing.t < scratch.hits[at].crossing.t {
                    at = i;
                }
            }
            let hit = scratch.hits.swap_remove(at);
            if !(hit.crossing.t < *t_max) {
                break;
            }
            if counts(query.line.at(hit.crossing.t)) {
                *t_max = hit.crossing.t;
                *best = Some(hit);
                break;
            }
        }
        scratch.hits.truncate(start);
    }
}
