//! What happens to paths on segments within scattering media: free flights, direct light where they end, and equiangular sampling of
//! direct light along the segment.
//!
//! Light of single scattering along a segment is sampled by three techniques, weighed by the power heuristic in the measure (distance,
//! solid angle at that distance):
//!
//! - **A**: distance by free flight, then a light is chosen from there and sampled: p = flight · choice · light;
//! - **B**: a light is chosen for the segment, the distance is equiangular about its middle, then it is sampled from there:
//!   p = choice · equiangular · light; only in homogeneous media, whose free flights have a known density, and for lights that are small
//!   as seen from the segment;
//! - **C**: distance by free flight, direction from the phase function: p = flight · phase.
//!
//! Densities are divided by that of the free flight, which A and C share and which grids do not know.

use super::light_sampling::{Direct, sample_one, visibility_in_medium};
use super::{Estimate, Vertex};
use crate::accel::Ray;
use crate::light::LightContext;
use crate::math::{Vec3, fns, warp::power_heuristic};
use crate::medium::equiangular::Equiangular;
use crate::medium::{Homogeneous, Medium, MediumStack};
use crate::sampler::{HashRng, SampleStream};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Segments that span a smaller angle as seen from a light gain nothing: free flights are as good there.
const LEAST_ANGLE: f32 = 0.3;
/// Optical distance beyond which a segment carries nothing worth a sample of its own.
const OPTICAL_END: f32 = 12.0;

/// A segment on which direct light is sampled along its length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    o: Vec3,
    d: Vec3,
    /// Where it ends, or where nothing comes from any more.
    end: f32,
    /// The point that stands for the segment when a light is chosen.
    reference: LightContext,
}

/// Where on a segment a path was scattered.
#[derive(Clone, Copy, Debug)]
pub(super) struct OnSegment {
    segment: Segment,
    t: f32,
    /// Density of the free flight.
    pdf_flight: f32,
}

impl OnSegment {
    /// Density of technique B for a light and a direction towards it, over the density of the free flight; `pdf_light` is that of the
    /// direction without the choice of the light.
    #[inline]
    pub(super) fn relative_pdf(&self, scene: &Scene, light: u32, pdf_light: f32) -> f32 {
        match self.segment.toward(scene, light) {
            Some(e) if self.t < self.segment.end => {
                let pmf = scene.light_sampler.pmf(&self.segment.reference, light);
                pmf * e.pdf(self.t) * pdf_light / self.pdf_flight
            }
            _ => 0.0,
        }
    }
}

impl Segment {
    fn new(medium: &Homogeneous, ray: &Ray, t_max: f32, lanes: Spectrum) -> Self {
        let sigma = lanes.0[0] * medium.sigma_t.0[0] + lanes.0[1] * medium.sigma_t.0[1] + lanes.0[2] * medium.sigma_t.0[2];
        let end = t_max.min(OPTICAL_END / sigma.max(f32::MIN_POSITIVE));
        let reference = LightContext { p: ray.at((0.5 * end).min(1.0 / sigma.max(f32::MIN_POSITIVE))), n: Vec3::ZERO };
        Self { o: ray.o, d: ray.d, end, reference }
    }

    /// Distances by the angle about a light; `None` for lights without a place, and where it would not pay.
    #[inline]
    fn toward(&self, scene: &Scene, light: u32) -> Option<Equiangular> {
        let (center, radius) = (*scene.light_places.get(light as usize)?)?;
        Equiangular::new(self.o, self.d, self.end, center).filter(|e| e.angle() > LEAST_ANGLE && radius < e.distance())
    }
}

/// Where and how a path goes on after a medium has scattered it.
pub(super) struct Scattered {
    pub t: f32,
    pub wi: Vec3,
    /// What the throughput has to be multiplied with for `wi`.
    pub weight: f32,
    pub vertex: Vertex,
}

