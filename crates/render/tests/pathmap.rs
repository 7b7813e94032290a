//! Path tracing with a caustic map: nothing is lost and nothing counts twice, at every depth, for all kinds of surfaces and lights.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use support::statistics::{Blocks, assert_same};
use support::*;

const EDGE: usize = 8;

fn method(name: &str, max_depth: u32, spp: u32) -> RenderSettings {
    RenderSettings { integrator: Some(name.into()), max_depth: Some(max_depth), photons: Some(8000), ..settings(24, 24, spp) }
}

fn blocks(desc: &SceneDesc, s: &RenderSettings) -> Blocks {
    Blocks::of_seeds(desc, s, EDGE)
}

/// The blur goes with the square of the radius: two radii tell what none would give.
fn without_radius(desc: &SceneDesc, s: &RenderSettings, radius: f32) -> Blocks {
    Blocks::without_radius(radius, |radius| blocks(desc, &RenderSettings { photon_radius: Some(radius), ..s.clone() }))
}

/// A room with glass, a mirror, rough metal and coated surfaces, so that photons come to diffuse surfaces, to glossy ones, and by both;
/// no light yet.
fn room() -> SceneDesc {
    let mut desc = scene();
    let side = bsdf(&mut desc, BsdfDesc::Diffuse { reflectance: Color::Constant([0.6, 0.5, 0.4]), alpha: None });
    let white = bsdf(&mut desc, BsdfDesc::TwoSided { front: side, back: side });
    rectangle(&mut desc, Vec3::ZERO, [2.0; 2], false, Some(white));
    rectangle(&mut desc, Vec3::new(0.0, 0.0, 3.0), [2.0; 2], true, Some(white));
    let back = Mat4::from_translation(Vec3::new(0.0, 2.0, 1.5))
        * Mat4::from_rotation_x(std::f32::consts::FRAC_PI_2)
        * Mat4::from_scale(Vec3::splat(2.0));
    shape(&mut desc, GeometryDesc::Rectangle, back, Some(white));
    let glass = bsdf(&mut desc, glass(1.5, None));
    sphere(&mut desc, Vec3::new(0.8, -0.4, 0.7), 0.6, Some(glass));
    let smooth = bsdf(&mut desc, mirror(None));
    sphere(&mut desc, Vec3::new(-1.1, 0.8, 0.6), 0.6, Some(smooth));
    let rough = bsdf(&mut desc, mirror(Some(0.3)));
    sphere(&mut desc, Vec3::new(-0.9, -0.6, 0.4), 0.4, Some(rough));
    let coated = bsdf(&mut desc, plastic(0.5, true, None));
    rectangle(&mut desc, Vec3::new(0.0, -0.8, 0.05), [0.4; 2], false, Some(coated));
    let glossy = bsdf(&mut desc, plastic(0.5, false, Some(0.15)));
    sphere(&mut desc, Vec3::new(0.1, 0.9, 0.5), 0.5, Some(glossy));
    perspective(&mut desc, Vec3::new(1.0, -5.0, 2.0), Vec3::new(0.0, 0.0, 1.0), 40.0);
    desc
}

fn lamp(desc: &mut SceneDesc) {
    let black = diffuse(desc, 0.0);
    let lamp = sphere(desc, Vec3::new(0.3, 0.0, 2.3), 0.4, Some(black));
    emit(desc, lamp, Color::Constant([5.0, 4.0, 3.0]));
}

#[test]
fn the_light_of_paths_once() {
    let mut desc = room();
    lamp(&mut desc);
    let path = Blocks::new(&render_seeds(&desc, &method("path", 6, 1024), 50..52), EDGE);
    // One block sees hardly more than the dark beyond the room.
    assert_same("pathmap", &without_radius(&desc, &method("pathmap", 6, 24), 0.12), &path, 4e-3, 0.7);
}

#[test]
fn every_depth_by_itself() {
    let mut desc = room();
    lamp(&mut desc);
    for depth in [0, 1, 2, 3] {
        let path = Blocks::new(&render_seeds(&desc, &method("path", depth, 512), 50..52), EDGE);
        let found = without_radius(&desc, &method("pathmap", depth, 16), 0.12);
        assert_same(&format!("pathmap depth {depth}"), &found, &path, 4e-3, 0.9);
    }
}

