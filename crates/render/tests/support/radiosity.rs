//! What tests of radiosity share.

use etendue_render::accel::Ray;
use etendue_render::lightmap::SurfaceLight;
use etendue_render::radiosity::{Display, Limits, Method, Progress, Settings, Solution, solve};
use etendue_render::scene::Scene;
use etendue_scene::SceneDesc;
use etendue_scene::desc::*;
use glam::{Mat4, Vec3};

use super::*;

/// Compiles a scene with some camera.
pub fn compiled(desc: &mut SceneDesc) -> Scene {
    perspective(desc, Vec3::new(0.1, 0.2, 0.3), Vec3::ONE, 60.0);
    compile(desc, &settings(8, 8, 1))
}

/// Settings of a method with so many elements and few rays.
pub fn with(method: Method, elements: usize) -> Settings {
    Settings { method, limits: Limits { elements, links: 4_000_000 }, rays: Some(32), ..Settings::default() }
}

/// Solves a scene.
pub fn solved(scene: &Scene, settings: &Settings) -> Solution {
    solve(scene, settings, Display::Smooth, &Progress::silent()).unwrap()
}

/// Irradiance where a ray meets something.
pub fn irradiance(scene: &Scene, solution: &Solution, o: Vec3, d: Vec3) -> [f64; 3] {
    let s = scene.intersect(&Ray::new(o, d)).expect("a surface");
    solution.irradiance(scene, &s).rgb().map(f64::from)
}

/// A closed room of unlike walls with a light under the ceiling and a block on the floor; two-sided materials.
pub fn room() -> SceneDesc {
    let mut desc = scene();
    let wall = |desc: &mut SceneDesc, m: Mat4, rgb: [f32; 3]| {
        let front = add(desc, BsdfDesc::Diffuse { reflectance: Color::Constant(rgb), alpha: None });
        let both = add(desc, BsdfDesc::TwoSided { front, back: front });
        shape(desc, GeometryDesc::Rectangle, m, Some(both));
    };
    let quarter = std::f32::consts::FRAC_PI_2;
    let at = |x: f32, y: f32, z: f32| Mat4::from_translation(Vec3::new(x, y, z));
    wall(&mut desc, at(0.0, 0.0, -1.0), [0.7; 3]);
    wall(&mut desc, at(0.0, 0.0, 1.0) * Mat4::from_rotation_x(2.0 * quarter), [0.8; 3]);
    wall(&mut desc, at(-1.0, 0.0, 0.0) * Mat4::from_rotation_y(quarter), [0.6, 0.2, 0.1]);
    wall(&mut desc, at(1.0, 0.0, 0.0) * Mat4::from_rotation_y(-quarter), [0.2, 0.5, 0.2]);
    wall(&mut desc, at(0.0, -1.0, 0.0) * Mat4::from_rotation_x(-quarter), [0.7; 3]);
    wall(&mut desc, at(0.0, 1.0, 0.0) * Mat4::from_rotation_x(quarter), [0.5; 3]);
    let gray = diffuse(&mut desc, 0.5);
    shape(
        &mut desc,
        GeometryDesc::Cube,
        at(0.3, 0.2, -0.75) * Mat4::from_rotation_z(0.5) * Mat4::from_scale(Vec3::splat(0.25)),
        Some(gray),
    );
    let black = diffuse(&mut desc, 0.0);
    let light = rectangle(&mut desc, Vec3::new(-0.2, 0.0, 0.9), [0.4, 0.3], true, Some(black));
    emit(&mut desc, light, Color::Constant([4.0, 3.0, 2.0]));
    desc
}
