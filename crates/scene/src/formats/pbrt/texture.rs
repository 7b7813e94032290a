//! Textures, and material parameters that may be textures.

use glam::{Mat3, Vec2};

use super::Reader;
use super::params::Params;
use super::spectrum::SpectrumKind;
use crate::desc::{AddNode, BitmapDesc, Channel, Color, Encoding, Node, Scalar, TextureDesc, TextureFilter, TextureId, Wrap};

impl Reader {
    /// `Texture "name" "float|spectrum" "class"`
    pub(super) fn texture(&mut self, name: &str, value: &str, class: &str, p: &Params) {
        if !["float", "spectrum"].contains(&value) {
            self.error(p.span, format!("a texture is float or spectrum, not `{value}`"));
            return;
        }
        let float = value == "float";
        let desc = match class {
            "constant" => TextureDesc::Constant { value: self.constant(p, "value", float, 1.0) },
            "scale" => {
                let tex = self.any(p, "tex", float, 1.0);
                let scale = self.any(p, "scale", true, 1.0);
                TextureDesc::Multiply { a: tex, b: scale }
            }
            "mix" => {
                let (a, b) = (self.any(p, "tex1", float, 0.0), self.any(p, "tex2", float, 1.0));
                TextureDesc::Mix { a, b, weight: self.scalar(p, "amount", 0.5) }
            }
            "directionmix" => {
                let (a, b) = (self.any(p, "tex1", float, 0.0), self.any(p, "tex2", float, 1.0));
                p.ignore(&["dir"]);
                self.loss(p.span, "Texture \"directionmix\"", "an equal mix of both");
                TextureDesc::Mix { a, b, weight: Scalar::Constant(0.5) }
            }
            "checkerboard" => {
                if p.opt_integer("dimension", &mut self.desc.report).unwrap_or(2) != 2 {
                    self.loss(p.span, "a checkerboard of three dimensions", "one over texture coordinates");
                }
                let (color0, color1) = (self.any(p, "tex1", float, 1.0), self.any(p, "tex2", float, 0.0));
                let pattern_from_uv = Mat3::from_scale(Vec2::splat(0.5)) * self.mapping(p);
                TextureDesc::Checkerboard { color0, color1, pattern_from_uv }
            }
            "dots" => {
                let inside = self.any(p, "inside", float, 1.0);
                let outside = self.any(p, "outside", float, 0.0);
                self.mapping(p);
                self.loss(p.span, "Texture \"dots\"", "a mix of inside and outside by their area");
                // Half of the cells have a dot of radius 0.35.
                TextureDesc::Mix { a: outside, b: inside, weight: Scalar::Constant(0.19) }
            }
            "bilerp" => {
                let corners = ["v00", "v01", "v10", "v11"].map(|n| self.constant(p, n, float, if n.ends_with('1') { 1.0 } else { 0.0 }));
                self.mapping(p);
                self.loss(p.span, "Texture \"bilerp\"", "the mean of its corners");
                TextureDesc::Constant { value: std::array::from_fn(|i| corners.iter().map(|c| c[i]).sum::<f32>() / 4.0) }
            }
            "imagemap" => match self.image_map(p) {
                Some(desc) => desc,
                None => return,
            },
            "fbm" | "wrinkled" | "windy" | "marble" | "ptex" => {
                p.ignore(&["octaves", "roughness", "scale", "variation", "filename", "encoding", "mapping"]);
                self.loss(p.span, format!("Texture \"{class}\""), "a constant 0.5");
                TextureDesc::Constant { value: [0.5; 3] }
            }
            _ => {
                self.error(p.span, format!("no texture `{class}`"));
                return;
            }
        };
        if float {
            let value = match desc {
                TextureDesc::Constant { value } => Scalar::Constant(value[0]),
                desc => Scalar::Texture(self.desc.add(Node::named(name, p.span, desc))),
            };
            self.float_textures.insert(name.to_owned(), value);
        } else {
            let id = self.desc.add(Node::named(name, p.span, desc));
            self.spectrum_textures.insert(name.to_owned(), id);
        }
    }

    fn constant(&mut self, p: &Params, name: &str, float: bool, default: f32) -> [f32; 3] {
        if float {
            return [p.float(name, default, &mut self.desc.report); 3];
        }
        p.get(name).and_then(|q| self.color(q, SpectrumKind::Unbounded)).unwrap_or([default; 3])
    }

    /// A parameter of a texture: constant or texture, as a color in either case.
    fn any(&mut self, p: &Params, name: &str, float: bool, default: f32) -> Color {
        if float {
            match self.scalar(p, name, default) {
                Scalar::Constant(v) => Color::gray(v),
                Scalar::Texture(id) => Color::Texture(id),
            }
        } else {
            self.color_param(p, name, SpectrumKind::Unbounded, [default; 3])
        }
    }

