//! Different ways to the same light agree: Z-tests over picture blocks.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::film::Film;
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use std::f64::consts::PI;
use support::statistics::{Blocks, ROUNDING, assert_known, assert_same};
use support::*;

/// A room of six walls with a large light, a ball of each kind of scattering and a glowing sphere.
fn room() -> SceneDesc {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    let red = add(&mut desc, BsdfDesc::Diffuse { reflectance: Color::Constant([0.6, 0.2, 0.1]), alpha: None });
    let wall = |desc: &mut SceneDesc, m: Mat4, b| shape(desc, GeometryDesc::Rectangle, m, Some(b));
    wall(&mut desc, Mat4::from_scale(Vec3::splat(2.0)), white);
    wall(&mut desc, facing(Vec3::new(0.0, 0.0, 3.0), [2.0; 2], true), white);
    wall(
        &mut desc,
        Mat4::from_translation(Vec3::new(-2.0, 0.0, 1.5)) * Mat4::from_rotation_y(1.570_796_4) * Mat4::from_scale(Vec3::splat(2.0)),
        red,
    );
    wall(
        &mut desc,
        Mat4::from_translation(Vec3::new(0.0, 2.0, 1.5)) * Mat4::from_rotation_x(1.570_796_4) * Mat4::from_scale(Vec3::splat(2.0)),
        white,
    );
    for (i, model) in [plastic(0.5, false, Some(0.2)), mirror(Some(0.3)), glass(1.5, Some(0.4))].into_iter().enumerate() {
        let material = bsdf(&mut desc, model);
        sphere(&mut desc, Vec3::new(1.2 * i as f32 - 1.2, 0.0, 0.5), 0.5, Some(material));
    }
    let light = rectangle(&mut desc, Vec3::new(0.0, 0.0, 2.9), [1.2; 2], true, Some(white));
    emit(&mut desc, light, Color::Constant([2.0, 1.5, 1.0]));
    let glow = sphere(&mut desc, Vec3::new(-0.8, 1.2, 1.8), 0.4, Some(white));
    emit(&mut desc, glow, Color::gray(3.0));
    constant_sky(&mut desc, 0.4);
    perspective(&mut desc, Vec3::new(1.0, -5.0, 2.0), Vec3::new(0.0, 0.0, 1.0), 40.0);
    desc
}

fn base(spp: u32) -> RenderSettings {
    RenderSettings { max_depth: Some(4), ..settings(24, 24, spp) }
}

/// Three pictures with seeds of their own.
fn films(desc: &SceneDesc, s: &RenderSettings, first_seed: u64) -> Vec<Film> {
    render_seeds(desc, s, first_seed..first_seed + 3)
}

fn naive_films(desc: &SceneDesc, s: &RenderSettings, max_depth: u32) -> Vec<Film> {
    (0..3)
        .map(|i| {
            let s = RenderSettings { seed: 100 + i, ..s.clone() };
            finish(session_of(compile(desc, &s), Box::new(naive::Naive { max_depth }), &s), &s)
        })
        .collect()
}

const EDGE: usize = 6;

#[test]
fn path_tracing_agrees_with_the_naive_kind_and_so_does_every_light_sampler() {
    let desc = room();
    let reference = Blocks::new(&naive_films(&desc, &base(512), 4), EDGE);
    for (i, lights) in ["bvh", "power", "uniform"].into_iter().enumerate() {
        let s = RenderSettings { light_sampler: Some(lights.into()), ..base(64) };
        let blocks = Blocks::new(&films(&desc, &s, 10 * i as u64), EDGE);
        assert_same(&format!("light sampler {lights}"), &blocks, &reference, ROUNDING, 0.03);
    }
}

#[test]
fn masks_panes_and_media_agree_with_the_naive_kind_at_every_depth() {
    let mut desc = room();
    let white = diffuse(&mut desc, 0.5);
    let mask = bsdf(&mut desc, BsdfDesc::Mask { nested: white, opacity: Param::Constant(0.5) });
    rectangle(&mut desc, Vec3::new(0.5, 0.0, 1.8), [0.9; 2], false, Some(mask));
    let pane = bsdf(&mut desc, pane(1.5));
    rectangle(&mut desc, Vec3::new(-0.5, 0.0, 2.2), [1.0; 2], false, Some(pane));
    for depth in [0, 1, 3] {
        let reference = Blocks::new(&naive_films(&desc, &base(512), depth), EDGE);
        let s = RenderSettings { max_depth: Some(depth), ..base(128) };
        assert_same(&format!("see-through depth {depth}"), &Blocks::new(&films(&desc, &s, 0), EDGE), &reference, ROUNDING, 0.12);
    }
}

