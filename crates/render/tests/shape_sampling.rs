//! Statistics of the shapes' sampling: chi-square against the densities, irradiance against closed forms, areas.

#![allow(clippy::unwrap_used)]

use etendue_render::accel::Ray;
use etendue_render::math::hash::{mix32, unit_float};
use etendue_render::math::{Frame, Mat4, PI, TAU, Vec2, Vec3};
use etendue_render::shape::{AreaSample, Cylinder, Disk, Polygon, Rectangle, Shape, Sphere, triangle};
use glam::{EulerRot, Quat};

fn rnd(i: u32) -> f32 {
    unit_float(mix32(i))
}

fn rnd2(i: u32) -> Vec2 {
    Vec2::new(rnd(2 * i), rnd(2 * i + 1))
}

fn turned() -> Mat4 {
    Mat4::from_quat(Quat::from_euler(EulerRot::XYZ, 0.4, -0.9, 1.7))
}

fn placed(scale: Vec3) -> Mat4 {
    Mat4::from_translation(Vec3::new(0.3, -0.2, 0.5)) * turned() * Mat4::from_scale(scale)
}

fn star() -> Vec<Vec<Vec2>> {
    // A pentagram, whose middle is outside by the even–odd rule, and a square with a square hole beside it.
    let p = |i: u32| Vec2::from_angle(i as f32 * TAU * 2.0 / 5.0);
    let square = |s: f32| [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| Vec2::new(2.0 + x, y)).to_vec();
    vec![(0..5).map(p).collect(), square(0.8), square(0.3)]
}

