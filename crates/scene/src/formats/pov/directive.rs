//! Directives: declarations, defaults, versions, messages. Blocks are in `directive_flow`, files in `directive_file`.

use std::sync::Arc;

use etendue_procedural::{Layer, Texture};

use super::lexer::{Directive, Raw, SIGNS};
use super::options::Stream;
use super::parser::{Parse, Parser, Token};
use super::symbols::{Deprecation, Place, Size};
use super::value::Value;
use crate::span::Span;

/// Most values inside of one another.
const VALUE_DEPTH_LIMIT: usize = 400;
/// Most tokens of a texture with all that it holds.
const VALUE_WEIGHT_LIMIT: u64 = 20_000_000;

impl Parser {
    /// Obeys a directive; its word has been taken. `next` and `end` are the places of its next branch and of its `#end`.
    pub(super) fn directive(&mut self, kind: Directive, next: u32, end: u32, span: Span) -> Parse<()> {
        use Directive as D;
        match kind {
            D::Declare => self.declare(false),
            D::Local => self.declare(true),
            D::Undef => self.undef(),
            D::If => self.if_directive(next, end, span),
            D::Ifdef => self.ifdef(true, next, end, span),
            D::Ifndef => self.ifdef(false, next, end, span),
            D::Else | D::Elseif => self.branch_ends(kind, span),
            D::Case | D::Range => self.case_directive(kind, next, span),
            D::Switch => self.switch_directive(end, span),
            D::While => self.while_directive(end, span),
            D::For => self.for_directive(end, span),
            D::End => self.end_directive(span),
            D::Break => self.break_directive(span),
            D::Macro => self.define_macro(end, span),
            D::Include => self.include(span),
            D::Version => self.version_directive(),
            D::Default => self.default_directive(),
            D::Debug => self.message(Stream::Debug),
            D::Render => self.message(Stream::Render),
            D::Statistics => self.message(Stream::Statistics),
            D::Warning => self.message(Stream::Warning),
            D::Error => {
                let text = self.string_value()?;
                Err(self.error(span, format!("#error: {}", text.trim_end())))
            }
            D::Fopen => self.fopen(span),
            D::Fclose => self.fclose(),
            D::Read => self.read_directive(span),
            D::Write => self.write_directive(span),
            D::MaxIntersections => {
                self.float()?;
                Ok(())
            }
            D::MaxTraceLevel => {
                let levels = self.float()?;
                self.scene.settings.max_trace_level = (levels as u32).clamp(1, 256);
                Ok(())
            }
        }
    }

    /// `#declare [deprecated [once] ["message"]] Name = value`, also of an array's element.
    fn declare(&mut self, local: bool) -> Parse<()> {
        let level = self.frame_level();
        let deprecation = self.deprecation()?;
        let span = self.raw_span();
        let name = self.raw_name(if local { "#local" } else { "#declare" })?;
        let is_element = matches!(self.raw(), Some(Raw::Sign(s)) if SIGNS[usize::from(s)] == "[");
        let mut place = if local && !is_element { self.symbols.local_place(name, level) } else { self.symbols.place(name) };
        if is_element {
            place = self.indices(place, span)?;
        }
        self.expect_raw("=", "a declaration")?;
        let old = self.set_barrier();
        let value = match self.sized_rvalue() {
            Ok(value) => self.finish_macros().map(|()| value),
            Err(stop) => Err(stop),
        };
        self.lift_barrier(old);
        let (value, size) = value?;
        self.check_size(&value, size, &place, span)?;
        self.assign(&place, value, span)?;
        self.symbols.set_size(&place, size);
        if let Some((once, message)) = deprecation {
            let text = self.names.text(name);
            let message = message.unwrap_or_else(|| format!("the identifier `{text}` was declared deprecated").into());
            self.symbols.deprecate(name, Deprecation { once, told: false.into(), message });
        }
        Ok(())
    }

    /// A value and its size.
    pub(super) fn sized_rvalue(&mut self) -> Parse<(Value, Size)> {
        let outer = (std::mem::take(&mut self.used), std::mem::replace(&mut self.base_nesting, self.nesting), self.work);
        let value = self.rvalue();
        // Objects know their own depth: unions that grow in loops stay flat.
        let depth = match &value {
            Ok(Value::Object(o)) => self.used.depth.min(o.depth.saturating_add(1)),
            _ => self.used.depth,
        };
        let size = Size { depth, weight: self.used.weight.saturating_add(self.work - outer.2) };
        // An argument of a macro may become part of what is being declared around the call.
        self.used.depth = size.depth.max(outer.0.depth);
        self.used.weight = size.weight.saturating_add(outer.0.weight);
        self.base_nesting = outer.1;
        Ok((value?, size))
    }

