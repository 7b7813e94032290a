//! `photons`: light that targets mirror and refract onto other surfaces, followed from the lights (documentation, "Photons"; Jensen 1996,
//! "Global Illumination using Photon Maps", doi:10.1007/978-3-7091-7484-5_3).
//!
//! Each light shoots at each target, in rings around the direction to its middle, one photon for each square of the spacing there. A photon
//! that meets its target goes on as the `photons` of the surfaces on its way say, and is kept where it falls on a surface that scatters it.
//! Light does not grow weaker with distance in this model, so that a photon counts for as much as its cone is wide where it lands
//! (measured). Surfaces then see as much light as the nearest `gather` photons bring to the disc that holds them. In return targets that
//! refract photons of a light cast full shadows of it.

use etendue_procedural::{Context, fns};
use etendue_scene::desc::classic::{PhotonSettings, Photons};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::finish::reflectance;
use super::light::Lamp;
use super::refract::{Stack, band_color, beyond, inner_attenuation, refracted};
use super::trace::{DEPTH_LIMIT, NEAR};
use super::{ClassicWorld, peak};
use crate::photon::tree::{MAX_NEIGHBORS, Neighbors};
use crate::photon::{Photon, PhotonTree, Route};
use crate::solid::{Line, PhotonTarget, RayKind, SolidHit};
use crate::spectrum::Spectrum;

use std::f64::consts::{PI, TAU};

/// Largest search radius by itself, in spacings: what POV-Ray's pictures show at the edges of shadows.
const REACH: f64 = 27.0;
/// Most photons shot; larger numbers are shot with a wider spacing.
const MOST_SHOT: f64 = 8e6;
/// Most photons kept, 32 bytes each.
const MOST_KEPT: usize = 30_000_000;
/// Most pieces that one photon may break into.
const MOST_PIECES: u32 = 2000;

/// Photons on surfaces.
pub(super) struct PhotonLight {
    tree: PhotonTree,
    gather: usize,
    radius: f32,
}

/// A photon on its way.
struct Going {
    line: Line,
    color: DVec3,
    /// How far it has come.
    way: f64,
    inside: Stack,
    level: u32,
    band: Option<f64>,
}

/// Photons of one light to be shot at one target.
struct Aim<'a> {
    lamp: &'a Lamp,
    target: &'a PhotonTarget,
    middle: DVec3,
    radius: f64,
    spacing: f64,
}

impl PhotonLight {
    /// Shoots photons; `None` where none is kept.
    pub(super) fn build(world: &ClassicWorld, settings: &Photons) -> Option<Self> {
        let targets: Vec<PhotonTarget> =
            world.world.photon_targets().into_iter().filter(|t| t.bounds.is_finite() && !t.bounds.is_empty()).collect();
        let mut aims: Vec<Aim<'_>> = Vec::new();
        for lamp in world.lamps.iter().filter(|l| l.shoots()) {
            for target in &targets {
                let (middle, radius) =
                    (0.5 * (target.bounds.min + target.bounds.max), 0.5 * (target.bounds.max - target.bounds.min).length());
                aims.push(Aim { lamp, target, middle, radius, spacing: target.spacing.clamp(1e-3, 1e3) });
            }
        }
        // In squares of the spacing.
        let squares: f64 = aims.iter().map(|a| PI * a.radius * a.radius / (a.spacing * a.spacing)).sum();
        if !(squares > 0.0) || !squares.is_finite() {
            return None;
        }
        let wanted = if settings.spacing > 0.0 { settings.spacing } else { (squares / f64::from(settings.count.max(1))).sqrt() };
        let spacing = wanted.max((squares / MOST_SHOT).sqrt());
        let mut kept = Vec::new();
        for aim in &mut aims {
            aim.spacing *= spacing;
            let more: Vec<Photon> =
                aim.rays(settings.jitter).into_par_iter().flat_map_iter(|(d, share)| world.shoot(aim, d, share, settings)).collect();
            kept.extend(more);
            if kept.len() > MOST_KEPT {
                break;
            }
        }
        if kept.is_empty() {
            return None;
        }
        let [radius, factor, ..] = settings.radius;
        let radius = if radius > 0.0 { radius * if factor > 0.0 { factor } else { 1.0 } } else { REACH * spacing };
        let gather = (settings.gather[1] as usize).clamp(1, MAX_NEIGHBORS);
        Some(Self { tree: PhotonTree::new(kept), gather, radius: radius as f32 })
    }

    /// Light of the photons that fall on the side of `n`, as much as a lamp of that color would send straight down.
    pub(super) fn light(&self, p: DVec3, n: DVec3) -> DVec3 {
        let n = n.as_vec3();
        let accept = |photon: &Photon| photon.from().dot(n) > 0.0 && photon.normal().dot(n) > 0.3;
        let mut found = Neighbors::new();
        let square = self.tree.nearest(p.as_vec3(), self.gather, self.radius, accept, &mut found);
        let mut sum = Vec3::ZERO;
        for (_, index) in &found {
            sum += Vec3::from_array(self.tree.photon(*index).power().rgb());
        }
        if square > 0.0 { sum.as_dvec3() / (PI * f64::from(square)) } else { DVec3::ZERO }
    }
}

