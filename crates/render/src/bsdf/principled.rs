//! The "principled" model of Disney with the parameters and the meaning that Mitsuba 3 gives them.
//!
//! Burley 2012, "Physically Based Shading at Disney" (diffuse, sheen, specular, clearcoat) and Burley 2015, "Extending the
//! Disney BRDF to a BSDF with Integrated Subsurface Scattering" (transmission, flatness, thin surfaces), SIGGRAPH course
//! notes. The lobes are added, not layered: the model may lose up to half of the light at high roughness and gain some at
//! grazing angles with sheen and clearcoat. Use [`super::Pbr`] where energy must be kept.
//!
//! [`Principled::thin`] picks between the interface of a solid ([`solid`]) and a sheet without thickness ([`thin`]).

mod solid;
mod terms;
mod thin;

use super::{BsdfSample, Lobe, TransportMode, fresnel};
use crate::math::{Vec2, Vec3};
use crate::spectrum::Spectrum;

/// Disney's principled model. Everything in [0, 1] unless said otherwise; [`Principled::default`] is Mitsuba's default.
#[derive(Clone, Debug)]
pub struct Principled {
    /// Color of the diffuse, metallic and transmitted light.
    pub base_color: Spectrum,
    /// Perceived roughness; alpha of GGX is its square, at least 0.001.
    pub roughness: f32,
    /// 0: round highlights, 1: highlights stretched along x.
    pub anisotropic: f32,
    /// Blend from dielectric to metal. Solid only.
    pub metallic: f32,
    /// Share of light that goes through instead of being scattered diffusely.
    pub spec_trans: f32,
    /// Refractive index inside over outside, more than zero; see [`Principled::eta_from_specular`].
    pub eta: f32,
    /// Tint of the dielectric reflection towards the hue of the base color.
    pub spec_tint: f32,
    /// Weight of the grazing retro-reflection of cloth.
    pub sheen: f32,
    /// Tint of the sheen towards the hue of the base color.
    pub sheen_tint: f32,
    /// Blend from the diffuse model to the approximation of subsurface scattering.
    pub flatness: f32,
    /// Weight of the second specular lobe. Solid only.
    pub clearcoat: f32,
    /// 0: satin, 1: gloss. Solid only.
    pub clearcoat_gloss: f32,
    /// In [0, 2]: 1 sends as much diffuse light through as back, 2 all of it. Thin only.
    pub diff_trans: f32,
    /// A sheet without thickness instead of the boundary of a solid.
    pub thin: bool,
}

impl Default for Principled {
    fn default() -> Self {
        Self {
            base_color: Spectrum::from_rgb([0.5; 3]),
            roughness: 0.5,
            anisotropic: 0.0,
            metallic: 0.0,
            spec_trans: 0.0,
            eta: 1.5,
            spec_tint: 0.0,
            sheen: 0.0,
            sheen_tint: 0.0,
            flatness: 0.0,
            clearcoat: 0.0,
            clearcoat_gloss: 0.0,
            diff_trans: 0.0,
            thin: false,
        }
    }
}

impl Principled {
    /// The refractive index for Disney's `specular` in [0, 1]: a reflectance of 8 % of it at normal incidence.
    #[inline]
    pub fn eta_from_specular(specular: f32) -> f32 {
        fresnel::eta_from_f0(0.08 * specular.clamp(0.0, 1.0))
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Spectrum {
        if wo.z == 0.0 || wi.z == 0.0 {
            Spectrum::ZERO
        } else if self.thin {
            self.eval_thin(wo, wi)
        } else {
            self.eval_solid(wo, wi, mode)
        }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wo.z == 0.0 || wi.z == 0.0 {
            0.0
        } else if self.thin {
            self.pdf_thin(wo, wi)
        } else {
            self.pdf_solid(wo, wi)
        }
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let (wi, lobe, eta) = if self.thin { self.sample_thin(wo, u_lobe, u)? } else { self.sample_solid(wo, u_lobe, u)? };
        let pdf = self.pdf(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, value: self.eval(wo, wi, mode), pdf, lobe, eta })
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn lobes(&self) -> Lobe {
        let through = self.spec_trans > 0.0 && (self.thin || self.metallic < 1.0);
        let glossy = !self.thin || through;
        let diffuse = self.spec_trans < 1.0 && (self.thin || self.metallic < 1.0) || self.sheen > 0.0;
        let mut lobes = Lobe::REFLECTION;
        if glossy {
            lobes = lobes.union(Lobe::GLOSSY);
        }
        if diffuse {
            lobes = lobes.union(Lobe::DIFFUSE);
        }
        if through || self.thin && self.diff_trans > 0.0 {
            lobes = lobes.union(Lobe::TRANSMISSION);
        }
        lobes
    }

    /// See the contract in [`crate::bsdf`].
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Spectrum {
        let cos = wo.z.abs().min(1.0);
        if self.thin {
            // Reflection and transmission of the sheet add to one, the latter colored.
            let f = fresnel::dielectric(cos, self.eta_safe()).0;
            let specular = Spectrum::splat(f) + self.base_color * (1.0 - f);
            return (self.base_color.lerp(specular, self.spec_trans)).clamp(0.0, 1.0);
        }
        let f = fresnel::dielectric(wo.z, self.eta_safe()).0;
        let specular = self.principled_fresnel(f, cos, wo.z > 0.0);
        if wo.z <= 0.0 {
            let through = self.base_color.map(f32::sqrt) * ((1.0 - self.metallic) * self.spec_trans * (1.0 - f));
            return (specular + through).clamp(0.0, 1.0);
        }
        let below = self.base_color.lerp(self.base_color.map(f32::sqrt), self.spec_trans) * ((1.0 - self.metallic) * (1.0 - f));
        (specular + below).clamp(0.0, 1.0)
    }

    /// The refractive index, kept away from one where the half vector of refraction has no direction.
    #[inline]
    fn eta_safe(&self) -> f32 {
        if (self.eta - 1.0).abs() < 1e-3 { 1.001 } else { self.eta.max(1e-3) }
    }
}
