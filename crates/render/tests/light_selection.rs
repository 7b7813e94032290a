//! Choosing lights: probabilities sum to one, are those of the samples, and make unbiased estimates.

#![allow(clippy::unwrap_used)]

use etendue_render::light::{
    AreaGeometry, AreaLight, ConstantLight, DirectionalLight, Light, LightContext, LightSampler, LightSelection, PointLight, SceneSphere,
    SpotLight,
};
use etendue_render::math::hash::{mix32, unit_float};
use etendue_render::math::{Mat4, Vec2, Vec3, warp};
use etendue_render::shape::{Shape, Sphere};
use etendue_render::spectrum::Spectrum;
use etendue_scene::desc::SpotFalloff;

const SCENE: SceneSphere = SceneSphere { center: Vec3::ZERO, radius: 15.0, endless: false };

fn rnd(i: u32) -> f32 {
    unit_float(mix32(i))
}

fn rnd3(i: u32) -> Vec3 {
    Vec3::new(rnd(3 * i), rnd(3 * i + 1), rnd(3 * i + 2))
}

fn dir(i: u32) -> Vec3 {
    warp::uniform_sphere(Vec2::new(rnd(2 * i), rnd(2 * i + 1)))
}

fn emitter(geometry: AreaGeometry, strength: f32, two_sided: bool) -> Light {
    Light::Area(AreaLight {
        geometry,
        radiance: Spectrum::splat(strength),
        emission_id: 0,
        textured: false,
        two_sided,
        flip_normals: false,
    })
}

/// Triangles, spheres, points and spots in a cube of side 20, of strengths over four orders of magnitude.
fn finite_lights(n: u32) -> Vec<Light> {
    let light = |i: u32| {
        let p = (rnd3(i) - 0.5) * 20.0;
        let strength = 10.0f32.powi((rnd(50_000 + i) * 4.0) as i32 - 2);
        match i % 5 {
            0 | 1 => {
                let corners = [p, p + 0.3 * dir(60_000 + i), p + 0.3 * dir(70_000 + i)];
                emitter(AreaGeometry::Triangle(corners), strength, i.is_multiple_of(10))
            }
            2 => emitter(AreaGeometry::Shape(Box::new(Shape::Sphere(Sphere::new(p, 0.1 + 0.2 * rnd(i)).unwrap()))), strength, false),
            3 => Light::Point(PointLight { p, intensity: Spectrum::splat(0.1 * strength) }),
            _ => {
                let m = Mat4::from_translation(p) * Mat4::from_quat(glam::Quat::from_rotation_arc(-Vec3::Z, dir(80_000 + i)));
                Light::Spot(SpotLight::new(m, [0.1 * strength; 3], 0.2 + 0.3 * rnd(i), 0.8, SpotFalloff::Linear).unwrap())
            }
        }
    };
    (0..n).map(light).collect()
}

fn with_infinite(n: u32) -> Vec<Light> {
    let mut lights = finite_lights(n);
    lights.insert(7, Light::Constant(ConstantLight { radiance: Spectrum::splat(0.01) }));
    lights.push(Light::Directional(DirectionalLight::new(Vec3::new(0.2, -1.0, 0.1), [0.02; 3]).unwrap()));
    // One that gives nothing.
    lights.push(Light::Point(PointLight { p: Vec3::ZERO, intensity: Spectrum::ZERO }));
    lights
}

const SELECTIONS: [LightSelection; 3] = [LightSelection::Uniform, LightSelection::Power, LightSelection::Bvh];

fn contexts() -> Vec<LightContext> {
    (0..12)
        .map(|i| LightContext {
            p: (rnd3(1234 + i) - 0.5) * if i < 6 { 20.0 } else { 60.0 },
            n: if i % 3 == 0 { Vec3::ZERO } else { dir(4321 + i) },
        })
        .collect()
}

