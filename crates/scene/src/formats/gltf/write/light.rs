//! Lights and cameras.

use glam::{Mat4, Quat, Vec3};
use serde_json::{Value, json};

use super::Writer;
use crate::desc::{FovAxis, LightDesc, ProjectionDesc, SpotFalloff};
use crate::formats::gltf::LUMENS_PER_WATT;

/// Width over height where the scene does not say it.
const DEFAULT_ASPECT: f32 = 4.0 / 3.0;

/// Intensity in candela or lux, and the color.
fn photometric(watts: [f32; 3]) -> (f32, [f32; 3]) {
    let max = watts.into_iter().fold(0.0f32, f32::max);
    if max > 0.0 { (max * LUMENS_PER_WATT, watts.map(|w| (w / max).max(0.0))) } else { (0.0, [1.0; 3]) }
}

impl Writer<'_> {
    pub(super) fn write_lights(&mut self, roots: &mut Vec<usize>) {
        for node in &self.desc.lights {
            let plain = node.value.without_picture();
            if plain != node.value {
                self.loss(node.span, "picture of a point light", "the light is written without it");
            }
            let (light, transform) = match &plain {
                // Taken apart above.
                LightDesc::Picture { .. } => continue,
                LightDesc::Point { position, intensity } => {
                    let (intensity, color) = photometric(*intensity);
                    (json!({"type": "point", "intensity": intensity, "color": color}), Mat4::from_translation(*position))
                }
                LightDesc::Directional { direction, irradiance } => {
                    let (intensity, color) = photometric(*irradiance);
                    let rotation = Quat::from_rotation_arc(-Vec3::Z, direction.normalize_or(-Vec3::Z));
                    (json!({"type": "directional", "intensity": intensity, "color": color}), Mat4::from_quat(rotation))
                }
                LightDesc::Spot { world_from_light, intensity, outer_rad, inner_rad, falloff, texture } => {
                    if *falloff != SpotFalloff::CosineSquared {
                        self.loss(node.span, "falloff of a spot light", "written with glTF's falloff");
                    }
                    if texture.is_some() {
                        self.loss(node.span, "picture of a spot light", "not written");
                    }
                    let (intensity, color) = photometric(*intensity);
                    let spot = json!({"innerConeAngle": inner_rad, "outerConeAngle": outer_rad});
                    (json!({"type": "spot", "intensity": intensity, "color": color, "spot": spot}), *world_from_light)
                }
                LightDesc::Constant { .. } => {
                    self.loss(node.span, "constant environment", "not written");
                    continue;
                }
                LightDesc::Environment { .. } => {
                    self.loss(node.span, "environment map", "not written");
                    continue;
                }
                LightDesc::SunSky(_) => {
                    self.loss(node.span, "sun and sky", "not written");
                    continue;
                }
            };
            let mut light = light;
            if !node.name.is_empty() {
                light["name"] = json!(node.name);
            }
            self.lights.push(light);
            let reference = json!({"KHR_lights_punctual": {"light": self.lights.len() - 1}});
            let root = self.node(&node.name, transform, "extensions", reference);
            roots.push(root);
        }
    }

    pub(super) fn write_cameras(&mut self, roots: &mut Vec<usize>) {
        let film = &self.desc.film;
        let aspect = match (film.width, film.height) {
            (Some(w), Some(h)) if w > 0 && h > 0 => w as f32 / h as f32,
            _ => DEFAULT_ASPECT,
        };
        for node in &self.desc.cameras {
            let camera = &node.value;
            let projection = camera.projection.without_objective();
            if projection != camera.projection {
                self.loss(node.span, "objective", "a perspective of its field of view");
            }
            let mut lens: Value = match projection {
                ProjectionDesc::Perspective { fov_rad, fov_axis, aperture_radius, principal_point_offset, .. } => {
                    if aperture_radius > 0.0 {
                        self.loss(node.span, "depth of field", "written as a pinhole");
                    }
                    if principal_point_offset != [0.0; 2] {
                        self.loss(node.span, "principal point offset", "not written");
                    }
                    // Edge along which the angle is measured, in units of the height.
                    let edge = match fov_axis {
                        FovAxis::Y => 1.0,
                        FovAxis::X => aspect,
                        FovAxis::Smaller => aspect.min(1.0),
                        FovAxis::Larger => aspect.max(1.0),
                        FovAxis::Diagonal => (aspect * aspect + 1.0).sqrt(),
                    };
                    let yfov = match fov_axis {
                        FovAxis::Y => fov_rad,
                        _ => 2.0 * ((f64::from(fov_rad) / 2.0).tan() / f64::from(edge)).atan() as f32,
                    };
                    json!({"yfov": yfov, "aspectRatio": aspect})
                }
                ProjectionDesc::Orthographic { half_width, half_height } => {
                    json!({"xmag": half_width, "ymag": half_height.unwrap_or(half_width / aspect), "zfar": 1e6})
                }
                ProjectionDesc::Panoramic | ProjectionDesc::Objective(_) => {
                    self.loss(node.span, "panoramic camera", "not written");
                    continue;
                }
            };
            let perspective = matches!(projection, ProjectionDesc::Perspective { .. });
            lens["znear"] = json!(if perspective { camera.near.max(1e-6) } else { camera.near.max(0.0) });
            if camera.far.is_finite() && camera.far < f32::MAX {
                lens["zfar"] = json!(camera.far);
            }
            let kind = if perspective { "perspective" } else { "orthographic" };
            let mut value = json!({"type": kind, kind: lens});
            if !node.name.is_empty() {
                value["name"] = json!(node.name);
            }
            let index = self.push("cameras", value);
            let root = self.node(&node.name, camera.world_from_camera, "camera", json!(index));
            roots.push(root);
        }
    }
}
