//! The factors that both forms of the model share.

use super::Principled;
use crate::bsdf::fresnel::{self, schlick_weight};
use crate::bsdf::microfacet::{Distribution, Microfacet};
use crate::math::fns::{self, safe_sqrt, sqr};
use crate::math::{INV_PI, PI, TAU, Vec2, Vec3};
use crate::spectrum::Spectrum;

impl Principled {
    /// GGX for a perceived roughness (Burley 2012, specular D).
    #[inline]
    pub(super) fn distribution(&self, roughness: f32) -> Microfacet {
        let alpha = sqr(roughness);
        let aspect = safe_sqrt(1.0 - 0.9 * self.anisotropic);
        Microfacet::new(Distribution::Ggx, (alpha / aspect).max(1e-3), (alpha * aspect).max(1e-3))
    }

    /// The base color without its luminance; white where it is black.
    #[inline]
    pub(super) fn tint(&self) -> Spectrum {
        let lum = self.base_color.luminance();
        if lum > 0.0 { self.base_color / lum } else { Spectrum::ONE }
    }

    /// Diffuse reflection with retro-reflection, blended with the subsurface approximation by `flatness`
    /// (Burley 2015, diffuse and retro-reflection; Burley 2012, section 5.3), without the color and with the cosine of `cos_i`.
    /// `cos_d` is the cosine between the light and the half vector.
    #[inline]
    pub(super) fn diffuse(&self, cos_o: f32, cos_i: f32, cos_d: f32) -> f32 {
        let (fo, fi) = (schlick_weight(cos_o), schlick_weight(cos_i));
        let rr = 2.0 * self.roughness * cos_d * cos_d;
        let mut f = (1.0 - 0.5 * fo) * (1.0 - 0.5 * fi) + rr * (fo + fi + fo * fi * (rr - 1.0));
        if self.flatness > 0.0 {
            let fss90 = 0.5 * rr;
            let fss = fns::lerp(fo, 1.0, fss90) * fns::lerp(fi, 1.0, fss90);
            let ss = 1.25 * (fss * (1.0 / (cos_o + cos_i) - 0.5) + 0.5);
            f = fns::lerp(self.flatness, f, ss);
        }
        f * INV_PI * cos_i
    }

    /// Sheen (Burley 2012), with the cosine of `cos_i`.
    #[inline]
    pub(super) fn sheen_value(&self, cos_i: f32, cos_d: f32) -> Spectrum {
        let color = Spectrum::ONE.lerp(self.tint(), self.sheen_tint);
        color * (self.sheen * schlick_weight(cos_d) * cos_i)
    }

    /// The weight of Schlick's grazing reflectance; seen from the denser side the cosine of the thinner side counts.
    #[inline]
    pub(super) fn schlick_weight_eta(cos_o: f32, eta: f32) -> f32 {
        if eta > 1.0 { schlick_weight(cos_o) } else { schlick_weight(safe_sqrt(1.0 - (1.0 - sqr(cos_o)) / sqr(eta))) }
    }

    /// Reflectance of the microfacets of the main lobe; `f` is the dielectric one at the same cosine. Seen from
    /// inside (`front` false), the metal is not there.
    #[inline]
    pub(super) fn principled_fresnel(&self, f: f32, cos: f32, front: bool) -> Spectrum {
        let dielectric = 1.0 - self.metallic;
        if !front {
            return Spectrum::splat(dielectric * self.spec_trans * f);
        }
        let eta = self.eta_safe();
        let w = Self::schlick_weight_eta(cos, eta);
        let toward_white = |f0: Spectrum| f0 + (Spectrum::ONE - f0) * w;
        let mut r = Spectrum::splat(dielectric * (1.0 - self.spec_tint) * f);
        if self.metallic > 0.0 {
            r += toward_white(self.base_color) * self.metallic;
        }
        if self.spec_tint > 0.0 {
            r += toward_white(self.tint() * fresnel::f0_from_eta(eta)) * (dielectric * self.spec_tint);
        }
        r
    }
}

/// The distribution of the clearcoat: GTR with exponent 1 (Burley 2012, appendix B).
pub(super) struct Gtr1 {
    alpha: f32,
}

impl Gtr1 {
    pub(super) fn new(gloss: f32) -> Self {
        Self { alpha: fns::lerp(gloss, 0.1, 0.001) }
    }

    /// D(m).
    pub(super) fn d(&self, m: Vec3) -> f32 {
        let a2 = sqr(self.alpha);
        if m.z <= 0.0 { 0.0 } else { (a2 - 1.0) / (PI * fns::ln(a2) * (m.x * m.x + m.y * m.y + a2 * m.z * m.z)) }
    }

    /// A normal with density D(m) m.z (Burley 2012, appendix B).
    pub(super) fn sample(&self, u: Vec2) -> Vec3 {
        let a2 = sqr(self.alpha);
        let z2 = (1.0 - fns::pow(a2, 1.0 - u.x)) / (1.0 - a2);
        let r = safe_sqrt(1.0 - z2);
        let (sin, cos) = fns::sin_cos(TAU * u.y);
        Vec3::new(r * cos, r * sin, safe_sqrt(z2))
    }

    /// Smith's masking with the fixed roughness 0.25.
    pub(super) fn g1(cos: f32) -> f32 {
        let a2 = 0.25 * 0.25;
        2.0 * cos / (cos + safe_sqrt(a2 + (1.0 - a2) * cos * cos))
    }
}
