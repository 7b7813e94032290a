//! `density_file`: values on a lattice in the unit cube, from a df3 file (documentation, "Density File Pattern").

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::image_map::catmull_rom;

/// Values on a lattice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DensityFile {
    /// Number of values along x, y, z; each at least 1.
    pub size: [u32; 3],
    /// Values in [0, 1], x fastest; as many as the product of the sizes.
    pub values: Arc<Vec<f32>>,
    /// How values between those of the lattice come about.
    pub interpolation: DensityInterpolation,
}

/// `interpolate` of density files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum DensityInterpolation {
    /// 0: the value of the cell.
    #[default]
    None,
    /// 1: trilinear.
    Trilinear,
    /// 2: tricubic.
    Tricubic,
}

impl DensityFile {
    /// Reads a df3 file: three 16-bit sizes, then values of 1, 2 or 4 bytes, all most significant byte first; how many bytes a value has
    /// follows from the file's length.
    ///
    /// # Errors
    /// A sentence about what is wrong: no header, a size of 0, or fewer bytes than values.
    pub fn read_df3(bytes: &[u8]) -> Result<Self, &'static str> {
        let [x0, x1, y0, y1, z0, z1, data @ ..] = bytes else { return Err("a df3 file begins with three 16-bit sizes") };
        let size = [[x0, x1], [y0, y1], [z0, z1]].map(|[high, low]| u32::from(u16::from_be_bytes([*high, *low])));
        let count = size.iter().try_fold(1_usize, |n, s| n.checked_mul(*s as usize)).unwrap_or(usize::MAX);
        if count == 0 {
            return Err("a df3 file must have a size of at least 1 along each axis");
        }
        if data.len() < count {
            return Err("the df3 file has fewer values than its sizes ask for");
        }
        let width = match data.len() / count {
            0..2 => 1,
            2..4 => 2,
            _ => 4,
        };
        let values = data
            .chunks_exact(width)
            .take(count)
            .map(|v| match *v {
                [a] => f32::from(a) / 255.0,
                [a, b] => f32::from(u16::from_be_bytes([a, b])) / 65535.0,
                [a, b, c, d] => (f64::from(u32::from_be_bytes([a, b, c, d])) / f64::from(u32::MAX)) as f32,
                _ => 0.0,
            })
            .collect();
        Ok(Self { size, values: Arc::new(values), interpolation: DensityInterpolation::None })
    }

    /// The value at a cell; cells beyond the upper ends are those of the lower ends, and below the lower end of y of its upper end, while
    /// x and z stop there (measured).
    fn at(&self, x: i64, y: i64, z: i64) -> f64 {
        let wrap = |v: i64, n: u32| v.rem_euclid(i64::from(n.max(1))) as usize;
        let [nx, ny, nz] = self.size;
        let index = (wrap(z.max(0), nz) * ny as usize + wrap(y, ny)) * nx as usize + wrap(x.max(0), nx);
        self.values.get(index).map_or(0.0, |v| f64::from(*v))
    }

    /// The value at a point; 0 outside of the unit cube. Values stand at the lower corners of cells.
    pub fn value(&self, p: DVec3) -> f64 {
        if !(p.cmpge(DVec3::ZERO).all() && p.cmplt(DVec3::ONE).all()) {
            return 0.0;
        }
        let q = p * DVec3::from_array(self.size.map(f64::from));
        let f = q - q.floor();
        match self.interpolation {
            DensityInterpolation::None => self.at(q.x as i64, q.y as i64, q.z as i64),
            DensityInterpolation::Trilinear => {
                let pair = |t: f64| [1.0 - t, t];
                self.blend(q, 0, pair(f.x), pair(f.y), pair(f.z))
            }
            DensityInterpolation::Tricubic => self.blend(q, -1, catmull_rom(f.x), catmull_rom(f.y), catmull_rom(f.z)),
        }
    }

    /// Weighted sum of cells, the first `first` cells from the point's own along each axis.
    fn blend<const N: usize>(&self, q: DVec3, first: i64, wx: [f64; N], wy: [f64; N], wz: [f64; N]) -> f64 {
        let corner = [q.x, q.y, q.z].map(|v| v as i64 + first);
        let mut sum = 0.0;
        for (k, wz) in (0..).zip(wz) {
            for (j, wy) in (0..).zip(wy) {
                for (i, wx) in (0..).zip(wx) {
                    sum += wx * wy * wz * self.at(corner[0] + i, corner[1] + j, corner[2] + k);
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of POV-Ray for the file of 3 × 4 × 5 bytes (37 i + 11) mod 256.
    #[test]
    fn interpolation_is_as_measured() {
        let bytes: Vec<u8> = [0, 3, 0, 4, 0, 5].into_iter().chain((0..60_u32).map(|i| ((i * 37 + 11) % 256) as u8)).collect();
        let file = DensityFile::read_df3(&bytes).unwrap();
        let points = [[0.236_048_09, 0.103_166_03, 0.396_058_24], [0.917_955_04, 0.800_452_35, 0.765_162_60]];
        for (interpolation, expected) in
            [(DensityInterpolation::Trilinear, [0.505_607, 0.465_421]), (DensityInterpolation::Tricubic, [0.453_643, 0.432_242])]
        {
            let file = DensityFile { interpolation, ..file.clone() };
            for (p, e) in points.into_iter().zip(expected) {
                let got = file.value(DVec3::from_array(p));
                assert!((got - e).abs() < 1e-5, "{interpolation:?}: {got}, measured {e}");
            }
        }
    }

    #[test]
    fn hostile_files() {
        for bytes in [&[][..], &[0, 1, 0, 1], &[0, 0, 0, 1, 0, 1, 5], &[255; 6], &[255; 100]] {
            assert!(DensityFile::read_df3(bytes).is_err());
        }
        let one = DensityFile::read_df3(&[0, 1, 0, 1, 0, 1, 255]).unwrap();
        assert_eq!(one.value(DVec3::splat(0.5)), 1.0);
        assert_eq!(one.value(DVec3::NAN), 0.0);
    }
}
