//! Scenes whose light is known in closed form, rendered by the integrators.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::film::Film;
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use std::f64::consts::PI;
use support::statistics::{Blocks, ROUNDING, assert_known, assert_same};
use support::*;

fn gray(v: f64) -> [f64; 3] {
    [v; 3]
}

fn film(desc: &SceneDesc, settings: &RenderSettings) -> Vec<Film> {
    vec![render(desc, settings)]
}

/// A unit sphere of a material under a sky of radiance 1, filling most of a picture of 12 × 12 pixels.
fn furnace(make: impl FnOnce(&mut SceneDesc) -> BsdfId, spp: u32) -> Vec<Film> {
    let mut desc = scene();
    let material = make(&mut desc);
    sphere(&mut desc, Vec3::ZERO, 1.0, Some(material));
    constant_sky(&mut desc, 1.0);
    orthographic(&mut desc, Vec3::new(1.0, 2.0, 5.0), Vec3::ZERO, 1.2);
    film(&desc, &settings(12, 12, spp))
}

fn single(value: BsdfDesc) -> impl FnOnce(&mut SceneDesc) -> BsdfId {
    move |desc| bsdf(desc, value)
}

#[test]
fn white_furnace_of_models_that_lose_nothing_is_white_in_every_pixel() {
    let known = |name: &str, films: Vec<Film>, noise: f64| assert_known(name, &films, 1, gray(1.0), noise);
    known("furnace diffuse", furnace(|d| diffuse(d, 1.0), 512), 0.03);
    known("furnace mirror", furnace(single(mirror(None)), 64), 0.05);
    known("furnace glass", furnace(single(glass(1.5, None)), 512), 0.03);
    known("furnace pane", furnace(single(pane(1.5)), 512), 0.03);
    known("furnace plastic", furnace(single(plastic(1.0, false, None)), 1024), 0.03);
    known("furnace nonlinear plastic", furnace(single(plastic(1.0, true, None)), 1024), 0.03);
    known("furnace null", furnace(single(BsdfDesc::Null), 4), 0.01);
    let mask = |d: &mut SceneDesc| {
        let white = diffuse(d, 1.0);
        let nested = bsdf(d, BsdfDesc::TwoSided { front: white, back: white });
        bsdf(d, BsdfDesc::Mask { nested, opacity: Param::Constant(0.4) })
    };
    known("furnace mask", furnace(mask, 512), 0.03);
    let blend = |d: &mut SceneDesc| {
        let (first, second) = (diffuse(d, 1.0), bsdf(d, mirror(None)));
        bsdf(d, BsdfDesc::Blend { first, second, weight: Param::Constant(0.3) })
    };
    known("furnace blend", furnace(blend, 512), 0.05);
}

#[test]
fn white_furnace_of_microfacets_is_at_most_white() {
    let cases = [
        ("smooth-ish conductor", mirror(Some(0.05)), 0.97),
        ("rough conductor", mirror(Some(0.5)), 0.6),
        ("rough glass", glass(1.5, Some(0.3)), 0.7),
        ("rough plastic", plastic(1.0, true, Some(0.3)), 0.5),
        ("glTF, metal", BsdfDesc::Pbr(Box::default()), 0.5),
        ("glTF, dielectric", BsdfDesc::Pbr(Box::new(PbrDesc { metallic: Param::Constant(0.0), ..PbrDesc::default() })), 0.7),
    ];
    for (name, model, least) in cases {
        let blocks = Blocks::new(&furnace(single(model), 256), 2);
        for (mean, variance) in blocks.mean.iter().zip(&blocks.variance) {
            for c in 0..3 {
                let noise = 5.0 * variance[c].sqrt();
                assert!(mean[c] < 1.0 + noise + 2e-3 && mean[c] > least - noise, "{name}: {} ± {noise}", mean[c]);
            }
        }
    }
}

/// A floor of reflectance 0.5 at z = 0 seen from close above in a small patch about the origin. The radiance of it is 0.5 / π times
/// the irradiance.
fn floor() -> SceneDesc {
    let mut desc = scene();
    let material = diffuse(&mut desc, 0.5);
    rectangle(&mut desc, Vec3::ZERO, [50.0; 2], false, Some(material));
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 0.05), Vec3::ZERO, 1e-3);
    desc
}

