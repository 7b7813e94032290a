//! Small `.pov` texts against the colors that POV-Ray 3.7.0.10 gives them.
//!
//! Expected numbers were read from pictures of POV-Ray written with 16 bits and `File_Gamma=1.0`, most of one pixel; the camera of those
//! looks along +z at the origin. Numbers above 1 cannot be told from 1.

use std::path::Path;

use etendue_render::session::job::{self, Plan};
use etendue_render::session::{Cancel, Silent, Stop};
use etendue_scene::RenderSettings;
use etendue_scene::formats::{ReadOptions, pov};

const HEAD: &str = "#version 3.7; global_settings { assumed_gamma 1 }\n";
const CAMERA: &str = "camera { orthographic location -z*5 right 0.001*x up 0.001*y }\n";
const WALL: &str = "box { <-9,-9,0>, <9,9,1> pigment { rgb 1 } finish { ambient 0 diffuse 1 } }\n";

/// The picture of a text, row by row.
fn picture(text: &str, size: [u32; 2]) -> Vec<[f32; 3]> {
    let desc = pov::read_bytes(Path::new("test.pov"), text.as_bytes(), &ReadOptions::default()).unwrap();
    // A threshold that no difference reaches: one sample in the middle of each pixel.
    let settings = RenderSettings { width: Some(size[0]), height: Some(size[1]), antialias: Some(3.0), ..RenderSettings::default() };
    let plan = Plan::new(&desc, &settings, None).unwrap();
    let mut session = job::prepare(&desc, &settings, &plan, &[]).unwrap();
    session.render(&Stop { spp: Some(plan.spp), ..Stop::default() }, &Cancel::default(), &Silent).unwrap();
    session.into_film().develop().rgb().unwrap()
}

/// The pixel of a scene under the usual head and camera.
fn pixel(scene: &str) -> [f32; 3] {
    picture(&format!("{HEAD}{CAMERA}{scene}"), [1, 1])[0]
}

#[track_caller]
fn is(scene: &str, expected: [f64; 3]) {
    same(pixel(scene), expected, scene);
}

#[track_caller]
fn same(got: [f32; 3], expected: [f64; 3], what: &str) {
    for (a, b) in got.iter().zip(expected) {
        assert!((f64::from(*a).clamp(0.0, 1.0) - b).abs() < 3e-4, "{what}: {got:?} is not {expected:?}");
    }
}

fn sun(degrees: f64, color: &str) -> String {
    let a = degrees.to_radians();
    format!("light_source {{ <{}, 0, {}>*1e5, rgb {color} }}\n", a.sin(), -a.cos())
}

#[test]
fn colors_follow_the_gamma_of_the_scene() {
    let scene = format!("{CAMERA}box {{ <-9,-9,0>, <9,9,1> pigment {{ rgb 0.5 }} finish {{ ambient 1 diffuse 0 }} }}");
    // 8-bit sRGB codes that POV-Ray writes, as linear light.
    for (head, code) in [
        ("", 127.502),
        ("#version 3.7;\n", 187.518),
        ("#version 3.6;\n", 127.502),
        ("global_settings { assumed_gamma 2.2 }\n", 128.486),
        ("#version 3.7; global_settings { assumed_gamma srgb }\n", 127.502),
        ("#version 3.6; global_settings { assumed_gamma 1 }\n", 187.518),
    ] {
        let [v, ..] = picture(&format!("{head}{scene}"), [1, 1])[0];
        let srgb = 1.055 * f64::from(v).powf(1.0 / 2.4) - 0.055;
        assert!((srgb * 255.0 - code).abs() < 0.1, "{head}: {}", srgb * 255.0);
    }
}

#[test]
fn interiors_fade_what_is_seen_through_them() {
    let ball = |items: &str| {
        format!("background {{ rgb 1 }} sphere {{ 0, 1 pigment {{ rgbt 1 }} finish {{ ambient 0 diffuse 0 }} interior {{ {items} }} }}")
    };
    is(&ball("fade_distance 1 fade_power 2"), [0.2; 3]);
    is(&ball("fade_distance 1 fade_power 1 fade_color <1,.5,0>"), [1.0, 0.66667, 0.33333]);
    is(&ball("fade_distance 2 fade_power 1000 fade_color <.9,.5,.1>"), [0.90484, 0.60653, 0.40658]);
    is(&ball("fade_distance 2 fade_power 999"), [0.5; 3]);
}

