//! Shading normals as colors.

use super::light_sampling::first_surface;
use super::path::first_hit;
use super::{Estimate, Integrator};
use crate::camera::CameraRay;
use crate::sampler::SampleStream;
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// The shading normal in world space on the camera's side, as 0.5 · n + 0.5. For the values themselves take the `normal` AOV.
/// Media dim what is seen through them.
#[derive(Clone, Copy, Debug)]
pub struct Normals;

impl Integrator for Normals {
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let Some((s, distance, through)) = first_surface(scene, &camera_ray.ray, &mut stream.rng()) else { return };
        let wo = -camera_ray.ray.d;
        let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
        first_hit(scene, &s, wo, &scatter, distance, out);
        // The part that weighs most shows its bump and normal maps.
        let n = scatter.parts.first().map_or(s.frame.n, |p| p.frame.n);
        let n = if n.dot(wo) < 0.0 { -n } else { n };
        out.add(Spectrum::from_rgb((n * 0.5 + 0.5).to_array()) * through, 0);
    }
}
