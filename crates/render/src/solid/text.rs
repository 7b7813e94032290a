//! Extruded letters: exact walls along quadratic curves.

use std::sync::Arc;

use arrayvec::ArrayVec;
use etendue_scene::desc::classic::{OutlineSegment, TextShape};
use glam::{DVec2, DVec3};

use super::bvh::Bvh;
use super::facets::{Facet, fill, has_area, quad};
use super::roots::quadratic;
use super::{Bounds, Crossing, Line, NO_UV, Primitive};

/// Letters between z = 0 and z = thickness. Parts: 0 the front, 1 the back, 2 + i the wall of piece i of the outlines.
pub(super) struct Text {
    /// Range of z.
    depth: [f64; 2],
    /// Pieces of all different letters; straight ones have their middle in the middle. None turns in y.
    pieces: Vec<Piece>,
    /// Ranges of `pieces`.
    letters: Vec<std::ops::Range<usize>>,
    /// Letter and place.
    glyphs: Vec<(u32, DVec3)>,
    bvh: Bvh,
}

/// Part of a quadratic Bézier curve that goes only up or only down.
#[derive(Clone, Copy, Debug)]
struct Piece {
    points: [DVec2; 3],
    straight: bool,
    /// The box of its points.
    min: DVec2,
    max: DVec2,
}

impl Piece {
    fn new(points: [DVec2; 3], straight: bool) -> Self {
        let [a, b, c] = points;
        Self { points, straight, min: a.min(b).min(c), max: a.max(b).max(c) }
    }

    fn at(&self, s: f64) -> DVec2 {
        let [a, b, c] = self.points;
        let r = 1.0 - s;
        a * (r * r) + b * (2.0 * r * s) + c * (s * s)
    }

    fn tangent(&self, s: f64) -> DVec2 {
        let [a, b, c] = self.points;
        (b - a) * (1.0 - s) + (c - b) * s
    }

    /// Parameters in [0, 1] where w · curve = level.
    #[inline]
    fn parameters(&self, w: DVec2, level: f64) -> impl Iterator<Item = f64> {
        let [a, b, c] = self.points.map(|p| w.dot(p));
        // The curve lies within the triangle of its points.
        let roots = if a.min(b).min(c) > level || a.max(b).max(c) < level {
            ArrayVec::new()
        } else if self.straight {
            quadratic(&[a - level, c - a, 0.0])
        } else {
            quadratic(&[a - level, 2.0 * (b - a), a - 2.0 * b + c])
        };
        roots.into_iter().filter(|s| *s >= 0.0 && *s <= 1.0)
    }
}

impl Text {
    /// `None` where no letter has an outline or there is no thickness.
    pub(super) fn new(text: &Arc<TextShape>) -> Option<Self> {
        let depth = [text.thickness.min(0.0), text.thickness.max(0.0)];
        if !(depth[1] > depth[0] && depth[1] - depth[0] < f64::INFINITY) {
            return None;
        }
        let mut pieces = Vec::new();
        let mut letters = Vec::new();
        let mut boxes = Vec::new();
        for outline in &text.outlines {
            let start = pieces.len();
            outline.contours.iter().flatten().for_each(|s| add(*s, &mut pieces));
            letters.push(start..pieces.len());
            let hull = pieces[start..]
                .iter()
                .flat_map(|p: &Piece| p.points)
                .fold(Bounds::EMPTY, |b, p| b.with(p.extend(depth[0])).with(p.extend(depth[1])));
            boxes.push(hull);
        }
        let glyphs: Vec<(u32, DVec3)> =
            text.glyphs.iter().copied().filter(|(i, at)| (*i as usize) < letters.len() && at.is_finite()).collect();
        let bvh = Bvh::new(glyphs.iter().map(|(i, at)| {
            let b = boxes[*i as usize];
            if b.is_empty() { b } else { Bounds { min: b.min + *at, max: b.max + *at }.padded() }
        }));
        (!bvh.bounds().is_empty()).then_some(Self { depth, pieces, letters, glyphs, bvh })
    }

    /// Whether a point of the plane is within a letter.
    fn covers(&self, letter: u32, q: DVec2) -> bool {
        self.pieces[self.letters[letter as usize].clone()].iter().fold(false, |odd, piece| {
            let [a, _, c] = piece.points;
            if (a.y <= q.y) == (c.y <= q.y) || piece.max.x <= q.x {
                return odd;
            }
            if piece.min.x > q.x {
                return !odd;
            }
            // It goes up or down once, so there is one parameter but for rounding.
            let s = piece.parameters(DVec2::Y, q.y).next().unwrap_or(if (a.y - q.y).abs() < (c.y - q.y).abs() { 0.0 } else { 1.0 });
            odd ^ (piece.at(s).x > q.x)
        })
    }
}

