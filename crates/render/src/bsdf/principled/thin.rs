//! A sheet without thickness: the two-sided specular and diffuse lobes of Burley 2015 for thin surfaces.

use super::Principled;
use crate::bsdf::microfacet::Microfacet;
use crate::bsdf::{Lobe, fresnel};
use crate::math::{Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// What depends on `wo` only, turned so that `wo.z` is positive.
struct View {
    wo: Vec3,
    flip: bool,
    eta: f32,
    reflect: Microfacet,
    transmit: Microfacet,
    /// Share of diffuse light that goes through.
    through: f32,
    /// Probabilities of diffuse reflection, diffuse transmission, glossy reflection, glossy transmission.
    p: [f32; 4],
}

fn mirror_z(v: Vec3) -> Vec3 {
    Vec3::new(v.x, v.y, -v.z)
}

impl Principled {
    fn thin_view(&self, wo: Vec3) -> View {
        let flip = wo.z < 0.0;
        let wo = if flip { mirror_z(wo) } else { wo };
        let eta = self.eta_safe();
        let f = self.thin_fresnel(fresnel::dielectric(wo.z, eta).0, wo.z).max_component();
        let through = 0.5 * self.diff_trans.clamp(0.0, 2.0);
        let color = self.base_color.max_component();
        let diffuse = 1.0 - self.spec_trans;
        let w = [
            diffuse * (1.0 - through) * (color + 0.2 * self.sheen),
            diffuse * through * color,
            self.spec_trans * f,
            self.spec_trans * (1.0 - f).max(0.05) * color,
        ];
        let sum = w[0] + w[1] + w[2] + w[3];
        let p = if sum > 0.0 { w.map(|w| w / sum) } else { [0.0; 4] };
        // Light that crosses two rough faces spreads less at low indices (Burley 2015).
        let transmit = self.distribution(self.roughness * (0.65 * eta - 0.35).clamp(0.0, 1e3));
        View { wo, flip, eta, reflect: self.distribution(self.roughness), transmit, through, p }
    }

    /// Reflectance of the sheet, tinted by `spec_tint`.
    fn thin_fresnel(&self, f: f32, cos: f32) -> Spectrum {
        if self.spec_tint <= 0.0 {
            return Spectrum::splat(f);
        }
        let f0 = self.tint() * fresnel::f0_from_eta(self.eta_safe());
        let tinted = f0 + (Spectrum::ONE - f0) * Self::schlick_weight_eta(cos, self.eta_safe());
        Spectrum::splat(f).lerp(tinted, self.spec_tint)
    }

    pub(super) fn eval_thin(&self, wo: Vec3, wi: Vec3) -> Spectrum {
        let v = self.thin_view(wo);
        let wi = if v.flip { mirror_z(wi) } else { wi };
        let through = wi.z < 0.0;
        let wi = if through { mirror_z(wi) } else { wi };
        let m = (v.wo + wi).normalize();
        let cos_d = v.wo.dot(m);
        let mut value = Spectrum::ZERO;
        // As in Mitsuba, a facet transmits only to directions behind it, although the lobe is a mirrored reflection.
        if self.spec_trans > 0.0 && cos_d > 0.0 && !(through && mirror_z(wi).dot(m) >= 0.0) {
            let f = fresnel::dielectric(cos_d, v.eta).0;
            let (mf, color) = if through { (&v.transmit, self.base_color * (1.0 - f)) } else { (&v.reflect, self.thin_fresnel(f, cos_d)) };
            value += color * (self.spec_trans * mf.d(m) * mf.g(v.wo, wi, m) / (4.0 * v.wo.z));
        }
        let diffuse = 1.0 - self.spec_trans;
        if through {
            value += self.base_color * (diffuse * v.through * warp::cosine_hemisphere_pdf(wi.z));
        } else if v.through < 1.0 {
            let share = diffuse * (1.0 - v.through);
            value += self.base_color * (share * self.diffuse(v.wo.z, wi.z, cos_d));
            if self.sheen > 0.0 {
                value += self.sheen_value(wi.z, cos_d) * share;
            }
        }
        value
    }

    pub(super) fn pdf_thin(&self, wo: Vec3, wi: Vec3) -> f32 {
        let v = self.thin_view(wo);
        let wi = if v.flip { mirror_z(wi) } else { wi };
        let (wi, mf, diffuse, glossy) =
            if wi.z < 0.0 { (mirror_z(wi), &v.transmit, v.p[1], v.p[3]) } else { (wi, &v.reflect, v.p[0], v.p[2]) };
        let m = (v.wo + wi).normalize();
        let cos_d = v.wo.dot(m);
        let ggx = if cos_d > 0.0 { mf.pdf_visible(v.wo, m) / (4.0 * cos_d) } else { 0.0 };
        diffuse * warp::cosine_hemisphere_pdf(wi.z) + glossy * ggx
    }

    /// Direction, lobe and relative refractive index of a sample.
    pub(super) fn sample_thin(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<(Vec3, Lobe, f32)> {
        let v = self.thin_view(wo);
        let mut k = 0;
        let mut cdf = v.p[0];
        while k < 3 && u_lobe >= cdf {
            k += 1;
            cdf += v.p[k];
        }
        if v.p[k] <= 0.0 {
            return None;
        }
        let (wi, kind) = if k < 2 {
            (warp::cosine_hemisphere(u), Lobe::DIFFUSE)
        } else {
            let mf = if k == 2 { &v.reflect } else { &v.transmit };
            let m = mf.sample_visible_normal(v.wo, u);
            ((m * (2.0 * v.wo.dot(m)) - v.wo).normalize(), Lobe::GLOSSY)
        };
        if wi.z <= 0.0 {
            return None;
        }
        let through = k % 2 == 1;
        let side = if through { Lobe::TRANSMISSION } else { Lobe::REFLECTION };
        Some((if through != v.flip { mirror_z(wi) } else { wi }, kind.union(side), 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_of_a_sheet_look_alike() {
        let b = Principled { thin: true, spec_trans: 0.5, diff_trans: 0.7, ..Default::default() };
        let (wo, wi) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.48, 0.36, -0.8));
        let a = b.eval_thin(wo, wi);
        assert_eq!(a, b.eval_thin(mirror_z(wo), mirror_z(wi)));
        assert!(a.luminance() > 0.0);
    }
}
