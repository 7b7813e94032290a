//! Media: what is given, taken and scattered along a part of a ray.
//!
//! How many samples are taken where was measured on media whose density is a step: with method 3 a ray is cut at j / (n + 1), n = ⌊samples
//! / 2⌋ + 1 ≥ 2; each of the n pieces is the mean of its ends and its middle, halved again while they differ, and light that was given before
//! is not weakened by the piece's own extinction. Shadow rays take the same samples, but halve nothing. Where several media share a space
//! each scatters by the mean of all their phase functions, those that do not scatter counted as isotropic (measured).

use etendue_procedural::fns;
use etendue_scene::desc::classic::{LightKind, Media, Scattering};
use glam::DVec3;

use super::light::Lamp;
use super::refract::Stack;
use super::shadow::Receiver;
use super::trace::Tracer;
use super::{ClassicWorld, atmosphere, peak};
use crate::solid::Line;

/// About the most samples of media that a part of a shadow ray takes.
const MOST_IN_SHADOWS: u32 = 10_000;

/// What a place in media does to light, per unit of length.
#[derive(Clone, Copy, Default)]
struct Place {
    given: DVec3,
    taken: DVec3,
}

impl Place {
    fn mean(a: Self, b: Self, c: Self) -> Self {
        let third = 1.0 / 3.0;
        Self { given: (a.given + b.given + c.given) * third, taken: (a.taken + b.taken + c.taken) * third }
    }

    fn half(a: Self, b: Self) -> Self {
        Self { given: (a.given + b.given) * 0.5, taken: (a.taken + b.taken) * 0.5 }
    }
}

/// What is around a part of a ray.
struct Around<'w> {
    /// What the ray is inside of.
    inside: &'w Stack,
    /// None inside of anything solid.
    media: Vec<&'w Media>,
    /// Those that shine on the part.
    lamps: Vec<&'w Lamp>,
    /// Photons stand for the light through their targets.
    by_photons: bool,
}

impl<'w> Around<'w> {
    fn new(world: &'w ClassicWorld, inside: &'w Stack) -> Self {
        let own = inside.iter().filter_map(|w| w.interior.as_ref()).flat_map(|i| &i.media);
        let all = own.chain(&world.scene.atmosphere);
        let media = if inside.iter().all(|w| w.hollow) { all.collect() } else { Vec::new() };
        let by_photons = world.photons.is_some() && media.iter().any(|m| scatters_photons(m));
        Self { inside, media, lamps: Vec::new(), by_photons }
    }
}

impl Tracer<'_, '_> {
    /// Light that has come along a part of a ray through the media that the ray is inside of.
    pub(super) fn through_media(&mut self, color: DVec3, line: &Line, t: f64, inside: &Stack, group: u32) -> DVec3 {
        let world = self.world;
        let mut around = Around::new(world, inside);
        let media = &around.media;
        let Some(&first) = media.first() else { return color };
        let t = t.min(atmosphere::FAR);
        let scatters = media.iter().any(|m| m.scattering.is_some());
        let mut cuts = vec![0.0, t];
        if scatters {
            world.cut_at_cones(line, t, &mut cuts);
        }
        let intervals = media.iter().map(|m| m.intervals).max().unwrap_or(1).max(1);
        let pieces = f64::from(intervals.div_ceil(cuts.len() as u32 - 1).max(1));
        let samples = media.iter().map(|m| m.samples[0]).max().unwrap_or(1);
        let (mut added, mut passing) = (DVec3::ZERO, DVec3::ONE);
        for cut in cuts.windows(2) {
            let step = (cut[1] - cut[0]) / pieces;
            if !(step > 0.0) {
                continue;
            }
            // Cones end at cuts, so that a light shines on all of a part or on nothing of it.
            let middle = line.at(0.5 * (cut[0] + cut[1]));
            around.lamps.clear();
            if scatters {
                around.lamps.extend(
                    world
                        .media_lamps(group)
                        .filter(|l| l.light.kind == LightKind::Point || l.color(l.light.location, middle) != DVec3::ZERO),
                );
            }
            for k in 0..pieces as u32 {
                let from = cut[0] + f64::from(k) * step;
                self.interval(line, [from, step], &around, first, samples, &mut added, &mut passing);
                if peak(passing) < 1e-6 {
                    return added;
                }
            }
        }
        color * passing + added
    }

