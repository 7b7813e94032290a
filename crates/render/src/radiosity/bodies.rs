//! Bodies: closed surfaces whose insides no light reaches.
//!
//! glTF and other formats make surfaces that reflect on both sides. The inside of a closed, opaque body is dark all the same, and nobody
//! sees it; but elements of other surfaces that reach into it would share their light with it, and it would share its darkness with them.
//! So its inner sides are left out, as they are where the file makes them black. A part of a surface is closed where each of its edges
//! is passed as often in the one direction as in the other: then the number of times that a line leaves it after a point, over the times
//! that it enters, tells whether the point is inside.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::face::{Candidate, Decided, Face, Faces};
use super::form_factor::area_of;
use super::material::may_pass;
use crate::light::Light;
use crate::math::{Aabb, Frame, Vec2};
use crate::scene::Scene;
use crate::scene::geometry::NONE;
use crate::scene::surface::offset;
use crate::shape::Shape;

/// Places on a triangle that shines.
const PLACES: [[f32; 3]; 4] = [[0.34, 0.33, 0.33], [0.7, 0.18, 0.12], [0.12, 0.7, 0.18], [0.18, 0.12, 0.7]];
/// A body is lit from inside by what lies in it with more than this share of its area. What touches it or is let into it a little, as
/// a lamp into a ceiling, does not count.
const INSIDE: f64 = 0.5;
/// Triangles that are looked at for all lights together; scenes with more, of very many bodies within each other, are taken as they are.
const MOST_LOOKS: usize = 1 << 33;
/// Corners in the same one of so many cells of an object's extent are one.
const CELLS: f32 = 1e6;

/// For each candidate, whether its back bounds the dark inside of a body.
pub(super) fn dark_insides(scene: &Scene, faces: &Faces, candidates: &[Candidate], decided: &[Decided]) -> Vec<bool> {
    let mut dark = vec![false; candidates.len()];
    if !decided.iter().any(|d| matches!(d, Decided::Sides { sides: [_, Some(_)], .. })) {
        return dark;
    }
    // An object is the part of a surface that has one material; what is not closed alone may be so together.
    let mut parts = shapes(scene, candidates, decided);
    let all: Vec<usize> = (0..candidates.len()).filter(|&i| candidates[i].shape == NONE).collect();
    let key = |c: &Candidate| u64::from(c.instance) << 32 | u64::from(object_of(scene, c));
    parts.extend(connected(candidates, decided, &all, key));
    let open: Vec<usize> =
        parts.iter().filter(|p| !p.is_closed).flat_map(|p| &p.members).copied().filter(|i| candidates[*i].shape == NONE).collect();
    let joined = connected(candidates, decided, &open, |c| u64::from(c.instance));
    let is_dark = |p: &&Part| p.is_closed && p.members.iter().all(|&i| is_dark_behind(scene, faces, &candidates[i], &decided[i]));
    let bodies: Vec<&Part> = parts.iter().chain(&joined).filter(is_dark).collect();
    let shadow = Shadow::new(candidates, &bodies);
    if scene.lights.len().saturating_mul(2 * PLACES.len()).saturating_mul(shadow.most_entries()) > MOST_LOOKS {
        return dark;
    }
    let points = scene.lights.par_iter().filter(|light| light.is_delta() && !light.is_infinite());
    let at = |light: &Light| light.emit(&scene.sphere(), Vec2::splat(0.5), Vec2::splat(0.5)).map(|e| shadow.bodies_around(e.o));
    let of_points = points.filter_map(at).flatten();
    let lit: Vec<u32> = parts.par_iter().flat_map_iter(|part| around(scene, &shadow, candidates, decided, part)).chain(of_points).collect();
    let mut is_lit = vec![false; bodies.len()];
    lit.into_iter().for_each(|body| is_lit[body as usize] = true);
    for (body, is_lit) in bodies.iter().zip(is_lit) {
        body.members.iter().for_each(|&i| dark[i] = !is_lit);
    }
    dark
}

fn object_of(scene: &Scene, c: &Candidate) -> u32 {
    scene.geometries[scene.placements[c.instance as usize].geometry as usize].object_of_primitive[c.primitive as usize]
}

