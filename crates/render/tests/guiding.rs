//! Guided paths: the light of others, with less noise where light comes through a gap, and chosen where that is so.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

mod support;

use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use std::f32::consts::FRAC_PI_2;
use support::statistics::{Blocks, assert_same};
use support::*;

/// A closed room.
fn room() -> SceneDesc {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    let red = add(&mut desc, BsdfDesc::Diffuse { reflectance: Color::Constant([0.6, 0.2, 0.1]), alpha: None });
    let [white, red] = [white, red].map(|side| bsdf(&mut desc, BsdfDesc::TwoSided { front: side, back: side }));
    rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, Some(white));
    rectangle(&mut desc, Vec3::new(0.0, 0.0, 2.0), [1.0; 2], true, Some(white));
    for (turn, wall) in [
        (Mat4::from_rotation_x(-FRAC_PI_2), white),
        (Mat4::from_rotation_x(FRAC_PI_2), white),
        (Mat4::from_rotation_y(-FRAC_PI_2), white),
        (Mat4::from_rotation_y(FRAC_PI_2), red),
    ] {
        let place = Mat4::from_translation(Vec3::Z) * turn * Mat4::from_translation(Vec3::NEG_Z);
        shape(&mut desc, GeometryDesc::Rectangle, place, Some(wall));
    }
    perspective(&mut desc, Vec3::new(0.0, -0.95, 0.9), Vec3::new(0.0, 1.0, 0.8), 70.0);
    desc
}

/// The room, lit by a lamp on a shelf below the ceiling that hides it from most of the room.
fn cove() -> SceneDesc {
    let mut desc = room();
    let white = diffuse(&mut desc, 0.6);
    let shelf = bsdf(&mut desc, BsdfDesc::TwoSided { front: white, back: white });
    rectangle(&mut desc, Vec3::new(0.3, 0.3, 1.6), [0.35; 2], false, Some(shelf));
    let lamp = sphere(&mut desc, Vec3::new(0.3, 0.3, 1.75), 0.08, Some(white));
    emit(&mut desc, lamp, Color::Constant([40.0, 35.0, 30.0]));
    desc
}

/// The room, lit by a lamp in a shade that is open above.
fn shade() -> SceneDesc {
    let mut desc = room();
    let white = diffuse(&mut desc, 0.6);
    let paper = bsdf(&mut desc, BsdfDesc::TwoSided { front: white, back: white });
    let [p0, p1] = [1.2, 1.75].map(|z| Vec3::new(0.45, 0.4, z));
    shape(&mut desc, GeometryDesc::Cylinder { p0, p1, radius: 0.15 }, Mat4::IDENTITY, Some(paper));
    rectangle(&mut desc, p0, [0.15; 2], false, Some(paper));
    let lamp = sphere(&mut desc, Vec3::new(0.45, 0.4, 1.3), 0.05, Some(white));
    emit(&mut desc, lamp, Color::Constant([1200.0, 1050.0, 850.0]));
    desc
}

/// Balls of what guides do and do not know: gloss with and without a diffuse part, mirrors, glass, frosted glass, and a mask.
fn with_balls(mut desc: SceneDesc) -> SceneDesc {
    for (i, model) in
        [plastic(0.5, false, Some(0.2)), plastic(0.5, false, None), mirror(Some(0.3)), glass(1.5, None), glass(1.5, Some(0.4))]
            .into_iter()
            .enumerate()
    {
        let material = bsdf(&mut desc, model);
        sphere(&mut desc, Vec3::new(0.36 * i as f32 - 0.72, 0.1, 0.5), 0.17, Some(material));
    }
    let white = diffuse(&mut desc, 0.7);
    let mask = bsdf(&mut desc, BsdfDesc::Mask { nested: white, opacity: Param::Constant(0.5) });
    rectangle(&mut desc, Vec3::new(0.0, 0.3, 0.9), [0.5, 0.2], false, Some(mask));
    desc
}

fn with(guiding: &str, max_splits: u32, spp: u32) -> RenderSettings {
    RenderSettings { guiding: Some(guiding.into()), max_splits: Some(max_splits), ..settings(32, 24, spp) }
}

