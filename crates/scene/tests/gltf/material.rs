//! Materials, textures, emission.

use etendue_scene::SceneDesc;
use etendue_scene::desc::{
    BitmapDesc, BsdfDesc, Channel, Color, Encoding, ImageSource, MediumDesc, Scalar, TextureDesc, TextureFilter, TextureId, Wrap,
};
use etendue_scene::formats::ReadOptions;
use serde_json::json;

use crate::build::{Build, F32, PNG, f32s};

fn bitmap(desc: &SceneDesc, id: TextureId) -> &BitmapDesc {
    match &desc[id].value {
        TextureDesc::Bitmap(b) => b,
        other => panic!("{other:?}"),
    }
}

/// Factor and picture of a scalar that is a scaled picture.
fn scaled(desc: &SceneDesc, s: Scalar) -> (f32, &BitmapDesc) {
    let Scalar::Texture(id) = s else { panic!("{s:?}") };
    match &desc[id].value {
        TextureDesc::Affine { texture, scale, .. } => (*scale, bitmap(desc, *texture)),
        _ => (1.0, bitmap(desc, id)),
    }
}

fn only_pbr(desc: &SceneDesc) -> &etendue_scene::desc::PbrDesc {
    desc.bsdfs.iter().find_map(|b| if let BsdfDesc::Pbr(p) = &b.value { Some(&**p) } else { None }).unwrap()
}

#[test]
fn the_default_material_is_a_rough_white_metal_on_both_sides() {
    let desc = Build::triangle().read();
    let BsdfDesc::TwoSided { front, back } = desc[desc.shapes[0].value.bsdf.unwrap()].value else { panic!() };
    assert_eq!(front, back);
    let pbr = only_pbr(&desc);
    assert_eq!((pbr.metallic, pbr.roughness, pbr.base_color), (Scalar::Constant(1.0), Scalar::Constant(1.0), Color::gray(1.0)));
}

#[test]
fn metallic_roughness_with_textures() {
    let mut b = Build::triangle().with_material(json!({
        "name": "brass",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 1, 1, 1], "baseColorTexture": {"index": 0},
            "metallicFactor": 1, "roughnessFactor": 0.25, "metallicRoughnessTexture": {"index": 0},
        },
        "normalTexture": {"index": 0, "scale": 0.5},
        "occlusionTexture": {"index": 0},
    }));
    b.push("samplers", json!({"wrapS": 33071, "wrapT": 33648, "minFilter": 9987, "magFilter": 9729}));
    b.json["textures"][0]["sampler"] = json!(0);
    let desc = b.read();
    let pbr = only_pbr(&desc);
    let (metallic, roughness) = (scaled(&desc, pbr.metallic), scaled(&desc, pbr.roughness));
    assert_eq!((metallic.0, metallic.1.channel, metallic.1.encoding), (1.0, Channel::B, Encoding::Linear));
    assert_eq!((roughness.0, roughness.1.channel), (0.25, Channel::G));
    assert_eq!((roughness.1.wrap, roughness.1.filter), ([Wrap::Clamp, Wrap::Mirror], TextureFilter::Trilinear));
    let Color::Texture(base) = pbr.base_color else { panic!() };
    let TextureDesc::Multiply { a, b: Color::Texture(picture) } = desc[base].value else { panic!() };
    assert_eq!((a, bitmap(&desc, picture).encoding), (Color::Constant([0.5, 1.0, 1.0]), Encoding::Srgb));
    assert!(desc.bsdfs.iter().any(|b| matches!(b.value, BsdfDesc::NormalMap { scale: 0.5, .. }) && b.name == "brass"));
    // One picture, whatever it is used for.
    assert_eq!(desc.images.len(), 1);
    assert_eq!(desc.images[0].value.source, ImageSource::Embedded(PNG.to_vec()));
    assert!(desc.report.losses.is_empty() && desc.report.faults.is_empty());
}

