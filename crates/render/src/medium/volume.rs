//! Numbers on a regular grid in space.

use etendue_scene::desc::{VolumeDesc, VolumeFilter, VolumeWrap};

use crate::math::{Mat4, Vec3};
use crate::spectrum::Spectrum;

/// A volume ready for look-ups; see [`VolumeDesc`] for where its values are.
#[derive(Clone, Debug)]
pub struct Volume {
    size: [i32; 3],
    channels: usize,
    data: Vec<f32>,
    /// The unit cube from world space.
    pub volume_from_world: Mat4,
    /// The inverse.
    pub world_from_volume: Mat4,
    filter: VolumeFilter,
    wrap: VolumeWrap,
}

impl Volume {
    /// From a validated description.
    pub fn new(desc: &VolumeDesc) -> Self {
        Self {
            size: desc.size.map(|n| n as i32),
            channels: desc.channels as usize,
            data: desc.data.clone(),
            volume_from_world: desc.world_from_volume.inverse(),
            world_from_volume: desc.world_from_volume,
            filter: desc.filter,
            wrap: desc.wrap,
        }
    }

    /// Values along each axis.
    pub fn size(&self) -> [i32; 3] {
        self.size
    }

    /// The value at a point of the unit cube's space.
    #[inline]
    pub fn lookup(&self, p: Vec3) -> Spectrum {
        // Beyond the box and not a number: nothing sensible is there, and indices must stay small.
        let p = p.clamp(Vec3::splat(-1e6), Vec3::splat(1e6));
        let at = |k: usize| {
            let x = p[k] * self.size[k] as f32;
            if x.is_nan() { 0.0 } else { x }
        };
        match self.filter {
            VolumeFilter::Nearest => self.value([0, 1, 2].map(|k| at(k).floor() as i32)),
            VolumeFilter::Linear => {
                let x = [0, 1, 2].map(|k| at(k) - 0.5);
                let i = x.map(|x| x.floor());
                let f = [0, 1, 2].map(|k| x[k] - i[k]);
                let i = i.map(|x| x as i32);
                let mut sum = Spectrum::ZERO;
                for corner in 0..8 {
                    let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
                    let w = [0, 1, 2].map(|k| if bit[k] == 1 { f[k] } else { 1.0 - f[k] });
                    let w = w[0] * w[1] * w[2];
                    if w > 0.0 {
                        sum += self.value([0, 1, 2].map(|k| i[k].saturating_add(bit[k]))) * w;
                    }
                }
                sum
            }
        }
    }

    /// The value of a cell, which may lie beyond the box.
    #[inline]
    pub fn value(&self, cell: [i32; 3]) -> Spectrum {
        let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(|k| self.wrapped(cell[k], self.size[k])) else { return Spectrum::ZERO };
        let at = ((z * self.size[1] as usize + y) * self.size[0] as usize + x) * self.channels;
        if self.channels == 1 {
            let v = self.data[at];
            Spectrum::from_rgb([v; 3])
        } else {
            Spectrum::from_rgb([self.data[at], self.data[at + 1], self.data[at + 2]])
        }
    }

    #[inline]
    fn wrapped(&self, i: i32, n: i32) -> Option<usize> {
        if (0..n).contains(&i) {
            return Some(i as usize);
        }
        match self.wrap {
            VolumeWrap::Clamp => Some(i.clamp(0, n - 1) as usize),
            VolumeWrap::Repeat => Some(i.rem_euclid(n) as usize),
            VolumeWrap::Mirror => {
                let r = i64::from(i).rem_euclid(2 * i64::from(n));
                Some(if r < i64::from(n) { r } else { 2 * i64::from(n) - 1 - r } as usize)
            }
            VolumeWrap::Zero => None,
        }
    }
}
