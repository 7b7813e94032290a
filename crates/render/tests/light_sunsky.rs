//! Sky and sun against Mitsuba 3.9.1 (`sunsky`, variant `scalar_rgb`), which uses the same model.

#![allow(clippy::unwrap_used)]

use etendue_render::light::sunsky::{self, Sky, sun_irradiance};
use etendue_render::light::{Light, LightContext};
use etendue_render::math::{Mat4, PI, Vec2, Vec3, fns};
use etendue_scene::desc::SunSkyDesc;

/// Elevation, turbidity, albedo, angle from the zenith, azimuth from the sun; radiance.
#[rustfmt::skip]
const SKY: [(f32, f32, f32, f32, f32, [f32; 3]); 24] = [
    (0.7, 3.0, 0.2, 0.01, 0.0, [0.02041, 0.03629, 0.07346]),
    (0.7, 3.0, 0.2, 0.6, 0.5, [0.05317, 0.07513, 0.11804]),
    (0.7, 3.0, 0.2, 1.0, 2.0, [0.03068, 0.05748, 0.10909]),
    (0.7, 3.0, 0.2, 1.3, 3.1, [0.06430, 0.10879, 0.17517]),
    (0.7, 3.0, 0.2, 1.5, 1.0, [0.13447, 0.18527, 0.22937]),
    (0.7, 3.0, 0.2, 1.1, 0.05, [0.18527, 0.21919, 0.25796]),
    (0.2, 2.0, 0.0, 0.01, 0.0, [0.00753, 0.01617, 0.03007]),
    (0.2, 2.0, 0.0, 0.6, 0.5, [0.01433, 0.02613, 0.04307]),
    (0.2, 2.0, 0.0, 1.0, 2.0, [0.02071, 0.03610, 0.05620]),
    (0.2, 2.0, 0.0, 1.3, 3.1, [0.05748, 0.08491, 0.10303]),
    (0.2, 2.0, 0.0, 1.5, 1.0, [0.09600, 0.11615, 0.09725]),
    (0.2, 2.0, 0.0, 1.1, 0.05, [0.07029, 0.08673, 0.09750]),
    (1.3, 6.5, 0.7, 0.01, 0.0, [0.26436, 0.28022, 0.30877]),
    (1.3, 6.5, 0.7, 0.6, 0.5, [0.22306, 0.24719, 0.28902]),
    (1.3, 6.5, 0.7, 1.0, 2.0, [0.08148, 0.12182, 0.19897]),
    (1.3, 6.5, 0.7, 1.3, 3.1, [0.13139, 0.17986, 0.26669]),
    (1.3, 6.5, 0.7, 1.5, 1.0, [0.24986, 0.29543, 0.34408]),
    (1.3, 6.5, 0.7, 1.1, 0.05, [0.13308, 0.17919, 0.26371]),
    (0.05, 1.0, 0.5, 0.01, 0.0, [0.00603, 0.00961, 0.01279]),
    (0.05, 1.0, 0.5, 0.6, 0.5, [0.01030, 0.01494, 0.01858]),
    (0.05, 1.0, 0.5, 1.0, 2.0, [0.01663, 0.02226, 0.02529]),
    (0.05, 1.0, 0.5, 1.3, 3.1, [0.04544, 0.04873, 0.03894]),
    (0.05, 1.0, 0.5, 1.5, 1.0, [0.06928, 0.06253, 0.03232]),
    (0.05, 1.0, 0.5, 1.1, 0.05, [0.02934, 0.03655, 0.03667]),
];

/// Elevation, turbidity; irradiance of the facing surface.
#[rustfmt::skip]
const SUN: [(f32, f32, [f32; 3]); 5] = [
    (0.7, 3.0, [1.44964, 1.17857, 0.84753]),
    (0.1, 2.5, [0.76189, 0.36786, 0.06809]),
    (0.3, 7.2, [0.83328, 0.57085, 0.30703]),
    (1.4, 4.0, [1.48284, 1.25087, 0.98849]),
    (0.04, 3.0, [0.29931, 0.09185, 0.00016]),
];

