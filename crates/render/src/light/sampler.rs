//! Choosing a light.

use super::bvh::LightBvh;
use super::{Light, LightBounds, LightContext, SceneSphere};
use crate::math::{ONE_MINUS_EPSILON, PiecewiseConstant1D};

/// How lights are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightSelection {
    /// All alike. Right where there are few.
    Uniform,
    /// By the power that they bring into the scene.
    Power,
    /// By a hierarchy, which knows distance and orientation. Infinite lights have half of the samples, in equal shares.
    #[default]
    Bvh,
}

/// Chooses lights for points of a scene. Lights that give nothing are never chosen.
#[derive(Clone, Debug)]
pub struct LightSampler {
    strategy: Strategy,
}

#[derive(Clone, Debug)]
enum Strategy {
    /// No light, or one.
    Single(Option<u32>),
    /// Independent of the point.
    Table(PiecewiseConstant1D),
    Bvh {
        infinite: Vec<u32>,
        /// For each light whether it is in `infinite`.
        is_infinite: Vec<bool>,
        finite: LightBvh,
    },
}

impl LightSampler {
    /// For the lights of a scene. O(n log n).
    pub fn new(lights: &[Light], scene: &SceneSphere, selection: LightSelection) -> Self {
        let power: Vec<f32> = lights.iter().map(|l| super::bounds::strength(l.power(scene))).collect();
        let gives = |i: usize| power[i] > 0.0;
        let mut giving = (0..lights.len()).filter(|&i| gives(i));
        let (first, second) = (giving.next(), giving.next());
        if second.is_none() {
            return Self { strategy: Strategy::Single(first.map(|i| i as u32)) };
        }
        let strategy = match selection {
            LightSelection::Uniform => {
                let weights: Vec<f32> = (0..lights.len()).map(|i| f32::from(u8::from(gives(i)))).collect();
                Strategy::Table(PiecewiseConstant1D::new(&weights))
            }
            LightSelection::Power => Strategy::Table(PiecewiseConstant1D::new(&floored(&power))),
            LightSelection::Bvh => {
                let is_infinite: Vec<bool> = (0..lights.len()).map(|i| lights[i].is_infinite() && gives(i)).collect();
                let infinite = (0..lights.len()).filter(|&i| is_infinite[i]).map(|i| i as u32).collect();
                let finite: Vec<(u32, LightBounds)> = lights
                    .iter()
                    .enumerate()
                    .filter_map(|(i, l)| Some((i as u32, l.bounds()?)))
                    .filter(|&(i, _)| gives(i as usize))
                    .collect();
                Strategy::Bvh { infinite, is_infinite, finite: LightBvh::new(finite, lights.len()) }
            }
        };
        Self { strategy }
    }

    /// Whether there is more than one light to choose from.
    #[inline]
    pub fn has_choice(&self) -> bool {
        !matches!(self.strategy, Strategy::Single(_))
    }

    /// A light's index and its probability for `u` in [0, 1); `None` where no light can arrive (the estimate is then zero).
    #[inline]
    pub fn sample(&self, ctx: &LightContext, u: f32) -> Option<(u32, f32)> {
        match &self.strategy {
            Strategy::Single(light) => light.map(|l| (l, 1.0)),
            Strategy::Table(table) => {
                let (light, pmf, _) = table.sample_discrete(u);
                (pmf > 0.0).then_some((light as u32, pmf))
            }
            Strategy::Bvh { infinite, finite, .. } => {
                let share = infinite_share(infinite.len(), finite);
                let position = u / share;
                if position < infinite.len() as f32 {
                    return Some((infinite[position as usize], share));
                }
                let rest = 1.0 - share * infinite.len() as f32;
                let u = ((u - share * infinite.len() as f32) / rest).clamp(0.0, ONE_MINUS_EPSILON);
                finite.sample(ctx.p, ctx.n, u).map(|(light, pmf)| (light, pmf * rest))
            }
        }
    }

    /// The probability with which [`LightSampler::sample`] returns the light.
    #[inline]
    pub fn pmf(&self, ctx: &LightContext, light: u32) -> f32 {
        match &self.strategy {
            Strategy::Single(single) => f32::from(u8::from(*single == Some(light))),
            Strategy::Table(table) => {
                if (light as usize) < table.len() {
                    table.probability(light as usize)
                } else {
                    0.0
                }
            }
            Strategy::Bvh { infinite, is_infinite, finite } => {
                let share = infinite_share(infinite.len(), finite);
                match is_infinite.get(light as usize) {
                    Some(true) => share,
                    Some(false) => (1.0 - share * infinite.len() as f32) * finite.pmf(ctx.p, ctx.n, light),
                    None => 0.0,
                }
            }
        }
    }
}

/// The probability of each infinite light: half in all if there are finite ones, which cannot be compared with them.
#[inline]
fn infinite_share(infinite: usize, finite: &LightBvh) -> f32 {
    (if finite.is_empty() { 1.0 } else { 0.5 }) / infinite.max(1) as f32
}

/// Powers with a floor: a table of `f32` rounds shares below 6e-8 to nothing, and every light must have its chance.
fn floored(power: &[f32]) -> Vec<f32> {
    let total = power.iter().map(|&p| f64::from(p)).sum::<f64>();
    let floor = (total * (1e-3 / power.len().max(1) as f64).max(2.5e-7)) as f32;
    power.iter().map(|&p| if p > 0.0 { p.max(floor) } else { 0.0 }).collect()
}
