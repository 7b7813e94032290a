//! `photons`: light that targets mirror and refract onto other surfaces and into media, followed from the lights (documentation,
//! "Photons"; Jensen 1996, "Global Illumination using Photon Maps", doi:10.1007/978-3-7091-7484-5_3; Jensen and Christensen 1998, "Efficient
//! Simulation of Light Transport in Scenes with Participating Media using Photon Maps", doi:10.1145/280814.280925).
//!
//! Each light shoots at each target, in rings around the direction to its middle, one photon for each square of the spacing there. A photon
//! that meets its target goes on as the `photons` of the surfaces on its way say, and is kept where it falls on a surface that scatters it.
//! Light does not grow weaker with distance in this model, so that a photon counts for as much as its cone is wide where it lands
//! (measured). Surfaces then see as much light as the nearest `gather` photons bring to the disc that holds them. In return targets that
//! refract photons of a light cast full shadows of it on whatever collects photons, provided that any photon arrives at all.
//!
//! Behind the target photons are also left at equal steps in the interiors that scatter and collect them, each for as much light as its
//! step is long; what such media scatter is the light of the nearest photons in the sphere that holds them, by the direction of each. All
//! that follows was measured: media weaken photons from one surface to the next, but not within the part; atmospheric media neither collect
//! nor weaken any. Surfaces and media that refuse photons are lit through targets as through anything transparent.

use etendue_procedural::{Context, fns};
use etendue_scene::desc::classic::{Media, PhotonSettings, Photons};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::finish::reflectance;
use super::light::Lamp;
use super::media::collect_photons;
use super::refract::{Stack, band_color, beyond, fresnel_ratio, inner_attenuation, refracted};
use super::trace::{DEPTH_LIMIT, NEAR};
use super::{ClassicWorld, atmosphere, peak};
use crate::photon::tree::{MAX_NEIGHBORS, Neighbors};
use crate::photon::{Photon, PhotonTree, Route};
use crate::solid::{Line, PhotonTarget, RayKind, SolidHit};
use crate::spectrum::Spectrum;

use std::f64::consts::{PI, TAU};

/// Largest search radius by itself, in spacings: what POV-Ray's pictures show at the edges of shadows.
const REACH: f64 = 27.0;
/// Most photons shot; larger numbers are shot with a wider spacing.
const MOST_SHOT: f64 = 8e6;
/// Most photons kept, 32 bytes each; where there would be more, the spacing is doubled.
const MOST_KEPT: usize = 30_000_000;
/// Most pieces that one photon may break into.
const MOST_PIECES: u32 = 2000;

/// Photons that graze a surface more than this count as if by this cosine.
const LEAST_COS: f64 = 0.01;
/// How much nearer photons must be across a bumped surface than along it.
const FLATNESS: f64 = 4.5;
/// Most photons that one photon may leave in media.
const MOST_IN_MEDIA: usize = 10_000;
/// Enough for any spacing that fits into memory at all.
const MOST_DOUBLINGS: u32 = 16;
/// Photons shot before those kept are counted.
const CHUNK: usize = 4096;

/// Photons on surfaces and in media.
pub(super) struct PhotonLight {
    surfaces: Nearby,
    media: Nearby,
    /// How much wider the spacing is than was asked for.
    widened: f64,
}

/// Photons, with how many of them are gathered from how far.
struct Nearby {
    tree: PhotonTree,
    gather: usize,
    radius: f32,
}

/// Where photons were kept.
#[derive(Default)]
struct Kept {
    surfaces: Vec<Photon>,
    media: Vec<Photon>,
    /// Photons have come to something that does not refuse them, be it black.
    has_come: bool,
}

