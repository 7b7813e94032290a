//! The writer: what was read can be written and read again.

use std::path::Path;

use etendue_scene::SceneDesc;
use etendue_scene::desc::{
    AddNode, BsdfDesc, CameraDesc, Color, EmissionDesc, FovAxis, GeometryDesc, ImageDesc, ImageSource, LightDesc, MeshAttribute, MeshData,
    MeshDesc, Node, ProjectionDesc, Roughness, Scalar, ShapeDesc, TextureDesc,
};
use etendue_scene::formats::{ReadOptions, gltf};
use glam::{Mat4, Vec2, Vec3};
use serde_json::{Value, json};

use crate::build::{Build, F32, PNG, f32s, mesh_of};

fn read(bytes: &[u8]) -> SceneDesc {
    gltf::read_bytes(bytes, Path::new("test.glb"), &ReadOptions::default()).unwrap()
}

/// The JSON of a GLB.
fn json_of(glb: &[u8]) -> Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

/// A description as JSON without places.
fn plain(desc: &SceneDesc) -> Value {
    fn strip(v: &mut Value) {
        match v {
            Value::Object(m) => {
                m.remove("span");
                m.values_mut().for_each(strip);
            }
            Value::Array(a) => a.iter_mut().for_each(strip),
            _ => {}
        }
    }
    let mut v = serde_json::to_value(desc).unwrap();
    strip(&mut v);
    v
}

/// Writes what a file describes, reads it again and compares; returns the written JSON.
fn round_trip(desc: &SceneDesc) -> Value {
    let (first, losses) = gltf::write_glb(desc).unwrap();
    assert_eq!(losses, []);
    let again = read(&first);
    let (a, b) = (plain(desc), plain(&again));
    for part in ["bsdfs", "textures", "images", "media", "meshes", "shapes", "groups", "instances", "lights", "cameras"] {
        assert_eq!(a[part], b[part], "{part}");
    }
    assert_eq!(gltf::write_glb(&again).unwrap().0, first);
    json_of(&first)
}

#[test]
fn a_material_with_everything() {
    let texture = json!({"index": 0});
    let turned = json!({"index": 0, "texCoord": 1, "extensions": {"KHR_texture_transform":
        {"offset": [0.25, 0.5], "rotation": 0.5, "scale": [2, 3]}}});
    let mut b = Build::triangle().with_material(json!({"name": "all", "alphaMode": "BLEND",
    "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1, 0.5], "baseColorTexture": texture, "metallicFactor": 0.5,
        "metallicRoughnessTexture": turned},
    "normalTexture": {"index": 0, "scale": 0.5}, "emissiveFactor": [1, 0.5, 0.25], "emissiveTexture": texture,
    "extensions": {
        "KHR_materials_ior": {"ior": 1.25},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [2, 1, 0], "specularTexture": texture},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.75, "clearcoatRoughnessTexture": texture,
            "clearcoatRoughnessFactor": 0.5, "clearcoatNormalTexture": {"index": 0, "scale": 2}},
        "KHR_materials_sheen": {"sheenColorFactor": [0.125, 0.25, 0.5], "sheenRoughnessFactor": 0.5},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.5, "anisotropyRotation": 1, "anisotropyTexture": texture},
        "KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceIor": 1.75, "iridescenceThicknessMinimum": 200,
            "iridescenceThicknessMaximum": 600, "iridescenceThicknessTexture": texture},
        "KHR_materials_emissive_strength": {"emissiveStrength": 8},
    }}));
    let uv = b.accessor(&f32s(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]), F32, "VEC2", 3);
    b.primitive()["attributes"]["TEXCOORD_0"] = json!(uv);
    b.primitive()["attributes"]["TEXCOORD_1"] = json!(uv);
    let desc = b.read();
    let (first, losses) = gltf::write_glb(&desc).unwrap();
    assert_eq!(losses, []);
    let original = b.json["materials"][0].clone();
    let mut written = json_of(&first)["materials"][0].clone();
    assert_eq!(written["doubleSided"], true);
    // The transform is recomputed: equal but for rounding.
    let pointer = "/pbrMetallicRoughness/metallicRoughnessTexture/extensions/KHR_texture_transform";
    let transform = std::mem::take(written.pointer_mut(pointer).unwrap());
    for (key, expected) in [("offset", [0.25, 0.5]), ("scale", [2.0, 3.0])] {
        for i in 0..2 {
            assert!((transform[key][i].as_f64().unwrap() - expected[i]).abs() < 1e-5, "{transform}");
        }
    }
    assert!((transform["rotation"].as_f64().unwrap() - 0.5).abs() < 1e-5);
    fn check(original: &Value, written: &Value, path: &str) {
        match original {
            Value::Object(m) => {
                m.iter().filter(|(k, _)| *k != "KHR_texture_transform").for_each(|(k, v)| check(v, &written[k], &format!("{path}/{k}")))
            }
            Value::Array(a) => a.iter().enumerate().for_each(|(i, v)| check(v, &written[i], &format!("{path}/{i}"))),
            Value::Number(n) => assert_eq!(n.as_f64(), written.as_f64(), "{path}"),
            other => assert_eq!(other, written, "{path}"),
        }
    }
    check(&original, &written, "");
}