    /// A color parameter of a material: a constant or a spectrum texture.
    pub(super) fn color_param(&mut self, p: &Params, name: &str, kind: SpectrumKind, default: [f32; 3]) -> Color {
        let Some(q) = p.get(name) else { return Color::Constant(default) };
        if q.kind != "texture" {
            return Color::Constant(self.color(q, kind).unwrap_or(default));
        }
        let texture = q.text().unwrap_or_default();
        match self.spectrum_textures.get(texture) {
            Some(id) => Color::Texture(*id),
            None => {
                self.error(q.span, format!("no spectrum texture `{texture}`"));
                Color::Constant(default)
            }
        }
    }

    /// A number of a material: a constant or a float texture.
    pub(super) fn scalar(&mut self, p: &Params, name: &str, default: f32) -> Scalar {
        self.opt_scalar(p, name).unwrap_or(Scalar::Constant(default))
    }

    /// A number of a material, where the file gives it.
    pub(super) fn opt_scalar(&mut self, p: &Params, name: &str) -> Option<Scalar> {
        let q = p.get(name)?;
        if q.kind != "texture" {
            return p.opt_float(name, &mut self.desc.report).map(Scalar::Constant);
        }
        let texture = q.text().unwrap_or_default();
        let found = self.float_textures.get(texture).copied();
        if found.is_none() {
            self.error(q.span, format!("no float texture `{texture}`"));
        }
        found
    }

    /// `picture_from_uv` of the texture's mapping.
    fn mapping(&mut self, p: &Params) -> Mat3 {
        let r = &mut self.desc.report;
        let kind = p.opt_text("mapping", r).unwrap_or("uv").to_owned();
        if kind != "uv" {
            p.ignore(&["v1", "v2"]);
            r.loss(p.span, format!("mapping \"{kind}\" of a texture"), "texture coordinates");
        }
        let (su, sv) = (p.float("uscale", 1.0, r), p.float("vscale", 1.0, r));
        let (du, dv) = (p.float("udelta", 0.0, r), p.float("vdelta", 0.0, r));
        Mat3::from_cols_array(&[su, 0.0, 0.0, 0.0, sv, 0.0, du, dv, 1.0])
    }

    fn image_map(&mut self, p: &Params) -> Option<TextureDesc> {
        let picture_from_uv = self.mapping(p);
        let r = &mut self.desc.report;
        let Some(name) = p.opt_text("filename", r).map(str::to_owned) else {
            r.error(p.span, "an imagemap needs a `filename`");
            return None;
        };
        let wrap = match p.opt_text("wrap", r).unwrap_or("repeat") {
            "repeat" => Wrap::Repeat,
            "clamp" => Wrap::Clamp,
            "black" => {
                r.loss(p.span, "wrap \"black\"", "the edge goes on");
                Wrap::Clamp
            }
            other => {
                let message = format!("no wrap mode `{other}`; there are repeat, black, clamp");
                r.error(p.span, message);
                Wrap::Repeat
            }
        };
        let filter = match p.opt_text("filter", r).unwrap_or("bilinear") {
            "point" => TextureFilter::Nearest,
            "trilinear" | "ewa" | "EWA" => TextureFilter::Trilinear,
            _ => TextureFilter::Bilinear,
        };
        let encoding = match p.opt_text("encoding", r) {
            None => Encoding::Auto,
            Some("sRGB" | "srgb") => Encoding::Srgb,
            Some("linear") => Encoding::Linear,
            Some(other) => {
                let feature = format!("encoding \"{other}\"");
                r.loss(p.span, feature, "sRGB");
                Encoding::Srgb
            }
        };
        p.ignore(&["maxanisotropy"]);
        let scale = p.float("scale", 1.0, r);
        let invert = p.boolean("invert", false, r);
        let span = p.get("filename").map_or(p.span, |q| q.span);
        let image = self.image(&name, span)?;
        let bitmap = TextureDesc::Bitmap(BitmapDesc {
            image,
            encoding,
            wrap: [wrap; 2],
            filter,
            picture_from_uv,
            channel: Channel::Luminance,
            uv_set: 0,
        });
        if scale == 1.0 && !invert {
            return Some(bitmap);
        }
        let texture: TextureId = self.desc.add(Node::named(&name, p.span, bitmap));
        let (scale, offset) = if invert { (-scale, 1.0) } else { (scale, 0.0) };
        Some(TextureDesc::Affine { texture, scale, offset, clamp: Some([0.0, f32::MAX]) })
    }
}
