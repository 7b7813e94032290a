//! A small JSON reader that knows where every value stands, so that every fault of a glTF file has a line, a column and a path.
//!
//! Depth and number of values are limited: a hostile file can neither overflow the stack nor fill the memory.

use std::borrow::Cow;

use crate::span::{FileId, Span};

/// Deeper nesting is refused. glTF itself nests less than ten levels; `extras` may add some.
const DEPTH_LIMIT: u32 = 128;
/// More values are refused: 20 million take about 1 GB.
const VALUE_LIMIT: u32 = 20_000_000;
/// Characters are counted once per so many bytes, to find a column in a long line quickly.
const COLUMN_STEP: usize = 1024;

/// A value and the place where it starts.
#[derive(Debug)]
pub struct Value<'a> {
    /// Byte offset into the text.
    at: u32,
    /// What it is.
    pub kind: Kind<'a>,
}

/// What a JSON value is.
#[derive(Debug)]
pub enum Kind<'a> {
    /// `null`
    Null,
    /// `true` or `false`
    Bool(bool),
    /// A finite number.
    Number(f64),
    /// A string, unescaped.
    String(Cow<'a, str>),
    /// An array.
    Array(Vec<Value<'a>>),
    /// An object, in the order of the file.
    Object(Vec<(Cow<'a, str>, Value<'a>)>),
}

/// An object without members, for what a file leaves out.
pub static EMPTY: Value<'static> = Value { at: 0, kind: Kind::Object(Vec::new()) };

impl<'a> Value<'a> {
    /// The member of an object.
    pub fn get(&self, key: &str) -> Option<&Self> {
        match &self.kind {
            Kind::Object(members) => members.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// The elements of an array; nothing for other values.
    pub fn items(&self) -> &[Self] {
        match &self.kind {
            Kind::Array(items) => items,
            _ => &[],
        }
    }

    /// The text of a string.
    pub fn as_str(&self) -> Option<&str> {
        match &self.kind {
            Kind::String(s) => Some(s),
            _ => None,
        }
    }

    /// The value of a number.
    pub fn as_f64(&self) -> Option<f64> {
        match self.kind {
            Kind::Number(n) => Some(n),
            _ => None,
        }
    }
}

/// A syntax error: byte offset and what is wrong.
#[derive(Debug)]
pub struct SyntaxError {
    /// Byte offset into the text.
    pub at: usize,
    /// What is wrong.
    pub message: &'static str,
}

/// A text with what is needed to tell lines and columns.
#[derive(Debug)]
pub struct Places<'a> {
    text: &'a str,
    /// Byte offset of the start of each line.
    lines: Vec<u32>,
    /// Number of characters before each multiple of `COLUMN_STEP` bytes, up to the end of the text.
    chars: Vec<u32>,
}

impl<'a> Places<'a> {
    /// Counts the lines of a text.
    pub fn new(text: &'a str) -> Self {
        let mut lines = vec![0];
        let mut chars = Vec::with_capacity(text.len() / COLUMN_STEP + 1);
        let mut count = 0;
        for (i, b) in text.bytes().enumerate() {
            if i % COLUMN_STEP == 0 {
                chars.push(count);
            }
            count += u32::from(b & 0xC0 != 0x80);
            if b == b'\n' {
                lines.push(i as u32 + 1);
            }
        }
        chars.resize(text.len() / COLUMN_STEP + 1, count);
        Self { text, lines, chars }
    }

    fn chars_before(&self, at: usize) -> u32 {
        let step = at / COLUMN_STEP;
        let rest = &self.text.as_bytes()[step * COLUMN_STEP..at];
        self.chars[step] + rest.iter().filter(|&&b| b & 0xC0 != 0x80).count() as u32
    }

    /// Line and column of a byte offset.
    pub fn span(&self, at: usize) -> Span {
        let at = at.min(self.text.len());
        let line = self.lines.partition_point(|&l| l as usize <= at).max(1) - 1;
        let column = self.chars_before(at).saturating_sub(self.chars_before(self.lines[line] as usize)) + 1;
        Span::new(FileId(0), line as u32 + 1, column)
    }

    /// Where a value stands.
    pub fn span_of(&self, value: &Value<'_>) -> Span {
        self.span(value.at as usize)
    }
}

/// The JSON pointer of a value within a tree, such as `/meshes/3/primitives/0`; empty for the tree itself.
pub fn path_of(root: &Value<'_>, value: &Value<'_>) -> String {
    let mut path = String::new();
    let mut node = root;
    // Values start where their first character stands, so a parent's offset is less than its children's and siblings ascend.
    while node.at != value.at {
        match &node.kind {
            Kind::Array(items) => {
                let i = items.partition_point(|v| v.at <= value.at);
                let Some(i) = i.checked_sub(1) else { break };
                path.push_str(&format!("/{i}"));
                node = &items[i];
            }
            Kind::Object(members) => {
                let i = members.partition_point(|(_, v)| v.at <= value.at);
                let Some(i) = i.checked_sub(1) else { break };
                path.push('/');
                path.extend(members[i].0.chars().take(80));
                node = &members[i].1;
            }
            _ => break,
        }
    }
    path
}

/// Parses a JSON text.
///
/// # Errors
/// [`SyntaxError`] at the first offence.
pub fn parse(text: &str) -> Result<Value<'_>, SyntaxError> {
    let mut parser = Parser { text, bytes: text.as_bytes(), at: 0, values: 0 };
    if text.starts_with('\u{feff}') {
        parser.at = 3;
    }
    if text.len() >= u32::MAX as usize {
        return Err(parser.error("JSON of 4 GiB or more"));
    }
    let value = parser.value(0)?;
    parser.space();
    // Some writers pad the chunk of a GLB with zeros instead of spaces.
    if parser.bytes[parser.at..].iter().any(|&b| b != 0) {
        return Err(parser.error("something follows the end of the JSON"));
    }
    Ok(value)
}

struct Parser<'a> {
    text: &'a str,
    bytes: &'a [u8],
    at: usize,
    values: u32,
}

