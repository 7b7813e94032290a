//! Path tracing (Kajiya 1986, doi:10.1145/15922.15902) with next-event estimation, multiple importance sampling (Veach 1997,
//! chapter 9) and Russian roulette.
//!
//! Unbiased for everything that paths from the camera can find. It is slow on light that reaches diffuse surfaces through
//! small mirrors and refractors (caustics of small lights) and cannot see point lights through glass.
//!
//! Surfaces that let light straight through (masks, thin panes) do not end the search for lights: shadow rays cross them, and
//! a path that crosses one keeps the density of its last real scattering for the weights.
//!
//! Media scatter, absorb and emit along the way (`volume`): a scattering in a medium is an edge of the path as one at a surface is.

use std::ops::Range;

use arrayvec::ArrayVec;

use super::caustics::{Caustics, Place, Start};
use super::guiding::{COST, Directions, Guide, Guiding, Lesson, can_guide};
use super::light_sampling::{context, infinite, pdf_surface, sample_one};
use super::resampling::{CHOICE_NUMBERS, Receiver};
use super::splitting::{Probe, Splits};
use super::volume::{self, Scattered, power_of_three};
use super::{Estimate, FirstHit, Integrator, Stage, Vertex};
use crate::accel::Ray;
use crate::bsdf::{Bsdf, BsdfSample, Lobe, TransportMode};
use crate::camera::CameraRay;
use crate::light::LightContext;
use crate::material::Scatter;
use crate::math::warp::power_heuristic;
use crate::math::{Vec3, fns};
use crate::medium::MediumStack;
use crate::sampler::{HashRng, SampleStream};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// A path that only ever crosses surfaces straight on ends after so many of them.
const MAX_CROSSINGS: u32 = 1024;

/// Numbers that a vertex draws for its direct light, and those for its scattering and roulette: none is made that is not used.
const DIRECT_NUMBERS: u32 = 3;
const SCATTER_NUMBERS: u32 = 4;
/// Where the numbers lie of the light samples that a pilot compares with those of the path: beyond all others.
const COMPARED_NUMBERS: u32 = 1 << 30;

/// The path tracer.
#[derive(Clone, Debug)]
pub struct Path {
    /// Longest path in scattering events: 0 shows lights only, 1 direct light.
    pub max_depth: u32,
    /// Scattering events after which Russian roulette may end a path.
    pub rr_depth: u32,
    /// Samples direct light along segments in homogeneous media by the angle from the light as well: less noise about small lights.
    pub equiangular: bool,
    /// Most paths that go on from the first surface that scatters a path; 1 for none but one. How many do is decided by
    /// [`Integrator::prepare`], for each part of the picture; where that is asked for, so is of how many light samples one is chosen there.
    pub max_splits: u32,
    /// Whether pixels may take different numbers of samples, where the same pilot finds that this is worth it.
    pub allots: bool,
    pub(super) splits: Option<Splits>,
    /// Whether paths are guided to where light has been found to come from; decided by [`Integrator::prepare`] as well.
    pub guiding: Guiding,
    pub(super) guide: Option<Guide>,
    pub(super) note: Option<String>,
}

/// The cone of directions that a path's sample stands for, after Akenine-Möller et al. 2019 (Ray Tracing Gems ch. 20).
#[derive(Clone, Copy)]
struct Cone {
    width: f32,
    spread: f32,
}

impl Cone {
    /// Goes along the ray; returns the footprint's width on a surface seen at a cosine. The shorter way across the ellipse and the
    /// longer one are averaged as areas.
    #[inline]
    fn advance(&mut self, distance: f32, cos: f32) -> f32 {
        self.width += self.spread * distance;
        self.width / cos.abs().max(0.05).sqrt()
    }

    /// Widens with the solid angle that a sampled direction stands for, 1 / pdf; a quarter of it, as neighboring samples share it.
    #[inline]
    fn scatter(&mut self, pdf: f32) {
        if pdf.is_finite() {
            self.spread = (self.spread + 0.25 / pdf.sqrt()).min(0.5);
        }
    }
}

