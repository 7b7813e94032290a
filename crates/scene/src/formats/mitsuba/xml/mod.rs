//! XML → plugin tree: defaults, `$key`, includes, aliases, values and transforms.

mod transform;
mod values;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use roxmltree::Node;

use super::tree::{Kind, Plugin, Property, Tree, Value, suggestion};
use super::upgrade;
use crate::formats::Resolver;
use crate::report::{ReadError, Report};
use crate::span::{FileId, Span};

/// Deepest nesting of elements.
const DEPTH_LIMIT: usize = 64;
/// Deepest nesting of includes.
const INCLUDE_DEPTH_LIMIT: usize = 15;
/// Most includes of a scene.
const INCLUDE_LIMIT: usize = 1000;
/// Most XML nodes of a scene, includes counted as often as they are included.
const NODE_LIMIT: usize = 8_000_000;
/// Largest XML file in bytes.
const XML_SIZE_LIMIT: u64 = 512 << 20;
/// Largest file of a spectrum in bytes.
const SPECTRUM_SIZE_LIMIT: u64 = 1 << 20;
/// Longest text that `$key` may grow a value to.
const VALUE_LIMIT: usize = 16 << 20;

/// What has been read so far of a scene's XML files.
pub struct XmlReader<'a> {
    resolver: &'a Resolver,
    /// Folders that `<path>` added.
    pub paths: Vec<PathBuf>,
    /// Files in the order of their ids.
    pub files: Vec<PathBuf>,
    /// What was found.
    pub report: Report,
    defines: BTreeMap<String, String>,
    /// Names of `defines` that a value used or that the file itself declared.
    used_defines: BTreeSet<String>,
    given: BTreeSet<String>,
    aliases: Vec<(String, String, Span)>,
    nodes: usize,
    includes: usize,
}

/// Line and column of a growing offset; cheap because elements are visited in order.
struct Cursor<'t> {
    text: &'t str,
    offset: usize,
    line: u32,
    column: u32,
}

impl Cursor<'_> {
    fn at(&mut self, offset: usize, file: FileId) -> Span {
        if offset < self.offset {
            (self.offset, self.line, self.column) = (0, 1, 1);
        }
        for c in self.text.get(self.offset..offset).unwrap_or_default().chars() {
            if c == '\n' {
                self.line += 1;
                self.column = 1;
            } else {
                self.column += 1;
            }
        }
        self.offset = offset;
        Span::new(file, self.line, self.column)
    }
}

/// Where an element is being read.
struct Context<'t> {
    file: FileId,
    folder: PathBuf,
    /// The file's version is below 2: names are those of Mitsuba 0.6.
    old: bool,
    cursor: Cursor<'t>,
    include_depth: usize,
}

impl<'a> XmlReader<'a> {
    /// A reader with values for `$key`.
    pub fn new(resolver: &'a Resolver, defines: &BTreeMap<String, String>) -> Self {
        Self {
            resolver,
            paths: Vec::new(),
            files: Vec::new(),
            report: Report::default(),
            defines: defines.clone(),
            used_defines: BTreeSet::new(),
            given: defines.keys().cloned().collect(),
            aliases: Vec::new(),
            nodes: 0,
            includes: 0,
        }
    }

    /// Reads a scene file.
    ///
    /// # Errors
    /// [`ReadError::Io`] where the file itself cannot be read. Everything else goes into the report; the tree is `None` where there is
    /// none to go on with.
    pub fn read_file(&mut self, path: &Path) -> Result<Option<Tree>, ReadError> {
        let bytes = std::fs::metadata(path)
            .and_then(|m| if m.len() > XML_SIZE_LIMIT { Err(std::io::Error::other("larger than 512 MiB")) } else { std::fs::read(path) })
            .map_err(|source| ReadError::Io { path: path.to_owned(), source })?;
        Ok(self.read_bytes(path, &bytes))
    }

