//! Triangles for analytic shapes, and the way back from a hit to the triangle that stands for the place.
//!
//! A shape becomes a grid in parameters of its own. Spheres and disks are blown up so that the triangles have the shape's area:
//! then they send and receive the right amount of light.

use crate::math::{PI, TAU, Vec2, Vec3, fns};
use crate::shape::Shape;

/// Cells of a grid over a shape: each has two triangles, (0, 1, 3) and (0, 3, 2) of its corners in the order (s, t) = 00, 10, 01, 11.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Columns.
    pub nu: u32,
    /// Rows.
    pub nv: u32,
}

/// Half of the edge of the square that stands for an infinite plane, in radii of the bounded scene.
const PLANE_RADII: f32 = 6.0;

/// The grid for a shape; `None` for polygons, which are cut into triangles. `is_coarse` where a scene has very many shapes.
pub fn grid(shape: &Shape, is_coarse: bool) -> Option<Grid> {
    let (nu, nv) = match shape {
        Shape::Sphere(_) => (32, 16),
        Shape::Disk(_) => (16, 16),
        Shape::Cylinder(_) => (32, 4),
        Shape::Rectangle(_) => return Some(Grid { nu: 1, nv: 1 }),
        Shape::Plane(_) => return Some(Grid { nu: 8, nv: 8 }),
        Shape::Polygon(_) => return None,
    };
    Some(if is_coarse { Grid { nu: nu / 2, nv: (nv / 2).max(1) } } else { Grid { nu, nv } })
}

/// The extent of the bounded scene, which decides how much of a plane is lit.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Center.
    pub center: Vec3,
    /// Radius.
    pub radius: f32,
}

impl Extent {
    /// The same in the space of an instance.
    pub fn transformed(self, object_from_world: Option<glam::Mat4>) -> Self {
        match object_from_world {
            None => self,
            Some(m) => {
                let scale = m.x_axis.truncate().length().max(m.y_axis.truncate().length()).max(m.z_axis.truncate().length());
                Self { center: m.transform_point3(self.center), radius: self.radius * scale }
            }
        }
    }
}

/// Triangles of a shape in its own space, cell by cell (degenerate ones included, so that the index tells the place). The corners
/// are in the order in which [`locate`] counts.
pub fn triangles(shape: &Shape, grid: Option<Grid>, extent: Extent) -> Vec<[Vec3; 3]> {
    let Some(grid) = grid else {
        return if let Shape::Polygon(p) = shape { p.triangles() } else { Vec::new() };
    };
    let (nu, nv) = (grid.nu, grid.nv);
    let point = |i: u32, j: u32| {
        let (s, t) = (i as f32 / nu as f32, j as f32 / nv as f32);
        match shape {
            Shape::Plane(plane) => {
                let c = plane.surface(extent.center);
                let (x, y) = (c.dpdu.normalize_or_zero(), c.dpdv - c.dpdu * (c.dpdv.dot(c.dpdu) / c.dpdu.length_squared()));
                let half = PLANE_RADII * extent.radius;
                c.p + x * ((2.0 * s - 1.0) * half) + y.normalize_or_zero() * ((2.0 * t - 1.0) * half)
            }
            _ => {
                // The last column of what closes is the first one, bit by bit.
                let turn = if i == nu { 0.0 } else { s };
                let u = match shape {
                    Shape::Sphere(_) => Vec2::new(0.5 * (1.0 - fns::cos(PI * t)), turn),
                    Shape::Cylinder(_) => Vec2::new(turn, t),
                    _ => Vec2::new(s, t),
                };
                shape.sample_area(u).map_or(Vec3::NAN, |a| a.p)
            }
        }
    };
    let mut points: Vec<Vec3> = (0..=nv).flat_map(|j| (0..=nu).map(move |i| (i, j))).map(|(i, j)| point(i, j)).collect();
    if let Shape::Sphere(_) = shape {
        // One point for each pole.
        for i in 1..=nu as usize {
            points[i] = points[0];
            let last = (nv * (nu + 1)) as usize;
            points[last + i] = points[last];
        }
    }
    let cells = |points: &[Vec3]| {
        let mut out = Vec::with_capacity((2 * nu * nv) as usize);
        for j in 0..nv {
            for i in 0..nu {
                let at = |i: u32, j: u32| points[(j * (nu + 1) + i) as usize];
                let c = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
                out.extend([[c[0], c[1], c[3]], [c[0], c[3], c[2]]]);
            }
        }
        out
    };
    let flat = cells(&points);
    if !matches!(shape, Shape::Sphere(_) | Shape::Disk(_)) {
        return flat;
    }
    let area: f64 = flat.iter().map(|c| f64::from(super::form_factor::area_of(c))).sum();
    let scale = (f64::from(shape.area()) / area).sqrt() as f32;
    if !(scale.is_finite() && scale < 1.5) {
        return flat;
    }
    let center = shape.bounds().center();
    points.iter_mut().for_each(|p| *p = center + (*p - center) * scale);
    cells(&points)
}

