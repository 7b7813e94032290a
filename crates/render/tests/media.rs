//! Participating media against closed forms, quadrature and each other.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::f64::consts::PI;
use std::sync::Arc;

use etendue_render::accel::Ray;
use etendue_render::film::Film;
use etendue_render::medium::{GridMedium, Homogeneous, Medium, Phase, Volume};
use etendue_render::sampler::HashRng;
use etendue_render::spectrum::Spectrum;
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use support::statistics::{Blocks, assert_known, assert_same};
use support::*;

fn ramp_volume(n: u32) -> VolumeDesc {
    // Values at the middles of the cells of a function that is linear in x: linear look-ups give it back between the outermost middles.
    let data = (0..n * 2 * 2).map(|i| ((i % n) as f32 + 0.5) / n as f32).collect();
    VolumeDesc {
        size: [n, 2, 2],
        channels: 1,
        data,
        world_from_volume: Mat4::from_scale(Vec3::new(2.0, 1.0, 1.0)),
        filter: VolumeFilter::Linear,
        wrap: VolumeWrap::Clamp,
    }
}

fn grid(desc: &VolumeDesc, factor: [f32; 3], albedo: [f32; 3], emission: Option<[f32; 3]>) -> Medium {
    let volume = Arc::new(Volume::new(desc));
    let medium = GridMediumDesc {
        extinction: FieldDesc { factor, volume: Some(VolumeId(0)) },
        scattering: ScatteringDesc::Albedo(FieldDesc::constant(albedo)),
        emission: emission.map(|e| MediumEmissionDesc { source: EmissionSource::Field(FieldDesc::constant(e)), by_absorption: true }),
        phase: PhaseDesc::Isotropic,
    };
    Medium::Grid(Box::new(GridMedium::new(&medium, &[volume])))
}

/// Mean and standard error of many estimates.
fn mean(n: u64, mut f: impl FnMut(&mut HashRng) -> Spectrum) -> [(f64, f64); 3] {
    let (mut sum, mut squares) = ([0.0; 3], [0.0; 3]);
    let mut rng = HashRng::new(7);
    for _ in 0..n {
        let v = f(&mut rng).rgb().map(f64::from);
        for k in 0..3 {
            sum[k] += v[k];
            squares[k] += v[k] * v[k];
        }
    }
    let n = n as f64;
    [0, 1, 2].map(|k| (sum[k] / n, ((squares[k] / n - (sum[k] / n).powi(2)).max(0.0) / n).sqrt()))
}

/// Panics unless each lane is within four and a half standard errors.
fn assert_mean(what: &str, found: [(f64, f64); 3], known: [f64; 3]) {
    for k in 0..3 {
        let (m, e) = found[k];
        assert!((m - known[k]).abs() <= 4.5 * e + 1e-4 * known[k].abs() + 1e-9, "{what}: lane {k}: {m} ± {e} instead of {}", known[k]);
        assert!(e <= 0.02 * known[k].abs().max(0.1), "{what}: too noisy to find anything: {e}");
    }
}

/// Optical depth of the ramp from x = a to b for a factor of 1: density x / 2 in the world, flat in the outer half cells.
fn ramp_depth(n: f64, a: f64, b: f64) -> f64 {
    let density = |x: f64| (0.5 * x).clamp(0.5 / n, 1.0 - 0.5 / n);
    let steps = 20_000;
    let h = (b - a) / f64::from(steps);
    (0..steps).map(|i| density(a + (f64::from(i) + 0.5) * h) * h).sum()
}

