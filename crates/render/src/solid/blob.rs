//! `blob`: where a sum of fields around points and lines reaches a threshold.
//!
//! Each field is strength · (1 − (distance/radius)²)² up to its radius (POV-Ray documentation, section 3.4.5.1.1): a quartic along the part of a
//! line within reach. The ends of all parts cut the line into pieces; on each, the sum is one quartic.

use std::cell::Cell;
use std::sync::Arc;

use arrayvec::ArrayVec;
use etendue_procedural::Texture;
use glam::{DAffine3, DMat4, DVec2, DVec3};

use super::{Bounds, Crossing, Line, Primitive, roots};

/// Components of a leaf of the hierarchy.
const LEAF: usize = 4;

/// What a component is around, in its own space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Core {
    /// A point.
    Point(DVec3),
    /// A line between two points, with rounded ends.
    Segment(DVec3, DVec3),
}

/// A component as described.
#[derive(Clone, Debug)]
pub struct Component {
    /// What it is around.
    pub core: Core,
    /// Where the field ends; positive.
    pub radius: f64,
    /// Field at the core, of either sign.
    pub strength: f64,
    /// Places the component.
    pub blob_from_component: DMat4,
    /// Its own texture, in the blob's space.
    pub texture: Option<Arc<Texture>>,
}

/// A component in units of its radius, its core along z from 0.
#[derive(Clone, Copy, Debug)]
struct Field {
    field_from_blob: DAffine3,
    strength: f64,
    /// Length of the core; 0 for a point.
    length: f64,
    /// Number in the file's order.
    number: u32,
    bounds: Bounds,
}

/// The part of a line where a field is one quartic: |o + d t|² is the squared distance over the squared radius.
#[derive(Clone, Copy, Debug)]
struct Part {
    from: f64,
    to: f64,
    o: DVec3,
    d: DVec3,
    strength: f64,
}

#[derive(Default)]
struct Scratch {
    parts: Vec<Part>,
    cuts: Vec<f64>,
    active: Vec<u32>,
}

thread_local! {
    /// Kept between lines, so that no line allocates.
    static SCRATCH: Cell<Scratch> = Cell::default();
}

/// Hierarchy of fields: the left child follows its parent.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// Right child; the first field of a leaf.
    next: u32,
    /// Fields of a leaf; 0 for inner nodes.
    count: u32,
}

/// A blob.
pub struct Blob {
    threshold: f64,
    fields: Vec<Field>,
    nodes: Vec<Node>,
    bounds: Bounds,
    textures: Vec<Arc<Texture>>,
    /// Texture of each component in the file's order.
    texture_of: Vec<Option<usize>>,
}

impl Field {
    fn new(component: &Component, number: u32) -> Option<Self> {
        let radius = component.radius.abs();
        if !(radius > 0.0) || !radius.is_finite() || !component.strength.is_finite() {
            return None;
        }
        let (a, b) = match component.core {
            Core::Point(p) => (p, p),
            Core::Segment(a, b) => (a, b),
        };
        let axis = b - a;
        let length = axis.length() / radius;
        let z = axis.try_normalize().unwrap_or(DVec3::Z);
        let (x, y) = z.any_orthonormal_pair();
        let component_from_field = DAffine3::from_mat3_translation(glam::DMat3::from_cols(x * radius, y * radius, z * radius), a);
        let m = component.blob_from_component;
        if !m.is_finite() || !component_from_field.is_finite() {
            return None;
        }
        let blob_from_field = DAffine3::from_mat4(m) * component_from_field;
        let field_from_blob = blob_from_field.inverse();
        if !field_from_blob.is_finite() || !length.is_finite() {
            return None;
        }
        // A ball under a linear map reaches as far along an axis as the row is long.
        let rows = blob_from_field.matrix3.transpose();
        let reach = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
        let (a, b) = (blob_from_field.translation, blob_from_field.transform_point3(DVec3::new(0.0, 0.0, length)));
        let bounds = Bounds { min: a.min(b) - reach, max: a.max(b) + reach };
        Some(Self { field_from_blob, strength: component.strength, length, number, bounds })
    }

