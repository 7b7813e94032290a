//! Objects: their words, constructive combinations, copies, and how they enter the scene.

use std::sync::Arc;

use glam::DMat4;

use super::super::{Parse, Parser, Token};
use super::pattern::pick;
use crate::desc::classic::{Light, MAX_DEPTH, MAX_LEAVES, Object, Solid};
use crate::span::Span;

/// Words that begin an object.
pub(crate) const OBJECT_WORDS: &[&str] = &[
    "bicubic_patch",
    "blob",
    "box",
    "composite",
    "cone",
    "cubic",
    "cylinder",
    "difference",
    "disc",
    "height_field",
    "intersection",
    "isosurface",
    "julia_fractal",
    "lathe",
    "light_group",
    "light_source",
    "merge",
    "mesh",
    "mesh2",
    "object",
    "ovus",
    "parametric",
    "plane",
    "poly",
    "polygon",
    "polynomial",
    "prism",
    "quadric",
    "quartic",
    "smooth_triangle",
    "sor",
    "sphere",
    "sphere_sweep",
    "superellipsoid",
    "text",
    "torus",
    "triangle",
    "union",
];

impl Parser {
    /// Any object, from its first word (one of [`OBJECT_WORDS`]).
    pub(crate) fn object(&mut self) -> Parse<Object> {
        let span = self.span();
        match self.peek_word()? {
            Some("light_source") => return self.light_source(),
            Some("light_group") => return self.light_group(),
            _ => {}
        }
        let Some(word) = self.accept_any(OBJECT_WORDS)? else { return Err(self.unexpected("an object")) };
        self.expect("{")?;
        // A copy of a declared object, whatever its word.
        if let Some(copy) = self.accept_value(pick!(Object))? {
            let mut object = Arc::unwrap_or_clone(copy);
            object.span = span;
            if word == "object" || word == "union" && !self.at_object()? {
                return self.modified(object);
            }
            if !matches!(word, "union" | "merge" | "intersection" | "difference" | "composite") {
                return self.modified(object);
            }
            return self.combination(word, span, vec![Arc::new(object)]);
        }
        match word {
            "object" => {
                if !self.at_object()? {
                    return Err(self.unexpected("`object`; it holds the name of an object"));
                }
                let mut object = self.object()?;
                object.span = span;
                self.modified(object)
            }
            "union" | "composite" | "merge" | "intersection" | "difference" => self.combination(word, span, Vec::new()),
            _ => {
                let solid = self.solid(word, span)?;
                self.modified(Object::new(span, solid))
            }
        }
    }

    /// Whether an object begins here.
    pub(super) fn at_object(&mut self) -> Parse<bool> {
        Ok(self.peek_word()?.is_some_and(|w| OBJECT_WORDS.contains(&w)))
    }

    /// Objects and modifiers up to the closing brace.
    fn combination(&mut self, word: &str, span: Span, mut parts: Vec<Arc<Object>>) -> Parse<Object> {
        let is_union = matches!(word, "union" | "composite");
        while self.at_object()? {
            let part = self.object()?;
            match &part.solid {
                // Scenes grow unions step by step: `#declare All = union { object { All } … }` stays flat.
                Solid::Union(inner) if is_union && part.is_plain() => {
                    // A part is copied in a fraction of the time that a token takes, but a loop copies all of them each time.
                    self.spend(inner.len() as u64 / 8)?;
                    parts.extend(inner.iter().cloned());
                }
                _ => parts.push(Arc::new(part)),
            }
        }
        if parts.is_empty() {
            self.warning(span, format!("`{word}` without objects"));
        }
        let object = Object::new(
            span,
            match word {
                "merge" => Solid::Merge(parts),
                "intersection" => Solid::Intersection(parts),
                "difference" => Solid::Difference(parts),
                _ => Solid::Union(parts),
            },
        );
        self.check_size_of(&object)?;
        self.modified(object)
    }

    /// Keeps objects within what memory and stack can hold.
    pub(super) fn check_size_of(&mut self, object: &Object) -> Parse<()> {
        if object.leaves > MAX_LEAVES {
            return Err(self.error(object.span, format!("an object of more than {MAX_LEAVES} primitives")));
        }
        if object.depth > MAX_DEPTH {
            return Err(self.error(object.span, format!("objects within objects more than {MAX_DEPTH} deep")));
        }
        Ok(())
    }

    /// Adds an object to the scene: takes its lights out, gives parts without texture the default.
    pub(crate) fn add_object(&mut self, mut object: Object) {
        let first = self.scene.lights.len();
        take_lights(&object, &DMat4::IDENTITY, 0, &mut self.scene.lights);
        if self.scene.lights.len() > first && matches!(object.solid, Solid::Light(_)) {
            return;
        }
        // Counted now and then only, as every count goes through all objects.
        if object.leaves > 1024 || self.scene.objects.len().is_multiple_of(1024) {
            let leaves = self.scene.objects.iter().fold(object.leaves, |n, o| n.saturating_add(o.leaves));
            if leaves > MAX_LEAVES {
                self.error(object.span, format!("more than {MAX_LEAVES} primitives"));
                return;
            }
        }
        if object.texture.is_none() {
            object.texture = Some(self.default_texture());
            object.texture_is_default = true;
        }
        self.scene.objects.push(Arc::new(object));
    }

    /// Objects up to the closing brace, as in `clipped_by { … }`.
    pub(super) fn objects_to_brace(&mut self) -> Parse<Vec<Arc<Object>>> {
        let mut objects = Vec::new();
        loop {
            if let Some(object) = self.accept_value(pick!(Object))? {
                objects.push(object);
            } else if self.at_object()? {
                objects.push(Arc::new(self.object()?));
            } else {
                break;
            }
        }
        // Transforms and the like at the end concern all of them.
        if !matches!(self.peek()?, Token::Sign("}")) && !objects.is_empty() {
            let span = self.span();
            let solid = Solid::Intersection(objects);
            let all = self.modified(Object::new(span, solid))?;
            return Ok(vec![Arc::new(all)]);
        }
        self.expect("}")?;
        Ok(objects)
    }
}

/// Adds the lights of an object and its parts, moved to world space.
fn take_lights(object: &Object, world_from_parent: &DMat4, group: u32, lights: &mut Vec<Light>) {
    let group = if object.light_group != 0 { object.light_group } else { group };
    if let Solid::Light(light) = &object.solid {
        let mut light = Light::clone(light);
        if *world_from_parent != DMat4::IDENTITY {
            light.transform(world_from_parent);
        }
        if light.group == 0 {
            light.group = group;
        }
        lights.push(light);
        return;
    }
    if !object.has_lights {
        return;
    }
    let m = *world_from_parent * object.world_from_solid;
    for part in object.solid.parts().unwrap_or_default() {
        take_lights(part, &m, group, lights);
    }
}
