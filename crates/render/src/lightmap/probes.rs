//! Light probes: light in the air as spherical harmonics, for what moves through a baked scene.
//!
//! Radiance is projected to the real spherical harmonics of bands 0 to 2 (Ramamoorthi and Hanrahan 2001, "An Efficient Representation for
//! Irradiance Environment Maps", doi:10.1145/383259.383317) and convolved with the clamped cosine: the nine coefficients give the irradiance
//! of a surface by its normal, with an error of a few percent under light from everywhere and more under small lights.

use rayon::prelude::*;
use serde_json::{Value, json};

use super::BakeError;
use super::job::Bake;
use super::method::Method;
use super::spots::World;
use crate::integrator::Estimate;
use crate::integrator::irradiance::{Receiver, in_air};
use crate::math::{PI, Vec3};
use crate::sampler::{Sampler, SamplerKind};
use crate::scene::Scene;

/// Most probes.
const LIMIT: u64 = 1 << 20;

/// Points on a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// The first point.
    pub origin: Vec3,
    /// From point to point along each axis.
    pub step: Vec3,
    /// Points along each axis.
    pub counts: [u32; 3],
}

impl Grid {
    /// A grid over the scene: points in the middle of equal boxes.
    ///
    /// # Errors
    /// [`BakeError::Setting`] for no points, too many, or a scene without bounds.
    pub fn new(scene: &Scene, counts: [u32; 3]) -> Result<Self, BakeError> {
        let total: u64 = counts.iter().map(|c| u64::from(*c)).fold(1, u64::saturating_mul);
        if total == 0 || total > LIMIT {
            return Err(BakeError::Setting(format!("1 to {LIMIT} probes are possible, not {total}")));
        }
        let (min, extent) = (scene.bounds.min, scene.bounds.extent());
        if !(min.is_finite() && extent.is_finite()) {
            return Err(BakeError::Setting("a scene without bounds has no grid of probes".into()));
        }
        let step = extent / Vec3::from_array(counts.map(|c| c as f32));
        Ok(Self { origin: min + step * 0.5, step, counts })
    }

    /// All points, x fastest, then y.
    pub fn points(&self) -> Vec<Vec3> {
        let [nx, ny, nz] = self.counts;
        let at = |x: u32, y: u32, z: u32| self.origin + self.step * Vec3::new(x as f32, y as f32, z as f32);
        (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (x, y, z)))).map(|(x, y, z)| at(x, y, z)).collect()
    }
}

/// A probe.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Coefficients of irradiance, by [`basis`].
    pub irradiance: [[f32; 3]; 9],
    /// Lies inside of a closed body, where its light means nothing.
    pub is_inside: bool,
}

impl Probe {
    /// Irradiance of a surface by its unit normal, W·m⁻².
    pub fn irradiance(&self, n: Vec3) -> [f32; 3] {
        let b = basis(n);
        std::array::from_fn(|k| (0..9).map(|i| b[i] * self.irradiance[i][k]).sum())
    }
}

/// Probes on a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Where they are.
    pub grid: Grid,
    /// One for each point of the grid.
    pub probes: Vec<Probe>,
}

/// Real spherical harmonics of bands 0, 1 and 2 in the order (0,0), (1,−1), (1,0), (1,1), (2,−2), (2,−1), (2,0), (2,1), (2,2), as in three.js.
pub fn basis(d: Vec3) -> [f32; 9] {
    let Vec3 { x, y, z } = d;
    [
        0.282_094_8,
        0.488_602_5 * y,
        0.488_602_5 * z,
        0.488_602_5 * x,
        1.092_548_4 * x * y,
        1.092_548_4 * y * z,
        0.315_391_57 * (3.0 * z * z - 1.0),
        1.092_548_4 * x * z,
        0.546_274_2 * (x * x - y * y),
    ]
}

/// Factors of the convolution with the clamped cosine, by band.
const COSINE: [f32; 9] = {
    const A: [f32; 3] = [PI, 2.0 * PI / 3.0, PI / 4.0];
    [A[0], A[1], A[1], A[1], A[2], A[2], A[2], A[2], A[2]]
};

/// Measures all probes of a grid by paths, with `spp` samples each. Solutions that are looked up on surfaces have no light in the air: their
/// scenes are measured by paths as well.
pub fn measure(bake: &Bake, method: &Method, grid: &Grid, spp: u32, seed: u64) -> Field {
    let sampler = Sampler { kind: SamplerKind::Sobol, seed, spp };
    let own;
    let indirect = match method {
        Method::Path { indirect } => indirect.as_deref(),
        Method::Solved(_) => {
            own = bake.path();
            match &own {
                Method::Path { indirect } => indirect.as_deref(),
                Method::Solved(_) => None,
            }
        }
    };
    let world = World { scene: &bake.scene, flat: &bake.flat };
    let points = grid.points();
    let probes = points
        .par_iter()
        .enumerate()
        .map_init(Estimate::default, |estimate, (i, p)| {
            let surface = in_air(*p);
            let receiver = Receiver { scene: &bake.scene, indirect, surface: &surface };
            let mut sums = [[0.0f64; 3]; 9];
            for index in 0..spp {
                let mut stream = sampler.stream(i as u32, u32::MAX - 1, index);
                receiver.gather(&mut stream, estimate, |d, radiance| {
                    let b = basis(d);
                    for (sum, b) in sums.iter_mut().zip(b) {
                        let rgb = radiance.rgb();
                        (0..3).for_each(|k| sum[k] += f64::from(b * rgb[k]));
                    }
                });
            }
            let irradiance = std::array::from_fn(|i| sums[i].map(|s| (s / f64::from(spp.max(1))) as f32 * COSINE[i]));
            Probe { irradiance, is_inside: world.is_inside(*p, Vec3::Y) }
        })
        .collect();
    Field { grid: grid.clone(), probes }
}

impl Field {
    /// How many probes lie inside of bodies.
    pub fn inside(&self) -> usize {
        self.probes.iter().filter(|p| p.is_inside).count()
    }

    /// The form in which probes are written: docs/guide/baking.md.
    pub fn to_json(&self) -> Value {
        json!({
            "basis": "real spherical harmonics, bands 0 to 2, order 00 1-1 10 11 2-2 2-1 20 21 22",
            "quantity": "irradiance in W/m2 by normal: sum of coefficient times basis; R, G, B linear Rec. 709",
            "origin": self.grid.origin.to_array(),
            "step": self.grid.step.to_array(),
            "counts": self.grid.counts,
            "order": "x fastest, then y, then z",
            "coefficients": self.probes.iter().map(|p| p.irradiance.concat()).collect::<Vec<_>>(),
            "inside": self.probes.iter().enumerate().filter(|(_, p)| p.is_inside).map(|(i, _)| i).collect::<Vec<_>>(),
        })
    }
}