const CLEAR: &str = "pigment { rgbt 1 } finish { ambient 0 diffuse 0 }";

/// A sphere of that center, radius and fade distance, with fade power 1.
fn fading(center: &str, radius: f64, distance: f64, items: &str) -> String {
    format!("sphere {{ {center}, {radius} {CLEAR} interior {{ fade_distance {distance} fade_power 1 }} {items} }}\n")
}

#[test]
fn only_ways_that_end_at_the_same_interior_fade() {
    let glow = "box { <-9,-9,2>, <9,9,3> pigment { rgb 1 } finish { ambient .5 diffuse 0 } }\n";
    let seen = |what: &str, value: f64| is(&format!("{glow}{what}"), [value; 3]);
    let [a, b] = [fading("0", 1.0, 0.5, ""), fading("z*.5", 1.0, 0.25, "")];
    let interior = "interior { fade_distance .5 fade_power 1 }";
    seen(&a, 0.1);
    // Open halves, a disc and a plane are never left.
    seen(&fading("0", 1.0, 0.5, "clipped_by { plane { z, 0 } }"), 0.5);
    seen(&fading("0", 1.0, 0.5, "clipped_by { plane { -z, 0 } }"), 0.5);
    seen(&format!("disc {{ 0, -z, 1 {CLEAR} {interior} }}"), 0.5);
    seen(&format!("disc {{ 0, z, 1 {CLEAR} {interior} }}"), 0.5);
    seen(&format!("disc {{ -z*6, -z, 9 {CLEAR} {interior} }}"), 0.5);
    seen(&format!("plane {{ -z, 0 {CLEAR} {interior} }}"), 0.5);
    seen(&format!("sphere {{ 0, 1 inverse {CLEAR} {interior} }}"), 0.1);
    // Each surface begins a new way: what lies in another interior fades by the one that it is in last.
    seen(&format!("merge {{ {a}{b} }}"), 0.5);
    seen(&format!("union {{ {a}{b} }}"), 0.04167);
    seen(&format!("merge {{ sphere {{ 0, 1 }} sphere {{ z*.5, 1 }} {CLEAR} {interior} }}"), 0.08333);
    seen(&format!("{a}{}", fading("0", 0.5, 0.25, "")), 0.05);
    // The camera is inside.
    seen(&fading("-z*5", 4.0, 0.5, ""), 0.05556);
}

#[test]
fn shadows_fade_as_what_is_seen_does() {
    let lit = |what: &str, value: f64| is(&format!("{}{WALL}{what}", sun(0.0, "1")), [value; 3]);
    let ball = |items: &str| fading("-z*2", 1.0, 0.5, &format!("no_image {items}"));
    lit(&ball(""), 0.2);
    lit(&ball("clipped_by { plane { z, -2 } }"), 1.0);
    lit(&ball("clipped_by { plane { -z, 2 } }"), 1.0);
    lit(&format!("union {{ {}{} no_image }}", fading("-z*2", 1.0, 0.5, ""), fading("-z*1.5", 1.0, 0.25, "")), 0.07143);
    lit(&format!("{}{}", ball(""), fading("-z*2", 0.5, 0.25, "no_image")), 0.1);
    // A shadow ray begins inside of what the viewing ray was in.
    lit(&fading("0", 1.0, 0.5, ""), 0.33333);
    lit(&fading("0", 1.0, 0.5, "no_image"), 1.0);
    lit(&fading("0", 1.0, 0.5, "no_shadow"), 1.0);
}

#[test]
fn parts_without_interior_are_one() {
    let stripes = "box { <-9,-9,2>, <9,9,3> pigment { gradient x color_map { [0 rgb 0] [1 rgb 1] } scale 4 translate -2*x }
        finish { ambient 1 diffuse 0 } }\n";
    let seen = |what: &str, value: f64| is(&format!("{stripes}{what}"), [value; 3]);
    let glass = format!("sphere {{ .15*x, 1 {CLEAR} interior {{ ior 1.5 }} }}\n");
    let hole = |items: &str| format!("sphere {{ .1*x, .5 {CLEAR} {items} }} sphere {{ <.1,0,-.4>, .4 {CLEAR} {items} }}\n");
    let air = "interior { ior 1 }";
    seen(&glass, 0.55038);
    seen(&format!("{glass}sphere {{ .1*x, .5 {CLEAR} }}"), 0.49993);
    // Two bubbles that overlap: two things when they stand alone, or bear interiors; one in a union.
    seen(&format!("{glass}{}", hole("")), 0.4605);
    seen(&format!("{glass}{}", hole(air)), 0.4605);
    seen(&format!("{glass}union {{ {} }}", hole("")), 0.0);
    seen(&format!("{glass}union {{ {} {air} }}", hole("")), 0.0);
    // Holes are turned inside out and are no bubbles.
    seen(&format!("difference {{ {glass}{} }}", hole("")), 0.4605);
    seen(&format!("difference {{ {glass}union {{ {} }} }}", hole("")), 0.4605);
}

