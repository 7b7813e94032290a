//! The pattern library (documentation, "Pattern").
//!
//! A pattern is a kind with a [`Placement`] (transforms, warps and turbulence, in the order in which they were said) and a [`Wave`]
//! that the raw value goes through. All kinds share this; block patterns are asked for an index instead of a value.

mod blocks;
mod density_file;
mod eval;
mod fractal;
mod pavement;
mod placement;
mod simple;
mod tiling;
mod wave;

use std::sync::Arc;

use glam::{DMat4, DVec2, DVec3};
use serde::{Deserialize, Serialize};

pub use density_file::{DensityFile, DensityInterpolation};
pub(crate) use eval::gray;
pub use fractal::{Coloring, Fractal, FractalSet};
pub use pavement::Pavement;
pub use placement::{Operation, Placement, Turbulent};
pub(crate) use simple::quilted_vector;
pub use wave::{Wave, WaveForm};

use crate::{Context, Function, ImageMap, ObjectId, Pigment};

/// A pattern with its modifiers (warps, transforms, turbulence, frequency, phase, wave form).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pattern {
    /// What it is.
    pub kind: PatternKind,
    /// Where it is.
    pub placement: Placement,
    /// What its value goes through; `None` for the kind's own wave form with frequency 1.
    pub wave: Wave,
    /// Generator of noise; `None` for the scene's.
    pub noise_generator: Option<u8>,
}

/// The kinds of patterns, by the names in the language.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum PatternKind {
    /// No pattern: 0 everywhere.
    #[default]
    None,
    /// Marble-like bands with turbulence of its own (`agate_turb`).
    Agate {
        /// Amount of the turbulence of its own.
        turbulence: f64,
    },
    /// Angle between the ray and the surface.
    Aoi,
    /// All entries of a map together. No value of its own.
    Average,
    /// Cube of half side 1 that fades from its center.
    Boxed,
    /// Noise.
    Bozo,
    /// Bricks and mortar, a block pattern: 0 mortar, 1 brick.
    Brick {
        /// Size of a brick with mortar.
        size: DVec3,
        /// Thickness of the mortar.
        mortar: f64,
    },
    /// Noise; a special one as a normal.
    Bumps,
    /// Unit cubes with a random value each.
    Cells,
    /// Unit cubes of two kinds, a block pattern.
    Checker,
    /// Cells around random points.
    Crackle(Crackle),
    /// The six pyramids of a cube, a block pattern.
    Cubic,
    /// Cylinder of radius 1 around the y axis that fades from its axis.
    Cylindrical,
    /// Values from a file in the unit cube.
    DensityFile(Arc<DensityFile>),
    /// Noise cubed; a special one as a normal.
    Dents,
    /// Flat pieces; for normals only.
    Facets {
        /// `coords`: size of the pieces in space; 0 where `size` counts.
        coords: f64,
        /// `size`: size of the pieces on the sphere of normals.
        size: f64,
    },
    /// Mandelbrot, Julia and magnet sets.
    Fractal(Fractal),
    /// A user function of x, y, z.
    Function(Arc<Function>),
    /// Ramp along a direction (of any length but 0).
    Gradient(DVec3),
    /// Sum of noise.
    Granite,
    /// Hexagonal prisms of three kinds, a block pattern.
    Hexagon,
    /// A picture's gray value.
    Image(Arc<ImageMap>),
    /// Regular spots.
    Leopard,
    /// Triangle wave along x.
    Marble,
    /// Inside or outside of an object, a block pattern: 1 inside.
    Object(ObjectId),
    /// Concentric spheres.
    Onion,
    /// Polyforms that pave the x-z plane.
    Pavement(Pavement),
    /// Gray value of a pigment.
    Pigment(Arc<Pigment>),
    /// Slab that fades from the x-z plane.
    Planar,
    /// Padded cubes.
    Quilted {
        /// Shape of the seam.
        control0: f64,
        /// Shape of the seam.
        control1: f64,
    },
    /// Angle around the y axis.
    Radial,
    /// Waves from points; a special one as a normal.
    Ripples,
    /// Direction of the normal, and altitude.
    Slope(Slope),
    /// Sphere of radius 1 that fades from its center.
    Spherical,
    /// Spiral around the z axis with a number of arms.
    Spiral1(f64),
    /// Two spirals around the z axis with a number of arms.
    Spiral2(f64),
    /// Noise.
    Spotted,
    /// Unit squares of four kinds, a block pattern.
    Square,
    /// Tilings of the x-z plane, 1 to 27.
    Tiling(u8),
    /// Triangles of six kinds, a block pattern.
    Triangular,
    /// Waves from points; a special one as a normal.
    Waves,
    /// Concentric cylinders around the z axis.
    Wood,
    /// Sum of noise with sharp folds; a special one as a normal.
    Wrinkles,
}

