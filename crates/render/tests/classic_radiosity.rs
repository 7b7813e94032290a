//! Radiosity of the classic model: closed forms in closed rooms, values measured from pictures of POV-Ray 3.7.0.10 (16 bits,
//! `File_Gamma=1.0`), and settings nobody should use.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::Arc;

use etendue_procedural::{Color, Finish, Layer, Pigment, Texture};
use etendue_render::film::Film;
use etendue_render::session::job::{self, Plan};
use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::desc::classic::{Camera, ClassicScene, Fog, Light, Object, Radiosity, Solid};
use etendue_scene::{RenderSettings, SceneDesc, Span};
use glam::DVec3;

fn object(solid: Solid, rgb: DVec3, finish: Finish) -> Object {
    let mut o = Object::new(Span::default(), solid);
    o.texture = Some(Arc::new(Texture::Layers(vec![Layer {
        pigment: Pigment::Solid(Color { rgb, filter: 0.0, transmit: 0.0 }),
        normal: None,
        finish: Arc::new(finish),
    }])));
    (o.hollow, o.hollow_stated) = (true, true);
    o
}

/// What glows with `emission` and returns half of the light.
fn glowing(emission: f64) -> Finish {
    Finish { ambient: DVec3::ZERO, emission: DVec3::splat(emission), diffuse: 0.5, ..Finish::default() }
}

/// The inside of a unit sphere.
fn room(finish: Finish, rgb: DVec3, radiosity: Radiosity) -> ClassicScene {
    let camera = Camera { location: DVec3::new(0.0, 0.0, -0.3), ..Camera::default() };
    let mut s = ClassicScene { camera, ..ClassicScene::default() };
    s.objects.push(Arc::new(object(Solid::Sphere { center: DVec3::ZERO, radius: 1.0 }, rgb, finish)));
    s.settings.gamma_given = true;
    s.settings.radiosity = Some(radiosity);
    s
}

fn film(scene: &ClassicScene, size: [u32; 2], threads: usize) -> Film {
    let mut desc = SceneDesc::new("pov", "test.pov");
    desc.classic = Some(Box::new(scene.clone()));
    desc.integrator.name = "whitted".to_owned();
    let settings = RenderSettings { width: Some(size[0]), height: Some(size[1]), spp: Some(1), ..RenderSettings::default() };
    let plan = Plan::new(&desc, &settings, None).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(32 << 20).build().unwrap();
    pool.install(|| {
        let mut session = job::prepare(&desc, &settings, &plan, &[]).unwrap();
        session.render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent).unwrap();
        session.into_film()
    })
}

fn rgb(scene: &ClassicScene, size: [u32; 2]) -> Vec<[f32; 3]> {
    film(scene, size, 2).develop().rgb().unwrap().to_vec()
}

#[track_caller]
fn all_near(scene: &ClassicScene, expected: [f64; 3], tolerance: f64) {
    for pixel in rgb(scene, [8, 6]) {
        for (a, b) in pixel.iter().zip(expected) {
            assert!((f64::from(*a) - b).abs() < tolerance, "{pixel:?} is not {expected:?}");
        }
    }
}

#[test]
fn closed_room_glows_as_the_geometric_series() {
    // L = e · (1 + ρ + ρ² + …), a term for each bounce.
    for bounces in [1, 2, 3, 5] {
        let l: f64 = (0..=bounces).map(|k| 0.2 * 0.5_f64.powi(k)).sum();
        let radiosity = Radiosity { recursion_limit: bounces as u32, ..Radiosity::default() };
        all_near(&room(glowing(0.2), DVec3::ONE, radiosity), [l; 3], 1e-4);
    }
}

#[test]
fn factors_of_gathered_light_as_measured() {
    let three = Radiosity { recursion_limit: 3, ..Radiosity::default() };
    let orange = DVec3::new(1.0, 0.5, 0.0);
    all_near(&room(glowing(0.2), DVec3::ONE, Radiosity { brightness: 0.5, ..three.clone() }), [0.2656; 3], 2e-4);
    all_near(&room(glowing(0.2), orange, Radiosity { gray_threshold: 0.5, ..three.clone() }), [0.3203, 0.1384, 0.0], 3e-4);
    all_near(&room(glowing(0.2), orange, Radiosity { max_sample: 0.2, ..three }), [0.3, 0.1201, 0.0], 5e-4);
}

