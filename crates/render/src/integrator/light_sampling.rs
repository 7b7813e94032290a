//! Next-event estimation: light that reaches a point straight from a light, and the densities that weigh it against
//! directions from the BSDF.

use etendue_scene::desc::BsdfDesc;

use crate::accel::Ray;
use crate::light::{Light, LightContext, LightSample, SeenPart, Sight};
use crate::math::{Vec2, Vec3};
use crate::medium::MediumStack;
use crate::sampler::{HashRng, SampleStream};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Light rays stop this much (relative) before the light, so as not to meet it.
const SHADOW_END: f32 = 1.0 - 1e-4;
/// Surfaces that light may cross straight on between two points.
const MAX_CROSSINGS: u32 = 256;

/// A light chosen and sampled.
pub(crate) struct Direct {
    /// Toward the light.
    pub sample: LightSample,
    /// Radiance over the density of choosing the light: without the density of the direction.
    pub radiance: Spectrum,
    /// Density per solid angle, of choosing the light included.
    pub pdf: f32,
    /// Light group.
    pub group: u32,
    /// The light.
    pub light: u32,
}

/// The context of a surface point for light sampling.
#[inline]
pub(super) fn context(s: &Surface) -> LightContext {
    LightContext { p: s.p, n: s.frame.n }
}

/// The same for light that is sent back into a direction: the normal is on its side.
#[inline]
pub(super) fn context_towards(s: &Surface, wo: Vec3) -> LightContext {
    let n = s.frame.n;
    LightContext { p: s.p, n: if n.dot(wo) < 0.0 { -n } else { n } }
}

/// Chooses one light for a point and samples it, by three numbers; the result is to be weighed against directions from the BSDF, always.
/// Inlined always, like the shadow rays below: with several
/// integrators as callers the compiler would not, and paths would pay for the calls.
#[inline(always)]
pub(crate) fn sample_one(scene: &Scene, ctx: &LightContext, stream: &mut SampleStream) -> Option<Direct> {
    choose_and_sample(scene, ctx, stream, |index, u| scene.lights[index as usize].sample_compensated(ctx, u))
}

/// The same, for results that need not be weighed.
#[inline]
pub(super) fn sample_one_alone(scene: &Scene, ctx: &LightContext, stream: &mut SampleStream) -> Option<Direct> {
    choose_and_sample(scene, ctx, stream, |index, u| match visible_part(scene, ctx, index) {
        Some(seen) => seen.sample(ctx, u),
        None => scene.lights[index as usize].sample(ctx, u),
    })
}

#[inline(always)]
fn choose_and_sample(
    scene: &Scene,
    ctx: &LightContext,
    stream: &mut SampleStream,
    sample: impl Fn(u32, Vec2) -> Option<LightSample>,
) -> Option<Direct> {
    let u_light = if scene.light_sampler.has_choice() { stream.next_1d() } else { stream.skip_1d() };
    let u = stream.next_2d();
    choose_and_sample_at(scene, ctx, u_light, u, sample)
}

/// [`sample_one`] by numbers in [0, 1): `u_light` chooses the light, `u` samples it.
#[inline]
pub(super) fn sample_one_at(scene: &Scene, ctx: &LightContext, u_light: f32, u: Vec2) -> Option<Direct> {
    choose_and_sample_at(scene, ctx, u_light, u, |index, u| scene.lights[index as usize].sample_compensated(ctx, u))
}

#[inline(always)]
fn choose_and_sample_at(
    scene: &Scene,
    ctx: &LightContext,
    u_light: f32,
    u: Vec2,
    sample: impl Fn(u32, Vec2) -> Option<LightSample>,
) -> Option<Direct> {
    let (index, pmf) = scene.light_sampler.sample(ctx, u_light)?;
    let sample = sample(index, u)?;
    let radiance = scene.light_radiance(index, &sample);
    let pdf = sample.pdf * pmf;
    (pdf > 0.0 && !radiance.is_black()).then_some(Direct { sample, radiance, pdf, group: scene.light_groups[index as usize], light: index })
}

/// Where walls are in the way of most of an environment map: what is seen of it from a place.
#[inline]
fn visible_part<'a>(scene: &'a Scene, ctx: &LightContext, light: u32) -> Option<SeenPart<'a>> {
    let visibility = scene.environment_visibility.as_ref().filter(|v| v.light == light)?;
    let Light::Environment(environment) = &scene.lights[light as usize] else { return None };
    visibility.at(environment, ctx, scene)
}

