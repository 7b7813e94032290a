//! Lights: samples against densities, arriving and leaving light against quadrature and closed forms.

#![allow(clippy::unwrap_used)]

use etendue_render::light::{
    AreaGeometry, AreaLight, ConstantLight, DirectionalLight, EnvironmentLight, Light, LightContext, PictureLight, PointLight, Rows,
    SceneSphere, SpotLight, SunLight,
};
use etendue_render::math::hash::{mix32, unit_float};
use etendue_render::math::{INV_4PI, INV_TAU, Mat4, PI, TAU, Vec2, Vec3, fns, warp};
use etendue_render::shape::{Disk, Shape, Sphere};
use etendue_render::spectrum::Spectrum;
use etendue_scene::desc::{PictureMapping, SpotFalloff};
use glam::{EulerRot, Quat};

const SCENE: SceneSphere = SceneSphere { center: Vec3::new(1.0, 2.0, 3.0), radius: 5.0, endless: false };

fn rnd(i: u32) -> f32 {
    unit_float(mix32(i))
}

fn rnd2(i: u32) -> Vec2 {
    Vec2::new(rnd(2 * i), rnd(2 * i + 1))
}

fn turned() -> Mat4 {
    Mat4::from_quat(Quat::from_euler(EulerRot::XYZ, 0.4, -0.9, 1.7))
}

/// Red, green and blue differ, a third is black, and one texel is a thousand times as bright.
fn picture(width: usize, height: usize) -> Vec<[f32; 3]> {
    let mut texels: Vec<[f32; 3]> = (0..(width * height) as u32)
        .map(|i| if rnd(77 + i) < 0.33 { [0.0; 3] } else { [rnd(1000 + i), 2.0 * rnd(5000 + i), 0.5 * rnd(9000 + i)] })
        .collect();
    texels[width * (height / 3) + width - 1] = [700.0, 500.0, 300.0];
    texels
}

fn environment(rows: Rows) -> EnvironmentLight {
    EnvironmentLight::new((24, 12), picture(24, 12), [1.0, 0.5, 2.0], turned(), rows).unwrap()
}

fn area(geometry: AreaGeometry, two_sided: bool, flip_normals: bool) -> Light {
    let radiance = Spectrum::from_rgb([1.0, 2.0, 0.5]);
    Light::Area(AreaLight { geometry, radiance, emission_id: 0, textured: false, two_sided, flip_normals })
}

fn picture_light(width: usize, height: usize, mapping: PictureMapping) -> Light {
    // Mirrored, turned and moved.
    let m = Mat4::from_translation(Vec3::ONE) * turned() * Mat4::from_scale(Vec3::new(2.0, -2.0, 2.0));
    Light::Picture(Box::new(PictureLight::new((width, height), &picture(width, height), [1.0, 0.5, 2.0], None, m, mapping).unwrap()))
}

