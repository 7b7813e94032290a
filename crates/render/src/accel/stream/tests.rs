//! Streams against single rays: the same bits, whatever the rays, the geometry and the instruction set.

use super::super::tests::{Mesh, Random, bits, mesh_accel, rays, soup};
use super::super::{Accel, BlasInput, Instance};
use super::*;
use crate::math::{Mat4, Vec3};
use crate::shape::{Plane, Shape, Sphere};

/// Fails where a stream's results differ from those of single rays.
fn compare(accel: Accel, rays: &[Ray], what: &str) {
    let mut accel = accel;
    let mut memory = StreamMemory::new();
    for isa in IsaKind::available() {
        accel = accel.with_isa(isa);
        // What stands there before does not matter.
        let mut hits = vec![Some(Hit { t: 1.0, u: 0.5, v: 0.5, prim: 7, instance: 7 }); rays.len()];
        let mut occluded: Vec<bool> = (0..rays.len()).map(|i| i % 2 == 0).collect();
        accel.intersect_stream(rays, &mut hits, &mut memory);
        accel.occluded_stream(rays, &mut occluded, &mut memory);
        for (i, ray) in rays.iter().enumerate() {
            assert_eq!(bits(hits[i]), bits(accel.intersect(ray)), "{what}, {isa:?}, ray {i}: {ray:?}");
            assert_eq!(occluded[i], accel.occluded(ray), "{what}, {isa:?}, ray {i}: {ray:?}");
        }
    }
}

/// Rays with one thing wrong each, or at the end of a range.
fn hostile() -> Vec<Ray> {
    let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, f32::MIN, f32::MAX, 1e18, 2e18, 1e-30, f32::MIN_POSITIVE, -1.0];
    let good = Ray::new(Vec3::new(0.1, -0.2, -3.0), Vec3::new(0.01, 0.05, 1.0));
    let mut out = vec![good; 20];
    for x in values {
        for k in 0..3 {
            let (mut a, mut b, mut c) = (good, good, good);
            a.o[k] = x;
            b.d[k] = x;
            c.d = Vec3::ZERO;
            c.d[k] = x;
            out.extend([a, b, c]);
        }
        out.extend([Ray { t_min: x, ..good }, Ray { t_max: x, ..good }, Ray { t_min: x, t_max: x, ..good }]);
        out.push(Ray { t_min: x, t_max: x.next_up(), ..good });
        out.push(Ray { d: Vec3::splat(x), ..good });
    }
    out
}

fn spheres(count: usize) -> Vec<Shape> {
    let sphere = |i: usize| Sphere::new(Random(i as u64 * 77 + 1).point(1.0), 0.02 + 0.01 * i as f32).unwrap();
    (0..count).map(|i| Shape::Sphere(sphere(i))).collect()
}

fn plane(z: f32) -> Shape {
    Shape::Plane(Plane::from_transform(Mat4::from_translation(Vec3::new(0.0, 0.0, z)), false).unwrap())
}

/// Rays from one place through a grid in the order of its rows.
fn bundle(n: u32, width: f32) -> Vec<Ray> {
    let at = |i: u32| (i as f32 / n as f32 - 0.5) * width;
    let ray = |i: u32| Ray::new(Vec3::new(0.1, 0.2, -4.0), Vec3::new(at(i % n), at(i / n), 1.0));
    (0..n * n).map(ray).collect()
}

#[test]
fn streams_equal_single_rays_on_triangles_and_shapes() {
    for (count, shapes) in [(0, 0), (1, 0), (0, 1), (40, 3), (600, 0), (3000, 20)] {
        let mesh = if count == 0 { (vec![], vec![]) } else { soup(count, 31 + count as u64) };
        let mut all = rays(if count > 1000 { 9000 } else { 1500 }, 32);
        all.extend(hostile());
        compare(mesh_accel(&mesh, &spheres(shapes)), &all, &format!("{count} triangles, {shapes} spheres"));
    }
}

