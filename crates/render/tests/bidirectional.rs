//! Bidirectional methods agree with the path tracer: Z-tests over picture blocks.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests")]

mod support;

use etendue_render::integrator::{Integrator, Vcm};
use etendue_scene::desc::*;
use etendue_scene::{RenderSettings, SceneDesc};
use glam::{Mat4, Vec3};
use support::statistics::{Blocks, ROUNDING, assert_same};
use support::*;

const EDGE: usize = 8;

fn base(spp: u32) -> RenderSettings {
    RenderSettings { max_depth: Some(5), ..settings(24, 24, spp) }
}

fn method(name: &str, spp: u32) -> RenderSettings {
    RenderSettings { integrator: Some(name.into()), ..base(spp) }
}

/// The path tracer's.
fn reference(desc: &SceneDesc, s: &RenderSettings) -> Blocks {
    Blocks::new(&render_seeds(desc, s, 50..52), EDGE)
}

fn blocks(desc: &SceneDesc, s: &RenderSettings) -> Blocks {
    Blocks::of_seeds(desc, s, EDGE)
}

fn wall(desc: &mut SceneDesc, m: Mat4, b: BsdfId) -> ShapeId {
    shape(desc, GeometryDesc::Rectangle, m, Some(b))
}

/// A room with a red wall, open to the viewer; no light yet.
fn room(desc: &mut SceneDesc) -> BsdfId {
    let white = diffuse(desc, 0.6);
    let red = add(desc, BsdfDesc::Diffuse { reflectance: Color::Constant([0.6, 0.2, 0.1]), alpha: None });
    wall(desc, Mat4::from_scale(Vec3::splat(2.0)), white);
    wall(desc, facing(Vec3::new(0.0, 0.0, 3.0), [2.0; 2], true), white);
    let quarter = std::f32::consts::FRAC_PI_2;
    let at = |x, y| Mat4::from_translation(Vec3::new(x, y, 1.5));
    wall(desc, at(-2.0, 0.0) * Mat4::from_rotation_y(quarter) * Mat4::from_scale(Vec3::splat(2.0)), red);
    wall(desc, at(0.0, 2.0) * Mat4::from_rotation_x(quarter) * Mat4::from_scale(Vec3::splat(2.0)), white);
    perspective(desc, Vec3::new(1.0, -5.0, 2.0), Vec3::new(0.0, 0.0, 1.0), 40.0);
    white
}

/// Rough and coated balls, a glowing one, and a lamp.
fn glossy_room() -> SceneDesc {
    let mut desc = scene();
    let white = room(&mut desc);
    for (i, model) in [plastic(0.5, false, Some(0.2)), mirror(Some(0.3)), glass(1.5, Some(0.4))].into_iter().enumerate() {
        let material = bsdf(&mut desc, model);
        sphere(&mut desc, Vec3::new(1.2 * i as f32 - 1.2, 0.0, 0.5), 0.5, Some(material));
    }
    let light = rectangle(&mut desc, Vec3::new(0.3, 0.0, 2.9), [0.8, 0.5], true, Some(white));
    emit(&mut desc, light, Color::Constant([4.0, 3.0, 2.0]));
    let glow = sphere(&mut desc, Vec3::new(-0.8, 1.2, 1.8), 0.4, Some(white));
    emit(&mut desc, glow, Color::gray(2.0));
    desc
}

/// Glass, a mirror and plastic under a lamp that is not too small for the path tracer to find.
fn caustic() -> SceneDesc {
    let mut desc = scene();
    let white = room(&mut desc);
    let glass = bsdf(&mut desc, glass(1.5, None));
    sphere(&mut desc, Vec3::new(0.7, -0.4, 0.7), 0.6, Some(glass));
    let mirror = bsdf(&mut desc, mirror(None));
    sphere(&mut desc, Vec3::new(-0.8, 0.4, 0.6), 0.6, Some(mirror));
    let plastic = bsdf(&mut desc, plastic(0.5, true, None));
    rectangle(&mut desc, Vec3::new(0.0, -0.6, 0.05), [0.4, 0.4], false, Some(plastic));
    let lamp = sphere(&mut desc, Vec3::new(0.3, 0.0, 2.3), 0.4, Some(white));
    emit(&mut desc, lamp, Color::Constant([5.0, 4.0, 3.0]));
    desc
}