fn lights() -> Vec<(&'static str, Light)> {
    let corners = [Vec3::new(-0.8, 0.1, 0.2), Vec3::new(0.9, -0.3, 0.5), Vec3::new(0.1, 0.7, -0.6)];
    let shape = |s| AreaGeometry::Shape(Box::new(s));
    let disk = || Shape::Disk(Disk::from_transform(turned(), false).unwrap());
    let spot = |falloff| Light::Spot(SpotLight::new(turned(), [1.0, 2.0, 0.5], 0.3, 0.8, falloff).unwrap());
    vec![
        ("triangle", area(AreaGeometry::Triangle(corners), false, false)),
        ("flipped triangle", area(AreaGeometry::Triangle(corners), false, true)),
        ("two-sided triangle", area(AreaGeometry::Triangle(corners), true, false)),
        ("sphere", area(shape(Shape::Sphere(Sphere::new(Vec3::X, 0.5).unwrap())), false, false)),
        ("disk", area(shape(disk()), false, false)),
        ("two-sided disk", area(shape(disk()), true, false)),
        ("point", Light::Point(PointLight { p: Vec3::ONE, intensity: Spectrum::from_rgb([1.0, 2.0, 0.5]) })),
        ("linear spot", spot(SpotFalloff::Linear)),
        ("squared spot", spot(SpotFalloff::CosineSquared)),
        ("smooth spot", spot(SpotFalloff::Smoothstep)),
        ("goniometric", picture_light(12, 12, PictureMapping::EqualAreaSquare)),
        ("projection", picture_light(9, 6, PictureMapping::Perspective { fov_rad: 1.3 })),
        ("directional", Light::Directional(DirectionalLight::new(Vec3::new(1.0, -2.0, 3.0), [1.0, 2.0, 0.5]).unwrap())),
        ("sun", Light::Sun(SunLight::new(Vec3::new(1.0, -2.0, 3.0), [1.0, 2.0, 0.5], 0.004_65).unwrap())),
        ("wide sun", Light::Sun(SunLight::new(Vec3::Y, [1.0, 2.0, 0.5], 1.2).unwrap())),
        ("constant", Light::Constant(ConstantLight { radiance: Spectrum::from_rgb([1.0, 2.0, 0.5]) })),
        ("environment", Light::Environment(Box::new(environment(Rows::Centered)))),
        ("environment with rows on the poles", Light::Environment(Box::new(environment(Rows::OnPoles)))),
    ]
}

#[track_caller]
fn assert_close(name: &str, value: Spectrum, expected: Spectrum, relative: f32) {
    for lane in 0..3 {
        let (v, e) = (value[lane], expected[lane]);
        assert!((v - e).abs() <= relative * e.abs(), "{name}: lane {lane} is {v}, expected {e}");
    }
}

/// The power that `power` states is what the emitted rays carry.
#[test]
fn emitted_rays_carry_the_power() {
    for (name, light) in lights() {
        let n = 1 << 17;
        let mut sum = [0.0f64; 3];
        for i in 0..n {
            let u = Vec2::new((i as f32 + rnd(i)) / n as f32, rnd(3 * i + 1));
            if let Some(s) = light.emit(&SCENE, rnd2(i + 12345), u) {
                assert!(
                    (s.d.length() - 1.0).abs() < 1e-4 && s.o.is_finite() && s.pdf_direction > 0.0 && s.pdf_position > 0.0,
                    "{name}: {s:?}"
                );
                if light.is_infinite() {
                    assert!((s.o - SCENE.center).dot(s.d) < -0.99 * SCENE.radius, "{name}: the ray starts in the scene");
                }
                for (lane, v) in sum.iter_mut().enumerate() {
                    *v += f64::from(s.radiance[lane] * s.cos) / (f64::from(s.pdf_position) * f64::from(s.pdf_direction));
                }
            }
        }
        let estimate = Spectrum::from_rgb(sum.map(|v| (v / f64::from(n)) as f32));
        assert_close(name, estimate, light.power(&SCENE), 0.01);
    }
}

/// The density that connections ask for is that of the rays that leave, and the intensity that shadow rays see is theirs, but for rays
/// on the
/// edge of a pixel.
#[test]
fn pictures_know_their_own_rays() {
    for mapping in [PictureMapping::EqualAreaSquare, PictureMapping::Perspective { fov_rad: 1.3 }] {
        let Light::Picture(light) = picture_light(12, 12, mapping) else { continue };
        let (count, mut off) = (20_000, 0);
        for i in 0..count {
            let Some(s) = light.emit(&SCENE, Vec2::ZERO, rnd2(i)) else { continue };
            let same = (light.pdf_emit(s.d) / s.pdf_direction - 1.0).abs() < 1e-3 && light.intensity(s.d) == s.radiance;
            off += u32::from(!same);
        }
        assert!(off < count / 1000, "{mapping:?}: {off}");
        // All densities together are one.
        let n = 400_000;
        let mean = (0..n).map(|i| f64::from(light.pdf_emit(warp::uniform_sphere(rnd2(i))))).sum::<f64>() / f64::from(n);
        assert!((mean * 4.0 * std::f64::consts::PI - 1.0).abs() < 0.15, "{mapping:?}: {mean}");
    }
}

