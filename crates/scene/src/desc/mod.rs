//! [`SceneDesc`]: what a scene file says, in no format's words.
//!
//! Conventions: right-handed; linear Rec. 709 colors; radiance in W·m⁻²·sr⁻¹ or whatever unit the file uses consistently;
//! angles in radians; transforms named `world_from_object`. Nodes refer to each other by index ids.

mod bsdf;
mod camera;
pub mod classic;
mod geometry;
mod hash;
mod lens;
mod light;
mod medium;
mod texture;

pub use bsdf::*;
pub use camera::*;
pub use geometry::*;
pub use lens::*;
pub use light::*;
pub use medium::*;
pub use texture::*;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::report::Report;
use crate::span::{FileId, Span};

/// A node of a description: its value, its name in the file, and its place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Node<T> {
    /// The name or id that the file gives it; empty for none.
    pub name: String,
    /// Where the file says it.
    pub span: Span,
    /// What it says.
    pub value: T,
}

impl<T> Node<T> {
    /// A node without a name.
    pub fn new(span: Span, value: T) -> Self {
        Self { name: String::new(), span, value }
    }

    /// A node with a name.
    pub fn named(name: impl Into<String>, span: Span, value: T) -> Self {
        Self { name: name.into(), span, value }
    }
}

macro_rules! ids {
    ($($(#[$doc:meta])* $name:ident => $field:ident: $type:ty),* $(,)?) => {
        $($(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        pub struct $name(pub u32);

        impl std::ops::Index<$name> for SceneDesc {
            type Output = Node<$type>;
            fn index(&self, id: $name) -> &Node<$type> {
                &self.$field[id.0 as usize]
            }
        }

        impl AddNode<$type> for SceneDesc {
            type Id = $name;
            fn add(&mut self, node: Node<$type>) -> $name {
                self.$field.push(node);
                $name(self.$field.len() as u32 - 1)
            }
        })*
    };
}

/// Adds a node of one kind and returns its id.
pub trait AddNode<T> {
    /// The id of this kind of node.
    type Id;
    /// Appends the node.
    fn add(&mut self, node: Node<T>) -> Self::Id;
}

ids! {
    /// Index into [`SceneDesc::images`].
    ImageId => images: ImageDesc,
    /// Index into [`SceneDesc::textures`].
    TextureId => textures: TextureDesc,
    /// Index into [`SceneDesc::bsdfs`].
    BsdfId => bsdfs: BsdfDesc,
    /// Index into [`SceneDesc::media`].
    MediumId => media: MediumDesc,
    /// Index into [`SceneDesc::volumes`].
    VolumeId => volumes: VolumeDesc,
    /// Index into [`SceneDesc::meshes`].
    MeshId => meshes: MeshDesc,
    /// Index into [`SceneDesc::groups`].
    GroupId => groups: GroupDesc,
    /// Index into [`SceneDesc::shapes`].
    ShapeId => shapes: ShapeDesc,
    /// Index into [`SceneDesc::instances`].
    InstanceId => instances: InstanceDesc,
    /// Index into [`SceneDesc::lights`].
    LightId => lights: LightDesc,
    /// Index into [`SceneDesc::cameras`].
    CameraId => cameras: CameraDesc,
}

/// An animation of a file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AnimationDesc {
    /// Its name; may be empty.
    pub name: String,
    /// Time of its last key, in seconds.
    pub secs: f64,
}

/// Everything that a scene file says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneDesc {
    /// The format it was read from, such as `mitsuba` or `gltf`.
    pub format: String,
    /// The files it was read from; spans point here. The first is the scene file itself.
    pub files: Vec<PathBuf>,
    /// Pictures, referred to by textures and environment lights.
    pub images: Vec<Node<ImageDesc>>,
    /// Textures.
    pub textures: Vec<Node<TextureDesc>>,
    /// Scattering models.
    pub bsdfs: Vec<Node<BsdfDesc>>,
    /// Participating media.
    pub media: Vec<Node<MediumDesc>>,
    /// Grids of numbers in space, referred to by media.
    pub volumes: Vec<Node<VolumeDesc>>,
    /// Triangle meshes.
    pub meshes: Vec<Node<MeshDesc>>,
    /// Shapes of the world.
    pub shapes: Vec<Node<ShapeDesc>>,
    /// Groups of shapes that instances place.
    pub groups: Vec<Node<GroupDesc>>,
    /// Placed groups.
    pub instances: Vec<Node<InstanceDesc>>,
    /// Lights that are no shapes.
    pub lights: Vec<Node<LightDesc>>,
    /// Cameras; the first is the default.
    pub cameras: Vec<Node<CameraDesc>>,
    /// The scene of the classic model, where the format has one (POV-Ray); the lists above are then empty.
    pub classic: Option<Box<classic::ClassicScene>>,
    /// Animations that the file has; the scene is one moment of at most one of them.
    pub animations: Vec<AnimationDesc>,
    /// What the file says about how to render.
    pub film: FilmDesc,
    /// What the file says about the integrator.
    pub integrator: IntegratorDesc,
    /// Warnings and losses found while reading.
    pub report: Report,
}

impl SceneDesc {
    /// A scene that holds nothing, of a format and a file.
    pub fn new(format: &str, file: impl Into<PathBuf>) -> Self {
        Self { format: format.to_owned(), files: vec![file.into()], ..Self::default() }
    }

    /// Registers a further file and returns its id; the same path gives the same id.
    pub fn add_file(&mut self, path: impl Into<PathBuf>) -> FileId {
        let path = path.into();
        let i = self.files.iter().position(|f| *f == path).unwrap_or_else(|| {
            self.files.push(path);
            self.files.len() - 1
        });
        FileId(i as u32)
    }
}
