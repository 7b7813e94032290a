//! Path guiding: paths learn where light comes from, and go there (Müller, Gross, Novák 2017, "Practical Path Guiding for Efficient
//! Light-Transport Simulation", doi:10.1111/cgf.13227).
//!
//! `learn` traces rounds of paths, each guided by what those before have learned; `field` sorts their vertices into places and sides of
//! surfaces; `quadtree` holds the directions of each place; `trial` says whether all of this pays. A guided direction is weighed by the
//! densities of both ways to choose it, so that the estimate has no bias whatever was learned.
//!
//! Guided are surfaces all of whose scattering, but for mirrors and holes, stays on one side. Mirrors, glass and media go their own way.

mod field;
mod learn;
mod quadtree;
mod trial;

use std::sync::Arc;

use field::{Field, Leaf, NONE};
pub(super) use learn::Lesson;
use learn::{Learner, ROUNDS};
use trial::Trial;

use super::{Path, Stage};
use crate::bsdf::{BsdfSample, Lobe, TransportMode};
use crate::material::Scatter;
use crate::math::{ONE_MINUS_EPSILON, Vec2, Vec3};
use crate::scene::{Scene, Surface};

/// Whether paths are guided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Guiding {
    /// No.
    #[default]
    Off,
    /// Where paths are noisy, and a trial says that guided ones are less so at equal cost.
    Auto,
    /// Yes.
    On,
}

impl Guiding {
    /// By the name that the user types.
    ///
    /// # Errors
    /// A sentence where there is no such choice.
    pub fn from_name(name: &str) -> Result<Self, String> {
        Ok(match name {
            "auto" => Self::Auto,
            "on" => Self::On,
            "off" => Self::Off,
            _ => return Err(format!("no guiding `{name}`; there are auto, on, off")),
        })
    }
}

/// The share of directions that come from what was learned, on surfaces with a diffuse part and on others.
const SHARE: f32 = 0.5;
const SHARE_GLOSSY: f32 = 0.25;
/// Paths that will find less than this share of what the camera sees there end by roulette, and how likely they go on at least.
const WORTH: f32 = 0.1;
const LEAST_SURVIVAL: f32 = 0.2;
/// Relative variance of the indirect light of a sample from which on it is tried whether guided paths have less, and its share of that of
/// all light: guides take nothing from the noise of direct light, and they cost more.
const LEAST_NOISE: f64 = 3.0;
const LEAST_SHARE: f64 = 0.5;
/// Samples of each pixel that tell what makes the noise, and of the first and the last trials of guided paths.
const LOOK: u32 = 6;
const SAMPLES: [u32; 2] = [16, 48];
/// What an edge of a guided path costs in edges of others.
pub(super) const COST: f64 = 1.35;
/// How much better paths have to be that are guided by a part of what can be learned.
const LEAST_PROMISE: f64 = 1.0;
/// How much better guided paths have to be: learning takes time as well.
const LEAST_GAIN: f64 = 1.3;

/// What has been learned.
#[derive(Clone, Debug)]
pub(super) struct Guide {
    field: Arc<Field>,
}

/// The directions at one place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Directions<'a> {
    field: &'a Field,
    leaf: Leaf,
    /// The share of directions that come from here; the others are those of the surface.
    share: f32,
}

/// Whether a surface can be guided: all that it scatters, but for what mirrors and holes do, stays on its side.
#[inline]
pub(super) fn can_guide(scatter: &Scatter) -> bool {
    scatter.is_smooth_anywhere()
        && scatter.parts.iter().all(|p| p.bsdf.lobes().0 & (Lobe::TRANSMISSION.0 | Lobe::NULL.0) != Lobe::TRANSMISSION.0)
}

