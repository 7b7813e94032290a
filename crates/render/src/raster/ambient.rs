//! What scattering models make of light from everywhere, in closed form.

use super::environment::ReflectanceTable;
use crate::bsdf::{Bsdf, fresnel};
use crate::math::{Vec3, fns};
use crate::spectrum::Spectrum;

/// A model under light from everywhere.
pub(super) struct Ambient {
    /// Share of irradiance that is reflected diffusely.
    pub diffuse: Spectrum,
    /// Share of the irradiance of the other side that comes through.
    pub through: Spectrum,
    /// Reflectance of the blurred mirror.
    pub specular: Spectrum,
    /// Its roughness.
    pub alpha: f32,
}

/// Closed forms of the models that have them; delta lobes are left out.
pub(super) fn ambient(bsdf: &Bsdf, wo: Vec3, table: &ReflectanceTable) -> Option<Ambient> {
    let none = Ambient { diffuse: Spectrum::ZERO, through: Spectrum::ZERO, specular: Spectrum::ZERO, alpha: 0.0 };
    let facing = wo.z > 0.0;
    Some(match bsdf {
        Bsdf::Diffuse(_) | Bsdf::RoughDiffuse(_) => {
            let diffuse = if facing { bsdf.albedo(wo) } else { Spectrum::ZERO };
            Ambient { diffuse, ..none }
        }
        Bsdf::DiffuseTransmission(b) => Ambient { diffuse: b.reflectance, through: b.transmittance, ..none },
        Bsdf::Plastic(_) | Bsdf::RoughPlastic(_) | Bsdf::RoughConductor(_) if !facing => none,
        Bsdf::Plastic(b) => {
            let mirror = b.specular_reflectance * fresnel::dielectric(wo.z, b.eta).0;
            Ambient { diffuse: bsdf.albedo(wo) - mirror, ..none }
        }
        Bsdf::RoughPlastic(b) => {
            let specular = b.specular_reflectance * (1.0 - b.transmittance.eval(wo.z));
            Ambient { diffuse: bsdf.albedo(wo) - specular, specular, alpha: mean_alpha(b.microfacet.alpha_x, b.microfacet.alpha_y), ..none }
        }
        Bsdf::RoughConductor(b) => {
            let alpha = mean_alpha(b.microfacet.alpha_x, b.microfacet.alpha_y);
            let [scale, offset] = table.lookup(wo.z, alpha);
            let f0 = fresnel::conductor(1.0, b.eta, b.k) * b.specular_reflectance;
            Ambient { specular: f0 * scale + b.specular_reflectance * offset, alpha, ..none }
        }
        Bsdf::Pbr(b) => {
            let layered = b.clearcoat > 0.0 || !b.sheen_color.is_black() || b.iridescence > 0.0;
            if layered || b.transmission > 0.0 || b.diffuse_transmission > 0.0 {
                return None;
            }
            let alpha = fns::sqr(b.roughness).max(1e-4);
            let [scale, offset] = table.lookup(wo.z.abs(), alpha);
            let f0 = b.specular_color.map(|c| (c * fresnel::f0_from_eta(b.ior.max(1.0))).min(1.0)) * b.specular;
            let coat = f0 * scale + Spectrum::splat(b.specular * offset);
            let metal = b.base_color * scale + Spectrum::splat(offset);
            let diffuse = b.base_color * ((1.0 - b.metallic) * (1.0 - coat.max_component()).max(0.0));
            Ambient { diffuse, specular: coat.lerp(metal, b.metallic), alpha, ..none }
        }
        _ => return None,
    })
}

fn mean_alpha(x: f32, y: f32) -> f32 {
    (x * y).max(0.0).sqrt()
}
