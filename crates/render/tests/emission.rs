//! Rays that leave the lights of a scene: their power, their densities, and the flux through a sphere.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::integrator::emission::EmissionSampler;
use etendue_render::light::Light;
use etendue_render::math::hash::{mix32, unit_float};
use etendue_render::math::{Mat4, Vec2, Vec3};
use etendue_render::scene::Scene;
use etendue_scene::SceneDesc;
use etendue_scene::desc::*;
use glam::Mat3;
use support::*;

fn rnd(i: u32) -> f32 {
    unit_float(mix32(i))
}

fn rnd2(i: u32) -> Vec2 {
    Vec2::new(rnd(2 * i), rnd(2 * i + 1))
}

/// Mean power of emitted rays with its standard error, by channel.
fn emitted(scene: &Scene, keep: impl Fn(Vec3, Vec3) -> bool) -> ([f64; 3], [f64; 3]) {
    let sampler = EmissionSampler::new(scene);
    let n = 100_000u32;
    let (mut sum, mut squares) = ([0.0f64; 3], [0.0f64; 3]);
    for i in 0..n {
        let Some(e) = sampler.sample(scene, rnd(7 * i + 5), rnd2(900_001 + i), rnd2(5_000_001 + i)) else { continue };
        assert!((sampler.pmf(e.light) - e.pmf).abs() < 1e-6);
        let light = &scene.lights[e.light as usize];
        let (position, direction) =
            (sampler.pdf_position(scene, e.light, e.p, e.ray.d), sampler.pdf_direction(scene, e.light, e.n, e.ray.d));
        assert!((position / e.pdf_position - 1.0).abs() < 1e-3, "{light:?}: {position} instead of {}", e.pdf_position);
        let at_border = matches!(light, Light::Environment(_));
        assert!(at_border || (direction / e.pdf_direction - 1.0).abs() < 1e-2, "{light:?}: {direction} instead of {}", e.pdf_direction);
        if keep(e.ray.o, e.ray.d) {
            for c in 0..3 {
                let v = f64::from(e.power()[c]);
                sum[c] += v;
                squares[c] += v * v;
            }
        }
    }
    let n = f64::from(n);
    let error = std::array::from_fn(|c| ((squares[c] / n - (sum[c] / n).powi(2)).max(0.0) / n).sqrt());
    (sum.map(|s| s / n), error)
}

#[track_caller]
fn assert_power(name: &str, (value, error): ([f64; 3], [f64; 3]), expected: [f64; 3]) {
    for c in 0..3 {
        let slack = 4.5 * error[c] + 2e-3 * expected[c];
        assert!((value[c] - expected[c]).abs() <= slack, "{name}, channel {c}: {} ± {} instead of {}", value[c], error[c], expected[c]);
    }
}

fn lights() -> Vec<(&'static str, SceneDesc)> {
    let with = |f: &dyn Fn(&mut SceneDesc)| {
        let mut desc = scene();
        // Something that makes the scene's sphere 3 wide about the origin.
        let at = 3.0 / 3.0f32.sqrt();
        sphere(&mut desc, Vec3::splat(at - 1e-4), 1e-4, None);
        sphere(&mut desc, Vec3::splat(1e-4 - at), 1e-4, None);
        perspective(&mut desc, Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 40.0);
        f(&mut desc);
        desc
    };
    let glow = Color::Constant([1.0, 2.0, 0.5]);
    let turned = Mat4::from_rotation_x(0.7) * Mat4::from_scale(Vec3::new(0.5, 1.0, 0.8));
    vec![
        (
            "sphere",
            with(&|d| {
                let s = sphere(d, Vec3::X * 0.5, 0.4, None);
                emit(d, s, glow);
            }),
        ),
        (
            "ellipsoid",
            with(&|d| {
                let s = shape(d, GeometryDesc::Sphere { center: Vec3::ZERO, radius: 0.5 }, turned, None);
                emit(d, s, glow);
            }),
        ),
        (
            "cylinder",
            with(&|d| {
                let s = shape(d, GeometryDesc::Cylinder { p0: Vec3::ZERO, p1: Vec3::Z, radius: 0.3 }, turned, None);
                emit(d, s, glow);
            }),
        ),
        (
            "disk",
            with(&|d| {
                let s = shape(d, GeometryDesc::Disk, turned, None);
                emit(d, s, glow);
            }),
        ),
        (
            "cube of triangles, two-sided",
            with(&|d| {
                let s = shape(d, GeometryDesc::Cube, turned, None);
                d.shapes[s.0 as usize].value.emission = Some(EmissionDesc { radiance: glow, two_sided: true, group: String::new() });
            }),
        ),
        (
            "point and spot",
            with(&|d| {
                add(d, LightDesc::Point { position: Vec3::ONE, intensity: [1.0, 2.0, 3.0] });
                let world_from_light = Mat4::from_rotation_x(2.0);
                let falloff = SpotFalloff::CosineSquared;
                add(d, LightDesc::Spot { world_from_light, intensity: [4.0; 3], inner_rad: 0.3, outer_rad: 0.9, falloff, texture: None });
            }),
        ),
        (
            "directional",
            with(&|d| {
                add(d, LightDesc::Directional { direction: Vec3::new(1.0, 1.0, -1.0), irradiance: [1.0, 2.0, 3.0] });
            }),
        ),
        (
            "constant and a small lamp",
            with(&|d| {
                constant_sky(d, 0.4);
                let s = sphere(d, Vec3::X * 0.5, 0.01, None);
                emit(d, s, glow);
            }),
        ),
        (
            "environment",
            with(&|d| {
                let data = (0..16 * 8 * 3).map(|i| if i % 7 == 0 { 10.0 } else { rnd(i) }).collect();
                let image = picture(d, 16, 8, 3, data);
                let mapping = EnvironmentMapping::Equirectangular;
                add(
                    d,
                    LightDesc::Environment {
                        image,
                        scale: [1.0, 2.0, 0.5],
                        world_from_light: Mat4::from_rotation_x(0.4),
                        mapping,
                        portal: None,
                    },
                );
            }),
        ),
    ]
}