/// Whether no light passes a triangle, and its back sends none out.
fn is_dark_behind(scene: &Scene, faces: &Faces, c: &Candidate, decided: &Decided) -> bool {
    let g = &scene.geometries[scene.placements[c.instance as usize].geometry as usize];
    let object = &g.objects[object_of(scene, c) as usize];
    if may_pass(scene, &scene.materials[object.material as usize]) {
        return false;
    }
    match decided {
        Decided::Sides { sides: [_, Some(back)], .. } if object.emission.is_some() => {
            faces.optics(scene, back, Vec3::splat(1.0 / 3.0)).emission.is_black()
        }
        _ => true,
    }
}

/// Triangles that hang together.
struct Part {
    /// Indices of candidates.
    members: Vec<usize>,
    /// Whether they have no rim, and their fronts are outside.
    is_closed: bool,
}

/// Each analytic shape.
fn shapes(scene: &Scene, candidates: &[Candidate], decided: &[Decided]) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    let mut last = NONE;
    for (i, c) in candidates.iter().enumerate().filter(|(_, c)| c.shape != NONE) {
        // The triangles of a shape follow each other.
        if c.shape != last {
            let g = &scene.geometries[scene.placements[c.instance as usize].geometry as usize];
            let is_closed = matches!(g.shapes.get((c.primitive as usize).wrapping_sub(g.triangles.len())), Some(Shape::Sphere(_)));
            parts.push(Part { members: Vec::new(), is_closed });
            last = c.shape;
        }
        if let Some(part) = parts.last_mut() {
            part.members.push(i);
        }
    }
    parts.iter_mut().for_each(|part| part.is_closed = part.is_closed && has_fronts_outside(decided, &part.members));
    parts
}

/// The parts that some triangles form; corners are one where both their place, but for rounding, and the triangles' keys are the same.
fn connected(candidates: &[Candidate], decided: &[Decided], some: &[usize], key: impl Fn(&Candidate) -> u64 + Sync) -> Vec<Part> {
    // Triangles without area join their neighbors.
    let is_there = |i: &usize| !matches!(decided[*i], Decided::NotFinite | Decided::TooFar);
    let some: Vec<usize> = some.iter().copied().filter(is_there).collect();
    // The corners of a closed surface are not always the same to the last bit, as at the poles of a sphere.
    let mut boxes: BTreeMap<u64, Aabb> = BTreeMap::new();
    for &i in &some {
        let bounds = boxes.entry(key(&candidates[i])).or_insert(Aabb::EMPTY);
        *bounds = candidates[i].corners.iter().fold(*bounds, |b, p| b.grow(*p));
    }
    let corner = |i: usize, p: Vec3| {
        let key = key(&candidates[i]);
        let bounds = boxes.get(&key).copied().unwrap_or(Aabb::EMPTY);
        let cells = CELLS / bounds.extent().max_element().max(f32::MIN_POSITIVE);
        (key, ((p - bounds.min) * cells).round().to_array().map(|v| v as u32))
    };
    let mut corners: Vec<_> = some.iter().flat_map(|&i| candidates[i].corners.map(|p| corner(i, p))).collect();
    corners.par_sort_unstable();
    corners.dedup();
    let index = |i: usize, p: Vec3| corners.partition_point(|c| *c < corner(i, p)) as u32;
    let triangles: Vec<[u32; 3]> = some.par_iter().map(|&i| candidates[i].corners.map(|p| index(i, p))).collect();
    let mut joined = Joined((0..corners.len() as u32).collect());
    triangles.iter().for_each(|t| (1..3).for_each(|k| joined.join(t[0], t[k])));
    let edges_of = |t: &[u32; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
    let mut edges: Vec<(u32, u32, i32)> = triangles
        .iter()
        .flat_map(edges_of)
        .filter(|(a, b)| a != b)
        .map(|(a, b)| (a.min(b), a.max(b), if a < b { 1 } else { -1 }))
        .collect();
    edges.par_sort_unstable();
    // What is smaller than a cell has no edges, and is not judged.
    let (mut has_edges, mut has_rim) = (vec![false; corners.len()], vec![false; corners.len()]);
    for edge in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        let root = joined.root(edge[0].0) as usize;
        has_edges[root] = true;
        has_rim[root] |= edge.iter().map(|e| e.2).sum::<i32>() != 0;
    }
    let mut part_of = vec![NONE; corners.len()];
    let mut members: Vec<(usize, Vec<usize>)> = Vec::new();
    for (t, &i) in triangles.iter().zip(&some) {
        let root = joined.root(t[0]) as usize;
        if part_of[root] == NONE {
            part_of[root] = members.len() as u32;
            members.push((root, Vec::new()));
        }
        members[part_of[root] as usize].1.push(i);
    }
    let is_closed = |root: usize, members: &[usize]| has_edges[root] && !has_rim[root] && has_fronts_outside(decided, members);
    let part = |(root, members): (usize, Vec<usize>)| Part { is_closed: is_closed(root, &members), members };
    members.into_iter().map(part).collect()
}

