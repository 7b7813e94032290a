//! Manifold next-event estimation: known answers, agreement with methods that find the same light in other ways, hostile scenes.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use support::statistics::{Blocks, assert_same};
use support::*;

const EDGE: usize = 8;

fn method(name: &str, max_depth: u32, spp: u32) -> RenderSettings {
    RenderSettings { integrator: Some(name.into()), max_depth: Some(max_depth), ..settings(24, 24, spp) }
}

fn blocks(desc: &SceneDesc, s: &RenderSettings) -> Blocks {
    Blocks::of_seeds(desc, s, EDGE)
}

/// A floor seen from a little above, from below what is over it: no glass is in view.
fn floor(desc: &mut SceneDesc, reflectance: f32, half_width: f32) {
    let gray = diffuse(desc, reflectance);
    rectangle(desc, Vec3::ZERO, [6.0; 2], false, Some(gray));
    orthographic(desc, Vec3::new(0.0, 0.0, 0.25), Vec3::ZERO, half_width);
}

fn point(desc: &mut SceneDesc, position: Vec3) {
    add(desc, LightDesc::Point { position, intensity: [9.0, 7.0, 5.0] });
}

/// The share of light that an interface of glass lets through, and the sine behind it.
fn through(sin: f64, n: f64) -> (f64, f64) {
    let behind = sin / n;
    let (ci, ct) = ((1.0 - sin * sin).sqrt(), (1.0 - behind * behind).sqrt());
    let (s, p) = ((ci - n * ct) / (ci + n * ct), (n * ci - ct) / (n * ci + ct));
    (1.0 - 0.5 * (s * s + p * p), behind)
}

/// A point light over a pane of thick glass: what it sends between two angles arrives between two circles.
#[test]
fn a_slab_has_a_closed_form() {
    const GAP: f64 = 2.0;
    const THICK: f64 = 0.6;
    let n = 1.5;
    let glass_of = |desc: &mut SceneDesc| bsdf(desc, glass(n as f32, None));
    let rectangles = |desc: &mut SceneDesc| {
        let glass = glass_of(desc);
        rectangle(desc, Vec3::new(0.0, 0.0, 0.5), [20.0; 2], true, Some(glass));
        rectangle(desc, Vec3::new(0.0, 0.0, 0.5 + THICK as f32), [20.0; 2], false, Some(glass));
    };
    let cube = |desc: &mut SceneDesc| {
        let glass = glass_of(desc);
        let m = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.5 + 0.5 * THICK as f32))
            * Mat4::from_scale(Vec3::new(20.0, 20.0, 0.5 * THICK as f32));
        shape(desc, GeometryDesc::Cube, m, Some(glass));
    };
    type Change<'a> = &'a dyn Fn(&mut SceneDesc);
    let changes: [(&str, Change); 2] = [("rectangles", &rectangles), ("cube", &cube)];
    for (name, change) in changes {
        let mut desc = scene();
        floor(&mut desc, 0.5, 1.5);
        change(&mut desc);
        // The light is `GAP` from the slab and the floor together.
        add(&mut desc, LightDesc::Point { position: Vec3::new(0.0, 0.0, (GAP + THICK) as f32), intensity: [10.0; 3] });
        let picture = render(&desc, &RenderSettings { max_depth: Some(3), ..method("mnee", 3, 64) }).develop();
        let radius = |sin: f64| {
            let (_, inside) = through(sin, n);
            GAP * sin / (1.0 - sin * sin).sqrt() + THICK * inside / (1.0 - inside * inside).sqrt()
        };
        let values = picture.channel("G").unwrap();
        let (mut sum, mut wanted_sum) = (0.0, 0.0);
        for (i, &value) in values.iter().enumerate() {
            let at = |k: usize| (k as f64 + 0.5) / 12.0 * 1.5 - 1.5;
            let r = (at(i % 24).powi(2) + at(i / 24).powi(2)).sqrt();
            let (mut low, mut high) = (0.0, 0.999);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if radius(middle) < r { low = middle } else { high = middle }
            }
            // Solid angle over area, by differences of the cosine and of the square of the radius.
            let (a, b) = (low - 1e-5, low + 1e-5);
            let focus = 2.0 * ((1.0 - a * a).sqrt() - (1.0 - b * b).sqrt()) / (radius(b).powi(2) - radius(a).powi(2));
            sum += f64::from(value);
            wanted_sum += 0.5 / std::f64::consts::PI * 10.0 * through(low, n).0.powi(2) * focus;
        }
        // 37000 samples of which half find the way.
        assert!((sum / wanted_sum - 1.0).abs() < 0.02, "{name}: {} of the known light", sum / wanted_sum);
    }
}

/// Light of a point behind a glass ball, which paths cannot find, is what light tracing finds.
#[test]
fn delta_lights() {
    let mut desc = scene();
    floor(&mut desc, 0.5, 1.2);
    let glass = bsdf(&mut desc, glass(1.5, None));
    sphere(&mut desc, Vec3::new(0.1, 0.0, 0.9), 0.5, Some(glass));
    point(&mut desc, Vec3::new(0.4, 0.3, 2.4));
    // No chain of so few vertices is reflected by glass twice. Noisy: a block is at the focus.
    let light = blocks(&desc, &method("light", 4, 512));
    assert_same("mnee ball and point", &blocks(&desc, &method("mnee", 4, 32)), &light, 3e-3, 0.6);
}