#[test]
fn probabilities_sum_to_one_and_are_those_of_the_samples() {
    let lights = with_infinite(200);
    for selection in SELECTIONS {
        let sampler = LightSampler::new(&lights, &SCENE, selection);
        for ctx in contexts() {
            let pmf: Vec<f32> = (0..lights.len() as u32).map(|l| sampler.pmf(&ctx, l)).collect();
            let sum: f64 = pmf.iter().map(|&p| f64::from(p)).sum();
            // The hierarchy may end where a group's bounds are lit but no member's are.
            let least = if selection == LightSelection::Bvh { 0.9 } else { 1.0 - 1e-4 };
            assert!(sum > least && sum < 1.0 + 1e-4, "{selection:?}: {sum}");
            assert_eq!(pmf[lights.len() - 1], 0.0, "a black light is never chosen");
            // Stratified samples: counts are within rounding (a few strata per level) of their expectation.
            let n = 100_000;
            let (mut hits, mut none) = (vec![0u32; lights.len()], 0);
            for i in 0..n {
                let Some((light, p)) = sampler.sample(&ctx, (i as f32 + 0.5) / n as f32) else {
                    none += 1;
                    continue;
                };
                assert!((p - pmf[light as usize]).abs() <= 1e-5 * p, "{selection:?}: light {light} has {p} and {}", pmf[light as usize]);
                hits[light as usize] += 1;
            }
            for (hit, p) in hits.iter().zip(&pmf) {
                assert!((f64::from(*hit) - f64::from(*p) * f64::from(n)).abs() < 3.0 + 1e-3 * f64::from(*hit), "{selection:?}: {hit} {p}");
            }
            assert!((f64::from(none) / f64::from(n) - (1.0 - sum)).abs() < 1e-3, "{none} samples of no light, the rest has {sum}");
            assert_eq!(sampler.pmf(&ctx, 5000), 0.0);
        }
    }
}

