//! The glTF 2.0 metallic-roughness material with the Khronos extensions (anisotropy, clearcoat, diffuse transmission,
//! dispersion, ior, iridescence, sheen, specular, transmission, volume boundary).
//!
//! The layering keeps energy, in the way of OpenPBR and Cycles' Principled BSDF rather than of glTF's non-normative
//! sample code: from top to bottom sheen, clearcoat, then a mix of metal and dielectric; a layer lets through what its
//! directional albedo leaves (Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks", SIGGRAPH course
//! notes). The specular lobes of metal, dielectric and glass get back the light that single scattering loses (Turquin 2019,
//! "Practical Multiple Scattering Compensation for Microfacet Models"); the coat does not, as in Cycles.
//!
//! The albedos are those of the direction towards the camera, so f(a, b) ≠ f(b, a) for layered and rough materials.
//! For [`TransportMode::Importance`] the arguments are exchanged: light and camera paths estimate the same picture.
//!
//! There are no delta lobes, alpha is at least 0.0001, with one exception: transmission that changes no direction, which is
//! that of smooth thin walls (roughness below 0.01) and of solids with an index within 0.001 of one.
//!
//! Back side (`wo.z < 0`): thin walls and diffuse transmission look the same from both sides; solids with transmission
//! show their interface from inside (do not turn their normals); everything else is black.

mod iridescence;
mod layers;
mod sheen;
mod tables;

use super::microfacet::Microfacet;
use super::{BsdfSample, Lobe, TransportMode};
use crate::math::{ONE_MINUS_EPSILON, Vec2, Vec3, fns, warp};
use crate::spectrum::Spectrum;
use layers::{Layers, STRATEGIES};

/// The least roughness alpha of any lobe.
const MIN_ALPHA: f32 = Microfacet::MIN_ALPHA;

/// Normals of a diffuse base under a normal map, local, unit. The frame's own normal is bent so that the interface's mirror direction
/// stays above the surface; what is diffuse needs no such bending.
#[derive(Clone, Copy, Debug)]
pub struct DiffuseTilt {
    /// The normal of the surface without the map.
    pub base: Vec3,
    /// The normal of the map.
    pub normal: Vec3,
}

impl DiffuseTilt {
    /// The cosine that the diffuse base shows to the light, with the light that neighboring bumps hide (Conty Estevez, Lecocq,
    /// Stein 2019, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator Problem", Ray Tracing Gems ch. 12).
    #[inline]
    fn cosine(&self, light: Vec3) -> f32 {
        let (cos_i, cos_d) = (self.base.dot(light), self.base.dot(self.normal).clamp(1e-3, 1.0));
        if cos_i <= 0.0 {
            return 0.0;
        }
        let tan2 = |cos: f32| (1.0 - cos * cos).max(0.0) / (cos * cos);
        let alpha2 = (0.125 * tan2(cos_d)).min(1.0);
        let shadowing = 2.0 / (1.0 + (1.0 + alpha2 * tan2(cos_i)).sqrt());
        self.normal.dot(light).max(0.0) * shadowing
    }
}

/// The glTF material at a point. Factors in [0, 1] unless said otherwise; the default is glTF's, but not metallic.
#[derive(Clone, Debug)]
pub struct Pbr {
    /// Reflectance of the metal at normal incidence, albedo of what is below the dielectric interface.
    pub base_color: Spectrum,
    /// Blend from dielectric to metal.
    pub metallic: f32,
    /// Perceived roughness; alpha of GGX is its square.
    pub roughness: f32,
    /// Refractive index of the dielectric, at least one; 0 stands for infinity (KHR_materials_ior).
    pub ior: f32,
    /// Strength of the dielectric reflection (KHR_materials_specular).
    pub specular: f32,
    /// Color of the dielectric reflection at normal incidence; may exceed one.
    pub specular_color: Spectrum,
    /// Weight of the coat, a dielectric of index 1.5.
    pub clearcoat: f32,
    /// Perceived roughness of the coat.
    pub clearcoat_roughness: f32,
    /// Normal of the coat in the local frame, unit; +z where `None`.
    pub clearcoat_normal: Option<Vec3>,
    /// Normals of the diffuse base where a normal map tilts it; `None` for +z.
    pub diffuse_tilt: Option<DiffuseTilt>,
    /// Color and weight of the sheen.
    pub sheen_color: Spectrum,
    /// Perceived roughness of the sheen, at least 0.1.
    pub sheen_roughness: f32,
    /// Share of the dielectric that transmits instead of scattering diffusely.
    pub transmission: f32,
    /// True where the material has no volume (thickness zero): light passes without being bent. Else the surface bounds a
    /// solid that refracts with `ior`.
    pub thin_walled: bool,
    /// Weight of the thin film.
    pub iridescence: f32,
    /// Refractive index of the film.
    pub iridescence_ior: f32,
    /// Thickness of the film in nanometers.
    pub iridescence_thickness_nm: f32,
    /// Stretches highlights along the tangent turned by the rotation.
    pub anisotropy: f32,
    /// Radians, counterclockwise from the tangent (+x).
    pub anisotropy_rotation: f32,
    /// 20 over the Abbe number; solids only. Red, green and blue have an index each.
    pub dispersion: f32,
    /// Share of the diffuse light that comes out of the other side.
    pub diffuse_transmission: f32,
    /// Color of that share.
    pub diffuse_transmission_color: Spectrum,
}

