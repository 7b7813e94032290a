//! Photons: kept energy, known irradiances, agreement with path tracing, exact merging, files, budgets, hostile scenes.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::cell::Cell;

use etendue_render::accel::Ray;
use etendue_render::film::Film;
use etendue_render::lightmap::SurfaceLight;
use etendue_render::math::{Mat4, Vec3};
use etendue_render::photon::trace::{Keep, Tracer};
use etendue_render::photon::{MapInfo, Photon, PhotonLight, PhotonMap, Route};
use etendue_render::scene::Scene;
use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use support::*;

const PI: f64 = std::f64::consts::PI;

fn map(scene: &Scene, photons: u64, budget: u64) -> PhotonMap {
    let mut map = PhotonMap::new(MapInfo::default());
    map.trace(scene, 0..photons, budget, &|| false, &mut |_, _| {});
    map
}

fn point_light(desc: &mut SceneDesc, position: Vec3, intensity: f32) {
    add(desc, LightDesc::Point { position, intensity: [intensity, 2.0 * intensity, 0.5 * intensity] });
}

/// Both sides of a surface.
fn two_sided(desc: &mut SceneDesc, reflectance: f32) -> BsdfId {
    let side = diffuse(desc, reflectance);
    bsdf(desc, BsdfDesc::TwoSided { front: side, back: side })
}

/// In a closed room with the reflectance ρ the surfaces receive P / (1 − ρ) in all, and absorb P.
#[test]
fn a_closed_room_absorbs_what_its_light_emits() {
    for reflectance in [0.0, 0.5, 0.9, 1.0] {
        let mut desc = scene();
        let wall = two_sided(&mut desc, reflectance);
        shape(&mut desc, GeometryDesc::Cube, Mat4::IDENTITY, Some(wall));
        point_light(&mut desc, Vec3::new(0.3, 0.2, -0.5), 1.0);
        perspective(&mut desc, Vec3::ZERO, Vec3::X, 60.0);
        let scene = compile(&desc, &settings(4, 4, 1));
        let photons = 20_000;
        let m = map(&scene, photons, u64::MAX);
        let received: f64 = m.surface().iter().map(|p| f64::from(p.power[0])).sum::<f64>() * f64::from(m.scale());
        let r = f64::from(reflectance);
        if r == 1.0 {
            // Every photon goes on until it is killed as one of a long path: 32 events, then 20 in the mean; power is kept.
            assert!(m.surface().len() as u64 > 40 * photons, "{}", m.surface().len());
            continue;
        }
        // The number of landings is geometric: standard deviation √ρ / (1 − ρ).
        let error = 4.0 * PI * r.sqrt() / (1.0 - r) / (photons as f64).sqrt();
        let expected = 4.0 * PI / (1.0 - r);
        assert!((received - expected).abs() < 4.0 * error + 1e-3 * expected, "ρ {r}: {received} instead of {expected} ± {error}");
        // Roulette keeps powers: all photons of one point light are alike.
        assert!(m.surface().iter().all(|p| (f64::from(p.power[0]) / (4.0 * PI) - 1.0).abs() < 1e-3));
    }
}

/// Mean relative deviation of a map's irradiance from a known one over points of the plane z = 0, and the largest.
fn deviation(scene: &Scene, light: &PhotonLight, known: impl Fn(Vec3) -> f64) -> (f64, f64) {
    let (mut sum, mut most) = (0.0, 0.0f64);
    for i in 0..100 {
        let p = Vec3::new((i % 10) as f32 * 0.1 - 0.45, (i / 10) as f32 * 0.1 - 0.45, 0.0);
        let s = scene.intersect(&Ray::new(p + Vec3::Z * 0.1, -Vec3::Z)).unwrap();
        let relative = f64::from(light.irradiance(scene, &s)[0]) / known(p) - 1.0;
        sum += relative / 100.0;
        most = most.max(relative.abs());
    }
    (sum, most)
}

