//! Scenes of the classic model, as POV-Ray has them: exact solids and their constructive combinations, procedural textures, and
//! light as Whitted-style tracers compute it. Everything in `f64`, in the file's own left-handed space.
//!
//! `etendue-render` renders such a scene in two ways: by the classic shading model (`whitted`), and, turned into physical
//! materials, by any other integrator.

mod atmosphere;
mod camera;
mod function_solids;
mod interior;
mod large_solids;
mod light;
mod object;
mod settings;
mod solid;

pub use atmosphere::*;
pub use camera::*;
pub use function_solids::*;
pub use interior::*;
pub use large_solids::*;
pub use light::*;
pub use object::*;
pub use settings::*;
pub use solid::*;

use std::path::PathBuf;
use std::sync::Arc;

use etendue_procedural::Color;
use serde::{Deserialize, Serialize};

use crate::span::Span;

/// A picture that textures or height fields use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClassicImage {
    /// Where it comes from.
    pub source: ImageSource,
    /// Where the file names it.
    pub span: Span,
    /// What the scene says that the file's numbers mean (`gamma`).
    pub gamma: Option<ImageGamma>,
    /// What the numbers are for.
    pub content: ImageContent,
    /// Colors are stored multiplied with alpha (`premultiplied`); `None` by the file's own kind.
    pub premultiplied: Option<bool>,
}

/// Where a picture comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ImageSource {
    /// The resolved path of a file.
    File(PathBuf),
    /// Made by a function: colors of the working space, row by row from the top.
    Made {
        /// Columns.
        width: u32,
        /// Colors; as many as columns by rows.
        colors: Arc<Vec<Color>>,
    },
}

/// `gamma` of a picture: how its numbers become linear light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ImageGamma {
    /// By a power.
    Power(f64),
    /// Through the sRGB transfer function.
    Srgb,
}

/// What a picture's numbers are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ImageContent {
    /// Colors, decoded by the file's kind and brought to the working space.
    Colors,
    /// Colors of a scene before version 3.7: as they are where no gamma is given.
    OldColors,
    /// Heights, pattern values and indices: as they are where no gamma is given, and never brought to the working space.
    Data,
}

/// What a scene of the classic model says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ClassicScene {
    /// Global settings.
    pub settings: GlobalSettings,
    /// Objects of the world, lights taken out.
    pub objects: Vec<Arc<Object>>,
    /// Objects that `object { … }` patterns ask about, by [`etendue_procedural::ObjectId`].
    pub pattern_objects: Vec<Arc<Object>>,
    /// Light sources; those of light groups name their group.
    pub lights: Vec<Light>,
    /// Light groups; number n of objects and lights is entry n − 1.
    pub light_groups: Vec<LightGroup>,
    /// The camera.
    pub camera: Camera,
    /// Fogs, all of them at work.
    pub fogs: Vec<Fog>,
    /// Rainbows.
    pub rainbows: Vec<Rainbow>,
    /// The sky beyond everything.
    pub sky: Option<SkySphere>,
    /// Background color; black where there is none.
    pub background: Option<Color>,
    /// Interior (media) of the space outside all objects.
    pub atmosphere: Vec<Media>,
    /// Pictures, by [`etendue_procedural::ImageId`].
    pub images: Vec<ClassicImage>,
}