#[test]
fn ratio_tracking_agrees_with_the_closed_form() {
    let desc = ramp_volume(32);
    let factor = [3.0, 1.0, 0.2];
    let medium = grid(&desc, factor, [0.5; 3], None);
    let ray = Ray::new(Vec3::new(0.25, 0.5, 0.5), Vec3::X);
    for t_max in [0.4f32, 1.0, f32::INFINITY] {
        let end = f64::from(0.25 + t_max).min(2.0);
        let depth = ramp_depth(32.0, 0.25, end);
        let known = factor.map(|f| (-f64::from(f) * depth).exp());
        assert_mean("ramp", mean(40_000, |rng| medium.transmittance(&ray, t_max, rng)), known);
    }
    // From outside, and past the medium.
    let ray = Ray::new(Vec3::new(-3.0, 0.5, 0.5), Vec3::X);
    let known = factor.map(|f| (-f64::from(f) * ramp_depth(32.0, 0.0, 2.0)).exp());
    assert_mean("from outside", mean(40_000, |rng| medium.transmittance(&ray, f32::INFINITY, rng)), known);
    let past = Ray::new(Vec3::new(-3.0, 1.5, 0.5), Vec3::X);
    assert_eq!(medium.transmittance(&past, f32::INFINITY, &mut HashRng::new(1)).rgb(), [1.0; 3]);
}

#[test]
fn delta_tracking_scatters_where_the_closed_form_says() {
    let desc = ramp_volume(32);
    let factor = [4.0, 1.0, 0.3];
    let albedo = [0.9, 0.5, 1.0];
    let medium = grid(&desc, factor, albedo, None);
    let ray = Ray::new(Vec3::new(0.0, 0.5, 0.5), Vec3::X);
    let throughput = Spectrum::from_rgb([0.2, 1.0, 0.6]);
    // The share that is scattered within each quarter of the way, and the share that passes, lane by lane.
    for quarter in 0..5 {
        let found = mean(60_000, |rng| {
            let u = rng.next_1d();
            let flight = medium.sample_flight(&ray, f32::INFINITY, throughput, u, rng);
            let where_to = flight.scattered_at.map_or(4, |t| (t * 2.0) as usize);
            if where_to == quarter { flight.weight } else { Spectrum::ZERO }
        });
        let depth = |x: f64| if x > 0.0 { ramp_depth(32.0, 0.0, x) } else { 0.0 };
        let known = [0, 1, 2].map(|k| {
            let t = |x: f64| (-f64::from(factor[k]) * depth(x)).exp();
            let q = quarter as f64;
            if quarter == 4 { t(2.0) } else { f64::from(albedo[k]) * (t(0.5 * q) - t(0.5 * (q + 1.0))) }
        });
        assert_mean(&format!("quarter {quarter}"), found, known);
    }
}

#[test]
fn flights_in_homogeneous_media_agree_with_the_closed_form_in_every_lane() {
    let (a, s, e) = ([0.5f32, 0.0, 2.0], [2.0f32, 0.7, 0.1], [0.3f32, 0.0, 1.0]);
    let medium = Homogeneous::new(a, s, e, Phase::Isotropic);
    let throughput = Spectrum::from_rgb([0.1, 1.0, 2.0]);
    let (near, far) = (0.6f32, 1.7f32);
    let t = |k: usize, x: f32| (-f64::from(a[k] + s[k]) * f64::from(x)).exp();
    let share = |what: usize| {
        mean(60_000, |rng| {
            let flight = medium.sample_flight(far, throughput, rng.next_1d());
            let found = flight.scattered_at.map_or(2, |t| usize::from(t >= near));
            if found == what { flight.weight } else { Spectrum::ZERO }
        })
    };
    let albedo = |k: usize| f64::from(s[k]) / f64::from(a[k] + s[k]);
    assert_mean("near", share(0), [0, 1, 2].map(|k| albedo(k) * (1.0 - t(k, near))));
    assert_mean("far", share(1), [0, 1, 2].map(|k| albedo(k) * (t(k, near) - t(k, far))));
    assert_mean("beyond", share(2), [0, 1, 2].map(|k| t(k, far)));
    let emitted = medium.emitted(far).rgb().map(f64::from);
    for k in 0..3 {
        let known = f64::from(e[k]) * (1.0 - t(k, far)) / f64::from(a[k] + s[k]);
        assert!((emitted[k] - known).abs() < 1e-5, "{k}: {} {known}", emitted[k]);
    }
    // The density is that of the samples: it integrates to the share that does not pass.
    let lanes = Homogeneous::lanes(throughput);
    let steps = 2000;
    let inside: f64 = (0..steps).map(|i| f64::from(medium.pdf_flight((i as f32 + 0.5) * far / steps as f32, lanes))).sum::<f64>();
    assert!((inside * f64::from(far) / f64::from(steps) + f64::from(medium.probability_to_pass(far, lanes)) - 1.0).abs() < 1e-4);
}

