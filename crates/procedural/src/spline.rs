//! Splines of numbers and vectors.

use serde::{Deserialize, Serialize};

/// A curve through (or near) points, each of up to five numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spline {}

impl Spline {
    /// The value at a parameter: as many numbers as the points have, the rest 0.
    pub fn eval(&self, t: f64) -> [f64; 5] {
        let _ = t;
        [0.0; 5]
    }
}
impl Spline {
    /// n
    pub fn components(&self) -> usize {
        1
    }
}
