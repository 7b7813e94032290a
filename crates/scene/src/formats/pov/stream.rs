//! The stream of tokens: files, macros and loops one inside another, identifiers replaced by their values.

use std::sync::Arc;

use super::lexer::{Code, Directive, Raw, RawToken, SIGNS, Sym};
use super::parser::{Parse, Parser, Token};
use super::value::{Macro, Value};
use super::words;
use crate::span::Span;

/// Most frames (include files, macros) inside of one another.
const FRAME_LIMIT: usize = 10_000;
/// Most directives and expressions inside of one another.
pub(super) const DEPTH_LIMIT: u32 = 2_000;

/// Something that tokens are taken from.
pub(super) struct Frame {
    pub(super) code: Arc<Code>,
    /// Index of the next token.
    pub(super) at: usize,
    pub(super) end: usize,
    /// Open blocks of the frames below.
    pub(super) blocks: usize,
    /// Scope of the frame.
    pub(super) level: u32,
    pub(super) kind: FrameKind,
    /// Where it was called from.
    pub(super) call: Span,
}

pub(super) enum FrameKind {
    Scene,
    Include,
    Macro(Arc<Macro>),
}

/// An open `#if`, `#while` …
pub(super) struct Block {
    pub(super) kind: BlockKind,
    pub(super) span: Span,
    /// Index of its `#end`.
    pub(super) end: u32,
}

pub(super) enum BlockKind {
    If,
    Switch(f64),
    /// Index of the token after `#while`.
    While(usize),
    For {
        name: Sym,
        level: u32,
        last: f64,
        step: f64,
        body: usize,
    },
}

/// Where a declaration's value ends: at a directive of the same frame and block, so that a declaration without semicolon takes effect
/// before the directive after it is obeyed.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Barrier {
    pub(super) active: bool,
    frames: usize,
    blocks: usize,
    nesting: u32,
    /// A token has been taken since the barrier was set.
    pub(super) taken: bool,
}

impl Parser {
    /// Starts with the main file.
    pub(super) fn begin(&mut self, bytes: &[u8]) {
        let code = Arc::new(super::lexer::lex(crate::span::FileId(0), bytes, &mut self.names));
        let end = code.tokens.len();
        self.frames.push(Frame { code, at: 0, end, blocks: 0, level: 0, kind: FrameKind::Scene, call: Span::default() });
    }

    /// Sets a barrier; the return value restores the old one with [`Parser::lift_barrier`].
    pub(super) fn set_barrier(&mut self) -> Barrier {
        let old = self.barrier;
        self.barrier = Barrier { active: true, frames: self.frames.len(), blocks: self.blocks.len(), nesting: self.nesting, taken: false };
        old
    }

    /// Ends what [`Parser::set_barrier`] began, and takes a semicolon if one follows.
    pub(super) fn lift_barrier(&mut self, old: Barrier) {
        match &self.ahead {
            Some((Token::Sign("#"), _)) => self.ahead = None,
            Some((Token::Sign(";"), _)) => self.ahead = None,
            Some(_) => {}
            None => {
                if let Some(f) = self.frames.last_mut()
                    && f.at < f.end
                    && f.code.tokens[f.at].raw == Raw::Sign(SEMICOLON)
                {
                    f.at += 1;
                }
            }
        }
        self.barrier = old;
    }

    /// Leaves macros whose last token was the value of a declaration, so that its semicolon is next.
    pub(super) fn finish_macros(&mut self) -> Parse<()> {
        while self.ahead.is_none() && self.frames.len() > self.barrier.frames {
            match self.raw() {
                None => self.leave_frame()?,
                Some(Raw::Directive { kind, next, end }) => {
                    let span = self.raw_span();
                    self.take_raw()?;
                    self.directive(kind, next, end, span)?;
                }
                Some(_) => break,
            }
        }
        Ok(())
    }

    fn stopped_by_barrier(&self) -> bool {
        let b = &self.barrier;
        b.active && b.taken && b.frames == self.frames.len() && b.blocks == self.blocks.len() && b.nesting == self.nesting
    }

    /// The place that reading has come to.
    pub(super) fn here(&self) -> Span {
        self.frames.last().map_or_else(Span::default, |f| f.code.span(f.at.saturating_sub(1).min(f.end.saturating_sub(1))))
    }

    /// Which macros and files have led here, for messages.
    pub(super) fn call_chain(&self) -> String {
        let mut text = String::new();
        let inner: Vec<&Frame> = self.frames.iter().filter(|f| !matches!(f.kind, FrameKind::Scene)).rev().collect();
        for frame in inner.iter().take(8) {
            let at = frame.call.display(&self.files.paths);
            match &frame.kind {
                FrameKind::Macro(m) => text.push_str(&format!("; in macro {}, called at {at}", m.name)),
                _ => text.push_str(&format!("; in a file included at {at}")),
            }
        }
        if inner.len() > 8 {
            text.push_str(&format!("; and {} more", inner.len() - 8));
        }
        text
    }