#[test]
fn irradiance_under_known_lights() {
    let floor = |f: &dyn Fn(&mut SceneDesc)| {
        let mut desc = scene();
        let white = diffuse(&mut desc, 0.0);
        rectangle(&mut desc, Vec3::ZERO, [3.0; 2], false, Some(white));
        perspective(&mut desc, Vec3::new(0.0, -5.0, 3.0), Vec3::ZERO, 40.0);
        f(&mut desc);
        compile(&desc, &settings(4, 4, 1))
    };
    let at = Vec3::new(0.3, -0.2, 1.5);
    let inverse_square = move |p: Vec3| f64::from((at - p).z) / f64::from((at - p).length()).powi(3);
    type Known = Box<dyn Fn(Vec3) -> f64>;
    let cases: Vec<(&str, Scene, Known)> = vec![
        ("point", floor(&|d| point_light(d, at, 3.0)), Box::new(move |p| 3.0 * inverse_square(p))),
        // A sphere that is wholly above the horizon lights as a point of intensity π L r² does.
        (
            "sphere",
            floor(&|d| {
                let s = sphere(d, at, 0.4, None);
                emit(d, s, Color::gray(7.0));
            }),
            Box::new(move |p| 7.0 * PI * 0.16 * inverse_square(p)),
        ),
        ("sky", floor(&|d| constant_sky(d, 0.6)), Box::new(|_| PI * 0.6)),
        (
            "sun",
            floor(&|d| {
                add(d, LightDesc::Directional { direction: Vec3::new(1.0, 0.0, -2.0), irradiance: [5.0; 3] });
            }),
            Box::new(|_| 5.0 * 2.0 / 5.0f64.sqrt()),
        ),
    ];
    for (name, scene, known) in cases {
        let light = PhotonLight::new(map(&scene, 300_000, u64::MAX), 200, 1.0);
        let (mean, most) = deviation(&scene, &light, &known);
        println!("{name}: {mean:.4} {most:.3}");
        // Two hundred photons at each of few points: about 2% of noise in the mean, measured.
        assert!(mean.abs() < 0.035, "{name}: the mean deviation is {mean}");
        assert!(most < 0.35, "{name}: the largest deviation is {most}");
        // The side away from the light is dark; the sky is on both.
        let mut s = scene.intersect(&Ray::new(Vec3::Z * 0.1, -Vec3::Z)).unwrap();
        (s.ng, s.frame.n) = (-s.ng, -s.frame.n);
        assert!(name == "sky" || light.irradiance(&scene, &s).is_black(), "{name}");
        // A third of the memory: noisier, and right in the mean.
        let full = map(&scene, 300_000, u64::MAX);
        let thinned = map(&scene, 300_000, full.bytes() / 3);
        assert!(thinned.level() == 2 && thinned.bytes() <= full.bytes() / 3);
        let (mean, _) = deviation(&scene, &PhotonLight::new(thinned, 50, 2.0), &known);
        assert!(mean.abs() < 0.08, "{name}: thinned, the mean deviation is {mean}");
    }
}