/// Pixels of a window lie as who looks along the light sees them, and beside it is dark.
#[test]
fn windows_are_upright() {
    let texels: Vec<[f32; 3]> = (1..7).map(|v| [v as f32; 3]).collect();
    let mapping = PictureMapping::Perspective { fov_rad: 0.5 * PI };
    let light = PictureLight::new((3, 2), &texels, [1.0; 3], None, Mat4::IDENTITY, mapping).unwrap();
    // The window is 3 by 2 at distance 1.
    let at = |x: f32, y: f32, z: f32| light.intensity(Vec3::new(x, y, z).normalize())[0];
    assert_eq!([at(-1.0, 0.5, 1.0), at(0.0, 0.5, 1.0), at(1.4, 0.9, 1.0)], [1.0, 2.0, 3.0]);
    assert_eq!([at(-1.4, -0.9, 1.0), at(0.0, -0.5, 1.0), at(1.0, -0.5, 1.0)], [4.0, 5.0, 6.0]);
    assert_eq!([at(1.6, 0.0, 1.0), at(0.0, 1.1, 1.0), at(0.0, 0.0, -1.0)], [0.0; 3]);
    // The middle of maps of equal areas is +z, +x is to the right of it, +y below.
    let texels: Vec<[f32; 3]> = (0..16).map(|v| [v as f32; 3]).collect();
    let light = PictureLight::new((4, 4), &texels, [1.0; 3], None, Mat4::IDENTITY, PictureMapping::EqualAreaSquare).unwrap();
    let at = |x: f32, y: f32, z: f32| light.intensity(Vec3::new(x, y, z).normalize())[0];
    assert_eq!([at(0.1, 0.1, 1.0), at(-0.1, 0.1, 1.0), at(0.1, -0.1, 1.0), at(0.1, 0.1, -1.0)], [10.0, 9.0, 6.0, 15.0]);
}

/// Samples lie on their light, and `pdf_hit` and `pdf_escaped` are the densities that `sample` states.
#[test]
fn densities_agree_with_samples() {
    for (name, light) in lights() {
        for n in [Vec3::ZERO, Vec3::new(0.36, 0.48, 0.8)] {
            let ctx = LightContext { p: Vec3::new(-0.5, 2.5, 1.5), n };
            for i in 0..3000 {
                let Some(s) = light.sample(&ctx, rnd2(i)) else { continue };
                assert!(
                    (s.wi.length() - 1.0).abs() < 1e-5 && s.pdf > 0.0 && s.radiance.is_finite() && !s.radiance.is_black(),
                    "{name}: {s:?}"
                );
                assert_eq!(s.delta, light.is_delta());
                if s.dist.is_finite() {
                    assert!((ctx.p + s.wi * s.dist - s.p).length() < 1e-5, "{name}");
                }
                if let Light::Area(l) = &light {
                    assert!((light.pdf_hit(&ctx, s.p, s.n) / s.pdf - 1.0).abs() < 1e-3, "{name}");
                    assert_eq!(l.emitted(s.n, -s.wi), s.radiance);
                    assert_eq!(light.pdf_escaped(&ctx, s.wi), 0.0);
                } else if !s.delta {
                    let pdf = light.pdf_escaped(&ctx, s.wi);
                    // At the border of a cell the direction may round into the next one.
                    assert!((pdf / s.pdf - 1.0).abs() < 1e-3 || near_cell_border(&light, s.wi), "{name}: {pdf} {}", s.pdf);
                    assert_eq!(light.pdf_hit(&ctx, s.p, s.n), 0.0);
                }
            }
        }
    }
}

fn near_cell_border(light: &Light, wi: Vec3) -> bool {
    matches!(light, Light::Environment(_)) && near_cell_border_of(wi)
}

