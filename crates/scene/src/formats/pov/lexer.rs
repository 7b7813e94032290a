//! From bytes to tokens. A whole file is cut into tokens at once, and the tokens are kept: loops and macros go over them again
//! without looking at the text.

use std::collections::HashMap;
use std::sync::Arc;

use super::words::{self, WordId};
use crate::span::{FileId, Span};

/// Number of a name, the same for the same name in all files.
pub(super) type Sym = u32;

/// Most characters of a string literal.
pub(super) const STRING_LIMIT: usize = 1 << 24;

/// Numbers for names.
#[derive(Default)]
pub(super) struct Names {
    texts: Vec<Arc<str>>,
    numbers: HashMap<Arc<str>, Sym>,
}

impl Names {
    /// The number of a name, a new one if it has none.
    pub(super) fn intern(&mut self, name: &str) -> Sym {
        if let Some(&n) = self.numbers.get(name) {
            return n;
        }
        let text: Arc<str> = name.into();
        let number = self.texts.len() as Sym;
        self.texts.push(text.clone());
        self.numbers.insert(text, number);
        number
    }

    /// The name of a number.
    pub(super) fn text(&self, name: Sym) -> Arc<str> {
        self.texts.get(name as usize).cloned().unwrap_or_else(|| "?".into())
    }
}

/// What a directive does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Directive {
    Break,
    Case,
    Debug,
    Declare,
    Default,
    Else,
    Elseif,
    End,
    Error,
    Fclose,
    Fopen,
    For,
    If,
    Ifdef,
    Ifndef,
    Include,
    Local,
    Macro,
    Range,
    Read,
    Render,
    Statistics,
    Switch,
    Undef,
    Version,
    Warning,
    While,
    Write,
    MaxIntersections,
    MaxTraceLevel,
}

impl Directive {
    /// The directive of a word.
    pub(super) fn of(word: &str) -> Option<Self> {
        use Directive as D;
        Some(match word {
            "break" => D::Break,
            "case" => D::Case,
            "debug" => D::Debug,
            "declare" => D::Declare,
            "default" => D::Default,
            "else" => D::Else,
            "elseif" => D::Elseif,
            "end" => D::End,
            "error" => D::Error,
            "fclose" => D::Fclose,
            "fopen" => D::Fopen,
            "for" => D::For,
            "if" => D::If,
            "ifdef" => D::Ifdef,
            "ifndef" => D::Ifndef,
            "include" => D::Include,
            "local" => D::Local,
            "macro" => D::Macro,
            "range" => D::Range,
            "read" => D::Read,
            "render" => D::Render,
            "statistics" => D::Statistics,
            "switch" => D::Switch,
            "undef" => D::Undef,
            "version" => D::Version,
            "warning" => D::Warning,
            "while" => D::While,
            "write" => D::Write,
            "max_intersections" => D::MaxIntersections,
            "max_trace_level" => D::MaxTraceLevel,
            _ => return None,
        })
    }

    fn opens(self) -> bool {
        use Directive as D;
        matches!(self, D::If | D::Ifdef | D::Ifndef | D::Switch | D::While | D::For | D::Macro)
    }
}

/// Signs of the language.
pub(super) const SIGNS: &[&str] = &[
    "{", "}", "(", ")", "[", "]", "<", ">", ",", ";", "+", "-", "*", "/", "?", ":", "&", "|", "=", "!", ".", "<=", ">=", "!=", "@", "^",
    "%", "~", "\\", "'", "`", "$",
];

/// Of each byte its place in [`SIGNS`], if it is one.
const SIGN_OF_BYTE: [Option<u8>; 256] = {
    let mut places = [None; 256];
    let mut i = 0;
    while i < SIGNS.len() {
        if SIGNS[i].len() == 1 {
            places[SIGNS[i].as_bytes()[0] as usize] = Some(i as u8);
        }
        i += 1;
    }
    places
};

/// A token as it stands in a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Raw {
    /// Reserved word.
    Word(WordId),
    /// Any other name.
    Name(Sym),
    /// Number.
    Number(f64),
    /// String literal, by its number in [`Code::texts`].
    Text(u32),
    /// Index into [`SIGNS`].
    Sign(u8),
    /// `#` and a word. `next`: the next branch of the same block or its `#end`, `end`: the block's `#end`, as indices of tokens;
    /// `u32::MAX` where the block is not closed.
    Directive { kind: Directive, next: u32, end: u32 },
    /// Something that is no token; the number of its message in [`Code::texts`].
    Bad(u32),
}

/// A token and its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct RawToken {
    pub(super) raw: Raw,
    pub(super) line: u32,
    pub(super) column: u32,
}

/// The tokens of a file.
#[derive(Debug)]
pub(super) struct Code {
    pub(super) file: FileId,
    pub(super) tokens: Vec<RawToken>,
    pub(super) texts: Vec<Arc<str>>,
    /// Place after the last token.
    pub(super) last: Span,
}

