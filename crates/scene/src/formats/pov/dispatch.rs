//! What stands at the top of a scene and after `#declare`.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::expression::COLOR_WORDS;
use super::items::OBJECT_WORDS;
use super::lexer::Directive;
use super::parser::{Parse, Parser, Token};
use super::value::{Array, Num, Value};

/// Most elements of all arrays that live at a time.
const ELEMENT_LIMIT: u64 = 16_000_000;

impl Parser {
    /// Reads the whole scene.
    pub fn parse_scene(&mut self) -> Parse<()> {
        loop {
            match *self.peek()? {
                Token::End => return Ok(()),
                Token::Sign(";") => {
                    self.next()?;
                }
                Token::Word(word) => self.scene_item(word)?,
                // An object's identifier may stand alone at the top (measured), though not documented so.
                Token::Identifier(_, Value::Object(ref o)) => {
                    let object = (**o).clone();
                    self.next()?;
                    self.add_object(object);
                }
                _ => return Err(self.unexpected("the scene")),
            }
        }
    }

    fn scene_item(&mut self, word: &'static str) -> Parse<()> {
        match word {
            "camera" => {
                self.scene.camera = self.camera()?;
                self.has_camera = true;
            }
            "fog" => {
                let fog = self.fog()?;
                self.scene.fogs.push(fog);
            }
            "rainbow" => {
                let rainbow = self.rainbow()?;
                self.scene.rainbows.push(rainbow);
            }
            "sky_sphere" => {
                let span = self.span();
                let sky = self.sky_sphere()?;
                if self.scene.sky.replace(sky).is_some() {
                    self.warning(span, "a second sky_sphere replaces the first");
                }
            }
            "background" => self.background()?,
            "global_settings" => self.global_settings()?,
            "media" => {
                let media = self.media()?;
                self.scene.atmosphere.push(media);
            }
            "max_trace_level" => {
                self.next()?;
                let levels = self.float()?;
                self.scene.settings.max_trace_level = (levels as u32).clamp(1, 256);
            }
            _ if OBJECT_WORDS.contains(&word) => {
                let object = self.object()?;
                self.add_object(object);
            }
            // Old scenes have these directives without their `#`.
            "declare" | "default" | "include" | "local" | "undef" | "version" => return self.bare_directive(word),
            _ => return Err(self.unexpected("the scene")),
        }
        Ok(())
    }

    fn bare_directive(&mut self, word: &str) -> Parse<()> {
        let span = self.span();
        self.next()?;
        if word != "default" {
            self.warning(span, format!("`{word}` should be `#{word}`"));
        }
        match Directive::of(word) {
            Some(kind) => self.directive(kind, u32::MAX, u32::MAX, span),
            None => Ok(()),
        }
    }

    /// What may stand on the right of `#declare Name =`, or be the argument of a macro.
    pub(super) fn rvalue(&mut self) -> Parse<Value> {
        self.deeper(Self::rvalue_now)
    }

