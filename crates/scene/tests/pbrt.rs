//! The reader of pbrt-v4 files: what it makes of good files, and what it says of bad ones, with the place.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod support;

use std::path::Path;
use std::time::{Duration, Instant};

use etendue_scene::desc::*;
use etendue_scene::formats::{ReadOptions, pbrt, read};
use etendue_scene::{ReadError, SceneDesc, Severity};
use glam::{Vec2, Vec3};
use support::TempFolder;

fn parse(text: &str) -> Result<SceneDesc, ReadError> {
    pbrt::read_bytes(Path::new("test.pbrt"), text.as_bytes(), &ReadOptions::default())
}

fn good(text: &str) -> SceneDesc {
    parse(text).unwrap_or_else(|e| panic!("{e}"))
}

/// A description of what stands after `WorldBegin`.
fn world(body: &str) -> SceneDesc {
    good(&format!("WorldBegin\n{body}"))
}

fn faults(text: &str) -> Vec<String> {
    match parse(text) {
        Err(ReadError::Invalid { faults, .. }) => faults
            .iter()
            .filter(|f| f.severity == Severity::Error)
            .map(|f| format!("{}:{} {}", f.span.line, f.span.column, f.message))
            .collect(),
        Err(e) => panic!("{e}"),
        Ok(_) => Vec::new(),
    }
}

/// The model of the last material, without the wrapper for both sides.
fn model(body: &str) -> BsdfDesc {
    let desc = world(body);
    let last = &desc.bsdfs.last().unwrap().value;
    match last {
        BsdfDesc::TwoSided { front, .. } => desc[*front].value.clone(),
        other => other.clone(),
    }
}

#[test]
fn a_camera_looks_where_look_at_says_with_x_to_the_right() {
    let desc = good(
        "LookAt 1 2 3  1 2 -5  0 1 0\nCamera \"perspective\" \"float fov\" 40\nFilm \"rgb\" \"integer xresolution\" 30 \"integer yresolution\" 20\nWorldBegin",
    );
    let m = desc.cameras[0].value.world_from_camera;
    assert!((m.transform_point3(Vec3::ZERO) - Vec3::new(1.0, 2.0, 3.0)).length() < 1e-6);
    assert!((m.transform_vector3(Vec3::NEG_Z) - Vec3::NEG_Z).length() < 1e-6, "forward");
    // Left-handed: looking along −z with +y up, the right is −x.
    assert!((m.transform_vector3(Vec3::X) - Vec3::NEG_X).length() < 1e-6, "right");
    let ProjectionDesc::Perspective { fov_rad, fov_axis, .. } = desc.cameras[0].value.projection else { panic!() };
    assert_eq!((fov_rad, fov_axis), (40f32.to_radians(), FovAxis::Smaller));
    assert_eq!((desc.film.width, desc.film.height), (Some(30), Some(20)));
}

#[test]
fn defaults_are_those_of_pbrt() {
    let desc = world("");
    assert_eq!((desc.film.width, desc.film.height, desc.film.spp), (Some(1280), Some(720), Some(16)));
    assert_eq!(desc.film.filter, Some(FilterDesc::Gaussian { stddev: 0.5 }));
    assert_eq!((desc.integrator.name.as_str(), desc.integrator.max_depth), ("path", Some(5)));
    assert!(
        matches!(desc.cameras[0].value.projection, ProjectionDesc::Perspective { fov_rad, .. } if (fov_rad.to_degrees() - 90.0).abs() < 1e-4)
    );
}

#[test]
fn attributes_and_transforms_nest() {
    let desc = world(
        "AttributeBegin Translate 1 0 0 Scale 2 2 2 Shape \"sphere\" ReverseOrientation Shape \"sphere\" AttributeEnd\n\
         Shape \"sphere\" \"float radius\" [3]",
    );
    let at = |i: usize| desc.shapes[i].value.world_from_object.transform_point3(Vec3::X);
    assert_eq!((at(0), at(2)), (Vec3::new(3.0, 0.0, 0.0), Vec3::X));
    assert_eq!([0, 1, 2].map(|i| desc.shapes[i].value.flip_normals), [false, true, false]);
    assert_eq!(desc.shapes[2].value.geometry, GeometryDesc::Sphere { center: Vec3::ZERO, radius: 3.0 });
}

