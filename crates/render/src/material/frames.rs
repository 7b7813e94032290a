//! Shading frames tilted by bump and normal maps.

use etendue_scene::desc::TextureId;

use crate::math::{Frame, Vec3};
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
fn keep_side(tilted: Vec3, n: Vec3, wo: Vec3) -> Vec3 {
    let side = if n.dot(wo) < 0.0 { -1.0 } else { 1.0 };
    let cos = tilted.dot(wo);
    if cos * side >= MIN_COS { tilted } else { (tilted + wo * (MIN_COS * side - cos)).normalize_or(n) }
}

/// The frame with the normal that a picture stores in tangent space.
pub(super) fn normal_map(scene: &Scene, s: &Surface, frame: &Frame, wo: Vec3, texture: TextureId, scale: f32) -> Frame {
    let [r, g, b] = scene.texture(texture).color(scene, s).rgb();
    let stored = Vec3::new((2.0 * r - 1.0) * scale, (2.0 * g - 1.0) * scale, 2.0 * b - 1.0);
    match frame.world_from_local(stored).try_normalize() {
        Some(n) => {
            let tilted = Frame::from_normal_tangent(keep_side(n, frame.n, wo), frame.s);
            // Keep the handedness of the texture coordinates.
            if tilted.t.dot(frame.t) < 0.0 { Frame { t: -tilted.t, ..tilted } } else { tilted }
        }
        None => *frame,
    }
}
