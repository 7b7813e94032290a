//! Textures, spectra, and parameters that take either.

use glam::{DVec3, Mat3};

use super::Builder;
use super::props::{Props, rgb};
use crate::desc::{
    AddNode, BitmapDesc, Channel, Color, Encoding, ImageDesc, ImageId, ImageSource, Node, Param, Scalar, TextureDesc, TextureFilter,
    TextureId, Wrap,
};
use crate::formats::mitsuba::tree::{Kind, Plugin, Property, Value};
use crate::formats::spectrum::{Quantity, blackbody, rgb_from_list, rgb_from_uniform};

/// Turns v round: Mitsuba's pictures begin at v = 0, ours at v = 1.
const FLIP_V: Mat3 = Mat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 1.0]);

/// Rec. 709 luminance.
fn luminance(c: [f32; 3]) -> f32 {
    0.212671 * c[0] + 0.715160 * c[1] + 0.072169 * c[2]
}

impl<'t> Builder<'t> {
    /// A color parameter.
    pub(super) fn color(&mut self, p: &mut Props<'t>, name: &'static str, default: f32) -> Color {
        self.opt_color(p, name, Quantity::Reflectance).unwrap_or(Color::gray(default))
    }

    /// A color parameter that may be missing.
    pub(super) fn opt_color(&mut self, p: &mut Props<'t>, name: &'static str, quantity: Quantity) -> Option<Color> {
        let property = p.get(name)?;
        let color = self.color_of(property, quantity);
        if color.is_none() && !matches!(property.value, Value::Plugin(_) | Value::Reference(_)) {
            p.fault(property.span, format!("`{name}` takes a color, spectrum or texture, not {}", property.value.kind_name()));
        }
        color
    }

    fn color_of(&mut self, property: &'t Property, quantity: Quantity) -> Option<Color> {
        match &property.value {
            Value::Float(v) => Some(Color::gray(*v as f32)),
            Value::Int(v) => Some(Color::gray(*v as f32)),
            Value::Rgb(v) | Value::Vector(v) => Some(Param::Constant(rgb(*v))),
            Value::Uniform(v) => Some(Param::Constant(rgb(rgb_from_uniform(*v, quantity)))),
            Value::Spectrum(list) => Some(Param::Constant(rgb(rgb_from_list(list, quantity)))),
            Value::Plugin(_) | Value::Reference(_) => {
                let plugin = self.resolve(property)?;
                if plugin.kind != Kind::Texture {
                    let message = format!("`{}` takes a texture or spectrum, not {}", property.name, super::describe(plugin));
                    self.desc.report.error(property.span, message);
                    return None;
                }
                self.texture(plugin, quantity)
            }
            _ => None,
        }
    }

    /// A color that cannot vary; a texture becomes the default and a loss.
    pub(super) fn constant_color(&mut self, p: &mut Props<'t>, name: &'static str, quantity: Quantity, default: [f32; 3]) -> [f32; 3] {
        match self.opt_color(p, name, quantity) {
            Some(Param::Constant(v)) => v,
            Some(Param::Texture(_)) => {
                let what = format!("texture for `{name}` of {}", super::describe(p.plugin));
                self.desc.report.loss(p.plugin.span, what, "a constant in its place");
                default
            }
            None => default,
        }
    }

    /// A number that may vary.
    pub(super) fn scalar(&mut self, p: &mut Props<'t>, name: &'static str, default: f32) -> Scalar {
        self.opt_scalar(p, name).unwrap_or(Param::Constant(default))
    }

    /// A number that may vary and may be missing.
    pub(super) fn opt_scalar(&mut self, p: &mut Props<'t>, name: &'static str) -> Option<Scalar> {
        Some(match self.opt_color(p, name, Quantity::Reflectance)? {
            Param::Constant(c) if c[0] == c[1] && c[1] == c[2] => Param::Constant(c[0]),
            Param::Constant(c) => Param::Constant(luminance(c)),
            Param::Texture(id) => Param::Texture(id),
        })
    }

    /// A texture's id, where a constant will not do.
    pub(super) fn texture_id(&mut self, plugin: &'t Plugin) -> Option<TextureId> {
        Some(match self.texture(plugin, Quantity::Reflectance)? {
            Param::Texture(id) => id,
            Param::Constant(value) => self.desc.add(Node::named(&plugin.id, plugin.span, TextureDesc::Constant { value })),
        })
    }

