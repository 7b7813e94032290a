//! Materials become scattering models, emission and media.

use super::Reader;
use crate::desc::{AddNode, BsdfDesc, BsdfId, Channel, Color, EmissionDesc, MediumDesc, MediumId, Node, PbrDesc, PhaseDesc, Scalar};
use crate::formats::gltf::json::{EMPTY, Value};

/// What tells one form of a material from another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct MaterialKey {
    /// Number of the material; `None` is glTF's default material.
    pub index: Option<usize>,
    /// The mesh has vertex colors.
    pub has_color: bool,
    /// The mesh has vertex alpha other than 1.
    pub has_alpha: bool,
}

/// What shapes of a material get.
#[derive(Clone, Debug)]
pub(super) struct Material {
    pub bsdf: BsdfId,
    pub emission: Option<EmissionDesc>,
    pub interior: Option<MediumId>,
}

/// KHR_materials_ior: 0 stands for an infinite refractive index, whose surface reflects everything at all angles.
const MIRROR_IOR: f32 = 0.0;

/// Widening of the step at the alpha cutoff: a power of two, so that scaling is exact.
const CUTOFF_SLOPE: f32 = 65536.0;

impl<'a> Reader<'a> {
    /// The material for shapes, made at its first use.
    pub(super) fn material(&mut self, key: MaterialKey) -> Material {
        if let Some(known) = self.materials.get(&key) {
            return known.clone();
        }
        // The default material is that of an empty object; any value without members will do.
        let at = key.index.and_then(|i| self.list("materials").get(i)).unwrap_or(&EMPTY);
        let material = self.load_material(at, key);
        self.materials.insert(key, material.clone());
        material
    }

    fn bsdf(&mut self, name: &str, at: &Value<'_>, bsdf: BsdfDesc) -> BsdfId {
        self.desc.add(Node::named(name, self.places.span_of(at), bsdf))
    }

    fn load_material(&mut self, at: &'a Value<'a>, key: MaterialKey) -> Material {
        let name = self.name(at);
        let (base_at, specular_glossiness) = match self.extension(at, "KHR_materials_pbrSpecularGlossiness") {
            Some(e) => (e, true),
            None => (self.object(at, "pbrMetallicRoughness").unwrap_or(&EMPTY), false),
        };
        let (factor_key, texture_key) =
            if specular_glossiness { ("diffuseFactor", "diffuseTexture") } else { ("baseColorFactor", "baseColorTexture") };
        let factor = self.floats::<4>(base_at, factor_key).unwrap_or([1.0; 4]).map(|f| f.max(0.0));
        let mut base_color = self.color_param(base_at, [factor[0], factor[1], factor[2]], texture_key);
        if key.has_color {
            let color = Color::Texture(self.attribute(at, "color"));
            base_color = self.product(at, base_color, color);
        }
        let opacity = self.opacity(at, base_at, factor[3], texture_key, key);

        let unlit = self.extension(at, "KHR_materials_unlit").is_some();
        let mut emission = self.emission(at);
        let mut interior = None;
        let mut bsdf = if unlit {
            // An unlit surface shows its base color whatever falls on it.
            emission = Some(base_color);
            self.bsdf(&name, at, BsdfDesc::Diffuse { reflectance: Color::gray(0.0), alpha: None })
        } else {
            let mut pbr = if specular_glossiness { self.specular_glossiness(base_at) } else { self.metallic_roughness(base_at) };
            pbr.base_color = base_color;
            self.extensions_of(at, &mut pbr);
            interior = self.volume(at, &mut pbr);
            let one_sided = pbr.transmission != Scalar::Constant(0.0);
            let mut id = self.bsdf(&name, at, BsdfDesc::Pbr(Box::new(pbr)));
            if let Some(info) = self.texture_info(at, "normalTexture") {
                let scale = self.float(info.at, "scale", 1.0);
                if let Some(texture) = self.bitmap(&info, false, Channel::Luminance) {
                    id = self.bsdf(&name, at, BsdfDesc::NormalMap { nested: id, texture, scale });
                }
            }
            if one_sided { id } else { self.bsdf(&name, at, BsdfDesc::TwoSided { front: id, back: id }) }
        };
        if let Some(opacity) = opacity {
            bsdf = self.bsdf(&name, at, BsdfDesc::Mask { nested: bsdf, opacity });
            emission = emission.map(|e| self.faded(at, e, opacity));
        }
        let emission = emission.map(|radiance| EmissionDesc { radiance, two_sided: true, group: String::new() });
        Material { bsdf, emission, interior }
    }

