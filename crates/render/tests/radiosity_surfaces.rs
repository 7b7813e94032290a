//! What radiosity makes of surfaces: sides, instances, insides of bodies, broken meshes, limits.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::accel::Ray;
use etendue_render::lightmap::SurfaceLight;
use etendue_render::radiosity::face::Faces;
use etendue_render::radiosity::{Display, Limits, Method, Progress, Settings, solve};
use etendue_scene::SceneDesc;
use etendue_scene::desc::*;
use glam::{Mat4, Vec3};
use support::radiosity::*;
use support::*;

/// A cube of corners ±1 about a place, as a mesh of some of its triangles.
fn box_mesh(desc: &mut SceneDesc, center: Vec3, triangles: std::ops::Range<usize>, is_turned: bool) -> GeometryDesc {
    let corner = |i: u32| center + Vec3::new((2 * (i & 1)) as f32 - 1.0, (i & 2) as f32 - 1.0, ((i & 4) / 2) as f32 - 1.0);
    let sides: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mut all: Vec<[u32; 3]> = sides.iter().flat_map(|s| [[s[0], s[1], s[2]], [s[0], s[2], s[3]]]).collect();
    all.iter_mut().filter(|_| is_turned).for_each(|t| t.swap(1, 2));
    let data = MeshData { positions: (0..8).map(corner).collect(), triangles: all[triangles].to_vec(), ..MeshData::default() };
    let mesh = add(desc, MeshDesc { file: None, flip_v: false, data: Some(data) });
    GeometryDesc::Mesh { mesh, face_normals: true, smooth: false }
}

#[test]
fn dark_insides_of_closed_bodies_are_left_out() {
    // What reflects on both sides has two faces for each triangle, but for those whose back is inside.
    let faces = |change: &dyn Fn(&mut SceneDesc, BsdfId)| {
        let mut desc = scene();
        let m = diffuse(&mut desc, 0.5);
        let both = add(&mut desc, BsdfDesc::TwoSided { front: m, back: m });
        change(&mut desc, both);
        // Lights outside, a point and a small patch, light no inside.
        add(&mut desc, LightDesc::Point { position: Vec3::new(0.0, 0.0, 9.0), intensity: [1.0; 3] });
        // Black on the other side.
        let lamp = rectangle(&mut desc, Vec3::new(0.3, 0.2, 8.0), [0.1; 2], true, Some(m));
        emit(&mut desc, lamp, Color::gray(1.0));
        let scene = compiled(&mut desc);
        let found = Faces::new(&scene, 100_000).unwrap();
        found.faces.len() - 2
    };
    let whole = |at: Vec3, turned: bool| {
        move |d: &mut SceneDesc, m: BsdfId| {
            let g = box_mesh(d, at, 0..12, turned);
            shape(d, g, Mat4::IDENTITY, Some(m));
        }
    };
    let closed = whole(Vec3::ZERO, false);
    assert_eq!(faces(&closed), 12);
    let nearly = |d: &mut SceneDesc, m: BsdfId| {
        for (part, off) in [(0..5, 1e-7), (5..12, 0.0)] {
            let g = box_mesh(d, Vec3::ZERO, part, false);
            shape(d, g, Mat4::from_translation(Vec3::splat(off)), Some(m));
        }
    };
    assert_eq!(faces(&nearly), 12, "corners are apart by a rounding error");
    assert_eq!(faces(&whole(Vec3::ZERO, true)), 24, "the fronts are inside");
    let with = |more: &dyn Fn(&mut SceneDesc, BsdfId)| {
        faces(&|d, m| {
            closed(d, m);
            more(d, m);
        })
    };
    let point_at = |z: f32| {
        with(&|d: &mut SceneDesc, _| {
            add(d, LightDesc::Point { position: Vec3::new(0.2, 0.1, z), intensity: [1.0; 3] });
        })
    };
    assert_eq!([point_at(0.999), point_at(1.001)], [24, 12], "a light inside, and just outside");
    assert_eq!(with(&whole(Vec3::new(0.0, 2.0, 0.0), false)), 24, "bodies that touch");
    assert_eq!(with(&whole(Vec3::new(0.5, 1.0, 0.3), false)), 24, "bodies that overlap");
    let lamp_inside = |d: &mut SceneDesc, m: BsdfId| {
        let lamp = rectangle(d, Vec3::new(0.1, 0.0, 0.9), [0.05; 2], false, Some(m));
        emit(d, lamp, Color::gray(1.0));
    };
    assert_eq!(with(&lamp_inside), 24 + 4);
    let flush = |d: &mut SceneDesc, m: BsdfId| {
        let g = box_mesh(d, Vec3::new(0.0, 0.0, -1.99), 0..12, false);
        let lamp = shape(d, g, Mat4::IDENTITY, Some(m));
        emit(d, lamp, Color::gray(1.0));
    };
    assert_eq!(with(&flush), 24, "a lamp that is let into a body a little");
    let parts = |parts: [std::ops::Range<usize>; 2]| {
        faces(&|d: &mut SceneDesc, m| {
            for part in parts.clone() {
                let g = box_mesh(d, Vec3::ZERO, part, false);
                shape(d, g, Mat4::IDENTITY, Some(m));
            }
        })
    };
    assert_eq!(parts([0..5, 5..12]), 12, "closed by two materials");
    assert_eq!(parts([0..5, 6..12]), 22, "a triangle is missing");
    let ball = |radius: f32| {
        faces(&|d: &mut SceneDesc, m| {
            sphere(d, Vec3::ZERO, 1.0, Some(m));
            add(d, LightDesc::Point { position: Vec3::new(0.0, 0.0, radius), intensity: [1.0; 3] });
        })
    };
    assert_eq!(ball(0.9), 2 * ball(1.1), "a light in a ball, and outside");
    let glass = |d: &mut SceneDesc, _: BsdfId| {
        let m = diffuse(d, 0.5);
        let both = add(d, BsdfDesc::TwoSided { front: m, back: m });
        let thin = add(d, BsdfDesc::Mask { nested: both, opacity: Param::Constant(0.5) });
        let g = box_mesh(d, Vec3::ZERO, 0..12, false);
        shape(d, g, Mat4::IDENTITY, Some(thin));
    };
    assert_eq!(faces(&glass), 24, "light passes");
}