impl Default for Pbr {
    fn default() -> Self {
        Self {
            base_color: Spectrum::from_rgb([1.0; 3]),
            metallic: 0.0,
            roughness: 1.0,
            ior: 1.5,
            specular: 1.0,
            specular_color: Spectrum::from_rgb([1.0; 3]),
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            clearcoat_normal: None,
            diffuse_tilt: None,
            sheen_color: Spectrum::ZERO,
            sheen_roughness: 0.0,
            transmission: 0.0,
            thin_walled: true,
            iridescence: 0.0,
            iridescence_ior: 1.3,
            iridescence_thickness_nm: 400.0,
            anisotropy: 0.0,
            anisotropy_rotation: 0.0,
            dispersion: 0.0,
            diffuse_transmission: 0.0,
            diffuse_transmission_color: Spectrum::from_rgb([1.0; 3]),
        }
    }
}

#[inline]
fn mirror_z(v: Vec3) -> Vec3 {
    Vec3::new(v.x, v.y, -v.z)
}

/// G2(wo, wi) / G1(wo) with height-correlated shadowing (Heitz 2014, equation 99): the share of what a visible normal
/// sends to `wi` that leaves.
#[inline]
fn masking_ratio(mf: &Microfacet, wo: Vec3, wi: Vec3) -> f32 {
    let (o, i) = (mf.g1_distant(wo), mf.g1_distant(wi));
    i / (o + i - o * i)
}

impl Pbr {
    /// True where light that is transmitted is refracted into a solid.
    #[inline]
    fn is_solid(&self) -> bool {
        self.transmission > 0.0 && self.metallic < 1.0 && !self.thin_walled
    }

    /// True where light that is transmitted goes straight on: the one delta lobe.
    #[inline]
    fn is_straight(&self) -> bool {
        if self.thin_walled { self.roughness * self.roughness < MIN_ALPHA } else { (self.eta() - 1.0).abs() < 1e-3 }
    }

    /// The refractive index of the dielectric.
    #[inline]
    fn eta(&self) -> f32 {
        if self.ior == 0.0 { 100.0 } else { self.ior.clamp(1.0, 100.0) }
    }

