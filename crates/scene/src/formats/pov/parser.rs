//! The parser: a cursor over tokens, with all directives already obeyed. The contract that the items build on.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use etendue_procedural::{Color, ImageId, Layer, Texture};
use glam::{DMat4, DVec2, DVec3, DVec4};

use super::Value;
use super::files::Files;
use super::lexer::Names;
use super::options::PovOptions;
use super::random::Streams;
use super::stream::{Barrier, Block, Frame};
use super::symbols::Symbols;
use crate::desc::classic::{ClassicImage, ClassicScene, ImageContent, ImageGamma, ImageSource};
use crate::report::Report;
use crate::span::Span;

/// Parsing has ended early: the fault is in the report.
#[derive(Debug)]
pub struct Stop;

/// A parsed thing, or the end of parsing.
pub type Parse<T> = Result<T, Stop>;

/// A token as items see it: directives, macros, comments and includes are gone, identifiers replaced by their values.
#[derive(Clone, Debug)]
pub enum Token {
    /// Reserved word, by its text, such as `sphere`. Of words with two spellings the American one.
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
    /// Faults and losses so far.
    pub report: Report,
    pub(super) options: PovOptions,
    pub(super) files: Files,
    pub(super) names: Names,
    pub(super) symbols: Symbols,
    /// What is being read: the scene file, in it an include file, in it a macro …
    pub(super) frames: Vec<Frame>,
    /// Open `#if`, `#while` … of all frames.
    pub(super) blocks: Vec<Block>,
    pub(super) barrier: Barrier,
    /// The next token, where it has been looked at.
    pub(super) ahead: Option<(Token, Span)>,
    /// Open braces, parentheses and brackets.
    pub(super) nesting: u32,
    /// Directives that are being obeyed inside of one another, and nested expressions.
    pub(super) depth: u32,
    /// Tokens read so far.
    pub(super) work: u64,
    /// Size of what is being declared, and the nesting at which it began.
    pub(super) used: super::symbols::Size,
    pub(super) base_nesting: u32,
    pub(super) begun: std::time::Instant,
    /// Blocks `{ … }` begun so far.
    pub(super) braces: u64,
    pub(super) living_elements: Arc<AtomicU64>,
    /// Bytes of all strings made so far.
    pub(super) string_bytes: u64,
    pub(super) version: u32,
    /// What the word `version` stands for: 3.7 before the first `#version`, though the scene is then read as one of 3.62.
    pub(super) stated_version: u32,
    /// `noise_generator` of the global settings was said; otherwise it goes by the version.
    pub(super) noise_generator_given: bool,
    pub(super) streams: Streams,
    pub(super) default: Arc<Texture>,
    /// Whether the scene has a camera.
    pub(super) has_camera: bool,
}

/// Endings of picture files, tried where a name has none that leads to a file.
const IMAGE_EXTENSIONS: &[&str] =
    &["png", "jpg", "jpeg", "gif", "tga", "bmp", "ppm", "pgm", "tif", "tiff", "exr", "hdr", "iff", "pot", "sys"];
/// The same of other files.
const FILE_EXTENSIONS: &[&str] = &["ttf", "df3", "png", "gif", "tga", "pgm", "ppm", "pot", "jpg"];

/// Most braces, parentheses and brackets that may be open at a time.
pub(super) const NESTING_LIMIT: u32 = 400;

impl Parser {
    /// A parser that has nothing to read yet.
    pub(super) fn new(options: PovOptions, files: Files) -> Self {
        Self {
            scene: ClassicScene::default(),
            report: Report::default(),
            options,
            files,
            names: Names::default(),
            symbols: Symbols::default(),
            frames: Vec::new(),
            blocks: Vec::new(),
            barrier: Barrier::default(),
            ahead: None,
            nesting: 0,
            depth: 0,
            work: 0,
            used: super::symbols::Size::default(),
            base_nesting: 0,
            begun: std::time::Instant::now(),
            braces: 0,
            living_elements: Arc::default(),
            string_bytes: 0,
            version: 362,
            stated_version: 370,
            noise_generator_given: false,
            streams: Streams::default(),
            default: Arc::new(Texture::Layers(vec![Layer::default()])),
            has_camera: false,
        }
    }

