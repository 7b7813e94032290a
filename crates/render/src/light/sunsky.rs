//! Sky and sun by a physical model: Hosek and Wilkie 2012, "An Analytic Model for Full Spectral Sky-Dome Radiance",
//! doi:10.1145/2185520.2185591, in its RGB form, and their solar radiance of 2013.
//!
//! The sky becomes an environment map, black below the horizon, and the sun a disk of constant radiance, without the
//! darkening towards its limb. Units are Mitsuba 3's, so that its scenes look alike: the RGB data of the model over the
//! integral of the CIE ȳ(λ) curve. The model knows the sun above the horizon only: lower suns give the sky of a sun at the
//! horizon and no sunlight.

use etendue_scene::desc::SunSkyDesc;
use hw_skymodel::rgb::{SkyParams, SkyState};
use rayon::prelude::*;

use super::sun_table::SUN_IRRADIANCE;
use super::{EnvironmentLight, Light, Rows, SunLight};
use crate::math::{Mat4, PI, TAU, Vec3, Vec4, fns};

/// Texels of the sky's map.
const SKY_SIZE: (usize, usize) = (1024, 512);
/// From the RGB data's units to ours: one over the integral of ȳ(λ) in nm.
const UNIT: f32 = 1.0 / 106.856_98;

/// The lights of a description: none, one or two. What is out of the model's range is limited to it; `None` where
/// numbers are not finite or a transform is singular.
pub fn lights(desc: &SunSkyDesc) -> Option<Vec<Light>> {
    let numbers = [desc.turbidity, desc.sky_scale, desc.sun_scale, desc.sun_half_angle_rad];
    let to_sun = desc.sun_direction.normalize_or_zero();
    if to_sun == Vec3::ZERO || !numbers.iter().chain(&desc.albedo).all(|x| x.is_finite()) {
        return None;
    }
    let mut lights = Vec::new();
    if desc.sky && desc.sky_scale > 0.0 {
        let sky = Sky::new(to_sun, desc.turbidity, desc.albedo)?;
        // The map's +y is the model's +z.
        let model_from_map = Mat4::from_cols(Vec4::X, Vec4::Z, -Vec4::Y, Vec4::W);
        let scale = [desc.sky_scale; 3];
        let map = EnvironmentLight::new(SKY_SIZE, sky.texels(SKY_SIZE), scale, desc.world_from_light * model_from_map, Rows::Centered)?;
        lights.push(Light::Environment(Box::new(map)));
    }
    if desc.sun && desc.sun_scale > 0.0 && to_sun.z > 0.0 {
        let irradiance = sun_irradiance(fns::asin(to_sun.z), desc.turbidity).map(|v| v * desc.sun_scale);
        let direction = desc.world_from_light.transform_vector3(to_sun);
        lights.push(Light::Sun(SunLight::new(direction, irradiance, desc.sun_half_angle_rad)?));
    }
    Some(lights)
}

/// Irradiance of a surface that faces the sun, for its elevation in radians.
pub fn sun_irradiance(elevation_rad: f32, turbidity: f32) -> [f32; 3] {
    let position = |x: f32, knots: usize| {
        let x = x.clamp(0.0, (knots - 1) as f32);
        let i = (x as usize).min(knots - 2);
        (i, x - i as f32)
    };
    let (row, s) = position(turbidity - 1.0, SUN_IRRADIANCE.len());
    let knots = SUN_IRRADIANCE[0].len();
    let (column, t) = position(libm::cbrtf((elevation_rad / (PI / 2.0)).max(0.0)) * (knots - 1) as f32, knots);
    let along = |row: usize, lane: usize| fns::lerp(t, SUN_IRRADIANCE[row][column][lane], SUN_IRRADIANCE[row][column + 1][lane]);
    [0, 1, 2].map(|lane| fns::lerp(s, along(row, lane), along(row + 1, lane)))
}

/// The model's coefficients for one sun.
pub struct Sky {
    to_sun: Vec3,
    /// A to I of equation 8 for each channel.
    coefficients: [f32; 27],
    radiance: [f32; 3],
}

impl Sky {
    /// `to_sun` is unit, in the model's space (+z to the zenith).
    pub fn new(to_sun: Vec3, turbidity: f32, albedo: [f32; 3]) -> Option<Self> {
        let elevation = fns::asin(to_sun.z).clamp(0.0, PI / 2.0);
        let params = SkyParams { elevation, turbidity: turbidity.clamp(1.0, 10.0), albedo: albedo.map(|a| a.clamp(0.0, 1.0)) };
        let (coefficients, radiance) = SkyState::new(&params).ok()?.raw();
        // The model's own idea of the sun's place: not below the horizon.
        let to_sun = if to_sun.z < 0.0 { to_sun.with_z(0.0).normalize_or(Vec3::X) } else { to_sun };
        Some(Self { to_sun, coefficients, radiance })
    }

    /// Radiance from a unit direction of the model's space: equations 8 and 9.
    pub fn radiance(&self, d: Vec3) -> [f32; 3] {
        if d.z < 0.0 {
            return [0.0; 3];
        }
        let cos_gamma = d.dot(self.to_sun).clamp(-1.0, 1.0);
        let gamma = fns::atan2(d.cross(self.to_sun).length(), cos_gamma);
        [0, 1, 2].map(|channel| {
            let c = &self.coefficients[9 * channel..9 * channel + 9];
            let x = 1.0 + c[8] * c[8] - 2.0 * c[8] * cos_gamma;
            let mie = (1.0 + cos_gamma * cos_gamma) / (x * x.sqrt());
            let gradient = 1.0 + c[0] * fns::exp(c[1] / (d.z + 0.01));
            let around_sun = c[2] + c[3] * fns::exp(c[4] * gamma) + c[5] * cos_gamma * cos_gamma + c[6] * mie + c[7] * d.z.sqrt();
            (gradient * around_sun * self.radiance[channel] * UNIT).max(0.0)
        })
    }

    /// The map of an [`EnvironmentLight`] whose +y is the model's +z and whose −z is the model's +y.
    fn texels(&self, (width, height): (usize, usize)) -> Vec<[f32; 3]> {
        let mut texels = vec![[0.0; 3]; width * height];
        texels.par_chunks_exact_mut(width).enumerate().for_each(|(y, row)| {
            let (sin_theta, cos_theta) = fns::sin_cos(PI * (y as f32 + 0.5) / height as f32);
            if cos_theta < 0.0 {
                return;
            }
            for (x, texel) in row.iter_mut().enumerate() {
                let (sin_phi, cos_phi) = fns::sin_cos(TAU * ((x as f32 + 0.5) / width as f32 - 0.5));
                *texel = self.radiance(Vec3::new(sin_theta * sin_phi, sin_theta * cos_phi, cos_theta));
            }
        });
        texels
    }
}
