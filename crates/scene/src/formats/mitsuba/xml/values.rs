//! Values of parameters: numbers, colors, spectra.

use glam::DVec3;
use roxmltree::Node;

use super::{Context, SPECTRUM_SIZE_LIMIT, XmlReader};
use crate::formats::mitsuba::find;
use crate::formats::mitsuba::tree::Value;
use crate::formats::spectrum;
use crate::formats::{ResolveError, Resolver};
use crate::span::Span;

impl XmlReader<'_> {
    pub(super) fn value(&mut self, node: Node, tag: &str, span: Span) -> Option<Value> {
        match tag {
            "point" | "vector" => {
                self.check_attributes(node, span, &["name", "value", "x", "y", "z"]);
                return self.xyz(node, span, DVec3::ZERO).map(Value::Vector);
            }
            "spectrum" => self.check_attributes(node, span, &["name", "value", "intent"]),
            "rgb" | "srgb" => self.check_attributes(node, span, &["name", "value", "intent"]),
            "blackbody" => self.check_attributes(node, span, &["name", "temperature", "scale"]),
            _ => self.check_attributes(node, span, &["name", "value"]),
        }
        if tag == "blackbody" {
            let temperature = self.required(node, "temperature", span)?;
            let kelvin = temperature.trim().trim_end_matches(['K', 'k']).to_owned();
            let kelvin = self.number(&kelvin, span)?;
            let scale = self.attribute(node, "scale", span);
            let scale = if scale.is_empty() { 1.0 } else { self.number(&scale, span)? };
            return Some(Value::Spectrum(spectrum::blackbody(kelvin, scale)));
        }
        let text = self.required(node, "value", span)?;
        let trimmed = text.trim();
        let bad = |reader: &mut Self, what: &str| {
            reader.report.error(span, format!("`{}` is not {what}", shorten(trimmed)));
            None
        };
        match tag {
            "float" => self.number(trimmed, span).map(Value::Float),
            "integer" => match trimmed.parse::<i64>() {
                Ok(v) => Some(Value::Int(v)),
                Err(_) => bad(self, "an integer"),
            },
            "boolean" => match trimmed.to_ascii_lowercase().as_str() {
                "true" => Some(Value::Bool(true)),
                "false" => Some(Value::Bool(false)),
                _ => bad(self, "true or false"),
            },
            "string" => Some(Value::Text(text)),
            "rgb" | "srgb" => {
                if let Some(hex) = trimmed.strip_prefix('#') {
                    return match parse_hex(hex) {
                        Some(color) => Some(Value::Rgb(color)),
                        None => bad(self, "a color such as #rrggbb"),
                    };
                }
                let decode = |v: f64| if tag == "srgb" { spectrum::linear_from_srgb(v) } else { v };
                match self.numbers(trimmed, span)?[..] {
                    [v] => Some(Value::Rgb(DVec3::splat(decode(v)))),
                    [r, g, b] => Some(Value::Rgb(DVec3::new(decode(r), decode(g), decode(b)))),
                    _ => bad(self, "a color of one or three numbers"),
                }
            }
            _ => self.spectrum(trimmed, span),
        }
    }

    fn spectrum(&mut self, text: &str, span: Span) -> Option<Value> {
        if !text.contains(':') {
            return match self.numbers(text, span)?[..] {
                [v] => Some(Value::Uniform(v)),
                // 0.6 took three numbers as a color.
                [r, g, b] => Some(Value::Rgb(DVec3::new(r, g, b))),
                _ => {
                    self.report.error(span, format!("`{}` is not a number or a list of wavelength:value", shorten(text)));
                    None
                }
            };
        }
        let mut list = Vec::new();
        for pair in text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty()) {
            let Some((wavelength, value)) = pair.split_once(':') else {
                self.report.error(span, format!("`{}` is not wavelength:value", shorten(pair)));
                return None;
            };
            list.push((self.number(wavelength, span)?, self.number(value, span)?));
        }
        if !list.is_sorted_by(|a, b| a.0 < b.0) {
            self.report.error(span, "wavelengths must rise");
            return None;
        }
        Some(Value::Spectrum(list))
    }

    /// A spectrum of a text file: a wavelength and a value to a line, `#` before a comment.
    pub(super) fn spectrum_file(&mut self, cx: &Context, node: Node, span: Span) -> Option<Value> {
        self.check_attributes(node, span, &["name", "filename", "intent"]);
        let name = self.required(node, "filename", span)?;
        let folders = std::iter::once(cx.folder.clone()).chain(self.paths.iter().cloned());
        let bytes = find(self.resolver, folders, &name).and_then(|path| {
            let small = std::fs::metadata(&path).is_ok_and(|m| m.len() <= SPECTRUM_SIZE_LIMIT);
            if small { Resolver::read(&path) } else { Err(ResolveError::Unfit(name.clone())) }
        });
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(e) => {
                self.report.error(span, e.to_string());
                return None;
            }
        };
        let text = String::from_utf8_lossy(&bytes);
        let lines = text.lines().map(|l| l.split('#').next().unwrap_or_default().trim()).filter(|l| !l.is_empty());
        let mut list = Vec::new();
        for line in lines {
            match self.numbers(line, span)?[..] {
                [wavelength, value] => list.push((wavelength, value)),
                _ => {
                    self.report.error(span, format!("`{name}`: `{}` is not a wavelength and a value", shorten(line)));
                    return None;
                }
            }
        }
        if list.is_empty() || !list.is_sorted_by(|a, b| a.0 < b.0) {
            self.report.error(span, format!("`{name}`: wavelengths must rise"));
            return None;
        }
        Some(Value::Spectrum(list))
    }

    pub(super) fn number(&mut self, text: &str, span: Span) -> Option<f64> {
        match text.trim().parse::<f64>() {
            Ok(v) if v.is_finite() => Some(v),
            Ok(_) => {
                self.report.error(span, format!("`{}` is not a finite number", shorten(text)));
                None
            }
            Err(_) => {
                self.report.error(span, format!("`{}` is not a number", shorten(text)));
                None
            }
        }
    }

    pub(super) fn numbers(&mut self, text: &str, span: Span) -> Option<Vec<f64>> {
        text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty()).map(|t| self.number(t, span)).collect()
    }

    /// Three numbers from `value` (one or three) or from `x`, `y`, `z`.
    pub(super) fn xyz(&mut self, node: Node, span: Span, default: DVec3) -> Option<DVec3> {
        if node.has_attribute("value") {
            let text = self.attribute(node, "value", span);
            return match self.numbers(&text, span)?[..] {
                [v] => Some(DVec3::splat(v)),
                [x, y, z] => Some(DVec3::new(x, y, z)),
                _ => {
                    self.report.error(span, format!("`{}` is not one or three numbers", shorten(&text)));
                    None
                }
            };
        }
        let mut v = default;
        for (i, name) in ["x", "y", "z"].into_iter().enumerate() {
            if node.has_attribute(name) {
                let text = self.attribute(node, name, span);
                v[i] = self.number(&text, span)?;
            }
        }
        Some(v)
    }
}

fn parse_hex(hex: &str) -> Option<DVec3> {
    if hex.len() != 6 || !hex.is_ascii() {
        return None;
    }
    let channel = |i: usize| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).ok().map(|v| spectrum::linear_from_srgb(f64::from(v) / 255.0));
    Some(DVec3::new(channel(0)?, channel(1)?, channel(2)?))
}

/// A text short enough for a message.
pub(super) fn shorten(text: &str) -> String {
    if text.chars().count() <= 60 { text.to_owned() } else { text.chars().take(57).chain("...".chars()).collect() }
}
