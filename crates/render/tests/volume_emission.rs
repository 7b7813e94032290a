//! Media that emit: what leaves them, what they light, and that all methods count their light once.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::accel::Ray;
use etendue_render::integrator::volume_emission::VolumeEmission;
use etendue_render::lightmap::SurfaceLight;
use etendue_render::math::{Mat4, Vec2, Vec3};
use etendue_render::photon::{MapInfo, PhotonLight, PhotonMap};
use etendue_render::sampler::HashRng;
use etendue_render::scene::Scene;
use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use support::statistics::{Blocks, assert_same};
use support::*;

const PI: f64 = std::f64::consts::PI;

/// The same everywhere.
fn glow(desc: &mut SceneDesc, sigma_a: f32, sigma_s: f32, emission: [f32; 3]) -> MediumId {
    let phase = PhaseDesc::HenyeyGreenstein { g: 0.3 };
    add(desc, MediumDesc::Homogeneous { sigma_a: [sigma_a; 3], sigma_s: [sigma_s; 3], emission, phase })
}

/// A flame: bright in the middle of a grid that is thinner towards its top, turned, in the box of `world_from_volume`.
fn flame(desc: &mut SceneDesc, world_from_volume: Mat4, brightness: f32) -> MediumId {
    let n = 12;
    let data = (0..n * n * n)
        .map(|i| {
            let at = |k: u32| (i / k % n) as f32 / (n - 1) as f32 * 2.0 - 1.0;
            let (x, y, z) = (at(1), at(n), at(n * n));
            (1.2 - 3.0 * (x * x + y * y) - 0.5 * z).max(0.0) * 1.5
        })
        .collect();
    let volume = VolumeDesc { size: [n; 3], channels: 1, data, world_from_volume, filter: VolumeFilter::Linear, wrap: VolumeWrap::Clamp };
    let volume = Some(add(desc, volume));
    let source = EmissionSource::Field(FieldDesc { factor: [brightness, 0.5 * brightness, 0.15 * brightness], volume });
    let medium = GridMediumDesc {
        extinction: FieldDesc { factor: [2.0; 3], volume },
        scattering: ScatteringDesc::Albedo(FieldDesc::constant([0.4, 0.3, 0.2])),
        emission: Some(MediumEmissionDesc { source, by_absorption: true }),
        phase: PhaseDesc::Isotropic,
    };
    add(desc, MediumDesc::Grid(Box::new(medium)))
}

fn fill(desc: &mut SceneDesc, shape: ShapeId, medium: MediumId) {
    desc.shapes[shape.0 as usize].value.interior = Some(medium);
}

/// The mean power of so many rays that leave media, red.
fn power(scene: &Scene, rays: u64) -> f64 {
    let emission = VolumeEmission::new(scene).unwrap().unwrap();
    let mut rng = HashRng::new(5);
    let mut sum = 0.0;
    for _ in 0..rays {
        let mut u = || rng.next_1d();
        let (choice, position, direction) = (u(), Vec2::new(u(), u()), Vec2::new(u(), u()));
        let mut own = HashRng::new(u64::from(u().to_bits()));
        if let Some(ray) = emission.sample(scene, choice, position, direction, &mut own) {
            assert!((ray.ray.d.length() - 1.0).abs() < 1e-5);
            sum += f64::from(ray.power.0[0]);
        }
    }
    sum / rays as f64
}

