//! POV-Ray scenes as physics: known answers of light transport over exact solids, and agreement with the classic model where both
//! must agree.

use std::path::Path;

use etendue_render::film::Film;
use etendue_render::session::job::{self, Plan};
use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::formats::{ReadOptions, pov};
use etendue_scene::{RenderSettings, SceneDesc};

const HEAD: &str = "#version 3.7; global_settings { assumed_gamma 1 }
    camera { orthographic location -5*z right 0.02*x up 0.02*y }";

fn read(text: &str) -> SceneDesc {
    pov::read_bytes(Path::new("test.pov"), format!("{HEAD}\n{text}").as_bytes(), &ReadOptions::default()).unwrap()
}

fn film(text: &str, integrator: &str, spp: u32, max_depth: Option<u32>, threads: usize) -> Film {
    let desc = read(text);
    let settings = RenderSettings {
        width: Some(16),
        height: Some(16),
        spp: Some(spp),
        integrator: Some(integrator.to_owned()),
        filter: Some("box".to_owned()),
        max_depth,
        ..RenderSettings::default()
    };
    let plan = Plan::new(&desc, &settings, None).unwrap();
    let mut session = job::prepare(&desc, &settings, &plan, &[]).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(32 << 20).build().unwrap();
    pool.install(|| session.render(&Stop { spp: Some(spp), ..Stop::default() }, &Cancel::default(), &Silent)).unwrap();
    session.into_film()
}