    /// Reads a scene from the bytes of a file; `path` names it in messages and its folder is where relative names start.
    pub fn read_bytes(&mut self, path: &Path, bytes: &[u8]) -> Option<Tree> {
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let root = self.document(path, &folder, bytes, 0)?;
        for key in &self.given {
            if !self.used_defines.contains(key) {
                self.report.warning(Span::default(), format!("the given value for `${key}` is not used"));
            }
        }
        if root.kind != Kind::Scene {
            self.report.error(root.span, format!("the outermost element must be <scene>, not <{}>", root.kind.tag()));
            return None;
        }
        Some(Tree { root, aliases: std::mem::take(&mut self.aliases) })
    }

    fn document(&mut self, path: &Path, folder: &Path, bytes: &[u8], include_depth: usize) -> Option<Plugin> {
        let file = FileId(self.files.len() as u32);
        self.files.push(path.to_owned());
        let text = match std::str::from_utf8(bytes) {
            Ok(text) => text.strip_prefix('\u{feff}').unwrap_or(text),
            Err(e) => {
                let line = bytes[..e.valid_up_to()].iter().filter(|b| **b == b'\n').count() as u32 + 1;
                self.report.error(Span::new(file, line, 1), "not a text file in UTF-8");
                return None;
            }
        };
        // The parser itself recurses on nothing, but elements are visited recursively below.
        let limit = (NODE_LIMIT - self.nodes.min(NODE_LIMIT)) as u32;
        let options = roxmltree::ParsingOptions { allow_dtd: false, nodes_limit: limit, ..Default::default() };
        let document = match roxmltree::Document::parse_with_options(text, options) {
            Ok(document) => document,
            Err(e) => {
                let at = e.pos();
                self.report.error(Span::new(file, at.row, at.col), format!("not well-formed XML: {}", message_of(&e)));
                return None;
            }
        };
        self.nodes += document.descendants().len();
        let root = document.root_element();
        let mut context =
            Context { file, folder: folder.to_owned(), old: false, cursor: Cursor { text, offset: 0, line: 1, column: 1 }, include_depth };
        let span = context.cursor.at(root.range().start, file);
        match root.attribute("version") {
            Some(version) => {
                let major = version.trim().split('.').next().and_then(|v| v.parse::<u32>().ok());
                match major {
                    Some(major) => context.old = major < 2,
                    None => self.report.error(span, format!("`{version}` is not a version such as 3.0.0")),
                }
            }
            None => self.report.warning(span, "the file does not say its version; read as Mitsuba 3"),
        }
        let Some(kind) = Kind::from_tag(root.tag_name().name()) else {
            self.report.error(span, format!("the outermost element must be <scene>, not <{}>", root.tag_name().name()));
            return None;
        };
        self.plugin(&mut context, root, kind, span, 0)
    }

    fn plugin(&mut self, cx: &mut Context, node: Node, kind: Kind, span: Span, depth: usize) -> Option<Plugin> {
        let tag = node.tag_name().name();
        let mut plugin = Plugin { kind, type_name: String::new(), id: String::new(), span, params: Vec::new() };
        for attribute in node.attributes() {
            let value = self.substitute(attribute.value(), span).unwrap_or_default();
            match attribute.name() {
                "type" => plugin.type_name = value,
                "id" => plugin.id = value,
                "name" | "version" => {}
                name => {
                    self.report.error(span, format!("<{tag}> has no attribute `{name}`{}", suggestion(name, ["type", "id", "name"])));
                }
            }
        }
        if plugin.type_name.is_empty() && kind != Kind::Scene {
            self.report.error(span, format!("<{tag}> lacks its `type`"));
            return None;
        }
        if depth >= DEPTH_LIMIT {
            self.report.error(span, format!("nested more than {DEPTH_LIMIT} levels deep"));
            return None;
        }
        for child in node.children() {
            if child.is_element() {
                self.child(cx, child, &mut plugin, depth);
            } else if child.is_text() && child.text().is_some_and(|t| !t.trim().is_empty()) {
                let at = cx.cursor.at(child.range().start, cx.file);
                self.report.error(at, format!("text inside <{tag}>"));
            }
        }
        if cx.old {
            upgrade::plugin(&mut plugin);
        }
        Some(plugin)
    }

