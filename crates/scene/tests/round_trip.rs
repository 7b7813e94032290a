//! Writing a scene and reading it again gives the same scene.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, mitsuba, read, summary};
use etendue_scene::{Report, SceneDesc, Span};
use glam::{Mat4, Vec3};
use support::TempFolder;

/// Leaves out what a file name, a place or a made-up id says.
fn stripped(mut desc: SceneDesc) -> SceneDesc {
    macro_rules! strip {
        ($($field:ident),*) => {$(for node in &mut desc.$field {
            node.name.clear();
            node.span = Span::default();
        })*};
    }
    strip!(images, textures, bsdfs, media, meshes, shapes, groups, instances, lights, cameras);
    for mesh in &mut desc.meshes {
        mesh.value.file = None;
        mesh.value.flip_v = false;
    }
    for image in &mut desc.images {
        image.value.source = ImageSource::Embedded(Vec::new());
    }
    desc.files.clear();
    desc.report = Report::default();
    desc
}

const SCENE: &str = r#"<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="7"/><integer name="rr_depth" value="3"/><boolean name="hide_emitters" value="true"/></integrator>
  <sensor type="thinlens" id="cam &amp; era"><float name="fov" value="39.3"/><float name="aperture_radius" value="0.1"/><float name="focus_distance" value="4"/>
    <transform name="to_world"><lookat origin="1, 2, 3" target="0, 0.5, 0" up="0, 1, 0"/></transform>
    <sampler type="stratified"><integer name="sample_count" value="25"/></sampler>
    <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="48"/><integer name="crop_offset_x" value="8"/>
      <integer name="crop_width" value="32"/><rfilter type="mitchell"/></film></sensor>
  <texture type="bitmap" id="wood"><string name="filename" value="wood.png"/><string name="wrap_mode" value="mirror"/><boolean name="raw" value="true"/>
    <transform name="to_uv"><scale x="2" y="3"/></transform></texture>
  <texture type="checkerboard" id="tiles"><rgb name="color0" value="0.1, 0.2, 0.3"/></texture>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="2"/><float name="albedo" value="0.5"/><phase type="hg"><float name="g" value="0.25"/></phase></medium>
  <bsdf type="diffuse" id="white"><ref name="reflectance" id="wood"/></bsdf>
  <bsdf type="twosided" id="both"><ref id="white"/></bsdf>
  <bsdf type="roughconductor" id="gold"><string name="material" value="Au"/><float name="alpha_u" value="0.1"/><float name="alpha_v" value="0.2"/></bsdf>
  <bsdf type="conductor" id="mirror"/>
  <bsdf type="roughdielectric" id="frost"><string name="distribution" value="ggx"/></bsdf>
  <bsdf type="dielectric" id="glass"/>
  <bsdf type="thindielectric" id="pane"/>
  <bsdf type="plastic" id="plastic"><boolean name="nonlinear" value="true"/></bsdf>
  <bsdf type="roughplastic" id="rough"><float name="alpha" value="0.3"/></bsdf>
  <bsdf type="principled" id="disney"><float name="metallic" value="0.5"/><float name="specular" value="0.7"/></bsdf>
  <bsdf type="principledthin" id="leaf"><float name="diff_trans" value="1.5"/></bsdf>
  <bsdf type="blendbsdf" id="blend"><ref name="weight" id="tiles"/><ref id="white"/><ref id="gold"/></bsdf>
  <bsdf type="mask" id="mask"><float name="opacity" value="0.3"/><ref id="both"/></bsdf>
  <bsdf type="bumpmap" id="bump"><ref name="map" id="wood"/><float name="scale" value="2"/><ref id="white"/></bsdf>
  <bsdf type="normalmap" id="normal"><ref name="normalmap" id="wood"/><ref id="white"/></bsdf>
  <bsdf type="null" id="nothing"/>
  <shape type="obj"><string name="filename" value="m.obj"/><ref id="bump"/><emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter></shape>
  <shape type="sphere"><point name="center" value="1, 2, 3"/><float name="radius" value="0.5"/><ref id="nothing"/><ref name="interior" id="fog"/></shape>
  <shape type="shapegroup" id="group"><shape type="cube"><ref id="mask"/></shape><shape type="disk"/></shape>
  <shape type="cylinder"><boolean name="flip_normals" value="true"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="33"/></transform></shape>
  <shape type="instance"><transform name="to_world"><translate x="4"/></transform><ref id="group"/></shape>
  <emitter type="spot"><transform name="to_world"><rotate y="1" angle="90"/></transform><float name="cutoff_angle" value="33"/></emitter>
  <emitter type="directional"><vector name="direction" value="0, 0, -1"/></emitter>
  <emitter type="point"><point name="position" value="1, 1, 1"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>
  <emitter type="envmap"><string name="filename" value="wood.png"/><float name="scale" value="2"/><transform name="to_world"><rotate y="1" angle="20"/></transform></emitter>
  <emitter type="sunsky"/>
