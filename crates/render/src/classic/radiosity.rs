//! Light between diffuse surfaces: irradiance gathered at scattered points and interpolated (Ward, Rubinstein and Clear 1988, "A Ray Tracing
//! Solution for Diffuse Interreflection", doi:10.1145/378456.378490), with the parameters of `radiosity`.
//!
//! Points are gathered before the picture is made, on grids from coarse to fine, in batches: a batch sees the points of the batches before it
//! and its own, never those that other threads make at the same time, and its points are added in order. So the cache, and with it the
//! picture, does not depend on threads.

use std::collections::HashMap;

use etendue_procedural::fns;
use etendue_scene::desc::classic::Radiosity;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::refract::Stack;
use super::trace::{DEPTH_LIMIT, Ray, Tracer};
use super::{ClassicWorld, gray, peak};
use crate::sampler::{Sampler, SamplerKind};
use crate::solid::{Line, RayKind};

use std::f64::consts::TAU;

/// Most points of a cache.
const POINT_LIMIT: usize = 2_000_000;
/// Pixels of the largest batch.
const BATCH: usize = 64;

/// Irradiance at a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    p: DVec3,
    n: DVec3,
    color: DVec3,
    /// Distance within which the color may be used, at an error bound of 1.
    radius: f64,
}

impl Point {
    /// Ward's error of using the point at another place (eq. 4 without its constant).
    fn error(&self, p: DVec3, n: DVec3) -> f64 {
        let d = p - self.p;
        // What lies behind the place sees other things than the point does.
        if d.dot(n + self.n) < -0.05 * self.radius {
            return f64::INFINITY;
        }
        d.length() / self.radius + (1.0 - n.dot(self.n)).max(0.0).sqrt()
    }
}

/// What several points say of a place.
#[derive(Clone, Copy, Default)]
struct Mean {
    weight: f64,
    color: DVec3,
    count: u32,
}

impl Mean {
    fn add(&mut self, point: &Point, error: f64, bound: f64) {
        let w = 1.0 - error / bound;
        let weight = w * w / error.max(1e-3);
        self.weight += weight;
        self.color += point.color * weight;
        self.count += 1;
    }
}

/// Points of one recursion level, in cells as large as they reach.
#[derive(Default)]
struct Level {
    points: Vec<Point>,
    cells: HashMap<[i32; 4], Vec<u32>>,
    /// Sizes of cells in use, as exponents of 2.
    sizes: Vec<i32>,
}

impl Level {
    fn insert(&mut self, point: Point, reach: f64) {
        if self.points.len() >= POINT_LIMIT || !(reach > 0.0 && reach.is_finite() && point.p.is_finite()) {
            return;
        }
        // The next power of two above twice the reach.
        let size = (fns::log2(2.0 * reach).clamp(-60.0, 60.0) + 1.0).floor() as i32;
        self.cells.entry(cell(point.p, size)).or_default().push(self.points.len() as u32);
        self.points.push(point);
        if let Err(at) = self.sizes.binary_search(&size) {
            self.sizes.insert(at, size);
        }
    }

    fn visit(&self, p: DVec3, mut visit: impl FnMut(&Point)) {
        for &size in &self.sizes {
            let half = 0.25 * fns::exp2(f64::from(size));
            let (a, b) = (cell(p - half, size), cell(p + half, size));
            for x in a[0]..=b[0] {
                for y in a[1]..=b[1] {
                    for z in a[2]..=b[2] {
                        for &i in self.cells.get(&[x, y, z, size]).into_iter().flatten() {
                            visit(&self.points[i as usize]);
                        }
                    }
                }
            }
        }
    }
}

fn cell(p: DVec3, size: i32) -> [i32; 4] {
    let q = p / fns::exp2(f64::from(size));
    let index = |v: f64| v.floor().clamp(-1e9, 1e9) as i32;
    [index(q.x), index(q.y), index(q.z), size]
}

/// All points, by recursion level.
pub(super) struct Cache {
    settings: Radiosity,
    levels: Vec<Level>,
}

impl Cache {
    fn new(settings: Radiosity) -> Self {
        let levels = (0..settings.recursion_limit.clamp(1, 20)).map(|_| Level::default()).collect();
        Self { settings, levels }
    }

