//! Methods with photons sample the sky where it is seen from rooms: the light stays the same.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

mod support;

use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use std::f32::consts::FRAC_PI_2;
use support::statistics::{Blocks, assert_same};
use support::*;

/// A room with a window, a table and a screen that is half there, under a sky with a sun.
fn room() -> SceneDesc {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    let white = bsdf(&mut desc, BsdfDesc::TwoSided { front: white, back: white });
    rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, Some(white));
    rectangle(&mut desc, Vec3::new(0.0, 0.0, 2.0), [1.0; 2], true, Some(white));
    let wall = |turn: Mat4| Mat4::from_translation(Vec3::Z) * turn * Mat4::from_translation(Vec3::NEG_Z);
    for turn in [Mat4::from_rotation_x(FRAC_PI_2), Mat4::from_rotation_y(-FRAC_PI_2), Mat4::from_rotation_y(FRAC_PI_2)] {
        shape(&mut desc, GeometryDesc::Rectangle, wall(turn), Some(white));
    }
    // The wall with the window: four parts around it.
    for (center, half) in [([0.0, -0.75], [1.0, 0.25]), ([0.0, 0.75], [1.0, 0.25]), ([-0.7, 0.0], [0.3, 0.5]), ([0.7, 0.0], [0.3, 0.5])] {
        let part = Mat4::from_translation(Vec3::new(center[0], center[1], 0.0)) * Mat4::from_scale(Vec3::new(half[0], half[1], 1.0));
        shape(&mut desc, GeometryDesc::Rectangle, wall(Mat4::from_rotation_x(-FRAC_PI_2)) * part, Some(white));
    }
    rectangle(&mut desc, Vec3::new(0.3, 0.2, 0.5), [0.3; 2], false, Some(white));
    sphere(&mut desc, Vec3::new(-0.4, 0.3, 0.3), 0.3, Some(white));
    let paper = diffuse(&mut desc, 0.6);
    let screen = bsdf(&mut desc, BsdfDesc::Mask { nested: paper, opacity: Param::Constant(0.5) });
    rectangle(&mut desc, Vec3::new(0.5, 0.7, 1.0), [0.2; 2], false, Some(screen));
    let (width, height) = (32, 16);
    let texel = |i: u32| if i == 4 * width + 13 { [900.0, 800.0, 600.0] } else { [0.5, 0.7, 1.0].map(|c| c * (1.0 + (i % 5) as f32)) };
    let image = picture(&mut desc, width, height, 3, (0..width * height).flat_map(texel).collect());
    let world_from_light = Mat4::from_rotation_x(FRAC_PI_2);
    add(
        &mut desc,
        LightDesc::Environment { image, scale: [1.0; 3], world_from_light, mapping: EnvironmentMapping::Equirectangular, portal: None },
    );
    perspective(&mut desc, Vec3::new(0.0, -0.95, 0.9), Vec3::new(0.0, 1.0, 0.8), 70.0);
    desc
}

fn by(integrator: &str, spp: u32) -> RenderSettings {
    RenderSettings { integrator: Some(integrator.into()), max_depth: Some(1), ..settings(32, 24, spp) }
}

#[test]
fn rooms_have_the_light_of_paths_through_a_window() {
    let desc = room();
    let paths = Blocks::of_seeds(&desc, &by("path", 256), 8);
    let photons = Blocks::of_seeds(&desc, &by("sppm", 64), 8);
    assert_same("direct light of sppm", &photons, &paths, 0.0, 0.2);
}

#[test]
fn rooms_do_not_depend_on_threads_or_parts() {
    assert_passes_merge(&room(), &by("sppm", 4));
}
