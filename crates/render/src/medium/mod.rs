//! Participating media: what fills shapes and the space around the camera. The closed set is [`Medium`].
//!
//! The contract, for every medium:
//!
//! - Coefficients are per unit of length in world space, in lanes: absorption σa, scattering σs, extinction σt = σa + σs, and the
//!   emitted radiance per unit of length. A medium lies in world space; which shape holds it is the affair of [`MediumStack`].
//! - Segments are rays with a **unit** direction, from 0 to `t_max`, which may be infinite; `ray.t_min` and `ray.t_max` are not looked at.
//! - [`Medium::transmittance`] is an unbiased estimate of exp(−∫σt dt), exact for homogeneous media (Beer–Lambert), by ratio tracking
//!   for grids (Novák, Selle, Jarosz 2014, "Residual Ratio Tracking", doi:10.1145/2661229.2661292).
//! - [`Medium::sample_flight`] samples where light is scattered next: by inversion with multiple importance sampling over the lanes
//!   for homogeneous media, by delta tracking for grids (Woodcock et al. 1965), whose lanes share one path by throughput weights (Kutz,
//!   Habel, Li, Novák 2017, "Spectral and Decomposition Tracking", doi:10.1145/3072959.3073665). There is no absorption event: the weight
//!   carries it. Weights are ratios to the density with which the flight was sampled, so the estimator is `throughput *= weight`.
//! - A flight that passes has sampled the transmittance: a path that goes on to a light has the direction's density alone in the weights
//!   of multiple importance sampling. So delta tracking needs no density of its distances; [`Homogeneous::pdf_flight`] is known and is
//!   there for those who weigh distances (equiangular sampling, bidirectional connections).
//! - [`Phase`]: `wo` and `wi` both point away from the point where light is scattered, in world space; `eval` is normalized over the
//!   sphere (1/4π for the isotropic one) and has no cosine; `pdf` is the density of `sample`. Today they are equal for all models.
//! - Random numbers: `u` is one well distributed number in [0, 1) of the sample's stream; what tracking needs beyond it comes from a
//!   [`HashRng`] that the path makes once, by [`SampleStream::rng`](crate::sampler::SampleStream::rng). Homogeneous media draw nothing from it.
//! - Bounded work: a grid's majorant is limited so that a ray meets at most [`grid::MOST_STEPS`] tentative collisions in the mean.

mod blackbody;
pub mod equiangular;
pub mod grid;
pub mod homogeneous;
mod majorant;
pub mod phase;
mod stack;
mod volume;

pub use grid::GridMedium;
pub use homogeneous::Homogeneous;
pub use phase::{Phase, PhaseSample};
pub use stack::MediumStack;
pub use volume::Volume;

use etendue_scene::desc::{MediumDesc, SceneDesc};

use crate::accel::Ray;
use crate::math::Vec3;
use crate::sampler::HashRng;
use crate::spectrum::Spectrum;

/// What a medium does at a point, per unit of length.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coefficients {
    /// Absorption plus scattering.
    pub sigma_t: Spectrum,
    /// Scattering.
    pub sigma_s: Spectrum,
    /// Emitted radiance.
    pub emission: Spectrum,
}

/// A sampled free flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Where light is scattered; `None`: the segment is crossed.
    pub scattered_at: Option<f32>,
    /// What the throughput is multiplied by: transmittance (times σs, where light is scattered) over the density.
    pub weight: Spectrum,
    /// Estimate of what the segment emits towards its start, transmittance included. Not yet multiplied by the path's throughput.
    pub emitted: Spectrum,
}

/// What happens to light that crosses a segment without being scattered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Share that passes.
    pub transmittance: Spectrum,
    /// What the segment emits towards its start, transmittance included.
    pub emitted: Spectrum,
}

/// The closed set of media.
#[derive(Clone, Debug)]
pub enum Medium {
    /// The same everywhere.
    Homogeneous(Homogeneous),
    /// Given by volumes.
    Grid(Box<GridMedium>),
}

impl Medium {
    /// Whether it scatters anywhere.
    #[inline]
    pub fn scatters(&self) -> bool {
        match self {
            Self::Homogeneous(m) => m.scatters,
            Self::Grid(m) => m.scatters,
        }
    }

    /// Whether it emits anywhere.
    #[inline]
    pub fn emits(&self) -> bool {
        match self {
            Self::Homogeneous(m) => !m.emission.is_black(),
            Self::Grid(m) => m.emits(),
        }
    }

    /// In which directions it scatters.
    #[inline]
    pub fn phase(&self) -> &Phase {
        match self {
            Self::Homogeneous(m) => &m.phase,
            Self::Grid(m) => &m.phase,
        }
    }

    /// What it does at a point in world space.
    #[inline]
    pub fn coefficients(&self, p: Vec3) -> Coefficients {
        match self {
            Self::Homogeneous(m) => Coefficients { sigma_t: m.sigma_t, sigma_s: m.sigma_s, emission: m.emission },
            Self::Grid(m) => m.coefficients(p),
        }
    }

    /// An upper bound of σt in all lanes, everywhere.
    #[inline]
    pub fn majorant(&self) -> f32 {
        match self {
            Self::Homogeneous(m) => m.sigma_t.max_component(),
            Self::Grid(m) => m.majorant(),
        }
    }

    /// The share of light that passes along a ray to `t_max`; an unbiased estimate for grids.
    #[inline]
    pub fn transmittance(&self, ray: &Ray, t_max: f32, rng: &mut HashRng) -> Spectrum {
        match self {
            Self::Homogeneous(m) => m.transmittance(t_max),
            Self::Grid(m) => m.cross(ray, t_max, rng).transmittance,
        }
    }

    /// Transmittance and emission along a ray to `t_max`, for media that do not scatter or paths that must not.
    #[inline]
    pub fn cross(&self, ray: &Ray, t_max: f32, rng: &mut HashRng) -> Crossing {
        match self {
            Self::Homogeneous(m) => Crossing { transmittance: m.transmittance(t_max), emitted: m.emitted(t_max) },
            Self::Grid(m) => m.cross(ray, t_max, rng),
        }
    }

    /// Samples where light that comes to the ray's origin along it was scattered last, or that it was not before `t_max`.
    /// `throughput` is the path's: lanes that carry more are sampled better.
    #[inline]
    pub fn sample_flight(&self, ray: &Ray, t_max: f32, throughput: Spectrum, u: f32, rng: &mut HashRng) -> Flight {
        match self {
            Self::Homogeneous(m) => m.sample_flight(t_max, throughput, u),
            Self::Grid(m) => m.sample_flight(ray, t_max, throughput, u, rng),
        }
    }
}

/// Makes the media of a validated description, and sentences about what had to be changed.
pub fn compile(desc: &SceneDesc) -> (Vec<Medium>, Vec<String>) {
    let volumes: Vec<_> = desc.volumes.iter().map(|v| std::sync::Arc::new(Volume::new(&v.value))).collect();
    let mut warnings = Vec::new();
    let media = desc
        .media
        .iter()
        .map(|node| match &node.value {
            MediumDesc::Homogeneous { sigma_a, sigma_s, emission, phase } => {
                Medium::Homogeneous(Homogeneous::new(*sigma_a, *sigma_s, *emission, Phase::new(phase)))
            }
            MediumDesc::Grid(grid) => {
                let medium = GridMedium::new(grid, &volumes);
                if medium.is_limited {
                    warnings.push(format!("the medium `{}` is denser than can be resolved; its peaks are cut off", node.name));
                }
                Medium::Grid(Box::new(medium))
            }
        })
        .collect();
    (media, warnings)
}