    #[expect(clippy::too_many_arguments, reason = "private; one loop in two functions")]
    fn interval(
        &mut self,
        line: &Line,
        [from, length]: [f64; 2],
        around: &Around<'_>,
        rule: &Media,
        samples: u32,
        added: &mut DVec3,
        passing: &mut DVec3,
    ) {
        if rule.method == 3 {
            let n = three_point_pieces(samples);
            let spacing = length / f64::from(n + 1);
            let shift = if rule.jitter != 0.0 { rule.jitter * (f64::from(self.stream.next_1d()) - 0.5) } else { 0.0 };
            let at = |j: u32| from + (f64::from(j) + shift).max(0.0) * spacing;
            let step = length / f64::from(n);
            let mut a = self.place(line.at(at(0)), line.d, around);
            for j in 0..n {
                let b = self.place(line.at(at(j + 1)), line.d, around);
                let piece = self.refine(line, [at(j), at(j + 1)], [a, b], around, rule, length, 1);
                *added += *passing * piece.given * step;
                *passing *= exponential(piece.taken * -step);
                a = b;
            }
        } else {
            let n = samples.clamp(1, 10_000);
            let step = length / f64::from(n);
            for k in 0..n {
                let u = offset(rule, &mut || f64::from(self.stream.next_1d()));
                let place = self.place(line.at(from + (f64::from(k) + u) * step), line.d, around);
                *added += *passing * place.given * step;
                *passing *= exponential(place.taken * -step);
            }
        }
    }

    /// The mean of a piece: of its ends and its middle, or of its halves where the light that they would give over the whole interval differs
    /// by more than the threshold, summed over the colors (measured).
    #[expect(clippy::too_many_arguments, reason = "private and recursive")]
    fn refine(
        &mut self,
        line: &Line,
        t: [f64; 2],
        ends: [Place; 2],
        around: &Around<'_>,
        rule: &Media,
        interval: f64,
        level: u32,
    ) -> Place {
        let middle = 0.5 * (t[0] + t[1]);
        let place = self.place(line.at(middle), line.d, around);
        let differ = |a: &Place| (a.given - place.given).abs().element_sum() * interval > rule.aa_threshold;
        if level >= rule.aa_level || !(differ(&ends[0]) || differ(&ends[1])) {
            return Place::mean(ends[0], place, ends[1]);
        }
        let a = self.refine(line, [t[0], middle], [ends[0], place], around, rule, interval, level + 1);
        let b = self.refine(line, [middle, t[1]], [place, ends[1]], around, rule, interval, level + 1);
        Place::half(a, b)
    }

    fn place(&mut self, p: DVec3, d: DVec3, around: &Around<'_>) -> Place {
        let world = self.world;
        let mut out = Place::default();
        let (mut scatters, mut scattering_density) = (DVec3::ZERO, DVec3::ZERO);
        for &m in &around.media {
            let density = world.density(m, p);
            out.given += m.emission * density;
            out.taken += m.absorption * density;
            if let Some(scattering) = &m.scattering {
                out.taken += scattering.color * scattering.extinction * density;
                scatters += scattering.color * density;
                scattering_density += density;
            }
        }
        if scattering_density != DVec3::ZERO {
            let phases = |cos: f64| around.media.iter().map(|m| m.scattering.as_ref().map_or(1.0, |s| phase(s, cos))).sum::<f64>();
            let scattered =
                self.lamps_at(p, around).iter().fold(DVec3::ZERO, |sum, (towards, color)| sum + *color * phases(d.dot(*towards)))
                    / around.media.len() as f64;
            out.given += scatters * scattered;
        }
        out
    }

