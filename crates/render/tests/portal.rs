//! Environment maps behind portals: samples and their density, the same light as through a hole in a wall, and agreement of methods.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::f32::consts::FRAC_PI_2;

use etendue_render::integrator::emission::EmissionSampler;
use etendue_render::light::{EnvironmentLight, Light, LightContext, PortalLight, Rows, SceneSphere};
use etendue_render::math::hash::{hash_words, unit_float};
use etendue_render::math::{Vec2, warp};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use support::statistics::{Blocks, assert_same};
use support::*;

fn rnd2(i: u32) -> Vec2 {
    Vec2::new(unit_float(hash_words([u64::from(i), 1]) as u32), unit_float(hash_words([u64::from(i), 2]) as u32))
}

/// A sky of differing texels, one of them bright.
fn texels(width: u32, height: u32) -> Vec<[f32; 3]> {
    let texel = |i: u32| if i == 4 * width + 13 { [50.0, 40.0, 30.0] } else { [0.5, 0.7, 1.0].map(|c| c * (1.0 + (i % 5) as f32)) };
    (0..width * height).map(texel).collect()
}

/// A window of 0.8 × 1 in the plane y = −1, light comes in along +y.
const WINDOW: [Vec3; 4] = [Vec3::new(-0.4, -1.0, 0.5), Vec3::new(-0.4, -1.0, 1.5), Vec3::new(0.4, -1.0, 1.5), Vec3::new(0.4, -1.0, 0.5)];

fn light() -> PortalLight {
    let map = EnvironmentLight::new((32, 16), texels(32, 16), [1.0; 3], Mat4::from_rotation_x(FRAC_PI_2), Rows::Centered).unwrap();
    PortalLight::new(map, WINDOW).unwrap()
}

/// What is seen, sampled and told of densities is one and the same light, on this side of the window alone.
#[test]
fn samples_are_the_light_that_comes_through_the_window() {
    let light = Light::Portal(Box::new(light()));
    for (p, n) in [(Vec3::new(0.1, 0.3, 0.2), Vec3::Z), (Vec3::new(-0.27, -0.9, 0.93), Vec3::NEG_Y), (Vec3::new(2.0, 1.0, 1.0), Vec3::ZERO)]
    {
        let ctx = LightContext { p, n };
        let side = 1500u32;
        let (mut expected, mut density, mut seen, mut off) = ([0.0f64; 3], 0.0f64, 0, 0);
        let norm = 4.0 * std::f64::consts::PI / f64::from(side * side);
        for i in 0..side * side {
            let wi = warp::uniform_sphere((Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) / side as f32);
            let (radiance, pdf) = (light.escaped(p, wi), light.pdf_escaped(&ctx, wi));
            // The line passes the window.
            let t = (-1.0 - p.y) / wi.y;
            let at = p + wi * t;
            let passes = t > 0.0 && at.x.abs() < 0.4 && (at.z - 1.0).abs() < 0.5;
            assert_eq!(!radiance.is_black(), pdf > 0.0, "{p} {wi}");
            // But for rounding at the window's edges.
            off += u32::from(passes != (pdf > 0.0));
            seen += u32::from(passes);
            density += f64::from(pdf) * norm;
            (0..3).for_each(|k| expected[k] += f64::from(radiance[k]) * norm);
        }
        // Half of the samples always pass, of the others those that the map sends there.
        assert!(off < 5, "{off} directions");
        assert!(seen > 1000 && density > 0.499 && density < 1.0, "{density}");
        let count = 400u32;
        let (mut sum, mut all) = ([0.0f64; 3], 0);
        for i in 0..count * count {
            let u = (Vec2::new((i % count) as f32, (i / count) as f32) + rnd2(i)) / count as f32;
            let Some(s) = light.sample(&ctx, u) else { continue };
            all += 1;
            let off = (light.escaped(p, s.wi) - s.radiance).map(f32::abs).max_component();
            assert!(off < 1e-2 * s.radiance.max_component() && s.dist == f32::INFINITY && !s.delta, "{p}: {off}");
            assert!((light.pdf_escaped(&ctx, s.wi) / s.pdf - 1.0).abs() < 1e-2 || i % 97 != 0, "{}", s.pdf);
            (0..3).for_each(|k| sum[k] += f64::from(s.radiance[k] / s.pdf) / f64::from(count * count));
        }
        let share = f64::from(all) / f64::from(count * count);
        assert!((share / density - 1.0).abs() < 0.01, "{share} of the samples pass, the density says {density}");
        for k in 0..3 {
            assert!((sum[k] / expected[k] - 1.0).abs() < 0.01, "{p}: {} instead of {}", sum[k], expected[k]);
        }
    }
    for p in [Vec3::new(0.0, -1.5, 1.0), Vec3::new(0.0, -1.0, 3.0)] {
        let ctx = LightContext { p, n: Vec3::Y };
        let dark = (0..1000).all(|i| light.sample(&ctx, rnd2(i)).is_none() && light.escaped(p, warp::uniform_sphere(rnd2(i))).is_black());
        assert!(dark, "{p} is beyond the window");
    }
}

