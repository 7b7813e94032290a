//! Rays that leave the lights: the first step of every method that traces particles.
//!
//! A light is chosen by its power (known without regard to any point of the scene), then a ray by [`Light::emit`]. The densities
//! are available one by one, because bidirectional methods weigh paths that were made in other ways by them. Media that emit
//! take part where the method asks for them ([`EmissionSampler::with_media`]).

use rayon::prelude::*;

use super::light_sampling::transmittance;
use super::volume_emission::{VolumeEmission, VolumeRay};
use crate::accel::{Hit, Ray};
use crate::light::{EmissionSample, Light, LightContext, LightSampler, LightSelection, SceneSphere, strength};
use crate::math::hash::hash_words;
use crate::math::{INV_PI, ONE_MINUS_EPSILON, Vec2, Vec3, warp};
use crate::medium::MediumStack;
use crate::sampler::HashRng;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Surfaces that are passed on the way to a light: from the camera to find the light's medium, or against the light to where it comes from.
const MAX_BORDERS: u32 = 4096;
/// The least share of rays that lights, and media, have of all, where both emit.
const LEAST_SHARE: f32 = 0.05;

/// A ray that leaves a light.
#[derive(Clone, Debug)]
pub struct Emission {
    /// Index of the light.
    pub light: u32,
    /// Its light group.
    pub group: u32,
    /// The ray; it starts so far off the light's surface that it does not meet it again.
    pub ray: Ray,
    /// The point of the light, or for infinite lights one outside of the scene or in their window.
    pub p: Vec3,
    /// Unit normal of the light there, on the side of the ray; the ray's direction where it has none.
    pub n: Vec3,
    /// The surface that emits; `None` for lights that are no surfaces.
    pub surface: Option<Surface>,
    /// Radiance along the ray (intensity where the position is a delta, irradiance where the direction is), texture included.
    pub radiance: Spectrum,
    /// |cos| between ray and light.
    pub cos: f32,
    /// Probability of choosing the light.
    pub pmf: f32,
    /// Density of the start by area (for infinite lights, across the ray); 1 where it is a delta.
    pub pdf_position: f32,
    /// Density of the direction per solid angle; 1 where it is a delta.
    pub pdf_direction: f32,
}

impl Emission {
    /// The power in W that the ray carries if it is the only one: the mean over rays is the power of all lights.
    #[inline]
    pub fn power(&self) -> Spectrum {
        // In this order: with pmf and densities multiplied first, tiny lights would overflow.
        self.radiance * (self.cos / self.pdf_direction) / self.pdf_position / self.pmf
    }
}

/// Chooses lights by power and rays that leave them.
#[derive(Clone, Debug)]
pub struct EmissionSampler {
    lights: LightSampler,
    sphere: SceneSphere,
    /// The media that each light is in; empty where the scene has none.
    media: Vec<MediumStack>,
    /// Media that rays leave.
    volumes: Option<VolumeEmission>,
    /// The share of rays that leave media.
    volume_share: f32,
}

impl EmissionSampler {
    /// For the lights of a scene.
    pub fn new(scene: &Scene) -> Self {
        let sphere = scene.sphere();
        let lights = LightSampler::new(&scene.lights, &sphere, LightSelection::Power);
        let media = if scene.has_media { scene.lights.par_iter().map(|l| media_of(scene, &sphere, l)).collect() } else { Vec::new() };
        Self { lights, sphere, media, volumes: None, volume_share: 0.0 }
    }

    /// For the lights of a scene and the media that emit.
    ///
    /// # Errors
    /// A sentence about media that emit and have no end.
    pub fn with_media(scene: &Scene) -> Result<Self, String> {
        let mut sampler = Self::new(scene);
        if scene.has_media {
            sampler.volumes = VolumeEmission::new(scene)?;
        }
        if let Some(volumes) = &sampler.volumes {
            let lights: f32 = scene.lights.iter().map(|l| strength(l.power(&sampler.sphere))).sum();
            let share = volumes.power() / (volumes.power() + lights.min(1e30));
            sampler.volume_share = if lights > 0.0 { share.clamp(LEAST_SHARE, 1.0 - LEAST_SHARE) } else { 1.0 };
        }
        Ok(sampler)
    }

