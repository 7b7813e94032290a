//! What radiosity sees of materials: a diffuse reflectance, and a share of light that passes.

use etendue_scene::desc::BsdfDesc;

use crate::bsdf::Bsdf;
use crate::material::{Material, Scatter};
use crate::math::Vec3;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// What a side of a surface does with light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SideOptics {
    /// Diffuse reflectance, each lane in [0, [`MAX_REFLECTANCE`]].
    pub reflectance: Spectrum,
    /// Emitted radiosity, W·m⁻².
    pub emission: Spectrum,
    /// Whether the material is something else than diffuse, and was taken for diffuse.
    pub inexact: bool,
}

/// Brighter surfaces are taken for this bright: between perfectly white ones light never ends.
pub const MAX_REFLECTANCE: f32 = 0.999;

/// The diffuse reflectance of what scatters at a point, seen from `wo`, and whether that is all that it does.
///
/// Ideal and rough diffuse models have theirs. Metals, plastics and layered models have their albedo at this angle: all the light
/// that they reflect, spread out evenly. Glass and what is not there at all reflect nothing: light passes, see [`passing_share`].
/// Light that a translucent sheet lets through to its other side is lost.
pub fn diffuse_reflectance(scatter: &Scatter, wo: Vec3) -> (Spectrum, bool) {
    let (mut sum, mut inexact) = (Spectrum::ZERO, false);
    for part in &scatter.parts {
        let reflectance = match &part.bsdf {
            Bsdf::Diffuse(b) => b.reflectance,
            Bsdf::Null(_) => Spectrum::ZERO,
            Bsdf::DiffuseTransmission(b) => {
                inexact = true;
                b.reflectance
            }
            Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_) | Bsdf::RoughDielectric(_) => {
                inexact = true;
                Spectrum::ZERO
            }
            other => {
                inexact = true;
                other.albedo(part.frame.local_from_world(wo))
            }
        };
        // One-sided models are black from behind.
        if part.frame.n.dot(wo) > 0.0 || !matches!(part.bsdf, Bsdf::Diffuse(_) | Bsdf::RoughDiffuse(_)) {
            sum += reflectance * part.weight;
        }
    }
    let limit = |v: f32| if v.is_finite() { v.clamp(0.0, MAX_REFLECTANCE) } else { 0.0 };
    (sum.map(limit), inexact)
}

/// The optics of a surface point on the side of the unit vector `wo`, which is along the normal.
pub fn side_optics(scene: &Scene, s: &Surface, wo: Vec3) -> SideOptics {
    let scatter = scene.materials[s.material as usize].shade(scene, s, wo);
    let (reflectance, inexact) = diffuse_reflectance(&scatter, wo);
    let emitted = scene.emitted(s, wo) * std::f32::consts::PI;
    // Numbers beyond this would overflow in sums over a scene.
    let limit = |v: f32| if v.is_finite() { v.clamp(0.0, 1e18) } else { 0.0 };
    SideOptics { reflectance, emission: emitted.map(limit), inexact }
}

/// Whether any light may pass straight through a material; cheap.
pub fn may_pass(scene: &Scene, material: &Material) -> bool {
    material.has_null || may_refract(scene, material, 0)
}

fn may_refract(scene: &Scene, material: &Material, depth: u32) -> bool {
    let nested = |id: etendue_scene::desc::BsdfId| depth < 16 && may_refract(scene, &scene.materials[id.0 as usize], depth + 1);
    match &material.desc {
        BsdfDesc::Dielectric { .. } => true,
        BsdfDesc::Blend { first, second, .. } => nested(*first) || nested(*second),
        BsdfDesc::TwoSided { front, back } => nested(*front) || nested(*back),
        BsdfDesc::Mask { nested: n, .. } | BsdfDesc::BumpMap { nested: n, .. } | BsdfDesc::NormalMap { nested: n, .. } => nested(*n),
        _ => false,
    }
}

/// The share of light that goes straight on through what scatters at a point: all of it where nothing is, what Fresnel's equations
/// leave at a border of glass (which does not bend it here).
pub fn passing_share(scatter: &Scatter, wo: Vec3) -> f32 {
    let mut share = scatter.null_transmittance(wo).average();
    for part in &scatter.parts {
        let cos = part.frame.n.dot(wo).abs();
        let (eta, tint) = match &part.bsdf {
            Bsdf::Dielectric(b) => (b.eta, b.specular_transmittance),
            Bsdf::RoughDielectric(b) => (b.eta, b.specular_transmittance),
            _ => continue,
        };
        // Schlick's form (1994, doi:10.1111/1467-8659.1330233) is near enough for light that is not bent either.
        let r0 = crate::math::fns::sqr((eta - 1.0) / (eta + 1.0));
        let m = (1.0 - cos).clamp(0.0, 1.0);
        share += part.weight * tint.average() * (1.0 - (r0 + (1.0 - r0) * m * m * m * m * m));
    }
    if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
}
