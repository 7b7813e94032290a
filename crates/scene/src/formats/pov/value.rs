//! Values that identifiers hold.

use std::sync::Arc;

use etendue_procedural::{BlendMap, Color, Finish, Function, Normal, Pigment, Spline, Texture};
use glam::DMat4;

use crate::desc::classic::{Camera, Fog, Interior, Media, Object, Rainbow, SkySphere};

/// A material: texture and interior together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Material {
    /// Texture.
    pub texture: Option<Arc<Texture>>,
    /// Texture of the inside.
    pub interior_texture: Option<Arc<Texture>>,
    /// Interior.
    pub interior: Option<Arc<Interior>>,
}

/// What an identifier stands for. Cheap to clone.
#[derive(Clone, Debug)]
pub enum Value {
    /// Float.
    Float(f64),
    /// Vector of 2, 3, 4 or 5 numbers; colors are vectors of five (red, green, blue, filter, transmit).
    Vector(arrayvec::ArrayVec<f64, 5>),
    /// String.
    String(Arc<str>),
    /// Function.
    Function(Arc<Function>),
    /// Spline.
    Spline(Arc<Spline>),
    /// Transform.
    Transform(DMat4),
    /// Pigment (also density).
    Pigment(Arc<Pigment>),
    /// Normal.
    Normal(Arc<Normal>),
    /// Finish.
    Finish(Arc<Finish>),
    /// Texture.
    Texture(Arc<Texture>),
    /// Material.
    Material(Arc<Material>),
    /// Object; lights too.
    Object(Arc<Object>),
    /// Interior.
    Interior(Arc<Interior>),
    /// Media.
    Media(Arc<Media>),
    /// Color map.
    ColorMap(Arc<BlendMap<Color>>),
    /// Pigment map (also density map).
    PigmentMap(Arc<BlendMap<Pigment>>),
    /// Normal map.
    NormalMap(Arc<BlendMap<Normal>>),
    /// Texture map.
    TextureMap(Arc<BlendMap<Texture>>),
    /// Slope map: (height, slope).
    SlopeMap(Arc<BlendMap<(f64, f64)>>),
    /// Camera.
    Camera(Arc<Camera>),
    /// Fog.
    Fog(Arc<Fog>),
    /// Rainbow.
    Rainbow(Arc<Rainbow>),
    /// Sky sphere.
    SkySphere(Arc<SkySphere>),
}
