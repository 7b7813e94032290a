//! Media given by volumes: delta tracking and ratio tracking under local majorants.
//!
//! The box of the extinction's volume is where the medium is. The work of a ray is proportional to the optical thickness of the local
//! majorants along it. Extinction that would make a ray meet more than [`MOST_STEPS`] tentative collisions is cut off.

use std::sync::Arc;

use etendue_scene::desc::{EmissionSource, FieldDesc, GridMediumDesc, ScatteringDesc};

use super::majorant::MajorantGrid;
use super::{Coefficients, Crossing, Flight, Phase, Volume};
use crate::accel::Ray;
use crate::math::{Vec3, fns};
use crate::sampler::HashRng;
use crate::spectrum::Spectrum;

/// The most tentative collisions that a ray across the whole box meets in the mean.
pub const MOST_STEPS: f32 = 1e5;
/// Transmittance below which ratio tracking plays Russian roulette.
const ROULETTE: f32 = 0.1;

/// A color times a volume.
#[derive(Clone, Debug)]
struct Field {
    factor: Spectrum,
    volume: Option<Arc<Volume>>,
}

impl Field {
    fn new(desc: &FieldDesc, volumes: &[Arc<Volume>]) -> Self {
        let volume = desc.volume.and_then(|id| volumes.get(id.0 as usize)).cloned();
        Self { factor: Spectrum::from_rgb(desc.factor), volume }
    }

    #[inline]
    fn at(&self, p: Vec3) -> Spectrum {
        match &self.volume {
            None => self.factor,
            Some(v) => self.factor * v.lookup(v.volume_from_world.transform_point3(p)),
        }
    }
}

#[derive(Clone, Debug)]
enum Source {
    Field(Field),
    BlackBody { kelvin: Field, offset: f32, scale: f32, table: super::blackbody::Table },
}

/// A medium that varies in space.
#[derive(Clone, Debug)]
pub struct GridMedium {
    extinction: Field,
    scattering: Field,
    scattering_is_albedo: bool,
    emission: Option<Source>,
    emission_by_absorption: bool,
    /// Phase function.
    pub phase: Phase,
    /// Whether it scatters anywhere.
    pub scatters: bool,
    /// Whether its extinction has been cut off.
    pub is_limited: bool,
    limit: f32,
    majorants: MajorantGrid,
}

impl GridMedium {
    /// From a validated description and the volumes of the scene.
    pub fn new(desc: &GridMediumDesc, volumes: &[Arc<Volume>]) -> Self {
        let extinction = Field::new(&desc.extinction, volumes);
        let (scattering, scattering_is_albedo) = match &desc.scattering {
            ScatteringDesc::Albedo(f) => (Field::new(f, volumes), true),
            ScatteringDesc::Coefficient(f) => (Field::new(f, volumes), false),
        };
        // Tentative collisions along the box's diagonal: majorant times length.
        let diagonal = extinction.volume.as_ref().map_or(1.0, |v| v.world_from_volume.transform_vector3(Vec3::ONE).length());
        let limit = MOST_STEPS / diagonal.max(f32::MIN_POSITIVE);
        let mut is_limited = false;
        let majorants = match &extinction.volume {
            Some(v) => {
                let grid = MajorantGrid::new(v.size(), |cell| (extinction.factor * v.value(cell)).max_component().min(limit));
                is_limited = grid.max >= limit;
                grid
            }
            None => MajorantGrid::constant(extinction.factor.max_component().min(limit)),
        };
        Self {
            phase: Phase::new(&desc.phase),
            scatters: !scattering.factor.is_black() && !extinction.factor.is_black(),
            scattering,
            scattering_is_albedo,
            emission_by_absorption: desc.emission.as_ref().is_some_and(|e| e.by_absorption),
            emission: desc.emission.as_ref().map(|e| match &e.source {
                EmissionSource::Field(f) => Source::Field(Field::new(f, volumes)),
                EmissionSource::BlackBody { kelvin, offset, scale } => {
                    let table = super::blackbody::Table::new();
                    Source::BlackBody { kelvin: Field::new(kelvin, volumes), offset: *offset, scale: *scale, table }
                }
            }),
            extinction,
            is_limited,
            limit,
            majorants,
        }
    }

    /// Whether it emits anywhere.
    pub fn emits(&self) -> bool {
        self.emission.is_some()
    }

    /// The box in which it is (the world from the unit cube) and the values along its axes; `None` for media without a border.
    pub fn bounds(&self) -> Option<(crate::math::Mat4, [i32; 3])> {
        self.extinction.volume.as_ref().map(|v| (v.world_from_volume, v.size()))
    }

    /// An upper bound of the extinction.
    pub fn majorant(&self) -> f32 {
        self.majorants.max
    }