#[test]
fn rays_carry_the_power_of_all_lights() {
    for (name, desc) in lights() {
        let scene = compile(&desc, &settings(8, 8, 1));
        let mut expected = [0.0; 3];
        for light in &scene.lights {
            let power = light.power(&scene.sphere());
            expected.iter_mut().enumerate().for_each(|(c, e)| *e += f64::from(power[c]));
        }
        assert_power(name, emitted(&scene, |_, _| true), expected);
    }
}

#[test]
fn textured_lights_carry_the_power_of_their_texture() {
    // A row of four texels on a rectangle of 2 × 2; nearest neighbors, so that the mean is exact.
    let mut desc = scene();
    let image = picture(&mut desc, 4, 1, 3, vec![0.0, 1.0, 8.0, 4.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    let bitmap = BitmapDesc {
        image,
        encoding: Encoding::Linear,
        wrap: [Wrap::Clamp; 2],
        filter: TextureFilter::Nearest,
        picture_from_uv: Mat3::IDENTITY,
        channel: Channel::Luminance,
        uv_set: 0,
    };
    let texture = add(&mut desc, TextureDesc::Bitmap(bitmap));
    let panel = rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, None);
    emit(&mut desc, panel, Param::Texture(texture));
    perspective(&mut desc, Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 40.0);
    let scene = compile(&desc, &settings(8, 8, 1));
    let flux = |mean: f64| std::f64::consts::PI * 4.0 * mean;
    assert_power("texture", emitted(&scene, |_, _| true), [1.0, 1.0, 2.0].map(flux));
}

/// Flux through a sphere far away from the lamp: the share of a Lambertian disk's light in a cone is sin² of its half-angle, and of
/// an even sky, what passes a ball of radius r is 4π² r² L.
#[test]
fn flux_through_a_sphere() {
    let through = |center: Vec3, radius: f32| {
        move |o: Vec3, d: Vec3| {
            let t = (center - o).dot(d);
            t > 0.0 && (o + d * t - center).length() < radius
        }
    };
    let all = lights();
    let sky = &all.iter().find(|(n, _)| n.starts_with("constant")).unwrap().1;
    let (p, r) = (Vec3::new(-1.5, 0.3, 1.0), 0.5);
    let mut only_sky = sky.clone();
    only_sky.shapes.last_mut().unwrap().value.emission = None;
    let expected = 4.0 * std::f64::consts::PI.powi(2) * f64::from(r * r) * 0.4;
    assert_power("sky", emitted(&compile(&only_sky, &settings(8, 8, 1)), through(p, r)), [expected; 3]);

    let mut desc = scene();
    let lamp = shape(&mut desc, GeometryDesc::Disk, Mat4::from_scale(Vec3::splat(1e-3)), None);
    emit(&mut desc, lamp, Color::gray(1e6));
    perspective(&mut desc, Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 40.0);
    let power = std::f64::consts::PI * std::f64::consts::PI;
    // A ball of sin θ = 0.6 about the axis.
    assert_power("disk", emitted(&compile(&desc, &settings(8, 8, 1)), through(Vec3::Z * 5.0, 3.0)), [power * 0.36; 3]);
}

#[test]
fn hostile_lights_send_nothing() {
    let mut desc = scene();
    perspective(&mut desc, Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 40.0);
    rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, None);
    let none = compile(&desc, &settings(8, 8, 1));
    assert_eq!(emitted(&none, |_, _| true).0, [0.0; 3]);
    for value in [0.0, f32::MAX] {
        let mut desc = desc.clone();
        let lamp = sphere(&mut desc, Vec3::X, 1e-20, None);
        emit(&mut desc, lamp, Color::gray(value));
        let plane = shape(&mut desc, GeometryDesc::Plane, Mat4::from_translation(Vec3::NEG_Z), None);
        emit(&mut desc, plane, Color::gray(1.0));
        let scene = compile(&desc, &settings(8, 8, 1));
        let (mean, _) = emitted(&scene, |_, _| true);
        assert!(mean.iter().all(|m| m.is_finite()), "{mean:?}");
    }
}
