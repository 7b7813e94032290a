//! Fog, sky and rainbow.

use serde::{Deserialize, Serialize};

/// `fog`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fog {}

/// `sky_sphere`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SkySphere {}

/// `rainbow`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rainbow {}