/// A homogeneous ball, with a hole in which another medium is, and a second ball that overlaps its box.
#[test]
fn the_power_of_media_is_known() {
    let mut desc = scene();
    let none = bsdf(&mut desc, BsdfDesc::Null);
    let (bright, dark) = (glow(&mut desc, 0.5, 0.2, [2.0, 1.0, 0.5]), glow(&mut desc, 0.5, 0.2, [0.0; 3]));
    for (at, radius, medium) in [(Vec3::ZERO, 1.0, bright), (Vec3::X * 0.3, 0.5, dark), (Vec3::new(1.1, 1.1, 0.2), 0.4, bright)] {
        let ball = sphere(&mut desc, at, radius, Some(none));
        fill(&mut desc, ball, medium);
    }
    perspective(&mut desc, Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 40.0);
    let ball = |r: f64| 4.0 / 3.0 * PI * r * r * r;
    let known = 2.0 * 4.0 * PI * (ball(1.0) - ball(0.5) + ball(0.4));
    let found = power(&compile(&desc, &settings(4, 4, 1)), 200_000);
    assert!((found / known - 1.0).abs() < 0.01, "{found} instead of {known}");

    let mut desc = scene();
    let none = bsdf(&mut desc, BsdfDesc::Null);
    let place = Mat4::from_translation(Vec3::new(3.0, 0.2, -0.5)) * Mat4::from_rotation_x(0.4) * Mat4::from_scale(Vec3::new(1.0, 0.5, 2.0));
    let medium = flame(&mut desc, place, 3.0);
    let half = Mat4::from_translation(Vec3::splat(0.5)) * Mat4::from_scale(Vec3::splat(0.5));
    let cube = shape(&mut desc, GeometryDesc::Cube, place * half, Some(none));
    fill(&mut desc, cube, medium);
    perspective(&mut desc, Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 40.0);
    let scene = compile(&desc, &settings(4, 4, 1));
    // By a fine midpoint rule over the volume's box.
    let n = 64;
    let sum: f64 = (0..n * n * n)
        .map(|i| {
            let at = |k: u32| ((i / k % n) as f32 + 0.5) / n as f32;
            f64::from(scene.media[0].coefficients(place.transform_point3(Vec3::new(at(1), at(n), at(n * n)))).emission.0[0])
        })
        .sum();
    let known = 4.0 * PI * sum / f64::from(n).powi(3);
    let found = power(&scene, 200_000);
    assert!((found / known - 1.0).abs() < 0.01, "{found} instead of {known}");
}

/// Thousands of flames, each a medium of its own: their power is the sum, and a ray costs what it does with few.
#[test]
fn thousands_of_flames() {
    let of = |n: u32| {
        let mut desc = scene();
        let none = bsdf(&mut desc, BsdfDesc::Null);
        let medium = flame(&mut desc, Mat4::IDENTITY, 1.0);
        let MediumDesc::Grid(grid) = desc.media[medium.0 as usize].value.clone() else { panic!("a flame is a grid") };
        let volume = desc.volumes[0].value.clone();
        for i in 1..n * n {
            let place = Mat4::from_translation(Vec3::new((i % n) as f32, (i / n) as f32, 0.0) * 1.5);
            let volume = Some(add(&mut desc, VolumeDesc { world_from_volume: place, ..volume.clone() }));
            let mut own = grid.clone();
            own.extinction.volume = volume;
            let source = EmissionSource::Field(FieldDesc { factor: [1.0, 0.5, 0.15], volume });
            own.emission = Some(MediumEmissionDesc { source, by_absorption: true });
            let medium = add(&mut desc, MediumDesc::Grid(own));
            let half = Mat4::from_translation(Vec3::splat(0.5)) * Mat4::from_scale(Vec3::splat(0.5));
            let cube = shape(&mut desc, GeometryDesc::Cube, place * half, Some(none));
            fill(&mut desc, cube, medium);
        }
        // From above, so that few borders are on the way to a point.
        perspective(&mut desc, Vec3::new(0.7 * n as f32, 0.7 * n as f32, 500.0), Vec3::ZERO, 40.0);
        let scene = compile(&desc, &settings(4, 4, 1));
        let start = std::time::Instant::now();
        let rays = 20_000;
        let each = power(&scene, rays) / f64::from(n * n - 1);
        (each, start.elapsed().as_secs_f64())
    };
    let (few, many) = (of(4), of(40));
    println!("15 flames: {few:?} (power of each, seconds); 1599: {many:?}");
    assert!((many.0 / few.0 - 1.0).abs() < 0.05, "{} instead of {}", many.0, few.0);
}