    /// Guards against recursion of the parser itself.
    pub(super) fn deeper<T>(&mut self, inner: impl FnOnce(&mut Self) -> Parse<T>) -> Parse<T> {
        if self.depth >= self.options.depth_limit {
            let span = self.here();
            return Err(
                self.error(span, format!("directives, macros and expressions are nested more than {} deep", self.options.depth_limit))
            );
        }
        self.depth += 1;
        let result = inner(self);
        self.depth -= 1;
        result
    }

    /// Sees to it that there is a next token.
    pub(super) fn fill(&mut self) -> Parse<()> {
        if self.ahead.is_some() {
            return Ok(());
        }
        self.deeper(Self::fill_now)
    }

    fn fill_now(&mut self) -> Parse<()> {
        while self.ahead.is_none() {
            let Some(frame) = self.frames.last_mut() else {
                self.ahead = Some((Token::End, Span::default()));
                return Ok(());
            };
            if frame.at >= frame.end {
                if self.stopped_by_barrier() {
                    self.ahead = Some((Token::Sign("#"), self.here()));
                    return Ok(());
                }
                self.leave_frame()?;
                continue;
            }
            let RawToken { raw, line, column } = frame.code.tokens[frame.at];
            let span = Span::new(frame.code.file, line, column);
            if let Raw::Directive { kind, next, end } = raw {
                if self.stopped_by_barrier() {
                    self.ahead = Some((Token::Sign("#"), span));
                    return Ok(());
                }
                self.take_raw()?;
                self.directive(kind, next, end, span)?;
                continue;
            }
            self.take_raw()?;
            let token = match raw {
                Raw::Word(w) => Token::Word(words::WORDS[usize::from(w)]),
                Raw::Number(n) => Token::Number(n),
                Raw::Sign(s) => Token::Sign(SIGNS[usize::from(s)]),
                Raw::Text(t) => Token::Text(self.raw_text(t)),
                Raw::Name(name) => {
                    self.identifier(name, span)?;
                    continue;
                }
                Raw::Bad(t) => {
                    let text = self.raw_text(t);
                    return Err(self.error(span, &*text));
                }
                Raw::Directive { .. } => continue,
            };
            self.ahead = Some((token, span));
        }
        Ok(())
    }

    /// A text of the current file.
    pub(super) fn raw_text(&self, number: u32) -> Arc<str> {
        self.frames.last().and_then(|f| f.code.texts.get(number as usize)).cloned().unwrap_or_else(|| "".into())
    }

    /// The next token of the current frame as it stands in the file.
    pub(super) fn raw(&self) -> Option<Raw> {
        self.raw_at(0)
    }

    /// A token of the current frame, `ahead` of the next one.
    pub(super) fn raw_at(&self, ahead: usize) -> Option<Raw> {
        let f = self.frames.last()?;
        let at = f.at + ahead;
        (at < f.end).then(|| f.code.tokens[at].raw)
    }

    /// Place of the next raw token.
    pub(super) fn raw_span(&self) -> Span {
        self.frames.last().map_or_else(Span::default, |f| f.code.span(f.at))
    }

    /// Takes a raw token.
    pub(super) fn take_raw(&mut self) -> Parse<()> {
        if let Some(f) = self.frames.last_mut() {
            f.at += 1;
        }
        self.spend(1)
    }

    /// Counts work, in tokens, towards the limit.
    pub(super) fn spend(&mut self, work: u64) -> Parse<()> {
        let before = self.work;
        self.work = before.saturating_add(work);
        if before >> 20 != self.work >> 20 {
            self.check_time()?;
        }
        if self.work > self.options.work_limit {
            let span = self.here();
            return Err(self.error(span, format!("more than {} tokens have been read; is there an endless loop?", self.options.work_limit)));
        }
        Ok(())
    }

    /// Stops when reading has taken too long.
    pub(super) fn check_time(&mut self) -> Parse<()> {
        if self.begun.elapsed() > self.options.time_limit {
            let span = self.here();
            return Err(self.error(span, format!("reading the scene has taken more than {} seconds", self.options.time_limit.as_secs())));
        }
        Ok(())
    }

    /// Takes the next raw token if it is this sign.
    pub(super) fn accept_raw(&mut self, sign: &str) -> Parse<bool> {
        let there = matches!(self.raw(), Some(Raw::Sign(s)) if SIGNS[usize::from(s)] == sign);
        if there {
            self.take_raw()?;
        }
        Ok(there)
    }