    /// From the core, in radii.
    fn offset(&self, p: DVec3) -> DVec3 {
        let mut q = self.field_from_blob.transform_point3(p);
        q.z -= q.z.clamp(0.0, self.length);
        q
    }

    fn value(&self, p: DVec3) -> f64 {
        let k = 1.0 - self.offset(p).length_squared();
        if k > 0.0 { self.strength * k * k } else { 0.0 }
    }

    /// The parts of a line within reach.
    fn parts(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Part>) {
        let (o, d) = (self.field_from_blob.transform_point3(line.o), self.field_from_blob.transform_vector3(line.d));
        let mut push = |from: f64, to: f64, o: DVec3, d: DVec3| {
            let (from, to) = (from.max(t_min), to.min(t_max));
            if from < to {
                out.push(Part { from, to, o, d, strength: self.strength });
            }
        };
        // Around the nearest point to the origin: far away lines keep their digits.
        let ball = |o: DVec3, d: DVec3| {
            let c = d.length_squared();
            let middle = -o.dot(d) / c;
            let rest = (1.0 - (o + d * middle).length_squared()) / c;
            (rest > 0.0).then(|| (middle - rest.sqrt(), middle + rest.sqrt()))
        };
        if self.length == 0.0 {
            if let Some((from, to)) = ball(o, d) {
                push(from, to, o, d);
            }
            return;
        }
        let end = o - DVec3::new(0.0, 0.0, self.length);
        // Where the line is between the ends.
        let (enter, leave) = if d.z == 0.0 {
            if o.z < 0.0 {
                (f64::INFINITY, f64::INFINITY)
            } else if o.z > self.length {
                (f64::NEG_INFINITY, f64::NEG_INFINITY)
            } else {
                (f64::NEG_INFINITY, f64::INFINITY)
            }
        } else {
            let (a, b) = (-o.z / d.z, (self.length - o.z) / d.z);
            (a.min(b), a.max(b))
        };
        let (first, last) = if d.z < 0.0 { (end, o) } else { (o, end) };
        let level = DVec3::new(1.0, 1.0, 0.0);
        if let Some((from, to)) = ball(first, d) {
            push(from, to.min(enter), first, d);
        }
        let (of, df) = (o * level, d * level);
        if df.length_squared() > 1e-24 * d.length_squared() {
            if let Some((from, to)) = ball(of, df) {
                push(from.max(enter), to.min(leave), of, df);
            }
        } else if of.length_squared() < 1.0 {
            push(enter, leave, of, df);
        }
        if let Some((from, to)) = ball(last, d) {
            push(from.max(leave), to, last, d);
        }
    }
}

impl Blob {
    /// `None` for a threshold that is not positive and finite, and where nothing is left: components without a positive radius, a finite
    /// strength and an invertible place count for nothing.
    pub fn new(threshold: f64, components: &[Component]) -> Option<Self> {
        if !(threshold > 0.0) || !threshold.is_finite() {
            return None;
        }
        let mut fields: Vec<Field> = Vec::with_capacity(components.len());
        let mut textures: Vec<Arc<Texture>> = Vec::new();
        let mut texture_of = Vec::with_capacity(components.len());
        for (i, component) in components.iter().enumerate() {
            fields.extend(Field::new(component, u32::try_from(i).ok()?).filter(|f| f.strength != 0.0));
            texture_of.push(component.texture.as_ref().map(|t| {
                textures.iter().position(|u| Arc::ptr_eq(t, u)).unwrap_or_else(|| {
                    textures.push(t.clone());
                    textures.len() - 1
                })
            }));
        }
        let positive = fields.iter().filter(|f| f.strength > 0.0);
        // Without a positive field there is no surface.
        let bounds = positive.map(|f| f.bounds).reduce(Bounds::union)?;
        let mut nodes = Vec::new();
        let count = fields.len();
        build(&mut fields, 0, count, &mut nodes);
        Some(Self { threshold, fields, nodes, bounds, textures, texture_of })
    }

