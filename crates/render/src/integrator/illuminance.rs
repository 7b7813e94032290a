//! Irradiance of surfaces and sensors: how much light arrives, whatever the surface makes of it.
//!
//! The estimate is that of [`Receiver`]: next-event estimation, and directions in proportion to the cosine that the path tracer follows.

use super::irradiance::Receiver;
use super::path::first_hit;
use super::{Estimate, Integrator};
use crate::camera::CameraRay;
use crate::math::Frame;
use crate::sampler::SampleStream;
use crate::scene::{Scene, Surface};

/// Shows the irradiance of what the camera sees, on the side that it sees, in W·m⁻² (times 683 lm/W: illuminance). The scene
/// hides its lights ([`super::hides_lights`]).
pub struct Illuminance {
    inner: Box<dyn Integrator>,
}

impl Illuminance {
    /// With the integrator that follows light between surfaces.
    pub fn new(inner: Box<dyn Integrator>) -> Self {
        Self { inner }
    }
}

impl Integrator for Illuminance {
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let Some(s) = scene.intersect(&camera_ray.ray) else { return };
        let wo = -camera_ray.ray.d;
        first_hit(scene, &s, wo, &scene.materials[s.material as usize].shade(scene, &s, wo), s.t, out);
        let n = if s.ng.dot(wo) < 0.0 { -s.ng } else { s.ng };
        let surface = Surface { ng: n, frame: Frame::from_normal(n), ..s };
        let receiver = Receiver { scene, indirect: Some(self.inner.as_ref()), surface: &surface };
        out.add(receiver.irradiance(stream, &mut Estimate::default()), 0);
    }
}
