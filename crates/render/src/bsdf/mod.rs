//! Scattering at one surface point: the closed set of BSDF models.
//!
//! A [`Bsdf`] holds numbers, no textures: a material evaluates its textures at a hit and makes one. The contract, for
//! every model:
//!
//! - Directions are in the local shading frame (normal = +z), unit, and point away from the surface. `wo` is the
//!   known side, `wi` the sampled one.
//! - `eval` returns f(wo, wi)·|cos θi|, zero for delta lobes and wherever the model does not scatter.
//! - `pdf` is the density with which `sample` returns `wi`, per solid angle; delta lobes are left out of it.
//! - `sample` takes `u_lobe` and `u` in [0, 1) and returns `None` where nothing is scattered. For a delta lobe `value` and
//!   `pdf` are the factors in front of the Dirac delta, so `value / pdf` is the throughput in every case.
//! - `mode` says what travels along `wo`. Radiance that crosses from one medium into another is scaled by the squared
//!   ratio of the refractive indices, importance is not (Veach 1997, section 5.2).
//! - A model that has no transmission is black for `wo.z <= 0`; two-sidedness is the material's affair.

pub mod coated;
pub mod conductor;
pub mod dielectric;
pub mod diffuse;
pub mod diffuse_transmission;
pub mod fresnel;
pub mod microfacet;
pub mod null;
pub mod pbr;
pub mod plastic;
pub mod principled;
pub mod rough_conductor;
pub mod rough_dielectric;
pub mod rough_diffuse;
pub mod rough_plastic;
pub mod rough_transmittance;
pub mod thin_dielectric;

pub use coated::{Coat, Coated, CoatedBase};
pub use conductor::Conductor;
pub use dielectric::Dielectric;
pub use diffuse::Diffuse;
pub use diffuse_transmission::DiffuseTransmission;
pub use null::Null;
pub use pbr::{DiffuseTilt, Pbr};
pub use plastic::Plastic;
pub use principled::Principled;
pub use rough_conductor::RoughConductor;
pub use rough_dielectric::RoughDielectric;
pub use rough_diffuse::RoughDiffuse;
pub use rough_plastic::RoughPlastic;
pub use rough_transmittance::RoughTransmittance;
pub use thin_dielectric::ThinDielectric;

use crate::math::{Vec2, Vec3};
use crate::spectrum::Spectrum;

/// What is carried along the known direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransportMode {
    /// The path comes from the camera: radiance travels along `wo`.
    Radiance,
    /// The path comes from a light: importance travels along `wo`.
    Importance,
}

/// Which kind of scattering happened, as a set of flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Lobe(pub u8);

impl Lobe {
    /// Spread over the whole hemisphere.
    pub const DIFFUSE: Self = Self(1);
    /// Spread about a preferred direction.
    pub const GLOSSY: Self = Self(2);
    /// Exactly one direction.
    pub const DELTA: Self = Self(4);
    /// `wi` on the side of `wo`.
    pub const REFLECTION: Self = Self(8);
    /// `wi` on the other side.
    pub const TRANSMISSION: Self = Self(16);
    /// Straight on, as if nothing were there (with [`Lobe::DELTA`] and [`Lobe::TRANSMISSION`]).
    pub const NULL: Self = Self(32);

    /// True where every flag of `o` is set.
    #[inline]
    pub const fn contains(self, o: Self) -> bool {
        self.0 & o.0 == o.0
    }

    /// The flags of both.
    #[inline]
    pub const fn union(self, o: Self) -> Self {
        Self(self.0 | o.0)
    }
}

/// A sampled direction with everything that an estimator needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The sampled direction, local, unit.
    pub wi: Vec3,
    /// f·|cos θi| of the whole model for non-delta lobes, the factor of the Dirac delta for delta lobes.
    pub value: Spectrum,
    /// Density per solid angle of the whole model, or the probability of the delta lobe.
    pub pdf: f32,
    /// The lobe that was sampled.
    pub lobe: Lobe,
    /// Refractive index on the side of `wi` over that on the side of `wo`; 1 for reflection.
    pub eta: f32,
}

macro_rules! bsdfs {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {
        /// One of the models, with its parameters at a point.
        #[derive(Clone, Debug)]
        pub enum Bsdf {
            $($(#[$doc])* $name($name)),*
        }

        impl Bsdf {
            /// f(wo, wi)·|cos θi|; zero for delta lobes.
            #[inline]
            pub fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Spectrum {
                match self { $(Self::$name(b) => b.eval(wo, wi, mode)),* }
            }

            /// The density of `wi` per solid angle, delta lobes left out.
            #[inline]
            pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
                match self { $(Self::$name(b) => b.pdf(wo, wi)),* }
            }

            /// Samples a direction.
            #[inline]
            pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
                match self { $(Self::$name(b) => b.sample(wo, u_lobe, u, mode)),* }
            }

            /// All lobes that the model may sample.
            #[inline]
            pub fn lobes(&self) -> Lobe {
                match self { $(Self::$name(b) => b.lobes()),* }
            }

            /// An estimate of the share of light that is scattered, for the albedo AOV: in [0, 1].
            #[inline]
            pub fn albedo(&self, wo: Vec3) -> Spectrum {
                match self { $(Self::$name(b) => b.albedo(wo)),* }
            }
        }
    };
}

bsdfs! {
    /// Lambert's ideally diffuse reflection.
    Diffuse,
    /// Lambertian reflection and transmission.
    DiffuseTransmission,
    /// Diffuse reflection of a rough surface.
    RoughDiffuse,
    /// Smooth metal, mirrors.
    Conductor,
    /// Rough metal.
    RoughConductor,
    /// Smooth glass.
    Dielectric,
    /// Frosted glass.
    RoughDielectric,
    /// A thin pane of glass.
    ThinDielectric,
    /// A diffuse base below a clear coat.
    Plastic,
    /// A diffuse base below a frosted coat.
    RoughPlastic,
    /// A varnished material.
    Coated,
    /// No surface at all.
    Null,
    /// Disney's principled model, with the parameters of Mitsuba.
    Principled,
    /// The glTF metallic-roughness material with its extensions.
    Pbr,
}
