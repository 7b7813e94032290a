//! From finishes to scattering models.

use etendue_procedural::{Context, Finish, Layer};
use glam::DVec3;

use super::{Physical, SolidPoint, glow};
use crate::bsdf::microfacet::{Distribution, Microfacet};
use crate::bsdf::{Bsdf, Conductor, Dielectric, Diffuse, RoughConductor, ThinDielectric};
use crate::classic::finish::{metallic, opacity, reflectance};
use crate::classic::{gray, peak};
use crate::material::{MAX_PARTS, Part, Scatter};
use crate::math::{Frame, Vec3};
use crate::solid::SolidHit;
use crate::spectrum::Spectrum;

/// What a stack of layers does with light, summed over the layers.
#[derive(Default)]
pub(super) struct Shares {
    pub(super) diffuse: DVec3,
    pub(super) gloss: DVec3,
    /// Width of the highlights: α of the microfacets, weighted by `gloss`.
    pub(super) alpha: f64,
    pub(super) mirror: DVec3,
    pub(super) passing: DVec3,
    pub(super) normal: Option<DVec3>,
}

/// The most that a surface may return; the rest keeps paths from going on for ever.
const MOST: f64 = 0.99;

impl Physical {
    /// The models at a point of the solids, seen from `wo`.
    pub(crate) fn shade(&self, at: &SolidPoint, wo: Vec3) -> Scatter {
        let hit = self.hit(at);
        let (view, d) = (wo.as_dvec3(), -wo.as_dvec3());
        let back = hit.n.dot(d) > 0.0;
        let n = if back { -hit.n } else { hit.n };
        let mut scatter = Scatter::default();
        let mut total = 0.0;
        self.classic.world.textures(&hit, back, &mut |weight, texture| {
            let Some(texture) = texture else { return };
            texture.resolve(&self.context(&hit, n, d), &mut |share, layers, context| {
                // A third texture of a blend finds no room; the others take its share.
                let weight = weight * share;
                if weight > 1e-4 && scatter.parts.len() + 4 <= MAX_PARTS {
                    total += weight;
                    let shares = self.shares(layers, context, n, view, &hit);
                    self.push(&mut scatter, &shares, weight, n, &hit, layers);
                }
            });
        });
        if total > 0.0 {
            scatter.parts.iter_mut().for_each(|p| p.weight = (f64::from(p.weight) / total) as f32);
        }
        scatter
    }

    /// Radiance that the surface gives by itself towards `wo`.
    pub(crate) fn emitted(&self, at: &SolidPoint, wo: Vec3) -> Spectrum {
        let hit = self.hit(at);
        let d = -wo.as_dvec3();
        let back = hit.n.dot(d) > 0.0;
        let n = if back { -hit.n } else { hit.n };
        let mut sum = DVec3::ZERO;
        self.classic.world.textures(&hit, back, &mut |weight, texture| {
            let Some(texture) = texture else { return };
            texture.resolve(&self.context(&hit, n, d), &mut |share, layers, context| {
                let mut passing = DVec3::ONE;
                for layer in layers.iter().rev() {
                    let pigment = layer.pigment.color(context);
                    let opacity = opacity(&pigment, self.classic.settings().version);
                    let color = self.classic.space.linear_rgb(pigment.rgb * glow(&layer.finish));
                    sum += passing * color * (opacity * weight * share);
                    passing *= pigment.passing();
                }
            });
        });
        Spectrum::from_rgb(sum.as_vec3().max(Vec3::ZERO).to_array())
    }

