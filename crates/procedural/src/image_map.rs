//! Pictures wrapped around objects.

use serde::{Deserialize, Serialize};

use crate::ImageId;

/// A picture with the way it is mapped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageMap {
    /// The picture.
    pub image: ImageId,
}
