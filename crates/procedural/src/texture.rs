//! Textures: layers of pigment, normal and finish, and maps of textures.

use std::sync::Arc;

use glam::DMat4;
use serde::{Deserialize, Serialize};

use crate::{Context, Finish, Normal, Pigment};

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

/// A texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Texture {
    /// Layers, the first the lowest, the last on top.
    Layers(Vec<Layer>),
}

impl Texture {
    /// The stacks of layers at the context's point with their weights (sum 1): a blend of lit textures, as texture maps make it.
    pub fn resolve<'a>(&'a self, context: &Context, visit: &mut dyn FnMut(f64, &'a [Layer], &Context)) {
        match self {
            Self::Layers(layers) => visit(1.0, layers, context),
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
        }
    }
}