#[test]
fn shapes_without_bounds_are_hit_by_streams() {
    let mut all = rays(600, 41);
    all.extend(hostile());
    compare(mesh_accel(&soup(100, 42), &[plane(0.5), plane(0.5), plane(-0.25)]), &all, "planes");
}

#[test]
fn equal_distances_go_to_the_lowest_number_in_streams() {
    // Each triangle four times, in leaves of their own by their number.
    let mut mesh = soup(64, 43);
    let triangles = mesh.1.clone();
    (0..3).for_each(|_| mesh.1.extend(&triangles));
    let all: Vec<Ray> = rays(3000, 44).into_iter().chain(bundle(40, 0.7)).collect();
    compare(mesh_accel(&mesh, &[]), &all, "doubled");
}

#[test]
fn coherent_bundles_fill_the_memory_of_lists_and_keep_their_hits() {
    // Huge triangles through each other: every ray enters nearly every node.
    let mut r = Random(51);
    let count = 400;
    let positions: Vec<Vec3> = (0..3 * count).map(|_| r.point(4.0)).collect();
    let mesh: Mesh = (positions, (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect());
    compare(mesh_accel(&mesh, &[]), &bundle(64, 0.05), "bundle");
    compare(mesh_accel(&mesh, &[]), &vec![Ray::new(Vec3::new(0.3, 0.2, -9.0), Vec3::Z); 4097], "one ray many times");
}

#[test]
fn instances_are_hit_by_streams() {
    let mesh = soup(300, 61);
    let blas = |mesh: &Mesh, shapes: &[Shape]| Blas::build(BlasInput { positions: &mesh.0, triangles: &mesh.1, shapes });
    let blases = || vec![blas(&mesh, &spheres(4)), blas(&soup(20, 62), &[plane(1.0)]), blas(&(vec![], vec![]), &spheres(2))];
    let mut r = Random(63);
    let place = |r: &mut Random| {
        Mat4::from_translation(r.point(2.0)) * Mat4::from_rotation_y(r.unit() * 6.0) * Mat4::from_scale(Vec3::splat(0.3) + r.point(0.25))
    };
    let mut instances: Vec<Instance> = (0..40).map(|i| Instance { world_from_object: place(&mut r), blas: [0, 0, 2][i % 3] }).collect();
    let mut all = rays(1500, 64);
    all.extend(hostile());
    all.extend(bundle(40, 1.5));
    compare(Accel::build(blases(), instances.clone()), &all, "instances");
    // The same place twice, one beyond all bounds, and faults.
    instances.extend([instances[3], Instance { blas: 1, ..instances[5] }, Instance { blas: 9, ..instances[0] }]);
    instances.push(Instance { world_from_object: Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0)), blas: 0 });
    compare(Accel::build(blases(), instances), &all, "unbounded instances");
    let moved = vec![Instance { world_from_object: Mat4::from_translation(Vec3::X), blas: 0 }];
    compare(Accel::build(blases(), moved), &all, "one that does not stand at the origin");
    compare(Accel::build(blases(), vec![Instance { world_from_object: Mat4::IDENTITY, blas: 1 }]), &all, "one without bounds");
    compare(Accel::build(vec![], vec![]), &all, "nothing");
}

#[test]
fn streams_may_have_any_length() {
    let accel = mesh_accel(&soup(200, 71), &[]);
    let all = rays(4100, 72);
    for count in (0..20).chain([4095, 4096, 4100]) {
        compare(mesh_accel(&soup(200, 71), &[]), &all[..count], "length");
    }
    // The rest of the longer slice is left alone.
    let mut memory = StreamMemory::new();
    let mark = Some(Hit { t: 3.0, u: 0.0, v: 0.0, prim: 1, instance: 1 });
    let mut hits = vec![mark; 50];
    accel.intersect_stream(&all[..20], &mut hits, &mut memory);
    assert_eq!(hits[20..], vec![mark; 30]);
    accel.intersect_stream(&all, &mut hits[..30], &mut memory);
    assert_eq!(hits[..30], all[..30].iter().map(|r| accel.intersect(r)).collect::<Vec<_>>());
}