    pub(super) fn shares(&self, layers: &[Layer], context: &Context, n: DVec3, view: DVec3, hit: &SolidHit<'_>) -> Shares {
        let mut s = Shares { passing: DVec3::ONE, ..Shares::default() };
        for layer in layers.iter().rev() {
            let pigment = layer.pigment.color(context);
            let finish = &*layer.finish;
            let normal = layer.normal.as_ref().map_or(n, |normal| normal.perturb(n, context));
            s.normal.get_or_insert(normal);
            let opacity = opacity(&pigment, self.classic.settings().version).clamp(0.0, 1.0);
            let rgb = self.classic.space.linear_rgb(pigment.rgb);
            let cos = normal.dot(view).clamp(0.0, 1.0);
            s.diffuse += s.passing * rgb * (opacity * diffuse_albedo(finish));
            for (albedo, alpha) in [phong(finish), blinn(finish)].into_iter().flatten() {
                let color = metallic(rgb, finish.metallic, cos) * albedo;
                s.gloss += s.passing * color;
                s.alpha += gray(s.passing * color) * alpha;
            }
            let ior = if finish.reflection.fresnel { index(hit, layers) } else { 1.0 };
            s.mirror += s.passing * reflectance(&finish.reflection, cos, ior, rgb);
            s.passing *= self.classic.space.linear_rgb(pigment.passing());
            if s.passing == DVec3::ZERO {
                break;
            }
        }
        let whole = |v: DVec3| v.clamp(DVec3::ZERO, DVec3::ONE);
        s.alpha /= gray(s.gloss).max(1e-12);
        s.passing = whole(s.passing);
        s.mirror = whole(s.mirror).min(DVec3::splat(MOST));
        s.gloss = s.gloss.clamp(DVec3::ZERO, DVec3::splat(MOST) - s.mirror);
        s.diffuse = s.diffuse.clamp(DVec3::ZERO, DVec3::splat(MOST) - s.mirror - s.gloss);
        s
    }

    /// Adds the models of one stack of layers with a share of the whole. Each is chosen as often as it is bright, and scaled accordingly.
    fn push(&self, out: &mut Scatter, s: &Shares, weight: f64, n: DVec3, hit: &SolidHit<'_>, layers: &[Layer]) {
        let flat = n.as_vec3().normalize_or(Vec3::Z);
        let normal = s.normal.unwrap_or(n).as_vec3().normalize_or(flat);
        // Ripples must not turn the surface away from where light comes and goes.
        let normal = if normal.dot(flat) > 1e-3 { normal } else { flat };
        let face_normal = (normal != flat).then_some(flat);
        let frame = Frame::from_normal(normal);
        let ior = index(hit, layers);
        let refracts = (ior - 1.0).abs() >= 1e-6;
        let through = peak(s.passing);
        // Glass reflects by Fresnel's equations; the mirror of the finish is for what does not let light through.
        let mirror = if refracts && through > 0.5 { DVec3::ZERO } else { s.mirror };
        let lobes = [through, gray(s.diffuse), gray(s.gloss), gray(mirror)];
        let sum: f64 = lobes.iter().sum();
        if !(sum > 0.0) {
            let black = Bsdf::Diffuse(Diffuse { reflectance: Spectrum::ZERO });
            out.parts.push(Part { weight: weight as f32, frame, face_normal, bsdf: black });
            return;
        }
        let share = lobes.map(|l| l / sum);
        let scaled = |color: DVec3, i: usize| Spectrum::from_rgb((color / share[i]).as_vec3().to_array());
        let mut add = |i: usize, frame: Frame, face_normal: Option<Vec3>, bsdf: &dyn Fn() -> Bsdf| {
            if share[i] > 1e-4 {
                let _ = out.parts.try_push(Part { weight: (weight * share[i]) as f32, frame, face_normal, bsdf: bsdf() });
            }
        };
        let specular_transmittance = || scaled(s.passing, 0);
        let specular_reflectance = || scaled(DVec3::splat(through), 0);
        if refracts {
            // Refraction takes sides by the solid's own normal.
            let side = |v: Vec3| if hit.n.dot(n) < 0.0 { -v } else { v };
            let (eta, frame) = (ior as f32, Frame::from_normal(side(normal)));
            add(0, frame, face_normal.map(side), &|| {
                Bsdf::Dielectric(Dielectric {
                    eta,
                    specular_reflectance: specular_reflectance(),
                    specular_transmittance: specular_transmittance(),
                })
            });
        } else {
            let specular_reflectance = Spectrum::ZERO;
            add(0, Frame::from_normal(flat), None, &|| {
                Bsdf::ThinDielectric(ThinDielectric { eta: 1.0, specular_reflectance, specular_transmittance: specular_transmittance() })
            });
        }
        add(1, frame, face_normal, &|| Bsdf::Diffuse(Diffuse { reflectance: scaled(s.diffuse, 1) }));
        add(2, frame, face_normal, &|| {
            let microfacet = Microfacet::new(Distribution::Ggx, s.alpha as f32, s.alpha as f32);
            let (eta, k, specular_reflectance) = (Spectrum::ZERO, Spectrum::ONE, scaled(s.gloss, 2));
            Bsdf::RoughConductor(RoughConductor { microfacet, eta, k, specular_reflectance })
        });
        add(3, frame, face_normal, &|| Bsdf::Conductor(Conductor::mirror(scaled(mirror, 3))));
    }
}

