//! Participating media.

use glam::{DMat4, DVec3, Mat4, Vec3};

use super::Reader;
use super::cloud::Cloud;
use super::params::Params;
use super::presets;
use super::spectrum::SpectrumKind;
use crate::desc::{
    AddNode, EmissionSource, FieldDesc, GridMediumDesc, MediumDesc, MediumEmissionDesc, MediumId, Node, PhaseDesc, ScatteringDesc,
    VOLUME_LIMIT, VolumeDesc, VolumeFilter, VolumeId, VolumeWrap,
};
use crate::formats::Resolver;
use crate::formats::grids::{self, DenseGrid};
use crate::formats::volume::clamp_negative;
use crate::span::Span;

/// Values of a cloud, and about those of all.
const MOST_OF_CLOUD: u32 = 1 << 20;
const ALL_CLOUDS: u32 = 1 << 24;
/// Parameters that a medium which cannot be read may have.
const OF_OTHERS: [&str; 24] = [
    "sigma_a",
    "sigma_s",
    "g",
    "scale",
    "Le",
    "Lescale",
    "density",
    "nx",
    "ny",
    "nz",
    "p0",
    "p1",
    "filename",
    "wispiness",
    "frequency",
    "temperature",
    "temperatureoffset",
    "temperaturescale",
    "temperaturecutoff",
    "preset",
    "LeScale",
    "majorantgrid",
    "densityscale",
    "gridname",
];

impl Reader {
    /// `MakeNamedMedium "name" "string type" …`
    pub(super) fn make_medium(&mut self, name: &str, p: &Params) {
        let kind = p.opt_text("type", &mut self.desc.report).unwrap_or_default().to_owned();
        let g = p.float("g", 0.0, &mut self.desc.report);
        if !(g > -1.0 && g < 1.0) {
            self.error(p.span, format!("`g` must lie between -1 and 1, not {g}"));
            return;
        }
        let phase = if g == 0.0 { PhaseDesc::Isotropic } else { PhaseDesc::HenyeyGreenstein { g } };
        let medium = match kind.as_str() {
            "homogeneous" => self.homogeneous(p, phase),
            "uniformgrid" => self.uniform_grid(p, phase),
            "rgbgrid" => self.rgb_grid(p, phase),
            "nanovdb" => self.nanovdb(p, phase),
            "cloud" => self.cloud(p, phase),
            _ => {
                self.error(p.span, format!("no medium `{kind}`; there are homogeneous, uniformgrid, rgbgrid, cloud, nanovdb"));
                p.ignore(&OF_OTHERS);
                None
            }
        };
        if let Some(medium) = medium {
            let id = self.desc.add(Node::named(name, p.span, medium));
            self.media.insert(name.to_owned(), id);
        }
    }

    /// Absorption and scattering: a measured medium's, or as given.
    fn coefficients(&mut self, p: &Params, defaults: [[f32; 3]; 2]) -> Option<[[f32; 3]; 2]> {
        let r = &mut self.desc.report;
        let scale = p.float("scale", 1.0, r);
        let preset = p.opt_text("preset", r).map(str::to_owned);
        let measured = preset.as_ref().and_then(|name| presets::find(name));
        if let (Some(preset), None) = (&preset, measured) {
            r.warning(p.span, format!("no measured medium `{preset}`; the coefficients beside it or pbrt's defaults count"));
        }
        let defaults = measured.unwrap_or(defaults);
        let mut get = |name: &str, default: [f32; 3]| {
            let given = if measured.is_some() { p.has(name).then(|| p.ignore(&[name])).and(None) } else { p.get(name) };
            given.and_then(|q| self.color(q, SpectrumKind::Unbounded)).unwrap_or(default).map(|v| v * scale)
        };
        let both = [get("sigma_a", defaults[0]), get("sigma_s", defaults[1])];
        if both.iter().flatten().any(|v| *v < 0.0) {
            self.error(p.span, "coefficients must not be negative");
            return None;
        }
        Some(both)
    }

    /// What the medium's absorption is multiplied by to give its emission; `None` for black.
    fn glow(&mut self, p: &Params) -> Option<[f32; 3]> {
        let given = p.get("Le")?;
        self.color(given, SpectrumKind::Illuminant).filter(|c| *c != [0.0; 3])
    }

