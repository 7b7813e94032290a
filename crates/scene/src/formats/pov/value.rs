//! Values that identifiers hold.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use etendue_procedural::{BlendMap, Color, Finish, Function, Normal, Pigment, Spline, Texture};
use glam::{DMat4, DVec2, DVec3, DVec4};

use super::lexer::{Code, Sym};
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
    Transform(Arc<DMat4>),
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
    /// Array.
    Array(Arc<Array>),
    /// Macro.
    Macro(Arc<Macro>),
    /// An open file, by its number.
    File(u32),
}

/// An array of up to five dimensions.
#[derive(Debug)]
pub struct Array {
    /// Sizes, outermost first.
    pub sizes: Vec<usize>,
    /// Elements in order; `None` where not set.
    pub items: Vec<Option<Value>>,
    /// Elements of all living arrays together, so that a scene cannot fill the memory with them.
    pub(super) living: Arc<AtomicU64>,
}

impl Array {
    /// An array of unset elements, counted in `living`.
    pub(super) fn new(sizes: Vec<usize>, living: &Arc<AtomicU64>) -> Self {
        let count = sizes.iter().product();
        living.fetch_add(count as u64, Ordering::Relaxed);
        Self { sizes, items: vec![None; count], living: living.clone() }
    }
}

impl Clone for Array {
    fn clone(&self) -> Self {
        self.living.fetch_add(self.items.len() as u64, Ordering::Relaxed);
        Self { sizes: self.sizes.clone(), items: self.items.clone(), living: self.living.clone() }
    }
}

impl Drop for Array {
    fn drop(&mut self) {
        self.living.fetch_sub(self.items.len() as u64, Ordering::Relaxed);
    }
}

/// A macro: its parameters and the tokens of its body.
#[derive(Debug)]
pub struct Macro {
    /// Name.
    pub name: Arc<str>,
    /// Parameters and whether each may be left out.
    pub(super) parameters: Vec<(Sym, bool)>,
    /// The file with its body.
    pub(super) code: Arc<Code>,
    /// The body: tokens of this range.
    pub(super) body: std::ops::Range<usize>,
}

impl Value {
    /// What kind of value it is, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Float(_) => "float",
            Self::Vector(v) if v.len() == 5 => "color",
            Self::Vector(_) => "vector",
            Self::String(_) => "string",
            Self::Function(_) => "function",
            Self::Spline(_) => "spline",
            Self::Transform(_) => "transform",
            Self::Pigment(_) => "pigment",
            Self::Normal(_) => "normal",
            Self::Finish(_) => "finish",
            Self::Texture(_) => "texture",
            Self::Material(_) => "material",
            Self::Object(_) => "object",
            Self::Interior(_) => "interior",
            Self::Media(_) => "media",
            Self::ColorMap(_) => "color_map",
            Self::PigmentMap(_) => "pigment_map",
            Self::NormalMap(_) => "normal_map",
            Self::TextureMap(_) => "texture_map",
            Self::SlopeMap(_) => "slope_map",
            Self::Camera(_) => "camera",
            Self::Fog(_) => "fog",
            Self::Rainbow(_) => "rainbow",
            Self::SkySphere(_) => "sky_sphere",
            Self::Array(_) => "array",
            Self::Macro(_) => "macro",
            Self::File(_) => "file",
        }
    }
}

/// The value of a numeric expression: a float, or a vector of two to five numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Num {
    /// Components; those from `len` on are 0.
    pub v: [f64; 5],
    /// How many components there are; 1 for a float.
    pub len: u8,
}

impl Num {
    /// A float.
    pub fn float(x: f64) -> Self {
        Self { v: [x, 0.0, 0.0, 0.0, 0.0], len: 1 }
    }

    /// A vector of one to five numbers; more are left out.
    pub fn vector(values: &[f64]) -> Self {
        let mut v = [0.0; 5];
        for (to, from) in v.iter_mut().zip(values) {
            *to = *from;
        }
        Self { v, len: values.len().clamp(1, 5) as u8 }
    }

    /// A vector of three numbers.
    pub fn vector3(p: DVec3) -> Self {
        Self::vector(&[p.x, p.y, p.z])
    }

    /// As a vector of `len` numbers or more: a float fills all, a shorter vector is filled up with zeros.
    pub fn promoted(self, len: u8) -> Self {
        if self.len == 1 && len > 1 {
            let mut v = [0.0; 5];
            v[..usize::from(len.min(5))].fill(self.v[0]);
            Self { v, len }
        } else {
            Self { v: self.v, len: self.len.max(len) }
        }
    }

    /// The first two numbers after promotion.
    pub fn xy(self) -> DVec2 {
        let v = self.promoted(2).v;
        DVec2::new(v[0], v[1])
    }

    /// The first three numbers after promotion.
    pub fn xyz(self) -> DVec3 {
        let v = self.promoted(3).v;
        DVec3::new(v[0], v[1], v[2])
    }

    /// The first four numbers after promotion.
    pub fn xyzt(self) -> DVec4 {
        let v = self.promoted(4).v;
        DVec4::new(v[0], v[1], v[2], v[3])
    }

    /// As a color: a float fills all five numbers.
    pub fn color(self) -> Color {
        let v = self.promoted(5).v;
        Color { rgb: DVec3::new(v[0], v[1], v[2]), filter: v[3], transmit: v[4] }
    }

    /// As an identifier's value.
    pub fn value(self) -> Value {
        if self.len == 1 { Value::Float(self.v[0]) } else { Value::Vector(self.v[..usize::from(self.len)].iter().copied().collect()) }
    }

    /// Of an identifier's value, if it is a number.
    pub fn of(value: &Value) -> Option<Self> {
        match value {
            Value::Float(x) => Some(Self::float(*x)),
            Value::Vector(v) => Some(Self::vector(v)),
            _ => None,
        }
    }
}
