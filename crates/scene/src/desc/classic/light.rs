//! Light sources of the classic model.

use std::sync::Arc;

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

use super::Object;

/// Where a light shines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum LightKind {
    /// All round.
    #[default]
    Point,
    /// Within a cone about the line to `point_at`.
    Spot,
    /// Within a cylinder about the line to `point_at`.
    Cylinder,
}

/// An area light: a grid of points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AreaLight {
    /// One edge of the rectangle.
    pub axis1: DVec3,
    /// The other edge.
    pub axis2: DVec3,
    /// Points along each edge.
    pub size: [u32; 2],
    /// Subdivisions before the adaptive ones; `None` tests all points.
    pub adaptive: Option<u32>,
    /// Points are moved at random within their cells.
    pub jitter: bool,
    /// The grid is shaped like a disc.
    pub circular: bool,
    /// The rectangle turns towards the point it lights.
    pub orient: bool,
    /// Diffuse and specular light come from all points, not from the middle.
    pub illumination: bool,
}

/// `light_group`: lights that only light what is in the group.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LightGroup {
    /// The group around it, whose lights light it too; 0 for none.
    pub parent: u32,
    /// Lights of the world light it too.
    pub global_lights: bool,
}

/// `light_source`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Light group, from 1; 0 for none.
    pub group: u32,
    /// Where it is.
    pub location: DVec3,
    /// Color.
    pub color: DVec3,
    /// Where it shines.
    pub kind: LightKind,
    /// Its rays are parallel to the line to `point_at`.
    pub parallel: bool,
    /// The middle of the cone.
    pub point_at: DVec3,
    /// Half angle of the bright cone in degrees, or radius of the bright cylinder.
    pub radius: f64,
    /// Half angle of the cone in degrees, or radius of the cylinder.
    pub falloff: f64,
    /// Exponent of the cosine to the cone's axis.
    pub tightness: f64,
    /// Its extent, for soft shadows.
    pub area: Option<AreaLight>,
    /// Casts no shadows and makes no highlights.
    pub shadowless: bool,
    /// Distance at which the light has its color; 0 for no fading.
    pub fade_distance: f64,
    /// Exponent of fading; 0 for none.
    pub fade_power: f64,
    /// Only light that passes this object arrives.
    pub projected_through: Option<Arc<Object>>,
    /// Lights media.
    pub media_interaction: bool,
    /// Fog and atmospheric media take from its light.
    pub media_attenuation: bool,
    /// Shoots photons at reflecting targets; `None`: as the target says.
    pub photon_reflection: Option<bool>,
    /// Shoots photons at refracting targets; `None`: as the target says.
    pub photon_refraction: Option<bool>,
    /// Photons leave all of an area light, not its middle.
    pub photon_area: bool,
}

impl Light {
    /// A point light.
    pub fn new(location: DVec3, color: DVec3) -> Self {
        Self {
            group: 0,
            location,
            color,
            kind: LightKind::Point,
            parallel: false,
            point_at: DVec3::ZERO,
            radius: 30.0,
            falloff: 45.0,
            tightness: 0.0,
            area: None,
            shadowless: false,
            fade_distance: 0.0,
            fade_power: 0.0,
            projected_through: None,
            media_interaction: true,
            media_attenuation: false,
            photon_reflection: None,
            photon_refraction: None,
            photon_area: false,
        }
    }

    /// Moves the light.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.location = world_from_old.transform_point3(self.location);
        self.point_at = world_from_old.transform_point3(self.point_at);
        if let Some(area) = &mut self.area {
            area.axis1 = world_from_old.transform_vector3(area.axis1);
            area.axis2 = world_from_old.transform_vector3(area.axis2);
        }
        if let Some(object) = &mut self.projected_through {
            Arc::make_mut(object).transform(world_from_old);
        }
    }
}

impl Default for Light {
    /// A white point light at the origin.
    fn default() -> Self {
        Self::new(DVec3::ZERO, DVec3::ONE)
    }
}