/// Direct light on the floor by several integrators, against an irradiance.
fn assert_irradiance(name: &str, desc: &SceneDesc, irradiance: f64, spp: u32) {
    for (integrator, lights, depth) in
        [("path", "bvh", Some(1)), ("path", "uniform", Some(1)), ("direct", "power", None), ("whitted", "bvh", None)]
    {
        let s = RenderSettings {
            integrator: Some(integrator.into()),
            light_sampler: Some(lights.into()),
            max_depth: depth,
            ..settings(8, 8, spp)
        };
        assert_known(&format!("{name} {integrator} {lights}"), &film(desc, &s), 8, gray(0.5 / PI * irradiance), 0.02);
    }
}

#[test]
fn irradiance_below_lights_has_its_closed_form() {
    let light = |add_light: &dyn Fn(&mut SceneDesc)| {
        let mut desc = floor();
        add_light(&mut desc);
        desc
    };
    let black = |desc: &mut SceneDesc| Some(diffuse(desc, 0.0));
    // A sphere that is wholly above the horizon lights as its solid angle's projection: π L (r/d)² cos θ.
    for center in [Vec3::new(0.0, 0.0, 2.0), Vec3::new(1.5, -1.0, 2.0)] {
        let desc = light(&|d| {
            let material = black(d);
            let s = sphere(d, center, 0.7, material);
            emit(d, s, Color::gray(2.0));
        });
        let d = f64::from(center.length());
        assert_irradiance("sphere", &desc, PI * 2.0 * (0.7f64 / d).powi(2) * f64::from(center.z) / d, 128);
    }
    // Parallel rectangle above a corner of it, four times (Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", B-4).
    let desc = light(&|d| {
        let material = black(d);
        let s = rectangle(d, Vec3::new(0.0, 0.0, 1.0), [1.5, 0.5], true, material);
        emit(d, s, Color::gray(3.0));
    });
    let (x, y) = (1.5f64, 0.5f64);
    let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    let corner = (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / (2.0 * PI);
    assert_irradiance("rectangle", &desc, PI * 3.0 * 4.0 * corner, 128);
    // The same as two triangles.
    let desc = light(&|d| {
        let positions = [[-1.5, -0.5], [-1.5, 0.5], [1.5, 0.5], [1.5, -0.5]].map(|[x, y]| Vec3::new(x, y, 1.0)).to_vec();
        let data = MeshData { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..MeshData::default() };
        let mesh = add(d, MeshDesc { file: None, flip_v: false, data: Some(data) });
        let material = black(d);
        let s = shape(d, GeometryDesc::Mesh { mesh, face_normals: true, smooth: false }, Mat4::IDENTITY, material);
        emit(d, s, Color::gray(3.0));
    });
    assert_irradiance("mesh", &desc, PI * 3.0 * 4.0 * corner, 128);
    // A disk overhead: π L r² / (r² + h²).
    let desc = light(&|d| {
        let material = black(d);
        let s = shape(d, GeometryDesc::Disk, facing(Vec3::new(0.0, 0.0, 1.0), [0.8; 2], true), material);
        emit(d, s, Color::gray(1.0));
    });
    assert_irradiance("disk", &desc, PI * 0.64 / 1.64, 128);
    // The patch is small but not a point: its edge is off by some 1e-6 relative.
    let position = Vec3::new(1.0, 2.0, 2.0);
    let desc = light(&|d| {
        add(d, LightDesc::Point { position, intensity: [4.0; 3] });
    });
    assert_irradiance("point", &desc, 4.0 / 9.0 * 2.0 / 3.0, 32);
    let desc = light(&|d| {
        add(
            d,
            LightDesc::Spot {
                world_from_light: look_at(position, Vec3::ZERO),
                intensity: [4.0; 3],
                outer_rad: 0.4,
                inner_rad: 0.3,
                falloff: SpotFalloff::Linear,
                texture: None,
            },
        );
    });
    assert_irradiance("spot", &desc, 4.0 / 9.0 * 2.0 / 3.0, 32);
    // Half way between the cones the linear spot has half its intensity: turn its axis away by 0.35 rad.
    let desc = light(&|d| {
        let world_from_light = look_at(Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO) * Mat4::from_rotation_x(0.35);
        let falloff = SpotFalloff::Linear;
        let spot = LightDesc::Spot { world_from_light, intensity: [4.0; 3], outer_rad: 0.4, inner_rad: 0.3, falloff, texture: None };
        add(d, spot);
    });
    let films = film(&desc, &RenderSettings { max_depth: Some(1), ..settings(8, 8, 32) });
    let blocks = Blocks::new(&films, 8);
    assert_same("spot falloff", &blocks, &blocks.known(gray(0.5 / PI * 0.5)), 1e-2, 0.02);
    let desc = light(&|d| {
        add(d, LightDesc::Directional { direction: Vec3::new(0.6, 0.0, -0.8), irradiance: [2.0; 3] });
    });
    assert_irradiance("directional", &desc, 1.6, 4);
    let desc = light(&|d| constant_sky(d, 0.5));
    assert_irradiance("sky", &desc, 0.5 * PI, 64);
}

#[test]
fn a_textured_emitter_gives_all_its_power_from_the_right_places() {
    // One quarter of a square shines: above x > 0 and y > 0 of its own space, whose y the turn has reversed.
    let emitter = |desc: &mut SceneDesc, at: Vec3, down: bool| {
        let image = picture(desc, 2, 2, 3, [[0.0; 3], [8.0; 3], [0.0; 3], [0.0; 3]].concat());
        let bitmap = BitmapDesc {
            image,
            encoding: Encoding::Linear,
            wrap: [Wrap::Clamp; 2],
            filter: TextureFilter::Nearest,
            picture_from_uv: glam::Mat3::IDENTITY,
            channel: Channel::Luminance,
            uv_set: 0,
        };
        let texture = add(desc, TextureDesc::Bitmap(bitmap));
        let black = diffuse(desc, 0.0);
        let s = rectangle(desc, at, [1.0; 2], down, Some(black));
        emit(desc, s, Param::Texture(texture));
    };
    let mut desc = floor();
    emitter(&mut desc, Vec3::new(0.0, 0.0, 1.0), true);
    // One corner's share of the irradiance, as above with X = Y = 1.
    let r = 2.0f64.sqrt();
    let corner = 2.0 * (1.0 / r) * (1.0 / r).atan() / (2.0 * PI);
    assert_irradiance("textured", &desc, PI * 8.0 * corner, 512);
    // The picture's first row is at v = 1: seen from the front the bright quarter is the upper right.
    let mut desc = scene();
    emitter(&mut desc, Vec3::ZERO, false);
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 1.0), Vec3::ZERO, 1.0);
    let image = render(&desc, &settings(2, 2, 4)).develop();
    assert_eq!(image.channel("R").unwrap(), [0.0, 8.0, 0.0, 0.0]);
}

