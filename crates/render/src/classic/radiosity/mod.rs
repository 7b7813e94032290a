//! Light between diffuse surfaces: irradiance gathered at scattered points and interpolated (Ward, Rubinstein and Clear 1988, "A Ray Tracing
//! Solution for Diffuse Interreflection", doi:10.1145/378456.378490), with the parameters of `radiosity`.
//!
//! Points are gathered before the picture is made, on grids from coarse to fine and at last at every pixel, in batches: a batch sees the
//! points of the batches before it and its own, never those that other threads make at the same time, and its points are added in order.
//! So the cache, and with it the picture, does not depend on threads.

mod samples;

use etendue_procedural::fns;
use etendue_scene::desc::classic::Radiosity;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::refract::Stack;
use super::trace::{DEPTH_LIMIT, Ray, Tracer};
use super::{ClassicWorld, peak};
use crate::sampler::{Sampler, SamplerKind};
use crate::solid::{Line, RayKind};
use samples::{Level, Mean, Point};

use std::f64::consts::TAU;

/// Places whose points are made at the same time, and those of the first grid.
const BATCH: usize = 64;
const FIRST_BATCH: usize = 8;
/// Rays for one pixel of the grids.
const PIXEL_RAYS: u32 = 250_000;
/// Rays for all grids, for each pixel of the picture, and at least. Only made-up scenes need more.
const RAYS_PER_PIXEL: u64 = 20_000;
const LEAST_RAYS: u64 = 20_000_000;

/// All points, by recursion level.
pub(super) struct Cache {
    settings: Radiosity,
    levels: Vec<Level>,
    pixel: Footprint,
    /// Rays that may still be spent.
    rays: u64,
}

/// Width of a pixel at a distance: a + b · distance.
#[derive(Clone, Copy)]
struct Footprint(f64, f64);

impl Footprint {
    /// Of the middle of a picture.
    fn new(world: &ClassicWorld, size: [u32; 2]) -> Self {
        let middle = DVec2::new(f64::from(size[0]), f64::from(size[1])) * 0.5;
        let line = |x: f64| world.rays.line(world, middle + DVec2::new(x, 0.0), DVec2::splat(0.5));
        let (Some(a), Some(b)) = (line(-0.5), line(0.5)) else { return Self(0.0, 0.0) };
        let sane = |v: f64| if v.is_finite() { v } else { 0.0 };
        Self(sane((b.o - a.o).length()), sane((b.d - a.d).length()))
    }

    fn at(self, distance: f64) -> f64 {
        self.0 + self.1 * distance
    }
}

/// Which points are made and used.
#[derive(Clone, Copy, PartialEq)]
enum Pass {
    /// More of them than the picture needs, from a grid.
    Grid,
    /// What the grids left out, from all pixels.
    Pixels,
    /// None are made.
    Picture,
}

impl Cache {
    fn new(settings: &Radiosity, pixel: Footprint, rays: u64) -> Self {
        let sane = |v: f64, least: f64, most: f64, or: f64| if v.is_finite() { v.clamp(least, most) } else { or };
        let settings = Radiosity {
            count: settings.count.clamp(1, 20_000),
            error_bound: sane(settings.error_bound, 1e-4, 1e4, 1.8),
            low_error_factor: sane(settings.low_error_factor, 1e-3, 1e3, 0.5),
            brightness: sane(settings.brightness, -1e6, 1e6, 1.0),
            gray_threshold: sane(settings.gray_threshold, 0.0, 1.0, 0.0),
            max_sample: sane(settings.max_sample, -1.0, 1e30, -1.0),
            minimum_reuse: sane(settings.minimum_reuse, 0.0, 1e3, 0.015),
            maximum_reuse: sane(settings.maximum_reuse, 0.0, 1e6, 0.2),
            recursion_limit: settings.recursion_limit.clamp(1, 20),
            ..settings.clone()
        };
        let levels = (0..settings.recursion_limit).map(|_| Level::default()).collect();
        Self { settings, levels, pixel, rays }
    }