#[test]
fn samplers() {
    for (sampler, filter) in [
        (json!({}), TextureFilter::Trilinear),
        (json!({"minFilter": 9729}), TextureFilter::Bilinear),
        (json!({"minFilter": 9728, "magFilter": 9728}), TextureFilter::Nearest),
    ] {
        let mut b = Build::triangle().with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        b.push("samplers", sampler);
        b.json["textures"][0]["sampler"] = json!(0);
        let desc = b.read();
        assert_eq!(bitmap(&desc, TextureId(0)).filter, filter);
        assert_eq!(bitmap(&desc, TextureId(0)).wrap, [Wrap::Repeat; 2]);
    }
}

#[test]
fn all_extensions_of_the_material() {
    let texture = json!({"index": 0, "texCoord": 1});
    let b = Build::triangle().with_material(json!({"extensions": {
        "KHR_materials_ior": {"ior": 1.33},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [2, 1, 0], "specularTexture": texture},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.5, "clearcoatRoughnessTexture": texture,
            "clearcoatNormalTexture": {"index": 0, "scale": 2}},
        "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.2, 0.3], "sheenRoughnessFactor": 0.5, "sheenRoughnessTexture": texture},
        "KHR_materials_anisotropy": {"anisotropyStrength": 0.6, "anisotropyRotation": 1, "anisotropyTexture": texture},
        "KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceIor": 1.8, "iridescenceThicknessMinimum": 200,
            "iridescenceThicknessMaximum": 600, "iridescenceThicknessTexture": texture},
        "KHR_materials_dispersion": {"dispersion": 0.1},
        "KHR_materials_emissive_strength": {"emissiveStrength": 5},
    }, "emissiveFactor": [1, 0.5, 0], "emissiveTexture": texture}));
    let desc = b.read();
    let pbr = only_pbr(&desc);
    assert_eq!((pbr.ior, pbr.dispersion, pbr.clearcoat), (1.33, 0.1, Scalar::Constant(0.75)));
    let specular = scaled(&desc, pbr.specular);
    assert_eq!((specular.0, specular.1.channel, specular.1.uv_set), (0.5, Channel::A, 1));
    assert_eq!(pbr.specular_color, Color::Constant([2.0, 1.0, 0.0]));
    assert_eq!(scaled(&desc, pbr.clearcoat_roughness).1.channel, Channel::G);
    assert_eq!(pbr.clearcoat_normal.unwrap().1, 2.0);
    assert_eq!((pbr.sheen_color, scaled(&desc, pbr.sheen_roughness).1.channel), (Color::Constant([0.1, 0.2, 0.3]), Channel::A));
    assert_eq!((pbr.anisotropy, pbr.anisotropy_rotation), (Scalar::Constant(0.6), 1.0));
    assert!(pbr.anisotropy_direction.is_some());
    let Scalar::Texture(thickness) = pbr.iridescence_thickness_nm else { panic!() };
    let TextureDesc::Affine { texture, scale: 400.0, offset: 200.0, clamp: None } = desc[thickness].value else { panic!() };
    assert_eq!(bitmap(&desc, texture).channel, Channel::G);
    assert_eq!((pbr.iridescence, pbr.iridescence_ior), (Scalar::Constant(1.0), 1.8));
    let Color::Texture(emission) = desc.shapes[0].value.emission.as_ref().unwrap().radiance else { panic!() };
    let TextureDesc::Multiply { a, .. } = desc[emission].value else { panic!() };
    assert_eq!(a, Color::Constant([5.0, 2.5, 0.0]));
}