#[test]
fn objects_become_groups_with_instances() {
    let desc = world(
        "ObjectBegin \"tree\" Translate 0 1 0 Shape \"disk\" \"float radius\" 2 ObjectEnd\n\
         AttributeBegin Translate 5 0 0 ObjectInstance \"tree\" AttributeEnd ObjectInstance \"tree\"",
    );
    assert_eq!((desc.groups.len(), desc.instances.len(), desc.groups[0].value.shapes.len()), (1, 2, 1));
    assert_eq!(desc.instances[0].value.world_from_object.transform_point3(Vec3::ZERO), Vec3::new(5.0, 0.0, 0.0));
    assert_eq!(desc.shapes[0].value.world_from_object.transform_point3(Vec3::X), Vec3::new(2.0, 1.0, 0.0));
}

#[test]
fn roughness_is_remapped_unless_the_file_says_otherwise() {
    let alpha = |p: &str| match model(&format!("Material \"conductor\" \"float roughness\" 0.25 {p}")) {
        BsdfDesc::Conductor { roughness: Some(r), .. } => r.alpha_u,
        other => panic!("{other:?}"),
    };
    assert_eq!(alpha(""), Scalar::Constant(0.5));
    assert_eq!(alpha("\"bool remaproughness\" false"), Scalar::Constant(0.25));
    assert!(matches!(model("Material \"dielectric\""), BsdfDesc::Dielectric { int_ior: 1.5, roughness: None, .. }));
    let textured = world("Texture \"r\" \"float\" \"checkerboard\" Material \"dielectric\" \"texture roughness\" \"r\"");
    assert!(textured.textures.iter().any(|t| matches!(t.value, TextureDesc::Power { exponent: 0.5, .. })));
}

