//! The clouds of pbrt's medium `cloud`: gradient noise in five octaves, looked up at places that two more have moved, thinner towards the
//! top (Pharr, Jakob, Humphreys 2023, "Physically Based Rendering", 4th edition, section 11.4).
//!
//! pbrt evaluates the noise at each look-up; here it is sampled once, on a grid that is fine enough for all octaves where that fits, and
//! linear between.

use glam::Vec3;
use rayon::prelude::*;

/// Values of a grid along an axis at most.
const MOST_ALONG: f64 = 1024.0;
/// Values for each cell of the finest octave.
const PER_CELL: f64 = 3.0;
/// From one octave to the next.
const LACUNARITY: f32 = 1.99;
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

/// How steep the noise is, by differences over a hundredth of a cell.
fn slope(p: Vec3) -> Vec3 {
    const STEP: f32 = 0.01;
    let here = noise(p);
    Vec3::from_array([Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (noise(p + STEP * axis) - here) / STEP))
}

/// Gradient noise (Perlin 2002, "Improving Noise", doi:10.1145/566654.566636), with the gradients of pbrt: between −1 and 1, and 0 on the
/// corners of cells.
fn noise(p: Vec3) -> f32 {
    // Cells repeat after 256 of them: beyond that numbers lose their fraction.
    let p = p - 256.0 * (p / 256.0).floor();
    let cell = p.floor();
    let d = p - cell;
    let [x, y, z] = cell.to_array().map(|v| v as usize);
    let entry = |i: usize| usize::from(PERMUTATION[i & 255]);
    let corner = |i: usize| {
        let (dx, dy, dz) = (i & 1, i >> 1 & 1, i >> 2);
        let hash = entry(entry(entry(x + dx) + y + dy) + z + dz) & 15;
        let from = d - Vec3::new(dx as f32, dy as f32, dz as f32);
        let (u, v) = match hash {
            0..=3 | 12 | 13 => (from.x, from.y),
            4..=7 => (from.x, from.z),
            _ => (from.y, from.z),
        };
        (if hash & 1 == 0 { u } else { -u }) + (if hash & 2 == 0 { v } else { -v })
    };
    let s = d * d * d * (d * (d * 6.0 - 15.0) + 10.0);
    let mix = |t: f32, a: f32, b: f32| a + (b - a) * t;
    let edge = |i: usize| mix(s.x, corner(i), corner(i + 1));
    let face = |i: usize| mix(s.y, edge(i), edge(i + 2));
    mix(s.z, face(0), face(4))
}

/// Perlin's permutation of the numbers below 256.
#[rustfmt::skip]
const PERMUTATION: [u8; 256] = [
    151, 160, 137, 91, 90, 15, 131, 13, 201, 95, 96, 53, 194, 233, 7, 225, 140, 36, 103, 30, 69, 142, 8, 99,
    37, 240, 21, 10, 23, 190, 6, 148, 247, 120, 234, 75, 0, 26, 197, 62, 94, 252, 219, 203, 117, 35, 11, 32,
    57, 177, 33, 88, 237, 149, 56, 87, 174, 20, 125, 136, 171, 168, 68, 175, 74, 165, 71, 134, 139, 48, 27, 166,
    77, 146, 158, 231, 83, 111, 229, 122, 60, 211, 133, 230, 220, 105, 92, 41, 55, 46, 245, 40, 244, 102, 143, 54,
    65, 25, 63, 161, 1, 216, 80, 73, 209, 76, 132, 187, 208, 89, 18, 169, 200, 196, 135, 130, 116, 188, 159, 86,
    164, 100, 109, 198, 173, 186, 3, 64, 52, 217, 226, 250, 124, 123, 5, 202, 38, 147, 118, 126, 255, 82, 85, 212,
    207, 206, 59, 227, 47, 16, 58, 17, 182, 189, 28, 42, 223, 183, 170, 213, 119, 248, 152, 2, 44, 154, 163, 70,
    221, 153, 101, 155, 167, 43, 172, 9, 129, 22, 39, 253, 19, 98, 108, 110, 79, 113, 224, 232, 178, 185, 112, 104,
    218, 246, 97, 228, 251, 34, 242, 193, 238, 210, 144, 12, 191, 179, 162, 241, 81, 51, 145, 235, 249, 14, 239, 107,
    49, 192, 214, 31, 181, 199, 106, 157, 184, 84, 204, 176, 115, 121, 50, 45, 127, 4, 150, 254, 138, 236, 205, 93,
    222, 114, 67, 29, 24, 72, 243, 141, 128, 195, 78, 66, 215, 61, 156, 180,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_a_permutation() {
        let mut seen = [false; 256];
        PERMUTATION.iter().for_each(|&v| seen[usize::from(v)] = true);
        assert!(seen.iter().all(|s| *s));
    }

    /// Nothing on the corners of cells, slopes there that are gradients of length √2, no jump at borders and where the pattern repeats.
    #[test]
    fn noise_is_smooth() {
        for i in 0..300 {
            let corner = Vec3::new((i % 17) as f32, (i % 5) as f32 - 2.0, (i / 3) as f32);
            assert_eq!(noise(corner), 0.0);
            assert!((slope(corner).length() - 2f32.sqrt()).abs() < 0.05, "{}", slope(corner));
            let border = corner + Vec3::new(0.0, 0.3, 0.6);
            assert!((noise(border - Vec3::X * 1e-4) - noise(border + Vec3::X * 1e-4)).abs() < 1e-3);
            assert!((noise(border) - noise(border + Vec3::Z * 256.0)).abs() < 1e-3);
        }
    }

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