    /// The cache of a scene for a picture of a size.
    pub(super) fn build(world: &ClassicWorld, settings: &Radiosity, size: [u32; 2]) -> Self {
        let mut cache = Self::new(settings.clone());
        let sampler = Sampler { kind: SamplerKind::Sobol, seed: 0, spp: 1 };
        let width = f64::from(size[0].max(1));
        let (mut step, last) =
            ((settings.pretrace_start.clamp(0.005, 1.0) * width).max(1.0), (settings.pretrace_end.clamp(0.002, 1.0) * width).max(1.0));
        loop {
            let mut pixels = grid(size, step);
            let mut rest = &mut pixels[..];
            let mut batch = 4;
            while !rest.is_empty() {
                let (now, later) = rest.split_at_mut(batch.min(rest.len()));
                let found: Vec<Vec<Vec<Point>>> = now
                    .par_iter()
                    .enumerate()
                    .with_max_len(1)
                    .map(|(i, at)| {
                        let mut stream = sampler.stream(at.x as u32, at.y as u32, i as u32);
                        let mut tracer = Tracer::new(world, &mut stream, None);
                        tracer.gather_into(&cache);
                        if let Some(line) = world.rays.line(world, *at, DVec2::splat(0.5)) {
                            tracer.camera_ray(line, world.rays.max_distance());
                        }
                        tracer.take_points()
                    })
                    .collect();
                for points in found {
                    cache.insert(points);
                }
                rest = later;
                batch = (batch * 2).min(BATCH);
            }
            if step <= last {
                break;
            }
            step = (0.5 * step).max(last);
        }
        cache
    }

    fn insert(&mut self, points: Vec<Vec<Point>>) {
        for (level, points) in self.levels.iter_mut().zip(points) {
            for point in points {
                level.insert(point, point.radius * self.settings.error_bound.clamp(1e-6, 1e6));
            }
        }
    }

    fn mean(&self, level: usize, p: DVec3, n: DVec3, bound: f64, own: &[Point]) -> Mean {
        let mut mean = Mean::default();
        let mut visit = |point: &Point| {
            let error = point.error(p, n);
            if error < bound {
                mean.add(point, error, bound);
            }
        };
        if let Some(level) = self.levels.get(level) {
            level.visit(p, &mut visit);
        }
        own.iter().for_each(visit);
        mean
    }
}

/// Middles of squares of a size that cover the picture.
fn grid(size: [u32; 2], step: f64) -> Vec<DVec2> {
    let [columns, rows] = size.map(|s| ((f64::from(s) / step).ceil().max(1.0) as u32).min(4096));
    let at = |k: u32, n: u32, s: u32| (f64::from(k) + 0.5) / f64::from(n) * f64::from(s);
    (0..rows).flat_map(|j| (0..columns).map(move |i| DVec2::new(at(i, columns, size[0]), at(j, rows, size[1])))).collect()
}

/// What a tracer needs of radiosity.
pub(super) struct Gathering<'a> {
    cache: &'a Cache,
    /// Points made by this tracer, by level; `None` while the picture is made.
    own: Option<Vec<Vec<Point>>>,
}

impl<'a> Gathering<'a> {
    /// For making the picture from a finished cache.
    pub(super) fn finished(cache: &'a Cache) -> Self {
        Self { cache, own: None }
    }
}

