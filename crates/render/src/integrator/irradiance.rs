//! Light that arrives at a point from all directions: irradiance of surfaces and light fields in the air, for baking.
//!
//! One sample is one light (next-event estimation) and one direction, along which an integrator finds the light that surfaces scatter.
//! The two are combined by multiple importance sampling (Veach 1997, chapter 9), as at any vertex of a path. The scene must be compiled
//! with hidden lights ([`Scene::hide_lights`]): then an integrator that starts here does not count again what is found here.

use super::light_sampling::{pdf_infinite, pdf_surface, sample_one, visibility};
use super::{Estimate, Integrator};
use crate::accel::Ray;
use crate::camera::CameraRay;
use crate::light::LightContext;
use crate::math::warp::{UNIFORM_SPHERE_PDF, cosine_hemisphere, cosine_hemisphere_pdf, power_heuristic, uniform_sphere};
use crate::math::{Frame, Vec2, Vec3};
use crate::medium::MediumStack;
use crate::sampler::{HashRng, SampleStream};
use crate::scene::{Scene, Surface};
use crate::spectrum::Spectrum;

/// Surfaces that light may cross straight on.
const MAX_CROSSINGS: u32 = 256;

/// A point that gathers light.
pub struct Receiver<'a> {
    /// The scene, with hidden lights.
    pub scene: &'a Scene,
    /// Finds the light that surfaces scatter; `None` gathers direct light alone.
    pub indirect: Option<&'a dyn Integrator>,
    /// The surface point, its normals on the side that gathers; or a point in the air ([`in_air`]).
    pub surface: &'a Surface,
}

/// A point in the air as a surface without normal.
pub fn in_air(p: Vec3) -> Surface {
    let frame = Frame { s: Vec3::X, t: Vec3::Y, n: Vec3::ZERO };
    Surface::free(p, frame)
}

/// A point that hangs freely as a surface that faces the unit direction `n`: a sensor.
pub fn sensor(p: Vec3, n: Vec3) -> Surface {
    Surface::free(p, Frame::from_normal(n))
}

impl Receiver<'_> {
    fn is_in_air(&self) -> bool {
        self.surface.frame.n == Vec3::ZERO
    }

    /// Density of a direction of the second kind of sample.
    fn pdf(&self, d: Vec3) -> f32 {
        if self.is_in_air() { UNIFORM_SPHERE_PDF } else { cosine_hemisphere_pdf(self.surface.frame.n.dot(d)) }
    }

    /// Whether light from a direction counts: not from below the horizon of either normal.
    fn sees(&self, d: Vec3) -> bool {
        self.is_in_air() || self.surface.frame.n.dot(d) > 0.0 && self.surface.ng.dot(d) > 0.0
    }

    /// One estimate of the irradiance in W·m⁻².
    pub fn irradiance(&self, stream: &mut SampleStream, estimate: &mut Estimate) -> Spectrum {
        let mut sum = Spectrum::ZERO;
        let n = self.surface.frame.n;
        self.gather(stream, estimate, |d, radiance| sum += radiance * n.dot(d).max(0.0));
        sum
    }

    /// One sample: calls back with unit directions towards the light and radiance over density (per solid angle). The sum over
    /// them of radiance · cosine estimates the irradiance in W·m⁻². Values that are not finite are left out.
    pub fn gather(&self, stream: &mut SampleStream, estimate: &mut Estimate, mut add: impl FnMut(Vec3, Spectrum)) {
        let mut add = |d, radiance: Spectrum| {
            if radiance.is_finite() && !radiance.is_black() {
                add(d, radiance);
            }
        };
        let (scene, s) = (self.scene, self.surface);
        let mut rng = stream.rng();
        let ctx = LightContext { p: s.p, n: s.frame.n };
        if let Some(direct) = sample_one(scene, &ctx, stream).filter(|d| self.sees(d.sample.wi)) {
            let wi = direct.sample.wi;
            let weight = if direct.sample.delta { 1.0 } else { power_heuristic(direct.pdf, self.pdf(wi)) };
            let visible = visibility(scene, s, s.ng, &scene.camera_medium, &direct.sample, &mut rng);
            add(wi, direct.radiance * visible * (weight / direct.pdf));
        }
        let u = stream.next_2d();
        let d = if self.is_in_air() { uniform_sphere(u) } else { s.frame.world_from_local(cosine_hemisphere(u)) };
        let pdf = self.pdf(d);
        if !self.sees(d) || !(pdf > 0.0) {
            return;
        }
        let ray = Ray::new(s.offset_origin(d), d);
        let mut radiance = emitted_along(scene, &ctx, ray, pdf, scene.camera_medium, &mut rng);
        if let Some(integrator) = self.indirect {
            estimate.reset(scene.group_names.len());
            integrator.estimate(
                scene,
                &CameraRay { ray, weight: 1.0, picture: Vec2::ZERO, u_lens: Vec2::ZERO, spread_rad: 0.0 },
                stream,
                estimate,
            );
            radiance += estimate.radiance;
        }
        add(d, radiance * (1.0 / pdf));
    }
}

/// Light that comes straight from lights along a ray of a density, through media and surfaces that let it, weighted against their own
/// sampling from `ctx`; `media` are those at the ray's origin.
pub(super) fn emitted_along(
    scene: &Scene,
    ctx: &LightContext,
    mut ray: Ray,
    pdf: f32,
    mut media: MediumStack,
    rng: &mut HashRng,
) -> Spectrum {
    let (mut through, mut sum) = (Spectrum::ONE, Spectrum::ZERO);
    for _ in 0..MAX_CROSSINGS {
        let hit = scene.intersect(&ray);
        if let Some(medium) = scene.medium(&media) {
            through *= medium.transmittance(&ray, hit.as_ref().map_or(ray.t_max, |s| s.t), rng);
        }
        let Some(s) = hit else {
            for &light in &scene.infinite_lights {
                let radiance = scene.lights[light as usize].escaped(ctx.p, ray.d);
                if !radiance.is_black() {
                    sum += through * radiance * power_heuristic(pdf, pdf_infinite(scene, ctx, light, ray.d));
                }
            }
            return sum;
        };
        let radiance = scene.emitted(&s, -ray.d);
        if !radiance.is_black() {
            let weight = s.light(scene).map_or(1.0, |light| power_heuristic(pdf, pdf_surface(scene, ctx, light, &s)));
            sum += through * radiance * weight;
        }
        let material = &scene.materials[s.material as usize];
        if !material.has_null {
            return sum;
        }
        through *= material.shade(scene, &s, -ray.d).null_transmittance(-ray.d);
        if through.is_black() {
            return sum;
        }
        if scene.has_media {
            media.cross(scene, &s, ray.d);
        }
        ray = Ray::new(s.offset_origin(ray.d), ray.d);
    }
    sum
}
