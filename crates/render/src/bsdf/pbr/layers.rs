//! What a view direction sees: the layers with their albedos, and the lobes.

use super::sheen::Sheen;
use super::tables::{glass_albedo, tables};
use super::{MIN_ALPHA, Pbr, iridescence, masking_ratio, mirror_z};
use crate::bsdf::microfacet::{Distribution, Microfacet};
use crate::bsdf::{Lobe, fresnel};
use crate::math::fns::{lerp, sqr};
use crate::math::{Frame, INV_PI, Vec2, Vec3, warp};
use crate::spectrum::Spectrum;

/// Sampling strategies, in the order of the probabilities.
pub(super) const SHEEN: usize = 0;
pub(super) const COAT: usize = 1;
pub(super) const SPECULAR: usize = 2;
pub(super) const GLASS: usize = 3;
pub(super) const DIFFUSE: usize = 4;
pub(super) const DIFFUSE_THROUGH: usize = 5;
pub(super) const THIN: usize = 6;
const STRAIGHT: usize = 7;
pub(super) const STRATEGIES: usize = 8;

/// Refractive index of the clearcoat (KHR_materials_clearcoat).
const COAT_IOR: f32 = 1.5;

struct Coat {
    mf: Microfacet,
    frame: Frame,
    /// The view in the coat's frame, above it.
    view: Vec3,
    weight: f32,
    /// Directional albedo with the weight.
    albedo: f32,
}

/// The material seen from a direction. Directions are in the lobe frame; `view.z` is positive unless `inside`, where
/// it is positive too but every direction is negated.
pub(super) struct Layers<'a> {
    b: &'a Pbr,
    view: Vec3,
    /// The back side of a thin material: the caller mirrors directions at the surface.
    pub mirrored: bool,
    /// Normals of the diffuse base in the lobe frame.
    diffuse_tilt: Option<super::DiffuseTilt>,
    /// The view is in the solid.
    pub inside: bool,
    sheen: Option<Sheen>,
    sheen_albedo: Spectrum,
    coat: Option<Coat>,
    /// Share of light that reaches the base.
    below: f32,
    mf: Microfacet,
    /// Refractive index of the dielectric, its reflectance at normal incidence without and with color, and at grazing.
    eta: f32,
    r0: f32,
    f0: Spectrum,
    f90: f32,
    /// Metal and dielectric reflection: gain by multiple scattering and albedo with it.
    metal: (Spectrum, Spectrum),
    dielectric: (Spectrum, Spectrum),
    /// Share of light below the dielectric interface.
    under_dielectric: f32,
    /// Albedo of the lobe with perfectly reflecting facets.
    e: f32,
    /// Gain of the glass by multiple scattering.
    glass_gain: Spectrum,
}

/// Gain of a lobe by multiple scattering when the facets reflect `avg` on the mean (Kulla and Conty 2017, with the
/// form of Turquin 2019: the whole lobe is scaled).
#[inline]
fn multiple_scattering(e: f32, e_avg: f32, avg: Spectrum) -> Spectrum {
    let missing = (1.0 - e).max(0.0) / e;
    // Colors beyond one, from careless files, must not make the sum of all bounces diverge.
    avg.clamp(0.0, 1.0).map(|f| 1.0 + missing * f * e_avg / (1.0 - f * (1.0 - e_avg)))
}

