//! Displaced meshes of pbrt scenes: known answers of simple heights, what is refused, and what is written.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use etendue_render::accel::Ray;
use etendue_render::math::fns;
use etendue_render::scene::{Scene, bake_displacement, displace};
use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, gltf, mitsuba, pbrt, read};
use etendue_scene::{ReadError, Severity};
use glam::{Vec2, Vec3};
use support::*;

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("etendue-displacement-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Vertices as place, normal and texture coordinates, and triangles, as a PLY file.
fn ply(path: &Path, vertices: &[(Vec3, Option<Vec3>, Vec2)], triangles: &[[u32; 3]]) {
    let normals = vertices[0].1.is_some();
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", vertices.len());
    text += "property float x\nproperty float y\nproperty float z\n";
    text += if normals { "property float nx\nproperty float ny\nproperty float nz\n" } else { "" };
    text += "property float u\nproperty float v\n";
    let _ = writeln!(text, "element face {}\nproperty list uchar int vertex_indices\nend_header", triangles.len());
    for (p, n, uv) in vertices {
        let _ = write!(text, "{} {} {} ", p.x, p.y, p.z);
        if let Some(n) = n {
            let _ = write!(text, "{} {} {} ", n.x, n.y, n.z);
        }
        let _ = writeln!(text, "{} {}", uv.x, uv.y);
    }
    for [a, b, c] in triangles {
        let _ = writeln!(text, "3 {a} {b} {c}");
    }
    std::fs::write(path, text).unwrap();
}

/// The square [−1, 1]² in the xy plane without normals, texture coordinates from 0 to 1.
fn square(folder: &Path) {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| Vec2::new(x, y));
    let vertices = corners.map(|p| (p.extend(0.0), None, 0.5 * p + 0.5));
    ply(&folder.join("square.ply"), &vertices, &[[0, 1, 2], [0, 2, 3]]);
}

/// A sphere of radius 1 with a seam and poles, with or without normals.
fn globe(folder: &Path, normals: bool) {
    let (columns, rows) = (24, 12);
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for y in 0..=rows {
        for x in 0..=columns {
            let uv = Vec2::new(x as f32 / columns as f32, y as f32 / rows as f32);
            // The seam and the poles are the same numbers from both sides.
            let (st, ct) = if y == rows { (0.0, -1.0) } else { fns::sin_cos(uv.y * std::f32::consts::PI) };
            let (sp, cp) = fns::sin_cos((x % columns) as f32 / columns as f32 * std::f32::consts::TAU);
            let p = Vec3::new(st * cp, st * sp, ct);
            vertices.push((p, normals.then_some(p), uv));
        }
    }
    let at = |x: u32, y: u32| y * (columns + 1) + x;
    for y in 0..rows {
        for x in 0..columns {
            triangles.extend([[at(x, y), at(x, y + 1), at(x + 1, y + 1)], [at(x, y), at(x + 1, y + 1), at(x + 1, y)]]);
        }
    }
    ply(&folder.join("globe.ply"), &vertices, &triangles);
}

fn try_scene(folder: &Path, body: &str) -> Result<SceneDesc, ReadError> {
    let path = folder.join("scene.pbrt");
    std::fs::write(&path, format!("Camera \"perspective\" WorldBegin LightSource \"infinite\"\n{body}")).unwrap();
    read(&path, &ReadOptions::default())
}

fn scene_of(folder: &Path, body: &str) -> SceneDesc {
    let desc = try_scene(folder, body).unwrap_or_else(|e| panic!("{e}"));
    assert!(desc.report.losses.is_empty() && desc.report.faults.is_empty(), "{:?}", desc.report);
    desc
}

/// A displaced mesh by the float texture of a text.
fn shape_of(file: &str, texture: &str, edge: f32) -> String {
    format!(
        "Texture \"h\" \"float\" {texture}\nShape \"plymesh\" \"string filename\" \"{file}.ply\" \"texture displacement\" \"h\" \
         \"float displacement.edgelength\" {edge}"
    )
}

/// Height and normal where a ray that comes down meets the scene.
fn height(scene: &Scene, x: f32, y: f32) -> (f32, Vec3) {
    let s = scene.intersect(&Ray::new(Vec3::new(x, y, 20.0), Vec3::NEG_Z)).unwrap();
    (s.p.z, s.frame.n)
}