/// A room with an open front; the light is small, and a glass ball throws a caustic on the floor.
fn room(glossy: bool) -> SceneDesc {
    let mut desc = scene();
    let white = two_sided(&mut desc, 0.7);
    let red = bsdf(&mut desc, BsdfDesc::Diffuse { reflectance: Color::Constant([0.7, 0.2, 0.1]), alpha: None });
    rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, Some(white));
    rectangle(&mut desc, Vec3::new(0.0, 0.0, 2.0), [1.0; 2], true, Some(white));
    let upright = |at: Vec3, turn: Mat4| Mat4::from_translation(at) * turn;
    let quarter = std::f32::consts::FRAC_PI_2;
    shape(&mut desc, GeometryDesc::Rectangle, upright(Vec3::new(-1.0, 0.0, 1.0), Mat4::from_rotation_y(quarter)), Some(red));
    shape(&mut desc, GeometryDesc::Rectangle, upright(Vec3::new(1.0, 0.0, 1.0), Mat4::from_rotation_y(-quarter)), Some(white));
    shape(&mut desc, GeometryDesc::Rectangle, upright(Vec3::new(0.0, 1.0, 1.0), Mat4::from_rotation_x(quarter)), Some(white));
    let ball = if glossy { plastic(0.5, false, Some(0.15)) } else { glass(1.5, None) };
    let ball = bsdf(&mut desc, ball);
    sphere(&mut desc, Vec3::new(0.35, 0.0, 0.45), 0.4, Some(ball));
    let metal = bsdf(&mut desc, mirror(Some(if glossy { 0.3 } else { 0.05 })));
    sphere(&mut desc, Vec3::new(-0.45, 0.3, 0.35), 0.35, Some(metal));
    perspective(&mut desc, Vec3::new(0.0, -3.8, 1.0), Vec3::new(0.0, 0.0, 1.0), 39.0);
    desc
}

fn lamp(desc: &mut SceneDesc) {
    let s = sphere(desc, Vec3::new(0.1, 0.0, 1.7), 0.12, None);
    emit(desc, s, Color::Constant([20.0, 16.0, 12.0]));
}

fn with(integrator: &str, spp: u32, f: impl FnOnce(&mut RenderSettings)) -> RenderSettings {
    let mut s = settings(24, 24, spp);
    s.integrator = Some(integrator.into());
    f(&mut s);
    s
}

/// Means of blocks of 6 × 6 pixels by channel, with the standard error over pictures of several seeds.
fn blocks(desc: &SceneDesc, s: &RenderSettings, seeds: u64) -> Vec<[(f64, f64); 3]> {
    let films: Vec<Film> = render_seeds(desc, s, 77..77 + seeds);
    let means: Vec<Vec<[f64; 3]>> = films
        .iter()
        .map(|film| {
            let image = film.develop();
            let mut sums = vec![[0.0; 3]; 16];
            for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
                for (i, v) in image.channel(name).unwrap().iter().enumerate() {
                    sums[i / 24 / 6 * 4 + i % 24 / 6][c] += f64::from(*v) / 36.0;
                }
            }
            sums
        })
        .collect();
    let n = seeds as f64;
    (0..16)
        .map(|b| {
            std::array::from_fn(|c| {
                let mean = means.iter().map(|m| m[b][c]).sum::<f64>() / n;
                let variance = means.iter().map(|m| (m[b][c] - mean).powi(2)).sum::<f64>() / (n - 1.0) / n;
                (mean, variance.sqrt())
            })
        })
        .collect()
}

/// Blocks agree within 4.5 standard errors and a relative `bias`, and all together within a third of it.
#[track_caller]
fn assert_agree(name: &str, a: &[[(f64, f64); 3]], b: &[[(f64, f64); 3]], bias: f64) {
    let (mut total, mut worst) = ([0.0; 2], (0.0, 0));
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        for c in 0..3 {
            let ((x, sx), (y, sy)) = (a[c], b[c]);
            (total[0], total[1]) = (total[0] + x, total[1] + y);
            let relative = (x - y).abs() / y.max(1e-3);
            worst = if relative > worst.0 { (relative, i) } else { worst };
            let slack = bias * y.abs() + 4.5 * (sx * sx + sy * sy).sqrt() + 1e-5;
            assert!((x - y).abs() <= slack, "{name}: block {i}, channel {c}: {x} ± {sx} instead of {y} ± {sy}");
        }
    }
    let mean = total[0] / total[1] - 1.0;
    println!("{name}: mean {mean:+.4}, worst block {} {:+.3}", worst.1, worst.0);
    assert!(mean.abs() < bias / 2.0, "{name}: the mean is off by {mean}");
}

