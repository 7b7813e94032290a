//! Sessions: the only place that knows time, threads, progress, cancelling and checkpoints.
//!
//! A session hands out work as (tile, range of sample indices), fills small films and merges them into one. The pixels do
//! not depend on how the work was split: each sample is a function of (seed, pixel, index) and film sums are exact.

mod adaptive;
mod antialias;
mod blurred;
mod channels;
pub mod job;
mod smooth;

pub use antialias::Antialias;
pub use blurred::Confidence;
pub use channels::{Aov, film_channels};

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::camera::CameraRay;
use crate::classic::WorkingSpace;
use crate::film::{Film, FilmError, FilmMeta, FilmSpec, FilterSampler, HeldSamples, Rect};
use crate::integrator::{CameraSample, Estimate, Integrator, Stage};
use crate::math::Vec2;
use crate::sampler::{SampleStream, Sampler, SamplerKind};
use crate::scene::Scene;
use adaptive::{BLOCK, STEP};
use antialias::Centers;
use blurred::Blurred;

/// Edge of a tile in pixels.
const TILE: u32 = 32;
/// The longest pass in samples per pixel: short enough for a live picture and a prompt stop.
const PASS_LIMIT: u32 = 16;

/// When to stop. Whatever comes first.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stop {
    /// Samples per pixel; `None`: until another rule stops.
    pub spp: Option<u32>,
    /// Time from the start of the rendering.
    pub time: Option<Duration>,
    /// Relative error as in [`Film::relative_error`].
    pub noise: Option<f64>,
}

/// Why a session stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// All samples are done.
    Samples,
    /// The time is over.
    Time,
    /// The error is small enough.
    Noise,
    /// Someone asked for it.
    Cancelled,
}

/// How far a session is.
#[derive(Clone, Copy, Debug)]
pub struct Status {
    /// Samples per pixel that are complete everywhere, those included that antialiasing does not need.
    pub spp_done: u32,
    /// Samples per pixel that are planned, if that is known.
    pub spp_target: Option<u32>,
    /// Done share in [0, 1] by whichever rule will stop first.
    pub fraction: f64,
    /// Time since the start.
    pub elapsed: Duration,
    /// Estimated relative error, known after each pass.
    pub relative_error: Option<f64>,
}

/// Asks a session to stop; clones ask the same session.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks to stop after the tiles in work.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether someone has asked.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Why a session cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The film cannot take the samples, which would be a fault of ours.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// The method cannot render this scene.
    #[error("{0}")]
    Integrator(String),
}

/// What watches a session.
pub trait Observer: Send + Sync {
    /// Called while the integrator does its own stages: what it does and the share that is done. From any thread.
    fn stage(&self, _what: &str, _fraction: f64) {}
    /// Called after tiles and passes, from any thread, one call at a time.
    fn status(&self, _status: &Status) {}
    /// Called after each pass with the film as it is: for previews and checkpoints.
    fn pass(&self, _film: &Film, _status: &Status) {}
}

/// An observer that does nothing.
pub struct Silent;
impl Observer for Silent {}

/// A scene, how to sample it, and the film it goes to.
pub struct Session {
    scene: Arc<Scene>,
    integrator: Box<dyn Integrator>,
    sampler: Sampler,
    filter: FilterSampler,
    aovs: Vec<Aov>,
    first_sample: u32,
    film: Film,
    order_tiles: Option<fn(&mut Vec<Rect>)>,
    centers: Option<Centers>,
    blurred: Option<Blurred>,
    error_goal: Option<f64>,
    is_prepared: bool,
    /// The integrator takes the camera's rays; otherwise only the point of the picture.
    needs_camera: bool,
    /// Points on the lens matter.
    needs_lens: bool,
}

impl Session {
    /// A session that starts with an empty film of the given size, crop and filter; its channels are those of the AOVs and the
    /// scene's light groups.
    ///
    /// # Errors
    /// [`FilmError`] for an impossible spec.
    pub fn new(
        scene: Arc<Scene>,
        integrator: Box<dyn Integrator>,
        sampler: Sampler,
        mut spec: FilmSpec,
        aovs: Vec<Aov>,
        meta: FilmMeta,
    ) -> Result<Self, FilmError> {
        spec.channels = film_channels(&aovs, &scene.group_names);
        spec.splats = integrator.splats();
        let filter = FilterSampler::new(spec.filter);
        let mut film = Film::new(spec)?;
        film.meta = meta;
        let needs_camera = integrator.uses_camera_rays(&scene);
        let needs_lens = needs_camera || scene.classic.as_ref().is_none_or(|c| c.needs_lens());
        Ok(Self {
            scene,
            integrator,
            sampler,
            filter,
            aovs,
            first_sample: 0,
            film,
            order_tiles: None,
            centers: None,
            blurred: None,
            error_goal: None,
            is_prepared: false,
            needs_camera,
            needs_lens,
        })
    }

