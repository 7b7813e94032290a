//! Directives: what changes the graphics state, and what makes items.

use std::borrow::Cow;
use std::rc::Rc;

use glam::{DMat4, DVec3, DVec4};

use super::lexer::{Lexer, Token};
use super::params::{Parameter, Params, Values};
use super::spectrum::ColorSpace;
use super::{Reader, resolve_message};
use crate::desc::{AddNode, GroupDesc, InstanceDesc, Node};
use crate::formats::Resolver;
use crate::span::{FileId, Span};

/// Deepest nesting of included files.
const INCLUDE_DEPTH: u32 = 64;
/// Most files that are included in all.
const INCLUDE_LIMIT: u32 = 100_000;
/// Deepest nesting of attributes.
const STACK_LIMIT: usize = 100_000;

/// Tokens with one of look-ahead.
struct Cursor<'a> {
    lexer: Lexer<'a>,
    peeked: Option<(Span, Token<'a>)>,
}

/// Parsing of this file has ended: the fault is in the report.
struct Stop;

type Parse<T> = Result<T, Stop>;

impl Reader {
    /// Obeys all directives of a text.
    pub(super) fn text(&mut self, text: &str, file: FileId) {
        let mut cursor = Cursor { lexer: Lexer::new(text, file), peeked: None };
        while !self.desc.report.is_full() {
            match self.take(&mut cursor) {
                Ok(Some((span, Token::Word(word)))) => {
                    if self.directive(word, span, &mut cursor).is_err() {
                        return;
                    }
                }
                Ok(Some((span, token))) => {
                    self.error(span, format!("expected a directive, not {}", describe(&token)));
                    return;
                }
                Ok(None) | Err(Stop) => return,
            }
        }
    }