#[test]
fn photon_methods_agree_with_path_tracing() {
    for glossy in [false, true] {
        let mut desc = room(glossy);
        lamp(&mut desc);
        let reference = blocks(&desc, &with("path", 512, |_| {}), 4);
        let sppm = with("sppm", 48, |s| s.photons = Some(20_000));
        assert_agree(&format!("sppm, glossy {glossy}"), &blocks(&desc, &sppm, 3), &reference, 0.03);
        let maps = |name| {
            with(name, 32, |s| {
                s.photons = Some(150_000);
                s.photon_neighbors = Some(50);
            })
        };
        assert_agree(&format!("photon, glossy {glossy}"), &blocks(&desc, &maps("photon"), 3), &reference, 0.06);
        // Seams along edges are dark.
        assert_agree(&format!("particles, glossy {glossy}"), &blocks(&desc, &maps("particles"), 3), &reference, 0.15);
    }
}

#[test]
fn other_lights_and_path_lengths_agree() {
    let mut sky = room(true);
    let data = (0..16 * 8).flat_map(|i| if i == 37 { [60.0, 50.0, 30.0] } else { [0.4, 0.6, 1.0] }).collect();
    let image = picture(&mut sky, 16, 8, 3, data);
    let mapping = EnvironmentMapping::Equirectangular;
    add(&mut sky, LightDesc::Environment { image, scale: [1.0; 3], world_from_light: Mat4::from_rotation_x(1.2), mapping, portal: None });
    let mut many = room(false);
    for i in 0..40 {
        let (x, y) = ((i % 8) as f32 * 0.24 - 0.84, (i / 8) as f32 * 0.3 - 0.6);
        point_light(&mut many, Vec3::new(x, y, 1.9), if i % 7 == 0 { 0.2 } else { 0.02 });
    }
    for (name, desc, depth) in
        [("sky", &sky, None), ("many lights", &many, None), ("sky, depth 2", &sky, Some(2)), ("depth 1", &many, Some(1))]
    {
        let deep = |s: &mut RenderSettings| s.max_depth = depth;
        let reference = with("path", 512, deep);
        let reference = blocks(desc, &reference, 5);
        let sppm = with("sppm", 40, |s| {
            s.photons = Some(20_000);
            s.max_depth = depth;
        });
        // Point lights through glass are what a path cannot find: the ball's blocks are left out where light is of points.
        let keep = |b: Vec<[(f64, f64); 3]>| -> Vec<_> { if name == "many lights" { b[..8].to_vec() } else { b } };
        assert_agree(name, &keep(blocks(desc, &sppm, 5)), &keep(reference), 0.05);
    }
}

/// A ball on a floor without end under a sky: to the horizon, and from beyond it to the ball.
#[test]
fn floors_without_end_agree() {
    let mut desc = scene();
    let (gray, red) = (diffuse(&mut desc, 0.5), diffuse(&mut desc, 0.8));
    shape(&mut desc, GeometryDesc::Plane, Mat4::IDENTITY, Some(gray));
    sphere(&mut desc, Vec3::new(0.0, 0.0, 0.6), 0.5, Some(red));
    constant_sky(&mut desc, 0.8);
    perspective(&mut desc, Vec3::new(0.0, -6.0, 2.0), Vec3::new(0.0, 0.0, 0.4), 50.0);
    let reference = blocks(&desc, &with("path", 256, |_| {}), 3);
    for (name, spp, photons, bias) in
        [("sppm", 48, 20_000, 0.03), ("photon", 32, 150_000, 0.06), ("particles", 32, 150_000, 0.15), ("pathmap", 64, 20_000, 0.03)]
    {
        let s = with(name, spp, |s| s.photons = Some(photons));
        assert_agree(&format!("endless floor, {name}"), &blocks(&desc, &s, 4), &reference, bias);
    }
}