impl<'a> Layers<'a> {
    /// `None` where the material is black from this side.
    #[inline]
    pub(super) fn new(b: &'a Pbr, wo: Vec3) -> Option<Self> {
        let back = wo.z < 0.0;
        let solid = b.is_solid();
        let through = b.metallic < 1.0 && (b.transmission > 0.0 || b.diffuse_transmission > 0.0);
        if back && !through {
            return None;
        }
        let (inside, mirrored) = (back && solid, back && !solid);
        let view = b.lobe_from_local(wo, mirrored);
        let view = if inside { -view } else { view };
        let alpha = sqr(b.roughness);
        // KHR_materials_anisotropy.
        let alpha_t = lerp(sqr(b.anisotropy), alpha, 1.0);
        let mf = Microfacet::new(Distribution::Ggx, alpha_t.max(MIN_ALPHA), alpha.max(MIN_ALPHA));
        let roughness = if b.anisotropy > 0.0 { (mf.alpha_x * mf.alpha_y).sqrt().sqrt() } else { b.roughness };
        let eta = b.eta();
        let r0 = fresnel::f0_from_eta(eta);
        let mut l = Self {
            b,
            view,
            mirrored,
            diffuse_tilt: b
                .diffuse_tilt
                .map(|t| super::DiffuseTilt { base: b.lobe_from_local(t.base, mirrored), normal: b.lobe_from_local(t.normal, mirrored) }),
            inside,
            sheen: None,
            sheen_albedo: Spectrum::ZERO,
            coat: None,
            below: 1.0,
            mf,
            eta,
            r0,
            f0: b.specular_color.map(|c| (c * r0).min(1.0)) * b.specular,
            f90: b.specular,
            metal: (Spectrum::ONE, Spectrum::ZERO),
            dielectric: (Spectrum::ONE, Spectrum::ZERO),
            under_dielectric: 1.0,
            e: 1.0,
            glass_gain: Spectrum::ONE,
        };
        if solid && !b.is_straight() {
            let [e, e_avg, f_avg] = glass_albedo(view.z, roughness, if inside { 1.0 / eta } else { eta });
            // Each further facet reflects without color or transmits with the tint.
            l.glass_gain = multiple_scattering(e.max(0.1), e_avg, l.glass_tint().map(|t| lerp(f_avg, t, 1.0)));
        }
        if inside {
            return Some(l);
        }
        if !b.sheen_color.is_black() {
            let sheen = Sheen::new(b.sheen_roughness);
            l.sheen_albedo = b.sheen_color * sheen.albedo(view.z);
            l.below *= (1.0 - l.sheen_albedo.max_component()).max(0.0);
            l.sheen = Some(sheen);
        }
        if b.clearcoat > 0.0 {
            l.coat = l.coat_layer();
            l.below *= 1.0 - l.coat.as_ref().map_or(0.0, |c| c.albedo);
        }
        if b.metallic <= 0.0 && l.shares().1 <= 0.0 {
            // All glass.
            return Some(l);
        }
        let a = tables().lookup(view.z, roughness, eta);
        l.e = a.e;
        // For a film, Schlick's curve through its reflectance under the view stands in for the mean.
        let film = |f0: Spectrum, f90: f32, s: f32, plain: Spectrum| {
            if b.iridescence <= 0.0 {
                return plain;
            }
            let w = fresnel::schlick_weight(view.z);
            let r = iridescence::reflectance(view.z, f0, b.iridescence_ior, b.iridescence_thickness_nm);
            let r0 = r.map(|r| ((r - w) / (1.0 - w).max(1e-3)).clamp(0.0, 1.0));
            plain.lerp((r0 + (Spectrum::ONE - r0) * s) * f90, b.iridescence)
        };
        if b.metallic > 0.0 {
            let f0 = b.base_color;
            let plain = |s| f0 + (Spectrum::ONE - f0) * s;
            let gain = multiple_scattering(a.e, a.e_avg, film(f0, 1.0, 1.0 / 21.0, plain(1.0 / 21.0)));
            l.metal = (gain, film(f0, 1.0, a.schlick, plain(a.schlick)) * gain * a.e);
        }
        if b.metallic < 1.0 {
            let (f0, f90) = (l.f0, l.f90);
            let plain = |s| f0 + (Spectrum::splat(f90) - f0) * s;
            let gain = multiple_scattering(a.e, a.e_avg, film(f0, f90, 1.0 / 21.0, plain(a.dielectric_avg)));
            l.dielectric = (gain, film(f0, f90, a.schlick, plain(a.dielectric)) * gain * a.e);
            l.under_dielectric = (1.0 - l.dielectric.1.max_component()).max(0.0);
        }
        Some(l)
    }