/// What all lights give at a point without shadows, by sampling each, and the probability of every light that gives something.
#[test]
fn estimates_are_unbiased_and_no_contribution_is_without_probability() {
    let lights = with_infinite(1000);
    let samplers = SELECTIONS.map(|s| LightSampler::new(&lights, &SCENE, s));
    let arriving = |ctx: &LightContext, light: &Light, u: Vec2| {
        let cos = |wi: Vec3| if ctx.n == Vec3::ZERO { 1.0 } else { wi.dot(ctx.n).max(0.0) };
        light.sample(ctx, u).map_or(0.0, |s| f64::from(s.radiance[0] * cos(s.wi) / s.pdf))
    };
    for ctx in contexts() {
        let mut expected = 0.0;
        for (i, light) in lights.iter().enumerate() {
            let each = 64;
            let given: f64 = (0..each).map(|k| arriving(&ctx, light, Vec2::new((k as f32 + 0.5) / each as f32, rnd(k)))).sum::<f64>();
            expected += given / f64::from(each);
            for (sampler, selection) in samplers.iter().zip(SELECTIONS) {
                assert!(given == 0.0 || sampler.pmf(&ctx, i as u32) > 0.0, "{selection:?}: light {i} gives {given} at {ctx:?}");
            }
        }
        for (k, sampler) in samplers.iter().enumerate() {
            let n = 200_000u32;
            let (mut sum, mut sum2) = (0.0, 0.0);
            for i in 0..n {
                let value = sampler.sample(&ctx, rnd(3 * i)).map_or(0.0, |(light, pmf)| {
                    arriving(&ctx, &lights[light as usize], Vec2::new(rnd(3 * i + 1), rnd(3 * i + 2))) / f64::from(pmf)
                });
                sum += value;
                sum2 += value * value;
            }
            let mean = sum / f64::from(n);
            let sigma = ((sum2 / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
            assert!((mean - expected).abs() < 4.5 * sigma + 0.01 * expected, "{:?}: {mean} ± {sigma}, expected {expected}", SELECTIONS[k]);
        }
    }
}

/// The share of the standard deviation that choosing by the hierarchy leaves of choosing by power, near lights and far from them.
#[test]
fn the_hierarchy_knows_distance_and_orientation() {
    let lights = finite_lights(1000);
    let samplers = [LightSelection::Power, LightSelection::Bvh].map(|s| LightSampler::new(&lights, &SCENE, s));
    let mut ratios: Vec<f64> = Vec::new();
    for i in 0..40 {
        let near = lights[i as usize * 20].bounds().unwrap().bounds.center() + 0.3 * dir(i);
        let ctx = LightContext { p: if i % 2 == 0 { near } else { 40.0 * dir(i) }, n: Vec3::ZERO };
        let given = |light: u32| {
            let u = |k: u32| Vec2::new((k as f32 + 0.5) / 16.0, rnd(k));
            (0..16).map(|k| lights[light as usize].sample(&ctx, u(k)).map_or(0.0, |s| f64::from(s.radiance[0] / s.pdf))).sum::<f64>() / 16.0
        };
        // Exact second moments: the variance that comes from the choice alone.
        let all: Vec<f64> = (0..lights.len() as u32).map(given).collect();
        let total: f64 = all.iter().sum();
        let [power, bvh] = [0, 1].map(|k| {
            let second = |(l, g): (usize, &f64)| if *g > 0.0 { g * g / f64::from(samplers[k].pmf(&ctx, l as u32)) } else { 0.0 };
            (all.iter().enumerate().map(second).sum::<f64>() - total * total).sqrt() / total
        });
        ratios.push(bvh / power);
    }
    ratios.sort_by(f64::total_cmp);
    assert!(ratios[20] < 0.5 && ratios[36] < 0.7, "{ratios:?}");
}

/// The importance is zero nowhere where a single light gives something, its surface's plane and its cone's limit included.
#[test]
fn importance_reaches_as_far_as_the_light() {
    for (i, light) in finite_lights(300).iter().enumerate() {
        let bounds = light.bounds().unwrap();
        for k in 0..300 {
            let id = (i * 300 + k) as u32;
            let distance = 10.0f32.powi(k as i32 % 7 - 3);
            let p = bounds.bounds.center() + dir(id) * distance;
            for n in [Vec3::ZERO, dir(id + 1), (p - bounds.bounds.center()).normalize().any_orthonormal_vector()] {
                let ctx = LightContext { p, n };
                let gives = (0..8)
                    .any(|s| light.sample(&ctx, Vec2::new(rnd(s), rnd(s + 1))).is_some_and(|s| n == Vec3::ZERO || s.wi.dot(n) != 0.0));
                assert!(!gives || bounds.importance(p, n) > 0.0, "light {i} at {p}, {bounds:?}");
                assert!(bounds.importance(p, n).is_finite());
            }
        }
    }
}

#[test]
fn bounds_of_groups_hold_their_members() {
    let lights = finite_lights(400);
    for (k, pair) in lights.windows(2).enumerate() {
        let (a, b) = (pair[0].bounds().unwrap(), pair[1].bounds().unwrap());
        let u = a.union(&b);
        for m in [a, b] {
            assert_eq!(u.bounds.union(m.bounds), u.bounds);
            // A cone about another: the angle between the axes plus the inner half-angle.
            let angle = angle_between(u.axis, m.axis) + f64::from(m.cos_o).acos();
            assert!(u.cos_o <= -1.0 || angle <= f64::from(u.cos_o).acos() + 2e-3, "pair {k}: {m:?} is outside of {u:?}");
            assert!(u.cos_e <= m.cos_e && u.phi >= m.phi);
        }
    }
}

fn angle_between(a: Vec3, b: Vec3) -> f64 {
    let (a, b) = (a.as_dvec3(), b.as_dvec3());
    a.cross(b).length().atan2(a.dot(b))
}

#[test]
fn few_many_and_stacked_lights() {
    let ctx = LightContext { p: Vec3::new(0.1, 0.2, 0.3), n: Vec3::Z };
    for selection in SELECTIONS {
        assert!(LightSampler::new(&[], &SCENE, selection).sample(&ctx, 0.5).is_none());
        let one = LightSampler::new(&finite_lights(1), &SCENE, selection);
        assert_eq!(one.sample(&ctx, 0.7), Some((0, 1.0)));
        assert_eq!((one.pmf(&ctx, 0), one.pmf(&ctx, 1)), (1.0, 0.0));
        let only_infinite: Vec<Light> = (0..3).map(|_| Light::Constant(ConstantLight { radiance: Spectrum::ONE })).collect();
        let s = LightSampler::new(&only_infinite, &SCENE, selection);
        assert!((s.sample(&ctx, 0.999_999).unwrap().1 - 1.0 / 3.0).abs() < 1e-6);
        // All at one place: no plane splits them.
        let stacked: Vec<Light> = (0..5000).map(|_| Light::Point(PointLight { p: Vec3::ONE, intensity: Spectrum::ONE })).collect();
        let s = LightSampler::new(&stacked, &SCENE, selection);
        let (light, pmf) = s.sample(&ctx, 0.3).unwrap();
        assert!((pmf * 5000.0 - 1.0).abs() < 0.1 && (s.pmf(&ctx, light) - pmf).abs() < 1e-6);
        // Strengths beyond all reason, and a receiver at a light.
        let wild: Vec<Light> = [1e-38, 1e38, 1.0, f32::MAX]
            .map(|s| Light::Point(PointLight { p: Vec3::splat(s.min(10.0)), intensity: Spectrum::splat(s) }))
            .to_vec();
        let s = LightSampler::new(&wild, &SCENE, selection);
        for p in [Vec3::splat(10.0), Vec3::ZERO, Vec3::splat(1e30)] {
            for i in 0..100 {
                let ctx = LightContext { p, n: Vec3::ZERO };
                let sample = s.sample(&ctx, rnd(i));
                assert!(sample.is_none_or(|(_, pmf)| pmf > 0.0 && pmf <= 1.0), "{selection:?} {p}: {sample:?}");
            }
        }
    }
}