    /// The opacity of materials that are not opaque.
    fn opacity(&mut self, at: &'a Value<'a>, base_at: &'a Value<'a>, factor: f32, texture: &str, key: MaterialKey) -> Option<Scalar> {
        let mode = self.string(at, "alphaMode").unwrap_or("OPAQUE");
        if mode == "OPAQUE" {
            return None;
        }
        let mut alpha = self.scalar_param(base_at, factor.min(1.0), texture, Channel::A);
        if key.has_alpha {
            let vertex = Scalar::Texture(self.attribute(at, "alpha"));
            alpha = self.scalar_product(at, alpha, vertex);
        }
        let opacity = match mode {
            "BLEND" => alpha,
            "MASK" => {
                // 1 where alpha ≥ cutoff: a step so steep that no 16-bit alpha falls into it.
                let cutoff = self.float(at, "alphaCutoff", 0.5).max(0.0);
                self.affine(at, alpha, CUTOFF_SLOPE, 1.0 - cutoff * CUTOFF_SLOPE, Some([0.0, 1.0]))
            }
            other => {
                self.error(at, format!("unknown alphaMode `{other}`"));
                return None;
            }
        };
        (opacity != Scalar::Constant(1.0)).then_some(opacity)
    }

    fn emission(&mut self, at: &'a Value<'a>) -> Option<Color> {
        let mut factor = self.color(at, "emissiveFactor", [0.0; 3]);
        if let Some(e) = self.extension(at, "KHR_materials_emissive_strength") {
            let strength = self.float_in(e, "emissiveStrength", 1.0, [0.0, f32::MAX]);
            factor = factor.map(|f| (f * strength).min(f32::MAX));
        }
        if factor == [0.0; 3] {
            return None;
        }
        Some(self.color_param(at, factor, "emissiveTexture"))
    }

    fn metallic_roughness(&mut self, at: &'a Value<'a>) -> PbrDesc {
        let metallic = self.float_in(at, "metallicFactor", 1.0, [0.0, 1.0]);
        let roughness = self.float_in(at, "roughnessFactor", 1.0, [0.0, 1.0]);
        PbrDesc {
            metallic: self.scalar_param(at, metallic, "metallicRoughnessTexture", Channel::B),
            roughness: self.scalar_param(at, roughness, "metallicRoughnessTexture", Channel::G),
            ..PbrDesc::default()
        }
    }

    /// Specular–glossiness: a mirror-like index whose reflection the specular color scales, as KHR_materials_ior suggests.
    fn specular_glossiness(&mut self, at: &'a Value<'a>) -> PbrDesc {
        let specular = self.color(at, "specularFactor", [1.0; 3]);
        let glossiness = self.float_in(at, "glossinessFactor", 1.0, [0.0, 1.0]);
        let specular_color = self.color_param(at, specular, "specularGlossinessTexture");
        let gloss = self.scalar_param(at, glossiness, "specularGlossinessTexture", Channel::A);
        self.loss(at, "KHR_materials_pbrSpecularGlossiness", "rendered as metallic-roughness with a specular color");
        PbrDesc {
            metallic: Scalar::Constant(0.0),
            roughness: self.affine(at, gloss, -1.0, 1.0, None),
            ior: MIRROR_IOR,
            specular_color,
            ..PbrDesc::default()
        }
    }

