//! Objects: solids with their textures.

use std::sync::Arc;

use etendue_procedural::Texture;
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

use super::{Interior, Light};
use crate::span::Span;

/// An object of the world or part of another.
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
    /// Lights on either side light both.
    pub double_illuminate: bool,
    /// Pigments by surface coordinates where the texture does not say.
    pub uv_mapping: bool,
    /// Light group, from 1; 0 for none.
    pub light_group: u32,
}

/// Shapes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Solid {
    /// All of several.
    Union(Vec<Arc<Object>>),
    /// Sphere.
    Sphere {
        /// Center.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
    /// A light source in a union or group; taken out when the object is added to the scene.
    Light(Box<Light>),
}

impl Object {
    /// An object without texture.
    pub fn new(span: Span, solid: Solid) -> Self {
        Self {
            span,
            solid,
            world_from_solid: DMat4::IDENTITY,
            inverse: false,
            texture: None,
            interior_texture: None,
            interior: None,
            clipped_by: Vec::new(),
            no_shadow: false,
            no_image: false,
            no_reflection: false,
            no_radiosity: false,
            hollow: false,
            double_illuminate: false,
            uv_mapping: false,
            light_group: 0,
        }
    }

    /// Moves the object with its textures, interior and parts.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.world_from_solid = *world_from_old * self.world_from_solid;
        if let Some(t) = &mut self.texture {
            Arc::make_mut(t).transform(world_from_old);
        }
        if let Some(t) = &mut self.interior_texture {
            Arc::make_mut(t).transform(world_from_old);
        }
        if let Some(i) = &mut self.interior {
            Arc::make_mut(i).transform(world_from_old);
        }
    }
}
