//! The classic model against pictures of POV-Ray 3.7.0.10.
//!
//! Expected numbers were read from pictures of one pixel, written with 16 bits and `File_Gamma=1.0`, of the same scenes: an orthographic
//! camera that looks along +z at a surface, black background, `assumed_gamma 1`.

use std::sync::Arc;

use etendue_procedural::{Color, Finish, Layer, Pigment, Texture};
use etendue_render::film::{Film, Rect};
use etendue_render::session::job::{self, Plan};
use etendue_render::session::{Cancel, Session, Silent, Stop};
use etendue_scene::desc::classic::{Camera, CameraKind, ClassicScene, FocalBlur, Fog, GlobalSettings, Light, LightKind, Object, Solid};
use etendue_scene::{RenderSettings, SceneDesc, Span};
use glam::DVec3;

fn texture(pigment: Color, finish: Finish) -> Option<Arc<Texture>> {
    Some(Arc::new(Texture::Layers(vec![Layer { pigment: Pigment::Solid(pigment), normal: None, finish: Arc::new(finish) }])))
}

fn object(solid: Solid, pigment: Color, finish: Finish) -> Arc<Object> {
    let mut o = Object::new(Span::default(), solid);
    o.texture = texture(pigment, finish);
    Arc::new(o)
}

/// A slab from z = 0 to z = 1.
fn slab(pigment: Color, finish: Finish) -> Arc<Object> {
    object(Solid::Box { corners: [DVec3::new(-9.0, -9.0, 0.0), DVec3::new(9.0, 9.0, 1.0)] }, pigment, finish)
}

fn scene(objects: Vec<Arc<Object>>, lights: Vec<Light>) -> ClassicScene {
    let camera = Camera {
        kind: CameraKind::Orthographic,
        location: DVec3::new(0.0, 0.0, -5.0),
        right: DVec3::X * 0.001,
        up: DVec3::Y * 0.001,
        ..Camera::default()
    };
    ClassicScene { objects, lights, camera, ..ClassicScene::default() }
}

fn film(scene: ClassicScene, size: [u32; 2], spp: u32, threads: usize) -> Film {
    let mut desc = SceneDesc::new("pov", "test.pov");
    desc.classic = Some(Box::new(scene));
    desc.integrator.name = "whitted".to_owned();
    let settings = RenderSettings { width: Some(size[0]), height: Some(size[1]), spp: Some(spp), ..RenderSettings::default() };
    let plan = Plan::new(&desc, &settings, None).unwrap();
    let mut session = job::prepare(&desc, &settings, &plan, &[]).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(32 << 20).build().unwrap();
    pool.install(|| session.render(&Stop { spp: Some(spp), ..Stop::default() }, &Cancel::default(), &Silent)).unwrap();
    session.into_film()
}

/// The one pixel.
fn pixel(scene: ClassicScene) -> [f32; 3] {
    film(scene, [1, 1], 1, 1).develop().rgb().unwrap()[0]
}

#[track_caller]
fn near(a: [f32; 3], b: [f64; 3]) {
    for (a, b) in a.iter().zip(b) {
        assert!((f64::from(*a) - b).abs() < 2e-4, "{a:?} is not {b:?}");
    }
}

fn sun(degrees: f64) -> Light {
    let a = degrees.to_radians();
    Light::new(DVec3::new(a.sin(), 0.0, -a.cos()) * 1e5, DVec3::ONE)
}

const ORANGE: Color = Color::rgb(0.9, 0.5, 0.2);

fn dark() -> Finish {
    Finish { ambient: DVec3::ZERO, diffuse: 0.0, ..Finish::default() }
}

#[test]
fn lambert_and_ambient() {
    let lit = Finish { diffuse: 0.6, ..dark() };
    near(pixel(scene(vec![slab(ORANGE, lit)], vec![sun(60.0)])), [0.27, 0.15, 0.06]);
    let glowing = Finish { ambient: DVec3::splat(0.5), emission: DVec3::splat(0.1), ..dark() };
    let mut tinted = scene(vec![slab(ORANGE, glowing)], vec![]);
    tinted.settings.ambient_light = DVec3::new(1.0, 0.5, 0.2);
    near(pixel(tinted), [0.54, 0.175, 0.04]);
}

