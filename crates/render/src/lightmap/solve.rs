//! Irradiance at many points, in passes: what texels, vertices and every method share.
//!
//! Each point has sums of its own, to which one thread adds in the order of the sample indices. So the bits do not depend on threads,
//! on how often the work was interrupted, or on where passes end.

use std::time::Instant;

use rayon::prelude::*;

use super::method::Method;
use crate::integrator::Estimate;
use crate::integrator::irradiance::Receiver;
use crate::math::Vec3;
use crate::sampler::{SampleStream, Sampler};
use crate::scene::{Scene, Surface};
use crate::session::{Cancel, Observer, Status, Stop};
use crate::spectrum::Spectrum;

/// The longest pass.
const PASS_LIMIT: u32 = 16;
/// Samples before the error can be told from the spread.
const ERROR_SPP: u32 = 16;
/// Points darker than this share of the mean are judged by it, as their relative error would never end.
const DARK: f64 = 0.05;

/// The sums of a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Irradiance, R, G, B.
    pub irradiance: [f64; 3],
    /// Square of a sample's mean of R, G and B.
    pub square: f64,
    /// Direction of light weighted with a sample's mean of R, G and B.
    pub direction: [f64; 3],
    /// Samples that have found a place.
    pub count: f64,
}

impl Sums {
    /// Numbers in a file.
    pub const WIDTH: usize = 8;

    /// All numbers.
    pub fn to_array(self) -> [f64; Self::WIDTH] {
        let ([a, b, c], [x, y, z]) = (self.irradiance, self.direction);
        [a, b, c, self.square, x, y, z, self.count]
    }

    /// The reverse of [`Sums::to_array`].
    pub fn from_array([a, b, c, square, x, y, z, count]: [f64; Self::WIDTH]) -> Self {
        Self { irradiance: [a, b, c], square, direction: [x, y, z], count }
    }

    fn mean(&self) -> f64 {
        self.irradiance.iter().sum::<f64>() / (3.0 * self.count.max(1.0))
    }
}

/// Points that get light.
#[expect(clippy::len_without_is_empty, reason = "nothing without points is solved")]
pub trait Points: Sync {
    /// How many there are.
    fn len(&self) -> usize;
    /// Two numbers that select a point's random numbers.
    fn key(&self, point: usize) -> [u32; 2];
    /// A place that the point stands for, chosen by the next numbers of the stream; `None` where there is none.
    fn surface(&self, point: usize, stream: &mut SampleStream) -> Option<Surface>;
}

/// Some of the points, with the random numbers that they have among all.
pub(super) struct Slice<'a> {
    pub points: &'a dyn Points,
    pub begin: usize,
    pub len: usize,
}

impl Points for Slice<'_> {
    fn len(&self) -> usize {
        self.len
    }

    fn key(&self, point: usize) -> [u32; 2] {
        self.points.key(self.begin + point)
    }

    fn surface(&self, point: usize, stream: &mut SampleStream) -> Option<Surface> {
        self.points.surface(self.begin + point, stream)
    }
}

/// The state of a solution: all sums after so many samples of each point.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Sums of each point.
    pub sums: Vec<Sums>,
    /// Samples of each point.
    pub spp: u32,
}

impl Solution {
    /// Nothing done yet.
    pub fn new(points: usize) -> Self {
        Self { sums: vec![Sums::default(); points], spp: 0 }
    }

    /// Irradiance of a point, W·m⁻²; `None` where no sample has found a place.
    pub fn irradiance(&self, point: usize) -> Option<[f32; 3]> {
        let sums = self.sums.get(point).filter(|s| s.count > 0.0)?;
        Some(sums.irradiance.map(|v| (v / sums.count) as f32))
    }

    /// Unit direction from which most of a point's light comes, in world space; zero where there is none.
    pub fn direction(&self, point: usize) -> Vec3 {
        let [x, y, z] = self.sums[point].direction;
        glam::DVec3::new(x, y, z).normalize_or_zero().as_vec3()
    }

    /// Mean standard error over the points, relative to their irradiance; dark points count by the mean of all.
    pub fn relative_error(&self) -> f64 {
        let lit = self.sums.iter().filter(|s| s.count > 1.0).count();
        if lit == 0 {
            return 0.0;
        }
        let mean = self.sums.iter().map(Sums::mean).sum::<f64>() / lit as f64;
        let error = |s: &Sums| {
            let (n, m) = (s.count, s.mean());
            if n <= 1.0 {
                return 0.0;
            }
            let variance = ((s.square / n - m * m) / (n - 1.0)).max(0.0);
            let size = m.max(DARK * mean);
            if size > 0.0 { variance.sqrt() / size } else { 0.0 }
        };
        self.sums.iter().map(error).sum::<f64>() / lit as f64
    }
}