    /// A texture, or a constant for a spectrum.
    pub(super) fn texture(&mut self, plugin: &'t Plugin, quantity: Quantity) -> Option<Color> {
        let key: *const Plugin = plugin;
        let memo = |b: &mut Self| {
            if quantity == Quantity::Emission { std::mem::take(&mut b.emission_textures) } else { std::mem::take(&mut b.textures) }
        };
        let put = |b: &mut Self, m| if quantity == Quantity::Emission { b.emission_textures = m } else { b.textures = m };
        let map = memo(self);
        let known = map.get(&key).copied();
        put(self, map);
        if let Some(known) = known {
            return known;
        }
        let built = self.guarded(plugin, |b| b.build_texture(plugin, quantity));
        let mut map = memo(self);
        map.insert(key, built);
        put(self, map);
        built
    }

    fn build_texture(&mut self, plugin: &'t Plugin, quantity: Quantity) -> Option<Color> {
        if !self.is_known(plugin) {
            return None;
        }
        let mut p = Props::new(plugin);
        let constant = |v: DVec3| Some(Param::Constant(rgb(v)));
        let built = match plugin.type_name.as_str() {
            "bitmap" => self.bitmap(&mut p),
            "checkerboard" => {
                let color0 = self.opt_color(&mut p, "color0", quantity).unwrap_or(Color::gray(0.4));
                let color1 = self.opt_color(&mut p, "color1", quantity).unwrap_or(Color::gray(0.2));
                Some(self.add_texture(plugin, TextureDesc::Checkerboard { color0, color1, pattern_from_uv: p.uv_transform("to_uv") }))
            }
            "mesh_attribute" | "vertexcolors" => {
                let name = p.opt_text("name").unwrap_or("vertex_color");
                let name = name.strip_prefix("vertex_").or(name.strip_prefix("face_")).unwrap_or(name).to_owned();
                let scale = p.float("scale", 1.0);
                Some(self.add_texture(plugin, TextureDesc::Attribute { name, scale }))
            }
            "scale" => {
                let scale = match self.opt_color(&mut p, "scale", Quantity::Reflectance) {
                    Some(Param::Constant(v)) => v,
                    _ => [1.0; 3],
                };
                let nested = self.next_of(&mut p, Kind::Texture).and_then(|t| self.texture(t, quantity));
                let nested = nested.or_else(|| self.opt_color(&mut p, "value", quantity));
                match nested {
                    Some(Param::Constant(v)) => Some(Param::Constant([v[0] * scale[0], v[1] * scale[1], v[2] * scale[2]])),
                    Some(a) => Some(self.add_texture(plugin, TextureDesc::Multiply { a, b: Param::Constant(scale) })),
                    None => {
                        p.fault(plugin.span, "a nested texture is missing");
                        None
                    }
                }
            }
            "uniform" | "rawconstant" | "d65" | "srgb" | "rgb" => {
                let name = if plugin.type_name == "srgb" || plugin.type_name == "rgb" && p.has("color") { "color" } else { "value" };
                let scale = if plugin.type_name == "d65" { p.float("scale", 1.0) } else { 1.0 };
                p.ignore(&["unbounded"]);
                let value = match p.get(name).map(|q| &q.value) {
                    Some(Value::Float(v) | Value::Uniform(v)) => DVec3::splat(*v),
                    Some(Value::Int(v)) => DVec3::splat(*v as f64),
                    Some(Value::Rgb(v) | Value::Vector(v)) => *v,
                    Some(_) => {
                        p.fault_at(name, format!("`{name}` takes a number or a color"));
                        DVec3::ONE
                    }
                    None => DVec3::ONE,
                };
                constant(value * f64::from(scale))
            }
            "regular" | "irregular" | "spectrum" => self.tabulated(&mut p, quantity).and_then(constant),
            "blackbody" => {
                let kelvin = p.positive("temperature", 5000.0);
                let scale = p.float("scale", 1.0);
                p.ignore(&["wavelength_min", "wavelength_max"]);
                constant(rgb_from_list(&blackbody(f64::from(kelvin), f64::from(scale)), quantity))
            }
            _ => {
                self.lose(plugin, "a gray of 0.5 in its place");
                p.ignore_all();
                Some(Color::gray(0.5))
            }
        };
        self.finish(p);
        built
    }

    fn add_texture(&mut self, plugin: &Plugin, value: TextureDesc) -> Color {
        Param::Texture(self.desc.add(Node::named(&plugin.id, plugin.span, value)))
    }

