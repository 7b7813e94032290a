//! Images, samplers and texture references.

use glam::{Mat3, Vec2};

use super::Reader;
use crate::desc::{
    AddNode, BitmapDesc, Channel, Color, Encoding, ImageDesc, ImageId, ImageSource, Node, Scalar, TextureDesc, TextureFilter, TextureId,
    Wrap,
};
use crate::formats::gltf::container::{data_uri, file_name};
use crate::formats::gltf::json::Value;

/// What tells one use of a picture from another.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct BitmapKey {
    texture: usize,
    uv_set: u32,
    transform: [u32; 9],
    srgb: bool,
    channel: u8,
}

/// A texture as a material refers to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct TextureInfo<'a> {
    pub at: &'a Value<'a>,
    texture: usize,
    uv_set: u32,
    picture_from_uv: Mat3,
}

/// v → 1 − v.
const FLIP_V: Mat3 = Mat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 1.0]);

impl<'a> Reader<'a> {
    /// The textureInfo of that name.
    pub(super) fn texture_info(&mut self, object: &'a Value<'a>, key: &str) -> Option<TextureInfo<'a>> {
        let at = self.object(object, key)?;
        self.required(at, "index")?;
        let (texture, _) = self.reference(at, "index", "textures")?;
        let mut uv_set = self.integer(at, "texCoord").unwrap_or(0);
        let mut transform = Mat3::IDENTITY;
        if let Some(t) = self.extension(at, "KHR_texture_transform") {
            let offset = Vec2::from_array(self.floats(t, "offset").unwrap_or([0.0; 2]));
            let scale = self.floats(t, "scale").unwrap_or([1.0; 2]);
            let (sin, cos) = f64::from(self.float(t, "rotation", 0.0)).sin_cos();
            let (sin, cos) = (sin as f32, cos as f32);
            // Counter-clockwise as one sees it, with v down: (u, v) → (c u + s v, −s u + c v).
            let rotation = Mat3::from_cols_array(&[cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0]);
            transform = Mat3::from_translation(offset) * rotation * Mat3::from_scale(Vec2::from_array(scale));
            uv_set = self.integer(t, "texCoord").unwrap_or(uv_set);
        }
        if uv_set >= 8 {
            self.warning(at, format!("texture coordinates of set {uv_set}; only sets 0 to 7 are read, set 0 is taken"));
            uv_set = 0;
        }
        let picture_from_uv = if transform == Mat3::IDENTITY { transform } else { FLIP_V * transform * FLIP_V };
        Some(TextureInfo { at, texture, uv_set: uv_set as u32, picture_from_uv })
    }

    /// The texture that a reference stands for; `None` where its picture cannot be used.
    pub(super) fn bitmap(&mut self, info: &TextureInfo<'a>, srgb: bool, channel: Channel) -> Option<TextureId> {
        let key = BitmapKey {
            texture: info.texture,
            uv_set: info.uv_set,
            transform: info.picture_from_uv.to_cols_array().map(f32::to_bits),
            srgb,
            channel: channel as u8,
        };
        if let Some(known) = self.textures.get(&key) {
            return *known;
        }
        let id = self.load_bitmap(info, srgb, channel);
        self.textures.insert(key, id);
        id
    }

    fn load_bitmap(&mut self, info: &TextureInfo<'a>, srgb: bool, channel: Channel) -> Option<TextureId> {
        let texture = &self.list("textures")[info.texture];
        let image = self.texture_image(texture)?;
        let (wrap, filter) = match self.reference(texture, "sampler", "samplers") {
            Some((_, sampler)) => self.sampler(sampler),
            None => ([Wrap::Repeat; 2], TextureFilter::Trilinear),
        };
        let bitmap = BitmapDesc {
            image,
            encoding: if srgb { Encoding::Srgb } else { Encoding::Linear },
            wrap,
            filter,
            picture_from_uv: info.picture_from_uv,
            channel,
            uv_set: info.uv_set,
        };
        let node = Node::named(self.name(texture), self.span(info.at), TextureDesc::Bitmap(bitmap));
        Some(self.desc.add(node))
    }

    fn sampler(&mut self, sampler: &'a Value<'a>) -> ([Wrap; 2], TextureFilter) {
        let mut wrap = [Wrap::Repeat; 2];
        for (w, key) in wrap.iter_mut().zip(["wrapS", "wrapT"]) {
            *w = match self.integer(sampler, key) {
                None | Some(10497) => Wrap::Repeat,
                Some(33071) => Wrap::Clamp,
                Some(33648) => Wrap::Mirror,
                Some(other) => {
                    self.warning(sampler, format!("unknown {key} {other}; the picture repeats"));
                    Wrap::Repeat
                }
            };
        }
        let mag = self.integer(sampler, "magFilter");
        let filter = match (mag, self.integer(sampler, "minFilter")) {
            (Some(9728), _) => TextureFilter::Nearest,
            (_, Some(9728 | 9729)) => TextureFilter::Bilinear,
            _ => TextureFilter::Trilinear,
        };
        (wrap, filter)
    }

    /// The picture of a texture: WebP where the file offers it, otherwise PNG or JPEG, otherwise KTX2.
    fn texture_image(&mut self, texture: &'a Value<'a>) -> Option<ImageId> {
        if let Some(webp) = self.extension(texture, "EXT_texture_webp")
            && let Some((i, image)) = self.reference(webp, "source", "images")
        {
            return self.image(i, image);
        }
        if let Some((i, image)) = self.reference(texture, "source", "images") {
            return self.image(i, image);
        }
        if let Some(basis) = self.extension(texture, "KHR_texture_basisu")
            && let Some((i, image)) = self.reference(basis, "source", "images")
        {
            return self.image(i, image);
        }
        for name in ["EXT_texture_avif", "MSFT_texture_dds"] {
            if let Some(extension) = self.extension(texture, name) {
                self.loss(extension, name, "texture ignored: there is no PNG, JPEG, WebP or KTX2 beside it");
                return None;
            }
        }
        self.warning(texture, "a texture without `source`; ignored");
        None
    }

    fn image(&mut self, i: usize, image: &'a Value<'a>) -> Option<ImageId> {
        if let Some(known) = self.images.get(&i) {
            return *known;
        }
        let id = self.load_image(image).map(|source| {
            let node = Node::named(self.name(image), self.span(image), ImageDesc { source });
            self.desc.add(node)
        });
        self.images.insert(i, id);
        id
    }

    fn load_image(&mut self, image: &'a Value<'a>) -> Option<ImageSource> {
        let source = if image.get("bufferView").is_some() {
            let (i, view) = self.reference(image, "bufferView", "bufferViews")?;
            let bytes = self.view(i, view)?;
            if !self.spend(image, bytes.len() as u64) {
                return None;
            }
            ImageSource::Embedded(bytes.to_vec())
        } else {
            self.required(image, "uri")?;
            let uri = self.string(image, "uri")?;
            match data_uri(uri) {
                Some(Ok(bytes)) => ImageSource::Embedded(bytes),
                Some(Err(reason)) => {
                    self.error(image, reason);
                    return None;
                }
                None => match self.resolver.resolve(&self.folder, &file_name(uri)) {
                    Ok(path) => ImageSource::File(path),
                    Err(e) => {
                        self.error(image, e.to_string());
                        return None;
                    }
                },
            }
        };
        Some(source)
    }

    fn add_texture(&mut self, at: &Value<'_>, texture: TextureDesc) -> TextureId {
        self.desc.add(Node::new(self.places.span_of(at), texture))
    }

    /// A factor on a color texture.
    pub(super) fn color_times(&mut self, at: &'a Value<'a>, factor: [f32; 3], color: Color) -> Color {
        match color {
            Color::Constant(c) => Color::Constant(std::array::from_fn(|i| c[i] * factor[i])),
            Color::Texture(_) if factor == [1.0; 3] => color,
            Color::Texture(_) => Color::Texture(self.add_texture(at, TextureDesc::Multiply { a: Color::Constant(factor), b: color })),
        }
    }

    /// The product of two colors.
    pub(super) fn product(&mut self, at: &'a Value<'a>, a: Color, b: Color) -> Color {
        match (a, b) {
            (Color::Constant(f), _) => self.color_times(at, f, b),
            (_, Color::Constant(f)) => self.color_times(at, f, a),
            _ => Color::Texture(self.add_texture(at, TextureDesc::Multiply { a, b })),
        }
    }

    /// `scale` · value + `offset`, clamped where a range is given.
    pub(super) fn affine(&mut self, at: &'a Value<'a>, value: Scalar, scale: f32, offset: f32, clamp: Option<[f32; 2]>) -> Scalar {
        match value {
            Scalar::Constant(v) => {
                let v = scale * v + offset;
                Scalar::Constant(clamp.map_or(v, |[a, b]| v.clamp(a, b)))
            }
            Scalar::Texture(_) if scale == 1.0 && offset == 0.0 && clamp.is_none() => value,
            Scalar::Texture(texture) => Scalar::Texture(self.add_texture(at, TextureDesc::Affine { texture, scale, offset, clamp })),
        }
    }

    /// The product of two numbers that may vary over the surface.
    pub(super) fn scalar_product(&mut self, at: &'a Value<'a>, a: Scalar, b: Scalar) -> Scalar {
        match (a, b) {
            (Scalar::Constant(f), _) => self.affine(at, b, f, 0.0, None),
            (_, Scalar::Constant(f)) => self.affine(at, a, f, 0.0, None),
            (Scalar::Texture(a), Scalar::Texture(b)) => {
                Scalar::Texture(self.add_texture(at, TextureDesc::Multiply { a: Color::Texture(a), b: Color::Texture(b) }))
            }
        }
    }

    /// A vertex attribute as a texture.
    pub(super) fn attribute(&mut self, at: &'a Value<'a>, name: &str) -> TextureId {
        self.add_texture(at, TextureDesc::Attribute { name: name.to_owned(), scale: 1.0 })
    }

    /// A color that is zero where a number is zero: `color` · `weight`.
    pub(super) fn faded(&mut self, at: &'a Value<'a>, color: Color, weight: Scalar) -> Color {
        match weight {
            Scalar::Constant(w) => self.color_times(at, [w; 3], color),
            Scalar::Texture(_) => Color::Texture(self.add_texture(at, TextureDesc::Mix { a: Color::gray(0.0), b: color, weight })),
        }
    }

    /// A color factor times the texture of that name.
    pub(super) fn color_param(&mut self, object: &'a Value<'a>, factor: [f32; 3], key: &str) -> Color {
        let texture = self.texture_info(object, key).and_then(|info| self.bitmap(&info, true, Channel::Luminance));
        match texture {
            Some(id) => self.color_times(object, factor, Color::Texture(id)),
            None => Color::Constant(factor),
        }
    }

    /// A factor times a channel of the texture of that name. Alpha is linear in sRGB pictures too, so it shares the color's encoding.
    pub(super) fn scalar_param(&mut self, object: &'a Value<'a>, factor: f32, key: &str, channel: Channel) -> Scalar {
        let texture = self.texture_info(object, key).and_then(|info| self.bitmap(&info, channel == Channel::A, channel));
        match texture {
            Some(id) => self.affine(object, Scalar::Texture(id), factor, 0.0, None),
            None => Scalar::Constant(factor),
        }
    }
}