    /// Visits the fields whose box `holds` accepts.
    fn visit<'a>(&'a self, mut holds: impl FnMut(&Bounds) -> bool, mut with: impl FnMut(&'a Field)) {
        let mut stack = ArrayVec::<u32, 64>::new();
        stack.push(0);
        while let Some(at) = stack.pop() {
            let Some(node) = self.nodes.get(at as usize) else { continue };
            if !holds(&node.bounds) {
                continue;
            }
            if node.count == 0 {
                // Halves: the depth is the logarithm of the number of fields.
                let _ = stack.try_push(node.next);
                let _ = stack.try_push(at + 1);
            } else {
                let first = node.next as usize;
                for field in &self.fields[first..first + node.count as usize] {
                    if holds(&field.bounds) {
                        with(field);
                    }
                }
            }
        }
    }

    fn at<'a>(&'a self, p: DVec3, with: impl FnMut(&'a Field)) {
        self.visit(|b| p.cmpge(b.min).all() && p.cmple(b.max).all(), with);
    }

    /// Visits the components that reach a point (number in the file's order, field).
    pub fn strengths(&self, p: DVec3, visit: &mut dyn FnMut(usize, f64)) {
        self.at(p, |f| {
            let value = f.value(p);
            if value != 0.0 {
                visit(f.number as usize, value);
            }
        });
    }

    fn solve(&self, scratch: &mut Scratch, push: &mut dyn FnMut(f64)) {
        let Scratch { parts, cuts, active } = scratch;
        parts.sort_unstable_by(|a, b| a.from.total_cmp(&b.from));
        cuts.extend(parts.iter().flat_map(|p| [p.from, p.to]));
        cuts.sort_unstable_by(f64::total_cmp);
        cuts.dedup();
        let mut waiting = 0;
        let mut inside = None;
        for pair in cuts.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            while parts.get(waiting).is_some_and(|p| p.from <= from) {
                active.push(waiting as u32);
                waiting += 1;
            }
            active.retain(|i| parts[*i as usize].to > from);
            let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
            let mut c = [-self.threshold, 0.0, 0.0, 0.0, 0.0];
            let mut most = 0.0;
            for i in active.iter() {
                let part = &parts[*i as usize];
                most += part.strength.max(0.0);
                let o = part.o + part.d * middle;
                let (p, q1, q2) = (1.0 - o.length_squared(), 2.0 * o.dot(part.d), part.d.length_squared());
                // (p − q1 s − q2 s²)²
                c[0] += part.strength * p * p;
                c[1] -= part.strength * 2.0 * p * q1;
                c[2] += part.strength * (q1 * q1 - 2.0 * p * q2);
                c[3] += part.strength * 2.0 * q1 * q2;
                c[4] += part.strength * q2 * q2;
            }
            let starts = most > self.threshold && roots::eval(&c, -half) >= 0.0;
            // Neighboring pieces may see the field at a cut a rounding apart.
            if inside.is_some_and(|inside| inside != starts) {
                push(from);
            }
            let mut now = starts;
            if most > self.threshold {
                for s in roots::quartic_in(&c, -half, half) {
                    push(middle + s);
                    now = !now;
                }
            }
            inside = Some(now);
        }
    }
}

