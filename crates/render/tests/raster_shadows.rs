//! The z-buffer renderer: shadow maps against shadow rays and closed forms, pictures against ray tracing.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use std::sync::Arc;

use etendue_render::accel::Ray;
use etendue_render::film::Film;
use etendue_render::integrator::Raster;
use etendue_render::lightmap::SurfaceLight;
use etendue_render::raster::*;
use etendue_render::scene::{Scene, Surface};
use etendue_render::spectrum::Spectrum;
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use support::*;

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }
}

/// A floor at z = 0 with some boxes and a ball on it.
fn things(desc: &mut SceneDesc) {
    let gray = diffuse(desc, 0.5);
    rectangle(desc, Vec3::ZERO, [4.0, 4.0], false, Some(gray));
    let mut r = Random(11);
    for _ in 0..8 {
        let (x, y, h) = (4.0 * r.unit() - 2.0, 4.0 * r.unit() - 2.0, 0.2 + 0.6 * r.unit());
        let m = Mat4::from_translation(Vec3::new(x, y, h)) * Mat4::from_rotation_z(r.unit()) * Mat4::from_scale(Vec3::new(0.25, 0.2, h));
        shape(desc, GeometryDesc::Cube, m, Some(gray));
    }
    sphere(desc, Vec3::new(0.3, -0.4, 1.6), 0.35, Some(gray));
    perspective(desc, Vec3::new(3.0, -6.0, 5.0), Vec3::ZERO, 45.0);
}

/// The maps of a scene's first light.
fn first_map(scene: &Scene, resolution: u32) -> ShadowMap {
    let triangles = Triangles::from_scene(scene).unwrap();
    let group = light_groups(scene).remove(0);
    let keeps = |_: &View, _: u32, _: u32, _: u32| true;
    ShadowMap::new(&group, &Casters { triangles: &triangles, sphere: scene.bounds.bounding_sphere(), seen: &[], resolution, keeps: &keeps })
}

#[test]
fn shadow_maps_agree_with_shadow_rays_but_for_edges() {
    let from = Vec3::new(1.0, 1.5, 4.0);
    let to_light = Vec3::new(0.3, 0.5, 1.0).normalize();
    let spot = look_at(from, Vec3::ZERO);
    let lights = [
        LightDesc::Point { position: from, intensity: [10.0; 3] },
        LightDesc::Spot {
            world_from_light: spot,
            intensity: [10.0; 3],
            outer_rad: 0.9,
            inner_rad: 0.8,
            falloff: SpotFalloff::Smoothstep,
            texture: None,
        },
        LightDesc::Directional { direction: -to_light, irradiance: [3.0; 3] },
    ];
    for (k, light) in lights.into_iter().enumerate() {
        let mut desc = scene();
        things(&mut desc);
        add(&mut desc, light);
        let scene = compile(&desc, &settings(64, 64, 1));
        let map = first_map(&scene, 1024);
        let lit = |p: Vec3, n: Vec3| {
            let (d, t_max) = if k == 2 { (to_light, f32::INFINITY) } else { ((from - p).normalize(), from.distance(p)) };
            n.dot(d) > 0.0 && !scene.accel.occluded(&Ray { o: p + n * 1e-4, d, t_min: 0.0, t_max })
        };
        let mut r = Random(5 + k as u64);
        let (mut count, mut differ, mut far) = (0, 0, 0);
        // Points that a camera would see: where rays from above and from the sides meet the scene.
        while count < 20_000 {
            let o = Vec3::new(8.0 * r.unit() - 4.0, -6.0 * r.unit(), 5.0);
            let d = (Vec3::new(5.0 * r.unit() - 2.5, 5.0 * r.unit() - 2.5, 0.0) - o).normalize();
            let Some(s) = scene.intersect(&Ray::new(o, d)) else { continue };
            let n = if s.ng.dot(d) > 0.0 { -s.ng } else { s.ng };
            let to = if k == 2 { to_light } else { (from - s.p).normalize() };
            if n.dot(to) < 0.05 {
                continue;
            }
            count += 1;
            let truth = lit(s.p, n);
            let found = map.visibility(s.p, n, ShadowFilter::Hard, 1.0, [0.5; 2]) > 0.5;
            if truth != found {
                differ += 1;
                // Near an edge some neighbor within a few texels has the other answer.
                let near = (0..32).any(|_| {
                    let (a, b) = n.any_orthonormal_pair();
                    let q = s.p + (a * (r.unit() - 0.5) + b * (r.unit() - 0.5)) * 0.12;
                    lit(q, n) != truth
                });
                far += u32::from(!near);
            }
        }
        let share = f64::from(differ) / f64::from(count);
        assert!(share < 0.012, "light {k}: {share} of the points differ");
        assert!(far < count / 2000, "light {k}: {far} of {count} points differ far from edges");
    }
}