fn near_cell_border_of(wi: Vec3) -> bool {
    let d = turned().inverse().transform_vector3(wi);
    let cell = Vec2::new(0.5 + fns::atan2(d.x, -d.z) * INV_TAU, fns::acos(d.y) / PI) * Vec2::new(48.0, 24.0);
    (cell - cell.round()).abs().min_element() < 1e-3
}

/// Irradiance by sampling the light is that by uniform directions, for all infinite lights.
#[test]
fn infinite_lights_light_surfaces_as_quadrature_says() {
    for (name, light) in lights() {
        if !light.is_infinite() || light.is_delta() || name == "sun" {
            continue;
        }
        for (k, n) in [Vec3::Y, Vec3::new(0.48, -0.6, 0.64)].into_iter().enumerate() {
            let side = 1500u32;
            let (mut expected, mut density) = ([0.0f64; 3], 0.0f64);
            for i in 0..side * side {
                let u = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) / side as f32;
                let wi = warp::uniform_sphere(u);
                let ctx = LightContext { p: Vec3::ZERO, n };
                density += f64::from(light.pdf_escaped(&ctx, wi));
                let l = light.escaped(Vec3::ZERO, wi);
                assert!(l.is_black() || light.pdf_escaped(&ctx, wi) > 0.0, "{name}: light without density");
                expected.iter_mut().enumerate().for_each(|(lane, e)| *e += f64::from(l[lane] * n.dot(wi).max(0.0)));
            }
            let norm = 4.0 * std::f64::consts::PI / f64::from(side * side);
            assert!((density * norm - 1.0).abs() < 3e-3, "{name}: the density integrates to {}", density * norm);
            let expected = Spectrum::from_rgb(expected.map(|e| (e * norm) as f32));

            let count = 400u32;
            let mut sum = [0.0f64; 3];
            for i in 0..count * count {
                let u = (Vec2::new((i % count) as f32, (i / count) as f32) + rnd2(i + k as u32 * 777)) / count as f32;
                if let Some(s) = light.sample(&LightContext { p: Vec3::ZERO, n }, u) {
                    sum.iter_mut().enumerate().for_each(|(lane, e)| *e += f64::from(s.radiance[lane] * n.dot(s.wi).max(0.0) / s.pdf));
                }
            }
            let value = Spectrum::from_rgb(sum.map(|v| (v / f64::from(count * count)) as f32));
            assert_close(name, value, expected, 5e-3);
        }
    }
}

#[test]
fn environment_convention_and_mean() {
    let light = |m: Mat4| {
        EnvironmentLight::new((8, 4), (0..32).map(|i| [i as f32, (i % 8) as f32, (i / 8) as f32]).collect(), [1.0; 3], m, Rows::Centered)
    };
    let e = light(Mat4::IDENTITY).unwrap();
    // The seam of columns 3 and 4 is −z, that of 5 and 6 is +x, rows 1 and 2 meet at the horizon.
    assert_close("-z", e.radiance(-Vec3::Z), Spectrum::from_rgb([15.5, 3.5, 1.5]), 1e-5);
    assert_close("+x", e.radiance(Vec3::X), Spectrum::from_rgb([17.5, 5.5, 1.5]), 1e-5);
    assert_close("+z", e.radiance(Vec3::new(1e-9, 0.0, 1.0)), Spectrum::from_rgb([15.5, 3.5, 1.5]), 1e-4);
    assert_eq!(e.radiance(Vec3::Y)[2], 0.0);
    assert_eq!(e.radiance(-Vec3::Y)[2], 3.0);
    // A quarter turn about +y takes −z to −x; scaling changes nothing.
    let turned = light(Mat4::from_rotation_y(PI / 2.0) * Mat4::from_scale(Vec3::splat(7.0))).unwrap();
    assert_close("turned", turned.radiance(-Vec3::X), Spectrum::from_rgb([15.5, 3.5, 1.5]), 1e-4);
    // A mirror that gives the picture's +x to −x.
    let mirrored = light(Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0))).unwrap();
    assert_close("mirrored", mirrored.radiance(-Vec3::X), Spectrum::from_rgb([17.5, 5.5, 1.5]), 1e-5);
    let sum: Spectrum = (0..200_000).fold(Spectrum::ZERO, |s, i| s + e.radiance(warp::uniform_sphere(rnd2(i))) * (1.0 / 200_000.0));
    assert_close("mean", e.mean(), sum, 0.01);
}