    fn take<'a>(&mut self, cursor: &mut Cursor<'a>) -> Parse<Option<(Span, Token<'a>)>> {
        if let Some(t) = cursor.peeked.take() {
            return Ok(Some(t));
        }
        cursor.lexer.next().map_err(|(span, message)| {
            self.error(span, message);
            Stop
        })
    }

    fn peek<'a, 'c>(&mut self, cursor: &'c mut Cursor<'a>) -> Parse<Option<&'c (Span, Token<'a>)>> {
        cursor.peeked = self.take(cursor)?;
        Ok(cursor.peeked.as_ref())
    }

    fn string<'a>(&mut self, cursor: &mut Cursor<'a>, what: &str) -> Parse<Cow<'a, str>> {
        let at = cursor.lexer.span();
        match self.take(cursor)? {
            Some((_, Token::Text(text))) => Ok(text),
            other => {
                let (span, found) = other.map_or((at, "the end of the file".to_owned()), |(s, t)| (s, describe(&t)));
                self.error(span, format!("expected {what} in quotes, not {found}"));
                Err(Stop)
            }
        }
    }

    /// `N` numbers, in brackets or not.
    fn numbers<const N: usize>(&mut self, cursor: &mut Cursor) -> Parse<[f64; N]> {
        let open = matches!(self.peek(cursor)?, Some((_, Token::Open)));
        if open {
            self.take(cursor)?;
        }
        let mut out = [0.0; N];
        for v in &mut out {
            let at = cursor.lexer.span();
            let token = self.take(cursor)?;
            let number = match &token {
                Some((_, Token::Word(word))) => word.parse().ok(),
                _ => None,
            };
            let Some(number) = number else {
                let (span, found) = token.map_or((at, "the end of the file".to_owned()), |(s, t)| (s, describe(&t)));
                self.error(span, format!("expected a number, not {found}"));
                return Err(Stop);
            };
            *v = number;
        }
        if open {
            match self.take(cursor)? {
                Some((_, Token::Close)) => {}
                other => {
                    let span = other.map_or_else(|| cursor.lexer.span(), |(s, _)| s);
                    self.error(span, format!("expected `]` after {N} numbers"));
                    return Err(Stop);
                }
            }
        }
        Ok(out)
    }

    fn parameters(&mut self, cursor: &mut Cursor, span: Span, kind: &str) -> Parse<Params> {
        let list = self.parameter_list(cursor)?;
        Ok(Params::new(span, list, self.state.defaults_of(kind)))
    }

    fn parameter_list(&mut self, cursor: &mut Cursor) -> Parse<Vec<Parameter>> {
        let mut list: Vec<Parameter> = Vec::new();
        while let Some((span, Token::Text(declaration))) = self.peek(cursor)?.cloned() {
            self.take(cursor)?;
            let mut words = declaration.split_ascii_whitespace();
            let (Some(kind), Some(name), None) = (words.next(), words.next(), words.next()) else {
                self.error(span, format!("a parameter is declared by its type and name, not `{declaration}`"));
                return Err(Stop);
            };
            let values = self.values(cursor, span)?;
            if !fits(kind, &values) {
                self.error(span, format!("the values of `{declaration}` do not fit its type"));
                continue;
            }
            if list.iter().any(|p| p.name == name) {
                self.error(span, format!("the parameter `{name}` is given twice"));
                continue;
            }
            list.push(Parameter::new(span, kind, name, values));
        }
        Ok(list)
    }

    fn values(&mut self, cursor: &mut Cursor, declared: Span) -> Parse<Values> {
        let (mut numbers, mut texts, mut bools) = (Vec::new(), Vec::new(), Vec::new());
        let mut bracket = false;
        loop {
            let Some((span, token)) = self.take(cursor)? else {
                self.error(declared, "the file ends within a parameter");
                return Err(Stop);
            };
            match token {
                Token::Open if !bracket => {
                    bracket = true;
                    continue;
                }
                Token::Close if bracket => break,
                Token::Text(t) => texts.push(t.into_owned()),
                Token::Word("true") => bools.push(true),
                Token::Word("false") => bools.push(false),
                Token::Word(w) => match w.parse::<f64>() {
                    Ok(v) => numbers.push(v),
                    Err(_) => {
                        self.error(span, format!("`{w}` is no number"));
                        return Err(Stop);
                    }
                },
                other => {
                    self.error(span, format!("expected a value, not {}", describe(&other)));
                    return Err(Stop);
                }
            }
            if !bracket {
                break;
            }
        }
        match (numbers.is_empty(), texts.is_empty(), bools.is_empty()) {
            (_, true, true) => Ok(Values::Numbers(numbers)),
            (true, false, true) => Ok(Values::Texts(texts)),
            (true, true, false) => Ok(Values::Bools(bools)),
            _ => {
                self.error(declared, "values of different types in one parameter");
                Err(Stop)
            }
        }
    }

    #[allow(clippy::too_many_lines)] // One arm for each directive of the format.
    fn directive(&mut self, word: &str, span: Span, cursor: &mut Cursor) -> Parse<()> {
        match word {
            "Identity" => self.state.set(DMat4::IDENTITY),
            "Translate" => {
                let v = self.numbers::<3>(cursor)?;
                self.state.concat(DMat4::from_translation(DVec3::from(v)));
            }
            "Scale" => {
                let v = self.numbers::<3>(cursor)?;
                self.state.concat(DMat4::from_scale(DVec3::from(v)));
            }
            "Rotate" => {
                let [degrees, x, y, z] = self.numbers::<4>(cursor)?;
                match DVec3::new(x, y, z).try_normalize() {
                    Some(axis) => self.state.concat(DMat4::from_axis_angle(axis, degrees.to_radians())),
                    None => self.error(span, "the axis of a rotation must not be zero"),
                }
            }
            "LookAt" => {
                let v = self.numbers::<9>(cursor)?;
                match look_at(DVec3::new(v[0], v[1], v[2]), DVec3::new(v[3], v[4], v[5]), DVec3::new(v[6], v[7], v[8])) {
                    Some(m) => self.state.concat(m),
                    None => self.error(span, "`LookAt` needs an eye away from the point looked at, and an up that is not along the view"),
                }
            }
            "Transform" => {
                let v = self.numbers::<16>(cursor)?;
                self.state.set(DMat4::from_cols_array(&v));
            }
            "ConcatTransform" => {
                let v = self.numbers::<16>(cursor)?;
                self.state.concat(DMat4::from_cols_array(&v));
            }
            "CoordinateSystem" => {
                let name = self.string(cursor, "a name")?;
                self.coordinate_systems.insert(name.into_owned(), self.state.transform());
            }
            "CoordSysTransform" => {
                let name = self.string(cursor, "a name")?;
                match self.coordinate_systems.get(name.as_ref()) {
                    Some(m) => self.state.transforms = [*m; 2],
                    None => self.desc.report.warning(span, format!("no coordinate system `{name}`")),
                }
            }
            "ActiveTransform" => {
                let word = match self.take(cursor)? {
                    Some((_, Token::Word(w))) => w.to_owned(),
                    Some((_, Token::Text(w))) => w.into_owned(),
                    _ => String::new(),
                };
                self.state.active = match word.as_str() {
                    "StartTime" => [true, false],
                    "EndTime" => [false, true],
                    "All" => [true, true],
                    _ => {
                        self.error(span, "`ActiveTransform` is followed by StartTime, EndTime or All");
                        return Err(Stop);
                    }
                };
            }
            "TransformTimes" => {
                self.numbers::<2>(cursor)?;
            }
            "ReverseOrientation" => self.state.reverse_orientation = !self.state.reverse_orientation,
            "ColorSpace" => {
                let name = self.string(cursor, "a color space")?;
                match ColorSpace::from_name(&name) {
                    Some(space) => self.state.color_space = space,
                    None => self.error(span, format!("no color space `{name}`; there are srgb, rec2020, dci-p3, aces2065-1")),
                }
            }
            "AttributeBegin" | "TransformBegin" => {
                self.push(if word == "AttributeBegin" { "AttributeBegin" } else { "TransformBegin" }, span)?
            }
            "AttributeEnd" => self.pop("AttributeBegin", word, span),
            "TransformEnd" => self.pop("TransformBegin", word, span),
            "Attribute" => {
                let kind = self.string(cursor, "a kind")?.into_owned();
                if !["shape", "light", "material", "medium", "texture"].contains(&kind.as_str()) {
                    self.error(span, format!("`Attribute` is for shape, light, material, medium or texture, not `{kind}`"));
                }
                let list = self.parameter_list(cursor)?;
                let defaults = Rc::make_mut(&mut self.state.defaults);
                let at = defaults.iter().position(|(k, _)| *k == kind).unwrap_or_else(|| {
                    defaults.push((kind, Vec::new()));
                    defaults.len() - 1
                });
                for p in list {
                    defaults[at].1.retain(|q| q.name != p.name);
                    defaults[at].1.push(p);
                }
            }
            "WorldBegin" => {
                if self.in_world {
                    self.error(span, "a second `WorldBegin`");
                }
                self.in_world = true;
                self.state.transforms = [DMat4::IDENTITY; 2];
                self.state.active = [true; 2];
                self.coordinate_systems.insert("world".to_owned(), DMat4::IDENTITY);
            }
            // Ended pbrt-v3 files; v4 tools still write it.
            "WorldEnd" => {}
            "ObjectBegin" => {
                let name = self.string(cursor, "a name")?.into_owned();
                if self.object.is_some() {
                    self.error(span, "an object within an object");
                }
                self.push("ObjectBegin", span)?;
                let group = self.desc.add(Node::named(&name, span, GroupDesc::default()));
                if self.objects.insert(name.clone(), group).is_some() {
                    self.error(span, format!("the object `{name}` is defined twice"));
                }
                self.object = Some((group, Vec::new()));
            }
            "ObjectEnd" => {
                self.pop("ObjectBegin", word, span);
                if let Some((group, shapes)) = self.object.take() {
                    self.desc.groups[group.0 as usize].value.shapes = shapes;
                }
            }
            "ObjectInstance" => {
                let name = self.string(cursor, "a name")?;
                self.instance(&name, span);
            }
            "Include" | "Import" => {
                let name = self.string(cursor, "a file")?;
                self.include(&name, span, word == "Import")?;
            }
            "Option" => {
                for p in self.parameter_list(cursor)? {
                    if p.name != "seed" {
                        self.loss(p.span, format!("Option \"{}\"", p.name), "ignored");
                    }
                }
            }
            "MediumInterface" => {
                let inside = self.string(cursor, "a medium")?.into_owned();
                let outside = match self.peek(cursor)? {
                    Some((_, Token::Text(_))) => self.string(cursor, "a medium")?.into_owned(),
                    _ => inside.clone(),
                };
                self.state.interior = self.named_medium(&inside, span);
                self.state.exterior = self.named_medium(&outside, span);
            }
            "NamedMaterial" => {
                let name = self.string(cursor, "a name")?;
                match self.materials.get(name.as_ref()) {
                    Some(id) => self.state.material = Some(*id),
                    None => self.error(span, format!("no material `{name}` has been made")),
                }
            }
            "Texture" => {
                let name = self.string(cursor, "a name")?.into_owned();
                let value = self.string(cursor, "float or spectrum")?.into_owned();
                let class = self.string(cursor, "a class of textures")?.into_owned();
                let p = self.parameters(cursor, span, "texture")?;
                self.texture(&name, &value, &class, &p);
                p.finish(&mut self.desc.report);
            }
            "Camera" | "Film" | "Sampler" | "Integrator" | "PixelFilter" | "Accelerator" | "Material" | "MakeNamedMaterial"
            | "MakeNamedMedium" | "LightSource" | "AreaLightSource" | "Shape" => {
                let name = self.string(cursor, "a name")?.into_owned();
                let kind = match word {
                    "Shape" => "shape",
                    "LightSource" | "AreaLightSource" => "light",
                    "Material" | "MakeNamedMaterial" => "material",
                    "MakeNamedMedium" => "medium",
                    _ => "",
                };
                let p = self.parameters(cursor, span, kind)?;
                self.item(word, &name, p);
            }
            _ => {
                self.error(span, format!("no directive `{word}`"));
                return Err(Stop);
            }
        }
        Ok(())
    }

    fn item(&mut self, word: &str, name: &str, p: Params) {
        let before_world = ["Camera", "Film", "Sampler", "Integrator", "PixelFilter", "Accelerator"].contains(&word);
        if before_world && self.in_world {
            self.error(p.span, format!("`{word}` belongs before `WorldBegin`"));
            return;
        }
        if !before_world && !self.in_world && matches!(word, "Shape" | "LightSource" | "AreaLightSource") {
            self.error(p.span, format!("`{word}` belongs after `WorldBegin`"));
            return;
        }
        match word {
            "Camera" => self.camera(name, &p),
            "Film" => self.film(name, &p),
            "Sampler" => self.sampler(name, &p),
            "Integrator" => self.integrator(name, &p),
            "PixelFilter" => self.filter(name, &p),
            // How rays are traced is ours to choose.
            "Accelerator" => return,
            "Material" => self.state.material = self.material(name, &p),
            "MakeNamedMaterial" => self.named_material(name, &p),
            "MakeNamedMedium" => self.make_medium(name, &p),
            "LightSource" => self.light(name, &p),
            "AreaLightSource" => {
                if name != "diffuse" {
                    self.error(p.span, format!("no area light `{name}`; there is `diffuse`"));
                }
                // Read by each shape that it applies to.
                self.state.area_light = Some(Rc::new(p));
                return;
            }
            _ => self.shape(name, &p),
        }
        p.finish(&mut self.desc.report);
    }

    fn push(&mut self, word: &'static str, span: Span) -> Parse<()> {
        if self.stack.len() >= STACK_LIMIT {
            self.error(span, format!("attributes nested deeper than {STACK_LIMIT}"));
            return Err(Stop);
        }
        self.stack.push((word, span, self.state.clone()));
        Ok(())
    }

    fn pop(&mut self, opened: &str, word: &str, span: Span) {
        match self.stack.last() {
            Some((o, _, _)) if *o == opened => {
                if let Some((_, _, state)) = self.stack.pop() {
                    if opened == "TransformBegin" {
                        self.state.transforms = state.transforms;
                        self.state.active = state.active;
                    } else {
                        self.state = state;
                    }
                }
            }
            Some((o, _, _)) => self.error(span, format!("`{word}` within `{o}`")),
            None => self.error(span, format!("`{word}` without `{opened}`")),
        }
    }

    fn instance(&mut self, name: &str, span: Span) {
        if self.object.is_some() {
            self.error(span, "an instance within an object");
            return;
        }
        let Some(group) = self.objects.get(name).copied() else {
            self.error(span, format!("no object `{name}` has been defined"));
            return;
        };
        self.check_motion(span);
        let world_from_object = self.state.transform().as_mat4();
        self.desc.add(Node::named(name, span, InstanceDesc { group, world_from_object }));
    }

    fn include(&mut self, name: &str, span: Span, import: bool) -> Parse<()> {
        if import && !self.in_world {
            self.error(span, "`Import` belongs after `WorldBegin`");
        }
        self.includes += 1;
        if self.depth >= INCLUDE_DEPTH || self.includes > INCLUDE_LIMIT {
            self.error(span, "too many included files, or files that include each other");
            return Err(Stop);
        }
        let Some(path) = self.resolve(name, span) else { return Ok(()) };
        let text = match Resolver::read(&path) {
            Ok(bytes) => inflated(bytes),
            Err(e) => Err(resolve_message(&e)),
        };
        match text {
            Ok(text) => {
                let file = self.desc.add_file(&path);
                self.depth += 1;
                let saved = import.then(|| self.state.clone());
                self.text(&text, file);
                if let Some(state) = saved {
                    self.state = state;
                }
                self.depth -= 1;
                Ok(())
            }
            Err(message) => {
                self.error(span, message);
                Ok(())
            }
        }
    }

    /// Tells that the transforms at both ends of the shutter's time differ.
    pub(super) fn check_motion(&mut self, span: Span) {
        if self.state.transforms[0] != self.state.transforms[1] {
            self.loss(span, "moving transform", "where it is at the start of the shutter's time");
        }
    }
}