/// Refractive index of the object over that of empty space.
pub(super) fn index(hit: &SolidHit<'_>, layers: &[Layer]) -> f64 {
    let old = layers.iter().rev().find_map(|l| l.finish.old_interior.ior);
    let ior = hit.object.interior.as_ref().map_or(old.unwrap_or(1.0), |i| i.ior);
    if ior > 0.01 && ior < 100.0 { ior } else { 1.0 }
}

/// The share of light that the diffuse term returns. Its peak times cosⁿ, n the brilliance, sums up to 2 / (n + 1) of the peak.
fn diffuse_albedo(finish: &Finish) -> f64 {
    let albedo = if finish.diffuse_albedo { finish.diffuse } else { finish.diffuse * 2.0 / (finish.brilliance + 1.0) };
    albedo.clamp(0.0, 1.0)
}

/// Share of light in Phong's highlight, and the α of microfacets of that width.
///
/// A highlight of peak p under light of irradiance π is a lobe that returns 2 p / (n + 1) (half-vector lobes: 8 p / (n + 8)) of the
/// light. The half-vector's exponent is about four times that about the mirrored direction, and α = √(2 / (n + 2)) (Walter et al. 2007,
/// "Microfacet Models for Refraction through Rough Surfaces").
fn phong(finish: &Finish) -> Option<(f64, f64)> {
    let n = finish.phong_size.clamp(0.0, 1e8);
    let albedo = if finish.phong_albedo { finish.phong } else { 2.0 * finish.phong / (n + 1.0) };
    (finish.phong > 0.0).then(|| (albedo.min(1.0), width(4.0 * n)))
}

/// The same for Blinn's highlight.
fn blinn(finish: &Finish) -> Option<(f64, f64)> {
    let n = (1.0 / finish.roughness).clamp(0.0, 1e8);
    let albedo = if finish.specular_albedo { finish.specular } else { 8.0 * finish.specular / (n + 8.0) };
    (finish.specular > 0.0).then(|| (albedo.min(1.0), width(n)))
}

fn width(n: f64) -> f64 {
    (2.0 / (n + 2.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn highlights_have_the_brightness_that_the_classic_model_shows() {
        // Light and view along the normal: the peak times the light's color c, and irradiance π c.
        for (finish, peak) in [
            (Finish { specular: 0.5, roughness: 0.01, ..Finish::default() }, 0.5),
            (Finish { phong: 0.4, phong_size: 60.0, ..Finish::default() }, 0.4),
        ] {
            let (albedo, alpha) = phong(&finish).or_else(|| blinn(&finish)).unwrap();
            let microfacet = Microfacet::new(Distribution::Beckmann, alpha as f32, alpha as f32);
            let lobe =
                RoughConductor { microfacet, eta: Spectrum::ZERO, k: Spectrum::ONE, specular_reflectance: Spectrum::splat(albedo as f32) };
            let radiance = lobe.eval(Vec3::Z, Vec3::Z, crate::bsdf::TransportMode::Radiance).max_component() * crate::math::PI;
            assert!((f64::from(radiance) / peak - 1.0).abs() < 0.15, "{radiance} for {peak}");
        }
    }
}