#[test]
fn shadows_of_slopes_have_no_acne_with_bias_and_have_it_without() {
    let mut desc = scene();
    let gray = diffuse(&mut desc, 0.5);
    rectangle(&mut desc, Vec3::ZERO, [4.0, 4.0], false, Some(gray));
    perspective(&mut desc, Vec3::new(3.0, -6.0, 5.0), Vec3::ZERO, 45.0);
    add(&mut desc, LightDesc::Point { position: Vec3::new(3.0, 0.0, 1.0), intensity: [1.0; 3] });
    let scene = compile(&desc, &settings(8, 8, 1));
    let map = first_map(&scene, 256);
    let mut r = Random(1);
    let mut dark = [[0; 2]; 3];
    for _ in 0..4000 {
        let p = Vec3::new(6.0 * r.unit() - 3.0, 6.0 * r.unit() - 3.0, 0.0);
        for (f, filter) in [ShadowFilter::Hard, ShadowFilter::Pcf, ShadowFilter::Pcss].into_iter().enumerate() {
            for (b, bias) in [0.0, 1.0].into_iter().enumerate() {
                dark[f][b] += u32::from(map.visibility(p, Vec3::Z, filter, bias, [r.unit(), r.unit()]) < 0.999);
            }
        }
    }
    assert!(dark[0][0] > 1000, "without bias half of the texels are in their own shadow: {dark:?}");
    assert!(dark.iter().all(|d| d[1] == 0), "with bias none is: {dark:?}");
}

#[test]
fn penumbras_are_as_wide_as_the_light_makes_them() {
    // A square light of edge 1 at height 4, a half-plane at height 1 that ends at x = 0: on the floor light fades in linearly over
    // 1 · (4 − 3) / 3.
    let mut desc = scene();
    let gray = diffuse(&mut desc, 0.5);
    rectangle(&mut desc, Vec3::ZERO, [4.0, 4.0], false, Some(gray));
    rectangle(&mut desc, Vec3::new(-2.0, 0.0, 1.0), [2.0, 4.0], false, Some(gray));
    let lamp = rectangle(&mut desc, Vec3::new(0.0, 0.0, 4.0), [0.5, 0.5], true, None);
    emit(&mut desc, lamp, Color::gray(10.0));
    perspective(&mut desc, Vec3::new(3.0, -6.0, 5.0), Vec3::ZERO, 45.0);
    let scene = compile(&desc, &settings(8, 8, 1));
    let map = first_map(&scene, 512);
    let mut r = Random(2);
    let mut at = |x: f32, filter: ShadowFilter| {
        let n = 400;
        let sum: f32 = (0..n).map(|_| map.visibility(Vec3::new(x, r.unit() - 0.5, 0.0), Vec3::Z, filter, 1.0, [r.unit(), r.unit()])).sum();
        sum / n as f32
    };
    for i in -8..=8 {
        let x = i as f32 / 40.0;
        let truth = (0.5 + 3.0 * x).clamp(0.0, 1.0);
        let soft = at(x, ShadowFilter::Pcss);
        assert!((soft - truth).abs() < 0.06, "at {x}: {soft} instead of {truth}");
        // The plain map knows no penumbra.
        let plain = at(x, ShadowFilter::Pcf);
        assert!(x.abs() < 0.04 || (plain - f32::from(u8::from(x > 0.0))).abs() < 0.05, "at {x}: {plain}");
    }
}

