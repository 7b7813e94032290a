//! `#fopen`, `#fclose`, `#read`, `#write` (File I/O Directives).

use std::sync::Arc;

use super::lexer::Raw;
use super::parser::{Parse, Parser, Token};
use super::value::{Num, Value};
use super::words;
use crate::span::Span;

/// Most bytes that a scene writes.
const WRITE_LIMIT: usize = 1 << 28;
/// Most files that a scene opens.
const OPEN_LIMIT: usize = 1 << 16;

/// An open file.
pub(super) enum OpenFile {
    /// Values yet to be read, the last first, and whether a comma comes after the last.
    Read(Vec<Item>, bool),
    /// Name; what is written goes to [`super::files::Files::written`].
    Write(String),
}

/// A value in a file.
pub(super) enum Item {
    Text(Arc<str>),
    Number(Num),
    Bad,
}

impl Parser {
    fn raw_word(&self) -> Option<&'static str> {
        match self.raw() {
            Some(Raw::Word(w)) => Some(words::WORDS[usize::from(w)]),
            _ => None,
        }
    }

    /// `#fopen Handle "name" read|write|append`.
    pub(super) fn fopen(&mut self, span: Span) -> Parse<()> {
        let handle = self.raw_name("#fopen")?;
        let name = self.string_value()?;
        let mode = self.raw_word();
        if self.files.open.len() >= OPEN_LIMIT {
            return Err(self.error(span, format!("more than {OPEN_LIMIT} files have been opened")));
        }
        let file = match mode {
            Some("read") => {
                let bytes = self.read_file(&name, &[], span)?;
                let (items, comma) = read_items(&bytes);
                OpenFile::Read(items, comma)
            }
            Some(mode @ ("write" | "append")) => {
                self.open_for_writing(&name, mode == "append", span)?;
                OpenFile::Write(name.to_string())
            }
            _ => return Err(self.error(span, "#fopen needs `read`, `write` or `append` after the name")),
        };
        self.take_raw()?;
        self.files.open.push(Some(file));
        let number = self.files.open.len() as u32 - 1;
        // File handles are always global.
        let place = super::symbols::Place { name: handle, level: 0, path: arrayvec::ArrayVec::new() };
        self.symbols.set(&place, Value::File(number));
        self.accept_raw(";")?;
        Ok(())
    }

    fn open_for_writing(&mut self, name: &str, append: bool, span: Span) -> Parse<()> {
        if self.options.output_folder.is_none() && !self.files.written.contains_key(name) {
            self.loss(span, format!("#fopen \"{name}\" for writing"), "kept in memory for this scene, not written to disk");
        }
        if append {
            if !self.files.written.contains_key(name) && self.file_is_there(name) {
                let bytes = self.read_file(name, &[], span)?;
                self.files.written.insert(name.to_owned(), bytes);
            }
            self.files.written.entry(name.to_owned()).or_default();
        } else {
            self.files.written.insert(name.to_owned(), Vec::new());
        }
        Ok(())
    }

    /// The open file of a handle.
    fn handle(&mut self) -> Parse<u32> {
        let pick = |v: &Value| if let Value::File(n) = v { Some(*n) } else { None };
        match self.accept_value(pick)? {
            Some(n) => Ok(n),
            None => Err(self.unexpected("a file directive, which needs an open file")),
        }
    }

    /// `#fclose Handle`.
    pub(super) fn fclose(&mut self) -> Parse<()> {
        let span = self.raw_span();
        let name = self.raw_name("#fclose")?;
        match self.symbols.get(name) {
            Some(Value::File(n)) => {
                let n = *n as usize;
                if let Some(f) = self.files.open.get_mut(n) {
                    *f = None;
                }
                self.symbols.undef(name);
            }
            Some(_) => return Err(self.error(span, "this is no open file")),
            // Closed at its end already.
            None => {}
        }
        self.accept_raw(";")?;
        Ok(())
    }

    /// `#read (Handle, A, B, …)`.
    pub(super) fn read_directive(&mut self, span: Span) -> Parse<()> {
        self.expect("(")?;
        let handle_name = match self.raw() {
            Some(Raw::Name(n)) => n,
            _ => return Err(self.error(span, "#read needs an open file")),
        };
        let handle = self.handle()? as usize;
        let mut is_past = false;
        while self.accept(",")? {
            let (place, _) = self.variable("#read")?;
            let item = match self.files.open.get_mut(handle) {
                Some(Some(OpenFile::Read(items, _))) => items.pop(),
                Some(Some(OpenFile::Write(_))) => return Err(self.error(span, "this file is open for writing")),
                _ => None,
            };
            let value = match item {
                Some(Item::Text(t)) => Value::String(t),
                Some(Item::Number(n)) => n.value(),
                Some(Item::Bad) => return Err(self.error(span, "the file holds something that is no string, float or vector")),
                None => {
                    is_past = true;
                    continue;
                }
            };
            self.assign(&place, value, span)?;
        }
        self.expect(")")?;
        self.accept_raw(";")?;
        // The handle goes at the end of the file; a comma after the last value hides the end from the directive that reads it (measured).
        let is_over =
            matches!(self.files.open.get(handle), Some(Some(OpenFile::Read(items, comma))) if items.is_empty() && (is_past || !comma));
        if is_over {
            self.files.open[handle] = None;
            self.symbols.undef(handle_name);
        }
        Ok(())
    }

    /// `#write (Handle, …)`.
    pub(super) fn write_directive(&mut self, span: Span) -> Parse<()> {
        self.expect("(")?;
        let handle = self.handle()? as usize;
        let name = match self.files.open.get(handle) {
            Some(Some(OpenFile::Write(name))) => name.clone(),
            _ => return Err(self.error(span, "this file is not open for writing")),
        };
        let mut out = Vec::new();
        // Commas may be left out.
        while self.accept(",")? || !self.at(")")? {
            // The word holds for one value, not for those after the next comma (measured).
            let binary = self.accept_any(&["sint8", "uint8", "sint16be", "sint16le", "uint16be", "uint16le", "sint32be", "sint32le"])?;
            if self.at_string()? {
                out.extend_from_slice(self.string_value()?.as_bytes());
                continue;
            }
            let n = if matches!(self.peek()?, Token::Word(w) if super::expression::COLOR_WORDS.contains(w)) {
                self.color_num()?
            } else {
                self.full()?
            };
            let values = &n.v[..usize::from(n.len)];
            match binary {
                Some(kind) => values.iter().for_each(|v| binary_word(*v, kind, &mut out)),
                None if n.len == 1 => out.extend_from_slice(written(n.v[0]).as_bytes()),
                None => {
                    let parts: Vec<String> = values.iter().map(|v| written(*v)).collect();
                    // With a blank after it (measured).
                    out.extend_from_slice(format!("<{}> ", parts.join(",")).as_bytes());
                }
            }
        }
        self.expect(")")?;
        self.accept_raw(";")?;
        let total: usize = self.files.written.values().map(Vec::len).sum();
        if total + out.len() > WRITE_LIMIT {
            return Err(self.error(span, format!("the scene writes more than {WRITE_LIMIT} bytes")));
        }
        self.files.written.entry(name).or_default().extend(out);
        Ok(())
    }
}