    fn coat_layer(&self) -> Option<Coat> {
        let b = self.b;
        let alpha = sqr(b.clearcoat_roughness).max(MIN_ALPHA);
        let frame = match b.clearcoat_normal {
            Some(n) => Frame::from_normal(b.lobe_from_local(n, false)),
            None => Frame { s: Vec3::X, t: Vec3::Y, n: Vec3::Z },
        };
        let view = frame.local_from_world(self.view);
        if view.z <= 0.0 {
            return None;
        }
        let a = tables().lookup(view.z, alpha.sqrt(), COAT_IOR);
        let f0 = fresnel::f0_from_eta(COAT_IOR);
        let albedo = b.clearcoat * a.e * lerp(a.dielectric, f0, 1.0);
        Some(Coat { mf: Microfacet::isotropic(Distribution::Ggx, alpha), frame, view, weight: b.clearcoat, albedo })
    }

    /// Reflectance of the facets of the dielectric at the cosine `cos`, `eta` being the index of the far side.
    #[inline]
    fn dielectric_fresnel(&self, cos: f32, eta: f32) -> Spectrum {
        let (f0, f90) = (self.f0, self.f90);
        let f = fresnel::dielectric(cos, eta).0;
        if f >= 1.0 {
            return Spectrum::ONE;
        }
        // The real curve between the two, F0 being the same from both sides and, nearly, for all colors.
        let s = ((f - self.r0) / (1.0 - self.r0)).clamp(0.0, 1.0);
        self.with_film(f0 + (Spectrum::splat(f90) - f0) * s, cos, f0, f90)
    }

    #[inline]
    fn with_film(&self, f: Spectrum, cos: f32, f0: Spectrum, f90: f32) -> Spectrum {
        let b = self.b;
        if b.iridescence <= 0.0 {
            return f;
        }
        f.lerp(iridescence::reflectance(cos, f0, b.iridescence_ior, b.iridescence_thickness_nm) * f90, b.iridescence)
    }

    /// The share of the base that is glass, the rest of the dielectric, and the share of thin transmission.
    fn shares(&self) -> (f32, f32) {
        let b = self.b;
        let dielectric = 1.0 - b.metallic;
        if b.thin_walled { (0.0, dielectric) } else { (dielectric * b.transmission, dielectric * (1.0 - b.transmission)) }
    }

    /// Share and color of the diffuse light below the interfaces, reflected and let through.
    fn diffuse(&self) -> [Spectrum; 2] {
        let b = self.b;
        let share = (1.0 - b.metallic) * (1.0 - b.transmission);
        let through = b.diffuse_transmission;
        if self.inside {
            // From inside there is no interface above; without diffuse transmission the opaque share is black.
            let open = if through > 0.0 { share } else { 0.0 };
            return [b.base_color * (open * (1.0 - through)), b.diffuse_transmission_color * (open * through)];
        }
        let share = share * self.below * self.under_dielectric;
        [b.base_color * (share * (1.0 - through)), b.diffuse_transmission_color * (share * through)]
    }

    /// Color of the thin transmission with all that is above it.
    fn thin(&self) -> Spectrum {
        if !self.b.thin_walled {
            return Spectrum::ZERO;
        }
        self.b.base_color * ((1.0 - self.b.metallic) * self.b.transmission * self.below * self.under_dielectric)
    }

    /// The factor of the delta lobe.
    pub(super) fn straight(&self) -> Spectrum {
        if !self.b.is_straight() {
            return Spectrum::ZERO;
        }
        if self.b.thin_walled { self.thin() } else { self.glass_tint() * (self.shares().0 * self.below) }
    }

    /// The tint per crossing: light that enters and leaves takes the base color.
    fn glass_tint(&self) -> Spectrum {
        self.b.base_color.map(|c| c.max(0.0).sqrt())
    }