/// Rays that leave it carry the power that it tells, by the densities that it tells.
#[test]
fn rays_start_in_the_window() {
    let light = light();
    let scene = SceneSphere { center: Vec3::ZERO, radius: 3.0, endless: false };
    let (count, mut sum, mut off) = (200_000, 0.0, 0);
    for i in 0..count {
        let Some(e) = light.emit(&scene, rnd2(2 * i), rnd2(2 * i + 1)) else { continue };
        assert!(e.d.y > 0.0 && (e.o.y + 1.0).abs() < 1e-5 && e.o.x.abs() <= 0.4001 && (e.o.z - 1.0).abs() <= 0.5001);
        assert!((light.pdf_position(e.d) / e.pdf_position - 1.0).abs() < 1e-4);
        off += u32::from((light.pdf_emit(e.d) / e.pdf_direction - 1.0).abs() > 1e-2);
        sum += f64::from(e.radiance.luminance() / (e.pdf_position * e.pdf_direction)) / f64::from(count);
    }
    assert!(off < count / 500, "{off}");
    let power = f64::from(light.power(&scene).luminance());
    assert!((sum / power - 1.0).abs() < 0.01, "{sum} instead of {power}");
}

#[test]
fn corners_that_span_nothing_make_no_light() {
    let map = || EnvironmentLight::new((2, 1), vec![[1.0; 3]; 2], [1.0; 3], Mat4::IDENTITY, Rows::Centered).unwrap();
    assert!(PortalLight::new(map(), [Vec3::ONE; 4]).is_none());
    assert!(PortalLight::new(map(), [Vec3::NAN, Vec3::X, Vec3::Y, Vec3::Z]).is_none());
}

fn sky(desc: &mut SceneDesc, portal: Option<[Vec3; 4]>) {
    let image = picture(desc, 32, 16, 3, texels(32, 16).into_iter().flatten().collect());
    let (world_from_light, mapping) = (Mat4::from_rotation_x(FRAC_PI_2), EnvironmentMapping::Equirectangular);
    add(desc, LightDesc::Environment { image, scale: [1.0; 3], world_from_light, mapping, portal });
}

/// A wall at y = −1 with the window in it: four parts, `far` beyond the window.
fn wall(desc: &mut SceneDesc, far: f32, material: BsdfId) {
    let upright = Mat4::from_translation(Vec3::new(0.0, -1.0, 1.0)) * Mat4::from_rotation_x(FRAC_PI_2);
    let half = 0.5 * far;
    for (x, y, w, h) in [
        (0.0, -0.5 - half, 0.4 + far, half),
        (0.0, 0.5 + half, 0.4 + far, half),
        (-0.4 - half, 0.0, half, 0.5),
        (0.4 + half, 0.0, half, 0.5),
    ] {
        let part = Mat4::from_translation(Vec3::new(x, y, 0.0)) * Mat4::from_scale(Vec3::new(w, h, 1.0));
        shape(desc, GeometryDesc::Rectangle, upright * part, Some(material));
    }
}

/// A floor behind a wall with a window, with the wall or with a portal in its place.
fn floor(walled: bool) -> SceneDesc {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    rectangle(&mut desc, Vec3::new(0.0, 1.0, 0.0), [2.0, 2.0], false, Some(white));
    sphere(&mut desc, Vec3::new(0.3, 0.8, 0.4), 0.4, Some(white));
    if walled {
        let black = diffuse(&mut desc, 0.0);
        wall(&mut desc, 1000.0, black);
        // Nothing may come from behind and from above; beyond the window all is open.
        for m in [Mat4::from_translation(Vec3::new(0.0, 999.0, 900.0)), Mat4::from_translation(Vec3::new(0.0, 999.0, -900.0))] {
            shape(&mut desc, GeometryDesc::Rectangle, m * Mat4::from_scale(Vec3::splat(1000.0)), Some(black));
        }
        for (turn, at) in [
            (Mat4::from_rotation_x(FRAC_PI_2), Vec3::Y * 900.0),
            (Mat4::from_rotation_y(FRAC_PI_2), Vec3::new(900.0, 999.0, 0.0)),
            (Mat4::from_rotation_y(FRAC_PI_2), Vec3::new(-900.0, 999.0, 0.0)),
        ] {
            shape(
                &mut desc,
                GeometryDesc::Rectangle,
                Mat4::from_translation(at) * turn * Mat4::from_scale(Vec3::splat(1000.0)),
                Some(black),
            );
        }
    }
    sky(&mut desc, (!walled).then_some(WINDOW));
    perspective(&mut desc, Vec3::new(0.0, 2.9, 1.0), Vec3::new(0.0, 0.9, 0.2), 50.0);
    desc
}

fn by(integrator: &str, spp: u32, depth: u32) -> RenderSettings {
    RenderSettings { integrator: Some(integrator.into()), max_depth: Some(depth), ..settings(32, 24, spp) }
}

