//! What fills space: background, sky, fog, rainbows.

use etendue_procedural::noise::turbulence;
use etendue_procedural::{Color, Context, fns};
use etendue_scene::desc::classic::{Fog, Rainbow};
use glam::DVec3;

use super::ClassicWorld;
use crate::solid::Line;

use std::f64::consts::PI;

/// The length that stands for infinity along rays that meet nothing.
pub(super) const FAR: f64 = 1e7;

impl ClassicWorld {
    /// What a direction shows where nothing is hit, with the share that hides what is behind the scene.
    pub(super) fn sky(&self, d: DVec3) -> (DVec3, f64) {
        let mut color = DVec3::ZERO;
        let mut passing = DVec3::ONE;
        let mut opaque = 0.0;
        if let Some(sky) = &self.scene.sky {
            let old = self.settings().version < 370;
            for (i, pigment) in sky.pigments.iter().enumerate().rev() {
                let c = pigment.color(&Context { ray: d, ..self.context(d) });
                color += passing * c.rgb * c.opacity().max(0.0) * sky.emission;
                // Before version 3.7 `filter` passed like `transmit` from pigment to pigment, but not to the background (measured).
                passing *= if old && i > 0 { DVec3::splat(c.filter + c.transmit) } else { c.passing() };
                opaque = 1.0;
                if passing == DVec3::ZERO {
                    return (color, 1.0);
                }
            }
        }
        if let Some(background) = self.scene.background {
            color += passing * background.rgb;
            opaque = 1.0;
        }
        (color, opaque)
    }

    /// Light that comes along a part of a ray, with fog and rainbows in between.
    ///
    /// Colors of several fogs add up, what they let through multiplies (measured).
    pub(super) fn hazed(&self, color: DVec3, line: &Line, t: f64) -> DVec3 {
        let scene = &self.scene;
        let t = t.min(FAR);
        let mut passing = DVec3::ONE;
        let mut added = DVec3::ZERO;
        for fog in &scene.fogs {
            if fog.distance == 0.0 {
                continue;
            }
            let left = self.fog_transmittance(fog, line, t).max(fog.color.transmit);
            passing *= tint(left, fog.color.rgb, fog.color.filter);
            added += fog.color.rgb * (1.0 - left);
        }
        for rainbow in &scene.rainbows {
            if let Some((left, c)) = rainbow_color(rainbow, line.d, t) {
                let left = left.max(c.transmit);
                passing *= tint(left, c.rgb, c.filter);
                added += c.rgb * (1.0 - left);
            }
        }
        color * passing + added
    }

    /// What fog lets through of light along a part of a ray, as lights with `media_attenuation` suffer it.
    pub(super) fn fog_passing(&self, line: &Line, t: f64) -> DVec3 {
        let mut passing = DVec3::ONE;
        for fog in self.scene.fogs.iter().filter(|f| f.distance != 0.0) {
            passing *= tint(self.fog_transmittance(fog, line, t).max(fog.color.transmit), fog.color.rgb, fog.color.filter);
        }
        passing
    }

    fn fog_transmittance(&self, fog: &Fog, line: &Line, t: f64) -> f64 {
        let depth = match fog.kind {
            1 => t,
            _ => ground_depth(fog, line, t),
        } / fog.distance.abs();
        let left = fns::exp(-depth);
        if fog.turbulence == DVec3::ZERO {
            return left;
        }
        // Stirred fog is thinner, by the turbulence halfway along the ray and by what constant fog of that length would let through,
        // in ground fog as well. The formula fits measured pictures to 1e−4.
        let left = fns::exp(-t / fog.distance.abs());
        let p = line.at(0.5 * t) * fog.turbulence;
        let stirred = (turbulence(p, &fog.octaves, self.settings().noise_generator) * fog.turb_depth).min(1.0);
        fns::exp(-depth * (1.0 - left * stirred))
    }
}

/// Light of a share `left` that a color filters in part.
fn tint(left: f64, rgb: DVec3, filter: f64) -> DVec3 {
    (DVec3::splat(1.0 - filter) + rgb * filter) * left
}

/// Length of a part of a ray weighed with the density of ground fog: 1 up to the offset, 1 / (1 + k²) above, k the height over the
/// offset in altitudes. (The documentation says 1 / (1 + k)²; measured pictures and its sentence of the altitude disagree with that.)
fn ground_depth(fog: &Fog, line: &Line, t: f64) -> f64 {
    let altitude = if fog.altitude.abs() > 1e-12 { fog.altitude.abs() } else { 1e-12 };
    let up = fog.up.normalize_or(DVec3::Y);
    let k = |p: DVec3| (p.dot(up) - fog.offset) / altitude;
    let (k0, k1) = (k(line.o), k(line.at(t)));
    let (low, high) = (k0.min(k1), k0.max(k1));
    if high - low < 1e-9 * (1.0 + low.abs()) {
        let density = if low <= 0.0 { 1.0 } else { 1.0 / (1.0 + low * low) };
        return t * density;
    }
    let below = (high.min(0.0) - low.min(0.0)).max(0.0);
    let above = fns::atan(high.max(0.0)) - fns::atan(low.max(0.0));
    t * (below + above) / (high - low)
}

/// What a rainbow lets through and its color, where the ray meets it.
fn rainbow_color(r: &Rainbow, d: DVec3, t: f64) -> Option<(f64, Color)> {
    let axis = r.direction.try_normalize()?;
    let colors = r.colors.as_ref()?;
    if r.distance == 0.0 || r.width == 0.0 {
        return None;
    }
    let degrees = |cos: f64| fns::acos(cos.clamp(-1.0, 1.0)) * 180.0 / PI;
    let angle = degrees(-d.dot(axis)).min(degrees(d.dot(axis)));
    let index = (angle - r.angle + 0.5 * r.width) / r.width;
    if !(0.0..=1.0).contains(&index) {
        return None;
    }
    let up = (r.up - axis * r.up.dot(axis)).normalize_or(DVec3::Y);
    let aside = (d - axis * d.dot(axis)).normalize_or(up);
    let along = degrees(aside.dot(up));
    let (half, full) = (0.5 * r.arc_angle, 0.5 * r.falloff_angle);
    let fade = if along <= full.min(half) {
        1.0
    } else if along < half {
        let k = (along - full) / (half - full);
        1.0 - k * k * (3.0 - 2.0 * k)
    } else {
        return None;
    };
    let (a, b, w) = colors.around(index)?;
    let color = a.lerp(b, w);
    let left = fns::exp(-t / r.distance);
    Some((1.0 - fade * (1.0 - left), color))
}