impl<'a> Tracer<'a, '_> {
    /// Makes new points beside those of a cache.
    fn gather_into(&mut self, cache: &'a Cache) {
        let own = cache.levels.iter().map(|_| Vec::new()).collect();
        self.gathering = Some(Gathering { cache, own: Some(own) });
        self.ray_limit = 4_000_000;
    }

    /// The points made.
    fn take_points(&mut self) -> Vec<Vec<Point>> {
        self.gathering.take().and_then(|g| g.own).unwrap_or_default()
    }

    /// Light from all surfaces around that falls on a place: its irradiance over π. `ray` is the one that led there.
    pub(super) fn gathered(&mut self, p: DVec3, n: DVec3, ray: &Ray) -> DVec3 {
        let Some(g) = &self.gathering else { return DVec3::ZERO };
        let cache: &'a Cache = g.cache;
        let settings = &cache.settings;
        let level = ray.gather as usize;
        if level >= cache.levels.len() {
            return DVec3::ZERO;
        }
        let first_pass = g.own.is_some();
        let own: &[Point] = g.own.as_ref().map_or(&[], |o| &o[level]);
        let bound = settings.error_bound * if first_pass { settings.low_error_factor } else { 1.0 };
        let wanted = if first_pass && level == 0 { settings.nearest_count.max(1) } else { 1 };
        let mut mean = cache.mean(level, p, n, bound, own);
        if !first_pass && mean.count == 0 {
            // Better a far point than none: the picture's pass is not to make new ones.
            mean = cache.mean(level, p, n, bound * 2.0, own);
        }
        if mean.count >= wanted && mean.weight > 0.0 {
            return self.finish_gathered(mean.color / mean.weight);
        }
        let point = self.gather(p, n, level, &ray.inside);
        if let Some(own) = self.gathering.as_mut().and_then(|g| g.own.as_mut()) {
            own[level].push(point);
            mean.add(&point, 0.0, bound.max(1e-9));
        } else {
            return self.finish_gathered(point.color);
        }
        self.finish_gathered(mean.color / mean.weight)
    }

    fn finish_gathered(&self, color: DVec3) -> DVec3 {
        let Some(g) = &self.gathering else { return DVec3::ZERO };
        let s = &g.cache.settings;
        let gray = DVec3::splat(gray(color));
        (color + (gray - color) * s.gray_threshold) * s.brightness
    }

    /// A new point: rays over the hemisphere, weighed by the cosine.
    fn gather(&mut self, p: DVec3, n: DVec3, level: usize, inside: &Stack) -> Point {
        let (settings, eye) = match &self.gathering {
            Some(g) => (g.cache.settings.clone(), (p - self.world.rays.location()).length()),
            None => return Point { p, n, color: DVec3::ZERO, radius: 0.0 },
        };
        // Deeper levels matter less.
        let count = (settings.count >> (2 * level).min(8)).max(settings.count.min(8));
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
                inside: inside.clone(),
                band: None,
                gather: level as u32 + 1,
            };
            let traced = self.trace(&ray);
            let mut color = traced.color;
            if settings.max_sample > 0.0 && peak(color) > settings.max_sample {
                color *= settings.max_sample / peak(color);
            }
            sum += color;
            near += 1.0 / traced.t.max(1e-6);
        }
        let radius = f64::from(count) / near.max(1e-12);
        let least = settings.minimum_reuse * eye;
        Point { p, n, color: sum / f64::from(count), radius: radius.clamp(least, (settings.maximum_reuse * eye).max(least)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, radius: f64) -> Point {
        Point { p: DVec3::new(x, 0.0, 0.0), n: DVec3::Z, color: DVec3::splat(x), radius }
    }

    #[test]
    fn cells_find_every_point_that_reaches() {
        let mut level = Level::default();
        let points: Vec<Point> = (0..400).map(|i| point(f64::from(i) * 0.37 - 70.0, 0.01 * f64::from(i % 50 + 1))).collect();
        for p in &points {
            level.insert(*p, p.radius);
        }
        for k in 0..200 {
            let p = DVec3::new(f64::from(k) * 0.71 - 71.0, 0.0, 0.0);
            let mut found = 0;
            level.visit(p, |q| found += u32::from((q.p - p).length() < q.radius));
            let all = points.iter().filter(|q| (q.p - p).length() < q.radius).count();
            assert_eq!(found as usize, all, "at {p}");
        }
    }

    #[test]
    fn error_grows_with_distance_and_angle() {
        let q = point(0.0, 2.0);
        assert!((q.error(DVec3::X, DVec3::Z) - 0.5).abs() < 1e-12);
        assert!(q.error(DVec3::X, DVec3::new(0.6, 0.0, 0.8)) > 0.9);
        assert_eq!(q.error(DVec3::new(0.0, 0.0, -1.0), DVec3::Z), f64::INFINITY);
    }
}
