//! Participating media.

use super::Builder;
use super::props::Props;
use crate::desc::{
    AddNode, FieldDesc, GridMediumDesc, MediumDesc, MediumId, Node, PhaseDesc, ScatteringDesc, VolumeDesc, VolumeFilter, VolumeId,
    VolumeWrap,
};
use crate::formats::Resolver;
use crate::formats::grids::{self, DenseGrid};
use crate::formats::mitsuba::tree::{Kind, Plugin, Value};
use crate::formats::spectrum::Quantity;
use crate::formats::volume::{VolFile, clamp_negative};

impl<'t> Builder<'t> {
    /// A medium; `None`, with a fault or a loss, where it cannot be built.
    pub(super) fn medium(&mut self, plugin: &'t Plugin) -> Option<MediumId> {
        let key: *const Plugin = plugin;
        if let Some(built) = self.media.get(&key) {
            return *built;
        }
        let built = self.guarded(plugin, |b| b.build_medium(plugin));
        self.media.insert(key, built);
        built
    }

    fn build_medium(&mut self, plugin: &'t Plugin) -> Option<MediumId> {
        if !self.is_known(plugin) {
            return None;
        }
        if !["homogeneous", "heterogeneous"].contains(&plugin.type_name.as_str()) {
            self.lose(plugin, "left out");
            return None;
        }
        let mut p = Props::new(plugin);
        let scale = p.float("scale", 1.0);
        p.ignore(&["has_spectral_extinction", "sample_emitters", "strategy", "medium_sampling_weight", "method", "max_density"]);
        if let Some(material) = p.get("material") {
            self.desc.report.loss(material.span, "`material` of a medium", "the default coefficients in its place");
        }
        // Media of Mitsuba 0.6 call the extinction density.
        let extinction = if p.has("density") && !p.has("sigma_t") { "density" } else { "sigma_t" };
        let [sigma_a, sigma_s] = if p.has("sigma_a") || p.has("sigma_s") {
            ["sigma_a", "sigma_s"].map(|name| self.coefficient(&mut p, name, 0.0))
        } else {
            let sigma_t = self.field(&mut p, extinction, 1.0);
            let albedo = self.field(&mut p, "albedo", 0.75);
            if sigma_t.volume.is_some() || albedo.volume.is_some() {
                return self.grid_medium(plugin, p, sigma_t, albedo, scale);
            }
            let product = |f: fn(f32) -> f32| [0, 1, 2].map(|i| sigma_t.factor[i] * f(albedo.factor[i]));
            [product(|a| 1.0 - a), product(|a| a)]
        };
        let emission = self.coefficient(&mut p, "emission", 0.0);
        let phase = self.phase_of(&mut p);
        if sigma_a.iter().chain(&sigma_s).any(|v| *v < 0.0) {
            p.fault(plugin.span, "coefficients must not be negative, nor an albedo above 1");
        }
        self.finish(p);
        let [sigma_a, sigma_s] = [sigma_a, sigma_s].map(|c| c.map(|v| v * scale));
        Some(self.desc.add(Node::named(&plugin.id, plugin.span, MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase })))
    }

    fn grid_medium(
        &mut self,
        plugin: &'t Plugin,
        mut p: Props<'t>,
        mut extinction: FieldDesc,
        albedo: FieldDesc,
        scale: f32,
    ) -> Option<MediumId> {
        extinction.factor = extinction.factor.map(|v| v * scale);
        let phase = self.phase_of(&mut p);
        self.finish(p);
        let grid = GridMediumDesc { extinction, scattering: ScatteringDesc::Albedo(albedo), emission: None, phase };
        Some(self.desc.add(Node::named(&plugin.id, plugin.span, MediumDesc::Grid(Box::new(grid)))))
    }

    /// A coefficient that is the same everywhere.
    fn coefficient(&mut self, p: &mut Props<'t>, name: &'static str, default: f32) -> [f32; 3] {
        let field = self.field(p, name, default);
        if field.volume.is_some() {
            p.fault_at(
                name,
                format!("`{name}` of this medium must be the same everywhere; heterogeneous media take `sigma_t` and `albedo`"),
            );
        }
        field.factor
    }

    /// A number, color, spectrum or volume.
    fn field(&mut self, p: &mut Props<'t>, name: &'static str, default: f32) -> FieldDesc {
        let volume = p.plugin.params.iter().find(|q| q.name == name && self.kind_of(q) == Some(Kind::Volume));
        let Some(property) = volume else {
            return FieldDesc::constant(self.constant_color(p, name, Quantity::Reflectance, [default; 3]));
        };
        p.ignore(&[name]);
        match self.resolve(property) {
            Some(volume) if volume.type_name == "constvolume" => {
                let mut q = Props::new(volume);
                let value = self.constant_color(&mut q, "value", Quantity::Reflectance, [default; 3]);
                q.ignore(&["to_world"]);
                self.finish(q);
                FieldDesc::constant(value)
            }
            Some(volume) if volume.type_name == "gridvolume" => {
                let key: *const Plugin = volume;
                let built = match self.volumes.get(&key) {
                    Some(built) => *built,
                    None => {
                        let built = self.grid_volume(volume);
                        self.volumes.insert(key, built);
                        built
                    }
                };
                FieldDesc { factor: [1.0; 3], volume: built }
            }
            Some(volume) => {
                self.lose(volume, "a constant in its place");
                FieldDesc::constant([default; 3])
            }
            None => FieldDesc::constant([default; 3]),
        }
    }

    fn grid_volume(&mut self, plugin: &'t Plugin) -> Option<VolumeId> {
        let mut p = Props::new(plugin);
        let filters = [("trilinear", VolumeFilter::Linear), ("nearest", VolumeFilter::Nearest)];
        let filter = p.choice("filter_type", &filters, VolumeFilter::Linear);
        let wraps = [("clamp", VolumeWrap::Clamp), ("repeat", VolumeWrap::Repeat), ("mirror", VolumeWrap::Mirror)];
        let wrap = p.choice("wrap_mode", &wraps, VolumeWrap::Clamp);
        let to_world = p.transform("to_world");
        let use_box = p.bool("use_grid_bbox", false);
        p.ignore(&["raw", "accel", "max_value"]);
        if p.has("grid") || p.has("data") {
            p.lose(&["grid", "data"]);
        }
        let path = self.filename(&mut p);
        let grid_name = p.opt_text("grid_name").unwrap_or("density");
        self.finish(p);
        let path = path?;
        let file = Resolver::read(&path).map_err(|e| e.to_string()).and_then(|bytes| {
            // Sparse grids are placed by their files; `to_world` moves them on.
            if grids::is_sparse(&bytes) {
                let grid = grids::read(&bytes, grid_name).and_then(|grid| grid.ok_or_else(|| format!("there is no grid `{grid_name}`")));
                let DenseGrid { size, data, world_from_volume } = grid.map_err(|e| format!("{}: {e}", path.display()))?;
                return Ok((size, 1, data, (to_world.as_dmat4() * world_from_volume).as_mat4()));
            }
            let file = VolFile::parse(&bytes).map_err(|e| format!("{}: {e}", path.display()))?;
            let world_from_volume = if use_box { to_world * file.box_transform() } else { to_world };
            Ok((file.size, file.channels, file.data, world_from_volume))
        });
        let (size, channels, mut data, world_from_volume) = file.map_err(|e| self.desc.report.error(plugin.span, e)).ok()?;
        if ![1, 3].contains(&channels) {
            self.desc.report.error(plugin.span, format!("a volume of {channels} numbers per value; only 1 and 3 can be rendered"));
            return None;
        }
        let negative = clamp_negative(&mut data);
        if negative > 0 {
            self.desc.report.warning(plugin.span, format!("{negative} values of the volume are below zero and count as zero"));
        }
        let volume = VolumeDesc { size, channels, data, world_from_volume, filter, wrap };
        Some(self.desc.add(Node::named(&plugin.id, plugin.span, volume)))
    }

    fn phase_of(&mut self, p: &mut Props<'t>) -> PhaseDesc {
        match self.next_of(p, Kind::Phase) {
            Some(phase) => self.phase(phase),
            None => PhaseDesc::Isotropic,
        }
    }

    fn phase(&mut self, plugin: &'t Plugin) -> PhaseDesc {
        if !self.is_known(plugin) {
            return PhaseDesc::Isotropic;
        }
        let mut p = Props::new(plugin);
        let phase = match plugin.type_name.as_str() {
            "isotropic" => PhaseDesc::Isotropic,
            "rayleigh" => PhaseDesc::Rayleigh,
            "hg" => {
                let g = match p.get("g").map(|q| &q.value) {
                    Some(Value::Plugin(_) | Value::Reference(_)) => match self.scalar(&mut p, "g", 0.8) {
                        crate::desc::Param::Constant(g) => g,
                        crate::desc::Param::Texture(_) => 0.8,
                    },
                    _ => p.float("g", 0.8),
                };
                if g.abs() >= 1.0 {
                    p.fault_at("g", format!("`g` must lie between -1 and 1, not {g}"));
                }
                PhaseDesc::HenyeyGreenstein { g: g.clamp(-0.999, 0.999) }
            }
            "blendphase" => {
                let weight = match p.get("weight").map(|q| &q.value) {
                    Some(Value::Plugin(_) | Value::Reference(_)) => {
                        self.lose(plugin, "a constant weight of one half");
                        0.5
                    }
                    _ => p.float("weight", 0.5),
                };
                if !(0.0..=1.0).contains(&weight) {
                    p.fault_at("weight", "`weight` must lie in [0, 1]");
                }
                let [first, second] = [0, 1].map(|_| self.next_of(&mut p, Kind::Phase));
                let (Some(first), Some(second)) = (first, second) else {
                    p.fault(plugin.span, "blendphase takes two phase functions");
                    self.finish(p);
                    return PhaseDesc::Isotropic;
                };
                let mut part = |plugin| self.guarded(plugin, |b| Some(b.phase(plugin))).unwrap_or(PhaseDesc::Isotropic);
                let (first, second) = (Box::new(part(first)), Box::new(part(second)));
                PhaseDesc::Blend { first, second, weight: weight.clamp(0.0, 1.0) }
            }
            _ => {
                self.lose(plugin, "isotropic in its place");
                p.ignore_all();
                PhaseDesc::Isotropic
            }
        };
        self.finish(p);
        phase
    }
}