impl Sight for Scene {
    fn is_open(&self, o: Vec3, d: Vec3) -> bool {
        let ray = Ray::new(o, d);
        if !self.has_null {
            return !self.stops_light(&ray, false);
        }
        let mut rng = HashRng::default();
        !transmittance_through_surfaces(self, ray, MediumStack::VACUUM, false, &mut rng).is_black()
    }

    fn distance(&self, o: Vec3, d: Vec3, t_max: f32) -> Option<f32> {
        self.intersect(&Ray { t_max, ..Ray::new(o, d) }).map(|s| s.t)
    }
}

/// The share of light that passes between a surface point and a light sample; `media` are those on the side of `wo`. An unbiased
/// estimate where the light crosses a grid medium.
#[inline(always)]
pub(super) fn visibility(
    scene: &Scene,
    from: &Surface,
    wo: Vec3,
    media: &MediumStack,
    sample: &LightSample,
    rng: &mut HashRng,
) -> Spectrum {
    let ray = shadow_ray(from.offset_origin(sample.wi), sample);
    let crosses = ray.d.dot(from.ng) * wo.dot(from.ng) < 0.0;
    if crosses && scene.has_media {
        let mut media = *media;
        media.cross(scene, from, ray.d);
        return transmittance(scene, ray, &media, sample.delta, rng);
    }
    transmittance(scene, ray, media, sample.delta, rng)
}

/// The same from a point within a medium.
#[inline]
pub(super) fn visibility_in_medium(scene: &Scene, p: Vec3, media: &MediumStack, sample: &LightSample, rng: &mut HashRng) -> Spectrum {
    transmittance(scene, shadow_ray(p, sample), media, sample.delta, rng)
}

/// From a point to just before a light sample.
#[inline]
fn shadow_ray(o: Vec3, sample: &LightSample) -> Ray {
    // Aim at the light's point from where the ray really starts.
    if sample.dist.is_finite() { towards(o, sample.p) } else { Ray::new(o, sample.wi) }
}

/// The share of light that passes straight along a ray with a unit direction, through surfaces that let it and through what is between
/// them; `media` are those at the ray's origin. `to_lamp`: the ray ends at a light without extent, for which solids may cast no shadow. An
/// unbiased estimate where the ray crosses a grid medium.
#[inline(always)]
pub(super) fn transmittance(scene: &Scene, ray: Ray, media: &MediumStack, to_lamp: bool, rng: &mut HashRng) -> Spectrum {
    if scene.has_null {
        transmittance_through_surfaces(scene, ray, *media, to_lamp, rng)
    } else if scene.stops_light(&ray, to_lamp) {
        Spectrum::ZERO
    } else if let Some(medium) = scene.medium(media) {
        medium.transmittance(&ray, ray.t_max, rng)
    } else {
        Spectrum::ONE
    }
}

fn transmittance_through_surfaces(scene: &Scene, mut ray: Ray, mut media: MediumStack, to_lamp: bool, rng: &mut HashRng) -> Spectrum {
    let mut through = Spectrum::ONE;
    for _ in 0..MAX_CROSSINGS {
        let hit = if to_lamp { scene.intersect_shadow(&ray) } else { scene.intersect(&ray) };
        if hit.as_ref().is_some_and(|s| !scene.materials[s.material as usize].has_null) {
            return Spectrum::ZERO;
        }
        if let Some(medium) = scene.medium(&media) {
            through *= medium.transmittance(&ray, hit.as_ref().map_or(ray.t_max, |s| s.t), rng);
        }
        let Some(s) = hit else { return through };
        through *= scene.materials[s.material as usize].shade(scene, &s, -ray.d).null_transmittance(-ray.d);
        if through.is_black() {
            return Spectrum::ZERO;
        }
        if scene.has_media {
            media.cross(scene, &s, ray.d);
        }
        ray = beyond(&ray, &s);
    }
    Spectrum::ZERO
}