    /// A ray that leaves a medium, where the number that chooses says so; else the number is stretched for the choice of a light
    /// ([`Self::sample`]). `Some(None)`: a ray without power.
    #[inline]
    pub fn sample_medium(
        &self,
        scene: &Scene,
        u: &mut f32,
        (u_position, u_direction): (Vec2, Vec2),
        rng: &mut HashRng,
    ) -> Option<Option<VolumeRay>> {
        let volumes = self.volumes.as_ref()?;
        let share = self.volume_share;
        if *u < share {
            let ray = volumes.sample(scene, (*u / share).min(ONE_MINUS_EPSILON), u_position, u_direction, rng);
            return Some(ray.map(|r| VolumeRay { power: r.power / share, ..r }));
        }
        *u = ((*u - share) / (1.0 - share)).clamp(0.0, ONE_MINUS_EPSILON);
        None
    }

    /// The media that the rays of a light start in. One for the whole light: a border may not go through it.
    #[inline]
    pub fn media(&self, light: u32) -> MediumStack {
        self.media.get(light as usize).copied().unwrap_or_default()
    }

    /// The sphere on which infinite lights shine.
    pub fn sphere(&self) -> &SceneSphere {
        &self.sphere
    }

    /// The probability of choosing a light.
    #[inline]
    pub fn pmf(&self, light: u32) -> f32 {
        self.lights.pmf(&LightContext { p: Vec3::ZERO, n: Vec3::ZERO }, light) * (1.0 - self.volume_share)
    }

    /// A ray for random numbers in [0, 1); `None` where nothing is emitted, which counts as a ray without power.
    pub fn sample(&self, scene: &Scene, u_light: f32, u_position: Vec2, u_direction: Vec2) -> Option<Emission> {
        let (light, pmf) = self.lights.sample(&LightContext { p: Vec3::ZERO, n: Vec3::ZERO }, u_light)?;
        let pmf = pmf * (1.0 - self.volume_share);
        let sample = emit(scene, &self.sphere, &scene.lights[light as usize], u_position, u_direction)?;
        let surface = match &scene.lights[light as usize] {
            Light::Area(area) => {
                let source = scene.light_sources[area.emission_id as usize];
                let hit = Hit { t: 0.0, u: sample.uv.x, v: sample.uv.y, prim: source.primitive, instance: 0 };
                Some(scene.surface(&Ray::new(sample.o, sample.d), &hit))
            }
            _ => None,
        };
        let radiance = match (&scene.lights[light as usize], &surface) {
            (Light::Area(area), Some(surface)) if area.textured => scene.emitted(surface, sample.d),
            (Light::Portal(_), _) => {
                // What is left of the light on its way to the window.
                let mut rng =
                    HashRng::new(hash_words([u_position.x, u_position.y, u_direction.x, u_direction.y].map(|u| u64::from(u.to_bits()))));
                let way = Ray::new(sample.o, -sample.d);
                sample.radiance * transmittance(scene, way, &self.media(light), false, &mut rng)
            }
            _ => sample.radiance,
        };
        let o = surface.as_ref().map_or(sample.o, |s| s.offset_origin(sample.d));
        let emission = Emission {
            light,
            group: scene.light_groups[light as usize],
            ray: Ray::new(o, sample.d),
            p: sample.o,
            n: sample.n,
            surface,
            radiance,
            cos: sample.cos,
            pmf,
            pdf_position: sample.pdf_position,
            pdf_direction: sample.pdf_direction,
        };
        // Lights of 1e-30 m or 1e30 W may overflow: they count as dark.
        let power = emission.power();
        (power.is_finite() && !power.is_black()).then_some(emission)
    }