/// A path under way.
#[derive(Clone)]
struct State<T> {
    ray: Ray,
    throughput: Spectrum,
    last: Vertex,
    depth: u32,
    crossings: u32,
    /// What roulette takes the throughput times: squared relative indices, as radiance is denser inside glass, and how many more paths go
    /// this way than the surfaces alone would send.
    spare: f32,
    guided: f32,
    /// What the camera is to see by this path: the throughput at its first guided vertex times what the surface there sends back in the
    /// mean; 0 before.
    seen: f32,
    media: MediumStack,
    rng: HashRng,
    trail: T,
    camera_distance: f32,
    cone: Cone,
    /// Into how many the path splits at the next surface that does more than mirror or refract.
    splits: u32,
    /// Rays that the path has had.
    edges: u32,
}

impl Integrator for Path {
    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        self.guide(scene, stage);
        self.split(scene, stage);
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        let describe = |what: &str, (least, mean, most): (u8, f64, u8)| {
            (most > 1).then(|| format!("path: {mean:.1} {what} where a camera ray is scattered first ({least} to {most} by place)"))
        };
        let splits = self.splits.iter().flat_map(|splits| {
            let paths = describe("paths go on from", splits.splits());
            paths.into_iter().chain(describe("light samples are compared", splits.candidates()))
        });
        let rates = self.splits.as_ref().map(Splits::rates).filter(|[least, most]| least < most);
        let rates =
            rates.map(|[least, most]| format!("path: pixels take {least:.1} to {most:.1} samples for each of the picture, by place"));
        self.note.iter().cloned().chain(splits).chain(rates).collect()
    }

    fn samples_of(&self, pixel: [u32; 2], begin: u32, end: u32) -> Range<u32> {
        self.splits.as_ref().map_or(begin..end, |splits| splits.samples_of(pixel, begin, end))
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        self.estimate_with(&(), scene, camera_ray, stream, out);
    }
}

impl Path {
    /// Paths of at most `max_depth` scattering events, of which roulette may end those with `rr_depth` or more; they do not split.
    pub fn new(max_depth: u32, rr_depth: u32) -> Self {
        Self {
            max_depth,
            rr_depth,
            equiangular: true,
            max_splits: 1,
            allots: true,
            splits: None,
            guiding: Guiding::Off,
            guide: None,
            note: None,
        }
    }

    /// Learns where light comes from, where that is wanted and pays; forgets how paths split.
    pub(super) fn guide(&mut self, scene: &Scene, stage: &Stage) {
        self.splits = None;
        (self.guide, self.note) = Guide::prepare(self, scene, stage);
    }

    /// Decides how many paths go on from where one is scattered.
    pub(super) fn split(&mut self, scene: &Scene, stage: &Stage) {
        self.splits = (self.max_splits > 1 && self.max_depth > 1).then(|| Splits::plan(self, scene, stage, self.max_splits));
    }

    /// Whether paths are guided.
    pub(super) fn is_guided(&self) -> bool {
        self.guide.is_some()
    }

    /// What a path costs in paths that are not guided.
    pub(super) fn cost(&self) -> f64 {
        if self.guide.is_some() { COST } else { 1.0 }
    }

    /// The same paths before anything was decided for them, which do not split.
    pub(super) fn alone(&self) -> Self {
        Self { max_splits: 1, splits: None, guiding: Guiding::Off, guide: None, note: None, ..self.clone() }
    }

    /// An estimate that leaves caustics to another method.
    pub(super) fn estimate_with<C: Caustics>(
        &self,
        caustics: &C,
        scene: &Scene,
        camera_ray: &CameraRay,
        stream: &mut SampleStream,
        out: &mut Estimate,
    ) {
        let mut probe = self.splits.as_ref().map_or(Probe::new(1), |splits| splits.at(stream.pixel()));
        self.trace_any(caustics, scene, camera_ray, stream, out, &mut probe);
    }