    /// A parser of a text that reads no files, such as a test has it.
    pub fn from_text(text: &str) -> Self {
        Self::from_bytes(text.as_bytes())
    }

    /// A parser of the bytes of a scene that reads no files.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut parser = Self::new(PovOptions::default(), Files::new(PathBuf::from("<text>"), &[]));
        parser.begin(bytes);
        parser
    }

    /// The next token, without taking it.
    pub fn peek(&mut self) -> Parse<&Token> {
        self.fill()?;
        // `fill` has put a token there.
        Ok(self.ahead.as_ref().map_or(&Token::End, |(t, _)| t))
    }

    /// Takes the next token.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Parse<Token> {
        self.fill()?;
        let token = self.ahead.take().map_or(Token::End, |(t, _)| t);
        self.barrier.taken = true;
        match token {
            Token::Sign("{") => {
                self.open()?;
                self.braces += 1;
                if self.braces > self.options.block_limit {
                    let span = self.here();
                    return Err(
                        self.error(span, format!("more than {} blocks; the limit keeps the memory bounded", self.options.block_limit))
                    );
                }
            }
            Token::Sign("(" | "[") => self.open()?,
            Token::Sign("}" | ")" | "]") => self.nesting = self.nesting.saturating_sub(1),
            _ => {}
        }
        Ok(token)
    }

    fn open(&mut self) -> Parse<()> {
        self.nesting += 1;
        if self.nesting > NESTING_LIMIT {
            let span = self.here();
            return Err(self.error(span, format!("more than {NESTING_LIMIT} braces, parentheses and brackets are open")));
        }
        Ok(())
    }

    /// Place of the next token.
    pub fn span(&mut self) -> Span {
        if self.fill().is_err() {
            return self.here();
        }
        self.ahead.as_ref().map_or_else(|| self.here(), |(_, s)| *s)
    }

    /// Whether the next token is this reserved word or sign.
    pub fn at(&mut self, text: &str) -> Parse<bool> {
        Ok(matches!(self.peek()?, Token::Word(t) | Token::Sign(t) if *t == text))
    }

    /// Takes the next token if it is this reserved word or sign.
    pub fn accept(&mut self, text: &str) -> Parse<bool> {
        let there = self.at(text)?;
        if there {
            self.next()?;
        }
        Ok(there)
    }

    /// Takes the next token, which must be this reserved word or sign.
    ///
    /// # Errors
    /// [`Stop`] after an error with both what was expected and what is there.
    pub fn expect(&mut self, text: &str) -> Parse<()> {
        if self.accept(text)? {
            return Ok(());
        }
        let span = self.span();
        let there = self.describe_next()?;
        Err(self.error(span, format!("expected `{text}`, but there is {there}")))
    }

    /// If the next token is a reserved word of this list, takes it and returns it.
    pub fn accept_any(&mut self, words: &[&'static str]) -> Parse<Option<&'static str>> {
        let Token::Word(word) = *self.peek()? else { return Ok(None) };
        if words.contains(&word) {
            self.next()?;
            return Ok(Some(word));
        }
        Ok(None)
    }

    /// If the next token is an identifier that `pick` wants, takes it and returns what `pick` made of it.
    pub fn accept_value<T>(&mut self, pick: impl FnOnce(&Value) -> Option<T>) -> Parse<Option<T>> {
        let Token::Identifier(_, value) = self.peek()? else { return Ok(None) };
        let picked = pick(value);
        if picked.is_some() {
            self.next()?;
        }
        Ok(picked)
    }

    /// Puts an error at a place into the report; `return Err(parser.error(span, "…"))`.
    pub fn error(&mut self, span: Span, message: impl Into<String>) -> Stop {
        let mut message = message.into();
        message.push_str(&self.call_chain());
        self.report.error(span, message);
        Stop
    }

    /// An error that names the next token as unexpected in `context`, such as `a pigment`.
    pub fn unexpected(&mut self, context: &str) -> Stop {
        let span = self.span();
        match self.describe_next() {
            Ok(there) => self.error(span, format!("{there} is not expected in {context}")),
            Err(stop) => stop,
        }
    }

    /// The next token in words.
    fn describe_next(&mut self) -> Parse<String> {
        Ok(match self.peek()? {
            Token::Word(w) => format!("`{w}`"),
            Token::Identifier(name, value) => format!("`{name}` ({})", value.kind()),
            Token::Unknown(name) => format!("the undeclared identifier `{name}`"),
            Token::Number(n) => format!("the number {n}"),
            Token::Text(t) => format!("the string \"{}\"", t.chars().take(40).collect::<String>()),
            Token::Sign("#") => "a directive".to_owned(),
            Token::Sign(s) => format!("`{s}`"),
            Token::End => "the end of the file".to_owned(),
        })
    }

    /// Puts a warning into the report.
    pub fn warning(&mut self, span: Span, message: impl Into<String>) {
        self.report.warning(span, message);
    }

    /// Puts something that is read but not honored into the loss report.
    pub fn loss(&mut self, span: Span, feature: impl Into<String>, effect: impl Into<String>) {
        self.report.loss(span, feature, effect);
    }

    /// The language version at this place: 3.7 is 370; changes with `#version`.
    pub fn version(&self) -> u32 {
        self.version
    }

    /// A float expression.
    pub fn float(&mut self) -> Parse<f64> {
        let span = self.span();
        let n = self.num()?;
        if n.len != 1 {
            return Err(self.error(span, "a float is expected, but this is a vector or color"));
        }
        Ok(n.v[0])
    }

    /// Whether the next token can begin a float expression (for optional values such as `on`-less flags).
    pub fn at_float(&mut self) -> Parse<bool> {
        self.at_number()
    }

    /// A float expression as a flag; `true` where none follows.
    pub fn flag(&mut self) -> Parse<bool> {
        Ok(if self.at_float()? { self.float()?.abs() > 1e-10 } else { true })
    }

    /// A vector expression of two components; a float is promoted.
    pub fn vector2(&mut self) -> Parse<DVec2> {
        Ok(self.num()?.xy())
    }

    /// A vector expression of three components; a float is promoted.
    pub fn vector3(&mut self) -> Parse<DVec3> {
        Ok(self.num()?.xyz())
    }

    /// A vector expression of four components; a float is promoted.
    pub fn vector4(&mut self) -> Parse<DVec4> {
        Ok(self.num()?.xyzt())
    }

    /// A color: `color …`, `rgb …`, `rgbft …`, `red 1 green …`, an identifier, a vector expression.
    pub fn color(&mut self) -> Parse<Color> {
        Ok(self.color_num()?.color())
    }

    /// A string expression.
    pub fn string(&mut self) -> Parse<Arc<str>> {
        self.string_value()
    }

    /// Takes a comma if one follows.
    pub fn comma(&mut self) -> Parse<()> {
        self.accept(",").map(|_| ())
    }

    /// One `translate`, `rotate`, `scale`, `matrix` or `transform { … }`, if one follows.
    pub fn accept_transform(&mut self) -> Parse<Option<DMat4>> {
        self.transform_item()
    }

    /// Registers a picture by the name in the file, looked up in the scene's folder and the search path.
    pub fn image(
        &mut self,
        name: &str,
        span: Span,
        content: ImageContent,
        (gamma, premultiplied): (Option<ImageGamma>, Option<bool>),
    ) -> Parse<ImageId> {
        let path = self.find_file(name, IMAGE_EXTENSIONS, span)?;
        let image = ClassicImage { source: ImageSource::File(path), span, gamma, content, premultiplied };
        let same = self.scene.images.iter().position(|i| {
            (&i.source, i.gamma, i.content, i.premultiplied) == (&image.source, image.gamma, image.content, image.premultiplied)
        });
        Ok(same.map_or_else(|| self.add_image(image), |at| at as ImageId))
    }

    /// The number of a picture that is new.
    pub(super) fn add_image(&mut self, image: ClassicImage) -> ImageId {
        let id = self.scene.images.len() as ImageId;
        if let Some(probe) = &self.options.probe {
            probe.add_image(id, &image, &self.scene.settings);
        }
        self.scene.images.push(image);
        id
    }

    /// The bytes of a file (font, density file, mesh) by the name in the scene.
    pub fn file_bytes(&mut self, name: &str, span: Span) -> Parse<Vec<u8>> {
        self.read_file(name, FILE_EXTENSIONS, span)
    }

    /// Texture, pigment, normal and finish that objects and textures begin with (`#default`).
    pub fn default_texture(&self) -> Arc<Texture> {
        self.default.clone()
    }
}
