//! Plugin tree → description. Each plugin that others may refer to is built once, however often it is named.

mod bsdf;
mod emitter;
mod medium;
mod props;
mod sensor;
mod shape;
mod texture;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use props::{Cursor, Props, describe};

use super::tree::{Kind, Plugin, Property, Tree, Value, suggestion};
use crate::desc::{BsdfId, EmissionDesc, GroupId, ImageId, MediumId, MeshFormat, MeshId, Param, SceneDesc, VolumeId};
use crate::formats::Resolver;
use crate::span::Span;

/// Deepest nesting of plugins through references.
const DEPTH_LIMIT: usize = 100;

/// Most ids that a misspelled one is compared with.
const SUGGESTION_LIMIT: usize = 1000;

/// What a parameter built from a plugin once and for all.
type Memo<T> = HashMap<*const Plugin, Option<T>>;

/// A texture plugin becomes a texture, or a constant where it is a spectrum.
type BuiltTexture = Param<[f32; 3]>;

/// Interprets a tree.
pub struct Builder<'t> {
    /// What has been built.
    pub desc: SceneDesc,
    resolver: &'t Resolver,
    paths: Vec<PathBuf>,
    ids: HashMap<&'t str, &'t Plugin>,
    bsdfs: Memo<BsdfId>,
    textures: Memo<BuiltTexture>,
    /// Textures read as emission: spectra have another white there.
    emission_textures: Memo<BuiltTexture>,
    media: Memo<MediumId>,
    volumes: Memo<VolumeId>,
    groups: Memo<GroupId>,
    emissions: Memo<EmissionDesc>,
    images: HashMap<PathBuf, ImageId>,
    meshes: HashMap<(PathBuf, MeshFormat, u32, bool), MeshId>,
    /// Plugins that are being built, to find cycles.
    stack: Vec<*const Plugin>,
}

impl<'t> Builder<'t> {
    /// Nothing built yet; `desc` knows the files.
    pub fn new(desc: SceneDesc, resolver: &'t Resolver, paths: Vec<PathBuf>) -> Self {
        Self {
            desc,
            resolver,
            paths,
            ids: HashMap::new(),
            bsdfs: Memo::new(),
            textures: Memo::new(),
            emission_textures: Memo::new(),
            media: Memo::new(),
            volumes: Memo::new(),
            groups: Memo::new(),
            emissions: Memo::new(),
            images: HashMap::new(),
            meshes: HashMap::new(),
            stack: Vec::new(),
        }
    }

    /// Builds a scene. Faults are in the report.
    pub fn scene(&mut self, tree: &'t Tree) {
        self.collect_ids(&tree.root, 0);
        for (new, id, span) in &tree.aliases {
            match self.ids.get(id.as_str()) {
                Some(plugin) => {
                    if self.ids.insert(new, plugin).is_some() {
                        self.desc.report.error(*span, format!("the id `{new}` is given twice"));
                    }
                }
                None => self.undefined(id, *span),
            }
        }
        let mut integrator = None;
        for property in &tree.root.params {
            // Nobody reads more, and each costs time.
            if self.desc.report.is_full() {
                break;
            }
            let Some(plugin) = self.resolve(property) else {
                if !matches!(property.value, Value::Reference(_)) {
                    let message = format!("`{}` ({}) directly in the scene means nothing", property.name, property.value.kind_name());
                    self.desc.report.warning(property.span, message);
                }
                continue;
            };
            match plugin.kind {
                Kind::Integrator => {
                    if integrator.replace(plugin.span).is_some() {
                        self.desc.report.error(plugin.span, "a second integrator");
                        continue;
                    }
                    self.integrator(plugin);
                }
                Kind::Sensor => self.sensor(plugin),
                Kind::Shape => {
                    self.shape(plugin, None);
                }
                Kind::Bsdf => {
                    self.bsdf(plugin);
                }
                Kind::Texture => {
                    self.texture(plugin, crate::formats::spectrum::Quantity::Reflectance);
                }
                Kind::Emitter => self.emitter(plugin),
                Kind::Medium => {
                    self.medium(plugin);
                }
                Kind::Film | Kind::Sampler | Kind::Rfilter | Kind::Phase | Kind::Volume => {
                    let message = format!("{} directly in the scene is not used", describe(plugin));
                    self.desc.report.warning(plugin.span, message);
                }
                Kind::Scene => self.desc.report.error(plugin.span, "a scene within the scene"),
            }
        }
    }

    fn collect_ids(&mut self, plugin: &'t Plugin, depth: usize) {
        if depth > DEPTH_LIMIT {
            self.desc.report.error(plugin.span, format!("nested more than {DEPTH_LIMIT} levels deep"));
            return;
        }
        for property in &plugin.params {
            if let Value::Plugin(nested) = &property.value {
                if !nested.id.is_empty() && self.ids.insert(&nested.id, nested).is_some() {
                    self.desc.report.error(nested.span, format!("the id `{}` is given twice", nested.id));
                }
                self.collect_ids(nested, depth + 1);
            }
        }
    }