    fn extensions_of(&mut self, at: &'a Value<'a>, pbr: &mut PbrDesc) {
        if let Some(e) = self.extension(at, "KHR_materials_ior") {
            pbr.ior = match self.float(e, "ior", 1.5) {
                0.0 => MIRROR_IOR,
                ior if ior < 1.0 => self.float_in(e, "ior", 1.5, [1.0, f32::MAX]),
                ior => ior,
            };
        }
        if let Some(e) = self.extension(at, "KHR_materials_specular") {
            let specular = self.float_in(e, "specularFactor", 1.0, [0.0, 1.0]);
            pbr.specular = self.scalar_param(e, specular, "specularTexture", Channel::A);
            let color = self.color(e, "specularColorFactor", [1.0; 3]);
            pbr.specular_color = self.color_param(e, color, "specularColorTexture");
        }
        if let Some(e) = self.extension(at, "KHR_materials_transmission") {
            let factor = self.float_in(e, "transmissionFactor", 0.0, [0.0, 1.0]);
            pbr.transmission =
                if factor == 0.0 { Scalar::Constant(0.0) } else { self.scalar_param(e, factor, "transmissionTexture", Channel::R) };
        }
        if let Some(e) = self.extension(at, "KHR_materials_dispersion") {
            pbr.dispersion = self.float_in(e, "dispersion", 0.0, [0.0, f32::MAX]);
        }
        if let Some(e) = self.extension(at, "KHR_materials_clearcoat") {
            let factor = self.float_in(e, "clearcoatFactor", 0.0, [0.0, 1.0]);
            if factor > 0.0 {
                pbr.clearcoat = self.scalar_param(e, factor, "clearcoatTexture", Channel::R);
                let roughness = self.float_in(e, "clearcoatRoughnessFactor", 0.0, [0.0, 1.0]);
                pbr.clearcoat_roughness = self.scalar_param(e, roughness, "clearcoatRoughnessTexture", Channel::G);
                if let Some(info) = self.texture_info(e, "clearcoatNormalTexture") {
                    let scale = self.float(info.at, "scale", 1.0);
                    pbr.clearcoat_normal = self.bitmap(&info, false, Channel::Luminance).map(|t| (t, scale));
                }
            }
        }
        if let Some(e) = self.extension(at, "KHR_materials_sheen") {
            let color = self.color(e, "sheenColorFactor", [0.0; 3]);
            if color != [0.0; 3] {
                pbr.sheen_color = self.color_param(e, color, "sheenColorTexture");
                let roughness = self.float_in(e, "sheenRoughnessFactor", 0.0, [0.0, 1.0]);
                pbr.sheen_roughness = self.scalar_param(e, roughness, "sheenRoughnessTexture", Channel::A);
            }
        }
        if let Some(e) = self.extension(at, "KHR_materials_anisotropy") {
            let strength = self.float_in(e, "anisotropyStrength", 0.0, [0.0, 1.0]);
            pbr.anisotropy = Scalar::Constant(strength);
            pbr.anisotropy_rotation = self.float(e, "anisotropyRotation", 0.0);
            if let (true, Some(info)) = (strength > 0.0, self.texture_info(e, "anisotropyTexture")) {
                pbr.anisotropy_direction = self.bitmap(&info, false, Channel::Luminance);
            }
        }
        if let Some(e) = self.extension(at, "KHR_materials_iridescence") {
            let factor = self.float_in(e, "iridescenceFactor", 0.0, [0.0, 1.0]);
            if factor > 0.0 {
                pbr.iridescence = self.scalar_param(e, factor, "iridescenceTexture", Channel::R);
                pbr.iridescence_ior = self.float_in(e, "iridescenceIor", 1.3, [1.0, f32::MAX]);
                let min = self.float_in(e, "iridescenceThicknessMinimum", 100.0, [0.0, f32::MAX]);
                let max = self.float_in(e, "iridescenceThicknessMaximum", 400.0, [0.0, f32::MAX]);
                let share = self.scalar_param(e, 1.0, "iridescenceThicknessTexture", Channel::G);
                pbr.iridescence_thickness_nm = self.affine(e, share, max - min, min, None);
            }
        }
    }

    /// A volume under the surface: refraction, and absorption as a medium.
    fn volume(&mut self, at: &'a Value<'a>, pbr: &mut PbrDesc) -> Option<MediumId> {
        let e = self.extension(at, "KHR_materials_volume")?;
        if pbr.transmission == Scalar::Constant(0.0) || self.float(e, "thicknessFactor", 0.0) <= 0.0 {
            return None;
        }
        pbr.volume = true;
        let distance = self.float_opt(e, "attenuationDistance").filter(|d| *d > 0.0)?;
        let color = self.color(e, "attenuationColor", [1.0; 3]);
        // Beer–Lambert: color = exp(−σ_a · distance). Black would absorb all at once; a millionth is black enough.
        let sigma_a = color.map(|c| (-f64::from(c.clamp(1e-6, 1.0)).ln() / f64::from(distance)).min(f64::from(f32::MAX)) as f32);
        if sigma_a == [0.0; 3] {
            return None;
        }
        let medium = MediumDesc::Homogeneous { sigma_a, sigma_s: [0.0; 3], emission: [0.0; 3], phase: PhaseDesc::Isotropic };
        let node = Node::named(self.name(at), self.span(e), medium);
        Some(self.desc.add(node))
    }
}