#[test]
fn a_constant_moves_a_square_along_its_normal_in_its_own_units() {
    let folder = folder("constant");
    square(&folder);
    let shape = shape_of("square", "\"constant\" \"float value\" 0.25", 0.51);
    for (transform, expected) in [("", 0.25), ("Scale 2 2 2", 0.5), ("Scale -1 1 1", 0.25), ("ReverseOrientation", 0.25)] {
        let desc = scene_of(&folder, &format!("{transform}\n{shape}"));
        let scene = compile(&desc, &settings(4, 4, 1));
        for (x, y) in [(0.1, 0.2), (-0.7, 0.6), (0.93, -0.99)] {
            let (z, n) = height(&scene, x, y);
            assert!((z - expected).abs() < 1e-6 && n.z.abs() > 1.0 - 1e-6, "{transform}: {z} {n}");
        }
        // Legs of 1/2 and 1/√2 in turn: 0.7 is still too long. Edges are measured in the world.
        let triangles = displace(&desc).unwrap().meshes[&ShapeId(0)].triangles.len();
        assert_eq!(triangles, if transform.starts_with("Scale 2") { 256 } else { 64 }, "{transform}");
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_globe_that_grows_is_a_larger_globe_without_cracks() {
    let folder = folder("globe");
    for normals in [true, false] {
        globe(&folder, normals);
        let desc = scene_of(&folder, &shape_of("globe", "\"constant\" \"float value\" 0.5", 0.1));
        let scene = compile(&desc, &settings(4, 4, 1));
        let (mut volume, data) = (0.0, &displace(&desc).unwrap().meshes[&ShapeId(0)]);
        for t in &data.triangles {
            let [a, b, c] = t.map(|i| data.positions[i as usize].as_dvec3());
            volume += a.dot(b.cross(c)) / 6.0;
        }
        // A closed body of the volume of a sphere, less what the flat triangles of 24 × 12 cut off.
        let sphere = 4.0 / 3.0 * std::f64::consts::PI * 1.5f64.powi(3);
        assert!((volume / sphere - 0.98).abs() < 0.015, "{}", volume / sphere);
        for i in 0..500 {
            let (sin, cos) = fns::sin_cos(i as f32 * 2.4);
            let z = 1.0 - (i as f32 + 0.5) / 250.0;
            let d = Vec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z);
            let s = scene.intersect(&Ray::new(Vec3::ZERO, d)).unwrap();
            assert!((s.p.length() - 1.5).abs() < 0.02 && s.frame.n.dot(d) > 0.99, "{d}: {} {}", s.p.length(), s.frame.n.dot(d));
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_picture_of_a_displaced_globe_is_that_of_a_larger_sphere() {
    let folder = folder("picture");
    globe(&folder, true);
    let settings = etendue_scene::RenderSettings { integrator: Some("path".into()), max_depth: Some(2), ..settings(48, 48, 64) };
    let mut images = Vec::new();
    for shape in [shape_of("globe", "\"constant\" \"float value\" 0.5", 0.05), "Shape \"sphere\" \"float radius\" 1.5".to_owned()] {
        let body = format!("Translate 0 0 5 LightSource \"point\" \"point3 from\" [4 3 -6] \"rgb I\" [60 60 60]\n{shape}");
        images.push(render(&scene_of(&folder, &body), &settings).develop());
    }
    let [a, b] = [0, 1].map(|i| images[i].channel("G").unwrap());
    let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
    let off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>() / a.len() as f32;
    println!("means {} {}, mean difference {off}", mean(a), mean(b));
    assert!((mean(a) / mean(b) - 1.0).abs() < 0.01 && off < 0.02 * mean(b));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn heights_of_pictures_and_patterns_are_those_of_each_vertex() {
    let folder = folder("ramp");
    square(&folder);
    // bilerp: the height is u; a slope of 1/2 in x.
    let ramp = "\"bilerp\" \"float v00\" 0 \"float v01\" 0 \"float v10\" 1 \"float v11\" 1";
    let scene = compile(&scene_of(&folder, &shape_of("square", ramp, 0.2)), &settings(4, 4, 1));
    for (x, y) in [(0.1, 0.2), (-0.7, 0.6), (0.53, -0.9)] {
        let (z, n) = height(&scene, x, y);
        assert!((z - (0.5 * x + 0.5)).abs() < 1e-4, "{x} {y}: {z}");
        assert!(n.dot(Vec3::new(-0.5, 0.0, 1.0).normalize()).abs() > 0.9999, "{n}");
    }
    // A picture of two columns, black and white, repeated beyond its edges.
    std::fs::write(folder.join("columns.pgm"), b"P5 2 1 255\n\x00\xFF").unwrap();
    let columns = "\"imagemap\" \"string filename\" \"columns.pgm\" \"string encoding\" \"linear\" \"string filter\" \"point\"";
    let scene = compile(&scene_of(&folder, &shape_of("square", columns, 0.05)), &settings(4, 4, 1));
    assert!(height(&scene, -0.5, 0.3).0.abs() < 1e-5 && (height(&scene, 0.5, 0.3).0 - 1.0).abs() < 1e-5);
    // A pattern in space is looked up in the world: the cubes of a checkerboard, moved with their transform.
    let cubes = "\"checkerboard\" \"integer dimension\" 3 \"float tex1\" 0 \"float tex2\" 2";
    let body = format!("Translate 0.5 0.5 0.5\n{}", shape_of("square", cubes, 0.05).replace("Shape", "Identity Translate 7 0 0 Shape"));
    let scene = compile(&scene_of(&folder, &body), &settings(4, 4, 1));
    let (low, high) = (height(&scene, 6.75, 0.25).0, height(&scene, 7.0 + 0.75, 0.25).0);
    assert!(low.abs() < 1e-5 && (high - 2.0).abs() < 1e-5 || high.abs() < 1e-5 && (low - 2.0).abs() < 1e-5, "{low} {high}");
    std::fs::remove_dir_all(folder).unwrap();
}

fn faults(result: Result<SceneDesc, ReadError>) -> String {
    match result {
        Err(ReadError::Invalid { faults, .. }) => {
            let of = |f: &etendue_scene::Fault| format!("{}:{} {}", f.span.line, f.span.column, f.message);
            faults.iter().filter(|f| f.severity == Severity::Error).map(of).collect::<Vec<_>>().join("; ")
        }
        other => panic!("{:?}", other.map(|_| ())),
    }
}

#[test]
fn what_cannot_be_displaced_is_told_with_its_place() {
    let folder = folder("faults");
    square(&folder);
    let height = "\"constant\" \"float value\" 0.25";
    for edge in [0.0, -1.0] {
        let told = faults(try_scene(&folder, &shape_of("square", height, edge)));
        assert!(told.starts_with("3:1 `displacement.edgelength` must be positive"), "{told}");
    }
    let told = faults(try_scene(&folder, "Shape \"plymesh\" \"string filename\" \"square.ply\" \"texture displacement\" \"no\""));
    assert!(told.contains("no float texture `no`"), "{told}");
    std::fs::write(
        folder.join("bare.ply"),
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    )
    .unwrap();
    let told = faults(try_scene(&folder, &shape_of("bare", height, 1.0)));
    assert_eq!(told, "3:1 a displaced mesh needs texture coordinates");
    // Too many triangles: told soon, with the place.
    for edge in [1e-30, 1e-3] {
        let found = displace(&scene_of(&folder, &shape_of("square", height, edge))).unwrap_err();
        assert!(found[0].span.line == 3 && found[0].message.contains("more than 10000000 triangles"), "{found:?}");
    }
    // Heights that are no numbers leave their vertices where they are.
    std::fs::write(folder.join("one.pgm"), b"P5 1 1 255\n\xFF").unwrap();
    let mut desc = scene_of(&folder, &shape_of("square", "\"imagemap\" \"string filename\" \"one.pgm\"", 1.0));
    desc.images[0].value.source = ImageSource::Pixels { width: 1, height: 1, channels: 1, data: vec![f32::NAN] };
    let found = displace(&desc).unwrap();
    assert!(found.warnings[0].contains("heights of the displacement are no finite numbers"), "{:?}", found.warnings);
    assert!(found.meshes[&ShapeId(0)].positions.iter().all(|p| p.z == 0.0));
    assert_eq!(compile(&desc, &settings(4, 4, 1)).warnings, found.warnings);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn displacement_is_written_to_pbrt_and_baked_for_others() {
    let folder = folder("written");
    globe(&folder, true);
    let waves = "\"bilerp\" \"float v00\" 0.1 \"float v01\" 0.4 \"float v10\" 0.2 \"float v11\" 0.1";
    let two = format!(
        "{}\nTranslate 5 0 0 Shape \"plymesh\" \"string filename\" \"globe.ply\" \"float displacement\" 0.3 \"float edgelength\" 0.4",
        shape_of("globe", waves, 0.2)
    );
    let desc = scene_of(&folder, &two);
    let found = displace(&desc).unwrap().meshes;
    let out = folder.join("again.pbrt");
    assert!(pbrt::write(&desc, &out).unwrap().losses.is_empty());
    let again = displace(&read(&out, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"))).unwrap().meshes;
    assert_eq!(found.len(), 2);
    for (id, mesh) in &found {
        assert_eq!(mesh.triangles, again[id].triangles);
        assert!(mesh.positions.iter().zip(&again[id].positions).all(|(a, b)| a.distance(*b) < 1e-5));
    }
    // What the writers of other formats cannot say is a loss, or made before.
    let losses = |desc: &SceneDesc| {
        let xml = mitsuba::write(desc, &folder.join("out.xml")).unwrap().losses;
        let glb = gltf::write(desc, &folder.join("out.glb")).unwrap();
        [xml, glb].map(|l| l.iter().filter(|l| l.feature == "displacement of a mesh").count())
    };
    assert_eq!(losses(&desc), [2, 2]);
    let mut baked = desc.clone();
    bake_displacement(&mut baked).unwrap();
    assert_eq!(losses(&baked), [0, 0]);
    assert!(displace(&baked).unwrap().meshes.is_empty());
    let picture = |desc: &SceneDesc| {
        let settings = etendue_scene::RenderSettings { integrator: Some("path".into()), ..settings(16, 16, 4) };
        render(desc, &settings).develop().channel("G").unwrap().to_vec()
    };
    assert_eq!(picture(&desc), picture(&baked));
    std::fs::remove_dir_all(folder).unwrap();
}