/// A sky, a smoky ball of glass, and several lamps.
#[test]
fn other_lights_and_media() {
    let mut desc = room();
    constant_sky(&mut desc, 0.7);
    lamp(&mut desc);
    let glass = bsdf(&mut desc, glass(1.3, None));
    let ball = sphere(&mut desc, Vec3::new(0.2, -1.2, 1.2), 0.4, Some(glass));
    let phase = PhaseDesc::Isotropic;
    let smoke = MediumDesc::Homogeneous { sigma_a: [0.5, 0.2, 0.1], sigma_s: [1.0; 3], emission: [0.0; 3], phase };
    let id = add(&mut desc, smoke);
    desc.shapes[ball.0 as usize].value.interior = Some(id);
    let path = Blocks::new(&render_seeds(&desc, &method("path", 6, 1024), 50..52), EDGE);
    assert_same("pathmap sky and smoke", &without_radius(&desc, &method("pathmap", 6, 24), 0.12), &path, 4e-3, 0.1);
}

/// What paths cannot find at all: a point light behind glass. A pane that bends and reflects nothing, between camera and floor, changes
/// nothing but that no other method finds the light, as all paths then begin and end with a refraction.
#[test]
fn points_behind_glass() {
    let pictures = |pane: bool, name: &str| {
        let mut desc = scene();
        let gray = diffuse(&mut desc, 0.5);
        rectangle(&mut desc, Vec3::ZERO, [6.0; 2], false, Some(gray));
        orthographic(&mut desc, Vec3::new(0.0, 0.0, 0.25), Vec3::ZERO, 1.2);
        let ball = bsdf(&mut desc, glass(1.5, None));
        sphere(&mut desc, Vec3::new(0.1, 0.0, 0.9), 0.5, Some(ball));
        add(&mut desc, LightDesc::Point { position: Vec3::new(0.4, 0.3, 2.4), intensity: [9.0, 7.0, 5.0] });
        if pane {
            // Refracts without reflecting.
            let same = bsdf(&mut desc, glass(1.0, None));
            rectangle(&mut desc, Vec3::new(0.0, 0.0, 0.2), [6.0; 2], false, Some(same));
        }
        let s = method(name, if pane { 6 } else { 4 }, if name == "light" { 512 } else { 24 });
        if name == "light" { blocks(&desc, &s) } else { without_radius(&desc, &s, 0.06) }
    };
    let light = pictures(false, "light");
    assert_same("pathmap point", &pictures(false, "pathmap"), &light, 1e-2, 0.3);
    assert_same("pathmap point behind a pane", &pictures(true, "pathmap"), &light, 1e-2, 0.3);
}

/// Without caustics the picture is that of `path`, bit for bit.
#[test]
fn nothing_to_find() {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    rectangle(&mut desc, Vec3::ZERO, [2.0; 2], false, Some(white));
    sphere(&mut desc, Vec3::new(0.0, 0.0, 0.6), 0.5, Some(white));
    lamp(&mut desc);
    perspective(&mut desc, Vec3::new(1.0, -5.0, 2.0), Vec3::new(0.0, 0.0, 1.0), 40.0);
    let [a, b] = ["path", "pathmap"].map(|name| render(&desc, &method(name, 5, 4)).develop());
    for c in ["R", "G", "B"] {
        assert!(a.channel(c).unwrap().iter().zip(b.channel(c).unwrap()).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

#[test]
fn passes_merge_exactly_and_threads_do_not_matter() {
    let mut desc = room();
    lamp(&mut desc);
    assert_passes_merge(&desc, &method("pathmap", 6, 5));
}

#[test]
fn says_what_is_biased() {
    let mut desc = room();
    lamp(&mut desc);
    let s = method("pathmap", 6, 1);
    let mut biased = session(&desc, &s);
    biased.render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent).unwrap();
    let notes = biased.notes().join(" ");
    assert!(notes.contains("biased") && notes.contains("radius") && notes.contains("shrinks"), "{notes}");
    let s = RenderSettings { photon_map: Some("x.photons".into()), ..s };
    let error = session(&desc, &s).render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent).unwrap_err();
    assert!(error.to_string().contains("cannot use a photon map"));
}