    fn child(&mut self, cx: &mut Context, node: Node, parent: &mut Plugin, depth: usize) {
        // Nobody reads more, and each costs time.
        if self.report.is_full() {
            return;
        }
        let tag = node.tag_name().name();
        let span = cx.cursor.at(node.range().start, cx.file);
        let is_spectrum_value = tag == "spectrum" && !node.has_attribute("type");
        if let Some(kind) = Kind::from_tag(tag).filter(|_| !is_spectrum_value) {
            if kind == Kind::Scene {
                self.report.error(span, "<scene> inside another element");
                return;
            }
            let name = self.attribute(node, "name", span);
            if let Some(plugin) = self.plugin(cx, node, kind, span, depth + 1) {
                self.push(parent, name, Value::Plugin(Box::new(plugin)), span, cx.old);
            }
            return;
        }
        match tag {
            "default" => {
                self.check_attributes(node, span, &["name", "value"]);
                if let (Some(name), Some(value)) = (self.required(node, "name", span), self.required(node, "value", span)) {
                    self.given.remove(&name);
                    self.defines.entry(name).or_insert(value);
                }
            }
            "include" => self.include(cx, node, span, parent),
            "alias" => {
                self.check_attributes(node, span, &["id", "as"]);
                if let (Some(id), Some(new)) = (self.required(node, "id", span), self.required(node, "as", span)) {
                    self.aliases.push((new, id, span));
                }
            }
            "path" => {
                self.check_attributes(node, span, &["value"]);
                if let Some(value) = self.required(node, "value", span) {
                    self.paths.push(cx.folder.join(value.replace('\\', "/")));
                }
            }
            "ref" => {
                self.check_attributes(node, span, &["id", "name"]);
                let name = self.attribute(node, "name", span);
                if let Some(id) = self.required(node, "id", span) {
                    self.push(parent, name, Value::Reference(id), span, cx.old);
                }
            }
            "transform" => {
                self.check_attributes(node, span, &["name", "type"]);
                let name = self.required(node, "name", span);
                let matrix = self.transform(cx, node);
                if let (Some(name), Some(matrix)) = (name, matrix) {
                    self.push(parent, name, Value::Transform(matrix), span, cx.old);
                }
            }
            "float" | "integer" | "boolean" | "string" | "point" | "vector" | "rgb" | "srgb" | "spectrum" | "blackbody" => {
                let name = self.required(node, "name", span);
                let value = if tag == "spectrum" && node.has_attribute("filename") {
                    self.spectrum_file(cx, node, span)
                } else {
                    self.value(node, tag, span)
                };
                for inner in node.children().filter(Node::is_element) {
                    let at = cx.cursor.at(inner.range().start, cx.file);
                    self.report.error(at, format!("<{}> inside <{tag}>", inner.tag_name().name()));
                }
                if let (Some(name), Some(value)) = (name, value) {
                    self.push(parent, name, value, span, cx.old);
                }
            }
            "subsurface" if cx.old => self.report.loss(span, "<subsurface>", "ignored"),
            "animation" if cx.old => {
                self.report.loss(span, "<animation>", "its first transform");
                let name = self.required(node, "name", span);
                let first = node.children().find(|c| c.has_tag_name("transform"));
                if let (Some(name), Some(matrix)) = (name, first.and_then(|first| self.transform(cx, first))) {
                    self.push(parent, name, Value::Transform(matrix), span, cx.old);
                }
            }
            _ => {
                let hint = suggestion(tag, TAGS.iter().copied());
                self.report.error(span, format!("unknown element <{tag}>{hint}"));
            }
        }
    }

    fn push(&mut self, parent: &mut Plugin, name: String, value: Value, span: Span, old: bool) {
        let name = if old { upgrade::snake_case(&name) } else { name };
        if !name.is_empty() && parent.kind != Kind::Scene && parent.params.iter().rev().take(256).any(|p| p.name == name) {
            self.report.error(span, format!("`{name}` is given twice"));
            return;
        }
        parent.params.push(Property { name, value, span });
    }