/// A float as `#write` has it: six significant digits, as C's `%g` (measured).
fn written(x: f64) -> String {
    if !x.is_finite() {
        return if x.is_nan() {
            "nan"
        } else if x > 0.0 {
            "inf"
        } else {
            "-inf"
        }
        .to_owned();
    }
    if x == 0.0 {
        return "0".to_owned();
    }
    let scientific = format!("{x:.5e}");
    let Some((mantissa, exponent)) = scientific.split_once('e') else { return scientific };
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trimmed = |s: &str| if s.contains('.') { s.trim_end_matches('0').trim_end_matches('.').to_owned() } else { s.to_owned() };
    if (-4..6).contains(&exponent) {
        trimmed(&format!("{x:.*}", (5 - exponent) as usize))
    } else {
        let sign = if exponent < 0 { '-' } else { '+' };
        format!("{}e{sign}{:02}", trimmed(mantissa), exponent.abs())
    }
}

fn binary_word(x: f64, kind: &str, out: &mut Vec<u8>) {
    // Rounded to the nearest number that the word can hold; the casts saturate.
    let x = x.round();
    match kind {
        "sint8" => out.push((x as i8) as u8),
        "uint8" => out.push(x as u8),
        "sint16be" => out.extend((x as i16).to_be_bytes()),
        "sint16le" => out.extend((x as i16).to_le_bytes()),
        "uint16be" => out.extend((x as u16).to_be_bytes()),
        "uint16le" => out.extend((x as u16).to_le_bytes()),
        "sint32be" => out.extend((x as i32).to_be_bytes()),
        _ => out.extend((x as i32).to_le_bytes()),
    }
}

/// Strings, floats and vectors of a data file, the last first, and whether a comma ends the file.
fn read_items(bytes: &[u8]) -> (Vec<Item>, bool) {
    let mut names = super::lexer::Names::default();
    let code = super::lexer::lex(crate::span::FileId(0), bytes, &mut names);
    let mut items = Vec::new();
    let mut vector: Option<Vec<f64>> = None;
    let mut sign = 1.0;
    for token in &code.tokens {
        match token.raw {
            Raw::Text(t) => items.push(Item::Text(code.texts[t as usize].clone())),
            Raw::Number(n) => {
                match &mut vector {
                    Some(v) => v.push(sign * n),
                    None => items.push(Item::Number(Num::float(sign * n))),
                }
                sign = 1.0;
            }
            Raw::Sign(s) => match super::lexer::SIGNS[usize::from(s)] {
                "-" => sign = -sign,
                "+" | "," | ";" => {}
                "<" => vector = Some(Vec::new()),
                ">" => match vector.take() {
                    Some(v) if (2..=5).contains(&v.len()) => items.push(Item::Number(Num::vector(&v))),
                    _ => items.push(Item::Bad),
                },
                _ => items.push(Item::Bad),
            },
            _ => items.push(Item::Bad),
        }
    }
    items.reverse();
    let ends_with_comma = matches!(code.tokens.last().map(|t| t.raw), Some(Raw::Sign(s)) if super::lexer::SIGNS[usize::from(s)] == ",");
    (items, ends_with_comma)
}