#[test]
fn grids_glow_as_the_closed_form_says() {
    // Density 1 in a unit cube: emission = absorption · color.
    let mut desc = ramp_volume(4);
    desc.data.fill(1.0);
    desc.world_from_volume = Mat4::IDENTITY;
    let factor = [2.0, 1.0, 0.5];
    let color = [1.0, 2.0, 0.5];
    let ray = Ray::new(Vec3::new(-1.0, 0.5, 0.5), Vec3::X);
    for albedo in [0.0, 0.5] {
        let medium = grid(&desc, factor, [albedo; 3], Some(color));
        let known = [0, 1, 2].map(|k| f64::from(color[k] * (1.0 - albedo)) * (1.0 - (-f64::from(factor[k])).exp()));
        assert_mean("crossing", mean(40_000, |rng| medium.cross(&ray, 10.0, rng).emitted), known);
        let flight = |rng: &mut HashRng| {
            let u = rng.next_1d();
            medium.sample_flight(&ray, 10.0, Spectrum::ONE, u, rng).emitted
        };
        assert_mean("flight", mean(40_000, flight), known);
    }
}

#[test]
fn hostile_media_end_in_bounded_time_with_numbers() {
    let odd = [0.0, 1e-38, 1.0, 1e38, f32::MAX];
    for a in odd {
        for s in odd {
            let medium = Homogeneous::new([a; 3], [s, 0.0, a], [s; 3], Phase::Isotropic);
            for t_max in [0.0, 1e-30, 1.0, 1e30, f32::INFINITY] {
                let flight = medium.sample_flight(t_max, Spectrum::ONE, 0.5);
                assert!(flight.weight.is_finite() && flight.emitted.is_finite(), "{a} {s} {t_max} {flight:?}");
            }
            let mut desc = ramp_volume(8);
            desc.data[5] = a;
            desc.data[9] = s;
            let medium = grid(&desc, [a, 1.0, s], [0.3; 3], Some([s; 3]));
            let mut rng = HashRng::new(2);
            for d in [Vec3::X, Vec3::new(0.6, 0.8, 0.0), Vec3::NEG_Z] {
                let ray = Ray::new(Vec3::new(0.1, 0.5, 0.5), d);
                let u = rng.next_1d();
                let flight = medium.sample_flight(&ray, f32::INFINITY, Spectrum::ONE, u, &mut rng);
                assert!(flight.weight.is_finite(), "{a} {s} {flight:?}");
                assert!(medium.transmittance(&ray, f32::INFINITY, &mut rng).is_finite());
            }
        }
    }
}

// Scenes.

fn films(desc: &SceneDesc, settings: &RenderSettings) -> Vec<Film> {
    render_seeds(desc, settings, 0..4)
}

fn homogeneous(desc: &mut SceneDesc, sigma_a: [f32; 3], sigma_s: [f32; 3], g: f32) -> MediumId {
    let phase = if g == 0.0 { PhaseDesc::Isotropic } else { PhaseDesc::HenyeyGreenstein { g } };
    add(desc, MediumDesc::Homogeneous { sigma_a, sigma_s, emission: [0.0; 3], phase })
}

/// A cube [−1, 1]³ around a medium, whose faces are a model.
fn filled(desc: &mut SceneDesc, model: BsdfDesc, medium: MediumId) -> ShapeId {
    let material = bsdf(desc, model);
    let s = shape(desc, GeometryDesc::Cube, Mat4::IDENTITY, Some(material));
    desc.shapes[s.0 as usize].value.interior = Some(medium);
    s
}

