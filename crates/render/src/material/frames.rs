//! Shading frames tilted by bump and normal maps.

use etendue_scene::desc::TextureId;

use crate::math::{Frame, Vec3, fns};
use crate::scene::{Scene, Surface};

/// The frame of a surface displaced by a height field (Blinn 1978, doi:10.1145/800248.507101).
pub(super) fn bump(scene: &Scene, s: &Surface, frame: &Frame, wo: Vec3, texture: TextureId, scale: f32) -> Frame {
    let g = scene.texture(texture).scalar_gradient(scene, s) * scale;
    let n = frame.n;
    let dpdu = s.dpdu + n * (g.x - n.dot(s.dpdu));
    let dpdv = s.dpdv + n * (g.y - n.dot(s.dpdv));
    let Some(mut tilted) = dpdu.cross(dpdv).try_normalize() else { return *frame };
    if tilted.dot(n) < 0.0 {
        tilted = -tilted;
    }
    Frame::from_normal_tangent(keep_side(tilted, n, wo), s.dpdu)
}

/// The least cosine between a tilted normal and the direction to the viewer.
const MIN_COS: f32 = 0.01;

/// Bends a tilted normal back as far as it takes for `wo` to stay on the side of the surface that it is on: a map must not turn
/// what one sees into a black back.
pub(super) fn keep_side(tilted: Vec3, n: Vec3, wo: Vec3) -> Vec3 {
    let side = if n.dot(wo) < 0.0 { -1.0 } else { 1.0 };
    let cos = tilted.dot(wo);
    if cos * side >= MIN_COS { tilted } else { (tilted + wo * (MIN_COS * side - cos)).normalize_or(n) }
}

/// Bends a tilted normal back as far as it takes for the mirror direction of `wo` to stay above the surface: otherwise light that a
/// map reflects into the surface would be lost. The bent normal lies between `tilted` and `ng`.
pub(super) fn keep_reflection(tilted: Vec3, ng: Vec3, wo: Vec3) -> Vec3 {
    let cos = ng.dot(wo);
    let least = MIN_COS.min(0.9 * cos);
    let reflected = tilted * (2.0 * tilted.dot(wo)) - wo;
    let Some(x) = (tilted - ng * tilted.dot(ng)).try_normalize() else { return tilted };
    if cos <= 0.0 || reflected.dot(ng) >= least {
        return tilted;
    }
    // In the plane of both normals, with φ the angle from ng, the mirror direction's height is wx sin 2φ + wz cos 2φ.
    let (wx, wz) = (wo.dot(x), cos);
    let two_phi = fns::atan2(wx, wz) + fns::acos(least / (wx * wx + wz * wz).sqrt());
    let (sin, cos) = fns::sin_cos(0.5 * two_phi);
    (ng * cos + x * sin).normalize_or(ng)
}

/// The frame with the normal that a picture stores in tangent space, bent for the viewer, and that normal as it is stored.
pub(super) fn normal_map(scene: &Scene, s: &Surface, frame: &Frame, wo: Vec3, texture: TextureId, scale: f32) -> (Frame, Vec3) {
    let [r, g, b] = scene.texture(texture).color(scene, s).rgb();
    let stored = Vec3::new((2.0 * r - 1.0) * scale, (2.0 * g - 1.0) * scale, 2.0 * b - 1.0);
    match frame.world_from_local(stored).try_normalize() {
        Some(stored) => {
            let n = stored;
            let ng = if s.ng.dot(wo) < 0.0 { -s.ng } else { s.ng };
            let n = if frame.n.dot(ng) < 0.0 { n } else { keep_reflection(n, ng, wo) };
            let tilted = Frame::from_normal_tangent(keep_side(n, frame.n, wo), frame.s);
            // Keep the handedness of the texture coordinates.
            let t = if tilted.t.dot(frame.t) < 0.0 { -tilted.t } else { tilted.t };
            (Frame { t, ..tilted }, stored)
        }
        None => (*frame, frame.n),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bent_normals_reflect_above_the_surface_and_others_stay() {
        let ng = Vec3::Z;
        for (theta, phi) in [(1.4f32, 0.3f32), (1.5, 2.0), (0.7, 1.0), (1.55, 3.0)] {
            let wo = Vec3::new(fns::sin(theta) * fns::cos(phi), fns::sin(theta) * fns::sin(phi), fns::cos(theta));
            for i in 0..40 {
                let (t, p) = (0.035 * i as f32, 0.7 * i as f32);
                let tilted = Vec3::new(fns::sin(t) * fns::cos(p), fns::sin(t) * fns::sin(p), fns::cos(t));
                let n = keep_reflection(tilted, ng, wo);
                let height = |n: Vec3| (n * (2.0 * n.dot(wo)) - wo).dot(ng);
                let least = MIN_COS.min(0.9 * wo.z);
                assert!((n.length() - 1.0).abs() < 1e-5 && height(n) >= least - 1e-5, "{tilted} {wo} {n}");
                assert!(height(tilted) < least || n == tilted);
                assert!(n.dot(tilted) >= ng.dot(tilted) - 1e-5 && n.dot(wo) > 0.0, "between both normals");
            }
        }
    }
}
