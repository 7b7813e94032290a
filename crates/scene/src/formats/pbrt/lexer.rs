//! Text → tokens: quoted strings, brackets and bare words, each with its place.

use std::borrow::Cow;

use crate::span::{FileId, Span};

/// A token.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token<'a> {
    /// A quoted string, unescaped, without its quotes.
    Text(Cow<'a, str>),
    /// `[`
    Open,
    /// `]`
    Close,
    /// A directive, a number, `true` or `false`.
    Word(&'a str),
}

/// What is wrong with the text at a place.
pub(super) type LexFault = (Span, String);

/// Cuts one file into tokens.
pub(super) struct Lexer<'a> {
    text: &'a str,
    at: usize,
    file: FileId,
    line: u32,
    /// Where the line begins.
    line_at: usize,
}

impl<'a> Lexer<'a> {
    /// At the beginning of a text.
    pub fn new(text: &'a str, file: FileId) -> Self {
        Self { text: text.strip_prefix('\u{feff}').unwrap_or(text), at: 0, file, line: 1, line_at: 0 }
    }

    /// Place of the next character.
    pub fn span(&self) -> Span {
        Span::new(self.file, self.line, (self.at - self.line_at) as u32 + 1)
    }

    fn skip(&mut self) {
        let bytes = self.text.as_bytes();
        while let Some(b) = bytes.get(self.at) {
            match b {
                b'\n' => {
                    self.at += 1;
                    self.line += 1;
                    self.line_at = self.at;
                }
                b'#' => self.at += bytes[self.at..].iter().position(|b| *b == b'\n').unwrap_or(bytes.len() - self.at),
                b if b.is_ascii_whitespace() => self.at += 1,
                _ => break,
            }
        }
    }

    /// The next token with its place; `None` at the end.
    pub fn next(&mut self) -> Result<Option<(Span, Token<'a>)>, LexFault> {
        self.skip();
        let span = self.span();
        let rest = &self.text[self.at..];
        let Some(first) = rest.bytes().next() else { return Ok(None) };
        let token = match first {
            b'[' => {
                self.at += 1;
                Token::Open
            }
            b']' => {
                self.at += 1;
                Token::Close
            }
            b'"' => Token::Text(self.text_literal(span)?),
            _ => {
                let end = rest.find(|c: char| c.is_ascii_whitespace() || matches!(c, '[' | ']' | '"' | '#')).unwrap_or(rest.len());
                self.at += end;
                Token::Word(&rest[..end])
            }
        };
        Ok(Some((span, token)))
    }

    /// A quoted string; it ends on its own line.
    fn text_literal(&mut self, span: Span) -> Result<Cow<'a, str>, LexFault> {
        let body = &self.text[self.at + 1..];
        let mut owned: Option<String> = None;
        let mut chars = body.char_indices();
        while let Some((i, c)) = chars.next() {
            match c {
                '"' => {
                    self.at += i + 2;
                    return Ok(owned.map_or(Cow::Borrowed(&body[..i]), Cow::Owned));
                }
                '\n' => break,
                '\\' => {
                    let text = owned.get_or_insert_with(|| body[..i].to_owned());
                    match chars.next() {
                        Some((_, 'n')) => text.push('\n'),
                        Some((_, 't')) => text.push('\t'),
                        Some((_, 'r')) => text.push('\r'),
                        Some((_, 'b')) => text.push('\u{8}'),
                        Some((_, 'f')) => text.push('\u{c}'),
                        Some((_, c @ ('\\' | '\'' | '"'))) => text.push(c),
                        _ => return Err((span, "an unknown escape in a string".to_owned())),
                    }
                }
                c => {
                    if let Some(text) = &mut owned {
                        text.push(c);
                    }
                }
            }
        }
        Err((span, "a string that does not end on its line".to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_have_places() {
        let mut lexer = Lexer::new("Shape \"sp\\\"here\" # comment\n  [1 -2.5e3]", FileId(3));
        let mut all = Vec::new();
        while let Some((span, token)) = lexer.next().unwrap() {
            assert_eq!(span.file, FileId(3));
            all.push((span.line, span.column, token));
        }
        let expected = [
            (1, 1, Token::Word("Shape")),
            (1, 7, Token::Text("sp\"here".into())),
            (2, 3, Token::Open),
            (2, 4, Token::Word("1")),
            (2, 6, Token::Word("-2.5e3")),
            (2, 12, Token::Close),
        ];
        assert_eq!(all, expected);
    }

    #[test]
    fn unended_strings_are_faults() {
        assert!(Lexer::new("\"abc\n\"", FileId(0)).next().is_err());
        assert!(Lexer::new("\"a\\q\"", FileId(0)).next().is_err());
    }
}