    /// Directions and colors at a point of those of some lamps, and of the photons, that light it.
    fn lamps_at(&mut self, p: DVec3, around: &Around<'_>) -> Vec<(DVec3, DVec3)> {
        let mut lights = Vec::new();
        for &lamp in &around.lamps {
            let towards = lamp.towards(p);
            let lit = Receiver { p, inside: around.inside, by_photons: around.by_photons };
            let color = self.lamp_color(lamp, lit, towards);
            if color != DVec3::ZERO {
                lights.push((towards.0, color));
            }
        }
        if let Some(photons) = self.world.photons.as_ref().filter(|_| around.by_photons) {
            photons.light_in_media(p, &mut lights);
        }
        lights
    }
}

/// Whether photons are kept in what a ray is inside of.
pub(super) fn collect_photons(inside: &Stack) -> bool {
    let mut media = inside.iter().filter_map(|w| w.interior.as_ref()).flat_map(|i| &i.media);
    inside.iter().all(|w| w.hollow) && media.any(scatters_photons)
}

fn scatters_photons(media: &Media) -> bool {
    media.collect_photons && media.scattering.is_some()
}

impl ClassicWorld {
    /// Lamps of a light group that media scatter.
    fn media_lamps(&self, group: u32) -> impl Iterator<Item = &Lamp> {
        let set = self.lamps_of_group.get(group as usize).or(self.lamps_of_group.first());
        set.into_iter().flatten().filter_map(|&i| self.lamps.get(i as usize)).filter(|l| l.light.media_interaction)
    }

    fn density(&self, media: &Media, p: DVec3) -> DVec3 {
        let context = self.context(p);
        media.densities.iter().fold(DVec3::ONE, |product, d| product * d.color(&context).rgb)
    }

    /// What media let through of light between two places of a ray; `random` gives numbers in [0, 1).
    pub(super) fn media_passing(&self, media: &[&Media], line: &Line, [from, to]: [f64; 2], random: &mut impl FnMut() -> f64) -> DVec3 {
        let length = (to - from).clamp(0.0, atmosphere::FAR);
        let taken = |m: &Media| m.absorption + m.scattering.map_or(DVec3::ZERO, |s| s.color * s.extinction);
        if media.iter().all(|m| m.densities.is_empty() || taken(m) == DVec3::ZERO) {
            return exponential(media.iter().fold(DVec3::ZERO, |sum, m| sum + taken(m)) * -length);
        }
        let Some(rule) = media.first() else { return DVec3::ONE };
        let samples = media.iter().map(|m| m.samples[0]).max().unwrap_or(1);
        // For each of a viewing ray's samples and each light: bounded, whatever a file asks for.
        let intervals = media.iter().map(|m| m.intervals).max().unwrap_or(1).clamp(1, (MOST_IN_SHADOWS / samples.max(1)).max(1));
        let piece = length / f64::from(intervals);
        let place = |t: f64| {
            let p = line.at(t);
            media.iter().filter(|m| taken(m) != DVec3::ZERO).fold(DVec3::ZERO, |sum, m| sum + taken(m) * self.density(m, p))
        };
        let mut depth = DVec3::ZERO;
        for k in 0..intervals {
            let from = from + f64::from(k) * piece;
            if rule.method == 3 {
                let n = three_point_pieces(samples);
                let spacing = piece / f64::from(n + 1);
                let shift = if rule.jitter != 0.0 { rule.jitter * (random() - 0.5) } else { 0.0 };
                let at = |j: f64| from + (j + shift).max(0.0) * spacing;
                let mut a = place(at(0.0));
                for j in 0..n {
                    let b = place(at(f64::from(j + 1)));
                    depth += (a + place(at(f64::from(j) + 0.5)) + b) * (piece / f64::from(3 * n));
                    a = b;
                }
            } else {
                let n = samples.clamp(1, 10_000);
                let step = piece / f64::from(n);
                for j in 0..n {
                    depth += place(from + (f64::from(j) + offset(rule, random)) * step) * step;
                }
            }
        }
        exponential(-depth)
    }