/// Light in fog, the lamp within it, by points and by beams.
#[test]
fn fog_agrees() {
    let mut desc = room(true);
    lamp(&mut desc);
    let medium = MediumDesc::Homogeneous {
        sigma_a: [0.1, 0.2, 0.3],
        sigma_s: [0.6, 0.5, 0.4],
        emission: [0.0; 3],
        phase: PhaseDesc::HenyeyGreenstein { g: 0.4 },
    };
    let medium = add(&mut desc, medium);
    let border = bsdf(&mut desc, BsdfDesc::Null);
    let place = Mat4::from_translation(Vec3::Z) * Mat4::from_scale(Vec3::splat(0.98));
    let fog = shape(&mut desc, GeometryDesc::Cube, place, Some(border));
    desc.shapes[fog.0 as usize].value.interior = Some(medium);
    let reference = blocks(&desc, &with("path", 256, |_| {}), 3);
    for beams in [false, true] {
        let agrees = |name: &str, spp: u32, photons: u32, bias: f64| {
            let s = with(name, spp, |s| {
                s.photons = Some(photons);
                s.photon_beams = beams;
            });
            assert_agree(&format!("fog, {name}, beams: {beams}"), &blocks(&desc, &s, 3), &reference, bias);
        };
        agrees("sppm", 40, 20_000, 0.05);
        agrees("photon", 32, 100_000, 0.06);
        agrees("particles", 32, 100_000, 0.15);
    }
}

/// A wall between a room with a lamp and one without: the floor beyond the wall's foot stays dark.
#[test]
fn light_does_not_leak_past_the_foot_of_a_wall() {
    let mut desc = scene();
    let white = two_sided(&mut desc, 0.7);
    rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, Some(white));
    rectangle(&mut desc, Vec3::new(0.0, 0.0, 1.0), [1.0; 2], true, Some(white));
    let wall = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.5))
        * Mat4::from_rotation_y(std::f32::consts::FRAC_PI_2)
        * Mat4::from_scale(Vec3::new(0.5, 1.0, 1.0));
    shape(&mut desc, GeometryDesc::Rectangle, wall, Some(white));
    let s = sphere(&mut desc, Vec3::new(-0.5, 0.0, 0.5), 0.1, None);
    emit(&mut desc, s, Color::Constant([20.0; 3]));
    let from = |x: f32| {
        let mut desc = desc.clone();
        perspective(&mut desc, Vec3::new(x, 0.0, 0.4), Vec3::new(0.2 * x, 0.0, 0.0), 30.0);
        desc
    };
    let mean = |x: f32| render(&from(x), &with("sppm", 8, |_| ())).develop().channel("G").unwrap().iter().sum::<f32>() / 576.0;
    let (lit, dark) = (mean(-0.25), mean(0.25));
    assert!(lit > 0.1 && dark < 0.01 * lit, "{dark} beyond the wall, {lit} before it");
}

#[test]
fn errors_of_sppm_fall_with_the_passes() {
    let mut desc = room(false);
    lamp(&mut desc);
    let reference = render(
        &desc,
        &with("sppm", 300, |s| {
            s.photons = Some(30_000);
            s.seed = 99;
        }),
    )
    .develop();
    let error = |spp: u32| {
        let image = render(&desc, &with("sppm", spp, |s| s.photons = Some(10_000))).develop();
        ["R", "G", "B"]
            .iter()
            .flat_map(|c| image.channel(c).unwrap().iter().zip(reference.channel(c).unwrap()))
            .map(|(x, y)| f64::from(x - y).powi(2) / (f64::from(*y).powi(2) + 0.01))
            .sum::<f64>()
            / (3.0 * 24.0 * 24.0)
    };
    let errors = [1, 8, 64].map(error);
    println!("relMSE after 1, 8, 64 passes: {errors:?}");
    assert!(errors[1] < 0.3 * errors[0] && errors[2] < 0.3 * errors[1], "{errors:?}");
}

#[test]
fn passes_merge_exactly_and_threads_do_not_matter() {
    let mut desc = room(false);
    lamp(&mut desc);
    assert_passes_merge(&desc, &with("sppm", 5, |s| s.photons = Some(5000)));
}