    /// The density of the start of a ray that leaves a light along the unit direction `d`: at the point `p` of an area light, by area; for
    /// infinite lights, across the ray, of rays that come to `p`; 1 where it is a delta. The choice of the light is not in it.
    pub fn pdf_position(&self, scene: &Scene, light: u32, p: Vec3, d: Vec3) -> f32 {
        match &scene.lights[light as usize] {
            Light::Area(area) => area.pdf_area(p) * if area.two_sided { 0.5 } else { 1.0 },
            Light::Point(_) | Light::Spot(_) | Light::Picture(_) => 1.0,
            Light::Directional(_) | Light::Sun(_) | Light::Constant(_) | Light::Environment(_) => {
                let from = p - self.sphere.center;
                self.sphere.pdf_across((from - d * from.dot(d)).length_squared())
            }
            Light::Portal(portal) => portal.pdf_position(d),
        }
    }

    /// The density per solid angle of a ray's unit direction `d`, given the light and (for area lights) its normal at the start,
    /// either side's. 1 where it is a delta.
    pub fn pdf_direction(&self, scene: &Scene, light: u32, n: Vec3, d: Vec3) -> f32 {
        match &scene.lights[light as usize] {
            Light::Area(area) => {
                let cos = if area.two_sided { n.dot(d).abs() } else { n.dot(d) };
                cos.max(0.0) * INV_PI
            }
            Light::Point(_) => warp::UNIFORM_SPHERE_PDF,
            Light::Spot(spot) => spot.pdf_emit(d),
            Light::Picture(picture) => picture.pdf_emit(d),
            Light::Directional(_) => 1.0,
            Light::Portal(portal) => portal.pdf_emit(d),
            other => other.pdf_escaped(&LightContext { p: Vec3::ZERO, n: Vec3::ZERO }, -d),
        }
    }
}

/// A ray that leaves a light. That of an infinite light starts before the first surface that is in its way, however far away: surfaces
/// without end may be between the light and the disk where other rays start.
fn emit(scene: &Scene, sphere: &SceneSphere, light: &Light, u_position: Vec2, u_direction: Vec2) -> Option<EmissionSample> {
    let mut sample = light.emit(sphere, u_position, u_direction)?;
    if sphere.endless && light.is_infinite() && !matches!(light, Light::Portal(_)) {
        let mut surfaces = 0;
        while let Some(s) = scene.intersect(&Ray::new(sample.o, -sample.d)) {
            surfaces += 1;
            if surfaces > MAX_BORDERS {
                return None;
            }
            sample.o = s.offset_origin(-sample.d);
        }
    }
    Some(sample)
}

/// The media at a light, a little before it on the side to which it shines.
fn media_of(scene: &Scene, sphere: &SceneSphere, light: &Light) -> MediumStack {
    if let Light::Portal(portal) = light {
        return media_at(scene, portal.center() - portal.normal() * (1e-4 * sphere.radius));
    }
    match emit(scene, sphere, light, Vec2::splat(0.5), Vec2::splat(0.5)) {
        Some(start) => media_at(scene, start.o + start.d * (1e-4 * sphere.radius)),
        None => scene.camera_medium,
    }
}

/// The media at a point: those that a straight way from the camera, whose media are known, comes to.
pub(super) fn media_at(scene: &Scene, end: Vec3) -> MediumStack {
    let mut media = scene.camera_medium;
    let mut o = scene.camera_origin();
    for _ in 0..MAX_BORDERS {
        let to = end - o;
        let distance = to.length();
        if !(distance > 0.0 && distance.is_finite()) {
            break;
        }
        let ray = Ray { o, d: to / distance, t_min: 0.0, t_max: distance };
        let Some(s) = scene.intersect(&ray) else { break };
        media.cross(scene, &s, ray.d);
        o = s.offset_origin(ray.d);
    }
    media
}
