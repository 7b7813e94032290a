//! Ambient occlusion: the cosine-weighted share of the hemisphere in which nothing is near.

use super::light_sampling::{first_surface, is_blocked};
use super::path::first_hit;
use super::{Estimate, Integrator};
use crate::accel::Ray;
use crate::camera::CameraRay;
use crate::math::{Frame, warp};
use crate::sampler::SampleStream;
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// White surfaces under a white sky of the given reach. It knows no lights and no materials; media dim what is seen through them and
/// occlude nothing.
#[derive(Clone, Copy, Debug)]
pub struct AmbientOcclusion {
    /// What is farther does not occlude.
    pub distance: f32,
}

impl Integrator for AmbientOcclusion {
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let u = stream.next_2d();
        let mut rng = stream.rng();
        let Some((s, distance, through)) = first_surface(scene, &camera_ray.ray, &mut rng) else { return };
        let wo = -camera_ray.ray.d;
        first_hit(scene, &s, wo, &scene.materials[s.material as usize].shade(scene, &s, wo), distance, out);
        let n = if s.frame.n.dot(wo) < 0.0 { -s.frame.n } else { s.frame.n };
        let d = Frame::from_normal(n).world_from_local(warp::cosine_hemisphere(u));
        // Directions of the shading hemisphere that go into the surface are occluded by it.
        let outside = s.ng.dot(d) * s.ng.dot(wo) > 0.0;
        let ray = Ray { t_max: self.distance, ..Ray::new(s.offset_origin(d), d) };
        if outside && !is_blocked(scene, &ray) {
            out.add(Spectrum::from_rgb([1.0; 3]) * through, 0);
        }
    }
}