#[test]
fn shadows_of_transparent_things() {
    let through = |what: &str| format!("{}{WALL}sphere {{ -z*2, 1 no_image finish {{ ambient 0 diffuse 0 }} {what} }}", sun(0.0, "1"));
    is(&through("pigment { rgbf <.9,.5,.2,.8> }"), [0.51839, 0.16001, 0.0256]);
    is(&through("pigment { rgbf <.9,.5,.2,.8> } interior { ior 1.5 }"), [0.51839, 0.16001, 0.0256]);
    is(&through("pigment { rgbt 1 } interior { fade_distance 1 fade_power 1 fade_color <1,.5,0> }"), [1.0, 0.66667, 0.33333]);
    for (x, power, value) in [(0.0, 1.0, 4.0), (0.2, 0.5, 2.6627), (0.2, 1.0, 1.95758), (0.4, 0.5, 1.30114), (0.2, 2.0, 1.34401)] {
        let scene = format!(
            "{}{WALL}sphere {{ <{x},0,-2>, 1 no_image pigment {{ rgbt 1 }} finish {{ ambient 0 diffuse 0 }} interior {{ ior 1.5 caustics {power} }} }}",
            sun(0.0, "0.1")
        );
        is(&scene, [value * 0.1; 3]);
    }
}

#[test]
fn total_reflection_is_whole() {
    let prism = |items: &str| {
        format!(
            "background {{ rgb 1 }} intersection {{ box {{ -1, 1 }} plane {{ z, 0 rotate -x*45 }} pigment {{ rgbf <.5,.5,.5,1> }} {items} }}"
        )
    };
    is(&prism("finish { ambient 0 diffuse 0 } interior { ior 1.5 }"), [0.25; 3]);
    is(&prism("finish { ambient 0 diffuse 0 } interior { ior 1 }"), [0.25; 3]);
    is(&prism("finish { ambient 0 diffuse 0 reflection { 0, 1 fresnel } conserve_energy } interior { ior 1.5 }"), [0.27041; 3]);
}

#[test]
fn levels_count_bends_and_mirrors() {
    let seen = |levels: u32, balls: u32, interior: &str| {
        let mut scene = format!(
            "#version 3.7; global_settings {{ assumed_gamma 1 max_trace_level {levels} }}\n{CAMERA}background {{ rgb <.5,.8,.4> }}\n"
        );
        for i in 0..balls {
            scene += &format!("sphere {{ z*{i}, 0.4 pigment {{ rgbt <0,0,0,1> }} finish {{ ambient 0 diffuse 0 }} {interior} }}\n");
        }
        picture(&scene, [1, 1])[0][1]
    };
    // Straight rays take no level but want one to be left; bent ones take one each.
    assert_eq!([seen(1, 1, ""), seen(2, 1, ""), seen(2, 5, "")].map(|v| v > 0.5), [false, true, true]);
    let bent = "interior { ior 1.001 }";
    assert_eq!([seen(2, 1, bent), seen(3, 1, bent), seen(4, 2, bent), seen(5, 2, bent)].map(|v| v > 0.5), [false, true, false, true]);
}

#[test]
fn sky_pigments_in_layers() {
    let sky = |version: &str, pigments: &str| {
        picture(&format!("#version {version}; global_settings {{ assumed_gamma 1 }}\n{CAMERA}sky_sphere {{ {pigments} }}"), [1, 1])[0]
    };
    let two = |top: &str| format!("pigment {{ rgb <.9,.5,.2> }} pigment {{ {top} }}");
    same(sky("3.7", &two("rgbf <.2,.4,.6,.5>")), [0.19001, 0.30001, 0.36001], "filter, 3.7");
    same(sky("3.5", &two("rgbf <.2,.4,.6,.5>")), [0.55, 0.45, 0.4], "filter, 3.5");
    same(sky("3.7", &two("rgbft <.2,.4,.6,.5,.25>")), [0.365, 0.325, 0.26], "both, 3.7");
    same(sky("3.5", &two("rgbft <.2,.4,.6,.5,.25>")), [0.725, 0.475, 0.30001], "both, 3.5");
    same(sky("3.7", "pigment { rgb <.9,.5,.2> } emission .5"), [0.45, 0.25, 0.10001], "emission");
}