    /// Index of the far side over that of the view's for a color channel (KHR_materials_dispersion: n_F − n_C = (n − 1) / V).
    fn glass_eta(&self, channel: usize) -> f32 {
        let n = self.eta;
        let n = (n + (channel as f32 - 1.0) * 0.025 * self.b.dispersion * (n - 1.0)).max(1.001);
        if self.inside { 1.0 / n } else { n }
    }

    fn channels(&self) -> std::ops::RangeInclusive<usize> {
        if self.b.dispersion > 0.0 { 0..=2 } else { 1..=1 }
    }

    /// Albedos by strategy, for the AOV and the probabilities.
    pub(super) fn albedos(&self) -> [Spectrum; STRATEGIES] {
        let mut a = [Spectrum::ZERO; STRATEGIES];
        let (glass, opaque) = self.shares();
        let [diffuse, through] = self.diffuse();
        a[DIFFUSE] = diffuse;
        a[DIFFUSE_THROUGH] = through;
        a[if self.b.is_straight() { STRAIGHT } else { THIN }] = self.thin();
        if glass > 0.0 {
            if self.b.is_straight() {
                a[STRAIGHT] = self.straight();
            } else {
                let f = self.dielectric_fresnel(self.view.z, self.glass_eta(1));
                a[GLASS] = (f + (Spectrum::ONE - f) * self.glass_tint()) * (glass * self.below);
            }
        }
        if self.inside {
            return a;
        }
        a[SHEEN] = self.sheen_albedo;
        let under_sheen = 1.0 - self.sheen_albedo.max_component();
        a[COAT] = self.coat.as_ref().map_or(Spectrum::ZERO, |c| Spectrum::from_rgb([c.albedo * under_sheen; 3]));
        a[SPECULAR] = (self.metal.1 * self.b.metallic + self.dielectric.1 * opaque) * self.below;
        a
    }

    /// Probabilities of the strategies, which add to one or are all zero.
    pub(super) fn probabilities(&self) -> [f32; STRATEGIES] {
        // Half luminance, half mean: blue lobes are not starved.
        let w = self.albedos().map(|a| 0.5 * (a.luminance() + a.average()).max(0.0));
        let sum: f32 = w.iter().sum();
        if sum > 0.0 && sum.is_finite() { w.map(|w| w / sum) } else { [0.0; STRATEGIES] }
    }

    #[inline]
    fn half(&self, light: Vec3) -> Vec3 {
        (self.view + light).normalize()
    }

    /// D G2 / (4 cos θo) of the base for reflection, `m` being the half vector.
    #[inline]
    fn base_dg(&self, light: Vec3, m: Vec3) -> f32 {
        self.mf.d(m) * self.mf.g1_distant(self.view) * masking_ratio(&self.mf, self.view, light) / (4.0 * self.view.z)
    }

