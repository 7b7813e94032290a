//! Particle tracing: photons that leave the lights, where they land, and the light that their density stands for.
//!
//! A photon is a function of (seed, index): it leaves a light chosen by power, scatters as the materials say and leaves a
//! [`Photon`] on every surface that is not a perfect mirror or refractor. So a [`PhotonMap`] of a range of indices is the same
//! whoever traced it, maps of ranges that do not overlap merge into the bits of one run, and a map serves any number of views.
//!
//! | module | what |
//! |---|---|
//! | `trace` | follows photons |
//! | `map` | what they left: segments, thinning to a memory budget, merging |
//! | `file` | `.photons` files (docs/guide/particles.md) |
//! | `beams` | the ways of photons through homogeneous media, by place |
//! | `tree` | a kd-tree: all photons within a radius, the k nearest |
//! | `estimate` | from densities to radiance and irradiance |
//! | `disk` | how far the surface around a point goes on before something stands on it |
//! | `surface_light` | irradiance for lightmaps, right up to the edges of surfaces |
//!
//! Sources: Jensen 1996, "Global Illumination using Photon Maps" (doi:10.1007/978-3-7091-7484-5_3); Shirley et al. 1995,
//! "Global Illumination via Density-Estimation" (doi:10.1007/978-3-7091-9430-0_21).

pub mod beams;
pub mod disk;
pub mod estimate;
pub mod file;
pub mod map;
pub mod surface_light;
pub mod trace;
pub mod tree;

pub use beams::{Beam, BeamTree};
pub use disk::VisibleDisk;
pub use estimate::Query;
pub use file::Contents;
pub use map::{MapError, MapInfo, PhotonMap, Segment};
pub use surface_light::{CoarseLight, PhotonLight};
pub use trace::Tracer;
pub use tree::PhotonTree;

use bytemuck::{Pod, Zeroable};

use crate::math::Vec3;
use crate::spectrum::Spectrum;

/// How a photon came to where it landed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Route {
    /// Straight from a light.
    Direct = 0,
    /// By mirrors and refractors alone (and glossy surfaces without a diffuse part): caustics.
    Caustic = 1,
    /// After at least one diffuse scattering, or from a medium that emits.
    Indirect = 2,
}

/// A photon on a surface, 32 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Photon {
    /// Where.
    pub p: [f32; 3],
    /// Power in W if it were the only photon: a map's density divides by the number of photons.
    pub power: [f32; 3],
    /// Direction to where it came from (24 bits) and light group (8 bits).
    from_and_group: u32,
    /// Geometric normal on the side on which it landed (24 bits), scattering events before it (6 bits), route (2 bits).
    normal_and_path: u32,
}

/// Scattering events that a photon's record can tell apart; longer paths count as this.
pub const MAX_RECORDED_DEPTH: u32 = 63;

impl Photon {
    /// A record. `from` points to where the photon came from, `ng` is the geometric normal, either side's; both unit.
    pub fn new(p: Vec3, from: Vec3, ng: Vec3, power: Spectrum, group: u32, depth: u32, route: Route) -> Self {
        let side = if ng.dot(from) < 0.0 { -ng } else { ng };
        Self {
            p: p.to_array(),
            power: power.rgb(),
            // Groups beyond the last count as the unnamed one.
            from_and_group: pack_unit(from) << 8 | if group < 256 { group } else { 0 },
            normal_and_path: pack_unit(side) << 8 | depth.min(MAX_RECORDED_DEPTH) << 2 | route as u32,
        }
    }

    /// Where.
    #[inline]
    pub fn position(&self) -> Vec3 {
        Vec3::from_array(self.p)
    }

    /// Power in W if it were the only photon.
    #[inline]
    pub fn power(&self) -> Spectrum {
        Spectrum::from_rgb(self.power)
    }

    /// Unit direction to where it came from.
    #[inline]
    pub fn from(&self) -> Vec3 {
        unpack_unit(self.from_and_group >> 8)
    }

    /// Unit geometric normal on the side on which it landed.
    #[inline]
    pub fn normal(&self) -> Vec3 {
        unpack_unit(self.normal_and_path >> 8)
    }

    /// Light group.
    #[inline]
    pub fn group(&self) -> u32 {
        self.from_and_group & 0xff
    }

    /// Scattering events between light and photon, at most [`MAX_RECORDED_DEPTH`].
    #[inline]
    pub fn depth(&self) -> u32 {
        self.normal_and_path >> 2 & MAX_RECORDED_DEPTH
    }

    /// How it came.
    #[inline]
    pub fn route(&self) -> Route {
        match self.normal_and_path & 3 {
            0 => Route::Direct,
            1 => Route::Caustic,
            _ => Route::Indirect,
        }
    }

    /// Whether all numbers are finite; others never get into a map.
    pub fn is_finite(&self) -> bool {
        self.p.iter().chain(&self.power).all(|v| v.is_finite())
    }
}

/// A unit vector in 24 bits: twice 12 bits of the octahedral map (Cigolle et al. 2014, "A Survey of Efficient Representations for
/// Independent Unit Vectors"). Off by at most 0.05 degrees.
fn pack_unit(v: Vec3) -> u32 {
    let sum = v.x.abs() + v.y.abs() + v.z.abs();
    let (mut x, mut y) = if sum > 0.0 { (v.x / sum, v.y / sum) } else { (0.0, 0.0) };
    if v.z < 0.0 {
        (x, y) = ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y));
    }
    let quantize = |v: f32| ((v * 0.5 + 0.5) * 4095.0 + 0.5).clamp(0.0, 4095.0) as u32;
    quantize(x) << 12 | quantize(y)
}

/// The inverse of [`pack_unit`].
#[inline]
fn unpack_unit(bits: u32) -> Vec3 {
    let part = |v: u32| (v & 0xfff) as f32 * (2.0 / 4095.0) - 1.0;
    let (x, y) = (part(bits >> 12), part(bits));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{mix32, unit_float};
    use crate::math::{Vec2, warp};

    #[test]
    fn records_keep_what_they_are_given() {
        for i in 0..20_000u32 {
            let u = |k: u32| unit_float(mix32(4 * i + k));
            let (from, n) = (warp::uniform_sphere(Vec2::new(u(0), u(1))), warp::uniform_sphere(Vec2::new(u(2), u(3))));
            let route = [Route::Direct, Route::Caustic, Route::Indirect][i as usize % 3];
            let photon = Photon::new(from * 3.0, from, n, Spectrum::from_rgb([1.0, 2.0, 3.0]), i % 256, i % 64, route);
            assert!(photon.from().dot(from) > 1.0 - 1e-6, "{from} became {}", photon.from());
            assert!(photon.normal().dot(n).abs() > 1.0 - 1e-6);
            assert!(photon.normal().dot(from) > -1e-3);
            assert_eq!((photon.group(), photon.depth(), photon.route()), (i % 256, i % 64, route));
        }
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert!(unpack_unit(pack_unit(axis)).dot(axis) > 1.0 - 1e-6);
        }
        assert!(unpack_unit(pack_unit(Vec3::NAN)).is_finite());
        assert_eq!(size_of::<Photon>(), 32);
    }
}
