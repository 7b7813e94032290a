//! The boundary of a solid: diffuse, sheen, specular, clearcoat, refraction.

use super::Principled;
use super::terms::Gtr1;
use crate::bsdf::microfacet::Microfacet;
use crate::bsdf::{Lobe, TransportMode, fresnel};
use crate::math::fns::sqr;
use crate::math::{ONE_MINUS_EPSILON, Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// Clearcoat: a quarter of its weight times Schlick with this reflectance (Burley 2012).
const CLEARCOAT_F0: f32 = 0.04;

/// What depends on `wo` only. Everything is turned so that `wo.z` is positive.
struct View {
    wo: Vec3,
    front: bool,
    /// Index on the other side over that on the side of `wo`.
    eta: f32,
    mf: Microfacet,
    /// Share of refracting base.
    bsdf: f32,
    /// Probabilities of the cosine-weighted, the GGX and the clearcoat strategies.
    p: [f32; 3],
}

impl View {
    /// The normal that refracts or reflects `wo` to `wi`, both in turned coordinates, with `wo · m > 0` and, for refraction,
    /// `wi · m < 0`.
    fn half(&self, wi: Vec3) -> Option<Vec3> {
        let h = self.wo + wi * if wi.z > 0.0 { 1.0 } else { self.eta };
        let len2 = h.length_squared();
        if len2 <= 0.0 {
            return None;
        }
        let m = h / len2.sqrt().copysign(h.z);
        let ok = self.wo.dot(m) > 0.0 && wi.dot(m) * wi.z > 0.0 && m.z > 0.0;
        ok.then_some(m)
    }

    fn turn(&self, v: Vec3) -> Vec3 {
        if self.front { v } else { -v }
    }
}

impl Principled {
    fn view(&self, wo: Vec3) -> View {
        let front = wo.z > 0.0;
        let wo = if front { wo } else { -wo };
        let eta = if front { self.eta_safe() } else { 1.0 / self.eta_safe() };
        let bsdf = (1.0 - self.metallic) * self.spec_trans;
        let p = if front {
            let f = fresnel::dielectric(wo.z, eta).0;
            let color = self.base_color.max_component();
            let diffuse = (1.0 - self.metallic) * (color * (1.0 - self.spec_trans) * (1.0 - f) + 0.2 * self.sheen);
            let specular = self.principled_fresnel(f, wo.z, true).max_component() + bsdf * (1.0 - f) * color.max(0.0).sqrt();
            let clearcoat = 0.25 * self.clearcoat * (CLEARCOAT_F0 + (1.0 - CLEARCOAT_F0) * fresnel::schlick_weight(wo.z));
            let sum = diffuse + specular + clearcoat;
            if sum > 0.0 { [diffuse / sum, specular / sum, clearcoat / sum] } else { [0.0; 3] }
        } else {
            [0.0, f32::from(bsdf > 0.0), 0.0]
        };
        View { wo, front, eta, mf: self.distribution(self.roughness), bsdf, p }
    }

    /// Probability that the GGX strategy refracts at a facet seen under `cos`, and the reflectance there.
    fn refract_probability(&self, v: &View, cos: f32) -> (f32, f32) {
        let f = fresnel::dielectric(cos, v.eta).0;
        if v.bsdf <= 0.0 {
            return (0.0, f);
        }
        let t = v.bsdf * (1.0 - f) * self.base_color.max_component().max(0.0).sqrt();
        let r = self.principled_fresnel(f, cos, v.front).max_component();
        (if t > 0.0 { t / (t + r) } else { 0.0 }, f)
    }

    pub(super) fn eval_solid(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Spectrum {
        let v = self.view(wo);
        let wi = v.turn(wi);
        let Some(m) = v.half(wi) else { return Spectrum::ZERO };
        let cos_d = v.wo.dot(m);
        let f = fresnel::dielectric(cos_d, v.eta).0;
        if wi.z < 0.0 {
            if v.bsdf <= 0.0 {
                return Spectrum::ZERO;
            }
            // Walter et al. 2007, equation 21; the solid angle of radiance shrinks as Veach 1997, section 5.2, says.
            let scale = if mode == TransportMode::Radiance { 1.0 } else { sqr(v.eta) };
            let i = wi.dot(m);
            let value = v.mf.d(m) * v.mf.g(v.wo, wi, m) * (1.0 - f) * (cos_d * i).abs() / (v.wo.z * sqr(cos_d + v.eta * i));
            return self.base_color.map(|c| c.max(0.0).sqrt()) * (v.bsdf * scale * value);
        }
        let dg = v.mf.d(m) * v.mf.g(v.wo, wi, m) / (4.0 * v.wo.z);
        let mut value = self.principled_fresnel(f, cos_d, v.front) * dg;
        if !v.front {
            return value;
        }
        if self.clearcoat > 0.0 {
            let fc = CLEARCOAT_F0 + (1.0 - CLEARCOAT_F0) * Self::schlick_weight_eta(cos_d, v.eta);
            // Not divided by 4 cos θo cos θi: so in Mitsuba, whose numbers are the measure here.
            let c = fc * Gtr1::new(self.clearcoat_gloss).d(m) * Gtr1::g1(v.wo.z) * Gtr1::g1(wi.z) * wi.z;
            value += Spectrum::from_rgb([0.25 * self.clearcoat * c; 3]);
        }
        if self.metallic < 1.0 {
            if self.sheen > 0.0 {
                value += self.sheen_value(wi.z, cos_d) * (1.0 - self.metallic);
            }
            value += self.base_color * ((1.0 - self.metallic) * (1.0 - self.spec_trans) * self.diffuse(v.wo.z, wi.z, cos_d));
        }
        value
    }

    pub(super) fn pdf_solid(&self, wo: Vec3, wi: Vec3) -> f32 {
        let v = self.view(wo);
        let wi = v.turn(wi);
        let mut pdf = if wi.z > 0.0 { v.p[0] * warp::cosine_hemisphere_pdf(wi.z) } else { 0.0 };
        let Some(m) = v.half(wi) else { return pdf };
        let cos_d = v.wo.dot(m);
        let (q, _) = self.refract_probability(&v, cos_d);
        let ggx = v.p[1] * v.mf.pdf_visible(v.wo, m);
        if wi.z > 0.0 {
            pdf += (ggx * (1.0 - q) + v.p[2] * Gtr1::new(self.clearcoat_gloss).d(m) * m.z) / (4.0 * cos_d);
        } else {
            // Walter et al. 2007, equation 17.
            let i = wi.dot(m);
            pdf += ggx * q * sqr(v.eta) * i.abs() / sqr(cos_d + v.eta * i);
        }
        pdf
    }

    /// Direction, lobe and relative refractive index of a sample.
    pub(super) fn sample_solid(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<(Vec3, Lobe, f32)> {
        let v = self.view(wo);
        if u_lobe < v.p[0] {
            let wi = warp::cosine_hemisphere(u);
            return (wi.z > 0.0).then_some((wi, Lobe::DIFFUSE.union(Lobe::REFLECTION), 1.0));
        }
        if v.p[1] + v.p[2] <= 0.0 {
            return None;
        }
        let glossy = u_lobe < v.p[0] + v.p[1];
        let m = if glossy || v.p[2] <= 0.0 { v.mf.sample_visible_normal(v.wo, u) } else { Gtr1::new(self.clearcoat_gloss).sample(u) };
        let cos_d = v.wo.dot(m);
        if cos_d <= 0.0 {
            return None;
        }
        if glossy {
            let u = ((u_lobe - v.p[0]) / v.p[1]).min(ONE_MINUS_EPSILON);
            if u < self.refract_probability(&v, cos_d).0 {
                let (f, cos_t, _, eta_ti) = fresnel::dielectric(cos_d, v.eta);
                let wi = fresnel::refract(v.wo, m, cos_t, eta_ti).normalize();
                let ok = f < 1.0 && wi.z < 0.0;
                return ok.then_some((v.turn(wi), Lobe::GLOSSY.union(Lobe::TRANSMISSION), v.eta));
            }
        }
        let wi = (m * (2.0 * cos_d) - v.wo).normalize();
        (wi.z > 0.0).then_some((v.turn(wi), Lobe::GLOSSY.union(Lobe::REFLECTION), 1.0))
    }
}
