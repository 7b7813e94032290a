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
    ProjectionDesc::Objective(ObjectiveDesc { interfaces, film_diagonal: 0.08, focus_distance, stop: StopShape::Circle })
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

/// A lamp out of focus is as large as the stop and has its shape, and all shapes give as much light.
#[test]
fn lamps_out_of_focus_have_the_shape_of_the_stop() {
    let lamp = |stop: StopShape, distance: f32| {
        let mut desc = scene();
        let black = diffuse(&mut desc, 0.0);
        // Through a picture of which the upper left quarter is white.
        picture(&mut desc, 2, 2, 1, vec![1.0, 0.0, 0.0, 0.0]);
        let lamp = sphere(&mut desc, Vec3::new(0.0, 0.0, -distance), 0.0012 * distance, Some(black));
        emit(&mut desc, lamp, Color::gray(1000.0));
        let ProjectionDesc::Objective(mut objective) = objective(if distance < 1.5 { 3.0 } else { 0.6 }) else { panic!() };
        // Thick enough for its edge.
        (objective.interfaces[0].aperture_radius, objective.interfaces[1].thickness) = (0.01, 0.01);
        (objective.stop, objective.film_diagonal) = (stop, if distance < 1.5 { 0.003 } else { 0.02 });
        look(&mut desc, Vec3::ZERO, Vec3::NEG_Z, ProjectionDesc::Objective(objective));
        let settings = RenderSettings { max_depth: Some(0), ..settings(36, 36, 2048) };
        let image = render(&desc, &RenderSettings { integrator: Some("path".into()), ..settings }).develop();
        image.channel("G").unwrap().to_vec()
    };
    let sums = |v: &[f32]| v.iter().fold([0.0f64; 2], |s, v| [s[0] + f64::from(*v), s[1] + f64::from(v * v)]);
    let circle = sums(&lamp(StopShape::Circle, 1.0));
    let pi = std::f64::consts::PI;
    for (stop, area) in
        [(StopShape::Square, 1.0 / pi), (StopShape::Pentagon, 0.4845), (StopShape::Star, 0.3574), (StopShape::Gaussian, 0.6)]
    {
        let found = sums(&lamp(stop, 1.0));
        let (energy, spread) = (found[0] / circle[0], found[0] * found[0] / found[1] / (circle[0] * circle[0] / circle[1]));
        println!("{stop:?}: energy {energy}, area {spread}, sharp {area}");
        assert!((energy - 1.0).abs() < 0.03, "{stop:?}: {energy}");
        // The lamp's own image makes the shape a little larger.
        assert!(spread > 0.95 * area && spread < 1.7 * area, "{stop:?}: {spread} instead of {area}");
    }
    // Beyond the focus lamps show the stop upright, before it upside down.
    for (distance, side) in [(1.0, -1.0), (4.0, 1.0)] {
        let found = lamp(StopShape::Picture(ImageId(0)), distance);
        let middle = found.iter().enumerate().fold([0.0f64; 3], |s, (i, v)| {
            let v = f64::from(*v);
            [s[0] + v, s[1] + v * ((i % 36) as f64 - 17.5), s[2] + v * ((i / 36) as f64 - 17.5)]
        });
        println!("at {distance}: {} {}", middle[1] / middle[0], middle[2] / middle[0]);
        assert!(middle[1] * side < -2.0 * middle[0] && middle[2] * side < -2.0 * middle[0], "{distance}: {middle:?}");
    }
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

#[test]
fn a_stop_that_lets_nothing_through_is_refused() {
    let mut desc = room();
    picture(&mut desc, 2, 1, 1, vec![0.0, f32::NAN]);
    let ProjectionDesc::Objective(objective) = &mut desc.cameras[0].value.projection else { panic!() };
    objective.stop = StopShape::Picture(ImageId(0));
    let Err(faults) = etendue_render::scene::compile(&desc, &method("path", 1), [24, 16]) else { panic!("a black picture") };
    assert_eq!(faults[0].message, "the picture of a camera's aperture is black");
}