/// A lumpy grid medium over the cube [−1, 1]³ that scatters all light.
fn lumps(desc: &mut SceneDesc, density: f32, albedo: [f32; 3]) -> MediumId {
    let n = 12u32;
    let data = (0..n * n * n).map(|i| if (i * 7919) % 5 < 2 { 2.0 } else { 0.1 }).collect();
    let volume = VolumeDesc {
        size: [n; 3],
        channels: 1,
        data,
        world_from_volume: Mat4::from_translation(Vec3::NEG_ONE) * Mat4::from_scale(Vec3::splat(2.0)),
        filter: VolumeFilter::Linear,
        wrap: VolumeWrap::Clamp,
    };
    let volume = add(desc, volume);
    let medium = GridMediumDesc {
        extinction: FieldDesc { factor: [density, 0.6 * density, 0.3 * density], volume: Some(volume) },
        scattering: ScatteringDesc::Albedo(FieldDesc::constant(albedo)),
        emission: None,
        phase: PhaseDesc::HenyeyGreenstein { g: 0.5 },
    };
    add(desc, MediumDesc::Grid(Box::new(medium)))
}

#[test]
fn white_media_under_a_white_sky_are_not_seen() {
    let look = |desc: &mut SceneDesc| {
        constant_sky(desc, 1.5);
        perspective(desc, Vec3::new(2.0, 1.5, 3.0), Vec3::ZERO, 45.0);
    };
    let settings = settings(8, 8, 64);
    let mut desc = scene();
    let medium = homogeneous(&mut desc, [0.0; 3], [3.0, 1.0, 0.2], 0.3);
    filled(&mut desc, BsdfDesc::Null, medium);
    look(&mut desc);
    assert_known("fog in a box", &films(&desc, &settings), 4, [1.5; 3], 0.03);
    let mut desc = scene();
    let medium = lumps(&mut desc, 3.0, [1.0; 3]);
    filled(&mut desc, BsdfDesc::Null, medium);
    look(&mut desc);
    assert_known("smoke in a box", &films(&desc, &settings), 4, [1.5; 3], 0.03);
    // The same within glass, whose light is neither lost nor gained.
    let mut desc = scene();
    let medium = lumps(&mut desc, 1.0, [1.0; 3]);
    filled(&mut desc, glass(1.3, None), medium);
    look(&mut desc);
    assert_known("smoke in glass", &films(&desc, &settings), 4, [1.5; 3], 0.03);
}

/// A camera in a fog that fills everything, a point light beside its axis, and a black wall.
fn light_in_fog(sigma_a: [f32; 3], sigma_s: [f32; 3], g: f32) -> SceneDesc {
    let mut desc = scene();
    let medium = homogeneous(&mut desc, sigma_a, sigma_s, g);
    let black = diffuse(&mut desc, 0.0);
    rectangle(&mut desc, Vec3::new(0.0, 0.0, -4.0), [50.0; 2], false, Some(black));
    add(&mut desc, LightDesc::Point { position: Vec3::new(0.4, 0.0, -2.0), intensity: [3.0, 2.0, 1.0] });
    orthographic(&mut desc, Vec3::ZERO, Vec3::NEG_Z, 1e-3);
    desc.cameras[0].value.medium = Some(medium);
    desc
}