#[test]
fn a_portal_gives_the_light_of_a_hole_in_a_wall() {
    let walled = Blocks::of_seeds(&floor(true), &by("path", 400, 2), 8);
    let portal = Blocks::of_seeds(&floor(false), &by("path", 64, 2), 8);
    assert_same("a portal and a hole", &portal, &walled, 2e-3, 0.4);
    println!("noise of 64 samples by the portal {}, of 400 by the hole {}", portal.noise(), walled.noise());
}

/// A room with a window, some things and a mirror.
fn room(portal: bool, fog: bool) -> SceneDesc {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.6);
    let white = bsdf(&mut desc, BsdfDesc::TwoSided { front: white, back: white });
    rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, Some(white));
    rectangle(&mut desc, Vec3::new(0.0, 0.0, 2.0), [1.0; 2], true, Some(white));
    let side = |turn: Mat4| Mat4::from_translation(Vec3::Z) * turn * Mat4::from_translation(Vec3::NEG_Z);
    for turn in [Mat4::from_rotation_x(FRAC_PI_2), Mat4::from_rotation_y(-FRAC_PI_2), Mat4::from_rotation_y(FRAC_PI_2)] {
        shape(&mut desc, GeometryDesc::Rectangle, side(turn), Some(white));
    }
    wall(&mut desc, 0.6, white);
    rectangle(&mut desc, Vec3::new(0.3, 0.2, 0.5), [0.3; 2], false, Some(white));
    let shiny = bsdf(&mut desc, mirror(None));
    sphere(&mut desc, Vec3::new(-0.4, 0.3, 0.3), 0.3, Some(shiny));
    // A tree before the window, and leaves that are half there; black, as portals leave dark what is outside.
    let black = diffuse(&mut desc, 0.0);
    sphere(&mut desc, Vec3::new(0.3, -1.6, 1.2), 0.3, Some(black));
    let screen = bsdf(&mut desc, BsdfDesc::Mask { nested: black, opacity: Param::Constant(0.5) });
    sphere(&mut desc, Vec3::new(-0.4, -1.7, 1.2), 0.3, Some(screen));
    if fog {
        let phase = PhaseDesc::Isotropic;
        let medium = MediumDesc::Homogeneous { sigma_a: [0.1; 3], sigma_s: [0.2; 3], emission: [0.0; 3], phase };
        let medium = add(&mut desc, medium);
        let null = bsdf(&mut desc, BsdfDesc::Null);
        // In the room alone: what fog scatters beyond the window is another light.
        let border = sphere(&mut desc, Vec3::new(0.0, 0.05, 1.0), 0.93, Some(null));
        desc.shapes[border.0 as usize].value.interior = Some(medium);
    }
    sky(&mut desc, portal.then_some(WINDOW));
    perspective(&mut desc, Vec3::new(0.0, -0.95, 0.9), Vec3::new(0.0, 1.0, 0.8), 70.0);
    desc
}

#[test]
fn a_portal_in_the_window_of_a_room_changes_nothing() {
    let plain = Blocks::of_seeds(&room(false, false), &by("path", 192, 3), 8);
    for (method, spp) in [("path", 64), ("bdpt", 24), ("vcm", 24), ("mlt", 96), ("sppm", 16), ("pathmap", 16)] {
        let found = Blocks::of_seeds(&room(true, false), &by(method, spp, 3), 8);
        println!("{method}: noise {}, without portal {}", found.noise(), plain.noise());
        let slack = if matches!(method, "sppm" | "vcm" | "pathmap") { 0.04 } else { 2e-3 };
        assert_same(method, &found, &plain, slack, 0.3);
    }
}

#[test]
fn light_comes_through_portals_in_fog() {
    let plain = Blocks::of_seeds(&room(false, true), &by("path", 256, 3), 8);
    for (method, spp) in [("path", 128), ("bdpt", 48)] {
        let found = Blocks::of_seeds(&room(true, true), &by(method, spp, 3), 8);
        assert_same(method, &found, &plain, 2e-3, 0.3);
    }
}

/// What stands before the window keeps rays from it.
#[test]
fn no_ray_comes_through_what_is_before_the_window() {
    let mut desc = floor(false);
    let black = diffuse(&mut desc, 0.0);
    let shutter =
        Mat4::from_translation(Vec3::new(0.0, -2.0, 1.0)) * Mat4::from_rotation_x(FRAC_PI_2) * Mat4::from_scale(Vec3::splat(900.0));
    shape(&mut desc, GeometryDesc::Rectangle, shutter, Some(black));
    let scene = compile(&desc, &settings(8, 8, 1));
    let sampler = EmissionSampler::new(&scene);
    let left = (0..20_000).filter(|&i| sampler.sample(&scene, 0.5, rnd2(2 * i), rnd2(2 * i + 1)).is_some()).count();
    assert!(left < 200, "{left} of 20000 rays");
}
