//! Random streams of `seed` and `rand`.

/// Most streams of a scene.
const STREAM_LIMIT: usize = 1 << 20;

/// All streams of a scene, by number.
#[derive(Default)]
pub(super) struct Streams {
    states: Vec<u32>,
}

impl Streams {
    /// Begins a stream and returns its number; `None` where there are too many.
    pub(super) fn seed(&mut self, seed: f64) -> Option<f64> {
        if self.states.len() >= STREAM_LIMIT {
            return None;
        }
        self.states.push(seed as i64 as u32);
        Some((self.states.len() - 1) as f64)
    }

    /// The next number of a stream, in [0, 1]; `None` where there is no such stream.
    pub(super) fn rand(&mut self, stream: f64) -> Option<f64> {
        if !(stream >= 0.0) {
            return None;
        }
        let state = self.states.get_mut(stream as usize)?;
        *state = state.wrapping_mul(1_812_433_253).wrapping_add(12345);
        Some(f64::from(*state) / f64::from(u32::MAX))
    }
}