/// Whether the volume that fronts enclose is positive, and all of them are the same side of their triangles. Where it is negative, as in a
/// room that is modelled as a box, the fronts are inside.
fn has_fronts_outside(decided: &[Decided], members: &[usize]) -> bool {
    let fronts = || {
        members.iter().filter_map(|&i| match &decided[i] {
            Decided::Sides { sides: [front, _], .. } => front.as_ref(),
            _ => None,
        })
    };
    let Some(first) = fronts().next() else { return false };
    let origin = first.corners[0].as_dvec3();
    let volume = |f: &Face| {
        let [a, b, c] = f.corners.map(|p| p.as_dvec3() - origin);
        a.dot(b.cross(c))
    };
    fronts().map(volume).sum::<f64>() > 0.0 && fronts().all(|f| f.is_turned == first.is_turned)
}

/// The bodies in which a part that shines lies.
fn around(scene: &Scene, shadow: &Shadow, candidates: &[Candidate], decided: &[Decided], part: &Part) -> Vec<u32> {
    let (mut area, mut inside) = (0.0f64, BTreeMap::<u32, f64>::new());
    for &i in &part.members {
        let Decided::Sides { sides: [Some(front), _], .. } = &decided[i] else { continue };
        let g = &scene.geometries[scene.placements[candidates[i].instance as usize].geometry as usize];
        let Some(emission) = &g.objects[front.object as usize].emission else { continue };
        let of_place = f64::from(area_of(&front.corners)) / PLACES.len() as f64;
        for b in PLACES {
            let p = (0..3).map(|k| front.corners[k] * b[k]).sum();
            for n in [front.normal, -front.normal].into_iter().take(if emission.two_sided { 2 } else { 1 }) {
                area += of_place;
                for body in shadow.bodies_around(offset(p, n)) {
                    *inside.entry(body).or_default() += of_place;
                }
            }
        }
    }
    inside.into_iter().filter(|(_, sum)| *sum > INSIDE * area).map(|(body, _)| body).collect()
}

/// The triangles of bodies, seen along lines of one direction: a line through a point meets those of one cell of a grid.
struct Shadow {
    /// Two axes across the lines and the lines' own.
    axes: [DVec3; 3],
    lo: DVec2,
    cells_per_unit: f64,
    resolution: usize,
    /// Where the entries of each cell start, and of the one behind the last.
    first: Vec<u32>,
    /// Indices into `triangles`.
    entries: Vec<u32>,
    /// Corners across and along the lines, and the body.
    triangles: Vec<([DVec3; 3], u32)>,
}

impl Shadow {
    fn new(candidates: &[Candidate], bodies: &[&Part]) -> Self {
        // Of no building's or axis' direction.
        let frame = Frame::from_normal(Vec3::new(0.328_947, 0.817_283, 0.473_129).normalize());
        let axes = [frame.s, frame.t, frame.n].map(|v| v.as_dvec3());
        let flat = |p: Vec3| DVec3::from_array(axes.map(|axis| axis.dot(p.as_dvec3())));
        let of_body = |(body, part): (usize, &&Part)| {
            part.members.iter().map(|&i| (candidates[i].corners.map(flat), body as u32)).collect::<Vec<_>>()
        };
        let triangles: Vec<_> = bodies.iter().enumerate().flat_map(of_body).collect();
        let (mut lo, mut hi) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for p in triangles.iter().flat_map(|t| t.0) {
            (lo, hi) = (lo.min(p.truncate()), hi.max(p.truncate()));
        }
        let mut out = Self { axes, lo, cells_per_unit: 0.0, resolution: 1, first: Vec::new(), entries: Vec::new(), triangles };
        // As fine as memory in proportion to the triangles allows.
        let finest = (out.triangles.len() as f64).sqrt() as usize;
        for shift in 0..usize::BITS {
            out.resolution = (finest >> shift).max(1);
            out.cells_per_unit = out.resolution as f64 / (hi - lo).max_element().max(f64::MIN_POSITIVE);
            let count: usize = out.triangles.iter().map(|t| out.span(t)).map(|[rows, columns]| rows.count() * columns.count()).sum();
            if out.resolution == 1 || count <= 8 * out.triangles.len() + 4096 {
                break;
            }
        }
        let mut of_cell: Vec<(u32, u32)> = Vec::new();
        for (i, t) in out.triangles.iter().enumerate() {
            of_cell.extend(out.cells(t).map(|cell| (cell as u32, i as u32)));
        }
        of_cell.par_sort_unstable();
        let cells = out.resolution * out.resolution;
        out.first = (0..=cells as u32).map(|cell| of_cell.partition_point(|e| e.0 < cell) as u32).collect();
        out.entries = of_cell.into_iter().map(|e| e.1).collect();
        out
    }