/// Parameters of `crackle`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Crackle {
    /// Factors of the distances to the nearest three points.
    pub form: DVec3,
    /// Exponent of the metric; 2 is Euclid's.
    pub metric: f64,
    /// Distance along a fourth axis.
    pub offset: f64,
    /// One value for each cell.
    pub solid: bool,
}

impl Default for Crackle {
    fn default() -> Self {
        Self { form: DVec3::new(-1.0, 1.0, 0.0), metric: 2.0, offset: 0.0, solid: false }
    }
}

/// Parameters of `slope`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Slope {
    /// The direction, or the point where `point_at` is set. Its length is its weight against `altitude`.
    pub direction: DVec3,
    /// `direction` is a point to look at.
    pub point_at: bool,
    /// Slopes for the values 0 and 1.
    pub slope_range: DVec2,
    /// Direction of the altitude; its length is its weight. Zero for none.
    pub altitude: DVec3,
    /// Altitudes for the values 0 and 1.
    pub altitude_range: DVec2,
}

impl Pattern {
    /// A pattern without modifiers.
    pub fn new(kind: PatternKind) -> Self {
        let wave = Wave::of(&kind);
        Self { kind, placement: Placement::default(), wave, noise_generator: None }
    }

    /// The pattern's value at the context's point, usually in [0, 1].
    pub fn value(&self, context: &Context) -> f64 {
        self.value_here(&self.enter(context))
    }

    /// The context in the pattern's own space: after all transforms and warps.
    pub fn enter<'a>(&self, context: &Context<'a>) -> Context<'a> {
        let mut inner = *context;
        if let Some(generator) = self.noise_generator {
            inner.noise_generator = generator;
        }
        if !self.placement.is_identity() {
            inner.p = self.placement.apply(context.p, inner.noise_generator, self.kind.turbulence_is_its_own());
        }
        inner
    }

    /// The value at a point in the pattern's own space.
    pub fn value_here(&self, inner: &Context) -> f64 {
        let raw = self.raw(inner);
        // Numbers of blocks are values as they are.
        if self.wave == Wave::default() && self.kind.blocks().is_some() { raw } else { self.wave.apply(raw) }
    }

    /// Moves the pattern with the object.
    pub fn transform(&mut self, world_from_old: &DMat4) {
        self.placement.transform(world_from_old);
    }
}

impl PatternKind {
    /// Number of entries of a block pattern's list; `None` for patterns with values.
    pub fn blocks(&self) -> Option<usize> {
        match self {
            Self::Brick { .. } | Self::Checker | Self::Object(_) => Some(2),
            Self::Hexagon => Some(3),
            Self::Square => Some(4),
            Self::Cubic | Self::Triangular => Some(6),
            _ => None,
        }
    }

    /// How deep patterns stand inside of this one.
    pub(crate) fn depth(&self) -> u32 {
        match self {
            Self::Pigment(pigment) => pigment.depth(),
            _ => 0,
        }
    }

    /// Whether `turbulence` is no warp of space but goes into the pattern's own formula.
    pub fn turbulence_is_its_own(&self) -> bool {
        matches!(self, Self::Marble | Self::Wood)
    }
}
