//! The clouds of pbrt's medium `cloud`: gradient noise in five octaves, looked up at places that two more have moved, thinner towards the
//! top (Pharr, Jakob, Humphreys 2023, "Physically Based Rendering", 4th edition, section 11.4).
//!
//! pbrt evaluates the noise at each look-up; here it is sampled once, on a grid that is fine enough for all octaves where that fits, and
//! linear between.

use etendue_procedural::gradient_noise::{LACUNARITY, noise, slope};
use glam::Vec3;
use rayon::prelude::*;

/// Values of a grid along an axis at most.
const MOST_ALONG: f64 = 1024.0;
/// Values for each cell of the finest octave.
const PER_CELL: f64 = 3.0;
const OCTAVES: i32 = 5;

/// A cloud over the plane y = 0; all is thickest below y = ½, nothing is left above y = 1 but what is denser than that.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cloud {
    /// Factor of the noise.
    pub density: f32,
    /// How far places are moved.
    pub wispiness: f32,
    /// Cells of the first octave for each unit of length.
    pub frequency: f32,
}

impl Cloud {
    /// The density at a point, from 0 to 1.
    fn at(&self, p: Vec3) -> f32 {
        let mut q = p * self.frequency;
        if self.wispiness > 0.0 {
            let (mut weight, mut scale) = (0.05 * self.wispiness, 10.0);
            for _ in 0..2 {
                q += weight * slope(scale * q);
                weight *= 0.5;
                scale *= LACUNARITY;
            }
        }
        let (mut sum, mut weight, mut scale) = (0.0, 0.5, 1.0);
        for _ in 0..OCTAVES {
            sum += weight * noise(scale * q);
            weight *= 0.5;
            scale *= LACUNARITY;
        }
        let thinner_upwards = ((1.0 - p.y) * 4.5 * self.density * sum).clamp(0.0, 1.0);
        (thinner_upwards + 2.0 * (0.5 - p.y).max(0.0)).clamp(0.0, 1.0)
    }

    /// Values in the middles of the cells of a grid over the box from `lo` to `hi`, x fastest, and how many there are along each axis;
    /// about `most` at most.
    pub fn grid(&self, lo: Vec3, hi: Vec3, most: u32) -> ([u32; 3], Vec<f32>) {
        let finest = f64::from(self.frequency.abs()) * f64::from(LACUNARITY).powi(OCTAVES - 1);
        let wanted = (hi - lo).as_dvec3().to_array().map(|edge| (edge * finest * PER_CELL).clamp(4.0, MOST_ALONG));
        let too_many = (wanted.iter().product::<f64>() / f64::from(most)).max(1.0).cbrt();
        let size = wanted.map(|n| ((n / too_many) as u32).max(2));
        let [nx, ny, nz] = size;
        let cell = (hi - lo) / Vec3::new(nx as f32, ny as f32, nz as f32);
        let rows = (0..ny * nz).into_par_iter().flat_map_iter(|row| {
            let (y, z) = ((row % ny) as f32 + 0.5, (row / ny) as f32 + 0.5);
            (0..nx).map(move |x| self.at(lo + cell * Vec3::new(x as f32 + 0.5, y, z)))
        });
        (size, rows.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Full at the bottom, nothing but what the noise leaves at the top, and the same far below.
    #[test]
    fn clouds_are_thinner_upwards() {
        let cloud = Cloud { density: 1.0, wispiness: 1.0, frequency: 5.0 };
        let (size, values) = cloud.grid(Vec3::ZERO, Vec3::ONE, 1 << 18);
        assert_eq!(values.len(), size.iter().map(|n| *n as usize).product::<usize>());
        let mean = |y: u32| {
            let of = (0..size[2]).flat_map(|z| (0..size[0]).map(move |x| (x, z)));
            let index = |(x, z): (u32, u32)| ((z * size[1] + y) * size[0] + x) as usize;
            of.map(|at| f64::from(values[index(at)])).sum::<f64>() / f64::from(size[0] * size[2])
        };
        let [bottom, middle, top] = [0, size[1] / 2 + 1, size[1] - 1].map(mean);
        assert!(bottom > 0.98 && (0.1..0.6).contains(&middle) && top < 0.02, "{bottom}, {middle}, {top}");
        assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
        for hostile in [f32::MAX, 1e-30, 0.0] {
            let (size, values) =
                Cloud { density: hostile, wispiness: hostile, frequency: hostile }.grid(Vec3::ZERO, Vec3::new(1.0, 1e-3, 1e3), 4096);
            assert!(values.len() <= 8192 && size.iter().all(|n| *n >= 2));
        }
    }
}