    /// f |cos| of the light for a direction in the lobe frame.
    pub(super) fn eval(&self, light: Vec3) -> Spectrum {
        let light = if self.inside { -light } else { light };
        let [diffuse, diffuse_through] = self.diffuse();
        let (glass, opaque) = self.shares();
        let rough_glass = glass > 0.0 && !self.b.is_straight();
        if light.z < 0.0 {
            let mut value = diffuse_through * (INV_PI * -light.z);
            if rough_glass {
                value += self.glass_through(light) * (glass * self.below);
            }
            if self.b.transmission > 0.0 && self.b.thin_walled && !self.b.is_straight() {
                // A reflection folded to the other side, with all light that enters coming out.
                let up = mirror_z(light);
                value += self.thin() * (self.base_dg(up, self.half(up)) / self.e);
            }
            return value;
        }
        let cos_diffuse = self.diffuse_tilt.map_or(light.z, |t| t.cosine(light));
        let mut value = diffuse * (INV_PI * cos_diffuse);
        let m = self.half(light);
        let cos = self.view.dot(m).min(1.0);
        let dg = self.base_dg(light, m);
        if rough_glass {
            value += self.dielectric_fresnel(cos, self.glass_eta(1)) * self.glass_gain * (glass * self.below * dg);
        }
        if self.inside {
            return value;
        }
        let mut specular = Spectrum::ZERO;
        if self.b.metallic > 0.0 {
            let f0 = self.b.base_color;
            let f = self.with_film(fresnel::schlick(cos, f0), cos, f0, 1.0);
            specular += f * self.metal.0 * self.b.metallic;
        }
        if opaque > 0.0 {
            specular += self.dielectric_fresnel(cos, self.eta) * self.dielectric.0 * opaque;
        }
        value += specular * (dg * self.below);
        if let Some(c) = &self.coat {
            let light = c.frame.local_from_world(light);
            if light.z > 0.0 {
                let m = (c.view + light).normalize();
                let f = fresnel::dielectric(c.view.dot(m).min(1.0), COAT_IOR).0;
                let dg = c.mf.d(m) * c.mf.g1_distant(c.view) * masking_ratio(&c.mf, c.view, light) / (4.0 * c.view.z);
                let under_sheen = 1.0 - self.sheen_albedo.max_component();
                value += Spectrum::from_rgb([c.weight * f * dg * under_sheen; 3]);
            }
        }
        if let Some(s) = &self.sheen {
            value += self.b.sheen_color * s.eval(self.view, light);
        }
        value
    }

    /// The facet that refracts the view to `light`, with the cosines to both.
    fn refracting_facet(&self, light: Vec3, eta: f32) -> Option<(Vec3, f32, f32)> {
        let h = self.view + light * eta;
        let len2 = h.length_squared();
        if len2 <= 0.0 {
            return None;
        }
        let m = h / len2.sqrt().copysign(h.z);
        let (o, i) = (self.view.dot(m), light.dot(m));
        (o > 0.0 && i < 0.0).then_some((m, o, i))
    }

    /// Refraction into `light` below (Walter et al. 2007, equation 21), radiance scaled by the squared ratio of indices.
    fn glass_through(&self, light: Vec3) -> Spectrum {
        let tint = self.glass_tint() * self.glass_gain;
        let mut value = [0.0; 3];
        for k in self.channels() {
            let eta = self.glass_eta(k);
            let Some((m, o, i)) = self.refracting_facet(light, eta) else { continue };
            let g = self.mf.g1_distant(self.view) * masking_ratio(&self.mf, self.view, light);
            let v = self.mf.d(m) * g * (o * i).abs() / (self.view.z * sqr(o + eta * i));
            let t = (Spectrum::ONE - self.dielectric_fresnel(o.min(1.0), eta)) * tint * v;
            if self.b.dispersion > 0.0 { value[k] = t[k] } else { value = t.rgb() }
        }
        Spectrum::from_rgb(value)
    }

