//! Participating media.

use super::Reader;
use super::params::Params;
use super::spectrum::SpectrumKind;
use crate::desc::{AddNode, MediumDesc, MediumId, Node, PhaseDesc};
use crate::span::Span;

impl Reader {
    /// `MakeNamedMedium "name" "string type" …`
    pub(super) fn make_medium(&mut self, name: &str, p: &Params) {
        let kind = p.opt_text("type", &mut self.desc.report).unwrap_or_default().to_owned();
        if kind != "homogeneous" {
            if ["uniformgrid", "rgbgrid", "cloud", "nanovdb"].contains(&kind.as_str()) {
                self.loss(p.span, format!("medium \"{kind}\""), "left out");
            } else {
                self.error(p.span, format!("no medium `{kind}`; there are homogeneous, uniformgrid, rgbgrid, cloud, nanovdb"));
            }
            p.ignore(&[
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
            ]);
            return;
        }
        let r = &mut self.desc.report;
        let scale = p.float("scale", 1.0, r);
        let emission_scale = p.float("Lescale", 1.0, r);
        let g = p.float("g", 0.0, r);
        if !(g > -1.0 && g < 1.0) {
            r.error(p.span, format!("`g` must lie between -1 and 1, not {g}"));
            return;
        }
        if let Some(preset) = p.opt_text("preset", r) {
            let feature = format!("preset \"{preset}\" of a medium");
            r.loss(p.span, feature, "the coefficients that are given beside it, or pbrt's defaults");
        }
        let mut get = |name: &str, kind, default: [f32; 3]| p.get(name).and_then(|q| self.color(q, kind)).unwrap_or(default);
        let sigma_a = get("sigma_a", SpectrumKind::Unbounded, [0.0011, 0.0024, 0.014]).map(|v| v * scale);
        let sigma_s = get("sigma_s", SpectrumKind::Unbounded, [2.55, 3.21, 3.77]).map(|v| v * scale);
        let emission = get("Le", SpectrumKind::Illuminant, [0.0; 3]).map(|v| v * emission_scale);
        if sigma_a.iter().chain(&sigma_s).any(|v| *v < 0.0) {
            self.error(p.span, "coefficients must not be negative");
            return;
        }
        let phase = if g == 0.0 { PhaseDesc::Isotropic } else { PhaseDesc::HenyeyGreenstein { g } };
        let id = self.desc.add(Node::named(name, p.span, MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase }));
        self.media.insert(name.to_owned(), id);
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