/// Takes a path along a segment of a scattering medium: adds emission and direct light, and returns where it is scattered; `None`
/// where it crosses the segment. The throughput is black where the path ends.
#[allow(clippy::too_many_arguments, reason = "the state of a path")]
pub(super) fn advance(
    scene: &Scene,
    medium: &Medium,
    media: &MediumStack,
    ray: &Ray,
    t_max: f32,
    throughput: &mut Spectrum,
    equiangular: bool,
    stream: &mut SampleStream,
    rng: &mut HashRng,
    out: &mut Estimate,
) -> Option<Scattered> {
    let before = *throughput;
    let mut segment = None;
    if let Medium::Homogeneous(m) = medium
        && equiangular
        && !scene.light_places.is_empty()
    {
        let lanes = Homogeneous::lanes(before);
        let s = Segment::new(m, ray, t_max, lanes);
        along_segment(scene, m, media, &s, before, lanes, stream, rng, out);
        segment = Some((s, m, lanes));
    }
    let flight = medium.sample_flight(ray, t_max, before, stream.next_1d(), rng);
    out.add(before * flight.emitted, 0);
    *throughput *= flight.weight;
    let t = flight.scattered_at.filter(|_| !throughput.is_black())?;
    let on_segment = segment.map(|(segment, m, lanes)| OnSegment { segment, t, pdf_flight: m.pdf_flight(t, lanes) });
    let (p, wo) = (ray.at(t), -ray.d);
    let ctx = LightContext { p, n: Vec3::ZERO };
    let phase = medium.phase();
    if let Some(Direct { sample, radiance, pdf, group, light }) = sample_one(scene, &ctx, stream) {
        let by_phase = if sample.delta { 0.0 } else { phase.pdf(wo, sample.wi) };
        let by_angle = on_segment.map_or(0.0, |on| on.relative_pdf(scene, light, sample.pdf));
        let weight = power_of_three(pdf, by_angle, by_phase);
        let visible = visibility_in_medium(scene, p, media, &sample, rng);
        out.add(*throughput * radiance * visible * (phase.eval(wo, sample.wi) * weight / pdf), group);
    }
    let sample = phase.sample(wo, stream.next_2d());
    Some(Scattered { t, wi: sample.wi, weight: sample.weight, vertex: Vertex { ctx, pdf: sample.pdf, on_segment } })
}

/// Technique B: one light, one distance.
#[allow(clippy::too_many_arguments, reason = "the state of a path")]
fn along_segment(
    scene: &Scene,
    medium: &Homogeneous,
    media: &MediumStack,
    segment: &Segment,
    throughput: Spectrum,
    lanes: Spectrum,
    stream: &mut SampleStream,
    rng: &mut HashRng,
    out: &mut Estimate,
) {
    let (u_light, u, u_distance) = (stream.next_1d(), stream.next_2d(), stream.next_1d());
    let Some((light, choice)) = scene.light_sampler.sample(&segment.reference, u_light) else { return };
    let Some(e) = segment.toward(scene, light) else { return };
    let t = e.sample(u_distance);
    if !(t > 0.0 && t < segment.end) {
        return;
    }
    let p = segment.o + segment.d * t;
    let ctx = LightContext { p, n: Vec3::ZERO };
    let Some(sample) = scene.lights[light as usize].sample(&ctx, u).filter(|s| s.pdf > 0.0) else { return };
    let wo = -segment.d;
    let phase = medium.phase.eval(wo, sample.wi);
    let pdf = choice * e.pdf(t) * sample.pdf;
    let pdf_flight = medium.pdf_flight(t, lanes);
    let by_flight = pdf_flight * scene.light_sampler.pmf(&ctx, light) * sample.pdf;
    let by_phase = if sample.delta { 0.0 } else { pdf_flight * medium.phase.pdf(wo, sample.wi) };
    let weight = power_of_three(pdf, by_flight, by_phase);
    let arriving = throughput * medium.transmittance(t) * medium.sigma_s * scene.light_radiance(light, &sample) * (phase * weight / pdf);
    if !arriving.is_black() {
        let visible = visibility_in_medium(scene, p, media, &sample, rng);
        out.add(arriving * visible, scene.light_groups[light as usize]);
    }
}

/// The power heuristic (β = 2) of three densities, for the first.
#[inline]
pub(super) fn power_of_three(f: f32, g: f32, h: f32) -> f32 {
    if h == 0.0 {
        return power_heuristic(f, g);
    }
    // Ratios, so that squares do not overflow.
    1.0 / (1.0 + fns::sqr(g / f) + fns::sqr(h / f))
}