#[test]
fn media_give_take_and_scatter() {
    let inside = |media: &str, more: &str| {
        format!(
            "box {{ <-9,-9,0>, <9,9,2> hollow {more} pigment {{ rgbt 1 }} finish {{ ambient 0 diffuse 0 }} interior {{ media {{ {media} }} }} }}"
        )
    };
    is(&inside("emission <.1,.2,.05>", ""), [0.2, 0.4, 0.10001]);
    is(&format!("background {{ rgb 1 }}{}", inside("absorption <.1,.2,.5>", "")), [0.81873, 0.67032, 0.36788]);
    // The mean over a piece is taken before its own extinction: more samples come nearer to 0.12642.
    for (items, value) in [("", 0.13725), ("samples 1", 0.16065), ("samples 5", 0.14867), ("samples 20", 0.13227)] {
        is(&inside(&format!("emission .1 absorption .5 {items}"), ""), [value; 3]);
    }
    is(&format!("{}{}", sun(90.0, "1"), inside("scattering { 1, .5 } samples 30", "no_shadow")), [0.65208; 3]);
    is(&format!("{}{}", sun(0.0, "1"), inside("scattering { 1, .1 } samples 30", "no_shadow")), [0.18241; 3]);
    is(&format!("background {{ rgb 1 }}{}", inside("scattering { 1, .5 extinction .5 }", "")), [0.60653; 3]);
    is(&inside("emission .5 density { rgb .5 } density { rgb <1,.5,.2> }", ""), [0.5, 0.25, 0.1]);
    // A density that differs from place to place is sampled at fixed places, of which a third lie beyond the step.
    let step = "density { gradient z color_map { [0.4 rgb 0][0.4 rgb 1] } scale 2 }";
    is(&inside(&format!("emission .45 samples 1 aa_threshold 100 {step}"), ""), [0.3; 3]);
    is(
        &format!("media {{ absorption .1 }}{}", "box { <-9,-9,0>, <9,9,1> pigment { rgb 1 } finish { ambient 1 diffuse 0 } }"),
        [0.60653; 3],
    );
}

#[test]
fn lights_in_media() {
    let lamp = |items: &str| format!("light_source {{ -z*10, rgb 1 {items} }} media {{ absorption .1 }}{WALL}");
    is(&lamp(""), [0.60653; 3]);
    is(&lamp("media_attenuation on"), [0.22313; 3]);
}

#[test]
fn cameras_send_the_same_rays() {
    let sky = "sky_sphere { pigment { average pigment_map {
        [1 function { (x + 1) / 2 } color_map { [0 rgb 0][1 rgb x*3] }]
        [1 function { (y + 1) / 2 } color_map { [0 rgb 0][1 rgb y*3] }]
        [1 function { (z + 1) / 2 } color_map { [0 rgb 0][1 rgb z*3] }] } } }\n";
    // Directions through pixel (2, 2) and (6, 3) of 8 × 6.
    for (kind, a, b) in [
        ("perspective", [-0.1713, -0.0823, 0.9818], [0.7563, -0.3030, 0.5798]),
        ("ultra_wide_angle", [-0.0837, -0.1160, 0.9897], [0.6963, -0.3056, 0.6495]),
        ("panoramic", [-0.5301, 0.1005, 0.8419], [0.9517, -0.2983, 0.0726]),
        ("cylinder 1", [-0.0809, -0.1009, 0.9916], [0.6923, -0.3205, 0.6466]),
        ("cylinder 2", [-0.1145, -0.0865, 0.9897], [0.7049, -0.3172, 0.6344]),
        ("cylinder 3", [-0.0886, -0.2232, 0.9707], [0.7048, -0.2015, 0.6802]),
        ("cylinder 4", [0.2415, -0.0924, 0.9660], [0.2249, -0.3741, 0.8997]),
        ("spherical", [-0.0843, -0.1520, 0.9848], [0.6988, -0.2716, 0.6618]),
        ("omnimax", [-0.2839, 0.2620, 0.9224], [0.9173, -0.0329, 0.3967]),
    ] {
        let camera = format!("camera {{ {kind} location <1,2,3> right 2*x up 1.5*y direction 1.2*z angle 100 look_at <2,1,7> }}");
        let sent = picture(&format!("{HEAD}{sky}{camera}"), [8, 6]);
        for (pixel, d) in [([2usize, 2usize], a), ([6, 3], b)] {
            let got = sent[pixel[1] * 8 + pixel[0]].map(|v| f64::from(v) * 2.0 - 1.0);
            let error = got.iter().zip(d).map(|(g, d)| (g - d).abs()).fold(0.0, f64::max);
            // Known: omnimax rays are up to two degrees off.
            let tolerance = if kind == "omnimax" { 4e-2 } else { 3e-3 };
            assert!(error < tolerance, "{kind} {pixel:?}: {got:?} is not {d:?}");
        }
    }
}