/// With compensation the density still integrates to one and leaves out what is darker than the mean; with the weights of multiple
/// importance sampling nothing is lost.
#[test]
fn compensated_environment() {
    let environment = environment(Rows::Centered);
    let ctx = LightContext { p: Vec3::ZERO, n: Vec3::ZERO };
    let n = 400_000;
    let (mut sum, mut left_out) = (0.0f64, 0);
    let mut both = 0.0f64;
    for i in 0..n {
        let wi = warp::uniform_sphere(rnd2(i));
        let pdf = environment.pdf_compensated(wi);
        sum += f64::from(pdf) * 4.0 * std::f64::consts::PI / f64::from(n);
        left_out += u32::from(pdf == 0.0 && environment.pdf(wi) > 0.0);
        let here = f64::from(environment.radiance(wi).luminance() / INV_4PI);
        both += here * f64::from(warp::power_heuristic(INV_4PI, pdf));
        if let Some(s) = environment.sample_compensated(&ctx, rnd2(i + n)) {
            assert!((environment.pdf_compensated(s.wi) / s.pdf - 1.0).abs() < 1e-3 || near_cell_border_of(s.wi));
            both += f64::from(s.radiance.luminance() / s.pdf * warp::power_heuristic(s.pdf, INV_4PI));
        }
    }
    assert!((sum - 1.0).abs() < 0.03, "{sum}");
    assert!(left_out > n / 2, "{left_out}");
    let whole = f64::from(environment.mean().luminance() / INV_4PI);
    assert!((both / f64::from(n) / whole - 1.0).abs() < 0.005, "{} {whole}", both / f64::from(n));
}

#[test]
fn spots_fall_off() {
    // Half-way in the angle the cosine's ramp is at 0.6187.
    let cases = [(SpotFalloff::Linear, 0.5), (SpotFalloff::CosineSquared, 0.3827), (SpotFalloff::Smoothstep, 0.6747)];
    for (falloff, half_way) in cases {
        let l = SpotLight::new(Mat4::from_translation(Vec3::Z), [4.0; 3], 0.2, 0.6, falloff).unwrap();
        let at = |angle: f32| {
            let d = Vec3::new(fns::sin(angle), 0.0, -fns::cos(angle));
            l.sample(&LightContext { p: Vec3::Z + d * 2.0, n: Vec3::ZERO }, Vec2::ZERO).map_or(0.0, |s| s.radiance[0])
        };
        assert!((at(0.19) - 1.0).abs() < 1e-5 && at(0.61) == 0.0);
        assert!((at(0.4) - half_way).abs() < 2e-3, "{falloff:?}: {}", at(0.4));
    }
}

#[test]
fn sides_and_suns() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    for (two_sided, flip, above, below) in [(false, false, true, false), (false, true, false, true), (true, false, true, true)] {
        let light = area(AreaGeometry::Triangle(corners), two_sided, flip);
        let lit = |z: f32| (0..50).any(|i| light.sample(&LightContext { p: Vec3::new(0.2, 0.2, z), n: Vec3::ZERO }, rnd2(i)).is_some());
        assert_eq!((lit(1.0), lit(-1.0)), (above, below));
    }
    // Irradiance does not depend on the sun's size.
    for half_angle in [1e-4, 0.004_65, 0.1, 1.0] {
        let sun = SunLight::new(Vec3::Z, [3.0, 2.0, 1.0], half_angle).unwrap();
        let ctx = LightContext { p: Vec3::ZERO, n: Vec3::Z };
        let n = 20_000;
        let e = (0..n)
            .filter_map(|i| sun.sample(&ctx, Vec2::new((i as f32 + 0.5) / n as f32, rnd(i))))
            .fold(Spectrum::ZERO, |e, s| e + s.radiance * (s.wi.z / s.pdf));
        assert_close("sun", e * (1.0 / n as f32), Spectrum::from_rgb([3.0, 2.0, 1.0]), 1e-3);
        assert!(
            !sun.radiance(Vec3::Z).is_black()
                && sun.radiance(Vec3::new(fns::sin(half_angle * 1.01), 0.0, fns::cos(half_angle * 1.01))).is_black()
        );
    }
}