fn mean(film: &Film, rect: [u32; 4]) -> f64 {
    let image = film.develop();
    let (names, w) = (["R", "G", "B"], image.width as usize);
    let plane = |n: &str| image.channel(n).unwrap().to_vec();
    let mut sum = 0.0;
    for n in names {
        let data = plane(n);
        for y in rect[1]..rect[3] {
            for x in rect[0]..rect[2] {
                sum += f64::from(data[y as usize * w + x as usize]);
            }
        }
    }
    sum / f64::from(3 * (rect[2] - rect[0]) * (rect[3] - rect[1]))
}

#[test]
fn maps_from_many_places_converge_to_direct_light() {
    let mut desc = scene();
    things(&mut desc);
    let lamp = rectangle(&mut desc, Vec3::new(1.0, 1.0, 4.0), [0.6, 0.4], true, None);
    emit(&mut desc, lamp, Color::gray(20.0));
    constant_sky(&mut desc, 0.5);
    let base = settings(48, 48, 96);
    let by = |name: &str, maps: &str| {
        let integrator = Some(name.to_owned());
        render(&desc, &RenderSettings { integrator, shadow_maps: Some(maps.to_owned()), shadow_resolution: Some(512), ..base.clone() })
    };
    let (truth, sampled) = (by("direct", "center"), by("raster", "sampled"));
    // Quarters of the picture: the sky's samples are shared by all pixels and leave some noise.
    for (x, y) in [(0, 0), (24, 0), (0, 24), (24, 24)] {
        let rect = [x, y, x + 24, y + 24];
        let (a, b) = (mean(&truth, rect), mean(&sampled, rect));
        assert!((b / a - 1.0).abs() < 0.03, "quarter {x} {y}: {b} instead of {a}");
    }
}

#[test]
fn soft_shadows_from_one_map_are_near_those_of_rays() {
    let mut desc = scene();
    things(&mut desc);
    let lamp = rectangle(&mut desc, Vec3::new(1.0, 1.0, 4.0), [0.3, 0.3], true, None);
    emit(&mut desc, lamp, Color::gray(40.0));
    let base = settings(64, 64, 32);
    let by = |name: &str| render(&desc, &RenderSettings { integrator: Some(name.to_owned()), ..base.clone() });
    let (truth, raster) = (by("direct"), by("raster"));
    let all = [0, 0, 64, 64];
    let ratio = mean(&raster, all) / mean(&truth, all);
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}

#[test]
fn surfaces_under_a_uniform_sky_are_as_bright_as_it_without_shadows() {
    for material in [BsdfDesc::Diffuse { reflectance: Color::gray(1.0), alpha: None }, mirror(None), mirror(Some(0.3))] {
        let rough = matches!(&material, BsdfDesc::Conductor { roughness: Some(_), .. });
        let mut desc = scene();
        let material = bsdf(&mut desc, material);
        sphere(&mut desc, Vec3::ZERO, 1.0, Some(material));
        constant_sky(&mut desc, 1.0);
        orthographic(&mut desc, Vec3::new(1.0, 2.0, 5.0), Vec3::ZERO, 1.2);
        let film = render(&desc, &RenderSettings { integrator: Some("raster".into()), ..settings(16, 16, 4) });
        let m = mean(&film, [0, 0, 16, 16]);
        // Rough mirrors lose what facets send into each other.
        let ok = if rough { (0.9..=1.001).contains(&m) } else { (m - 1.0).abs() < 0.01 };
        assert!(ok, "{m}");
    }
}

