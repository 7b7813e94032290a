//! The simplest path tracer: scatter until a light is met. It shares no light sampling, weights or roulette with the product's.

use etendue_render::accel::Ray;
use etendue_render::bsdf::{Lobe, TransportMode};
use etendue_render::camera::CameraRay;
use etendue_render::integrator::{Estimate, Integrator};
use etendue_render::sampler::SampleStream;
use etendue_render::scene::Scene;
use etendue_render::spectrum::Spectrum;

/// Paths of at most so many scattering events; straight crossings do not count.
pub struct Naive {
    pub max_depth: u32,
}

impl Integrator for Naive {
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let (mut ray, mut throughput, mut depth) = (camera_ray.ray, Spectrum::ONE, 0);
        for _ in 0..1000 {
            let Some(s) = scene.intersect(&ray) else {
                for &light in &scene.infinite_lights {
                    out.add(throughput * scene.lights[light as usize].escaped(ray.o, ray.d), 0);
                }
                return;
            };
            let wo = -ray.d;
            out.add(throughput * scene.emitted(&s, wo), 0);
            let scatter = scene.materials[s.material as usize].shade(scene, &s, wo);
            let (u_lobe, u) = (stream.next_1d(), stream.next_2d());
            let Some(sample) = scatter.sample(wo, u_lobe, u, TransportMode::Radiance) else { return };
            if !sample.lobe.contains(Lobe::NULL) {
                if depth == self.max_depth {
                    return;
                }
                depth += 1;
            }
            throughput *= sample.value / sample.pdf;
            ray = Ray::new(s.offset_origin(sample.wi), sample.wi);
        }
    }
}