#[test]
fn light_groups_keep_to_themselves() {
    let group = |items: &str| {
        format!(
            "{}light_group {{ light_source {{ -z*1e5, rgb <1,0,0> }} box {{ <-9,-9,0>, <9,9,1> pigment {{ rgb 1 }} finish {{ ambient 0 diffuse .5 }} }} {items} }}",
            sun(60.0, "<0,1,0>")
        )
    };
    is(&group("global_lights off"), [0.5, 0.0, 0.0]);
    is(&group("global_lights on"), [0.5, 0.25, 0.0]);
    is(&format!("light_group {{ light_source {{ -z*1e5, rgb 1 }} }}{WALL}"), [0.0; 3]);
}

/// A far light above a plate that is a target, and things below it.
fn below_a_target(photons: &str, light: &str, plate: &str, things: &str) -> String {
    format!(
        "global_settings {{ photons {{ {photons} }} }}
        light_source {{ <0, 1000, 0>, rgb 1 {light} }}
        box {{ <-2, 3, -2>, <2, 3.1, 2> pigment {{ rgbf 1 }} finish {{ ambient 0 diffuse 0 }} interior {{ ior 1 }} photons {{ {plate} collect off }} }}
        {things}"
    )
}

/// Looks at one place from near by, with an orthographic camera that is `from` there.
#[track_caller]
fn at(place: [f64; 3], from: &str, scene: &str, expected: f64, tolerance: f64) {
    let [x, y, z] = place;
    let up = if from.contains('y') { "z" } else { "y" };
    let camera = format!("camera {{ orthographic location <{x}, {y}, {z}> + {from} direction -({from}) right .02*x up .02*{up} }}");
    let got = f64::from(picture(&format!("{HEAD}{camera}{scene}"), [1, 1])[0][0]);
    assert!((got - expected).abs() <= tolerance * expected + 1e-6, "{got} is not {expected}, at {place:?} of\n{scene}");
}

const REFRACTING: &str = "target refraction on";

/// A box with an interior around the origin, before a black wall.
fn clear_box(half: f64, interior: &str) -> String {
    format!("box {{ -{half}, {half} hollow {CLEAR} interior {{ {interior} }} }}\n")
}

#[test]
fn fresnels_mirrors_know_what_a_ray_is_in() {
    // A slab whose far side mirrors, and around it something else.
    let sky = "sky_sphere { pigment { rgb .9 } }\n";
    let slab = format!(
        "{sky} intersection {{ plane {{ -z, 0 {CLEAR} }} plane {{ z, 1 pigment {{ rgb 0 }} finish {{ ambient 0 diffuse 0 reflection {{ 0, 1 fresnel }} }} }}
            hollow interior {{ ior 1.5 }} }}\n"
    );
    let around = |interior: &str| format!("sphere {{ 0, 500 hollow {CLEAR} {interior} }}\n");
    let towards = |d: f64, scene: &str, value: f64| {
        let camera = format!("camera {{ orthographic location <0, 0, -1> direction <{d}, 0, 1> right .001*z up .001*y }}");
        let got = picture(&format!("{HEAD}{camera}{scene}"), [1, 1])[0];
        same(got, [value; 3], scene);
    };
    for (d, value) in [(0.3, 0.03612), (1.0, 0.04521), (3.0, 0.1733), (9.0, 0.48637)] {
        towards(d, &slab, value);
        for interior in ["", "interior { ior 1 }", "interior { ior 1.2 }"] {
            towards(d, &format!("{slab}{}", around(interior)), 0.0);
        }
    }
    // The camera is in both: what was last found around it is beyond.
    let ground = format!(
        "{sky} plane {{ z, 1 hollow pigment {{ rgb 0 }} finish {{ ambient 0 diffuse 0 reflection {{ 0, 1 fresnel }} }} interior {{ ior 1.5 }} }}\n"
    );
    let [inner, outer] = [around("interior { ior 1.4 }"), around("interior { ior 1.2 }")];
    towards(0.3, &format!("{ground}{outer}"), 0.01126);
    towards(0.7, &format!("{ground}{outer}"), 0.01665);
    towards(2.0, &format!("{ground}{outer}{inner}"), 0.04457);
}

