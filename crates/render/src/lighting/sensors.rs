//! Readings of sensors by path tracing.

use rayon::prelude::*;

use super::{SensorGrid, photometric};
use crate::integrator::irradiance::{Receiver, sensor};
use crate::integrator::{Estimate, Integrator};
use crate::math::Vec3;
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::Scene;

/// How sensors are read.
#[derive(Clone, Copy, Debug)]
pub struct SensorOptions {
    /// Samples of each sensor.
    pub samples: u32,
    /// Selects the random numbers.
    pub seed: u64,
    /// Lumens per watt.
    pub efficacy: f64,
}

/// What a sensor reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Where.
    pub p: Vec3,
    /// Illuminance in lux.
    pub lux: f64,
    /// Standard error of it, from independent batches of samples.
    pub error: f64,
}

/// What a grid amounts to. All in lux but the ratios.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// The darkest sensor.
    pub min: f64,
    /// The brightest.
    pub max: f64,
    /// Mean of all.
    pub mean: f64,
    /// Half of the sensors read less.
    pub median: f64,
    /// Uniformity U₀: min / mean (EN 12464-1).
    pub min_over_mean: f64,
    /// Diversity: min / max.
    pub min_over_max: f64,
}

/// Batches whose spread tells the error.
const BATCHES: u32 = 16;

/// Reads all sensors of a grid: each reading is a function of scene, options, and the sensor's number alone. `inner` follows light
/// between surfaces; the scene must hide its lights. `progress` takes the share that is done; `None` where it was cancelled.
pub fn measure(
    scene: &Scene,
    inner: &dyn Integrator,
    grid: &SensorGrid,
    options: &SensorOptions,
    is_cancelled: &(dyn Fn() -> bool + Sync),
    progress: &(dyn Fn(f64) + Sync),
) -> Option<Vec<Reading>> {
    let points = grid.points();
    let n = grid.axes()[0];
    let done = std::sync::atomic::AtomicUsize::new(0);
    let readings: Vec<Option<Reading>> = points
        .par_iter()
        .enumerate()
        .map(|(i, &p)| {
            if is_cancelled() {
                return None;
            }
            let reading = read(scene, inner, p, n, i as u32, options);
            let count = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            progress(count as f64 / points.len() as f64);
            Some(reading)
        })
        .collect();
    readings.into_iter().collect()
}

fn read(scene: &Scene, inner: &dyn Integrator, p: Vec3, n: Vec3, number: u32, options: &SensorOptions) -> Reading {
    let per_batch = options.samples.div_ceil(BATCHES).max(1);
    let mut kept = Estimate::default();
    let surface = sensor(p, n);
    let receiver = Receiver { scene, indirect: Some(inner), surface: &surface };
    let means: Vec<f64> = (0..BATCHES)
        .map(|batch| {
            // Batches are scrambled apart, so that their means are independent.
            let sampler = Sampler { kind: SamplerKind::Sobol, seed: options.seed, spp: per_batch };
            let sum: f64 = (0..per_batch)
                .map(|i| {
                    let mut stream = sampler.stream(number, batch, i);
                    let e = receiver.irradiance(&mut stream, &mut kept);
                    let lux = photometric(e, options.efficacy);
                    if lux.is_finite() { lux } else { 0.0 }
                })
                .sum();
            sum / f64::from(per_batch)
        })
        .collect();
    let lux = means.iter().sum::<f64>() / f64::from(BATCHES);
    let variance = means.iter().map(|m| (m - lux) * (m - lux)).sum::<f64>() / f64::from(BATCHES - 1);
    Reading { p, lux, error: (variance / f64::from(BATCHES)).sqrt() }
}

impl Summary {
    /// Of readings; `None` where there are none.
    pub fn of(readings: &[Reading]) -> Option<Self> {
        let mut lux: Vec<f64> = readings.iter().map(|r| r.lux).collect();
        lux.sort_by(f64::total_cmp);
        let (min, max) = (*lux.first()?, *lux.last()?);
        let mean = lux.iter().sum::<f64>() / lux.len() as f64;
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
        let k = lux.len() / 2;
        let median = if lux.len() % 2 == 1 { lux[k] } else { 0.5 * (lux[k - 1] + lux[k]) };
        Some(Self { min, max, mean, median, min_over_mean: ratio(min, mean), min_over_max: ratio(min, max) })
    }
}
