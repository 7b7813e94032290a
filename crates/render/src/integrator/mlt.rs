//! Metropolis light transport in the space of random numbers (Kelemen, Szirmay-Kalos, Antal, Csonka 2002, doi:10.1111/1467-8659.t01-1-00703)
//! over multiplexed bidirectional paths (Hachisuka, Kaplanyan, Dachsbacher 2014, "Multiplexed Metropolis Light Transport",
//! doi:10.1145/2601097.2601138).
//!
//! A chain of paths changes the numbers that a path is made of, a little or altogether, and stays where light is. One number chooses the
//! technique, so that chains find the one that makes a path best. Each chain has a path length of its own. It is for light that is hard
//! to find at all: through a keyhole, or of many mirrors. In easy scenes it is noisier than `path`: its error shows as blotches.
//!
//! Chains are short and many, and each sample of the picture has its own: some pixels head a chain, which starts at one of the paths
//! that the sample index's bootstrap has drawn in proportion to the light that they bring, so that it needs no time to settle. Which light
//! there is in all is estimated by the same bootstrap. Everything is a function of the seed, the pixel and the index, so that films merge
//! as always; the mean over indices is unbiased.

use rayon::prelude::*;

use super::bidirectional::mis::Joint;
use super::bidirectional::walk::Walk;
use super::bidirectional::{Bidirectional, Numbers};
use super::{Estimate, Integrator, Splat, Stage};
use crate::camera::CameraRay;
use crate::math::hash::{hash_words, mix64, unit_float};
use crate::math::{PiecewiseConstant1D, Vec2, fns};
use crate::sampler::{HashRng, SampleStream};
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Longest path, in scattering events.
const MAX_DEPTH: u32 = 100;
/// How much rarer a path length is tried than the one before it.
const DEPTH_RATIO: f32 = 0.75;
/// Share of mutations that change everything.
const LARGE_STEPS: f32 = 0.3;
/// Smallest and largest small step (Kelemen et al. 2002, section 3.1).
const SMALL_STEPS: [f32; 2] = [1.0 / 1024.0, 1.0 / 64.0];
/// Longest chain.
const MAX_CHAIN: u32 = 1024;

/// Metropolis light transport.
pub struct Mlt {
    shared: Bidirectional,
    /// For what the camera sees directly, which needs no chains.
    direct_sight: Bidirectional,
    seed: u64,
    size: [u32; 2],
    bootstrap: Bootstrap,
}

/// Where chains of one sample index start.
#[derive(Clone, Debug, Default)]
struct Bootstrap {
    index: u32,
    /// Mean of the light that a path brings to the picture.
    mean: f64,
    /// Chooses starts; `None` where there is no light.
    table: Option<PiecewiseConstant1D>,
}

/// Light that a path brings, in radiance times square pixels.
#[derive(Clone, Debug, Default)]
struct Brought {
    splats: Vec<Splat>,
    /// What chains are proportional to.
    total: f32,
}

impl Mlt {
    /// Paths of at most `max_depth` scattering events, and never more than 100.
    pub fn new(max_depth: u32) -> Self {
        Self {
            shared: Bidirectional::new(max_depth.min(MAX_DEPTH), u32::MAX),
            direct_sight: Bidirectional::new(0, u32::MAX),
            seed: 0,
            size: [1; 2],
            bootstrap: Bootstrap::default(),
        }
    }

    fn pixels(&self) -> u32 {
        self.size[0].saturating_mul(self.size[1])
    }

    /// Mutations of a chain.
    fn chain_length(&self) -> u32 {
        (self.pixels() / 128).clamp(16, MAX_CHAIN)
    }

    /// The first pixel of a sample index that heads a chain: each `chain_length`-th after it does as well.
    fn first_head(&self, index: u32) -> u32 {
        (hash_words([self.seed, u64::from(index), 0x6865_6164]) % u64::from(self.chain_length())) as u32
    }

    /// Numbers of a start, with the path length that they choose and its probability.
    fn start(&self, index: u32, number: u32) -> (Primary, u32, f32) {
        let mut primary = Primary::new(hash_words([self.seed, u64::from(index), u64::from(number), 0x626f_6f74]));
        let u = primary.uniform();
        let longest = self.shared.max_depth;
        let total = 1.0 - fns::pow(DEPTH_RATIO, longest as f32);
        let (mut depth, mut p, mut below) = (1, (1.0 - DEPTH_RATIO) / total, 0.0);
        while depth < longest && u >= below + p {
            below += p;
            p *= DEPTH_RATIO;
            depth += 1;
        }
        (primary, depth, p)
    }