#[test]
fn tiles_begin_with_the_second() {
    let glow = |gray: f64| format!("texture {{ pigment {{ rgb {gray} }} finish {{ ambient 1 diffuse 0 }} }}");
    let tiles = format!("texture {{ tiles {{ {} tile2 {} }} }}", glow(0.2), glow(0.8));
    for ([x, y], value) in [([0.5, 0.5], 0.8), ([1.5, 0.5], 0.2), ([0.5, -0.5], 0.2), ([1.5, 1.5], 0.8)] {
        is(&format!("plane {{ -z, -.5 {tiles} translate <{}, {}, 0> }}", -x, -y), [value; 3]);
    }
}

#[test]
fn media_that_share_a_space_scatter_alike() {
    // The angle of the light to the camera's axis is 30 degrees.
    let light = "light_source { <500, 0, 866.0254> rgb 1 parallel point_at 0 }";
    let medium = |kind: u32, color: f64| format!("media {{ scattering {{ {kind}, {color} extinction 0 }} }}");
    let seen = |things: String, value: f64| is(&format!("{light}{things}"), [value; 3]);
    let [mie, rayleigh] = [medium(2, 0.02), medium(4, 0.02)];
    seen(clear_box(1.0, &mie), 0.14228);
    seen(clear_box(1.0, &rayleigh), 0.05595);
    seen(clear_box(1.0, &format!("{mie}{rayleigh}")), 0.19823);
    seen(clear_box(1.0, &format!("{}{}", medium(4, 0.03), medium(2, 0.01))), 0.19823);
    // Media count that scatter nothing: by no color, or not at all.
    seen(clear_box(1.0, &format!("{mie}{}", medium(4, 0.0))), 0.09912);
    seen(clear_box(1.0, &format!("media {{ absorption 0 }} {mie}")), 0.09114);
    seen(clear_box(1.0, &mie) + &clear_box(1.5, &rayleigh), 0.22621);
}

#[test]
fn media_are_halved_where_their_light_differs() {
    // The light ends at z = .4, between two samples: 2/3 of the piece is lit, or 5/6 where it is halved.
    let seen = |light: &str, medium: &str, threshold: f64, value: f64| {
        let medium = format!("media {{ {medium} method 3 samples 4 intervals 1 aa_level 2 aa_threshold {threshold} }}");
        let scene = format!(
            "light_source {{ <0, 1000, 0> rgb {light} parallel point_at 0 }} box {{ <-2, 3, .4>, <2, 3.1, 9> pigment {{ rgb 0 }} }} {}",
            clear_box(1.0, &medium)
        );
        assert!((f64::from(pixel(&scene)[0]) - value).abs() < 2e-5, "{scene}: {:?}", pixel(&scene));
    };
    let whole = |l: f64| 0.04 * l * (2.0 + 2.0 / 3.0) / 3.0;
    let halved = |l: f64| 0.04 * l * (2.0 + 5.0 / 6.0) / 3.0;
    let scatters = "scattering { 1, .02 extinction 0 }";
    // Differences are sums of the colors' over the whole interval: .02 · 2 · 3.
    for (light, l, limit) in [("1", 1.0, 0.12), (".5", 0.5, 0.06), ("<1, 0, 0>", 1.0, 0.04), ("<1, 1, 0>", 1.0, 0.08)] {
        seen(light, scatters, limit * 0.99, halved(l));
        seen(light, scatters, limit * 1.01, whole(l));
    }
}