    /// What it does at a point of the world.
    pub fn coefficients(&self, p: Vec3) -> Coefficients {
        let Some(v) = &self.extinction.volume else { return self.inside(p) };
        let local = v.volume_from_world.transform_point3(p);
        if local.cmpge(Vec3::ZERO).all() && local.cmple(Vec3::ONE).all() { self.inside(p) } else { Coefficients::default() }
    }

    /// The same for a point that is known to be in the box.
    #[inline]
    fn inside(&self, p: Vec3) -> Coefficients {
        let sigma_t = self.extinction.at(p).map(|s| s.min(self.limit));
        let scattering = self.scattering.at(p);
        // No medium gives back more than it takes.
        let sigma_s = if self.scattering_is_albedo {
            sigma_t.zip(scattering, |t, a| t * a.min(1.0))
        } else {
            sigma_t.zip(scattering, |t, s| s.min(t))
        };
        let emission = match &self.emission {
            None => return Coefficients { sigma_t, sigma_s, emission: Spectrum::ZERO },
            Some(Source::Field(f)) => f.at(p),
            Some(Source::BlackBody { kelvin, offset, scale, table }) => table.color(kelvin.at(p).0[0] + offset) * *scale,
        };
        let emission = if self.emission_by_absorption { emission * (sigma_t - sigma_s) } else { emission };
        Coefficients { sigma_t, sigma_s, emission }
    }

    /// The ray in the space of the majorants.
    fn local(&self, ray: &Ray) -> (Vec3, Vec3) {
        match &self.extinction.volume {
            Some(v) => (v.volume_from_world.transform_point3(ray.o), v.volume_from_world.transform_vector3(ray.d)),
            None => (Vec3::splat(0.5), Vec3::ZERO),
        }
    }

    /// Calls `collide(t, majorant)` at tentative collisions in order until it returns false: a Poisson process whose rate is the majorant.
    fn track(&self, ray: &Ray, t_max: f32, u: f32, rng: &mut HashRng, mut collide: impl FnMut(f32, f32, &mut HashRng) -> bool) {
        // What is left of the optical distance to the next collision goes over from cell to cell.
        let mut left = -fns::ln_1p(-u);
        let mut cell = |start: f32, end: f32, majorant: f32| {
            let mut t = start;
            loop {
                let step = left / majorant;
                if !(t + step < end) {
                    left -= (end - t) * majorant;
                    left = left.max(0.0);
                    return true;
                }
                t += step;
                if !collide(t, majorant, rng) {
                    return false;
                }
                left = -fns::ln_1p(-rng.next_1d());
            }
        };
        if self.extinction.volume.is_none() {
            // Without a box the medium has no border.
            if self.majorants.max > 0.0 {
                cell(0.0, t_max, self.majorants.max);
            }
            return;
        }
        let (o, d) = self.local(ray);
        self.majorants.walk(o, d, t_max, cell);
    }

    /// See [`super::Medium::cross`].
    pub fn cross(&self, ray: &Ray, t_max: f32, rng: &mut HashRng) -> Crossing {
        let mut transmittance = Spectrum::from_rgb([1.0; 3]);
        let mut emitted = Spectrum::ZERO;
        let u = rng.next_1d();
        self.track(ray, t_max, u, rng, |t, majorant, rng| {
            let c = self.inside(ray.at(t));
            if self.emission.is_some() {
                emitted += transmittance * c.emission / majorant;
            }
            transmittance = transmittance.zip(c.sigma_t, |w, s| w * (1.0 - s / majorant).max(0.0));
            let most = transmittance.max_component();
            if most < ROULETTE {
                if rng.next_1d() * ROULETTE >= most {
                    transmittance = Spectrum::ZERO;
                    return false;
                }
                transmittance *= ROULETTE / most;
            }
            true
        });
        Crossing { transmittance, emitted }
    }

    /// See [`super::Medium::sample_flight`].
    pub fn sample_flight(&self, ray: &Ray, t_max: f32, throughput: Spectrum, u: f32, rng: &mut HashRng) -> Flight {
        let mut weight = Spectrum::from_rgb([1.0; 3]);
        let mut emitted = Spectrum::ZERO;
        let mut scattered_at = None;
        self.track(ray, t_max, u, rng, |t, majorant, rng| {
            let c = self.inside(ray.at(t));
            if self.emission.is_some() {
                emitted += weight * c.emission / majorant;
            }
            let null = c.sigma_t.map(|s| (majorant - s).max(0.0));
            // Lanes agree on what happens by what they carry, so that no lane's weight grows without bound.
            let carried = throughput * weight;
            let (real, not) = ((carried * c.sigma_t).average(), (carried * null).average());
            let sum = real + not;
            if !(sum > 0.0) {
                weight = Spectrum::ZERO;
                return false;
            }
            if rng.next_1d() * sum < real {
                weight = weight * c.sigma_s * (sum / (real * majorant));
                scattered_at = Some(t);
                return false;
            }
            weight = weight * null * (sum / (not * majorant));
            true
        });
        Flight { scattered_at, weight, emitted }
    }
}