/// Adds something to a scene.
type Change = fn(&mut SceneDesc);

#[test]
fn rough_surfaces() {
    let desc = glossy_room();
    let path = reference(&desc, &base(256));
    assert_same("bdpt rough", &blocks(&desc, &method("bdpt", 12)), &path, ROUNDING, 0.04);
    assert_same("light rough", &blocks(&desc, &method("light", 32)), &path, ROUNDING, 0.08);
    assert_same("mlt rough", &blocks(&desc, &method("mlt", 32)), &path, ROUNDING, 0.2);
}

#[test]
fn every_depth_by_itself() {
    let desc = glossy_room();
    for depth in [0, 1, 2] {
        let s = |name, spp| RenderSettings { max_depth: Some(depth), ..method(name, spp) };
        let path = reference(&desc, &s("path", 128));
        for (name, spp) in [("bdpt", 8), ("light", 16), ("mlt", 16)] {
            assert_same(&format!("{name} depth {depth}"), &blocks(&desc, &s(name, spp)), &path, ROUNDING, 0.6);
        }
    }
}

#[test]
fn caustics() {
    let desc = caustic();
    let path = reference(&desc, &base(768));
    assert_same("bdpt caustic", &blocks(&desc, &method("bdpt", 16)), &path, ROUNDING, 0.1);
    assert_same("mlt caustic", &blocks(&desc, &method("mlt", 32)), &path, ROUNDING, 0.2);
}

#[test]
fn vcm_without_radius() {
    for (name, desc) in [("rough", glossy_room()), ("caustic", caustic())] {
        let path = reference(&desc, &base(512));
        let zero =
            Blocks::without_radius(0.16, |radius| blocks(&desc, &RenderSettings { photon_radius: Some(radius), ..method("vcm", 12) }));
        assert_same(&format!("vcm {name}"), &zero, &path, 5e-3, 0.15);
        // As `auto` has it: merging finds what splats would.
        let zero = Blocks::without_radius(0.16, |radius| {
            let film = |seed| {
                let s = RenderSettings { seed, ..base(12) };
                let vcm = Vcm::without_splats(5, 4, Some(radius));
                assert!(!vcm.splats());
                finish(session_of(compile(&desc, &s), Box::new(vcm), &s), &s)
            };
            Blocks::of_films(&(0..10).map(film).collect::<Vec<_>>(), EDGE)
        });
        assert_same(&format!("vcm {name} without splats"), &zero, &path, 5e-3, 0.15);
    }
}

#[test]
fn lights_of_all_kinds() {
    let lights: [(&str, Change); 4] = [
        ("constant", |desc| constant_sky(desc, 0.7)),
        ("environment", |desc| {
            let sky = (0..8 * 4 * 3).map(|i| 0.1 + (i * 7 % 11) as f32 * 0.1).collect();
            let image = picture(desc, 8, 4, 3, sky);
            let mapping = EnvironmentMapping::Equirectangular;
            add(
                desc,
                LightDesc::Environment { image, scale: [1.0; 3], world_from_light: Mat4::from_rotation_x(1.57), mapping, portal: None },
            );
        }),
        ("points", |desc| {
            add(desc, LightDesc::Point { position: Vec3::new(1.0, -1.0, 2.0), intensity: [5.0, 4.0, 3.0] });
            let spot = LightDesc::Spot {
                world_from_light: look_at(Vec3::new(1.0, -2.0, 2.5), Vec3::ZERO),
                intensity: [20.0; 3],
                outer_rad: 0.5,
                inner_rad: 0.3,
                falloff: SpotFalloff::Linear,
                texture: None,
            };
            add(desc, spot);
        }),
        ("directional", |desc| {
            add(desc, LightDesc::Directional { direction: Vec3::new(-0.5, 1.0, -1.0), irradiance: [3.0, 2.0, 1.0] });
        }),
    ];
    for (name, light) in lights {
        let mut desc = scene();
        room(&mut desc);
        let rough = bsdf(&mut desc, glass(1.4, Some(0.3)));
        sphere(&mut desc, Vec3::new(0.4, 0.0, 0.6), 0.6, Some(rough));
        light(&mut desc);
        let path = reference(&desc, &base(256));
        assert_same(&format!("bdpt {name}"), &blocks(&desc, &method("bdpt", 16)), &path, ROUNDING, 0.1);
        assert_same(&format!("light {name}"), &blocks(&desc, &method("light", 32)), &path, ROUNDING, 0.4);
    }
}

