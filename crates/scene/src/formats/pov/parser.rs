//! The parser: a cursor over tokens, with all directives already obeyed. The contract that the items build on.

use std::sync::Arc;

use etendue_procedural::Color;
use glam::{DMat4, DVec2, DVec3};

use super::Value;
use crate::desc::classic::ClassicScene;
use crate::span::Span;

/// Parsing has ended early: the fault is in the report.
#[derive(Debug)]
pub struct Stop;

/// A parsed thing, or the end of parsing.
pub type Parse<T> = Result<T, Stop>;

/// A token as items see it: directives, macros, comments and includes are gone, identifiers replaced by their values.
#[derive(Clone, Debug)]
pub enum Token {
    /// Reserved word, by its text, such as `sphere`.
    Word(&'static str),
    /// A declared identifier: its name and its value. Float, vector and string identifiers are met inside expressions only.
    Identifier(Arc<str>, Value),
    /// An identifier that has not been declared.
    Unknown(Arc<str>),
    /// Number.
    Number(f64),
    /// String literal.
    Text(Arc<str>),
    /// Punctuation: one of `{ } ( ) [ ] < > , ; + - * / ? : & | = ! .` and `<= >= !=`.
    Sign(&'static str),
    /// End of the scene.
    End,
}

/// Reads one scene. Methods for items are in `items/`.
pub struct Parser {
    /// The scene so far; items add to it.
    pub scene: ClassicScene,
}

impl Parser {
    /// The next token, without taking it.
    pub fn peek(&mut self) -> Parse<&Token> {
        Err(Stop)
    }

    /// Takes the next token.
    pub fn next(&mut self) -> Parse<Token> {
        Err(Stop)
    }

    /// Place of the next token.
    pub fn span(&mut self) -> Span {
        Span::default()
    }

    /// Takes the next token if it is this reserved word or sign.
    pub fn accept(&mut self, text: &str) -> Parse<bool> {
        let _ = text;
        Err(Stop)
    }

    /// Takes the next token, which must be this reserved word or sign.
    ///
    /// # Errors
    /// [`Stop`] after an error with both what was expected and what is there.
    pub fn expect(&mut self, text: &str) -> Parse<()> {
        let _ = text;
        Err(Stop)
    }

    /// If the next token is a reserved word of this list, takes it and returns it.
    pub fn accept_any(&mut self, words: &[&'static str]) -> Parse<Option<&'static str>> {
        let _ = words;
        Err(Stop)
    }

    /// If the next token is an identifier that `pick` wants, takes it and returns what `pick` made of it.
    pub fn accept_value<T>(&mut self, pick: impl FnOnce(&Value) -> Option<T>) -> Parse<Option<T>> {
        let _ = pick;
        Err(Stop)
    }

    /// Puts an error at a place into the report; `return Err(parser.error(span, "…"))`.
    pub fn error(&mut self, span: Span, message: impl Into<String>) -> Stop {
        let _ = (span, message.into());
        Stop
    }

    /// An error that names the next token as unexpected in `context`, such as `a pigment`.
    pub fn unexpected(&mut self, context: &str) -> Stop {
        let _ = context;
        Stop
    }

    /// Puts a warning into the report.
    pub fn warning(&mut self, span: Span, message: impl Into<String>) {
        let _ = (span, message.into());
    }

    /// Puts something that is read but not honored into the loss report.
    pub fn loss(&mut self, span: Span, feature: impl Into<String>, effect: impl Into<String>) {
        let _ = (span, feature.into(), effect.into());
    }

    /// The language version at this place: 3.7 is 370; changes with `#version`.
    pub fn version(&self) -> u32 {
        370
    }

    /// A float expression.
    pub fn float(&mut self) -> Parse<f64> {
        Err(Stop)
    }

    /// Whether the next token can begin a float expression (for optional values such as `on`-less flags).
    pub fn at_float(&mut self) -> Parse<bool> {
        Err(Stop)
    }

    /// A float expression as a flag; `true` where none follows.
    pub fn flag(&mut self) -> Parse<bool> {
        Err(Stop)
    }

    /// A vector expression of two components; a float is promoted.
    pub fn vector2(&mut self) -> Parse<DVec2> {
        Err(Stop)
    }

    /// A vector expression of three components; a float is promoted.
    pub fn vector3(&mut self) -> Parse<DVec3> {
        Err(Stop)
    }

    /// A vector expression of four components; a float is promoted.
    pub fn vector4(&mut self) -> Parse<glam::DVec4> {
        Err(Stop)
    }

    /// A color: `color …`, `rgb …`, `rgbft …`, `red 1 green …`, an identifier, a vector expression.
    pub fn color(&mut self) -> Parse<Color> {
        Err(Stop)
    }

    /// A string expression.
    pub fn string(&mut self) -> Parse<Arc<str>> {
        Err(Stop)
    }

    /// Takes a comma if one follows.
    pub fn comma(&mut self) -> Parse<()> {
        Err(Stop)
    }

    /// One `translate`, `rotate`, `scale`, `matrix` or `transform { … }`, if one follows.
    pub fn accept_transform(&mut self) -> Parse<Option<DMat4>> {
        Err(Stop)
    }

    /// Registers a picture by the name in the file, looked up in the scene's folder and the search path.
    pub fn image(&mut self, name: &str, span: Span, gamma: Option<f64>) -> Parse<etendue_procedural::ImageId> {
        let _ = (name, span, gamma);
        Err(Stop)
    }

    /// The bytes of a file (font, density file, mesh) by the name in the scene.
    pub fn file_bytes(&mut self, name: &str, span: Span) -> Parse<Vec<u8>> {
        let _ = (name, span);
        Err(Stop)
    }

    /// Texture, pigment, normal and finish that objects and textures begin with (`#default`).
    pub fn default_texture(&self) -> Arc<etendue_procedural::Texture> {
        Arc::new(etendue_procedural::Texture::Layers(vec![etendue_procedural::Layer::default()]))
    }
}
