//! `texture`.

use std::sync::Arc;

use etendue_procedural::{Layer, Normal, Pattern, PatternKind, PatternedTexture, Texture, TextureFill};

use super::super::{Parse, Parser};
use super::pattern::{DEPTH_LIMIT, change_kind, pick};

/// Most layers of a texture.
const LAYERS_LIMIT: usize = 4096;

impl Parser {
    /// One or more `texture { … }` in a row: layers of one texture. Begins with the default texture unless an identifier starts the
    /// block.
    pub(crate) fn texture(&mut self) -> Parse<Texture> {
        let mut texture = self.texture_block()?;
        while self.peek_word()? == Some("texture") {
            let span = self.span();
            match (&mut texture, self.texture_block()?) {
                (Texture::Layers(layers), Texture::Layers(above)) => {
                    layers.extend(above);
                    if layers.len() > LAYERS_LIMIT {
                        return Err(self.error(span, format!("a texture may have at most {LAYERS_LIMIT} layers")));
                    }
                }
                _ => return Err(self.error(span, "a patterned texture cannot be a layer of a layered texture")),
            }
        }
        Ok(texture)
    }

    /// `texture { … }` alone, as in texture maps.
    pub(crate) fn texture_block(&mut self) -> Parse<Texture> {
        self.expect("texture")?;
        self.expect("{")?;
        let texture = self.texture_body()?;
        self.expect("}")?;
        Ok(texture)
    }

    /// What stands in a texture's braces, up to the closing brace or bracket.
    pub(super) fn texture_body(&mut self) -> Parse<Texture> {
        let uv_mapping = self.accept("uv_mapping")? && self.flag()?;
        let mut texture = match self.accept_value(pick!(Texture))? {
            Some(copy) => Texture::clone(&copy),
            None => Texture::clone(&self.default_texture()),
        };
        let mut uv = uv_mapping;
        while !self.at_end_of_body()? {
            if let Some(matrix) = self.accept_transform()? {
                texture.transform(&matrix);
            } else if self.accept("uv_mapping")? {
                uv = self.flag()?;
            } else if self.accept("no_bump_scale")? {
                if self.flag()? {
                    keep_bumps(&mut texture);
                }
            } else if self.layer_item(&mut texture)? {
            } else if !self.texture_pattern(&mut texture)? {
                return Err(self.unexpected("a texture"));
            }
        }
        if uv {
            match &mut texture {
                Texture::Patterned(patterned) => patterned.uv_mapping = true,
                Texture::Layers(layers) => layers.iter_mut().for_each(Layer::map_by_uv),
            }
        }
        Ok(texture)
    }

    /// Pigment, normal or finish, which change the lowest layer.
    pub(super) fn layer_item(&mut self, texture: &mut Texture) -> Parse<bool> {
        let word = self.peek_word()?;
        let Texture::Layers(layers) = texture else { return Ok(false) };
        let Some(layer) = layers.first_mut() else { return Ok(false) };
        if let Some(pigment) = self.accept_value(pick!(Pigment))? {
            layer.pigment = Arc::unwrap_or_clone(pigment);
        } else if let Some(normal) = self.accept_value(pick!(Normal))? {
            layer.normal = Some(Arc::unwrap_or_clone(normal));
        } else if let Some(finish) = self.accept_value(pick!(Finish))? {
            layer.finish = finish;
        } else {
            match word {
                Some("pigment") => layer.pigment = self.pigment_onto(Some(layer.pigment.clone()))?,
                Some("normal") => layer.normal = Some(self.normal_onto(layer.normal.clone())?),
                Some("finish") => {
                    let start = etendue_procedural::Finish::clone(&layer.finish);
                    layer.finish = Arc::new(self.finish_onto(start)?);
                }
                _ => return Ok(false),
            }
        }
        Ok(true)
    }

    /// A pattern with its textures, `tiles` or `material_map`, and modifiers of a pattern.
    fn texture_pattern(&mut self, texture: &mut Texture) -> Parse<bool> {
        let span = self.span();
        if self.accept("tiles")? {
            self.expect("{")?;
            let odd = self.tile()?;
            self.expect("tile2")?;
            // The second one is where a checker's first is (measured).
            let list = vec![self.tile()?, odd];
            self.expect("}")?;
            let pattern = Pattern::new(PatternKind::Checker);
            *texture = Texture::Patterned(Box::new(PatternedTexture::new(pattern, TextureFill::List(Arc::new(list)))));
        } else if self.accept("material_map")? {
            self.expect("{")?;
            let (image, _) = self.image_map_items(true)?;
            let mut list = Vec::new();
            while self.peek_word()? == Some("texture") {
                list.push(self.texture_block()?);
            }
            let mut pattern = Pattern::default();
            while let Some(matrix) = self.accept_transform()? {
                pattern.transform(&matrix);
            }
            self.expect("}")?;
            *texture = Texture::Patterned(Box::new(PatternedTexture::new(pattern, TextureFill::Image(image, Arc::new(list)))));
        } else if let Some(kind) = self.accept_pattern()? {
            let is_object = matches!(kind, PatternKind::Object(_));
            let count = kind.blocks().unwrap_or(0);
            let mut list = Vec::new();
            while list.len() < count {
                self.comma()?;
                if self.peek_word()? != Some("texture") {
                    break;
                }
                list.push(self.texture_block()?);
            }
            if is_object {
                self.expect("}")?;
            }
            if !list.is_empty() {
                list.resize_with(count, || Texture::clone(&self.default_texture()));
            }
            let mut pattern = match std::mem::take(texture) {
                Texture::Patterned(old) => old.pattern,
                Texture::Layers(_) => Pattern::default(),
            };
            change_kind(&mut pattern, kind);
            *texture = Texture::Patterned(Box::new(PatternedTexture::new(pattern, TextureFill::List(Arc::new(list)))));
        } else {
            let Texture::Patterned(patterned) = texture else { return Ok(false) };
            if self.peek_word()? == Some("texture_map") {
                let weighted = matches!(patterned.pattern.kind, PatternKind::Average);
                patterned.fill = TextureFill::Textures(self.shared_texture_map(weighted)?);
            } else {
                return self.accept_pattern_modifier(&mut patterned.pattern);
            }
        }
        if let Texture::Patterned(patterned) = texture
            && patterned.settle() > DEPTH_LIMIT
        {
            return Err(self.error(span, format!("more than {DEPTH_LIMIT} textures inside of one another")));
        }
        Ok(true)
    }

    /// A texture of `tiles`: in a block or as its items.
    fn tile(&mut self) -> Parse<Texture> {
        if self.peek_word()? == Some("texture") {
            return self.texture_block();
        }
        self.expect("{")?;
        let texture = self.texture_body()?;
        self.expect("}")?;
        Ok(texture)
    }
}

/// `no_bump_scale` of a texture: of all its normals.
fn keep_bumps(texture: &mut Texture) {
    match texture {
        Texture::Layers(layers) => layers.iter_mut().filter_map(|l| l.normal.as_mut()).for_each(|n: &mut Normal| n.no_bump_scale = true),
        Texture::Patterned(patterned) => match &mut patterned.fill {
            TextureFill::Textures(map) => Arc::make_mut(map).for_each_mut(keep_bumps),
            TextureFill::List(list) | TextureFill::Image(_, list) => Arc::make_mut(list).iter_mut().for_each(keep_bumps),
        },
    }
}