#[test]
fn meshes_cameras_lights_and_volumes() {
    let mut b = Build::triangle()
        .with_material(json!({"name": "glass", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [0.36787945, 1, 1]}}}));
    for (name, width, values) in [
        ("NORMAL", "VEC3", [0.0, 0.0, 1.0].repeat(3)),
        ("TANGENT", "VEC4", [1.0, 0.0, 0.0, -1.0].repeat(3)),
        ("TEXCOORD_0", "VEC2", [0.25, 0.5].repeat(3)),
    ] {
        let a = b.accessor(&f32s(&values), F32, width, 3);
        b.primitive()["attributes"][name] = json!(a);
    }
    b.json["nodes"][0] = json!({"name": "pane", "mesh": 0, "translation": [1, 2, 3]});
    b.push("cameras", json!({"name": "cam", "type": "perspective", "perspective": {"yfov": 0.75, "znear": 0.125, "aspectRatio": 2}}));
    b.node(json!({"camera": 0, "translation": [0, 0, 4]}));
    b.push("cameras", json!({"name": "plan", "type": "orthographic", "orthographic": {"xmag": 2, "ymag": 1, "znear": 0, "zfar": 100}}));
    b.node(json!({"camera": 1}));
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"name": "sun", "type": "directional", "intensity": 683}, {"name": "lamp", "type": "spot", "spot": {"outerConeAngle": 0.5}}]}});
    b.node(json!({"extensions": {"KHR_lights_punctual": {"light": 0}}}));
    b.node(json!({"extensions": {"KHR_lights_punctual": {"light": 1}}, "translation": [0, 5, 0]}));
    let written = round_trip(&b.read());
    assert_eq!(written["extensionsUsed"], json!(["KHR_lights_punctual", "KHR_materials_transmission", "KHR_materials_volume"]));
    assert_eq!(written["accessors"][0]["max"], json!([1.0, 1.0, 0.0]));
}

#[test]
fn instances_stay_instances() {
    let mut b = Build::new();
    let p: Vec<f32> = (0..3 * 3 * 1001).map(|i| (i % 7) as f32).collect();
    let position = b.accessor(&f32s(&p), F32, "VEC3", 3 * 1001);
    let primitive = json!({"attributes": {"POSITION": position}});
    b.push("meshes", json!({"name": "big", "primitives": [primitive, primitive]}));
    b.node(json!({"mesh": 0, "name": "big"}));
    b.node(json!({"mesh": 0, "name": "two", "translation": [1, 2, 3]}));
    let desc = b.read();
    let again = read(&gltf::write_glb(&desc).unwrap().0);
    assert_eq!((again.groups.len(), again.instances.len(), again.shapes.len()), (1, 2, 2));
    assert_eq!(again.instances[1].value.world_from_object, desc.instances[1].value.world_from_object);
}

