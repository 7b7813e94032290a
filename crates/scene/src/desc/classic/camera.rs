//! Cameras of the classic model.

use serde::{Deserialize, Serialize};

/// `camera`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Camera {}