    /// The path of `depth` scattering events that the numbers make.
    fn path(&self, scene: &Scene, depth: u32, primary: &mut Primary, scratch: &mut Scratch, out: &mut Brought) {
        out.splats.clear();
        let shared = &self.shared;
        primary.rewind();
        let joints = &mut scratch.joints;
        let techniques = depth + 2;
        let s = ((primary.of(CHOICE).next_1d() * techniques as f32) as u32).min(techniques - 1);
        let (light_edges, camera_edges) = (s.saturating_sub(1), techniques - s - 1);
        let start = if s >= 2 { shared.walk_light(scene, light_edges, &mut primary.of(LIGHT), &mut scratch.light) } else { None };
        if s >= 2 && start.is_none() {
            out.total = 0.0;
            return;
        }
        let pixels = scene.camera.pixels();
        let times = techniques as f32;
        let ends = |walk: &Walk, edges: u32| (0..walk.vertices.len()).filter(|&i| walk.vertices[i].depth == edges).collect::<Vec<_>>();
        if camera_edges == 0 {
            let Some(start) = &start else { return };
            for i in ends(&scratch.light, light_edges) {
                let y = &scratch.light.vertices[i];
                if let Some((picture, c)) = shared.to_camera(scene, (&scratch.light, start, y), &mut primary.of(CONNECTION), joints) {
                    out.splats.push(Splat { picture, radiance: c.value * (pixels * times), group: c.group });
                }
            }
        } else {
            // The picture and what its filter reaches beyond it.
            let extent = Vec2::new(self.size[0] as f32, self.size[1] as f32) + Vec2::splat(2.0 * shared.margin);
            let mut numbers = primary.of(CAMERA);
            let picture = numbers.next_2d() * extent - Vec2::splat(shared.margin);
            let camera_ray = scene.camera.ray(picture, numbers.next_2d());
            let escape = shared.walk_camera(scene, &camera_ray, camera_edges, &mut numbers, &mut scratch.camera);
            let mut rng = if scene.has_media { primary.of(CONNECTION).rng() } else { HashRng::default() };
            let walk = &scratch.camera;
            let scale = extent.x * extent.y * times;
            let mut add = |value: Spectrum, group: u32| out.splats.push(Splat { picture, radiance: value * scale, group });
            for &(_, emitted) in walk.emitted.iter().filter(|(edges, e)| s == 0 && edges + 1 == camera_edges && !e.is_black()) {
                add(emitted, 0);
            }
            for i in ends(walk, camera_edges) {
                let z = &walk.vertices[i];
                match (s, &start) {
                    (0, _) => {
                        if let Some(c) = shared.hit(scene, walk, z, joints) {
                            add(c.value, c.group);
                        }
                    }
                    (_, None) => {
                        if let Some(c) = shared.direct(scene, walk, z, &mut primary.of(CONNECTION), joints) {
                            add(c.value, c.group);
                        }
                    }
                    (_, Some(start)) => {
                        for j in ends(&scratch.light, light_edges) {
                            let y = (&scratch.light, start, &scratch.light.vertices[j]);
                            if let Some(c) = shared.connect(scene, y, (walk, z), &mut rng, joints) {
                                add(c.value, c.group);
                            }
                        }
                    }
                }
            }
            if let Some(escape) = escape.filter(|e| s == 0 && walk.depth_of(e.previous) + 1 == camera_edges) {
                shared.escape(scene, walk, &escape, joints, |c| add(c.value, c.group));
            }
        }
        out.splats.retain(|s| s.radiance.is_finite());
        out.total = out.splats.iter().map(|s| s.radiance.map(f32::abs).luminance()).sum();
        if !out.total.is_finite() {
            out.total = 0.0;
        }
    }

