//! Textures, and material parameters that may be textures.

use etendue_procedural::SolidPattern;
use etendue_procedural::solid_pattern::MOST_OCTAVES;
use glam::{Mat3, Mat4, Vec2, Vec3, Vec4};

use super::Reader;
use super::params::Params;
use super::spectrum::SpectrumKind;
use crate::desc::{
    AddNode, BitmapDesc, Channel, Color, Encoding, Node, PatternSpace, Projection, Scalar, TextureDesc, TextureFilter, TextureId, Wrap,
};

/// Where a texture takes its two coordinates from.
enum Mapping {
    /// From the shape's, by `picture_from_uv`.
    Uv(Mat3),
    /// From the place, by `pattern_from_world`.
    Projected(Projection, Mat4),
}

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
                let (facing, other) = (self.any(p, "tex1", float, 0.0), self.any(p, "tex2", float, 1.0));
                let direction = p.vector("dir", Vec3::Y, &mut self.desc.report).as_dvec3();
                let Some(direction) = self.state.transform().transform_vector3(direction).try_normalize() else {
                    self.error(p.span, "`dir` must not be zero");
                    return;
                };
                let weight = Scalar::Texture(self.part(p, TextureDesc::Facing { direction: direction.as_vec3() }));
                TextureDesc::Mix { a: other, b: facing, weight }
            }
            "checkerboard" => {
                let (color0, color1) = (self.any(p, "tex1", float, 1.0), self.any(p, "tex2", float, 0.0));
                match p.opt_integer("dimension", &mut self.desc.report).unwrap_or(2) {
                    2 => self.squares(p, color0, color1),
                    3 => {
                        let weight = self.solid(p, SolidPattern::Cubes);
                        TextureDesc::Mix { a: color0, b: color1, weight: Scalar::Texture(self.part(p, weight)) }
                    }
                    other => {
                        self.error(p.span, format!("a checkerboard has 2 or 3 dimensions, not {other}"));
                        return;
                    }
                }
            }
            "dots" => {
                let inside = self.any(p, "inside", float, 1.0);
                let outside = self.any(p, "outside", float, 0.0);
                let mapping = self.mapping(p);
                let dots = |m| TextureDesc::Solid { pattern: SolidPattern::Dots, space: PatternSpace::Uv(m) };
                let weight = self.mapped(p, &mapping, dots);
                TextureDesc::Mix { a: outside, b: inside, weight: Scalar::Texture(self.part(p, weight)) }
            }
            "bilerp" => {
                let corners = ["v00", "v01", "v10", "v11"].map(|n| self.constant(p, n, float, if n.ends_with('1') { 1.0 } else { 0.0 }));
                self.bilerp(p, corners.map(Color::Constant))
            }
            "imagemap" => match self.image_map(p) {
                Some(desc) => desc,
                None => return,
            },
            "fbm" | "wrinkled" | "windy" if !float => {
                self.error(p.span, format!("`{class}` is a texture of floats; a `mix` makes colors of it"));
                return;
            }
            "marble" if float => {
                self.error(p.span, "`marble` is a texture of spectra");
                return;
            }
            "fbm" => {
                let (octaves, roughness) = self.octaves(p);
                self.solid(p, SolidPattern::Fbm { octaves, roughness })
            }
            "wrinkled" => {
                let (octaves, roughness) = self.octaves(p);
                self.solid(p, SolidPattern::Turbulence { octaves, roughness })
            }
            "windy" => self.solid(p, SolidPattern::Windy),
            "marble" => {
                let (octaves, roughness) = self.octaves(p);
                let r = &mut self.desc.report;
                let (scale, variation) = (p.float("scale", 1.0, r), p.float("variation", 0.2, r));
                self.solid(p, SolidPattern::Marble { octaves, roughness, scale, variation })
            }
            "ptex" => {
                p.ignore(&["filename", "encoding", "scale"]);
                self.loss(p.span, "Texture \"ptex\"", "a constant 0.5");
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
                desc => Scalar::Texture(self.add_texture(name, p, desc)),
            };
            self.float_textures.insert(name.to_owned(), value);
        } else {
            let id = self.add_texture(name, p, desc);
            self.spectrum_textures.insert(name.to_owned(), id);
        }
    }

    /// A node, of which is kept whether its values may lie beyond [0, 1] by a pattern.
    fn add_texture(&mut self, name: &str, p: &Params, desc: TextureDesc) -> TextureId {
        let color = |c: &Color| matches!(c, Color::Texture(id) if self.unbounded.contains(id));
        let unbounded = match &desc {
            TextureDesc::Solid { pattern, .. } => pattern.is_unbounded(),
            TextureDesc::Projected { texture, .. } | TextureDesc::Affine { texture, clamp: None, .. } => self.unbounded.contains(texture),
            TextureDesc::Multiply { a, b } => color(a) || color(b),
            TextureDesc::Mix { a, b, weight } => {
                color(a) || color(b) || matches!(weight, Scalar::Texture(id) if self.unbounded.contains(id))
            }
            TextureDesc::Checkerboard { color0, color1, .. } => color(color0) || color(color1),
            _ => false,
        };
        let id = self.desc.add(Node::named(name, p.span, desc));
        if unbounded {
            self.unbounded.insert(id);
        }
        id
    }

    /// A node that a texture is made of.
    fn part(&mut self, p: &Params, desc: TextureDesc) -> TextureId {
        self.add_texture("", p, desc)
    }

    /// The space that the current transform places in the world: `pattern_from_world`.
    fn texture_space(&mut self, p: &Params) -> Mat4 {
        self.check_motion(p.span);
        let m = self.state.transform().inverse().as_mat4();
        if m.is_finite() {
            return m;
        }
        self.error(p.span, "the texture's transform cannot be inverted");
        Mat4::IDENTITY
    }

    /// A pattern in the texture's space.
    fn solid(&mut self, p: &Params, pattern: SolidPattern) -> TextureDesc {
        TextureDesc::Solid { pattern, space: PatternSpace::World(self.texture_space(p)) }
    }

    fn octaves(&mut self, p: &Params) -> (u32, f32) {
        let r = &mut self.desc.report;
        let octaves = p.opt_integer("octaves", r).unwrap_or(8);
        if octaves > i64::from(MOST_OCTAVES) {
            r.loss(p.span, format!("{octaves} octaves of noise"), format!("{MOST_OCTAVES}: the others are finer than numbers tell apart"));
        }
        (octaves.clamp(0, i64::from(MOST_OCTAVES)) as u32, p.float("roughness", 0.5, r))
    }

    /// A checkerboard over two coordinates.
    fn squares(&mut self, p: &Params, color0: Color, color1: Color) -> TextureDesc {
        let half = Mat3::from_scale(Vec2::splat(0.5));
        match self.mapping(p) {
            Mapping::Uv(m) => TextureDesc::Checkerboard { color0, color1, pattern_from_uv: half * m },
            // The colors keep the coordinates of their own.
            mapping => {
                let squares =
                    |m| TextureDesc::Checkerboard { color0: Color::gray(0.0), color1: Color::gray(1.0), pattern_from_uv: half * m };
                let weight = self.mapped(p, &mapping, squares);
                TextureDesc::Mix { a: color0, b: color1, weight: Scalar::Texture(self.part(p, weight)) }
            }
        }
    }

    /// Between the colors at (0, 0), (0, 1), (1, 0), (1, 1), and beyond as lines go on.
    fn bilerp(&mut self, p: &Params, [c00, c01, c10, c11]: [Color; 4]) -> TextureDesc {
        let mapping = self.mapping(p);
        let swap = Mat3::from_cols(Vec3::Y, Vec3::X, Vec3::Z);
        let [s, t] = [Mat3::IDENTITY, swap].map(|turn| {
            let coordinate = |m| TextureDesc::Solid { pattern: SolidPattern::Coordinate, space: PatternSpace::Uv(turn * m) };
            let desc = self.mapped(p, &mapping, coordinate);
            Scalar::Texture(self.part(p, desc))
        });
        let [a, b] = [(c00, c10), (c01, c11)].map(|(a, b)| Color::Texture(self.part(p, TextureDesc::Mix { a, b, weight: s })));
        TextureDesc::Mix { a, b, weight: t }
    }

    /// A texture over the coordinates of a mapping; `make` is given `picture_from_uv`.
    fn mapped(&mut self, p: &Params, mapping: &Mapping, make: impl FnOnce(Mat3) -> TextureDesc) -> TextureDesc {
        match mapping {
            Mapping::Uv(m) => make(*m),
            Mapping::Projected(projection, pattern_from_world) => {
                let texture = self.part(p, make(Mat3::IDENTITY));
                TextureDesc::Projected { texture, projection: *projection, pattern_from_world: *pattern_from_world }
            }
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
            Some(id) if kind == SpectrumKind::Albedo && self.unbounded.contains(id) => {
                // No surface reflects less than nothing or more than all.
                let clamped = TextureDesc::Affine { texture: *id, scale: 1.0, offset: 0.0, clamp: Some([0.0, 1.0]) };
                let known = self.clamped.get(id).copied();
                let clamped = known.unwrap_or_else(|| self.desc.add(Node::new(p.span, clamped)));
                self.clamped.insert(*id, clamped);
                Color::Texture(clamped)
            }
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

    /// The texture's mapping.
    fn mapping(&mut self, p: &Params) -> Mapping {
        let r = &mut self.desc.report;
        let kind = p.opt_text("mapping", r).unwrap_or("uv").to_owned();
        let projection = match kind.as_str() {
            "uv" => {
                let (su, sv) = (p.float("uscale", 1.0, r), p.float("vscale", 1.0, r));
                let (du, dv) = (p.float("udelta", 0.0, r), p.float("vdelta", 0.0, r));
                return Mapping::Uv(Mat3::from_cols_array(&[su, 0.0, 0.0, 0.0, sv, 0.0, du, dv, 1.0]));
            }
            "planar" => {
                let (v1, v2) = (p.vector("v1", Vec3::X, r), p.vector("v2", Vec3::Y, r));
                let (du, dv) = (p.float("udelta", 0.0, r), p.float("vdelta", 0.0, r));
                let axes = Mat4::from_cols(v1.extend(du), v2.extend(dv), Vec4::ZERO, Vec4::W).transpose();
                return Mapping::Projected(Projection::Planar, axes * self.texture_space(p));
            }
            "spherical" => Projection::Spherical,
            "cylindrical" => Projection::Cylindrical,
            _ => {
                r.error(p.span, format!("no mapping `{kind}`; there are uv, spherical, cylindrical, planar"));
                return Mapping::Uv(Mat3::IDENTITY);
            }
        };
        Mapping::Projected(projection, self.texture_space(p))
    }

    fn image_map(&mut self, p: &Params) -> Option<TextureDesc> {
        let mapping = self.mapping(p);
        let r = &mut self.desc.report;
        let Some(name) = p.opt_text("filename", r).map(str::to_owned) else {
            r.error(p.span, "an imagemap needs a `filename`");
            return None;
        };
        let wrap = match p.opt_text("wrap", r).unwrap_or("repeat") {
            "repeat" => Wrap::Repeat,
            "clamp" => Wrap::Clamp,
            "black" => Wrap::Black,
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
        let bitmap = |picture_from_uv| {
            let (wrap, channel) = ([wrap; 2], Channel::Luminance);
            TextureDesc::Bitmap(BitmapDesc { image, encoding, wrap, filter, picture_from_uv, channel, uv_set: 0 })
        };
        let bitmap = self.mapped(p, &mapping, bitmap);
        if scale == 1.0 && !invert {
            return Some(bitmap);
        }
        let texture: TextureId = self.desc.add(Node::named(&name, p.span, bitmap));
        let (scale, offset) = if invert { (-scale, 1.0) } else { (scale, 0.0) };
        Some(TextureDesc::Affine { texture, scale, offset, clamp: Some([0.0, f32::MAX]) })
    }
}
