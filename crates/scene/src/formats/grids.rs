//! Sparse grids of numbers (OpenVDB and NanoVDB files) as dense volumes.

use glam::{DMat4, DVec3};

use super::{nanovdb, openvdb};
use crate::desc::VOLUME_LIMIT;

/// Entries of nodes that are looked at: a guard against files whose nodes refer to each other again and again.
const MOST_ENTRIES: u64 = 1 << 30;

/// A dense copy of a grid, with a border of one empty value.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DenseGrid {
    /// Values along x, y and z.
    pub size: [u32; 3],
    /// The values, x fastest.
    pub data: Vec<f32>,
    /// Places the unit cube over the values' cells.
    pub world_from_volume: DMat4,
}

/// Whether the bytes of a file begin as those of a sparse grid do.
pub(super) fn is_sparse(file: &[u8]) -> bool {
    openvdb::is_one(file) || file.starts_with(b"NanoVDB")
}

/// Reads the grid of a name from a file of either kind; `None` where it has none of it.
///
/// # Errors
/// A sentence.
pub(super) fn read(file: &[u8], name: &str) -> Result<Option<DenseGrid>, String> {
    if openvdb::is_one(file) { openvdb::read(file, name) } else { nanovdb::read(file, name) }
}

/// A dense copy while it is filled.
pub(super) struct Filler {
    min: [i64; 3],
    size: [i64; 3],
    data: Vec<f32>,
    entries: u64,
    /// Values that may still be set: nodes lie side by side, so each is set once at most.
    unset: usize,
}

impl Filler {
    /// A box of indices from `min` to `max`, both in it, full of `background`.
    ///
    /// # Errors
    /// A sentence where it holds nothing or too much.
    pub fn new(name: &str, min: [i64; 3], max: [i64; 3], background: f32) -> Result<Self, String> {
        let size = [0, 1, 2].map(|k| max[k].saturating_sub(min[k]).saturating_add(3));
        let is_empty = (0..3).any(|k| max[k] < min[k]);
        let count = size.iter().try_fold(1i128, |n, s| n.checked_mul(i128::from(*s))).filter(|n| *n <= i128::from(VOLUME_LIMIT));
        match count {
            Some(count) if !is_empty => {
                let unset = count as usize;
                Ok(Self { min: min.map(|v| v - 1), size, data: vec![background; unset], entries: 0, unset })
            }
            _ => {
                let [x, y, z] = size;
                Err(format!("the grid `{name}` has {x} × {y} × {z} values, which is none or more than 2^28"))
            }
        }
    }

    /// Sets the values of a cube of `edge` values.
    ///
    /// # Errors
    /// A sentence where cubes lie over each other, which could take any time.
    pub fn fill(&mut self, origin: [i64; 3], edge: i64, value: f32) -> Result<(), String> {
        let range = |k: usize| {
            let lo = (origin[k] - self.min[k]).clamp(0, self.size[k]);
            let hi = (origin[k] + edge - self.min[k]).clamp(0, self.size[k]);
            lo as usize..hi as usize
        };
        let (xs, ys, zs) = (range(0), range(1), range(2));
        let left = self.unset.checked_sub(xs.len() * ys.len() * zs.len());
        self.unset = left.ok_or("the nodes of a grid lie over each other")?;
        let (nx, ny) = (self.size[0] as usize, self.size[1] as usize);
        for z in zs {
            for y in ys.clone() {
                let row = (z * ny + y) * nx;
                self.data[row + xs.start..row + xs.end].fill(value);
            }
        }
        Ok(())
    }

    /// Whether any value of a cube is wanted.
    pub fn meets(&self, origin: [i64; 3], edge: i64) -> bool {
        (0..3).all(|k| origin[k] < self.min[k] + self.size[k] && origin[k] + edge > self.min[k])
    }

    /// Counts entries of nodes.
    ///
    /// # Errors
    /// A sentence where there are more than any file needs.
    pub fn count(&mut self, entries: u64) -> Result<(), String> {
        self.entries += entries;
        if self.entries > MOST_ENTRIES { Err("the nodes of a grid refer to each other again and again".to_owned()) } else { Ok(()) }
    }

    /// The volume, of which `world_from_index` places the values' middles.
    pub fn finish(self, world_from_index: DMat4) -> DenseGrid {
        let vector = |v: [i64; 3]| DVec3::new(v[0] as f64, v[1] as f64, v[2] as f64);
        let cells = DMat4::from_translation(vector(self.min) - 0.5) * DMat4::from_scale(vector(self.size));
        DenseGrid { size: self.size.map(|n| n as u32), data: self.data, world_from_volume: world_from_index * cells }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubes_over_each_other_are_refused() {
        let mut filler = Filler::new("density", [0; 3], [99; 3], 0.0).unwrap();
        filler.fill([0; 3], 64, 1.0).unwrap();
        filler.fill([64, 0, 0], 64, 2.0).unwrap();
        let error = (0..1000).find_map(|_| filler.fill([-2048; 3], 4096, 3.0).err()).unwrap();
        assert!(error.contains("over each other"), "{error}");
    }
}