#[test]
fn interrupted_maps_go_on_and_merge_into_the_bits_of_one_run() {
    let mut desc = room(false);
    lamp(&mut desc);
    let scene = compile(&desc, &settings(4, 4, 1));
    let whole = map(&scene, 150_000, u64::MAX);
    // Stopped after the first round.
    let rounds = Cell::new(0);
    let mut stopped = PhotonMap::new(MapInfo::default());
    let cancelled = std::sync::atomic::AtomicBool::new(false);
    let is_cancelled = || cancelled.load(std::sync::atomic::Ordering::Relaxed);
    stopped.trace(&scene, 0..150_000, u64::MAX, &is_cancelled, &mut |_, _| {
        rounds.set(rounds.get() + 1);
        cancelled.store(true, std::sync::atomic::Ordering::Relaxed);
    });
    assert_eq!(rounds.get(), 1);
    assert!(stopped.traced() > 0 && stopped.traced() < 150_000);
    stopped.trace(&scene, 0..150_000, u64::MAX, &|| false, &mut |_, _| {});
    assert!(stopped == whole, "going on gives another map");
    // Parts from elsewhere, by one thread.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let part = |range: std::ops::Range<u64>| {
        one.install(|| {
            let mut m = PhotonMap::new(MapInfo::default());
            m.trace(&scene, range, u64::MAX, &|| false, &mut |_, _| {});
            m
        })
    };
    let mut merged = part(70_001..150_000);
    merged.merge(part(0..70_001)).unwrap();
    assert!(merged == whole, "merging gives another map");
    assert!(merged.merge(part(100..101)).is_err(), "photons that are there already");
}

#[test]
fn a_map_on_disk_serves_several_views_of_its_scene_only() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("photon-maps");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("room.photons");
    let mut desc = room(false);
    lamp(&mut desc);
    let photons = 30_000;
    let mut m = PhotonMap::new(MapInfo { scene_hash: desc.light_hash(), seed: 5, max_depth: None });
    m.trace(&compile(&desc, &settings(4, 4, 1)), 0..photons, u64::MAX, &|| false, &mut |_, _| {});
    m.save(&path).unwrap();
    for integrator in ["particles", "photon"] {
        let view = |desc: &SceneDesc, file: bool| {
            let s = with(integrator, 2, |s| {
                s.seed = 5;
                s.photons = Some(photons as u32);
                s.photon_map = file.then(|| path.to_str().unwrap().to_owned());
            });
            let mut session = session(desc, &s);
            session.render(&Stop { spp: Some(2), ..Stop::default() }, &Cancel::default(), &Silent).map(|_| session.into_film().develop())
        };
        let mut other = desc.clone();
        other.cameras.clear();
        perspective(&mut other, Vec3::new(0.7, -2.0, 1.5), Vec3::new(0.0, 0.0, 0.6), 60.0);
        for desc in [&desc, &other] {
            assert_eq!(view(desc, true).unwrap(), view(desc, false).unwrap(), "{integrator}: the file's picture differs");
        }
        let mut moved = desc.clone();
        moved.shapes[0].value.world_from_object = Mat4::from_translation(Vec3::Z * 0.01);
        let error = view(&moved, true).unwrap_err().to_string();
        assert!(error.contains("another scene"), "{error}");
    }
    std::fs::write(&path, b"ETNDPHOTgarbage").unwrap();
    let s = with("particles", 1, |s| s.photon_map = Some(path.to_str().unwrap().to_owned()));
    let error = session(&desc, &s).render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent);
    assert!(error.unwrap_err().to_string().contains("truncated"));
    std::fs::remove_file(&path).unwrap();
}

