//! Lights (KHR_lights_punctual) and cameras.

use glam::{DMat4, DVec3, Mat4, Vec3};

use super::Reader;
use crate::desc::{AddNode, CameraDesc, FovAxis, LightDesc, Node, ProjectionDesc, SpotFalloff};
use crate::formats::gltf::LUMENS_PER_WATT;
use crate::formats::gltf::json::{EMPTY, Value};

/// Height of the picture in pixels where a camera tells its proportions; the width follows.
const FILM_HEIGHT: f32 = 720.0;

/// A transform without its scale.
fn rigid(m: &DMat4) -> Mat4 {
    let axis = |v: DVec3, or: DVec3| v.normalize_or(or);
    let z = axis(m.z_axis.truncate(), DVec3::Z);
    let x = axis(m.x_axis.truncate(), DVec3::X);
    // Gram–Schmidt, in case that the parents shear.
    let y = axis(m.y_axis.truncate() - z * z.dot(m.y_axis.truncate()), z.cross(x));
    let x = if y.cross(z).dot(x) < 0.0 { -y.cross(z) } else { y.cross(z) };
    let rigid = DMat4::from_cols(x.extend(0.0), y.extend(0.0), z.extend(0.0), m.w_axis);
    // Rounding is left alone, so that writing and reading again changes nothing.
    if rigid.abs_diff_eq(*m, 1e-6) { m.as_mat4() } else { rigid.as_mat4() }
}

impl<'a> Reader<'a> {
    /// The light of a node.
    pub(super) fn light(&mut self, node: &'a Value<'a>, world: &DMat4) {
        let Some(reference) = self.extension(node, "KHR_lights_punctual") else { return };
        let Some(index) = self.required(reference, "light").and_then(|v| self.integer_of(v)) else { return };
        let lights = self.extension(self.root, "KHR_lights_punctual").map_or(&[][..], |e| self.array(e, "lights"));
        let Some(light) = usize::try_from(index).ok().and_then(|i| lights.get(i)) else {
            self.error(reference, format!("light {index} is out of range: there are {}", lights.len()));
            return;
        };
        let color = self.color(light, "color", [1.0; 3]);
        let intensity = self.float_in(light, "intensity", 1.0, [0.0, f32::MAX]) / LUMENS_PER_WATT;
        let power = color.map(|c| (c * intensity).min(f32::MAX));
        let world_from_light = rigid(world);
        let position = world_from_light.w_axis.truncate();
        let desc = match self.string(light, "type") {
            Some("point") => LightDesc::Point { position, intensity: power },
            Some("directional") => {
                LightDesc::Directional { direction: world_from_light.transform_vector3(-Vec3::Z).normalize(), irradiance: power }
            }
            Some("spot") => {
                let spot = self.object(light, "spot").unwrap_or(&EMPTY);
                let outer = self.float_in(spot, "outerConeAngle", std::f32::consts::FRAC_PI_4, [1e-3, std::f32::consts::FRAC_PI_2]);
                let inner = self.float_in(spot, "innerConeAngle", 0.0, [0.0, std::f32::consts::FRAC_PI_2]).min(outer);
                LightDesc::Spot {
                    world_from_light,
                    intensity: power,
                    outer_rad: outer,
                    inner_rad: inner,
                    falloff: SpotFalloff::CosineSquared,
                    texture: None,
                }
            }
            other => {
                let kind = other.unwrap_or("").to_owned();
                self.error(light, format!("a light of unknown type `{kind}`"));
                return;
            }
        };
        if let Some(range) = light.get("range") {
            self.loss(range, "light range", "ignored: light falls off with the square of the distance");
        }
        let name = self.string(light, "name").or_else(|| self.string(node, "name")).unwrap_or_default();
        self.desc.add(Node::named(name, self.span(light), desc));
    }

    /// The camera of a node.
    pub(super) fn camera(&mut self, node: &'a Value<'a>, world: &DMat4) {
        let Some((_, camera)) = self.reference(node, "camera", "cameras") else { return };
        let Some(kind) = self.required(camera, "type").and_then(|_| self.string(camera, "type")) else { return };
        let Some(lens) = self.required(camera, kind).and_then(|_| self.object(camera, kind)) else { return };
        let near = self.float(lens, "znear", 0.0).max(0.0);
        // Without zfar the projection is infinite.
        let far = self.float(lens, "zfar", f32::MAX);
        let (projection, aspect) = match kind {
            "perspective" => {
                self.required(lens, "yfov");
                let fov_rad = self.float(lens, "yfov", 1.0);
                if !(fov_rad > 0.0 && fov_rad < std::f32::consts::PI) {
                    self.error(lens, format!("yfov must be between 0 and π, not {fov_rad}"));
                    return;
                }
                let projection = ProjectionDesc::Perspective {
                    fov_rad,
                    fov_axis: FovAxis::Y,
                    aperture_radius: 0.0,
                    focus_distance: 1.0,
                    principal_point_offset: [0.0; 2],
                };
                (projection, self.float_opt(lens, "aspectRatio"))
            }
            "orthographic" => {
                let [x, y] = ["xmag", "ymag"].map(|key| {
                    self.required(lens, key);
                    self.float(lens, key, 1.0).abs()
                });
                if x == 0.0 || y == 0.0 {
                    self.error(lens, "xmag and ymag must not be 0");
                    return;
                }
                (ProjectionDesc::Orthographic { half_width: x, half_height: Some(y) }, Some(x / y))
            }
            _ => {
                self.error(camera, format!("a camera of unknown type `{kind}`"));
                return;
            }
        };
        if far <= near {
            self.error(lens, "zfar must be beyond znear");
            return;
        }
        // The picture's proportions are those of the first camera.
        if let Some(aspect) = aspect.filter(|a| *a > 0.0 && self.desc.cameras.is_empty()) {
            let height = FILM_HEIGHT.min(8192.0 / aspect);
            self.desc.film.width = Some((height * aspect).round().clamp(1.0, 8192.0) as u32);
            self.desc.film.height = Some(height.round().max(1.0) as u32);
        }
        let name = self.string(camera, "name").or_else(|| self.string(node, "name")).unwrap_or_default();
        let desc = CameraDesc { world_from_camera: rigid(world), projection, near, far, medium: None };
        self.desc.add(Node::named(name, self.span(camera), desc));
    }
}