    fn homogeneous(&mut self, p: &Params, phase: PhaseDesc) -> Option<MediumDesc> {
        let [sigma_a, sigma_s] = self.coefficients(p, [[0.0011, 0.0024, 0.014], [2.55, 3.21, 3.77]])?;
        let scale = p.float("Lescale", 1.0, &mut self.desc.report);
        let glow = self.glow(p).unwrap_or_default();
        let emission = [0, 1, 2].map(|k| glow[k] * scale * sigma_a[k]);
        Some(MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase })
    }

    /// `uniformgrid`: coefficients times a density.
    fn uniform_grid(&mut self, p: &Params, phase: PhaseDesc) -> Option<MediumDesc> {
        let [sigma_a, sigma_s] = self.coefficients(p, [[1.0; 3]; 2])?;
        let sigma_t = [0, 1, 2].map(|k| sigma_a[k] + sigma_s[k]);
        let albedo = [0, 1, 2].map(|k| if sigma_t[k] > 0.0 { sigma_s[k] / sigma_t[k] } else { 0.0 });
        if !p.has("density") {
            self.error(p.span, "a uniformgrid medium needs `density`");
            p.ignore(&OF_OTHERS);
            return None;
        }
        let density = self.grid(p, "density", 1)?;
        let r = &mut self.desc.report;
        let offset = p.float("temperatureoffset", 0.0, r) + p.float("temperaturecutoff", 0.0, r);
        let kelvin = p.float("temperaturescale", 1.0, r);
        let many = p.floats("Lescale", r).len() > 1;
        let scale = if many { 1.0 } else { p.float("Lescale", 1.0, r) };
        let source = if p.has("temperature") {
            let volume = self.grid(p, "temperature", 1)?;
            if many {
                self.loss(p.span, "`Lescale` values beside a temperature", "a factor of 1");
            }
            let kelvin_field = FieldDesc { factor: [kelvin; 3], volume: Some(volume) };
            Some(EmissionSource::BlackBody { kelvin: kelvin_field, offset: -offset * kelvin, scale })
        } else {
            let volume = if many { Some(self.grid(p, "Lescale", 1)?) } else { None };
            self.glow(p).map(|c| EmissionSource::Field(FieldDesc { factor: c.map(|v| v * scale), volume }))
        };
        Some(MediumDesc::Grid(Box::new(GridMediumDesc {
            extinction: FieldDesc { factor: sigma_t, volume: Some(density) },
            scattering: ScatteringDesc::Albedo(FieldDesc::constant(albedo)),
            emission: source.map(|source| MediumEmissionDesc { source, by_absorption: true }),
            phase,
        })))
    }

    /// `cloud`: coefficients times noise.
    fn cloud(&mut self, p: &Params, phase: PhaseDesc) -> Option<MediumDesc> {
        let [sigma_a, sigma_s] = self.coefficients(p, [[1.0; 3]; 2])?;
        let sigma_t = [0, 1, 2].map(|k| sigma_a[k] + sigma_s[k]);
        let albedo = [0, 1, 2].map(|k| if sigma_t[k] > 0.0 { sigma_s[k] / sigma_t[k] } else { 0.0 });
        let r = &mut self.desc.report;
        let (density, wispiness) = (p.float("density", 1.0, r), p.float("wispiness", 1.0, r));
        let cloud = Cloud { density, wispiness, frequency: p.float("frequency", 5.0, r) };
        let (lo, hi) = self.medium_box(p)?;
        // Many clouds are coarser, so that a short file does not fill the memory.
        let most = (ALL_CLOUDS / (self.desc.volumes.len() as u32).saturating_add(1)).min(MOST_OF_CLOUD);
        let (size, mut data) = cloud.grid(lo, hi, most);
        // Numbers that overflow in the noise are none.
        data.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
        let world_from_volume = self.volume_place(lo, hi);
        // The cloud is cut off at its box.
        let (filter, wrap) = (VolumeFilter::Linear, VolumeWrap::Clamp);
        let volume = self.desc.add(Node::named("cloud", p.span, VolumeDesc { size, channels: 1, data, world_from_volume, filter, wrap }));
        Some(MediumDesc::Grid(Box::new(GridMediumDesc {
            extinction: FieldDesc { factor: sigma_t, volume: Some(volume) },
            scattering: ScatteringDesc::Albedo(FieldDesc::constant(albedo)),
            emission: None,
            phase,
        })))
    }

    /// The box from `p0` to `p1`.
    fn medium_box(&mut self, p: &Params) -> Option<(Vec3, Vec3)> {
        let r = &mut self.desc.report;
        let (p0, p1) = (p.vector("p0", Vec3::ZERO, r), p.vector("p1", Vec3::ONE, r));
        let (lo, hi) = (p0.min(p1), p0.max(p1));
        if !(hi - lo).cmpgt(Vec3::ZERO).all() || !(hi - lo).is_finite() {
            self.error(p.span, "the box from `p0` to `p1` is empty");
            return None;
        }
        Some((lo, hi))
    }

    /// Where the unit cube of a volume over a box is in the world.
    fn volume_place(&self, lo: Vec3, hi: Vec3) -> Mat4 {
        let place = DMat4::from_translation(lo.as_dvec3()) * DMat4::from_scale((hi - lo).as_dvec3());
        (self.state.transform() * place).as_mat4()
    }

    /// `rgbgrid`: coefficients for each value.
    fn rgb_grid(&mut self, p: &Params, phase: PhaseDesc) -> Option<MediumDesc> {
        let scale = p.float("scale", 1.0, &mut self.desc.report);
        let glow_scale = p.float("Lescale", 1.0, &mut self.desc.report);
        if !p.has("sigma_a") && !p.has("sigma_s") {
            self.error(p.span, "an rgbgrid medium needs `sigma_a` or `sigma_s`");
            p.ignore(&OF_OTHERS);
            return None;
        }
        let sigma_a = if p.has("sigma_a") { Some(self.grid(p, "sigma_a", 3)?) } else { None };
        let sigma_s = if p.has("sigma_s") { Some(self.grid(p, "sigma_s", 3)?) } else { None };
        let glow = if p.has("Le") { Some(self.grid(p, "Le", 3)?) } else { None };
        // The extinction's grid is the sum; a coefficient without a grid is 1 everywhere.
        let first = sigma_a.or(sigma_s)?;
        let mut sum = self.desc[first].value.clone();
        match (sigma_a, sigma_s) {
            (Some(_), Some(s)) => {
                for (v, w) in sum.data.iter_mut().zip(&self.desc[s].value.data) {
                    *v += w;
                }
            }
            _ => sum.data.iter_mut().for_each(|v| *v += 1.0),
        }
        let extinction = self.desc.add(Node::new(p.span, sum));
        Some(MediumDesc::Grid(Box::new(GridMediumDesc {
            extinction: FieldDesc { factor: [scale; 3], volume: Some(extinction) },
            scattering: ScatteringDesc::Coefficient(FieldDesc { factor: [scale; 3], volume: sigma_s }),
            emission: glow.map(|volume| MediumEmissionDesc {
                source: EmissionSource::Field(FieldDesc { factor: [glow_scale; 3], volume: Some(volume) }),
                by_absorption: true,
            }),
            phase,
        })))
    }

    /// `nanovdb`: coefficients times the `density` of a file, and the glow of its `temperature`.
    fn nanovdb(&mut self, p: &Params, phase: PhaseDesc) -> Option<MediumDesc> {
        let [sigma_a, sigma_s] = self.coefficients(p, [[1.0; 3]; 2])?;
        let sigma_t = [0, 1, 2].map(|k| sigma_a[k] + sigma_s[k]);
        let albedo = [0, 1, 2].map(|k| if sigma_t[k] > 0.0 { sigma_s[k] / sigma_t[k] } else { 0.0 });
        let r = &mut self.desc.report;
        let offset = p.float("temperatureoffset", 0.0, r) + p.float("temperaturecutoff", 0.0, r);
        let factor = p.float("temperaturescale", 1.0, r);
        let scale = p.float(if p.has("LeScale") { "LeScale" } else { "Lescale" }, 1.0, r);
        let Some(name) = p.opt_text("filename", r).map(str::to_owned) else {
            self.error(p.span, "a nanovdb medium needs `filename`");
            return None;
        };
        let path = self.resolve(&name, p.span)?;
        let bytes = match Resolver::read(&path) {
            Ok(bytes) => bytes,
            Err(e) => {
                self.error(p.span, e.to_string());
                return None;
            }
        };
        let density = match self.nano_grid(&bytes, &name, "density", p.span)? {
            Some(density) => density,
            None => {
                self.error(p.span, format!("`{name}` has no grid `density`"));
                return None;
            }
        };
        let kelvin = self.nano_grid(&bytes, &name, "temperature", p.span)?;
        let emission = kelvin.map(|volume| MediumEmissionDesc {
            source: EmissionSource::BlackBody {
                kelvin: FieldDesc { factor: [factor; 3], volume: Some(volume) },
                offset: -offset * factor,
                scale,
            },
            by_absorption: true,
        });
        Some(MediumDesc::Grid(Box::new(GridMediumDesc {
            extinction: FieldDesc { factor: sigma_t, volume: Some(density) },
            scattering: ScatteringDesc::Albedo(FieldDesc::constant(albedo)),
            emission,
            phase,
        })))
    }

    /// A grid of a NanoVDB or OpenVDB file; the outer `None`, with a fault, where it cannot be read.
    fn nano_grid(&mut self, bytes: &[u8], file: &str, name: &str, span: Span) -> Option<Option<VolumeId>> {
        let DenseGrid { size, mut data, world_from_volume } = match grids::read(bytes, name) {
            Ok(Some(grid)) => grid,
            Ok(None) => return Some(None),
            Err(message) => {
                self.error(span, format!("{file}: {message}"));
                return None;
            }
        };
        let negative = clamp_negative(&mut data);
        if negative > 0 {
            self.desc.report.warning(span, format!("{negative} values of `{name}` are below zero and count as zero"));
        }
        let world_from_volume = (self.state.transform() * world_from_volume).as_mat4();
        let (filter, wrap) = (VolumeFilter::Linear, VolumeWrap::Zero);
        Some(Some(self.desc.add(Node::named(name, span, VolumeDesc { size, channels: 1, data, world_from_volume, filter, wrap }))))
    }

    /// The grid that a parameter gives in the box of `p0` and `p1`.
    fn grid(&mut self, p: &Params, name: &str, channels: u32) -> Option<VolumeId> {
        let r = &mut self.desc.report;
        let size = ["nx", "ny", "nz"].map(|n| p.opt_integer(n, r).unwrap_or(1));
        let given = p.get(name)?;
        let (span, numbers) = (given.span, given.numbers());
        let count = size.iter().map(|n| i128::from(*n)).product::<i128>() * i128::from(channels);
        if size.iter().any(|n| *n < 1) || count > i128::from(VOLUME_LIMIT) || numbers.len() as i128 != count {
            let found = numbers.len();
            self.error(span, format!("`{name}` has {found} numbers, which do not fill nx × ny × nz values of {channels}"));
            return None;
        }
        let (lo, hi) = self.medium_box(p)?;
        let mut data: Vec<f32> = if channels == 3 {
            let space = self.state.color_space;
            let color = |c: &[f64]| space.to_rec709(DVec3::new(c[0], c[1], c[2])).as_vec3().to_array();
            numbers.chunks_exact(3).flat_map(color).collect()
        } else {
            numbers.iter().map(|v| *v as f32).collect()
        };
        let negative = clamp_negative(&mut data);
        if negative > 0 {
            self.desc.report.warning(span, format!("{negative} values of `{name}` are below zero and count as zero"));
        }
        let world_from_volume = self.volume_place(lo, hi);
        let size = size.map(|n| n as u32);
        let (filter, wrap) = (VolumeFilter::Linear, VolumeWrap::Zero);
        Some(self.desc.add(Node::named(name, span, VolumeDesc { size, channels, data, world_from_volume, filter, wrap })))
    }

    /// A medium by name; the empty name is vacuum.
    pub(super) fn named_medium(&mut self, name: &str, span: Span) -> Option<MediumId> {
        if name.is_empty() {
            return None;
        }
        let found = self.media.get(name).copied();
        if found.is_none() {
            self.desc.report.warning(span, format!("no medium `{name}` that can be rendered; vacuum in its place"));
        }
        found
    }
}
