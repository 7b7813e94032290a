//! How the shading normal turns along a surface: what smooth glass and mirrors need to tell how they focus light.

use super::Scene;
use super::geometry::NONE;
use super::surface::Surface;
use crate::math::Vec3;

impl Surface {
    /// The changes of the unit shading normal `frame.n` (world space, per unit of length) for two moves in the tangent plane.
    ///
    /// Exact for analytic shapes and for triangles with interpolated normals; zero where a surface is flat or has no extent.
    pub fn normal_changes(&self, scene: &Scene, moves: [Vec3; 2]) -> [Vec3; 2] {
        let placement = &scene.placements[self.instance as usize];
        let g = &scene.geometries[placement.geometry as usize];
        let object = &g.objects[self.object as usize];
        // Two tangents in the geometry's own space, the normal there (of any length) and its changes along them.
        let ([a, b], n, [dna, dnb]) = match (self.primitive as usize).checked_sub(g.triangles.len()) {
            None if object.normals == NONE => return [Vec3::ZERO; 2],
            None => {
                let tri = g.triangles[self.primitive as usize];
                let [p0, p1, p2] = tri.map(|i| g.positions[i as usize]);
                let [n0, n1, n2] = tri.map(|i| g.normals[(object.normals + i - object.first_vertex) as usize]);
                let (b1, b2) = (self.bary.x, self.bary.y);
                ([p1 - p0, p2 - p0], n0 * (1.0 - b1 - b2) + n1 * b1 + n2 * b2, [n1 - n0, n2 - n0])
            }
            Some(shape) => {
                let p = placement.object_from_world.map_or(self.p, |m| m.transform_point3(self.p));
                let s = g.shapes[shape].surface(p);
                ([s.dpdu, s.dpdv], s.ng, [s.dndu, s.dndv])
            }
        };
        let (aa, ab, bb) = (a.length_squared(), a.dot(b), b.length_squared());
        let det = aa * bb - ab * ab;
        let normal = placement.normal_matrix * n;
        let length = normal.length();
        if !(det > 0.0 && length > 0.0) {
            return [Vec3::ZERO; 2];
        }
        let unit = normal / length;
        let scale = if unit.dot(self.frame.n) < 0.0 { -1.0 } else { 1.0 } / length;
        moves.map(|m| {
            let m = placement.object_from_world.map_or(m, |t| t.transform_vector3(m));
            let (ma, mb) = (m.dot(a), m.dot(b));
            let change = placement.normal_matrix * (dna * ((bb * ma - ab * mb) / det) + dnb * ((aa * mb - ab * ma) / det));
            (change - unit * unit.dot(change)) * scale
        })
    }
}
