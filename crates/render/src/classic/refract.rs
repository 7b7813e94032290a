//! Interiors: what a ray is inside of, refraction, and fading with depth.

use std::sync::Arc;

use etendue_procedural::fns;
use etendue_scene::desc::classic::{Interior, Object};
use glam::DVec3;

use crate::solid::SolidHit;

/// Tells objects apart: parts of a combination with one interior are one, and so are those without any (measured).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Identity {
    /// By the interior's address.
    Interior(usize),
    /// By the number of the top-level object.
    Whole(u32),
}

pub(super) fn identity(object: &Object, whole: u32) -> Identity {
    object.interior.as_ref().map_or(Identity::Whole(whole), |i| Identity::Interior(Arc::as_ptr(i) as usize))
}

/// An object that a ray is inside of.
#[derive(Clone)]
pub(super) struct Within {
    pub(super) identity: Identity,
    pub(super) interior: Option<Arc<Interior>>,
    /// The index of refraction of a finish, for an object without interior.
    old_ior: Option<f64>,
    pub(super) hollow: bool,
}

impl Within {
    pub(super) fn new(object: &Object, whole: u32, old_ior: Option<f64>) -> Self {
        Self { identity: identity(object, whole), interior: object.interior.clone(), old_ior, hollow: object.hollow }
    }

    fn ior(&self, band: Option<f64>) -> f64 {
        object_ior(self.interior.as_deref(), self.old_ior, band)
    }
}

/// What a ray is inside of, the innermost last.
pub(super) type Stack = Vec<Within>;

/// Most objects that a ray may be inside of; it enters no more.
const DEPTH_LIMIT: usize = 100;

/// That of an object, whose finish may give it where there is no interior.
fn object_ior(interior: Option<&Interior>, old_ior: Option<f64>, band: Option<f64>) -> f64 {
    interior.map_or(old_ior.unwrap_or(1.0), |i| ior_of(i, band))
}

/// The index of refraction for a color of the split light, from 0 for red to 1 for violet; the middle where light is whole.
fn ior_of(interior: &Interior, band: Option<f64>) -> f64 {
    match band {
        Some(t) if interior.dispersion != 1.0 => interior.ior * fns::pow(interior.dispersion.max(1e-6), t - 0.5),
        _ => interior.ior,
    }
}

/// The stack beyond a surface, and the index of refraction there over that here.
pub(super) fn beyond(stack: &Stack, hit: &SolidHit<'_>, old_ior: Option<f64>, band: Option<f64>) -> (Stack, f64) {
    let own = Within::new(hit.object, hit.whole, old_ior);
    let mut next = stack.clone();
    let outside = |s: &Stack| s.last().map_or(1.0, |w| w.ior(band));
    match next.iter().rposition(|w| w.identity == own.identity) {
        Some(at) => {
            next.remove(at);
            // Leaving an object that another one lies in changes nothing for the ray.
            let ratio = if at == next.len() { outside(&next) / own.ior(band) } else { 1.0 };
            (next, ratio)
        }
        None => {
            let ratio = own.ior(band) / outside(&next);
            if next.len() < DEPTH_LIMIT {
                next.push(own);
            }
            (next, ratio)
        }
    }
}

/// The index of refraction beyond a surface over that here, as Fresnel's mirrors take it: where a ray leaves an object, what it is in last
/// counts as beyond, be it that object itself, which then mirrors nothing; air only where it is in nothing else (measured).
pub(super) fn fresnel_ratio(stack: &Stack, hit: &SolidHit<'_>, old_ior: Option<f64>, band: Option<f64>) -> f64 {
    let own = object_ior(hit.object.interior.as_deref(), old_ior, band);
    let last = stack.last().map_or(1.0, |w| w.ior(band));
    let identity = identity(hit.object, hit.whole);
    match stack.iter().any(|w| w.identity == identity) {
        true if stack.len() == 1 => 1.0 / own,
        true => last / own,
        false => own / last,
    }
}