    /// The entries of the fullest cell.
    fn most_entries(&self) -> usize {
        self.first.windows(2).map(|w| (w[1] - w[0]) as usize).max().unwrap_or(0)
    }

    fn cell(&self, v: f64) -> usize {
        // Negative and beyond both ends are those.
        ((v * self.cells_per_unit) as usize).min(self.resolution - 1)
    }

    /// The rows and columns of cells that a triangle's box overlaps.
    fn span(&self, (corners, _): &([DVec3; 3], u32)) -> [RangeInclusive<usize>; 2] {
        let [a, b, c] = corners.map(|p| p.truncate() - self.lo);
        let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
        [self.cell(lo.y)..=self.cell(hi.y), self.cell(lo.x)..=self.cell(hi.x)]
    }

    fn cells(&self, triangle: &([DVec3; 3], u32)) -> impl Iterator<Item = usize> {
        let [rows, columns] = self.span(triangle);
        let resolution = self.resolution;
        rows.flat_map(move |y| columns.clone().map(move |x| y * resolution + x))
    }

    /// The bodies in which a point is.
    fn bodies_around(&self, p: Vec3) -> Vec<u32> {
        let p = DVec3::from_array(self.axes.map(|axis| axis.dot(p.as_dvec3())));
        let at = p.truncate() - self.lo;
        let cell = self.cell(at.y) * self.resolution + self.cell(at.x);
        let entries = &self.entries[self.first[cell] as usize..self.first[cell + 1] as usize];
        let crossed = entries.iter().map(|&entry| &self.triangles[entry as usize]).map(|(corners, body)| (*body, crossing(corners, p)));
        let mut crossed: Vec<(u32, i32)> = crossed.filter(|c| c.1 != 0).collect();
        crossed.sort_unstable();
        let of_body = crossed.chunk_by(|a, b| a.0 == b.0);
        of_body.filter(|c| c.iter().map(|c| c.1).sum::<i32>() != 0).map(|c| c[0].0).collect()
    }
}

/// How the line from `p` towards +z crosses a triangle: 1 to its front side, −1 to its back, 0 not at all. A line through an edge crosses
/// one of its two triangles.
fn crossing(corners: &[DVec3; 3], p: DVec3) -> i32 {
    let [a, b, c] = *corners;
    let is_left = |a: DVec3, b: DVec3| {
        // The same number for both triangles of an edge; zero is left of those that go up.
        let (lo, hi, sign) = if (a.x, a.y) < (b.x, b.y) { (a, b, 1.0) } else { (b, a, -1.0) };
        let e = (hi - lo).truncate().perp_dot((p - lo).truncate());
        if e == 0.0 { sign > 0.0 } else { e * sign > 0.0 }
    };
    let sides = [is_left(a, b), is_left(b, c), is_left(c, a)];
    if sides[0] != sides[1] || sides[1] != sides[2] {
        return 0;
    }
    let n = (b - a).cross(c - a);
    if n.z == 0.0 {
        return 0;
    }
    let z = a.z - (n.x * (p.x - a.x) + n.y * (p.y - a.y)) / n.z;
    if z <= p.z {
        0
    } else if sides[0] {
        1
    } else {
        -1
    }
}

/// Which corners hang together: each points to another of its part, or to itself.
struct Joined(Vec<u32>);

impl Joined {
    fn root(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            let next = self.0[self.0[i as usize] as usize];
            self.0[i as usize] = next;
            i = next;
        }
        i
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