impl Lamp {
    /// Whether it shoots photons at all.
    fn shoots(&self) -> bool {
        let light = &self.light;
        let off = light.photon_reflection == Some(false) && light.photon_refraction == Some(false);
        !off && !light.shadowless && peak(light.color.abs()) > 0.0 && light.color.is_finite()
    }
}

/// Whether a surface's shadow of a lamp is left to the photons.
pub(super) fn takes_shadow(photons: &PhotonSettings, lamp: &Lamp) -> bool {
    photons.target.is_some()
        && photons.refraction == Some(true)
        && !photons.pass_through
        && lamp.light.photon_refraction != Some(false)
        && lamp.shoots()
}

/// A number in [0, 1) of two others: the jitter of a photon (Mueller's 32-bit integer hash).
fn hash(a: u32, b: u32) -> f64 {
    let mut x = a.wrapping_mul(0x9e37_79b9) ^ b.wrapping_add(0x7f4a_7c15);
    for _ in 0..2 {
        x = (x ^ (x >> 16)).wrapping_mul(0x045d_9f3b);
    }
    f64::from(x ^ (x >> 16)) / 4_294_967_296.0
}

impl Aim<'_> {
    /// Directions, or for parallel lights places on a disc, with the share of the solid angle or of the area that each stands for.
    fn rays(&self, jitter: f64) -> Vec<(Line, f64)> {
        let light = &self.lamp.light;
        let jitter = jitter.clamp(0.0, 1.0);
        let to = self.middle - light.location;
        let distance = to.length();
        let axis = if light.parallel { -self.lamp.towards(self.middle).0 } else { to.normalize_or(DVec3::Z) };
        let (u, v) = axis.any_orthonormal_pair();
        // Rings of a disc, or of a cone that holds the target.
        let (reach, step) = if light.parallel {
            (self.radius, self.spacing)
        } else if distance > self.radius {
            (fns::asin(self.radius / distance), self.spacing / distance)
        } else {
            (PI, self.spacing / self.radius.max(1e-12))
        };
        let rings = (reach / step).ceil().clamp(1.0, 1e5) as u32;
        let mut out = Vec::new();
        for ring in 0..rings {
            let (a, b) = (f64::from(ring) * step, f64::from(ring + 1) * step);
            let middle = 0.5 * (a + b);
            let around = if light.parallel { middle } else { fns::sin(middle.min(PI)) };
            let share = if light.parallel { PI * (b * b - a * a) } else { TAU * (fns::cos(a.min(PI)) - fns::cos(b.min(PI))) };
            let count = (TAU * around / step).round().clamp(1.0, 1e7) as u32;
            for i in 0..count {
                let shift = |k: u32| jitter * (hash(ring.wrapping_mul(2).wrapping_add(k), i) - 0.5);
                let turn = TAU * (f64::from(i) + 0.5 * f64::from(ring % 2) + shift(0)) / f64::from(count);
                let (sin, cos) = fns::sin_cos(turn);
                let aside = u * cos + v * sin;
                let off = (middle + step * shift(1)).abs();
                let line = if light.parallel {
                    let depth = (self.middle - light.location).dot(axis);
                    Line { o: self.middle - axis * depth + aside * off, d: axis }
                } else {
                    let (sin, cos) = fns::sin_cos(off);
                    Line { o: light.location, d: axis * cos + aside * sin }
                };
                out.push((line, share / f64::from(count)));
            }
        }
        out
    }
}