    /// An estimate of a path that splits as the probe says, and what it tells of that.
    pub(super) fn probe(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate, probe: &mut Probe) {
        self.trace_any(&(), scene, camera_ray, stream, out, probe);
    }

    fn trace_any<C: Caustics>(
        &self,
        caustics: &C,
        scene: &Scene,
        camera_ray: &CameraRay,
        stream: &mut SampleStream,
        out: &mut Estimate,
        probe: &mut Probe,
    ) {
        if camera_ray.weight == 0.0 {
            return;
        }
        let trace = if scene.has_media { Self::trace::<true, C> } else { Self::trace::<false, C> };
        trace(self, scene, camera_ray, caustics, stream, out, probe);
    }

    /// Follows one path. `MEDIA`: whether there are any. Compiled apart, as for each kind of `caustics`, so that scenes without pay
    /// nothing for them.
    fn trace<const MEDIA: bool, C: Caustics>(
        &self,
        scene: &Scene,
        camera_ray: &CameraRay,
        caustics: &C,
        stream: &mut SampleStream,
        out: &mut Estimate,
        probe: &mut Probe,
    ) {
        let ray = camera_ray.ray;
        let state = State {
            ray,
            throughput: Spectrum::splat(camera_ray.weight),
            last: Vertex { ctx: LightContext { p: ray.o, n: Vec3::ZERO }, pdf: f32::INFINITY, on_segment: None },
            depth: 0,
            crossings: 0,
            spare: 1.0,
            guided: 1.0,
            seen: 0.0,
            media: if MEDIA { scene.camera_medium } else { MediumStack::VACUUM },
            rng: if MEDIA { stream.rng() } else { HashRng::default() },
            trail: caustics.start(stream),
            camera_distance: 0.0,
            cone: Cone { width: 0.0, spread: camera_ray.spread_rad },
            splits: probe.splits,
            edges: 0,
        };
        let edges = self.go_on::<MEDIA, C>(scene, caustics, state, stream, out, probe);
        probe.end(out, edges);
    }