#[test]
fn roulette_and_samplers_change_the_noise_only() {
    let desc = room();
    let deep = |spp| RenderSettings { max_depth: Some(12), ..base(spp) };
    let late = RenderSettings { rr_depth: Some(1000), ..deep(96) };
    let reference = Blocks::new(&films(&desc, &late, 50), EDGE);
    let early = RenderSettings { rr_depth: Some(0), ..deep(96) };
    assert_same("roulette", &Blocks::new(&films(&desc, &early, 0), EDGE), &reference, ROUNDING, 0.04);
    for sampler in ["sobol", "stratified", "halton"] {
        let s = RenderSettings { sampler: Some(sampler.into()), rr_depth: Some(3), ..deep(64) };
        assert_same(&format!("sampler {sampler}"), &Blocks::new(&films(&desc, &s, 20), EDGE), &reference, ROUNDING, 0.04);
    }
}

#[test]
fn direct_is_path_of_depth_one() {
    let desc = room();
    let direct = RenderSettings { integrator: Some("direct".into()), max_depth: None, ..base(32) };
    let path = RenderSettings { max_depth: Some(1), ..base(32) };
    // The same algorithm with the same numbers: the pictures are equal.
    assert_eq!(render(&desc, &direct).develop(), render(&desc, &path).develop());
    assert_same(
        "direct",
        &Blocks::new(&films(&desc, &direct, 0), EDGE),
        &Blocks::new(&naive_films(&desc, &base(512), 1), EDGE),
        ROUNDING,
        0.05,
    );
}

#[test]
fn instances_are_what_they_are_copies_of() {
    // Balls, a mirrored turned mesh, and a light inside the group.
    let placements = [
        Mat4::from_translation(Vec3::new(-1.2, 0.0, 0.0)) * Mat4::from_rotation_z(0.7),
        Mat4::from_translation(Vec3::new(1.2, 0.3, 0.2)) * Mat4::from_scale(Vec3::new(-0.8, 1.1, 1.0)),
    ];
    let build = |instanced: bool| {
        let mut desc = scene();
        let white = diffuse(&mut desc, 0.7);
        let shiny = bsdf(&mut desc, plastic(0.4, false, Some(0.2)));
        // Of a sphere under a mirroring transform the inside is the front, as in Mitsuba; under a mirroring instance it is not.
        let both_sides = bsdf(&mut desc, BsdfDesc::TwoSided { front: white, back: white });
        rectangle(&mut desc, Vec3::ZERO, [4.0; 2], false, Some(white));
        constant_sky(&mut desc, 0.3);
        let parts = |desc: &mut SceneDesc, m: Mat4| {
            let cube = m * Mat4::from_translation(Vec3::new(0.0, 0.0, 0.5)) * Mat4::from_scale(Vec3::new(0.5, 0.3, 0.4));
            let cube = shape(desc, GeometryDesc::Cube, cube, Some(shiny));
            let place = m * Mat4::from_translation(Vec3::new(0.2, -0.8, 0.4)) * Mat4::from_scale(Vec3::splat(0.3));
            let ball = shape(desc, GeometryDesc::Sphere { center: Vec3::ZERO, radius: 1.0 }, place, Some(both_sides));
            let place = m * facing(Vec3::new(0.0, 0.0, 1.6), [0.4; 2], true);
            let light = shape(desc, GeometryDesc::Rectangle, place, Some(white));
            emit(desc, light, Color::gray(5.0));
            vec![cube, ball, light]
        };
        if instanced {
            let shapes = parts(&mut desc, Mat4::IDENTITY);
            let group = add(&mut desc, GroupDesc { shapes });
            for world_from_object in placements {
                add(&mut desc, InstanceDesc { group, world_from_object });
            }
        } else {
            for m in placements {
                parts(&mut desc, m);
            }
        }
        perspective(&mut desc, Vec3::new(0.5, -6.0, 3.0), Vec3::new(0.0, 0.0, 0.6), 40.0);
        desc
    };
    let (a, b) = (films(&build(true), &base(64), 0), films(&build(false), &base(64), 30));
    assert_same("instances", &Blocks::new(&a, EDGE), &Blocks::new(&b, EDGE), ROUNDING, 0.03);
}