#[test]
fn masks_let_their_share_of_the_background_through() {
    let mut desc = scene();
    let black = diffuse(&mut desc, 0.0);
    let nested = bsdf(&mut desc, BsdfDesc::TwoSided { front: black, back: black });
    let mask = bsdf(&mut desc, BsdfDesc::Mask { nested, opacity: Param::Constant(0.3) });
    rectangle(&mut desc, Vec3::ZERO, [4.0, 4.0], false, Some(mask));
    constant_sky(&mut desc, 1.0);
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, 1.0);
    let film = render(&desc, &RenderSettings { integrator: Some("raster".into()), ..settings(16, 16, 64) });
    let m = mean(&film, [0, 0, 16, 16]);
    assert!((m - 0.7).abs() < 0.02, "{m}");
}

#[test]
fn pictures_do_not_depend_on_threads_or_split_ranges() {
    let mut desc = scene();
    things(&mut desc);
    let metal = bsdf(&mut desc, mirror(Some(0.1)));
    sphere(&mut desc, Vec3::new(-1.0, 0.5, 1.5), 0.4, Some(metal));
    add(&mut desc, LightDesc::Point { position: Vec3::new(1.0, 1.5, 4.0), intensity: [10.0; 3] });
    constant_sky(&mut desc, 0.3);
    let base = RenderSettings { integrator: Some("raster".into()), shadow_resolution: Some(256), ..settings(40, 30, 4) };
    let with = |threads: usize, first: u32, count: u32| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut session = session(&desc, &base);
        session.set_first_sample(first);
        pool.install(|| finish(session, &RenderSettings { spp: Some(count), ..base.clone() }))
    };
    let pixels = |film: &Film| film.develop().channels.iter().map(|p| p.data.clone()).collect::<Vec<_>>();
    let whole = with(1, 0, 4);
    assert_eq!(pixels(&whole), pixels(&with(4, 0, 4)));
    let mut parts = with(3, 2, 2);
    parts.merge(&with(2, 0, 2)).unwrap();
    assert_eq!(pixels(&whole), pixels(&parts));
}

#[test]
fn cameras_of_all_kinds_see_what_rays_see() {
    for kind in 0..3 {
        let mut desc = scene();
        things(&mut desc);
        desc.cameras.clear();
        match kind {
            0 => orthographic(&mut desc, Vec3::new(3.0, -6.0, 5.0), Vec3::ZERO, 3.0),
            1 => panoramic(&mut desc, Vec3::new(0.2, 1.0, 1.2)),
            _ => {
                let projection = ProjectionDesc::Perspective {
                    fov_rad: 0.7,
                    fov_axis: FovAxis::X,
                    aperture_radius: 0.3,
                    focus_distance: 7.0,
                    principal_point_offset: [0.1, -0.2],
                };
                let world_from_camera = look_at(Vec3::new(3.0, -6.0, 5.0), Vec3::ZERO);
                add(&mut desc, CameraDesc { world_from_camera, projection, near: 0.0, far: f32::INFINITY, medium: None });
            }
        }
        add(&mut desc, LightDesc::Directional { direction: -Vec3::Z, irradiance: [3.0; 3] });
        let base = settings(64, 48, 32);
        let by = |name: &str| render(&desc, &RenderSettings { integrator: Some(name.into()), ..base.clone() });
        let (truth, raster) = (by("normals"), by("raster"));
        // Coverage: where the picture is not empty.
        let alpha = |film: &Film| {
            let image = film.develop();
            image.channel("A").map(|a| a.iter().map(|v| f64::from(*v)).sum::<f64>() / a.len() as f64)
        };
        let (a, b) = (alpha(&truth).unwrap(), alpha(&raster).unwrap());
        assert!(a > 0.05 && (a - b).abs() < 0.01, "camera {kind}: {a} {b}");
    }
}

struct Solved;