/// A photon to be shot: its way, the share of the solid angle or of the area that it stands for, and a number of its own.
#[derive(Clone, Copy)]
struct Shot {
    line: Line,
    share: f64,
    number: u32,
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
    /// Shoots photons; `None` where none arrives anywhere.
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
        let mut spacing = wanted.max((squares / MOST_SHOT).sqrt());
        aims.iter_mut().for_each(|aim| aim.spacing *= spacing);
        let mut kept = None;
        for _ in 0..MOST_DOUBLINGS {
            kept = world.shoot_all(&aims, settings);
            if kept.is_some() {
                break;
            }
            spacing *= 2.0;
            aims.iter_mut().for_each(|aim| aim.spacing *= 2.0);
        }
        let kept = kept?;
        if !kept.has_come && kept.media.is_empty() {
            return None;
        }
        let gather = (settings.gather[1] as usize).clamp(1, MAX_NEIGHBORS);
        let nearby = |photons: Vec<Photon>, radius: f64, factor: f64, spacing: f64| {
            let radius = if radius > 0.0 { radius * if factor > 0.0 { factor } else { 1.0 } } else { REACH * spacing };
            Nearby { tree: PhotonTree::new(photons), gather, radius: radius as f32 }
        };
        let [radius, factor, media_radius, media_factor] = settings.radius;
        let surfaces = nearby(kept.surfaces, radius, factor, spacing);
        let media = nearby(kept.media, media_radius, media_factor, spacing * settings.media_factor.max(1.0));
        Some(Self { surfaces, media, widened: spacing / wanted })
    }

    /// What is to be said of photons that are not as was asked for.
    pub(super) fn warning(&self) -> Option<String> {
        let factor = self.widened;
        (factor > 1.0)
            .then(|| format!("photons: their spacing is {factor:.3} times as wide as asked for, or there would be too many of them"))
    }

    /// Gives the photons that fall on the side of `n`: where each came from, and the color of a lamp that would bring as much light.
    pub(super) fn lights(&self, p: DVec3, n: DVec3, mut give: impl FnMut(DVec3, DVec3)) {
        let n = n.as_vec3();
        let accept = |photon: &Photon| photon.from().dot(n) > 0.0 && photon.normal().dot(n) > 0.3;
        let mut found = Neighbors::new();
        let Nearby { tree, gather, radius } = &self.surfaces;
        let square = tree.nearest(p.as_vec3(), *gather, *radius, accept, &mut found);
        if !(square > 0.0) {
            return;
        }
        let density = 1.0 / (PI * f64::from(square));
        for (_, index) in &found {
            let photon = tree.photon(*index);
            let from = photon.from();
            // A lamp's light is spread over a slanted surface, a photon's already is.
            let cos = f64::from(from.dot(photon.normal())).max(LEAST_COS);
            give(from.as_dvec3(), Vec3::from_array(photon.power().rgb()).as_dvec3() * (density / cos));
        }
    }

    /// Adds the light of the photons around a place in media: the direction to where each came from, and what a lamp there would be.
    pub(super) fn light_in_media(&self, p: DVec3, lights: &mut Vec<(DVec3, DVec3)>) {
        let Nearby { tree, gather, radius } = &self.media;
        if tree.is_empty() {
            return;
        }
        let mut found = Neighbors::new();
        let square = f64::from(tree.nearest(p.as_vec3(), *gather, *radius, |_| true, &mut found));
        if !(square > 0.0) {
            return;
        }
        let density = 1.0 / (4.0 / 3.0 * PI * square * square.sqrt());
        lights.extend(found.iter().map(|(_, index)| {
            let photon = tree.photon(*index);
            (photon.from().as_dvec3(), Vec3::from_array(photon.power().rgb()).as_dvec3() * density)
        }));
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
    photons.target.is_some() && !passes_through(photons) && sends_on(photons.refraction, lamp.light.photon_refraction) && lamp.shoots()
}

/// Whether an object refracts or mirrors photons of a lamp: what it says, else what the lamp says, unless the lamp forbids it (measured).
fn sends_on(object: Option<bool>, lamp: Option<bool>) -> bool {
    lamp != Some(false) && object.or(lamp) == Some(true)
}

