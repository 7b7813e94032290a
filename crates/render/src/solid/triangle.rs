//! Triangle, flat or smooth.

use etendue_scene::desc::classic;
use glam::{DAffine3, DVec2, DVec3};

use super::{Bounds, Crossing, Line, NO_UV, Primitive};

/// Triangle with barycentric coordinates of the second and third corner in its crossings.
#[derive(Clone, Debug)]
pub(super) struct Triangle {
    corner: DVec3,
    edges: [DVec3; 2],
    normals: Option<Box<[DVec3; 3]>>,
    /// A mirror has turned its corners around, but not its normal.
    mirrored: bool,
}

impl Triangle {
    /// `None` where corners are in a line.
    pub(super) fn new(t: &classic::Triangle) -> Option<Self> {
        let [a, b, c] = t.corners;
        let edges = [b - a, c - a];
        edges[0].cross(edges[1]).try_normalize()?;
        let normals = t.normals.filter(|n| n.iter().all(|n| n.is_finite())).map(Box::new);
        a.is_finite().then_some(Self { corner: a, edges, normals, mirrored: false })
    }

    /// The image under an affine transform; `None` where that has no area.
    pub(super) fn moved(&self, m: &DAffine3) -> Option<Self> {
        let corner = m.transform_point3(self.corner);
        let edges = self.edges.map(|e| m.matrix3 * e);
        edges[0].cross(edges[1]).try_normalize()?;
        let normal = m.matrix3.inverse().transpose();
        let normals = self.normals.as_ref().map(|n| Box::new(n.map(|n| normal * n)));
        let mirrored = self.mirrored != (m.matrix3.determinant() < 0.0);
        corner.is_finite().then_some(Self { corner, edges, normals, mirrored })
    }

    fn flat(&self) -> DVec3 {
        let n = flat_normal(&self.edges);
        if self.mirrored { -n } else { n }
    }
}

/// Where a line meets a triangle: t and the barycentric coordinates of the second and third corner (Möller, Trumbore 1997, "Fast, Minimum
/// Storage Ray/Triangle Intersection", equation 6). Edges count, with a little room against gaps between neighbors.
#[inline]
pub(super) fn intersect(corner: DVec3, edges: &[DVec3; 2], line: &Line) -> Option<(f64, DVec2)> {
    const ROOM: f64 = 1e-13;
    let p = line.d.cross(edges[1]);
    let scale = 1.0 / edges[0].dot(p);
    let s = line.o - corner;
    let u = s.dot(p) * scale;
    if !(-ROOM..=1.0 + ROOM).contains(&u) {
        return None;
    }
    let q = s.cross(edges[0]);
    let v = line.d.dot(q) * scale;
    if !(v >= -ROOM && u + v <= 1.0 + ROOM) {
        return None;
    }
    let t = edges[1].dot(q) * scale;
    t.is_finite().then_some((t, DVec2::new(u, v)))
}

/// The unit normal on the side from which the corners go clockwise in left-handed space, as measured.
pub(super) fn flat_normal(edges: &[DVec3; 2]) -> DVec3 {
    edges[1].cross(edges[0]).normalize_or(DVec3::Y)
}

/// The normal between corner normals.
pub(super) fn smooth(normals: &[DVec3; 3], uv: DVec2, flat: DVec3) -> DVec3 {
    let n = normals[0] * (1.0 - uv.x - uv.y) + normals[1] * uv.x + normals[2] * uv.y;
    n.normalize_or(flat)
}

impl Primitive for Triangle {
    fn bounds(&self) -> Bounds {
        Bounds::of_points([self.corner, self.corner + self.edges[0], self.corner + self.edges[1]])
    }

    #[inline]
    fn crossings(&self, line: &Line, t_min: f64, t_max: f64, out: &mut Vec<Crossing>) {
        out.extend(self.nearest(line, t_min, t_max, &mut Vec::new()));
    }

    #[inline]
    fn nearest(&self, line: &Line, t_min: f64, t_max: f64, _scratch: &mut Vec<Crossing>) -> Option<Crossing> {
        let (t, uv) = intersect(self.corner, &self.edges, line)?;
        (t > t_min && t < t_max).then_some(Crossing { t, part: 0, uv })
    }

    fn inside(&self, _p: DVec3) -> bool {
        false
    }

    fn normal(&self, _p: DVec3, crossing: &Crossing) -> DVec3 {
        match &self.normals {
            Some(n) => smooth(n, crossing.uv, self.flat()),
            None => self.flat(),
        }
    }

    fn geometric_normal(&self, p: DVec3, crossing: &Crossing) -> DVec3 {
        let flat = self.flat();
        if flat.dot(self.normal(p, crossing)) < 0.0 { -flat } else { flat }
    }

    fn uv(&self, _p: DVec3, _crossing: &Crossing) -> DVec2 {
        NO_UV
    }
}
