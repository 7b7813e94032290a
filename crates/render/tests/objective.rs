//! Cameras with objectives: known pictures, agreement of methods, and who refuses them.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::Vec3;
use support::statistics::{Blocks, assert_same};
use support::*;

fn method(name: &str, spp: u32) -> RenderSettings {
    RenderSettings { integrator: Some(name.into()), ..settings(24, 16, spp) }
}

/// A symmetric lens of 100 mm with a stop of 5 mm at its front.
fn objective(focus_distance: f32) -> ProjectionDesc {
    let surface = |curvature_radius, thickness, ior, aperture_radius| LensInterface { curvature_radius, thickness, ior, aperture_radius };
    let interfaces = vec![surface(0.0, 0.0, 1.0, 0.005), surface(0.1, 0.001, 1.5, 0.03), surface(-0.1, 0.1, 1.0, 0.03)];
    ProjectionDesc::Objective(ObjectiveDesc { interfaces, film_diagonal: 0.08, focus_distance })
}

fn look(desc: &mut SceneDesc, from: Vec3, to: Vec3, projection: ProjectionDesc) {
    perspective(desc, from, to, 40.0);
    desc.cameras[0].value.projection = projection;
}

/// Under an even sky the film has the irradiance of the pupil's cone, and cos⁴ of the angle to the axis of it away from the middle.
#[test]
fn the_film_darkens_with_the_fourth_power_of_the_cosine() {
    let mut desc = scene();
    constant_sky(&mut desc, 1.0);
    look(&mut desc, Vec3::ZERO, Vec3::NEG_Z, objective(3.0));
    let picture = render(&desc, &method("path", 256)).develop();
    let values = picture.channel("G").unwrap();
    // The pupil is 1/f from the film by the lens equation, less half of the lens.
    let distance = 1.0 / (1.0 / 0.1 - 1.0 / 2.9);
    let edge = 0.08 / (24.0f64 * 24.0 + 16.0 * 16.0).sqrt();
    let area = std::f64::consts::PI * 0.005 * 0.005;
    for (x, y) in [(11, 7), (0, 7), (0, 0), (23, 15), (12, 0)] {
        let off = |i: usize, n: f64| (i as f64 + 0.5 - 0.5 * n) * edge;
        let square = off(x, 24.0).powi(2) + off(y, 16.0).powi(2);
        let cos2 = distance * distance / (distance * distance + square);
        let wanted = area / (distance * distance) * cos2 * cos2;
        let found = f64::from(values[y * 24 + x]);
        assert!((found / wanted - 1.0).abs() < 0.04, "({x}, {y}): {found} instead of {wanted}");
    }
    assert!(picture.channel("A").is_none_or(|a| a.iter().all(|v| *v < 1e-3)), "a sky has no surface");
}

/// A room with a lamp, sharp in the middle.
fn room() -> SceneDesc {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    rectangle(&mut desc, Vec3::ZERO, [3.0; 2], false, Some(white));
    sphere(&mut desc, Vec3::new(0.0, 0.0, 0.4), 0.4, Some(white));
    let lamp = sphere(&mut desc, Vec3::new(0.6, 0.8, 1.5), 0.2, Some(white));
    emit(&mut desc, lamp, Color::gray(3000.0));
    look(&mut desc, Vec3::new(0.0, -3.0, 1.2), Vec3::new(0.0, 0.0, 0.4), objective(3.1));
    desc
}

#[test]
fn methods_agree() {
    let desc = room();
    let blocks = |name: &str, spp: u32| Blocks::of_seeds(&desc, &RenderSettings { max_depth: Some(4), ..method(name, spp) }, 8);
    let path = blocks("path", 128);
    for (name, spp, slack) in [("auto", 64, 2e-3), ("pathmap", 64, 2e-3), ("sppm", 24, 0.04)] {
        assert_same(name, &blocks(name, spp), &path, slack, 0.2);
    }
}

#[test]
fn who_joins_paths_to_the_camera_refuses() {
    for name in ["light", "bdpt", "vcm", "mlt"] {
        let s = method(name, 1);
        let error = session(&room(), &s).render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent).unwrap_err();
        assert!(error.to_string().contains("objective"), "{name}: {error}");
    }
}
