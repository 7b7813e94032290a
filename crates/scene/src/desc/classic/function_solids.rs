//! Surfaces of functions.

use std::sync::Arc;

use etendue_procedural::Function;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// What limits the surface of a function.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Container {
    /// Box with faces along the axes, by opposite corners in any order.
    Box([DVec3; 2]),
    /// Ball.
    Sphere {
        /// Center.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
}

impl Default for Container {
    fn default() -> Self {
        Self::Box([DVec3::NEG_ONE, DVec3::ONE])
    }
}

/// `isosurface`: where a function of x, y, z has the value of a threshold; inside it is less.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Isosurface {
    /// The function.
    pub function: Arc<Function>,
    /// Where it is looked at.
    pub container: Container,
    /// The value at the surface.
    pub threshold: f64,
    /// Intervals of a ray of this length are not divided further; also the step of the normal's differences.
    pub accuracy: f64,
    /// Bound of the function's slope.
    pub max_gradient: f64,
    /// `evaluate`: least slope, factor of overestimation, attenuation; the slope is then estimated.
    pub evaluate: Option<[f64; 3]>,
    /// Without the container's surface where the inside meets it.
    pub open: bool,
    /// Noise generator of the function's noise.
    pub noise_generator: u8,
}

/// `parametric`: the surface of the points (x(u, v), y(u, v), z(u, v)).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parametric {
    /// x, y and z as functions of u and v.
    pub functions: [Arc<Function>; 3],
    /// Least and greatest (u, v).
    pub range: [DVec2; 2],
    /// Points outside of it are not there.
    pub container: Container,
    /// How far a point may be off.
    pub accuracy: f64,
    /// Noise generator of the functions' noise.
    pub noise_generator: u8,
}