#[test]
fn a_closed_box_has_the_radiance_of_its_geometric_series() {
    let (emitted, reflectance) = (0.3f32, 0.7f32);
    let mut desc = scene();
    let material = diffuse(&mut desc, reflectance);
    let s = shape(&mut desc, GeometryDesc::Cube, Mat4::IDENTITY, Some(material));
    desc.shapes[s.0 as usize].value.flip_normals = true;
    emit(&mut desc, s, Color::gray(emitted));
    perspective(&mut desc, Vec3::new(0.2, 0.3, 0.9), Vec3::new(-1.0, -0.7, -1.0), 80.0);
    let all = f64::from(emitted) / (1.0 - f64::from(reflectance));
    for rr_depth in [0, 2, 20] {
        let s = RenderSettings { rr_depth: Some(rr_depth), ..settings(8, 8, 48) };
        assert_known(&format!("box roulette {rr_depth}"), &film(&desc, &s), 4, gray(all), 0.05);
    }
    let s = RenderSettings { max_depth: Some(2), ..settings(8, 8, 48) };
    let two = f64::from(emitted) * (1.0 + 0.7 + 0.49);
    assert_known("box of two bounces", &film(&desc, &s), 4, gray(two), 0.05);
}

/// Straight down through something at z = 0.5 to 1 on a floor that emits.
fn look_through(thing: impl FnOnce(&mut SceneDesc)) -> Vec<Film> {
    let mut desc = scene();
    let black = diffuse(&mut desc, 0.0);
    let s = rectangle(&mut desc, Vec3::ZERO, [50.0; 2], false, Some(black));
    emit(&mut desc, s, Color::gray(2.0));
    thing(&mut desc);
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO, 0.1);
    film(&desc, &settings(8, 8, 32))
}

