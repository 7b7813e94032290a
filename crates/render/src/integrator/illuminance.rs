//! Irradiance of surfaces and sensors: how much light arrives, whatever the surface makes of it.
//!
//! E = ∫ L cos θ dω over the hemisphere of a normal. Light that comes straight from lights is sampled at the lights; what comes by way
//! of surfaces is sampled by directions in proportion to the cosine, each followed by the path tracer, in whose first sight lights do
//! not show (so that nothing counts twice). Unbiased but for emitters that cannot be sampled (infinite planes).

use super::light_sampling::{sample_one, visibility};
use super::path::first_hit;
use super::{Estimate, Integrator};
use crate::accel::Ray;
use crate::camera::CameraRay;
use crate::light::LightContext;
use crate::math::{Frame, PI, Vec2, Vec3, warp};
use crate::sampler::SampleStream;
use crate::scene::geometry::NONE;
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Shows the irradiance of what the camera sees, on the side that it sees, in W·m⁻² (times 683 lm/W: illuminance).
pub struct Illuminance {
    inner: Box<dyn Integrator>,
}

impl Illuminance {
    /// With the integrator that follows light between surfaces; `direct` asks for light straight from lights alone.
    pub fn new(inner: Box<dyn Integrator>) -> Self {
        Self { inner }
    }
}

/// One estimate of the irradiance at a point on the side of the unit normal `n`. The scene must hide its lights
/// ([`Scene::hide_lights`]). `surface` is where the point is, if it is on one; else the point hangs freely.
pub fn sample_irradiance(
    scene: &Scene,
    inner: &dyn Integrator,
    p: Vec3,
    n: Vec3,
    surface: Option<&Surface>,
    stream: &mut SampleStream,
    kept: &mut Estimate,
) -> Spectrum {
    let frame = Frame::from_normal(n);
    let free = Surface {
        p,
        ng: n,
        frame,
        uv: Vec2::ZERO,
        dpdu: frame.s,
        dpdv: frame.t,
        bary: Vec2::ZERO,
        t: 0.0,
        geometry: 0,
        object: 0,
        primitive: 0,
        material: 0,
        footprint: 0.0,
    };
    let s = surface.unwrap_or(&free);
    let mut sum = Spectrum::ZERO;
    if let Some(direct) = sample_one(scene, &LightContext { p, n }, stream) {
        let cos = direct.sample.wi.dot(n);
        if cos > 0.0 {
            sum += direct.radiance * visibility(scene, s, n, NONE, &direct.sample) * (cos / direct.pdf);
        }
    }
    let d = frame.world_from_local(warp::cosine_hemisphere(stream.next_2d()));
    let ray = Ray::new(s.offset_origin(d), d);
    let camera_ray = CameraRay { ray, weight: 1.0, picture: Vec2::ZERO, u_lens: Vec2::ZERO, spread_rad: 0.0 };
    kept.reset(0);
    inner.estimate(scene, &camera_ray, stream, kept);
    // The density of a direction is cos / π.
    sum + kept.radiance * PI
}

impl Integrator for Illuminance {
    fn hides_lights(&self) -> bool {
        true
    }

    fn estimate(&self, scene: &Scene, camera_ray: &CameraRay, stream: &mut SampleStream, out: &mut Estimate) {
        let Some(s) = scene.intersect(&camera_ray.ray) else { return };
        let wo = -camera_ray.ray.d;
        first_hit(scene, &s, wo, &scene.materials[s.material as usize].shade(scene, &s, wo), s.t, out);
        let n = if s.ng.dot(wo) < 0.0 { -s.ng } else { s.ng };
        let mut kept = Estimate::default();
        out.add(sample_irradiance(scene, self.inner.as_ref(), s.p, n, Some(&s), stream, &mut kept), 0);
    }
}
