//! Textures: layers of pigment, normal and finish, and maps of textures (documentation, "Texture").

use std::sync::Arc;

use glam::DMat4;
use serde::{Deserialize, Serialize};

use crate::{BlendMap, Context, Finish, ImageMap, Normal, Pattern, PatternKind, Pigment};

/// One layer of a texture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// Its color.
    pub pigment: Pigment,
    /// Its normal perturbation.
    pub normal: Option<Normal>,
    /// How it answers light.
    pub finish: Arc<Finish>,
}

impl Layer {
    /// Pigment and normal by surface coordinates (`uv_mapping` of the texture).
    pub fn map_by_uv(&mut self) {
        if let Pigment::Patterned(patterned) = &mut self.pigment {
            patterned.uv_mapping = true;
        }
        if let Some(normal) = &mut self.normal {
            normal.uv_mapping = true;
        }
    }
}

/// A texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Texture {
    /// Layers, the first the lowest, the last on top.
    Layers(Vec<Layer>),
    /// Textures chosen by a pattern.
    Patterned(Box<PatternedTexture>),
}

/// A pattern with the textures it chooses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PatternedTexture {
    /// The pattern.
    pub pattern: Pattern,
    /// The textures.
    pub fill: TextureFill,
    /// The point is (u, v, 0) of the surface.
    pub uv_mapping: bool,
    /// How deep patterned textures stand in one another, from 1; kept by [`PatternedTexture::settle`].
    pub depth: u32,
}

/// What a pattern chooses from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TextureFill {
    /// Blends of textures; weighted in an `average`.
    Textures(Arc<BlendMap<Texture>>),
    /// A texture for each kind of block.
    List(Arc<Vec<Texture>>),
    /// A texture for each index of a picture (`material_map`); the pattern is only its place.
    Image(ImageMap, Arc<Vec<Texture>>),
}

impl Default for Texture {
    fn default() -> Self {
        Self::Layers(vec![Layer::default()])
    }
}

impl Texture {
    /// The stacks of layers at the context's point with their weights (sum 1): a blend of lit textures, as texture maps make it. The
    /// context that `visit` gets is the one to evaluate the layers in.
    pub fn resolve<'a>(&'a self, context: &Context, visit: &mut dyn FnMut(f64, &'a [Layer], &Context)) {
        self.resolve_share(1.0, context, visit);
    }

    fn resolve_share<'a>(&'a self, share: f64, context: &Context, visit: &mut dyn FnMut(f64, &'a [Layer], &Context)) {
        match self {
            Self::Layers(layers) => visit(share, layers, context),
            Self::Patterned(patterned) => patterned.resolve(share, context, visit),
        }
    }

    /// Moves the texture with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        match self {
            Self::Layers(layers) => layers.iter_mut().for_each(|l| {
                l.pigment.transform(world_from_old);
                if let Some(n) = &mut l.normal {
                    n.transform(world_from_old);
                }
            }),
            Self::Patterned(patterned) => patterned.pattern.transform(world_from_old),
        }
    }

    /// Moves the texture with an object that it is on: what goes by surface coordinates stays (measured: POV-Ray's `uv_mapping` does not
    /// follow transforms of the object, but those within the texture).
    pub fn move_with_object(&mut self, world_from_old: &DMat4) {
        match self {
            Self::Layers(layers) => layers.iter_mut().for_each(|l| {
                if !matches!(&l.pigment, Pigment::Patterned(p) if p.uv_mapping) {
                    l.pigment.transform(world_from_old);
                }
                if let Some(n) = l.normal.as_mut().filter(|n| !n.uv_mapping) {
                    n.transform(world_from_old);
                }
            }),
            Self::Patterned(patterned) if patterned.uv_mapping => {}
            Self::Patterned(patterned) => patterned.pattern.transform(world_from_old),
        }
    }

    /// Layers, where this is a plain or layered texture.
    pub fn layers(&self) -> Option<&[Layer]> {
        match self {
            Self::Layers(layers) => Some(layers),
            Self::Patterned(_) => None,
        }
    }
}

impl PatternedTexture {
    /// A pattern with its textures.
    pub fn new(pattern: Pattern, fill: TextureFill) -> Self {
        let mut new = Self { pattern, fill, uv_mapping: false, depth: 1 };
        new.settle();
        new
    }

    /// Brings the depth up to date after a change of the fill; returns it.
    pub fn settle(&mut self) -> u32 {
        let depth = |t: &Texture| match t {
            Texture::Layers(_) => 0,
            Texture::Patterned(p) => p.depth,
        };
        let of_fill = match &self.fill {
            TextureFill::Textures(map) => map.entries.iter().map(|e| depth(&e.1)).max(),
            TextureFill::List(list) | TextureFill::Image(_, list) => list.iter().map(depth).max(),
        };
        self.depth = of_fill.unwrap_or(0).saturating_add(1);
        self.depth
    }

    fn resolve<'a>(&'a self, share: f64, context: &Context, visit: &mut dyn FnMut(f64, &'a [Layer], &Context)) {
        let inner = if self.uv_mapping { self.pattern.enter(&context.moved(context.uv.extend(0.0))) } else { self.pattern.enter(context) };
        match &self.fill {
            TextureFill::Textures(map) if matches!(self.pattern.kind, PatternKind::Average) => {
                let total = map.total();
                let even = !(total.is_finite() && total != 0.0);
                for (weight, texture) in &map.entries {
                    let part = if even { 1.0 / map.entries.len() as f64 } else { weight / total };
                    if part != 0.0 {
                        texture.resolve_share(share * part, &inner, visit);
                    }
                }
            }
            TextureFill::Textures(map) => match map.around(self.pattern.value_here(&inner)) {
                None => {}
                Some((a, _, 0.0)) => a.resolve_share(share, &inner, visit),
                Some((_, b, 1.0)) => b.resolve_share(share, &inner, visit),
                Some((a, b, weight)) => {
                    a.resolve_share(share * (1.0 - weight), &inner, visit);
                    b.resolve_share(share * weight, &inner, visit);
                }
            },
            TextureFill::List(list) => {
                if let Some(texture) = list.get(self.pattern.kind.block(&inner)) {
                    texture.resolve_share(share, &inner, visit);
                }
            }
            TextureFill::Image(image, list) => {
                if !list.is_empty() {
                    let index = image.material(&inner) as usize % list.len();
                    list[index].resolve_share(share, &inner, visit);
                }
            }
        }
    }
}