fn slab(desc: &mut SceneDesc, material: BsdfDesc, sigma_a: Option<[f32; 3]>) {
    let material = bsdf(desc, material);
    let place = Mat4::from_translation(Vec3::new(0.0, 0.0, 0.75)) * Mat4::from_scale(Vec3::new(20.0, 20.0, 0.25));
    let s = shape(desc, GeometryDesc::Cube, place, Some(material));
    desc.shapes[s.0 as usize].value.interior = sigma_a.map(|sigma_a| {
        let (sigma_s, emission, phase) = ([0.0; 3], [0.0; 3], PhaseDesc::Isotropic);
        add(desc, MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase })
    });
}

const SIGMA: [f32; 3] = [1.0, 3.0, 0.0];

fn beer_lambert(factor: f64) -> [f64; 3] {
    SIGMA.map(|s| factor * (-0.5 * f64::from(s)).exp())
}

#[test]
fn what_lies_between_camera_and_light_lets_its_share_through() {
    assert_known("null slab", &look_through(|d| slab(d, BsdfDesc::Null, Some(SIGMA))), 8, beer_lambert(2.0), 1e-3);
    assert_known("matched slab", &look_through(|d| slab(d, glass(1.0, None), Some(SIGMA))), 8, beer_lambert(2.0), 1e-3);
    // Reflection at both faces in turn: (1 − r) / (1 + r) at normal incidence, whether thick or thin.
    let r = (0.5f64 / 2.5).powi(2);
    let through = (1.0 - r) / (1.0 + r);
    assert_known("glass slab", &look_through(|d| slab(d, glass(1.5, None), None)), 8, gray(2.0 * through), 0.02);
    let thin = |d: &mut SceneDesc, model: BsdfDesc| {
        let material = bsdf(d, model);
        rectangle(d, Vec3::new(0.0, 0.0, 0.5), [20.0; 2], false, Some(material));
    };
    assert_known("pane", &look_through(|d| thin(d, pane(1.5))), 8, gray(2.0 * through), 0.02);
    let mask = |d: &mut SceneDesc| {
        let nested = diffuse(d, 0.0);
        thin(d, BsdfDesc::Mask { nested, opacity: Param::Constant(0.3) });
    };
    assert_known("mask", &look_through(mask), 8, gray(1.4), 0.05);
}

#[test]
fn what_lies_between_a_surface_and_a_light_lets_its_share_through() {
    // A point light straight above: the rays to the patch are vertical.
    let shadow = |thing: &dyn Fn(&mut SceneDesc)| {
        let mut desc = floor();
        add(&mut desc, LightDesc::Point { position: Vec3::new(0.0, 0.0, 4.0), intensity: [16.0; 3] });
        thing(&mut desc);
        desc
    };
    let s =
        |integrator: &str, depth: u32| RenderSettings { integrator: Some(integrator.into()), max_depth: Some(depth), ..settings(8, 8, 16) };
    let rho = 0.5 / PI;
    let r = (0.5f64 / 2.5).powi(2);
    for (integrator, depth) in [("path", 1), ("whitted", 1)] {
        let desc = shadow(&|d| slab(d, BsdfDesc::Null, Some(SIGMA)));
        assert_known(&format!("slab shadow {integrator}"), &film(&desc, &s(integrator, depth)), 8, beer_lambert(rho), 1e-3);
        let desc = shadow(&|d| {
            let material = bsdf(d, pane(1.5));
            rectangle(d, Vec3::new(0.0, 0.0, 0.5), [20.0; 2], false, Some(material));
        });
        let through = rho * (1.0 - r) / (1.0 + r);
        assert_known(&format!("pane shadow {integrator}"), &film(&desc, &s(integrator, depth)), 8, gray(through), 1e-3);
        let desc = shadow(&|d| {
            let nested = diffuse(d, 0.0);
            let material = bsdf(d, BsdfDesc::Mask { nested, opacity: Param::Constant(0.3) });
            rectangle(d, Vec3::new(0.0, 0.0, 0.5), [20.0; 2], false, Some(material));
        });
        assert_known(&format!("mask shadow {integrator}"), &film(&desc, &s(integrator, depth)), 8, gray(0.7 * rho), 1e-3);
    }
    // The last scattering's own ray crosses the mask as the shadow ray does: the weights of the two must add up.
    let mut desc = floor();
    let nested = diffuse(&mut desc, 0.0);
    let mask = bsdf(&mut desc, BsdfDesc::Mask { nested, opacity: Param::Constant(0.3) });
    rectangle(&mut desc, Vec3::new(0.0, 0.0, 0.5), [20.0; 2], false, Some(mask));
    let light = shape(&mut desc, GeometryDesc::Disk, facing(Vec3::new(0.0, 0.0, 1.0), [2.0; 2], true), Some(nested));
    emit(&mut desc, light, Color::gray(1.0));
    assert_known(
        "mask before a large light",
        &film(&desc, &RenderSettings { spp: Some(256), ..s("path", 1) }),
        8,
        gray(0.7 * 0.5 * 0.8),
        0.02,
    );
}