#[test]
fn transparency_of_both_kinds() {
    let ambient = Finish { ambient: DVec3::ONE, ..dark() };
    let see = |filter, transmit| pixel(scene(vec![slab(Color { filter, transmit, ..ORANGE }, ambient.clone())], vec![]));
    near(see(0.3, 0.0), [0.80011, 0.4025, 0.14839]);
    near(see(0.0, 0.3), [0.819, 0.455, 0.182]);
    near(see(0.3, 0.4), [0.4509, 0.2325, 0.0876]);
    near(see(1.0, 0.0), [0.0; 3]);
}

#[test]
fn layers_show_through_each_other() {
    let layer = |color, finish| Layer { pigment: Pigment::Solid(color), normal: None, finish: Arc::new(finish) };
    let stack = |top: Color| {
        let bottom = Finish { ambient: DVec3::ONE, phong: 0.25, phong_size: 1.0, ..dark() };
        let above = Finish { ambient: DVec3::splat(0.5), phong: 0.125, phong_size: 1.0, ..dark() };
        let mut o = Arc::unwrap_or_clone(slab(ORANGE, dark()));
        o.texture = Some(Arc::new(Texture::Layers(vec![layer(ORANGE, bottom), layer(top, above)])));
        Arc::new(o)
    };
    let blue = Color::rgb(0.2, 0.4, 0.6);
    let clear = stack(Color { transmit: 0.5, ..blue });
    near(pixel(scene(vec![clear.clone()], vec![])), [0.5, 0.35, 0.25]);
    near(pixel(scene(vec![clear], vec![sun(0.0)])), [0.75, 0.6, 0.5]);
    let filter = stack(Color { filter: 0.5, ..blue });
    near(pixel(scene(vec![filter.clone()], vec![])), [0.14, 0.2, 0.21]);
    near(pixel(scene(vec![filter], vec![sun(0.0)])), [0.29, 0.375, 0.41]);
}

#[test]
fn fogs() {
    let glowing = Finish { ambient: DVec3::ONE, ..dark() };
    let foggy = |fog: Fog| {
        let mut s = scene(vec![slab(ORANGE, glowing.clone())], vec![]);
        s.fogs = vec![Fog { distance: 5.0, ..fog }];
        pixel(s)
    };
    let blue = Color::rgb(0.2, 0.4, 0.6);
    near(foggy(Fog { color: blue, ..Fog::default() }), [0.45751, 0.43679, 0.45284]);
    near(foggy(Fog { color: Color { filter: 0.3, ..blue }, ..Fog::default() }), [0.37806, 0.40368, 0.44402]);
    near(foggy(Fog { color: Color { filter: 0.2, transmit: 0.3, ..blue }, ..Fog::default() }), [0.40455, 0.41471, 0.44697]);
    let ground = |up, offset| {
        let mut s = scene(vec![slab(Color::rgb(0.0, 0.0, 0.0), dark())], vec![]);
        s.fogs = vec![Fog { kind: 2, distance: 5.0, color: Color::rgb(1.0, 1.0, 1.0), offset, altitude: 1.0, up, ..Fog::default() }];
        pixel(s)
    };
    near(ground(DVec3::Y, -1.0), [0.39347; 3]);
    near(ground(DVec3::new(0.0, 1.0, 1.0), -1.0), [0.60909; 3]);
    near(ground(DVec3::Z, -3.0), [0.47785; 3]);
}

#[test]
fn rays_that_carry_little_are_not_followed() {
    let seen = |amount: f64| {
        let mut s = scene(
            vec![slab(Color::rgb(0.0, 0.0, 0.0), {
                let mut f = dark();
                f.reflection.min = DVec3::splat(amount);
                f.reflection.max = f.reflection.min;
                f
            })],
            vec![],
        );
        s.background = Some(Color::rgb(10.0, 10.0, 10.0));
        pixel(s)
    };
    near(seen(0.0045), [0.045; 3]);
    near(seen(0.0039), [0.0; 3]);
}

