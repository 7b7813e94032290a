//! Lights that are no shapes.

use glam::{Mat4, Vec3};

use super::Builder;
use super::props::Props;
use crate::desc::{AddNode, EnvironmentMapping, LightDesc, Node, SpotFalloff, SunSkyDesc};
use crate::formats::mitsuba::tree::Plugin;
use crate::formats::spectrum::Quantity;

/// Half a turn about +y: Mitsuba's lights look along +z, ours along −z.
pub(super) const HALF_TURN: Mat4 = Mat4::from_cols_array(&[-1., 0., 0., 0., 0., 1., 0., 0., 0., 0., -1., 0., 0., 0., 0., 1.]);

impl<'t> Builder<'t> {
    /// Adds a light of the scene.
    pub(super) fn emitter(&mut self, plugin: &'t Plugin) {
        if !self.is_known(plugin) {
            return;
        }
        let mut p = Props::new(plugin);
        p.ignore(&["sampling_weight"]);
        let light = match plugin.type_name.as_str() {
            "point" => {
                let to_world = p.transform("to_world");
                let position = p.opt_vector("position").unwrap_or_else(|| to_world.transform_point3(Vec3::ZERO));
                Some(LightDesc::Point { position, intensity: self.power(&mut p, "intensity") })
            }
            "spot" => {
                let outer = p.positive("cutoff_angle", 20.0);
                let inner = p.float("beam_width", outer * 0.75).clamp(0.0, outer);
                Some(LightDesc::Spot {
                    world_from_light: p.transform("to_world") * HALF_TURN,
                    intensity: self.power(&mut p, "intensity"),
                    outer_rad: outer.to_radians(),
                    inner_rad: inner.to_radians(),
                    falloff: SpotFalloff::Linear,
                    texture: match p.get("texture").and_then(|q| self.resolve(q)) {
                        Some(texture) => self.texture_id(texture),
                        None => None,
                    },
                })
            }
            "directional" => {
                let to_world = p.transform("to_world");
                let direction = p.opt_vector("direction").unwrap_or_else(|| to_world.transform_vector3(Vec3::Z));
                let irradiance = self.power(&mut p, "irradiance");
                match direction.try_normalize() {
                    Some(direction) => Some(LightDesc::Directional { direction, irradiance }),
                    None => {
                        p.fault(plugin.span, "`direction` must not be zero");
                        None
                    }
                }
            }
            "constant" => {
                p.ignore(&["to_world"]);
                let scale = p.float("scale", 1.0);
                Some(LightDesc::Constant { radiance: self.power(&mut p, "radiance").map(|v| v * scale) })
            }
            "envmap" => {
                let scale = p.float("scale", 1.0);
                let world_from_light = p.transform("to_world") * HALF_TURN;
                p.ignore(&["mis_compensation", "cache"]);
                p.lose(&["gamma"]);
                self.image(&mut p).map(|image| LightDesc::Environment {
                    image,
                    scale: [scale; 3],
                    world_from_light,
                    mapping: EnvironmentMapping::EquirectangularOnPoles,
                    portal: None,
                })
            }
            "sunsky" | "sky" | "sun" => self.sun_sky(&mut p),
            "area" => {
                p.ignore_all();
                self.desc.report.error(plugin.span, "emitter \"area\" belongs inside a shape");
                None
            }
            _ => {
                self.lose(plugin, "left out");
                p.ignore_all();
                None
            }
        };
        self.finish(p);
        if let Some(light) = light {
            self.desc.add(Node::named(&plugin.id, plugin.span, light));
        }
    }

    /// An amount of light; 1 where it is missing, as in Mitsuba.
    fn power(&mut self, p: &mut Props<'t>, name: &'static str) -> [f32; 3] {
        self.constant_color(p, name, Quantity::Emission, [1.0; 3])
    }