#[test]
fn mirrors_show_the_light_times_fresnel() {
    let gold = ([0.2f32, 0.4, 1.4], [3.9f32, 2.4, 1.8]);
    let mut desc = scene();
    let conductor = BsdfDesc::Conductor {
        eta: Some(Color::Constant(gold.0)),
        k: Color::Constant(gold.1),
        specular_reflectance: Color::gray(0.9),
        roughness: None,
    };
    let material = bsdf(&mut desc, conductor);
    rectangle(&mut desc, Vec3::ZERO, [1.0; 2], false, Some(material));
    let black = diffuse(&mut desc, 0.0);
    let light = rectangle(&mut desc, Vec3::new(0.0, 0.0, 1.0), [1.0; 2], true, Some(black));
    emit(&mut desc, light, Color::gray(3.0));
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 0.5), Vec3::ZERO, 0.1);
    let expected = std::array::from_fn(|c| {
        let (n, k) = (f64::from(gold.0[c]), f64::from(gold.1[c]));
        3.0 * 0.9 * ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k)
    });
    for (integrator, depth) in [("path", 1), ("path", 10), ("whitted", 1)] {
        let s = RenderSettings { integrator: Some(integrator.into()), max_depth: Some(depth), ..settings(4, 4, 4) };
        assert_known(&format!("mirror {integrator} {depth}"), &film(&desc, &s), 4, expected, 1e-3);
    }
}

#[test]
fn an_environments_texel_shows_where_the_description_says() {
    let (width, height) = (16u32, 8u32);
    let (x, y) = (11u32, 2u32);
    let environment = |desc: &mut SceneDesc, world_from_light: Mat4| {
        let mut data = vec![0.0; (3 * width * height) as usize];
        data[(3 * (y * width + x)) as usize..][..3].copy_from_slice(&[5.0, 6.0, 7.0]);
        let image = picture(desc, width, height, 3, data);
        add(
            desc,
            LightDesc::Environment {
                image,
                scale: [1.0, 0.5, 2.0],
                world_from_light,
                mapping: EnvironmentMapping::Equirectangular,
                portal: None,
            },
        );
    };
    // The panoramic camera and the picture share their conventions: the pictures are alike, whatever is between texels.
    let mut desc = scene();
    environment(&mut desc, Mat4::IDENTITY);
    panoramic(&mut desc, Vec3::ZERO);
    let image = render(&desc, &settings(width, height, 64)).develop();
    let rgb = image.rgb().unwrap();
    let brightest = (0..rgb.len()).max_by(|a, b| rgb[*a][0].total_cmp(&rgb[*b][0])).unwrap();
    assert_eq!(brightest, (y * width + x) as usize);
    let sum = |c: usize| rgb.iter().map(|p| p[c]).sum::<f32>();
    assert!((sum(1) / sum(0) - 0.6).abs() < 1e-3 && (sum(2) / sum(0) - 2.8).abs() < 1e-3, "scaled by channel");
    assert!(sum(0) > 2.5 && sum(0) < 7.5, "one texel's light: {}", sum(0));
    // +y is up, the middle column is −z and +x a quarter to the right: the texel's direction, from its longitude and latitude.
    let phi = (f64::from(x) + 0.5) / f64::from(width) * 2.0 * PI - PI;
    let theta = (f64::from(y) + 0.5) / f64::from(height) * PI;
    let d = Vec3::new((theta.sin() * phi.sin()) as f32, theta.cos() as f32, (-theta.sin() * phi.cos()) as f32);
    for turn in [Mat4::IDENTITY, Mat4::from_rotation_y(1.1), Mat4::from_rotation_x(-2.0)] {
        let mut desc = scene();
        environment(&mut desc, turn);
        perspective(&mut desc, Vec3::ZERO, turn.transform_vector3(d), 2.0);
        let image = render(&desc, &settings(2, 2, 16)).develop();
        assert!(image.channel("R").unwrap().iter().all(|v| *v > 4.0), "{turn}: {:?}", image.channel("R"));
    }
    // Light sampling finds the same light as chance does.
    let mut desc = floor();
    environment(&mut desc, Mat4::from_rotation_x(1.3));
    let s = RenderSettings { max_depth: Some(1), ..settings(8, 8, 1024) };
    let naive = finish(session_of(compile(&desc, &s), Box::new(naive::Naive { max_depth: 1 }), &s), &s);
    let sampled = render(&desc, &RenderSettings { spp: Some(128), seed: 1, ..s });
    assert_same("environment", &Blocks::new(&[sampled], 8), &Blocks::new(&[naive], 8), ROUNDING, 0.1);
}