#[test]
fn glass_with_a_colored_inside() {
    let b = Build::triangle().with_material(json!({"extensions": {
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 2, "attenuationColor": [0.5, 1, 0]},
    }}));
    let desc = b.read();
    let shape = &desc.shapes[0].value;
    // A boundary is not two-sided.
    let BsdfDesc::Pbr(pbr) = &desc[shape.bsdf.unwrap()].value else { panic!() };
    assert!(pbr.volume && pbr.transmission == Scalar::Constant(1.0));
    let MediumDesc::Homogeneous { sigma_a, sigma_s, .. } = &desc[shape.interior.unwrap()].value else { panic!("homogeneous") };
    assert!((sigma_a[0] - 2.0f32.recip() * std::f32::consts::LN_2).abs() < 1e-6);
    assert!(sigma_a[1] == 0.0 && sigma_a[2] > 5.0 && *sigma_s == [0.0; 3]);
    // Thin-walled without thickness.
    let b = Build::triangle().with_material(json!({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.5},
        "KHR_materials_volume": {"attenuationDistance": 2, "attenuationColor": [0.5, 1, 0]}}}));
    let desc = b.read();
    assert!(!only_pbr(&desc).volume && desc.shapes[0].value.interior.is_none());
}

#[test]
fn alpha() {
    let material = |mode: &str| {
        json!({"alphaMode": mode, "alphaCutoff": 0.25, "pbrMetallicRoughness":
        {"baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": 0}}})
    };
    let opacity = |desc: &SceneDesc| match desc[desc.shapes[0].value.bsdf.unwrap()].value {
        BsdfDesc::Mask { opacity, .. } => Some(opacity),
        _ => None,
    };
    assert_eq!(opacity(&Build::triangle().with_material(material("OPAQUE")).read()), None);
    let desc = Build::triangle().with_material(material("BLEND")).read();
    let (factor, picture) = scaled(&desc, opacity(&desc).unwrap());
    assert_eq!((factor, picture.channel), (0.5, Channel::A));

    let desc = Build::triangle().with_material(material("MASK")).read();
    let Some(Scalar::Texture(step)) = opacity(&desc) else { panic!() };
    let TextureDesc::Affine { scale, offset, clamp: Some([low, high]), .. } = desc[step].value else { panic!() };
    let step = |alpha: f32| (scale * alpha + offset).clamp(low, high);
    assert_eq!([step(0.0), step(0.2499), step(0.25), step(0.2501), step(1.0)], [0.0, 0.0, 1.0, 1.0, 1.0]);

    // Constant alpha is decided at once.
    let constant =
        |cutoff: f32| json!({"alphaMode": "MASK", "alphaCutoff": cutoff, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5]}});
    assert_eq!(opacity(&Build::triangle().with_material(constant(0.6)).read()), Some(Scalar::Constant(0.0)));
    assert_eq!(opacity(&Build::triangle().with_material(constant(0.4)).read()), None);
}

#[test]
fn emission_fades_with_alpha() {
    let b = Build::triangle().with_material(json!({"alphaMode": "BLEND", "emissiveFactor": [1, 1, 1],
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25]}}));
    assert_eq!(b.read().shapes[0].value.emission.as_ref().unwrap().radiance, Color::gray(0.25));
}

#[test]
fn unlit_surfaces_shine_in_their_base_color() {
    let b = Build::triangle().with_material(json!({"pbrMetallicRoughness": {"baseColorFactor": [0.25, 0.5, 1, 1]},
        "extensions": {"KHR_materials_unlit": {}}}));
    let desc = b.read();
    let shape = &desc.shapes[0].value;
    assert_eq!(shape.emission.as_ref().unwrap().radiance, Color::Constant([0.25, 0.5, 1.0]));
    assert!(matches!(desc[shape.bsdf.unwrap()].value, BsdfDesc::Diffuse { reflectance, .. } if reflectance == Color::gray(0.0)));
}