/// A ball that absorbs nothing lights what is outside of it as a point in its middle does.
#[test]
fn irradiance_under_a_thin_ball() {
    let mut desc = scene();
    let black = diffuse(&mut desc, 0.0);
    rectangle(&mut desc, Vec3::ZERO, [3.0; 2], false, Some(black));
    let none = bsdf(&mut desc, BsdfDesc::Null);
    let at = Vec3::new(0.3, -0.2, 1.5);
    let medium = glow(&mut desc, 0.0, 0.0, [2.0, 1.0, 0.5]);
    let ball = sphere(&mut desc, at, 0.5, Some(none));
    fill(&mut desc, ball, medium);
    perspective(&mut desc, Vec3::new(0.0, -5.0, 3.0), Vec3::ZERO, 40.0);
    let scene = compile(&desc, &settings(4, 4, 1));
    let mut map = PhotonMap::new(MapInfo::default());
    map.trace(&scene, 0..400_000, u64::MAX, &|| false, &mut |_, _| {});
    let light = PhotonLight::new(map, 200, 1.0);
    let intensity = 2.0 * 4.0 / 3.0 * PI * 0.125;
    let (mut mean, points) = (0.0, 100);
    for i in 0..points {
        let p = Vec3::new((i % 10) as f32 * 0.1 - 0.45, (i / 10) as f32 * 0.1 - 0.45, 0.0);
        let s = scene.intersect(&Ray::new(p + Vec3::Z * 0.1, -Vec3::Z)).unwrap();
        let known = intensity * f64::from((at - p).z) / f64::from((at - p).length()).powi(3);
        let relative = f64::from(light.irradiance(&scene, &s)[0]) / known - 1.0;
        assert!(relative.abs() < 0.35, "{relative} at {p}");
        mean += relative / f64::from(points);
    }
    assert!(mean.abs() < 0.035, "the mean deviation is {mean}");
}

/// A floor, a wall and a red ball, lit by a lamp (where asked for), a glowing ball of fog and a flame; or also with glass and a mirror.
fn fireplace(with_lamp: bool, with_glass: bool) -> SceneDesc {
    let mut desc = scene();
    let white = diffuse(&mut desc, 0.7);
    let white = bsdf(&mut desc, BsdfDesc::TwoSided { front: white, back: white });
    let red = bsdf(&mut desc, BsdfDesc::Diffuse { reflectance: Color::Constant([0.7, 0.2, 0.1]), alpha: None });
    rectangle(&mut desc, Vec3::ZERO, [3.0; 2], false, Some(white));
    let upright = Mat4::from_translation(Vec3::new(0.0, 1.2, 1.0)) * Mat4::from_rotation_x(std::f32::consts::FRAC_PI_2);
    shape(&mut desc, GeometryDesc::Rectangle, upright * Mat4::from_scale(Vec3::splat(3.0)), Some(white));
    sphere(&mut desc, Vec3::new(-0.7, -0.3, 0.35), 0.35, Some(red));
    let none = bsdf(&mut desc, BsdfDesc::Null);
    let fog = glow(&mut desc, 0.4, 1.2, [0.5, 0.8, 1.2]);
    let ball = sphere(&mut desc, Vec3::new(0.75, 0.2, 0.9), 0.4, Some(none));
    fill(&mut desc, ball, fog);
    let place = Mat4::from_translation(Vec3::new(-0.3, 0.1, 0.05)) * Mat4::from_scale(Vec3::new(0.6, 0.6, 1.0));
    let fire = flame(&mut desc, place, 8.0);
    let half = Mat4::from_translation(Vec3::splat(0.5)) * Mat4::from_scale(Vec3::splat(0.5));
    let cube = shape(&mut desc, GeometryDesc::Cube, place * half, Some(none));
    fill(&mut desc, cube, fire);
    if with_lamp {
        let lamp = sphere(&mut desc, Vec3::new(0.4, -0.9, 1.7), 0.2, None);
        emit(&mut desc, lamp, Color::Constant([5.0, 4.0, 3.0]));
    }
    if with_glass {
        let ball = bsdf(&mut desc, glass(1.5, None));
        sphere(&mut desc, Vec3::new(0.35, -0.7, 0.4), 0.3, Some(ball));
        let metal = bsdf(&mut desc, mirror(None));
        sphere(&mut desc, Vec3::new(-1.1, 0.5, 0.5), 0.35, Some(metal));
    }
    perspective(&mut desc, Vec3::new(0.0, -3.8, 1.2), Vec3::new(0.0, 0.0, 0.7), 39.0);
    desc
}

fn with(name: &str, spp: u32, f: impl FnOnce(&mut RenderSettings)) -> RenderSettings {
    let mut s = RenderSettings { integrator: Some(name.into()), ..settings(24, 24, spp) };
    f(&mut s);
    s
}