#[test]
fn light_groups_add_up() {
    let mut desc = room(false);
    lamp(&mut desc);
    desc.shapes.last_mut().unwrap().name = "lamp".into();
    desc.shapes.last_mut().unwrap().value.emission.as_mut().unwrap().group = "lamp".into();
    point_light(&mut desc, Vec3::new(-0.5, -0.5, 1.5), 0.3);
    desc.lights.last_mut().unwrap().name = "point".into();
    for integrator in ["sppm", "photon", "particles"] {
        let s = with(integrator, 2, |s| {
            s.photons = Some(10_000);
            s.light_groups = true;
        });
        let image = render(&desc, &s).develop();
        let group = |name: &str| image.channel(&format!("light.{name}.R")).unwrap_or_else(|| panic!("no {name}")).to_vec();
        let (lamp, point) = (group("lamp"), group("point"));
        let total = image.channel("R").unwrap();
        assert!(lamp.iter().any(|v| *v > 0.0) && point.iter().any(|v| *v > 0.0));
        for i in 0..total.len() {
            assert!((lamp[i] + point[i] - total[i]).abs() <= 1e-3 * total[i] + 1e-6, "{integrator}, pixel {i}");
        }
    }
}

#[test]
fn hostile_scenes_render_dark_and_do_not_hang() {
    let black = |desc: &SceneDesc, name: &str, integrator: &str| {
        let s = with(integrator, 2, |s| s.photons = Some(3000));
        let image = render(desc, &s).develop();
        let values = image.channel("G").unwrap();
        assert!(values.iter().all(|v| v.is_finite()), "{name}, {integrator}");
        values.iter().all(|v| *v == 0.0)
    };
    for integrator in ["particles", "photon", "sppm"] {
        assert!(black(&room(false), "no light", integrator));
        let mut away = room(false);
        let s = rectangle(&mut away, Vec3::new(0.0, 0.0, 5.0), [1.0; 2], false, None);
        emit(&mut away, s, Color::gray(5.0));
        assert!(black(&away, "a light that shines away", integrator));
        let mut zero = room(false);
        point_light(&mut zero, Vec3::Z, 0.0);
        assert!(black(&zero, "no power", integrator));
        // Nothing but a sky.
        let mut empty = scene();
        constant_sky(&mut empty, 1.0);
        perspective(&mut empty, Vec3::ZERO, Vec3::X, 60.0);
        black(&empty, "nothing", integrator);
        // Extreme sizes and powers, a plane without end, white mirrors that face each other.
        for (radius, radiance) in [(1e-18, 1e30), (1e15, 1.0), (0.1, f32::MAX), (0.1, f32::MIN_POSITIVE)] {
            let mut desc = room(false);
            let s = sphere(&mut desc, Vec3::new(0.0, 0.0, 1.5), radius, None);
            emit(&mut desc, s, Color::gray(radiance));
            shape(&mut desc, GeometryDesc::Plane, Mat4::from_translation(Vec3::NEG_Z), None);
            let ideal = bsdf(&mut desc, mirror(None));
            rectangle(&mut desc, Vec3::new(0.0, 0.0, 1.2), [0.3; 2], true, Some(ideal));
            rectangle(&mut desc, Vec3::new(0.0, 0.0, 1.1), [0.3; 2], false, Some(ideal));
            let s = with(integrator, 1, |s| s.photons = Some(3000));
            let film = render_any(&desc, &s);
            assert!(film.develop().channel("G").unwrap().iter().all(|v| v.is_finite()));
        }
    }
}

/// Renders where samples may be no numbers.
fn render_any(desc: &SceneDesc, s: &RenderSettings) -> Film {
    let mut session = session(desc, s);
    session.render(&Stop { spp: s.spp, ..Stop::default() }, &Cancel::default(), &Silent).unwrap();
    session.into_film()
}