    /// Follows a path from a state on; returns its edges from the camera on.
    fn go_on<const MEDIA: bool, C: Caustics>(
        &self,
        scene: &Scene,
        caustics: &C,
        mut path: State<C::Trail>,
        stream: &mut SampleStream,
        out: &mut Estimate,
        probe: &mut Probe,
    ) -> u32 {
        let mut scatter = Scatter { parts: ArrayVec::new_const() };
        loop {
            path.edges += 1;
            let found = scene.intersect(&path.ray);
            if MEDIA && let Some(medium) = scene.medium(&path.media) {
                let t_max = found.as_ref().map_or(f32::INFINITY, |s| s.t);
                if !medium.scatters() || path.depth >= self.max_depth {
                    let crossing = medium.cross(&path.ray, t_max, &mut path.rng);
                    out.add(path.throughput * crossing.emitted, 0);
                    path.throughput *= crossing.transmittance;
                } else {
                    let equiangular = self.equiangular;
                    let scattered = volume::advance(
                        scene,
                        medium,
                        &path.media,
                        &path.ray,
                        t_max,
                        &mut path.throughput,
                        equiangular,
                        stream,
                        &mut path.rng,
                        out,
                    );
                    if let Some(Scattered { t, wi, weight, vertex }) = scattered {
                        if path.depth == 0 {
                            out.alpha = 1.0;
                            if let Some(s) = &found {
                                behind_medium(scene, s, -path.ray.d, path.camera_distance + s.t, out);
                            }
                        }
                        if C::ON {
                            let start = Start { place: Place::Medium(path.ray.at(t), medium.phase()), wo: -path.ray.d, media: &path.media };
                            caustics.add(scene, &start, path.throughput, [path.depth, self.max_depth], &mut path.trail, out);
                            caustics.scattered_in_medium(&mut path.trail, path.ray.at(t));
                        }
                        path.throughput *= weight;
                        path.ray = Ray::new(path.ray.at(t), wi);
                        path.cone.advance(t, 1.0);
                        path.cone.scatter(vertex.pdf);
                        path.last = vertex;
                        path.depth += 1;
                        if !self.survives(path.depth, &mut path.throughput, path.spare, &mut stream.part(1)) {
                            return path.edges;
                        }
                        continue;
                    }
                }
                if path.throughput.is_black() {
                    return path.edges;
                }
            }
            let Some(mut s) = found else {
                add_infinite(
                    scene,
                    path.ray.d,
                    path.throughput,
                    &path.last,
                    path.depth,
                    |light| caustics.found(scene, &path.trail, light),
                    out,
                );
                probe.met(&path.last, out);
                return path.edges;
            };
            let wo = -path.ray.d;
            if scene.mipmap {
                s.footprint = path.cone.advance(s.t, s.ng.dot(wo));
            }
            if !(C::ON && s.light(scene).is_some_and(|light| caustics.found(scene, &path.trail, light))) {
                add_emission(scene, &s, wo, path.throughput, &path.last, path.depth, out);
                probe.met(&path.last, out);
            }
            scene.materials[s.material as usize].shade_into(scene, &s, wo, &mut scatter);
            if path.depth == 0 {
                path.camera_distance += s.t;
                first_hit(scene, &s, wo, &scatter, path.camera_distance, out);
            }
            // The last scattering is done, but its ray may still go straight on to a light: shadow rays may as well.
            let last_edge = path.depth >= self.max_depth;
            if last_edge && !scene.has_null {
                return path.edges;
            }
            let directions = self.guide.as_ref().and_then(|guide| guide.at(&s, &scatter, wo));
            if let Some(lessons) = &mut probe.lessons {
                lessons.extend(Lesson::at(&s, &scatter, wo, path.throughput, path.guided, out));
            }
            // Where paths split, and on the way there, a pilot may have found it worth while to choose among light samples.
            let candidates = if path.splits > 0 { probe.candidates } else { 1 };
            let mut numbers = stream.part(DIRECT_NUMBERS + if candidates > 1 { CHOICE_NUMBERS } else { 0 });
            if !last_edge && scatter.is_smooth_anywhere() {
                let (throughput, directions) = (path.throughput, directions.as_ref());
                let receiver = Receiver { surface: &s, scatter: &scatter, wo, directions, media: &path.media, throughput };
                let found = out.radiance;
                if candidates > 1 {
                    let direct = receiver.resampled(scene, caustics, &path.trail, candidates, numbers, &mut path.rng);
                    if let Some((visible, group)) = direct {
                        out.add(visible, group);
                    }
                } else if let Some(direct) = sample_one(scene, &context(&s), &mut numbers)
                    && !(C::ON && caustics.finds_direct(&path.trail, &scatter, direct.light))
                {
                    let unshadowed = receiver.unshadowed(&direct);
                    if !unshadowed.is_black() {
                        let visible = receiver.visible(scene, &direct, unshadowed, &mut path.rng);
                        if !visible.is_black() {
                            out.add(visible, direct.group);
                        }
                    }
                }
                if path.splits > 0 && probe.compared > 1 {
                    let numbers = stream.at(COMPARED_NUMBERS);
                    let direct = receiver.resampled(scene, caustics, &path.trail, probe.compared, numbers, &mut path.rng);
                    probe.resampled(out.radiance - found, direct.map_or(Spectrum::ZERO, |d| d.0));
                }
            }
            if C::ON && !last_edge && scatter.is_smooth_anywhere() {
                let start = Start { place: Place::Surface(&s, &scatter), wo, media: &path.media };
                caustics.add(scene, &start, path.throughput, [path.depth, self.max_depth], &mut path.trail, out);
            }
            if can_guide(&scatter)
                && let Some(lesson) = probe.lessons.as_mut().and_then(|l| l.last_mut())
            {
                lesson.lit(out);
            }
            if path.splits > 0 && scatter.is_smooth_anywhere() {
                probe.at_split(out, path.edges);
                let splits = std::mem::replace(&mut path.splits, 0);
                if splits > 1 {
                    path.throughput /= splits as f32;
                    path.spare *= splits as f32;
                    for j in 0..splits {
                        let found = out.radiance;
                        let mut child = path.clone();
                        let mut stream = stream.split(splits, j);
                        if MEDIA {
                            child.rng = stream.rng();
                        }
                        let at = (&s, &scatter, directions);
                        if self.scatter::<MEDIA, C>(scene, caustics, &mut child, at, &mut stream, (probe, out)) {
                            let edges = self.go_on::<MEDIA, C>(scene, caustics, child, &mut stream, out, probe);
                            probe.edges_after += edges - path.edges;
                        }
                        if let Some(after) = probe.after.get_mut(j as usize) {
                            *after = (out.radiance - found) * splits as f32;
                        }
                    }
                    return path.edges;
                }
            }
            if !self.scatter::<MEDIA, C>(scene, caustics, &mut path, (&s, &scatter, directions), stream, (probe, out)) {
                return path.edges;
            }
        }
    }

