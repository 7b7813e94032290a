//! The z-buffer against ray casting, and against what it promises.

use glam::{DVec2, DVec3};

use super::*;
use crate::accel::{Accel, Blas, BlasInput, Instance, Ray};
use crate::math::{Mat4, Vec3};

/// A small generator, so that the tests depend on nothing else (Marsaglia 2003, "Xorshift RNGs").
pub(super) struct Random(pub u64);

impl Random {
    pub(super) fn unit(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }
    fn point(&mut self, size: f32) -> Vec3 {
        Vec3::new(self.unit() - 0.5, self.unit() - 0.5, self.unit() - 0.5) * 2.0 * size
    }
}

/// Triangles of many sizes all round the origin: across the near plane, behind the eye, larger than the picture.
fn soup(count: usize, seed: u64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut r = Random(seed);
    let mut positions = Vec::new();
    for i in 0..count {
        let center = r.point(4.0);
        let size = [0.5, 0.1, 0.02, 4.0][i % 4];
        positions.extend([center + r.point(size), center + r.point(size), center + r.point(size)]);
    }
    let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    (positions, triangles)
}

fn views(size: [u32; 2]) -> Vec<View> {
    let pose = Pose::along(Vec3::new(0.1, -0.2, 0.3), Vec3::new(0.4, 0.3, -1.0));
    vec![
        View::perspective(pose, [-1.0, 1.0, -0.75, 0.75], size, 1e-3, f64::INFINITY),
        View::perspective(pose, [-0.1, 3.0, -0.5, 0.2], size, 0.5, 3.0),
        View::orthographic(pose, [-2.0, 2.0, -1.5, 1.5], size, 0.0, 100.0),
        View::perspective(pose, [-1.0, 1.0, -0.75, 0.75], size, 1e-3, f64::INFINITY).sampled_at(DVec2::new(0.3, -0.45)),
    ]
}