impl Code {
    /// The place of a token; past the end, the end of the file.
    pub(super) fn span(&self, at: usize) -> Span {
        self.tokens.get(at).map_or(self.last, |t| Span::new(self.file, t.line, t.column))
    }
}

/// Cuts a file into tokens. Never fails: what is no token becomes [`Raw::Bad`], an error only where it is read.
pub(super) fn lex(file: FileId, bytes: &[u8], names: &mut Names) -> Code {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut lexer = Lexer {
        bytes,
        at: 0,
        line: 1,
        line_start: 0,
        counted: (0, 0),
        names,
        code: Code { file, tokens: Vec::new(), texts: Vec::new(), last: Span::default() },
    };
    while lexer.token() {}
    let (line, column) = lexer.place(lexer.at);
    let mut code = lexer.code;
    code.last = Span::new(file, line, column);
    link(&mut code);
    code
}

struct Lexer<'a, 'n> {
    bytes: &'a [u8],
    at: usize,
    line: u32,
    line_start: usize,
    /// A place in the line and how many characters are before it.
    counted: (usize, usize),
    names: &'n mut Names,
    code: Code,
}

impl<'a> Lexer<'a, '_> {
    fn byte(&self, ahead: usize) -> u8 {
        self.bytes.get(self.at + ahead).copied().unwrap_or(0)
    }

    fn place(&mut self, at: usize) -> (u32, u32) {
        // Columns are characters: continuation bytes of UTF-8 do not count. Tokens follow each other, so that each byte is looked at once.
        let (from, before) = self.counted;
        let (from, before) = if from >= self.line_start && from <= at { (from, before) } else { (self.line_start.min(at), 0) };
        let text = &self.bytes[from.min(self.bytes.len())..at.min(self.bytes.len())];
        let column = before + text.iter().filter(|&&b| b & 0xc0 != 0x80).count();
        self.counted = (at, column);
        (self.line, u32::try_from(column + 1).unwrap_or(u32::MAX))
    }

    fn newline(&mut self) {
        self.line = self.line.saturating_add(1);
        self.line_start = self.at;
    }

    /// Skips blanks and comments; the message of a comment that does not end.
    fn blanks(&mut self) -> Option<(u32, u32)> {
        while let Some(&byte) = self.bytes.get(self.at) {
            match byte {
                b' ' | b'\t' | 0x0b | 0x0c | 0x1a | 0 => self.at += 1,
                b'\n' => {
                    self.at += 1;
                    self.newline();
                }
                b'\r' => {
                    self.at += 1;
                    if self.byte(0) != b'\n' {
                        self.newline();
                    }
                }
                0xc2 if self.byte(1) == 0xa0 => self.at += 2,
                b'/' if self.byte(1) == b'/' => {
                    let rest = &self.bytes[self.at..];
                    self.at += rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
                }
                b'/' if self.byte(1) == b'*' => {
                    let start = self.place(self.at);
                    if !self.block_comment() {
                        return Some(start);
                    }
                }
                _ => break,
            }
        }
        None
    }

    fn block_comment(&mut self) -> bool {
        let mut depth = 0u32;
        while self.at < self.bytes.len() {
            match (self.byte(0), self.byte(1)) {
                (b'/', b'*') => {
                    depth += 1;
                    self.at += 2;
                }
                (b'*', b'/') => {
                    depth -= 1;
                    self.at += 2;
                    if depth == 0 {
                        return true;
                    }
                }
                (b'\n', _) => {
                    self.at += 1;
                    self.newline();
                }
                _ => self.at += 1,
            }
        }
        false
    }

    fn push(&mut self, raw: Raw, (line, column): (u32, u32)) {
        self.code.tokens.push(RawToken { raw, line, column });
    }

    fn text(&mut self, text: &str) -> u32 {
        self.code.texts.push(text.into());
        self.code.texts.len() as u32 - 1
    }

    fn bad(&mut self, message: &str, place: (u32, u32)) {
        let text = self.text(message);
        self.push(Raw::Bad(text), place);
    }

    /// Reads a token; `false` at the end.
    fn token(&mut self) -> bool {
        if let Some(place) = self.blanks() {
            self.bad("this comment does not end", place);
            return false;
        }
        if self.at >= self.bytes.len() {
            return false;
        }
        let place = self.place(self.at);
        let b = self.byte(0);
        match b {
            b'0'..=b'9' => self.number(place),
            b'.' if self.byte(1).is_ascii_digit() => self.number(place),
            b'a'..=b'z' | b'A'..=b'Z' | b'_' => {
                let word = self.word();
                let raw = match words::find(word) {
                    Some(id) => Raw::Word(id),
                    None => Raw::Name(self.names.intern(word)),
                };
                self.push(raw, place);
            }
            b'"' => self.string(place),
            b'#' => {
                self.at += 1;
                if self.blanks().is_some() {
                    self.bad("this comment does not end", place);
                    return false;
                }
                let start = self.at;
                match Directive::of(self.word()) {
                    Some(kind) => self.push(Raw::Directive { kind, next: u32::MAX, end: u32::MAX }, place),
                    // Before any other word the sign means nothing (measured).
                    None => self.at = start,
                }
            }
            _ => {
                let two = match (b, self.byte(1)) {
                    (b'<', b'=') => Some("<="),
                    (b'>', b'=') => Some(">="),
                    (b'!', b'=') => Some("!="),
                    _ => None,
                };
                let two = two.and_then(|sign| SIGNS.iter().position(|s| *s == sign));
                let one = SIGN_OF_BYTE[usize::from(b)];
                if let Some(i) = two {
                    self.at += 2;
                    self.push(Raw::Sign(i as u8), place);
                } else if let Some(i) = one {
                    self.at += 1;
                    self.push(Raw::Sign(i), place);
                } else {
                    self.at += 1;
                    while self.byte(0) & 0xc0 == 0x80 {
                        self.at += 1;
                    }
                    self.bad("this character means nothing here", place);
                }
            }
        }
        true
    }

    fn word(&mut self) -> &'a str {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let word = rest.iter().position(|b| !(b.is_ascii_alphanumeric() || *b == b'_')).map_or(rest, |end| &rest[..end]);
        self.at += word.len();
        // ASCII by the line above.
        std::str::from_utf8(word).unwrap_or("")
    }

    fn number(&mut self, place: (u32, u32)) {
        let start = self.at;
        let digits = |s: &mut Self| {
            while s.byte(0).is_ascii_digit() {
                s.at += 1;
            }
        };
        digits(self);
        if self.byte(0) == b'.' {
            self.at += 1;
            digits(self);
        }
        if matches!(self.byte(0), b'e' | b'E') {
            let sign = usize::from(matches!(self.byte(1), b'+' | b'-'));
            if self.byte(1 + sign).is_ascii_digit() {
                self.at += 1 + sign;
                digits(self);
            }
        }
        let text = std::str::from_utf8(&self.bytes[start..self.at]).unwrap_or("0");
        match text.parse() {
            Ok(v) => self.push(Raw::Number(v), place),
            Err(_) => self.bad("this is no number", place),
        }
    }

    fn string(&mut self, place: (u32, u32)) {
        self.at += 1;
        let mut out: Vec<u8> = Vec::new();
        loop {
            if self.at >= self.bytes.len() || out.len() > STRING_LIMIT {
                self.bad("this string does not end", place);
                self.at = self.bytes.len();
                return;
            }
            let b = self.byte(0);
            self.at += 1;
            match b {
                b'"' => break,
                b'\\' => self.escape(&mut out),
                b'\n' => {
                    out.push(b);
                    self.newline();
                }
                _ => out.push(b),
            }
        }
        let text = decode(&out);
        let text = self.text(&text);
        self.push(Raw::Text(text), place);
    }

    fn escape(&mut self, out: &mut Vec<u8>) {
        let b = self.byte(0);
        if self.at < self.bytes.len() {
            self.at += 1;
        }
        out.push(match b {
            b'a' => 7,
            b'b' => 8,
            b'f' => 12,
            b'n' => b'\n',
            b'r' => b'\r',
            b't' => b'\t',
            b'v' => 11,
            b'0' => 0,
            b'u' => {
                let hex = self.bytes.get(self.at..self.at + 4).and_then(|h| std::str::from_utf8(h).ok());
                let code = hex.filter(|h| h.bytes().all(|b| b.is_ascii_hexdigit())).and_then(|h| u32::from_str_radix(h, 16).ok());
                if let Some(c) = code {
                    self.at += 4;
                    let c = char::from_u32(c).unwrap_or(char::REPLACEMENT_CHARACTER);
                    out.extend_from_slice(c.encode_utf8(&mut [0; 4]).as_bytes());
                    return;
                }
                b'u'
            }
            _ => b,
        });
    }
}

/// Text of unknown encoding: UTF-8 if it is that, else Latin-1.
pub(super) fn decode(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(t) => t.to_owned(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

/// Connects the branches of each block, so that skipping one is a jump.
fn link(code: &mut Code) {
    // Of each open block its branches so far.
    let mut open: Vec<Vec<usize>> = Vec::new();
    for i in 0..code.tokens.len() {
        let Raw::Directive { kind, .. } = code.tokens[i].raw else { continue };
        match kind {
            k if k.opens() => open.push(vec![i]),
            Directive::Else | Directive::Elseif | Directive::Case | Directive::Range => {
                if let Some(branches) = open.last_mut() {
                    branches.push(i);
                }
            }
            Directive::End => {
                let branches = open.pop().unwrap_or_default();
                for (k, &b) in branches.iter().enumerate() {
                    if let Raw::Directive { next, end, .. } = &mut code.tokens[b].raw {
                        *next = branches.get(k + 1).copied().unwrap_or(i) as u32;
                        *end = i as u32;
                    }
                }
            }
            _ => {}
        }
    }
}