/// Whether photons on their way to a target go straight through an object: not if it is one that is told to refract them (measured).
fn passes_through(photons: &PhotonSettings) -> bool {
    photons.pass_through && !(photons.target.is_some() && photons.refraction == Some(true))
}

/// The share of the photons on a flat surface that the search finds about a bumped normal, by the cosine between the two.
///
/// Light on bumps of 0.8 to 22 degrees is as if a photon at the distance d counted as one at √(d² + 4.5 d |d · n|), n the bumped normal: the
/// mean of 1 / (1 + a |cos φ|) over all directions φ on the surface, a 4.5 times the sine (POV-Ray's pictures to 0.02).
pub(super) fn photons_found_on(cos: f64) -> f64 {
    let a = FLATNESS * (1.0 - (cos * cos).min(1.0)).sqrt();
    let square = 1.0 - a * a;
    let quotient = if square.abs() < 1e-6 {
        1.0
    } else if square > 0.0 {
        fns::acos(a) / square.sqrt()
    } else {
        fns::acosh(a) / (-square).sqrt()
    };
    quotient * 2.0 / PI
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
    /// Directions, or for parallel lights places on a disc.
    fn shots(&self, jitter: f64) -> Vec<Shot> {
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
                out.push(Shot { line, share: share / f64::from(count), number: out.len() as u32 });
            }
        }
        out
    }
}

impl Kept {
    fn len(&self) -> usize {
        self.surfaces.len() + self.media.len()
    }
}

