//! The reader of Mitsuba files: what it makes of good files, and what it says of bad ones, with the place.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use std::path::Path;
use std::time::Instant;

use etendue_scene::desc::*;
use etendue_scene::formats::mitsuba::tree::{Kind, Plugin, Property, Tree, Value};
use etendue_scene::formats::mitsuba::{from_tree, read_bytes};
use etendue_scene::formats::{ReadOptions, read};
use etendue_scene::{ReadError, SceneDesc, Severity, Span};
use glam::{DMat4, DVec3, Mat4, Vec3};
use support::TempFolder;

fn parse(body: &str) -> Result<SceneDesc, ReadError> {
    parse_version("3.0.0", body)
}

fn parse_version(version: &str, body: &str) -> Result<SceneDesc, ReadError> {
    let text = format!("<scene version=\"{version}\">\n{body}\n</scene>");
    read_bytes(Path::new("test.xml"), text.as_bytes(), &ReadOptions::default())
}

fn good(body: &str) -> SceneDesc {
    parse(body).unwrap_or_else(|e| panic!("{e}"))
}

/// The messages with their places, as `line:column message`.
fn faults(result: Result<SceneDesc, ReadError>) -> Vec<String> {
    match result {
        Err(ReadError::Invalid { faults, .. }) => faults
            .iter()
            .filter(|f| f.severity == Severity::Error)
            .map(|f| format!("{}:{} {}", f.span.line, f.span.column, f.message))
            .collect(),
        Err(e) => panic!("{e}"),
        Ok(_) => Vec::new(),
    }
}

fn bsdf(body: &str) -> BsdfDesc {
    let desc = good(body);
    desc.bsdfs.last().unwrap().value.clone()
}

#[test]
fn a_camera_is_turned_to_look_along_minus_z() {
    let desc = good(
        r#"<sensor type="perspective"><float name="fov" value="40"/>
           <transform name="to_world"><lookat origin="1, 2, 3" target="1, 2, 0" up="0, 1, 0"/></transform>
           <film type="hdrfilm"><integer name="width" value="10"/><integer name="height" value="20"/></film></sensor>"#,
    );
    let camera = &desc.cameras[0].value;
    // Mitsuba: +z forward. Ours: -z forward, so the camera at (1, 2, 3) that looks to -z is not turned at all.
    assert!(camera.world_from_camera.abs_diff_eq(Mat4::from_translation(Vec3::new(1.0, 2.0, 3.0)), 1e-6), "{}", camera.world_from_camera);
    let ProjectionDesc::Perspective { fov_rad, fov_axis, .. } = camera.projection else { panic!() };
    assert_eq!((fov_rad, fov_axis), (40f32.to_radians(), FovAxis::X));
    assert_eq!((desc.film.width, desc.film.height), (Some(10), Some(20)));
    assert_eq!(desc.film.filter, Some(FilterDesc::Gaussian { stddev: 0.5 }));
}

