//! Light on surfaces: what view-independent methods leave, and what is baked.
//!
//! Radiosity and particle tracing solve a static scene once. What they find is a [`SurfaceLight`]: anyone may ask it for the
//! irradiance at a point of a surface, be it a camera ray, a texel of a lightmap or a lux meter.
//!
//! Baking goes one way: [`flatten`](flatten()) puts all triangles into the world, [`Layout`] unwraps and packs them and finds what each texel
//! stands for, [`spots()`] finds where its light is measured, [`solve()`] measures, [`fill`] and [`seams`] make pictures of the
//! texels, and [`output`] and [`deliver`] write them with the scene. [`Bake`] does it all, at once or by [`Part`]s. The same bits for any number of threads, with and without
//! interruption.

mod charts;
mod clean;
pub mod deliver;
pub mod fill;
mod flatten;
mod glb;
mod job;
mod layout;
mod method;
pub mod output;
mod pack;
mod part;
pub mod probes;
mod seams;
mod solve;
mod spots;
mod texels;
mod topology;
mod vertices;

use std::path::PathBuf;

pub use flatten::{Flat, FlatShape, Sides, flatten};
pub use job::{Bake, Baked, Content};
pub use layout::{Layout, PlacedChart, Side, Texel};
pub use method::{Method, NAMES as METHODS};
pub use pack::{Packing, Place};
pub use part::Part;
pub use solve::{Points, Solution, Solver, Sums, Watcher, solve};
pub use spots::{Spot, World, spots};
pub use topology::Topology;

use etendue_scene::Fault;

use crate::denoise::DenoiseError;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Light that arrives at surfaces, solved beforehand.
pub trait SurfaceLight: Send + Sync {
    /// Irradiance in W·m⁻² at a surface point, on the side to which its shading normal points. Direct light is included.
    fn irradiance(&self, scene: &Scene, surface: &Surface) -> Spectrum;
}

/// Why nothing was baked.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// A setting does not fit.
    #[error("{0}")]
    Setting(String),
    /// The scene cannot be baked.
    #[error("{0}")]
    Scene(String),
    /// The scene could not be compiled.
    #[error("the scene cannot be rendered: {}", .0.iter().map(|f| f.message.as_str()).collect::<Vec<_>>().join("; "))]
    Faults(Vec<Fault>),
    /// A checkpoint does not fit.
    #[error("{0}")]
    Checkpoint(String),
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The denoiser failed.
    #[error(transparent)]
    Denoise(#[from] DenoiseError),
}

/// What the light is stored in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Target {
    /// Pictures.
    #[default]
    Texels,
    /// Colors of the vertices.
    Vertices,
}

/// How surfaces are cut and measured.
#[derive(Clone, Debug, PartialEq)]
pub struct BakeOptions {
    /// Texels for a world unit; `None` takes what one atlas has room for.
    pub texels_per_meter: Option<f64>,
    /// Largest edge of an atlas, in texels: 16 to 16384.
    pub resolution: u32,
    /// Texels of gutter around each chart: 1 to 32.
    pub padding: u32,
    /// New texture coordinates even where the file's second set would do.
    pub unwrap: bool,
    /// Which sides of surfaces.
    pub sides: Sides,
    /// Where the light goes.
    pub target: Target,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self { texels_per_meter: None, resolution: 1024, padding: 2, unwrap: false, sides: Sides::Auto, target: Target::Texels }
    }
}

impl BakeOptions {
    /// Checks ranges.
    ///
    /// # Errors
    /// [`BakeError::Setting`]
    pub fn validate(&self) -> Result<(), BakeError> {
        let fail = |what: String| Err(BakeError::Setting(what));
        if !(16..=16384).contains(&self.resolution) {
            return fail(format!("an atlas has 16 to 16384 texels along an edge, not {}", self.resolution));
        }
        if !(1..=32).contains(&self.padding) || self.padding * 4 >= self.resolution {
            return fail(format!("a gutter has 1 to 32 texels and less than a quarter of the atlas, not {}", self.padding));
        }
        if self.texels_per_meter.is_some_and(|d| !(d > 0.0 && d < 1e9)) {
            return fail("the texels per meter must be a positive number".into());
        }
        Ok(())
    }
}