/// A ball on a floor without end, whose light comes from a sky and a direction: to the horizon, and from beyond it to the ball.
#[test]
fn floors_without_end() {
    let mut desc = scene();
    let (gray, red) = (diffuse(&mut desc, 0.5), diffuse(&mut desc, 0.8));
    shape(&mut desc, GeometryDesc::Plane, Mat4::IDENTITY, Some(gray));
    sphere(&mut desc, Vec3::new(0.0, 0.0, 0.6), 0.5, Some(red));
    constant_sky(&mut desc, 0.8);
    add(&mut desc, LightDesc::Directional { direction: Vec3::new(-0.5, 1.0, -1.0), irradiance: [1.0; 3] });
    perspective(&mut desc, Vec3::new(0.0, -6.0, 2.0), Vec3::new(0.0, 0.0, 0.4), 50.0);
    let path = reference(&desc, &base(128));
    assert_same("bdpt floor", &blocks(&desc, &method("bdpt", 8)), &path, ROUNDING, 0.1);
    assert_same("light floor", &blocks(&desc, &method("light", 48)), &path, ROUNDING, 0.3);
    assert_same("mlt floor", &blocks(&desc, &method("mlt", 32)), &path, ROUNDING, 0.3);
    let vcm = RenderSettings { photon_radius: Some(0.02), ..method("vcm", 8) };
    assert_same("vcm floor", &blocks(&desc, &vcm), &path, 5e-3, 0.15);
}

#[test]
fn many_lights() {
    let mut desc = scene();
    let white = room(&mut desc);
    for i in 0..40 {
        let (x, y, z) = ((i % 7) as f32 * 0.55 - 1.7, (i % 5) as f32 * 0.6 - 1.0, 0.3 + (i % 11) as f32 * 0.24);
        let bulb = sphere(&mut desc, Vec3::new(x, y, z), 0.04, Some(white));
        emit(&mut desc, bulb, Color::gray([0.5, 8.0, 40.0][i % 3]));
    }
    let path = reference(&desc, &base(256));
    assert_same("bdpt many lights", &blocks(&desc, &method("bdpt", 16)), &path, ROUNDING, 0.3);
}

#[test]
fn masks_and_panes() {
    let mut desc = glossy_room();
    let white = diffuse(&mut desc, 0.5);
    let mask = bsdf(&mut desc, BsdfDesc::Mask { nested: white, opacity: Param::Constant(0.5) });
    rectangle(&mut desc, Vec3::new(0.5, 0.0, 1.8), [0.9; 2], false, Some(mask));
    let pane = bsdf(&mut desc, pane(1.5));
    rectangle(&mut desc, Vec3::new(-0.5, 0.0, 2.2), [1.0; 2], false, Some(pane));
    let path = reference(&desc, &base(384));
    assert_same("bdpt see-through", &blocks(&desc, &method("bdpt", 16)), &path, ROUNDING, 0.08);
    assert_same("mlt see-through", &blocks(&desc, &method("mlt", 32)), &path, ROUNDING, 0.2);
}