#[test]
fn whitted_of_diffuse_surfaces_and_point_lights_is_direct_light() {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.8);
    rectangle(&mut desc, Vec3::ZERO, [50.0; 2], false, Some(white));
    let mut irradiance = 0.0;
    for (p, intensity) in [(Vec3::new(1.0, 2.0, 2.0), 3.0), (Vec3::new(-2.0, 0.0, 1.0), 5.0), (Vec3::new(0.0, 0.0, 9.0), 81.0)] {
        add(&mut desc, LightDesc::Point { position: p, intensity: [intensity; 3] });
        let d = f64::from(p.length());
        irradiance += f64::from(intensity) / (d * d) * f64::from(p.z) / d;
    }
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 0.5), Vec3::ZERO, 1e-3);
    let whitted = RenderSettings { integrator: Some("whitted".into()), max_depth: None, ..base(2) };
    assert_known("whitted", &[render(&desc, &whitted)], 24, [0.8 / PI * irradiance; 3], 1e-3);
    let path = RenderSettings { max_depth: Some(1), ..base(64) };
    assert_same("whitted, path", &Blocks::new(&films(&desc, &path, 0), EDGE), &Blocks::new(&[render(&desc, &whitted)], EDGE), 1e-3, 0.02);
}

#[test]
fn filters_keep_the_light_of_a_picture() {
    // A light patch well inside of an even picture: what a filter takes from one pixel it gives to others.
    let mut desc = scene();
    constant_sky(&mut desc, 0.5);
    let spot = rectangle(&mut desc, Vec3::ZERO, [0.3, 0.2], false, None);
    emit(&mut desc, spot, Color::Constant([4.0, 2.0, 1.0]));
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO, 1.0);
    let s = RenderSettings { max_depth: Some(0), ..base(256) };
    let known = |c: f64| 0.5 + 0.06 * (c - 0.5);
    let expected = [4.0, 2.0, 1.0].map(known);
    for filter in ["box", "tent", "gaussian", "mitchell", "blackman-harris", "lanczos"] {
        let s = RenderSettings { filter: Some(filter.into()), ..s.clone() };
        let blocks = Blocks::new(&films(&desc, &s, 0), 24);
        // The sum of weights divides: with few samples and negative weights that is off by a little.
        assert_same(&format!("filter {filter}"), &blocks, &blocks.known(expected), 2e-3, 0.01);
    }
}

/// Paths that split bring the same light as those that do not: among glossy balls, behind a mask and in fog. And they bring it with less
/// noise for each camera ray.
#[test]
fn split_paths_agree_with_single_ones() {
    let mut masked = room();
    let white = diffuse(&mut masked, 0.7);
    let mask = bsdf(&mut masked, BsdfDesc::Mask { nested: white, opacity: Param::Constant(0.5) });
    shape(&mut masked, GeometryDesc::Rectangle, look_at(Vec3::new(0.3, -1.5, 1.0), Vec3::new(1.0, -5.0, 2.0)), Some(mask));
    let mut foggy = room();
    let phase = PhaseDesc::HenyeyGreenstein { g: 0.3 };
    let fog = add(&mut foggy, MediumDesc::Homogeneous { sigma_a: [0.02; 3], sigma_s: [0.08; 3], emission: [0.0; 3], phase });
    foggy.cameras[0].value.medium = Some(fog);
    for (name, desc) in [("a room", room()), ("a mask", masked), ("fog", foggy)] {
        let with = |max_splits, first_seed| {
            let s = RenderSettings { max_splits: Some(max_splits), max_depth: Some(8), ..base(48) };
            Blocks::new(&films(&desc, &s, first_seed), 8)
        };
        let (split, single) = (with(16, 40), with(1, 50));
        assert_same(&format!("split paths in {name}"), &split, &single, 0.0, 0.1);
        let variance = |b: &Blocks| b.variance.iter().flatten().sum::<f64>();
        assert!(variance(&split) < 0.95 * variance(&single), "{name}: {} instead of {}", variance(&split), variance(&single));
    }
}