</scene>"#;

fn example(folder: &TempFolder) -> SceneDesc {
    folder.put("wood.png", b"\x89PNG not really");
    folder.put("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0.25\nf 1/1 2/1 3/1\n");
    let path = folder.put("scene.xml", SCENE);
    read(&path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn what_is_written_is_read_again() {
    let folder = TempFolder::new("round-trip");
    let desc = example(&folder);
    assert!(desc.report.losses.is_empty() && desc.report.faults.is_empty(), "{:?}", desc.report);
    let out = TempFolder::new("round-trip-out");
    let path = out.path().join("written.xml");
    let report = mitsuba::write(&desc, &path).unwrap();
    assert!(report.losses.is_empty(), "{:?}", report.losses);
    let again = read(&path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}\n{}", std::fs::read_to_string(&path).unwrap()));
    let (a, b) = (stripped(desc), stripped(again.clone()));
    assert_eq!(a.cameras, b.cameras);
    assert_eq!(a.bsdfs, b.bsdfs);
    assert_eq!(a.shapes, b.shapes);
    assert_eq!(a, b);
    // Once more into another folder: the very same text.
    let out = TempFolder::new("round-trip-again");
    let second = out.path().join("written.xml");
    mitsuba::write(&again, &second).unwrap();
    assert_eq!(
        std::fs::read_to_string(path).unwrap().replace("written_files/0_0_", "written_files/0_"),
        std::fs::read_to_string(second).unwrap().replace("written_files/0_0_", "written_files/0_")
    );
}

#[test]
fn what_mitsuba_cannot_say_is_listed_as_lost() {
    let folder = TempFolder::new("write-losses");
    let mut desc = SceneDesc::new("test", "test");
    let span = Span::default();
    let pixels = ImageSource::Pixels { width: 2, height: 1, channels: 3, data: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
    let image = desc.add(Node::new(span, ImageDesc { source: pixels }));
    let pbr = desc.add(Node::named("odd \"name\" <", span, BsdfDesc::Pbr(Box::default())));
    let coat = BsdfDesc::Coated {
        base: pbr,
        int_ior: 1.5,
        ext_ior: 1.0,
        thickness: 1.0,
        sigma_a: Color::gray(0.0),
        specular_reflectance: Color::gray(1.0),
        roughness: None,
    };
    let coat = desc.add(Node::new(span, coat));
    let mut plane = ShapeDesc::new(GeometryDesc::Plane, Mat4::IDENTITY);
    plane.bsdf = Some(coat);
    desc.add(Node::new(span, plane));
    desc.add(Node::new(
        span,
        LightDesc::Environment {
            image,
            scale: [1.0, 2.0, 3.0],
            world_from_light: Mat4::IDENTITY,
            mapping: EnvironmentMapping::EquirectangularOnPoles,
            portal: None,
        },
    ));
    let path = folder.path().join("out.xml");
    let report = mitsuba::write(&desc, &path).unwrap();
    let lost: Vec<&str> = report.losses.iter().map(|l| l.feature.as_str()).collect();
    assert_eq!(lost, ["glTF material", "coated bsdf", "infinite plane", "color of an environment light"]);
    let again = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!(again.shapes[0].value.world_from_object.transform_vector3(Vec3::X).x, 1e5);
    assert!(matches!(again[again.shapes[0].value.bsdf.unwrap()].value, BsdfDesc::TwoSided { .. }));
    assert!(summary(&again).contains("image_0.exr 2 × 1"), "{}", summary(&again));
}

#[test]
fn the_summary_tells_the_figures() {
    let folder = TempFolder::new("summary");
    let desc = example(&folder);
    let text = summary(&desc);
    for line in [
        "shapes      6 (1 cube, 1 cylinder, 1 disk, 1 mesh, 1 rectangle, 1 sphere)",
        "meshes      1 (1 triangles, 3 vertices)",
        "max depth 6",
        "64 × 48, 25 samples",
    ] {
        assert!(text.contains(line), "`{line}` is not in\n{text}");
    }
    let json = etendue_scene::formats::Summary::new(&desc).to_json();
    assert_eq!(json["lights"]["area"], 1);
    assert_eq!(json["film"], serde_json::json!([64, 48]));
}