    fn rvalue_now(&mut self) -> Parse<Value> {
        if self.at_string()? {
            return self.string_rvalue();
        }
        let word = match self.peek()? {
            Token::Word(w) => *w,
            Token::Identifier(_, v) if Num::of(v).is_none() && !matches!(v, Value::Function(_) | Value::Spline(_)) => {
                let v = v.clone();
                self.next()?;
                return Ok(v);
            }
            Token::Identifier(_, v @ (Value::Function(_) | Value::Spline(_))) => {
                // A call is a number; the name alone is the function itself.
                let v = v.clone();
                if !self.parenthesis_follows() {
                    self.next()?;
                    return Ok(v);
                }
                return Ok(self.num()?.value());
            }
            Token::Identifier(_, Value::Vector(v)) if v.len() == 5 => return Ok(self.color_or_float()?.value()),
            _ => return Ok(self.num()?.value()),
        };
        Ok(match word {
            "array" => self.array()?,
            "camera" => Value::Camera(Arc::new(self.camera()?)),
            "color_map" => Value::ColorMap(Arc::new(self.color_map()?)),
            "density" => Value::Pigment(Arc::new(self.density()?)),
            "density_map" | "pigment_map" => Value::PigmentMap(Arc::new(self.pigment_map()?)),
            "finish" => Value::Finish(Arc::new(self.finish()?)),
            "fog" => Value::Fog(Arc::new(self.fog()?)),
            "function" => Value::Function(Arc::new(self.function()?)),
            "interior" => Value::Interior(Arc::new(self.interior()?)),
            "material" => Value::Material(Arc::new(self.material()?)),
            "media" => Value::Media(Arc::new(self.media()?)),
            "normal" => Value::Normal(Arc::new(self.normal()?)),
            "normal_map" => Value::NormalMap(Arc::new(self.normal_map()?)),
            "pigment" => Value::Pigment(Arc::new(self.pigment()?)),
            "rainbow" => Value::Rainbow(Arc::new(self.rainbow()?)),
            "sky_sphere" => Value::SkySphere(Arc::new(self.sky_sphere()?)),
            "slope_map" => Value::SlopeMap(Arc::new(self.slope_map()?)),
            "spline" => Value::Spline(Arc::new(self.spline()?)),
            "texture" => Value::Texture(Arc::new(self.texture()?)),
            "texture_map" => Value::TextureMap(Arc::new(self.texture_map()?)),
            "transform" => {
                self.next()?;
                Value::Transform(Arc::new(self.transform_block()?))
            }
            _ if COLOR_WORDS.contains(&word) => self.color_num()?.value(),
            _ if OBJECT_WORDS.contains(&word) => Value::Object(Arc::new(self.object()?)),
            _ => self.num()?.value(),
        })
    }

    /// A string, or the comparison of two as a number.
    fn string_rvalue(&mut self) -> Parse<Value> {
        Ok(Value::String(self.string_value()?))
    }

    /// What begins with a color's identifier: a color with further words, or an expression.
    fn color_or_float(&mut self) -> Parse<Num> {
        let n = self.num()?;
        if n.len != 5 {
            return Ok(n);
        }
        self.color_words(n)
    }

    /// Whether the next token but one is `(`; the next one has been looked at.
    fn parenthesis_follows(&self) -> bool {
        matches!(self.raw(), Some(super::lexer::Raw::Sign(s)) if super::lexer::SIGNS[usize::from(s)] == "(")
    }

    /// `array [size] … { … }`.
    fn array(&mut self) -> Parse<Value> {
        let span = self.span();
        self.expect("array")?;
        let mut sizes = Vec::new();
        let mut count = 1u64;
        while self.accept("[")? {
            let size = self.full_float()? + 1e-10;
            self.expect("]")?;
            if !(size >= 1.0 && size < ELEMENT_LIMIT as f64) {
                return Err(self.error(span, format!("an array's size must be between 1 and {ELEMENT_LIMIT}")));
            }
            sizes.push(size as usize);
            count = count.saturating_mul(size as u64);
            if sizes.len() > 5 {
                return Err(self.error(span, "an array of more than five dimensions"));
            }
        }
        let is_measured = sizes.is_empty();
        if is_measured {
            // A list in braces of as many elements as there are.
            let mut items = Vec::new();
            self.expect("{")?;
            while !self.accept("}")? {
                items.push(Some(self.rvalue()?));
                self.comma()?;
            }
            let mut array = Array::new(vec![items.len()], &self.living_elements);
            array.items = items;
            return Ok(Value::Array(Arc::new(array)));
        }
        if self.living_elements.load(Ordering::Relaxed).saturating_add(count) > ELEMENT_LIMIT {
            return Err(self.error(span, format!("the arrays have more than {ELEMENT_LIMIT} elements together")));
        }
        let mut array = Array::new(sizes, &self.living_elements);
        if self.at("{")? {
            self.initializer(&mut array, 0, 0)?;
        }
        Ok(Value::Array(Arc::new(array)))
    }

    /// `{ … }` with the elements of one dimension; `base` is the number of the first of them.
    fn initializer(&mut self, array: &mut Array, dimension: usize, base: usize) -> Parse<()> {
        self.expect("{")?;
        let stride: usize = array.sizes[dimension + 1..].iter().product();
        for i in 0..array.sizes[dimension] {
            if self.at("}")? {
                break;
            }
            if dimension + 1 < array.sizes.len() {
                self.initializer(array, dimension + 1, base + i * stride)?;
            } else if !self.at(",")? {
                array.items[base + i] = Some(self.rvalue()?);
            }
            self.comma()?;
        }
        self.expect("}")
    }
}
