//! Lights by pictures: what they give against closed forms, and the same by path tracing, light tracing, bidirectionally and by photons.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_scene::SceneDesc;
use etendue_scene::desc::*;
use glam::{Mat4, Vec3};
use support::statistics::{Blocks, assert_same};
use support::*;

/// A gray floor at z = 0 from above; the light is still missing.
fn floor() -> SceneDesc {
    let mut desc = scene();
    let gray = diffuse(&mut desc, 0.5);
    rectangle(&mut desc, Vec3::ZERO, [4.0, 4.0], false, Some(gray));
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, 2.0);
    desc
}

fn light(desc: &mut SceneDesc, at: Vec3, [width, height]: [u32; 2], texels: Vec<f32>, power: Option<f32>, mapping: PictureMapping) {
    let image = picture(desc, width, height, 3, texels);
    // Looks down.
    let world_from_light = Mat4::from_translation(at) * Mat4::from_rotation_x(std::f32::consts::PI);
    add(desc, LightDesc::Picture { world_from_light, intensity: [1.0, 2.0, 0.5], power, image, mapping });
}

/// Radiance of the floor at (x, y) by an intensity at a height over the middle: ρ/π · I cos³θ / h².
fn radiance(intensity: f32, height: f32, x: f32, y: f32) -> f32 {
    let cos = height / (x * x + y * y + height * height).sqrt();
    0.5 / std::f32::consts::PI * intensity * cos.powi(3) / (height * height)
}

/// The same brightness everywhere is a point light, and a power is that of all directions.
#[test]
fn an_even_map_is_a_point_light() {
    for power in [None, Some(7.0)] {
        let mut desc = floor();
        light(&mut desc, Vec3::new(0.3, 0.2, 1.5), [4, 4], vec![0.25; 48], power, PictureMapping::EqualAreaSquare);
        let mut point = floor();
        let mut intensity = [0.25, 0.5, 0.125];
        if let Some(power) = power {
            let luminance = 0.212_671 * intensity[0] + 0.715_16 * intensity[1] + 0.072_169 * intensity[2];
            intensity = intensity.map(|v| v * power / (4.0 * std::f32::consts::PI * luminance));
        }
        add(&mut point, LightDesc::Point { position: Vec3::new(0.3, 0.2, 1.5), intensity });
        let of = |d: &SceneDesc| render(d, &settings(8, 8, 1)).develop().channel("G").unwrap().to_vec();
        for (a, b) in of(&desc).iter().zip(of(&point)) {
            assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
        }
    }
}

/// The middle of the floor under a bright pixel.
#[test]
fn intensities_fall_off_as_those_of_points() {
    let mut desc = floor();
    light(&mut desc, Vec3::new(0.0, 0.0, 2.0), [1, 1], vec![3.0; 3], None, PictureMapping::Perspective { fov_rad: 2.5 });
    let film = render(&desc, &settings(41, 41, 16));
    let red = film.develop().channel("R").unwrap().to_vec();
    let middle = red[20 * 41 + 20];
    assert!((middle / radiance(3.0, 2.0, 0.0, 0.0) - 1.0).abs() < 2e-3, "{middle}");
    let corner = red[0];
    let edge = 2.0 * 40.0 / 41.0;
    assert!((corner / radiance(3.0, 2.0, edge, edge) - 1.0).abs() < 0.02, "{corner}");
}

#[test]
fn all_methods_agree() {
    for mapping in [PictureMapping::EqualAreaSquare, PictureMapping::Perspective { fov_rad: 1.4 }] {
        let mut desc = floor();
        let red = add(&mut desc, BsdfDesc::Diffuse { reflectance: Color::Constant([0.8, 0.3, 0.2]), alpha: None });
        sphere(&mut desc, Vec3::new(0.6, 0.3, 0.5), 0.5, Some(red));
        let texels = (0..8 * 8 * 3).map(|i| if i % 7 == 0 { 0.0 } else { 0.2 + (i * 5 % 13) as f32 * 0.3 }).collect();
        light(&mut desc, Vec3::new(-0.4, 0.1, 2.0), [8, 8], texels, None, mapping);
        let method =
            |name: &str, spp| etendue_scene::RenderSettings { integrator: Some(name.into()), max_depth: Some(4), ..settings(16, 16, spp) };
        let path = Blocks::new(&render_seeds(&desc, &method("path", 128), 50..52), 4);
        for (name, spp) in [("bdpt", 32), ("light", 512)] {
            assert_same(&format!("{name} {mapping:?}"), &Blocks::of_seeds(&desc, &method(name, spp), 4), &path, 1e-3, 0.4);
        }
    }
}