#[test]
fn depths_count_edges_from_the_camera() {
    for (said, meant) in [("-1", None), ("1", Some(0)), ("2", Some(1)), ("16", Some(15))] {
        let desc = good(&format!(r#"<integrator type="path"><integer name="max_depth" value="{said}"/></integrator>"#));
        assert_eq!(desc.integrator.max_depth, meant);
    }
}

#[test]
fn transforms_apply_in_order() {
    let desc = good(
        r#"<shape type="sphere"><transform name="to_world"><scale value="2"/><rotate y="1" angle="90"/><translate x="5"/></transform></shape>"#,
    );
    let p = desc.shapes[0].value.world_from_object.transform_point3(Vec3::Z);
    assert!(p.abs_diff_eq(Vec3::new(7.0, 0.0, 0.0), 1e-5), "{p}");
}

#[test]
fn defaults_can_be_overridden_and_are_substituted_longest_first() {
    let text = r#"<scene version="3.0.0"><default name="r" value="1"/><default name="radius" value="2"/>
        <shape type="sphere"><float name="radius" value="$radius"/></shape></scene>"#;
    let mut options = ReadOptions::default();
    let radius = |options: &ReadOptions| {
        let desc = read_bytes(Path::new("t.xml"), text.as_bytes(), options).unwrap();
        let GeometryDesc::Sphere { radius, .. } = desc.shapes[0].value.geometry else { panic!() };
        radius
    };
    assert_eq!(radius(&options), 2.0);
    options.defines.insert("radius".into(), "7".into());
    assert_eq!(radius(&options), 7.0);
}

#[test]
fn references_may_come_first_be_nested_and_have_aliases() {
    let desc = good(
        r#"<shape type="sphere"><ref id="other"/></shape>
           <shape type="disk"><ref id="inner"/></shape>
           <bsdf type="twosided" id="outer"><bsdf type="diffuse" id="inner"/></bsdf>
           <alias id="outer" as="other"/>"#,
    );
    assert_eq!(desc.bsdfs.len(), 2);
    let name = |i: usize| desc[desc.shapes[i].value.bsdf.unwrap()].name.clone();
    assert_eq!((name(0), name(1)), ("outer".to_owned(), "inner".to_owned()));
}

#[test]
fn named_materials_and_indices_are_found() {
    let BsdfDesc::Conductor { eta: Some(Param::Constant(eta)), .. } =
        bsdf(r#"<bsdf type="conductor"><string name="material" value="Au"/></bsdf>"#)
    else {
        panic!()
    };
    assert!((eta[0] - 0.143).abs() < 1e-3);
    let BsdfDesc::Dielectric { int_ior, ext_ior, roughness: Some(r), .. } =
        bsdf(r#"<bsdf type="roughdielectric"><string name="int_ior" value="water"/><float name="alpha" value="0.3"/></bsdf>"#)
    else {
        panic!()
    };
    assert_eq!((int_ior, ext_ior, r.distribution, r.alpha_u), (1.333, 1.00028, MicrofacetKind::Beckmann, Param::Constant(0.3)));
    assert!(matches!(bsdf(r#"<bsdf type="conductor"/>"#), BsdfDesc::Conductor { eta: None, .. }));
}

#[test]
fn files_of_version_0_6_are_upgraded() {
    let folder = TempFolder::new("upgrade");
    folder.put("a.png", [0u8; 4]);
    let path = folder.put(
        "old.xml",
        r#"<scene version="0.6.0">
           <sensor type="perspective"><transform name="toWorld"><lookAt origin="0,0,1" target="0,0,0" up="0,1,0"/></transform></sensor>
           <shape type="sphere"><transform name="toWorld"><scale x="2" y="2" z="2"/></transform><boolean name="flipNormals" value="true"/>
             <bsdf type="roughplastic"><float name="intIOR" value="1.9"/><texture type="bitmap" name="diffuseReflectance">
               <string name="filename" value="a.png"/><float name="uscale" value="3"/><float name="voffset" value="0.5"/></texture></bsdf></shape>
           <shape type="disk"><bsdf type="conductor"/></shape>
           <shape type="disk"><bsdf type="coating"><bsdf type="roughdiffuse"/></bsdf></shape>
           </scene>"#,
    );
    let desc = etendue_scene::formats::mitsuba::read(&path, &ReadOptions::default()).unwrap();
    assert!(desc.shapes[0].value.flip_normals);
    let BsdfDesc::Plastic { int_ior, diffuse_reflectance: Param::Texture(t), .. } = desc.bsdfs[0].value else { panic!() };
    assert_eq!(int_ior, 1.9);
    let TextureDesc::Bitmap(bitmap) = &desc[t].value else { panic!() };
    // u' = 3u; v' = 1 - (v + 0.5), as Mitsuba's pictures begin at v = 0 and ours at v = 1.
    let uv = bitmap.picture_from_uv.transform_point2(glam::Vec2::new(0.25, 0.1));
    assert!(uv.abs_diff_eq(glam::Vec2::new(0.75, 0.4), 1e-6), "{uv}");
    // 0.6 means copper where it says nothing.
    assert!(matches!(desc.bsdfs[1].value, BsdfDesc::Conductor { eta: Some(_), .. }));
    assert!(desc.bsdfs.iter().any(|b| matches!(b.value, BsdfDesc::Coated { .. })));
}

#[test]
fn lights_are_turned_to_our_axes() {
    let desc = good(
        r#"<emitter type="spot"><transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform></emitter>
           <emitter type="directional"><vector name="direction" value="0, -2, 0"/><rgb name="irradiance" value="1,2,3"/></emitter>
           <emitter type="point"><transform name="to_world"><translate y="3"/></transform><spectrum name="intensity" value="2"/></emitter>"#,
    );
    let LightDesc::Spot { world_from_light, outer_rad, inner_rad, .. } = &desc.lights[0].value else { panic!() };
    assert!(world_from_light.transform_vector3(Vec3::NEG_Z).abs_diff_eq(Vec3::NEG_Z, 1e-6));
    assert_eq!((*outer_rad, *inner_rad), (20f32.to_radians(), 15f32.to_radians()));
    assert_eq!(desc.lights[1].value, LightDesc::Directional { direction: Vec3::NEG_Y, irradiance: [1.0, 2.0, 3.0] });
    let LightDesc::Point { position, intensity } = &desc.lights[2].value else { panic!() };
    assert_eq!(*position, Vec3::new(0.0, 3.0, 0.0));
    // A flat spectrum as emission has the color of the equal-energy white (Mitsuba: 2.40959, 1.89658, 1.81783).
    assert!((intensity[0] - 2.40959).abs() < 5e-3 && (intensity[2] - 1.81783).abs() < 5e-3, "{intensity:?}");
}

#[test]
fn spectra_are_read_from_files() {
    let folder = TempFolder::new("spectrum");
    folder.put("s.spd", "# nm value\n400 0.1\n500 0.2\n600 0.8\n700 0.9\n");
    let path = folder
        .put("s.xml", r#"<scene version="3.0.0"><bsdf type="diffuse"><spectrum name="reflectance" filename="s.spd"/></bsdf></scene>"#);
    let desc = read(&path, &ReadOptions::default()).unwrap();
    let BsdfDesc::Diffuse { reflectance: Param::Constant([r, g, b]), .. } = desc.bsdfs[0].value else { panic!() };
    // Mitsuba 3.9 in its RGB mode.
    assert!((r - 0.958689).abs() < 2e-3 && (g - 0.446356).abs() < 2e-3 && (b - 0.10571).abs() < 2e-3, "{r} {g} {b}");
}

#[test]
fn groups_are_shared_by_instances() {
    let desc = good(
        r#"<shape type="shapegroup" id="g"><shape type="sphere"/><shape type="cube"/></shape>
           <shape type="instance"><ref id="g"/><transform name="to_world"><translate x="1"/></transform></shape>
           <shape type="instance"><ref id="g"/></shape><shape type="disk"/>"#,
    );
    assert_eq!((desc.shapes.len(), desc.groups.len(), desc.instances.len()), (3, 1, 2));
    assert_eq!(desc.groups[0].value.shapes, [ShapeId(0), ShapeId(1)]);
}

#[test]
fn media_are_attached_by_name() {
    let desc = good(
        r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="2, 2, 2"/><float name="albedo" value="0.25"/>
             <phase type="hg"><float name="g" value="0.5"/></phase></medium>
           <shape type="sphere"><bsdf type="null"/><ref name="interior" id="fog"/></shape>"#,
    );
    let MediumDesc::Homogeneous { sigma_a, sigma_s, phase, .. } = &desc.media[0].value else { panic!("homogeneous") };
    assert_eq!((*sigma_a, *sigma_s, phase), ([1.5; 3], [0.5; 3], &PhaseDesc::HenyeyGreenstein { g: 0.5 }));
    assert_eq!(desc.shapes[0].value.interior, Some(MediumId(0)));
}

#[test]
fn what_cannot_be_rendered_is_listed_as_lost() {
    let desc = good(r#"<shape type="sphere"><bsdf type="hair"/></shape><shape type="sdfgrid"/><emitter type="projector"/>"#);
    let losses: Vec<&str> = desc.report.losses.iter().map(|l| l.feature.as_str()).collect();
    assert_eq!(losses, ["bsdf \"hair\"", "shape \"sdfgrid\"", "emitter \"projector\""]);
    assert_eq!(desc.shapes.len(), 1);
}

#[test]
fn faults_have_places_and_suggestions_and_are_all_told() {
    let cases = [
        (r#"<bsdf type="difuse"/>"#, r#"2:1 unknown bsdf type "difuse" (did you mean `diffuse`?)"#),
        (
            r#"<bsdf type="diffuse"><rgb name="reflectence" value="1"/></bsdf>"#,
            r#"2:22 unknown parameter `reflectence` of bsdf "diffuse" (did you mean `reflectance`?)"#,
        ),
        (r#"<shpae type="sphere"/>"#, "2:1 unknown element <shpae> (did you mean `shape`?)"),
        (r#"<shape type="sphere"><float name="radius" value="x1"/></shape>"#, "2:22 `x1` is not a number"),
        (r#"<shape type="sphere"><float name="radius" value="nan"/></shape>"#, "2:22 `nan` is not a finite number"),
        (r#"<shape type="sphere"><float name="radius" value="-1"/></shape>"#, r#"2:22 shape "sphere": `radius` must be positive, not -1"#),
        (
            r#"<shape type="sphere"><string name="radius" value="1"/></shape>"#,
            r#"2:22 shape "sphere": `radius` takes a number, not a string"#,
        ),
        (r#"<shape type="sphere"><ref id="nothing"/></shape>"#, "2:22 nothing has the id `nothing`"),
        (r#"<shape type="sphere"><float name="radius" value="$q"/></shape>"#, "2:22 `$q` is not defined"),
        (
            r#"<shape type="ply"><string name="filename" value="no.ply"/></shape>"#,
            "2:19 no file `no.ply` in the scene's folder or the search paths",
        ),
        (r#"<shape type="ply"/>"#, r#"2:1 shape "ply": `filename` is missing"#),
        (r#"<bsdf type="twosided"/>"#, r#"2:1 bsdf "twosided": a nested bsdf is missing"#),
        (r#"<bsdf type="twosided" id="a"><ref id="a"/></bsdf>"#, r#"2:1 bsdf "twosided" `a` contains itself"#),
        (
            r#"<shape type="sphere"><transform name="to_world"><scale value="0"/></transform></shape>"#,
            r#"2:22 shape "sphere": `to_world` cannot be inverted"#,
        ),
        (
            r#"<shape type="sphere"><transform name="to_world"><lookat origin="0,0,0" target="0,1,0" up="0,1,0"/></transform></shape>"#,
            "2:49 <lookat> needs a target away from its origin and an up vector across the line to it",
        ),
        (r#"<bsdf type="diffuse" id="a"/><bsdf type="diffuse" id="a"/>"#, "2:30 the id `a` is given twice"),
        (r#"<bsdf type="diffuse"><shape type="sphere"/></bsdf>"#, r#"2:22 bsdf "diffuse" takes no shape "sphere""#),
        (
            r#"<include filename="../secret.xml"/>"#,
            "2:1 `../secret.xml` is outside the scene's folder and the search paths; allow its folder with --search-path",
        ),
        (r#"<emitter type="area"/>"#, r#"2:1 emitter "area" belongs inside a shape"#),
        (
            r#"<sensor type="perspective"><float name="fov" value="180"/></sensor>"#,
            r#"2:28 sensor "perspective": `fov` must lie between 0 and 180 degrees, not 180"#,
        ),
        (r#"<spectrum name="x"/>"#, "2:1 <spectrum> lacks its `value`"),
        (
            r#"<bsdf type="conductor"><string name="material" value="Aux"/></bsdf>"#,
            r#"2:24 bsdf "conductor": no conductor is called `Aux` (did you mean `Au`?)"#,
        ),
    ];
    let mut together = String::new();
    for (body, expected) in cases {
        assert_eq!(faults(parse(body)), [expected], "{body}");
        together += body;
        together.push('\n');
    }
    assert!(faults(parse(&together)).len() >= cases.len());
}

#[test]
fn texts_that_are_no_scene_are_told() {
    let options = ReadOptions::default();
    let read = |text: &[u8]| faults(read_bytes(Path::new("t.xml"), text, &options));
    let unclosed = read(b"<scene version='3.0.0'>\n<bsdf></scene>");
    assert!(unclosed[0].starts_with("2:7 not well-formed XML: "), "{unclosed:?}");
    assert_eq!(read(b"<scene version='3.0.0'>\n\xff</scene>"), ["2:1 not a text file in UTF-8"]);
    assert_eq!(read(b"<html/>"), ["1:1 the outermost element must be <scene>, not <html>"]);
    assert_eq!(read(b"<scene version='x'/>"), ["1:1 `x` is not a version such as 3.0.0"]);
    assert_eq!(read(b"").len(), 1);
}

#[test]
fn includes_are_read_and_cycles_are_told() {
    let folder = TempFolder::new("include");
    folder.put("parts/glass.xml", r#"<scene version="3.0.0"><bsdf type="dielectric" id="glass"/><shape type="ply"><string name="filename" value="m.ply"/></shape></scene>"#);
    folder.put("parts/m.ply", PLY);
    let path = folder.put(
        "main.xml",
        r#"<scene version="3.0.0"><include filename="parts/glass.xml"/><shape type="sphere"><ref id="glass"/></shape></scene>"#,
    );
    let desc = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!((desc.shapes.len(), desc.files.len()), (2, 2));
    let path = folder.put("cycle.xml", "<scene version=\"3.0.0\"><include filename=\"cycle.xml\"/></scene>");
    let text = read(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(text.contains("cycle.xml:1:24: error: includes are nested more than 15 deep"), "{text}");
    // Twice at each level: 2^15 files unless their number is bounded.
    let path = folder.put("bomb.xml", "<scene version=\"3.0.0\"><include filename=\"bomb.xml\"/><include filename=\"bomb.xml\"/></scene>");
    let start = Instant::now();
    assert!(read(&path, &ReadOptions::default()).is_err());
    assert!(start.elapsed().as_secs() < 5);
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
    property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

#[test]
fn hostile_texts_end_in_bounded_time() {
    let start = Instant::now();
    let laughs = format!(
        "<!DOCTYPE x [<!ENTITY a \"ha\">{}]><scene version=\"3.0.0\">&z;</scene>",
        ('b'..='z').map(|c| format!("<!ENTITY {c} \"{0}{0}{0}{0}\">", format!("&{};", (c as u8 - 1) as char))).collect::<String>()
    );
    assert!(!faults(read_bytes(Path::new("t.xml"), laughs.as_bytes(), &ReadOptions::default())).is_empty());
    let deep = "<bsdf type=\"twosided\">".repeat(100_000) + &"</bsdf>".repeat(100_000);
    assert!(faults(parse(&deep)).iter().any(|f| f.contains("nested more than 64 levels deep")));
    // Each key doubles the one before it.
    let mut doubling = "<default name=\"k0\" value=\"xxxxxxxx\"/>".to_owned();
    for i in 1..64 {
        doubling += &format!("<default name=\"k{i}\" value=\"$k{0}$k{0}\"/>", i - 1);
    }
    assert!(faults(parse(&doubling)).iter().any(|f| f.contains("grows too long")));
    // A chain of references longer than any stack.
    let mut chain = String::new();
    for i in 0..20_000 {
        chain += &format!("<bsdf type=\"twosided\" id=\"b{i}\"><ref id=\"b{}\"/></bsdf>\n", i + 1);
    }
    chain += "<bsdf type=\"diffuse\" id=\"b20000\"/>";
    assert!(faults(parse(&chain)).iter().any(|f| f.contains("nested more than")));
    // Many ids, many references to none of them; many shapes in a group.
    let ids: String = (0..50_000).map(|i| format!("<bsdf type=\"diffuse\" id=\"material_{i}\"/>\n")).collect();
    let references: String = (0..50_000).map(|i| format!("<shape type=\"sphere\"><ref id=\"matrial_{i}\"/></shape>\n")).collect();
    assert_eq!(faults(parse(&(ids + &references))).len(), 1000);
    let group = format!("<shape type=\"shapegroup\" id=\"g\">{}</shape>", "<shape type=\"sphere\"/>\n".repeat(100_000));
    assert_eq!(good(&group).groups[0].value.shapes.len(), 100_000);
    // One long line with many faults.
    let many = "<bsdf type=\"x\"/>".repeat(50_000);
    assert_eq!(faults(parse(&many)).len(), 1000);
    let count = r#"<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="999999999999"/></film></sensor>"#;
    assert!(!faults(parse(count)).is_empty());
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

#[test]
fn a_tree_without_xml_gives_the_same_scene() {
    let property = |name: &str, value| Property { name: name.into(), value, span: Span::default() };
    let plugin = |type_name: &str, params| Plugin {
        kind: Kind::of_type(type_name).unwrap(),
        type_name: type_name.into(),
        id: String::new(),
        span: Span::default(),
        params,
    };
    let diffuse = plugin("diffuse", vec![property("reflectance", Value::Rgb(DVec3::new(0.1, 0.2, 0.3)))]);
    let transform = Value::Transform(DMat4::from_translation(DVec3::X));
    let sphere = plugin("sphere", vec![property("to_world", transform), property("bsdf", Value::Plugin(Box::new(diffuse)))]);
    let root = plugin("scene", vec![property("ball", Value::Plugin(Box::new(sphere)))]);
    let tree = Tree { root, aliases: Vec::new() };
    let mut made = from_tree(&tree, Path::new("."), &ReadOptions::default()).unwrap();
    let mut parsed = good(
        r#"<shape type="sphere"><transform name="to_world"><translate x="1"/></transform>
           <bsdf type="diffuse"><rgb name="reflectance" value="0.1, 0.2, 0.3"/></bsdf></shape>"#,
    );
    for desc in [&mut made, &mut parsed] {
        desc.files.clear();
        desc.shapes[0].span = Span::default();
        desc.bsdfs[0].span = Span::default();
    }
    assert_eq!(made, parsed);
}

#[test]
fn scenes_without_camera_and_light_get_both() {
    let folder = TempFolder::new("complete");
    let path = folder.put("bare.xml", r#"<scene version="3.0.0"><shape type="sphere"><float name="radius" value="2"/></shape></scene>"#);
    let desc = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!((desc.cameras.len(), desc.lights.len()), (1, 2));
    assert_eq!(desc.report.faults.len(), 2);
    // The sphere's center lies on the camera's axis, outside of the sphere.
    let center = desc.cameras[0].value.world_from_camera.inverse().transform_point3(Vec3::ZERO);
    assert!(center.x.abs() < 1e-4 && center.y.abs() < 1e-4 && center.z < -4.0, "{center}");
}