#[test]
fn things_nearer_than_a_thousandth_cast_no_shadow() {
    let lit = Finish { diffuse: 1.0, ..dark() };
    let seen = |height: f64| {
        let disc = Solid::Disc { center: DVec3::new(height, 0.0, -height), normal: DVec3::Z, radius: 0.4, hole_radius: 0.0 };
        let mut blocker = Arc::unwrap_or_clone(object(disc, ORANGE, dark()));
        blocker.no_image = true;
        pixel(scene(vec![slab(Color::rgb(1.0, 1.0, 1.0), lit.clone()), Arc::new(blocker)], vec![sun(45.0)]))
    };
    near(seen(9e-4), [0.0; 3]);
    near(seen(5e-4), [std::f64::consts::FRAC_1_SQRT_2; 3]);
}

/// A scene with a bit of everything.
fn mixed() -> ClassicScene {
    let mirror = {
        let mut f = Finish { phong: 0.5, crand: 0.1, ..Finish::default() };
        f.reflection.min = DVec3::splat(0.3);
        f.reflection.max = DVec3::splat(0.8);
        f
    };
    let ball = |x: f64, color, finish| object(Solid::Sphere { center: DVec3::new(x, 0.0, 0.0), radius: 0.9 }, color, finish);
    let glass = {
        let mut o = Arc::unwrap_or_clone(ball(-1.0, Color { filter: 0.5, transmit: 0.4, ..ORANGE }, mirror.clone()));
        o.interior = Some(Arc::new(etendue_scene::desc::classic::Interior { ior: 1.5, ..Default::default() }));
        Arc::new(o)
    };
    let mut soft = Light::new(DVec3::new(3.0, 5.0, -5.0), DVec3::ONE);
    soft.area = Some(etendue_scene::desc::classic::AreaLight {
        axis1: DVec3::X,
        axis2: DVec3::Y,
        size: [4, 4],
        adaptive: Some(1),
        jitter: true,
        circular: true,
        orient: true,
        illumination: false,
    });
    let mut spot = Light::new(DVec3::new(0.0, 8.0, 0.0), DVec3::splat(0.5));
    spot.kind = LightKind::Spot;
    let floor = object(Solid::Plane { normal: DVec3::Y, distance: -1.0 }, Color::rgb(0.8, 0.8, 0.8), Finish::default());
    let mut s = scene(vec![glass, ball(1.0, ORANGE, mirror), floor], vec![soft, spot]);
    s.camera = Camera { location: DVec3::new(0.0, 1.0, -5.0), ..Camera::default() };
    s.background = Some(Color::rgb(0.2, 0.3, 0.5));
    s
}

#[test]
fn threads_and_order_do_not_matter() {
    let one = film(mixed(), [48, 36], 4, 1).develop();
    let three = film(mixed(), [48, 36], 4, 3).develop();
    assert_eq!(one, three);
}

#[test]
fn hostile_numbers_end() {
    for bad in [f64::NAN, f64::INFINITY, 1e300, -1e300, 0.0] {
        let mut s = mixed();
        s.settings = GlobalSettings { max_trace_level: 256, adc_bailout: bad, ..GlobalSettings::default() };
        s.camera.right = DVec3::splat(bad);
        s.fogs = vec![Fog { kind: 2, distance: bad, altitude: bad, offset: bad, ..Fog::default() }];
        for light in &mut s.lights {
            [light.radius, light.falloff, light.tightness, light.fade_distance, light.fade_power] = [bad; 5];
        }
        film(s, [4, 3], 1, 1);
        let mut s = mixed();
        for o in &mut s.objects {
            let o = Arc::make_mut(o);
            let finish = Finish { brilliance: bad, phong: bad, phong_size: bad, roughness: bad, metallic: bad, ..Finish::default() };
            o.texture = texture(Color { rgb: DVec3::splat(bad), filter: bad, transmit: bad }, finish);
            o.interior = Some(Arc::new(etendue_scene::desc::classic::Interior {
                ior: bad,
                fade_distance: bad,
                fade_power: bad,
                caustics: bad,
                ..Default::default()
            }));
        }
        film(s, [4, 3], 1, 1);
    }
}