    fn sun_sky(&mut self, p: &mut Props<'t>) -> Option<LightDesc> {
        let kind = p.plugin.type_name.as_str();
        // 0.x, whose models have +y to the zenith, is upgraded with this mark.
        let y_up = p.bool("y_up", false);
        let albedo = self.constant_color(p, "albedo", Quantity::Reflectance, if y_up { [0.15; 3] } else { [0.3; 3] });
        let scale = p.float("scale", 1.0);
        let aperture = p.positive("sun_aperture", 0.5358) * p.float("sun_radius_scale", 1.0);
        p.lose(&["stretch", "extend"]);
        p.ignore(&["resolution", "sun_samples_fraction", "complex_sun"]);
        let sun_direction = match p.opt_vector("sun_direction") {
            Some(direction) => {
                let direction = if y_up { Vec3::new(direction.x, -direction.z, direction.y) } else { direction };
                p.ignore(&["latitude", "longitude", "timezone", "year", "month", "day", "hour", "minute", "second"]);
                match direction.try_normalize() {
                    Some(direction) => direction,
                    None => {
                        p.fault_at("sun_direction", "`sun_direction` must not be zero");
                        Vec3::Z
                    }
                }
            }
            None => sun_direction(p),
        };
        let turn = if y_up { Mat4::from_rotation_x(-std::f32::consts::FRAC_PI_2) } else { Mat4::IDENTITY };
        Some(LightDesc::SunSky(Box::new(SunSkyDesc {
            sky: kind != "sun",
            sun: kind != "sky",
            sun_direction,
            turbidity: p.float("turbidity", 3.0).clamp(1.0, 10.0),
            albedo,
            sky_scale: p.float("sky_scale", scale),
            sun_scale: p.float("sun_scale", scale),
            sun_half_angle_rad: aperture.max(0.0).to_radians() * 0.5,
            world_from_light: p.transform("to_world") * turn,
        })))
    }
}

/// Direction to the sun at a place and time; the defaults are Mitsuba's (Tokyo, 10 July 2010, 15:00). +x is south, +y west, +z up.
///
/// Low-precision formulas of the Astronomical Almanac (Michalsky 1988, Solar Energy 40(3), doi:10.1016/0038-092X(88)90045-X): good to about
/// 0.01 degrees between 1950 and 2050.
fn sun_direction(p: &mut Props) -> Vec3 {
    let latitude = f64::from(p.float("latitude", 35.689_4)).to_radians();
    let longitude = f64::from(p.float("longitude", 139.691_7));
    let timezone = f64::from(p.float("timezone", 9.0));
    let year = p.opt_int("year").unwrap_or(2010).clamp(1900, 2100);
    let month = p.opt_int("month").unwrap_or(7).clamp(1, 12);
    let day = p.opt_int("day").unwrap_or(10).clamp(1, 31);
    let hours = f64::from(p.float("hour", 15.0)) + f64::from(p.float("minute", 0.0)) / 60.0 + f64::from(p.float("second", 0.0)) / 3600.0;
    // Days since noon of 1 January 2000, universal time (Fliegel and van Flandern 1968).
    let a = (14 - month) / 12;
    let (y, m) = (year + 4800 - a, month + 12 * a - 3);
    let julian_day = day + (153 * m + 2) / 5 + 365 * y + y / 4 - y / 100 + y / 400 - 32045;
    let n = (julian_day - 2_451_545) as f64 - 0.5 + (hours - timezone) / 24.0;
    let mean_longitude = 280.460 + 0.985_647_4 * n;
    let anomaly = (357.528 + 0.985_600_3 * n).to_radians();
    let ecliptic = (mean_longitude + 1.915 * anomaly.sin() + 0.020 * (2.0 * anomaly).sin()).to_radians();
    let obliquity = (23.439 - 4e-7 * n).to_radians();
    let right_ascension = (obliquity.cos() * ecliptic.sin()).atan2(ecliptic.cos());
    let declination = (obliquity.sin() * ecliptic.sin()).asin();
    let sidereal_degrees = (18.697_374_558 + 24.065_709_824_419_08 * n) * 15.0 + longitude;
    let hour_angle = sidereal_degrees.to_radians() - right_ascension;
    let up = latitude.sin() * declination.sin() + latitude.cos() * declination.cos() * hour_angle.cos();
    let west = declination.cos() * hour_angle.sin();
    let south = latitude.sin() * declination.cos() * hour_angle.cos() - latitude.cos() * declination.sin();
    Vec3::new(south as f32, west as f32, up as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::mitsuba::tree::Kind;
    use crate::span::Span;

    /// The expected direction is Mitsuba 3.9's for its default place and time.
    #[test]
    fn the_sun_stands_where_mitsuba_puts_it() {
        let plugin = Plugin { kind: Kind::Emitter, type_name: "sunsky".into(), id: String::new(), span: Span::default(), params: vec![] };
        let direction = sun_direction(&mut Props::new(&plugin));
        assert!(direction.abs_diff_eq(Vec3::new(0.0513854, 0.691748, 0.720308), 2e-3), "{direction}");
    }
}