/// Splits fields in halves along the longest side of their centers' box.
fn build(fields: &mut [Field], first: usize, count: usize, nodes: &mut Vec<Node>) {
    let own = &mut fields[first..first + count];
    let bounds = own.iter().fold(Bounds::EMPTY, |b, f| b.union(f.bounds));
    let at = nodes.len();
    if count <= LEAF {
        nodes.push(Node { bounds, next: first as u32, count: count as u32 });
        return;
    }
    nodes.push(Node { bounds, next: 0, count: 0 });
    let center = |f: &Field| f.bounds.min + f.bounds.max;
    let (lo, hi) = own.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), f| (lo.min(center(f)), hi.max(center(f))));
    let axis = (hi - lo).max_position();
    let half = count / 2;
    own.select_nth_unstable_by(half, |a, b| center(a)[axis].total_cmp(&center(b)[axis]));
    build(fields, first, half, nodes);
    nodes[at].next = nodes.len() as u32;
    build(fields, first + half, count - half, nodes);
}

impl Primitive for Blob {
    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        if !line.o.is_finite() || !line.d.is_finite() || line.d == DVec3::ZERO {
            return;
        }
        let mut scratch = SCRATCH.take();
        let inverse = line.d.recip();
        let hit = |b: &Bounds| {
            let (mut lo, mut hi) = (t_min, t_max);
            for axis in 0..3 {
                if line.d[axis] == 0.0 {
                    if !(line.o[axis] >= b.min[axis] && line.o[axis] <= b.max[axis]) {
                        return false;
                    }
                    continue;
                }
                let (a, c) = ((b.min[axis] - line.o[axis]) * inverse[axis], (b.max[axis] - line.o[axis]) * inverse[axis]);
                lo = lo.max(a.min(c));
                hi = hi.min(a.max(c));
            }
            lo <= hi
        };
        self.visit(hit, |field| field.parts(line, t_min, t_max, &mut scratch.parts));
        if !scratch.parts.is_empty() {
            self.solve(&mut scratch, &mut |t| {
                if t > t_min && t < t_max {
                    out.push(Crossing { t, part: 0, uv: DVec2::ZERO });
                }
            });
        }
        scratch.parts.clear();
        scratch.cuts.clear();
        scratch.active.clear();
        SCRATCH.set(scratch);
    }

    fn inside(&self, p: DVec3) -> bool {
        let mut sum = 0.0;
        self.at(p, |f| sum += f.value(p));
        sum >= self.threshold
    }

    fn normal(&self, p: DVec3, _: &Crossing) -> DVec3 {
        let mut n = DVec3::ZERO;
        self.at(p, |f| {
            let q = f.offset(p);
            let k = 1.0 - q.length_squared();
            if k > 0.0 {
                n += f.field_from_blob.matrix3.transpose() * q * (f.strength * k);
            }
        });
        n.try_normalize().unwrap_or(DVec3::X)
    }

    fn uv(&self, p: DVec3, _: &Crossing) -> DVec2 {
        p.truncate()
    }

    fn own_textures(&self) -> Vec<Arc<Texture>> {
        self.textures.clone()
    }

    fn part_textures(&self, p: DVec3, _: &Crossing, visit: &mut dyn FnMut(f64, Option<usize>)) {
        // By field; what pushes away has no say in the color.
        let mut sum = 0.0;
        self.strengths(p, &mut |_, value| sum += value.max(0.0));
        if !(sum > 0.0) {
            visit(1.0, None);
            return;
        }
        self.strengths(p, &mut |number, value| {
            if value > 0.0 {
                visit(value / sum, self.texture_of.get(number).copied().flatten());
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::measured::{Tolerance, alternates, compare, hostile_lines, random};
    use super::*;

    fn component(core: Core, radius: f64, strength: f64) -> Component {
        Component { core, radius, strength, blob_from_component: DMat4::IDENTITY, texture: None }
    }

    fn measured() -> Blob {
        let point = |x, y, z| Core::Point(DVec3::new(x, y, z));
        let mut second = component(point(-0.375, 0.65, 0.0), 1.0, 1.0);
        // POV-Ray turns to the left: z by 20 degrees from x to y.
        let angle = 20f64.to_radians();
        second.blob_from_component = DMat4::from_rotation_z(angle) * DMat4::from_scale(DVec3::new(1.0, 1.5, 0.7));
        let cylinder = Core::Segment(DVec3::new(0.0, -1.0, -1.0), DVec3::new(0.5, 1.0, 1.0));
        let all = [
            component(point(0.75, 0.0, 0.0), 1.0, 1.0),
            second,
            component(point(-0.375, -0.65, 0.0), 1.0, 1.0),
            component(cylinder, 0.7, 1.2),
            component(point(0.3, 0.2, 0.1), 0.8, -0.7),
        ];
        Blob::new(0.6, &all).unwrap()
    }

    fn many() -> Blob {
        let mut s = 11;
        let mut point = || DVec3::new(random(&mut s), random(&mut s), random(&mut s)) * 4.0 - 2.0;
        let all: Vec<Component> = (0..150)
            .map(|i| {
                let core = if i % 3 == 0 { Core::Segment(point(), point() * 0.3) } else { Core::Point(point()) };
                component(core, 0.3 + 0.002 * f64::from(i), if i % 7 == 0 { -0.8 } else { 1.0 })
            })
            .collect();
        Blob::new(0.5, &all).unwrap()
    }

    #[test]
    fn as_pov_ray() {
        compare(&measured(), include_str!("measured/blob.txt"), &Tolerance::default());
    }

    #[test]
    fn inside_alternates() {
        alternates(&measured(), DVec3::ZERO, 1.5, 3000, 0);
        alternates(&many(), DVec3::ZERO, 2.0, 1000, 0);
    }

    #[test]
    fn far_lines_see_the_same() {
        let blob = many();
        for z in [-5.0, -1e3, -1e5] {
            let mut out = Vec::new();
            blob.crossings(&Line { o: DVec3::new(0.1, 0.2, z), d: DVec3::Z }, 0.0, 1e9, &mut out);
            let mut near = Vec::new();
            blob.crossings(&Line { o: DVec3::new(0.1, 0.2, 0.0), d: DVec3::Z }, -1e3, 1e3, &mut near);
            assert_eq!(out.len(), near.len());
            for (a, b) in out.iter().zip(&near) {
                assert!((a.t + z - b.t).abs() < 1e-11 * (1.0 - z));
            }
        }
    }

    #[test]
    fn one_ball() {
        // strength (1 − r²)² = threshold
        let blob = Blob::new(0.25, &[component(Core::Point(DVec3::ZERO), 2.0, 1.0)]).unwrap();
        let mut out = Vec::new();
        blob.crossings(&Line { o: DVec3::new(-10.0, 0.0, 0.0), d: DVec3::X }, 0.0, 100.0, &mut out);
        assert_eq!(out.len(), 2);
        assert!((out[0].t - (10.0 - 2.0 * 0.5f64.sqrt())).abs() < 1e-13);
        // From inside there is one.
        out.clear();
        blob.crossings(&Line { o: DVec3::ZERO, d: DVec3::X }, 0.0, 100.0, &mut out);
        assert_eq!(out.len(), 1);
    }

    #[test]
    fn hostile() {
        let ball = |radius, strength| component(Core::Point(DVec3::ZERO), radius, strength);
        assert!(Blob::new(0.5, &[]).is_none());
        assert!(Blob::new(0.0, &[ball(1.0, 1.0)]).is_none());
        assert!(Blob::new(f64::NAN, &[ball(1.0, 1.0)]).is_none());
        assert!(Blob::new(0.5, &[ball(0.0, 1.0), ball(1.0, -1.0), ball(f64::NAN, 1.0), ball(1.0, f64::INFINITY)]).is_none());
        let mut flat = ball(1.0, 1.0);
        flat.blob_from_component = DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0));
        assert!(Blob::new(0.5, &[flat]).is_none());
        hostile_lines(&measured());
        hostile_lines(&Blob::new(1e-300, &[ball(1e100, 1e100), ball(1e-100, 1e300)]).unwrap());
    }
}
