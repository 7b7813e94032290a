//! What `auto` chooses, and that its picture is the chosen method's.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

mod support;

use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use std::f32::consts::FRAC_PI_2;
use support::*;

const SPP: u32 = 2;

fn with(method: &str, seed: u64) -> RenderSettings {
    RenderSettings { integrator: Some(method.into()), seed, ..settings(200, 150, SPP) }
}

/// The picture, and what the method says.
fn render(desc: &SceneDesc, method: &str, seed: u64) -> (Vec<u32>, Vec<String>) {
    let mut session = session(desc, &with(method, seed));
    let stop = Stop { spp: Some(SPP), ..Stop::default() };
    session.render(&stop, &Cancel::default(), &Silent).unwrap();
    let image = session.film().develop();
    let bits = ["R", "G", "B"].iter().flat_map(|c| image.channel(c).unwrap().iter().map(|v| v.to_bits())).collect();
    (bits, session.notes())
}

/// Renders by `auto`, which has to say that it chose `method`, and say the same again, and by the method.
fn assert_chosen(desc: &SceneDesc, method: &str) {
    let (picture, notes) = render(desc, "auto", 3);
    let name = if method == "path" { "auto: path tracing;".to_owned() } else { format!("({method}), which is biased") };
    assert!(notes[0].starts_with("auto: ") && notes[0].contains(&name), "{method}: {notes:?}");
    assert_eq!(render(desc, "auto", 3), (picture.clone(), notes), "{method}: another choice or picture for the same seed");
    assert!(render(desc, method, 3).0 == picture, "{method}: another picture than the method's");
}

/// A floor, and walls and a ceiling around it where wanted.
fn floor(walls: bool) -> SceneDesc {
    let mut desc = scene();
    let side = diffuse(&mut desc, 0.7);
    let white = bsdf(&mut desc, BsdfDesc::TwoSided { front: side, back: side });
    rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, Some(white));
    perspective(&mut desc, Vec3::new(0.0, -3.9, 1.0), Vec3::new(0.0, 0.0, if walls { 1.0 } else { 0.3 }), 42.0);
    if walls {
        rectangle(&mut desc, Vec3::new(0.0, 0.0, 2.0), [1.0; 2], true, Some(white));
        for turn in [Mat4::from_rotation_x(-FRAC_PI_2), Mat4::from_rotation_y(-FRAC_PI_2), Mat4::from_rotation_y(FRAC_PI_2)] {
            let middle = Mat4::from_translation(Vec3::Z);
            shape(&mut desc, GeometryDesc::Rectangle, middle * turn * Mat4::from_translation(Vec3::NEG_Z), Some(white));
        }
    }
    desc
}

fn lamp(desc: &mut SceneDesc, center: Vec3, radius: f32) {
    let black = diffuse(desc, 0.0);
    let lamp = sphere(desc, center, radius, Some(black));
    emit(desc, lamp, Color::Constant([0.5 / (radius * radius); 3]));
}

fn glass_ball(desc: &mut SceneDesc, center: Vec3, radius: f32) {
    let glass = bsdf(desc, glass(1.5, None));
    sphere(desc, center, radius, Some(glass));
}

/// Nothing is focused: nothing is tried.
#[test]
fn rooms_without_glass_are_for_paths() {
    let mut desc = floor(true);
    lamp(&mut desc, Vec3::new(0.0, 0.0, 1.7), 0.1);
    assert_chosen(&desc, "path");
    let (_, notes) = render(&desc, "auto", 1);
    assert!(notes[0].contains("0.00%") && !notes[0].contains("pilot"), "{notes:?}");
}

/// Glass in even light: paths find all of it, and the pilot says so.
#[test]
fn glass_under_a_sky_is_for_paths() {
    let mut desc = floor(false);
    glass_ball(&mut desc, Vec3::new(0.0, 0.0, 0.4), 0.4);
    constant_sky(&mut desc, 1.0);
    assert_chosen(&desc, "path");
    let (_, notes) = render(&desc, "auto", 1);
    assert!(notes[0].contains("than") || notes[0].contains("too little"), "{notes:?}");
}

/// All light but the caustic is direct: paths are better for that.
#[test]
fn glass_on_a_floor_is_for_paths_with_a_caustic_map() {
    let mut desc = floor(false);
    glass_ball(&mut desc, Vec3::new(0.0, 0.0, 0.65), 0.4);
    lamp(&mut desc, Vec3::new(-0.9, -0.5, 1.9), 0.04);
    assert_chosen(&desc, "pathmap");
}

/// Caustics light a room again: photons are better for all of that.
#[test]
fn glass_in_a_room_is_for_photons() {
    let mut desc = floor(true);
    glass_ball(&mut desc, Vec3::new(0.5, -0.2, 0.45), 0.45);
    let mirror = bsdf(&mut desc, mirror(None));
    sphere(&mut desc, Vec3::new(-0.5, 0.3, 0.5), 0.5, Some(mirror));
    lamp(&mut desc, Vec3::new(0.0, 0.0, 1.8), 0.06);
    assert_chosen(&desc, "sppm");
}
