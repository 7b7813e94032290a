//! Gradient noise in single precision, as pbrt's textures and clouds have it.
//!
//! Points that are not finite give some finite value or NaN, never a panic.

use glam::Vec3;

/// Ratio of the frequencies of successive octaves in sums of this noise: not quite 2, so that corners of cells do not fall together.
pub const LACUNARITY: f32 = 1.99;

/// How steep the noise is, by differences over a hundredth of a cell.
pub fn slope(p: Vec3) -> Vec3 {
    const STEP: f32 = 0.01;
    let here = noise(p);
    Vec3::from_array([Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (noise(p + STEP * axis) - here) / STEP))
}

/// Gradient noise (Perlin 2002, "Improving Noise", doi:10.1145/566654.566636), with the gradients of pbrt: between −1 and 1, and 0 on the
/// corners of cells.
pub fn noise(p: Vec3) -> f32 {
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

    /// Values of Perlin's own program (2002), at places where no corner has one of the two gradients that pbrt has changed.
    #[test]
    #[allow(clippy::approx_constant, reason = "a place, not π")]
    fn noise_is_perlins() {
        for (p, value) in [
            ([3.14, 42.0, 7.0], 0.136_919_96),
            ([-6.58, 6.25, 4.75], -0.271_133_07),
            ([4.72, -8.96, -0.98], -0.368_890_5),
            ([3.99, -4.88, 8.01], -0.012_456_462),
            ([6.08, 1.02, 2.56], 0.018_669_02),
        ] {
            let found = noise(Vec3::from(p));
            assert!((found - value).abs() < 5e-6, "{p:?}: {found} {value}");
        }
    }
}
