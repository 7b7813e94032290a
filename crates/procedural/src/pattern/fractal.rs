//! Mandelbrot, Julia and magnet sets (documentation, "Fractal Pattern").

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// A fractal pattern.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fractal {
    /// Which set.
    pub set: FractalSet,
    /// `Some(c)` for the Julia set of c, `None` for the Mandelbrot-like set.
    pub julia: Option<DVec2>,
    /// Most iterations.
    pub iterations: u32,
    /// How points outside of the set get their value.
    pub exterior: Coloring,
    /// How points inside of the set get their value.
    pub interior: Coloring,
}

/// The map that is iterated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FractalSet {
    /// z ↦ zⁿ + c, with the exponent, 2 to 33.
    Power(u8),
    /// First model of magnetic renormalization.
    Magnet1,
    /// Second model of magnetic renormalization.
    Magnet2,
}

/// `exterior` or `interior`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coloring {
    /// Method, 0 to 8.
    pub method: u8,
    /// Factor of the value.
    pub factor: f64,
}

impl Fractal {
    /// A Mandelbrot set.
    pub fn mandelbrot(iterations: u32) -> Self {
        Self {
            set: FractalSet::Power(2),
            julia: None,
            iterations,
            exterior: Coloring { method: 1, factor: 1.0 },
            interior: Coloring { method: 0, factor: 1.0 },
        }
    }

    /// The value at a point of the x-y plane.
    pub fn value(&self, p: DVec3) -> f64 {
        let _ = p;
        0.0
    }
}
