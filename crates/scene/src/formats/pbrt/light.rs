//! Lights that are no shapes.

use glam::{DMat4, DVec3, DVec4, Mat4, Vec3};

use super::Reader;
use super::angles::sin_cos;
use super::params::Params;
use super::spectrum::SpectrumKind;
use crate::desc::{AddNode, EnvironmentMapping, LightDesc, Node, PictureMapping, SpotFalloff};

impl Reader {
    /// `LightSource`
    pub(super) fn light(&mut self, name: &str, p: &Params) {
        self.check_motion(p.span);
        let transform = self.state.transform();
        let point = |v: Vec3| transform.transform_point3(v.as_dvec3());
        let r = &mut self.desc.report;
        let scale = p.float("scale", 1.0, r);
        let power = p.opt_float("power", r).filter(|v| *v > 0.0);
        let from = p.vector("from", Vec3::ZERO, r);
        let to = p.vector("to", Vec3::Z, r);
        let light = match name {
            "goniometric" if p.has("filename") => {
                // The map's middle is +y, as the format turns it.
                let swap = DMat4::from_cols(DVec4::X, DVec4::Z, DVec4::Y, DVec4::W);
                let intensity = self.radiance(p, "I", scale);
                self.picture(p, transform * swap, intensity, power, PictureMapping::EqualAreaSquare)
            }
            "projection" => {
                let fov = p.float("fov", 90.0, r);
                if !(fov > 0.0 && fov < 180.0) {
                    r.error(p.span, format!("`fov` must lie between 0 and 180 degrees, not {fov}"));
                }
                if !p.has("filename") {
                    r.error(p.span, "a projection needs a `filename`");
                }
                self.picture(p, transform, [scale; 3], power, PictureMapping::Perspective { fov_rad: fov.to_radians() })
            }
            "point" | "goniometric" => {
                let scale = power.map_or(scale, |w| scale * w / (4.0 * std::f32::consts::PI));
                let intensity = self.radiance(p, "I", scale);
                Some(LightDesc::Point { position: point(from).as_vec3(), intensity })
            }
            "spot" => self.spot(p, scale, power, from, to),
            "distant" => {
                let scale = p.opt_float("illuminance", &mut self.desc.report).filter(|v| *v > 0.0).map_or(scale, |e| scale * e);
                let direction = transform.transform_vector3((to - from).as_dvec3()).try_normalize();
                let irradiance = self.radiance(p, "L", scale);
                match direction {
                    Some(d) => Some(LightDesc::Directional { direction: d.as_vec3(), irradiance }),
                    None => {
                        self.error(p.span, "`from` and `to` must differ");
                        None
                    }
                }
            }
            "infinite" => self.infinite(p, scale),
            _ => {
                self.error(p.span, format!("no light `{name}`; there are point, spot, projection, goniometric, distant, infinite"));
                None
            }
        };
        if let Some(light) = light {
            self.desc.add(Node::named(name, p.span, light));
        }
    }

    /// A light's color times its scale.
    fn radiance(&mut self, p: &Params, name: &str, scale: f32) -> [f32; 3] {
        p.get(name).and_then(|q| self.color(q, SpectrumKind::Illuminant)).unwrap_or([1.0; 3]).map(|v| v * scale)
    }

    fn picture(
        &mut self,
        p: &Params,
        world_from_light: DMat4,
        intensity: [f32; 3],
        power: Option<f32>,
        mapping: PictureMapping,
    ) -> Option<LightDesc> {
        let q = p.get("filename")?;
        let image = self.image(q.text().unwrap_or_default(), q.span)?;
        // Lights of no power at all are dark.
        let power = power.filter(|_| intensity != [0.0; 3]);
        Some(LightDesc::Picture { world_from_light: world_from_light.as_mat4(), intensity, power, image, mapping })
    }

    fn spot(&mut self, p: &Params, scale: f32, power: Option<f32>, from: Vec3, to: Vec3) -> Option<LightDesc> {
        let r = &mut self.desc.report;
        let transform = self.state.transform();
        let (angle, delta) = (p.float("coneangle", 30.0, r), p.float("conedeltaangle", 5.0, r));
        if !(angle > 0.0 && angle <= 180.0) {
            r.error(p.span, format!("a cone's angle must lie between 0 and 180 degrees, not {angle}"));
            return None;
        }
        let outer_rad = angle.to_radians();
        let inner_rad = (angle - delta).clamp(0.0, angle).to_radians();
        // Its flux per intensity: full within the inner cone, half on average between the two.
        let (ci, co) = (sin_cos(inner_rad).1, sin_cos(outer_rad).1);
        let flux = std::f32::consts::TAU * ((1.0 - ci) + 0.5 * (ci - co));
        let scale = power.map_or(scale, |w| scale * w / flux);
        let Some(axis) = (to - from).as_dvec3().try_normalize() else {
            self.error(p.span, "`from` and `to` must differ");
            return None;
        };
        // Ours shines along −z.
        let turn = glam::DQuat::from_rotation_arc(DVec3::NEG_Z, axis);
        let world_from_light = (transform * DMat4::from_rotation_translation(turn, from.as_dvec3())).as_mat4();
        let intensity = self.radiance(p, "I", scale);
        Some(LightDesc::Spot { world_from_light, intensity, outer_rad, inner_rad, falloff: SpotFalloff::Smoothstep, texture: None })
    }

    fn infinite(&mut self, p: &Params, scale: f32) -> Option<LightDesc> {
        let r = &mut self.desc.report;
        let illuminance = p.opt_float("illuminance", r).filter(|v| *v > 0.0);
        let portal = self.portal(p)?;
        let r = &mut self.desc.report;
        let Some(name) = p.opt_text("filename", r).map(str::to_owned) else {
            if portal.is_some() {
                r.error(p.span, "a `portal` needs a picture: `filename`");
            }
            // The same radiance from everywhere gives π times it.
            let scale = illuminance.map_or(scale, |e| scale * e / std::f32::consts::PI);
            return Some(LightDesc::Constant { radiance: self.radiance(p, "L", scale) });
        };
        if p.has("L") {
            self.error(p.span, "an infinite light has `L` or `filename`, not both");
        }
        p.ignore(&["L"]);
        if illuminance.is_some() {
            self.loss(p.span, "illuminance of an environment map", "the map's own radiance");
        }
        let span = p.get("filename").map_or(p.span, |q| q.span);
        let image = self.image(&name, span)?;
        let world_from_light = turned(self.state.transform().as_mat4());
        Some(LightDesc::Environment { image, scale: [scale; 3], world_from_light, mapping: EnvironmentMapping::EqualAreaSquare, portal })
    }

    /// The `portal` of an infinite light, in the world whatever the transform; `None` with a fault where it has not four corners.
    fn portal(&mut self, p: &Params) -> Option<Option<[Vec3; 4]>> {
        let Some(q) = p.get("portal") else { return Some(None) };
        let span = q.span;
        let corners = p.vectors("portal", &mut self.desc.report);
        let found = <[Vec3; 4]>::try_from(corners);
        if found.is_err() {
            self.error(span, "a `portal` has four points");
        }
        found.ok().map(Some)
    }
}

/// The transform without its translation, which means nothing to directions.
fn turned(m: Mat4) -> Mat4 {
    Mat4::from_mat3(glam::Mat3::from_mat4(m))
}
