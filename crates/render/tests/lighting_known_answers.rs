//! Illuminance of sensors where it is known in closed form.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::f64::consts::PI;

use etendue_render::integrator;
use etendue_render::lighting::{Reading, SensorGrid, SensorOptions, Summary, measure};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::Vec3;
use support::*;

fn read(desc: &SceneDesc, grid: &str, samples: u32) -> Vec<Reading> {
    let settings = RenderSettings { integrator: Some("path".into()), ..settings(1, 1, 1) };
    let mut scene = compile(desc, &settings);
    scene.hide_lights = true;
    let inner = integrator::create(&settings, &desc.integrator).unwrap();
    let options = SensorOptions { samples, seed: 3, efficacy: 1.0 };
    measure(&scene, inner.as_ref(), &SensorGrid::parse(grid).unwrap(), &options, &|| false, &|_| ()).unwrap()
}

/// A scene with a camera that no one uses.
fn dark() -> SceneDesc {
    let mut desc = scene();
    perspective(&mut desc, Vec3::Z, Vec3::ZERO, 40.0);
    desc
}

fn assert_reads(name: &str, r: &Reading, truth: f64) {
    // Five standard errors, and what `f32` leaves.
    let allowed = 5.0 * r.error + 2e-4 * truth.abs();
    assert!((r.lux - truth).abs() <= allowed, "{name}: {} ± {} instead of {truth}", r.lux, r.error);
    assert!(r.error < 0.02 * truth.abs() + 1e-9, "{name}: too noisy, {} of {truth}", r.error);
}

#[test]
fn point_lights_follow_the_inverse_square_and_the_cosine() {
    let mut desc = dark();
    add(&mut desc, LightDesc::Point { position: Vec3::new(0.0, 0.0, 2.0), intensity: [5.0; 3] });
    for r in read(&desc, "position=0 0 0,normal=0 0 1,columns=9,rows=2,spacing=0.7", 16) {
        let d2 = f64::from(r.p.distance_squared(Vec3::new(0.0, 0.0, 2.0)));
        assert_reads("point", &r, 5.0 / d2 * (2.0 / d2.sqrt()));
    }
    assert_eq!(read(&desc, "position=0 0 0,normal=0 0 -1", 16)[0].lux, 0.0);
}

#[test]
fn spheres_light_as_if_they_were_points() {
    // Above the horizon: E = π L (R / d)² cos.
    let mut desc = dark();
    let lamp = sphere(&mut desc, Vec3::new(0.0, 0.0, 3.0), 0.8, None);
    emit(&mut desc, lamp, Color::gray(2.0));
    for r in read(&desc, "position=0 0 0,normal=0 0 1,columns=5,spacing=0.8", 4096) {
        let d2 = f64::from(r.p.distance_squared(Vec3::new(0.0, 0.0, 3.0)));
        assert_reads("sphere", &r, PI * 2.0 * 0.64 / d2 * (3.0 / d2.sqrt()));
    }
}

#[test]
fn rectangles_light_as_lambert_says() {
    // Below a corner: E = L / 2 · (a/√(a²+h²) atan(b/√(a²+h²)) + b/√(b²+h²) atan(a/√(b²+h²))); the middle sees four corners.
    let mut desc = dark();
    let lamp = rectangle(&mut desc, Vec3::new(0.0, 0.0, 1.5), [1.0, 0.5], true, None);
    emit(&mut desc, lamp, Color::gray(3.0));
    let corner = |a: f64, b: f64, h: f64| {
        let (p, q) = ((a * a + h * h).sqrt(), (b * b + h * h).sqrt());
        1.5 * (a / p * (b / p).atan() + b / q * (a / q).atan())
    };
    assert_reads("below the middle", &read(&desc, "position=0 0 0,normal=0 0 1", 1024)[0], 4.0 * corner(1.0, 0.5, 1.5));
    assert_reads("below a corner", &read(&desc, "position=1 0.5 0,normal=0 0 1", 1024)[0], corner(2.0, 1.0, 1.5));
}

#[test]
fn a_uniform_sky_gives_pi_times_its_radiance_and_walls_half_of_it() {
    let mut desc = dark();
    constant_sky(&mut desc, 0.7);
    assert_reads("open", &read(&desc, "position=0 0 0,normal=0 0 1", 64)[0], PI * 0.7);
    // A black half-space below hides half of what a vertical sensor sees.
    let black = diffuse(&mut desc, 0.0);
    shape(&mut desc, GeometryDesc::Plane, glam::Mat4::from_translation(Vec3::new(0.0, 0.0, -0.01)), Some(black));
    assert_reads("wall", &read(&desc, "position=0 0 0,normal=1 0 0", 4096)[0], PI * 0.35);
}

#[test]
fn closed_rooms_sum_all_reflections() {
    // A sphere that emits L and reflects ρ: E = π L / (1 − ρ) anywhere inside.
    let mut desc = dark();
    let half = diffuse(&mut desc, 0.5);
    let both = bsdf(&mut desc, BsdfDesc::TwoSided { front: half, back: half });
    let ball = add(
        &mut desc,
        ShapeDesc {
            bsdf: Some(both),
            flip_normals: true,
            emission: Some(EmissionDesc { radiance: Color::gray(1.0), two_sided: false, group: String::new() }),
            ..ShapeDesc::new(GeometryDesc::Sphere { center: Vec3::ZERO, radius: 2.0 }, glam::Mat4::IDENTITY)
        },
    );
    let _ = ball;
    for r in read(&desc, "position=0 0 0.5,normal=0 1 1,columns=3,spacing=0.6", 8192) {
        eprintln!("{r:?}");
        assert_reads("integrating sphere", &r, 2.0 * PI);
    }
}

#[test]
fn pictures_of_illuminance_show_what_sensors_read() {
    let mut desc = scene();
    let gray = diffuse(&mut desc, 0.3);
    rectangle(&mut desc, Vec3::ZERO, [4.0, 4.0], false, Some(gray));
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, 0.05);
    add(&mut desc, LightDesc::Point { position: Vec3::new(0.0, 1.0, 2.0), intensity: [5.0; 3] });
    let film = render(&desc, &RenderSettings { integrator: Some("illuminance".into()), ..settings(8, 8, 4) });
    let image = film.develop();
    let g = image.channel("G").unwrap();
    let mean = g.iter().sum::<f32>() / g.len() as f32;
    let truth = 5.0 * 2.0 / (5.0 * 5.0f32.sqrt());
    assert!((mean / truth - 1.0).abs() < 1e-3, "{mean} {truth}");
}

#[test]
fn summaries_are_of_all_sensors() {
    let reading = |lux: f64| Reading { p: Vec3::ZERO, lux, error: 0.0 };
    let s = Summary::of(&[reading(4.0), reading(1.0), reading(2.0), reading(5.0)]).unwrap();
    assert_eq!((s.min, s.max, s.mean, s.median), (1.0, 5.0, 3.0, 3.0));
    assert!((s.min_over_mean - 1.0 / 3.0).abs() < 1e-12 && (s.min_over_max - 0.2).abs() < 1e-12);
    assert!(Summary::of(&[]).is_none());
    assert_eq!(Summary::of(&[reading(0.0)]).unwrap().min_over_mean, 0.0);
}