#[test]
fn samples_survive() {
    for name in ["helmet.glb", "golf.glb"] {
        let Some(path) = crate::samples::sample(name) else { continue };
        let desc = gltf::read(&path, &ReadOptions::default()).unwrap();
        let (first, losses) = gltf::write_glb(&desc).unwrap();
        assert_eq!(losses, []);
        let again = read(&first);
        let counts = |d: &SceneDesc| [d.shapes.len(), d.images.len(), d.meshes.len(), d.bsdfs.len(), d.cameras.len()];
        assert_eq!(counts(&again), counts(&desc));
        for (a, b) in desc.shapes.iter().zip(&again.shapes) {
            let (ma, mb) = (mesh_of(&desc, &a.value), mesh_of(&again, &b.value));
            assert_eq!((&ma.positions, &ma.normals, &ma.triangles), (&mb.positions, &mb.normals, &mb.triangles));
            assert!(ma.uvs.iter().zip(&mb.uvs).all(|(a, b)| (*a - *b).length() < 1e-6));
            assert_eq!(a.value.world_from_object, b.value.world_from_object);
            assert_eq!(a.value.emission, b.value.emission);
        }
        assert!(gltf::write_glb(&again).unwrap().0 == first, "{name}: writing what was written changes it");
    }
}

/// A scene as another format may describe it.
fn foreign() -> SceneDesc {
    let span = Default::default();
    let mut d = SceneDesc::new("mitsuba", "scene.xml");
    let image = d.add(Node::new(
        span,
        ImageDesc { source: ImageSource::Pixels { width: 2, height: 1, channels: 3, data: vec![0.0, 0.5, 1.0, 0.25, 0.5, 2.0] } },
    ));
    let bitmap = d.add(Node::new(
        span,
        TextureDesc::Bitmap(etendue_scene::desc::BitmapDesc {
            image,
            encoding: Default::default(),
            wrap: Default::default(),
            filter: Default::default(),
            picture_from_uv: glam::Mat3::from_scale(Vec2::new(4.0, 2.0)),
            channel: Default::default(),
            uv_set: 0,
        }),
    ));
    let rough = Roughness { distribution: Default::default(), alpha_u: Scalar::Constant(0.25), alpha_v: Scalar::Constant(0.25) };
    let matt = d.add(Node::named("matt", span, BsdfDesc::Diffuse { reflectance: Color::Texture(bitmap), alpha: None }));
    let metal = d.add(Node::named(
        "metal",
        span,
        BsdfDesc::Conductor {
            eta: Some(Color::gray(0.2)),
            k: Color::gray(3.0),
            specular_reflectance: Color::gray(1.0),
            roughness: Some(rough),
        },
    ));
    let glass = d.add(Node::named(
        "glass",
        span,
        BsdfDesc::Dielectric {
            int_ior: 1.5,
            ext_ior: 1.0,
            specular_reflectance: Color::gray(1.0),
            specular_transmittance: Color::gray(1.0),
            roughness: None,
        },
    ));
    let null = d.add(Node::named("null", span, BsdfDesc::Null));
    let shape = |geometry, bsdf| {
        let mut s = ShapeDesc::new(geometry, Mat4::from_translation(Vec3::Y));
        s.bsdf = Some(bsdf);
        s
    };
    let mut lamp = shape(GeometryDesc::Rectangle, matt);
    lamp.emission = Some(EmissionDesc { radiance: Color::Constant([5.0, 10.0, 20.0]), two_sided: false, group: String::new() });
    let others = [
        lamp,
        shape(GeometryDesc::Sphere { center: Vec3::ZERO, radius: 1.0 }, glass),
        shape(GeometryDesc::Cube, metal),
        shape(GeometryDesc::Disk, null),
        shape(GeometryDesc::Plane, matt),
        shape(GeometryDesc::Cylinder { p0: Vec3::ZERO, p1: Vec3::Y, radius: 0.5 }, matt),
    ];
    for s in others {
        d.add(Node::new(span, s));
    }
    let data = MeshData {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        triangles: vec![[0, 1, 2]],
        attributes: vec![MeshAttribute { name: "heat".to_owned(), per_face: true, width: 1, data: vec![1.0] }],
        ..MeshData::default()
    };
    let mesh = d.add(Node::new(span, MeshDesc { file: None, flip_v: false, data: Some(data) }));
    let mut smooth = ShapeDesc::new(GeometryDesc::Mesh { mesh, face_normals: false, smooth: true }, Mat4::IDENTITY);
    smooth.flip_normals = true;
    d.add(Node::named("smooth", span, smooth));
    d.add(Node::new(span, LightDesc::Constant { radiance: [1.0; 3] }));
    d.add(Node::new(
        span,
        CameraDesc {
            world_from_camera: Mat4::IDENTITY,
            projection: ProjectionDesc::Perspective {
                fov_rad: std::f32::consts::FRAC_PI_2,
                fov_axis: FovAxis::X,
                aperture_radius: 0.1,
                focus_distance: 1.0,
                principal_point_offset: [0.0; 2],
            },
            near: 0.01,
            far: 1e4,
            medium: None,
        },
    ));
    (d.film.width, d.film.height) = (Some(200), Some(100));
    d
}

