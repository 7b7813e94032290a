//! What evaluation needs beside the point: pictures, and which points lie inside which objects.

use glam::{DVec2, DVec3};

use crate::{Color, ImageId, ObjectId};

/// Decoded pictures.
pub trait Images: Send + Sync {
    /// Width and height in pixels; `None` for a picture that is not there.
    fn size(&self, image: ImageId) -> Option<[u32; 2]>;
    /// The pixel at (x, y), (0, 0) the upper left corner, in the scene's working color space, alpha as `transmit` = 1 − alpha.
    /// Coordinates are within the size.
    fn pixel(&self, image: ImageId, x: u32, y: u32) -> Color;
    /// The palette index of a pixel of a picture with palette; `None` without one.
    fn index(&self, image: ImageId, x: u32, y: u32) -> Option<u32>;
}

/// Which points lie inside objects.
pub trait Inside: Send + Sync {
    /// Whether the point (world space) is inside the object.
    fn inside(&self, object: ObjectId, p: DVec3) -> bool;
}

/// Where and with what a texture is evaluated. Cheap to copy.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// The point, in the texture's space (world space at the top).
    pub p: DVec3,
    /// Unit normal at the point, turned towards the viewer, for `slope` and `aoi` patterns; zero where there is none.
    pub normal: DVec3,
    /// Unit direction of the ray, for `aoi`; zero where there is none.
    pub ray: DVec3,
    /// Surface coordinates for `uv_mapping`.
    pub uv: DVec2,
    /// Pictures; `None` where pictures cannot be read (they then are black).
    pub images: Option<&'a dyn Images>,
    /// Objects; `None` where there are none (nothing is then inside).
    pub inside: Option<&'a dyn Inside>,
    /// The scene's `noise_generator`: 1, 2 or 3.
    pub noise_generator: u8,
    /// The scene's `number_of_waves`: 10 by default.
    pub number_of_waves: u32,
}

impl Context<'_> {
    /// A bare point with noise generator 2, which is the default of scenes of version 3.7.
    pub fn at(p: DVec3) -> Self {
        Self {
            p,
            normal: DVec3::ZERO,
            ray: DVec3::ZERO,
            uv: DVec2::ZERO,
            images: None,
            inside: None,
            noise_generator: 2,
            number_of_waves: 10,
        }
    }

    /// The same at another point.
    pub fn moved(self, p: DVec3) -> Self {
        Self { p, ..self }
    }
}
