//! Random numbers without an end, for methods that cannot say how many they need.

use crate::math::hash::{mix64, unit_float};

/// Numbers that are a function of a key and of how many have been drawn: delta tracking draws as many as a medium is dense.
/// Made by [`SampleStream::rng`](super::SampleStream::rng).
#[derive(Clone, Copy, Debug, Default)]
pub struct HashRng {
    state: u64,
}

impl HashRng {
    /// Numbers of a key.
    #[inline]
    pub fn new(key: u64) -> Self {
        Self { state: mix64(key) }
    }

    /// The next number in [0, 1): SplitMix64 (Steele, Lea, Flood 2014, doi:10.1145/2660193.2660195).
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        unit_float((mix64(self.state) >> 32) as u32)
    }
}