fn direction(theta: f32, phi: f32) -> Vec3 {
    Vec3::new(fns::sin(theta) * fns::cos(phi), fns::sin(theta) * fns::sin(phi), fns::cos(theta))
}

fn desc(elevation: f32, turbidity: f32, albedo: f32) -> SunSkyDesc {
    SunSkyDesc {
        sky: true,
        sun: true,
        sun_direction: direction(PI / 2.0 - elevation, 0.0),
        turbidity,
        albedo: [albedo; 3],
        sky_scale: 1.0,
        sun_scale: 1.0,
        sun_half_angle_rad: 0.004_675_7,
        world_from_light: Mat4::IDENTITY,
    }
}

#[test]
fn sky_is_mitsubas() {
    for (elevation, turbidity, albedo, theta, phi, expected) in SKY {
        let d = desc(elevation, turbidity, albedo);
        let model = Sky::new(d.sun_direction, turbidity, d.albedo).unwrap().radiance(direction(theta, phi));
        let lights = sunsky::lights(&d).unwrap();
        let Light::Environment(map) = &lights[0] else { panic!("the sky comes first") };
        let mapped = map.radiance(direction(theta, phi)).rgb();
        for lane in 0..3 {
            let (v, e) = (model[lane], expected[lane]);
            assert!((v - e).abs() <= 0.01 * e, "sun at {elevation}, T {turbidity}, {theta} {phi}: {model:?}, expected {expected:?}");
            assert!((mapped[lane] - v).abs() <= 5e-3 * v, "the map has {mapped:?}, the model {model:?}");
        }
    }
}

#[test]
fn sun_is_mitsubas() {
    for (elevation, turbidity, expected) in SUN {
        let value = sun_irradiance(elevation, turbidity);
        for (v, e) in value.into_iter().zip(expected) {
            assert!((v - e).abs() <= 0.02 * e + 0.005, "sun at {elevation}, T {turbidity}: {value:?}, expected {expected:?}");
        }
    }
}

#[test]
fn transforms_hostile_numbers_and_parts() {
    let mut d = desc(0.7, 3.0, 0.2);
    // Up is +y in the world: the model's +z goes there, and its +x (the sun's side) to +x.
    d.world_from_light = Mat4::from_rotation_x(-PI / 2.0);
    let lights = sunsky::lights(&d).unwrap();
    let to_sun = Vec3::new(fns::cos(0.7), fns::sin(0.7), 0.0);
    assert!(!lights[1].escaped(Vec3::ZERO, to_sun).is_black());
    assert!(lights[0].escaped(Vec3::ZERO, -Vec3::Y).is_black());
    assert!(lights[0].escaped(Vec3::ZERO, to_sun).luminance() > 3.0 * lights[0].escaped(Vec3::ZERO, Vec3::Y).luminance());
    let ctx = LightContext { p: Vec3::ZERO, n: Vec3::Y };
    assert!((lights[1].sample(&ctx, Vec2::splat(0.5)).unwrap().wi - to_sun).length() < 0.01);

    let count = |change: &dyn Fn(&mut SunSkyDesc)| {
        let mut d = desc(0.7, 3.0, 0.2);
        change(&mut d);
        sunsky::lights(&d).map(|l| l.len())
    };
    assert_eq!(count(&|d| d.sky = false), Some(1));
    assert_eq!(count(&|d| d.sun_scale = 0.0), Some(1));
    assert_eq!(count(&|d| d.sun_direction = Vec3::new(1.0, 0.0, -0.2)), Some(1));
    assert_eq!(count(&|d| d.turbidity = 50.0), Some(2));
    assert_eq!(count(&|d| d.albedo = [2.0, -1.0, 0.5]), Some(2));
    assert_eq!(count(&|d| d.turbidity = f32::NAN), None);
    assert_eq!(count(&|d| d.sun_direction = Vec3::ZERO), None);
    assert_eq!(count(&|d| d.world_from_light = Mat4::ZERO), None);
}
