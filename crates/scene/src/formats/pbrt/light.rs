//! Lights that are no shapes.

use glam::{DMat4, DVec3, Mat4, Vec3};

use super::Reader;
use super::angles::sin_cos;
use super::params::Params;
use super::spectrum::SpectrumKind;
use crate::desc::{
    AddNode, BitmapDesc, Channel, Encoding, EnvironmentMapping, LightDesc, Node, SpotFalloff, TextureDesc, TextureFilter, Wrap,
};

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
        p.ignore(&["portal"]);
        if p.has("portal") {
            r.loss(p.span, "portal of an infinite light", "ignored");
        }
        let light = match name {
            "point" | "goniometric" => {
                if name == "goniometric" {
                    p.ignore(&["filename"]);
                    self.loss(p.span, "LightSource \"goniometric\"", "a point light of the same intensity all round");
                }
                let scale = power.map_or(scale, |w| scale * w / (4.0 * std::f32::consts::PI));
                let intensity = self.radiance(p, "I", scale);
                Some(LightDesc::Point { position: point(from).as_vec3(), intensity })
            }
            "spot" | "projection" => self.spot(name, p, scale, power, from, to),
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

    fn spot(&mut self, name: &str, p: &Params, scale: f32, power: Option<f32>, from: Vec3, to: Vec3) -> Option<LightDesc> {
        let projection = name == "projection";
        let r = &mut self.desc.report;
        let transform = self.state.transform();
        let (angle, delta) = if projection {
            (0.5 * p.float("fov", 90.0, r), 0.0)
        } else {
            (p.float("coneangle", 30.0, r), p.float("conedeltaangle", 5.0, r))
        };
        if !(angle > 0.0 && angle <= 180.0) {
            r.error(p.span, format!("a cone's angle must lie between 0 and 180 degrees, not {angle}"));
            return None;
        }
        let outer_rad = angle.to_radians();
        let inner_rad = (angle - delta).clamp(0.0, angle).to_radians();
        let mut texture = None;
        if projection {
            self.loss(p.span, "LightSource \"projection\"", "a spot light with the picture in its cone");
            let file = p.opt_text("filename", &mut self.desc.report).map(str::to_owned);
            if let Some(image) = file.and_then(|f| self.image(&f, p.span)) {
                let bitmap = BitmapDesc {
                    image,
                    encoding: Encoding::Auto,
                    wrap: [Wrap::Clamp; 2],
                    filter: TextureFilter::Bilinear,
                    picture_from_uv: glam::Mat3::IDENTITY,
                    channel: Channel::Luminance,
                    uv_set: 0,
                };
                texture = Some(self.desc.add(Node::new(p.span, TextureDesc::Bitmap(bitmap))));
            }
        }
        // Its flux per intensity: full within the inner cone, half on average between the two.
        let (ci, co) = (sin_cos(inner_rad).1, sin_cos(outer_rad).1);
        let flux = std::f32::consts::TAU * ((1.0 - ci) + 0.5 * (ci - co));
        let scale = power.map_or(scale, |w| scale * w / flux);
        let (o, d) = if projection { (DVec3::ZERO, DVec3::Z) } else { (from.as_dvec3(), (to - from).as_dvec3()) };
        let Some(axis) = d.try_normalize() else {
            self.error(p.span, "`from` and `to` must differ");
            return None;
        };
        // Ours shines along −z.
        let turn = glam::DQuat::from_rotation_arc(DVec3::NEG_Z, axis);
        let world_from_light = (transform * DMat4::from_rotation_translation(turn, o)).as_mat4();
        let intensity = self.radiance(p, "I", scale);
        Some(LightDesc::Spot { world_from_light, intensity, outer_rad, inner_rad, falloff: SpotFalloff::Smoothstep, texture })
    }

    fn infinite(&mut self, p: &Params, scale: f32) -> Option<LightDesc> {
        let r = &mut self.desc.report;
        let illuminance = p.opt_float("illuminance", r).filter(|v| *v > 0.0);
        let Some(name) = p.opt_text("filename", r).map(str::to_owned) else {
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
        Some(LightDesc::Environment { image, scale: [scale; 3], world_from_light, mapping: EnvironmentMapping::EqualAreaSquare })
    }
}

/// The transform without its translation, which means nothing to directions.
fn turned(m: Mat4) -> Mat4 {
    Mat4::from_mat3(glam::Mat3::from_mat4(m))
}