impl ClassicWorld {
    /// Shoots the photons of all lights at all targets; `None` where too many are kept.
    fn shoot_all(&self, aims: &[Aim<'_>], settings: &Photons) -> Option<Kept> {
        let mut kept = Kept::default();
        for aim in aims {
            for shots in aim.shots(settings.jitter).chunks(CHUNK) {
                let more: Vec<Kept> = shots.par_iter().map(|shot| self.shoot(aim, *shot, settings)).collect();
                for mut more in more {
                    kept.surfaces.append(&mut more.surfaces);
                    kept.media.append(&mut more.media);
                    kept.has_come |= more.has_come;
                }
                if kept.len() > MOST_KEPT {
                    return None;
                }
            }
        }
        Some(kept)
    }

    /// Follows a photon to all places where it is kept.
    fn shoot(&self, aim: &Aim<'_>, shot: Shot, settings: &Photons) -> Kept {
        let (lamp, start, share) = (aim.lamp, shot.line, shot.share);
        let light = &lamp.light;
        let most = settings.max_trace_level.unwrap_or(self.settings().max_trace_level).min(DEPTH_LIMIT);
        let bailout = settings.adc_bailout.unwrap_or(self.settings().adc_bailout);
        let mut kept = Kept::default();
        let mut pieces = 0;
        let mut pending = vec![Going { line: start, color: DVec3::ONE, way: 0.0, inside: self.around(start.o), level: 0, band: None }];
        while let Some(going) = pending.pop() {
            pieces += 1;
            if pieces > MOST_PIECES {
                break;
            }
            let hit = self.world.nearest(&going.line, NEAR, f64::INFINITY, RayKind::Photon);
            let length = hit.as_ref().map_or(atmosphere::FAR, |h| h.t);
            if going.level > 0 && settings.media > 0 {
                self.leave_in_media(aim, &shot, &going, length, settings, &mut kept.media);
            }
            let Some(hit) = hit else { continue };
            let way = going.way + hit.t;
            let mut color = going.color * inner_attenuation(&going.inside, hit.object, hit.t);
            if going.inside.iter().all(|w| w.hollow) {
                let media: Vec<&Media> = going.inside.iter().filter_map(|w| w.interior.as_ref()).flat_map(|i| &i.media).collect();
                color *= self.media_passing(&media, &going.line, [0.0, hit.t], &mut || 0.5);
            }
            let photons = &hit.object.photons;
            let met = self.met(&hit, &going);
            if going.level == 0 && passes_through(photons) {
                let inside = beyond(&going.inside, &hit, None, going.band).0;
                let line = Line { o: hit.p, d: going.line.d };
                pending.push(Going { line, color: color * met.passing, way, inside, ..going });
                continue;
            }
            if going.level == 0 && !aim.target.leaves.contains(&hit.leaf) {
                continue;
            }
            if going.level > 0 && !photons.no_collect {
                kept.has_come = true;
            }
            if going.level > 0 && met.scatters && !photons.no_collect {
                let power = if light.parallel {
                    lamp.color(light.location, hit.p) * share
                } else {
                    lamp.color(start.o, start.o + start.d * way) * (share * way * way)
                };
                let power = (power * color).as_vec3().max(Vec3::ZERO);
                if power.is_finite() && power != Vec3::ZERO && hit.p.as_vec3().is_finite() {
                    let (from, ng) = ((-going.line.d).as_vec3(), self.world.geometric_normal(&hit).as_vec3());
                    kept.surfaces.push(Photon::new(hit.p.as_vec3(), from, ng, Spectrum::from_rgb(power.to_array()), 0, 1, Route::Caustic));
                }
            }
            if going.level + 1 >= most {
                continue;
            }
            let next = |d: DVec3, color: DVec3, inside: Stack, band: Option<f64>| {
                let line = Line { o: hit.p, d: d.normalize_or(going.line.d) };
                Going { line, color, way, inside, level: going.level + 1, band }
            };
            let d = going.line.d;
            let mirrored = d - met.normal * (2.0 * d.dot(met.normal));
            if sends_on(photons.reflection, light.photon_reflection) && peak(color * met.mirror) > bailout {
                pending.push(next(mirrored, color * met.mirror, going.inside.clone(), going.band));
            }
            if !sends_on(photons.refraction, light.photon_refraction) || !(peak(color * met.passing) > bailout) {
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

    /// Leaves photons along a part of a photon's way, where it is inside of media that collect them.
    fn leave_in_media(&self, aim: &Aim<'_>, shot: &Shot, going: &Going, length: f64, settings: &Photons, kept: &mut Vec<Photon>) {
        if !collect_photons(&going.inside) {
            return;
        }
        let (lamp, start) = (aim.lamp, shot.line.o);
        let light = &lamp.light;
        // As far apart as photons are when they enter.
        let spread = if light.parallel { 1.0 } else { going.way / (aim.middle - start).length().max(1e-12) };
        let spacing = aim.spacing * settings.media_factor.abs().max(1e-3) * spread;
        let most = (settings.media as usize).min(MOST_IN_MEDIA.saturating_sub(kept.len()));
        let steps = (length / spacing).ceil().min(most as f64);
        let step = length / steps;
        let from = (-going.line.d).as_vec3();
        let shift = hash(shot.number, going.level);
        for k in 0..steps as u32 {
            let t = (f64::from(k) + shift) * step;
            let way = going.way + t;
            let power = if light.parallel {
                lamp.color(light.location, going.line.at(t)) * (shot.share * step)
            } else {
                // One measure of the width too many, but so it is (measured to 0.1 %).
                lamp.color(start, start + shot.line.d * way) * (shot.share * way * way * step * way / going.way)
            };
            let (p, power) = (going.line.at(t).as_vec3(), (power * going.color).as_vec3().max(Vec3::ZERO));
            if power.is_finite() && power != Vec3::ZERO && p.is_finite() {
                kept.push(Photon::new(p, from, from, Spectrum::from_rgb(power.to_array()), 0, 1, Route::Caustic));
            }
        }
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
                    met.scatters |= finish.diffuse != 0.0 || finish.phong != 0.0 || finish.specular != 0.0;
                    let ior = if finish.reflection.fresnel { fresnel_ratio(&going.inside, hit, met.old, going.band) } else { 1.0 };
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
    /// It has a diffuse part or highlights.
    scatters: bool,
    /// Index of refraction that the texture gives, as in old scenes.
    old: Option<f64>,
}