impl<'a> Parser<'a> {
    fn error(&self, message: &'static str) -> SyntaxError {
        SyntaxError { at: self.at, message }
    }

    fn space(&mut self) {
        while matches!(self.bytes.get(self.at), Some(b' ' | b'\t' | b'\n' | b'\r')) {
            self.at += 1;
        }
    }

    fn take(&mut self, byte: u8) -> bool {
        let found = self.bytes.get(self.at) == Some(&byte);
        self.at += usize::from(found);
        found
    }

    fn value(&mut self, depth: u32) -> Result<Value<'a>, SyntaxError> {
        if depth > DEPTH_LIMIT {
            return Err(self.error("nested more than 128 levels deep"));
        }
        self.values += 1;
        if self.values > VALUE_LIMIT {
            return Err(self.error("more than 20 million values"));
        }
        self.space();
        let at = self.at as u32;
        let kind = match self.bytes.get(self.at) {
            None => return Err(self.error("the JSON ends here, in the middle")),
            Some(b'{') => self.object(depth)?,
            Some(b'[') => self.array(depth)?,
            Some(b'"') => Kind::String(self.string()?),
            Some(b'-' | b'0'..=b'9') => self.number()?,
            _ => self.word()?,
        };
        Ok(Value { at, kind })
    }

    fn object(&mut self, depth: u32) -> Result<Kind<'a>, SyntaxError> {
        self.at += 1;
        let mut members = Vec::new();
        self.space();
        if self.take(b'}') {
            return Ok(Kind::Object(members));
        }
        loop {
            self.space();
            if self.bytes.get(self.at) != Some(&b'"') {
                return Err(self.error("expected a name in quotes"));
            }
            let key = self.string()?;
            self.space();
            if !self.take(b':') {
                return Err(self.error("expected `:`"));
            }
            members.push((key, self.value(depth + 1)?));
            self.space();
            if self.take(b'}') {
                return Ok(Kind::Object(members));
            }
            if !self.take(b',') {
                return Err(self.error("expected `,` or `}`"));
            }
        }
    }

    fn array(&mut self, depth: u32) -> Result<Kind<'a>, SyntaxError> {
        self.at += 1;
        let mut items = Vec::new();
        self.space();
        if self.take(b']') {
            return Ok(Kind::Array(items));
        }
        loop {
            items.push(self.value(depth + 1)?);
            self.space();
            if self.take(b']') {
                return Ok(Kind::Array(items));
            }
            if !self.take(b',') {
                return Err(self.error("expected `,` or `]`"));
            }
        }
    }

    fn number(&mut self) -> Result<Kind<'a>, SyntaxError> {
        let start = self.at;
        while matches!(self.bytes.get(self.at), Some(b'-' | b'+' | b'.' | b'e' | b'E' | b'0'..=b'9')) {
            self.at += 1;
        }
        match self.text[start..self.at].parse::<f64>() {
            Ok(n) if n.is_finite() => Ok(Kind::Number(n)),
            Ok(_) => Err(SyntaxError { at: start, message: "a number out of range" }),
            Err(_) => Err(SyntaxError { at: start, message: "not a number" }),
        }
    }

    fn word(&mut self) -> Result<Kind<'a>, SyntaxError> {
        for (word, kind) in [("true", Kind::Bool(true)), ("false", Kind::Bool(false)), ("null", Kind::Null)] {
            if self.bytes[self.at..].starts_with(word.as_bytes()) {
                self.at += word.len();
                return Ok(kind);
            }
        }
        Err(self.error("not a JSON value"))
    }

    fn string(&mut self) -> Result<Cow<'a, str>, SyntaxError> {
        self.at += 1;
        let start = self.at;
        let mut owned: Option<String> = None;
        // Start of the stretch that is not yet in `owned`.
        let mut from = start;
        loop {
            match self.bytes.get(self.at) {
                None => return Err(self.error("a string without an end")),
                Some(b'"') => {
                    let rest = &self.text[from..self.at];
                    self.at += 1;
                    return Ok(match owned {
                        None => Cow::Borrowed(rest),
                        Some(s) => Cow::Owned(s + rest),
                    });
                }
                Some(b'\\') => {
                    let text = owned.get_or_insert_default();
                    text.push_str(&self.text[from..self.at]);
                    let c = self.escape()?;
                    owned.get_or_insert_default().push(c);
                    from = self.at;
                }
                Some(0..0x20) => return Err(self.error("a control character in a string")),
                Some(_) => self.at += 1,
            }
        }
    }

    /// Reads an escape and stops behind it.
    fn escape(&mut self) -> Result<char, SyntaxError> {
        let c = self.bytes.get(self.at + 1).copied().unwrap_or(0);
        let plain = match c {
            b'"' | b'\\' | b'/' => c as char,
            b'b' => '\u{8}',
            b'f' => '\u{c}',
            b'n' => '\n',
            b'r' => '\r',
            b't' => '\t',
            b'u' => return self.unicode(),
            _ => return Err(self.error("an unknown escape in a string")),
        };
        self.at += 2;
        Ok(plain)
    }

    fn unicode(&mut self) -> Result<char, SyntaxError> {
        let high = self.hex(self.at)?;
        self.at += 6;
        // A pair of surrogates stands for one character; a single one becomes the replacement character.
        if (0xD800..0xDC00).contains(&high) && self.bytes[self.at..].starts_with(b"\\u") {
            let low = self.hex(self.at)?;
            if (0xDC00..0xE000).contains(&low) {
                self.at += 6;
                return Ok(char::from_u32(0x1_0000 + ((high - 0xD800) << 10) + (low - 0xDC00)).unwrap_or('\u{fffd}'));
            }
        }
        Ok(char::from_u32(high).unwrap_or('\u{fffd}'))
    }

    /// The number of a `\uXXXX` at an offset.
    fn hex(&self, at: usize) -> Result<u32, SyntaxError> {
        let digits = self.bytes.get(at + 2..at + 6).filter(|d| d.iter().all(u8::is_ascii_hexdigit));
        digits
            .and_then(|d| std::str::from_utf8(d).ok())
            .and_then(|d| u32::from_str_radix(d, 16).ok())
            .ok_or_else(|| self.error("expected four hexadecimal digits"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_places_and_paths() {
        let text = "{\n  \"ä\": [1, {\"b\": \"x\\u00e4\\ud83d\\ude00\\n\"}, true, null]\n}";
        let root = parse(text).unwrap();
        let list = root.get("ä").unwrap();
        let b = list.items()[1].get("b").unwrap();
        assert_eq!(b.as_str(), Some("xä😀\n"));
        assert_eq!(path_of(&root, b), "/ä/1/b");
        let places = Places::new(text);
        assert_eq!(places.span_of(list), Span::new(FileId(0), 2, 8));
        assert_eq!(places.span_of(b), Span::new(FileId(0), 2, 18));
        assert_eq!(list.items()[0].as_f64(), Some(1.0));
    }

    #[test]
    fn columns_of_a_long_line() {
        let text = format!("[\"{}\", 7]", "é".repeat(5000));
        let root = parse(&text).unwrap();
        assert_eq!(Places::new(&text).span_of(&root.items()[1]).column, 5006);
        let places = Places::new("");
        assert_eq!(places.span(0).column, 1);
    }

    #[test]
    fn faulty_texts_are_refused_at_their_place() {
        for (text, at) in [
            ("", 0),
            ("{", 1),
            ("[1,]", 3),
            ("{\"a\" 1}", 5),
            ("[NaN]", 1),
            ("[1e999]", 1),
            ("[--1]", 1),
            ("\"a", 2),
            ("\"\\u12\"", 1),
            ("[1] x", 4),
            ("{a:1}", 1),
        ] {
            assert_eq!(parse(text).unwrap_err().at, at, "{text}");
        }
        assert!(parse(&"[".repeat(1 << 20)).is_err());
        assert!(parse(&"{\"a\":".repeat(1 << 20)).is_err());
    }
}
