//! Textures, scattering models and media.

use std::io;

use glam::{Mat3, Mat4, Vec4};

use super::Writer;
use crate::desc::{
    BsdfDesc, BsdfId, Channel, Encoding, FieldDesc, ImageId, MediumDesc, MicrofacetKind, Param, PbrDesc, PhaseDesc, Roughness, Scalar,
    ScatteringDesc, TextureDesc, TextureFilter, VolumeDesc, VolumeFilter, VolumeWrap, Wrap,
};
use crate::span::Span;

/// Turns v round: our pictures begin at v = 1, Mitsuba's at v = 0.
const FLIP_V: Mat3 = Mat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 1.0]);

impl Writer<'_> {
    /// The name of a picture's file; written on first use.
    pub(super) fn image(&mut self, id: ImageId) -> io::Result<String> {
        self.files.image(self.desc, id)
    }

    pub(super) fn texture(&mut self, i: usize) -> io::Result<()> {
        let node = &self.desc.textures[i];
        let (id, span) = (self.ids.textures[i].clone(), node.span);
        match &node.value {
            TextureDesc::Constant { value } => {
                self.xml.open("texture", "srgb", &id);
                self.xml.triple("rgb", "color", *value);
            }
            TextureDesc::Bitmap(bitmap) => {
                let name = self.image(bitmap.image)?;
                self.xml.open("texture", "bitmap", &id);
                self.xml.value("string", "filename", name);
                match bitmap.filter {
                    TextureFilter::Nearest => self.xml.value("string", "filter_type", "nearest"),
                    TextureFilter::Bilinear => {}
                    TextureFilter::Trilinear => self.lose(span, "trilinear texture filter", "bilinear"),
                }
                match bitmap.wrap[0] {
                    Wrap::Repeat => {}
                    Wrap::Mirror => self.xml.value("string", "wrap_mode", "mirror"),
                    Wrap::Clamp => self.xml.value("string", "wrap_mode", "clamp"),
                    Wrap::Black => {
                        self.lose(span, "texture that is black beyond its edge", "the edge goes on");
                        self.xml.value("string", "wrap_mode", "clamp");
                    }
                }
                if bitmap.wrap[1] != bitmap.wrap[0] {
                    self.lose(span, "texture wrapped differently in v", "wrapped as in u");
                }
                if bitmap.encoding == Encoding::Linear {
                    self.xml.value("boolean", "raw", true);
                }
                if bitmap.channel != Channel::Luminance {
                    self.lose(span, "texture of a single channel", "its luminance");
                }
                if bitmap.uv_set != 0 {
                    self.lose(span, "second set of texture coordinates", "the first");
                }
                self.xml.transform("to_uv", embed(FLIP_V * bitmap.picture_from_uv));
            }
            TextureDesc::Checkerboard { color0, color1, pattern_from_uv } => {
                self.xml.open("texture", "checkerboard", &id);
                self.color("color0", *color0);
                self.color("color1", *color1);
                self.xml.transform("to_uv", embed(*pattern_from_uv));
            }
            TextureDesc::Attribute { name, scale } => {
                let per_face = self.desc.meshes.iter().filter_map(|m| m.value.data.as_ref()).flat_map(|d| &d.attributes);
                let per_face = per_face.filter(|a| a.name == *name).any(|a| a.per_face);
                self.xml.open("texture", "mesh_attribute", &id);
                self.xml.value("string", "name", format!("{}_{name}", if per_face { "face" } else { "vertex" }));
                if *scale != 1.0 {
                    self.xml.float("scale", *scale);
                }
            }
            TextureDesc::Multiply { a, b } => return self.stand_in(span, &id, &[*a, *b], "product of textures"),
            TextureDesc::Mix { a, b, .. } => return self.stand_in(span, &id, &[*a, *b], "mix of textures"),
            TextureDesc::Affine { texture, .. } => return self.stand_in(span, &id, &[Param::Texture(*texture)], "scaled texture"),
            TextureDesc::Power { texture, .. } => return self.stand_in(span, &id, &[Param::Texture(*texture)], "power of a texture"),
            TextureDesc::Projected { texture, .. } => {
                return self.stand_in(span, &id, &[Param::Texture(*texture)], "projected texture");
            }
            TextureDesc::Solid { pattern, .. } => return self.mean(span, &id, pattern.mean(), "pattern of a texture"),
            TextureDesc::Facing { .. } => return self.mean(span, &id, [0.5; 3], "texture by direction"),
        }
        self.xml.close();
        Ok(())
    }

    fn mean(&mut self, span: Span, id: &str, value: [f32; 3], feature: &str) -> io::Result<()> {
        self.lose(span, feature, "its mean");
        self.xml.open("texture", "srgb", id);
        // Mitsuba refuses what no surface reflects.
        self.xml.triple("rgb", "color", value.map(|v| v.clamp(0.0, 1.0)));
        self.xml.close();
        Ok(())
    }

    /// What Mitsuba cannot compute becomes its first textured part, or its first constant.
    fn stand_in(&mut self, span: Span, id: &str, parts: &[crate::desc::Color], feature: &str) -> io::Result<()> {
        self.lose(span, feature, "one of its parts");
        let texture = parts.iter().find_map(|p| if let Param::Texture(t) = p { Some(t.0) } else { None });
        match texture {
            // A checkerboard of two like squares passes its parameter on.
            Some(t) => {
                self.xml.open("texture", "checkerboard", id);
                self.texture_ref("color0", t);
                self.texture_ref("color1", t);
            }
            None => {
                let value = parts.iter().find_map(|p| if let Param::Constant(c) = p { Some(*c) } else { None });
                self.xml.open("texture", "srgb", id);
                self.xml.triple("rgb", "color", value.unwrap_or([0.5; 3]));
            }
        }
        self.xml.close();
        Ok(())
    }

    /// The id under which a model is written; models that Mitsuba lacks stand for what is under them.
    pub(super) fn bsdf_id(&self, id: BsdfId) -> String {
        let mut id = id;
        for _ in 0..self.desc.bsdfs.len() {
            match self.desc.bsdfs.get(id.0 as usize).map(|n| &n.value) {
                Some(BsdfDesc::Coated { base, .. }) => id = *base,
                _ => break,
            }
        }
        self.ids.bsdfs.get(id.0 as usize).cloned().unwrap_or_default()
    }

    fn bsdf_ref(&mut self, id: BsdfId) {
        let id = self.bsdf_id(id);
        self.xml.reference("", &id);
    }

    fn roughness(&mut self, roughness: &Option<Roughness>) {
        let Some(r) = roughness else { return };
        let distribution = if r.distribution == MicrofacetKind::Ggx { "ggx" } else { "beckmann" };
        self.xml.value("string", "distribution", distribution);
        if r.alpha_u == r.alpha_v {
            self.scalar("alpha", r.alpha_u);
        } else {
            self.scalar("alpha_u", r.alpha_u);
            self.scalar("alpha_v", r.alpha_v);
        }
    }

    fn iors(&mut self, int_ior: f32, ext_ior: f32) {
        self.xml.float("int_ior", int_ior);
        self.xml.float("ext_ior", ext_ior);
    }

    pub(super) fn bsdf(&mut self, i: usize) {
        let node = &self.desc.bsdfs[i];
        let (id, span) = (self.ids.bsdfs[i].clone(), node.span);
        match &node.value {
            BsdfDesc::Coated { .. } => return self.lose(span, "coated bsdf", "what is under the coat"),
            BsdfDesc::Pbr(pbr) => return self.pbr(span, &id, pbr),
            BsdfDesc::Diffuse { alpha: Some(_), .. } => {
                self.lose(span, "rough diffuse bsdf", "diffuse");
                self.xml.open("bsdf", "diffuse", &id);
            }
            BsdfDesc::DiffuseTransmission { .. } => {
                self.lose(span, "diffuse transmission", "diffuse reflection");
                self.xml.open("bsdf", "diffuse", &id);
            }
            value => self.xml.open("bsdf", value.type_name(), &id),
        }
        match &node.value {
            BsdfDesc::Diffuse { reflectance, .. } | BsdfDesc::DiffuseTransmission { reflectance, .. } => {
                self.color("reflectance", *reflectance);
            }
            BsdfDesc::Conductor { eta, k, specular_reflectance, roughness } => {
                match eta {
                    Some(eta) => {
                        self.color("eta", *eta);
                        self.color("k", *k);
                    }
                    None => self.xml.value("string", "material", "none"),
                }
                self.color("specular_reflectance", *specular_reflectance);
                self.roughness(roughness);
            }
            BsdfDesc::Dielectric { int_ior, ext_ior, specular_reflectance, specular_transmittance, roughness } => {
                self.iors(*int_ior, *ext_ior);
                self.color("specular_reflectance", *specular_reflectance);
                self.color("specular_transmittance", *specular_transmittance);
                self.roughness(roughness);
            }
            BsdfDesc::ThinDielectric { int_ior, ext_ior, specular_reflectance, specular_transmittance } => {
                self.iors(*int_ior, *ext_ior);
                self.color("specular_reflectance", *specular_reflectance);
                self.color("specular_transmittance", *specular_transmittance);
            }
            BsdfDesc::Plastic { diffuse_reflectance, specular_reflectance, int_ior, ext_ior, nonlinear, roughness } => {
                self.iors(*int_ior, *ext_ior);
                self.color("diffuse_reflectance", *diffuse_reflectance);
                self.color("specular_reflectance", *specular_reflectance);
                self.xml.value("boolean", "nonlinear", nonlinear);
                if let Some(r) = roughness
                    && (r.alpha_u != r.alpha_v || matches!(r.alpha_u, Param::Texture(_)))
                {
                    // Mitsuba's rough plastic takes one number.
                    self.lose(span, "rough plastic of varying or anisotropic roughness", "one roughness");
                    let alpha = if let Param::Constant(v) = r.alpha_u { v } else { 0.1 };
                    let alpha: Scalar = Param::Constant(alpha);
                    self.roughness(&Some(Roughness { distribution: r.distribution, alpha_u: alpha, alpha_v: alpha }));
                } else {
                    self.roughness(roughness);
                }
            }
            BsdfDesc::Principled(p) => {
                self.color("base_color", p.base_color);
                let common = [
                    ("roughness", p.roughness),
                    ("anisotropic", p.anisotropic),
                    ("spec_trans", p.spec_trans),
                    ("spec_tint", p.spec_tint),
                    ("sheen", p.sheen),
                    ("sheen_tint", p.sheen_tint),
                    ("flatness", p.flatness),
                    ("eta", p.eta),
                ];
                let solid = [("metallic", p.metallic), ("clearcoat", p.clearcoat), ("clearcoat_gloss", p.clearcoat_gloss)];
                let thin = [("diff_trans", p.diff_trans)];
                let rest = if p.thin { &thin[..] } else { &solid[..] };
                for (name, value) in common.iter().chain(rest) {
                    self.scalar(name, *value);
                }
            }
            BsdfDesc::Blend { first, second, weight } => {
                self.scalar("weight", *weight);
                self.bsdf_ref(*first);
                self.bsdf_ref(*second);
            }
            BsdfDesc::Mask { nested, opacity } => {
                self.scalar("opacity", *opacity);
                self.bsdf_ref(*nested);
            }
            BsdfDesc::TwoSided { front, back } => {
                self.bsdf_ref(*front);
                if front != back {
                    self.bsdf_ref(*back);
                }
            }
            BsdfDesc::BumpMap { nested, texture, scale } => {
                self.texture_ref("arbitrary", texture.0);
                self.xml.float("scale", *scale);
                self.bsdf_ref(*nested);
            }
            BsdfDesc::NormalMap { nested, texture, scale } => {
                self.texture_ref("normalmap", texture.0);
                if *scale != 1.0 {
                    self.lose(span, "scale of a normal map", "1");
                }
                self.bsdf_ref(*nested);
            }
            BsdfDesc::Coated { .. } | BsdfDesc::Pbr(_) | BsdfDesc::Null => {}
        }
        self.xml.close();
    }

    fn pbr(&mut self, span: Span, id: &str, p: &PbrDesc) {
        let plain = PbrDesc::default();
        let extras = [
            (p.specular != plain.specular || p.specular_color != plain.specular_color, "specular strength or tint"),
            (p.dispersion != 0.0, "dispersion"),
            (p.clearcoat_normal.is_some(), "normal map of the clear coat"),
            (p.sheen_color != plain.sheen_color, "sheen"),
            (p.anisotropy != plain.anisotropy, "anisotropy"),
            (p.iridescence != plain.iridescence, "iridescence"),
        ];
        let lost: Vec<&str> = extras.iter().filter(|(given, _)| *given).map(|(_, what)| *what).collect();
        let without = if lost.is_empty() { String::new() } else { format!(" without {}", lost.join(", ")) };
        self.lose(span, "glTF material", &format!("bsdf \"principled\"{without}"));
        // glTF surfaces without a volume are seen from both sides.
        let transmits = p.transmission != Param::Constant(0.0);
        if !transmits {
            self.xml.open("bsdf", "twosided", id);
            self.xml.open("bsdf", "principled", "");
        } else {
            self.xml.open("bsdf", "principled", id);
        }
        self.color("base_color", p.base_color);
        self.scalar("metallic", p.metallic);
        self.scalar("roughness", p.roughness);
        // An index of 1 has no interface in Mitsuba's model.
        self.xml.float("eta", p.ior.max(1.001));
        self.scalar("spec_trans", p.transmission);
        self.scalar("clearcoat", p.clearcoat);
        let gloss = if let Param::Constant(r) = p.clearcoat_roughness { 1.0 - r } else { 1.0 };
        self.xml.float("clearcoat_gloss", gloss);
        self.xml.close();
        if !transmits {
            self.xml.close();
        }
    }

    pub(super) fn medium(&mut self, i: usize) -> io::Result<()> {
        let node = &self.desc.media[i];
        let id = self.ids.media[i].clone();
        match &node.value {
            MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase } => {
                if emission.iter().any(|v| *v != 0.0) {
                    self.lose(node.span, "emission of a medium", "none");
                }
                self.xml.open("medium", "homogeneous", &id);
                let sigma_t = [0, 1, 2].map(|c| sigma_a[c] + sigma_s[c]);
                self.constant("sigma_t", sigma_t);
                self.xml.triple("rgb", "albedo", [0, 1, 2].map(|c| if sigma_t[c] > 0.0 { sigma_s[c] / sigma_t[c] } else { 0.0 }));
                self.phase(phase);
            }
            MediumDesc::Grid(grid) => {
                if grid.emission.is_some() {
                    self.lose(node.span, "emission of a medium", "none");
                }
                self.xml.open("medium", "heterogeneous", &id);
                self.field("sigma_t", &grid.extinction, node.span)?;
                match &grid.scattering {
                    ScatteringDesc::Albedo(albedo) => self.field("albedo", albedo, node.span)?,
                    ScatteringDesc::Coefficient(sigma_s) => {
                        let albedo = self.albedo_volume(&grid.extinction, sigma_s);
                        match albedo {
                            Some(volume) => self.volume("albedo", usize::MAX, &volume, [1.0; 3])?,
                            None => self.lose(node.span, "scattering coefficients on another grid than the extinction", "albedo 0.75"),
                        }
                    }
                }
                self.phase(&grid.phase);
            }
        }
        self.xml.close();
        Ok(())
    }

    fn phase(&mut self, phase: &PhaseDesc) {
        match phase {
            PhaseDesc::Isotropic => self.xml.open("phase", "isotropic", ""),
            PhaseDesc::Rayleigh => self.xml.open("phase", "rayleigh", ""),
            PhaseDesc::HenyeyGreenstein { g } => {
                self.xml.open("phase", "hg", "");
                self.xml.float("g", *g);
            }
            PhaseDesc::Blend { first, second, weight } => {
                self.xml.open("phase", "blendphase", "");
                self.xml.float("weight", *weight);
                self.phase(first);
                self.phase(second);
            }
        }
        self.xml.close();
    }

    fn field(&mut self, name: &'static str, field: &FieldDesc, span: Span) -> io::Result<()> {
        let volume = field.volume.and_then(|id| Some((id, &self.desc.volumes.get(id.0 as usize)?.value)));
        let Some((id, volume)) = volume else {
            self.constant(name, field.factor);
            return Ok(());
        };
        if volume.wrap == VolumeWrap::Zero {
            self.lose(span, "volume that is empty beyond its outermost values", "the outermost values up to the border");
        }
        self.volume(name, id.0 as usize, volume, field.factor)
    }

    /// A coefficient. Mitsuba takes colors above 1 for faults unless they are in a volume.
    fn constant(&mut self, name: &'static str, value: [f32; 3]) {
        let unbounded = value.iter().any(|v| *v > 1.0);
        if unbounded {
            self.xml.open_named("volume", "constvolume", name);
        }
        self.xml.triple("rgb", if unbounded { "value" } else { name }, value);
        if unbounded {
            self.xml.close();
        }
    }

    /// A volume with a factor on its values.
    fn volume(&mut self, name: &'static str, number: usize, volume: &VolumeDesc, factor: [f32; 3]) -> io::Result<()> {
        let mut scaled = volume.clone();
        if factor != [1.0; 3] {
            scaled.data = scale_values(volume, factor);
            scaled.channels = 3;
        }
        self.volumes += 1;
        let number = if number == usize::MAX || factor != [1.0; 3] { self.desc.volumes.len() + self.volumes } else { number };
        let file = self.files.volume(number, &scaled)?;
        self.xml.open_named("volume", "gridvolume", name);
        self.xml.value("string", "filename", file);
        self.xml.value("boolean", "raw", true);
        if volume.filter == VolumeFilter::Nearest {
            self.xml.value("string", "filter_type", "nearest");
        }
        match volume.wrap {
            VolumeWrap::Repeat => self.xml.value("string", "wrap_mode", "repeat"),
            VolumeWrap::Mirror => self.xml.value("string", "wrap_mode", "mirror"),
            VolumeWrap::Clamp | VolumeWrap::Zero => {}
        }
        self.xml.transform("to_world", volume.world_from_volume);
        self.xml.close();
        Ok(())
    }

    /// Scattering over extinction, value by value, where both are on one grid or constant.
    fn albedo_volume(&self, extinction: &FieldDesc, sigma_s: &FieldDesc) -> Option<VolumeDesc> {
        let volume = |f: &FieldDesc| f.volume.and_then(|id| Some(&self.desc.volumes.get(id.0 as usize)?.value));
        let (t, s) = (volume(extinction)?, volume(sigma_s));
        let same = |s: &VolumeDesc| s.size == t.size && s.world_from_volume == t.world_from_volume;
        if s.is_some_and(|s| !same(s)) {
            return None;
        }
        let total = scale_values(t, extinction.factor);
        let scattered = match s {
            Some(s) => scale_values(s, sigma_s.factor),
            None => sigma_s.factor.iter().copied().cycle().take(total.len()).collect(),
        };
        let data = total.iter().zip(&scattered).map(|(t, s)| if *t > 0.0 { (s / t).min(1.0) } else { 0.0 }).collect();
        Some(VolumeDesc { channels: 3, data, ..t.clone() })
    }
}

/// The values of a volume as colors times a factor.
fn scale_values(volume: &VolumeDesc, factor: [f32; 3]) -> Vec<f32> {
    if volume.channels == 1 {
        volume.data.iter().flat_map(|v| factor.map(|f| f * v)).collect()
    } else {
        volume.data.iter().zip(factor.iter().cycle()).map(|(v, f)| v * f).collect()
    }
}

/// A transform of (u, v) as the 4×4 matrix of which Mitsuba takes the upper rows.
fn embed(m: Mat3) -> Mat4 {
    Mat4::from_cols(
        Vec4::new(m.x_axis.x, m.x_axis.y, 0.0, 0.0),
        Vec4::new(m.y_axis.x, m.y_axis.y, 0.0, 0.0),
        Vec4::Z,
        Vec4::new(m.z_axis.x, m.z_axis.y, 0.0, 1.0),
    )
}
