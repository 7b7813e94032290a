//! Curves as meshes: tubes of their width.

use glam::Vec3;

use super::angles::sin_cos;

use crate::desc::MeshData;

/// Sides of a tube.
const SIDES: u32 = 6;
/// Pieces of one segment of a curve.
const PIECES: u32 = 8;

/// A segment: four Bézier points, and the widths at its ends.
pub(super) struct Segment {
    /// Control points.
    pub points: [Vec3; 4],
    /// Widths at both ends.
    pub widths: [f32; 2],
}

/// Cubic Bézier segments of a curve by `basis` (bezier, bspline) and degree (2, 3); `None` where the number of points does not fit.
pub(super) fn segments(points: &[Vec3], degree: usize, bspline: bool, width0: f32, width1: f32) -> Option<Vec<Segment>> {
    let n = points.len();
    let count = match (bspline, n > degree) {
        (_, false) => return None,
        (true, true) => n - degree,
        (false, true) if (n - 1).is_multiple_of(degree) => (n - 1) / degree,
        _ => return None,
    };
    let width = |i: usize| width0 + (width1 - width0) * i as f32 / count as f32;
    let cubic = |i: usize| -> [Vec3; 4] {
        let elevate = |p: [Vec3; 3]| [p[0], p[0].lerp(p[1], 2.0 / 3.0), p[2].lerp(p[1], 2.0 / 3.0), p[2]];
        match (bspline, degree) {
            (false, 2) => elevate([points[2 * i], points[2 * i + 1], points[2 * i + 2]]),
            (false, _) => [points[3 * i], points[3 * i + 1], points[3 * i + 2], points[3 * i + 3]],
            (true, 2) => elevate([points[i].lerp(points[i + 1], 0.5), points[i + 1], points[i + 1].lerp(points[i + 2], 0.5)]),
            (true, _) => {
                let [a, b, c, d] = [points[i], points[i + 1], points[i + 2], points[i + 3]];
                let third = |p: Vec3, q: Vec3| (2.0 * p + q) / 3.0;
                [(third(b, a) + third(b, c)) / 2.0, third(b, c), third(c, b), (third(c, b) + third(c, d)) / 2.0]
            }
        }
    };
    Some((0..count).map(|i| Segment { points: cubic(i), widths: [width(i), width(i + 1)] }).collect())
}

/// A tube along the segments, with smooth normals; u runs round it, v along it.
pub(super) fn tube(segments: &[Segment]) -> MeshData {
    let mut mesh = MeshData::default();
    let total = segments.len() as u32 * PIECES;
    let mut side = Vec3::ZERO;
    for ring in 0..=total {
        let (i, t) =
            if ring == total { (segments.len() - 1, 1.0) } else { ((ring / PIECES) as usize, (ring % PIECES) as f32 / PIECES as f32) };
        let s = &segments[i];
        let [a, b, c, d] = s.points;
        let (ab, bc, cd) = (a.lerp(b, t), b.lerp(c, t), c.lerp(d, t));
        let (abc, bcd) = (ab.lerp(bc, t), bc.lerp(cd, t));
        let p = abc.lerp(bcd, t);
        let axis = (bcd - abc).normalize_or((d - a).normalize_or(Vec3::Z));
        // Carried along the curve, so that the tube does not twist.
        side = (side - axis * axis.dot(side)).try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
        let up = axis.cross(side);
        let radius = 0.5 * (s.widths[0] + (s.widths[1] - s.widths[0]) * t);
        for k in 0..=SIDES {
            let angle = std::f32::consts::TAU * k as f32 / SIDES as f32;
            let (sin, cos) = sin_cos(angle);
            let n = side * cos + up * sin;
            mesh.positions.push(p + n * radius);
            mesh.normals.push(n);
            mesh.uvs.push(glam::Vec2::new(k as f32 / SIDES as f32, ring as f32 / total as f32));
        }
    }
    let row = SIDES + 1;
    for ring in 0..total {
        for k in 0..SIDES {
            let (a, b) = (ring * row + k, (ring + 1) * row + k);
            mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bases_and_degrees_agree_on_a_straight_line() {
        let line: Vec<Vec3> = (0..7).map(|i| Vec3::X * i as f32).collect();
        for (degree, bspline, count) in [(3, false, 2), (2, false, 3), (3, true, 4), (2, true, 5)] {
            let s = segments(&line, degree, bspline, 1.0, 1.0).unwrap();
            assert_eq!(s.len(), count);
            for pair in s.windows(2) {
                assert!((pair[0].points[3] - pair[1].points[0]).length() < 1e-5, "the segments join");
            }
        }
        assert!(segments(&line[..5], 3, false, 1.0, 1.0).is_none());
    }

    #[test]
    fn a_tube_has_its_radius_and_faces_outwards() {
        let line: Vec<Vec3> = (0..4).map(|i| Vec3::X * i as f32).collect();
        let mesh = tube(&segments(&line, 3, false, 0.5, 0.5).unwrap());
        for (p, n) in mesh.positions.iter().zip(&mesh.normals) {
            assert!(((p.y * p.y + p.z * p.z).sqrt() - 0.25).abs() < 1e-5);
            assert!(n.dot(Vec3::new(0.0, p.y, p.z)) > 0.0);
        }
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            let middle = (a + b + c) / 3.0;
            assert!((b - a).cross(c - a).dot(Vec3::new(0.0, middle.y, middle.z)) > 0.0, "winding");
        }
    }
}