/// Text of an included file, which may be compressed by gzip.
fn inflated(bytes: Vec<u8>) -> Result<String, String> {
    let bytes = crate::formats::mesh::inflated(bytes).map_err(|e| e.to_string())?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

fn describe(token: &Token) -> String {
    match token {
        Token::Text(t) => format!("\"{t}\""),
        Token::Open => "`[`".to_owned(),
        Token::Close => "`]`".to_owned(),
        Token::Word(w) => format!("`{w}`"),
    }
}

/// Whether values can be those of a declared type.
fn fits(kind: &str, values: &Values) -> bool {
    match (kind, values) {
        ("bool", Values::Bools(_)) | ("string" | "texture", Values::Texts(_)) | ("spectrum", Values::Numbers(_) | Values::Texts(_)) => true,
        (
            "float" | "integer" | "point" | "point2" | "point3" | "vector" | "vector2" | "vector3" | "normal" | "normal3" | "rgb"
            | "blackbody",
            Values::Numbers(_),
        ) => true,
        // Written by pbrt before version 4.
        ("bool", Values::Texts(t)) => t.iter().all(|t| t == "true" || t == "false"),
        _ => false,
    }
}

/// Camera from world: the eye at the origin, looking along +z, left-handed, as pbrt defines it.
fn look_at(eye: DVec3, look: DVec3, up: DVec3) -> Option<DMat4> {
    let dir = (look - eye).try_normalize()?;
    let right = up.try_normalize()?.cross(dir).try_normalize()?;
    let new_up = dir.cross(right);
    let world_from_camera = DMat4::from_cols(right.extend(0.0), new_up.extend(0.0), dir.extend(0.0), DVec4::new(eye.x, eye.y, eye.z, 1.0));
    Some(world_from_camera.inverse())
}
