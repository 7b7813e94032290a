//! pbrt's procedural textures and mappings: what a surface point gets of them, against their definitions, before and after `convert`.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::path::{Path, PathBuf};

use etendue_procedural::SolidPattern;
use etendue_render::accel::Ray;
use etendue_render::math::fns;
use etendue_render::scene::Scene;
use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, pbrt, read};
use glam::{Mat4, Vec2, Vec3};
use support::*;

/// A folder of its own for a test.
fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("etendue-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A sphere of radius 1 at the origin, and a square at z = 10 with texture coordinates from 0 to 1 along x and y from −1 to 1.
const SHAPES: &str = "Shape \"sphere\" \"float radius\" 1\n\
    Shape \"trianglemesh\" \"point3 P\" [-1 -1 10 1 -1 10 1 1 10 -1 1 10] \"point2 uv\" [0 0 1 0 1 1 0 1] \
        \"integer indices\" [0 1 2 0 2 3]\n";

/// The scene whose shapes reflect by the texture `t` of a text.
fn textured(folder: &Path, texture: &str) -> SceneDesc {
    let path = folder.join("scene.pbrt");
    let text = format!("WorldBegin AttributeBegin\n{texture}\nAttributeEnd\nMaterial \"diffuse\" \"texture reflectance\" \"t\"\n{SHAPES}");
    std::fs::write(&path, text).unwrap();
    read(&path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// The reflectance where rays from the outside meet the sphere in the given directions, and the square at the given places.
fn reflectances(desc: &SceneDesc, directions: &[Vec3], places: &[Vec2]) -> Vec<[f32; 3]> {
    let scene: Scene = compile(desc, &settings(4, 4, 1));
    let reflectance =
        desc.bsdfs.iter().find_map(|b| if let BsdfDesc::Diffuse { reflectance, .. } = &b.value { Some(*reflectance) } else { None });
    let towards = directions.iter().map(|d| Ray::new(3.0 * d.normalize(), -d.normalize()));
    let down = places.iter().map(|p| Ray::new(p.extend(20.0), Vec3::NEG_Z));
    let value = |ray: Ray| scene.color(&reflectance.unwrap(), &scene.intersect(&ray).unwrap()).rgb();
    towards.chain(down).map(value).collect()
}

fn directions() -> Vec<Vec3> {
    (0..60).map(|i| Vec3::new((i % 5) as f32 - 1.9, (i / 5 % 4) as f32 - 1.4, (i / 20) as f32 - 0.9)).collect()
}

fn places() -> Vec<Vec2> {
    (0..60).map(|i| Vec2::new((i % 10) as f32 * 0.19 - 0.9, (i / 10) as f32 * 0.31 - 0.85)).collect()
}

/// Where the rays meet, with texture coordinates (of the square alone).
fn points() -> Vec<(Vec3, Option<Vec2>)> {
    let sphere = directions().into_iter().map(|d| (d.normalize(), None));
    sphere.chain(places().into_iter().map(|p| (p.extend(10.0), Some(0.5 * p + 0.5)))).collect()
}

/// Compares the texture with its definition, and with itself after the scene was written and read again.
fn check(name: &str, texture: &str, define: impl Fn(Vec3, Option<Vec2>) -> Option<[f32; 3]>) {
    let folder = folder(name);
    std::fs::write(folder.join("gray.pgm"), b"P5 2 2 255\n\x99\xCC\x33\x66").unwrap();
    let desc = textured(&folder, texture);
    assert!(desc.report.losses.is_empty(), "{:?}", desc.report.losses);
    let found = reflectances(&desc, &directions(), &places());
    let (mut checked, mut off) = (0, 0);
    for ((p, uv), found) in points().into_iter().zip(&found) {
        let Some(expected) = define(p, uv) else { continue };
        checked += 1;
        off += usize::from((0..3).any(|k| !((found[k] - expected[k].clamp(0.0, 1.0)).abs() < 2e-4)));
    }
    // The surfaces' points have rounding errors, which turn what lies on an edge of a pattern.
    assert!(checked >= 60 && off <= checked / 50, "{name}: {off} of {checked} differ");
    assert!(found.iter().any(|c| (c[0] - found[0][0]).abs() > 0.05), "{name} varies");
    let out = folder.join("written.pbrt");
    let report = pbrt::write(&desc, &out).unwrap();
    assert!(report.losses.is_empty(), "{name}: {:?}", report.losses);
    let again = read(&out, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}\n{}", std::fs::read_to_string(&out).unwrap()));
    let written = reflectances(&again, &directions(), &places());
    let off = found.iter().zip(&written).filter(|(a, b)| (0..3).any(|k| !((a[k] - b[k]).abs() < 2e-4))).count();
    assert!(off <= found.len() / 50, "{name}: {off} differ after writing\n{}", std::fs::read_to_string(&out).unwrap());
    std::fs::remove_dir_all(folder).unwrap();
}

/// What stands before the texture, and the same as `texture_from_world`.
const MOVED: &str = "Translate 0.3 -0.2 0.5 Rotate 35 0 1 1 Scale 0.4 0.7 0.5\n";

fn moved() -> Mat4 {
    let turn = Mat4::from_axis_angle(Vec3::new(0.0, 1.0, 1.0).normalize(), 35f32.to_radians());
    (Mat4::from_translation(Vec3::new(0.3, -0.2, 0.5)) * turn * Mat4::from_scale(Vec3::new(0.4, 0.7, 0.5))).inverse()
}

/// A float texture as the amount between black and white.
fn amount(texture: &str) -> String {
    format!(
        "{MOVED} Texture \"n\" \"float\" {texture} Texture \"t\" \"spectrum\" \"mix\" \"rgb tex1\" [0 0 0] \"rgb tex2\" [1 1 1] \
        \"texture amount\" \"n\""
    )
}

#[test]
fn noise_is_looked_up_in_the_space_of_its_texture() {
    let octaves = "\"integer octaves\" 5 \"float roughness\" 0.6";
    for (class, pattern) in [
        (format!("\"fbm\" {octaves}"), SolidPattern::Fbm { octaves: 5, roughness: 0.6 }),
        (format!("\"wrinkled\" {octaves}"), SolidPattern::Turbulence { octaves: 5, roughness: 0.6 }),
        ("\"windy\"".to_owned(), SolidPattern::Windy),
    ] {
        check("noise", &amount(&class), |p, _| Some(pattern.color(moved().transform_point3(p))));
    }
    let marble = format!("{MOVED} Texture \"t\" \"spectrum\" \"marble\" {octaves} \"float scale\" 3 \"float variation\" 0.4");
    let pattern = SolidPattern::Marble { octaves: 5, roughness: 0.6, scale: 3.0, variation: 0.4 };
    check("marble", &marble, |p, _| Some(pattern.color(moved().transform_point3(p))));
}

#[test]
fn cubes_alternate_in_space_and_dots_over_texture_coordinates() {
    let colors = "\"rgb tex1\" [0.1 0.2 0.3] \"rgb tex2\" [0.7 0.8 0.9]";
    let cubes = format!("{MOVED} Texture \"t\" \"spectrum\" \"checkerboard\" \"integer dimension\" 3 {colors}");
    check("cubes", &cubes, |p, _| {
        let cell = moved().transform_point3(p).floor();
        Some(if (cell.x + cell.y + cell.z).rem_euclid(2.0) == 0.0 { [0.1, 0.2, 0.3] } else { [0.7, 0.8, 0.9] })
    });
    let dots = "Texture \"t\" \"spectrum\" \"dots\" \"float uscale\" 6 \"float vscale\" 5 \"rgb inside\" [0.1 0.2 0.3] \
        \"rgb outside\" [0.7 0.8 0.9]";
    check("dots", dots, |_, uv| {
        let st = uv? * Vec2::new(6.0, 5.0);
        Some(if SolidPattern::Dots.color(st.extend(0.0))[0] > 0.5 { [0.1, 0.2, 0.3] } else { [0.7, 0.8, 0.9] })
    });
}

#[test]
fn bilerp_is_linear_between_its_corners_and_beyond() {
    let corners = "\"rgb v00\" [0.1 0 0.2] \"rgb v01\" [0.2 0.4 0.1] \"rgb v10\" [0.3 0.1 0.6] \"rgb v11\" [0.9 0.2 0.3]";
    let texture = format!("Texture \"t\" \"spectrum\" \"bilerp\" {corners} \"float uscale\" 1.2 \"float vdelta\" 0.1");
    check("bilerp", &texture, |_, uv| {
        let st = uv? * Vec2::new(1.2, 1.0) + Vec2::new(0.0, 0.1);
        let at = |a: f32, b: f32, c: f32, d: f32| {
            (1.0 - st.x) * (1.0 - st.y) * a + (1.0 - st.x) * st.y * b + st.x * (1.0 - st.y) * c + st.x * st.y * d
        };
        Some([at(0.1, 0.2, 0.3, 0.9), at(0.0, 0.4, 0.1, 0.2), at(0.2, 0.1, 0.6, 0.3)])
    });
}

#[test]
fn direction_mixes_follow_the_normal() {
    let texture = "Rotate 90 1 0 0 Texture \"t\" \"spectrum\" \"directionmix\" \"rgb tex1\" [0.9 0.5 0.1] \"rgb tex2\" [0.1 0.2 0.3] \
        \"vector3 dir\" [0 2 0]";
    // A quarter turn about x takes y to z.
    check("direction", texture, |p, uv| {
        let cos = if uv.is_some() { 1.0 } else { p.z.abs() };
        Some([(0.9, 0.1), (0.5, 0.2), (0.1, 0.3)].map(|(a, b)| cos * a + (1.0 - cos) * b))
    });
}

#[test]
fn projections_give_the_coordinates() {
    let squares = |s: f32, t: f32| Some(if (s.floor() + t.floor()).rem_euclid(2.0) == 0.0 { [1.0; 3] } else { [0.0; 3] });
    let board = |mapping: &str| format!("{MOVED} Texture \"t\" \"spectrum\" \"checkerboard\" {mapping}");
    let planar = "\"string mapping\" \"planar\" \"vector3 v1\" [3 0 1] \"vector3 v2\" [0 2 -1] \"float udelta\" 0.3 \"float vdelta\" -0.2";
    check("planar", &board(planar), |p, _| {
        let q = moved().transform_point3(p);
        squares(q.dot(Vec3::new(3.0, 0.0, 1.0)) + 0.3, q.dot(Vec3::new(0.0, 2.0, -1.0)) - 0.2)
    });
    check("cylindrical", &board("\"string mapping\" \"cylindrical\""), |p, _| {
        let q = moved().transform_point3(p);
        squares(0.5 + fns::atan2(q.y, q.x) / std::f32::consts::TAU, q.z)
    });
    // Angles of spheres lie in one square: the corners of a `bilerp` show them.
    let sphere = format!(
        "{MOVED} Texture \"t\" \"spectrum\" \"bilerp\" \"string mapping\" \"spherical\" \"rgb v10\" [1 0 0] \"rgb v01\" [0 1 0] \
        \"rgb v11\" [1 1 0]"
    );
    check("spherical", &sphere, |p, _| {
        let q = moved().transform_point3(p).normalize();
        Some([fns::acos(q.z) / std::f32::consts::PI, fns::atan2(q.y, q.x).rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU, 0.0])
    });
}

/// A picture of 2 × 2 pixels, 0.6 and 0.8 above 0.2 and 0.4, on the plane x, y of the world: its four pixels, and black around them.
#[test]
fn projected_pictures_may_end_in_black() {
    let texture = "Translate -0.5 -0.5 0 Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"gray.pgm\" \"string encoding\" \
        \"linear\" \"string mapping\" \"planar\" \
        \"string wrap\" \"black\" \"string filter\" \"point\"";
    check("black", texture, |p, _| {
        let inside = p.x.abs() < 0.5 && p.y.abs() < 0.5;
        Some([if inside { 0.2 + if p.x > 0.0 { 0.2 } else { 0.0 } + if p.y > 0.0 { 0.4 } else { 0.0 } } else { 0.0 }; 3])
    });
}
