//! Object modifiers: what may stand behind the shape in every object's braces (documentation, "Object Modifiers").

use std::sync::Arc;

use etendue_procedural::{Layer, Texture};

use super::super::{Parse, Parser};
use super::pattern::pick;
use crate::desc::classic::{Object, PhotonSettings};

/// Most layers that textures of an object can stack up to.
const LAYERS_LIMIT: usize = 4096;

impl Parser {
    /// Modifiers up to the closing brace, which is taken.
    pub(super) fn modified(&mut self, mut object: Object) -> Parse<Object> {
        while !self.accept("}")? {
            if !self.modifier(&mut object)? {
                return Err(self.unexpected("an object"));
            }
        }
        map_by_uv(&mut object);
        Ok(object)
    }

    /// One modifier, if one follows.
    fn modifier(&mut self, object: &mut Object) -> Parse<bool> {
        if let Some(matrix) = self.accept_transform()? {
            map_by_uv(object);
            object.transform(&matrix);
            return Ok(true);
        }
        if self.texture_modifier(object)? {
            return Ok(true);
        }
        let Some(word) = self.peek_word()? else { return Ok(false) };
        let span = self.span();
        match word {
            "interior" => object.interior = Some(Arc::new(self.interior()?)),
            "material" => {
                let material = self.material()?;
                if let Some(t) = material.texture {
                    self.lay_over(&mut object.texture, t);
                }
                if let Some(t) = material.interior_texture {
                    self.lay_over(&mut object.interior_texture, t);
                }
                if material.interior.is_some() {
                    object.interior = material.interior;
                }
            }
            "clipped_by" => {
                self.next()?;
                let mut clips = self.shared_shapes("bounded_by", &object.bounded_by)?;
                self.grow(object, &clips)?;
                object.clipped_by.append(&mut clips);
            }
            "bounded_by" => {
                self.next()?;
                let mut bounds = self.shared_shapes("clipped_by", &object.clipped_by)?;
                self.grow(object, &bounds)?;
                object.bounded_by.append(&mut bounds);
            }
            "inverse" => {
                self.next()?;
                object.inverse = !object.inverse;
            }
            "no_shadow" => {
                self.next()?;
                object.no_shadow = self.flag()?;
            }
            "no_image" => {
                self.next()?;
                object.no_image = self.flag()?;
            }
            "no_reflection" => {
                self.next()?;
                object.no_reflection = self.flag()?;
            }
            "no_radiosity" => {
                self.next()?;
                object.no_radiosity = self.flag()?;
            }
            "double_illuminate" => {
                self.next()?;
                object.double_illuminate = self.flag()?;
            }
            "hollow" => {
                self.next()?;
                object.hollow = self.flag()?;
                object.hollow_stated = true;
            }
            "sturm" => {
                self.next()?;
                object.sturm = self.flag()?;
            }
            // Our hierarchies are always on.
            "hierarchy" => {
                self.next()?;
                self.flag()?;
            }
            "cutaway_textures" => {
                self.next()?;
                object.cutaway_textures = self.flag()?;
            }
            "split_union" => {
                self.next()?;
                object.split_union = self.flag()?;
            }
            "uv_mapping" => {
                self.next()?;
                object.uv_mapping = self.flag()?;
            }
            "photons" => {
                self.next()?;
                self.photon_settings(&mut object.photons)?;
            }
            "radiosity" => {
                self.next()?;
                self.expect("{")?;
                while !self.accept("}")? {
                    self.expect("importance")?;
                    object.radiosity_importance = Some(self.float()?);
                }
            }
            "color" | "rgb" | "rgbf" | "rgbt" | "rgbft" | "srgb" => {
                // Very old scenes give objects a color for previews.
                self.color()?;
                self.warning(span, "a color of an object has no effect; it stands in a pigment");
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// `texture`, `pigment`, `normal`, `finish`, `interior_texture`, if one follows: textures lie over what is there, the others change it.
    pub(super) fn texture_modifier(&mut self, object: &mut Object) -> Parse<bool> {
        match self.peek_word()? {
            Some("texture") => {
                let texture = self.texture()?;
                self.lay_over(&mut object.texture, Arc::new(texture));
            }
            Some("interior_texture") => {
                self.next()?;
                self.expect("{")?;
                let texture = self.texture_body()?;
                self.expect("}")?;
                self.lay_over(&mut object.interior_texture, Arc::new(texture));
            }
            Some("pigment" | "normal" | "finish") => {
                let span = self.span();
                let mut texture = match &object.texture {
                    Some(t) => Texture::clone(t),
                    None => Texture::clone(&self.default_texture()),
                };
                if !matches!(texture, Texture::Layers(_)) {
                    self.warning(span, "the object's patterned texture is given up for this");
                    texture = Texture::clone(&self.default_texture());
                }
                if !self.layer_item(&mut texture)? {
                    return Err(self.unexpected("an object"));
                }
                object.texture = Some(Arc::new(texture));
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// A texture over another: layers on top of its layers.
    fn lay_over(&mut self, below: &mut Option<Arc<Texture>>, above: Arc<Texture>) {
        match (below.as_deref(), &*above) {
            (Some(Texture::Layers(lower)), Texture::Layers(upper)) if lower.len() + upper.len() <= LAYERS_LIMIT => {
                *below = Some(Arc::new(Texture::Layers(lower.iter().chain(upper).cloned().collect())));
            }
            _ => *below = Some(above),
        }
    }

    /// Objects in braces, or the word for those of the other modifier.
    fn shared_shapes(&mut self, word: &str, other: &[Arc<Object>]) -> Parse<Vec<Arc<Object>>> {
        // The brace is looked into by the list itself, so the word is looked for behind it.
        self.expect("{")?;
        if self.accept(word)? {
            self.expect("}")?;
            return Ok(other.to_vec());
        }
        self.objects_to_brace()
    }

    /// Counts clips and bounds among an object's parts.
    fn grow(&mut self, object: &mut Object, shapes: &[Arc<Object>]) -> Parse<()> {
        for shape in shapes {
            object.leaves = object.leaves.saturating_add(shape.leaves);
            object.depth = object.depth.max(shape.depth.saturating_add(1));
        }
        self.check_size_of(object)
    }

    /// `photons { … }` of an object.
    fn photon_settings(&mut self, photons: &mut PhotonSettings) -> Parse<()> {
        self.expect("{")?;
        while !self.accept("}")? {
            let Some(word) = self.accept_any(&["target", "refraction", "reflection", "collect", "pass_through"])? else {
                return Err(self.unexpected("an object's photons"));
            };
            match word {
                "target" => {
                    let spacing = if self.at_float()? { self.float()? } else { 1.0 };
                    photons.target = (spacing > 0.0).then_some(spacing);
                }
                "refraction" => photons.refraction = Some(self.flag()?),
                "reflection" => photons.reflection = Some(self.flag()?),
                "collect" => photons.no_collect = !self.flag()?,
                _ => photons.pass_through = self.flag()?,
            }
        }
        Ok(())
    }

    /// Texture items and transforms of a part that is no object of its own (blob components), up to the closing brace.
    pub(super) fn component_modifiers(&mut self, part: &mut Object) -> Parse<()> {
        while !self.accept("}")? {
            if let Some(matrix) = self.accept_transform()? {
                part.transform(&matrix);
            } else if !self.texture_modifier(part)? {
                return Err(self.unexpected("a component of a blob"));
            }
        }
        Ok(())
    }

    /// A texture by its name, shared with others that use it: `texture { Name }` of triangles.
    pub(super) fn shared_texture(&mut self) -> Parse<Arc<Texture>> {
        let span = self.span();
        self.expect("texture")?;
        self.expect("{")?;
        let Some(texture) = self.accept_value(pick!(Texture))? else {
            return Err(self.error(span, "the texture of a triangle is the name of a declared one"));
        };
        if self.accept("}")? {
            return Ok(texture);
        }
        let mut part = Object::new(span, crate::desc::classic::Solid::Union(Vec::new()));
        part.texture = Some(texture.clone());
        self.component_modifiers(&mut part)?;
        Ok(part.texture.unwrap_or(texture))
    }
}

/// `uv_mapping` of an object is that of its textures, also of those that come after it.
fn map_by_uv(object: &mut Object) {
    if !object.uv_mapping {
        return;
    }
    for texture in [&mut object.texture, &mut object.interior_texture].into_iter().flatten() {
        match Arc::make_mut(texture) {
            Texture::Patterned(patterned) => patterned.uv_mapping = true,
            Texture::Layers(layers) => layers.iter_mut().for_each(Layer::map_by_uv),
        }
    }
}