    fn include(&mut self, cx: &mut Context, node: Node, span: Span, parent: &mut Plugin) {
        self.check_attributes(node, span, &["filename"]);
        let Some(name) = self.required(node, "filename", span) else { return };
        self.includes += 1;
        if cx.include_depth >= INCLUDE_DEPTH_LIMIT {
            let message = format!("includes are nested more than {INCLUDE_DEPTH_LIMIT} deep (does a file include itself?)");
            self.report.error(span, message);
            return;
        }
        if self.includes > INCLUDE_LIMIT {
            if self.includes == INCLUDE_LIMIT + 1 {
                self.report.error(span, format!("more than {INCLUDE_LIMIT} includes"));
            }
            return;
        }
        let folders = std::iter::once(cx.folder.clone()).chain(self.paths.iter().cloned());
        let bytes = super::find(self.resolver, folders, &name).and_then(|path| {
            if std::fs::metadata(&path).is_ok_and(|m| m.len() > XML_SIZE_LIMIT) {
                return Err(crate::formats::ResolveError::Unfit(name.clone()));
            }
            Resolver::read(&path).map(|bytes| (path, bytes))
        });
        match bytes {
            Ok((path, bytes)) => {
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                match self.document(&path, &folder, &bytes, cx.include_depth + 1) {
                    Some(plugin) if plugin.kind == Kind::Scene => parent.params.extend(plugin.params),
                    Some(plugin) => {
                        let at = plugin.span;
                        parent.params.push(Property { name: String::new(), value: Value::Plugin(Box::new(plugin)), span: at });
                    }
                    None => {}
                }
            }
            Err(e) => self.report.error(span, e.to_string()),
        }
    }

    /// The text with `$key` replaced by the longest key that is defined; `None`, with a fault, where none is.
    fn substitute(&mut self, text: &str, span: Span) -> Option<String> {
        if !text.contains('$') {
            return Some(text.to_owned());
        }
        let mut out = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(i) = rest.find('$') {
            out.push_str(&rest[..i]);
            rest = &rest[i + 1..];
            let word = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            let key = (1..=word).rev().filter(|n| rest.is_char_boundary(*n)).map(|n| &rest[..n]).find(|k| self.defines.contains_key(*k));
            match key {
                Some(key) => {
                    out.push_str(&self.defines[key]);
                    self.used_defines.insert(key.to_owned());
                    rest = &rest[key.len()..];
                }
                None => {
                    let hint = suggestion(&rest[..word], self.defines.keys().map(String::as_str).take(1000));
                    self.report.error(span, format!("`${}` is not defined{hint}", &rest[..word]));
                    return None;
                }
            }
            if out.len() > VALUE_LIMIT {
                self.report.error(span, "a value grows too long");
                return None;
            }
        }
        Some(out + rest)
    }

    fn attribute(&mut self, node: Node, name: &str, span: Span) -> String {
        node.attribute(name).and_then(|v| self.substitute(v, span)).unwrap_or_default()
    }

    fn required(&mut self, node: Node, name: &str, span: Span) -> Option<String> {
        let Some(value) = node.attribute(name) else {
            self.report.error(span, format!("<{}> lacks its `{name}`", node.tag_name().name()));
            return None;
        };
        self.substitute(value, span)
    }

    fn check_attributes(&mut self, node: Node, span: Span, known: &[&str]) {
        for attribute in node.attributes() {
            if !known.contains(&attribute.name()) {
                let hint = suggestion(attribute.name(), known.iter().copied());
                self.report.error(span, format!("<{}> has no attribute `{}`{hint}", node.tag_name().name(), attribute.name()));
            }
        }
    }
}

/// Tags that a misspelled one may have meant.
const TAGS: &[&str] = &[
    "integrator",
    "sensor",
    "film",
    "sampler",
    "rfilter",
    "shape",
    "bsdf",
    "texture",
    "spectrum",
    "emitter",
    "medium",
    "phase",
    "volume",
    "default",
    "include",
    "alias",
    "path",
    "ref",
    "transform",
    "float",
    "integer",
    "boolean",
    "string",
    "point",
    "vector",
    "rgb",
];

/// The XML parser's message without the position that it appends.
fn message_of(e: &roxmltree::Error) -> String {
    let text = match e {
        roxmltree::Error::NodesLimitReached => "too many nodes".to_owned(),
        e => e.to_string(),
    };
    match text.rfind(" at ") {
        Some(i) if text[i + 4..].starts_with(|c: char| c.is_ascii_digit()) => text[..i].to_owned(),
        _ => text,
    }
}
