//! Participating media.

use super::Builder;
use super::props::Props;
use crate::desc::{AddNode, MediumDesc, MediumId, Node, PhaseDesc};
use crate::formats::mitsuba::tree::{Kind, Plugin, Value};
use crate::formats::spectrum::Quantity;

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
        if plugin.type_name != "homogeneous" {
            self.lose(plugin, "left out");
            return None;
        }
        let mut p = Props::new(plugin);
        let scale = p.float("scale", 1.0);
        p.ignore(&["has_spectral_extinction", "sample_emitters", "strategy", "medium_sampling_weight"]);
        if let Some(material) = p.get("material") {
            self.desc.report.loss(material.span, "`material` of medium \"homogeneous\"", "the default coefficients in its place");
        }
        let (sigma_a, sigma_s) = if p.has("sigma_a") || p.has("sigma_s") {
            (self.coefficient(&mut p, "sigma_a", 0.0), self.coefficient(&mut p, "sigma_s", 0.0))
        } else {
            let sigma_t = self.coefficient(&mut p, "sigma_t", 1.0);
            let albedo = self.coefficient(&mut p, "albedo", 0.75);
            let product = |f: fn(f32) -> f32| [0, 1, 2].map(|i| sigma_t[i] * f(albedo[i]));
            (product(|a| 1.0 - a), product(|a| a))
        };
        let emission = self.coefficient(&mut p, "emission", 0.0);
        let phase = match self.next_of(&mut p, Kind::Phase) {
            Some(phase) => self.phase(phase),
            None => PhaseDesc::Isotropic,
        };
        if sigma_a.iter().chain(&sigma_s).any(|v| *v < 0.0) {
            p.fault(plugin.span, "coefficients must not be negative, nor an albedo above 1");
        }
        self.finish(p);
        let [sigma_a, sigma_s] = [sigma_a, sigma_s].map(|c| c.map(|v| v * scale));
        Some(self.desc.add(Node::named(&plugin.id, plugin.span, MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase })))
    }

    /// A number, color, spectrum or constant volume.
    fn coefficient(&mut self, p: &mut Props<'t>, name: &'static str, default: f32) -> [f32; 3] {
        let volume = p.plugin.params.iter().find(|q| q.name == name && self.kind_of(q) == Some(Kind::Volume));
        let Some(property) = volume else {
            return self.constant_color(p, name, Quantity::Reflectance, [default; 3]);
        };
        p.ignore(&[name]);
        match self.resolve(property) {
            Some(volume) if volume.type_name == "constvolume" => {
                let mut q = Props::new(volume);
                let value = self.constant_color(&mut q, "value", Quantity::Reflectance, [default; 3]);
                q.ignore(&["to_world"]);
                self.finish(q);
                value
            }
            Some(volume) => {
                self.lose(volume, "a constant in its place");
                [default; 3]
            }
            None => [default; 3],
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
