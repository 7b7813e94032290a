//! Walks from the lights that are kept, and found by place: what merging needs.

use rayon::prelude::*;

use super::connect::{Contribution, push_camera_joints};
use super::mis::{Joint, Origin, Technique};
use super::walk::{LightStart, START, Vertex, Walk};
use super::{Bidirectional, LIGHT_DIMENSIONS};
use crate::integrator::Stage;
use crate::math::{PI, Vec3};
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Walks that one task makes.
const CHUNK: u32 = 1024;
/// Points farther from the tangent plane than this share of the radius are not merged: they lie on other surfaces.
const THICKNESS: f32 = 0.3;

/// Where a walk from a light meets a surface that does not only mirror.
#[derive(Clone, Copy, Debug)]
struct Photon {
    p: Vec3,
    /// To where it has come from, unit.
    w: Vec3,
    /// Power.
    beta: [f32; 3],
    /// Its vertex in `links`.
    link: u32,
}

/// A vertex of a kept walk, for the weights.
#[derive(Clone, Copy, Debug)]
struct Link {
    own: f32,
    other: f32,
    to_previous: f32,
    previous: u32,
    path: u32,
    depth: u32,
    delta: bool,
    in_medium: bool,
    nee: f32,
}

/// Kept walks.
#[derive(Clone, Debug, Default)]
pub struct StoredWalks {
    photons: Vec<Photon>,
    links: Vec<Link>,
    starts: Vec<LightStart>,
    /// Start of each bucket in `photons`, and the end.
    buckets: Vec<u32>,
    radius: f32,
    /// Number of walks, those without a vertex included.
    paths: u32,
}

impl StoredWalks {
    /// Makes `paths` walks for the sample index `index`, to be merged within `radius`. Takes some 80 bytes a vertex.
    pub fn new(shared: &Bidirectional, scene: &Scene, stage: &Stage, index: u32, paths: u32, radius: f32) -> Self {
        let sampler = Sampler { kind: SamplerKind::Independent, seed: stage.seed, spp: 1 };
        let done = std::sync::atomic::AtomicU32::new(0);
        let chunks: Vec<Self> = (0..paths.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut part = Self::default();
                let mut walk = Walk::default();
                for path in chunk * CHUNK..((chunk + 1) * CHUNK).min(paths) {
                    if (stage.is_cancelled)() {
                        break;
                    }
                    // No picture has so many rows.
                    let mut numbers = sampler.stream(path, u32::MAX, index).at(LIGHT_DIMENSIONS);
                    if let Some(start) = shared.walk_light(scene, shared.max_depth, &mut numbers, &mut walk) {
                        part.keep(start, &walk);
                    }
                }
                let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
                (stage.progress)("light paths", f64::from(done) * f64::from(CHUNK) / f64::from(paths.max(1)));
                part
            })
            .collect();
        let mut all = Self { radius, paths, ..Self::default() };
        for part in chunks {
            let (first_link, first_path) = (all.links.len() as u32, all.starts.len() as u32);
            all.starts.extend(part.starts);
            all.links.extend(part.links.into_iter().map(|l| Link {
                previous: if l.previous == START { START } else { l.previous + first_link },
                path: l.path + first_path,
                ..l
            }));
            all.photons.extend(part.photons.into_iter().map(|p| Photon { link: p.link + first_link, ..p }));
        }
        all.sort();
        all
    }

    fn keep(&mut self, start: LightStart, walk: &Walk) {
        let (first, path) = (self.links.len() as u32, self.starts.len() as u32);
        self.starts.push(start);
        for (i, v) in walk.vertices.iter().enumerate() {
            let previous = if v.previous == START { START } else { v.previous + first };
            let Vertex { own, other, to_previous, depth, delta, nee, .. } = *v;
            self.links.push(Link { own, other, to_previous, previous, path, depth, delta, in_medium: v.in_medium(), nee });
            let usable = own > 0.0 && own.is_finite() && v.beta.is_finite() && v.p.is_finite();
            // In media paths are connected only.
            if usable && !v.in_medium() && v.is_smooth_anywhere() {
                self.photons.push(Photon { p: v.p, w: v.wo, beta: v.beta.rgb(), link: first + i as u32 });
            }
        }
    }

    /// Sorts the photons by the bucket of their cell; within a bucket they stay in the order of their walks.
    fn sort(&mut self) {
        let count = self.photons.len().next_power_of_two();
        let bucket_of: Vec<u32> = self.photons.par_iter().map(|p| bucket(self.cell(p.p), count)).collect();
        let mut starts = vec![0u32; count + 1];
        for &b in &bucket_of {
            starts[b as usize + 1] += 1;
        }
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut sorted = self.photons.clone();
        for (photon, &b) in self.photons.iter().zip(&bucket_of) {
            sorted[next[b as usize] as usize] = *photon;
            next[b as usize] += 1;
        }
        self.photons = sorted;
        self.buckets = starts;
    }

    fn cell(&self, p: Vec3) -> [i32; 3] {
        // Casts saturate.
        (p / (2.0 * self.radius)).floor().to_array().map(|v| v as i32)
    }

    /// Calls back with each photon within the radius of a point.
    fn near(&self, p: Vec3, mut found: impl FnMut(&Photon)) {
        let count = self.buckets.len().saturating_sub(1);
        if self.photons.is_empty() {
            return;
        }
        let (low, high) = (self.cell(p - self.radius), self.cell(p + self.radius));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let cell = [x, y, z];
                    let b = bucket(cell, count) as usize;
                    for photon in &self.photons[self.buckets[b] as usize..self.buckets[b + 1] as usize] {
                        // Other cells may share the bucket.
                        let near = (photon.p - p).length_squared() <= self.radius * self.radius;
                        if near && self.cell(photon.p) == cell {
                            found(photon);
                        }
                    }
                }
            }
        }
    }
}