impl ClassicWorld {
    /// Follows a photon to all places where it is kept.
    fn shoot(&self, aim: &Aim<'_>, start: Line, share: f64, settings: &Photons) -> Vec<Photon> {
        let lamp = aim.lamp;
        let light = &lamp.light;
        let most = settings.max_trace_level.unwrap_or(self.settings().max_trace_level).min(DEPTH_LIMIT);
        let bailout = settings.adc_bailout.unwrap_or(self.settings().adc_bailout);
        let mut kept = Vec::new();
        let mut pieces = 0;
        let mut pending = vec![Going { line: start, color: DVec3::ONE, way: 0.0, inside: self.around(start.o), level: 0, band: None }];
        while let Some(going) = pending.pop() {
            pieces += 1;
            if pieces > MOST_PIECES {
                break;
            }
            let Some(hit) = self.world.nearest(&going.line, NEAR, f64::INFINITY, RayKind::Photon) else { continue };
            let way = going.way + hit.t;
            if going.level == 0 && !aim.target.leaves.contains(&hit.leaf) {
                continue;
            }
            let color = going.color * inner_attenuation(&going.inside, hit.object, hit.t);
            let photons = &hit.object.photons;
            if photons.pass_through {
                let inside = beyond(&going.inside, &hit, None, going.band).0;
                let line = Line { o: hit.p, d: going.line.d };
                pending.push(Going { line, color, way, inside, ..going });
                continue;
            }
            let met = self.met(&hit, &going);
            if going.level > 0 && met.scatters && !photons.no_collect {
                let power = if light.parallel {
                    lamp.color(light.location, hit.p) * share
                } else {
                    lamp.color(start.o, start.o + start.d * way) * (share * way * way)
                };
                let power = (power * color).as_vec3().max(Vec3::ZERO);
                if power.is_finite() && power != Vec3::ZERO && hit.p.as_vec3().is_finite() {
                    let (from, ng) = ((-going.line.d).as_vec3(), self.world.geometric_normal(&hit).as_vec3());
                    kept.push(Photon::new(hit.p.as_vec3(), from, ng, Spectrum::from_rgb(power.to_array()), 0, 1, Route::Caustic));
                }
            }
            if going.level + 1 >= most {
                continue;
            }
            let reflects = photons.reflection == Some(true) && light.photon_reflection != Some(false);
            let refracts = photons.refraction == Some(true) && light.photon_refraction != Some(false);
            let next = |d: DVec3, color: DVec3, inside: Stack, band: Option<f64>| {
                let line = Line { o: hit.p, d: d.normalize_or(going.line.d) };
                Going { line, color, way, inside, level: going.level + 1, band }
            };
            let d = going.line.d;
            let mirrored = d - met.normal * (2.0 * d.dot(met.normal));
            if reflects && peak(color * met.mirror) > bailout {
                pending.push(next(mirrored, color * met.mirror, going.inside.clone(), going.band));
            }
            if !refracts || !(peak(color * met.passing) > bailout) {
                continue;
            }
            let splits = hit.object.interior.as_ref().filter(|i| going.band.is_none() && i.dispersion != 1.0);
            let bands = splits.map_or(1, |i| i.dispersion_samples.clamp(2, 64));
            for i in 0..bands {
                let (band, tint) = if bands > 1 {
                    (Some((f64::from(i) + 0.5) / f64::from(bands)), band_color(i, bands))
                } else {
                    (going.band, DVec3::ONE)
                };
                let (inside, ratio) = beyond(&going.inside, &hit, met.old, band);
                let through = if ratio == 1.0 { Some(d) } else { refracted(d, met.normal, ratio) };
                pending.push(match through {
                    Some(d) => next(d, color * met.passing * tint, inside, band),
                    None => next(mirrored, color * tint, going.inside.clone(), band),
                });
            }
        }
        kept
    }

    /// What a surface does with a photon.
    fn met(&self, hit: &SolidHit<'_>, going: &Going) -> Met {
        let d = going.line.d;
        let back = hit.n.dot(d) > 0.0;
        let n = if back { -hit.n } else { hit.n };
        let at = Context { normal: n, ray: d, uv: hit.uv, ..self.context(hit.p) };
        let mut met = Met { mirror: DVec3::ZERO, passing: DVec3::ZERO, normal: n, scatters: false, old: None };
        let mut first = true;
        self.world.textures(hit, back, &mut |weight, texture| {
            let Some(texture) = texture else { return };
            texture.resolve(&at, &mut |share, layers, at| {
                let mut passing = DVec3::splat(weight * share);
                for layer in layers.iter().rev() {
                    let finish = &*layer.finish;
                    let pigment = layer.pigment.color(at);
                    let bent = layer.normal.as_ref().map_or(n, |normal| normal.perturb(n, at));
                    if std::mem::take(&mut first) && bent.dot(d) < 0.0 {
                        met.normal = bent;
                    }
                    met.old = met.old.or(finish.old_interior.ior);
                    met.scatters |= finish.diffuse != 0.0;
                    let ior = if finish.reflection.fresnel { beyond(&going.inside, hit, met.old, going.band).1 } else { 1.0 };
                    let mirror = reflectance(&finish.reflection, (-bent.dot(d)).clamp(0.0, 1.0), ior, pigment.rgb);
                    met.mirror += passing * mirror;
                    passing *= pigment.passing();
                    if finish.conserve_energy {
                        passing *= (DVec3::ONE - mirror).max(DVec3::ZERO);
                    }
                }
                met.passing += passing;
            });
        });
        met
    }
}

/// What a surface does with a photon.
struct Met {
    mirror: DVec3,
    passing: DVec3,
    /// Against the photon.
    normal: DVec3,
    /// It has a diffuse part.
    scatters: bool,
    /// Index of refraction that the texture gives, as in old scenes.
    old: Option<f64>,
}
