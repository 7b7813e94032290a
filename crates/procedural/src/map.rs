//! Maps from pattern values to colors, pigments, normals, textures …

use serde::{Deserialize, Serialize};

/// Entries at ascending places in [0, 1].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlendMap<T> {
    /// (place, entry), places ascending; never empty. In an `average`, the places are the weights.
    pub entries: Vec<(f64, T)>,
}

impl<T> BlendMap<T> {
    /// The two neighbors of a value and the weight of the second, in [0, 1]. Below the first place and from the last place on both
    /// are that entry. At a place that two entries share the later one counts (documentation, "Color Map"). Where places do not ascend,
    /// the last place counts first, then the first that lies above the value (measured).
    ///
    /// Returns `None` for a map without entries.
    pub fn around(&self, value: f64) -> Option<(&T, &T, f64)> {
        let last = self.entries.last()?;
        if !(value < last.0) {
            return Some((&last.1, &last.1, 0.0));
        }
        let next = if self.entries.len() <= 8 {
            self.entries.iter().position(|e| e.0 > value).unwrap_or(self.entries.len())
        } else {
            self.entries.partition_point(|e| e.0 <= value)
        };
        if next == 0 {
            let first = &self.entries.first()?.1;
            return Some((first, first, 0.0));
        }
        let low = self.entries.get(next - 1)?;
        let Some(high) = self.entries.get(next) else { return Some((&low.1, &low.1, 0.0)) };
        let width = high.0 - low.0;
        let weight = if width > 0.0 { ((value - low.0) / width).clamp(0.0, 1.0) } else { 1.0 };
        Some((&low.1, &high.1, if weight.is_nan() { 0.0 } else { weight }))
    }

    /// The same map with every entry changed.
    pub fn for_each_mut(&mut self, mut change: impl FnMut(&mut T)) {
        self.entries.iter_mut().for_each(|e| change(&mut e.1));
    }

    /// Sum of the places, which are weights in an `average`.
    pub fn total(&self) -> f64 {
        self.entries.iter().map(|e| e.0).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_places_jump_to_the_later_entry() {
        let map = BlendMap { entries: vec![(0.1, 1.0), (0.6, 2.0), (0.6, 3.0), (0.8, 4.0)] };
        let at = |v: f64| map.around(v).map(|(a, b, t)| a + (b - a) * t).unwrap();
        assert_eq!(at(0.0), 1.0);
        assert!((at(0.35) - 1.5).abs() < 1e-12);
        assert!(at(0.599_999) < 2.0);
        assert_eq!(at(0.6), 3.0);
        assert_eq!(at(0.8), 4.0);
        assert_eq!(at(f64::INFINITY), 4.0);
        assert_eq!(at(f64::NAN), 4.0);
    }

    #[test]
    fn empty_map_has_no_answer() {
        assert!(BlendMap::<u8> { entries: Vec::new() }.around(0.5).is_none());
    }
}
