//! Tests of the hierarchies against brute force, across instruction sets, and on hostile input.

use super::*;
use crate::math::{Aabb, Mat4};
use crate::shape::{Shape, Sphere};

/// A small generator, so that the tests depend on nothing else (Marsaglia 2003, "Xorshift RNGs").
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn bits(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 32) as u32
    }
    pub(super) fn unit(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / (1 << 24) as f32
    }
    pub(super) fn point(&mut self, size: f32) -> Vec3 {
        Vec3::new(self.unit() - 0.5, self.unit() - 0.5, self.unit() - 0.5) * 2.0 * size
    }
}

pub(super) type Mesh = (Vec<Vec3>, Vec<[u32; 3]>);

/// Triangles of all sorts: usual, tiny, huge, axis-aligned, degenerate, doubled and broken ones.
pub(super) fn soup(count: usize, seed: u64) -> Mesh {
    let mut r = Random(seed);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..count {
        let center = r.point(1.0);
        let size = [0.2, 0.02, 1e-4, 3.0][r.bits() as usize % 4];
        let mut v = [center + r.point(size), center + r.point(size), center + r.point(size)];
        match r.bits() % 16 {
            0 => v.iter_mut().for_each(|p| p.x = center.x),
            1 => v.iter_mut().for_each(|p| *p = (*p * 8.0).round() / 8.0),
            2 => v[2] = v[0],
            3 => v[2] = (v[0] + v[1]) * 0.5,
            4 => v[1] *= 1e6,
            5 => v[r.bits() as usize % 3].y = [f32::NAN, f32::INFINITY, -1e30][r.bits() as usize % 3],
            6 if i > 8 => {
                let other: [u32; 3] = triangles[r.bits() as usize % triangles.len()];
                triangles.push(other);
                continue;
            }
            _ => {}
        }
        let first = positions.len() as u32;
        positions.extend(v);
        triangles.push([first, first + 1, first + 2]);
    }
    triangles.push([0, 1, u32::MAX]);
    (positions, triangles)
}

/// Rays of all sorts: usual ones, axis-parallel ones, ones from grid points, along planes of the grid, short ones.
pub(super) fn rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut r = Random(seed);
    let mut out = Vec::new();
    for _ in 0..count {
        let mut ray = Ray::new(r.point(1.5), r.point(1.0));
        match r.bits() % 8 {
            0 => ray.d[r.bits() as usize % 3] = 0.0,
            1 => ray.d = [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_X][r.bits() as usize % 4],
            2 => ray.o = (ray.o * 8.0).round() / 8.0,
            3 => {
                ray.o = (ray.o * 8.0).round() / 8.0;
                ray.d = (ray.d * 2.0).round() * Vec3::new(1.0, -0.0, 1.0);
            }
            4 => ray.d *= 1e-5,
            5 => (ray.t_min, ray.t_max) = (0.2, 0.2 + r.unit()),
            6 => ray.o *= 1000.0,
            _ => {}
        }
        if r.bits().is_multiple_of(4) {
            ray.d = -ray.o + r.point(0.5);
        }
        out.push(ray);
    }
    out
}

fn single(blas: Blas) -> Accel {
    Accel::build(vec![blas], vec![Instance { world_from_object: Mat4::IDENTITY, blas: 0 }])
}

pub(super) fn mesh_accel(mesh: &Mesh, shapes: &[Shape]) -> Accel {
    single(Blas::build(BlasInput { positions: &mesh.0, triangles: &mesh.1, shapes }))
}

pub(super) type Bits = Option<(u32, u32, u32, u32, u32)>;

pub(super) fn bits(h: Option<Hit>) -> Bits {
    h.map(|h| (h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.prim, h.instance))
}

/// The nearest of the hits on hierarchies of one primitive each, which have no nodes.
struct BruteForce(Vec<Accel>);

impl BruteForce {
    fn new(mesh: &Mesh, shapes: &[Shape]) -> Self {
        let one = |t: &[u32; 3]| Blas::build(BlasInput { positions: &mesh.0, triangles: &[*t], shapes: &[] });
        let shape = |s: &Shape| Blas::build(BlasInput { positions: &[], triangles: &[], shapes: std::slice::from_ref(s) });
        Self(mesh.1.iter().map(one).chain(shapes.iter().map(shape)).map(|b| single(b).with_isa(IsaKind::Portable)).collect())
    }
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (i, one) in self.0.iter().enumerate() {
            if let Some(h) = one.intersect(ray)
                && best.is_none_or(|b| h.t < b.t)
            {
                best = Some(Hit { prim: i as u32, ..h });
            }
        }
        best
    }
}