#[test]
fn both_sides_and_instances_have_their_own_light() {
    let mut desc = scene();
    let m = diffuse(&mut desc, 0.5);
    let both = add(&mut desc, BsdfDesc::TwoSided { front: m, back: m });
    let positions = vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), Vec3::new(-1.0, 1.0, 0.0)];
    let data = MeshData { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..MeshData::default() };
    let mesh = add(&mut desc, MeshDesc { file: None, flip_v: false, data: Some(data) });
    let sheet = shape(&mut desc, GeometryDesc::Mesh { mesh, face_normals: true, smooth: false }, Mat4::IDENTITY, Some(both));
    let group = add(&mut desc, GroupDesc { shapes: vec![sheet] });
    for (x, mirror) in [(0.0, 1.0), (10.0, -1.0)] {
        let place = Mat4::from_translation(Vec3::new(x, 0.0, 0.0)) * Mat4::from_scale(Vec3::new(mirror, 1.0, 1.0));
        add(&mut desc, InstanceDesc { group, world_from_object: place });
    }
    add(&mut desc, LightDesc::Directional { direction: -Vec3::Z, irradiance: [2.0; 3] });
    add(&mut desc, LightDesc::Directional { direction: Vec3::Z, irradiance: [1.0; 3] });
    let scene = compiled(&mut desc);
    let solution = solved(&scene, &with(Method::Hierarchical, 1000));
    for x in [0.3, 10.3] {
        for (z, known) in [(1.0, 2.0), (-1.0, 1.0)] {
            let mut s = scene.intersect(&Ray::new(Vec3::new(x, 0.2, z), Vec3::new(0.0, 0.0, -z))).unwrap();
            if s.frame.n.z * z < 0.0 {
                s.frame.n = -s.frame.n;
            }
            let h = solution.irradiance(&scene, &s).rgb()[1];
            assert!((h - known).abs() < 1e-3, "x {x} z {z}: {h}");
        }
    }
}

#[test]
fn hostile_meshes_are_left_out_with_a_count() {
    let mut desc = room();
    let huge = 1e30;
    let positions = vec![
        Vec3::ZERO,
        Vec3::ZERO,
        Vec3::X,
        Vec3::splat(f32::NAN),
        Vec3::Y,
        Vec3::new(huge, 0.0, 0.0),
        Vec3::new(0.0, huge, 0.0),
        Vec3::new(f32::INFINITY, 0.0, 0.0),
        Vec3::X * 1e-30,
        Vec3::Y * 1e-30,
    ];
    let triangles = vec![[0, 1, 2], [0, 2, 3], [2, 4, 5], [0, 5, 6], [0, 4, 7], [0, 8, 9], [0, 0, 0], [0, 2, 4], [0, 2, 4], [4, 2, 0]];
    let data = MeshData { positions, triangles, ..MeshData::default() };
    let mesh = add(&mut desc, MeshDesc { file: None, flip_v: false, data: Some(data) });
    let m = diffuse(&mut desc, 1.0);
    shape(&mut desc, GeometryDesc::Mesh { mesh, face_normals: true, smooth: false }, Mat4::IDENTITY, Some(m));
    shape(&mut desc, GeometryDesc::Mesh { mesh, face_normals: true, smooth: false }, Mat4::from_scale(Vec3::ZERO), Some(m));
    shape(&mut desc, GeometryDesc::Plane, Mat4::from_translation(Vec3::new(0.0, 0.0, -5.0)), Some(m));
    add(&mut desc, LightDesc::Point { position: Vec3::splat(f32::NAN), intensity: [f32::INFINITY, 1.0, 1.0] });
    add(&mut desc, LightDesc::Point { position: Vec3::splat(0.1), intensity: [1e38; 3] });
    let scene = compiled(&mut desc);
    for method in [Method::Hierarchical, Method::Progressive, Method::Matrix] {
        let s = Settings { error: 1e-2, ..with(method, 500) };
        let solution = solved(&scene, &s);
        assert!(solution.notes.iter().any(|n| n.starts_with("triangles left out:") && n.contains("no numbers")), "{:?}", solution.notes);
        let h = irradiance(&scene, &solution, Vec3::new(-0.5, -0.5, 0.0), -Vec3::Z);
        assert!(h.iter().all(|v| v.is_finite()), "{method:?}: {h:?}");
    }
    // Nothing at all, and too much.
    let mut desc = support::scene();
    let nothing = compiled(&mut desc);
    assert!(solved(&nothing, &Settings::default()).notes.iter().any(|n| n.contains("no surfaces")));
    let error = solve(&scene, &with(Method::Matrix, 3), Display::Smooth, &Progress::silent()).err().unwrap();
    assert!(error.contains("--radiosity-elements"), "{error}");
}

#[test]
fn limits_are_kept_and_told() {
    let mut desc = room();
    let scene = compiled(&mut desc);
    let s = Settings { error: 1e-5, limits: Limits { elements: 3000, links: 20_000 }, rays: Some(4), ..Settings::default() };
    let solution = solved(&scene, &s);
    assert!(solution.notes.iter().any(|n| n.contains("limits of 3000 elements and 20000 links were met")), "{:?}", solution.notes);
}