    /// Lets only pixels that differ from a neighbor have more than one sample, which goes through their center. The sampler's number of
    /// samples should be that of the further ones.
    pub fn set_antialias(&mut self, antialias: Antialias) {
        let spec = self.film.spec();
        self.centers = Some(Centers::new(antialias, spec.space, self.film.rect(), spec.width, spec.height));
    }

    /// Lets pixels of a blurred picture take samples until they are good enough.
    pub fn set_confidence(&mut self, confidence: Confidence) {
        self.blurred = Some(Blurred::new(confidence));
    }

    /// Sets the relative error at which pixels take no more samples. The first sample must be that of index 0, parts of a picture must begin
    /// on the grid of blocks, and the film must keep its error estimate.
    pub fn set_error_goal(&mut self, goal: f64) {
        self.error_goal = Some(goal);
    }

    /// Estimates no error, for sessions of which nothing but the picture is wanted; see [`Film::drop_squares`].
    pub fn forgo_error_estimate(&mut self) {
        self.film.drop_squares();
    }

    /// Names the scene in the film, so that films of other scenes are refused.
    pub fn set_scene_hash(&mut self, hash: String) {
        self.film.meta.scene_hash = hash;
    }

    /// Lets sample indices start later, for a part of a picture that is merged afterwards.
    pub fn set_first_sample(&mut self, index: u32) {
        self.first_sample = index;
    }

    /// Starts with an empty film of a part of the picture, for a worker that renders one part after the other and keeps what was
    /// prepared. The parts' films merge exactly.
    ///
    /// # Errors
    /// [`FilmError::Outside`] where the pixels are not within the crop, [`FilmError::Spec`] where they cut blocks of adaptive sampling.
    pub fn set_part(&mut self, rect: Rect, first_sample: u32) -> Result<(), FilmError> {
        let spec = self.film.spec().clone();
        if self.error_goal.is_some() && !adaptive::is_on_grid(rect, spec.crop) {
            let message = format!("with an error as the goal parts begin and end on the grid of {BLOCK} × {BLOCK} pixels: not {rect}");
            return Err(FilmError::Spec(message));
        }
        let mut film = Film::tile(&spec, rect)?;
        if !self.film.has_squares() {
            film.drop_squares();
        }
        film.meta = FilmMeta { render_ms: 0, ..self.film.meta.clone() };
        self.film = film;
        self.first_sample = first_sample;
        if let Some(centers) = &self.centers {
            self.centers = Some(Centers::new(centers.antialias(), spec.space, rect, spec.width, spec.height));
        }
        self.blurred = self.blurred.as_ref().map(Blurred::anew);
        Ok(())
    }

    /// Whether samples give light to pixels other than their own: then a part is the whole picture.
    pub fn splats(&self) -> bool {
        self.integrator.splats()
    }

    /// Whether each pass begins with work of its own, such as new particles: parts of a picture would each do it again.
    pub fn has_costly_passes(&self) -> bool {
        self.integrator.pass_limit() < PASS_LIMIT
    }

    /// Changes the tiles and their order; for tests, which show that neither matters.
    #[doc(hidden)]
    pub fn set_tile_order(&mut self, order: fn(&mut Vec<Rect>)) {
        self.order_tiles = Some(order);
    }

    /// Goes on from a film that an earlier session of the same scene and settings has left.
    ///
    /// # Errors
    /// [`FilmError`] where the film belongs to another scene or other settings.
    pub fn resume(&mut self, film: &Film) -> Result<(), FilmError> {
        self.film.merge(film)
    }

    /// Sentences about what the scene names and could not be loaded.
    pub fn warnings(&self) -> &[String] {
        &self.scene.warnings
    }

    /// Sentences of the integrator about what it did; see [`Integrator::notes`].
    pub fn notes(&self) -> Vec<String> {
        self.integrator.notes()
    }

    /// The film as it is.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// The film, at the end.
    pub fn into_film(self) -> Film {
        self.film
    }