#[test]
fn all_instruction_sets_agree_with_brute_force_bit_for_bit() {
    for (count, seed) in [(0, 1), (1, 2), (3, 3), (40, 4), (600, 5), (3000, 6)] {
        let mesh = if count == 0 { (vec![], vec![]) } else { soup(count, seed) };
        let shapes: Vec<Shape> = (0..count / 20)
            .map(|i| Shape::Sphere(Sphere::new(Random(seed + i as u64 * 77 + 1).point(1.0), 0.02 + 0.0007 * i as f32).unwrap()))
            .collect();
        let brute = BruteForce::new(&mesh, &shapes);
        let mut accel = mesh_accel(&mesh, &shapes);
        assert_eq!(accel.blases()[0].validate(), Ok(()));
        let rays = rays(if count > 1000 { 600 } else { 1500 }, seed + 100);
        let expected: Vec<Bits> = rays.iter().map(|r| bits(brute.intersect(r))).collect();
        if count > 500 {
            let hits = expected.iter().flatten().count();
            assert!(hits > rays.len() / 5 && hits < rays.len(), "{hits} hits say little");
        }
        for isa in IsaKind::available() {
            accel = accel.with_isa(isa);
            assert_eq!(accel.isa(), isa);
            for (ray, e) in rays.iter().zip(&expected) {
                assert_eq!(bits(accel.intersect(ray)), *e, "{isa:?} {ray:?}, {count} triangles");
                assert_eq!(accel.occluded(ray), e.is_some(), "{isa:?} {ray:?}, {count} triangles");
            }
        }
    }
}

/// Möller and Trumbore 1997 in double precision: t, and how far inside the hit is.
fn double_precision(v: [Vec3; 3], ray: &Ray) -> (f64, f64) {
    let wide = |p: Vec3| p.to_array().map(f64::from);
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cross = |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let [a, b, c] = v.map(wide);
    let (e1, e2, d) = (sub(b, a), sub(c, a), wide(ray.d));
    let p = cross(d, e2);
    let det = dot(e1, p);
    let s = sub(wide(ray.o), a);
    let u = dot(s, p) / det;
    let q = cross(s, e1);
    let v = dot(d, q) / det;
    (dot(e2, q) / det, u.min(v).min(1.0 - u - v))
}