    /// A chain, into the sample of the pixel that heads it.
    fn chain(&self, scene: &Scene, head: u32, first_head: u32, out: &mut Estimate) {
        let (index, length) = (self.bootstrap.index, self.chain_length());
        let Some(table) = &self.bootstrap.table else { return };
        let mut rng = hash_words([self.seed, u64::from(index), u64::from(head), 0x6368_6169]);
        let (number, _, _) = table.sample_discrete(uniform(&mut rng));
        let (mut primary, depth, _) = self.start(index, number as u32);
        let (mut scratch, mut current, mut proposed) = (Scratch::default(), Brought::default(), Brought::default());
        self.path(scene, depth, &mut primary, &mut scratch, &mut current);
        if current.total <= 0.0 {
            return;
        }
        // From here on the chain's own numbers: others may start where it has.
        primary.rng = rng;
        let heads = (self.pixels() - 1 - first_head) / length + 1;
        let each = (self.bootstrap.mean / (f64::from(heads) * f64::from(length))) as f32;
        // What stays is brought once for all the mutations that it has survived.
        let mut stay = 0.0f32;
        let bring = |what: &Brought, weight: f32, out: &mut Estimate| {
            let scale = each * weight / what.total;
            if weight > 0.0 {
                out.splats.extend(what.splats.iter().map(|s| Splat { radiance: s.radiance * scale, ..*s }));
            }
        };
        for _ in 0..length {
            primary.mutate();
            self.path(scene, depth, &mut primary, &mut scratch, &mut proposed);
            let accept = (proposed.total / current.total).min(1.0);
            stay += 1.0 - accept;
            if primary.uniform() < accept {
                bring(&current, stay, out);
                std::mem::swap(&mut current, &mut proposed);
                stay = accept;
                primary.accept();
            } else {
                if accept > 0.0 {
                    bring(&proposed, accept, out);
                }
                primary.reject();
            }
        }
        bring(&current, stay, out);
    }
}

impl Integrator for Mlt {
    fn set_margin(&mut self, pixels: f32) {
        self.shared.margin = pixels;
    }

    fn prepare(&mut self, scene: &Scene, stage: &Stage) -> Result<(), String> {
        (self.seed, self.size) = (stage.seed, stage.size);
        self.shared.prepare(scene)?;
        Ok(())
    }

    fn pass_limit(&self) -> u32 {
        1
    }

    fn begin_pass(&mut self, scene: &Scene, first: u32, _end: u32, stage: &Stage) -> Result<(), String> {
        self.bootstrap = Bootstrap { index: first, ..Bootstrap::default() };
        if self.shared.max_depth == 0 {
            return Ok(());
        }
        let count = (self.pixels() / 4).clamp(1024, 1 << 18);
        let totals: Vec<f32> = (0..count)
            .into_par_iter()
            .map_init(
                || (Scratch::default(), Brought::default()),
                |(scratch, brought), number| {
                    if (stage.is_cancelled)() {
                        return 0.0;
                    }
                    let (mut primary, depth, p) = self.start(first, number);
                    self.path(scene, depth, &mut primary, scratch, brought);
                    brought.total / p
                },
            )
            .collect();
        let sum: f64 = totals.iter().map(|&t| f64::from(t)).sum();
        if sum > 0.0 && sum.is_finite() {
            self.bootstrap.mean = sum / f64::from(count);
            self.bootstrap.table = Some(PiecewiseConstant1D::new(&totals));
        }
        Ok(())
    }

    fn splats(&self) -> bool {
        true
    }

    fn notes(&self) -> Vec<String> {
        let note = format!("mlt: paths of more than {MAX_DEPTH} scattering events are left out");
        if self.shared.max_depth == MAX_DEPTH { vec![note] } else { Vec::new() }
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let mut scratch = Scratch::default();
        let walk = &mut scratch.camera;
        let escape = self.direct_sight.walk_camera(scene, camera_ray, 1, stream, walk);
        for &(_, emitted) in &walk.emitted {
            out.add(emitted, 0);
        }
        self.direct_sight.direct_sight(scene, camera_ray, walk, escape.as_ref(), &mut scratch.joints, out);
        let [x, y] = stream.pixel();
        let number = y.saturating_mul(self.size[0]).saturating_add(x);
        let first_head = self.first_head(self.bootstrap.index);
        if stream.index() == self.bootstrap.index && number % self.chain_length() == first_head {
            self.chain(scene, number, first_head, out);
        }
    }
}

/// Memory that paths use again.
#[derive(Default)]
struct Scratch {
    light: Walk,
    camera: Walk,
    joints: Vec<Joint>,
}

/// Which numbers a part of a path takes.
const CHOICE: usize = 0;
const LIGHT: usize = 1;
const CAMERA: usize = 2;
const CONNECTION: usize = 3;

/// A random number of a path and what it was before the last mutation.
#[derive(Clone, Copy, Debug)]
struct Coordinate {
    value: f32,
    changed: u32,
    old_value: f32,
    old_changed: u32,
}

/// The numbers that a path is made of. They are changed when they are asked for: most are not.
#[derive(Clone, Debug)]
struct Primary {
    coordinates: [Vec<Coordinate>; 4],
    position: [usize; 4],
    rng: u64,
    /// Mutations so far, and the last that changed everything.
    iteration: u32,
    last_large: u32,
    is_large: bool,
}

