//! Textures, scattering models and media.

use std::fmt::Write as _;
use std::io;

use super::Writer;
use crate::desc::{BsdfDesc, BsdfId, Color, Encoding, Param, PbrDesc, PrincipledDesc, Roughness, Scalar, TextureDesc, TextureFilter, Wrap};
use crate::span::Span;

impl Writer<'_> {
    /// Each texture twice: as `c{i}` of spectra and as `f{i}` of floats.
    pub(super) fn texture(&mut self, i: usize) -> io::Result<()> {
        let node = &self.desc.textures[i];
        let span = node.span;
        let (projected, texture) = self.projected(&node.value, span);
        // Patterns are floats in pbrt, of which colors are mixed.
        let kinds = [("f", "float"), ("c", "spectrum")];
        for (prefix, kind) in kinds {
            let float = prefix == "f";
            let space = self.texture_space(texture, projected, span);
            if let Some(world_from_pattern) = space {
                self.line("AttributeBegin");
                self.transform("Transform", world_from_pattern);
            }
            let _ = write!(self.text, "Texture \"{prefix}{i}\" \"{kind}\"");
            let value = |w: &mut Self, name: &str, c: Color| match (c, float) {
                (Param::Constant([r, g, b]), true) => w.float(name, 0.2126 * r + 0.7152 * g + 0.0722 * b),
                (Param::Constant(c), false) => w.rgb(name, c),
                (Param::Texture(id), _) => w.texture_ref(name, prefix, id),
            };
            match texture {
                TextureDesc::Constant { value: c } => {
                    self.text.push_str(" \"constant\"");
                    value(self, "value", Param::Constant(*c));
                }
                TextureDesc::Bitmap(bitmap) => {
                    self.text.push_str(" \"imagemap\"");
                    let name = self.files.image(self.desc, bitmap.image)?;
                    self.string("filename", &name);
                    let wrap = match bitmap.wrap[0] {
                        Wrap::Repeat => "repeat",
                        Wrap::Clamp => "clamp",
                        Wrap::Black => "black",
                        Wrap::Mirror => {
                            self.lose(span, "mirrored texture", "repeated");
                            "repeat"
                        }
                    };
                    self.string("wrap", wrap);
                    let filter = match bitmap.filter {
                        TextureFilter::Nearest => "point",
                        TextureFilter::Bilinear => "bilinear",
                        TextureFilter::Trilinear => "trilinear",
                    };
                    self.string("filter", filter);
                    match bitmap.encoding {
                        Encoding::Auto => {}
                        Encoding::Linear => self.string("encoding", "linear"),
                        Encoding::Srgb => self.string("encoding", "sRGB"),
                    }
                    self.mapping(bitmap.picture_from_uv, 1.0, projected, span);
                    if bitmap.uv_set != 0 {
                        self.lose(span, "second set of texture coordinates", "the first");
                    }
                }
                TextureDesc::Checkerboard { color0, color1, pattern_from_uv } => {
                    self.text.push_str(" \"checkerboard\"");
                    value(self, "tex1", *color0);
                    value(self, "tex2", *color1);
                    self.mapping(*pattern_from_uv, 2.0, projected, span);
                }
                TextureDesc::Multiply { a, b } => {
                    self.text.push_str(" \"scale\"");
                    // The second factor of pbrt is a float.
                    let (a, b) = if matches!(b, Param::Constant([r, g, b]) if r == g && g == b) { (*a, *b) } else { (*b, *a) };
                    value(self, "tex", a);
                    match b {
                        Param::Constant([r, g, b]) => {
                            if r != g || g != b {
                                self.lose(span, "texture times a color", "times its luminance");
                            }
                            self.float("scale", 0.2126 * r + 0.7152 * g + 0.0722 * b);
                        }
                        Param::Texture(id) => self.texture_ref("scale", "f", id),
                    }
                }
                TextureDesc::Mix { a, b, weight } => {
                    self.text.push_str(" \"mix\"");
                    value(self, "tex1", *a);
                    value(self, "tex2", *b);
                    self.scalar("amount", *weight);
                }
                // Reflectances are limited by pbrt itself.
                TextureDesc::Affine { texture, scale, offset: 0.0, .. } => {
                    self.text.push_str(" \"scale\"");
                    self.texture_ref("tex", prefix, *texture);
                    self.float("scale", *scale);
                }
                TextureDesc::Affine { texture, scale, offset, .. } => {
                    // scale · t + offset = (1 − amount) · offset + amount · (offset + scale), amount = t.
                    self.text.push_str(" \"mix\"");
                    value(self, "tex1", Color::gray(*offset));
                    value(self, "tex2", Color::gray(offset + scale));
                    self.texture_ref("amount", "f", *texture);
                    if !float {
                        self.lose(span, "scaled color texture", "scaled by its luminance");
                    }
                }
                TextureDesc::Power { texture, .. } => {
                    self.lose(span, "power of a texture", "the texture itself");
                    self.text.push_str(" \"scale\"");
                    self.texture_ref("tex", prefix, *texture);
                }
                TextureDesc::Attribute { .. } => {
                    self.lose(span, "vertex colors", "a constant 0.5");
                    self.text.push_str(" \"constant\"");
                    value(self, "value", Color::gray(0.5));
                }
                TextureDesc::Projected { texture, .. } => {
                    self.lose(span, "projection of this texture", "texture coordinates");
                    self.text.push_str(" \"scale\"");
                    self.texture_ref("tex", prefix, *texture);
                }
                TextureDesc::Solid { pattern, space } => self.pattern(i, float, pattern, *space, projected, span),
                TextureDesc::Facing { direction: d } => match float {
                    true => {
                        let _ = write!(
                            self.text,
                            " \"directionmix\" \"vector3 dir\" [{} {} {}] \"float tex1\" 1 \"float tex2\" 0",
                            d.x, d.y, d.z
                        );
                    }
                    false => self.mixed(i),
                },
            }
            self.text.push('\n');
            if space.is_some() {
                self.line("AttributeEnd");
            }
        }
        Ok(())
    }

    /// The number of the named material for a model: opaque ones are two-sided in pbrt without a word.
    pub(super) fn material_number(&self, id: BsdfId) -> u32 {
        match self.desc[id].value {
            BsdfDesc::TwoSided { front, back } if front == back => front.0,
            _ => id.0,
        }
    }

    /// A model as the named material `m{i}`.
    pub(super) fn bsdf(&mut self, i: usize) -> io::Result<()> {
        let desc = self.desc;
        let node = &desc.bsdfs[i];
        if self.material_number(BsdfId(i as u32)) != i as u32 {
            return Ok(());
        }
        let mut modifiers = Vec::new();
        // Wrappers of pbrt are parameters of what they wrap; the same wrapper never comes twice on one way down.
        let mut at = BsdfId(i as u32);
        for _ in 0..desc.bsdfs.len() {
            let inner = &desc[at].value;
            match inner {
                BsdfDesc::TwoSided { front, back } => {
                    if front != back {
                        self.lose(node.span, "different materials for both sides", "the front's");
                    }
                    at = *front;
                }
                BsdfDesc::BumpMap { nested, texture, scale } => {
                    if *scale != 1.0 {
                        self.lose(node.span, "scale of a bump map", "1");
                    }
                    modifiers.push(("displacement", *texture));
                    at = *nested;
                }
                BsdfDesc::NormalMap { nested, texture, .. } => {
                    modifiers.push(("normalmap", *texture));
                    at = *nested;
                }
                BsdfDesc::Mask { nested, .. } => at = *nested,
                _ => break,
            }
        }
        let _ = write!(self.text, "MakeNamedMaterial \"m{i}\"");
        self.model(&desc[at].value, node.span);
        for (name, texture) in modifiers {
            if name == "displacement" {
                self.texture_ref(name, "f", texture);
            } else if let TextureDesc::Bitmap(b) = &desc[texture].value {
                let file = self.files.image(desc, b.image)?;
                self.string(name, &file);
            } else {
                self.lose(node.span, "normal map that is no picture", "left out");
            }
        }
        self.text.push('\n');
        Ok(())
    }

    fn model(&mut self, bsdf: &BsdfDesc, span: Span) {
        let not_white = |c: &Color| *c != Color::gray(1.0);
        match bsdf {
            BsdfDesc::Diffuse { reflectance, alpha } => {
                if alpha.is_some() {
                    self.lose(span, "rough diffuse bsdf", "diffuse");
                }
                self.string("type", "diffuse");
                self.color("reflectance", *reflectance);
            }
            BsdfDesc::DiffuseTransmission { reflectance, transmittance } => {
                self.string("type", "diffusetransmission");
                self.color("reflectance", *reflectance);
                self.color("transmittance", *transmittance);
            }
            BsdfDesc::Conductor { eta, k, specular_reflectance, roughness } => {
                self.string("type", "conductor");
                match eta {
                    Some(eta) => {
                        if not_white(specular_reflectance) {
                            self.lose(span, "tint of a conductor", "its own color");
                        }
                        self.color("eta", *eta);
                        self.color("k", *k);
                    }
                    None => self.color("reflectance", *specular_reflectance),
                }
                self.roughness("", roughness);
            }
            BsdfDesc::Dielectric { int_ior, ext_ior, specular_reflectance, specular_transmittance, roughness } => {
                if not_white(specular_reflectance) || not_white(specular_transmittance) {
                    self.lose(span, "tint of a dielectric", "clear");
                }
                self.string("type", "dielectric");
                self.float("eta", int_ior / ext_ior);
                self.roughness("", roughness);
            }
            BsdfDesc::ThinDielectric { int_ior, ext_ior, .. } => {
                self.string("type", "thindielectric");
                self.float("eta", int_ior / ext_ior);
            }
            BsdfDesc::Plastic { diffuse_reflectance, int_ior, ext_ior, roughness, nonlinear, .. } => {
                if !nonlinear {
                    self.lose(span, "plastic without interreflection in the coat", "with it");
                }
                self.string("type", "coateddiffuse");
                self.color("reflectance", *diffuse_reflectance);
                self.float("eta", int_ior / ext_ior);
                self.roughness("", roughness);
            }
            BsdfDesc::Coated { base, int_ior, ext_ior, roughness, .. } => {
                let desc = self.desc;
                match &desc[*base].value {
                    BsdfDesc::Conductor { eta: Some(Param::Constant(eta)), k: Param::Constant(k), roughness: inner, .. } => {
                        let over = int_ior / ext_ior;
                        self.string("type", "coatedconductor");
                        self.float("interface.eta", over);
                        self.rgb("conductor.eta", eta.map(|v| v * over));
                        self.rgb("conductor.k", k.map(|v| v * over));
                        self.roughness("conductor.", inner);
                        self.roughness("interface.", roughness);
                    }
                    BsdfDesc::Diffuse { reflectance, .. } => {
                        self.string("type", "coateddiffuse");
                        self.color("reflectance", *reflectance);
                        self.float("eta", int_ior / ext_ior);
                        self.roughness("", roughness);
                    }
                    other => {
                        self.lose(span, "coat over this model", "the model without it");
                        self.model(other, span);
                    }
                }
            }
            BsdfDesc::Principled(p) => self.principled(p, span),
            BsdfDesc::Pbr(p) => self.pbr(p, span),
            BsdfDesc::Blend { first, second, weight } => {
                self.string("type", "mix");
                let _ = write!(
                    self.text,
                    " \"string materials\" [\"m{}\" \"m{}\"]",
                    self.material_number(*first),
                    self.material_number(*second)
                );
                self.scalar("amount", *weight);
            }
            BsdfDesc::Null => self.string("type", "interface"),
            // Taken off by the caller.
            BsdfDesc::Mask { .. } | BsdfDesc::TwoSided { .. } | BsdfDesc::BumpMap { .. } | BsdfDesc::NormalMap { .. } => {
                self.string("type", "diffuse");
            }
        }
    }

    fn principled(&mut self, p: &PrincipledDesc, span: Span) {
        let constant = |s: Scalar, default: f32| if let Param::Constant(v) = s { v } else { default };
        self.general(
            &General {
                base_color: p.base_color,
                roughness: constant(p.roughness, 0.5),
                metallic: constant(p.metallic, 0.0),
                transmission: constant(p.spec_trans, 0.0),
                ior: constant(p.eta, 1.5),
            },
            span,
            "principled bsdf",
        );
    }

    fn pbr(&mut self, p: &PbrDesc, span: Span) {
        let constant = |s: Scalar, default: f32| if let Param::Constant(v) = s { v } else { default };
        self.general(
            &General {
                base_color: p.base_color,
                roughness: constant(p.roughness, 0.5),
                metallic: constant(p.metallic, 0.0),
                transmission: constant(p.transmission, 0.0),
                ior: p.ior,
            },
            span,
            "pbr bsdf",
        );
    }

    /// The nearest of pbrt's materials to a general one.
    fn general(&mut self, g: &General, span: Span, what: &str) {
        let alpha = g.roughness * g.roughness;
        if g.metallic > 0.5 {
            self.lose(span, what, "conductor");
            self.string("type", "conductor");
            self.color("reflectance", g.base_color);
            self.float("roughness", alpha);
        } else if g.transmission > 0.5 {
            self.lose(span, what, "dielectric");
            self.string("type", "dielectric");
            self.float("eta", g.ior);
            self.float("roughness", alpha);
        } else {
            self.lose(span, what, "coateddiffuse");
            self.string("type", "coateddiffuse");
            self.color("reflectance", g.base_color);
            self.float("eta", g.ior);
            self.float("roughness", alpha);
        }
        self.boolean("remaproughness", false);
    }

    fn roughness(&mut self, prefix: &str, roughness: &Option<Roughness>) {
        if let Some(r) = roughness {
            if r.alpha_u == r.alpha_v {
                self.scalar(&format!("{prefix}roughness"), r.alpha_u);
            } else {
                self.scalar(&format!("{prefix}uroughness"), r.alpha_u);
                self.scalar(&format!("{prefix}vroughness"), r.alpha_v);
            }
            if prefix != "conductor." {
                self.boolean("remaproughness", false);
            }
        }
    }
}

/// What pbrt has nearest materials for.
struct General {
    base_color: Color,
    roughness: f32,
    metallic: f32,
    transmission: f32,
    ior: f32,
}