#[test]
fn cameras_look_along_minus_z_with_x_to_the_right_and_y_up() {
    // A small light at a known place, and the pixel in which it must show.
    let find = |desc: &SceneDesc| {
        let image = render(desc, &settings(32, 32, 16)).develop();
        let rgb = image.rgb().unwrap();
        let total: f32 = rgb.iter().map(|p| p[0]).sum();
        let at = |f: fn(usize) -> usize| rgb.iter().enumerate().map(|(i, p)| p[0] * (f(i) as f32 + 0.5)).sum::<f32>() / total;
        (at(|i| i % 32), at(|i| i / 32))
    };
    let lit = |at: Vec3| {
        let mut desc = scene();
        let s = sphere(&mut desc, at, 0.05, None);
        emit(&mut desc, s, Color::gray(1.0));
        desc
    };
    let near = |(x, y): (f32, f32), (ex, ey): (f32, f32), what: &str| {
        assert!((x - ex).abs() < 0.3 && (y - ey).abs() < 0.3, "{what}: {x}, {y} instead of {ex}, {ey}");
    };
    let mut desc = lit(Vec3::new(1.0, 0.5, -2.0));
    perspective(&mut desc, Vec3::ZERO, -Vec3::Z, 90.0);
    near(find(&desc), (24.0, 12.0), "perspective");
    let mut desc = lit(Vec3::new(1.0, 0.5, -2.0));
    orthographic(&mut desc, Vec3::ZERO, -Vec3::Z, 2.0);
    near(find(&desc), (24.0, 12.0), "orthographic");
    // A quarter of the sphere to the right of −z, on the horizon; off a pixel's edge.
    let mut desc = lit(Vec3::new(1.0, 0.0, 0.0));
    panoramic(&mut desc, Vec3::ZERO);
    near(find(&desc), (24.0, 16.0), "panoramic");
    // Looking along +x, −z is to the left.
    let mut desc = lit(Vec3::new(2.0, 0.0, -1.0));
    perspective(&mut desc, Vec3::ZERO, Vec3::X, 90.0);
    near(find(&desc), (8.0, 16.0), "perspective along x");
}

/// A near light behind a surface that is not there: the shadow ray's step off that surface must not reach the light itself.
#[test]
fn null_surfaces_do_not_hide_near_lights() {
    let mean = |with_null: bool| {
        let mut desc = scene();
        let white = diffuse(&mut desc, 0.8);
        rectangle(&mut desc, Vec3::new(0.0, 0.0, 2.0), [1.0, 1.0], true, Some(white));
        let lamp = ShapeDesc {
            emission: Some(EmissionDesc { radiance: Color::gray(5.0), two_sided: true, group: String::new() }),
            ..ShapeDesc::new(GeometryDesc::Rectangle, Mat4::from_translation(Vec3::Z * 1.8) * Mat4::from_scale(Vec3::splat(0.1)))
        };
        add(&mut desc, lamp);
        if with_null {
            let null = bsdf(&mut desc, BsdfDesc::Null);
            rectangle(&mut desc, Vec3::new(0.0, 0.0, 1.9), [3.0, 3.0], false, Some(null));
        }
        perspective(&mut desc, Vec3::new(0.3, 0.2, 0.5), Vec3::new(0.3, 0.2, 2.0), 10.0);
        let film = render(&desc, &RenderSettings { integrator: Some("direct".into()), ..settings(8, 8, 64) });
        let image = film.develop();
        let g = image.channel("G").unwrap();
        g.iter().sum::<f32>() / g.len() as f32
    };
    let (with, without) = (mean(true), mean(false));
    assert!(without > 0.01 && (with / without - 1.0).abs() < 0.02, "{with} instead of {without}");
}