/// Watches a solution.
pub trait Watcher: Observer {
    /// Called after each pass with all sums: for checkpoints.
    fn solution(&self, _solution: &Solution) {}
}

/// How points are sampled.
pub struct Solver<'a> {
    /// The scene, with hidden lights.
    pub scene: &'a Scene,
    /// How irradiance is found.
    pub method: &'a Method,
    /// The random numbers.
    pub sampler: Sampler,
    /// When to stop.
    pub stop: Stop,
}

/// Samples points until a rule stops or someone cancels. Returns whether no one has.
pub fn solve(solver: &Solver, points: &dyn Points, solution: &mut Solution, cancel: &Cancel, watcher: &dyn Watcher) -> bool {
    let Solver { scene, method, sampler, stop } = solver;
    let start = Instant::now();
    let end = stop.spp.unwrap_or(u32::MAX);
    let reached = |s: &Solution| s.spp >= ERROR_SPP && stop.noise.is_some_and(|goal| s.relative_error() <= goal);
    let done_points = std::sync::atomic::AtomicUsize::new(0);
    while solution.spp < end && !reached(solution) {
        let first = solution.spp;
        let last = first.saturating_add(first.clamp(1, PASS_LIMIT)).min(end);
        let status = |share: f64| Status {
            spp_done: first,
            spp_target: stop.spp,
            fraction: ((f64::from(first) + share * f64::from(last - first)) / f64::from(end)).min(1.0),
            elapsed: start.elapsed(),
            relative_error: None,
        };
        done_points.store(0, std::sync::atomic::Ordering::Relaxed);
        // A pass counts as a whole or not at all.
        let mut sums = solution.sums.clone();
        sums.par_chunks_mut(256).enumerate().for_each_init(Estimate::default, |estimate, (chunk, sums)| {
            if cancel.is_cancelled() {
                return;
            }
            for (i, sum) in sums.iter_mut().enumerate() {
                let point = chunk * 256 + i;
                let [x, y] = points.key(point);
                for index in first..last {
                    let mut stream = sampler.stream(x, y, index);
                    sample(scene, method, points, point, &mut stream, estimate, sum);
                }
            }
            let done = done_points.fetch_add(sums.len(), std::sync::atomic::Ordering::Relaxed) + sums.len();
            watcher.status(&status(done as f64 / points.len().max(1) as f64));
        });
        if cancel.is_cancelled() {
            return false;
        }
        solution.sums = sums;
        solution.spp = last;
        let mut status = status(1.0);
        status.spp_done = last;
        status.relative_error = (last >= ERROR_SPP).then(|| solution.relative_error());
        watcher.status(&status);
        watcher.solution(solution);
        if stop.time.is_some_and(|t| start.elapsed() >= t) {
            break;
        }
    }
    true
}

/// Adds a sample.
fn sample(
    scene: &Scene,
    method: &Method,
    points: &dyn Points,
    point: usize,
    stream: &mut SampleStream,
    estimate: &mut Estimate,
    sums: &mut Sums,
) {
    let Some(surface) = points.surface(point, stream) else { return };
    let mut irradiance = Spectrum::ZERO;
    let mut direction = Vec3::ZERO;
    match method {
        Method::Path { indirect } => {
            let receiver = Receiver { scene, indirect: indirect.as_deref(), surface: &surface };
            receiver.gather(stream, estimate, |d, radiance| {
                let e = radiance * surface.frame.n.dot(d);
                irradiance += e;
                direction += d * e.average();
            });
        }
        Method::Solved(light) => {
            irradiance = light.irradiance(scene, &surface);
            direction = surface.frame.n * irradiance.average();
        }
    }
    let e = irradiance.rgb();
    if !irradiance.is_finite() {
        return;
    }
    let mean = f64::from(irradiance.average());
    for k in 0..3 {
        sums.irradiance[k] += f64::from(e[k]);
        sums.direction[k] += f64::from(direction[k]);
    }
    sums.square += mean * mean;
    sums.count += 1.0;
}