    /// Scatters a path at a surface; whether it goes on.
    #[inline(always)]
    fn scatter<const MEDIA: bool, C: Caustics>(
        &self,
        scene: &Scene,
        caustics: &C,
        path: &mut State<C::Trail>,
        (s, scatter, directions): (&Surface, &Scatter, Option<Directions>),
        stream: &mut SampleStream,
        (probe, out): (&mut Probe, &Estimate),
    ) -> bool {
        let wo = -path.ray.d;
        let mut numbers = stream.part(SCATTER_NUMBERS);
        let u_lobe = if directions.is_some() || scatter.needs_lobe() { numbers.next_1d() } else { numbers.skip_1d() };
        let u = numbers.next_2d();
        let sample = match &directions {
            Some(directions) => directions.sample(scatter, wo, u_lobe, u),
            None => scatter.sample(wo, u_lobe, u, TransportMode::Radiance).map(|sample| (sample, sample.pdf)),
        };
        let Some((sample, bsdf_pdf)) = sample else { return false };
        let carried = path.throughput.luminance();
        path.throughput *= sample.value / sample.pdf;
        if path.throughput.is_black() {
            return false;
        }
        let o = s.offset_origin(sample.wi);
        path.ray = Ray::new(o, sample.wi);
        if C::ON && !sample.lobe.contains(Lobe::NULL) {
            caustics.scattered(&mut path.trail, s, scatter, &BsdfSample { pdf: bsdf_pdf, ..sample });
        }
        if MEDIA && sample.lobe.contains(Lobe::TRANSMISSION) {
            path.media.cross(scene, s, sample.wi);
        }
        if sample.lobe.contains(Lobe::NULL) {
            path.crossings += 1;
            return path.crossings <= MAX_CROSSINGS;
        }
        if path.depth >= self.max_depth {
            return false;
        }
        path.depth += 1;
        // What a guided path has less because more of them go its way is no reason for roulette to end it either.
        path.spare *= fns::sqr(sample.eta);
        let pdf = if sample.lobe.contains(Lobe::DELTA) { f32::INFINITY } else { sample.pdf };
        path.cone.scatter(pdf);
        if can_guide(scatter)
            && let Some(lesson) = probe.lessons.as_mut().and_then(|l| l.last_mut())
        {
            lesson.leave(s.frame.n.dot(sample.wi), sample.wi, pdf, path.throughput, out);
        }
        path.last = Vertex { ctx: context(s), pdf, on_segment: None };
        let Some(directions) = directions else {
            return self.survives(path.depth, &mut path.throughput, path.spare * path.guided.max(1.0), &mut numbers);
        };
        path.guided = (path.guided * sample.pdf / bsdf_pdf).clamp(1e-6, 1e6);
        // Whatever was learned, no path goes on for ever.
        let limit = if path.depth >= self.rr_depth { 0.99 } else { 1.0 };
        let survive = if path.seen == 0.0 {
            path.seen = carried * directions.all();
            limit
        } else {
            directions.survival(carried, path.seen).min(limit)
        };
        let survives = numbers.next_1d() < survive;
        path.throughput /= survive;
        survives
    }

