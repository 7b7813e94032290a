//! Irradiance of surfaces and sensors: how much light arrives, whatever the surface makes of it.
//!
//! E = ∫ L cos θ dω over the hemisphere of a normal, by the samples of [`Receiver`]: light that comes straight from lights, and what an
//! integrator finds along directions chosen in proportion to the cosine.

use super::irradiance::{Receiver, in_air};
use super::path::first_hit;
use super::{Estimate, Integrator};
use crate::camera::CameraRay;
use crate::math::{Frame, Vec3};
use crate::sampler::SampleStream;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Shows the irradiance of what the camera sees, on the side that it sees, in W·m⁻² (times 683 lm/W: illuminance).
pub struct Illuminance {
    inner: Box<dyn Integrator>,
}

impl Illuminance {
    /// With the integrator that follows light between surfaces.
    pub fn new(inner: Box<dyn Integrator>) -> Self {
        Self { inner }
    }
}

/// One estimate of the irradiance of a surface on the side of its normals. The scene must hide its lights ([`Scene::hide_lights`]).
pub fn sample_irradiance(
    scene: &Scene,
    inner: &dyn Integrator,
    surface: &Surface,
    stream: &mut SampleStream,
    kept: &mut Estimate,
) -> Spectrum {
    let mut sum = Spectrum::ZERO;
    let n = surface.frame.n;
    Receiver { scene, indirect: Some(inner), surface }.gather(stream, kept, |d, radiance| sum += radiance * d.dot(n).max(0.0));
    sum
}

/// A point with a unit normal that is on no surface: a sensor.
pub fn sensor(p: Vec3, n: Vec3) -> Surface {
    let frame = Frame::from_normal(n);
    Surface { ng: n, frame, dpdu: frame.s, dpdv: frame.t, ..in_air(p) }
}

impl Integrator for Illuminance {
    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let Some(mut s) = scene.intersect(&camera_ray.ray) else { return };
        let wo = -camera_ray.ray.d;
        first_hit(scene, &s, wo, &scene.materials[s.material as usize].shade(scene, &s, wo), s.t, out);
        s.ng = if s.ng.dot(wo) < 0.0 { -s.ng } else { s.ng };
        // Of the surface itself, not as normal maps bend it.
        s.frame = Frame::from_normal(s.ng);
        out.add(sample_irradiance(scene, self.inner.as_ref(), &s, stream, &mut Estimate::default()), 0);
    }
}