    /// The direction in the frame that has the anisotropy along x, and turned up where the back side is like the front.
    #[inline]
    fn lobe_from_local(&self, v: Vec3, mirror: bool) -> Vec3 {
        let v = if mirror { mirror_z(v) } else { v };
        if self.anisotropy <= 0.0 || self.anisotropy_rotation == 0.0 {
            return v;
        }
        let (sin, cos) = fns::sin_cos(self.anisotropy_rotation);
        Vec3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z)
    }

    #[inline]
    fn local_from_lobe(&self, v: Vec3, mirror: bool) -> Vec3 {
        let v = if mirror { mirror_z(v) } else { v };
        if self.anisotropy <= 0.0 || self.anisotropy_rotation == 0.0 {
            return v;
        }
        let (sin, cos) = fns::sin_cos(self.anisotropy_rotation);
        Vec3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z)
    }

    /// See the contract in [`crate::bsdf`].
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Spectrum {
        if wo.z == 0.0 || wi.z == 0.0 {
            return Spectrum::ZERO;
        }
        let (view, light) = if mode == TransportMode::Radiance { (wo, wi) } else { (wi, wo) };
        let Some(l) = Layers::new(self, view) else { return Spectrum::ZERO };
        let value = l.eval(self.lobe_from_local(light, l.mirrored));
        // The layers return f |cos| of the light.
        if mode == TransportMode::Radiance { value } else { value * (wi.z / wo.z).abs() }
    }

    /// See the contract in [`crate::bsdf`].
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z == 0.0 || wi.z == 0.0 {
            return 0.0;
        }
        Layers::new(self, wo).map_or(0.0, |l| l.pdf(&l.probabilities(), self.lobe_from_local(wi, l.mirrored)))
    }

    /// See the contract in [`crate::bsdf`].
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let l = Layers::new(self, wo)?;
        let p = l.probabilities();
        let mut k = 0;
        let mut rest = u_lobe;
        while k + 1 < STRATEGIES && rest >= p[k] {
            rest -= p[k];
            k += 1;
        }
        if p[k] <= 0.0 {
            return None;
        }
        let u_rest = (rest / p[k]).clamp(0.0, ONE_MINUS_EPSILON);
        let (wi, lobe, eta) = match k {
            layers::SHEEN => (warp::uniform_hemisphere(u), Lobe::DIFFUSE.union(Lobe::REFLECTION), 1.0),
            layers::DIFFUSE => (warp::cosine_hemisphere(u), Lobe::DIFFUSE.union(Lobe::REFLECTION), 1.0),
            layers::DIFFUSE_THROUGH => (mirror_z(warp::cosine_hemisphere(u)), Lobe::DIFFUSE.union(Lobe::TRANSMISSION), 1.0),
            layers::COAT => (l.sample_coat(u)?, Lobe::GLOSSY.union(Lobe::REFLECTION), 1.0),
            layers::SPECULAR => (l.sample_specular(u)?, Lobe::GLOSSY.union(Lobe::REFLECTION), 1.0),
            layers::THIN => (mirror_z(l.sample_specular(u)?), Lobe::GLOSSY.union(Lobe::TRANSMISSION), 1.0),
            layers::GLASS => l.sample_glass(u_rest, u)?,
            _ => {
                // Straight on; the value depends on the camera's side like that of all lobes.
                let value = if mode == TransportMode::Radiance { l.straight() } else { Layers::new(self, -wo)?.straight() };
                let lobe = Lobe::DELTA.union(Lobe::TRANSMISSION).union(Lobe::NULL);
                return Some(BsdfSample { wi: -wo, value, pdf: p[k], lobe, eta: 1.0 });
            }
        };
        let diffuse = matches!(k, layers::SHEEN | layers::DIFFUSE | layers::DIFFUSE_THROUGH);
        let wi = if l.inside && diffuse { -wi } else { wi };
        if wi.z == 0.0 {
            return None;
        }
        let pdf = l.pdf(&p, wi);
        if pdf <= 0.0 || pdf.is_nan() {
            return None;
        }
        let radiance = l.eval(wi);
        let wi = self.local_from_lobe(wi, l.mirrored);
        let value = if mode == TransportMode::Radiance { radiance } else { self.eval(wo, wi, mode) };
        Some(BsdfSample { wi, value, pdf, lobe, eta })
    }

    /// See the contract in [`crate::bsdf`].
    pub fn lobes(&self) -> Lobe {
        let mut lobes = Lobe::GLOSSY.union(Lobe::REFLECTION);
        let below = 1.0 - self.metallic;
        if below * (1.0 - self.transmission) > 0.0 || !self.sheen_color.is_black() {
            lobes = lobes.union(Lobe::DIFFUSE);
        }
        if below * self.transmission > 0.0 {
            lobes = lobes.union(Lobe::TRANSMISSION);
            if self.is_straight() {
                lobes = lobes.union(Lobe::DELTA).union(Lobe::NULL);
            }
        }
        if below * (1.0 - self.transmission) * self.diffuse_transmission > 0.0 {
            lobes = lobes.union(Lobe::TRANSMISSION);
        }
        lobes
    }

    /// See the contract in [`crate::bsdf`]: reflected and transmitted light together, from the albedos of the layers.
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        if wo.z == 0.0 {
            return Spectrum::ZERO;
        }
        Layers::new(self, wo).map_or(Spectrum::ZERO, |l| l.albedos().into_iter().fold(Spectrum::ZERO, |a, b| a + b).clamp(0.0, 1.0))
    }
}