#[test]
fn shadow_rays_sample_media_part_by_part() {
    // A floor below a medium that begins at a height h: what is taken is the sum of the weights of the samples above.
    let lit = |h: f64, rule: &str, more: &str| {
        let medium = format!("media {{ absorption 1 {rule} density {{ function {{ select(y - {h}, 0, 1) }} }} }}");
        let scene = format!(
            "{HEAD} camera {{ orthographic location <.5, -.2, 0> direction -y right .01*x up .01*z }}
            light_source {{ <.5, 1000, 0> rgb 1 parallel point_at <.5, 0, 0> }} plane {{ y, -.5 pigment {{ rgb 1 }} finish {{ ambient 0 diffuse 1 }} }}
            box {{ <-.5, 0, -1>, <1.5, 1, 1> hollow {CLEAR} interior {{ {medium} }} }} {more}"
        );
        -f64::from(picture(&scene, [1, 1])[0][0]).ln()
    };
    let takes = |h: f64, rule: &str, more: &str, taken: f64| {
        let got = lit(h, rule, more);
        assert!((got - taken).abs() < 1e-5, "{got} is not {taken}: {rule} from {h}");
    };
    let ninth = 1.0 / 9.0;
    for (h, parts) in [(0.1, 8.0), (0.2, 7.0), (0.3, 5.0), (0.4, 4.0), (0.55, 2.0), (0.7, 1.0), (0.8, 0.0)] {
        takes(h, "method 3 samples 4 intervals 1 aa_level 6 aa_threshold .001", "", parts * ninth);
    }
    for (h, parts) in [(0.1, 4.0), (0.2, 3.0), (0.5, 2.0), (0.7, 1.0), (0.9, 0.0)] {
        takes(h, "method 2 samples 4 intervals 1", "", parts * 0.25);
    }
    // What lies inside divides the way; in what is solid there are no media.
    let inner = |hollow: &str| format!("box {{ <-.4, .5, -.9>, <1.4, .9, .9> {hollow} {CLEAR} }}");
    let rule = "method 3 samples 4 intervals 1";
    takes(0.4, rule, &inner("hollow"), 0.4 + 0.1);
    takes(0.4, rule, &inner(""), 0.1);
    takes(0.72, rule, &inner("hollow"), 0.4 * 2.0 * ninth + 0.1);
}

#[test]
fn photons_go_where_lamps_and_objects_say() {
    let floor = |items: &str| format!("plane {{ y, -5 pigment {{ rgb 1 }} finish {{ ambient 0 diffuse 1 }} {items} }}\n");
    let seen = |light: &str, plate: &str, things: &str, value: f64, tolerance: f64| {
        at([0.7, -5.0, -0.4], "y*.5", &below_a_target("spacing .1", light, plate, things), value, tolerance);
    };
    let on = "photons { refraction on }";
    // Photons bring about as much as the light would: their estimates are noisy.
    let noise = 0.06;
    seen("", REFRACTING, &floor(""), 1.0, noise);
    seen("", REFRACTING, &floor("photons { collect off }"), 1.0, 0.0);
    let tinted = "pigment { rgbt <0, 0, 0, .5> }";
    let window = |items: &str| format!("box {{ <-2, 5, -2>, <2, 6, 2> finish {{ ambient 0 diffuse 0 }} {items} }}");
    let clear = |items: &str| window(&format!("pigment {{ rgbt 1 }} {items}"));
    // No photon arrives anywhere: light as without any. Where one does, what stands before the target hides it.
    seen("", REFRACTING, &(floor("") + &clear("")), 1.0, 0.0);
    let other = "box { <5, 3, -2>, <8, 3.1, 2> pigment { rgbf 1 } finish { ambient 0 diffuse 0 } interior { ior 1 } photons { target refraction on } }";
    seen("", REFRACTING, &(floor("") + &clear("") + other), 0.0, 0.0);
    seen("", REFRACTING, &(floor("") + &clear("photons { pass_through }")), 1.0, noise);
    seen("", REFRACTING, &(floor("") + &window(&format!("{tinted} photons {{ pass_through }}"))), 0.25, noise);
    // Behind the target what it says, else what the lamp says.
    let below = |items: &str| floor("") + &format!("box {{ <-3, -3, -3>, <3, 0, 3> {CLEAR} {items} }}");
    for (light, object, value) in [
        ("", "", 0.0),
        ("", "photons { refraction on }", 1.0),
        ("", "photons { pass_through }", 0.0),
        (on, "", 1.0),
        (on, "photons { refraction off }", 0.0),
        (on, "photons { pass_through }", 1.0),
    ] {
        seen(light, REFRACTING, &below(object), value, noise);
    }
    for plate in ["target", "target pass_through"] {
        seen("", plate, &floor(""), 1.0, 0.0);
    }
    seen(on, "target pass_through", &(floor("") + other), 1.0, 0.0);
    // Media weaken photons: e^(−.3 · 3).
    let dark = "hollow interior { media { absorption .3 } }";
    seen(on, REFRACTING, &below(dark), 0.4066, noise);
}

