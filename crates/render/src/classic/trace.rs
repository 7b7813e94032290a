//! Rays: what they hit, and what happens on their way there.

use glam::{DVec2, DVec3};

use super::radiosity::Gathering;
use super::refract::{Stack, inner_attenuation};
use super::{ClassicWorld, gray};
use crate::sampler::SampleStream;
use crate::solid::{Line, RayKind};

/// Surfaces nearer to a ray's origin than this are the one it left.
pub(super) const NEAR: f64 = 1e-4;
/// Rays of one sample. Only made-up scenes need more.
const RAY_LIMIT: u32 = 200_000;

/// Rays that lead to each other: what stands in for the stack of the thread.
pub(super) const DEPTH_LIMIT: u32 = 400;

/// A ray to be followed.
pub(super) struct Ray<'r> {
    pub(super) line: Line,
    pub(super) kind: RayKind,
    /// How many surfaces made it: 0 from the camera.
    pub(super) level: u32,
    /// How many rays led to it, those that went straight on included.
    pub(super) depth: u32,
    /// Largest share of its light that arrives at the camera.
    pub(super) weight: f64,
    /// What it is inside of.
    pub(super) inside: &'r Stack,
    /// How often light between diffuse surfaces was gathered on its way: 0 from the camera.
    pub(super) gather: u32,
    /// Its color, where light has been split by dispersion: from 0 for red to 1 for violet.
    pub(super) band: Option<f64>,
}

/// What a ray brings.
#[derive(Clone, Copy)]
pub(super) struct Traced {
    pub(super) color: DVec3,
    /// 0 where nothing hides what is behind the scene.
    pub(super) alpha: f64,
    /// How far the ray went.
    pub(super) t: f64,
}

/// What a camera ray hit first.
pub(super) struct First {
    pub(super) p: DVec3,
    pub(super) n: DVec3,
    pub(super) uv: DVec2,
    pub(super) depth: f64,
    pub(super) albedo: DVec3,
    pub(super) leaf: u32,
}

/// Follows the rays of one sample.
pub(super) struct Tracer<'a, 's> {
    pub(super) world: &'a ClassicWorld,
    pub(super) stream: &'s mut SampleStream,
    pub(super) max_level: u32,
    rays: u32,
    pub(super) ray_limit: u32,
    pub(super) first: Option<First>,
    /// What the camera sees first is asked for.
    pub(super) wants_first: bool,
    /// Radiosity, where it is on.
    pub(super) gathering: Option<Gathering<'a>>,
    /// Surface coordinates of the first hit are asked for.
    pub(super) wants_uv: bool,
}

impl<'a, 's> Tracer<'a, 's> {
    pub(super) fn new(world: &'a ClassicWorld, stream: &'s mut SampleStream, max_level: Option<u32>) -> Self {
        let max_level = max_level.unwrap_or(world.settings().max_trace_level).min(256);
        let gathering = world.radiosity.as_ref().map(Gathering::finished);
        Self { world, stream, max_level, rays: 0, ray_limit: RAY_LIMIT, first: None, wants_first: false, gathering, wants_uv: false }
    }

    /// Rays followed so far.
    pub(super) fn rays(&self) -> u32 {
        self.rays
    }

    /// A point in a unit square about the origin, to move a point of an area light within its cell.
    pub(super) fn jitter(&mut self) -> DVec2 {
        let u = self.stream.next_independent_2d();
        DVec2::new(f64::from(u.x), f64::from(u.y)) - 0.5
    }

    /// Follows a ray of the camera.
    pub(super) fn camera_ray(&mut self, line: Line, max_distance: f64) -> Traced {
        let found;
        let inside = match &self.world.around_camera {
            Some((o, around)) if *o == line.o => around,
            _ => {
                found = self.world.around(line.o);
                &found
            }
        };
        let ray = Ray { line, kind: RayKind::Camera, level: 0, depth: 0, weight: 1.0, inside, gather: 0, band: None };
        self.follow(&ray, max_distance)
    }

    /// The light that comes along a ray; black beyond the recursion level.
    pub(super) fn trace(&mut self, ray: &Ray<'_>) -> Traced {
        self.follow(ray, f64::INFINITY)
    }

    fn follow(&mut self, ray: &Ray<'_>, max_distance: f64) -> Traced {
        self.rays += 1;
        if ray.level >= self.max_level || ray.depth > DEPTH_LIMIT || self.rays > self.ray_limit {
            return Traced { color: DVec3::ZERO, alpha: 1.0, t: f64::INFINITY };
        }
        let world = self.world;
        let outlook = if ray.depth == 0 { world.outlook.as_ref() } else { None };
        let hit = world.world.nearest_from(outlook, &ray.line, NEAR, max_distance, ray.kind);
        let (mut traced, t) = match &hit {
            Some(hit) => (self.surface(ray, hit), hit.t),
            None => {
                let (color, alpha) = world.sky(ray.line.d);
                (Traced { color, alpha, t: f64::INFINITY }, f64::INFINITY)
            }
        };
        if let Some(hit) = &hit {
            traced.color *= inner_attenuation(ray.inside, hit.object, t);
        }
        if ray.inside.iter().all(|w| w.hollow) && self.gathering.as_ref().is_none_or(|g| g.sees_media(ray.gather)) {
            let group = hit.as_ref().map_or(0, |h| h.object.light_group);
            if !world.scene.atmosphere.is_empty() || ray.inside.iter().any(|w| w.interior.as_ref().is_some_and(|i| !i.media.is_empty())) {
                let clear = traced.color;
                traced.color = self.through_media(clear, &ray.line, t, ray.inside, group);
                if gray((traced.color - clear).abs()) > 0.0 {
                    traced.alpha = 1.0;
                }
            }
            if !world.scene.fogs.is_empty() || !world.scene.rainbows.is_empty() {
                let before = traced.color;
                traced.color = world.hazed(before, &ray.line, t);
                if gray((traced.color - before).abs()) > 0.0 {
                    traced.alpha = 1.0;
                }
            }
        }
        traced.t = t;
        traced
    }
}