    /// Keeps values within what programs can go through: those made of themselves in loops grow by a level, or double, each time.
    fn check_size(&mut self, value: &Value, size: Size, place: &Place, span: Span) -> Parse<()> {
        if size.depth as usize + place.path.len() > VALUE_DEPTH_LIMIT {
            return Err(self.error(span, format!("this value holds others more than {VALUE_DEPTH_LIMIT} deep")));
        }
        // Parts of these are copies; objects share theirs.
        let is_copied = matches!(
            value,
            Value::Pigment(_)
                | Value::Normal(_)
                | Value::Texture(_)
                | Value::Material(_)
                | Value::Interior(_)
                | Value::Media(_)
                | Value::PigmentMap(_)
                | Value::NormalMap(_)
                | Value::TextureMap(_)
        );
        if is_copied && size.weight > VALUE_WEIGHT_LIMIT {
            return Err(self.error(span, format!("this {} is made of more than {VALUE_WEIGHT_LIMIT} tokens", value.kind())));
        }
        Ok(())
    }

    fn deprecation(&mut self) -> Parse<Option<(bool, Option<Arc<str>>)>> {
        let word = |p: &Self, text: &str| matches!(p.raw(), Some(Raw::Word(w)) if super::words::WORDS[usize::from(w)] == text);
        if !word(self, "deprecated") {
            return Ok(None);
        }
        self.take_raw()?;
        let once = word(self, "once");
        if once {
            self.take_raw()?;
        }
        let mut message = None;
        if let Some(Raw::Text(t)) = self.raw() {
            message = Some(self.raw_text(t));
            self.take_raw()?;
        }
        Ok(Some((once, message)))
    }

    /// Sets a variable or an element of an array.
    pub(super) fn assign(&mut self, place: &Place, value: Value, span: Span) -> Parse<()> {
        if self.symbols.set(place, value) {
            return Ok(());
        }
        let name = self.names.text(place.name);
        Err(self.error(span, format!("`{name}` has no such element")))
    }

    /// `#undef Name`.
    fn undef(&mut self) -> Parse<()> {
        let name = self.raw_name("#undef")?;
        self.symbols.undef(name);
        self.accept_raw(";")?;
        Ok(())
    }

    /// `#version 3.7;`.
    fn version_directive(&mut self) -> Parse<()> {
        if let Some(Raw::Name(n)) = self.raw() {
            // `#version unofficial megapov 1.0;` of patched versions.
            if &*self.names.text(n) == "unofficial" {
                self.take_raw()?;
                self.take_raw()?;
            }
        }
        let old = self.set_barrier();
        let span = self.span();
        let version = self.float();
        self.lift_barrier(old);
        let version = (version? * 100.0).round();
        if !(100.0..1000.0).contains(&version) {
            return Err(self.error(span, "this is no version of the language"));
        }
        if version > 379.0 {
            self.warning(span, format!("the scene is for version {}; it is read as one of 3.7", version / 100.0));
        }
        self.version = version as u32;
        self.stated_version = version as u32;
        if !self.noise_generator_given {
            self.scene.settings.noise_generator = self.default_noise_generator();
        }
        Ok(())
    }

    /// The noise generator of scenes that do not say one: it changed with version 3.5, and the version at the end counts (measured).
    pub(super) fn default_noise_generator(&self) -> u8 {
        if self.version < 350 { 1 } else { 2 }
    }

    /// `#debug "…"` and its like.
    fn message(&mut self, stream: Stream) -> Parse<()> {
        let span = self.raw_span();
        let text = self.string_value()?;
        self.accept_raw(";")?;
        if stream == Stream::Warning {
            self.warning(span, text.trim_end().to_owned());
        }
        self.options.tell(stream, &text);
        Ok(())
    }

    /// `#default { texture { … } }`.
    fn default_directive(&mut self) -> Parse<()> {
        self.expect("{")?;
        loop {
            match *self.peek()? {
                Token::Word("texture") => {
                    let texture = self.texture()?;
                    match &texture {
                        Texture::Layers(l) if !l.is_empty() => self.default = Arc::new(texture),
                        #[allow(unreachable_patterns)]
                        _ => {
                            let span = self.here();
                            self.warning(span, "only plain textures can be defaults; this one is left out");
                        }
                    }
                }
                Token::Word("pigment") => {
                    let pigment = self.pigment()?;
                    self.default_layer(|l| l.pigment = pigment);
                }
                Token::Word("normal") => {
                    let normal = self.normal()?;
                    self.default_layer(|l| l.normal = Some(normal));
                }
                Token::Word("finish") => {
                    let finish = self.finish()?;
                    self.default_layer(|l| l.finish = Arc::new(finish));
                }
                Token::Word("camera") => self.scene.camera = self.camera()?,
                Token::Sign("}") => break,
                _ => return Err(self.unexpected("#default")),
            }
        }
        self.expect("}")?;
        self.accept_raw(";")?;
        Ok(())
    }

    #[allow(irrefutable_let_patterns)]
    fn default_layer(&mut self, change: impl FnOnce(&mut Layer)) {
        if let Texture::Layers(layers) = Arc::make_mut(&mut self.default)
            && let Some(last) = layers.last_mut()
        {
            change(last);
        }
    }
}