#[test]
fn photons_light_media() {
    let glow = "scattering { 1, .02 extinction 0 }";
    let seen = |place: [f64; 3], photons: &str, media: &str, value: f64, tolerance: f64| {
        let things = format!("box {{ <-3, -4, -1>, <3, 2.5, 1> hollow {CLEAR} interior {{ media {{ {media} }} }} }}");
        at(place, "-z*5", &below_a_target(photons, "photons { refraction on }", REFRACTING, &things), value, tolerance);
    };
    let photons = "spacing .05 media 1000";
    seen([0.0; 3], photons, glow, 0.03822, 0.05);
    // The edge of the beam is as soft as the sphere of a hundred photons is wide.
    for (x, value) in [(1.8, 0.0379), (1.95, 0.02989), (2.0, 0.02109), (2.05, 0.05353), (2.1, 0.04881), (2.3, 0.0419), (2.6, 0.04039)] {
        seen([x, 0.0, 0.0], photons, glow, value, 0.05);
    }
    for (y, value) in [(2.0, 0.45669), (0.0, 0.45307), (-3.5, 0.46072)] {
        seen([0.0, y, 0.0], photons, "scattering { 1, .3 }", value, 0.05);
    }
    seen([0.0; 3], "spacing .05", glow, 0.0, 0.0);
    seen([0.0; 3], photons, &format!("{glow} collect off"), 0.03999, 1e-3);
    // A near light's photons spread, so that media get brighter the farther they are from it (as they do in POV-Ray).
    for (y, value) in [(2.0, 0.04228), (0.0, 0.05594), (-3.5, 0.0788)] {
        let things = format!("box {{ <-3, -4, -1>, <3, 2.5, 1> hollow {CLEAR} interior {{ media {{ {glow} }} }} }}");
        let scene = below_a_target(photons, "photons { refraction on }", REFRACTING, &things).replace("1000, 0>", "8, 0>");
        at([0.5, y, 0.0], "-z*5", &scene, value, 0.05);
    }
    // Air neither keeps nor weakens photons: the shadow of the target is dark.
    let air = format!("media {{ {glow} }} box {{ <-90, -90, 1>, <90, 90, 2> pigment {{ rgb 0 }} }}");
    at([0.0, 2.0, 0.0], "-z*5", &below_a_target(photons, "", REFRACTING, &air), 0.06833, 0.01);
}

#[test]
fn photons_shine_as_lamps_do() {
    let seen = |light: &str, finish: &str, normal: &str, value: f64, tolerance: f64| {
        let scene = format!(
            "global_settings {{ photons {{ spacing .05 }} }} light_source {{ {light}, rgb 1 }}
            box {{ <-4, 0, -4>, <4, .1, 4> pigment {{ rgbf 1 }} finish {{ ambient 0 diffuse 0 }} interior {{ ior 1 }}
                photons {{ target refraction on collect off }} }}
            plane {{ y, -1 pigment {{ rgb .5 }} finish {{ ambient 0 {finish} }} {normal} }}"
        );
        at([0.3, -1.0, 0.2], "y*.5", &scene, value, tolerance);
    };
    let low = "<-1600, 500, 0>";
    for (finish, value) in [
        ("diffuse 1", 0.1501),
        ("diffuse 1 brilliance .5", 0.2776),
        ("diffuse 1 brilliance 2", 0.0439),
        ("diffuse 0 specular .5 roughness .5", 0.3317),
        ("diffuse 0 specular .5 roughness .5 metallic", 0.1892),
        ("diffuse 1 irid { .5 thickness .3 }", 0.0793),
    ] {
        seen(low, finish, "", value, 0.08);
    }
    for (slope, value) in [(0.3, 0.44), (0.7, 0.395), (1.5, 0.325), (3.0, 0.247), (8.0, 0.132)] {
        seen("<-10, 10000, 0>", "diffuse 1", &format!("normal {{ function {{ z }} {slope} }}"), value, 0.04);
    }
}