/// The box of what a line passes of the plane between two heights and two of its parameters, a little larger than it is.
fn shadow(o: &DVec3, d: &DVec3, depth: [f64; 2], [t_min, t_max]: [f64; 2]) -> (DVec2, DVec2) {
    let (mut from, mut to) = (t_min, t_max);
    if d.z != 0.0 {
        let (a, b) = ((depth[0] - o.z) / d.z, (depth[1] - o.z) / d.z);
        (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
    }
    let reach = DVec2::new(d.x, d.y);
    let o = DVec2::new(o.x, o.y);
    let (a, b) = (o + reach * from, o + reach * to);
    let slack = (o.abs() + a.abs().max(b.abs())) * 1e-9;
    // What is no number leaves a side open.
    let open = |v: f64, end: f64| if v.is_nan() { end } else { v };
    let low = |a: f64, b: f64, slack: f64| open(a.min(b) - slack, f64::NEG_INFINITY);
    let high = |a: f64, b: f64, slack: f64| open(a.max(b) + slack, f64::INFINITY);
    (DVec2::new(low(a.x, b.x, slack.x), low(a.y, b.y, slack.y)), DVec2::new(high(a.x, b.x, slack.x), high(a.y, b.y, slack.y)))
}

/// Adds a segment, cut where it turns in y.
fn add(segment: OutlineSegment, out: &mut Vec<Piece>) {
    let finite = |points: &[DVec2]| points.iter().all(|p| p.is_finite());
    match segment {
        OutlineSegment::Line([a, b]) => {
            if finite(&[a, b]) && a != b {
                out.push(Piece::new([a, (a + b) * 0.5, b], true));
            }
        }
        OutlineSegment::Quadratic([a, b, c]) => {
            if !finite(&[a, b, c]) || (a == b && b == c) {
                return;
            }
            let s = (a.y - b.y) / (a.y - 2.0 * b.y + c.y);
            if s > 0.0 && s < 1.0 {
                let (ab, bc) = (a + (b - a) * s, b + (c - b) * s);
                let mut turn = ab + (bc - ab) * s;
                turn.y = ab.y;
                out.push(Piece::new([a, DVec2::new(ab.x, turn.y), turn], false));
                out.push(Piece::new([turn, DVec2::new(bc.x, turn.y), c], false));
            } else {
                out.push(Piece::new([a, b, c], false));
            }
        }
    }
}

impl Primitive for Text {
    fn facets(&self, segments: usize, _: &Bounds) -> Option<Vec<Facet>> {
        let [front, back] = self.depth;
        let steps = |p: &Piece| if p.straight { 1 } else { (segments / 8).max(2) };
        let letter = |range: &std::ops::Range<usize>| -> Vec<Facet> {
            let edge = |p: &Piece, i: usize, n: usize| [p.at(i as f64 / n as f64), p.at((i + 1) as f64 / n as f64)];
            let pieces = &self.pieces[range.clone()];
            let edges: Vec<[DVec2; 2]> = pieces.iter().flat_map(|p| (0..steps(p)).map(move |i| edge(p, i, steps(p)))).collect();
            let wall = |[a, b]: &[DVec2; 2]| quad([a.extend(front), b.extend(front), b.extend(back), a.extend(back)]);
            let area = fill(&edges);
            let caps = [front, back].into_iter().flat_map(|z| area.iter().map(move |t| Facet::new(t.map(|q| q.extend(z)))));
            edges.iter().flat_map(wall).chain(caps).filter(has_area).collect()
        };
        let letters: Vec<Vec<Facet>> = self.letters.iter().map(letter).collect();
        let moved = |f: &Facet, by: DVec3| Facet::new(f.p.map(|p| p + by));
        Some(self.glyphs.iter().flat_map(|&(i, at)| letters[i as usize].iter().map(move |f| moved(f, at))).collect())
    }

    fn bounds(&self) -> Bounds {
        self.bvh.bounds()
    }

    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        let across = DVec2::new(line.d.x, line.d.y);
        let flat2 = across.length_squared();
        self.bvh.visit(line, t_min, t_max, |g, _| {
            let (letter, at) = self.glyphs[g as usize];
            let o = line.o - at;
            let mut take = |t: f64, part: u32, s: f64| {
                if t > t_min && t < t_max {
                    out.push(Crossing { t, part, uv: DVec2::new(s, 0.0) });
                }
            };
            if line.d.z != 0.0 {
                for (part, z) in self.depth.into_iter().enumerate() {
                    let t = (z - o.z) / line.d.z;
                    if !(t > t_min && t < t_max) {
                        continue;
                    }
                    let q = DVec2::new(o.x + t * line.d.x, o.y + t * line.d.y);
                    if self.covers(letter, q) {
                        take(t, part as u32, 0.0);
                    }
                }
            }
            if flat2 > 1e-24 * line.d.length_squared() {
                let o2 = DVec2::new(o.x, o.y);
                let w = across.perp();
                let level = w.dot(o2);
                let (min, max) = shadow(&o, &line.d, self.depth, [t_min, t_max]);
                for i in self.letters[letter as usize].clone() {
                    let piece = &self.pieces[i];
                    if !(piece.min.cmple(max).all() && piece.max.cmpge(min).all()) {
                        continue;
                    }
                    for s in piece.parameters(w, level) {
                        let t = (piece.at(s) - o2).dot(across) / flat2;
                        let z = o.z + t * line.d.z;
                        if z >= self.depth[0] && z <= self.depth[1] {
                            take(t, i as u32 + 2, s);
                        }
                    }
                }
            }
            true
        });
    }

    fn inside(&self, p: DVec3) -> bool {
        if !(p.z >= self.depth[0] && p.z <= self.depth[1]) {
            return false;
        }
        let mut inside = false;
        self.bvh.visit_point(p, |g| {
            let (letter, at) = self.glyphs[g as usize];
            inside = self.covers(letter, DVec2::new(p.x - at.x, p.y - at.y));
            !inside
        });
        inside
    }

    fn normal(&self, _p: DVec3, crossing: &Crossing) -> DVec3 {
        match crossing.part {
            0 => DVec3::NEG_Z,
            1 => DVec3::Z,
            wall => {
                // Outlines of letters have the ink on their right; normals of walls point into it (as measured).
                let t = self.pieces.get(wall as usize - 2).map_or(DVec2::Y, |p| p.tangent(crossing.uv.x));
                DVec3::new(t.y, -t.x, 0.0).normalize_or(DVec3::X)
            }
        }
    }

    fn uv(&self, _p: DVec3, _crossing: &Crossing) -> DVec2 {
        NO_UV
    }
}
