//! Raw values of all kinds of patterns, at points in the pattern's own space.

use glam::DVec3;

use super::{Pattern, PatternKind, Slope, simple};
use crate::noise::{self, Turbulence};
use crate::noise_cells::Waves;
use crate::{Context, fns, noise_cells};

impl Pattern {
    /// The value before frequency, phase and wave form, at a point in the pattern's own space.
    pub fn raw(&self, inner: &Context) -> f64 {
        let p = inner.p;
        let generator = inner.noise_generator;
        match &self.kind {
            PatternKind::None | PatternKind::Average => 0.0,
            PatternKind::Agate { turbulence } => noise::agate(p, *turbulence, &self.walk(), generator),
            PatternKind::Aoi => {
                let cosine = inner.ray.dot(inner.normal).abs().min(1.0);
                1.0 - fns::acos(cosine) / std::f64::consts::PI
            }
            PatternKind::Boxed => 1.0 - p.abs().max_element().min(1.0),
            PatternKind::Bozo | PatternKind::Spotted | PatternKind::Bumps => noise::noise(p, generator),
            PatternKind::Cells => noise_cells::cells(p),
            PatternKind::Crackle(c) => noise_cells::crackle(p, c.form, c.metric, c.offset, c.solid, generator),
            PatternKind::Cylindrical => 1.0 - (p.x * p.x + p.z * p.z).sqrt().min(1.0),
            PatternKind::DensityFile(file) => file.value(p),
            PatternKind::Dents => noise::dents(p, generator),
            PatternKind::Facets { .. } => 0.0,
            PatternKind::Fractal(fractal) => fractal.value(p),
            PatternKind::Function(function) => simple::fraction(function.eval(&p.to_array(), inner)),
            PatternKind::Gradient(direction) => simple::gradient(p, *direction),
            PatternKind::Granite => noise::granite(p, generator),
            PatternKind::Image(image) => image.value(inner).unwrap_or(0.0),
            PatternKind::Leopard => simple::leopard(p),
            PatternKind::Marble => match &self.placement.turbulence {
                Some(t) if t.amount.x != 0.0 => p.x + t.amount.x * noise::turbulence(p, &t.walk, generator),
                _ => p.x,
            },
            PatternKind::Onion => p.length() % 1.0,
            PatternKind::Pavement(pavement) => pavement.value(p),
            PatternKind::Pigment(pigment) => gray(&pigment.color(inner)),
            PatternKind::Planar => 1.0 - p.y.abs().min(1.0),
            PatternKind::Quilted { control0, control1 } => simple::quilted(p, *control0, *control1),
            PatternKind::Radial => simple::radial(p),
            PatternKind::Ripples => Waves::new(inner.number_of_waves).ripples(p, self.wave.frequency, self.wave.phase),
            PatternKind::Waves => Waves::new(inner.number_of_waves).waves(p, self.wave.frequency, self.wave.phase),
            PatternKind::Slope(slope) => slope.value(p, inner.normal),
            PatternKind::Spherical => 1.0 - p.length().min(1.0),
            PatternKind::Spiral1(arms) => simple::spiral1(p, *arms, self.spiral_turbulence(p, generator)),
            PatternKind::Spiral2(arms) => simple::spiral2(p, *arms, self.spiral_turbulence(p, generator)),
            PatternKind::Tiling(number) => super::tiling::value(p, *number),
            PatternKind::Wood => {
                let turbulent = match &self.placement.turbulence {
                    Some(t) if t.amount != DVec3::ZERO => Some((t.amount, noise::vector_turbulence(p, &t.walk, generator))),
                    _ => None,
                };
                simple::wood(p, turbulent)
            }
            PatternKind::Wrinkles => noise::wrinkles(p, generator),
            PatternKind::Brick { .. }
            | PatternKind::Checker
            | PatternKind::Cubic
            | PatternKind::Hexagon
            | PatternKind::Object(_)
            | PatternKind::Square
            | PatternKind::Triangular => self.kind.block(inner) as f64,
        }
    }

    fn walk(&self) -> Turbulence {
        self.placement.turbulence.map_or_else(Turbulence::default, |t| t.walk)
    }

    /// What the turbulence adds to the spirals beside warping them: its amount along x.
    fn spiral_turbulence(&self, p: DVec3, generator: u8) -> f64 {
        match &self.placement.turbulence {
            Some(t) if t.amount.x != 0.0 => t.amount.x * noise::turbulence(p, &t.walk, generator),
            _ => 0.0,
        }
    }
}

/// Gray value of a color, with POV-Ray's documented weights ("Color expressions").
pub(crate) fn gray(c: &crate::Color) -> f64 {
    c.rgb.dot(DVec3::new(0.297, 0.589, 0.114))
}

impl Slope {
    fn value(&self, p: DVec3, normal: DVec3) -> f64 {
        let scaled = |v: f64, lo: f64, hi: f64| if hi == lo { v } else { (v - lo) / (hi - lo) };
        let direction = if self.point_at { self.direction - p } else { self.direction };
        let cosine = direction.normalize_or_zero().dot(normal).clamp(-1.0, 1.0);
        let slope = (0.5 + fns::asin(cosine) / std::f64::consts::PI).clamp(0.0, 1.0);
        let slope = scaled(slope, self.slope_range.x, self.slope_range.y);
        let altitude_weight = self.altitude.length();
        if self.point_at || altitude_weight == 0.0 {
            return slope;
        }
        let weight = self.direction.length();
        let altitude = scaled(p.dot(self.altitude) / altitude_weight, self.altitude_range.x, self.altitude_range.y);
        (weight * slope + altitude_weight * altitude) / (weight + altitude_weight)
    }
}
