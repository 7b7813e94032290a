//! Surfaces: layers of a texture under every light, with mirrored and refracted rays.

use arrayvec::ArrayVec;
use etendue_procedural::{Color, Context, Finish, Layer};
use glam::{DVec2, DVec3};

use super::finish::{diffuse, highlights, iridescence, metallic, opacity, reflectance, reflected, stirred};
use super::photons::photons_found_on;
use super::refract::{Stack, band_color, beyond, fresnel_ratio, refracted};
use super::shadow::Receiver;
use super::trace::{First, Ray, Traced, Tracer};
use super::{ClassicWorld, peak};
use crate::solid::{Line, RayKind, SolidHit};

/// A stack of layers that counts at a hit, and where it is evaluated.
struct Stacked<'a> {
    weight: f64,
    layers: &'a [Layer],
    p: DVec3,
    normal: DVec3,
    uv: DVec2,
}

/// A list that mostly is short: the first entries need no memory of their own.
struct Few<T> {
    first: ArrayVec<T, 4>,
    more: Vec<T>,
}

impl<T> Few<T> {
    fn new() -> Self {
        Self { first: ArrayVec::new(), more: Vec::new() }
    }

    fn push(&mut self, entry: T) {
        if let Err(full) = self.first.try_push(entry) {
            self.more.push(full.element());
        }
    }

    fn iter(&self) -> impl Iterator<Item = &T> {
        self.first.iter().chain(&self.more)
    }
}

/// What all layers at a hit share.
struct Place<'a, 'h> {
    ray: &'h Ray<'h>,
    hit: &'h SolidHit<'a>,
    /// Normal towards the viewer, before perturbation.
    n: DVec3,
    /// Towards the viewer.
    view: DVec3,
    /// Lights and their colors here, once they are known.
    lights: Few<Lit>,
    knows_lights: bool,
    /// Light of surfaces around, once it is known.
    around: Option<DVec3>,
}

/// A light as it arrives.
#[derive(Clone, Copy)]
struct Lit {
    d: DVec3,
    color: DVec3,
    highlights: bool,
    is_photon: bool,
}

/// Most layers of a texture whose mirrors count.
const MIRRORS: usize = 32;

/// Where light goes on behind a surface with the perturbed normal `n` over `flat`; `None` where it is totally reflected.
fn through(d: DVec3, n: DVec3, flat: DVec3, ratio: f64) -> Option<DVec3> {
    if ratio == 1.0 { Some(d) } else { refracted(d, if d.dot(n) < 0.0 { n } else { flat }, ratio) }
}

