//! Maps from pattern values to colors, pigments, normals, textures …

use serde::{Deserialize, Serialize};

/// Entries at ascending places in [0, 1].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlendMap<T> {
    /// (place, entry), places ascending; never empty.
    pub entries: Vec<(f64, T)>,
}
