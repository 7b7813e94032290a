//! Lights that are no shapes.

use glam::{Mat4, Vec3};
use serde::{Deserialize, Serialize};

use super::{ImageId, TextureId};

/// How a spot light fades between its inner and outer cone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SpotFalloff {
    /// Linear in the angle (Mitsuba).
    #[default]
    Linear,
    /// The square of a linear ramp of the cosine (KHR_lights_punctual).
    CosineSquared,
    /// Smoothstep of the cosine (pbrt).
    Smoothstep,
}

/// How the directions of an environment lie in its picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum EnvironmentMapping {
    /// Latitude and longitude: +y is up (first row), the middle column lies towards −z of its own space, +x is a quarter to the right
    /// of it.
    #[default]
    Equirectangular,
    /// The same, with the centers of the first and the last row on the poles and the others evenly between, as Mitsuba 3 has it.
    EquirectangularOnPoles,
    /// A square with the same solid angle for each pixel, +z in the middle (Clarberg 2008, doi:10.1080/2151237X.2008.10129263), as
    /// pbrt-v4 has it.
    EqualAreaSquare,
}

/// How the directions of a light lie in its picture. In its own space, +x is to the right of who looks along +z, +y is up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum PictureMapping {
    /// All directions in a square with the same solid angle for each pixel, +z in the middle, +y towards the last row (Clarberg 2008,
    /// doi:10.1080/2151237X.2008.10129263). What counts is the mean of a pixel's colors.
    EqualAreaSquare,
    /// Through a window: along +z in the middle, +y towards the first row, dark beside the picture.
    Perspective {
        /// Angle across the shorter edge.
        fov_rad: f32,
    },
}

/// A light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum LightDesc {
    /// A point.
    Point {
        /// Where.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: [f32; 3],
    },
    /// A point with a cone, along −z of its own space as in glTF.
    Spot {
        /// Places it; the cone's axis is −z.
        world_from_light: Mat4,
        /// Radiant intensity on the axis, W/sr.
        intensity: [f32; 3],
        /// Half-angle of the cone beyond which it is dark.
        outer_rad: f32,
        /// Half-angle of the cone within which it is full.
        inner_rad: f32,
        /// Between the two.
        falloff: SpotFalloff,
        /// A picture projected through the cone.
        texture: Option<TextureId>,
    },
    /// A point whose intensity is a picture over directions; each pixel is one intensity.
    Picture {
        /// Places it. Scales do not count, mirrors do.
        world_from_light: Mat4,
        /// Factor on the picture's linear values, W/sr.
        intensity: [f32; 3],
        /// Luminance of its whole power, W, which decides how bright it is instead.
        power: Option<f32>,
        /// The picture.
        image: ImageId,
        /// How directions lie in it.
        mapping: PictureMapping,
    },
    /// From infinitely far away.
    Directional {
        /// Where the light travels to, unit.
        direction: Vec3,
        /// Irradiance on a surface that faces the light, W/m².
        irradiance: [f32; 3],
    },
    /// The same radiance from everywhere.
    Constant {
        /// Radiance.
        radiance: [f32; 3],
    },
    /// A picture all round.
    Environment {
        /// Picture of linear radiance.
        image: ImageId,
        /// Factor on the picture.
        scale: [f32; 3],
        /// Turns the picture's space into the world's.
        world_from_light: Mat4,
        /// How directions lie in the picture.
        mapping: EnvironmentMapping,
        /// The corners, in turn, of a rectangle in the world through which alone the light comes: a point sees the picture where its line of sight
        /// passes the rectangle in the direction of (corner 3 − corner 0) × (corner 1 − corner 0). `None`: it comes from everywhere.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        portal: Option<[Vec3; 4]>,
    },
    /// Sky and sun by a physical model.
    SunSky(Box<SunSkyDesc>),
}

impl LightDesc {
    /// What is left of a light by a picture without the picture, for formats that lack it: a point, or a cone as wide as the window is
    /// high.
    pub fn without_picture(&self) -> Self {
        let Self::Picture { world_from_light, intensity, mapping, .. } = self else { return self.clone() };
        match *mapping {
            PictureMapping::EqualAreaSquare => {
                Self::Point { position: world_from_light.transform_point3(Vec3::ZERO), intensity: *intensity }
            }
            PictureMapping::Perspective { fov_rad } => Self::Spot {
                // Spots shine along −z.
                world_from_light: *world_from_light * Mat4::from_rotation_y(std::f32::consts::PI),
                intensity: *intensity,
                outer_rad: 0.5 * fov_rad,
                inner_rad: 0.5 * fov_rad,
                falloff: SpotFalloff::Linear,
                texture: None,
            },
        }
    }
}

/// Sky and sun. The model's own space has +z to the zenith.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SunSkyDesc {
    /// Whether the sky shines.
    pub sky: bool,
    /// Whether the sun shines.
    pub sun: bool,
    /// Direction to the sun in the model's space, unit.
    pub sun_direction: Vec3,
    /// Turbidity, 1 to 10.
    pub turbidity: f32,
    /// Reflectance of the ground, [0, 1].
    pub albedo: [f32; 3],
    /// Factor on the sky.
    pub sky_scale: f32,
    /// Factor on the sun.
    pub sun_scale: f32,
    /// Half of the sun's angular diameter; its irradiance does not depend on it.
    pub sun_half_angle_rad: f32,
    /// Turns the model's space into the world's.
    pub world_from_light: Mat4,
}