    /// The density of all strategies but the delta lobe.
    pub(super) fn pdf(&self, p: &[f32; STRATEGIES], light: Vec3) -> f32 {
        let light = if self.inside { -light } else { light };
        if light.z < 0.0 {
            let mut pdf = p[DIFFUSE_THROUGH] * warp::cosine_hemisphere_pdf(-light.z);
            if p[THIN] > 0.0 {
                pdf += p[THIN] * self.reflection_pdf(mirror_z(light));
            }
            if p[GLASS] > 0.0 {
                let (mut sum, mut n) = (0.0, 0.0);
                for k in self.channels() {
                    n += 1.0;
                    let eta = self.glass_eta(k);
                    let Some((m, o, i)) = self.refracting_facet(light, eta) else { continue };
                    // Walter et al. 2007, equation 17.
                    let jacobian = sqr(eta) * i.abs() / sqr(o + eta * i);
                    sum += (1.0 - self.reflect_probability(o.min(1.0), eta)) * self.mf.pdf_visible(self.view, m) * jacobian;
                }
                pdf += p[GLASS] * sum / n;
            }
            return pdf;
        }
        let mut pdf = p[DIFFUSE] * warp::cosine_hemisphere_pdf(light.z) + p[SHEEN] * warp::UNIFORM_HEMISPHERE_PDF;
        if p[SPECULAR] + p[GLASS] > 0.0 {
            let mut share = p[SPECULAR];
            if p[GLASS] > 0.0 {
                let cos = self.view.dot(self.half(light)).min(1.0);
                let (mut sum, mut n) = (0.0, 0.0);
                for k in self.channels() {
                    n += 1.0;
                    sum += self.reflect_probability(cos, self.glass_eta(k));
                }
                share += p[GLASS] * sum / n;
            }
            pdf += share * self.reflection_pdf(light);
        }
        if let Some(c) = &self.coat
            && p[COAT] > 0.0
        {
            let light = c.frame.local_from_world(light);
            if light.z > 0.0 {
                let m = (c.view + light).normalize();
                pdf += p[COAT] * c.mf.pdf_visible(c.view, m) / (4.0 * c.view.dot(m)).max(1e-12);
            }
        }
        pdf
    }

    #[inline]
    fn reflection_pdf(&self, light: Vec3) -> f32 {
        let m = self.half(light);
        self.mf.pdf_visible(self.view, m) / (4.0 * self.view.dot(m)).max(1e-12)
    }

    /// Probability that the glass strategy reflects at a facet.
    fn reflect_probability(&self, cos: f32, eta: f32) -> f32 {
        let f = self.dielectric_fresnel(cos, eta);
        let t = (Spectrum::ONE - f) * self.glass_tint();
        let (r, t) = (f.average(), t.average());
        if r + t > 0.0 { r / (r + t) } else { 1.0 }
    }

    pub(super) fn sample_specular(&self, u: Vec2) -> Option<Vec3> {
        let wi = fresnel::reflect(self.view, self.mf.sample_visible_normal(self.view, u)).normalize();
        (wi.z > 0.0).then_some(wi)
    }

    pub(super) fn sample_coat(&self, u: Vec2) -> Option<Vec3> {
        let c = self.coat.as_ref()?;
        let wi = fresnel::reflect(c.view, c.mf.sample_visible_normal(c.view, u)).normalize();
        let wi_base = c.frame.world_from_local(wi);
        (wi.z > 0.0 && wi_base.z > 0.0).then_some(wi_base)
    }

    /// Direction (in the lobe frame, not negated inside), lobe and relative index.
    pub(super) fn sample_glass(&self, u_lobe: f32, u: Vec2) -> Option<(Vec3, Lobe, f32)> {
        let m = self.mf.sample_visible_normal(self.view, u);
        let cos = self.view.dot(m).min(1.0);
        if cos <= 0.0 {
            return None;
        }
        // With dispersion the first digit of the number picks the color.
        let (channel, u_lobe) = if self.b.dispersion > 0.0 {
            let k = ((u_lobe * 3.0) as usize).min(2);
            (k, u_lobe * 3.0 - k as f32)
        } else {
            (1, u_lobe)
        };
        let eta = self.glass_eta(channel);
        let turn = |v: Vec3| if self.inside { -v } else { v };
        if u_lobe < self.reflect_probability(cos, eta) {
            let wi = fresnel::reflect(self.view, m).normalize();
            return (wi.z > 0.0).then_some((turn(wi), Lobe::GLOSSY.union(Lobe::REFLECTION), 1.0));
        }
        let (f, cos_t, _, eta_ti) = fresnel::dielectric(cos, eta);
        let wi = fresnel::refract(self.view, m, cos_t, eta_ti).normalize();
        (f < 1.0 && wi.z < 0.0).then_some((turn(wi), Lobe::GLOSSY.union(Lobe::TRANSMISSION), eta))
    }
}