impl Guide {
    /// Learns where it has to, or where paths are noisy and trials say that guided ones are less so at equal cost; says what it found.
    pub fn prepare(path: &Path, scene: &Scene, stage: &Stage) -> (Option<Self>, Option<String>) {
        if path.guiding == Guiding::Off || path.max_depth < 2 {
            return (None, None);
        }
        let single = path.alone();
        let mut learner = Learner::new(&single);
        if path.guiding == Guiding::On {
            let guide = learner.learn(ROUNDS, scene, stage);
            return (guide, Some("path: guided".into()));
        }
        let look = Trial::new(&single, LOOK, scene, stage);
        let [noise, _, indirect] = look.noise(&[&look]);
        if indirect < LEAST_NOISE.max(LEAST_SHARE * noise) {
            return (None, None);
        }
        let gain = |guide: &Self, unguided: &Trial, samples: u32| {
            let guided = Trial::new(&Path { guide: Some(guide.clone()), ..single.clone() }, samples, scene, stage);
            let both = [unguided, &guided];
            let ([of_unguided, ..], [of_guided, without, _]) = (unguided.noise(&both), guided.noise(&both));
            of_unguided.max(without) * unguided.edges / (of_guided * guided.edges * COST)
        };
        let says = |gain: f64| format!("{gain:.1} times less noise at equal cost in a pilot than paths that are not");
        let no = |gain: f64| (None, Some(format!("path: not guided, as guided paths have {}", says(gain))));
        // A part of what there is to learn shows whether the rest is worth its time.
        let Some(first) = learner.learn(ROUNDS - 1, scene, stage) else { return (None, None) };
        let promise = gain(&first, &Trial::new(&single, SAMPLES[0], scene, stage), SAMPLES[0]);
        if promise < LEAST_PROMISE {
            return no(promise);
        }
        let Some(guide) = learner.learn(ROUNDS, scene, stage) else { return (None, None) };
        let gain = gain(&guide, &Trial::new(&single, SAMPLES[1], scene, stage), SAMPLES[1]);
        if gain < LEAST_GAIN || (stage.is_cancelled)() {
            return no(gain);
        }
        (Some(guide), Some(format!("path: guided, which has {}", says(gain))))
    }

    /// What is known at a surface.
    #[inline]
    pub fn at(&self, s: &Surface, scatter: &Scatter, wo: Vec3) -> Option<Directions<'_>> {
        if !can_guide(scatter) {
            return None;
        }
        let leaf = self.field.at(s.p, field::side(learn::facing(s, wo)));
        let share = if scatter.has_diffuse() { SHARE } else { SHARE_GLOSSY };
        (leaf.root != NONE).then_some(Directions { field: &self.field, leaf, share })
    }
}

impl Directions<'_> {
    /// All light that the surface sends back, in the mean.
    #[inline]
    pub fn all(&self) -> f32 {
        self.leaf.all
    }

    /// The probability with which a path goes on that has a throughput before it is scattered, and that is part of so much light: in
    /// proportion to what it will find by what was learned (Vorba and Křivánek 2016, doi:10.1145/2897824.2925912).
    #[inline]
    pub fn survival(&self, throughput: f32, of: f32) -> f32 {
        let expected = throughput * self.leaf.sent;
        if expected < of * WORTH { (expected / (of * WORTH)).max(LEAST_SURVIVAL) } else { 1.0 }
    }

    /// The density of a direction, of which that of the surface's own sampling is given.
    #[inline]
    pub fn pdf(&self, wi: Vec3, bsdf_pdf: f32) -> f32 {
        self.share * self.field.directions.pdf(self.leaf.root, wi) + (1.0 - self.share) * bsdf_pdf
    }

    /// Samples a direction from here or from the surface: one-sample multiple importance sampling by the balance heuristic. Returns the
    /// density of the surface's own sampling as well.
    #[inline]
    pub fn sample(&self, scatter: &Scatter, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<(BsdfSample, f32)> {
        if u_lobe >= self.share {
            let u_lobe = ((u_lobe - self.share) / (1.0 - self.share)).min(ONE_MINUS_EPSILON);
            let sample = scatter.sample(wo, u_lobe, u, TransportMode::Radiance)?;
            let pdf = if sample.lobe.contains(Lobe::DELTA) { (1.0 - self.share) * sample.pdf } else { self.pdf(sample.wi, sample.pdf) };
            return Some((BsdfSample { pdf, ..sample }, sample.pdf));
        }
        let (wi, pdf) = self.field.directions.sample(self.leaf.root, u);
        let (value, bsdf_pdf) = scatter.eval_pdf(wo, wi, TransportMode::Radiance);
        let pdf = self.share * pdf + (1.0 - self.share) * bsdf_pdf;
        let lobe = Lobe::GLOSSY.union(Lobe::REFLECTION);
        (pdf > 0.0 && !value.is_black()).then_some((BsdfSample { wi, value, pdf, lobe, eta: 1.0 }, bsdf_pdf))
    }
}