    /// Renders until a rule stops or someone cancels, with the threads of the current rayon pool.
    ///
    /// # Errors
    /// [`SessionError`]
    pub fn render(&mut self, stop: &Stop, cancel: &Cancel, observer: &dyn Observer) -> Result<Reason, SessionError> {
        let start = Instant::now();
        let spec = self.film.spec();
        let is_cancelled = || cancel.is_cancelled();
        let progress = |what: &str, fraction: f64| observer.stage(what, fraction);
        let (sampler, filter) = (self.sampler, self.filter.clone());
        let camera_sample = |index: u32| shared_sample(&sampler, &filter, index);
        let stage = Stage {
            size: [spec.width, spec.height],
            seed: self.sampler.seed,
            camera_sample: &camera_sample,
            is_cancelled: &is_cancelled,
            progress: &progress,
        };
        if !self.is_prepared {
            self.integrator.set_margin(spec.filter.radius());
            self.integrator.prepare(&self.scene, &stage).map_err(SessionError::Integrator)?;
            self.is_prepared = !cancel.is_cancelled();
        }
        let first = self.first_sample;
        if self.error_goal.is_some() && first > 0 {
            let message =
                format!("with adaptive sampling a pixel takes its samples from the first one on: none can begin with index {first}");
            return Err(SessionError::Integrator(message));
        }
        let end = stop.spp.map_or(u32::MAX, |n| first.saturating_add(n));
        let mut tiles = tiles(self.film.rect());
        if let Some(order) = self.order_tiles {
            order(&mut tiles);
        }
        let mut begin = first;
        let mut reason = Reason::Samples;
        while begin < end {
            // 1, 1, 2, 4, 8, 16, 16 …: a picture early, then few passes. Boundaries do not depend on the time.
            let done = begin - first;
            // Few pixels take more than one sample where edges alone are smoothed.
            let limit = self.integrator.pass_limit().clamp(1, PASS_LIMIT);
            let most = if self.centers.is_some() && begin > 0 { limit } else { done.clamp(1, limit) };
            let mut pass_end = begin.saturating_add(most).min(end);
            if self.error_goal.is_some() {
                pass_end = pass_end.min((begin / STEP + 1).saturating_mul(STEP));
            }
            if cancel.is_cancelled() {
                reason = Reason::Cancelled;
                break;
            }
            self.integrator.begin_pass(&self.scene, begin, pass_end, &stage).map_err(SessionError::Integrator)?;
            let complete = self.pass(&tiles, begin, pass_end, start, stop, cancel, observer)?;
            if !complete {
                reason = if cancel.is_cancelled() { Reason::Cancelled } else { Reason::Time };
                break;
            }
            begin = pass_end;
            // Two samples say nothing about an error; a few dozen say enough.
            let relative_error = (begin - first >= 16).then(|| self.film.relative_error());
            let mut status = self.status(begin - first, start.elapsed(), stop);
            status.relative_error = relative_error;
            observer.status(&status);
            observer.pass(&self.film, &status);
            let is_settled = |goal| adaptive::open_blocks(&self.film, self.film.rect(), begin, goal).next().is_none();
            if stop.noise.zip(relative_error).is_some_and(|(goal, error)| error <= goal) || self.error_goal.is_some_and(is_settled) {
                reason = Reason::Noise;
                break;
            }
            if stop.time.is_some_and(|t| start.elapsed() >= t) && begin < end {
                reason = Reason::Time;
                break;
            }
        }
        self.film.meta.render_ms += start.elapsed().as_millis() as u64;
        Ok(reason)
    }

    fn status(&self, spp_done: u32, elapsed: Duration, stop: &Stop) -> Status {
        let by_time = stop.time.map_or(0.0, |t| elapsed.as_secs_f64() / t.as_secs_f64().max(1e-9));
        let by_spp = stop.spp.map_or(0.0, |n| f64::from(spp_done) / f64::from(n.max(1)));
        Status { spp_done, spp_target: stop.spp, fraction: by_time.max(by_spp).min(1.0), elapsed, relative_error: None }
    }

