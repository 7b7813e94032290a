//! The glTF material at a surface point.

use etendue_scene::desc::PbrDesc;

use crate::bsdf::{Bsdf, Pbr};
use crate::math::{Vec3, fns};
use crate::scene::{Scene, Surface};

/// Evaluates the textures of a glTF material.
pub(super) fn shade(scene: &Scene, s: &Surface, p: &PbrDesc) -> Bsdf {
    let number = |v| scene.scalar(v, s);
    let mut anisotropy = number(&p.anisotropy);
    let mut anisotropy_rotation = p.anisotropy_rotation;
    if let Some(texture) = p.anisotropy_direction {
        // Red and green are a direction in tangent space, blue a factor (KHR_materials_anisotropy).
        let [x, y, strength] = scene.texture(texture).color(scene, s).rgb();
        anisotropy *= strength;
        anisotropy_rotation += fns::atan2(2.0 * y - 1.0, 2.0 * x - 1.0);
    }
    let clearcoat_normal = p.clearcoat_normal.map(|(texture, scale)| {
        let [x, y, z] = scene.texture(texture).color(scene, s).rgb();
        Vec3::new((2.0 * x - 1.0) * scale, (2.0 * y - 1.0) * scale, 2.0 * z - 1.0).normalize_or(Vec3::Z)
    });
    Bsdf::Pbr(Pbr {
        base_color: scene.color(&p.base_color, s),
        metallic: number(&p.metallic),
        roughness: number(&p.roughness),
        ior: p.ior,
        specular: number(&p.specular),
        specular_color: scene.color(&p.specular_color, s),
        clearcoat: number(&p.clearcoat),
        clearcoat_roughness: number(&p.clearcoat_roughness),
        clearcoat_normal,
        sheen_color: scene.color(&p.sheen_color, s),
        sheen_roughness: number(&p.sheen_roughness),
        transmission: number(&p.transmission),
        thin_walled: !p.volume,
        iridescence: number(&p.iridescence),
        iridescence_ior: p.iridescence_ior,
        iridescence_thickness_nm: number(&p.iridescence_thickness_nm),
        anisotropy,
        anisotropy_rotation,
        dispersion: p.dispersion,
        ..Pbr::default()
    })
}