fn cast(accel: &Accel, view: &View, x: u32, y: u32, near: f32, far: f32) -> Option<crate::accel::Hit> {
    // `line_of_sight` of a moved view is that of its own pixel centers.
    let (o, d) = view.line_of_sight(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
    accel.intersect(&Ray { o: o.as_vec3(), d: d.as_vec3(), t_min: near, t_max: far })
}

/// Share of pixels whose nearest triangle is not that of the ray, beyond ties, and the largest relative error of the distance.
fn compare(triangles: &Triangles, accel: &Accel, view: &View, near: f32, far: f32) -> (f64, f32) {
    let buffer = draw(triangles, view, &DrawOptions::default());
    let (mut differ, mut error, mut seen) = (0, 0.0f32, 0);
    for y in 0..view.size[1] {
        for x in 0..view.size[0] {
            let hit = cast(accel, view, x, y, near, far);
            let item = buffer.at(x, y).map(|(id, depth)| {
                let located = triangles.locate(id).unwrap();
                ((located.instance, located.primitive), view.distance(depth))
            });
            match (hit, item) {
                (None, None) => {}
                (Some(h), Some((id, distance))) if (h.instance, h.prim) == id => {
                    seen += 1;
                    error = error.max((distance - h.t).abs() / h.t.max(1e-2));
                }
                _ => differ += 1,
            }
        }
    }
    assert!(seen > 1000, "the test must see something");
    (f64::from(differ) / f64::from(view.size[0] * view.size[1]), error)
}

#[test]
fn triangles_are_those_that_rays_hit() {
    for seed in 1..4 {
        let (positions, indices) = soup(300, seed);
        let accel = Accel::build(
            vec![Blas::build(BlasInput { positions: &positions, triangles: &indices, shapes: &[] })],
            vec![Instance { world_from_object: Mat4::IDENTITY, blas: 0 }],
        );
        let triangles = Triangles::from_mesh(Mesh::new(positions, indices));
        for (i, view) in views([200, 150]).iter().enumerate() {
            let (near, far) = [(1e-3, f32::INFINITY), (0.5, 3.0), (0.0, 100.0), (1e-3, f32::INFINITY)][i];
            let (differ, error) = compare(&triangles, &accel, view, near, far);
            // One pixel in a thousand may differ: rays round differently at edges.
            assert!(differ < 1e-3, "seed {seed}, view {i}: {differ}");
            assert!(error < 1e-3, "seed {seed}, view {i}: distances differ by {error}");
        }
    }
}

#[test]
fn instances_are_those_that_rays_hit() {
    let (positions, indices) = soup(60, 9);
    let mut r = Random(77);
    let transforms: Vec<Mat4> = (0..20)
        .map(|_| {
            let q = glam::Quat::from_scaled_axis(r.point(3.0));
            Mat4::from_scale_rotation_translation(Vec3::new(0.3, -0.2, 0.4), q, r.point(3.0))
        })
        .collect();
    let accel = Accel::build(
        vec![Blas::build(BlasInput { positions: &positions, triangles: &indices, shapes: &[] })],
        transforms.iter().map(|&world_from_object| Instance { world_from_object, blas: 0 }).collect(),
    );
    let placed: Vec<(u32, Option<Mat4>)> = transforms.iter().map(|m| (0, Some(*m))).collect();
    let triangles = Triangles::new(vec![Mesh::new(positions, indices)], &placed).unwrap();
    let (differ, error) = compare(&triangles, &accel, &views([200, 150])[0], 1e-3, f32::INFINITY);
    assert!(differ < 1e-3 && error < 1e-3, "{differ} {error}");
}

/// How often each of 64 × 64 pixels is covered when every triangle of a grid is drawn alone; `place` gives the corners, in pixels.
fn coverage(n: u32, mut place: impl FnMut(u32, u32) -> [f32; 2]) -> Vec<u32> {
    let mut positions = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let [x, y] = place(i, j);
            positions.push(Vec3::new(x / 32.0 - 1.0, y / 32.0 - 1.0, -1.0));
        }
    }
    let mut covered = vec![0; 64 * 64];
    let view = View::perspective(Pose::along(Vec3::ZERO, -Vec3::Z), [-1.0, 1.0, -1.0, 1.0], [64, 64], 0.1, f64::INFINITY);
    for j in 0..n {
        for i in 0..n {
            let a = j * (n + 1) + i;
            let quad = [a, a + 1, a + n + 2, a + n + 1];
            // Diagonals and windings as they come.
            let two = if (i * 7 + j * 3) % 2 == 0 {
                [[quad[0], quad[1], quad[2]], [quad[3], quad[2], quad[0]]]
            } else {
                [[quad[1], quad[2], quad[3]], [quad[1], quad[3], quad[0]]]
            };
            for t in two {
                let one = Triangles::from_mesh(Mesh::new(positions.clone(), vec![t]));
                for (n, item) in covered.iter_mut().zip(draw(&one, &view, &DrawOptions::default()).items) {
                    *n += u32::from(item != NO_ITEM);
                }
            }
        }
    }
    covered
}

#[test]
fn meshes_have_no_cracks_and_no_pixel_is_drawn_twice() {
    let mut r = Random(5);
    let mut jittered = |i: u32, j: u32| {
        let inner = i > 0 && j > 0 && i < 12 && j < 12;
        let mut at = |k: u32| (k as f32 + if inner { 0.7 * (r.unit() - 0.5) } else { 0.0 }) * 8.0 - 16.0;
        [at(i), at(j)]
    };
    assert!(coverage(12, &mut jittered).iter().all(|n| *n == 1));
    // Edges exactly through pixel centers, in rows and columns.
    for swap in [false, true] {
        let place = |i: u32, j: u32| {
            let [x, y] = [i as f32 * 8.0 - 16.3, j as f32 * 8.0 - 15.5];
            if swap { [y, x] } else { [x, y] }
        };
        assert!(coverage(12, place).iter().all(|n| *n == 1), "{swap}");
    }
    // Corners exactly at pixel centers: nothing is missed.
    let snapped = |i: u32, j: u32| jittered(i, j).map(|v| if (i + j).is_multiple_of(3) { v.round() + 0.5 } else { v });
    assert!(coverage(12, snapped).iter().all(|n| *n >= 1));
}

