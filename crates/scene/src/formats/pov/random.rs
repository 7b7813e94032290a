//! Random streams of `seed` and `rand`.
//!
//! The generator was found from numbers that POV-Ray prints: `rand` after `seed(0)` gives 12345 / (2³² − 1), after `seed(1)`
//! (1812433253 + 12345) / (2³² − 1), and so on: a linear congruential generator modulo 2³².

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
        // Seeds are truncated to 32 bits; those outside give the least integer.
        let in_range = seed > -2_147_483_649.0 && seed < 2_147_483_648.0;
        self.states.push(if in_range { seed as i32 as u32 } else { 1 << 31 });
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Measured: printed by POV-Ray 3.7.0.10 with twenty digits.
    #[test]
    fn as_measured() {
        let mut streams = Streams::default();
        for (seed, values) in [
            (0.0, &[0.00000287429429657624, 0.46656368450880136844, 0.24907022883395438240, 0.96587604213642797024][..]),
            (12345.0, &[0.46656368450880136844, 0.24907022883395438240]),
            (-1.0, &[0.57801287355320829509, 0.44600617081066734615, 0.83224424226960269646, 0.95602017919440296367]),
            (1.7, &[0.42199287526821549488, 0.48712119820693533523, 0.66589621563113676750, 0.97573190507845297681]),
            (4294967297.0, &[0.50000287441071189498, 0.96656368462521669027]),
        ] {
            let stream = streams.seed(seed).unwrap();
            for v in values {
                let got = streams.rand(stream).unwrap();
                assert!((got - v).abs() < 1e-15, "{got} is not {v}");
            }
        }
        assert_eq!(streams.rand(7.0), None);
    }
}