/// Which triangle of [`triangles`] stands for a point with the shape's own parameters (a hit's `u`, `v`; `p` in the shape's space),
/// and the barycentric weights of its corners.
pub fn locate(shape: &Shape, grid: Option<Grid>, extent: Extent, uv: Vec2, p: Vec3, polygon: &[[Vec3; 3]]) -> (usize, Vec3) {
    let Some(grid) = grid else { return nearest(polygon, p) };
    let (s, t) = match shape {
        Shape::Plane(plane) => {
            let c = plane.surface(extent.center);
            let (x, y) = (c.dpdu.normalize_or_zero(), c.dpdv - c.dpdu * (c.dpdv.dot(c.dpdu) / c.dpdu.length_squared()));
            let (d, half) = (p - c.p, PLANE_RADII * extent.radius);
            (0.5 + 0.5 * d.dot(x) / half, 0.5 + 0.5 * d.dot(y.normalize_or_zero()) / half)
        }
        Shape::Disk(_) => {
            let c = concentric_square(uv.x, uv.y);
            (c.x, c.y)
        }
        _ => (uv.x, uv.y),
    };
    let cell = |v: f32, n: u32| {
        let v = (if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.0 }) * n as f32;
        let i = (v as u32).min(n - 1);
        (i, v - i as f32)
    };
    let ((i, x), (j, y)) = (cell(s, grid.nu), cell(t, grid.nv));
    let first = 2 * (j * grid.nu + i) as usize;
    // At the poles of a sphere one of the two triangles has no area.
    let is_lower = match shape {
        Shape::Sphere(_) if j == 0 => false,
        Shape::Sphere(_) if j + 1 == grid.nv => true,
        _ => x >= y,
    };
    if is_lower {
        let y = y.min(x);
        (first, Vec3::new(1.0 - x, x - y, y))
    } else {
        let x = x.min(y);
        (first + 1, Vec3::new(1.0 - y, x, y - x))
    }
}

/// The point of the unit square that the concentric map takes to radius and angle (in turns); see `warp::disk_concentric`.
fn concentric_square(r: f32, turn: f32) -> Vec2 {
    let quarter = PI / 4.0;
    let mut phi = turn * TAU;
    if phi > 7.0 * quarter {
        phi -= TAU;
    }
    let o = if phi < quarter {
        Vec2::new(r, r * phi / quarter)
    } else if phi < 3.0 * quarter {
        Vec2::new(r * (2.0 - phi / quarter), r)
    } else if phi < 5.0 * quarter {
        Vec2::new(-r, r * (4.0 - phi / quarter))
    } else {
        Vec2::new(r * (phi / quarter - 6.0), -r)
    };
    (o * 0.5 + 0.5).clamp(Vec2::ZERO, Vec2::ONE)
}

/// The triangle of a flat set that holds a point, or the nearest to do so.
fn nearest(triangles: &[[Vec3; 3]], p: Vec3) -> (usize, Vec3) {
    let mut best = (0, Vec3::new(1.0, 0.0, 0.0), f32::NEG_INFINITY);
    for (i, c) in triangles.iter().enumerate() {
        let b = barycentric(c, p);
        let least = b.min_element();
        if least > best.2 {
            best = (i, b, least);
        }
    }
    let b = best.1.max(Vec3::ZERO);
    (best.0, b / (b.x + b.y + b.z).max(1e-20))
}

/// Barycentric weights of the point of a triangle's plane that is next to `p`; not limited to the triangle.
pub fn barycentric(c: &[Vec3; 3], p: Vec3) -> Vec3 {
    let (e1, e2, d) = (c[1] - c[0], c[2] - c[0], p - c[0]);
    let (d11, d12, d22) = (e1.dot(e1), e1.dot(e2), e2.dot(e2));
    let (p1, p2) = (d.dot(e1), d.dot(e2));
    let inv = 1.0 / (d11 * d22 - d12 * d12);
    let (b1, b2) = ((d22 * p1 - d12 * p2) * inv, (d11 * p2 - d12 * p1) * inv);
    let b = Vec3::new(1.0 - b1 - b2, b1, b2);
    if b.is_finite() { b } else { Vec3::NEG_INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat4;

    #[test]
    fn points_of_shapes_are_located_in_the_triangles_that_stand_for_them() {
        let extent = Extent { center: Vec3::new(0.2, 0.1, 0.3), radius: 2.0 };
        let m = Mat4::from_translation(Vec3::new(1.0, 2.0, 3.0)) * Mat4::from_rotation_x(0.4);
        let shapes = [
            Shape::Sphere(crate::shape::Sphere::from_transform(Vec3::X, 2.0, m, false).unwrap()),
            Shape::Disk(crate::shape::Disk::from_transform(m, false).unwrap()),
            Shape::Rectangle(crate::shape::Rectangle::from_transform(m, false).unwrap()),
            Shape::Cylinder(crate::shape::Cylinder::from_transform(Vec3::ZERO, Vec3::ONE, 0.5, m, false).unwrap()),
        ];
        for shape in &shapes {
            let g = grid(shape, false);
            let triangles = triangles(shape, g, extent);
            let area: f32 = triangles.iter().map(super::super::form_factor::area_of).sum();
            assert!((area / shape.area() - 1.0).abs() < 6e-3, "{shape:?}: {area}");
            for k in 0..500u32 {
                let u = Vec2::new((k as f32 * 0.618_034).fract(), (k as f32 * 0.754_878).fract());
                let sample = shape.sample_area(u).unwrap();
                let hit = shape.surface(sample.p);
                let (i, b) = locate(shape, g, extent, hit.uv, sample.p, &triangles);
                let c = triangles[i];
                let found = c[0] * b.x + c[1] * b.y + c[2] * b.z;
                let size = shape.bounds().extent().max_element();
                assert!((found - sample.p).length() < 0.03 * size, "{shape:?} at {}: {found} for {}", hit.uv, sample.p);
            }
        }
    }
}