#[test]
fn vertex_colors_only_where_the_mesh_has_them() {
    let mut b = Build::triangle().with_material(json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}}));
    let color = b.accessor(&f32s(&[0.5; 9]), F32, "VEC3", 3);
    let mut colored = b.primitive().clone();
    colored["attributes"]["COLOR_0"] = json!(color);
    b.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(colored);
    let desc = b.read();
    let colors: Vec<_> =
        desc.bsdfs.iter().filter_map(|b| if let BsdfDesc::Pbr(p) = &b.value { Some(p.base_color) } else { None }).collect();
    assert_eq!(colors[0], Color::gray(0.5));
    let Color::Texture(product) = colors[1] else { panic!() };
    assert!(matches!(desc[product].value, TextureDesc::Multiply { a, .. } if a == Color::gray(0.5)));
}

#[test]
fn specular_glossiness_is_converted() {
    let b = Build::triangle().with_material(json!({"extensions": {"KHR_materials_pbrSpecularGlossiness":
        {"diffuseFactor": [0.1, 0.2, 0.3, 1], "specularFactor": [0.4, 0.5, 0.6], "glossinessFactor": 0.75}}}));
    let pbr = b.pbr();
    assert_eq!((pbr.base_color, pbr.specular_color), (Color::Constant([0.1, 0.2, 0.3]), Color::Constant([0.4, 0.5, 0.6])));
    assert_eq!((pbr.metallic, pbr.roughness, pbr.ior), (Scalar::Constant(0.0), Scalar::Constant(0.25), 0.0));
    assert_eq!(b.read().report.losses[0].feature, "KHR_materials_pbrSpecularGlossiness");
}

#[test]
fn variants() {
    let mut b = Build::triangle().with_material(json!({"name": "plain"}));
    b.push("materials", json!({"name": "gold"}));
    b.json["extensions"] = json!({"KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}});
    b.primitive()["extensions"] = json!({"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [1]}]}});
    let name = |variant: Option<&str>| {
        let options = ReadOptions { variant: variant.map(str::to_owned), ..ReadOptions::default() };
        b.read_with(&options).map(|d| d.bsdfs[0].name.clone()).map_err(|e| e.to_string())
    };
    assert_eq!(name(None).unwrap(), "plain");
    assert_eq!(name(Some("day")).unwrap(), "plain");
    assert_eq!(name(Some("night")).unwrap(), "gold");
    assert_eq!(name(Some("1")).unwrap(), "gold");
    assert!(name(Some("dusk")).unwrap_err().contains("no material variant `dusk`; there are: day, night"));
}

#[test]
fn pictures_that_cannot_be_decoded_are_losses() {
    let mut b = Build::triangle().with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    b.json["textures"][0] = json!({"extensions": {"EXT_texture_avif": {"source": 0}}});
    let desc = b.read();
    assert_eq!(desc.report.losses[0].feature, "EXT_texture_avif");
    assert_eq!(only_pbr(&desc).base_color, Color::gray(1.0));
    // With a picture beside it there is nothing to lose.
    b.json["textures"][0]["source"] = json!(0);
    assert!(b.read().report.losses.is_empty());
    for name in ["EXT_texture_webp", "KHR_texture_basisu"] {
        b.json["textures"][0] = json!({"extensions": {name: {"source": 0}}});
        let desc = b.read();
        assert_eq!((desc.images.len(), desc.report.losses.len()), (1, 0));
    }
}

#[test]
fn factors_out_of_range_are_clamped_with_a_warning() {
    let b = Build::triangle().with_material(json!({"pbrMetallicRoughness": {"roughnessFactor": 2}}));
    let desc = b.read();
    assert_eq!(only_pbr(&desc).roughness, Scalar::Constant(1.0));
    assert_eq!(desc.report.faults[0].message, "/materials/0/pbrMetallicRoughness/roughnessFactor: 2 is outside [0, 1]; taken as 1");
    let b = Build::triangle().with_material(json!({"pbrMetallicRoughness": {"roughnessFactor": "rough"}}));
    assert!(b.error().contains("/materials/0/pbrMetallicRoughness/roughnessFactor: expected a number"));
}
