//! Mitsuba's `.vol` files: grids of 32-bit floats.
//!
//! Little endian: the letters `VOL`, a byte of version 3, then the whole numbers encoding (1: float32), values along x, y and z and
//! numbers per value, then a box (six floats), then the values with x fastest and z slowest.

use glam::{Mat4, Vec3};

use crate::desc::VOLUME_LIMIT;

/// What a `.vol` file holds.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct VolFile {
    /// Values along x, y and z.
    pub size: [u32; 3],
    /// Numbers per value.
    pub channels: u32,
    /// The values.
    pub data: Vec<f32>,
    /// The box that the file says it fills.
    pub bounds: [Vec3; 2],
}

const HEADER: usize = 48;

impl VolFile {
    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// A sentence.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let head = bytes.get(..HEADER).ok_or("the file is too short for a volume")?;
        if &head[..3] != b"VOL" {
            return Err("no Mitsuba volume: it does not begin with VOL".to_owned());
        }
        if head[3] != 3 {
            return Err(format!("version {} of Mitsuba volumes; only 3 is known", head[3]));
        }
        let word = |i: usize| <[u8; 4]>::try_from(&head[4 + 4 * i..8 + 4 * i]).unwrap_or_default();
        let int = |i: usize| i32::from_le_bytes(word(i));
        if int(0) != 1 {
            return Err(format!("values of encoding {}; only 1 (float32) can be read", int(0)));
        }
        let size = [int(1), int(2), int(3)];
        let channels = int(4);
        if size.iter().any(|n| *n < 1) || !(1..=6).contains(&channels) {
            return Err(format!("a volume of {} × {} × {} values of {channels} numbers", size[0], size[1], size[2]));
        }
        let count = size.iter().map(|n| u128::from(n.unsigned_abs())).product::<u128>() * channels.unsigned_abs() as u128;
        if count > u128::from(VOLUME_LIMIT) {
            return Err(format!("a volume of {count} numbers is too large: at most 2^28"));
        }
        let values = bytes.get(HEADER..HEADER + 4 * count as usize).ok_or("the file ends within its values")?;
        let data = values.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let float = |i: usize| f32::from_le_bytes(word(i));
        let bounds = [Vec3::new(float(5), float(6), float(7)), Vec3::new(float(8), float(9), float(10))];
        Ok(Self { size: size.map(|n| n as u32), channels: channels as u32, data, bounds })
    }

    /// The bytes of a file.
    pub fn to_bytes(size: [u32; 3], channels: u32, data: &[f32]) -> Vec<u8> {
        let mut bytes = b"VOL\x03".to_vec();
        for n in [1, size[0], size[1], size[2], channels] {
            bytes.extend(n.to_le_bytes());
        }
        for v in [0.0f32, 0.0, 0.0, 1.0, 1.0, 1.0].iter().chain(data) {
            bytes.extend(v.to_le_bytes());
        }
        bytes
    }

    /// Places the unit cube where the file's box is.
    pub fn box_transform(&self) -> Mat4 {
        Mat4::from_translation(self.bounds[0]) * Mat4::from_scale(self.bounds[1] - self.bounds[0])
    }
}

/// Sets values below zero to zero, as interpolation of smoke leaves them; how many there were.
pub(super) fn clamp_negative(data: &mut [f32]) -> usize {
    let mut count = 0;
    for v in data {
        if *v < 0.0 {
            *v = 0.0;
            count += 1;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_come_back() {
        let data: Vec<f32> = (0..24).map(|i| i as f32).collect();
        let file = VolFile::parse(&VolFile::to_bytes([2, 3, 4], 1, &data)).unwrap();
        assert_eq!((file.size, file.channels, &file.data), ([2, 3, 4], 1, &data));
        assert_eq!(file.box_transform(), Mat4::IDENTITY);
    }

    #[test]
    fn broken_files_are_refused_with_a_reason() {
        let good = VolFile::to_bytes([2, 2, 2], 1, &[0.0; 8]);
        for (at, value, reason) in
            [(0, 0u8, "begin"), (3, 2, "version 2"), (4, 2, "encoding 2"), (8, 0, "0 × 2 × 2"), (11, 0x7f, "too large"), (8, 3, "ends")]
        {
            let mut bytes = good.clone();
            bytes[at] = value;
            let message = VolFile::parse(&bytes).unwrap_err();
            assert!(message.contains(reason), "{message}");
        }
        for n in 0..good.len() {
            assert!(VolFile::parse(&good[..n]).is_err());
        }
    }
}