impl<'a> Tracer<'a, '_> {
    /// The light that a surface sends along a ray.
    pub(super) fn surface(&mut self, ray: &Ray<'_>, hit: &SolidHit<'a>) -> Traced {
        let world: &'a ClassicWorld = self.world;
        let back = hit.n.dot(ray.line.d) > 0.0;
        let n = if back { -hit.n } else { hit.n };
        if ray.depth == 0 && self.wants_first && self.first.is_none() {
            self.first = Some(First {
                p: hit.p,
                n,
                uv: if self.wants_uv { world.world.uv(hit) } else { DVec2::ZERO },
                depth: hit.t,
                albedo: DVec3::ZERO,
                leaf: hit.leaf,
            });
        }
        let mut place = Place { ray, hit, n, view: -ray.line.d, lights: Few::new(), knows_lights: false, around: None };
        // Most surfaces have one texture of one stack.
        if let Some(layers) = world.world.only_layers(hit, back) {
            return self.stack(&mut place, &Stacked { weight: 1.0, layers, p: hit.p, normal: n, uv: hit.uv });
        }
        let context = Context { normal: n, ray: ray.line.d, uv: hit.uv, ..world.context(hit.p) };
        let mut stacks: Few<Stacked<'a>> = Few::new();
        world.world.textures(hit, back, &mut |weight, texture| {
            let Some(texture) = texture else { return };
            texture.resolve(&context, &mut |share, layers, at| {
                stacks.push(Stacked { weight: weight * share, layers, p: at.p, normal: at.normal, uv: at.uv });
            });
        });
        let mut sum = Traced { color: DVec3::ZERO, alpha: 0.0, t: 0.0 };
        for stack in stacks.iter() {
            let traced = self.stack(&mut place, stack);
            sum.color += traced.color * stack.weight;
            sum.alpha += traced.alpha * stack.weight;
        }
        if stacks.first.is_empty() {
            sum.alpha = 1.0;
        }
        sum
    }

    /// One stack of layers, from the top: each adds its light through those above it.
    fn stack(&mut self, place: &mut Place<'a, '_>, stack: &Stacked<'a>) -> Traced {
        let world: &'a ClassicWorld = self.world;
        let ray = place.ray;
        let settings = world.settings();
        let context = Context { normal: stack.normal, ray: ray.line.d, uv: stack.uv, ..world.context(stack.p) };
        let old = stack.layers.iter().rev().find_map(|l| l.finish.old_interior.ior);
        let mut across = None;
        let mut ratio = || across.get_or_insert_with(|| beyond(ray.inside, place.hit, old, ray.band)).1;
        let mut color = DVec3::ZERO;
        let mut passing = DVec3::ONE;
        let mut top_normal = None;
        let mut albedo = DVec3::ZERO;
        let mut mirrors: ArrayVec<(DVec3, DVec3, &Finish), MIRRORS> = ArrayVec::new();
        for layer in stack.layers.iter().rev() {
            let pigment = layer.pigment.color(&context);
            let n = match &layer.normal {
                Some(normal) => normal.perturb(place.n, &context),
                None => place.n,
            };
            top_normal.get_or_insert(n);
            let finish = &*layer.finish;
            let opacity = opacity(&pigment, settings.version);
            if opacity != 0.0 {
                albedo += passing * pigment.rgb * opacity;
                let mut glow = finish.emission;
                // Radiosity stands in for ambient light, but in scenes that end in an older version counts beside it (measured).
                if settings.radiosity.is_none() || settings.version < 370 {
                    glow += finish.ambient * settings.ambient_light;
                }
                if settings.radiosity.is_some() && finish.diffuse != 0.0 {
                    glow += self.around(place, n) * finish.diffuse;
                }
                color += passing * pigment.rgb * glow * opacity;
            }
            color += passing * self.lit(place, layer, &pigment, n, opacity);
            let ior = if finish.reflection.fresnel { fresnel_ratio(ray.inside, place.hit, old, ray.band) } else { 1.0 };
            let mirror = reflectance(&finish.reflection, n.dot(place.view).clamp(0.0, 1.0), ior, pigment.rgb);
            let share = passing * mirror;
            if peak(share.abs()) > 0.0 && ray.weight * peak(share.abs()) >= settings.adc_bailout {
                let _ = mirrors.try_push((share, n, finish));
            }
            passing *= pigment.passing();
            if finish.conserve_energy {
                passing *= (DVec3::ONE - mirror).max(DVec3::ZERO);
            }
            if passing == DVec3::ZERO {
                break;
            }
        }
        if let Some(first) = self.first.as_mut().filter(|_| ray.depth == 0) {
            first.albedo += albedo * stack.weight;
        }
        let mut alpha = 1.0;
        let n = top_normal.unwrap_or(place.n);
        if peak(passing.abs()) > 0.0 && through(ray.line.d, n, place.n, ratio()).is_none() {
            // Light that is totally reflected is not colored, and there is no other mirror (measured).
            mirrors.clear();
            color += self.mirrored(place, n, ray.weight);
            passing = DVec3::ZERO;
        }
        for &(share, n, finish) in &mirrors {
            let seen = self.mirrored(place, n, ray.weight * peak(share.abs()));
            color += share * reflected(&finish.reflection, seen);
        }
        let weight = ray.weight * peak(passing.abs());
        if peak(passing.abs()) > 0.0 && weight >= settings.adc_bailout {
            let (next, ratio) = across.unwrap_or_else(|| beyond(ray.inside, place.hit, old, ray.band));
            let beyond = match self.colors(place) {
                Some(colors) => self.split(place, n, old, colors, weight),
                _ => self.beyond(place, n, next, ratio, ray.band, weight),
            };
            color += passing * beyond.color;
            alpha = 1.0 - peak(passing) * (1.0 - beyond.alpha);
        }
        Traced { color, alpha: alpha.clamp(0.0, 1.0), t: 0.0 }
    }

    /// Light of surfaces around a place, for its normal or, with `normal on`, the perturbed one.
    fn around(&mut self, place: &mut Place<'a, '_>, n: DVec3) -> DVec3 {
        let perturbed = self.world.settings().radiosity.as_ref().is_some_and(|r| r.normal);
        if perturbed {
            return self.gathered(place.hit.p, n, place.ray);
        }
        if place.around.is_none() {
            place.around = Some(self.gathered(place.hit.p, place.n, place.ray));
        }
        place.around.unwrap_or_default()
    }

    /// Diffuse light and highlights of a layer under all lights.
    fn lit(&mut self, place: &mut Place<'a, '_>, layer: &Layer, pigment: &Color, n: DVec3, opacity: f64) -> DVec3 {
        let finish = &*layer.finish;
        let shines = place.ray.gather == 0 && (finish.phong != 0.0 || finish.specular != 0.0);
        let scatters = opacity != 0.0 && pigment.rgb != DVec3::ZERO && (finish.diffuse != 0.0 || finish.diffuse_back != 0.0);
        let unseen = self.gathering.as_ref().is_some_and(|g| !g.sees_lights(place.ray.gather));
        if unseen || !shines && !scatters {
            return DVec3::ZERO;
        }
        if !place.knows_lights {
            self.lights(place);
        }
        let both = place.hit.object.double_illuminate;
        let photons_found = if self.world.photons.is_some() { photons_found_on(n.dot(place.n)) } else { 1.0 };
        let mut sum = DVec3::ZERO;
        let settings = self.world.settings();
        let film = finish.irid.filter(|f| f.amount != 0.0).map(|f| stirred(f, place.hit.p, settings.noise_generator));
        let wavelengths = settings.irid_wavelength;
        for light in place.lights.iter() {
            let cos = n.dot(light.d);
            let front = light.d.dot(place.n) > 0.0;
            let mut answer = DVec3::ZERO;
            if scatters {
                let share = if front {
                    diffuse(finish, finish.diffuse, cos.max(0.0))
                } else {
                    let back = diffuse(finish, finish.diffuse_back, (-cos).max(0.0));
                    back + if both { diffuse(finish, finish.diffuse, (-cos).max(0.0)) } else { 0.0 }
                };
                let mut share = share * opacity;
                if finish.crand > 0.0 && share > 0.0 && !light.is_photon {
                    share = (share - finish.crand * f64::from(self.stream.next_1d())).max(0.0);
                }
                answer += light.color * pigment.rgb * share;
            }
            if shines && light.highlights && (front || both) {
                let (n, cos) = if front { (n, cos) } else { (-n, -cos) };
                let strength = highlights(finish, n, light.d, place.view);
                if strength != 0.0 {
                    answer += light.color * metallic(pigment.rgb, finish.metallic, cos) * strength;
                }
            }
            if let Some(film) = film {
                answer *= iridescence(&film, n.dot(light.d), n.dot(place.view), wavelengths);
            }
            sum += if light.is_photon { answer * photons_found } else { answer };
        }
        sum
    }

    /// Finds all lights that shine on a place, with their colors after shadows; photons are lights.
    fn lights(&mut self, place: &mut Place<'a, '_>) {
        place.knows_lights = true;
        let (world, hit, n): (&'a ClassicWorld, _, _) = (self.world, place.hit, place.n);
        let by_photons = world.photons.is_some() && !hit.object.photons.no_collect;
        let receiver = Receiver { p: hit.p, inside: place.ray.inside, by_photons };
        let lights = &mut place.lights;
        let object = hit.object;
        let set = world.lamps_of_group.get(object.light_group as usize).or(world.lamps_of_group.first());
        for lamp in set.into_iter().flatten().filter_map(|&i| world.lamps.get(i as usize)) {
            let highlights = !lamp.light.shadowless;
            let mut add = |d: DVec3, color: DVec3| {
                if color != DVec3::ZERO {
                    lights.push(Lit { d, color, highlights, is_photon: false });
                }
            };
            if let Some(area) = lamp.light.area.filter(|a| a.illumination) {
                let [rows, columns] = area.size;
                let share = 1.0 / (f64::from(rows) * f64::from(columns));
                for i in 0..rows {
                    for j in 0..columns {
                        let jitter = if area.jitter { self.jitter() } else { DVec2::ZERO };
                        let location = lamp.place(&area, f64::from(i), f64::from(j), jitter, hit.p);
                        let towards = lamp.towards_from(location, hit.p);
                        if self.can_light(hit, n, towards.0) {
                            add(towards.0, lamp.color(location, hit.p) * self.passing(lamp, None, receiver, towards) * share);
                        }
                    }
                }
            } else {
                let towards = lamp.towards(hit.p);
                if self.can_light(hit, n, towards.0) {
                    add(towards.0, self.lamp_color(lamp, receiver, towards));
                }
            }
        }
        if let Some(photons) = world.photons.as_ref().filter(|_| by_photons) {
            photons.lights(hit.p, n, |d, color| lights.push(Lit { d, color, highlights: true, is_photon: true }));
        }
    }

    /// Whether light from a direction can count: from the viewer's side, or from the other if something there answers.
    fn can_light(&self, hit: &SolidHit<'a>, n: DVec3, d: DVec3) -> bool {
        d.dot(n) > 0.0 || hit.object.double_illuminate || self.world.world.shows_light_behind(hit.leaf)
    }

    /// What a mirror shows.
    fn mirrored(&mut self, place: &Place<'a, '_>, n: DVec3, weight: f64) -> DVec3 {
        let d = place.ray.line.d;
        let mut r = d - n * (2.0 * d.dot(n));
        // A bump may send the ray into the surface; it then leaves by as much.
        let under = r.dot(place.n);
        if under < 0.0 {
            r -= place.n * (2.0 * under);
        }
        let line = Line { o: place.hit.p, d: r.normalize_or(place.n) };
        let ray = Ray {
            line,
            kind: RayKind::Reflection,
            level: place.ray.level + 1,
            depth: place.ray.depth + 1,
            weight,
            inside: place.ray.inside,
            gather: place.ray.gather,
            band: place.ray.band,
        };
        self.trace(&ray).color
    }

    /// Into how many colors the surface splits light.
    fn colors(&self, place: &Place<'a, '_>) -> Option<u32> {
        let interior = place.hit.object.interior.as_ref()?;
        (place.ray.band.is_none() && interior.dispersion != 1.0).then_some(interior.dispersion_samples.clamp(2, 1000))
    }

    /// What is seen through a surface that splits light: each color goes its own way.
    fn split(&mut self, place: &Place<'a, '_>, n: DVec3, old: Option<f64>, colors: u32, weight: f64) -> Traced {
        let mut sum = Traced { color: DVec3::ZERO, alpha: 0.0, t: 0.0 };
        for i in 0..colors {
            let band = Some((f64::from(i) + 0.5) / f64::from(colors));
            let (next, ratio) = beyond(place.ray.inside, place.hit, old, band);
            let seen = self.beyond(place, n, next, ratio, band, weight);
            sum.color += seen.color * band_color(i, colors);
            sum.alpha += seen.alpha / f64::from(colors);
        }
        sum
    }

    /// What is seen through the surface.
    fn beyond(&mut self, place: &Place<'a, '_>, n: DVec3, next: Stack, ratio: f64, band: Option<f64>, weight: f64) -> Traced {
        let ray = place.ray;
        let d = ray.line.d;
        let through = through(d, n, place.n, ratio).unwrap_or(d);
        let line = Line { o: place.hit.p, d: through.normalize_or(d) };
        // Rays that go straight on do not count as a level of their own, but take one to be there (measured).
        if ray.level + 1 >= self.max_level {
            return Traced { color: DVec3::ZERO, alpha: 1.0, t: 0.0 };
        }
        let level = if ratio == 1.0 { ray.level } else { ray.level + 1 };
        let on = Ray { line, kind: ray.kind, level, depth: ray.depth + 1, weight, inside: &next, gather: ray.gather, band };
        self.trace(&on)
    }
}