#[test]
fn ambient_light_counts_in_old_versions_only() {
    let finish = Finish { ambient: DVec3::splat(0.2), emission: DVec3::ZERO, ..glowing(0.0) };
    let mut s = room(finish, DVec3::ONE, Radiosity { recursion_limit: 1, ..Radiosity::default() });
    all_near(&s, [0.0; 3], 1e-9);
    s.settings.version = 360;
    all_near(&s, [0.3; 3], 1e-4);
}

#[test]
fn fog_counts_for_gathering_rays_only_with_media_on() {
    // Measured with an angle of 30°: 0.663, 0.081 and 0.722, 0.063.
    let mut s = room(glowing(0.2), DVec3::ONE, Radiosity { recursion_limit: 1, ..Radiosity::default() });
    s.camera.location = DVec3::ZERO;
    s.fogs.push(Fog { distance: 1.0, color: Color::rgb(0.8, 0.0, 0.0), ..Fog::default() });
    let through = (-1.0_f64).exp();
    all_near(&s, [0.8 * (1.0 - through) + 0.3 * through, 0.3 * through, 0.3 * through], 1e-4);
    if let Some(r) = &mut s.settings.radiosity {
        r.media = true;
    }
    let green = rgb(&s, [4, 3])[5][1];
    assert!((0.2..0.28).contains(&(f64::from(green) / through)), "{green}");
}

#[test]
fn unseen_objects_give_no_light() {
    let floor = |no_radiosity| {
        let mut s = room(glowing(0.4), DVec3::ONE, Radiosity { recursion_limit: 1, ..Radiosity::default() });
        let sphere = Object { no_radiosity, ..(*s.objects[0]).clone() };
        let corners = [DVec3::new(-9.0, -9.0, 0.1), DVec3::new(9.0, 9.0, 0.2)];
        s.objects = vec![Arc::new(sphere), Arc::new(object(Solid::Box { corners }, DVec3::ONE, glowing(0.0)))];
        rgb(&s, [4, 3])[5][0]
    };
    assert!((floor(false) - 0.2).abs() < 1e-4 && floor(true) == 0.0, "{} {}", floor(false), floor(true));
}

/// A room with a lamp and things of every kind of finish in it.
fn furnished(radiosity: Radiosity) -> ClassicScene {
    let mut s = room(glowing(0.05), DVec3::new(0.9, 0.7, 0.5), radiosity);
    let ball = |x: f64, finish| Arc::new(object(Solid::Sphere { center: DVec3::new(x, -0.2, 0.4), radius: 0.2 }, DVec3::ONE, finish));
    let mut mirror = glowing(0.0);
    mirror.reflection.min = DVec3::splat(0.6);
    mirror.reflection.max = DVec3::splat(0.6);
    s.objects.extend([ball(-0.3, glowing(0.0)), ball(0.3, mirror)]);
    s.lights.push(Light::new(DVec3::new(0.2, 0.6, 0.1), DVec3::splat(0.7)));
    s
}

#[test]
fn same_bits_for_any_number_of_threads() {
    for error_bound in [0.05, 1.8] {
        let s = furnished(Radiosity { error_bound, count: 20, recursion_limit: 3, ..Radiosity::default() });
        let one = film(&s, [24, 18], 1).develop();
        assert_eq!(one, film(&s, [24, 18], 2).develop());
        assert_eq!(one, film(&s, [24, 18], 5).develop());
    }
}

#[test]
fn hostile_settings_end() {
    let huge = Radiosity { count: 1_000_000_000, error_bound: 0.0, recursion_limit: 1_000_000, ..Radiosity::default() };
    rgb(&furnished(huge), [1, 1]);
    for bad in [f64::NAN, f64::INFINITY, -1e300, 0.0, 1e300] {
        let hostile = Radiosity {
            error_bound: bad,
            low_error_factor: bad,
            brightness: bad,
            gray_threshold: bad,
            max_sample: bad,
            maximum_reuse: bad,
            minimum_reuse: bad,
            pretrace_start: bad,
            pretrace_end: bad,
            adc_bailout: bad,
            count: 2,
            ..Radiosity::default()
        };
        rgb(&furnished(hostile), [2, 1]);
        let mut far = furnished(Radiosity { count: 2, ..Radiosity::default() });
        far.camera.location = DVec3::splat(bad);
        rgb(&far, [2, 1]);
    }
}
