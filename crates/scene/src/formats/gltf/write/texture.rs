//! Textures: what of a texture graph glTF can say, pictures, samplers.

use glam::Mat3;
use serde_json::{Value, json};

use super::{Writer, png};
use crate::desc::{
    BitmapDesc, Channel, Color, Encoding, ImageDesc, ImageId, ImageSource, Scalar, TextureDesc, TextureFilter, TextureId, Wrap,
};
use crate::formats::Resolver;
use crate::span::Span;

/// A written picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Image {
    index: usize,
    /// The extension that such a picture needs.
    extension: Option<&'static str>,
}

/// A color as glTF says it: a factor, times a picture, times the color of the vertices.
#[derive(Clone, Debug)]
pub(super) struct ColorParts {
    pub factor: [f32; 3],
    pub bitmap: Option<BitmapDesc>,
    pub vertex_color: bool,
}

/// A number as glTF says it: `factor` · channel of a picture + `offset`.
#[derive(Clone, Debug)]
pub(super) struct ScalarParts {
    pub factor: f32,
    pub offset: f32,
    pub clamped: bool,
    pub bitmap: Option<BitmapDesc>,
}

impl ScalarParts {
    fn constant(factor: f32) -> Self {
        Self { factor, offset: 0.0, clamped: false, bitmap: None }
    }
}

/// How deep textures of textures are followed.
const DEPTH_LIMIT: u32 = 16;