fn shapes() -> Vec<(&'static str, Shape)> {
    let uneven = Vec3::new(0.5, 1.4, 0.8);
    let p = |r: f32| (Vec3::new(0.1, 0.2, 0.3), r);
    let sphere = |(c, r): (Vec3, f32), s| Shape::Sphere(Sphere::from_transform(c, r, placed(s), false).unwrap());
    let ends = (Vec3::new(0.0, 0.1, -0.4), Vec3::new(0.2, 0.0, 0.7));
    let shear = Mat4::from_cols_array(&[1.0, 0.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    vec![
        ("sphere", sphere(p(0.7), Vec3::splat(1.2))),
        ("ellipsoid", sphere(p(0.7), uneven)),
        ("disk", Shape::Disk(Disk::from_transform(placed(uneven), false).unwrap())),
        ("rectangle", Shape::Rectangle(Rectangle::from_transform(placed(uneven), false).unwrap())),
        ("parallelogram", Shape::Rectangle(Rectangle::from_transform(placed(uneven) * shear, false).unwrap())),
        ("cylinder", Shape::Cylinder(Cylinder::from_transform(ends.0, ends.1, 0.4, placed(Vec3::ONE), false).unwrap())),
        ("elliptic cylinder", Shape::Cylinder(Cylinder::from_transform(ends.0, ends.1, 0.4, placed(uneven), false).unwrap())),
        ("polygon", Shape::Polygon(Polygon::from_transform(&star(), placed(uneven), false).unwrap())),
    ]
}

const CORNERS: [Vec3; 3] = [Vec3::new(-0.8, 0.1, 0.2), Vec3::new(0.9, -0.3, 0.5), Vec3::new(0.1, 0.7, -0.6)];

/// Something with hits and a density per solid angle.
struct Subject<'a> {
    name: String,
    ref_p: Vec3,
    sample: &'a dyn Fn(Vec2) -> Option<AreaSample>,
    /// The density of a direction, summed over all hits along it.
    pdf: &'a dyn Fn(Vec3) -> f32,
}

/// Pearson's test over cells of direction: no cell without density is hit, and counts follow the integral of the density.
fn chi_square(s: &Subject, max_sigma: f64) {
    let n = 60_000;
    let dirs: Vec<Vec3> = (0..n).filter_map(|i| (s.sample)(rnd2(i))).map(|a| (a.p - s.ref_p).normalize()).collect();
    assert!(dirs.len() as f32 > 0.99 * n as f32, "{}: {} samples of {n}", s.name, dirs.len());
    let axis = dirs.iter().sum::<Vec3>().normalize_or(Vec3::Z);
    let frame = Frame::from_normal(axis);
    // 1 − cos from the chord: keeps its digits for narrow cones.
    let omc = |d: Vec3| 0.5 * (d - axis).length_squared();
    let max = dirs.iter().map(|&d| omc(d)).fold(0.0f32, f32::max) * 1.000_01;
    let (rows, cols, sub) = (8usize, 16usize, 30usize);
    let mut hits = vec![0.0f64; rows * cols];
    for &d in &dirs {
        let l = frame.local_from_world(d);
        let phi = (f64::from(l.y).atan2(f64::from(l.x)) / std::f64::consts::TAU).rem_euclid(1.0);
        let row = ((omc(d) / max * rows as f32) as usize).min(rows - 1);
        hits[row * cols + ((phi * cols as f64) as usize).min(cols - 1)] += 1.0;
    }
    let (mut chi2, mut dof, mut total) = (0.0, -1.0f64, 0.0);
    let cell = f64::from(max) * std::f64::consts::TAU / (rows * cols) as f64;
    for (i, &observed) in hits.iter().enumerate() {
        let (mut sum, mut sum2) = (0.0, 0.0);
        for j in 0..sub * sub {
            let jitter = rnd2(1_000_000 + (i * sub * sub + j) as u32);
            let u = ((i / cols) as f32 + ((j / sub) as f32 + jitter.x) / sub as f32) / rows as f32;
            let v = ((i % cols) as f32 + ((j % sub) as f32 + jitter.y) / sub as f32) / cols as f32;
            let d = etendue_render::math::warp::uniform_cone(Vec2::new(u, v), max);
            let pdf = f64::from((s.pdf)(frame.world_from_local(d)));
            sum += pdf;
            sum2 += pdf * pdf;
        }
        let points = (sub * sub) as f64;
        let scale = cell * dirs.len() as f64;
        let expected = sum / points * scale;
        total += expected / dirs.len() as f64;
        // The integral over a cell has an error of its own, large where the density has a pole (a cylinder's silhouette).
        let variance = (sum2 / points - (sum / points).powi(2)) / points;
        assert!(expected > 0.0 || observed <= 30.0, "{}: {observed} hits in a cell without density", s.name);
        if expected > 20.0 {
            chi2 += (observed - expected).powi(2) / (expected + variance * scale * scale);
            dof += 1.0;
        }
    }
    assert!((total - 1.0).abs() < 0.03, "{}: the density integrates to {total}", s.name);
    let sigma = (chi2 - dof) / (2.0 * dof.max(1.0)).sqrt();
    assert!(sigma < max_sigma, "{}: chi2 {chi2} for {dof} degrees of freedom", s.name);
}

fn pdf_of_shape(shape: &Shape, ref_p: Vec3, d: Vec3) -> f32 {
    let mut ray = Ray::new(ref_p, d);
    ray.t_min = 1e-6;
    let mut sum = 0.0;
    while let Some(h) = shape.intersect(&ray) {
        let s = shape.surface(ray.at(h.t));
        sum += shape.pdf_solid_angle(ref_p, s.p, s.ng);
        ray.t_min = h.t * (1.0 + 1e-5) + 1e-5;
    }
    sum
}

#[test]
fn solid_angle_samples_follow_their_density() {
    let refs = [Vec3::new(3.0, 1.0, -2.0), Vec3::new(0.9, 1.5, 1.2), Vec3::new(-20.0, 30.0, 5.0)];
    for (name, shape) in shapes() {
        for (k, &ref_p) in refs.iter().enumerate() {
            for i in 0..2000 {
                if let Some(a) = shape.sample_solid_angle(ref_p, rnd2(i)) {
                    let pdf = shape.pdf_solid_angle(ref_p, a.p, a.ng);
                    assert!((pdf - a.pdf).abs() <= 2e-3 * a.pdf, "{name} from {ref_p}: {} and {pdf}", a.pdf);
                    assert!((shape.surface(a.p).p - a.p).length() < 2e-6 * (1.0 + a.p.length()), "{name}: {a:?} is not on the surface");
                    assert!((shape.surface(a.p).ng - a.ng).length() < 1e-3);
                }
            }
            chi_square(
                &Subject {
                    name: format!("{name} {k}"),
                    ref_p,
                    sample: &|u| shape.sample_solid_angle(ref_p, u),
                    pdf: &|d| pdf_of_shape(&shape, ref_p, d),
                },
                5.0,
            );
        }
    }
}

/// From inside a sphere and close to the surface.
#[test]
fn spheres_from_inside_and_near() {
    for scale in [Vec3::splat(1.2), Vec3::new(0.5, 1.4, 0.8)] {
        let sphere = Shape::Sphere(Sphere::from_transform(Vec3::ZERO, 1.0, turned() * Mat4::from_scale(scale), false).unwrap());
        for q in [Vec3::new(0.1, 0.3, -0.2), Vec3::new(0.0, 0.0, 0.97), Vec3::new(0.0, 0.0, 1.01), Vec3::new(0.0, 1.0001, 0.0)] {
            let ref_p = (turned() * Mat4::from_scale(scale)).transform_point3(q);
            let nearest = |d: Vec3| {
                let ray = Ray::new(ref_p, d);
                sphere.intersect(&ray).map_or(0.0, |h| sphere.pdf_solid_angle(ref_p, ray.at(h.t), Vec3::Z))
            };
            chi_square(
                &Subject { name: format!("{scale} {q}"), ref_p, sample: &|u| sphere.sample_solid_angle(ref_p, u), pdf: &nearest },
                5.0,
            );
        }
    }
}

#[test]
fn triangle_samples_follow_their_density() {
    for ref_p in [Vec3::new(0.5, 0.9, 2.0), Vec3::new(0.1, 0.2, 0.15), Vec3::new(40.0, -30.0, 20.0), Vec3::new(2000.0, 1000.0, 3000.0)] {
        let n = triangle::normal(&CORNERS);
        let pdf = |d: Vec3| {
            let t = n.dot(CORNERS[0] - ref_p) / n.dot(d);
            let p = ref_p + d * t;
            let inside = |a: Vec3, b: Vec3| (b - a).cross(p - a).dot(n) >= 0.0;
            let hit = t > 0.0 && inside(CORNERS[0], CORNERS[1]) && inside(CORNERS[1], CORNERS[2]) && inside(CORNERS[2], CORNERS[0]);
            if hit { triangle::pdf_solid_angle(&CORNERS, ref_p, p) } else { 0.0 }
        };
        // From 2000 units away positions have too few digits for directions: only the sum is checked.
        if ref_p.length() < 1000.0 {
            let name = format!("triangle from {ref_p}");
            chi_square(&Subject { name, ref_p, sample: &|u| triangle::sample_solid_angle(&CORNERS, ref_p, u), pdf: &pdf }, 5.0);
        }
        let sum: f64 =
            (0..10_000).filter_map(|i| triangle::sample_solid_angle(&CORNERS, ref_p, rnd2(i))).map(|s| 1.0 / f64::from(s.pdf)).sum();
        let expected = f64::from(triangle::solid_angle(&CORNERS, ref_p));
        assert!((sum / 10_000.0 / expected - 1.0).abs() < 2e-3, "{ref_p}: {} and {expected}", sum / 10_000.0);
    }
}

/// Irradiance at `p` on a surface with normal `n`, for radiance 1, over a 128 × 128 grid of jittered samples.
fn irradiance(n: Vec3, p: Vec3, sample: impl Fn(Vec2) -> Option<AreaSample>) -> f64 {
    let side = 128;
    let value = |i: u32| {
        let u = (Vec2::new((i % side) as f32, (i / side) as f32) + rnd2(i)) / side as f32;
        sample(u).map_or(0.0, |s| f64::from(n.dot((s.p - p).normalize()).max(0.0)) / f64::from(s.pdf))
    };
    (0..side * side).map(value).sum::<f64>() / f64::from(side * side)
}

/// Lambert's formula for a polygon above the horizon: E = ½ Σ Γᵢ·n.
fn lambert(corners: &[Vec3], p: Vec3, n: Vec3) -> f64 {
    let d: Vec<_> = corners.iter().map(|&c| (c.as_dvec3() - p.as_dvec3()).normalize()).collect();
    let side = |i: usize| {
        let (a, b) = (d[i], d[(i + 1) % d.len()]);
        a.cross(b).normalize_or_zero().dot(n.as_dvec3()) * a.dot(b).clamp(-1.0, 1.0).acos()
    };
    (0.5 * (0..d.len()).map(side).sum::<f64>()).abs()
}

/// The part of a convex polygon above the plane at `p`.
fn clipped(corners: &[Vec3], p: Vec3, n: Vec3) -> Vec<Vec3> {
    let mut out = Vec::new();
    for (i, &a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let (ha, hb) = ((a - p).dot(n), (b - p).dot(n));
        if ha > 0.0 {
            out.push(a);
        }
        if (ha > 0.0) != (hb > 0.0) {
            out.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    out
}

#[track_caller]
fn assert_close(name: &str, value: f64, expected: f64, relative: f64) {
    assert!((value - expected).abs() <= relative * expected, "{name}: {value}, expected {expected}");
}

#[test]
fn irradiance_of_polygons_is_lamberts() {
    let m = placed(Vec3::new(1.5, 0.4, 1.0));
    let rect = Shape::Rectangle(Rectangle::from_transform(m, false).unwrap());
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| m.transform_point3(Vec3::new(x, y, 0.0)));
    let foot = m.transform_point3(Vec3::new(0.3, -0.2, 0.0));
    let up = rect.surface(foot).ng;
    let points = [foot + up * 2.0, foot + up * 0.01, foot + up * 1e-4, foot - up * 0.3 + Vec3::X, foot + Vec3::splat(50.0)];
    for p in points {
        for n in [(foot - p).normalize(), Frame::from_normal(up).s, (Frame::from_normal(up).t - up).normalize()] {
            let above = clipped(&corners, p, n);
            let expected = lambert(&above, p, n);
            let value = irradiance(n, p, |u| rect.sample_solid_angle(p, u));
            assert!(
                (value - expected).abs() <= 0.005 * expected + 1e-4 / (1.0 + p.length_squared() as f64),
                "{p} {n}: {value}, {expected}"
            );

            let above = clipped(&CORNERS, p, n);
            let expected = if above.is_empty() { 0.0 } else { lambert(&above, p, n) };
            let value = irradiance(n, p, |u| triangle::sample_solid_angle(&CORNERS, p, u));
            assert!(
                (value - expected).abs() <= 0.005 * expected + 1e-4 / (1.0 + p.length_squared() as f64),
                "{p} {n}: {value}, {expected}"
            );
        }
    }
}

#[test]
fn irradiance_of_spheres_and_disks_in_closed_form() {
    for (r, dist, scale) in [(1.0, 3.0, 1.0f32), (1.0, 1.001, 1.0), (1e-4, 1.0, 1.0), (1.0, 1e6, 1.0), (1.0, 40.0, 1e-3), (0.5, 2.0, 1e4)] {
        let at = |d: f32| Vec3::new(0.36, 0.48, 0.8) * d * scale;
        let sphere = Shape::Sphere(Sphere::new(at(dist), r * scale).unwrap());
        let to_center = at(1.0).normalize();
        let value = irradiance(to_center, Vec3::ZERO, |u| sphere.sample_solid_angle(Vec3::ZERO, u));
        // π sin² of the half-angle; close spheres cross no horizon as their normal is that to the center.
        assert_close(&format!("sphere {r} at {dist}"), value, f64::from(PI) * f64::from(r / dist).powi(2), 2e-3);
        let half = irradiance(Frame::from_normal(to_center).s, Vec3::ZERO, |u| sphere.sample_solid_angle(Vec3::ZERO, u));
        // Half below the horizon: the projected solid angle of a half disk seen edge-on, θ − sin θ cos θ.
        let theta = (f64::from(r / dist)).asin();
        let expected = if theta < 1e-2 { 2.0 / 3.0 * theta.powi(3) } else { theta - theta.sin() * theta.cos() };
        if dist < 1e5 {
            assert_close(&format!("half sphere {r} at {dist}"), half, expected, 1e-2);
        }
    }
    // A disk of radius 1 at height h, seen from d beside its axis by a parallel surface.
    let disk = Shape::Disk(Disk::from_transform(Mat4::IDENTITY, false).unwrap());
    for (h, d) in [(1.0f32, 0.0f32), (0.2, 0.5), (3.0, 2.0), (0.5, 1.5)] {
        let p = Vec3::new(d, 0.0, h);
        let value = irradiance(-Vec3::Z, p, |u| disk.sample_solid_angle(p, u));
        let (h2, d2) = (f64::from(h * h), f64::from(d * d));
        let expected = f64::from(PI) / 2.0 * (1.0 - (h2 + d2 - 1.0) / ((h2 + d2 + 1.0).powi(2) - 4.0 * d2).sqrt());
        assert_close(&format!("disk {h} {d}"), value, expected, 0.01);
    }
}

#[test]
fn areas_are_known_and_samples_are_uniform() {
    let known = |shape: &Shape, expected: f32| assert!((shape.area() / expected - 1.0).abs() < 2e-4, "{} {expected}", shape.area());
    // A prolate spheroid of half-axes 1, 1, 2: 2π (1 + 2/e · asin e), e = √(3/4).
    let e = 0.75f32.sqrt();
    let spheroid = Sphere::from_transform(Vec3::ONE, 1.0, turned() * Mat4::from_scale(Vec3::new(1.0, 1.0, 2.0)), false).unwrap();
    known(&Shape::Sphere(spheroid), TAU * (1.0 + 2.0 / e * (PI / 3.0)));
    known(&Shape::Sphere(Sphere::new(Vec3::ONE, 3.0).unwrap()), 36.0 * PI);
    known(&Shape::Disk(Disk::from_transform(placed(Vec3::new(2.0, 3.0, 0.0)), false).unwrap()), 6.0 * PI);
    known(&Shape::Rectangle(Rectangle::from_transform(placed(Vec3::new(2.0, 3.0, 0.0)), false).unwrap()), 24.0);
    // The circumference of an ellipse of half-axes 1 and 2 is 9.688 448.
    let cylinder = Cylinder::from_transform(Vec3::ZERO, Vec3::Z, 1.0, placed(Vec3::new(1.0, 2.0, 3.0)), false).unwrap();
    known(&Shape::Cylinder(cylinder), 3.0 * 9.688_448);
    // The tips of a pentagram alone (of radius 1; its inner pentagon has radius 0.381 966), and the frame.
    let tips = 5.0 * 0.381_966 * 0.587_785 - 2.5 * 0.381_966 * 0.381_966 * 0.951_057;
    let polygon = Polygon::from_transform(&star(), Mat4::IDENTITY, false).unwrap();
    known(&Shape::Polygon(polygon), tips + 1.6 * 1.6 - 0.6 * 0.6);

    for (name, shape) in shapes() {
        let n = 40_000;
        let samples: Vec<AreaSample> = (0..n).map(|i| shape.sample_area(rnd2(i)).unwrap()).collect();
        let mean = samples.iter().map(|s| f64::from(1.0 / s.pdf)).sum::<f64>() / f64::from(n);
        assert!((mean / f64::from(shape.area()) - 1.0).abs() < 0.01, "{name}: {mean} {}", shape.area());
        // Rays to the samples meet the shape there, but for a few that lie on its very border.
        let met = |s: &&AreaSample| {
            let toward = |n: Vec3| shape.intersect(&Ray::new(s.p + n * 0.01, -n)).is_some_and(|h| (h.t - 0.01).abs() < 1e-5);
            toward(s.ng) || toward(-s.ng)
        };
        let count = samples.iter().take(2000).filter(met).count();
        assert!(count >= 1996, "{name}: {count} of 2000 samples met");
    }
}