#[test]
fn cameras_of_all_kinds() {
    let cameras: [(&str, Change); 3] = [
        ("orthographic", |desc| orthographic(desc, Vec3::new(1.0, -5.0, 2.0), Vec3::new(0.0, 0.0, 1.0), 1.5)),
        ("panoramic", |desc| panoramic(desc, Vec3::new(0.3, -1.2, 1.6))),
        ("lens", |desc| {
            desc.cameras[0].value.projection = ProjectionDesc::Perspective {
                fov_rad: 0.7,
                fov_axis: FovAxis::X,
                aperture_radius: 0.4,
                focus_distance: 4.0,
                principal_point_offset: [0.05, 0.0],
            };
        }),
    ];
    for (name, camera) in cameras {
        let mut desc = glossy_room();
        if name != "lens" {
            desc.cameras.clear();
        }
        camera(&mut desc);
        let path = reference(&desc, &base(192));
        assert_same(&format!("bdpt {name}"), &blocks(&desc, &method("bdpt", 12)), &path, ROUNDING, 0.2);
        assert_same(&format!("light {name}"), &blocks(&desc, &method("light", 24)), &path, ROUNDING, 0.3);
    }
}

/// Splats land by the same filter as camera samples, at the picture's edge as well.
#[test]
fn filters() {
    for (name, edge) in [("gaussian", 4), ("mitchell", 4)] {
        let mut desc = scene();
        let white = diffuse(&mut desc, 0.8);
        rectangle(&mut desc, Vec3::ZERO, [0.4, 0.3], false, Some(white));
        add(&mut desc, LightDesc::Directional { direction: Vec3::new(0.2, 0.1, -1.0), irradiance: [3.0, 2.0, 1.0] });
        orthographic(&mut desc, Vec3::new(0.2, 0.1, 2.0), Vec3::new(0.2, 0.1, 0.0), 0.6);
        let with = |name: &str, spp| RenderSettings { filter: Some(name.into()), ..settings(24, 24, spp) };
        let path = Blocks::new(&render_seeds(&desc, &with(name, 512), 50..52), edge);
        let light = RenderSettings { integrator: Some("light".into()), ..with(name, 1024) };
        assert_same(&format!("light {name}"), &Blocks::new(&render_seeds(&desc, &light, 0..2), edge), &path, 5e-3, 1.0);
    }
}

#[test]
fn white_furnace() {
    let mut desc = scene();
    constant_sky(&mut desc, 1.0);
    let white = diffuse(&mut desc, 1.0);
    sphere(&mut desc, Vec3::ZERO, 1.0, Some(white));
    let glass = bsdf(&mut desc, glass(1.5, None));
    sphere(&mut desc, Vec3::new(1.3, -0.5, 0.0), 0.5, Some(glass));
    perspective(&mut desc, Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 35.0);
    for name in ["bdpt", "vcm", "mlt"] {
        let s = RenderSettings { max_depth: Some(60), photon_radius: Some(0.01), ..method(name, 16) };
        let result = blocks(&desc, &s);
        assert_same(&format!("furnace {name}"), &result, &result.known([1.0; 3]), 2e-3, 0.15);
    }
}

/// Shading normals that are not the geometric ones, and normals that depend on the viewer.
#[test]
fn interpolated_normals_and_bumps() {
    let mut desc = scene();
    let white = room(&mut desc);
    let geometry = ball(&mut desc, 0.7, 8, 5);
    let two_sided = bsdf(&mut desc, BsdfDesc::TwoSided { front: white, back: white });
    shape(&mut desc, geometry, Mat4::from_translation(Vec3::new(0.0, 0.0, 0.9)), Some(two_sided));
    let light = rectangle(&mut desc, Vec3::new(0.3, 0.0, 2.9), [0.8, 0.5], true, Some(white));
    emit(&mut desc, light, Color::Constant([4.0, 3.0, 2.0]));
    let path = reference(&desc, &base(256));
    assert_same("bdpt normals", &blocks(&desc, &method("bdpt", 16)), &path, ROUNDING, 0.05);
    assert_same("light normals", &blocks(&desc, &method("light", 32)), &path, ROUNDING, 0.08);
}