#[test]
fn other_formats_are_approximated_with_their_losses() {
    let (bytes, losses) = gltf::write_glb(&foreign()).unwrap();
    let mut features: Vec<_> = losses.iter().map(|l| l.feature.as_str()).collect();
    features.sort_unstable();
    let expected = [
        "analytic shape",
        "conductor",
        "constant environment",
        "depth of field",
        "dielectric",
        "face attribute `heat`",
        "infinite plane",
        "light from one side",
        "picture with values above 1",
    ];
    assert_eq!(features, expected);
    let desc = read(&bytes);
    assert_eq!(desc.shapes.len(), 7);
    let emission = desc.shapes[0].value.emission.as_ref().unwrap();
    assert_eq!(emission.radiance, Color::Constant([5.0, 10.0, 20.0]));
    let ProjectionDesc::Perspective { fov_rad, fov_axis: FovAxis::Y, .. } = desc.cameras[0].value.projection else { panic!() };
    assert!((f64::from(fov_rad) - 2.0 * 0.5f64.atan()).abs() < 1e-6);
    let pbr = |name: &str| {
        desc.bsdfs.iter().find_map(|b| if let (BsdfDesc::Pbr(p), true) = (&b.value, b.name == name) { Some(p) } else { None }).unwrap()
    };
    assert_eq!((pbr("metal").metallic, pbr("metal").roughness), (Scalar::Constant(1.0), Scalar::Constant(0.5)));
    assert_eq!((pbr("glass").transmission, pbr("glass").volume), (Scalar::Constant(1.0), true));
    assert_eq!((pbr("matt").specular, pbr("matt").metallic), (Scalar::Constant(0.0), Scalar::Constant(0.0)));
    assert!(desc.bsdfs.iter().any(|b| matches!(b.value, BsdfDesc::Mask { opacity: Scalar::Constant(0.0), .. })));
    // The flipped and smoothed triangle.
    let smooth = mesh_of(&desc, &desc.shapes.iter().find(|s| s.name == "smooth").unwrap().value);
    assert_eq!((smooth.triangles[0], smooth.normals[0]), ([0, 2, 1], -Vec3::Z));
    let ImageSource::Embedded(png) = &desc.images[0].value.source else { panic!() };
    assert!(png.starts_with(&PNG[..8]));
    assert!(matches!(&desc.textures[0].value, TextureDesc::Bitmap(b) if b.picture_from_uv.x_axis.x == 4.0));
}

#[test]
fn gltf_with_its_data_beside_it() {
    let folder = std::env::temp_dir().join(format!("etendue-gltf-write-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for name in ["out.gltf", "out.glb"] {
        let path = folder.join(name);
        gltf::write(&foreign(), &path).unwrap();
        assert_eq!(gltf::read(&path, &ReadOptions::default()).unwrap().shapes.len(), 7);
    }
    assert!(folder.join("out.bin").is_file());
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(gltf::write(&foreign(), &folder.join("no/such/folder.glb")).is_err());
}