    fn tabulated(&mut self, p: &mut Props<'t>, quantity: Quantity) -> Option<DVec3> {
        let numbers = |text: &str| -> Option<Vec<f64>> {
            let words = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty());
            words.map(|t| t.parse().ok().filter(|v: &f64| v.is_finite())).collect()
        };
        if let Some(Value::Float(v)) = p.get("value").map(|q| &q.value) {
            return Some(rgb_from_uniform(*v, quantity));
        }
        let values = match p.opt_text("values").or_else(|| p.opt_text("value")).map(numbers) {
            Some(Some(values)) if !values.is_empty() => values,
            _ => {
                p.fault_at("values", "`values` must be a list of numbers");
                return None;
            }
        };
        let wavelengths = if p.plugin.type_name == "irregular" || p.has("wavelengths") {
            p.opt_text("wavelengths").and_then(numbers).unwrap_or_default()
        } else {
            let (first, last) = (p.float("wavelength_min", 360.0), p.float("wavelength_max", 830.0));
            let step = f64::from(last - first) / (values.len().max(2) - 1) as f64;
            (0..values.len()).map(|i| f64::from(first) + step * i as f64).collect()
        };
        let list: Vec<(f64, f64)> = wavelengths.iter().copied().zip(values.iter().copied()).collect();
        if wavelengths.len() != values.len() || !list.is_sorted_by(|a, b| a.0 < b.0) {
            p.fault_at("wavelengths", "wavelengths must rise, one to each value");
            return None;
        }
        Some(rgb_from_list(&list, quantity))
    }

    fn bitmap(&mut self, p: &mut Props<'t>) -> Option<Color> {
        let filter = p.choice(
            "filter_type",
            &[
                ("bilinear", TextureFilter::Bilinear),
                ("nearest", TextureFilter::Nearest),
                // Names of 0.x.
                ("trilinear", TextureFilter::Trilinear),
                ("ewa", TextureFilter::Trilinear),
            ],
            TextureFilter::Bilinear,
        );
        const WRAPS: &[(&str, Wrap)] = &[("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)];
        let wrap = p.choice("wrap_mode", WRAPS, Wrap::Repeat);
        let wrap = [p.choice("wrap_mode_u", WRAPS, wrap), p.choice("wrap_mode_v", WRAPS, wrap)];
        let raw = p.bool("raw", false);
        let gamma = p.opt_float("gamma");
        let channel =
            p.choice("channel", &[("r", Channel::R), ("g", Channel::G), ("b", Channel::B), ("a", Channel::A)], Channel::Luminance);
        p.ignore(&["format", "accel", "max_anisotropy", "cache"]);
        let encoding = match gamma {
            _ if raw => Encoding::Linear,
            Some(1.0) => Encoding::Linear,
            Some(g) if g == -1.0 || (g - 2.2).abs() < 0.01 => Encoding::Srgb,
            Some(_) => {
                p.lose(&["gamma"]);
                Encoding::Auto
            }
            None => Encoding::Auto,
        };
        let picture_from_uv = FLIP_V * p.uv_transform("to_uv");
        let image = self.image(p)?;
        let bitmap = BitmapDesc { image, encoding, wrap, filter, picture_from_uv, channel, uv_set: 0 };
        Some(self.add_texture(p.plugin, TextureDesc::Bitmap(bitmap)))
    }

    /// The picture that `filename`, `bitmap` or `data` gives.
    pub(super) fn image(&mut self, p: &mut Props<'t>) -> Option<ImageId> {
        for name in ["bitmap", "data"] {
            let Some(property) = p.get(name) else { continue };
            let Value::Pixels { width, height, channels, data } = &property.value else {
                p.fault(property.span, format!("`{name}` takes a picture, not {}", property.value.kind_name()));
                return None;
            };
            let count = u64::from(*width) * u64::from(*height) * u64::from(*channels);
            if count == 0 || !(1..=4).contains(channels) || count != data.len() as u64 {
                p.fault(property.span, format!("`{name}` is no picture of 1 to 4 channels"));
                return None;
            }
            p.ignore(&["filename"]);
            let source = ImageSource::Pixels { width: *width, height: *height, channels: *channels, data: data.clone() };
            return Some(self.desc.add(Node::new(property.span, ImageDesc { source })));
        }
        let path = self.filename(p)?;
        let span = p.plugin.span;
        if let Some(id) = self.images.get(&path) {
            return Some(*id);
        }
        let id = self.desc.add(Node::new(span, ImageDesc { source: ImageSource::File(path.clone()) }));
        self.images.insert(path, id);
        Some(id)
    }
}
