//! Participating media as files describe them.
//!
//! Coefficients are per unit of length in world space. A field of a grid medium is a constant color times the value of a
//! [`VolumeDesc`] at the point; volumes have a place of their own in the world, whatever shape holds the medium.

use glam::Mat4;
use serde::{Deserialize, Serialize};

use super::VolumeId;

/// The most numbers that a volume may hold: 1 GiB.
pub const VOLUME_LIMIT: u64 = 1 << 28;

/// What fills a shape or the space around the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum MediumDesc {
    /// The same everywhere.
    Homogeneous {
        /// Absorption per unit of length.
        sigma_a: [f32; 3],
        /// Scattering per unit of length.
        sigma_s: [f32; 3],
        /// Emitted radiance per unit of length.
        emission: [f32; 3],
        /// Phase function.
        phase: PhaseDesc,
    },
    /// Given by volumes: smoke, clouds, fire.
    Grid(Box<GridMediumDesc>),
}

/// A medium that varies in space. It fills the box of the extinction's volume and is nowhere else; a constant extinction has no border.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridMediumDesc {
    /// Absorption plus scattering per unit of length.
    pub extinction: FieldDesc,
    /// How much of it is scattering.
    pub scattering: ScatteringDesc,
    /// Emission.
    pub emission: Option<MediumEmissionDesc>,
    /// Phase function.
    pub phase: PhaseDesc,
}

/// A color times what a volume says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldDesc {
    /// Factor.
    pub factor: [f32; 3],
    /// The volume; `None` is the factor alone.
    pub volume: Option<VolumeId>,
}

impl FieldDesc {
    /// The same everywhere.
    pub const fn constant(factor: [f32; 3]) -> Self {
        Self { factor, volume: None }
    }
}

/// The share of light that a grid medium scatters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ScatteringDesc {
    /// As a share of the extinction, in [0, 1].
    Albedo(FieldDesc),
    /// As a coefficient per unit of length, at most the extinction.
    Coefficient(FieldDesc),
}

/// What a grid medium emits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MediumEmissionDesc {
    /// The emission per unit of length, or what the absorption is multiplied by.
    pub source: EmissionSource,
    /// Whether the source is multiplied by the absorption per unit of length, as for bodies that glow.
    pub by_absorption: bool,
}

/// Where the color of a glow comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum EmissionSource {
    /// A field of colors.
    Field(FieldDesc),
    /// Planck's law, scaled so that the highest radiance over the visible wavelengths is 1, times a factor. Black below 100 K.
    BlackBody {
        /// Temperature; the red lane counts.
        kelvin: FieldDesc,
        /// Added to the temperature.
        offset: f32,
        /// Factor on the radiance.
        scale: f32,
    },
}

/// In which direction a medium scatters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum PhaseDesc {
    /// Every direction alike.
    Isotropic,
    /// Henyey–Greenstein with mean cosine g in (−1, 1).
    HenyeyGreenstein {
        /// Mean cosine.
        g: f32,
    },
    /// Rayleigh.
    Rayleigh,
    /// A weighted sum of two.
    Blend {
        /// At weight 0.
        first: Box<PhaseDesc>,
        /// At weight 1.
        second: Box<PhaseDesc>,
        /// In [0, 1].
        weight: f32,
    },
}

/// How a volume is read between its values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum VolumeFilter {
    /// The nearest value.
    Nearest,
    /// Linear along each axis.
    #[default]
    Linear,
}

/// What a volume holds beyond its box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum VolumeWrap {
    /// The outermost values.
    #[default]
    Clamp,
    /// The values again.
    Repeat,
    /// The values again, each second time mirrored.
    Mirror,
    /// Nothing.
    Zero,
}

/// Numbers on a regular grid over the unit cube: value (i, j, k) of (nx, ny, nz) is at ((i + ½) / nx, (j + ½) / ny, (k + ½) / nz).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VolumeDesc {
    /// Values along x, y and z.
    pub size: [u32; 3],
    /// Numbers per value: 1 or 3 (linear Rec. 709).
    pub channels: u32,
    /// The values, x fastest, z slowest; `channels` numbers each, none negative.
    pub data: Vec<f32>,
    /// Places the unit cube in the world.
    pub world_from_volume: Mat4,
    /// Between the values.
    pub filter: VolumeFilter,
    /// Beyond the box.
    pub wrap: VolumeWrap,
}

impl MediumDesc {
    /// The medium's name as users write it.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::Homogeneous { .. } => "homogeneous",
            Self::Grid(_) => "grid",
        }
    }
}

impl GridMediumDesc {
    /// Its fields, for passes over all.
    pub fn fields(&self) -> Vec<FieldDesc> {
        let scattering = match self.scattering {
            ScatteringDesc::Albedo(f) | ScatteringDesc::Coefficient(f) => f,
        };
        let emission = self.emission.iter().map(|e| match e.source {
            EmissionSource::Field(f) | EmissionSource::BlackBody { kelvin: f, .. } => f,
        });
        [self.extinction, scattering].into_iter().chain(emission).collect()
    }
}
