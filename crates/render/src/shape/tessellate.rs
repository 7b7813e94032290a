//! Triangles for the exact shapes, for methods that know nothing else.

use super::Shape;
use super::affine::Affine;
use crate::math::{TAU, Vec2, Vec3, fns};

/// Segments of a full circle.
const SEGMENTS: u32 = 128;

/// Positions and vertex indices.
pub type Tessellation = (Vec<Vec3>, Vec<[u32; 3]>);

impl Shape {
    /// Triangles near the surface, their corners on it. Full circles get 128 segments; a plane becomes a square that reaches `reach`
    /// to each side of its origin's foot. The winding means nothing.
    pub fn tessellate(&self, reach: f32) -> Tessellation {
        match self {
            Self::Sphere(s) => sphere(&s.affine),
            Self::Cylinder(c) => grid(SEGMENTS, 1, |u, v| c.affine.world_from_unit(circle(u).extend(v))),
            Self::Disk(d) => disk(|q| d.planar.point(q)),
            Self::Rectangle(r) => grid(1, 1, |u, v| r.planar.point(2.0 * Vec2::new(u, v) - 1.0)),
            Self::Plane(p) => {
                // Units of the plane's own axes may be of any length, and oblique.
                let (s, t) = p.planar.ng.any_orthonormal_pair();
                grid(1, 1, |u, v| p.planar.origin + (s * (2.0 * u - 1.0) + t * (2.0 * v - 1.0)) * reach)
            }
            Self::Polygon(p) => p.pieces(),
        }
    }
}

fn circle(turn: f32) -> Vec2 {
    // The seam's vertices must be the same.
    let (sin, cos) = if turn >= 1.0 { (0.0, 1.0) } else { fns::sin_cos(turn * TAU) };
    Vec2::new(cos, sin)
}

fn grid(nu: u32, nv: u32, point: impl Fn(f32, f32) -> Vec3) -> Tessellation {
    let positions = (0..=nv).flat_map(|j| (0..=nu).map(move |i| (i as f32 / nu as f32, j as f32 / nv as f32))).map(|(u, v)| point(u, v));
    let quads = (0..nv).flat_map(|j| (0..nu).map(move |i| j * (nu + 1) + i));
    let triangles = quads.flat_map(|a| [[a, a + 1, a + nu + 2], [a, a + nu + 2, a + nu + 1]]).collect();
    (positions.collect(), triangles)
}

fn disk(point: impl Fn(Vec2) -> Vec3) -> Tessellation {
    let rim = (0..SEGMENTS).map(|i| point(circle(i as f32 / SEGMENTS as f32)));
    let positions = std::iter::once(point(Vec2::ZERO)).chain(rim).collect();
    (positions, (0..SEGMENTS).map(|i| [0, 1 + i, 1 + (i + 1) % SEGMENTS]).collect())
}

/// Half as many rings as segments; the poles' triangles without area are left out.
fn sphere(affine: &Affine) -> Tessellation {
    let rings = SEGMENTS / 2;
    let (positions, mut triangles) = grid(SEGMENTS, rings, |u, v| {
        let down = circle(0.5 * v);
        let (cos, sin) = if v >= 1.0 { (-1.0, 0.0) } else { (down.x, down.y) };
        affine.world_from_unit((circle(u) * sin).extend(cos))
    });
    let row = |v: u32| v / (SEGMENTS + 1);
    triangles.retain(|t| {
        let at = |r: u32| t.iter().filter(|v| row(**v) == r).count();
        at(0) < 2 && at(rings) < 2
    });
    (positions, triangles)
}

#[cfg(test)]
mod tests {
    use etendue_scene::desc::GeometryDesc;
    use glam::Mat4;

    use super::*;

    #[test]
    fn areas_come_near_those_of_the_shapes_and_corners_lie_on_them() {
        let m =
            Mat4::from_scale_rotation_translation(Vec3::new(1.0, 2.0, 0.5), glam::Quat::from_rotation_x(0.7), Vec3::new(3.0, -1.0, 2.0));
        let square = |h: f32| vec![Vec2::new(-h, -h), Vec2::new(h, -h), Vec2::new(h, h), Vec2::new(-h, h)];
        for geometry in [
            GeometryDesc::Sphere { center: Vec3::X, radius: 2.0 },
            GeometryDesc::Disk,
            GeometryDesc::Rectangle,
            GeometryDesc::Cylinder { p0: Vec3::X, p1: Vec3::Y, radius: 0.5 },
            GeometryDesc::Polygon { contours: vec![square(2.0), square(1.0)] },
        ] {
            let shape = Shape::from_desc(&geometry, m, false).unwrap();
            let (positions, triangles) = shape.tessellate(1.0);
            let corners = |t: &[u32; 3]| t.map(|i| positions[i as usize]);
            let area: f32 = triangles.iter().map(corners).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum();
            assert!((area / shape.area() - 1.0).abs() < 2e-3, "{geometry:?}: {area} instead of {}", shape.area());
            for p in &positions {
                assert!((shape.surface(*p).p - *p).length() < 1e-5, "{geometry:?}");
            }
        }
        let plane = Shape::from_desc(&GeometryDesc::Plane, m, false).unwrap();
        let (positions, triangles) = plane.tessellate(100.0);
        assert_eq!((positions.len(), triangles.len()), (4, 2));
        assert!(positions.iter().all(|p| (plane.surface(*p).p - *p).length() < 1e-4));
    }
}