    /// Russian roulette: whether the path goes on, with a throughput that makes up for those that do not. Paths that still carry half of
    /// what they began with are spared: on the scenes of `bench/efficiency.py` the noise of ending them costs more than following them.
    #[inline]
    fn survives(&self, depth: u32, throughput: &mut Spectrum, spare: f32, numbers: &mut SampleStream) -> bool {
        if depth >= self.rr_depth {
            let survive = (2.0 * throughput.max_component() * spare).min(0.99);
            if numbers.next_1d() >= survive {
                return false;
            }
            *throughput /= survive;
        }
        true
    }
}

/// Records the surface behind a medium that has scattered what the camera sees, where the ray meets one at once.
#[cold]
fn behind_medium(scene: &Scene, s: &Surface, wo: Vec3, depth: f32, out: &mut Estimate) {
    if out.first.is_none() {
        first_hit(scene, s, wo, &scene.materials[s.material as usize].shade(scene, s, wo), depth, out);
    }
}

/// Light that the surface itself sends back along the ray.
#[inline(always)]
fn add_emission(scene: &Scene, s: &Surface, wo: Vec3, throughput: Spectrum, last: &Vertex, depth: u32, out: &mut Estimate) {
    let Some(emission) = &s.object(scene).emission else { return };
    if depth == 0 && scene.hides(s) {
        return;
    }
    let radiance = scene.emitted(s, wo);
    if radiance.is_black() {
        return;
    }
    let weight = match s.light(scene) {
        Some(light) if last.pdf.is_finite() => {
            let by_light = pdf_surface(scene, &last.ctx, light, s);
            match &last.on_segment {
                None => power_heuristic(last.pdf, by_light),
                Some(on) => {
                    let pdf_light = scene.lights[light as usize].pdf_hit(&last.ctx, s.p, s.ng);
                    power_of_three(last.pdf, by_light, on.relative_pdf(scene, light, pdf_light))
                }
            }
        }
        _ => 1.0,
    };
    out.add(throughput * radiance * weight, emission.group);
}

/// Light from beyond the scene, but for lights that are `found` in another way.
#[inline]
fn add_infinite(scene: &Scene, d: Vec3, throughput: Spectrum, last: &Vertex, depth: u32, found: impl Fn(u32) -> bool, out: &mut Estimate) {
    if depth == 0 && scene.hide_lights {
        return;
    }
    for &light in &scene.infinite_lights {
        if found(light) {
            continue;
        }
        // The camera and mirrors have no density to weigh.
        let (radiance, weight) = if last.pdf.is_finite() {
            let (radiance, pdf) = infinite(scene, &last.ctx, light, d);
            (radiance, power_heuristic(last.pdf, pdf))
        } else {
            (scene.lights[light as usize].escaped(last.ctx.p, d), 1.0)
        };
        if !radiance.is_black() {
            out.add(throughput * radiance * weight, scene.light_groups[light as usize]);
        }
    }
}

/// Records what the camera sees, once: behind surfaces that are not there at all, but not behind panes.
pub(super) fn first_hit(scene: &Scene, s: &Surface, wo: Vec3, scatter: &Scatter, depth: f32, out: &mut Estimate) {
    let nothing = || !scatter.parts.is_empty() && scatter.parts.iter().all(|p| matches!(p.bsdf, Bsdf::Null(_)));
    if out.first.is_some() || nothing() {
        return;
    }
    out.alpha = 1.0;
    let ns = s.frame.n;
    out.first = Some(FirstHit {
        p: s.p,
        ns: if ns.dot(wo) < 0.0 { -ns } else { ns },
        uv: s.uv,
        depth,
        albedo: scatter.albedo(wo),
        object: s.object(scene).id,
        material: s.material + 1,
    });
}