#[test]
fn hostile_triangles_do_no_harm() {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -f32::MAX, 1e30, 1e-40, 0.0, -1.0, 1e18];
    let mut r = Random(3);
    let mut positions = vec![Vec3::new(-1.0, -1.0, -2.0), Vec3::new(1.0, -1.0, -2.0), Vec3::new(0.0, 1.0, -2.0)];
    let mut indices = vec![[0, 1, 2], [0, 0, 1], [0, 1, u32::MAX]];
    for _ in 0..400 {
        let first = positions.len() as u32;
        for _ in 0..3 {
            positions.push(Vec3::from_array(std::array::from_fn(|_| {
                let u = r.unit();
                if u < 0.6 { bad[(u * 16.6) as usize % bad.len()] } else { 4.0 * r.unit() - 2.0 }
            })));
        }
        indices.push([first, first + 1, first + 2]);
    }
    let triangles = Triangles::from_mesh(Mesh::new(positions, indices));
    for forward in [-Vec3::Z, Vec3::X, Vec3::new(1.0, 1.0, 1.0)] {
        let pose = Pose::along(Vec3::ZERO, forward);
        for view in [
            View::perspective(pose, [-1.0, 1.0, -1.0, 1.0], [67, 33], 1e-3, f64::INFINITY),
            View::perspective(pose, [-1.0, 1.0, -1.0, 1.0], [67, 33], f64::NAN, -1.0),
            View::perspective(pose, [0.0, 0.0, f64::NAN, 1.0], [67, 33], 1.0, 10.0),
            View::orthographic(pose, [-1.0, 1.0, -1.0, 1.0], [0, 33], -1e30, 1e30),
        ] {
            let buffer = draw(&triangles, &view, &DrawOptions::default());
            let ok = |(item, depth): (&u32, &f32)| *item == NO_ITEM || (*item < triangles.len() && !depth.is_nan());
            assert!(buffer.items.iter().zip(&buffer.depth).all(ok));
        }
    }
    let nothing = Triangles::from_mesh(Mesh::default());
    let view = View::perspective(Pose::along(Vec3::ZERO, -Vec3::Z), [-1.0, 1.0, -1.0, 1.0], [8, 8], 0.1, 10.0);
    assert!(nothing.is_empty() && draw(&nothing, &view, &DrawOptions::default()).items.iter().all(|i| *i == NO_ITEM));
}

#[test]
fn pictures_do_not_depend_on_threads_or_size_of_batches() {
    let (positions, indices) = soup(20_000, 4);
    let triangles = Triangles::from_mesh(Mesh::new(positions.clone(), indices.clone()));
    let view = views([300, 200])[0];
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| draw(&triangles, &view, &DrawOptions::default()))
    };
    assert_eq!(with(1), with(5));
    // The order of drawing does not matter but for the numbers: doubled triangles keep the lower one.
    let doubled: Vec<[u32; 3]> = indices.iter().chain(&indices).copied().collect();
    let twice = Triangles::from_mesh(Mesh::new(positions, doubled));
    assert_eq!(draw(&twice, &view, &DrawOptions::default()), with(2));
}

#[test]
fn options_hide_objects_and_pixels() {
    let positions = vec![Vec3::new(-9.0, -9.0, -2.0), Vec3::new(9.0, -9.0, -2.0), Vec3::new(0.0, 19.0, -2.0)];
    let triangles = Triangles::from_mesh(Mesh::new(positions, vec![[0, 1, 2]]));
    let view = View::perspective(Pose::along(Vec3::ZERO, -Vec3::Z), [-1.0, 1.0, -1.0, 1.0], [16, 16], 0.1, 10.0);
    let full = draw(&triangles, &view, &DrawOptions::default());
    assert!(full.items.iter().all(|i| *i == 0) && full.depth.iter().all(|d| (view.distance(*d) - 2.0).abs() < 1e-6));
    let hidden = draw(&triangles, &view, &DrawOptions { hides: Some(&|_, object| object == 0), ..DrawOptions::default() });
    assert!(hidden.items.iter().all(|i| *i == NO_ITEM));
}

#[test]
fn projections_and_lines_of_sight_are_inverse() {
    for view in views([40, 30]) {
        for (x, y) in [(0.0, 0.0), (40.0, 30.0), (7.3, 21.9)] {
            let (o, d) = view.line_of_sight(DVec2::new(x, y));
            let (pixel, distance) = view.project((o + d * 2.0).as_vec3()).unwrap();
            assert!((pixel - DVec2::new(x, y)).length() < 1e-4, "{pixel}");
            assert!((distance - 2.0).abs() < 1e-5);
        }
    }
    for face in 0..6 {
        let pose = Pose::cube_face(Vec3::ZERO, face);
        assert!((pose.right.cross(pose.up) + pose.forward).length() < 1e-12, "face {face} is mirrored");
        let expected = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z][face];
        assert!((pose.forward - expected).length() < 1e-12);
    }
}