/// A ball of haze, and glass with smoke inside, in a room with a lamp and a bulb.
#[test]
fn scattering_media() {
    let mut desc = glossy_room();
    let none = bsdf(&mut desc, BsdfDesc::Null);
    let haze = sphere(&mut desc, Vec3::new(0.2, -0.3, 1.6), 0.7, Some(none));
    let phase = PhaseDesc::HenyeyGreenstein { g: 0.4 };
    let medium = MediumDesc::Homogeneous { sigma_a: [0.1, 0.2, 0.3], sigma_s: [1.0, 0.8, 0.6], emission: [0.05; 3], phase };
    let id = add(&mut desc, medium);
    desc.shapes[haze.0 as usize].value.interior = Some(id);
    let frosted = bsdf(&mut desc, glass(1.3, Some(0.3)));
    let ball = sphere(&mut desc, Vec3::new(-0.6, -0.9, 1.4), 0.3, Some(frosted));
    let phase = PhaseDesc::Isotropic;
    let smoke = add(&mut desc, MediumDesc::Homogeneous { sigma_a: [0.5; 3], sigma_s: [3.0, 2.0, 1.0], emission: [0.0; 3], phase });
    desc.shapes[ball.0 as usize].value.interior = Some(smoke);
    add(&mut desc, LightDesc::Point { position: Vec3::new(0.9, -0.6, 2.4), intensity: [1.0; 3] });
    let path = reference(&desc, &base(384));
    assert_same("bdpt media", &blocks(&desc, &method("bdpt", 16)), &path, ROUNDING, 0.08);
    assert_same("mlt media", &blocks(&desc, &method("mlt", 32)), &path, ROUNDING, 0.3);
}

/// Scenes of POV-Ray: light of a lamp goes through what casts no shadow, and falls on it; the sky's light, which rays meet as well,
/// does not. Mirrors see what is there.
#[test]
fn what_casts_no_shadow() {
    let text = "#version 3.7; global_settings { assumed_gamma 1 } camera { location <0, 2.2, -5> look_at <0, 0.4, 0> angle 45 }
        light_source { <1, 3, -1> rgb 1.2 } background { rgb 0.25 }
        plane { y, 0 pigment { rgb <0.7, 0.5, 0.4> } finish { diffuse 0.8 ambient 0 } }
        box { <-0.9, 0.7, -0.7>, <0.7, 0.9, 0.8> pigment { rgb <0.3, 0.6, 0.5> } finish { diffuse 0.8 ambient 0 } no_shadow }
        sphere { <-0.9, 0.5, 0.9>, 0.5 pigment { rgb 0 } finish { diffuse 0 ambient 0 reflection 0.9 } }
        sphere { <1.2, 0.4, 0.2>, 0.4 pigment { rgb 0.6 } finish { diffuse 0.8 ambient 0 } }";
    let read = |text: &str| etendue_scene::formats::pov::read_bytes(std::path::Path::new("t.pov"), text.as_bytes(), &Default::default());
    let desc = read(text).unwrap();
    let path = reference(&desc, &method("path", 256));
    // The box shadows what is below it unless the file says otherwise.
    let shadowed = reference(&read(&text.replace("no_shadow", "")).unwrap(), &method("path", 64));
    let sum = |b: &Blocks| b.mean.iter().map(|m| m[1]).sum::<f64>();
    assert!(sum(&shadowed) < 0.95 * sum(&path), "{} with a shadow, {} without", sum(&shadowed), sum(&path));
    assert_same("bdpt no_shadow", &blocks(&desc, &method("bdpt", 16)), &path, ROUNDING, 0.1);
    assert_same("mlt no_shadow", &blocks(&desc, &method("mlt", 32)), &path, ROUNDING, 0.2);
    let vcm = RenderSettings { photon_radius: Some(0.01), ..method("vcm", 12) };
    assert_same("vcm no_shadow", &blocks(&desc, &vcm), &path, 5e-3, 0.15);
}