/// Guided paths bring the same light, alone and split, whatever is in their way, and end by roulette without a bias.
#[test]
fn guided_paths_agree_with_others() {
    let mut foggy = cove();
    let phase = PhaseDesc::HenyeyGreenstein { g: 0.3 };
    let fog = add(&mut foggy, MediumDesc::Homogeneous { sigma_a: [0.05; 3], sigma_s: [0.2; 3], emission: [0.0; 3], phase });
    foggy.cameras[0].value.medium = Some(fog);
    let mut window = room();
    window.shapes.remove(2);
    constant_sky(&mut window, 2.0);
    for (name, desc) in [("a cove", cove()), ("balls", with_balls(cove())), ("fog", foggy), ("a missing wall", with_balls(window))] {
        let pictures = |s: &RenderSettings| Blocks::of_seeds(&desc, s, 8);
        let others = pictures(&with("off", 16, 48));
        for max_splits in [1, 16] {
            let guided = pictures(&with("on", max_splits, 24));
            assert_same(&format!("guided paths in {name}, splits {max_splits}"), &guided, &others, 0.0, 0.15);
        }
    }
}

/// Where light comes by way of a small patch they have less noise for each camera ray, and a trial says that they have for each second.
#[test]
fn guided_paths_are_chosen_where_they_pay() {
    let notes = |desc: &SceneDesc, integrator: &str| {
        let settings = RenderSettings { integrator: Some(integrator.into()), ..settings(320, 240, 1) };
        let mut session = session(desc, &settings);
        session.render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent).unwrap();
        session.notes().join("\n")
    };
    let said = notes(&shade(), "path");
    assert!(said.contains("path: guided, which has"), "{said}");
    let said = notes(&shade(), "auto");
    assert!(said.contains("auto: guided path tracing;"), "{said}");
    // The light of a lamp in plain view is found well without.
    let mut plain = room();
    let white = diffuse(&mut plain, 0.6);
    let lamp = rectangle(&mut plain, Vec3::new(0.0, 0.0, 1.99), [0.3; 2], true, Some(white));
    emit(&mut plain, lamp, Color::gray(4.0));
    let said = notes(&plain, "path");
    assert!(!said.contains("guided"), "{said}");

    let variance = |guiding: &str| {
        let settings = RenderSettings { guiding: Some(guiding.into()), max_splits: Some(1), ..settings(320, 240, 8) };
        let blocks = Blocks::new(&[render(&shade(), &settings)], 8);
        blocks.variance.iter().flatten().sum::<f64>()
    };
    let [guided, others] = ["on", "off"].map(variance);
    println!("variance {guided} instead of {others}");
    assert!(guided < 0.6 * others, "{guided} instead of {others}");
}

/// What is learned is a function of scene, settings and seed: parts of a picture merge to the whole.
#[test]
fn guided_pictures_do_not_depend_on_threads_or_parts() {
    assert_passes_merge(&cove(), &with("on", 4, 5));
}

/// Nothing to learn: no light, nothing but a mirror, nothing at all.
#[test]
fn scenes_without_anything_to_learn_render() {
    let mut mirrors = scene();
    let silver = bsdf(&mut mirrors, mirror(None));
    sphere(&mut mirrors, Vec3::ZERO, 1.0, Some(silver));
    constant_sky(&mut mirrors, 1.0);
    perspective(&mut mirrors, Vec3::new(0.0, -4.0, 0.0), Vec3::ZERO, 40.0);
    let mut nothing = scene();
    constant_sky(&mut nothing, 1.0);
    perspective(&mut nothing, Vec3::new(0.0, -4.0, 0.0), Vec3::ZERO, 40.0);
    for (desc, expected) in [(room(), 0.0), (mirrors, 1.0), (nothing, 1.0)] {
        let film = render(&desc, &with("on", 1, 4));
        let image = film.develop();
        let values = image.channel("G").unwrap();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        assert!((mean - expected).abs() < 0.05 + 0.2 * expected, "{mean} instead of {expected}");
    }
}

#[test]
fn unknown_guidings_are_refused() {
    let settings = with("always", 1, 1);
    let plan = etendue_render::session::job::Plan::new(&room(), &settings, None).unwrap();
    let message = match etendue_render::session::job::prepare(&room(), &settings, &plan, &[]) {
        Ok(_) => panic!("an unknown name was taken"),
        Err(e) => e.to_string(),
    };
    assert!(message.contains("no guiding `always`; there are auto, on, off"), "{message}");
}
