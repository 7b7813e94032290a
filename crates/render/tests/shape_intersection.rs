//! Intersection and differential geometry of the shapes: against implicit equations, finite differences and hostile input.

#![allow(clippy::unwrap_used)]

use etendue_render::accel::Ray;
use etendue_render::math::hash::{mix32, unit_float};
use etendue_render::math::{Mat4, Vec2, Vec3, warp};
use etendue_render::shape::{Cylinder, Disk, Plane, Polygon, Rectangle, Shape, Sphere};
use glam::{EulerRot, Quat};

fn rnd(i: u32) -> f32 {
    unit_float(mix32(i))
}

fn rnd3(i: u32) -> Vec3 {
    Vec3::new(rnd(3 * i), rnd(3 * i + 1), rnd(3 * i + 2))
}

fn placed(scale: Vec3) -> Mat4 {
    let turn = Quat::from_euler(EulerRot::XYZ, 0.4, -0.9, 1.7);
    Mat4::from_scale_rotation_translation(scale, turn, Vec3::new(0.3, -0.2, 0.5))
}

fn polygon() -> Vec<Vec<Vec2>> {
    vec![[(-1.0, -1.0), (1.0, -1.0), (0.9, 0.8), (-1.0, 1.0)].map(Vec2::from).to_vec(), vec![Vec2::ZERO, Vec2::X * 0.5, Vec2::Y * 0.5]]
}