impl SurfaceLight for Solved {
    fn irradiance(&self, _scene: &Scene, surface: &Surface) -> Spectrum {
        Spectrum::splat(std::f32::consts::PI * (1.0 + surface.p.x))
    }
}

#[test]
fn light_that_was_solved_beforehand_is_shown() {
    let mut desc = scene();
    let half = diffuse(&mut desc, 0.5);
    rectangle(&mut desc, Vec3::ZERO, [4.0, 4.0], false, Some(half));
    orthographic(&mut desc, Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, 0.5);
    add(&mut desc, LightDesc::Directional { direction: -Vec3::Z, irradiance: [100.0; 3] });
    let base = settings(16, 16, 4);
    let raster = Raster::new(LightingOptions::default()).with_surface_light(Arc::new(Solved));
    let film = finish(session_of(compile(&desc, &base), Box::new(raster), &base), &base);
    assert!((mean(&film, [0, 0, 16, 16]) - 0.5).abs() < 0.01);
}

#[test]
fn scenes_without_anything_and_with_absurd_numbers_do_no_harm() {
    let raster = RenderSettings { integrator: Some("raster".into()), shadow_resolution: Some(64), ..settings(8, 8, 2) };
    let mut empty = scene();
    perspective(&mut empty, Vec3::Z, Vec3::ZERO, 40.0);
    assert_eq!(mean(&render(&empty, &raster), [0, 0, 8, 8]), 0.0);
    let mut desc = scene();
    let gray = diffuse(&mut desc, 0.5);
    let metal = bsdf(&mut desc, mirror(None));
    for (i, scale) in [1e-30f32, 1e15, 1e-6, 1.0].into_iter().enumerate() {
        sphere(&mut desc, Vec3::splat(i as f32), scale, Some(if i % 2 == 0 { gray } else { metal }));
        let lamp = rectangle(&mut desc, Vec3::new(i as f32, 0.0, 1e6), [scale, scale], true, None);
        emit(&mut desc, lamp, Color::gray(1e20));
    }
    add(&mut desc, LightDesc::Point { position: Vec3::splat(1e20), intensity: [1e30; 3] });
    add(&mut desc, LightDesc::Directional { direction: Vec3::X, irradiance: [1.0; 3] });
    perspective(&mut desc, Vec3::new(3.0, -6.0, 5.0), Vec3::ZERO, 45.0);
    for maps in ["center", "sampled"] {
        let settings = RenderSettings { shadow_maps: Some(maps.into()), ..raster.clone() };
        let mut session = session(&desc, &settings);
        let stop = etendue_render::session::Stop { spp: Some(2), ..Default::default() };
        session.render(&stop, &etendue_render::session::Cancel::default(), &etendue_render::session::Silent).unwrap();
    }
}

#[test]
fn settings_that_are_not_known_are_named() {
    let mut desc = scene();
    perspective(&mut desc, Vec3::Z, Vec3::ZERO, 40.0);
    let base = RenderSettings { integrator: Some("raster".into()), ..settings(8, 8, 1) };
    let error = |s: RenderSettings| {
        let plan = etendue_render::session::job::Plan::new(&desc, &s, None).unwrap();
        etendue_render::session::job::prepare(&desc, &s, &plan, &[]).err().map(|e| e.to_string()).unwrap_or_default()
    };
    assert!(error(RenderSettings { shadow_filter: Some("soft".into()), ..base.clone() }).contains("hard, pcf, pcss"));
    assert!(error(RenderSettings { envmap: Some("x".into()), ..base.clone() }).contains("none, sky, object"));
    assert!(error(RenderSettings { envmap_correction: Some("x".into()), ..base.clone() }).contains("none, box"));
    assert!(error(RenderSettings { shadow_maps: Some("x".into()), ..base.clone() }).contains("center, sampled"));
    assert!(error(RenderSettings { shadow_resolution: Some(0), ..base.clone() }).contains("texels"));
    assert!(error(RenderSettings { shadow_bias: Some(f32::NAN), ..base }).contains("bias"));
}