    /// One pass over all tiles; false where it was cut short.
    #[expect(clippy::too_many_arguments, reason = "private; all of it belongs to one loop")]
    fn pass(
        &mut self,
        tiles: &[Rect],
        begin: u32,
        end: u32,
        start: Instant,
        stop: &Stop,
        cancel: &Cancel,
        observer: &dyn Observer,
    ) -> Result<bool, FilmError> {
        // Workers fill tiles of their own and hand them over under a lock that is held briefly.
        let stand_in = self.film.new_tile(tiles[0])?;
        let film = Mutex::new((std::mem::replace(&mut self.film, stand_in), 0usize, Ok(())));
        // Tiles that are not in use: as many as threads.
        let spare: Mutex<Vec<Film>> = Mutex::new(Vec::new());
        let spare = || spare.lock().unwrap_or_else(PoisonError::into_inner);
        let this: &Self = self;
        tiles.par_iter().with_max_len(1).for_each(|&rect| {
            let mut kept = spare().pop();
            // The first pass is never cut by time: a picture without holes is worth more than a punctual one.
            let out_of_time = begin > this.first_sample && stop.time.is_some_and(|t| start.elapsed() >= t);
            if cancel.is_cancelled() || out_of_time {
                return;
            }
            let lock = || film.lock().unwrap_or_else(PoisonError::into_inner);
            let missing = missing(&lock().0, rect, begin, end);
            for (a, b) in missing {
                let open = this.error_goal.map(|goal| adaptive::open_blocks(&lock().0, rect, a, goal).collect::<Vec<_>>());
                let fits = kept.as_mut().is_some_and(|tile| tile.empty_for(rect));
                if !fits {
                    kept = lock().0.new_tile(rect).ok();
                }
                let Some(tile) = &mut kept else { return };
                for &part in open.as_deref().unwrap_or(&[rect]) {
                    this.render_tile(tile, part, a, b);
                }
                let mut guard = lock();
                let (film, _, result) = &mut *guard;
                if let Err(e) = tile.mark_held(rect, a, b).and_then(|()| film.merge(tile)) {
                    *result = Err(e);
                }
            }
            if let Some(tile) = kept {
                spare().push(tile);
            }
            let mut guard = lock();
            guard.1 += 1;
            let share = f64::from(end - begin) * guard.1 as f64 / tiles.len() as f64;
            let mut status = this.status(begin - this.first_sample, start.elapsed(), stop);
            if let Some(n) = stop.spp {
                let by_spp = (f64::from(begin - this.first_sample) + share) / f64::from(n.max(1));
                status.fraction = status.fraction.max(by_spp).min(1.0);
            }
            observer.status(&status);
        });
        let (film, done, result) = film.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.film = film;
        result.map(|()| done == tiles.len())
    }

    fn render_tile(&self, tile: &mut Film, rect: Rect, begin: u32, end: u32) {
        if let Some(centers) = &self.centers {
            return self.smooth_tile(centers, tile, rect, begin, end);
        }
        if let Some(blurred) = &self.blurred {
            return self.blurred_tile(blurred, tile, rect, begin, end);
        }
        let space = self.film.spec().space;
        let mut estimate = self.new_estimate();
        let mut values = Vec::new();
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                for index in self.integrator.samples_of([x, y], begin, end) {
                    let (weight, stream) = self.sample(x, y, self.sampler.stream(x, y, index), &mut estimate);
                    self.splat(&estimate, stream, tile);
                    self.add(tile, x, y, index, weight, space, &estimate, &mut values);
                }
            }
        }
    }

    /// What samples are written to: it says what is asked for.
    fn new_estimate(&self) -> Estimate {
        Estimate {
            wants_uv: self.aovs.contains(&Aov::Uv),
            forgoes_first: self.aovs.is_empty(),
            wants_own: self.film.spec().space != WorkingSpace::Linear,
            ..Estimate::default()
        }
    }

    /// Adds a sample to a film whose means are of numbers of a space.
    #[inline]
    #[expect(clippy::too_many_arguments, reason = "private; the innermost of one loop")]
    fn add(
        &self,
        tile: &mut Film,
        x: u32,
        y: u32,
        index: u32,
        weight: f32,
        space: WorkingSpace,
        estimate: &Estimate,
        values: &mut Vec<f32>,
    ) {
        let [r, g, b] = own_rgb(estimate, space);
        if self.aovs.is_empty() && estimate.groups.len() <= 1 {
            tile.add_sample(x, y, index, weight, &[r, g, b, estimate.alpha]);
            return;
        }
        channels::values(estimate, &self.aovs, values);
        values.iter_mut().zip([r, g, b]).for_each(|(v, own)| *v = own);
        tile.add_sample(x, y, index, weight, values);
    }

    /// One sample of a pixel with its numbers; returns its filter weight and the numbers that are left.
    fn sample(&self, x: u32, y: u32, mut stream: SampleStream, estimate: &mut Estimate) -> (f32, SampleStream) {
        if self.integrator.shares_camera_samples() {
            let shared = shared_sample(&self.sampler, &self.filter, stream.index());
            let camera_ray = self.scene.camera_ray(Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + shared.offset, shared.u_lens);
            estimate.reset(self.scene.group_names.len());
            self.integrator.estimate(&self.scene, &camera_ray, &mut stream, estimate);
            return (shared.weight, stream);
        }
        let u = match &self.centers {
            Some(centers) if self.sampler.kind == SamplerKind::Stratified => stream.next_grid_2d(centers.antialias().depth),
            _ => stream.next_2d(),
        };
        let filtered = self.filter.sample(u);
        let picture = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + filtered.offset;
        self.trace(picture, &mut stream, estimate);
        (filtered.weight, stream)
    }

    /// Hands a sample's light for other pixels to the film.
    fn splat(&self, estimate: &Estimate, mut stream: SampleStream, tile: &mut Film) {
        for splat in &estimate.splats {
            let landed = self.filter.land(splat.picture, stream.next_independent_2d());
            if let Some((Ok(x), Ok(y), weight)) = landed.map(|(x, y, weight)| (u32::try_from(x), u32::try_from(y), weight)) {
                tile.add_splat(x, y, weight, splat.radiance.rgb(), splat.group);
            }
        }
    }

    /// The sample through the center of a pixel. Its random numbers are those of an index that no session comes to.
    fn center(&self, x: u32, y: u32, estimate: &mut Estimate) {
        let sampler = Sampler { kind: SamplerKind::Independent, ..self.sampler };
        let mut stream = sampler.stream(x, y, u32::MAX);
        self.trace(Vec2::new(x as f32 + 0.5, y as f32 + 0.5), &mut stream, estimate);
    }

    fn trace(&self, picture: Vec2, stream: &mut SampleStream, estimate: &mut Estimate) {
        let lens = if self.needs_lens { stream.next_2d() } else { stream.skip_2d() };
        let camera_ray = if self.needs_camera { self.scene.camera_ray(picture, lens) } else { CameraRay::without_ray(picture, lens) };
        estimate.reset(self.scene.group_names.len());
        if camera_ray.weight == 0.0 {
            // What does not come through an objective is dark, and not seen through.
            estimate.alpha = 1.0;
            return;
        }
        self.integrator.estimate(&self.scene, &camera_ray, stream, estimate);
    }
}

