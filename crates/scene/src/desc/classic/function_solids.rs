//! Surfaces of functions.

use serde::{Deserialize, Serialize};

/// `isosurface`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Isosurface {}

/// `parametric`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Parametric {}