#[test]
fn materials_become_their_models() {
    let gold = model("Material \"conductor\" \"spectrum eta\" \"metal-Au-eta\" \"spectrum k\" \"metal-Au-k\"");
    let (eta, k) = etendue_scene::ior::conductor("Au").unwrap();
    assert!(matches!(gold, BsdfDesc::Conductor { eta: Some(Color::Constant(e)), k: Color::Constant(c), .. } if e == eta && c == k));
    // A reflectance of r at normal incidence.
    let BsdfDesc::Conductor { eta: Some(Color::Constant([n, ..])), k: Color::Constant([k, ..]), .. } =
        model("Material \"conductor\" \"rgb reflectance\" [0.9 0.5 0.1]")
    else {
        panic!()
    };
    assert!((((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k) - 0.9).abs() < 1e-5);
    assert!(matches!(model("Material \"coateddiffuse\""), BsdfDesc::Plastic { nonlinear: true, roughness: None, .. }));
    assert!(matches!(model("Material \"coatedconductor\" \"float interface.roughness\" 0"), BsdfDesc::Coated { .. }));
    assert!(matches!(model("Material \"thindielectric\""), BsdfDesc::ThinDielectric { .. }));
    assert!(matches!(model("Material \"interface\""), BsdfDesc::Null));
    let leaf = model("Material \"diffusetransmission\" \"float scale\" 2");
    assert!(matches!(leaf, BsdfDesc::DiffuseTransmission { reflectance: Color::Constant([r, ..]), .. } if r == 0.5));
    let mix = model(
        "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" MakeNamedMaterial \"b\" \"string type\" \"dielectric\"\n\
         Material \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" 0.25",
    );
    assert!(matches!(mix, BsdfDesc::Blend { weight: Scalar::Constant(0.25), .. }));
}

#[test]
fn lights_have_pbrts_units() {
    let desc = world(
        "LightSource \"point\" \"rgb I\" [1 2 3] \"float scale\" 2 \"point3 from\" [1 2 3]\n\
         LightSource \"point\" \"float power\" 12.566371\n\
         LightSource \"distant\" \"point3 from\" [0 10 0] \"point3 to\" [0 0 0] \"rgb L\" [3 3 3]\n\
         LightSource \"infinite\" \"rgb L\" [0.5 0.5 0.5] \"float scale\" 4\n\
         LightSource \"spot\" \"point3 from\" [0 5 0] \"point3 to\" [0 0 0] \"float coneangle\" 20 \"float conedeltaangle\" 5\n\
         LightSource \"infinite\" \"blackbody L\" 3000",
    );
    let light = |i: usize| desc.lights[i].value.clone();
    assert_eq!(light(0), LightDesc::Point { position: Vec3::new(1.0, 2.0, 3.0), intensity: [2.0, 4.0, 6.0] });
    assert!(matches!(light(1), LightDesc::Point { intensity: [i, ..], .. } if (i - 1.0).abs() < 1e-6), "power over 4π");
    assert_eq!(light(2), LightDesc::Directional { direction: Vec3::NEG_Y, irradiance: [3.0; 3] });
    assert_eq!(light(3), LightDesc::Constant { radiance: [2.0; 3] });
    let LightDesc::Spot { world_from_light, inner_rad, outer_rad, falloff, .. } = light(4) else { panic!() };
    assert!((world_from_light.transform_vector3(Vec3::NEG_Z) - Vec3::NEG_Y).length() < 1e-6);
    assert_eq!((inner_rad, outer_rad, falloff), (15f32.to_radians(), 20f32.to_radians(), SpotFalloff::Smoothstep));
    let LightDesc::Constant { radiance: [r, g, b] } = light(5) else { panic!() };
    assert!((0.2126 * r + 0.7152 * g + 0.0722 * b - 1.0).abs() < 1e-4 && r > 2.0 * b, "luminance 1, and red");
}

#[test]
fn area_lights_shine_from_the_shapes_that_follow() {
    let desc = world(
        "AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float scale\" 2 Shape \"sphere\" AttributeEnd Shape \"sphere\"\n\
         AreaLightSource \"diffuse\" \"float power\" 10 Shape \"disk\"",
    );
    let emission = |i: usize| desc.shapes[i].value.emission.clone();
    assert_eq!(emission(0).unwrap().radiance, Color::Constant([2.0, 4.0, 6.0]));
    assert_eq!(emission(1), None);
    let Color::Constant([l, ..]) = emission(2).unwrap().radiance else { panic!() };
    let pi = std::f32::consts::PI;
    assert!((l * pi * pi - 10.0).abs() < 1e-4, "the flux of a unit disk is π² L");
}

#[test]
fn shapes_become_meshes_with_their_own_normals() {
    let desc = world(
        "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"point2 uv\" [0 0 1 0 0 1]\n\
         Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]\n\
         Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 1]\n\
         Shape \"loopsubdiv\" \"integer levels\" 2 \"point3 P\" [1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1]\n\
           \"integer indices\" [0 2 4 2 1 4 1 3 4 3 0 4 2 0 5 1 2 5 3 1 5 0 3 5]\n\
         Shape \"curve\" \"point3 P\" [0 0 0 0 0 1 0 0 2 0 0 3] \"float width\" 0.1\n\
         Shape \"sphere\" \"float zmax\" 0 Shape \"disk\" \"float innerradius\" 0.5 Shape \"cylinder\" \"float phimax\" 90",
    );
    let count = |i: usize| desc.meshes[i].value.data.as_ref().unwrap().triangles.len();
    assert_eq!([0, 1, 2, 3].map(count), [1, 2, 128, 128]);
    assert_eq!(desc.meshes[0].value.data.as_ref().unwrap().uvs[1], Vec2::X);
    for i in 0..desc.meshes.len() {
        let mesh = desc.meshes[i].value.data.as_ref().unwrap();
        for t in mesh.triangles.iter().filter(|_| !mesh.normals.is_empty()) {
            let [a, b, c] = t.map(|k| mesh.positions[k as usize]);
            assert!((b - a).cross(c - a).dot(mesh.normals[t[0] as usize]) >= 0.0, "mesh {i}");
        }
    }
    let hemisphere = desc.meshes[5].value.data.as_ref().unwrap();
    assert!(hemisphere.positions.iter().all(|p| p.z <= 1e-6 && (p.length() - 1.0).abs() < 1e-5));
}

#[test]
fn textures_chain() {
    let folder = TempFolder::new("pbrt-textures");
    folder.put("a.png", "not looked into");
    let path = folder.put(
        "scene.pbrt",
        "WorldBegin Texture \"pic\" \"spectrum\" \"imagemap\" \"string filename\" \"a.png\" \"float uscale\" 2 \"float scale\" 0.5\n\
         Texture \"half\" \"float\" \"constant\" \"float value\" 0.5\n\
         Texture \"both\" \"spectrum\" \"scale\" \"texture tex\" \"pic\" \"texture scale\" \"half\"\n\
         Material \"diffuse\" \"texture reflectance\" \"both\" Shape \"sphere\"",
    );
    let desc = read(&path, &ReadOptions::default()).unwrap();
    let BsdfDesc::Diffuse { reflectance: Color::Texture(id), .. } = desc.bsdfs[0].value else { panic!() };
    let TextureDesc::Multiply { a: Color::Texture(a), b: Color::Constant(b) } = desc[id].value else { panic!() };
    assert_eq!(b, [0.5; 3]);
    let TextureDesc::Affine { texture, scale, .. } = desc[a].value else { panic!() };
    assert_eq!(scale, 0.5);
    let TextureDesc::Bitmap(bitmap) = &desc[texture].value else { panic!() };
    assert_eq!(bitmap.picture_from_uv.transform_point2(Vec2::ONE), Vec2::new(2.0, 1.0));
}

#[test]
fn lights_by_pictures_lie_in_the_spaces_of_their_formats() {
    let folder = TempFolder::new("pbrt-light-pictures");
    folder.put("a.png", "not looked into");
    let path = folder.put(
        "scene.pbrt",
        "WorldBegin Translate 1 2 3 LightSource \"goniometric\" \"string filename\" \"a.png\" \"rgb I\" [1 2 3] \"float scale\" 2\n\
         LightSource \"projection\" \"string filename\" \"a.png\" \"float fov\" 60 \"float power\" 5",
    );
    let check = |desc: &SceneDesc| {
        assert!(desc.report.losses.is_empty(), "{:?}", desc.report.losses);
        let LightDesc::Picture { world_from_light, intensity, power: None, mapping: PictureMapping::EqualAreaSquare, .. } =
            desc.lights[0].value
        else {
            panic!()
        };
        assert_eq!((intensity, world_from_light.transform_point3(Vec3::ZERO)), ([2.0, 4.0, 6.0], Vec3::new(1.0, 2.0, 3.0)));
        assert_eq!(world_from_light.transform_vector3(Vec3::Z), Vec3::Y, "the map's middle");
        let LightDesc::Picture { world_from_light, intensity, power, mapping: PictureMapping::Perspective { fov_rad }, .. } =
            desc.lights[1].value
        else {
            panic!()
        };
        assert_eq!((intensity, power, world_from_light.transform_vector3(Vec3::Z)), ([1.0; 3], Some(5.0), Vec3::Z));
        assert!((fov_rad.to_degrees() - 60.0).abs() < 1e-4);
    };
    let desc = read(&path, &ReadOptions::default()).unwrap();
    check(&desc);
    let out = folder.path().join("written.pbrt");
    assert!(pbrt::write(&desc, &out).unwrap().losses.is_empty());
    check(&read(&out, &ReadOptions::default()).unwrap());
    let light = |t: &str| faults(&format!("WorldBegin LightSource \"projection\" {t}"));
    assert!(light("")[0].contains("needs a `filename`"));
    assert!(light("\"string filename\" \"none.png\" \"float fov\" 180")[0].contains("between 0 and 180 degrees, not 180"));
}

#[test]
fn hostile_textures_are_refused_or_limited() {
    let texture = |t: &str| faults(&format!("WorldBegin Texture \"t\" {t}"));
    assert!(texture("\"spectrum\" \"fbm\"")[0].contains("a texture of floats"));
    assert!(texture("\"float\" \"marble\"")[0].contains("a texture of spectra"));
    assert!(texture("\"float\" \"checkerboard\" \"integer dimension\" 4")[0].contains("2 or 3 dimensions, not 4"));
    assert!(texture("\"float\" \"directionmix\" \"vector3 dir\" [0 0 0]")[0].contains("must not be zero"));
    assert!(texture("\"float\" \"dots\" \"string mapping\" \"conical\"")[0].contains("no mapping `conical`"));
    let flat = faults("WorldBegin Scale 1 0 1 Texture \"t\" \"float\" \"windy\"");
    assert!(flat[0].contains("cannot be inverted"), "{flat:?}");
    let mut desc = world("Texture \"t\" \"float\" \"fbm\" \"integer octaves\" 2000000000 \"float roughness\" nan");
    assert!(desc.report.losses[0].feature.contains("2000000000 octaves"), "{:?}", desc.report.losses);
    let message = etendue_scene::validate::validate(&mut desc).unwrap_err().to_string();
    assert!(message.contains("roughness is not finite"), "{message}");
}

/// Noise leaves [0, 1]; what a surface reflects does not.
#[test]
fn reflectances_by_noise_are_limited() {
    let desc = world(
        "Texture \"n\" \"float\" \"fbm\" Texture \"t\" \"spectrum\" \"mix\" \"texture amount\" \"n\"\n\
         Material \"diffuse\" \"texture reflectance\" \"t\" Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\"",
    );
    let limited = |i: usize| match desc.bsdfs[i].value {
        BsdfDesc::Diffuse { reflectance: Color::Texture(id), .. } => id,
        _ => panic!(),
    };
    assert!(matches!(desc[limited(0)].value, TextureDesc::Affine { clamp: Some([0.0, 1.0]), .. }));
    assert_eq!(limited(0), limited(2), "one node for all");
}

#[test]
fn included_files_may_be_compressed_and_may_not_lead_outside() {
    let folder = TempFolder::new("pbrt-include");
    folder.put("part.pbrt", "Shape \"sphere\"\n");
    let path = folder.put("scene.pbrt", "WorldBegin Include \"part.pbrt\" Import \"part.pbrt\"");
    assert_eq!(read(&path, &ReadOptions::default()).unwrap().shapes.len(), 2);
    let path = folder.put("bad.pbrt", "WorldBegin\n Include \"../../../../etc/passwd\"");
    let message = read(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(message.contains("bad.pbrt:2:2") && message.contains("outside"), "{message}");
    let path = folder.put("cycle.pbrt", "WorldBegin\nInclude \"cycle.pbrt\" Include \"cycle.pbrt\"");
    let start = Instant::now();
    let message = read(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(message.contains("include each other") && start.elapsed() < Duration::from_secs(2), "{message}");
}

#[test]
fn faults_have_their_place() {
    assert_eq!(faults("WorldBegin\n  Shap \"sphere\""), ["2:3 no directive `Shap`"]);
    assert_eq!(faults("Translate 1 2"), ["1:14 expected a number, not the end of the file"]);
    assert_eq!(faults("WorldBegin AttributeEnd"), ["1:12 `AttributeEnd` without `AttributeBegin`"]);
    assert_eq!(faults("WorldBegin\nAttributeBegin"), ["2:1 `AttributeBegin` is never ended"]);
    assert_eq!(faults("WorldBegin NamedMaterial \"x\""), ["1:12 no material `x` has been made"]);
    assert_eq!(faults("WorldBegin Shape \"sphere\" \"float radius\" [1"), ["1:27 the file ends within a parameter"]);
    assert_eq!(faults("WorldBegin Shape \"sphere\" \"float radius\" \"big\""), ["1:27 the values of `float radius` do not fit its type"]);
    let index = faults("WorldBegin Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 3]");
    assert_eq!(index, ["1:64 the index 3 in `indices` is not below 3, the number of points"]);
    // All faults of a file, not the first alone.
    let many = faults("WorldBegin\nShape \"blob\"\nLightSource \"lava\"\nMaterial \"goo\"");
    assert_eq!(many.len(), 3, "{many:?}");
}

#[test]
fn unknown_parameters_are_told() {
    let desc = world("Shape \"sphere\" \"float radios\" 2");
    let fault = &desc.report.faults[0];
    assert_eq!((fault.severity, fault.span.line), (Severity::Warning, 2));
    assert!(fault.message.contains("radios"), "{}", fault.message);
    // Defaults by `Attribute` need not fit every directive.
    assert!(
        world("Attribute \"shape\" \"float radius\" 4 Shape \"sphere\" Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]")
            .report
            .faults
            .is_empty()
    );
}

#[test]
fn what_cannot_be_rendered_is_in_the_loss_report() {
    let desc = world(
        "Material \"hair\" Shape \"sphere\" Texture \"t\" \"float\" \"ptex\"\n\
         ActiveTransform EndTime Translate 1 0 0 ActiveTransform All Shape \"sphere\"",
    );
    let features: Vec<&str> = desc.report.losses.iter().map(|l| l.feature.as_str()).collect();
    assert_eq!(features, ["Material \"hair\"", "Texture \"ptex\"", "moving transform"]);
}

#[test]
fn deep_and_long_files_end_in_bounded_time() {
    let start = Instant::now();
    assert!(!faults(&"AttributeBegin ".repeat(300_000)).is_empty());
    assert!(!faults(&format!("WorldBegin {}", "Shape \"sphere\" \"float radius\" -1 ".repeat(50_000))).is_empty());
    assert!(parse(&"\u{0}\"[".repeat(10_000)).is_err());
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
fn what_is_written_reads_the_same() {
    let folder = TempFolder::new("pbrt-write");
    let first = world(
        "AttributeBegin Translate 1 2 3 Material \"dielectric\" \"float eta\" 1.4 \"float roughness\" 0.04 Shape \"sphere\" AttributeEnd\n\
         Material \"conductor\" \"spectrum eta\" \"metal-Ag-eta\" \"spectrum k\" \"metal-Ag-k\" \"float uroughness\" 0.01 \"float vroughness\" 0.04\n\
         AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"bool twosided\" true Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]\n\
         ObjectBegin \"o\" Shape \"disk\" ObjectEnd Translate 0 0 4 ObjectInstance \"o\"\n\
         LightSource \"distant\" \"rgb L\" [3 3 3] LightSource \"spot\" \"float coneangle\" 40",
    );
    let path = folder.path().join("again.pbrt");
    let report = pbrt::write(&first, &path).unwrap();
    assert!(report.losses.is_empty(), "{:?}", report.losses);
    let again = read(&path, &ReadOptions::default()).unwrap();
    assert_eq!((again.shapes.len(), again.instances.len(), again.lights.len()), (3, 1, 2));
    // Groups are written first.
    let order = [2, 0, 1];
    for (i, node) in again.shapes.iter().enumerate() {
        let old = &first.shapes[order[i]].value;
        assert!(node.value.world_from_object.abs_diff_eq(old.world_from_object, 1e-6), "{i}");
        assert_eq!(node.value.emission, old.emission);
        let model = |d: &SceneDesc, s: &ShapeDesc| match &d[s.bsdf.unwrap()].value {
            BsdfDesc::TwoSided { front, .. } => d[*front].value.clone(),
            other => other.clone(),
        };
        assert_eq!(model(&again, &node.value), model(&first, old));
    }
    assert!(again.cameras[0].value.world_from_camera.abs_diff_eq(first.cameras[0].value.world_from_camera, 1e-6));
    let second = folder.path().join("second.pbrt");
    pbrt::write(&again, &second).unwrap();
    let text = |p: &Path| std::fs::read_to_string(p).unwrap().replace("second_files", "again_files");
    assert_eq!(text(&second).lines().count(), text(&path).lines().count());
}

/// A portal lies in the world, whatever the transform, and is written back.
#[test]
fn portals_are_rectangles_in_the_world() {
    let folder = TempFolder::new("pbrt-portal");
    std::fs::write(folder.path().join("sky.pfm"), b"PF\n1 1\n-1.0\n\0\0\x80\x3f\0\0\x80\x3f\0\0\x80\x3f").unwrap();
    let scene = folder.path().join("scene.pbrt");
    let parse = |portal: &str| {
        let text = format!("WorldBegin Translate 7 0 0\nLightSource \"infinite\" {portal}\nShape \"sphere\"");
        std::fs::write(&scene, text).unwrap();
        read(&scene, &ReadOptions::default())
    };
    let portal_of = |desc: &SceneDesc| match desc.lights[0].value {
        LightDesc::Environment { portal, .. } => portal,
        _ => panic!("no map"),
    };
    let corners = "\"point3 portal\" [0 0 0  0 0 1  2 0 1  2 0 0]";
    let desc = parse(&format!("\"string filename\" \"sky.pfm\" {corners}")).unwrap();
    assert!(desc.report.losses.is_empty() && desc.report.faults.is_empty(), "{:?}", desc.report);
    let expected = [Vec3::ZERO, Vec3::Z, Vec3::new(2.0, 0.0, 1.0), Vec3::new(2.0, 0.0, 0.0)];
    assert_eq!(portal_of(&desc), Some(expected));
    let written = folder.path().join("written.pbrt");
    assert!(pbrt::write(&desc, &written).unwrap().losses.is_empty());
    assert_eq!(portal_of(&read(&written, &ReadOptions::default()).unwrap()), Some(expected));
    for (portal, told) in [
        ("\"string filename\" \"sky.pfm\" \"point3 portal\" [0 0 0  0 0 1  2 0 1]", "2:52 a `portal` has four points"),
        (
            "\"string filename\" \"sky.pfm\" \"point3 portal\" [0 0 0  0 0 1  2 0 1  2 0 0.5]",
            "2:1 a light's portal must be the four corners",
        ),
        ("\"string filename\" \"sky.pfm\" \"point3 portal\" [0 0 0  0 0 1  0 0 1  0 0 0]", "2:1 a light's portal must be the four corners"),
        (corners, "2:1 a `portal` needs a picture"),
    ] {
        let Err(ReadError::Invalid { faults, .. }) = parse(portal) else { panic!("{portal}") };
        let found = format!("{}:{} {}", faults[0].span.line, faults[0].span.column, faults[0].message);
        assert!(found.starts_with(told), "{found} instead of {told}");
    }
}

/// Full below, nothing but wisps above, and cut off by its box.
#[test]
fn clouds_are_grids() {
    let of = |more: &str| world(&format!("MakeNamedMedium \"m\" \"string type\" \"cloud\" \"rgb sigma_s\" [3 2 1] {more}"));
    let desc = of("\"float frequency\" 0.7 \"point3 p0\" [-1 0 -1] \"point3 p1\" [1 1 1]");
    assert!(desc.report.losses.is_empty() && desc.report.faults.is_empty());
    let volume = &desc.volumes[0].value;
    let [nx, ny, nz] = volume.size.map(|n| n as usize);
    assert_eq!((volume.data.len(), nx), (nx * ny * nz, nz));
    let mean = |y: usize| {
        let row = |z: usize| volume.data[(z * ny + y) * nx..][..nx].iter().map(|v| f64::from(*v)).sum::<f64>();
        (0..nz).map(row).sum::<f64>() / (nx * nz) as f64
    };
    let [bottom, middle, top] = [0, ny / 2 + 1, ny - 1].map(mean);
    assert!(bottom > 0.98 && (0.05..0.7).contains(&middle) && top < 0.02, "{bottom}, {middle}, {top}");
    assert!(volume.data.iter().all(|v| (0.0..=1.0).contains(v)));
    assert_eq!(volume.world_from_volume.transform_point3(Vec3::ZERO), Vec3::new(-1.0, 0.0, -1.0));
    for hostile in ["\"float frequency\" 1e38", "\"float wispiness\" 1e38 \"float frequency\" 1"] {
        assert!(of(hostile).volumes[0].value.data.iter().all(|v| (0.0..=1.0).contains(v)), "{hostile}");
    }
}

#[test]
fn realistic_cameras_have_their_lenses() {
    let folder = TempFolder::new("pbrt-lens");
    folder.put("lens.dat", "# r d n w\n100 1 1.5 60\n0 2 0 20 # stop\n-100 0 1 60\n");
    folder.put("three.dat", "1 2 3");
    folder.put("words.dat", "1 2\n3 four");
    folder.put("diverging.dat", "-100 1 1.5 60\n100 0 1 60\n");
    let text = |lens: &str, more: &str| {
        format!(
            "Camera \"realistic\" \"string lensfile\" \"{lens}\" {more}\nFilm \"rgb\" \"float diagonal\" 43\nWorldBegin Shape \"sphere\""
        )
    };
    let read_text = |text: &str| read(&folder.put("scene.pbrt", text), &ReadOptions::default());
    let desc = read_text(&text("lens.dat", "\"float aperturediameter\" 8 \"float focusdistance\" 3")).unwrap();
    let ProjectionDesc::Objective(objective) = &desc.cameras[0].value.projection else { panic!("{:?}", desc.cameras[0]) };
    let surface = |curvature_radius, thickness, ior, aperture_radius| LensInterface { curvature_radius, thickness, ior, aperture_radius };
    let wanted = [surface(0.1, 0.001, 1.5, 0.03), surface(0.0, 0.002, 1.0, 0.004), surface(-0.1, 0.0, 1.0, 0.03)];
    for (a, b) in objective.interfaces.iter().zip(&wanted) {
        let values = |i: &LensInterface| [i.curvature_radius, i.thickness, i.ior, i.aperture_radius];
        assert!(values(a).iter().zip(values(b)).all(|(a, b)| (a - b).abs() < 1e-6), "{a:?}");
    }
    assert!((objective.film_diagonal - 0.043).abs() < 1e-6 && objective.focus_distance == 3.0 && desc.report.losses.is_empty());
    let path = folder.path().join("again.pbrt");
    assert!(pbrt::write(&desc, &path).unwrap().losses.is_empty());
    let again = read(&path, &ReadOptions::default()).unwrap();
    let ProjectionDesc::Objective(second) = &again.cameras[0].value.projection else { panic!("{:?}", again.cameras[0]) };
    assert!(second.interfaces.len() == 3 && (second.film_distance().unwrap() - objective.film_distance().unwrap()).abs() < 1e-6);
    for (shape, stop) in [("star", StopShape::Star), ("stop.pgm", StopShape::Picture(ImageId(0)))] {
        folder.put("stop.pgm", "P2 1 1 1 1");
        let desc = read_text(&text("lens.dat", &format!("\"float aperturediameter\" 8 \"string aperture\" \"{shape}\""))).unwrap();
        let stop_of = |desc: &SceneDesc| match &desc.cameras[0].value.projection {
            ProjectionDesc::Objective(objective) => objective.stop,
            other => panic!("{other:?}"),
        };
        assert!(stop_of(&desc) == stop && desc.report.losses.is_empty());
        assert!(pbrt::write(&desc, &path).unwrap().losses.is_empty());
        assert_eq!(stop_of(&read(&path, &ReadOptions::default()).unwrap()), stop);
    }
    let message = |text: &str| read_text(text).unwrap_err().to_string();
    let near = "\"float focusdistance\" 0.2 \"float aperturediameter\" 8";
    for (lens, more, wanted) in [
        ("lens.dat", near, "cannot focus at 0.2"),
        ("three.dat", "", "3 numbers"),
        ("words.dat", "", "words.dat:2: `four` is no number"),
        ("diverging.dat", "", "does not gather light"),
        ("missing.dat", "", "missing.dat"),
        ("../../../../etc/passwd", "", "outside"),
    ] {
        let message = message(&text(lens, more));
        assert!(message.contains(wanted) && message.contains("scene.pbrt:1:1"), "{lens}: {message}");
    }
    let hexagon = message(&text("lens.dat", "\"string aperture\" \"hexagon\""));
    assert!(hexagon.contains("scene.pbrt:1:49: error: no file `hexagon`") && hexagon.lines().count() == 1, "{hexagon}");
    assert!(message("Camera \"realistic\" WorldBegin").contains("needs a `lensfile`"));
}