#[test]
fn hits_agree_with_double_precision() {
    let mut r = Random(99);
    let positions: Vec<Vec3> = (0..900).map(|_| r.point(1.0)).collect();
    let triangles: Vec<[u32; 3]> = (0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = (positions, triangles);
    let accel = mesh_accel(&mesh, &[]);
    let mut compared = 0;
    for ray in (0..2000).map(|_| Ray::new(r.point(2.0), r.point(1.0))) {
        let all: Vec<(f64, f64)> =
            mesh.1.iter().map(|t| double_precision(t.map(|i| mesh.0[i as usize]), &ray)).filter(|h| h.0 > 1e-3).collect();
        let nearest = all.iter().filter(|h| h.1 > 1e-4).map(|h| h.0).fold(f64::INFINITY, f64::min);
        if all.iter().any(|h| h.1.abs() <= 1e-4 && h.0 <= nearest) {
            continue; // an edge, where rounding decides
        }
        compared += 1;
        match accel.intersect(&Ray { t_min: 1e-3, ..ray }) {
            Some(h) => {
                assert!((f64::from(h.t) / nearest - 1.0).abs() < 1e-3, "{ray:?}: {h:?}, expected {nearest}");
                let v = mesh.1[h.prim as usize].map(|i| mesh.0[i as usize]);
                let p = v[0] * (1.0 - h.u - h.v) + v[1] * h.u + v[2] * h.v;
                assert!((p - ray.at(h.t)).length() < 1e-3, "{ray:?}: {h:?} is not on its triangle");
            }
            None => assert_eq!(nearest, f64::INFINITY, "{ray:?}"),
        }
    }
    assert!(compared > 1500);
}

#[test]
fn equal_distances_go_to_the_lowest_primitive() {
    let positions = vec![Vec3::new(-1.0, -1.0, 1.0), Vec3::new(3.0, -1.0, 1.0), Vec3::new(-1.0, 3.0, 1.0)];
    let mesh = (positions, vec![[0, 1, 2]; 100]);
    let accel = mesh_accel(&mesh, &[]);
    let hit = accel.intersect(&Ray::new(Vec3::ZERO, Vec3::Z)).unwrap();
    assert_eq!((hit.t, hit.u, hit.v, hit.prim), (1.0, 0.25, 0.25, 0));
    assert_eq!(accel.blases()[0].validate(), Ok(()));
}

/// A bumpy closed surface: latitude and longitude, with fans at the poles.
fn closed_surface(n: u32, center: Vec3, scale: f32) -> Mesh {
    let mut r = Random(7);
    let mut positions = vec![center + Vec3::Z * scale, center - Vec3::Z * scale];
    for i in 1..n {
        for j in 0..2 * n {
            let (theta, phi) = (std::f32::consts::PI * i as f32 / n as f32, std::f32::consts::PI * j as f32 / n as f32);
            let (s, c) = crate::math::fns::sin_cos(theta);
            let (sp, cp) = crate::math::fns::sin_cos(phi);
            positions.push(center + Vec3::new(s * cp, s * sp, c) * scale * (0.8 + 0.2 * r.unit()));
        }
    }
    let at = |i: u32, j: u32| 2 + (i - 1) * 2 * n + j % (2 * n);
    let mut triangles = Vec::new();
    for j in 0..2 * n {
        triangles.push([0, at(1, j), at(1, j + 1)]);
        triangles.push([1, at(n - 1, j + 1), at(n - 1, j)]);
        for i in 1..n - 1 {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    (positions, triangles)
}

#[test]
fn closed_surfaces_do_not_leak_at_edges_and_vertices() {
    for (center, scale) in [(Vec3::ZERO, 1.0), (Vec3::new(1e4, -3e4, 2e4), 1.0), (Vec3::new(0.0, 1e6, 0.0), 100.0), (Vec3::ZERO, 1e-4)] {
        let mesh = closed_surface(24, center, scale);
        let mut accel = mesh_accel(&mesh, &[]);
        for isa in IsaKind::available() {
            accel = accel.with_isa(isa);
            let mut r = Random(3);
            for t in &mesh.1 {
                let v = t.map(|i| mesh.0[i as usize]);
                let f = r.unit();
                for target in [v[0], v[1], v[0] + (v[1] - v[0]) * f, v[1] + (v[2] - v[1]) * f, v[2] + (v[0] - v[2]) * 0.5] {
                    // From well inside in all directions, and from outside through the middle.
                    let o = center + r.point(scale * 0.2);
                    for ray in [Ray::new(o, target - o), Ray::new(center, target - center), Ray::new(o, (target - o) * 1e3)] {
                        assert!(accel.intersect(&ray).is_some(), "{isa:?} leak: {ray:?}");
                        assert!(accel.occluded(&ray), "{isa:?} leak: {ray:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn axis_parallel_rays_through_grid_points_do_not_leak() {
    // Two flat sheets on a grid of whole numbers; rays run exactly through vertices and along edges' planes.
    let n = 16u32;
    for z in [0.0f32, 5.0] {
        let positions: Vec<Vec3> = (0..=n).flat_map(|i| (0..=n).map(move |j| Vec3::new(i as f32 - 8.0, j as f32 - 8.0, z))).collect();
        let at = |i: u32, j: u32| i * (n + 1) + j;
        let triangles: Vec<[u32; 3]> = (0..n)
            .flat_map(|i| {
                (0..n).flat_map(move |j| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]])
            })
            .collect();
        let accel = mesh_accel(&(positions.clone(), triangles), &[]);
        for isa in IsaKind::available() {
            let accel = mesh_accel(&(positions.clone(), vec![]), &[]).with_isa(isa);
            assert!(accel.intersect(&Ray::new(Vec3::ZERO, Vec3::Z)).is_none());
        }
        for &p in &positions {
            for (from, d) in [(Vec3::NEG_Z, Vec3::Z), (Vec3::Z * 9.0, Vec3::NEG_Z), (Vec3::Z * 9.0, Vec3::new(-0.0, 0.0, -2.0))] {
                let hit = accel.intersect(&Ray::new(p * Vec3::new(1.0, 1.0, 0.0) + from, d)).unwrap();
                assert_eq!(hit.t, ((z - from.z) / d.z).abs());
            }
        }
    }
}

#[test]
fn instances_agree_with_flattened_geometry() {
    let mesh = soup(300, 11);
    let spheres = [Shape::Sphere(Sphere::new(Vec3::new(0.1, 0.2, 0.3), 0.4).unwrap())];
    let blas = || Blas::build(BlasInput { positions: &mesh.0, triangles: &mesh.1, shapes: &spheres });
    // Powers of two and whole numbers, so that flattening rounds nothing in most coordinates.
    let turn = Mat4::from_cols_array(&[0.0, 0.5, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 2.0, 0.0, 0.0, 1.0]);
    let transforms = [Mat4::IDENTITY, turn, Mat4::from_translation(Vec3::new(0.0, 3.0, 0.0)), Mat4::from_scale(Vec3::new(-2.0, 2.0, 2.0))];
    let mut instances: Vec<Instance> = transforms.iter().map(|&world_from_object| Instance { world_from_object, blas: 0 }).collect();
    // Faults are counted and hit nothing.
    instances.push(Instance { world_from_object: Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0)), blas: 0 });
    instances.push(Instance { world_from_object: Mat4::from_translation(Vec3::NAN), blas: 0 });
    instances.push(Instance { world_from_object: Mat4::IDENTITY, blas: 9 });
    let mut accel = Accel::build(vec![blas()], instances);
    assert_eq!(accel.skipped(), 3);
    let flat: Vec<Accel> = transforms
        .iter()
        .map(|m| {
            let positions: Vec<Vec3> = mesh.0.iter().map(|&p| m.transform_point3(p)).collect();
            mesh_accel(&(positions, mesh.1.clone()), &[])
        })
        .collect();
    let rays = rays(3000, 12);
    let mut first: Vec<Bits> = Vec::new();
    for isa in IsaKind::available() {
        accel = accel.with_isa(isa);
        let (mut hits, mut differ) = (0, 0);
        let mut found = Vec::new();
        for ray in &rays {
            let hit = accel.intersect(ray);
            found.push(bits(hit));
            assert_eq!(accel.occluded(ray), hit.is_some());
            let nearest = flat.iter().filter_map(|a| a.intersect(ray)).map(|h| h.t).fold(f32::INFINITY, f32::min);
            let Some(h) = hit else {
                differ += usize::from(nearest < f32::INFINITY);
                continue;
            };
            hits += 1;
            if h.prim as usize == mesh.1.len() {
                let m = transforms[h.instance as usize].inverse();
                let p = m.transform_point3(ray.at(h.t));
                assert!(((p - Vec3::new(0.1, 0.2, 0.3)).length() - 0.4).abs() < 2e-3, "{p}");
            } else {
                differ += usize::from((h.t - nearest).abs() > 1e-3 * nearest);
            }
        }
        assert!(hits > 700, "{hits}");
        // Rounding decides at a few edges.
        assert!(differ <= rays.len() / 500, "{differ} of {hits} differ");
        if first.is_empty() {
            first = found;
        } else {
            assert!(first == found, "{isa:?} differs");
        }
    }
}

#[test]
fn many_instances_are_found() {
    let mesh = closed_surface(6, Vec3::ZERO, 0.3);
    let blas = Blas::build(BlasInput { positions: &mesh.0, triangles: &mesh.1, shapes: &[] });
    let place = |i: u32| Mat4::from_translation(Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32));
    let accel = Accel::build(vec![blas], (0..1000).map(|i| Instance { world_from_object: place(i), blas: 0 }).collect());
    for i in 0..1000 {
        let center = place(i).transform_point3(Vec3::ZERO);
        assert_eq!(accel.intersect(&Ray::new(center, Vec3::new(0.3, 0.5, -0.2))).map(|h| h.instance), Some(i));
    }
}

#[test]
fn empty_and_broken_input_hits_nothing() {
    let nothing = mesh_accel(&(vec![], vec![]), &[]);
    assert!(nothing.bounds().is_empty());
    assert_eq!(Accel::build(vec![], vec![]).intersect(&Ray::new(Vec3::ZERO, Vec3::Z)), None);
    let nan = Vec3::NAN;
    let broken = (vec![nan, Vec3::X, Vec3::Y, Vec3::INFINITY, Vec3::Z], vec![[0, 1, 2], [1, 2, 3], [1, 1, 2], [1, 2, 77], [1, 2, 4]]);
    let blas = Blas::build(BlasInput { positions: &broken.0, triangles: &broken.1, shapes: &[] });
    assert_eq!((blas.skipped(), blas.validate()), (4, Ok(())));
    let accel = single(blas);
    for a in [&nothing, &accel] {
        for ray in [
            Ray::new(nan, Vec3::Z),
            Ray::new(Vec3::ZERO, nan),
            Ray::new(Vec3::ZERO, Vec3::ZERO),
            Ray::new(Vec3::INFINITY, Vec3::Z),
            Ray::new(Vec3::ZERO, Vec3::INFINITY),
            Ray { t_min: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::ONE) },
            Ray { t_max: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::ONE) },
            Ray { t_max: -1.0, ..Ray::new(Vec3::ZERO, Vec3::ONE) },
            Ray { t_min: 2.0, t_max: 1.0, ..Ray::new(Vec3::ZERO, Vec3::ONE) },
        ] {
            assert_eq!((a.intersect(&ray), a.occluded(&ray)), (None, false), "{ray:?}");
        }
    }
    assert_eq!(accel.intersect(&Ray::new(Vec3::ZERO, Vec3::ONE)).map(|h| h.prim), Some(4));
}

#[test]
fn the_interval_is_open() {
    let mesh = (vec![Vec3::new(-1.0, -1.0, 2.0), Vec3::new(1.0, -1.0, 2.0), Vec3::new(0.0, 2.0, 2.0)], vec![[0, 1, 2]]);
    let accel = mesh_accel(&mesh, &[]);
    let ray = |t_min, t_max| Ray { o: Vec3::ZERO, d: Vec3::Z, t_min, t_max };
    for (r, hit) in [
        (ray(0.0, 2.0), false),
        (ray(0.0, 2.0f32.next_up()), true),
        (ray(2.0, 3.0), false),
        (ray(2.0f32.next_down(), 3.0), true),
        (ray(-5.0, f32::INFINITY), true),
    ] {
        assert_eq!((accel.intersect(&r).is_some(), accel.occluded(&r)), (hit, hit), "{r:?}");
    }
}

#[test]
fn the_tree_does_not_depend_on_the_number_of_threads() {
    let mesh = soup(60_000, 21);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Blas::build(BlasInput { positions: &mesh.0, triangles: &mesh.1, shapes: &[] }))
    };
    let (one, two, three) = (build(1), build(2), build(3));
    assert_eq!(one.validate(), Ok(()));
    assert!(one.words() == two.words() && one.words() == three.words(), "trees differ");
}

#[test]
fn coincident_and_nested_geometry_gives_a_tree_of_bounded_depth() {
    // All in one place: no split separates them. Sizes over 36 powers of two: one at a time splits off.
    let same = (vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]; 20_000]);
    let nested: Mesh = (
        (0..2000).flat_map(|i| [Vec3::ZERO, Vec3::X * 1.02f32.powi(i - 1000), Vec3::Y * 1.02f32.powi(i - 1000)]).collect(),
        (0..2000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
    );
    for mesh in [same, nested] {
        let accel = mesh_accel(&mesh, &[]);
        assert_eq!(accel.blases()[0].validate(), Ok(()));
        assert!(accel.occluded(&Ray::new(Vec3::new(0.1, 0.1, -1.0), Vec3::Z)));
    }
}

#[test]
fn bounds_hold_everything() {
    let mesh = closed_surface(10, Vec3::new(1.0, 2.0, 3.0), 2.0);
    let accel = mesh_accel(&mesh, &[]);
    assert_eq!(accel.bounds(), Aabb::from_points(mesh.0.iter().copied()));
    assert!(accel.bytes() > 0);
}