#[test]
fn single_scattering_of_a_point_light_is_the_integral_along_the_ray() {
    let (a, s, g) = ([0.1f32, 0.0, 0.3], [0.5f32, 0.2, 0.05], 0.6f32);
    let desc = light_in_fog(a, s, g);
    let known = [0, 1, 2].map(|k| {
        let sigma = f64::from(a[k] + s[k]);
        let steps = 100_000;
        let h = 4.0 / f64::from(steps);
        let intensity = [3.0, 2.0, 1.0][k];
        (0..steps)
            .map(|i| {
                let t = (f64::from(i) + 0.5) * h;
                let (dx, dz) = (0.4f64, t - 2.0);
                let d2 = dx * dx + dz * dz;
                // Light flies from the light to the point and is turned towards the camera, +z.
                let cos = -dz / d2.sqrt();
                let g = f64::from(g);
                let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cos).powf(1.5));
                (-sigma * (t + d2.sqrt())).exp() * f64::from(s[k]) * phase * intensity / d2 * h
            })
            .sum()
    });
    let settings = RenderSettings { max_depth: Some(1), ..settings(16, 16, 64) };
    assert_known("single scattering", &films(&desc, &settings), 16, known, 0.02);
}

#[test]
fn grid_media_of_one_value_are_homogeneous_media() {
    let make = |as_grid: bool| {
        let mut desc = scene();
        let (a, s) = ([0.2, 0.5, 0.1], [1.0, 0.5, 2.0]);
        let medium = if as_grid {
            let volume = VolumeDesc {
                size: [5, 4, 3],
                channels: 3,
                data: (0..60).flat_map(|_| [0, 1, 2].map(|k| a[k] + s[k])).collect(),
                world_from_volume: Mat4::from_translation(Vec3::splat(-1.5)) * Mat4::from_scale(Vec3::splat(3.0)),
                filter: VolumeFilter::Nearest,
                wrap: VolumeWrap::Zero,
            };
            let volume = add(&mut desc, volume);
            let medium = GridMediumDesc {
                extinction: FieldDesc { factor: [1.0; 3], volume: Some(volume) },
                scattering: ScatteringDesc::Coefficient(FieldDesc::constant(s)),
                emission: None,
                phase: PhaseDesc::Rayleigh,
            };
            add(&mut desc, MediumDesc::Grid(Box::new(medium)))
        } else {
            add(&mut desc, MediumDesc::Homogeneous { sigma_a: a, sigma_s: s, emission: [0.0; 3], phase: PhaseDesc::Rayleigh })
        };
        filled(&mut desc, BsdfDesc::Null, medium);
        let white = diffuse(&mut desc, 0.7);
        rectangle(&mut desc, Vec3::new(0.0, 0.0, -1.5), [4.0; 2], false, Some(white));
        let lamp = rectangle(&mut desc, Vec3::new(0.0, 0.5, 3.0), [0.6; 2], true, Some(white));
        emit(&mut desc, lamp, Color::gray(10.0));
        perspective(&mut desc, Vec3::new(4.0, 1.0, 2.0), Vec3::ZERO, 40.0);
        desc
    };
    let settings = settings(8, 8, 64);
    let [a, b] = [true, false].map(|g| Blocks::new(&films(&make(g), &settings), 4));
    assert_same("grid and homogeneous", &a, &b, 1e-4, 0.06);
}

#[test]
fn equiangular_sampling_changes_the_noise_only() {
    // Two small area lights and a point light in fog with a mirror, so that all three techniques meet; and a fog of colors.
    let mut desc = scene();
    let medium = homogeneous(&mut desc, [0.05, 0.1, 0.3], [0.4, 0.2, 0.1], 0.5);
    let gray = diffuse(&mut desc, 0.5);
    rectangle(&mut desc, Vec3::new(0.0, 0.0, -3.0), [6.0; 2], false, Some(gray));
    let lamp = sphere(&mut desc, Vec3::new(0.6, 0.2, -1.0), 0.15, Some(gray));
    emit(&mut desc, lamp, Color::gray(30.0));
    let lamp = rectangle(&mut desc, Vec3::new(-0.8, 0.3, -0.5), [0.2; 2], true, Some(gray));
    emit(&mut desc, lamp, Color::gray(20.0));
    add(&mut desc, LightDesc::Point { position: Vec3::new(-0.3, -0.6, -1.5), intensity: [1.0, 2.0, 3.0] });
    perspective(&mut desc, Vec3::new(0.0, 0.0, 1.5), Vec3::new(0.0, 0.0, -3.0), 60.0);
    desc.cameras[0].value.medium = Some(medium);
    let settings = settings(12, 12, 128);
    for depth in [1, 6] {
        let [with, without] = [true, false].map(|e| by_technique(&desc, &settings, e, depth));
        assert_same(&format!("equiangular to depth {depth}"), &with, &without, 0.0, 0.2);
    }
    // Where it matters, it helps a lot.
    let desc = light_in_fog([0.0; 3], [0.3; 3], 0.0);
    let [with, without] = [true, false].map(|e| by_technique(&desc, &settings, e, 1));
    assert_same("equiangular beside a point light", &with, &without, 0.0, 0.2);
    assert!(with.noise() < 0.3 * without.noise(), "{} instead of {}", with.noise(), without.noise());
}