/// The rest of a shadow ray beyond a surface. It aims at the same end again: the step off the surface is across the ray, and larger than
/// the gap that is left before a near light.
pub(super) fn beyond(ray: &Ray, s: &Surface) -> Ray {
    let o = s.offset_origin(ray.d);
    if ray.t_max.is_finite() { towards(o, ray.at(ray.t_max / SHADOW_END)) } else { Ray { o, t_min: 0.0, ..*ray } }
}

/// A ray that ends just before a point.
#[inline]
pub(super) fn towards(o: Vec3, end: Vec3) -> Ray {
    let to = end - o;
    let dist = to.length();
    Ray { o, d: to / dist, t_min: 0.0, t_max: dist * SHADOW_END }
}

/// What a camera ray meets first, its distance, and the share of light that the media on the way let through. Borders of media that
/// are no surface are looked through where there are media.
pub(super) fn first_surface(scene: &Scene, ray: &Ray, rng: &mut HashRng) -> Option<(Surface, f32, Spectrum)> {
    if !scene.has_media {
        return scene.intersect(ray).map(|s| (s.t, s)).map(|(t, s)| (s, t, Spectrum::ONE));
    }
    let (mut ray, mut media, mut through, mut distance) = (*ray, scene.camera_medium, Spectrum::ONE, 0.0);
    for _ in 0..MAX_CROSSINGS {
        let s = scene.intersect(&ray)?;
        if let Some(medium) = scene.medium(&media) {
            through *= medium.transmittance(&ray, s.t, rng);
        }
        distance += s.t;
        if !is_border(scene, &s) {
            return Some((s, distance, through));
        }
        media.cross(scene, &s, ray.d);
        ray = beyond(&ray, &s);
    }
    None
}

/// Whether anything is in a ray's way; borders of media are not.
pub(super) fn is_blocked(scene: &Scene, ray: &Ray) -> bool {
    if !scene.has_media {
        return scene.occluded(ray);
    }
    let mut ray = *ray;
    for _ in 0..MAX_CROSSINGS {
        match scene.intersect(&ray) {
            None => return false,
            Some(s) if is_border(scene, &s) => {
                ray = beyond(&ray, &s);
            }
            Some(_) => return true,
        }
    }
    true
}

/// Whether a surface is only the border of a medium.
fn is_border(scene: &Scene, s: &Surface) -> bool {
    matches!(scene.materials[s.material as usize].desc, BsdfDesc::Null) && s.object(scene).emission.is_none()
}

/// The density with which [`sample_one`] would have sampled a surface point of a light from a context: that of choosing the
/// light times that of the direction.
#[inline]
pub(crate) fn pdf_surface(scene: &Scene, ctx: &LightContext, light: u32, s: &Surface) -> f32 {
    let pmf = scene.light_sampler.pmf(ctx, light);
    if pmf > 0.0 { pmf * scene.lights[light as usize].pdf_hit(ctx, s.p, s.ng) } else { 0.0 }
}

/// The same for a light that surrounds the scene.
#[inline]
pub(crate) fn pdf_infinite(scene: &Scene, ctx: &LightContext, light: u32, wi: Vec3) -> f32 {
    let pmf = scene.light_sampler.pmf(ctx, light);
    if pmf > 0.0 { pmf * scene.lights[light as usize].pdf_escaped_compensated(ctx, wi) } else { 0.0 }
}

/// The radiance of such a light and [`pdf_infinite`].
#[inline]
pub(super) fn infinite(scene: &Scene, ctx: &LightContext, light: u32, wi: Vec3) -> (Spectrum, f32) {
    let (radiance, pdf) = scene.lights[light as usize].escaped_and_pdf_compensated(ctx, wi);
    // Most directions do not meet the sun.
    if radiance.is_black() { (radiance, 0.0) } else { (radiance, scene.light_sampler.pmf(ctx, light) * pdf) }
}

/// [`pdf_infinite`] for [`sample_one_alone`].
#[inline]
pub(super) fn pdf_infinite_alone(scene: &Scene, ctx: &LightContext, light: u32, wi: Vec3) -> f32 {
    let pmf = scene.light_sampler.pmf(ctx, light);
    if pmf > 0.0 {
        pmf * match visible_part(scene, ctx, light) {
            Some(seen) => seen.pdf(wi),
            None => scene.lights[light as usize].pdf_escaped(ctx, wi),
        }
    } else {
        0.0
    }
}
