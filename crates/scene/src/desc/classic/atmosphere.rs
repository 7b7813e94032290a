//! Fog, sky and rainbow.

use std::sync::Arc;

use etendue_procedural::noise::Turbulence;
use etendue_procedural::{BlendMap, Color, Pigment};
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// `fog`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fog {
    /// 1 constant, 2 on the ground.
    pub kind: u8,
    /// Depth at which 1/e of the light is left; 0 for no fog.
    pub distance: f64,
    /// Color; `transmit` always passes, `filter` is the share that passes in its color.
    pub color: Color,
    /// Height up to which ground fog is constant.
    pub offset: f64,
    /// Height above the offset at which the density is a quarter.
    pub altitude: f64,
    /// Up, for heights; unit.
    pub up: DVec3,
    /// Amount of turbulence.
    pub turbulence: DVec3,
    /// Octaves of the turbulence.
    pub octaves: Turbulence,
    /// Turbulence along the ray.
    pub turb_depth: f64,
}

impl Default for Fog {
    fn default() -> Self {
        Self {
            kind: 1,
            distance: 0.0,
            color: Color::default(),
            offset: 0.0,
            altitude: 0.0,
            up: DVec3::Y,
            turbulence: DVec3::ZERO,
            octaves: Turbulence::default(),
            turb_depth: 0.5,
        }
    }
}

impl Fog {
    /// Turns the up direction.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.up = world_from_old.transform_vector3(self.up);
    }
}

/// `sky_sphere`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkySphere {
    /// Pigments of the direction, the last on top.
    pub pigments: Vec<Arc<Pigment>>,
    /// Factor of its light.
    pub emission: DVec3,
}

impl Default for SkySphere {
    fn default() -> Self {
        Self { pigments: Vec::new(), emission: DVec3::ONE }
    }
}

impl SkySphere {
    /// Turns the pigments.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        for pigment in &mut self.pigments {
            Arc::make_mut(pigment).transform(world_from_old);
        }
    }
}

/// `rainbow`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rainbow {
    /// The light's direction.
    pub direction: DVec3,
    /// Angle between the direction and the middle of the bow, in degrees.
    pub angle: f64,
    /// Width of the bow in degrees.
    pub width: f64,
    /// As a fog's distance.
    pub distance: f64,
    /// Random shift of colors.
    pub jitter: f64,
    /// Where the bow's top is.
    pub up: DVec3,
    /// Length of the bow in degrees.
    pub arc_angle: f64,
    /// Length up to which it is full, in degrees.
    pub falloff_angle: f64,
    /// Colors from the inside to the outside.
    pub colors: Option<Arc<BlendMap<Color>>>,
}

impl Default for Rainbow {
    fn default() -> Self {
        Self {
            direction: DVec3::ZERO,
            angle: 0.0,
            width: 0.0,
            distance: 1e9,
            jitter: 0.0,
            up: DVec3::Y,
            arc_angle: 180.0,
            falloff_angle: 180.0,
            colors: None,
        }
    }
}

impl Rainbow {
    /// Turns the bow.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.direction = world_from_old.transform_vector3(self.direction);
        self.up = world_from_old.transform_vector3(self.up);
    }
}