/// The radiance in numbers of a space: means are of numbers of the scene's, as in POV-Ray (measured).
#[inline]
fn own_rgb(estimate: &Estimate, space: WorkingSpace) -> [f32; 3] {
    let rgb = estimate.radiance.rgb();
    if space == WorkingSpace::Linear || estimate.is_own { rgb } else { rgb.map(|v| space.from_linear(f64::from(v)) as f32) }
}

/// The camera sample that all pixels share: that of a pixel that no picture has.
fn shared_sample(sampler: &Sampler, filter: &FilterSampler, index: u32) -> CameraSample {
    let mut stream = sampler.stream(u32::MAX, u32::MAX, index);
    let filtered = filter.sample(stream.next_2d());
    CameraSample { offset: filtered.offset, weight: filtered.weight, u_lens: stream.next_2d() }
}

/// The ranges of `begin..end` that a tile still lacks.
fn missing(film: &Film, rect: Rect, begin: u32, end: u32) -> Vec<(u32, u32)> {
    let mut held: Vec<(u32, u32)> =
        film.held().entries().iter().filter(|e: &&HeldSamples| e.rect.contains_rect(&rect)).map(|e| (e.begin, e.end)).collect();
    held.sort_unstable();
    let (mut gaps, mut at) = (Vec::new(), begin);
    for (a, b) in held {
        if a > at && at < end {
            gaps.push((at, a.min(end)));
        }
        at = at.max(b);
    }
    if at < end {
        gaps.push((at, end));
    }
    gaps
}

/// A rectangle cut into squares from its first corner on, row by row.
fn tiles_of(rect: Rect, edge: u32) -> impl Iterator<Item = Rect> {
    let starts = move |a: u32, b: u32| (a..b).step_by(edge as usize);
    let tile = move |x: u32, y: u32| Rect::new(x, y, (x + edge).min(rect.x1), (y + edge).min(rect.y1));
    starts(rect.y0, rect.y1).flat_map(move |y| starts(rect.x0, rect.x1).map(move |x| tile(x, y)))
}

/// Tiles of a rectangle, from the middle outwards: what one looks at comes first.
fn tiles(rect: Rect) -> Vec<Rect> {
    let mut tiles: Vec<Rect> = tiles_of(rect, TILE).collect();
    let (cx, cy) = (i64::from(rect.x0 + rect.x1), i64::from(rect.y0 + rect.y1));
    tiles.sort_by_key(|t| {
        let (dx, dy) = (i64::from(t.x0 + t.x1) - cx, i64::from(t.y0 + t.y1) - cy);
        (dx * dx + dy * dy, t.y0, t.x0)
    });
    tiles
}