/// Light of media is met by rays from the camera in some methods and by particles in others: the picture is the same.
#[test]
fn flames_agree() {
    for (with_lamp, with_glass, depth) in [(false, false, None), (true, true, None), (true, false, Some(1))] {
        let desc = fireplace(with_lamp, with_glass);
        let deep = |s: &mut RenderSettings| s.max_depth = depth;
        let reference = Blocks::of_seeds(&desc, &with("path", 128, deep), 6);
        let agrees = |s: RenderSettings, slack: f64, noise: f64| {
            let name = format!("{} with lamp: {with_lamp}, glass: {with_glass}, depth {depth:?}", s.integrator.as_deref().unwrap());
            assert_same(&name, &Blocks::of_seeds(&desc, &s, 6), &reference, slack, noise);
        };
        if !with_glass {
            agrees(with("light", 24, deep), 1e-3, 0.5);
        }
        let photons = |name: &str, spp: u32, photons: u32| {
            with(name, spp, |s| {
                (s.max_depth, s.photons) = (depth, Some(photons));
                s.photon_neighbors = (name != "sppm").then_some(50);
            })
        };
        agrees(photons("sppm", 20, 6_000), 0.04, 0.5);
        agrees(photons("photon", 12, 40_000), 0.05, 0.5);
        if depth.is_some() {
            continue;
        }
        // Seams along edges are dark.
        agrees(photons("particles", 6, 40_000), 0.15, 0.5);
        agrees(with("bdpt", 12, deep), 1e-3, 0.5);
        if with_glass {
            agrees(with("mnee", 20, deep), 5e-3, 0.5);
            agrees(with("pathmap", 20, |s| s.photons = Some(4_000)), 0.03, 0.5);
            agrees(with("vcm", 8, |s| s.photon_radius = Some(0.01)), 0.01, 0.5);
        } else {
            // With fewer chains rare bright paths have a spread that ten seeds do not tell.
            agrees(with("mlt", 64, deep), 1e-3, 0.7);
            let beams = RenderSettings { photon_beams: true, ..photons("sppm", 12, 6_000) };
            agrees(beams, 0.05, 0.5);
        }
    }
}

/// What has no end has no power from which photons could be dealt out; and methods that do not need them show it.
#[test]
fn glow_without_end_is_refused_by_name() {
    let mut desc = fireplace(true, false);
    let around = glow(&mut desc, 0.1, 0.0, [0.2; 3]);
    desc.cameras[0].value.medium = Some(around);
    let run = |name: &str| {
        let s = with(name, 1, |s| s.photons = Some(100));
        let stop = Stop { spp: Some(1), ..Stop::default() };
        session(&desc, &s).render(&stop, &Cancel::default(), &Silent).map_err(|e| e.to_string())
    };
    for name in ["light", "photon", "sppm", "particles"] {
        let message = run(name).unwrap_err();
        assert!(message.contains("emit") && message.contains("bdpt"), "{name}: {message}");
    }
    for name in ["path", "bdpt", "vcm", "mlt", "pathmap", "mnee", "auto"] {
        run(name).unwrap();
    }
}

/// Media of no size, of no end of light, or of numbers that are none.
#[test]
fn hostile_media_end() {
    for (radius, emission) in [(1e-20, 1.0), (1e18, 1.0), (0.4, f32::MAX), (0.4, 1e-38), (1e-12, f32::MAX)] {
        let mut desc = scene();
        let white = diffuse(&mut desc, 0.5);
        rectangle(&mut desc, Vec3::NEG_Z, [1.0; 2], false, Some(white));
        let none = bsdf(&mut desc, BsdfDesc::Null);
        let ball = sphere(&mut desc, Vec3::ZERO, radius, Some(none));
        let medium = glow(&mut desc, 0.5, 0.5, [emission; 3]);
        fill(&mut desc, ball, medium);
        perspective(&mut desc, Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 40.0);
        for name in ["light", "photon", "sppm", "particles"] {
            let s = with(name, 1, |s| s.photons = Some(200));
            let stop = Stop { spp: Some(1), ..Stop::default() };
            // Powers beyond all numbers may be refused; nothing may panic or go on for ever.
            let _ = session(&desc, &s).render(&stop, &Cancel::default(), &Silent);
        }
    }
}
