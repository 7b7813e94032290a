//! `density_file`: values on a lattice in the unit cube, from a df3 file (documentation, "Density File Pattern").

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

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

    fn at(&self, x: i64, y: i64, z: i64) -> f64 {
        let wrap = |v: i64, n: u32| v.rem_euclid(i64::from(n.max(1))) as usize;
        let [nx, ny, nz] = self.size;
        let index = (wrap(z, nz) * ny as usize + wrap(y, ny)) * nx as usize + wrap(x, nx);
        self.values.get(index).map_or(0.0, |v| f64::from(*v))
    }

    /// The value at a point; 0 outside of the unit cube.
    pub fn value(&self, p: DVec3) -> f64 {
        if !(p.cmpge(DVec3::ZERO).all() && p.cmplt(DVec3::ONE).all()) {
            return 0.0;
        }
        let q = p * DVec3::from_array(self.size.map(f64::from));
        match self.interpolation {
            DensityInterpolation::None => self.at(q.x as i64, q.y as i64, q.z as i64),
            DensityInterpolation::Trilinear | DensityInterpolation::Tricubic => self.at(q.x as i64, q.y as i64, q.z as i64),
        }
    }
}