    /// Takes the next raw token, which must be this sign.
    pub(super) fn expect_raw(&mut self, sign: &str, context: &str) -> Parse<()> {
        if self.accept_raw(sign)? {
            return Ok(());
        }
        let span = self.raw_span();
        Err(self.error(span, format!("`{sign}` is expected in {context}")))
    }

    /// Takes a name, declared or not.
    pub(super) fn raw_name(&mut self, context: &str) -> Parse<Sym> {
        let span = self.raw_span();
        match self.raw() {
            Some(Raw::Name(name)) => {
                self.take_raw()?;
                Ok(name)
            }
            Some(Raw::Word(w)) => {
                let word = words::WORDS[usize::from(w)];
                Err(self.error(span, format!("`{word}` is a reserved word; {context} needs an identifier")))
            }
            _ => Err(self.error(span, format!("{context} needs an identifier"))),
        }
    }

    fn leave_frame(&mut self) -> Parse<()> {
        let Some(frame) = self.frames.last() else { return Ok(()) };
        if self.blocks.len() > frame.blocks {
            let span = self.blocks.last().map_or_else(Span::default, |b| b.span);
            return Err(self.error(span, "this directive has no #end"));
        }
        let last = frame.code.last;
        match frame.kind {
            FrameKind::Scene => self.ahead = Some((Token::End, last)),
            FrameKind::Include | FrameKind::Macro(_) => {
                self.frames.pop();
                self.symbols.leave();
            }
        }
        Ok(())
    }

    /// Opens a frame with a scope of its own.
    pub(super) fn push_frame(&mut self, code: Arc<Code>, body: std::ops::Range<usize>, kind: FrameKind, call: Span) -> Parse<()> {
        if self.frames.len() >= FRAME_LIMIT {
            return Err(self.error(call, format!("macros and include files are nested more than {FRAME_LIMIT} deep")));
        }
        let level = self.symbols.level();
        self.frames.push(Frame { code, at: body.start, end: body.end, blocks: self.blocks.len(), level, kind, call });
        Ok(())
    }

    /// The scope that `#local` writes to.
    pub(super) fn frame_level(&self) -> u32 {
        self.frames.last().map_or(0, |f| f.level)
    }

    /// Makes a token of a name, or calls the macro of that name.
    fn identifier(&mut self, name: Sym, span: Span) -> Parse<()> {
        if self.symbols.deprecation(name).is_some() {
            self.tell_deprecation(name, span);
        }
        match self.symbols.get(name) {
            None => {
                let text = self.names.text(name);
                self.ahead = Some((Token::Unknown(text), span));
            }
            Some(Value::Macro(m)) => {
                let m = m.clone();
                self.call_macro(&m, span)?;
            }
            Some(Value::Array(_)) if matches!(self.raw(), Some(Raw::Sign(BRACKET))) => {
                let place = self.symbols.place(name);
                let place = self.indices(place, span)?;
                match self.symbols.at(&place) {
                    Some(v) => {
                        let token = Token::Identifier(self.names.text(name), v.clone());
                        self.use_size(name);
                        self.ahead = Some((token, span));
                    }
                    None => {
                        let text = self.names.text(name);
                        return Err(self.error(span, format!("this element of the array `{text}` has no value")));
                    }
                }
            }
            Some(value) => {
                let value = value.clone();
                if !matches!(value, Value::Float(_) | Value::Vector(_) | Value::String(_)) {
                    self.use_size(name);
                }
                self.ahead = Some((Token::Identifier(self.names.text(name), value), span));
            }
        }
        Ok(())
    }

    /// Counts a value as part of what is being declared. Right inside of its braces it is what the new value is made of, not a part.
    fn use_size(&mut self, name: Sym) {
        let size = self.symbols.size(name);
        let is_part = self.nesting > self.base_nesting + 1;
        self.used.depth = self.used.depth.max(size.depth + u32::from(is_part));
        self.used.weight = self.used.weight.saturating_add(size.weight);
    }

    fn tell_deprecation(&mut self, name: Sym, span: Span) {
        use std::sync::atomic::Ordering;
        let Some(d) = self.symbols.deprecation(name).cloned() else { return };
        if !(d.once && d.told.swap(true, Ordering::Relaxed)) {
            self.warning(span, d.message.to_string());
        }
    }

    /// Whether the directive is one of those that only a block may hold.
    pub(super) fn stray(&mut self, kind: Directive, span: Span) -> super::Stop {
        let word = match kind {
            Directive::End => "end",
            Directive::Else => "else",
            Directive::Elseif => "elseif",
            Directive::Case => "case",
            Directive::Range => "range",
            _ => "break",
        };
        self.error(span, format!("#{word} without a directive that it belongs to"))
    }
}

const SEMICOLON: u8 = 9;
const BRACKET: u8 = 4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_signs() {
        assert_eq!((SIGNS[usize::from(SEMICOLON)], SIGNS[usize::from(BRACKET)]), (";", "["));
    }
}