impl Writer<'_> {
    /// Takes a color apart.
    pub(super) fn color_parts(&mut self, color: Color, span: Span) -> ColorParts {
        self.color_parts_at(color, span, 0)
    }

    fn color_parts_at(&mut self, color: Color, span: Span, depth: u32) -> ColorParts {
        let plain = |factor| ColorParts { factor, bitmap: None, vertex_color: false };
        let id = match color {
            Color::Constant(c) => return plain(c),
            Color::Texture(id) => id,
        };
        let node = &self.desc[id];
        let span = if node.span == Span::default() { span } else { node.span };
        if depth > DEPTH_LIMIT {
            return plain([1.0; 3]);
        }
        match &node.value {
            TextureDesc::Constant { value } => plain(*value),
            TextureDesc::Bitmap(b) => ColorParts { bitmap: Some(b.clone()), ..plain([1.0; 3]) },
            TextureDesc::Attribute { name, scale } if name == "color" => ColorParts { vertex_color: true, ..plain([*scale; 3]) },
            TextureDesc::Multiply { a, b } => {
                let (a, b) = (self.color_parts_at(*a, span, depth + 1), self.color_parts_at(*b, span, depth + 1));
                if a.bitmap.is_some() && b.bitmap.is_some() {
                    self.loss(span, "product of two pictures", "one of the pictures written");
                }
                ColorParts {
                    factor: std::array::from_fn(|i| a.factor[i] * b.factor[i]),
                    bitmap: a.bitmap.or(b.bitmap),
                    vertex_color: a.vertex_color || b.vertex_color,
                }
            }
            // What fades with the opacity fades in glTF, too.
            TextureDesc::Mix { a: Color::Constant([0.0, 0.0, 0.0]), b, .. } => self.color_parts_at(*b, span, depth + 1),
            TextureDesc::Mix { a, b, weight } => {
                self.loss(span, "mixed texture", "written as one of the two");
                let first = matches!(weight, Scalar::Constant(w) if *w < 0.5);
                self.color_parts_at(if first { *a } else { *b }, span, depth + 1)
            }
            TextureDesc::Affine { texture, scale, offset, .. } => {
                if *offset != 0.0 {
                    self.loss(span, "texture with an offset", "written without the offset");
                }
                let mut parts = self.color_parts_at(Color::Texture(*texture), span, depth + 1);
                parts.factor = parts.factor.map(|f| f * scale);
                parts
            }
            TextureDesc::Checkerboard { color0, color1, .. } => {
                self.loss(span, "checkerboard", "written as the mean of its colors");
                let (a, b) = (self.color_parts_at(*color0, span, depth + 1), self.color_parts_at(*color1, span, depth + 1));
                plain(std::array::from_fn(|i| 0.5 * (a.factor[i] + b.factor[i])))
            }
            TextureDesc::Attribute { name, .. } => {
                self.loss(span, &format!("attribute `{name}` as texture"), "written as white");
                plain([1.0; 3])
            }
            TextureDesc::Projected { texture, .. } => {
                self.loss(span, "projected texture", "written over texture coordinates");
                self.color_parts_at(Color::Texture(*texture), span, depth + 1)
            }
            TextureDesc::Solid { pattern, .. } => {
                self.loss(span, "pattern of a texture", "written as its mean");
                plain(pattern.mean().map(|v| v.clamp(0.0, 1.0)))
            }
            TextureDesc::Facing { .. } => {
                self.loss(span, "texture by direction", "written as its mean");
                plain([0.5; 3])
            }
            TextureDesc::Power { texture, .. } => {
                self.loss(span, "power of a texture", "written as the texture");
                self.color_parts_at(Color::Texture(*texture), span, depth + 1)
            }
        }
    }

    /// Takes a number apart.
    pub(super) fn scalar_parts(&mut self, scalar: Scalar, span: Span) -> ScalarParts {
        let mut parts = ScalarParts::constant(1.0);
        let mut scalar = scalar;
        for _ in 0..DEPTH_LIMIT {
            let id = match scalar {
                Scalar::Constant(v) => {
                    return ScalarParts { factor: parts.factor * v, bitmap: None, ..parts };
                }
                Scalar::Texture(id) => id,
            };
            match &self.desc[id].value {
                TextureDesc::Bitmap(b) => return ScalarParts { bitmap: Some(b.clone()), ..parts },
                TextureDesc::Affine { texture, scale, offset, clamp } => {
                    parts.offset += parts.factor * offset;
                    parts.factor *= scale;
                    parts.clamped |= clamp.is_some();
                    scalar = Scalar::Texture(*texture);
                }
                TextureDesc::Constant { value } => scalar = Scalar::Constant(0.2126 * value[0] + 0.7152 * value[1] + 0.0722 * value[2]),
                TextureDesc::Multiply { a: Color::Constant([f, g, h]), b: Color::Texture(t) } if f == g && g == h => {
                    parts.factor *= f;
                    scalar = Scalar::Texture(*t);
                }
                _ => {
                    self.loss(span, "texture of a number", "written as 1");
                    scalar = Scalar::Constant(1.0);
                }
            }
        }
        parts
    }

    /// The textureInfo of a picture, for a slot that reads sRGB or linear values.
    pub(super) fn texture_info(&mut self, b: &BitmapDesc, srgb: bool, span: Span) -> Option<Value> {
        let image = self.image(b.image, srgb)?;
        // Pictures of decoded values are encoded as the slot wants them.
        let fits = match (&self.desc[b.image].value.source, b.encoding) {
            (ImageSource::Pixels { .. }, _) => true,
            (_, Encoding::Srgb) => srgb || b.channel == Channel::A,
            (_, Encoding::Linear) => !srgb || b.channel == Channel::A,
            (_, Encoding::Auto) => srgb,
        };
        if !fits {
            self.loss(span, "encoding of a picture", if srgb { "read as sRGB" } else { "read as linear" });
        }
        let key = format!("{:?} {:?} {:?}", image, b.wrap, b.filter);
        let texture = match self.textures.get(&key) {
            Some(known) => *known,
            None => {
                let sampler = self.sampler(b, span);
                let mut texture = json!({ "sampler": sampler });
                if let Some(name) = image.extension {
                    self.used.insert(name);
                    self.required.insert(name);
                    texture["extensions"] = json!({ name: {"source": image.index} });
                } else {
                    texture["source"] = json!(image.index);
                }
                let texture = self.push("textures", texture);
                self.textures.insert(key, texture);
                texture
            }
        };
        let mut info = json!({ "index": texture });
        if b.uv_set > 0 {
            info["texCoord"] = json!(b.uv_set);
        }
        if b.picture_from_uv != Mat3::IDENTITY {
            match transform(&b.picture_from_uv) {
                Some(t) => {
                    self.used.insert("KHR_texture_transform");
                    info["extensions"] = json!({ "KHR_texture_transform": t });
                }
                None => self.loss(span, "sheared texture coordinates", "written without the transform"),
            }
        }
        Some(info)
    }

    fn sampler(&mut self, b: &BitmapDesc, span: Span) -> usize {
        let mut black = false;
        let wrap = b.wrap.map(|w| match w {
            Wrap::Repeat => 10497,
            Wrap::Clamp => 33071,
            Wrap::Mirror => 33648,
            Wrap::Black => {
                black = true;
                33071
            }
        });
        if black {
            self.loss(span, "texture that is black beyond its edge", "the edge goes on");
        }
        let (mag, min) = match b.filter {
            TextureFilter::Nearest => (9728, 9728),
            TextureFilter::Bilinear => (9729, 9729),
            TextureFilter::Trilinear => (9729, 9987),
        };
        let sampler = json!({"wrapS": wrap[0], "wrapT": wrap[1], "magFilter": mag, "minFilter": min});
        match self.lists.get("samplers").and_then(|l| l.iter().position(|s| *s == sampler)) {
            Some(known) => known,
            None => self.push("samplers", sampler),
        }
    }

    fn image(&mut self, id: ImageId, srgb: bool) -> Option<Image> {
        if let Some(known) = self.images.get(&id) {
            return *known;
        }
        let image = self.write_image(id, srgb);
        self.images.insert(id, image);
        image
    }

    fn write_image(&mut self, id: ImageId, srgb: bool) -> Option<Image> {
        let node = &self.desc[id];
        let ImageDesc { source } = &node.value;
        let owned;
        let bytes: &[u8] = match source {
            ImageSource::Embedded(bytes) => bytes,
            ImageSource::File(path) => match Resolver::read(path) {
                Ok(bytes) => {
                    owned = bytes;
                    &owned
                }
                Err(e) => {
                    self.loss(node.span, "picture", &format!("left out: {e}"));
                    return None;
                }
            },
            ImageSource::Pixels { width, height, channels, data } => {
                let expected = u64::from(*width) * u64::from(*height) * u64::from(*channels);
                if !(1..=4).contains(channels) || expected != data.len() as u64 || expected == 0 {
                    return None;
                }
                if data.iter().any(|v| *v > 1.0) {
                    self.loss(node.span, "picture with values above 1", "clipped to 1");
                }
                owned = png::encode(*width, *height, *channels, data, srgb);
                &owned
            }
        };
        let (mime, extension) = if bytes.starts_with(b"\x89PNG") {
            ("image/png", None)
        } else if bytes.starts_with(b"\xFF\xD8\xFF") {
            ("image/jpeg", None)
        } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
            ("image/webp", Some("EXT_texture_webp"))
        } else if bytes.starts_with(b"\xABKTX 20") {
            ("image/ktx2", Some("KHR_texture_basisu"))
        } else {
            self.loss(node.span, "picture that is no PNG, JPEG, WebP or KTX2", "left out");
            return None;
        };
        let view = self.view(bytes, None);
        let mut image = json!({"bufferView": view, "mimeType": mime});
        if !node.name.is_empty() {
            image["name"] = json!(node.name);
        }
        Some(Image { index: self.push("images", image), extension })
    }

    /// The bitmap that a normal map refers to.
    pub(super) fn normal_bitmap(&mut self, id: TextureId, span: Span) -> Option<BitmapDesc> {
        if let TextureDesc::Bitmap(b) = &self.desc[id].value {
            return Some(b.clone());
        }
        self.loss(span, "normal map that is no picture", "left out");
        None
    }
}

/// KHR_texture_transform of a `picture_from_uv`; `None` where it shears.
fn transform(picture_from_uv: &Mat3) -> Option<Value> {
    // glTF's v runs the other way, before and after.
    let flip = Mat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 1.0]);
    let m = flip * *picture_from_uv * flip;
    // Columns of rotation · scale: (c sx, −s sx) and (s sy, c sy).
    let (a, b, c, d) = (f64::from(m.x_axis.x), f64::from(m.x_axis.y), f64::from(m.y_axis.x), f64::from(m.y_axis.y));
    let rotation = if a == 0.0 && b == 0.0 { c.atan2(d) } else { (-b).atan2(a) };
    let (sin, cos) = rotation.sin_cos();
    let scale = [a * cos - b * sin, c * sin + d * cos];
    let residual = (c * cos - d * sin).abs() + (a * sin + b * cos).abs();
    if residual > 1e-4 * (a.abs() + b.abs() + c.abs() + d.abs()) {
        return None;
    }
    let mut t = json!({"offset": [m.z_axis.x, m.z_axis.y], "scale": [scale[0] as f32, scale[1] as f32]});
    if rotation != 0.0 {
        t["rotation"] = json!(rotation as f32);
    }
    Some(t)
}