/// Mean color of the picture and the standard error of its luminance.
fn mean(film: &Film) -> ([f64; 3], f64) {
    let pixels = film.develop().rgb().unwrap();
    let n = pixels.len() as f64;
    let mean = [0, 1, 2].map(|c| pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / n);
    let gray = |p: &[f32; 3]| p.iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0;
    let m = mean.iter().sum::<f64>() / 3.0;
    let variance = pixels.iter().map(|p| (gray(p) - m).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

#[track_caller]
fn near(found: ([f64; 3], f64), expected: [f64; 3], relative: f64) {
    for (a, b) in found.0.iter().zip(expected) {
        assert!((a - b).abs() <= relative * b + 4.0 * found.1, "{found:?} instead of {expected:?}");
    }
}

#[test]
fn direct_light_is_as_bright_as_in_the_classic_model() {
    let surface = "plane { -z, 0 pigment { rgb <.8, .5, .2> } finish { ambient 0 diffuse .7 } }";
    let source = "light_source { <2, 1, -4> rgb <1, .9, .8>";
    for light in [
        format!("{source} parallel point_at 0 }}"),
        format!("{source} }}"),
        format!("{source} fade_distance 3 fade_power 2 }}"),
        format!("{source} spotlight point_at 0 radius 20 falloff 30 }}"),
        format!("{source} area_light x, y, 5, 5 jitter }}"),
        format!("{source} area_light .5*x, .5*y, 5, 5 jitter circular orient }}"),
    ] {
        let text = format!("{light}\n{surface}");
        let (classic, _) = mean(&film(&text, "whitted", 16, None, 1));
        near(mean(&film(&text, "path", 16, Some(1), 1)), classic, 0.03);
    }
}

#[test]
fn a_furnace_gives_the_walls_color_over_one_less_the_albedo() {
    // Inside a closed ball that glows, L = E + ρ L.
    let text = "sphere { 0, 6 pigment { rgb 1 } finish { ambient 0 diffuse .5 emission 1 } }";
    near(mean(&film(text, "path", 64, None, 1)), [2.0; 3], 0.002);
}

#[test]
fn convex_bodies_in_an_even_sky_return_their_albedo() {
    // The last one, half paint and half air: inside, L = (2 + ρ L) / 2; outside (2 ρ + L) / 2.
    for (finish, expected) in [
        ("pigment { rgb <.8, .4, .1> } finish { ambient 0 diffuse 1 }", [1.6, 0.8, 0.2]),
        ("pigment { rgb 0 } finish { ambient 0 diffuse 0 reflection .7 }", [1.4; 3]),
        ("pigment { rgbt 1 } finish { ambient 0 diffuse 0 } interior { ior 1.5 }", [2.0; 3]),
        ("pigment { rgbf <1, .5, 1, 1> } finish { ambient 0 diffuse 0 }", [2.0, 0.5, 2.0]),
        ("pigment { rgb <.5, 1, 0> transmit .5 } finish { ambient 0 diffuse 1 }", [7.0 / 6.0, 2.0, 0.5]),
    ] {
        let text = format!("background {{ rgb 2 }} sphere {{ 0, 1 {finish} }}");
        near(mean(&film(&text, "path", 64, None, 1)), expected, 0.012);
    }
}

#[test]
fn what_glows_shows_and_the_ambient_term_does_not() {
    let wall = |finish: &str| format!("plane {{ -z, 0 pigment {{ rgb <1, .5, 0> }} finish {{ {finish} }} }}");
    near(mean(&film(&wall("ambient 0 diffuse 0 emission 3"), "path", 4, None, 1)), [3.0, 1.5, 0.0], 1e-5);
    near(mean(&film(&wall("ambient 1 diffuse 0"), "path", 4, None, 1)), [1.0, 0.5, 0.0], 1e-5);
    near(mean(&film(&wall("ambient .4 diffuse .6"), "path", 4, None, 1)), [0.0; 3], 1e-9);
}

#[test]
fn interiors_absorb_by_length() {
    // Two units of glass without refraction that leaves 1/2, 1/4, 1/8 of what crosses one.
    let text = "background { rgb 1 } box { <-9, -9, 0>, <9, 9, 2> pigment { rgbt 1 }
        interior { fade_distance 1 fade_power 1000 fade_color <1 - ln(2), 1 - ln(4), 1 - ln(8)> } }";
    near(mean(&film(text, "path", 4, None, 1)), [0.25, 0.0625, 0.015_625], 1e-4);
}

#[test]
fn solids_keep_their_shape_and_shadows() {
    // The hole of a difference lets the light of a lamp behind through, and what is left of the box does not.
    let scene = |hole: &str| {
        format!(
            "light_source {{ 8*z rgb 1 }} plane {{ z, -6 pigment {{ rgb 0 }} }}
            plane {{ -z, 9 pigment {{ rgb 0 }} }}
            difference {{ box {{ <-3, -3, 3>, <3, 3, 4> }} {hole} pigment {{ rgb .5 }} }}
            sphere {{ <0, 0, -1>, .9 pigment {{ rgb 1 }} finish {{ ambient 0 diffuse 1 }} }}
            sphere {{ <0, 0, 2>, .5 pigment {{ rgb 1 }} finish {{ ambient 0 diffuse 1 }} }}"
        )
    };
    let light = |text: &str| mean(&film(text, "path", 16, None, 1)).0[0];
    assert!(light(&scene("sphere { 20*y, 1 }")) < 1e-6, "the box keeps all light back");
    let open = scene("cylinder { 0, 5*z, 2 }").replace("sphere { <0, 0, -1>", "sphere { <0, 5, -1>");
    assert!(light(&open) < 0.5, "the far sphere is lit from behind");
}

#[test]
fn the_picture_does_not_depend_on_threads() {
    let text =
        "light_source { <2, 3, -4> rgb 1 area_light x, y, 4, 4 } sky_sphere { pigment { gradient y color_map { [0 rgb .2] [1 rgb 1] } } }
        torus { .5, .2 pigment { bozo } normal { bumps .3 } finish { specular .4 reflection .1 } }
        sphere { <0, 0, -1>, .3 pigment { rgbf .9 } interior { ior 1.4 } }";
    assert_eq!(film(text, "path", 4, None, 1).develop().rgb(), film(text, "path", 4, None, 3).develop().rgb());
}

#[test]
fn methods_from_both_ends_refuse_curved_cameras_by_name() {
    let desc = pov::read_bytes(
        Path::new("test.pov"),
        b"camera { fisheye location -5*z look_at 0 } sphere { 0, 1 pigment { rgb 1 } } light_source { <3, 3, -5> rgb 1 }",
        &ReadOptions::default(),
    )
    .unwrap();
    let render = |integrator: &str| {
        let size = Some(8);
        let settings = RenderSettings {
            integrator: Some(integrator.to_owned()),
            width: size,
            height: size,
            spp: Some(1),
            ..RenderSettings::default()
        };
        let plan = Plan::new(&desc, &settings, None).unwrap();
        let mut session = job::prepare(&desc, &settings, &plan, &[]).map_err(|e| e.to_string())?;
        session.render(&Stop { spp: Some(1), ..Stop::default() }, &Cancel::default(), &Silent).map(|_| ()).map_err(|e| e.to_string())
    };
    render("path").unwrap();
    for name in ["light", "bdpt", "vcm", "mlt"] {
        let error = render(name).unwrap_err();
        assert!(error.contains("camera"), "{name}: {error}");
    }
}

#[test]
fn photons_bring_back_the_light_that_their_targets_take() {
    let wall = |photons: &str| format!("plane {{ -z, 0 pigment {{ rgb .5 }} finish {{ ambient 0 diffuse 1 }} photons {{ {photons} }} }}");
    let source = "light_source { <3, 0, -3> rgb 1 }";
    // A pane without refraction across the light, out of the camera's sight.
    let pane = |photons: &str| format!("box {{ <1.1, -.6, -1.9>, <1.9, .6, -1.1> pigment {{ rgbt 1 }} interior {{ ior 1 }} {photons} }}");
    let on = "global_settings { photons { spacing .02 } }";
    let color = |text: String| mean(&film(&text, "whitted", 1, None, 2)).0[0];
    let free = color(format!("{source} {} {}", wall(""), pane("")));
    assert!(free > 0.1);
    let brought = color(format!("{on} {source} {} {}", wall(""), pane("photons { target refraction on }")));
    assert!((brought / free - 1.0).abs() < 0.1 && brought != free, "{brought} instead of {free}");
    let refused = color(format!("{on} {source} {} {}", wall("collect off"), pane("photons { target refraction on }")));
    assert_eq!(refused, free, "what refuses photons is lit as without them");
}

#[test]
fn curved_cameras_see_the_same_in_both_models() {
    let text = |kind: &str| {
        format!(
            "camera {{ {kind} location -5*z look_at 0 }} light_source {{ <2, 1, -4> rgb 1 }}
             sphere {{ 0, 3 pigment {{ rgb .5 }} finish {{ ambient 0 diffuse .8 }} }}"
        )
    };
    for kind in ["fisheye angle 120", "ultra_wide_angle angle 100", "spherical angle 360 180", "cylinder 1 angle 90"] {
        let (classic, physical) = (film(&text(kind), "normals", 4, None, 2), film(&text("perspective"), "normals", 4, None, 2));
        assert_ne!(mean(&classic).0, mean(&physical).0, "{kind} is a camera of its own");
        assert!(mean(&film(&text(kind), "path", 4, Some(1), 2)).0[0] > 0.0, "{kind}");
    }
    assert!(job_fails(&text("fisheye angle 120"), "bdpt"));
}

/// Whether the scene cannot be rendered by a method.
fn job_fails(text: &str, integrator: &str) -> bool {
    let settings = RenderSettings { integrator: Some(integrator.to_owned()), ..RenderSettings::default() };
    let desc = read(text);
    let plan = Plan::new(&desc, &settings, None).unwrap();
    job::prepare(&desc, &settings, &plan, &[]).is_err()
}