fn by_technique(desc: &SceneDesc, settings: &RenderSettings, equiangular: bool, max_depth: u32) -> Blocks {
    let film = |seed| {
        let s = RenderSettings { seed, ..settings.clone() };
        let mut path = etendue_render::integrator::Path::new(max_depth, 4);
        path.equiangular = equiangular;
        finish(session_of(compile(desc, &s), Box::new(path), &s), &s)
    };
    Blocks::new(&(0..4).map(film).collect::<Vec<Film>>(), 4)
}

#[test]
fn methods_without_scattering_attenuate_and_say_so() {
    // Straight down through half a unit of a medium on a floor that emits 2.
    let (a, s) = ([0.5f32, 1.0, 0.0], [0.5f32, 2.0, 0.4]);
    let mut desc = scene();
    let black = diffuse(&mut desc, 0.0);
    let floor = rectangle(&mut desc, Vec3::ZERO, [50.0; 2], false, Some(black));
    emit(&mut desc, floor, Color::gray(2.0));
    let medium = homogeneous(&mut desc, a, s, 0.0);
    let nothing = bsdf(&mut desc, BsdfDesc::Null);
    let place = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.75)) * Mat4::from_scale(Vec3::new(20.0, 20.0, 0.25));
    let slab = shape(&mut desc, GeometryDesc::Cube, place, Some(nothing));
    desc.shapes[slab.0 as usize].value.interior = Some(medium);
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO, 0.1);
    let through = [0, 1, 2].map(|k| (-0.5 * f64::from(a[k] + s[k])).exp());
    let of = |integrator: &str| RenderSettings { integrator: Some(integrator.into()), ..settings(8, 8, 4) };
    assert_known("whitted", &films(&desc, &of("whitted")), 8, through.map(|t| 2.0 * t), 1e-3);
    // No one else is near: all of the sky, seen through the medium; the floor's normal is +z.
    assert_known("ao", &films(&desc, &of("ao")), 8, through, 1e-3);
    assert_known("normals", &films(&desc, &of("normals")), 8, [0.5 * through[0], 0.5 * through[1], through[2]], 1e-3);
    let mut whitted = session(&desc, &of("whitted"));
    let stop = etendue_render::session::Stop { spp: Some(1), ..Default::default() };
    whitted.render(&stop, &etendue_render::session::Cancel::default(), &etendue_render::session::Silent).unwrap();
    assert!(whitted.notes().iter().any(|n| n.contains("media")), "{:?}", whitted.notes());
}

#[test]
fn pictures_of_media_do_not_depend_on_threads() {
    let mut desc = scene();
    let medium = lumps(&mut desc, 4.0, [0.9; 3]);
    filled(&mut desc, BsdfDesc::Null, medium);
    constant_sky(&mut desc, 1.0);
    add(&mut desc, LightDesc::Point { position: Vec3::new(0.0, 0.0, 3.0), intensity: [5.0; 3] });
    perspective(&mut desc, Vec3::new(3.0, 1.0, 2.0), Vec3::ZERO, 50.0);
    let settings = settings(40, 40, 2);
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| render(&desc, &settings).develop().channel("R").unwrap().to_vec())
    };
    assert_eq!(with_threads(1), with_threads(3));
}