    /// The cache of a scene for a picture of a size.
    pub(super) fn build(world: &ClassicWorld, settings: &Radiosity, size: [u32; 2]) -> Self {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let rays = pixels.saturating_mul(RAYS_PER_PIXEL).max(LEAST_RAYS);
        let mut cache = Self::new(settings, Footprint::new(world, size), rays);
        let width = f64::from(size[0].max(1));
        let (mut step, last) =
            ((settings.pretrace_start.clamp(0.005, 1.0) * width).max(1.0), (settings.pretrace_end.clamp(0.002, 1.0) * width).max(1.0));
        // Without points of deeper levels, each place of a batch makes its own: few at first.
        let mut batch = FIRST_BATCH;
        loop {
            cache.pass(world, &Grid::new(size, step), batch, Pass::Grid);
            batch = BATCH;
            if !(step > last) {
                break;
            }
            step = (0.5 * step).max(last);
        }
        cache.pass(world, &Grid::new(size, 1.0), batch, Pass::Pixels);
        cache
    }

    /// Makes the points that places of the picture need. A batch has places far from each other: neighbors would make the same point twice.
    fn pass(&mut self, world: &ClassicWorld, grid: &Grid, batch: usize, pass: Pass) {
        let sampler = Sampler { kind: SamplerKind::Sobol, seed: 0, spp: 1 };
        let batches = grid.len().div_ceil(batch);
        for first in 0..batches {
            if self.rays == 0 {
                return;
            }
            let cache = &*self;
            let made: Vec<(Vec<Vec<Point>>, u32)> = (0..batch)
                .into_par_iter()
                .with_max_len(1)
                .filter_map(|k| grid.place(first + k * batches))
                .map(|at| {
                    let mut stream = sampler.stream(at.x as u32, at.y as u32, 0);
                    let mut tracer = Tracer::new(world, &mut stream, None);
                    tracer.gather_into(cache, pass);
                    if let Some(line) = world.rays.line(world, at, DVec2::splat(0.5)) {
                        tracer.camera_ray(line, world.rays.max_distance());
                    }
                    (tracer.take_points(), tracer.rays())
                })
                .collect();
            for (points, rays) in made {
                self.insert(points);
                self.rays = self.rays.saturating_sub(u64::from(rays));
            }
        }
    }

    fn insert(&mut self, points: Vec<Vec<Point>>) {
        let bound = self.settings.error_bound;
        for (level, points) in self.levels.iter_mut().zip(points) {
            for point in points {
                level.insert(point, bound);
            }
        }
    }
}

/// Middles of squares that cover the picture, row by row.
struct Grid {
    size: [u32; 2],
    columns: usize,
    rows: usize,
}

impl Grid {
    /// For squares of a size in pixels.
    fn new(size: [u32; 2], step: f64) -> Self {
        let [columns, rows] = size.map(|s| ((f64::from(s) / step).ceil().max(1.0) as usize).min(4096));
        Self { size, columns, rows }
    }

    fn len(&self) -> usize {
        self.columns * self.rows
    }

    fn place(&self, index: usize) -> Option<DVec2> {
        let at = |k: usize, n: usize, s: u32| (k as f64 + 0.5) / n as f64 * f64::from(s);
        let place = || DVec2::new(at(index % self.columns, self.columns, self.size[0]), at(index / self.columns, self.rows, self.size[1]));
        (index < self.len()).then(place)
    }
}

/// What a tracer needs of radiosity.
pub(super) struct Gathering<'a> {
    cache: &'a Cache,
    pass: Pass,
    /// Points made by this tracer, by level.
    own: Vec<Level>,
}

impl<'a> Gathering<'a> {
    /// For making the picture from a finished cache.
    pub(super) fn finished(cache: &'a Cache) -> Self {
        Self { cache, pass: Pass::Picture, own: Vec::new() }
    }

    /// Media and fogs count on the way of a ray of the `gather`th bounce.
    pub(super) fn sees_media(&self, gather: u32) -> bool {
        if gather > 0 { self.cache.settings.media } else { self.pass == Pass::Picture }
    }

    /// Lights count on surfaces that a ray of the `gather`th bounce meets: they do not on those of camera rays that only make points.
    pub(super) fn sees_lights(&self, gather: u32) -> bool {
        gather > 0 || self.pass == Pass::Picture
    }
}