/// The next uniform number of a generator.
fn uniform(rng: &mut u64) -> f32 {
    *rng = rng.wrapping_add(0x9e37_79b9_7f4a_7c15);
    unit_float((mix64(*rng) >> 32) as u32)
}

impl Primary {
    fn new(rng: u64) -> Self {
        Self { coordinates: Default::default(), position: [0; 4], rng, iteration: 0, last_large: 0, is_large: true }
    }

    fn uniform(&mut self) -> f32 {
        uniform(&mut self.rng)
    }

    /// Starts over with the first numbers.
    fn rewind(&mut self) {
        self.position = [0; 4];
    }

    /// Proposes other numbers.
    fn mutate(&mut self) {
        self.iteration += 1;
        self.is_large = self.uniform() < LARGE_STEPS;
    }

    /// Takes the proposal.
    fn accept(&mut self) {
        if self.is_large {
            self.last_large = self.iteration;
        }
    }

    /// Goes back to what was before.
    fn reject(&mut self) {
        for c in self.coordinates.iter_mut().flatten().filter(|c| c.changed == self.iteration) {
            (c.value, c.changed) = (c.old_value, c.old_changed);
        }
        self.iteration -= 1;
    }

    /// The numbers of one part.
    fn of(&mut self, part: usize) -> Part<'_> {
        Part { primary: self, part }
    }

    fn next(&mut self, part: usize) -> f32 {
        let at = self.position[part];
        self.position[part] += 1;
        if at >= self.coordinates[part].len() {
            // Never asked for before: as good as changed altogether long ago.
            let value = self.uniform();
            let changed = self.last_large;
            self.coordinates[part].push(Coordinate { value, changed, old_value: value, old_changed: changed });
        }
        let mut c = self.coordinates[part][at];
        if c.changed < self.last_large {
            // The last large step would have changed it.
            (c.value, c.changed) = (self.uniform(), self.last_large);
        }
        (c.old_value, c.old_changed) = (c.value, c.changed);
        if c.changed < self.iteration {
            if self.is_large {
                c.value = self.uniform();
            } else {
                for _ in c.changed..self.iteration {
                    c.value = small_step(c.value, self.uniform());
                }
            }
            c.changed = self.iteration;
        }
        self.coordinates[part][at] = c;
        c.value
    }
}

/// A step of an exponentially distributed size to either side, around the unit interval.
fn small_step(value: f32, u: f32) -> f32 {
    let [least, most] = SMALL_STEPS;
    let (u, sign) = if u < 0.5 { (2.0 * u, 1.0) } else { (2.0 * u - 1.0, -1.0) };
    let v = value + sign * most * fns::exp(-fns::ln(most / least) * u);
    let v = v - v.floor();
    if v < 1.0 { v } else { 0.0 }
}

/// See [`Primary::of`].
struct Part<'a> {
    primary: &'a mut Primary,
    part: usize,
}

impl Numbers for Part<'_> {
    fn next_1d(&mut self) -> f32 {
        self.primary.next(self.part)
    }

    fn next_2d(&mut self) -> Vec2 {
        Vec2::new(self.next_1d(), self.next_1d())
    }

    fn rng(&mut self) -> HashRng {
        // A small step changes all of these numbers: in media of grids chains take more large ones.
        HashRng::new(u64::from(self.next_1d().to_bits()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mutations keep the numbers uniform, and what is rejected comes back.
    #[test]
    fn mutations_keep_numbers_uniform_and_rejections_restore_them() {
        let mut primary = Primary::new(7);
        let (mut sum, mut squares, n) = (0.0f64, 0.0f64, 200_000);
        let mut first = primary.of(LIGHT).next_1d();
        for i in 0..n {
            primary.mutate();
            primary.rewind();
            let proposed = primary.of(LIGHT).next_1d();
            if i % 3 == 0 {
                primary.reject();
            } else {
                primary.accept();
                first = proposed;
            }
            let c = primary.coordinates[LIGHT][0];
            assert_eq!(c.value, first);
            assert!((0.0..1.0).contains(&c.value));
            sum += f64::from(c.value);
            squares += f64::from(c.value * c.value);
        }
        let n = f64::from(n);
        assert!((sum / n - 0.5).abs() < 0.01 && (squares / n - 1.0 / 3.0).abs() < 0.01, "{} {}", sum / n, squares / n);
    }
}