/// Signed value of an implicit equation in object space: the surface is where it changes sign.
type Implicit = fn(Vec3) -> f32;
/// Name, shape, equation, and which of its points belong to the shape.
type Subject = (&'static str, Shape, Implicit, fn(Vec3) -> bool);

fn subjects(m: Mat4) -> Vec<Subject> {
    vec![
        ("sphere", Shape::Sphere(Sphere::from_transform(Vec3::ZERO, 1.0, m, false).unwrap()), |p| p.length() - 1.0, |_| true),
        ("disk", Shape::Disk(Disk::from_transform(m, false).unwrap()), |p| p.z, |p| p.truncate().length() <= 1.0),
        ("rectangle", Shape::Rectangle(Rectangle::from_transform(m, false).unwrap()), |p| p.z, |p| p.truncate().abs().max_element() <= 1.0),
        (
            "cylinder",
            Shape::Cylinder(Cylinder::from_transform(Vec3::ZERO, Vec3::Z, 1.0, m, false).unwrap()),
            |p| p.truncate().length() - 1.0,
            |p| (0.0..=1.0).contains(&p.z),
        ),
        ("plane", Shape::Plane(Plane::from_transform(m, false).unwrap()), |p| p.z, |_| true),
        (
            "polygon",
            Shape::Polygon(Polygon::from_transform(&polygon(), m, false).unwrap()),
            |p| p.z,
            |p| {
                let q = p.truncate();
                // The outer contour's slanted sides, and the hole.
                let outer = q.x >= -1.0 && q.y >= -1.0 && q.x <= 1.0 - 0.1 * (q.y + 1.0) / 1.8 && q.y <= 0.8 + 0.2 * (0.9 - q.x) / 1.9;
                outer && !(q.x > 0.0 && q.y > 0.0 && q.x + q.y < 0.5)
            },
        ),
    ]
}

/// Hits are where a fine march along the ray finds the implicit equation's sign to change.
#[test]
fn hits_agree_with_implicit_equations() {
    for scale in [Vec3::splat(0.8), Vec3::new(0.5, 1.4, -0.8)] {
        let m = placed(scale);
        let inverse = m.inverse();
        for (name, shape, implicit, within) in subjects(m) {
            let (mut hits, mut differing) = (0, 0);
            for i in 0..1500 {
                let d = (rnd3(2 * i) - 0.5) * 2.0;
                let mut ray = Ray::new(m.transform_point3((rnd3(2 * i + 1) - 0.5) * 4.0), d);
                ray.t_max = 3.0;
                let hit = shape.intersect(&ray);
                if let Some(h) = hit {
                    hits += 1;
                    let p = ray.at(h.t);
                    assert!(implicit(inverse.transform_point3(p)).abs() < 2e-5, "{name} ray {i}");
                    let s = shape.surface(p);
                    assert!((s.p - p).length() < 2e-5 && (s.ng.length() - 1.0).abs() < 1e-5, "{name}: {p} {s:?}");
                    assert!((s.uv - Vec2::new(h.u, h.v)).abs().max_element() < 1e-4, "{name}: {h:?} {s:?}");
                    let b = shape.bounds();
                    assert!(s.p.cmpge(b.min - 1e-6).all() && s.p.cmple(b.max + 1e-6).all(), "{name}: {} outside {b:?}", s.p);
                    // Open at both ends.
                    ray.t_max = h.t;
                    assert!(shape.intersect(&ray).is_none(), "{name}: t_max is excluded");
                    ray.t_max = 3.0;
                    ray.t_min = h.t;
                    assert!(shape.intersect(&ray).is_none_or(|n| n.t > h.t), "{name}: t_min is excluded");
                    ray.t_min = 0.0;
                }
                let steps = 4000;
                let at = |k: u32| inverse.transform_point3(ray.at(3.0 * k as f32 / steps as f32));
                let first = (0..steps).find(|&k| (implicit(at(k)) < 0.0) != (implicit(at(k + 1)) < 0.0) && within(at(k)));
                let agree = match (first, hit) {
                    (None, None) => true,
                    (Some(k), Some(h)) => (h.t - 3.0 * k as f32 / steps as f32).abs() < 0.01,
                    _ => false,
                };
                differing += u32::from(!agree);
            }
            assert!(hits > 60, "{name}: only {hits} hits");
            // The march misses grazing hits and blurs borders.
            assert!(differing <= 8, "{name}: {differing} rays differ, {hits} hit");
        }
    }
}

#[test]
fn derivatives_agree_with_finite_differences() {
    for scale in [Vec3::splat(0.8), Vec3::new(0.5, 1.4, -0.8)] {
        for (name, shape, _, _) in subjects(placed(scale)) {
            for i in 0..200 {
                let p = match shape.sample_area(Vec2::new(0.05 + 0.9 * rnd(2 * i), 0.05 + 0.9 * rnd(2 * i + 1))) {
                    Some(s) => s.p,
                    None => rnd3(i),
                };
                let s = shape.surface(p);
                for (along_u, dp, dn) in [(true, s.dpdu, s.dndu), (false, s.dpdv, s.dndv)] {
                    let h = 2e-3 / dp.length();
                    let (a, b) = (shape.surface(s.p - dp * h), shape.surface(s.p + dp * h));
                    let duv = b.uv - a.uv;
                    let (moved, other) = if along_u { (duv.x, duv.y) } else { (duv.y, duv.x) };
                    if moved.abs() > 0.5 || duv.abs().max_element() > 0.5 {
                        continue; // Across the seam.
                    }
                    assert!((moved - 2.0 * h).abs() < 0.05 * h, "{name}: moved {moved} for {}", 2.0 * h);
                    assert!(other.abs() < 2e-3, "{name}: the other parameter moved by {other}");
                    assert!(((b.ng - a.ng) - dn * 2.0 * h).length() < 4e-4, "{name}: {} {}", b.ng - a.ng, dn * 2.0 * h);
                }
                assert!(s.dpdu.dot(s.ng).abs() < 1e-4 * s.dpdu.length() && s.dpdv.dot(s.ng).abs() < 1e-4 * s.dpdv.length(), "{name}");
            }
        }
    }
}

/// Orientation as in Mitsuba 3.9.1, from `ray_intersect` on each shape under mirrors.
#[test]
fn normals_under_mirrors() {
    let m = |x: f32, y: f32, z: f32| Mat4::from_scale(Vec3::new(x, y, z));
    let normal = |name: &str, m: Mat4, flip: bool| {
        let shape = subjects_with_flip(name, m, flip);
        shape.surface(Vec3::new(0.6, 0.0, if name == "sphere" { 0.8 } else { 0.0 })).ng
    };
    for (name, out) in [("sphere", Vec3::new(0.6, 0.0, 0.8)), ("rectangle", Vec3::Z), ("disk", Vec3::Z), ("cylinder", Vec3::X)] {
        let signs = match name {
            "sphere" => [1.0, -1.0, -1.0, -1.0],
            "rectangle" => [1.0, -1.0, 1.0, 1.0],
            "disk" => [1.0, 1.0, -1.0, -1.0],
            _ => [1.0; 4],
        };
        for (m, sign) in [m(1.0, 1.0, 1.0), m(-1.0, 1.0, 1.0), m(1.0, 1.0, -1.0), m(-1.0, -1.0, -1.0)].into_iter().zip(signs) {
            assert!((normal(name, m, false) - out * sign).length() < 1e-5, "{name} {m}");
            assert!((normal(name, m, true) + out * sign).length() < 1e-5, "{name} {m}");
        }
    }
}

fn subjects_with_flip(name: &str, m: Mat4, flip: bool) -> Shape {
    match name {
        "sphere" => Shape::Sphere(Sphere::from_transform(Vec3::ZERO, 1.0, m, flip).unwrap()),
        "rectangle" => Shape::Rectangle(Rectangle::from_transform(m, flip).unwrap()),
        "disk" => Shape::Disk(Disk::from_transform(m, flip).unwrap()),
        _ => Shape::Cylinder(Cylinder::from_transform(Vec3::ZERO, Vec3::Z, 1.0, m, flip).unwrap()),
    }
}

/// Far and small spheres are still met where they are, and rays that leave a surface do not meet it again.
#[test]
fn far_tiny_and_leaving() {
    for (center, r) in [(Vec3::new(1e6, 2e6, -1e6), 1e4), (Vec3::new(0.0, 0.0, 100.0), 1e-2), (Vec3::ZERO, 1e-6), (Vec3::ZERO, 1e6)] {
        let s = Sphere::new(center, r).unwrap();
        for i in 0..500 {
            let n = warp::uniform_sphere(Vec2::new(rnd(2 * i), rnd(2 * i + 1)));
            let g = s.surface(center + n * r);
            assert!(((g.p - center).length() - r).abs() < 4e-7 * (center.length() + r));
            let towards = Ray::new(center + n * (3.0 * r), -n * 0.37);
            let h = s.intersect(&towards).expect("a ray to the center hits");
            assert!((h.t * 0.37 - 2.0 * r).abs() < 1e-5 * r + 1e-6 * center.length());
            let eps = 1e-6 * (center.abs().max_element() + r);
            let d = warp::uniform_sphere(Vec2::new(rnd(7777 + i), rnd(9999 + i)));
            let d = if d.dot(g.ng) < 0.0 { -d } else { d };
            assert!(s.intersect(&Ray::new(g.p + g.ng * eps, d)).is_none(), "sphere {r} leaves itself");
        }
    }
}

#[test]
fn hostile_input_makes_no_shape() {
    let singular = Mat4::from_scale(Vec3::new(1.0, 0.0, 0.0));
    let nan = Mat4::from_translation(Vec3::NAN);
    let infinite = Mat4::from_scale(Vec3::INFINITY);
    for m in [singular, nan, infinite, Mat4::ZERO, Mat4::from_scale(Vec3::splat(1e30)), Mat4::from_scale(Vec3::splat(1e-30))] {
        assert!(Sphere::from_transform(Vec3::ZERO, 1.0, m, false).is_none(), "{m}");
        assert!(Cylinder::from_transform(Vec3::ZERO, Vec3::Z, 1.0, m, false).is_none());
        assert!(Disk::from_transform(m, false).is_none());
        assert!(Rectangle::from_transform(m, false).is_none());
        assert!(Plane::from_transform(m, false).is_none());
        assert!(Polygon::from_transform(&polygon(), m, false).is_none());
    }
    for r in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(Sphere::new(Vec3::ZERO, r).is_none());
        assert!(Cylinder::from_transform(Vec3::ZERO, Vec3::Z, r, Mat4::IDENTITY, false).is_none());
    }
    assert!(Cylinder::from_transform(Vec3::Z, Vec3::Z, 1.0, Mat4::IDENTITY, false).is_none());
    let make = |c: &[Vec<Vec2>]| Polygon::from_transform(c, Mat4::IDENTITY, false);
    assert!(make(&[]).is_none() && make(&[vec![]]).is_none() && make(&[vec![Vec2::ONE; 5]]).is_none());
    assert!(make(&[vec![Vec2::ZERO, Vec2::X, Vec2::NAN]]).is_none());
    assert!(make(&[vec![Vec2::ZERO, Vec2::X, Vec2::ONE], vec![Vec2::ZERO, Vec2::X, Vec2::ONE]]).is_none(), "a contour twice is empty");

    for (name, shape, _, _) in subjects(Mat4::IDENTITY) {
        for (o, d) in [
            (Vec3::NAN, Vec3::Z),
            (Vec3::ZERO, Vec3::NAN),
            (Vec3::ONE, Vec3::ZERO),
            (Vec3::INFINITY, Vec3::Z),
            (Vec3::Z, Vec3::X * f32::INFINITY),
        ] {
            if let Some(h) = shape.intersect(&Ray::new(o, d)) {
                assert!(h.t > 0.0 && h.t.is_finite(), "{name} {o} {d}: {h:?}");
            }
        }
    }
}