impl<'a> Tracer<'a, '_> {
    /// Makes new points beside those of a cache.
    fn gather_into(&mut self, cache: &'a Cache, pass: Pass) {
        let own = cache.levels.iter().map(|_| Level::default()).collect();
        self.gathering = Some(Gathering { cache, pass, own });
        self.ray_limit = PIXEL_RAYS;
    }

    /// The points made.
    fn take_points(&mut self) -> Vec<Vec<Point>> {
        self.gathering.take().map(|g| g.own.into_iter().map(Level::into_points).collect()).unwrap_or_default()
    }

    /// Light from all surfaces around that falls on a place: its irradiance over π. `ray` is the one that led there.
    pub(super) fn gathered(&mut self, p: DVec3, n: DVec3, ray: &Ray) -> DVec3 {
        let Some(g) = &self.gathering else { return DVec3::ZERO };
        let (cache, pass): (&'a Cache, Pass) = (g.cache, g.pass);
        let settings = &cache.settings;
        let index = ray.gather as usize;
        let Some(level) = cache.levels.get(index) else { return DVec3::ZERO };
        let bound = settings.error_bound * if pass == Pass::Grid { settings.low_error_factor } else { 1.0 };
        let many = index == 0 && (pass == Pass::Grid || pass == Pass::Pixels && settings.always_sample);
        let wanted = if many { settings.nearest_count.max(1) } else { 1 };
        let mut mean = level.mean(p, n, bound);
        if let Some(own) = g.own.get(index) {
            mean.merge(&own.mean(p, n, bound));
        }
        if pass == Pass::Picture && mean.count == 0 {
            // Better a far point than none: the picture's pass is not to make new ones.
            mean = level.loose_mean(p, n, bound);
        }
        if mean.count < wanted || mean.color().is_none() {
            if cache.rays == 0 {
                mean = Mean::default();
            } else {
                let point = self.gather(p, n, index, ray.inside);
                mean.add(&point, 0.0, bound);
                // With all rays spent it has seen too little.
                let complete = self.rays() < self.ray_limit;
                if let Some(own) = self.gathering.as_mut().and_then(|g| g.own.get_mut(index)).filter(|_| complete) {
                    own.insert(point, settings.error_bound);
                }
            }
        }
        finish(settings, mean.color().unwrap_or_else(|| level.average()))
    }

    /// A new point: rays over the hemisphere, weighed by the cosine.
    fn gather(&mut self, p: DVec3, n: DVec3, index: usize, inside: &Stack) -> Point {
        let eye = (p - self.world.rays.location()).length();
        let Some(Gathering { cache, .. }) = &self.gathering else {
            return Point { p, n, color: DVec3::ZERO, radius: 0.0, pixel: 0.0 };
        };
        let cache: &'a Cache = cache;
        let settings = &cache.settings;
        // Deeper levels matter less.
        let count = (settings.count >> (2 * index).min(8)).max(settings.count.min(8));
        let aside = if n.x.abs() < 0.5 { DVec3::X } else { DVec3::Y };
        let t = n.cross(aside).normalize_or(DVec3::X);
        let b = n.cross(t);
        let (mut sum, mut near) = (DVec3::ZERO, 0.0);
        for i in 0..count {
            let u = (f64::from(i) + 0.5) / f64::from(count);
            let (sin, cos) = fns::sin_cos(TAU * f64::from(i.reverse_bits()) / 4_294_967_296.0);
            let d = t * (u.sqrt() * cos) + b * (u.sqrt() * sin) + n * (1.0 - u).sqrt();
            let ray = Ray {
                line: Line { o: p, d: d.normalize_or(n) },
                kind: RayKind::Radiosity,
                level: 0,
                depth: DEPTH_LIMIT - 20,
                weight: 1.0,
                inside,
                band: None,
                gather: index as u32 + 1,
            };
            let traced = self.trace(&ray);
            let mut color = traced.color;
            if settings.max_sample > 0.0 && peak(color) > settings.max_sample {
                color *= settings.max_sample / peak(color);
            }
            sum += color;
            near += 1.0 / traced.t.max(1e-6);
        }
        let least = settings.minimum_reuse * eye;
        let radius = (f64::from(count) / near.max(1e-12)).min(settings.maximum_reuse * eye).max(least);
        Point { p, n, color: sum / f64::from(count), radius, pixel: cache.pixel.at(eye) }
    }
}

/// What becomes of gathered light: less color (`gray_threshold`, with weights as measured) and `brightness`.
fn finish(settings: &Radiosity, color: DVec3) -> DVec3 {
    let gray = DVec3::splat(color.dot(DVec3::new(0.297, 0.589, 0.114)));
    (color + (gray - color) * settings.gray_threshold) * settings.brightness
}
