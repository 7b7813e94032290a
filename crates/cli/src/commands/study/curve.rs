//! One method's error at growing cost.

use std::sync::Mutex;
use std::time::Instant;

use etendue_render::film::Film;
use etendue_render::image::Image;
use etendue_render::image::metrics::{self, Comparison, compare, heatmap};
use etendue_render::session::job::{self, JobError, Plan};
use etendue_render::session::{Cancel, Observer, Status, Stop};
use etendue_scene::{RenderSettings, SceneDesc};
use serde::Serialize;

use crate::clock::process_cpu_secs;

/// The error of the picture after so much work.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Point {
    /// Samples per pixel.
    pub spp: u32,
    /// CPU time of all threads, what the method prepares included.
    pub cpu_s: f64,
    /// Time on the clock.
    pub wall_s: f64,
    /// Mean of (x − ref)² / (ref² + 0.01).
    pub relmse: f64,
}

/// What came of one method.
pub(super) struct Curve {
    /// As `--integrator` names it.
    pub method: String,
    /// Errors at 1, 2, 4, 8 … samples and at the end; empty without a reference.
    pub points: Vec<Point>,
    /// The last picture.
    pub image: Image,
    /// Its samples per pixel.
    pub spp: u32,
    /// The film's own estimate of its noise.
    pub relative_error: Option<f64>,
    /// All figures of the last picture, and FLIP of each pixel.
    pub last: Option<(Comparison, Vec<f32>)>,
    /// What the method says about itself.
    pub notes: Vec<String>,
}

impl Curve {
    /// FLIP of each pixel in false color.
    pub fn heat_image(&self) -> Image {
        let flip = self.last.as_ref().map_or(&[][..], |(_, flip)| flip);
        heatmap(self.image.width, self.image.height, flip)
    }

    /// 1 / (relMSE × CPU seconds) at the end.
    pub fn efficiency(&self) -> Option<f64> {
        self.points.last().map(|p| 1.0 / (p.relmse * p.cpu_s)).filter(|e| e.is_finite())
    }

    /// The slope of log relMSE over log time in the later half of the points: −1 for an unbiased method that only has noise, 0 where
    /// what is left is no noise.
    pub fn slope(&self) -> Option<f64> {
        let later = &self.points[self.points.len() / 2..];
        let logs: Vec<[f64; 2]> =
            later.iter().map(|p| [p.cpu_s.ln(), p.relmse.ln()]).filter(|[x, y]| x.is_finite() && y.is_finite()).collect();
        let n = logs.len() as f64;
        let mean = [0, 1].map(|i| logs.iter().map(|p| p[i]).sum::<f64>() / n);
        let xx: f64 = logs.iter().map(|p| (p[0] - mean[0]).powi(2)).sum();
        let xy: f64 = logs.iter().map(|p| (p[0] - mean[0]) * (p[1] - mean[1])).sum();
        (logs.len() >= 3 && xx > 0.0).then(|| xy / xx)
    }
}

/// The scene and what all methods share.
pub(super) struct Bench<'a> {
    pub desc: &'a SceneDesc,
    pub settings: &'a RenderSettings,
    pub pool: &'a rayon::ThreadPool,
}

impl Bench<'_> {
    /// Renders by one method until the rule stops it.
    ///
    /// # Errors
    /// A sentence where the method cannot render the scene or the reference has another size.
    pub fn run(&self, method: &str, seed: u64, stop: &Stop, reference: Option<&Image>) -> Result<Curve, String> {
        let settings = RenderSettings { integrator: Some(method.to_owned()), seed, ..self.settings.clone() };
        let mut plan = Plan::new(self.desc, &settings, None).map_err(|e| self.describe(&e))?;
        if stop.spp.is_none() {
            plan.spp = job::DEFAULT_SPP;
            plan.be_even();
        }
        if let Some(image) = reference.filter(|r| [r.width, r.height] != [plan.width, plan.height]) {
            return Err(format!("the reference has {}×{} pixels, the picture {}×{}", image.width, image.height, plan.width, plan.height));
        }
        let mut session = self.pool.install(|| job::prepare(self.desc, &settings, &plan, &[])).map_err(|e| self.describe(&e))?;
        let recorder = Recorder::new(reference);
        self.pool.install(|| session.render(stop, &Cancel::default(), &recorder)).map_err(|e| e.to_string())?;
        let film = session.film();
        recorder.record(film, film.declared_spp());
        let image = film.develop();
        let last = reference.map(|r| compare(&image, r, true)).transpose().map_err(|e| e.to_string())?;
        let spp = film.declared_spp();
        let relative_error = Some(film.relative_error()).filter(|e| e.is_finite() && spp >= 16);
        Ok(Curve { method: method.to_owned(), points: recorder.points(), image, spp, relative_error, last, notes: session.notes() })
    }

    fn describe(&self, error: &JobError) -> String {
        match error {
            JobError::Scene(faults) => {
                faults.iter().map(|f| format!("{}: {}", f.span.display(&self.desc.files), f.message)).collect::<Vec<_>>().join("; ")
            }
            other => other.to_string(),
        }
    }
}

/// Measures the film as it grows; its own time does not count.
struct Recorder<'a> {
    reference: Option<&'a Image>,
    start: Instant,
    state: Mutex<State>,
}

struct State {
    points: Vec<Point>,
    /// CPU and clock at the start, later by what measuring took.
    cpu_s: f64,
    wall_s: f64,
}

impl<'a> Recorder<'a> {
    fn new(reference: Option<&'a Image>) -> Self {
        let state = State { points: Vec::new(), cpu_s: process_cpu_secs(), wall_s: 0.0 };
        Self { reference, start: Instant::now(), state: Mutex::new(state) }
    }

    fn record(&self, film: &Film, spp: u32) {
        let (Some(reference), Ok(mut state)) = (self.reference, self.state.lock()) else { return };
        if state.points.last().is_some_and(|p| p.spp == spp) {
            return;
        }
        let (cpu, wall) = (process_cpu_secs(), self.start.elapsed().as_secs_f64());
        if let Ok(relmse) = metrics::relmse(&film.develop(), reference) {
            let point = Point { spp, cpu_s: cpu - state.cpu_s, wall_s: wall - state.wall_s, relmse };
            state.points.push(point);
        }
        state.cpu_s += process_cpu_secs() - cpu;
        state.wall_s += self.start.elapsed().as_secs_f64() - wall;
    }

    fn points(self) -> Vec<Point> {
        self.state.into_inner().map(|s| s.points).unwrap_or_default()
    }
}

impl Observer for Recorder<'_> {
    fn pass(&self, film: &Film, status: &Status) {
        if status.spp_done.is_power_of_two() {
            self.record(film, status.spp_done);
        }
    }
}