#[test]
fn wrong_settings_are_refused() {
    let desc = room(false);
    for (what, f) in [
        ("photons", &(|s: &mut RenderSettings| s.photons = Some(0)) as &dyn Fn(&mut RenderSettings)),
        ("photon_radius", &|s| s.photon_radius = Some(-1.0)),
        ("photon_neighbors", &|s| s.photon_neighbors = Some(1000)),
    ] {
        let s = with("sppm", 1, f);
        let plan = etendue_render::session::job::Plan::new(&desc, &s, None).unwrap();
        let error = etendue_render::session::job::prepare(&desc, &s, &plan, &[]).err().unwrap().to_string();
        assert!(error.contains(what), "{error}");
    }
    let s = with("sppm", 1, |s| s.photon_map = Some("x.photons".into()));
    let error = session(&desc, &s).render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent).unwrap_err();
    assert!(error.to_string().contains("cannot use a photon map"));
}

/// In scenes of POV-Ray the light of a lamp falls on what casts no shadow, and on what is behind it.
#[test]
fn what_casts_no_shadow_lets_photons_through() {
    let lit = |panel: &str| {
        let text = format!(
            "#version 3.7; camera {{ location <0, 3, -5> look_at 0 }} light_source {{ 3*y rgb 1 }}
            disc {{ 0, y, 2 pigment {{ rgb 0 }} }} {panel}"
        );
        let desc = etendue_scene::formats::pov::read_bytes(std::path::Path::new("t.pov"), text.as_bytes(), &Default::default()).unwrap();
        let scene = compile(&desc, &with("particles", 1, |_| {}));
        let m = map(&scene, 60_000, u64::MAX);
        let power = |low: bool| m.surface().iter().filter(|p| (p.p[1] < 0.5) == low).map(|p| f64::from(p.power[0])).sum::<f64>();
        [power(true), power(false)]
    };
    let panel = |words: &str| lit(&format!("box {{ <-0.6, 1, -0.6>, <0.6, 1.02, 0.6> pigment {{ rgb 0 }} {words} }}"));
    let (hidden, through) = (panel(""), panel("no_shadow"));
    println!("{hidden:?} {through:?}");
    // The panel is a body: light that goes through it meets its lower face from within as well.
    let expected = [hidden[0] + hidden[1], 2.0 * hidden[1]];
    for (found, expected) in through.into_iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < 0.08, "{through:?} instead of {expected}");
    }
}

/// Photons know how they came.
#[test]
fn routes() {
    let mut desc = room(false);
    lamp(&mut desc);
    let scene = compile(&desc, &settings(4, 4, 1));
    let count = |keep: Keep, route: Route| {
        let tracer = Tracer::new(&scene, 0, u32::MAX, keep);
        let deposits = tracer.trace(0, 0..20_000, 0);
        deposits.surface.iter().filter(|p| p.route() == route).count()
    };
    for route in [Route::Direct, Route::Caustic, Route::Indirect] {
        let all = count(Keep::ALL, route);
        assert!(all > 500, "{route:?}: {all}");
        let [direct, caustic, indirect] = [Route::Direct, Route::Caustic, Route::Indirect].map(|r| r == route);
        let only = Keep { direct, caustic, indirect, ..Keep::ALL };
        assert_eq!(count(only, route), all);
    }
    // Those that are scattered by glass first: all caustics, and of the others as many as do not end before.
    let tracer = |keep| Tracer::new(&scene, 0, u32::MAX, keep).trace(0, 0..20_000, 0);
    let (all, focused) = (tracer(Keep::ALL).surface, tracer(Keep::FOCUSED).surface);
    let of = |photons: &[Photon], route: Route| photons.iter().filter(|p| p.route() == route).count();
    assert_eq!(of(&focused, Route::Caustic), of(&all, Route::Caustic));
    assert_eq!(of(&focused, Route::Direct), 0);
    assert!((100..of(&all, Route::Indirect) / 2).contains(&of(&focused, Route::Indirect)));
    // A path of length 1 is direct light.
    let tracer = Tracer::new(&scene, 0, 1, Keep::ALL);
    assert!(tracer.trace(0, 0..2000, 0).surface.iter().all(|p| p.depth() == 0 && p.route() == Route::Direct));
}
