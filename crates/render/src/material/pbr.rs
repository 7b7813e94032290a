//! The glTF material at a surface point.

use etendue_scene::desc::PbrDesc;

use crate::bsdf::{Bsdf, Pbr};
use crate::math::{Frame, Vec3, fns};

use super::frames::normal_map;
use crate::scene::{Scene, Surface};

/// Evaluates the textures of a glTF material. `frame` is the shading frame with the base's normal map; the coat has its own normal
/// map or none, so its normal is found from the untilted one (`base_normal`, where the frame is tilted).
pub(super) fn shade(scene: &Scene, s: &Surface, wo: Vec3, p: &PbrDesc, frame: &Frame, base_normal: Option<Vec3>) -> Bsdf {
    let number = |v| scene.scalar(v, s);
    let mut anisotropy = number(&p.anisotropy);
    let mut anisotropy_rotation = p.anisotropy_rotation;
    if let Some(texture) = p.anisotropy_direction {
        // Red and green are a direction in tangent space, blue a factor (KHR_materials_anisotropy).
        let [x, y, strength] = scene.texture(texture).color(scene, s).rgb();
        anisotropy *= strength;
        anisotropy_rotation += fns::atan2(2.0 * y - 1.0, 2.0 * x - 1.0);
    }
    let clearcoat = number(&p.clearcoat);
    let clearcoat_normal = if clearcoat > 0.0 {
        let untilted = base_normal.map(|n| Frame { n, ..Frame::from_normal_tangent(n, frame.s) });
        match p.clearcoat_normal {
            Some((texture, scale)) => Some(normal_map(scene, s, &untilted.unwrap_or(*frame), wo, texture, scale).n),
            None => base_normal,
        }
    } else {
        None
    };
    let clearcoat_normal = clearcoat_normal.map(|n| frame.local_from_world(n));
    Bsdf::Pbr(Pbr {
        base_color: scene.color(&p.base_color, s),
        metallic: number(&p.metallic),
        roughness: number(&p.roughness),
        ior: p.ior,
        specular: number(&p.specular),
        specular_color: scene.color(&p.specular_color, s),
        clearcoat,
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
