//! Materials: everything becomes metallic-roughness with extensions.

use serde_json::{Map, Value, json};

use super::Writer;
use super::texture::ColorParts;
use crate::desc::{
    BitmapDesc, BsdfDesc, BsdfId, Channel, Color, MediumDesc, MicrofacetKind, PbrDesc, Roughness, Scalar, ShapeDesc, TextureId,
};
use crate::span::Span;

/// How deep models in models are followed.
const DEPTH_LIMIT: u32 = 16;
/// Steeper than this, a clamped ramp of the opacity is a cutoff.
const CUTOFF_SLOPE: f32 = 256.0;

/// A scattering model as one glTF material.
#[derive(Clone, Debug, Default)]
struct Flat {
    pbr: PbrDesc,
    normal: Option<(TextureId, f32)>,
    opacity: Option<Scalar>,
    /// Where the shape is.
    span: Span,
}

impl Writer<'_> {
    /// The material of a shape, and whether it takes the colors of the vertices.
    pub(super) fn material(&mut self, shape: &ShapeDesc, span: Span) -> (usize, bool) {
        let interior = shape.interior.map(|m| &self.desc[m].value);
        let key = format!("{:?} {:?} {:?}", shape.bsdf, shape.emission, shape.interior);
        let mut flat = self.flatten(shape.bsdf, span, 0);
        flat.span = span;
        let base = self.color_parts(flat.pbr.base_color, span);
        let colors = base.vertex_color;
        if let Some(known) = self.materials.get(&key) {
            return (*known, colors);
        }
        if shape.exterior.is_some() {
            self.loss(span, "medium outside of a shape", "not written");
        }
        if let Some(e) = shape.emission.as_ref().filter(|e| !e.two_sided) {
            self.loss(span, "light from one side", "written as light from both sides");
            if !e.group.is_empty() {
                self.loss(span, "light group", "not written");
            }
        }
        let mut material = self.write_flat(&flat, &base, interior);
        if let Some(emission) = &shape.emission {
            // The reader fades emission with the opacity; undo what it did.
            let faded = match flat.opacity {
                Some(Scalar::Constant(alpha)) if alpha > 0.0 => alpha,
                _ => 1.0,
            };
            self.write_emission(&mut material, emission.radiance, faded, span);
        }
        if let Some(id) = shape.bsdf {
            let name = &self.desc[id].name;
            if !name.is_empty() {
                material.insert("name".to_owned(), json!(name));
            }
        }
        let index = self.push("materials", Value::Object(material));
        self.materials.insert(key, index);
        (index, colors)
    }

    fn approximate(&mut self, span: Span, what: &str) {
        self.loss(span, what, "written as the nearest metallic-roughness material");
    }

    /// glTF's roughness of microfacets: the square root of their slope α.
    fn roughness(&mut self, r: Option<&Roughness>, span: Span) -> Scalar {
        let Some(r) = r else { return Scalar::Constant(0.0) };
        if r.distribution == MicrofacetKind::Beckmann {
            self.loss(span, "Beckmann microfacets", "written as GGX");
        }
        match (r.alpha_u, r.alpha_v) {
            (Scalar::Constant(u), Scalar::Constant(v)) => {
                if u != v {
                    self.loss(span, "anisotropic roughness", "written as its mean");
                }
                Scalar::Constant((u.max(0.0) * v.max(0.0)).sqrt().sqrt().min(1.0))
            }
            _ => {
                self.loss(span, "textured roughness", "written as 0.5");
                Scalar::Constant(0.5)
            }
        }
    }

    fn flatten(&mut self, id: Option<BsdfId>, span: Span, depth: u32) -> Flat {
        let dielectric = PbrDesc { metallic: Scalar::Constant(0.0), ..PbrDesc::default() };
        let matt = PbrDesc { specular: Scalar::Constant(0.0), ..dielectric.clone() };
        let flat = |pbr| Flat { pbr, ..Flat::default() };
        let Some(id) = id.filter(|_| depth <= DEPTH_LIMIT) else {
            return flat(PbrDesc { base_color: Color::gray(0.5), ..matt });
        };
        let node = &self.desc[id];
        let span = if node.span == Span::default() { span } else { node.span };
        match &node.value {
            BsdfDesc::Pbr(pbr) => flat((**pbr).clone()),
            BsdfDesc::Diffuse { reflectance, alpha } => {
                if alpha.is_some() {
                    self.approximate(span, "rough diffuse");
                }
                flat(PbrDesc { base_color: *reflectance, ..matt })
            }
            BsdfDesc::DiffuseTransmission { reflectance, .. } => {
                self.approximate(span, "diffuse transmission");
                flat(PbrDesc { base_color: *reflectance, ..matt })
            }
            BsdfDesc::Conductor { eta, k, specular_reflectance, roughness } => {
                self.approximate(span, "conductor");
                let f0 = match (eta, k) {
                    (None, _) => [1.0; 3],
                    (Some(Color::Constant(n)), Color::Constant(k)) => std::array::from_fn(|i| {
                        // Fresnel at normal incidence.
                        ((n[i] - 1.0).powi(2) + k[i] * k[i]) / ((n[i] + 1.0).powi(2) + k[i] * k[i])
                    }),
                    _ => [0.9; 3],
                };
                let base_color = match specular_reflectance {
                    Color::Constant(s) => Color::Constant(std::array::from_fn(|i| (s[i] * f0[i]).clamp(0.0, 1.0))),
                    textured => *textured,
                };
                flat(PbrDesc { base_color, roughness: self.roughness(roughness.as_ref(), span), ..PbrDesc::default() })
            }
            BsdfDesc::Dielectric { int_ior, ext_ior, specular_transmittance, roughness, .. } => {
                self.approximate(span, "dielectric");
                flat(PbrDesc {
                    base_color: *specular_transmittance,
                    roughness: self.roughness(roughness.as_ref(), span),
                    ior: (int_ior / ext_ior).max(1.0),
                    transmission: Scalar::Constant(1.0),
                    volume: true,
                    ..dielectric
                })
            }
            BsdfDesc::ThinDielectric { int_ior, ext_ior, specular_transmittance, .. } => {
                self.approximate(span, "thin dielectric");
                flat(PbrDesc {
                    base_color: *specular_transmittance,
                    roughness: Scalar::Constant(0.0),
                    ior: (int_ior / ext_ior).max(1.0),
                    transmission: Scalar::Constant(1.0),
                    ..dielectric
                })
            }
            BsdfDesc::Plastic { diffuse_reflectance, int_ior, ext_ior, roughness, .. } => {
                self.approximate(span, "plastic");
                flat(PbrDesc {
                    base_color: *diffuse_reflectance,
                    roughness: self.roughness(roughness.as_ref(), span),
                    ior: (int_ior / ext_ior).max(1.0),
                    ..dielectric
                })
            }
            BsdfDesc::Coated { base, roughness, .. } => {
                self.approximate(span, "coated");
                let mut f = self.flatten(Some(*base), span, depth + 1);
                f.pbr.clearcoat = Scalar::Constant(1.0);
                f.pbr.clearcoat_roughness = self.roughness(roughness.as_ref(), span);
                f
            }
            BsdfDesc::Principled(p) => {
                self.approximate(span, "principled");
                let ior = if let Scalar::Constant(eta) = p.eta { eta.max(1.0) } else { 1.5 };
                let coat_roughness = if let Scalar::Constant(g) = p.clearcoat_gloss { 1.0 - g } else { 0.0 };
                flat(PbrDesc {
                    base_color: p.base_color,
                    roughness: p.roughness,
                    metallic: p.metallic,
                    ior,
                    transmission: p.spec_trans,
                    volume: !p.thin,
                    clearcoat: p.clearcoat,
                    clearcoat_roughness: Scalar::Constant(coat_roughness),
                    anisotropy: p.anisotropic,
                    sheen_color: if let Scalar::Constant(s) = p.sheen { Color::gray(s) } else { Color::gray(0.0) },
                    sheen_roughness: Scalar::Constant(0.5),
                    ..PbrDesc::default()
                })
            }
            BsdfDesc::Blend { first, second, weight } => {
                self.approximate(span, "blend of two models");
                let second_wins = matches!(weight, Scalar::Constant(w) if *w >= 0.5);
                self.flatten(Some(if second_wins { *second } else { *first }), span, depth + 1)
            }
            BsdfDesc::Mask { nested, opacity } => {
                let mut f = self.flatten(Some(*nested), span, depth + 1);
                if f.opacity.is_some() {
                    self.loss(span, "mask of a mask", "one of the two written");
                }
                f.opacity = Some(*opacity);
                f
            }
            BsdfDesc::TwoSided { front, back } => {
                if front != back {
                    self.loss(span, "different sides", "the front written for both");
                }
                self.flatten(Some(*front), span, depth + 1)
            }
            BsdfDesc::BumpMap { nested, .. } => {
                self.loss(span, "bump map", "not written");
                self.flatten(Some(*nested), span, depth + 1)
            }
            BsdfDesc::NormalMap { nested, texture, scale } => {
                let mut f = self.flatten(Some(*nested), span, depth + 1);
                f.normal = Some((*texture, *scale));
                f
            }
            BsdfDesc::Null => Flat { opacity: Some(Scalar::Constant(0.0)), ..flat(matt) },
        }
    }

    fn write_flat(&mut self, flat: &Flat, base: &ColorParts, interior: Option<&MediumDesc>) -> Map<String, Value> {
        let (pbr, span) = (&flat.pbr, flat.span);
        let mut out = Map::new();
        let mut core = Map::new();
        let mut alpha = 1.0;
        if let Some(opacity) = flat.opacity {
            alpha = self.write_opacity(&mut out, opacity, base, span);
        }
        let [r, g, b] = base.factor.map(|c| c.clamp(0.0, 1.0));
        if [r, g, b, alpha] != [1.0; 4] {
            core.insert("baseColorFactor".to_owned(), json!([r, g, b, alpha]));
        }
        self.put_texture(&mut core, "baseColorTexture", base.bitmap.as_ref(), true, span);
        self.write_metallic_roughness(&mut core, pbr, span);
        out.insert("pbrMetallicRoughness".to_owned(), Value::Object(core));
        if let Some((texture, scale)) = flat.normal
            && let Some(info) = self.normal_info(texture, scale, span)
        {
            out.insert("normalTexture".to_owned(), info);
        }
        if pbr.transmission == Scalar::Constant(0.0) {
            out.insert("doubleSided".to_owned(), json!(true));
        }
        self.write_extensions(&mut out, pbr, interior, span);
        out
    }

    fn normal_info(&mut self, texture: TextureId, scale: f32, span: Span) -> Option<Value> {
        let bitmap = self.normal_bitmap(texture, span)?;
        let mut info = self.texture_info(&bitmap, false, span)?;
        if scale != 1.0 {
            info["scale"] = json!(scale);
        }
        Some(info)
    }

    fn put_texture(&mut self, out: &mut Map<String, Value>, key: &str, bitmap: Option<&BitmapDesc>, srgb: bool, span: Span) {
        if let Some(info) = bitmap.and_then(|b| self.texture_info(b, srgb, span)) {
            out.insert(key.to_owned(), info);
        }
    }

    /// Writes the alpha mode; returns the alpha factor.
    fn write_opacity(&mut self, out: &mut Map<String, Value>, opacity: Scalar, base: &ColorParts, span: Span) -> f32 {
        let parts = self.scalar_parts(opacity, span);
        let same_picture = match (&parts.bitmap, &base.bitmap) {
            (Some(a), Some(b)) => a.image == b.image && a.picture_from_uv == b.picture_from_uv && a.channel == Channel::A,
            (Some(_), None) => false,
            (None, _) => true,
        };
        if !same_picture {
            self.loss(span, "opacity that is not the alpha of the base color's picture", "written as opaque");
            return 1.0;
        }
        if parts.clamped && parts.factor >= CUTOFF_SLOPE {
            out.insert("alphaMode".to_owned(), json!("MASK"));
            out.insert("alphaCutoff".to_owned(), json!((1.0 - parts.offset) / parts.factor));
            return 1.0;
        }
        if parts.offset != 0.0 && parts.bitmap.is_some() {
            self.loss(span, "opacity with an offset", "written without the offset");
        }
        out.insert("alphaMode".to_owned(), json!("BLEND"));
        let constant = if parts.bitmap.is_none() { parts.offset } else { 0.0 };
        (parts.factor + constant).clamp(0.0, 1.0)
    }

    fn write_metallic_roughness(&mut self, core: &mut Map<String, Value>, pbr: &PbrDesc, span: Span) {
        let metallic = self.scalar_parts(pbr.metallic, span);
        let roughness = self.scalar_parts(pbr.roughness, span);
        let mut roughness_factor = roughness.factor;
        let picture = match (&metallic.bitmap, &roughness.bitmap) {
            (Some(m), Some(r)) => {
                if m.image != r.image || m.channel != Channel::B || r.channel != Channel::G {
                    self.loss(span, "pictures of metalness and roughness", "read from blue and green of one picture");
                }
                Some(r.clone())
            }
            (None, Some(r)) => {
                // The picture's blue would scale a constant metalness.
                if metallic.factor != 0.0 {
                    self.loss(span, "picture of roughness beside constant metalness", "its blue scales the metalness");
                }
                if r.channel != Channel::G {
                    self.loss(span, "channel of the picture of roughness", "read from green");
                }
                Some(r.clone())
            }
            (Some(m), None) => {
                self.loss(span, "picture of metalness beside constant roughness", "its green scales the roughness");
                Some(m.clone())
            }
            (None, None) => None,
        };
        if roughness.offset != 0.0 {
            if roughness.bitmap.is_some() {
                self.loss(span, "roughness with an offset", "written as constant");
                roughness_factor = (0.5 * roughness.factor + roughness.offset).clamp(0.0, 1.0);
            } else {
                roughness_factor += roughness.offset;
            }
        }
        let picture = picture.filter(|_| roughness.offset == 0.0);
        for (key, factor) in [("metallicFactor", metallic.factor + metallic.offset), ("roughnessFactor", roughness_factor)] {
            if factor != 1.0 {
                core.insert(key.to_owned(), json!(factor.clamp(0.0, 1.0)));
            }
        }
        self.put_texture(core, "metallicRoughnessTexture", picture.as_ref(), false, span);
    }

    /// A factor and its texture under their names; left out where it is the default.
    fn put_scalar(&mut self, out: &mut Map<String, Value>, names: [&str; 2], value: Scalar, default: f32, channel: Channel, span: Span) {
        let parts = self.scalar_parts(value, span);
        if parts.factor != default {
            out.insert(names[0].to_owned(), json!(parts.factor));
        }
        if let Some(b) = &parts.bitmap {
            if b.channel != channel || parts.offset != 0.0 {
                self.loss(span, &format!("channel or offset of {}", names[1]), "read from the channel that glTF prescribes");
            }
            self.put_texture(out, names[1], Some(b), channel == Channel::A, span);
        }
    }

    fn put_color(&mut self, out: &mut Map<String, Value>, names: [&str; 2], value: Color, default: [f32; 3], span: Span) {
        let parts = self.color_parts(value, span);
        if parts.factor != default {
            out.insert(names[0].to_owned(), json!(parts.factor));
        }
        self.put_texture(out, names[1], parts.bitmap.as_ref(), true, span);
    }

    fn write_extensions(&mut self, out: &mut Map<String, Value>, pbr: &PbrDesc, interior: Option<&MediumDesc>, span: Span) {
        let zero = Scalar::Constant(0.0);
        let mut all: Vec<(&'static str, Map<String, Value>)> = Vec::new();
        let one_entry = |key: &str, value: f32| Map::from_iter([(key.to_owned(), json!(value))]);
        if pbr.ior != 1.5 {
            all.push(("KHR_materials_ior", one_entry("ior", pbr.ior)));
        }
        if pbr.specular != Scalar::Constant(1.0) || pbr.specular_color != Color::gray(1.0) {
            let mut e = Map::new();
            self.put_scalar(&mut e, ["specularFactor", "specularTexture"], pbr.specular, 1.0, Channel::A, span);
            self.put_color(&mut e, ["specularColorFactor", "specularColorTexture"], pbr.specular_color, [1.0; 3], span);
            all.push(("KHR_materials_specular", e));
        }
        if pbr.transmission != zero {
            let mut e = Map::new();
            self.put_scalar(&mut e, ["transmissionFactor", "transmissionTexture"], pbr.transmission, 0.0, Channel::R, span);
            all.push(("KHR_materials_transmission", e));
            if pbr.volume {
                all.push(("KHR_materials_volume", self.volume(interior, span)));
            }
        }
        if pbr.dispersion != 0.0 {
            all.push(("KHR_materials_dispersion", one_entry("dispersion", pbr.dispersion)));
        }
        if pbr.clearcoat != zero {
            let mut e = Map::new();
            self.put_scalar(&mut e, ["clearcoatFactor", "clearcoatTexture"], pbr.clearcoat, 0.0, Channel::R, span);
            let names = ["clearcoatRoughnessFactor", "clearcoatRoughnessTexture"];
            self.put_scalar(&mut e, names, pbr.clearcoat_roughness, 0.0, Channel::G, span);
            if let Some(info) = pbr.clearcoat_normal.and_then(|(t, scale)| self.normal_info(t, scale, span)) {
                e.insert("clearcoatNormalTexture".to_owned(), info);
            }
            all.push(("KHR_materials_clearcoat", e));
        }
        if pbr.sheen_color != Color::gray(0.0) {
            let mut e = Map::new();
            self.put_color(&mut e, ["sheenColorFactor", "sheenColorTexture"], pbr.sheen_color, [0.0; 3], span);
            self.put_scalar(&mut e, ["sheenRoughnessFactor", "sheenRoughnessTexture"], pbr.sheen_roughness, 0.0, Channel::A, span);
            all.push(("KHR_materials_sheen", e));
        }
        if pbr.anisotropy != zero {
            let mut e = one_entry("anisotropyRotation", pbr.anisotropy_rotation);
            e.insert("anisotropyStrength".to_owned(), json!(self.scalar_parts(pbr.anisotropy, span).factor));
            if let Some(info) = pbr.anisotropy_direction.and_then(|t| self.normal_info(t, 1.0, span)) {
                e.insert("anisotropyTexture".to_owned(), info);
            }
            all.push(("KHR_materials_anisotropy", e));
        }
        if pbr.iridescence != zero {
            let mut e = one_entry("iridescenceIor", pbr.iridescence_ior);
            self.put_scalar(&mut e, ["iridescenceFactor", "iridescenceTexture"], pbr.iridescence, 0.0, Channel::R, span);
            let thickness = self.scalar_parts(pbr.iridescence_thickness_nm, span);
            e.insert("iridescenceThicknessMinimum".to_owned(), json!(thickness.offset));
            e.insert("iridescenceThicknessMaximum".to_owned(), json!(thickness.offset + thickness.factor));
            self.put_texture(&mut e, "iridescenceThicknessTexture", thickness.bitmap.as_ref(), false, span);
            all.push(("KHR_materials_iridescence", e));
        }
        if interior.is_some() && (pbr.transmission == zero || !pbr.volume) {
            self.loss(span, "medium inside of a shape", "not written: the material is not the boundary of a volume");
        }
        for (name, value) in all {
            self.extension(out, name, value);
        }
    }

    fn extension(&mut self, out: &mut Map<String, Value>, name: &'static str, value: Map<String, Value>) {
        self.used.insert(name);
        if let Value::Object(extensions) = out.entry("extensions").or_insert_with(|| json!({})) {
            extensions.insert(name.to_owned(), Value::Object(value));
        }
    }

    fn volume(&mut self, interior: Option<&MediumDesc>, span: Span) -> Map<String, Value> {
        let mut e = Map::from_iter([("thicknessFactor".to_owned(), json!(1.0))]);
        if let Some(MediumDesc::Homogeneous { sigma_a, sigma_s, emission, .. }) = interior {
            if *sigma_s != [0.0; 3] || *emission != [0.0; 3] {
                self.loss(span, "scattering or glowing medium", "only its absorption written");
            }
            let max = sigma_a.iter().copied().fold(0.0f32, f32::max);
            if max > 0.0 {
                // The color that is left at the distance where the strongest channel falls to 1/e.
                let color = sigma_a.map(|s| (-f64::from(s / max)).exp() as f32);
                e.insert("attenuationDistance".to_owned(), json!(max.recip()));
                e.insert("attenuationColor".to_owned(), json!(color));
            }
        }
        e
    }

    fn write_emission(&mut self, out: &mut Map<String, Value>, radiance: Color, faded: f32, span: Span) {
        let mut parts = self.color_parts(radiance, span);
        parts.factor = parts.factor.map(|f| f / faded);
        let max = parts.factor.iter().copied().fold(0.0f32, f32::max);
        if max > 0.0 {
            let strength = max.max(1.0);
            out.insert("emissiveFactor".to_owned(), json!(parts.factor.map(|f| (f / strength).clamp(0.0, 1.0))));
            self.put_texture(out, "emissiveTexture", parts.bitmap.as_ref(), true, span);
            if strength > 1.0 {
                let e = Map::from_iter([("emissiveStrength".to_owned(), json!(strength))]);
                self.extension(out, "KHR_materials_emissive_strength", e);
            }
        }
    }
}