/// A session of a scene as settings and its own defaults ask for it.
fn session(scene: ClassicScene, settings: &RenderSettings, crop: Option<[u32; 4]>) -> (Session, Stop) {
    let mut desc = SceneDesc::new("pov", "test.pov");
    desc.classic = Some(Box::new(scene));
    desc.integrator.name = "whitted".to_owned();
    let plan = Plan::new(&desc, settings, crop).unwrap();
    let stop = Stop { spp: Some(plan.spp), ..Stop::default() };
    (job::prepare(&desc, settings, &plan, &[]).unwrap(), stop)
}

fn render(session: &mut Session, stop: &Stop, threads: usize) -> Film {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(32 << 20).build().unwrap();
    pool.install(|| session.render(stop, &Cancel::default(), &Silent)).unwrap();
    session.film().clone()
}

fn sized(width: u32, height: u32) -> RenderSettings {
    RenderSettings { width: Some(width), height: Some(height), ..RenderSettings::default() }
}

/// A white half-plane from x = 0.75 on, seen with pixels of 1.
fn edge() -> ClassicScene {
    let glow = Finish { ambient: DVec3::ONE, diffuse: 0.0, ..Finish::default() };
    let corners = [DVec3::new(0.75, -90.0, 0.0), DVec3::new(90.0, 90.0, 1.0)];
    let mut s = scene(vec![object(Solid::Box { corners }, Color::rgb(1.0, 1.0, 1.0), glow)], Vec::new());
    [s.camera.right, s.camera.up] = [DVec3::X * 16.0, DVec3::Y * 12.0];
    s
}

#[test]
fn only_edges_are_smoothed() {
    let (mut session, stop) = session(edge(), &sized(16, 12), None);
    let film = render(&mut session, &stop, 2);
    let picture = film.develop();
    let mut smoothed = 0.0;
    for y in 0..12 {
        for x in 0..16 {
            // Both pixels at the edge, whose centers lie on either side of it; nothing differs within the second.
            let count = film.sample_count(x, y);
            assert!(if x == 8 { count == 9 || count == 5 } else { count == if x == 9 { 5 } else { 1 } }, "{count} {x} {y}");
            let value = picture.rgb().unwrap()[(y * 16 + x) as usize][0];
            let expected = if x < 8 { 0.0 } else { 1.0 };
            if x != 8 {
                assert!((value - expected).abs() < 1e-6, "{x} {value}");
            } else {
                // The center is dark, and so are two of the three columns of the grid; of the third three in four samples are bright. Where
                // neither corner is, nothing more is asked.
                assert!((0.0..0.34).contains(&value), "{value}");
                smoothed += value / 12.0;
            }
        }
    }
    assert!((smoothed - 0.245).abs() < 0.06, "{smoothed}");
    for (settings, count) in [
        (RenderSettings { antialias: Some(0.0), ..sized(16, 12) }, 1),
        (RenderSettings { spp: Some(3), ..sized(16, 12) }, 3),
        (RenderSettings { antialias: Some(3.1), ..sized(16, 12) }, 1),
        (RenderSettings { antialias: Some(0.1), antialias_depth: Some(4), ..sized(16, 12) }, 5),
        (RenderSettings { antialias: Some(0.1), antialias_depth: Some(1), ..sized(16, 12) }, 2),
    ] {
        let (mut session, stop) = self::session(edge(), &settings, None);
        assert_eq!(render(&mut session, &stop, 1).sample_count(9, 5), count);
    }
}

#[test]
fn smoothed_films_do_not_depend_on_threads_and_parts() {
    let settings = sized(48, 36);
    let whole = |threads| {
        let (mut session, stop) = session(mixed(), &settings, None);
        render(&mut session, &stop, threads)
    };
    let one = whole(1);
    assert_eq!(one.develop(), whole(2).develop());
    let count = |n| (0..36).flat_map(|y| (0..48).map(move |x| (x, y))).filter(|&(x, y)| one.sample_count(x, y) == n).count();
    let counts = [1, 5, 9].map(count);
    assert!(counts.iter().zip([200, 30, 50]).all(|(n, least)| *n > least) && counts.iter().sum::<usize>() == 48 * 36, "{counts:?}");
    // Ranges of samples that begin after the centers trace those of their own accord.
    let part = |first, count| {
        let (mut session, _) = session(mixed(), &settings, None);
        session.set_first_sample(first);
        render(&mut session, &Stop { spp: Some(count), ..Stop::default() }, 2)
    };
    let mut merged = part(4, 5);
    merged.merge(&part(0, 1)).unwrap();
    merged.merge(&part(1, 3)).unwrap();
    assert_eq!(one.develop(), merged.develop());
    assert_eq!(one.declared_spp(), merged.declared_spp());
    // So do the borders of a part of the picture.
    let (mut session, stop) = session(mixed(), &settings, Some([11, 7, 30, 29]));
    let crop = render(&mut session, &stop, 2);
    for y in 7..29 {
        for x in 11..30 {
            assert_eq!(crop.sample_count(x, y), one.sample_count(x, y), "{x} {y}");
        }
    }
}

