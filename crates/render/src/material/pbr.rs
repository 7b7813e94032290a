//! The glTF material at a surface point.

use etendue_scene::desc::PbrDesc;

use crate::bsdf::{Bsdf, DiffuseTilt, Pbr};
use crate::math::{Frame, Vec3, fns};

use super::frames::{keep_reflection, normal_map};
use crate::scene::{Scene, Surface};

/// Evaluates the textures of a glTF material. `frame` is the shading frame with the base's normal map; the coat has its own normal
/// map or none, so its normal is found from the untilted one. `tilt`: the untilted normal and that of the base's map before it was bent.
pub(super) fn shade(scene: &Scene, s: &Surface, wo: Vec3, p: &PbrDesc, frame: &Frame, tilt: Option<(Vec3, Vec3)>) -> Bsdf {
    let base_normal = tilt.map(|(base, _)| base);
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
            Some((texture, scale)) => Some(normal_map(scene, s, &untilted.unwrap_or(*frame), wo, texture, scale).0.n),
            None => base_normal,
        }
    } else {
        None
    };
    // What the coat mirrors must be above the base's frame as well, in which all lobes are evaluated.
    let clearcoat_normal = clearcoat_normal.map(|n| frame.local_from_world(keep_reflection(n, frame.n, wo)));
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
        diffuse_tilt: tilt.map(|(base, stored)| DiffuseTilt { base: frame.local_from_world(base), normal: frame.local_from_world(stored) }),
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