    /// Adds the places where a ray enters and leaves the cones of spot and cylinder lights.
    fn cut_at_cones(&self, line: &Line, t: f64, cuts: &mut Vec<f64>) {
        for lamp in self.lamps.iter().filter(|l| l.light.kind != LightKind::Point && l.light.media_interaction) {
            for at in lamp.crossings(line) {
                if at > 1e-6 && at < t {
                    cuts.push(at);
                }
            }
        }
        cuts.sort_by(f64::total_cmp);
        cuts.dedup();
    }
}

/// How many pieces of three samples method 3 makes of an interval.
fn three_point_pieces(samples: u32) -> u32 {
    (samples / 2 + 1).clamp(2, 10_000)
}

/// Where in its step a sample of methods 1 and 2 is.
fn offset(rule: &Media, random: &mut impl FnMut() -> f64) -> f64 {
    match rule.method {
        1 => random(),
        _ if rule.jitter != 0.0 => 0.5 + rule.jitter * (random() - 0.5),
        _ => 0.5,
    }
}

fn exponential(v: DVec3) -> DVec3 {
    if v.x == v.y && v.x == v.z {
        return DVec3::splat(if v.x == 0.0 { 1.0 } else { fns::exp(v.x) });
    }
    DVec3::new(fns::exp(v.x), fns::exp(v.y), fns::exp(v.z))
}

/// How much light is scattered into the ray, 1 for isotropic media; `cos` is that between the ray and the direction to the light.
///
/// Henyey and Greenstein's function is theirs (1941), Rayleigh's 1 + cos² and the Mie approximations 1 + 9 ((1 + cos) / 2)⁸ and 1 + 50
/// ((1 + cos) / 2)³² are Nishita's (1987); their factors and the 50 were measured.
fn phase(s: &Scattering, cos: f64) -> f64 {
    let lobe = |n: i32| (0.5 * (1.0 + cos)).clamp(0.0, 1.0).powi(n);
    match s.phase {
        2 => 0.576_65 * (1.0 + 9.0 * lobe(8)),
        3 => 0.495_71 * (1.0 + 50.0 * lobe(32)),
        4 => 0.799_37 * (1.0 + cos * cos),
        5 => {
            let e = s.eccentricity;
            let d = 1.0 + e * e - 2.0 * e * cos;
            (1.0 - e * e) / (d * d.max(0.0).sqrt()).max(1e-9)
        }
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phase_functions_as_measured() {
        // POV-Ray 3.7.0.10; the angle is that of the light's direction to the camera's axis, 0 behind the camera.
        let table: [(u8, [f64; 6]); 5] = [
            (1, [1.0; 6]),
            (2, [0.57664, 0.57664, 0.57671, 0.59693, 1.09621, 3.55695]),
            (3, [0.49569, 0.49569, 0.49569, 0.49569, 0.49821, 3.19089]),
            (4, [1.59876, 1.39887, 0.99924, 0.79934, 0.99924, 1.39887]),
            (5, [0.22225, 0.24369, 0.32395, 0.53666, 1.15465, 3.15213]),
        ];
        for (kind, values) in table {
            let s = Scattering { phase: kind, color: DVec3::ONE, eccentricity: 0.5, extinction: 1.0 };
            for (k, value) in values.into_iter().enumerate() {
                let cos = -fns::cos((30.0 * k as f64).to_radians());
                assert!((phase(&s, cos) - value).abs() < 4e-4 * value.max(1.0), "{kind} {k}: {} is not {value}", phase(&s, cos));
            }
        }
    }
}