fn bucket(cell: [i32; 3], count: usize) -> u32 {
    let [x, y, z] = cell.map(|v| v as u32);
    let h = crate::math::hash::mix32(x.wrapping_mul(0x8da6_b343) ^ y.wrapping_mul(0xd816_3841) ^ z.wrapping_mul(0xcb1a_b31f));
    h & (count as u32 - 1)
}

impl Bidirectional {
    /// Light of the kept walks that end near a vertex of the camera's walk.
    pub fn merge(
        &self,
        scene: &Scene,
        stored: &StoredWalks,
        (walk, z): (&Walk, &Vertex),
        joints: &mut Vec<Joint>,
        mut add: impl FnMut(Contribution),
    ) {
        let area = PI * stored.radius * stored.radius;
        let scale = 1.0 / (area * stored.paths as f32);
        if !scale.is_finite() || !(z.own > 0.0) {
            return;
        }
        let Some(ng) = z.surface().map(|s| s.ng) else { return };
        stored.near(z.p, |photon| {
            let Some(link) = stored.links.get(photon.link as usize) else { return };
            let off = (photon.p - z.p).dot(ng).abs();
            if link.depth + z.depth - 1 > self.max_depth || off > THICKNESS * stored.radius {
                return;
            }
            let (f, to_light) = z.eval(scene, photon.w);
            if f.is_black() {
                return;
            }
            let cos = ng.dot(photon.w).abs();
            let value = z.beta * f * Spectrum::from_rgb(photon.beta) * (scale / cos);
            if value.is_black() || !value.is_finite() {
                return;
            }
            let start = &stored.starts[link.path as usize];
            joints.clear();
            let mut back = Some(to_light * link.to_previous);
            let mut at = link;
            while let Some(before) = stored.links.get(at.previous as usize) {
                joints.push(Joint {
                    light: before.own,
                    camera: back.take().unwrap_or(before.other),
                    connectible: !before.delta,
                    in_medium: before.in_medium,
                });
                at = before;
            }
            joints.push(Joint { camera: back.unwrap_or(start.joint.camera), ..start.joint });
            joints.reverse();
            let origin = Origin { nee: at.nee, delta: start.delta };
            let back = z.pdf_back(scene, photon.w) * z.to_previous;
            push_camera_joints(joints, walk, z, link.own, Some(back));
            let weight = self.techniques.weight(joints, &origin, Technique::Merge(link.depth as usize));
            add(Contribution { value: value * weight, group: start.group });
        });
    }
}