#[test]
fn hostile_input_makes_no_light() {
    let singular = Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0));
    for m in [singular, Mat4::ZERO, Mat4::from_scale(Vec3::NAN)] {
        assert!(EnvironmentLight::new((2, 2), vec![[1.0; 3]; 4], [1.0; 3], m, Rows::Centered).is_none());
    }
    for size in [(0, 0), (0, 4), (3, 2), (usize::MAX, 2)] {
        assert!(EnvironmentLight::new(size, vec![[1.0; 3]; 4], [1.0; 3], Mat4::IDENTITY, Rows::Centered).is_none());
    }
    assert!(DirectionalLight::new(Vec3::ZERO, [1.0; 3]).is_none() && DirectionalLight::new(Vec3::NAN, [1.0; 3]).is_none());
    assert!(SunLight::new(Vec3::Z, [1.0; 3], 0.0).is_none() && SunLight::new(Vec3::Z, [f32::NAN; 3], 0.1).is_none());
    assert!(SpotLight::new(Mat4::ZERO, [1.0; 3], 0.1, 0.2, SpotFalloff::Linear).is_none());
    let lit = |texels: &[[f32; 3]], m, mapping| PictureLight::new((2, 1), texels, [1.0; 3], None, m, mapping);
    let window = PictureMapping::Perspective { fov_rad: 1.0 };
    assert!(lit(&[[1.0; 3]; 2], singular, window).is_none() && lit(&[[1.0; 3]; 3], Mat4::IDENTITY, window).is_none());
    assert!(lit(&[[1.0; 3]; 2], Mat4::IDENTITY, PictureMapping::EqualAreaSquare).is_none(), "no square");
    let dark = lit(&[[f32::NAN, -1.0, f32::INFINITY]; 2], Mat4::IDENTITY, window).unwrap();
    assert!(dark.power(&SCENE).is_black() && dark.emit(&SCENE, Vec2::ZERO, Vec2::splat(0.5)).is_none());
    // Bad texels are black, one texel is a constant picture, and a black picture gives nothing.
    let bad =
        EnvironmentLight::new((2, 1), vec![[f32::NAN, -1.0, f32::INFINITY], [1.0; 3]], [1.0; 3], Mat4::IDENTITY, Rows::Centered).unwrap();
    assert!((0..1000).all(|i| bad.radiance(warp::uniform_sphere(rnd2(i))).is_finite()));
    let one = EnvironmentLight::new((1, 1), vec![[2.0; 3]], [1.0; 3], Mat4::IDENTITY, Rows::Centered).unwrap();
    assert_close("one texel", one.mean(), Spectrum::splat(2.0), 1e-5);
    assert!((one.pdf(Vec3::X) - 1.0 / (TAU * PI)).abs() < 1e-5);
    let black = EnvironmentLight::new((2, 2), vec![[0.0; 3]; 4], [1.0; 3], Mat4::IDENTITY, Rows::Centered).unwrap();
    let ctx = LightContext { p: Vec3::ZERO, n: Vec3::ZERO };
    assert!(black.sample(&ctx, Vec2::splat(0.3)).is_none());
    // A light at the very point, and a triangle without area.
    assert!(PointLight { p: Vec3::ZERO, intensity: Spectrum::ONE }.sample(&ctx, Vec2::ZERO).is_none());
    let flat = area(AreaGeometry::Triangle([Vec3::X, Vec3::X, Vec3::Y]), true, false);
    assert!((0..100).all(|i| flat.sample(&ctx, rnd2(i)).is_none()));
    assert!(flat.bounds().is_none());
}