/// A room with a glass ball, a mirror ball and a lamp that is just small enough to be looked for.
fn room() -> SceneDesc {
    let mut desc = scene();
    let (white, red) = (diffuse(&mut desc, 0.6), diffuse(&mut desc, 0.3));
    rectangle(&mut desc, Vec3::ZERO, [2.0; 2], false, Some(white));
    shape(&mut desc, GeometryDesc::Rectangle, facing(Vec3::new(0.0, 0.0, 3.0), [2.0; 2], true), Some(red));
    let back = Mat4::from_translation(Vec3::new(0.0, 2.0, 1.5))
        * Mat4::from_rotation_x(std::f32::consts::FRAC_PI_2)
        * Mat4::from_scale(Vec3::splat(2.0));
    shape(&mut desc, GeometryDesc::Rectangle, back, Some(white));
    let glass = bsdf(&mut desc, glass(1.5, None));
    sphere(&mut desc, Vec3::new(0.7, -0.4, 0.7), 0.6, Some(glass));
    let mirror = bsdf(&mut desc, mirror(None));
    sphere(&mut desc, Vec3::new(-0.8, 0.4, 0.6), 0.6, Some(mirror));
    let lamp = sphere(&mut desc, Vec3::new(0.3, 0.0, 2.3), 0.17, Some(red));
    emit(&mut desc, lamp, Color::Constant([25.0, 20.0, 15.0]));
    perspective(&mut desc, Vec3::new(1.0, -5.0, 2.0), Vec3::new(0.0, 0.0, 1.0), 40.0);
    desc
}

/// What chains bring is what paths find by chance, and nothing counts twice.
#[test]
fn small_lamps() {
    type Change = fn(&mut SceneDesc);
    let scenes: [(&str, Change); 4] = [
        ("balls", |_| ()),
        ("shell", |desc| {
            let (glass, air) = (bsdf(desc, glass(1.5, None)), bsdf(desc, glass(1.0 / 1.5, None)));
            sphere(desc, Vec3::new(0.1, -1.0, 1.0), 0.5, Some(glass));
            sphere(desc, Vec3::new(0.1, -1.0, 1.0), 0.4, Some(air));
            let white = diffuse(desc, 0.3);
            let lamp = sphere(desc, Vec3::new(0.1, -1.0, 1.0), 0.08, Some(white));
            emit(desc, lamp, Color::gray(20.0));
        }),
        ("mirrors", |desc| {
            let mirror = bsdf(desc, mirror(None));
            let both = bsdf(desc, BsdfDesc::TwoSided { front: mirror, back: mirror });
            rectangle(desc, Vec3::new(0.0, 0.5, 0.3), [0.6, 0.4], false, Some(both));
            let glass = bsdf(desc, glass(1.4, None));
            let mesh = ball(desc, 0.4, 16, 8);
            shape(desc, mesh, Mat4::from_translation(Vec3::new(-0.2, -1.0, 1.4)), Some(glass));
        }),
        ("smoke", |desc| {
            let glass = bsdf(desc, glass(1.3, None));
            let ball = sphere(desc, Vec3::new(0.1, -1.0, 1.0), 0.4, Some(glass));
            let phase = PhaseDesc::Isotropic;
            let smoke = MediumDesc::Homogeneous { sigma_a: [0.5, 0.2, 0.1], sigma_s: [1.0; 3], emission: [0.1; 3], phase };
            let id = add(desc, smoke);
            desc.shapes[ball.0 as usize].value.interior = Some(id);
        }),
    ];
    for (name, change) in scenes {
        let mut desc = room();
        change(&mut desc);
        let path = blocks(&desc, &method("path", 5, 192));
        assert_same(&format!("mnee {name}"), &blocks(&desc, &method("mnee", 5, 24)), &path, 4e-3, 0.8);
    }
}

#[test]
fn threads_do_not_matter() {
    let desc = room();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let picture = pool.install(|| render(&desc, &method("mnee", 6, 4))).develop();
        ["R", "G", "B"].map(|c| picture.channel(c).unwrap().iter().map(|v| v.to_bits()).collect::<Vec<_>>())
    };
    assert!(with(1) == with(3));
}

/// Meshes without extent, with odd normals and far away, and lamps on glass: no harm, no value that is not a number.
#[test]
fn hostile_glass() {
    let mut desc = room();
    let glass = bsdf(&mut desc, glass(1.5, None));
    let points = [[0.0; 3], [1e-30, 0.0, 0.0], [0.0, 1e30, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]];
    let mesh = MeshData {
        positions: points.map(Vec3::from_array).to_vec(),
        normals: [[0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1e-38, 0.0]].map(Vec3::from_array).to_vec(),
        triangles: vec![[0, 1, 2], [0, 3, 4], [3, 4, 3], [0, 2, 3]],
        ..MeshData::default()
    };
    let mesh = add(&mut desc, MeshDesc { file: None, flip_v: false, data: Some(mesh) });
    shape(&mut desc, GeometryDesc::Mesh { mesh, face_normals: false, smooth: false }, Mat4::IDENTITY, Some(glass));
    let flat = Mat4::from_scale(Vec3::new(1.0, 1.0, 1e-30));
    shape(&mut desc, GeometryDesc::Sphere { center: Vec3::new(0.0, 0.0, 1.0), radius: 0.3 }, flat, Some(glass));
    shape(&mut desc, GeometryDesc::Plane, Mat4::from_translation(Vec3::new(0.0, 0.0, 2.9)), Some(glass));
    for (position, intensity) in [(Vec3::new(0.7, -0.4, 1.3), 1.0), (Vec3::new(0.0, 0.0, 1e20), 1e30), (Vec3::ZERO, 1e-30)] {
        add(&mut desc, LightDesc::Point { position, intensity: [intensity; 3] });
    }
    let picture = render(&desc, &method("mnee", 8, 4)).develop();
    assert!(picture.channel("G").unwrap().iter().all(|v| v.is_finite()));
}