    fn undefined(&mut self, id: &str, span: Span) {
        // Comparing is slow; after some faults there is probably one reason for all.
        let candidates = if self.desc.report.faults.len() < 20 { SUGGESTION_LIMIT } else { 0 };
        let hint = suggestion(id, self.ids.keys().copied().take(candidates));
        self.desc.report.error(span, format!("nothing has the id `{id}`{hint}"));
    }

    /// The plugin that a property holds or refers to; `None` for a plain value and, with a fault, for an undefined reference.
    fn resolve(&mut self, property: &'t Property) -> Option<&'t Plugin> {
        match &property.value {
            Value::Plugin(plugin) => Some(plugin),
            Value::Reference(id) => {
                let found = self.ids.get(id.as_str()).copied();
                if found.is_none() {
                    self.undefined(id, property.span);
                }
                found
            }
            _ => None,
        }
    }

    /// The kind of what a property holds or refers to, without a fault.
    fn kind_of(&self, property: &Property) -> Option<Kind> {
        match &property.value {
            Value::Plugin(plugin) => Some(plugin.kind),
            Value::Reference(id) => self.ids.get(id.as_str()).map(|p| p.kind),
            _ => None,
        }
    }

    /// The next nested plugin of a kind that is not used yet.
    fn next_of(&mut self, p: &mut Props<'t>, kind: Kind) -> Option<&'t Plugin> {
        let property = p.next_object(Cursor::of(kind), |q| self.kind_of(q) == Some(kind))?;
        self.resolve(property)
    }

    /// Reports undefined references among the parameters that are left, which would otherwise read as misplaced.
    fn finish(&mut self, mut p: Props<'t>) {
        while let Some(property) =
            p.next_object(Cursor::UNDEFINED, |q| matches!(&q.value, Value::Reference(id) if !self.ids.contains_key(id.as_str())))
        {
            if let Value::Reference(id) = &property.value {
                self.undefined(id, property.span);
            }
        }
        p.finish(&mut self.desc.report);
    }

    /// Runs `build` for a plugin unless it is being built already or too deep.
    fn guarded<T>(&mut self, plugin: &'t Plugin, build: impl FnOnce(&mut Self) -> Option<T>) -> Option<T> {
        let this: *const Plugin = plugin;
        if self.stack.contains(&this) {
            self.desc.report.error(plugin.span, format!("{} contains itself", describe(plugin)));
            return None;
        }
        if self.stack.len() >= DEPTH_LIMIT {
            self.desc.report.error(plugin.span, format!("nested more than {DEPTH_LIMIT} levels deep"));
            return None;
        }
        self.stack.push(this);
        let built = build(self);
        self.stack.pop();
        built
    }

    fn unknown_type(&mut self, plugin: &Plugin) {
        let hint = suggestion(&plugin.type_name, plugin.kind.types().iter().copied());
        let message = format!("unknown {} type \"{}\"{hint}", plugin.kind.tag(), plugin.type_name);
        self.desc.report.error(plugin.span, message);
    }

    /// True where Mitsuba knows the type; otherwise a fault.
    fn is_known(&mut self, plugin: &Plugin) -> bool {
        let known = plugin.kind.types().contains(&plugin.type_name.as_str());
        if !known {
            self.unknown_type(plugin);
        }
        known
    }

    fn lose(&mut self, plugin: &Plugin, effect: &str) {
        self.desc.report.loss(plugin.span, format!("{} \"{}\"", plugin.kind.tag(), plugin.type_name), effect);
    }

    /// The path of a file that the scene names at `span`; a fault where there is none.
    fn file(&mut self, name: &str, span: Span) -> Option<PathBuf> {
        let base = self.desc.files.get(span.file.0 as usize).and_then(|f| f.parent()).unwrap_or(Path::new("")).to_owned();
        match super::find(self.resolver, std::iter::once(base).chain(self.paths.iter().cloned()), name) {
            Ok(path) => Some(path),
            Err(e) => {
                self.desc.report.error(span, e.to_string());
                None
            }
        }
    }

    /// The file that a plugin's `filename` names; a fault where it is missing.
    fn filename(&mut self, p: &mut Props<'t>) -> Option<PathBuf> {
        let Some(name) = p.opt_text("filename") else {
            if !p.has("filename") {
                p.fault(p.plugin.span, "`filename` is missing");
            }
            return None;
        };
        let span = p.get("filename").map_or(p.plugin.span, |q| q.span);
        self.file(name, span)
    }
}
