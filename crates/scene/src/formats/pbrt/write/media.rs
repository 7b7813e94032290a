//! Participating media.

use std::fmt::Write as _;

use super::Writer;
use crate::desc::{
    EmissionSource, FieldDesc, GridMediumDesc, MediumDesc, MediumEmissionDesc, Node, PhaseDesc, ScatteringDesc, VolumeDesc, VolumeFilter,
    VolumeWrap,
};
use crate::span::Span;

impl Writer<'_> {
    /// All media, by number.
    pub(super) fn media(&mut self) {
        let desc = self.desc;
        for (i, node) in desc.media.iter().enumerate() {
            match &node.value {
                MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase } => {
                    let _ = write!(self.text, "MakeNamedMedium \"v{i}\"");
                    self.string("type", "homogeneous");
                    self.rgb("sigma_a", *sigma_a);
                    self.rgb("sigma_s", *sigma_s);
                    if *emission != [0.0; 3] {
                        // pbrt multiplies by the absorption.
                        if (0..3).any(|k| emission[k] > 0.0 && sigma_a[k] <= 0.0) {
                            self.lose(node.span, "emission of a medium that does not absorb", "none in these channels");
                        }
                        self.rgb("Le", [0, 1, 2].map(|k| if sigma_a[k] > 0.0 { emission[k] / sigma_a[k] } else { 0.0 }));
                    }
                    self.phase(phase, node.span);
                    self.text.push('\n');
                }
                MediumDesc::Grid(grid) => self.grid_medium(i, node, grid),
            }
        }
    }

    fn phase(&mut self, phase: &PhaseDesc, span: Span) {
        match phase {
            PhaseDesc::Isotropic => {}
            PhaseDesc::HenyeyGreenstein { g } => self.float("g", *g),
            PhaseDesc::Rayleigh => self.lose(span, "Rayleigh phase function", "isotropic"),
            PhaseDesc::Blend { .. } => self.lose(span, "blend of phase functions", "isotropic"),
        }
    }

    fn of(&self, field: &FieldDesc) -> Option<&VolumeDesc> {
        field.volume.and_then(|id| Some(&self.desc.volumes.get(id.0 as usize)?.value))
    }

    fn grid_medium(&mut self, i: usize, node: &Node<MediumDesc>, grid: &GridMediumDesc) {
        let span = node.span;
        let Some(volume) = self.of(&grid.extinction).cloned() else {
            self.lose(span, "grid medium without a border", "left out");
            return;
        };
        if volume.wrap != VolumeWrap::Zero {
            self.lose(span, "volume with values beyond its outermost ones", "empty beyond them: thinner in the outer half of a cell");
        }
        if volume.filter == VolumeFilter::Nearest {
            self.lose(span, "volume of cells", "linear between the values");
        }
        let scattering = match &grid.scattering {
            ScatteringDesc::Albedo(f) | ScatteringDesc::Coefficient(f) => *f,
        };
        let is_albedo = matches!(grid.scattering, ScatteringDesc::Albedo(_));
        let same = |v: Option<&VolumeDesc>| v.is_none_or(|v| v.size == volume.size && v.world_from_volume == volume.world_from_volume);
        if !same(self.of(&scattering)) {
            self.lose(span, "albedo on another grid than the extinction", "left out: the medium is not written");
            return;
        }
        self.line("AttributeBegin");
        self.transform("Transform", volume.world_from_volume);
        let _ = write!(self.text, "MakeNamedMedium \"v{i}\"");
        let [nx, ny, nz] = volume.size;
        let _ = write!(self.text, " \"integer nx\" {nx} \"integer ny\" {ny} \"integer nz\" {nz}");
        self.phase(&grid.phase, span);
        let factor = grid.extinction.factor;
        if volume.channels == 1 && is_albedo && scattering.volume.is_none() {
            self.string("type", "uniformgrid");
            let albedo = scattering.factor;
            self.rgb("sigma_a", [0, 1, 2].map(|k| factor[k] * (1.0 - albedo[k])));
            self.rgb("sigma_s", [0, 1, 2].map(|k| factor[k] * albedo[k]));
            self.numbers("float density", &volume.data);
            self.glow(grid.emission.as_ref(), &volume, span);
        } else {
            self.string("type", "rgbgrid");
            let total = colors(&volume, factor);
            let other = match self.of(&scattering) {
                Some(v) => colors(v, scattering.factor),
                None => scattering.factor.iter().copied().cycle().take(total.len()).collect(),
            };
            let scattered: Vec<f32> = total.iter().zip(&other).map(|(t, o)| if is_albedo { t * o.min(1.0) } else { o.min(*t) }).collect();
            let absorbed: Vec<f32> = total.iter().zip(&scattered).map(|(t, s)| t - s).collect();
            self.numbers("rgb sigma_a", &absorbed);
            self.numbers("rgb sigma_s", &scattered);
            if let Some(emission) = &grid.emission {
                match &emission.source {
                    EmissionSource::Field(f) if emission.by_absorption && same(self.of(f)) => {
                        let glow = match self.of(f) {
                            Some(v) => colors(v, f.factor),
                            None => f.factor.iter().copied().cycle().take(total.len()).collect(),
                        };
                        self.numbers("rgb Le", &glow);
                    }
                    _ => self.lose(span, "emission of a medium", "none"),
                }
            }
        }
        self.text.push('\n');
        self.line("AttributeEnd");
    }

    /// Emission of a `uniformgrid`.
    fn glow(&mut self, emission: Option<&MediumEmissionDesc>, volume: &VolumeDesc, span: Span) {
        let Some(emission) = emission else { return };
        let same = |v: &VolumeDesc| v.channels == 1 && v.size == volume.size && v.world_from_volume == volume.world_from_volume;
        match &emission.source {
            EmissionSource::Field(f) if emission.by_absorption && f.volume.is_none() => self.rgb("Le", f.factor),
            EmissionSource::Field(f) if emission.by_absorption && self.of(f).is_some_and(same) => {
                self.rgb("Le", f.factor);
                let data = self.of(f).map(|v| v.data.clone()).unwrap_or_default();
                self.numbers("float Lescale", &data);
            }
            EmissionSource::BlackBody { kelvin, offset, scale } if emission.by_absorption && self.of(kelvin).is_some_and(same) => {
                let factor = kelvin.factor[0];
                let data = self.of(kelvin).map(|v| v.data.clone()).unwrap_or_default();
                self.numbers("float temperature", &data);
                self.float("temperaturescale", factor);
                self.float("temperatureoffset", if factor > 0.0 { -offset / factor } else { 0.0 });
                self.float("Lescale", *scale);
            }
            _ => self.lose(span, "emission of a medium", "none"),
        }
    }

    fn numbers(&mut self, declaration: &str, values: &[f32]) {
        let _ = write!(self.text, "\n  \"{declaration}\" [");
        for (i, v) in values.iter().enumerate() {
            let separator = if i % 16 == 15 { '\n' } else { ' ' };
            let _ = write!(self.text, "{v}{separator}");
        }
        self.text.push(']');
    }
}

/// The values of a volume as colors times a factor.
fn colors(volume: &VolumeDesc, factor: [f32; 3]) -> Vec<f32> {
    if volume.channels == 1 {
        volume.data.iter().flat_map(|v| factor.map(|f| f * v)).collect()
    } else {
        volume.data.iter().zip(factor.iter().cycle()).map(|(v, f)| v * f).collect()
    }
}
