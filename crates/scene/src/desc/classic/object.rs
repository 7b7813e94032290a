//! Objects: solids with their textures and modifiers.

use std::sync::Arc;

use etendue_procedural::Texture;
use glam::DMat4;
use serde::{Deserialize, Serialize};

use super::{Interior, Solid};
use crate::span::Span;

/// An object of the world or part of another.
///
/// Everything beside the solid (textures, interior, clips, bounds) is in the space that `world_from_solid` leads to: world space at the
/// top, the space of the parent's `solid` for parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Object {
    /// Where the file says it.
    pub span: Span,
    /// Its shape, in the solid's own space.
    pub solid: Solid,
    /// Places the solid.
    pub world_from_solid: DMat4,
    /// Inside and outside change places.
    pub inverse: bool,
    /// Texture, in world space; `None` takes the parent's, then the default.
    pub texture: Option<Arc<Texture>>,
    /// Texture of the inside; `None` takes `texture`.
    pub interior_texture: Option<Arc<Texture>>,
    /// What is inside.
    pub interior: Option<Arc<Interior>>,
    /// Only what is inside of all these is there.
    pub clipped_by: Vec<Arc<Object>>,
    /// Shapes that are said to hold the object; they bound what has no finite box of its own.
    pub bounded_by: Vec<Arc<Object>>,
    /// Casts no shadow.
    pub no_shadow: bool,
    /// Not seen by camera rays.
    pub no_image: bool,
    /// Not seen by reflected rays.
    pub no_reflection: bool,
    /// Not seen by radiosity rays.
    pub no_radiosity: bool,
    /// Fog and atmosphere go on inside.
    pub hollow: bool,
    /// `hollow` was stated; otherwise parts take their parent's.
    pub hollow_stated: bool,
    /// Lights on either side light both.
    pub double_illuminate: bool,
    /// Pigments by surface coordinates where the texture does not say.
    pub uv_mapping: bool,
    /// The accurate root finder was asked for.
    pub sturm: bool,
    /// Cut faces without texture take the textures of the parts that they cut (intersections and differences).
    pub cutaway_textures: bool,
    /// Photons are shot at each part (unions).
    pub split_union: bool,
    /// `photons`.
    pub photons: PhotonSettings,
    /// Share of radiosity samples, `radiosity { importance … }`.
    pub radiosity_importance: Option<f64>,
    /// Light group, from 1; 0 for none.
    pub light_group: u32,
    /// The texture is the default of its place, not one of its own: cut faces do without it.
    pub texture_is_default: bool,
    /// Whether there are lights among its parts.
    pub has_lights: bool,
    /// Number of primitives of this object with all its parts.
    pub leaves: u64,
    /// Levels of parts below this object; 0 for primitives.
    pub depth: u32,
}

/// `photons` of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhotonSettings {
    /// Photons are shot at the object, at this multiple of the spacing.
    pub target: Option<f64>,
    /// Refracts photons; `None` where not said.
    pub refraction: Option<bool>,
    /// Reflects photons; `None` where not said.
    pub reflection: Option<bool>,
    /// Does not keep photons (`collect off`).
    pub no_collect: bool,
    /// Photons pass as if it were not there.
    pub pass_through: bool,
}

/// Most parts that an object may have in all, which bounds memory: parts are shared in files but not in the renderer.
pub const MAX_LEAVES: u64 = 20_000_000;
/// Deepest nesting of parts in parts.
pub const MAX_DEPTH: u32 = 400;

impl Object {
    /// An object without texture.
    pub fn new(span: Span, solid: Solid) -> Self {
        let (leaves, depth) = match solid.parts() {
            Some(parts) => (
                parts.iter().fold(0u64, |n, p| n.saturating_add(p.leaves)),
                parts.iter().map(|p| p.depth).max().unwrap_or(0).saturating_add(1),
            ),
            None => (1, 0),
        };
        let has_lights = match &solid {
            Solid::Light(_) => true,
            solid => solid.parts().unwrap_or_default().iter().any(|p| p.has_lights),
        };
        Self {
            span,
            solid,
            world_from_solid: DMat4::IDENTITY,
            inverse: false,
            texture: None,
            interior_texture: None,
            interior: None,
            clipped_by: Vec::new(),
            bounded_by: Vec::new(),
            no_shadow: false,
            no_image: false,
            no_reflection: false,
            no_radiosity: false,
            hollow: false,
            hollow_stated: false,
            double_illuminate: false,
            uv_mapping: false,
            sturm: false,
            cutaway_textures: false,
            split_union: true,
            photons: PhotonSettings::default(),
            radiosity_importance: None,
            light_group: 0,
            texture_is_default: false,
            has_lights,
            leaves,
            depth,
        }
    }

    /// Moves the object with its textures, interior, clips, bounds and parts.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        if let Solid::Light(light) = &mut self.solid {
            light.transform(world_from_old);
        } else {
            self.world_from_solid = *world_from_old * self.world_from_solid;
        }
        for t in [&mut self.texture, &mut self.interior_texture].into_iter().flatten() {
            Arc::make_mut(t).move_with_object(world_from_old);
        }
        if let Some(i) = &mut self.interior {
            Arc::make_mut(i).transform(world_from_old);
        }
        for part in self.clipped_by.iter_mut().chain(&mut self.bounded_by) {
            Arc::make_mut(part).transform(world_from_old);
        }
    }

    /// Whether nothing but the solid says anything, so that a union of it can hold its parts directly.
    pub fn is_plain(&self) -> bool {
        self.world_from_solid == DMat4::IDENTITY
            && !self.inverse
            && self.texture.is_none()
            && self.interior_texture.is_none()
            && self.interior.is_none()
            && self.clipped_by.is_empty()
            && self.bounded_by.is_empty()
            && !(self.no_shadow || self.no_image || self.no_reflection || self.no_radiosity)
            && !(self.hollow_stated || self.double_illuminate || self.uv_mapping || self.cutaway_textures)
            && self.split_union
            && self.photons == PhotonSettings::default()
            && self.radiosity_importance.is_none()
            && self.light_group == 0
    }
}