/// The edge, out of focus.
fn blurred_edge(variance: f64) -> ClassicScene {
    let mut s = edge();
    let focal_point = s.camera.location + DVec3::Z * 2.0;
    s.camera.blur = FocalBlur { aperture: 1.5, samples: [4, 40], focal_point, variance, ..FocalBlur::default() };
    s
}

#[test]
fn blurred_pixels_stop_when_their_color_is_known() {
    let settings = sized(48, 36);
    let rendered = |variance, threads| {
        let (mut session, stop) = session(blurred_edge(variance), &settings, None);
        render(&mut session, &stop, threads)
    };
    let counts = |film: &Film| (0..36).flat_map(|y| (0..48).map(move |x| (x, y))).map(|(x, y)| film.sample_count(x, y)).collect::<Vec<_>>();
    let (one, all) = (rendered(0.012, 1), rendered(0.0, 2));
    // Nothing differs far from the edge: three rays after the least number. At the edge an error of √.012 takes up to (1.64 · .5)² / .012 rays, more than there are.
    let n = counts(&one);
    assert!(counts(&all).iter().all(|n| *n == 40) && n.iter().all(|n| *n == 40 || (n - 4) % 3 == 0));
    let [first, middle, last] = [7..8, 13..34, 40..41].map(|range| n.iter().filter(|n| range.contains(*n)).count());
    assert!(first > 600 && middle > 20 && last > 60, "{first} {middle} {last}");
    let (a, b) = (one.develop(), all.develop());
    let pairs = a.rgb().unwrap().into_iter().zip(b.rgb().unwrap());
    let square = pairs.map(|(a, b)| f64::from(a[0] - b[0]).powi(2)).sum::<f64>() / n.len() as f64;
    assert!(square < 0.012 && square > 0.0, "{square}");
    // Threads, parts of the picture and ranges of samples do not matter.
    assert_eq!(a, rendered(0.012, 2).develop());
    let (mut worker, _) = session(blurred_edge(0.012), &settings, None);
    let mut merged = session(blurred_edge(0.012), &settings, None).0.into_film();
    for (rect, first, count) in [([0, 0, 20, 36], 0, 40), ([20, 0, 48, 36], 9, 31), ([20, 0, 48, 36], 0, 9)] {
        worker.set_part(Rect::new(rect[0], rect[1], rect[2], rect[3]), first).unwrap();
        worker.render(&Stop { spp: Some(count), ..Stop::default() }, &Cancel::default(), &Silent).unwrap();
        merged.merge(worker.film()).unwrap();
    }
    assert_eq!(a, merged.develop());
    assert_eq!(n, counts(&merged));
}

#[test]
fn numbers_of_samples_hold_for_all_pixels_and_settings_exclude_each_other() {
    let (mut session, stop) = session(blurred_edge(0.004), &RenderSettings { spp: Some(9), ..sized(4, 3) }, None);
    assert_eq!(render(&mut session, &stop, 1).sample_count(0, 0), 9);
    let mut desc = SceneDesc::new("pov", "test.pov");
    desc.classic = Some(Box::new(edge()));
    for settings in [
        RenderSettings { spp: Some(4), antialias: Some(0.3), ..sized(4, 3) },
        RenderSettings { antialias_depth: Some(0), ..sized(4, 3) },
        RenderSettings { antialias_depth: Some(1000), ..sized(4, 3) },
    ] {
        assert!(Plan::new(&desc, &settings, None).is_err());
    }
}