/// Light of red, green and blue up to a place of the spectrum of split light (t, red, green, blue), read from pictures of POV-Ray in which a
/// surface splits light into 2, 3 and 7 colors.
const SPECTRUM: [[f64; 4]; 11] = [
    [0.0, 0.0, 0.0, 0.0],
    [1.0 / 7.0, 0.2570, 0.0, 0.0],
    [2.0 / 7.0, 0.6737, 0.1506, 0.0],
    [1.0 / 3.0, 0.7950, 0.2636, 0.0],
    [3.0 / 7.0, 0.9445, 0.5293, 0.0],
    [0.5, 0.9543, 0.7276, 0.0122],
    [4.0 / 7.0, 0.9543, 0.8905, 0.0980],
    [2.0 / 3.0, 0.9543, 0.9984, 0.3018],
    [5.0 / 7.0, 0.9543, 1.0, 0.4250],
    [6.0 / 7.0, 0.9573, 1.0, 0.7915],
    [1.0, 0.9938, 1.0, 0.9962],
];

/// The color of one of `n` parts of split light; all parts together are about white.
pub(super) fn band_color(i: u32, n: u32) -> DVec3 {
    let n = f64::from(n.max(1));
    let up_to = |t: f64| {
        let k = SPECTRUM.partition_point(|row| row[0] < t).clamp(1, SPECTRUM.len() - 1);
        let ([t0, r0, g0, b0], [t1, r1, g1, b1]) = (SPECTRUM[k - 1], SPECTRUM[k]);
        DVec3::new(r0, g0, b0).lerp(DVec3::new(r1, g1, b1), ((t - t0) / (t1 - t0)).clamp(0.0, 1.0))
    };
    up_to((f64::from(i) + 1.0) / n) - up_to(f64::from(i) / n)
}

/// The refracted direction by Snell's law for a unit direction `d` against the unit normal `n` (d · n < 0) and the ratio of the index
/// beyond to the index here; `None` where light is totally reflected.
pub(super) fn refracted(d: DVec3, n: DVec3, ratio: f64) -> Option<DVec3> {
    let eta = 1.0 / ratio;
    let cos = -d.dot(n);
    let k = 1.0 - eta * eta * (1.0 - cos * cos);
    (k >= 0.0).then(|| d * eta + n * (eta * cos - k.sqrt()))
}

/// What is left of light on its way to a surface: its own interior fades where the ray is inside of it. Ways that end at other surfaces do
/// not fade, nor do those that come in by a part of a combination with another interior (measured).
pub(super) fn inner_attenuation(stack: &Stack, object: &Object, depth: f64) -> DVec3 {
    match &object.interior {
        Some(own) if stack.iter().any(|w| w.interior.as_ref().is_some_and(|i| Arc::ptr_eq(i, own))) => attenuation(own, depth),
        _ => DVec3::ONE,
    }
}

/// What an interior leaves of light over a depth: color + (1 − color) / (1 + (depth / distance) ^ power), exponential for powers from 1000
/// (documentation, "Attenuation").
pub(super) fn attenuation(interior: &Interior, depth: f64) -> DVec3 {
    // A power of 0 halves the light at any depth (measured); without a distance there is no fading.
    if interior.fade_distance == 0.0 {
        return DVec3::ONE;
    }
    let d = depth.max(0.0) / interior.fade_distance.abs();
    if interior.fade_power >= 1000.0 {
        // Each color fades by itself: white does not.
        return exponential(interior.fade_color, d);
    }
    let left = 1.0 / (1.0 + fns::pow(d, interior.fade_power));
    interior.fade_color + (DVec3::ONE - interior.fade_color) * left
}

fn exponential(color: DVec3, d: f64) -> DVec3 {
    let left = |c: f64| fns::exp(-d * (1.0 - c));
    DVec3::new(left(color.x), left(color.y), left(color.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn split_light_has_the_colors_measured() {
        for (n, i, color) in [(7, 2, [0.2708, 0.3787, 0.0]), (3, 1, [0.1593, 0.7348, 0.3018]), (2, 1, [0.0395, 0.2724, 0.984])] {
            assert!((band_color(i, n) - DVec3::from(color)).abs().max_element() < 2e-4);
        }
        let all: DVec3 = (0..20).map(|i| band_color(i, 20)).sum();
        assert!((all - DVec3::ONE).abs().max_element() < 0.01);
    }

    #[test]
    fn refraction_follows_snell() {
        let d = DVec3::new(0.6, 0.0, -0.8);
        let t = refracted(d, DVec3::Z, 1.5).unwrap();
        assert!((t.x - 0.4).abs() < 1e-12 && (t.length() - 1.0).abs() < 1e-12);
        assert!(refracted(DVec3::new(0.8, 0.0, -0.6), DVec3::Z, 1.0 / 1.5).is_none());
        assert!((refracted(d, DVec3::Z, 1.0).unwrap() - d).length() < 1e-12);
    }
}
