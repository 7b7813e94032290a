//! Triangles for the analytic shapes.

use glam::{Vec2, Vec3};

use crate::desc::{GeometryDesc, MeshData};

/// Segments of a full circle.
const SEGMENTS: u32 = 96;
/// Half of the edge of the square that stands for the infinite plane.
const PLANE_HALF: f32 = 1000.0;

/// A point on the unit circle: `t` of the way round.
fn circle(t: f32) -> Vec2 {
    let (sin, cos) = (std::f64::consts::TAU * f64::from(t)).sin_cos();
    Vec2::new(cos as f32, sin as f32)
}

/// A grid of (`nu` + 1) × (`nv` + 1) vertices over the unit square; `f` gives position and normal.
fn grid(nu: u32, nv: u32, f: impl Fn(f32, f32) -> (Vec3, Vec3)) -> MeshData {
    let mut m = MeshData::default();
    for j in 0..=nv {
        for i in 0..=nu {
            let uv = Vec2::new(i as f32 / nu as f32, j as f32 / nv as f32);
            let (p, n) = f(uv.x, uv.y);
            m.positions.push(p);
            m.normals.push(n);
            m.uvs.push(uv);
        }
    }
    for j in 0..nv {
        for i in 0..nu {
            let a = j * (nu + 1) + i;
            let b = a + nu + 1;
            m.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    // Wind as the normals say, and drop what collapses at poles and centers.
    let MeshData { positions, normals, triangles, .. } = &mut m;
    triangles.retain_mut(|t| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        let ng = (b - a).cross(c - a);
        let n: Vec3 = t.iter().map(|&i| normals[i as usize]).sum();
        if ng.dot(n) < 0.0 {
            t.swap(1, 2);
        }
        ng.length_squared() > 0.0
    });
    m
}

fn square(half: f32) -> MeshData {
    let mut m = grid(1, 1, |u, v| (Vec3::new((2.0 * u - 1.0) * half, (2.0 * v - 1.0) * half, 0.0), Vec3::Z));
    if half != 1.0 {
        m.uvs = m.positions.iter().map(|p| p.truncate()).collect();
    }
    m
}

fn cube() -> MeshData {
    let mut m = MeshData::default();
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let mut n = Vec3::ZERO;
            n[axis] = sign;
            let mut s = Vec3::ZERO;
            s[(axis + 1) % 3] = 1.0;
            let face = grid(1, 1, |u, v| (n + (2.0 * u - 1.0) * s + (2.0 * v - 1.0) * n.cross(s), n));
            let base = m.positions.len() as u32;
            m.positions.extend(face.positions);
            m.normals.extend(face.normals);
            m.uvs.extend(face.uvs);
            m.triangles.extend(face.triangles.iter().map(|t| t.map(|i| i + base)));
        }
    }
    m
}

fn sphere(center: Vec3, radius: f32) -> MeshData {
    grid(SEGMENTS, SEGMENTS / 2, |u, v| {
        // The upper half of the circle, from the pole down.
        let (around, down) = (circle(u), circle(v / 2.0));
        let n = Vec3::new(down.y * around.x, down.y * around.y, down.x);
        (center + radius * n, n)
    })
}

fn cylinder(p0: Vec3, p1: Vec3, radius: f32) -> MeshData {
    let axis = (p1 - p0).normalize_or(Vec3::Z);
    let (s, t) = axis.any_orthonormal_pair();
    grid(SEGMENTS, 1, |u, v| {
        let c = circle(u);
        let n = s * c.x + t * c.y;
        (p0.lerp(p1, v) + radius * n, n)
    })
}

/// Ear clipping of a contour without holes or crossings.
fn polygon(contour: &[Vec2]) -> Option<MeshData> {
    let cross = |a: Vec2, b: Vec2, c: Vec2| (b - a).perp_dot(c - a);
    let area: f32 = (0..contour.len()).map(|i| contour[i].perp_dot(contour[(i + 1) % contour.len()])).sum();
    let mut rest: Vec<u32> = (0..contour.len() as u32).collect();
    if area < 0.0 {
        rest.reverse();
    }
    let at = |i: u32| contour[i as usize];
    let mut triangles = Vec::new();
    while rest.len() > 2 {
        let n = rest.len();
        let ear = (0..n).find(|&i| {
            let [a, b, c] = [rest[(i + n - 1) % n], rest[i], rest[(i + 1) % n]];
            let inside = |p: Vec2| cross(at(a), at(b), p) >= 0.0 && cross(at(b), at(c), p) >= 0.0 && cross(at(c), at(a), p) >= 0.0;
            cross(at(a), at(b), at(c)) >= 0.0 && rest.iter().all(|&k| k == a || k == b || k == c || !inside(at(k)))
        })?;
        triangles.push([rest[(ear + n - 1) % n], rest[ear], rest[(ear + 1) % n]]);
        rest.remove(ear);
    }
    let positions: Vec<Vec3> = contour.iter().map(|p| p.extend(0.0)).collect();
    Some(MeshData { normals: vec![Vec3::Z; positions.len()], uvs: contour.to_vec(), positions, triangles, ..MeshData::default() })
}

/// The triangles of a shape that is no mesh; `None` for meshes and for polygons with holes.
pub fn tessellate(geometry: &GeometryDesc) -> Option<MeshData> {
    match geometry {
        GeometryDesc::Mesh { .. } => None,
        GeometryDesc::Sphere { center, radius } => Some(sphere(*center, *radius)),
        GeometryDesc::Disk => Some(grid(1, SEGMENTS, |u, v| ((u * circle(v)).extend(0.0), Vec3::Z))),
        GeometryDesc::Rectangle => Some(square(1.0)),
        GeometryDesc::Cube => Some(cube()),
        GeometryDesc::Cylinder { p0, p1, radius } => Some(cylinder(*p0, *p1, *radius)),
        GeometryDesc::Plane => Some(square(PLANE_HALF)),
        GeometryDesc::Polygon { contours } => match &contours[..] {
            [contour] => polygon(contour),
            _ => None,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(m: &MeshData) -> f32 {
        let areas = m.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| m.positions[i as usize]);
            let ng = (b - a).cross(c - a) / 2.0;
            assert!(ng.dot(m.normals[t[0] as usize]) > 0.0, "wound to the inside");
            ng.length()
        });
        areas.sum()
    }

    #[test]
    fn areas_come_near_those_of_the_shapes() {
        use std::f32::consts::PI;
        let contour = vec![Vec2::new(0.0, 0.0), Vec2::new(0.0, 2.0), Vec2::new(1.0, 1.0), Vec2::new(2.0, 2.0), Vec2::new(2.0, 0.0)];
        for (geometry, expected) in [
            (GeometryDesc::Sphere { center: Vec3::X, radius: 2.0 }, 16.0 * PI),
            (GeometryDesc::Disk, PI),
            (GeometryDesc::Rectangle, 4.0),
            (GeometryDesc::Cube, 24.0),
            (GeometryDesc::Cylinder { p0: Vec3::X, p1: Vec3::Y, radius: 0.5 }, PI * 2.0f32.sqrt()),
            (GeometryDesc::Plane, 4.0e6),
            (GeometryDesc::Polygon { contours: vec![contour] }, 3.0),
        ] {
            let a = area(&tessellate(&geometry).unwrap());
            assert!((a / expected - 1.0).abs() < 2e-3, "{geometry:?}: {a} instead of {expected}");
        }
    }
}
